# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Progress bars on standard error: none where it is not a terminal."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich import progress as rich_progress

_REFRESH_S = 0.1


@contextmanager
def conversion_progress(
    samples: int, frames: int, *, show: bool
) -> Iterator[Callable[[int, int], None]]:
    """Yield a function to call with the samples done and the bytes written so far.

    The bar shows frames/s, MB/s and the time left.

    Args:
        samples: Total number of samples.
        frames: Number of frames, for the rate.
        show: Whether to show a bar if standard error is a terminal.
    """
    if not show or not sys.stderr.isatty():
        yield lambda _done, _bytes: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        BarColumn(),
        TextColumn('{task.percentage:3.0f}%'),
        TextColumn('{task.fields[speed]}'),
        TimeRemainingColumn(),
    )
    started = time.monotonic()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task('', total=samples, speed='')

        def update(done: int, size_bytes: int) -> None:
            elapsed = time.monotonic() - started
            rate = done / samples * frames / elapsed
            speed = f'{rate:5.0f} frames/s {size_bytes / elapsed / 1e6:6.0f} MB/s'
            bar.update(task, completed=done, speed=speed)

        yield _seldom(update)


@contextmanager
def step_progress(
    title: str, total: int | None = None, *, show: bool
) -> Iterator[Callable[..., None]]:
    """Yield a function to call with the steps done and, unless it is given here, their total."""
    if not show or not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import Progress

    # A thread that refreshes would forbid forks, see can_fork.
    with Progress(console=Console(stderr=True), transient=True, auto_refresh=False) as bar:
        task = bar.add_task(title, total=total)

        def update(done: int, total: int | None = None) -> None:
            bar.update(task, completed=done, total=total, refresh=True)

        yield _seldom(update)


@contextmanager
def bytes_progress(*titles: str, show: bool) -> Iterator[tuple[Callable[[int, int], None], ...]]:
    """Yield a function for each title, to call with the bytes done and the bytes of all.

    The bars show both, MB/s and the time left.
    """
    if not show or not sys.stderr.isatty():
        yield tuple(lambda _done, _total: None for _ in titles)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        DownloadColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
        TransferSpeedColumn,
    )

    columns = (
        TextColumn('{task.description}'),
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        tasks = [bar.add_task(title, total=None) for title in titles]
        yield tuple(_seldom(partial(_show_bytes, bar, task)) for task in tasks)


def _show_bytes(
    bar: rich_progress.Progress, task: rich_progress.TaskID, done: int, total: int
) -> None:
    bar.update(task, completed=done, total=total)


def _seldom(update: Callable[..., None]) -> Callable[..., None]:
    """Limit the updates of a bar: most messages are small, and drawing takes longer."""
    last = time.monotonic()

    def limited(*values: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= _REFRESH_S:
            last = now
            update(*values)

    return limited
