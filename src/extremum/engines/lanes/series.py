"""Power series of a loop's solution around the beginning of a step, recorded on a tape.

A series is Σ x_k θ^k, θ = (time since the step began)/H with a fixed unit of time H, whatever the
step's length. A state's follow from its rate, x_{k+1} = H/(k+1) ẋ_k; products convolve,
(ab)_k = Σ_j a_j b_{k−j}; f(a) with f' = w(a) follows from k f_k = Σ_j j a_j w_{k−j}. Sources: Jorba
and Zou, Experimental Mathematics 14 (2005), propositions 2.1 and 2.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from sympy import Expr, Symbol

from .reading import Plain, Reading
from .tape import Tape


class Series:
    """Coefficients on a tape, each recorded when it is first asked for."""

    def __init__(self, coefficient: Callable[[int], int]) -> None:
        self._coefficient = coefficient
        self._known: list[int] = []

    def __getitem__(self, k: int) -> int:
        while len(self._known) <= k:
            self._known.append(self._coefficient(len(self._known)))
        return self._known[k]


class Scaled(Series):
    """scale · base, the scale constant during a step: products collect scales."""

    def __init__(self, tape: Tape, scale: int, base: Series) -> None:
        super().__init__(lambda k: tape.multiply(scale, base[k]))
        self.scale, self.base = scale, base


class Wave(Series):
    """scale · sin or scale · cos of an oscillator's angle."""

    def __init__(self, powers: Powers, is_sine: bool, scale: int) -> None:
        super().__init__(self._of_order)
        self.powers, self.is_sine, self.scale = powers, is_sine, scale

    def _of_order(self, k: int) -> int:
        tape = self.powers.tape
        even, odd = self.parts()
        return tape.multiply(odd if k % 2 else even, self.powers[k])

    def parts(self) -> tuple[int, int]:
        """Return what multiplies the series of cos ωτ and of sin ωτ, τ since the step began."""
        tape, (sine, cosine) = self.powers.tape, self.powers.beginning
        even, odd = (sine, cosine) if self.is_sine else (cosine, tape.negative(sine))
        return tape.product([self.scale, even]), tape.product([self.scale, odd])


class Powers:
    """(ωH)^k/k! with the signs of cos ωτ (even k) and sin ωτ (odd k), and products with them.

    Parameters
    ----------
    angle
        ωH.
    beginning
        sin ωt and cos ωt at the step's beginning.
    """

    def __init__(self, tape: Tape, angle: int, beginning: tuple[int, int]) -> None:
        self.tape, self.angle, self.beginning = tape, angle, beginning
        self._powers = [tape.constant(1.0)]
        self._split: dict[Series, tuple[Series, Series]] = {}

    def __getitem__(self, k: int) -> int:
        while len(self._powers) <= k:
            n = len(self._powers)
            following = self.tape.multiply(self._powers[-1], self.angle)
            self._powers.append(self.tape.multiply(following, self.tape.constant(1 / n)))
        power = self._powers[k]
        return self.tape.negative(power) if k % 4 in (2, 3) else power

    def split(self, series: Series) -> tuple[Series, Series]:
        """Return a series times cos ωτ, and times sin ωτ."""
        if series not in self._split:
            self._split[series] = (
                Series(lambda k: self._times(series, k, 0)),
                Series(lambda k: self._times(series, k, 1)),
            )
        return self._split[series]

    def _times(self, series: Series, k: int, first: int) -> int:
        orders = range(first, k + 1, 2)
        return self.tape.convolution((series[k - j], self[j]) for j in reversed(orders))


