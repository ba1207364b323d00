# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/performance.md: each command beside its peers, as Markdown.

    python -m benchmarks SRC [--pairs 7] [--only WORD ...] [--dir FOLDER] [--devkit PROGRAM]

SRC is a drive of the raw layout, best of 480 frames; FOLDER needs ten times its size. Command and
peers take turns, each a process of its own, start included, and time runs until what it writes is
on the disk. A ratio is the median of the pairs' ratios, with the least and the greatest. Memory is
the peak of the largest process. Peers that are not installed are named.

    pip install pymcap-cli kitti2mcap mcap-ros2-support pykitti evo

DEVKIT is the binary of KITTI's evaluate_object.cpp, which reads data/object/label_2 and results/.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from kitti_ros2.files.local_files import sync_tree

# A package here, single scripts to the type checker.
from .yardsticks import COMMAND, fresh, make_parser  # type: ignore[import-not-found]

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

HEAD = """\
| measure | s | CPU s | MB | peer | s | CPU s | MB | ratio | CPU ratio |
|---|---|---|---|---|---|---|---|---|---|"""
PEERS = Path(__file__).with_name('peers.py')
CUT = 0.6


class Cost(NamedTuple):
    """What a process took: seconds, CPU seconds of it and its children, peak MB of the largest."""

    wall_s: float
    cpu_s: float
    memory_mb: float


@dataclass(frozen=True)
class Work:
    """A program to run.

    Attributes:
        name: Its name in the table.
        words: The command.
        out: What it makes, which is written to the disk and removed.
        needs: A program or module that must be installed.
        codes: Exit codes that are no failure.
    """

    name: str
    words: Sequence[str | Path]
    out: Path | None = None
    needs: str = ''
    codes: Sequence[int] = (0,)

    def absence(self) -> str:
        """Return why it cannot be compared with, '' if it can; this warms the page cache."""
        if self.needs and not (shutil.which(self.needs) or importlib.util.find_spec(self.needs)):
            return 'not installed'
        try:
            self.run()
        except subprocess.CalledProcessError as error:
            print(error, file=sys.stderr)
            return f'failed (exit code {error.returncode})'
        return ''

    def run(self) -> Cost:
        """Run it once.

        Raises:
            CalledProcessError: It fails.
        """
        if self.out is not None:
            fresh(self.out)
        os.sync()  # what an earlier run left to be written is not this one's burden
        words = [str(word) for word in self.words]
        silent = [(os.POSIX_SPAWN_OPEN, file, os.devnull, os.O_WRONLY, 0) for file in (1, 2)]
        started = time.perf_counter()
        child = os.posix_spawnp(words[0], words, os.environ, file_actions=silent)
        _, status, usage = os.wait4(child, 0)
        code = os.waitstatus_to_exitcode(status)
        if code not in self.codes:
            raise subprocess.CalledProcessError(code, words)
        if self.out is not None:
            sync_tree(self.out)
        wall_s = time.perf_counter() - started
        if self.out is not None:
            fresh(self.out)
        return Cost(wall_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000)


@dataclass(frozen=True)
class Row:
    """A measure: a command of this package, and its peers."""

    name: str
    own: Work
    peers: Sequence[Work]

    def lines(self, pairs: int) -> list[str]:
        """Run all in turns; return a line of the table for each peer.

        Raises:
            CalledProcessError: The command of this package fails.
        """
        self.own.run()
        absences = [peer.absence() for peer in self.peers]
        works = [
            self.own,
            *(peer for peer, why in zip(self.peers, absences, strict=True) if not why),
        ]
        costs: list[list[Cost]] = [[] for _ in works]
        for turn in range(pairs):
            for place in range(len(works)):
                number = (place + turn) % len(works)
                costs[number].append(works[number].run())
        own, *others = costs
        found, left, lines = iter(others), f'{self.name} | {_medians(own)}', []
        for peer, why in zip(self.peers, absences, strict=True):
            if why:
                right = f'{peer.name}: {why} | | | | | |'
            else:
                costs_of_peer = next(found)
                ratios = ' | '.join(_ratio(own, costs_of_peer, field) for field in (0, 1))
                right = f'{peer.name} | {_medians(costs_of_peer)} | {ratios} |'
            lines.append(f'| {left} | {right}')
            left = '| | |'
        return lines


