"""A progress bar for work that takes longer than a second."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import Final, Self

PATIENCE: Final = 1.0


class Bar:
    """Shows the simulated time on a terminal's standard error, once a second has passed."""

    def __init__(self, title: str, total: float) -> None:
        self.title, self.total = title, total
        self._begun = time.perf_counter()
        self._show: Callable[..., object] | None = None
        self._stop: Callable[[], object] | None = None

    def __call__(self, reached: float) -> None:
        """Show that the run has reached this time (s)."""
        if self._show is None:
            if time.perf_counter() - self._begun < PATIENCE or not sys.stderr.isatty():
                return
            self._show = self._start()
        self._show(completed=reached)

    def _start(self) -> Callable[..., object]:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.4g} of {task.total:.4g} s"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        bar.start()
        self._stop = bar.stop
        return partial(bar.update, bar.add_task(self.title, total=self.total))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._stop is not None:
            self._stop()
