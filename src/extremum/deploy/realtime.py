"""`run_realtime`: a sampled controller on the clock of the computer that it runs on."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from ..errors import InvalidDescription, shown
from ..validation import positive
from .running import RealtimeReport, Run, signals
from .timing import Clock, SteadyClock

if TYPE_CHECKING:
    from .discrete import DiscreteController


class RealtimeFailure(RuntimeError):
    """A real-time run that failed, after the safe output was sent; see `run_realtime`.

    Attributes
    ----------
    report
        The run up to there. What `read` or `write` raised is the ``__cause__``.
    """

    def __init__(self, report: RealtimeReport) -> None:
        self.report = report
        super().__init__(str(report))

    def __reduce__(self) -> tuple[type[RealtimeFailure], tuple[RealtimeReport]]:
        """Come back whole from another process."""
        return RealtimeFailure, (self.report,)


def run_realtime(
    controller: DiscreteController,
    read: Callable[[], float | None],
    write: Callable[[tuple[float, ...]], object],
    dt: float | None = None,
    *,
    duration: float | None = None,
    steps: int | None = None,
    stop: threading.Event | None = None,
    timeout: float | None = None,
    read_errors: int = 10,
    clock: Clock | None = None,
) -> RealtimeReport:
    """Run a sampled controller in real time, and leave the vehicle with the safe output.

    At each instant t₀ + k·dt of a steady clock: J = `read()`, u, state = `controller.step(state,
    J)`, `write(u)`. Whatever ends the run, the last thing written is `controller.safe`.

    A step begins at its instant, or late if it must; it never begins a whole period late: instants
    that have passed are skipped by `controller.skip`, so that the dither keeps the phase of real
    time. Between its instants the loop sleeps (it never spins, which would keep the other threads
    of a Python program waiting), so that a step begins some 0.1 ms late.

    Parameters
    ----------
    controller
        From `discretize`.
    read
        Returns J at once: the newest sample, or None (or NaN) if there is none.
    write
        Sends the commands, a tuple of floats. The watchdog calls it from another thread.
    dt
        The controller's dt (s), if you want it checked.
    duration, steps
        Ends after that time (s), or so many steps; None for no such end.
    stop
        Ends the run once it is set, from any thread.
    timeout
        How long (s) `read`, step and `write` may take together before the watchdog sends the safe
        output and the run ends; None for ten periods, at least 0.5 s; ``math.inf`` for ever.
    read_errors
        So many exceptions of `read` in a row count as missing samples; one more ends the run.
    clock
        Another clock, for tests.

    Returns
    -------
    RealtimeReport
        If it ended by `duration`, `steps`, `stop`, SIGINT (Ctrl-C) or SIGTERM. Signals are seen
        only in the main thread; a second one raises `KeyboardInterrupt` out of a `read` that hangs.

    Raises
    ------
    RealtimeFailure
        If `read` raised too often, `write` raised, or either took longer than `timeout`.
        Anything else, such as an error in the controller, is raised as it is. In every case the
        safe output has been sent first, or tried three times.
    InvalidDescription
        If an argument cannot be what it says.

    Notes
    -----
    A thread cannot stop another one: while `read` or `write` hangs, the watchdog has sent the safe
    output, but the run ends only once the call returns. It cannot help where the call holds the
    interpreter's lock or the device, nor if the process dies. An actuator that must not keep its
    last command needs a timeout of its own.
    """
    until, count = _checked(controller, read, write, dt, duration, steps, read_errors)
    within = max(10 * controller.dt, 0.5) if timeout is None else timeout
    if within != math.inf:
        within = positive("timeout", within)
    run = Run(controller, read, write, clock or SteadyClock(), within, stop, read_errors)
    with signals(run):
        try:
            run.go(until, count)
        except BaseException as error:
            run.close()
            if not run.safe_sent:
                error.add_note("The safe output could not be sent.")
            raise
        run.close()
    report = run.report()
    if run.failed:
        raise RealtimeFailure(report) from run.cause
    return report


def _checked(
    controller: DiscreteController,
    read: object,
    write: object,
    dt: float | None,
    duration: float | None,
    steps: int | None,
    read_errors: int,
) -> tuple[float, float]:
    """Return the number of the instant and the number of steps that end a run."""
    if not callable(getattr(controller, "step", None)):
        reason = "must be a DiscreteController; make one with discretize(controller, dt)"
        raise InvalidDescription("controller", reason, shown(controller))
    for name, given in (("read", read), ("write", write)):
        if not callable(given):
            raise InvalidDescription(name, "must be a function", shown(given))
    if dt is not None and not math.isclose(positive("dt", dt), controller.dt, rel_tol=1e-9):
        raise InvalidDescription(
            "dt",
            f"differs from the controller's, {controller.dt!r} s; discretize it with the dt that "
            "it runs at, or leave dt out",
            shown(dt),
        )
    for name, given, least in (("steps", steps, 1), ("read_errors", read_errors, 0)):
        if given is not None and (type(given) is not int or given < least):
            raise InvalidDescription(name, f"must be an integer, at least {least}", shown(given))
    until = math.inf
    if duration is not None:
        until = max(1, round(positive("duration", duration) / controller.dt))
    return until, math.inf if steps is None else steps