def _medians(costs: Sequence[Cost]) -> str:
    wall_s, cpu_s, memory_mb = (median(values) for values in zip(*costs, strict=True))
    return f'{wall_s:.2f} | {cpu_s:.2f} | {memory_mb:.0f}'


def _ratio(own: Sequence[Cost], peer: Sequence[Cost], field: int) -> str:
    ratios = [mine[field] / theirs[field] for mine, theirs in zip(own, peer, strict=True)]
    return f'**{median(ratios):.2f}** ({min(ratios):.2f} to {max(ratios):.2f})'


class Table:
    """The rows, and the inputs that they need, made when a row is measured.

    Args:
        src: The drive.
        folder: For inputs and outputs.
        devkit: KITTI's program that scores detections.
    """

    def __init__(self, src: Path, folder: Path, devkit: str) -> None:
        self.src, self.folder, self.devkit = src, folder, devkit
        self.own_bag, self.foreign, self.cut, self.raw = (
            folder / f'{name}.mcap' for name in ('own', 'foreign', 'cut', 'raw')
        )
        self.set, self.poses, self.rows_of_images = (
            folder / name for name in ('set', 'poses', 'images')
        )
        self._makers: dict[Path, Callable[[], object]] = {
            self.own_bag: lambda: self._to_bag(self.own_bag),
            self.foreign: lambda: self._to_bag(self.foreign, '--exclude-topics', '/kitti/source/*'),
            self.cut: self._cut_bag,
            self.set: lambda: self._make('labels', self.set),
            self.poses: lambda: self._make('trajectories', self.poses),
            self.rows_of_images: lambda: self._make('differences', src, self.rows_of_images),
            self.raw: lambda: self._to_bag(self.raw, '--images', 'raw'),
        }

    def rows(self) -> list[Row]:
        """Return all rows."""
        return [*self._bags(), *self._data_sets(), *self._library(), *self._scores()]

    def prepare(self, row: Row) -> None:
        """Make the inputs of a row."""
        words = [str(word) for work in (row.own, *row.peers) for word in work.words]
        for path, make in self._makers.items():
            if not path.exists() and any(word.startswith(str(path)) for word in words):
                make()

    def _bags(self) -> list[Row]:
        src, bag = self.src, self.own_bag
        raw = ('--images', 'raw')
        decode = Work('OpenCV decoding alone, all cores', self._peer('decode', src))
        zstd, plain = ('--compression', 'zstd'), ('--compression', 'none')
        one = self._ours('out.mcap', 'to-bag', src, *raw)
        packed = self._program('pymcap-cli', 'compress', bag, '-o', 'packed.mcap')
        words = ('recover', self.cut, *plain, 'packed.mcap')
        recovered = self._program('pymcap-cli', *words, codes=(3,))
        return [
            Row('`to-bag`, MCAP', self._ours('out.mcap', 'to-bag', src),
                [self._copy(), self._write_mcap(), self._loop('mcap')]),
            Row('`to-bag`, sqlite3', self._ours('out', 'to-bag', src, '--storage', 'sqlite3'),
                [self._loop('sqlite3')]),
            Row('`to-bag`, ROS 1', self._ours('out.bag', 'to-bag', src), [self._loop('ros1')]),
            Row('`to-bag --images raw`', one,
                [decode, self._kitti2mcap(), self._on_one_core(one)]),
            Row('the same, `--jobs 2`', self._ours('out.mcap', 'to-bag', src, *raw, '--jobs', '2'),
                [self._on_one_core(one)]),
            Row('`to-bag --compression zstd`', self._ours('out.mcap', 'to-bag', src, *zstd),
                [packed]),
            Row('`to-bag`, MCAP to ROS 1', self._ours('out.bag', 'to-bag', bag),
                [self._program('rosbags-convert', '--src', bag, '--dst', 'converted.bag')]),
            Row('`to-bag`, MCAP to MCAP', self._ours('out.mcap', 'to-bag', bag),
                [Work('cp', ['cp', bag, self.folder / 'copy'], self.folder / 'copy')]),
            Row('`recover`, cut off', self._ours('out.mcap', 'recover', self.cut, codes=(1,)),
                [recovered]),
        ]  # fmt: skip

    def _data_sets(self) -> list[Row]:
        own, foreign = self.own_bag, self.foreign
        loop = self.folder / 'loop'
        layout = ('--layout', 'raw')
        rosbags = Work('loop, rosbags', self._peer('read-write', own, loop), loop, 'rosbags')
        page = self.folder / 'page.html'
        return [
            Row('`to-kitti`, own bag', self._ours('out', 'to-kitti', own), [self._copy(), rosbags]),
            Row('`to-kitti`, raw images', self._ours('out', 'to-kitti', self.raw),
                [Work('bare zlib, all cores', self._peer('deflate', self.rows_of_images))]),
            Row('`to-kitti`, bag of others', self._ours('out', 'to-kitti', foreign, *layout),
                [rosbags]),
            Row('`to-kitti --plan`',
                Work('', [*COMMAND, 'to-kitti', foreign, '--plan', *layout]), [self._cat(foreign)]),
            Row('`validate`, bag', self._ours('', 'validate', own), [self._cat(own)]),
            Row('`stats`, bag', self._ours('', 'stats', own),
                [Work('its folder', [*COMMAND, 'stats', self.src, '-q'])]),
            Row('`report`, bag', Work('', [*COMMAND, 'report', own, '-q', '-o', page], page),
                [Work('its folder', [*COMMAND, 'report', self.src, '-q', '-o', page], page)]),
        ]  # fmt: skip

    def _library(self) -> list[Row]:
        src, bag = self.src, self.own_bag
        summary = self._reader('open', 'mcap', bag)
        numpy = Work('import numpy', [sys.executable, '-c', 'import numpy'])

        def points(role: str, path: Path, *peers: tuple[str, str]) -> Row:
            what = f'{role.replace("-", " ")}, {"bag" if path == bag else "folder"}'
            readers = [self._reader(role, name, path, needs) for name, needs in peers]
            return Row(what, self._reader(role, 'kitti_ros2', path), readers)

        of_bags = ('mcap-ros2-support', 'mcap_ros2'), ('rosbags', 'rosbags')
        return [
            points('points', bag, *of_bags),
            points('points-and-image', bag, *of_bags),
            points('points', src, ('numpy', ''), ('pykitti', 'pykitti')),
            Row('first frame, bag', Work('', self._peer('first-frame', bag)), [summary]),
            Row('first frame, folder', Work('', self._peer('first-frame', src)), [numpy]),
            Row('all poses, bag', Work('', self._peer('poses', bag)), [summary]),
            Row('`info`, bag', Work('', [*COMMAND, 'info', bag]),
                [summary, self._reader('open', 'rosbags', bag)]),
            Row('`--help`', Work('', [*COMMAND, '--help']), [numpy]),
        ]  # fmt: skip

    def _scores(self) -> list[Row]:
        labels, truth, result = self.set / 'label_2', self.poses / 'a.txt', self.poses / 'b.txt'
        numbers = Work('reading the numbers', self._peer('numbers', self.set))
        devkit = Work('C++ devkit', ['sh', '-c', f'cd {self.set} && {self.devkit} r'],
                      needs=self.devkit or 'evaluate_object')  # fmt: skip
        evo = f'evo_ape kitti {truth} {result} && evo_rpe kitti {truth} {result}'
        return [
            Row('`eval detection`', self._ours('', 'eval', 'detection', labels, self.set),
                [numbers, devkit]),
            Row('`eval odometry`', self._ours('', 'eval', 'odometry', truth, result),
                [Work('evo_ape and evo_rpe', ['sh', '-c', evo], needs='evo_ape')]),
        ]  # fmt: skip

    def _ours(self, out: str, *words: str | Path, codes: Sequence[int] = (0,)) -> Work:
        path = self.folder / out if out else None
        made = [] if path is None else [path]
        return Work('', [*COMMAND, *words, *made, '-q'], path, codes=codes)

    def _on_one_core(self, work: Work) -> Work:
        return Work('itself on one core', ['taskset', '-c', '0', *work.words], work.out, 'taskset')

    def _peer(self, role: str, *words: str | Path) -> list[str | Path]:
        return [sys.executable, PEERS, role, *words]

    def _reader(self, role: str, name: str, path: Path, needs: str = '') -> Work:
        return Work(name, self._peer(role, name, path), needs=needs)

    def _loop(self, storage: str) -> Work:
        out = self.folder / ('loop.bag' if storage == 'ros1' else 'loop')
        words = self._peer('write-rosbags', storage, self.src, out)
        return Work('loop, rosbags', words, out, 'rosbags')

    def _write_mcap(self) -> Work:
        out = self.folder / 'loop.mcap'
        return Work('loop, mcap', self._peer('write-mcap', self.src, out), out)

    def _copy(self) -> Work:
        out = self.folder / 'copy'
        return Work('`cp -r`', ['cp', '-r', self.src, out], out)

    def _cat(self, path: Path) -> Work:
        return Work('`cat`', ['cat', path])

    def _kitti2mcap(self) -> Work:
        out, date = self.folder / 'peer.mcap', self.src.parent
        drive = self.src.name.split('_')[4] if self.src.name.count('_') == 5 else ''
        words: list[str | Path] = [
            'kitti2mcap',
            '--date',
            date.name,
            '--drive',
            drive,
            '--kitti-dir',
            date.parent,
        ]
        words += ['--cameras', '0,1,2,3', '--output', out]
        return Work('kitti2mcap', words, out, 'kitti2mcap')

    def _program(self, name: str, *words: str | Path, codes: Sequence[int] = (0,)) -> Work:
        out = self.folder / words[-1]
        return Work(name, [name, *words[:-1], out], out, name, codes)

    def _to_bag(self, bag: Path, *words: str) -> None:
        subprocess.run([*COMMAND, 'to-bag', self.src, bag, '-q', *words], check=True)

    def _make(self, role: str, *words: Path) -> None:
        subprocess.run([*map(str, self._peer(role, *words))], check=True)

    def _cut_bag(self) -> None:
        self._to_bag(self.cut)
        os.truncate(self.cut, int(CUT * self.cut.stat().st_size))


