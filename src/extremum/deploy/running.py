"""A real-time run while it goes on: instants, samples, the end."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from .timing import NANO, Clock, Gauge, Spread, Watchdog, readable

if TYPE_CHECKING:
    from .discrete import DiscreteController

SLICE: Final = 0.05
"""The longest sleep (s) between two looks at whether to stop."""
SAFE_ATTEMPTS: Final = 3
"""How often the last output is tried if `write` raises."""


@dataclass(frozen=True)
class RealtimeReport:
    """What happened in a real-time run. ``print`` it.

    Attributes
    ----------
    reason
        What ended it: ``"duration"``, ``"steps"``, ``"stop"``, ``"SIGINT"``, ``"SIGTERM"``, or a
        sentence that says what failed.
    safe_sent
        Whether `write` has taken the safe output at the end.
    dt
        The period (s).
    elapsed
        From the first instant to the end (s).
    steps
        Steps of the controller.
    overruns
        Steps whose work was not done by the next instant.
    skipped
        Instants t₀ + k·dt at which nothing ran because earlier work, or the operating system, had
        not let go; `skip` took the dither past them.
    missing
        Steps without a finite sample: None, NaN, infinite, or `read` raised.
    read_errors
        Those of them in which `read` raised.
    late
        How long after its instant a step began.
    work
        How long `read`, the controller's step and `write` took together.
    state
        The controller's last state; None if there was no step.
    """

    reason: str
    safe_sent: bool
    dt: float
    elapsed: float
    steps: int
    overruns: int
    skipped: int
    missing: int
    read_errors: int
    late: Spread
    work: Spread
    state: Any

    def __str__(self) -> str:
        safe = "was sent" if self.safe_sent else "COULD NOT BE SENT"
        return (
            f"ended by {self.reason} after {readable(self.elapsed)}; the safe output {safe}\n"
            f"steps, every {readable(self.dt)}: {self.steps}; overruns: {self.overruns}; "
            f"instants skipped: {self.skipped}\n"
            f"samples missing: {self.missing}; errors of read: {self.read_errors}\n"
            f"begun late: {self.late}\n"
            f"work of a step: {self.work}"
        )


class Run:
    """What changes while a run goes on."""

    def __init__(
        self,
        controller: DiscreteController,
        read: Callable[[], float | None],
        write: Callable[[tuple[float, ...]], object],
        clock: Clock,
        timeout: float,
        stop: threading.Event | None,
        read_errors: int,
    ) -> None:
        self.controller, self.read, self.write = controller, read, write
        self.init, self.step = controller.init, controller.step  # made now, not at an instant
        self.clock, self.stop, self.read_errors = clock, stop, read_errors
        self.dog = Watchdog(clock, timeout, self._send_safe)
        self.asked = ""
        """What asks for the end."""
        self.reason = ""
        """What ended it."""
        self.closing = self.sending = False
        self.failed = self.safe_sent = False
        self.cause: BaseException | None = None
        self.state: Any = None
        self.began = self.ended = clock.now()
        self.steps = self.overruns = self.skipped = self.missing = self.errors = self.in_a_row = 0
        self.late, self.work = Gauge(), Gauge()

    def go(self, until: float, count: float) -> None:
        """Run to instant number `until`, for `count` steps, or until something else ends it."""
        try:
            self._go(until, count)
        finally:
            self.closing = True
            self.ended = self.clock.now()

    def _go(self, until: float, count: float) -> None:
        period = self.controller.dt / NANO
        index = 0
        self.began = self.clock.now()
        while not self.reason:
            due = self.began + round(index * period)
            if not self._wait(due):
                self.reason = self.asked
            elif index >= until:
                self.reason = "duration"
            elif self.steps >= count:
                self.reason = "steps"
            else:
                begin = self.clock.now()
                passed = int(min((begin - due) // period, until - index))
                if passed:
                    index += passed
                    self.skipped += passed
                    if self.state is not None:
                        self.state = self.controller.skip(self.state, passed)
                    continue
                self.late.add(begin - due)
                self._step(begin)
                index += 1
                end = self.clock.now()
                self.work.add(end - begin)
                self.overruns += end > self.began + round(index * period)

    def _wait(self, due: int) -> bool:
        """Sleep until an instant; return whether nothing asks for the end."""
        while True:
            if self.stop is not None and self.stop.is_set():
                self.asked = self.asked or "stop"
            if self.asked:
                return False
            left = (due - self.clock.now()) * NANO
            if left <= 0:
                return True
            self.clock.sleep(min(left, SLICE))

    def _step(self, begin: int) -> None:
        self.dog.begin(begin)
        try:
            sample = self._sample()
            if self.reason or self._hung("read"):
                return
            if self.state is None:
                self.state = self.init(sample)
            commands, self.state = self.step(self.state, sample)
            if self._hung("the controller's step"):
                return
            self.steps += 1
            try:
                self.write(commands)
            except Exception as error:
                self._fail(f"write, which raised {type(error).__name__}: {error}", error)
            self._hung("write")
        finally:
            self.dog.end()

    def _sample(self) -> float:
        """Return J, NaN if it is missing."""
        try:
            given = self.read()
            if isinstance(given, str | bytes):
                raise TypeError(f"read returned {given!r}, which is text")
            sample = math.nan if given is None else float(given)
            self.in_a_row = 0
        except Exception as error:
            sample = math.nan
            self.errors += 1
            self.in_a_row += 1
            if self.in_a_row > self.read_errors:
                what = f"{self.in_a_row} times in a row, last {type(error).__name__}: {error}"
                self._fail(f"read, which raised {what}", error)
        self.missing += not math.isfinite(sample)
        return sample

    def _hung(self, what: str) -> bool:
        """Say so if the watchdog has sent the safe output."""
        if self.dog.fired and not self.failed:
            self._fail(f"the watchdog: {what} took longer than {readable(self.dog.timeout)}", None)
        return self.dog.fired

    def _fail(self, reason: str, cause: BaseException | None) -> None:
        self.failed, self.reason, self.cause = True, reason, cause

    def _send_safe(self) -> None:
        self.write(self.controller.safe)

    def close(self) -> None:
        """Send the safe output, whatever is pressed meanwhile."""
        self.dog.close()
        last: BaseException | None = None
        for _ in range(SAFE_ATTEMPTS):
            try:
                self.sending = True
                self._send_safe()
                self.sending = False
            except BaseException as error:
                self.sending, last = False, error
            else:
                self.safe_sent = True
                return
        if not self.failed:
            self._fail(f"{self.reason}; writing the safe output raised {last!r}", last)

    def report(self) -> RealtimeReport:
        """Return what happened."""
        return RealtimeReport(
            reason=self.reason,
            safe_sent=self.safe_sent,
            dt=self.controller.dt,
            elapsed=(self.ended - self.began) * NANO,
            steps=self.steps,
            overruns=self.overruns,
            skipped=self.skipped,
            missing=self.missing,
            read_errors=self.errors,
            late=self.late.spread(),
            work=self.work.spread(),
            state=self.state,
        )


@contextmanager
def signals(run: Run) -> Iterator[None]:
    """Take SIGINT and SIGTERM as a wish to end; the second one interrupts whatever hangs."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: object) -> None:
        if run.sending if run.closing else run.asked:
            raise KeyboardInterrupt
        run.asked = run.asked or signal.Signals(number).name

    before = {which: signal.signal(which, handle) for which in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for which, handler in before.items():
            signal.signal(which, signal.SIG_DFL if handler is None else handler)
