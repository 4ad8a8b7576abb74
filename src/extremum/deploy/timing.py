"""What a real-time run needs of time: a steady clock, a watchdog, and statistics."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

NANO: Final = 1e-9
FINEST: Final = 100.0
"""Times shorter than this (ns) fall into a gauge's first bin."""
BINS: Final = 50
"""Bins per decade of a gauge: each is 4.7 % wide."""


class Clock(Protocol):
    """A clock that never steps back, and what waits for it."""

    def now(self) -> int:
        """Return the time (ns), from any origin."""
        ...

    def sleep(self, seconds: float) -> None:
        """Return no earlier than `seconds` from now."""
        ...

    def watch(self, seconds: float, check: Callable[[], None]) -> Callable[[], None]:
        """Call `check` every so many seconds beside the caller; return what ends that."""
        ...


class SteadyClock:
    """The operating system's monotonic clock; `watch` starts a thread."""

    def now(self) -> int:
        """Return the time (ns)."""
        return time.perf_counter_ns()

    def sleep(self, seconds: float) -> None:
        """Sleep; another thread may run."""
        time.sleep(seconds)

    def watch(self, seconds: float, check: Callable[[], None]) -> Callable[[], None]:
        """Call `check` from a thread that does not keep the process alive."""
        ended = threading.Event()

        def watching() -> None:
            while not ended.wait(seconds):
                check()

        threading.Thread(target=watching, name="extremum watchdog", daemon=True).start()
        return ended.set


class Watchdog:
    """Sends the safe output from another thread when a period's work does not end.

    Parameters
    ----------
    clock
        Whose time counts.
    timeout
        How long (s) the work may take; ``math.inf`` for ever.
    send
        Sends the safe output. If it raises, it is called again at the next look.
    """

    def __init__(self, clock: Clock, timeout: float, send: Callable[[], None]) -> None:
        self.clock, self.timeout, self.send = clock, timeout, send
        self.fired = False
        self._sent = False
        self._since: int | None = None
        self.close: Callable[[], None] = lambda: None
        if timeout < math.inf:
            self.close = clock.watch(timeout / 4, self.check)

    def begin(self, now: int) -> None:
        """Note that a period's work begins."""
        self._since = now

    def end(self) -> None:
        """Note that it has ended."""
        self._since = None

    def check(self) -> None:
        """Send the safe output once if the work has taken too long."""
        since = self._since
        if self._sent or since is None or (self.clock.now() - since) * NANO <= self.timeout:
            return
        self.fired = True
        try:
            self.send()
        except Exception:
            return
        self._sent = True


@dataclass(frozen=True)
class Spread:
    """How many times of one kind are distributed.

    Attributes
    ----------
    mean, std
        Mean and standard deviation (s).
    percentile_99
        99 % are no longer than this (s), from bins that are 4.7 % wide.
    largest
        The longest (s).
    """

    mean: float
    std: float
    percentile_99: float
    largest: float

    def __str__(self) -> str:
        return (
            f"mean {readable(self.mean)}, std {readable(self.std)}, "
            f"99 % {readable(self.percentile_99)}, largest {readable(self.largest)}"
        )


class Gauge:
    """Collects times in constant memory, however long the run."""

    def __init__(self) -> None:
        self.count = 0
        self._mean = self._squares = 0.0
        self._largest = 0
        self._bins: dict[int, int] = {}

    def add(self, nanoseconds: int) -> None:
        """Count one time (ns); mean and variance by Welford's recurrence."""
        self.count += 1
        off = nanoseconds - self._mean
        self._mean += off / self.count
        self._squares += off * (nanoseconds - self._mean)
        self._largest = max(self._largest, nanoseconds)
        place = math.ceil(BINS * math.log10(max(nanoseconds, FINEST) / FINEST))
        self._bins[place] = self._bins.get(place, 0) + 1

    def spread(self) -> Spread:
        """Return what was collected; zeros if nothing was."""
        if not self.count:
            return Spread(0.0, 0.0, 0.0, 0.0)
        left, edge = 0.99 * self.count, 0.0
        for place in sorted(self._bins):
            left -= self._bins[place]
            if left <= 0:
                edge = FINEST * 10 ** (place / BINS)
                break
        return Spread(
            self._mean * NANO,
            math.sqrt(self._squares / self.count) * NANO,
            min(edge, self._largest) * NANO,
            self._largest * NANO,
        )


def readable(seconds: float) -> str:
    """Return a time with three digits and a unit that suits it."""
    for factor, unit in ((1.0, "s"), (1e-3, "ms")):
        if abs(seconds) >= factor:
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds * 1e6:.3g} µs"