def caption(src: Path) -> str:
    """Where and when the table was measured."""
    load = ', '.join(f'{value:.1f}' for value in os.getloadavg())
    return (
        f'{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC, {os.cpu_count()} cores, load {load},'
        f' Linux {platform.release()}, Python {platform.python_version()}; {src.name}'
    )


def measure_player(src: Path, pairs: int) -> None:
    """Print the table of the player, beside bare loops over rclpy."""
    if importlib.util.find_spec('rclpy') is None:
        print('\nplayer: rclpy is not installed')
        return
    print('\n| player | value | aim | |\n|---|---|---|---|', flush=True)
    script = Path(__file__).with_name('play.py')
    subprocess.run([sys.executable, script, src, '--repeat', str(max(3, pairs // 2))], check=True)


def main() -> None:
    """Print the table, row by row."""
    parser = make_parser(__doc__)
    parser.add_argument('src', type=Path)
    parser.add_argument('--pairs', type=int, default=7)
    parser.add_argument('--only', nargs='+', default=[], help='rows with one of these words')
    parser.add_argument('--dir', type=Path, help='where to write; on the disk of SRC by default')
    parser.add_argument('--devkit', default='')
    args = parser.parse_args()
    src = args.src.resolve()
    with tempfile.TemporaryDirectory(dir=args.dir or src.parent.parent) as name:
        table = Table(src, Path(name), args.devkit)
        print(f'{caption(src)}\n\n{HEAD}', flush=True)
        for row in table.rows():
            if not args.only or any(word in row.name for word in args.only):
                table.prepare(row)
                print(*row.lines(args.pairs), sep='\n', flush=True)
        print(f'\nIn the end: {caption(src)}')
    if not args.only or 'player' in args.only:
        measure_player(src, args.pairs)


if __name__ == '__main__':
    main()
