"""A clock that tests turn by hand, and what runs on it: a controller, a plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from extremum.deploy.realtime import run_realtime
from extremum.deploy.running import RealtimeReport

MS = 1_000_000
SAFE = (0.0, -1.0)


class State(NamedTuple):
    instant: int
    last: float


class Counting:
    """A controller whose outputs are the number of the instant and the sample."""

    dt = 0.01
    safe = SAFE

    def init(self, sample: float) -> State:
        return State(0, sample)

    def step(self, state: State, sample: float) -> tuple[tuple[float, ...], State]:
        return (float(state.instant), sample), State(state.instant + 1, sample)

    def skip(self, state: State, steps: int) -> State:
        return state._replace(instant=state.instant + steps)


Counter: Any = Counting
"""What the runner asks of a `DiscreteController`, and no more."""


class HandClock:
    """Time passes only where it is told to; watchers look in as it does."""

    def __init__(self, overshoot: int = 0) -> None:
        self.time, self.overshoot = 123_456_789, overshoot
        self.watchers: dict[int, tuple[int, Callable[[], None]]] = {}

    def now(self) -> int:
        return self.time

    def sleep(self, seconds: float) -> None:
        assert 0 < seconds <= 0.05
        self.advance(round(seconds * 1e9) + self.overshoot)

    def advance(self, nanoseconds: int) -> None:
        end = self.time + nanoseconds
        while True:
            due = [(w[0], key) for key, w in self.watchers.items() if w[0] <= end]
            if not due:
                break
            self.time, key = min(due)
            _, check = self.watchers[key]
            self.watchers[key] = (self.time + key, check)
            check()
        self.time = end

    def watch(self, seconds: float, check: Callable[[], None]) -> Callable[[], None]:
        key = round(seconds * 1e9)
        self.watchers[key] = (self.time + key, check)
        return lambda: self.watchers.pop(key) and None


class Plant:
    """Samples 0, 1, 2, …, and a log of what was written when (ns since the first read)."""

    def __init__(self, clock: HandClock, during: dict[int, Callable[[], Any]] | None = None):
        self.clock, self.during = clock, during or {}
        self.reads = 0
        self.began: int | None = None
        self.log: list[tuple[int, tuple[float, ...]]] = []

    def read(self) -> Any:
        if self.began is None:
            self.began = self.clock.now()
        number = self.reads
        self.reads += 1
        happens = self.during.get(number)
        given = happens() if happens is not None else None
        return float(number) if given is None else given

    def write(self, commands: tuple[float, ...]) -> None:
        assert self.began is not None
        self.log.append((self.clock.now() - self.began, commands))

    @property
    def commands(self) -> list[tuple[float, ...]]:
        return [commands for _, commands in self.log]


def run(plant: Plant, controller: Any = None, **options: Any) -> RealtimeReport:
    chosen = Counter() if controller is None else controller
    return run_realtime(chosen, plant.read, plant.write, clock=plant.clock, **options)


def raising(error: BaseException) -> Callable[[], Any]:
    def raises() -> Any:
        raise error

    return raises
