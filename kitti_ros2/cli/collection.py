# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Commands with --all: run over a collection and print a summary."""

from __future__ import annotations

import json as json_module
import sys
import time
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..bags.locate import is_bag_name
from ..batch.collection import Collection, Progress
from ..batch.manifest import DONE, FAILED, MANIFEST
from ..batch.unit_functions import (
    run_detection_unit,
    run_odometry_unit,
    run_report_unit,
    run_statistics_unit,
    run_tracking_unit,
)
from ..batch.units import (
    DETECTION,
    ODOMETRY,
    TRACKING,
    FolderSearch,
    common_folder,
    find_all_roots,
    find_pairs,
    find_roots,
    find_source_units,
    refuse_within,
)
from ..datasets.set_statistics import SetStatistics, plain_values, read_values, write_csv
from ..evaluation.score_values import combined_odometry, combined_tracking
from ..evaluation.track_metrics import check_trackeval
from ..evaluation.trajectories import check_evo
from ..files.replaceable import KEEP_ALL_BUT_PAGES
from ..files.staging import staged_file
from ..model.boxes import Difficulty
from ..model.errors import BadFileError, UsageError, format_bytes, format_count, format_duration
from ..options.datasets import make_statistics_options
from ..options.evaluation import (
    make_detection_options,
    make_odometry_options,
    make_tracking_options,
)
from ..options.table import make_settings
from ..report.page import IndexEntry, make_index
from .exits import EXIT_LOSSES, EXIT_OK
from .output import (
    ENDINGS,
    PLOTS,
    cell,
    complain,
    figure_cells,
    format_path,
    number_cell,
    open_page,
    plain_table,
    print_json,
    say,
)
from .stats_tables import KEEP_ALL_BUT_TABLES, TABLE, print_sets

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..batch.collection import CollectionReport
    from ..batch.manifest import Pace, UnitRecord
    from ..batch.pool import RunUnit
    from ..batch.units import PairKind, WorkUnit
    from ..options.read import ReadOptions
    from ..options.table import BatchOptions
    from .output import ResultOutput


# The progress of a collection: a bar for all units, and one for each that is running.


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


# Units of a collection as tables, lines and JSON.

_SHOWN = 20
_COUNTED = {
    'to-bag': ('frames', 'messages', 'bytes'),
    'to-kitti': ('frames', 'files', 'bytes'),
    'validate': ('files', 'bytes', 'warnings'),
    'stats': ('frames', 'objects'),
    'report': ('frames', 'bytes'),
}
"""By command what is counted of a unit."""
_FRAMES = ('frames',)
_HEADINGS = {'bytes': 'size'}
_BAD = {'validate': ('error', 'errors'), 'report': ('loss', 'losses')}
_SKIPPED = ('skipped', 'skipped')


def record_json(record: UnitRecord) -> dict[str, object]:
    """Return a unit of the manifest for print_json."""
    values = asdict(record)
    identity = values.pop('identity')
    return {**values, 'source': identity['source'], 'version': identity['version']}


def print_groups(groups: Mapping[str, Sequence[UnitRecord]], command: str) -> None:
    """Print a row of sums for each group of units of a command."""
    from rich.console import Console

    counted = _COUNTED.get(command, _FRAMES)
    headings = [_HEADINGS.get(name, name) for name in counted]
    table = plain_table('units', ['count', *headings, _BAD.get(command, _SKIPPED)[1]])
    for name, units in groups.items():
        sums = {key: sum(unit.counts.get(key, 0) for unit in units) for key in counted}
        table.add_row(
            cell(name),
            f'{len(units):,}',
            *(format_bytes(n) if key == 'bytes' else f'{n:,}' for key, n in sums.items()),
            f'{sum(unit.bad for unit in units):,}',
        )
    Console(highlight=False).print(table)


