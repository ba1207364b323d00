# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: python -m tests.torture.fuzz [TARGET ...]."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from .lines import by_module, lines_of
from .loop import fuzz
from .targets import TARGETS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .loop import Outcome


def main(words: Sequence[str] | None = None) -> int:
    """Run targets and print what they cost and found; returns 1 if there are findings."""
    options = _parse(words)
    if options.list:
        print('\n'.join(sorted(TARGETS)))
        return 0
    names = options.targets or sorted(TARGETS)
    print(f'{"target":28} {"executions":>10} {"per s":>8} {"refused":>8} {"corpus":>7}'
          f' {"slowest":>8} {"memory":>8} {"findings":>8}', flush=True)  # fmt: skip
    outcomes = []
    end = time.monotonic() + 60 * (options.minutes or float('inf'))
    for number, name in enumerate(names):
        target = TARGETS[name]
        # What a target leaves of its share is for those behind it.
        seconds = (end - time.monotonic()) / (len(names) - number)
        executions = options.executions or target.long
        outcome = fuzz(target, options.seed, executions, seconds, all_seeds=True)
        outcomes.append(outcome)
        print(_row(outcome), flush=True)
        for place in _written(outcome, options.seed, options.out):
            print(f'  {place}', flush=True)
    _print_lines(outcomes, missing=options.missing)
    return 1 if any(each.findings for each in outcomes) else 0


def _parse(words: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='python -m tests.torture.fuzz',
        description='Attack the parsers and readers of kitti_ros2.',
    )
    parser.add_argument('targets', nargs='*', metavar='TARGET', help='default: all')
    parser.add_argument('--list', action='store_true', help='print the targets')
    parser.add_argument('--executions', type=int, help='inputs of each target')
    parser.add_argument(
        '--minutes', type=float, help='time for all targets, which ends them sooner'
    )
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--out', type=Path, default=Path('fuzz_findings'), help='for findings')
    parser.add_argument('--missing', action='store_true', help='print lines that were not reached')
    options = parser.parse_args(words)
    unknown = [name for name in options.targets if name not in TARGETS]
    if unknown:
        parser.error(f'no target {unknown[0]}; --list prints all')
    return options


def _row(outcome: Outcome) -> str:
    rate = outcome.executions / max(outcome.seconds, 1e-9)
    bounds = outcome.bounds
    return (
        f'{outcome.target.name:28} {outcome.executions:10,} {rate:8,.0f}'
        f' {outcome.refused / outcome.executions:8.0%} {outcome.corpus:7}'
        f' {bounds.slowest_s:6.2f} s {bounds.largest_bytes / 1e6:5.0f} MB'
        f' {len(outcome.findings):8}'
    )


def _written(outcome: Outcome, seed: int, folder: Path) -> list[str]:
    """Write the findings of a target, each with its seed; returns a line for each."""
    lines = []
    for finding in outcome.findings.values():
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f'{outcome.target.name}-{finding.name}'
        path.with_suffix('.input').write_bytes(finding.data)
        head = f'target {outcome.target.name}, seed {seed}: {finding.key}\n\n'
        path.with_suffix('.txt').write_text(head + finding.text)
        lines.append(f'{finding.key}: {path}.input, {len(finding.data)} bytes')
    return lines


def _print_lines(outcomes: Sequence[Outcome], *, missing: bool) -> None:
    print(f'\n{"module":36} {"lines":>6} {"reached":>8}')
    total, reached = 0, 0
    for module, seen in sorted(by_module([each.lines for each in outcomes]).items()):
        known = lines_of(module)
        total, reached = total + len(known), reached + len(known & seen)
        print(f'{module:36} {len(known):6} {len(known & seen) / max(len(known), 1):8.1%}')
        if missing and known - seen:
            print(f'    {", ".join(map(str, sorted(known - seen)))}')
    print(f'{"all":36} {total:6} {reached / max(total, 1):8.1%}')