class SeriesReading(Reading[Series]):
    """Reads expressions into series.

    Parameters
    ----------
    constants
        Reads what is constant during a step: parameters.
    bound
        The series of states and time.
    waves
        ω → its `Powers`.
    """

    def __init__(
        self,
        constants: Plain,
        bound: Mapping[Symbol, Series],
        waves: Callable[[Expr], Powers],
    ) -> None:
        super().__init__(constants.tape, bound, constants.time, constants.parameters)
        self.constants, self.waves = constants, waves
        self._fixed: dict[Series, int] = {}
        self._slopes: dict[Series, Series] = {}
        self._squares: dict[Series, Series] = {}
        self._pairs: dict[tuple[Series, bool], tuple[Series, Series]] = {}

    def read(self, expression: Expr) -> Series:
        """Return the series of an expression."""
        if expression not in self._read and expression.free_symbols <= self.parameters:
            self._read[expression] = self.fixed(self.constants.read(expression))
        return super().read(expression)

    def fixed(self, value: int) -> Series:
        """Return the series of what is constant during a step."""
        zero = self.tape.constant(0.0)
        series = Series(lambda k: zero if k else value)
        self._fixed[series] = value
        return series

    def number(self, number: float) -> Series:
        """Return the series of a number."""
        return self.fixed(self.tape.constant(number))

    def total(self, values: Sequence[Series]) -> Series:
        """Return a sum, coefficient by coefficient."""
        return Series(lambda k: self.tape.total([value[k] for value in values]))

    def product(self, values: Sequence[Series]) -> Series:
        """Return a product: what is constant first, then series, then waves."""
        scales = [v.scale for v in values if isinstance(v, Scaled)]
        values = [v.base if isinstance(v, Scaled) else v for v in values]
        scale = self.tape.product([*scales, *(self._fixed[v] for v in values if v in self._fixed)])
        waves = [v for v in values if isinstance(v, Wave)]
        others = [v for v in values if v not in self._fixed and not isinstance(v, Wave)]
        if not others and not waves:
            return self.fixed(scale)
        if not others:
            first = waves.pop(0)
            wave = Wave(first.powers, first.is_sine, self.tape.product([first.scale, scale]))
            others, scale = [wave], self.tape.constant(1.0)
        result = others[0]
        for other in others[1:]:
            result = self._convolved(result, other)
        for wave in waves:
            result, scale = self._modulated(result, wave, scale), self.tape.constant(1.0)
        return self._scaled(result, scale)

    def _scaled(self, series: Series, scale: int) -> Series:
        if self.tape.known(scale) == 1:
            return series
        return Scaled(self.tape, scale, series)

    def _modulated(self, series: Series, wave: Wave, scale: int) -> Series:
        tape = self.tape
        even, odd = (tape.product([scale, part]) for part in wave.parts())
        cosine, sine = wave.powers.split(series)
        return Series(lambda k: tape.convolution([(odd, sine[k]), (even, cosine[k])]))

    def _convolved(self, a: Series, b: Series) -> Series:
        if a is b:
            return self.square(a)
        return Series(lambda k: self.tape.convolution((a[i], b[k - i]) for i in _newest_last(k)))

    def square(self, value: Series) -> Series:
        """Return a square, each pair of coefficients taken once."""
        if value in self._fixed:
            return self.fixed(self.tape.multiply(self._fixed[value], self._fixed[value]))
        if value not in self._squares:
            tape, half = self.tape, self.tape.constant(0.5)

            def coefficient(k: int) -> int:
                pairs = [(value[i], value[k - i]) for i in _newest_last(k) if i < k - i]
                middle = value[k // 2]
                twin = [(tape.multiply(half, middle), middle)] if k % 2 == 0 else []
                return tape.convolution([*twin, *pairs])

            self._squares[value] = Scaled(tape, tape.constant(2.0), Series(coefficient))
        return self._squares[value]

    def reciprocal(self, value: Series) -> Series:
        """Return 1/b: q_k = −Σ_j b_j q_{k−j}/b_0."""
        tape = self.tape
        if value in self._fixed:
            return self.fixed(self.constants.reciprocal(self._fixed[value]))

        def coefficient(k: int) -> int:
            first = self.constants.reciprocal(value[0])
            if k == 0:
                return first
            rest = tape.convolution((value[k - i], result[i]) for i in range(k))
            return tape.negative(tape.multiply(rest, first))

        result = Series(coefficient)
        return result

    def oscillator(self, frequency: Expr) -> tuple[Series, Series]:
        """Return sin ωt and cos ωt."""
        powers, one = self.waves(frequency), self.tape.constant(1.0)
        return Wave(powers, True, one), Wave(powers, False, one)

    def oracle(self, name: str, arguments: Sequence[Series]) -> Series:
        """Refuse: a table has no power series."""
        raise TypeError(f"{name} is a table; it has no power series")

    def call(self, name: str, arguments: Sequence[Series]) -> Series:
        """Return a function of a series, from its value at the beginning and its derivative."""
        if all(a in self._fixed for a in arguments):
            return self.fixed(self.tape.call(name, *(self._fixed[a] for a in arguments)))
        if name == "pow":
            return self._real_power(*arguments)
        if name == "atan2":
            return self._angle(*arguments)
        (a,) = arguments
        if name == "sqrt":
            return self._raised(a, self.tape.constant(0.5), self.tape.call("sqrt", a[0]))
        if name in ("sin", "cos", "sinh", "cosh"):
            return self._pair(a, name)[name in ("cos", "cosh")]
        return self._grown(name, a, lambda result: self._derivative(name, a, result))

    def _derivative(self, name: str, a: Series, result: Series) -> Series:
        """Return f'(a) as a series; `result` is f(a)."""
        one, minus = self.number(1.0), self.number(-1.0)

        def of_square(series: Series, first: Series, sign: Series) -> Series:
            return self.total([first, self.product([sign, self.square(series)])])

        match name:
            case "exp":
                return result
            case "log":
                return self.reciprocal(a)
            case "tan":
                return of_square(result, one, one)
            case "tanh":
                return of_square(result, one, minus)
            case "atan":
                return self.reciprocal(of_square(a, one, one))
            case "atanh":
                return self.reciprocal(of_square(a, one, minus))
            case "asin":
                return self._inverse_root(of_square(a, one, minus))
            case "acos":
                return self.product([minus, self._inverse_root(of_square(a, one, minus))])
            case "asinh":
                return self._inverse_root(of_square(a, one, one))
            case "acosh":
                return self._inverse_root(of_square(a, minus, one))
        raise TypeError(f"no series is known for {name}")

    def _inverse_root(self, a: Series) -> Series:
        first = self.constants.reciprocal(self.tape.call("sqrt", a[0]))
        return self._raised(a, self.tape.constant(-0.5), first)

    def _grown(self, name: str, a: Series, slope: Callable[[Series], Series]) -> Series:
        def coefficient(k: int) -> int:
            if k == 0:
                return self.tape.call(name, a[0])
            return self._integrated(k, [(a, weight)])

        result = Series(coefficient)
        weight = slope(result)
        return result

    def _integrated(self, k: int, pairs: Sequence[tuple[Series, Series]]) -> int:
        """Return the coefficient k of ∫ Σ w da."""
        terms = [(self._slope(a)[j], w[k - j]) for a, w in pairs for j in _newest_last(k) if j]
        return self.tape.multiply(self.tape.convolution(terms), self.tape.constant(1 / k))

    def _slope(self, a: Series) -> Series:
        if a not in self._slopes:
            tape = self.tape
            self._slopes[a] = Series(lambda j: tape.multiply(tape.constant(float(j)), a[j]))
        return self._slopes[a]

    def _pair(self, a: Series, name: str) -> tuple[Series, Series]:
        """Return sin a and cos a, or sinh a and cosh a."""
        tape, hyperbolic = self.tape, name.endswith("h")
        names = ("sinh", "cosh") if hyperbolic else ("sin", "cos")

        def sine_of(k: int) -> int:
            return self._integrated(k, [(a, cosine)]) if k else tape.call(names[0], a[0])

        def cosine_of(k: int) -> int:
            if k == 0:
                return tape.call(names[1], a[0])
            grown = self._integrated(k, [(a, sine)])
            return grown if hyperbolic else tape.negative(grown)

        key = (a, hyperbolic)
        if key not in self._pairs:
            sine, cosine = Series(sine_of), Series(cosine_of)
            self._pairs[key] = (sine, cosine)
        return self._pairs[key]

    def _real_power(self, a: Series, exponent: Series) -> Series:
        if exponent in self._fixed:
            r = self._fixed[exponent]
            return self._raised(a, r, self.tape.call("pow", a[0], r))
        return self.call("exp", [self.product([exponent, self.call("log", [a])])])

    def _raised(self, a: Series, exponent: int, first: int) -> Series:
        """Return a^r: p_k = Σ_j (r j − (k − j)) a_j p_{k−j} / (k a_0)."""
        tape = self.tape

        def coefficient(k: int) -> int:
            if k == 0:
                return first
            terms = []
            for j in _newest_last(k):
                if j:
                    weight = tape.total(
                        [tape.multiply(exponent, tape.constant(j)), tape.constant(j - k)]
                    )
                    terms.append((tape.multiply(weight, a[j]), result[k - j]))
            grown = tape.multiply(tape.convolution(terms), tape.constant(1 / k))
            return tape.multiply(grown, self.constants.reciprocal(a[0]))

        result = Series(coefficient)
        return result

    def _angle(self, y: Series, x: Series) -> Series:
        """Return atan2(y, x): its differential is (x dy − y dx)/(x² + y²)."""
        inverse = self.reciprocal(self.total([self.square(x), self.square(y)]))
        along = self.product([x, inverse])
        across = self.product([self.number(-1.0), y, inverse])

        def coefficient(k: int) -> int:
            if k == 0:
                return self.tape.call("atan2", y[0], x[0])
            return self._integrated(k, [(y, along), (x, across)])

        return Series(coefficient)


def _newest_last(k: int) -> list[int]:
    """Return 0 … k, the ones whose larger of j and k − j is largest last."""
    return sorted(range(k + 1), key=lambda j: max(j, k - j))
