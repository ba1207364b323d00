# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m tests.torture.faults [COMMAND ...] [--all]``: faults at calls of the commands."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

_HERE = Path(__file__).parent
sys.path[:0] = [str(_HERE), str(_HERE.parent), str(_HERE.parents[1])]

from fault_cases import CASES, FAULTS  # noqa: E402 - after the path
from fault_library import compile_faults  # noqa: E402
from fault_points import Bench, Finding  # noqa: E402
from fault_spread import beginning_with, spread  # noqa: E402
from fork_server import ForkServer  # noqa: E402

_FEW = 8


def main() -> int:
    """Print the number of fault points of each command, and the findings."""
    parser = argparse.ArgumentParser(prog='python -m tests.torture.faults', description=__doc__)
    parser.add_argument('commands', nargs='*', metavar='COMMAND', help=', '.join(CASES))
    parser.add_argument('--fault', action='append', choices=FAULTS, help='default: every fault')
    parser.add_argument('--all', action='store_true', help=f'every call, not {_FEW} of each')
    parser.add_argument('--points', type=int, default=_FEW, help='so many calls of each')
    parser.add_argument('--at', type=int, help='this call only')
    given = parser.parse_args()
    names = beginning_with(given.commands, CASES)
    if not names:
        parser.error(f'no such command; there are {", ".join(CASES)}')
    findings = 0
    with tempfile.TemporaryDirectory() as folder:
        library = compile_faults(Path(folder))
        for number, name in enumerate(names):
            work = Path(folder) / f'{number}'
            work.mkdir()
            with ForkServer(library, work) as server:
                bench = Bench(name, CASES[name], server, work / 'work')
                for fault in given.fault or FAULTS:
                    most = None if given.all else given.points
                    findings += _sweep(bench, fault, most, given.at)
    print(f'{findings} findings')
    return min(findings, 1)


def _sweep(bench: Bench, fault_name: str, most: int | None, only: int | None) -> int:
    """Let the calls of a command meet a fault; print and count the findings."""
    fault = FAULTS[fault_name]
    calls = bench.calls(fault)
    chosen = [only] if only else spread(calls, most)
    started = time.monotonic()
    found: list[Finding] = [
        finding for call in chosen for finding in bench.check(fault_name, fault, call)
    ]
    took = time.monotonic() - started
    print(
        f'{bench.name}, {fault_name}: {len(chosen)} of {calls} calls, {len(found)} findings,'
        f' {took:.0f} s',
        flush=True,
    )
    for finding in found:
        print(f'  {finding}', flush=True)
    return len(found)


if __name__ == '__main__':
    sys.exit(main())