def complain_of(records: Sequence[UnitRecord], command: str) -> None:
    """Print failed units, and what is bad in others, on standard error."""
    singular, plural = _BAD.get(command, _SKIPPED)
    failed = [record for record in records if record.state == FAILED]
    lossy = [record for record in records if record.state == DONE and record.bad]
    lines = [f'failed {each.name}: {each.reason}' for each in failed]
    lines += [f'{singular} in {each.name}: {text}' for each in lossy for text in each.losses]
    for line in lines[:_SHOWN]:
        complain(line)
    if len(lines) > _SHOWN:
        complain(f'... and {len(lines) - _SHOWN} more; kitti-ros2 status OUT --json lists them')
    if failed or lossy:
        count = sum(each.bad for each in lossy)
        complain(
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
    FindUnits = Callable[[FolderSearch], list[WorkUnit]]
    Combine = Callable[[Sequence[tuple[UnitRecord, Path]]], 'Combined']


class Combined:
    """What the outputs of all units together give; this one is nothing."""

    def values(self) -> dict[str, object]:
        """Return it for print_json."""
        return {}

    def show(self) -> None:
        """Print it."""


def run_collection(
    collection: Collection,
    find: FindUnits,
    *,
    quiet: bool,
    json: bool = False,
    combine: Combine = lambda _: Combined(),
) -> int:
    """Run a command over a collection and print a summary.

    Args:
        collection: The command, with its output.
        find: Returns the units of a search.
        quiet: Print only failed units and skipped data.
        json: Whether to print the summary as JSON.
        combine: Makes what is common to all units, from those that are done and their outputs.

    Returns:
        The exit code: 1 with failed units or skipped data.

    Raises:
        UsageError: The output lies inside a unit.
    """
    search = FolderSearch([collection.out])
    units = find(search)
    refuse_within(units, collection.out)
    started = time.monotonic()
    with collection_progress(len(units), show=not (quiet or json)) as progress:
        report = collection.convert(units, progress)
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
                'jobs': report.jobs,
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
        complain(problem)
    complain_of(report.records, collection.command)
    if search.problems:
        complain(f'kitti-ros2: left out, as listed above; exit code {EXIT_LOSSES}')
    return EXIT_OK if report.ok and not search.problems else EXIT_LOSSES


def refuse_sequence(read: ReadOptions) -> None:
    """Refuse --sequence with --all.

    Raises:
        UsageError: It is given.
    """
    if read.sequence is not None:
        raise UsageError('--sequence chooses one recording and --all takes all; give one of them')


def need_folder(out: Path | None, endings: Sequence[str] = ()) -> Path:
    """Return the output folder of a collection.

    Args:
        out: As given with -o.
        endings: Of the files that -o names without --all.

    Raises:
        UsageError: It is not given, or is the name of a file.
    """
    if out is None:
        raise UsageError('--all writes a file for each unit; give their folder with -o OUT')
    if out.suffix.lower() in endings and not out.is_dir():
        raise UsageError(f'{out}: with --all OUT is a folder, with a file for each unit')
    return out


def _summarize(report: CollectionReport, command: str, elapsed: float) -> None:
    before = [record for record in report.records if record.name not in report.ran]
    now = [record for record in report.records if record.name in report.ran]
    groups = {
        'done': [each for each in now if each.state == DONE],
        'done before': [each for each in before if each.state == DONE],
        'failed': [each for each in now if each.state == FAILED],
        'failed before': [each for each in before if each.state == FAILED],
    }
    print_groups({name: units for name, units in groups.items() if units}, command)
    size = sum(each.counts.get('bytes', 0) for each in now)
    rate = f' ({size / elapsed / 1e6:.0f} MB/s)' if size else ''
    say(
        f'{format_path(report.out)}: {format_count(len(now), "unit")} run on'
        f' {format_count(report.jobs, "worker")}; took {elapsed:.1f} s{rate}'
    )
    if groups['failed before']:
        say('units that failed before are not run again; --retry does it')


# kitti-ros2 eval ... --all: scores of many results, a row for each, and of all together.

if TYPE_CHECKING:
    Values = Mapping[str, Any]
    Rows = Iterator[tuple[str, Sequence[str]]]

_TRACKED = ('HOTA', 'DetA', 'AssA', 'MOTA', 'MOTP', 'IDF1', 'IDSW')
_DETECTED = ('2d', 'aos', 'bev', '3d')


@dataclass(frozen=True)
class Evaluation:
    """An evaluation of a collection.

    Attributes:
        name: The word after eval.
        kind: What it compares.
        run: Runs a unit.
        read: Returns the options that choose among the ground truth, from values by name.
        columns: Headings of the table of results.
        rows: The rows of a result: a class, or nothing, and the cells.
        combine: Returns the figures of all results together, as the JSON of a result; None if they
            do not follow from those of each.
        check: Raises an error if a library is missing.
    """

    name: str
    kind: PairKind
    run: RunUnit
    read: Callable[[Mapping[str, object]], ReadOptions]
    columns: Sequence[str]
    rows: Callable[[Values], Rows]
    combine: Callable[[Sequence[Values]], dict[str, Any]] | None = None
    check: Callable[[], None] = lambda: None


def run_eval_collection(
    evaluation: Evaluation,
    paths: tuple[Path, Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Score each result of a collection, and print the figures of each.

    Args:
        evaluation: What is scored.
        paths: Ground truth and results: roots, globs or lists.
        given: The options of a unit by name.
        batch: How the collection is run.
        output: Where and how the scores are put.

    Returns:
        The exit code.
    """
    read = evaluation.read(given)
    refuse_sequence(read)
    folder = need_folder(output.out, PLOTS)
    evaluation.check()
    truth, results = paths
    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection(
        f'eval {evaluation.name}', folder, '.json', chosen, batch, evaluation.run
    )
    return run_collection(
        collection,
        lambda search: find_pairs(truth, results, evaluation.kind, read.layout, search),
        quiet=output.quiet,
        json=output.json,
        combine=lambda done: _Scores(evaluation, done),
    )


class _Scores(Combined):
    """The scores of all units, and those of all together."""

    def __init__(self, evaluation: Evaluation, done: Sequence[tuple[UnitRecord, Path]]) -> None:
        self._evaluation = evaluation
        self._done = done

    @cached_property
    def _found(self) -> dict[str, Values]:
        return {record.name: _read_scores(path) for record, path in self._done}

    @cached_property
    def _together(self) -> dict[str, Any]:
        """The figures of all together; empty if a ground truth is used twice."""
        found = [*self._found.values()]
        truths = {(each['ground_truth'], each['sequence']) for each in found}
        combine = self._evaluation.combine
        if combine is None or len(found) < 2 or len(truths) < len(found):
            return {}
        return combine(found)

    def values(self) -> dict[str, Any]:
        """Return the scores of each and of all together for print_json."""
        kept = {
            name: {key: value for key, value in each.items() if key != 'parts'}
            for name, each in self._found.items()
        }
        return {'scores': kept, 'combined': self._together or None}

    def show(self) -> None:
        """Print a table with a row for each result."""
        from rich.console import Console

        if not self._found:
            return
        table = plain_table('result', self._evaluation.columns)
        shown = [*self._found.items(), *([('all', self._together)] if self._together else [])]
        for name, values in shown:
            for part, cells in self._evaluation.rows(values):
                table.add_row(cell(f'{name} {part}'.rstrip()), *cells)
        Console(highlight=False).print(table)


def _read_scores(path: Path) -> Values:
    try:
        values: dict[str, Any] = json_module.loads(path.read_text('utf-8'))
    except ValueError as error:
        raise BadFileError(
            path, f'{error}', 'the scores of a result', remedy='remove it, and run again'
        ) from None
    return values


def _odometry_rows(values: Values) -> Rows:
    for each in values['odometry'].values():
        yield (
            '',
            (
                f'{each["segments"]}',
                number_cell(each['t_err_percent'], 4),
                number_cell(each['r_err_deg_per_m'], 6),
                number_cell(each['ape_m'], 4),
                number_cell(each['rpe_m'], 4),
            ),
        )


def _tracking_rows(values: Values) -> Rows:
    for class_name, each in values['tracking'].items():
        yield class_name, figure_cells(each, _TRACKED)


def _detection_rows(values: Values) -> Rows:
    for class_name, metrics in values['detection'].items():
        levels = [metrics.get(name, {}).get(Difficulty.MODERATE.value, {}) for name in _DETECTED]
        yield class_name, [number_cell(level.get('R40')) for level in levels]


EVAL_DETECTION = Evaluation(
    'detection',
    DETECTION,
    run_detection_unit,
    lambda given: make_detection_options(given)[0],
    _DETECTED,
    _detection_rows,
)
EVAL_TRACKING = Evaluation(
    'tracking',
    TRACKING,
    run_tracking_unit,
    lambda given: make_tracking_options(given)[0],
    (*_TRACKED[:-1], 'IDs'),
    _tracking_rows,
    lambda found: {'tracking': combined_tracking(found)},
    check_trackeval,
)
EVAL_ODOMETRY = Evaluation(
    'odometry',
    ODOMETRY,
    run_odometry_unit,
    lambda given: make_odometry_options(given)[0],
    ('segments', 't_err %', 'r_err deg/m', 'APE m', 'RPE m'),
    _odometry_rows,
    lambda found: {'odometry': {'all': combined_odometry(found)}},
    check_evo,
)


# kitti-ros2 report --all: a page for each recording and bag, and an index.

_SUFFIX = '.html'
_INDEX = 'index'


def run_report_collection(
    src: Path,
    out: Path,
    given: Mapping[str, object],
    batch: BatchOptions,
    *,
    results: Path | None,
    quiet: bool,
    show: bool,
) -> int:
    """Write a page for each unit of a collection, and an index of them.

    Args:
        src: A root, a glob or a list.
        out: The folder of pages.
        given: The options of a unit by name, with overwrite.
        batch: How the collection is run.
        results: As given; not for a collection.
        quiet: Print only losses.
        show: Whether to open the index in the browser.

    Returns:
        The exit code.

    Raises:
        UsageError: An option is not for a collection.
    """
    read = make_settings({n: v for n, v in given.items() if n != 'overwrite'}).read
    refuse_sequence(read)
    if results is not None:
        raise UsageError(f'{results}: --results scores one recording; leave out --all')
    folder = need_folder(out, ENDINGS)
    roots = find_roots(src, is_bag_name)
    index = folder / f'{_INDEX}{_SUFFIX}'

    def find(search: FolderSearch) -> list[WorkUnit]:
        units = find_source_units(roots, read.layout, search)
        taken = [unit.source for unit in units if unit.name == _INDEX]
        if taken:
            raise UsageError(f'{taken[0]}: its page would be {index}, that of all; rename it')
        return units

    def combine(done: Sequence[tuple[UnitRecord, Path]]) -> _Index:
        entries = [
            IndexEntry(each.name, path.relative_to(folder), each.counts.get('frames', 0), each.bad)
            for each, path in done
        ]
        with staged_file(index, KEEP_ALL_BUT_PAGES) as path:
            path.write_bytes(make_index(str(common_folder(roots)), entries).encode())
        return _Index(index)

    collection = Collection('report', folder, _SUFFIX, given, batch, run_report_unit)
    code = run_collection(collection, find, quiet=quiet, combine=combine)
    if show:
        open_page(index)
    return code


class _Index(Combined):
    """The index of the pages."""

    def __init__(self, page: Path) -> None:
        self._page = page

    def show(self) -> None:
        """Print its path."""
        say(format_path(self._page))


# kitti-ros2 stats --all: each recording and bag, and all together.


def run_statistics_collection(
    paths: Sequence[Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Count what is in each unit of a collection; print all together, and write their table.

    Args:
        paths: Roots, globs or lists.
        given: The options of a unit by name.
        batch: How the collection is run.
        output: Where and how the statistics are put.

    Returns:
        The exit code.
    """
    read, options = make_statistics_options(given)
    refuse_sequence(read)
    folder = need_folder(output.out, PLOTS)
    roots = find_all_roots(paths, is_bag_name)

    def combine(done: Sequence[tuple[UnitRecord, Path]]) -> _Together:
        found = _Together(common_folder(roots), done, folder / TABLE, points=options.points)
        found.write()
        return found

    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection('stats', folder, '.json', chosen, batch, run_statistics_unit)
    return run_collection(
        collection,
        lambda search: find_source_units(roots, read.layout, search),
        quiet=output.quiet,
        json=output.json,
        combine=combine,
    )


class _Together(Combined):
    """The statistics of all units together."""

    def __init__(
        self,
        root: Path,
        done: Sequence[tuple[UnitRecord, Path]],
        table: Path,
        *,
        points: bool,
    ) -> None:
        self._root = root
        self._done = done
        self._table = table
        self._points = points

    @cached_property
    def _sets(self) -> list[SetStatistics]:
        recordings = [
            replace(recording, name=record.name)
            for record, path in self._done
            for recording in _read_statistics(path).recordings
        ]
        return [SetStatistics(self._root, tuple(recordings))] if recordings else []

    def write(self) -> None:
        """Write the table; one of an earlier run is replaced."""
        with staged_file(self._table, KEEP_ALL_BUT_TABLES) as path:
            write_csv(path, self._sets)

    def values(self) -> dict[str, Any]:
        """Return the total for print_json."""
        return {'total': plain_values(self._sets[0])['total']} if self._sets else {}

    def show(self) -> None:
        """Print the tables of the total."""
        if self._sets:
            print_sets(self._sets, points=self._points)
        say(format_path(self._table))


def _read_statistics(path: Path) -> SetStatistics:
    try:
        return read_values(json_module.loads(path.read_text('utf-8')))
    except (ValueError, TypeError, KeyError) as error:
        raise BadFileError(
            path, f'{error}', 'the statistics of a unit', remedy='remove it, and run again'
        ) from None
