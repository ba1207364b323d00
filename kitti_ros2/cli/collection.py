# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Commands with --all: run over a collection and print a summary."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from ..batch.manifest import DONE, FAILED
from ..batch.units import find_roots, find_units
from ..files.staging import refuse_inside
from ..model.errors import UsageError
from .collection_progress import collection_progress
from .collection_tables import complain_of, print_groups, record_json
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .text import format_count, format_path, say

if TYPE_CHECKING:
    from pathlib import Path

    from ..batch.collection import Collection, CollectionReport
    from ..options.read import ReadOptions


def run_collection(
    collection: Collection, src: Path, read: ReadOptions, *, quiet: bool, json: bool
) -> int:
    """Run a command over a collection and print a summary.

    Args:
        collection: The command, with its output.
        src: A root, a glob or a list of folders.
        read: Options of reading; the layout chooses among the recordings.
        quiet: Print only failed units and skipped data.
        json: Whether to print the summary as JSON.

    Returns:
        The exit code: 1 with failed units or skipped data.

    Raises:
        UsageError: --sequence is given, or the output lies inside the source.
    """
    if read.sequence is not None:
        raise UsageError('--sequence chooses one recording and --all takes all; give one of them')
    roots = find_roots(src)
    for root in roots:
        refuse_inside(root, collection.out)
    units = find_units(roots, read.layout, collection.batch.slice_frames)
    started = time.monotonic()
    with collection_progress(len(units), show=not (quiet or json)) as progress:
        report = collection.convert(units, progress)
    elapsed = time.monotonic() - started
    if json:
        print_json(
            {
                'out': report.out,
                'jobs': report.jobs,
                'ran': len(report.ran),
                'units': [record_json(each) for each in report.records],
                'seconds': elapsed,
            }
        )
    elif not quiet:
        _summarize(report, elapsed)
    complain_of(report.records)
    return EXIT_OK if report.ok else EXIT_LOSSES


def _summarize(report: CollectionReport, elapsed: float) -> None:
    before = [each for each in report.records if each.name not in report.ran]
    now = [each for each in report.records if each.name in report.ran]
    groups = {
        'done': [each for each in now if each.state == DONE],
        'done before': [each for each in before if each.state == DONE],
        'failed': [each for each in now if each.state == FAILED],
        'failed before': [each for each in before if each.state == FAILED],
    }
    print_groups({name: units for name, units in groups.items() if units})
    size = sum(each.counts.get('bytes', 0) for each in now)
    say(
        f'{format_path(report.out)}: {format_count(len(now), "unit")} run on'
        f' {format_count(report.jobs, "worker")}; took {elapsed:.1f} s'
        f' ({size / elapsed / 1e6:.0f} MB/s)'
    )
    if groups['failed before']:
        say('units that failed before are not run again; --retry does it')
