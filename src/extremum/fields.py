"""Fields: the scalar map J(position, t) that the vehicle senses and does not know.

A field is one small class: its numbers and its `law`. We maximise J.
"""

from __future__ import annotations

import inspect
import re
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray
from sympy import Expr, Symbol
from sympy.core.function import AppliedUndef
from sympy.printing.str import StrPrinter

from .description import Description, part, structure, value
from .errors import InvalidDescription, shown, suggestion
from .paths import Path, as_path
from .symbols import FUNCTIONS, coordinates, decimals_exact, is_coordinate, letters, parse, plain, t
from .system import Oracle


class Field(Description, abstract=True):
    """A scalar map. Subclasses state `law`; those known by values only add `oracles`."""

    @abstractmethod
    def law(self, p: Sequence[Expr]) -> Expr:
        """Return J at position `p`, an expression of the coordinates, `t` and the parameters."""

    def dimension(self) -> int | None:
        """Return the number of coordinates the field wants, or None if any."""
        return None

    def maximum(self) -> tuple[Expr, ...] | None:
        """Return where the source is at time `t`, or None if the field does not say."""
        return None

    def oracles(self) -> Mapping[str, Oracle]:
        """Return the functions known by their values only that `law` uses, by name."""
        return {}

    def at(self, *position: ArrayLike, time: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Return J at positions given as one array per axis (m), which broadcast.

        NaN where the field has no value, such as outside a gridded field's data.
        """
        wanted = self.dimension()
        if wanted is not None and len(position) != wanted:
            raise InvalidDescription("position", f"has {len(position)} axes, the field {wanted}")
        names, oracles = coordinates(len(position)), self.oracles()
        law = self.law(names)
        within = [
            guard
            for call in law.atoms(AppliedUndef)
            for guard in oracles[call.func.__name__].guards(call.args)
        ]
        library = {n: o.vectorised() for n, o in oracles.items()}
        evaluate = sympy.lambdify([*names, t], [law, *within], [library, "numpy"], dummify=True)
        arrays = np.broadcast_arrays(*(np.asarray(p, dtype=float) for p in (*position, time)))
        with np.errstate(all="ignore"):
            values, *margins = (np.broadcast_to(e, arrays[0].shape) for e in evaluate(*arrays))
        inside = np.logical_and.reduce([np.isfinite(values), *(m >= 0 for m in margins)])
        return np.where(inside, values, np.nan)


class _Peaked(Field, abstract=True):
    """A field with a stated source."""

    source: tuple[float, ...] = value("{axis}^*", "m", "where the maximum is", shape="vector")

    def dimension(self) -> int | None:
        return len(self.source)

    def maximum(self) -> tuple[Expr, ...] | None:
        return tuple(sympy.sympify(c) for c in self.source)

    def _offset(self, p: Sequence[Expr]) -> list[Expr]:
        return [x - c for x, c in zip(p, self.source, strict=True)]


class Quadratic(_Peaked):
    """J = f* − Σ qᵢ (pᵢ − pᵢ*)², or with a symmetric matrix J = f* − p̃ᵀ q p̃, p̃ = p − p*.

    The Hessian is −2q. Source: Zhang, Siranosian and Krstić (2007), equation (2).

    Parameters
    ----------
    source
        p* (m), one number per axis.
    q
        Curvatures qᵢ (1/m²), one per axis, or the symmetric matrix q; ``q.0.1`` and ``q.1.0``
        are one parameter.
    peak
        f*, the value at the source.
    """

    q: Any = value("q_", "1/m^2", "curvature, per axis or as a matrix", shape="vector or matrix")
    peak: float = value("f^*", "1", "the value at the source", default=0.0)

    def check(self) -> None:
        """Refuse a curvature whose size differs from the source's."""
        if len(self.q) != len(self.source):
            raise InvalidDescription(
                "q",
                f"has {len(self.q)} entries for a source with {len(self.source)} coordinates; "
                "give one per axis",
                shown(self.q),
            )

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return f* − p̃ᵀ q p̃."""
        offset = self._offset(p)
        if isinstance(self.q[0], tuple):
            size = range(len(offset))
            terms = [self.q[i][i] * offset[i] ** 2 for i in size]
            terms += [
                2 * self.q[i][j] * offset[i] * offset[j]
                for i in size
                for j in range(i + 1, len(offset))
            ]
        else:
            terms = [q * x**2 for q, x in zip(self.q, offset, strict=True)]
        return self.peak - sympy.Add(*terms)


class Gaussian(_Peaked):
    """J = f* exp(−Σ (pᵢ − pᵢ*)² / (2 σᵢ²)); curvature at the source qᵢ = f*/(2 σᵢ²).

    Parameters
    ----------
    source
        p* (m), one number per axis.
    width
        σ (m), one number for all axes or one per axis.
    peak
        f*, the value at the source.
    """

    width: Any = value(
        "sigma", "m", "σ, standard deviation", shape="scalar or vector", positive=True, default=1.0
    )
    peak: float = value("f^*", "1", "the value at the source", default=1.0)

    def check(self) -> None:
        """Refuse widths whose number differs from the source's."""
        _check_widths(self.width, self.source)

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return f* exp(−Σ p̃ᵢ²/(2σᵢ²))."""
        return self.peak * sympy.exp(-_scaled(self._offset(p), self.width) / 2)


class InverseSquare(_Peaked):
    """J = f* / (1 + r²/w²): the inverse square law, softened so that it has a maximum.

    r² = Σ (pᵢ − pᵢ*)². Far away J ≈ f* w²/r², as from a point source of strength f* w²; a pure 1/r²
    has no maximum to seek. Curvature at the source: q = f*/w².

    Parameters
    ----------
    source
        p* (m), one number per axis.
    width
        w (m), the distance at which the signal has fallen to half.
    peak
        f*, the value at the source.
    """

    width: float = value("w", "m", "w, the distance of half the peak", positive=True, default=1.0)
    peak: float = value("f^*", "1", "the value at the source", default=1.0)

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return f*/(1 + r²/w²)."""
        return self.peak / (1 + _scaled(self._offset(p), self.width))


def _check_widths(width: Any, source: Sequence[float]) -> None:
    if isinstance(width, tuple) and len(width) != len(source):
        raise InvalidDescription(
            "width",
            f"has {len(width)} entries for a source with {len(source)} coordinates",
            shown(width),
        )


def _scaled(offset: Sequence[Expr], width: Any) -> Expr:
    if isinstance(width, tuple):
        return sympy.Add(*(x**2 / w**2 for x, w in zip(offset, width, strict=True)))
    return sympy.Add(*(x**2 for x in offset)) / width**2


class Expression(Field):
    """J as a formula in x, y, z (x1 … xn beyond three axes), t and named parameters.

    ``Expression("exp(-a*(x**2 + y**2))", parameters={"a": 0.5})``. Numbers written in the text are
    structure; the parameters are values that can be swept.

    Parameters
    ----------
    formula
        The text: numbers, coordinates, ``t``, ``pi``, parameters, ``+ - * / **`` and the functions
        exp, log, sqrt, sin, cos, tan, asin, acos, atan, atan2, sinh, cosh, tanh and their inverses.
    parameters
        Name → value.
    """

    formula: str = structure("J as mathematics in x, y, z, t and the parameters")
    parameters: Mapping[str, float] = value(
        "", "", "values of the letters", default=None, shape="table"
    )

    def check(self) -> None:
        """Refuse text that cannot be read."""
        if not isinstance(self.formula, str):
            raise InvalidDescription("formula", "must be text", shown(self.formula))
        for name in self.parameters:
            if is_coordinate(name):
                raise InvalidDescription(f"parameters.{name}", "is the name of a coordinate")
        numbered = [int(n) for n in re.findall(r"\bx(\d{1,3})\b", self.formula)]
        try:
            self._read(letters(self.parameters), coordinates(max(numbered, default=3)))
        except InvalidDescription as error:
            raise error.within("formula") from None

    def _read(self, names: Mapping[str, Any], p: Sequence[Expr]) -> Expr:
        named = {f"x{i + 1}": x for i, x in enumerate(p)}
        named |= dict(zip("xyz", p, strict=False)) if len(p) <= 3 else {}
        return parse(self.formula, {"t": t, **named, **names})

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return the formula with the coordinates and parameters put in."""
        return self._read({name: plain(v) for name, v in self.parameters.items()}, p)


def field_from(
    function: Callable[..., Any], parameters: Mapping[str, float] | None = None
) -> Expression:
    """Return the `Expression` that a Python function of position and time computes.

    The function is called once with symbols: arguments named x, y, z (or x1 … xn) and t are the
    coordinates and time, the others must be in `parameters`. Write it with ``es.exp``, ``es.sin``
    …, which work on numbers too::

        es.field_from(lambda x, y, a: es.exp(-a * (x**2 + y**2)), parameters={"a": 0.5})

    Raises
    ------
    InvalidDescription
        If the function cannot be traced: it branches on its arguments, calls something that does
        not take symbols (NumPy's and math's functions), or wants an unknown argument.
    """
    if not callable(function):
        raise InvalidDescription("", "field_from takes a function of x, y, …", shown(function))
    given = dict(parameters or {})
    names = list(inspect.signature(function).parameters)
    for name in names:
        if name != "t" and not is_coordinate(name) and name not in given:
            hint = suggestion(name, {"x", "y", "z", "t", *given})
            raise InvalidDescription(name, f"is neither a coordinate, t nor a parameter; {hint}")
    symbols = {name: t if name == "t" else Symbol(name, real=True) for name in names}
    try:
        traced = sympy.sympify(function(**symbols), strict=True)
    except Exception as error:
        raise InvalidDescription(
            "",
            f"the function cannot be traced to an expression ({type(error).__name__}: {error}); "
            "write it with es.exp, es.sin, … and without branches, or use es.Opaque",
            getattr(function, "__name__", ""),
        ) from error
    if not isinstance(traced, Expr):
        raise InvalidDescription("", "the function must return a number", shown(traced))
    known = {*FUNCTIONS.values(), sympy.exp}
    for part_ in sympy.preorder_traversal(traced):
        if isinstance(part_, sympy.Function) and part_.func not in known:
            raise InvalidDescription(
                "",
                f"uses {part_.func}, which not every engine has; known: {', '.join(FUNCTIONS)}",
                shown(str(traced)),
            )
    return Expression(_Formula().doprint(decimals_exact(traced)), parameters=given)


class _Formula(StrPrinter):
    def _print_Exp1(self, expr: Any) -> Any:  # noqa: N802 - SymPy's naming
        return "exp(1)"


class Opaque(Field):
    """J by any Python callable of position (array of length n) and time, returning a float.

    Nothing is known of it but its values: the reference engine integrates it, and it cannot be
    written to a scenario file.

    Parameters
    ----------
    function
        ``function(position, t) -> float``.
    """

    function: Callable[..., float] = structure("function(position, t) -> float")

    def check(self) -> None:
        """Refuse what cannot be called."""
        if not callable(self.function):
            raise InvalidDescription("function", "must be callable", shown(self.function))

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return f(p, t) with f left undefined."""
        return sympy.Function("f")(*p, t)

    def oracles(self) -> Mapping[str, Oracle]:
        """Return the callable under the name f."""
        function = self.function

        def asked(*arguments: float) -> float:
            try:
                return float(function(np.array(arguments[:-1]), arguments[-1]))
            except Exception as error:
                raise RuntimeError(f"the field's function failed: {error!r}") from error

        return {"f": Oracle(asked)}


class Moving(Field):
    """A field carried along a path: J(p, t) = field(p − d(t), t), d the path.

    The source is at the field's own source plus d(t).

    Parameters
    ----------
    field
        The field that moves.
    path
        `FigureEight`, `Circle`, `Line`, `Along`, or a tuple of expressions in t, such as
        ``("sin(0.1*t)", "0.2*t")``.
    """

    field: Field = part(Field, "the field that moves")
    path: Path = part(Path, "its displacement over time", converter=as_path)

    def check(self) -> None:
        """Refuse a path whose dimension differs from the field's."""
        have, want = self.path.dimension(), self.field.dimension()
        if want is not None and have != want:
            raise InvalidDescription(
                "path", f"has {have} coordinates, the field has {want}; they must agree"
            )

    def dimension(self) -> int | None:
        """Return the path's."""
        return self.path.dimension()

    def law(self, p: Sequence[Expr]) -> Expr:
        """Return the field's law at p − d(t)."""
        return self.field.law([x - d for x, d in zip(p, self.path.law(), strict=True)])

    def maximum(self) -> tuple[Expr, ...] | None:
        """Return the field's source plus d(t)."""
        still = self.field.maximum()
        if still is None:
            return None
        return tuple(c + d for c, d in zip(still, self.path.law(), strict=True))

    def oracles(self) -> Mapping[str, Oracle]:
        """Return the carried field's."""
        return self.field.oracles()
