"""What is computed of every loop while it runs."""

from __future__ import annotations

from dataclasses import dataclass

from sympy import Expr


@dataclass(frozen=True)
class Watch:
    """Expressions of a system's states, signals, parameters and time, followed along each run.

    Attributes
    ----------
    mean
        (1/T) ∫ e dt over the whole run, up to where it ended.
    last_mean
        (1/P) ∫ e dt over the window of length P that ends at t_end.
    maxima
        The largest value.
    beyond
        The last time (s) at which e > 0; 0 if it never was.
    """

    mean: tuple[Expr, ...] = ()
    last_mean: tuple[Expr, ...] = ()
    maxima: tuple[Expr, ...] = ()
    beyond: tuple[Expr, ...] = ()
