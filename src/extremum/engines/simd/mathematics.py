"""The functions of `symbols.FUNCTIONS` and powers as LLVM instructions, for lanes of any width.

Straight lines: no branch, no table, no call. Sums and products are kept as written (an emitter
that fuses is not used here), so that a lane's result depends on its own argument only and is the
same, bit for bit, in a vector of any width. ±0, ±∞, NaN, subnormals and the ends of domains give
what C's functions give; but sin, cos and tan are NaN beyond |x| = 10¹² (10⁵ in 32 bits), because
no reduction reaches there.

Largest errors found, in units of the last place, over the whole domain: of ten million or more
random arguments in 64 bits, of every seventh number in 32 bits (pow, atan2: of millions).

========= ====== ======
function  64 bit 32 bit
========= ====== ======
exp       1.19   1.08
log       0.82   0.83
pow       1.32   1.20
sin, cos  1.63   1.78
tan       3.71   3.65
asin      2.20   1.88
acos      1.20   1.27
atan      2.19   2.09
atan2     2.40   2.24
sinh      2.32   2.31
cosh      1.48   1.50
tanh      2.58   2.46
asinh     1.73   1.70
acosh     2.20   2.00
atanh     1.97   1.99
sqrt      0.50   0.50
========= ====== ======
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from .angles import cos, sin, sincos, tan
from .arcs import acos, asin, atan, atan2
from .emitter import Emitter
from .exponentials import cosh, exp, sinh, tanh
from .logarithms import acosh, asinh, atanh, log, power

__all__ = ["FUNCTIONS", "sincos"]

FUNCTIONS: Final[Mapping[str, Callable[..., str]]] = {
    **{f.__name__: f for f in (exp, log, sin, cos, tan, asin, acos, atan, atan2)},
    **{f.__name__: f for f in (sinh, cosh, tanh, asinh, acosh, atanh)},
    "sqrt": Emitter.root,
    "pow": power,
}
"""By name; called with an emitter and the names of values."""
