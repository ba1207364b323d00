# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Commands with --all: run over a collection and print a summary."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ..batch.collection import Progress
from ..batch.jobs import FolderSearch, refuse_within
from ..batch.manifest import DONE, FAILED, MANIFEST
from ..model.errors import UsageError, format_bytes, format_count, format_duration
from .exits import EXIT_LOSSES, EXIT_OK
from .output import cell, console, format_path, plain_table, print_json, say, say_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..batch.collection import Collection, CollectionReport
    from ..batch.jobs import Job
    from ..batch.manifest import JobRecord, Pace
    from ..options.read import ReadOptions


# The progress of a collection: a bar for all jobs, and one for each that is running.


@contextmanager
def collection_progress(jobs: int, *, show: bool) -> Iterator[Progress]:
    """Yield an object that shows the progress of jobs, if standard error is a terminal."""
    if not show or not sys.stderr.isatty():
        yield _NoteLines()
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
        yield _Bars(bars, jobs)


class _NoteLines(Progress):
    """Notes as lines on standard error."""

    def note(self, text: str) -> None:
        say_error(f'kitti-ros2: {text}')


class _Bars(_NoteLines):
    """One bar for all jobs, and one for each that is running."""

    def __init__(self, bars: Any, jobs: int) -> None:  # noqa: ANN401 - rich's progress
        self._bars = bars
        self._all = bars.add_task('units', total=jobs)
        self._running: dict[str, Any] = {}

    def skip(self, job: str) -> None:  # noqa: ARG002 - the form of the base class
        self._bars.advance(self._all)

    def begin(self, job: str) -> None:
        if job not in self._running:
            self._running[job] = self._bars.add_task(job, total=None)

    def advance(self, job: str, done: int, total: int) -> None:
        if job in self._running:
            self._bars.update(self._running[job], completed=done, total=total)

    def end(self, job: str) -> None:
        if job in self._running:
            self._bars.remove_task(self._running.pop(job))
        self._bars.advance(self._all)


# Jobs of a collection as tables, lines and JSON.

_SHOWN = 20
_COUNTED = {
    'to-bag': ('frames', 'messages', 'bytes'),
    'to-kitti': ('frames', 'files', 'bytes'),
    'validate': ('files', 'bytes', 'warnings'),
    'stats': ('frames', 'objects'),
    'report': ('frames', 'bytes'),
}
"""Counts of a job that are shown, by command."""
_FRAMES = ('frames',)
_HEADINGS = {'bytes': 'size'}
_BAD = {'validate': ('error', 'errors'), 'report': ('loss', 'losses')}
_SKIPPED = ('skipped', 'skipped')


def record_json(record: JobRecord) -> dict[str, object]:
    """Return a record of the manifest for print_json."""
    values = asdict(record)
    identity = values.pop('identity')
    return {**values, 'source': identity['source'], 'version': identity['version']}


def print_groups(groups: Mapping[str, Sequence[JobRecord]], command: str) -> None:
    """Print a row of sums for each group of jobs of a command."""
    counted = _COUNTED.get(command, _FRAMES)
    headings = [_HEADINGS.get(name, name) for name in counted]
    table = plain_table('units', ['count', *headings, _BAD.get(command, _SKIPPED)[1]])
    for name, records in groups.items():
        sums = {key: sum(record.counts.get(key, 0) for record in records) for key in counted}
        table.add_row(
            cell(name),
            f'{len(records):,}',
            *(format_bytes(n) if key == 'bytes' else f'{n:,}' for key, n in sums.items()),
            f'{sum(record.bad for record in records):,}',
        )
    console().print(table)


def print_failures(records: Sequence[JobRecord], command: str) -> None:
    """Print failed jobs, and the errors and losses of others, on standard error."""
    singular, plural = _BAD.get(command, _SKIPPED)
    failed = [record for record in records if record.state == FAILED]
    lossy = [record for record in records if record.state == DONE and record.bad]
    lines = [f'failed {record.name}: {record.reason}' for record in failed]
    lines += [f'{singular} in {record.name}: {text}' for record in lossy for text in record.losses]
    for line in lines[:_SHOWN]:
        say_error(line)
    if len(lines) > _SHOWN:
        say_error(f'... and {len(lines) - _SHOWN} more; kitti-ros2 status OUT --json lists them')
    if failed or lossy:
        count = sum(record.bad for record in lossy)
        say_error(
            f'kitti-ros2: {format_count(len(failed), "unit")} failed, {count}'
            f' {singular if count == 1 else plural} in'
            f' {format_count(len(lossy), "unit")}; exit code {EXIT_LOSSES}'
        )


