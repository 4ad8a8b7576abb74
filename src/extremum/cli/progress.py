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

    With `rate` the unit is counted: also how many each second, of those since the first call.

    It is also where an interrupt is noticed that Python could not deliver.
    """

    def __init__(self, title: str, total: float, unit: str, *, rate: bool = False) -> None:
        self.title, self.total, self.unit, self.rate = title, total, unit, rate
        self._first: float | None = None
        self._begun = time.perf_counter()
        self._show: Callable[..., object] | None = None
        self._stop: Callable[[], object] | None = None

    def __call__(self, reached: float) -> None:
        """Show that the work has come this far."""
        interrupts.check()
        if self._first is None:
            self._first = reached
        if self._show is None:
            if time.perf_counter() - self._begun < PATIENCE or not sys.stderr.isatty():
                return
            self._show = self._start()
        self._show(completed=reached)

    def _start(self) -> Callable[..., object]:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, Task, TextColumn, TimeRemainingColumn
        from rich.text import Text

        class Rate(TextColumn):
            def render(self, task: Task) -> Text:
                return Text(f"{task.speed:,.0f}/s" if task.speed else "")

        form = (",.0f", ",.0f") if self.rate else (".3g", ".4g")
        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn(f"{{task.completed:{form[0]}}} of {{task.total:{form[1]}}}{self.unit}"),
            *([Rate("")] if self.rate else []),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        bar.start()
        self._stop = bar.stop
        return partial(
            bar.update, bar.add_task(self.title, total=self.total, completed=int(self._first or 0))
        )

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
