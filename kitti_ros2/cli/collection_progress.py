# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The progress of a collection: a bar for all units, and one for each that is running."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..batch.collection import Progress
from .text import complain

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def collection_progress(units: int, *, show: bool) -> Iterator[Progress]:
    """Yield what shows the progress of so many units, if standard error is a terminal."""
    if not show or not sys.stderr.isatty():
        yield _RemarkLines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn('{task.description}', markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        yield _Bars(bars, units)


class _RemarkLines(Progress):
    """Remarks as lines on standard error."""

    def remark(self, text: str) -> None:
        complain(f'kitti-ros2: {text}')


class _Bars(_RemarkLines):
    """One bar for all units, and one for each that is running."""

    def __init__(self, bars: Any, units: int) -> None:  # noqa: ANN401 - rich's progress
        self._bars = bars
        self._all = bars.add_task('units', total=units)
        self._running: dict[str, Any] = {}

    def skip(self, unit: str) -> None:  # noqa: ARG002 - the form of the base class
        self._bars.advance(self._all)

    def begin(self, unit: str) -> None:
        if unit not in self._running:
            self._running[unit] = self._bars.add_task(unit, total=None)

    def advance(self, unit: str, done: int, total: int) -> None:
        if unit in self._running:
            self._bars.update(self._running[unit], completed=done, total=total)

    def end(self, unit: str) -> None:
        if unit in self._running:
            self._bars.remove_task(self._running.pop(unit))
        self._bars.advance(self._all)
