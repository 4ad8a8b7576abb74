"""A progress bar for work that takes longer than a second."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import Final, Self

from . import interrupts

PATIENCE: Final = 1.0


class Bar:
    """Shows how far work has come on a terminal's standard error, once a second has passed.

    It is also where an interrupt is noticed that Python could not deliver.
    """

    def __init__(self, title: str, total: float, unit: str) -> None:
        self.title, self.total, self.unit = title, total, unit
        self._begun = time.perf_counter()
        self._show: Callable[..., object] | None = None
        self._stop: Callable[[], object] | None = None

    def __call__(self, reached: float) -> None:
        """Show that the work has come this far."""
        interrupts.check()
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
            TextColumn(f"{{task.completed:.3g}} of {{task.total:.4g}}{self.unit}"),
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
