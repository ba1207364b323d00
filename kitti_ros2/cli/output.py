# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: lines, tables, JSON, progress, and checks of the files to write."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.output_rules import json_text, keep_all_but_files, losses_json, refusal_of
from ..model.errors import UsageError, either, one_line
from .exits import EXIT_LOSSES, EXIT_OK

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rich import progress as rich_progress
    from rich.console import Console
    from rich.table import Table

    from ..model.errors import Loss


# Output of the commands: lines for a terminal, losses, readable paths and quantities.

_SHOWN_LOSSES = 20


def say(line: str) -> None:
    """Print on standard output as one line of plain text."""
    sys.stdout.write(f'{one_line(line)}\n')


def say_error(line: str) -> None:
    """Print on standard error as one line of plain text."""
    sys.stderr.write(f'{one_line(line)}\n')


def format_path(path: Path) -> str:
    """Return a path, relative if it is below the working directory."""
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):  # elsewhere; or the working directory was deleted
        return str(path)


def show_losses(losses: tuple[Loss, ...]) -> None:
    """Print skipped data with its count on standard error, one line per cause."""
    if not losses:
        return
    causes: dict[str, list[Loss]] = {}
    for loss in losses:
        causes.setdefault(loss.text(), []).append(loss)
    for message, same in list(causes.items())[:_SHOWN_LOSSES]:
        count = sum(loss.count for loss in same)
        names = same[0].stream + (f' and {len(same) - 1} more' if len(same) > 1 else '')
        say_error(f'skipped {names} ({count}): {message}')
    rest = list(causes.values())[_SHOWN_LOSSES:]
    if rest:
        count = sum(loss.count for same in rest for loss in same)
        say_error(f'skipped {count} more, for {len(rest)} more reasons')
    total = sum(loss.count for loss in losses)
    listed = 'the first of them listed above' if rest else 'listed above'
    say_error(f'kitti-ros2: {total} skipped in all, {listed}; exit code 1')


# Tables for a terminal of 80 columns, without lines.

NONE = '-'
"""Cell of a missing figure."""


def console(**rest: Any) -> Console:  # noqa: ANN401 - keywords of rich
    """Return the terminal; names are shown as they are, also such as a:b:c."""
    from rich.console import Console

    return Console(highlight=False, emoji=False, **rest)


def plain_table(first: str, numbers: Iterable[str] = ()) -> Table:
    """Return a table with a column of names and columns of numbers."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style='bold')
    table.add_column(first, overflow='fold')
    for heading in numbers:
        table.add_column(heading, justify='right', no_wrap=True)
    return table


def cell(text: str) -> str:
    """Return a name with its markup escaped, for a table."""
    from rich.markup import escape

    return escape(one_line(text))


def number_cell(value: float | None, digits: int = 2) -> str:
    """Format a figure: a count, which is an integer, or a number with decimal places."""
    if value is None:
        return NONE
    return f'{value:d}' if isinstance(value, int) else f'{value:.{digits}f}'


def figure_cells(figures: Mapping[str, float | None], names: Iterable[str]) -> list[str]:
    """Format the figures of a class; those of one without objects and results are missing."""
    values = [figures[name] for name in names]
    return [NONE for _ in values] if None in values else [number_cell(value) for value in values]


# Results as JSON on standard output.


def print_json(values: object) -> None:
    """Print one JSON document; NaN and infinite numbers are null."""
    sys.stdout.write(json_text(values))


def report_values(report: Any) -> dict[str, Any]:  # noqa: ANN401 - a dataclass with losses
    """Return a report for print_json."""
    return {**asdict(report), 'losses': losses_json(report.losses)}


def print_result(
    values: Callable[[], object],
    show: Callable[[], None],
    losses: tuple[Loss, ...],
    *,
    json: bool,
    quiet: bool,
) -> int:
    """Print the result of a command, and its losses.

    Args:
        values: Returns the result for JSON.
        show: Prints it for a reader.
        losses: Data that was skipped.
        json: Whether to print JSON.
        quiet: Print only losses.

    Returns:
        The exit code: 1 with losses.
    """
    if json:
        print_json(values())
    elif not quiet:
        show()
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


# Output of commands that check, count or score.


@dataclass(frozen=True)
class ResultOutput:
    """File or folder and form of a result.

    Attributes:
        out: Argument of -o, None without it: a file, or with --all the folder of outputs.
        overwrite: Whether existing files may be replaced.
        json: Whether to print JSON instead of text.
        quiet: Print only errors and losses.
    """

    out: Path | None
    overwrite: bool
    json: bool
    quiet: bool


def refuse_files(out: Path | None, *, overwrite: bool) -> None:
    """Refuse -o and --overwrite of a command that writes files with --all only.

    Raises:
        UsageError: One is given.
    """
    if out is not None or overwrite:
        raise UsageError('-o and --overwrite are for whole collections; give --all too')


# Checks of output files before the work for them begins.

PLOTS = ('.png', '.pdf', '.svg')
_OTHER_PICTURES = ('.jpg', '.jpeg', '.webp')
_KEEP_ALL_BUT_PLOTS = keep_all_but_files('picture', (b'\x89PNG', b'%PDF', b'<?xml'))


def is_picture(out: Path) -> bool:
    """Whether an output is a file by its name, not a folder: a plot or another picture."""
    return out.suffix.lower() in {*PLOTS, *_OTHER_PICTURES}


def check_output(
    out: Path | None,
    paths: Sequence[Path],
    keep: Callable[[Path], str | None],
    *,
    overwrite: bool,
) -> Callable[[Path], str | None]:
    """Raise now for an output that could not be written later; return its refusal."""
    from ..files.local_staging import Staging
    from ..files.staging import refuse_inside

    refusal = refusal_of(keep, overwrite=overwrite)
    if out is not None:
        for path in paths:
            refuse_inside(path, out)
        Staging(out, refusal).discard()
    return refusal


def check_plot(
    out: Path | None, paths: Sequence[Path], *, overwrite: bool
) -> Callable[[Path], str | None]:
    """Raise now for a plot that could not be drawn later; return its refusal."""
    refusal = check_output(out, paths, _KEEP_ALL_BUT_PLOTS, overwrite=overwrite)
    if out is None:
        return refusal
    if out.suffix.lower() not in PLOTS:
        raise UsageError(f'{out}: a plot ends in {either(PLOTS)}')
    if find_spec('matplotlib') is None:
        raise UsageError(
            "-o needs matplotlib, which is not installed; run pip install 'kitti_ros2[plot]'"
        )
    return refusal


# HTML pages as outputs: their endings, and the browser that shows them.

ENDINGS = ('.html', '.htm')


def open_page(page: Path) -> None:
    """Open a page in the browser; print its address if there is none."""
    import webbrowser

    address = page.resolve().as_uri()
    if not webbrowser.open(address):
        say_error(f'no browser is found; open {address}')


# Progress bars on standard error: none where it is not a terminal.

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

        yield _rate_limited(update)


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

        yield _rate_limited(update)


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
        yield tuple(_rate_limited(partial(_show_bytes, bar, task)) for task in tasks)


def _show_bytes(
    bar: rich_progress.Progress, task: rich_progress.TaskID, done: int, total: int
) -> None:
    bar.update(task, completed=done, total=total)


def _rate_limited(update: Callable[..., None]) -> Callable[..., None]:
    """Limit the updates of a bar: most messages are small, and drawing takes longer."""
    last = time.monotonic()

    def limited(*values: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= _REFRESH_S:
            last = now
            update(*values)

    return limited
