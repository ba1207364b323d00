# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What N and 2 N of one kind of thing cost the commands: time must not grow faster than N.

    python -m tests.torture.growth [--list] [KIND ...]

It prints the CPU time of each command for N and for 2 N, above that for none, in seconds.
Marked are * a time that grows faster, ! one above what docs/reliability.md allows, which does not
count what frames cost, and ? a command that refuses the input.

Of the kinds named memory it prints the most memory of each command for N and for 4 N frames, in MB.
Marked are * memory that grows by more than 20 MB, and ?.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

_TESTS = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(_TESTS)]

from larger_bags import KINDS, write_larger  # noqa: E402 - after the path
from larger_sets import enlarge, kinds_of, write_small  # noqa: E402
from marks import judge  # noqa: E402
from peaks import PeakCase, peak_cases  # noqa: E402

from kitti_ros2.model.streams import Layout  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

OF_BAGS = ('info IN', 'validate IN', 'report IN -o OUT.html', 'view IN -o OUT.png',
           'to-kitti IN OUT --layout object', 'to-kitti IN OUT --layout raw',
           'to-kitti IN OUT --layout odometry', 'to-kitti IN OUT --layout tracking',
           'recover IN OUT')  # fmt: skip
OF_SETS = ('info IN', 'validate IN', 'report IN -o OUT.html', 'stats IN', 'view IN -o OUT.png',
           'to-bag IN OUT', 'crop IN OUT --range 0:50')  # fmt: skip
LINES, COPIES, FRAMES = 5_000, 200, 200
"""At first: lines of a text, copies of the bytes of another file, frames of a set."""
REFUSED = 2


@dataclass(frozen=True)
class Cost:
    """What a run of a command took.

    Attributes:
        cpu_s: CPU time.
        code: The exit code.
    """

    cpu_s: float
    code: int


@dataclass(frozen=True)
class Case:
    """One kind of input.

    Attributes:
        name: What grows.
        count: How many at first.
        base: Writes the input without them under a path; returns what to give to the commands.
        make: Writes one with so many.
        commands: Those that read it.
    """

    name: str
    count: int
    base: Callable[[Path], Path]
    make: Callable[[Path, int], Path]
    commands: tuple[str, ...]


def cases() -> Iterator[Case]:
    """Bags by what they hold, then sets by the file that grows."""
    for kind, count in KINDS.items():
        yield Case(f'bag: {kind.__name__}', count, write_larger, _bag_maker(kind), OF_BAGS)
    for layout in Layout:
        base = partial(write_small, layout)
        yield Case(f'{layout.value}: frames', FRAMES, base, base, OF_SETS)
        with tempfile.TemporaryDirectory() as folder:
            base(Path(folder) / 'set')
            kinds = kinds_of(Path(folder))
        for name in kinds:
            count = LINES if name.endswith('.txt') else COPIES
            make = _set_maker(layout, name)
            yield Case(f'{layout.value}: {name}', count, base, make, OF_SETS)


def _bag_maker(kind: Callable[[int], Iterator]) -> Callable[[Path, int], Path]:
    return lambda path, count: write_larger(path, kind(count))


def _set_maker(layout: Layout, name: str) -> Callable[[Path, int], Path]:
    def make(path: Path, count: int) -> Path:
        made = write_small(layout, path)
        for each in kinds_of(path)[name]:
            enlarge(each, count)
        return made

    return make


def run(command: str, source: Path, work: Path) -> Cost:
    """Run a command of kitti-ros2 on an input; its output is removed."""
    words = [word.replace('OUT', str(work / 'out')) for word in command.split()]
    words = [str(source) if word == 'IN' else word for word in words]
    errors = work / 'stderr'
    with errors.open('wb') as stream:
        process = subprocess.Popen(
            [sys.executable, '-m', 'kitti_ros2', *words],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stream,
        )  # fmt: skip
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if b'internal error' in errors.read_bytes():
        raise SystemExit(f'{command}, {source}: {errors.read_text(errors="replace")}')
    for path in work.glob('out*'):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return Cost(used.ru_utime + used.ru_stime, process.returncode)


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = [path] if path.is_file() else [each for each in path.rglob('*') if each.is_file()]
    return sum(each.stat().st_size for each in files)


def measure(case: Case, costs: dict[tuple[str, str], float], shrink: int = 1) -> str:
    """Run the commands of a case; a line, with marks.

    Args:
        case: The case.
        costs: Of inputs without what grows, by the beginning of names and command; completed here.
        shrink: Divides the counts.
    """
    with tempfile.TemporaryDirectory(prefix='growth-') as folder:
        work = Path(folder)
        count = max(1, case.count // shrink)
        base = case.base(work / 'base')
        sources = [case.make(work / f'in_{factor}', factor * count) for factor in (1, 2)]
        size = size_of(sources[1])
        said = []
        for command in case.commands:
            key = (case.name.partition(':')[0], command)
            if key not in costs:
                costs[key] = min(run(command, base, work).cpu_s for _ in range(2))
            found = [run(command, source, work) for source in sources]
            above = [max(0.0, each.cpu_s - costs[key]) for each in found]
            name = ' '.join(word for word in command.split() if word not in {'IN', 'OUT'})
            name = name.partition(' -o')[0].replace('to-kitti --layout ', 'to ')
            mark = judge(*above, size) + '?' * (found[1].code == REFUSED)
            said.append(f'{name} {above[0]:.1f} {above[1]:.1f}{mark}')
    return f'{case.name} x {count:,}, {size / 1e6:.2f} MB: {"; ".join(said)}'


def main() -> int:
    """Print a line for each case; 1 if one is marked *."""
    parser = argparse.ArgumentParser(
        prog='python -m tests.torture.growth', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument('kinds', nargs='*', metavar='KIND', help='parts of names; default: all')
    parser.add_argument('--list', action='store_true', help='print the names')
    parser.add_argument('--shrink', type=int, default=1, help='divide all numbers by it')
    given = parser.parse_args()
    every = [*cases(), *peak_cases()]
    chosen = [case for case in every if not given.kinds or any(k in case.name for k in given.kinds)]
    if not chosen:
        parser.error('no such kind; see --list')
    if given.list:
        print('\n'.join(case.name for case in chosen))
        return 0
    costs: dict[tuple[str, str], float] = {}
    marked = 0
    for case in chosen:
        if isinstance(case, PeakCase):
            line = case.measure(given.shrink)
        else:
            line = measure(case, costs, given.shrink)
        marked += '*' in line
        print(line, flush=True)
    return min(marked, 1)


if __name__ == '__main__':
    sys.exit(main())
