# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 status."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from ..files.processes import freeze_imports
from ..model.errors import MissingPathError, UsageError
from .command import JsonOption, QuietOption, argument
from .exits import EXIT_LOSSES, EXIT_OK
from .output import print_json


def status(
    out: Annotated[Path, argument('OUT', 'The folder that a command with --all writes')],
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> int:
    """Show how much of a collection is done, failed and left.

    Also how fast it goes, and why units failed. It may be asked while the collection is written.

    Examples:
      kitti-ros2 status bags
      kitti-ros2 status bags --json
    """
    from ..batch.manifest import STATES, manifest_folder, measure_pace, read_manifest
    from .run_all import print_failures, print_groups, print_pace, record_json

    freeze_imports()
    try:
        with manifest_folder(out) as folder:
            records, run = read_manifest(folder)
    except MissingPathError:
        raise UsageError(f'{out}: no command with --all wrote here; expected its OUT') from None
    pace = measure_pace(records, run)
    command = '' if run is None else run.command
    if json:
        print_json(
            {
                'out': out,
                'pace': {**asdict(pace), 'left': pace.left},
                'run': None if run is None else asdict(run),
                'units': [record_json(record) for record in records],
            }
        )
    elif not quiet:
        by_state = {
            state: [record for record in records if record.state == state] for state in STATES
        }
        print_groups({state: group for state, group in by_state.items() if group}, command)
        print_pace(out, pace)
    print_failures(records, command)
    return EXIT_LOSSES if pace.states['failed'] or pace.lossy else EXIT_OK