def print_pace(out: Path, pace: Pace) -> None:
    """Print how much is left, and how fast it goes."""
    say(
        f'{format_path(out / MANIFEST)}: {pace.states[DONE]:,} done, {pace.states[FAILED]:,}'
        f' failed, {pace.left:,} left'
    )
    if pace.recent and pace.recent_seconds > 0:
        left = pace.seconds_left or 0.0
        say(
            f'last run: {format_count(pace.recent, "unit")} in {pace.recent_seconds:.1f} s'
            f' ({pace.recent * 3600 / pace.recent_seconds:,.0f} units/hour{_rate(pace)})'
            + (f'; about {format_duration(round(left * 1e9))} left' if pace.left else '')
        )


def _rate(pace: Pace) -> str:
    """Return the bytes per second of the last run; empty if none are counted."""
    per_second = pace.recent_bytes / pace.recent_seconds
    return f', {per_second / 1e6:.0f} MB/s' if pace.recent_bytes else ''


# Commands with --all: run over a collection and print a summary.

if TYPE_CHECKING:
    FindJobs = Callable[[FolderSearch], list[Job]]
    Combine = Callable[[Sequence[tuple[JobRecord, Path]]], 'Combined']


@dataclass(frozen=True)
class Combined:
    """Result of all jobs together; nothing by default.

    Attributes:
        values: Returns the result for print_json.
        show: Prints it.
    """

    values: Callable[[], Mapping[str, object]] = dict
    show: Callable[[], None] = lambda: None


def run_collection(
    collection: Collection,
    find: FindJobs,
    combine: Combine = lambda _: Combined(),
    *,
    json: bool = False,
    quiet: bool,
) -> int:
    """Run a command over a collection and print a summary.

    Args:
        collection: The command, with its output.
        find: Returns the jobs of a search.
        combine: Makes the result of all jobs, from those that are done and their outputs.
        json: Whether to print the summary as JSON.
        quiet: Print only failed jobs and skipped data.

    Returns:
        The exit code: 1 with failed jobs or skipped data.

    Raises:
        UsageError: The output lies inside an input.
    """
    search = FolderSearch([collection.out])
    jobs = find(search)
    refuse_within(jobs, collection.out)
    started = time.monotonic()
    with collection_progress(len(jobs), show=not (quiet or json)) as progress:
        report = collection.convert(jobs, progress)
    elapsed = time.monotonic() - started
    combined = combine(
        [
            (record, collection.output_of(record.name))
            for record in report.records
            if record.state == DONE
        ]
    )
    if json:
        print_json(
            {
                'out': report.out,
                'jobs': report.workers,
                'ran': len(report.ran),
                'units': [record_json(record) for record in report.records],
                **combined.values(),
                'problems': search.problems,
                'seconds': elapsed,
            }
        )
    elif not quiet:
        combined.show()
        _summarize(report, collection.command, elapsed)
    for problem in search.problems:
        say_error(problem)
    print_failures(report.records, collection.command)
    if search.problems:
        say_error(f'kitti-ros2: left out, as listed above; exit code {EXIT_LOSSES}')
    return EXIT_OK if report.ok and not search.problems else EXIT_LOSSES


def refuse_sequence(read: ReadOptions) -> None:
    """Refuse --sequence with --all.

    Raises:
        UsageError: It is given.
    """
    if read.sequence is not None:
        raise UsageError('--sequence chooses one recording and --all takes all; give one of them')


def output_folder(read: ReadOptions, out: Path | None, endings: Sequence[str] = ()) -> Path:
    """Return the output folder of a collection, of which no sequence is chosen.

    Args:
        read: As given.
        out: As given with -o.
        endings: Endings of the files that -o names without --all.

    Raises:
        UsageError: It is not given, or is the name of a file; or a sequence is given.
    """
    refuse_sequence(read)
    if out is None:
        raise UsageError('--all writes a file for each unit; give their folder with -o OUT')
    if out.suffix.lower() in endings and not out.is_dir():
        raise UsageError(f'{out}: with --all OUT is a folder, with a file for each unit')
    return out


def _summarize(report: CollectionReport, command: str, elapsed: float) -> None:
    before = [record for record in report.records if record.name not in report.ran]
    now = [record for record in report.records if record.name in report.ran]
    groups = {
        'done': [record for record in now if record.state == DONE],
        'done before': [record for record in before if record.state == DONE],
        'failed': [record for record in now if record.state == FAILED],
        'failed before': [record for record in before if record.state == FAILED],
    }
    print_groups({name: group for name, group in groups.items() if group}, command)
    size = sum(record.counts.get('bytes', 0) for record in now)
    rate = f' ({size / elapsed / 1e6:.0f} MB/s)' if size else ''
    say(
        f'{format_path(report.out)}: {format_count(len(now), "unit")} run on'
        f' {format_count(report.workers, "worker")}; took {elapsed:.1f} s{rate}'
    )
    if groups['failed before']:
        say('units that failed before are not run again; --retry does it')
