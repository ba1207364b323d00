# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Commands with --all: run over a collection and print a summary."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from ..batch.folders import FolderSearch
from ..batch.manifest import DONE, FAILED
from ..batch.units import refuse_within
from ..model.errors import UsageError
from .collection_progress import collection_progress
from .collection_tables import complain_of, print_groups, record_json
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .text import complain, format_count, format_path, say

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..batch.collection import Collection, CollectionReport
    from ..batch.manifest import UnitRecord
    from ..batch.units import WorkUnit
    from ..options.read import ReadOptions

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
        [(each, collection.output_of(each.name)) for each in report.records if each.state == DONE]
    )
    if json:
        print_json(
            {
                'out': report.out,
                'jobs': report.jobs,
                'ran': len(report.ran),
                'units': [record_json(each) for each in report.records],
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
    before = [each for each in report.records if each.name not in report.ran]
    now = [each for each in report.records if each.name in report.ran]
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
