#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The SHA-256 of everything the commands write, to prove that a change of the code changes nothing.

    python benchmarks/outputs.py [--samples FOLDER] > LIST

Run it before and after a change, with the package of each installed, and diff the two lists. A line
is a file, or what a command printed and its exit code: bags of every layout, container and way to
write messages, what becomes of them on the way back, pictures, reports, descriptions, help texts.
Pages are compared by their elements and texts.

FOLDER holds real KITTI files (raw, object, odometry and tracking) and recorded bags (bags); without
it the synthetic recordings are the only samples.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING

from yardsticks import COMMAND, make_parser  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Sequence

LAYOUTS = ('raw', 'object', 'odometry', 'tracking')
SYNTHETIC = (*LAYOUTS, 'kitti360')  # which is not made of bags of others
COMMANDS = ('to-bag', 'to-kitti', 'recover', 'info', 'view', 'report', 'crop', 'demo', 'play')
WAYS = {
    'mcap': ('.mcap',),
    'directory': ('', '--compression', 'lz4'),
    'sqlite3': ('', '--storage', 'sqlite3'),
    'ros1': ('.bag',),
    'bz2': ('.bag', '--compression', 'bz2'),
    'zstd': ('.mcap', '--compression', 'zstd', '--compression-level', '3'),
    'split': ('', '--split-size', '2MB'),
    'raw': ('.mcap', '--images', 'raw'),
    'ring': ('.bag', '--images', 'both', '--ring-time', '--trails', '--marker-colors', 'track'),
    'ouster': ('', '--points', 'ouster'),
    'autoware': ('.bag', '--points', 'xyzircaedt'),
    'kitti2bag': ('.bag', '--preset', 'kitti2bag', '--base-to-imu', '-0.05,0.32,0.93'),
    'devkit': ('.mcap', '--map', 'devkit', '--no-tf', '--start', '1', '--streams', 'oxts,scan'),
}
CROSSED = ('sqlite3', 'ring')  # ways whose bags become data sets of every layout
CUT = ('--view', 'reduced', '--range', ':60', '--height', '-3:3', '--voxel', '0.2')
MODES = ('camera', 'boxes', 'lidar', 'bev', 'panel')


class Outputs:
    """Runs commands in a folder, by relative paths, and lists what they print and write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lines: list[str] = []

    def run(self, *words: str, out: str = '') -> None:
        """One command, and the file or folder that it makes."""
        done = subprocess.run(
            [*COMMAND, *words],
            cwd=self.folder,
            env=os.environ | {'COLUMNS': '80', 'NO_COLOR': '1'},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
        )
        said = hashlib.sha256(self._here(done.stdout + b'\0' + done.stderr)).hexdigest()
        self.lines.append(f'{said}  {done.returncode} {" ".join(words)}')
        self.add(out)

    def add(self, out: str) -> None:
        """The files at a path."""
        path = self.folder / out
        found = sorted(path.rglob('*')) if path.is_dir() and out else [path]
        for each in (each for each in found if each.is_file()):
            data = self._here(each.read_bytes())
            if each.suffix == '.html':
                data = _elements(data.decode())
            digest = hashlib.sha256(data).hexdigest()
            self.lines.append(f'{digest}  {each.relative_to(self.folder)}')

    def _here(self, data: bytes) -> bytes:
        """The same without the path of the folder, which is another in each run."""
        return data.replace(bytes(self.folder), b'.')


def _elements(page: str) -> bytes:
    """The elements and the text of a page: the same character may be escaped in several ways."""
    found: list[tuple[object, ...]] = []
    parser = HTMLParser()
    for name in ('starttag', 'startendtag', 'endtag', 'data', 'comment', 'decl'):
        setattr(parser, f'handle_{name}', lambda *event, name=name: found.append((name, *event)))
    parser.feed(page)
    parser.close()
    return repr(found).encode()


def of_recording(folder: Path, source: str) -> list[str]:
    """Everything that becomes of a KITTI folder."""
    outputs = Outputs(folder)
    name = source.strip('/').replace('/', '_')
    for way, (suffix, *options) in WAYS.items():
        bag = f'{name}_{way}{suffix}'
        outputs.run('to-bag', source, bag, '-q', *options, out=bag)
        if (folder / bag).exists():
            _of_bag(outputs, bag, LAYOUTS if way in CROSSED else ())
    _views(outputs, source, name)
    outputs.run('crop', source, f'{name}_cut', '-q', *CUT, out=f'{name}_cut')
    outputs.run('info', source, '--json')
    return outputs.lines


def of_bag(folder: Path, bag: str) -> list[str]:
    """Everything that becomes of a bag of others."""
    outputs = Outputs(folder)
    outputs.run('to-kitti', bag, '--plan')
    _of_bag(outputs, bag, LAYOUTS)
    _views(outputs, bag, bag)
    return outputs.lines


def of_help() -> list[str]:
    """What the help texts say."""
    with tempfile.TemporaryDirectory() as folder:
        outputs = Outputs(Path(folder))
        outputs.run('--help')
        for command in COMMANDS:
            outputs.run(command, '--help')
        return outputs.lines


def _of_bag(outputs: Outputs, bag: str, layouts: Sequence[str]) -> None:
    outputs.run('info', bag)
    outputs.run('to-kitti', bag, f'{bag}_back', '-q', out=f'{bag}_back')
    for layout in layouts:
        out = f'{bag}_{layout}'
        outputs.run('to-kitti', bag, out, '-q', '--layout', layout, out=out)
        shutil.rmtree(outputs.folder / out, ignore_errors=True)
    outputs.run('view', bag, '-q', '-o', f'{bag}.png', out=f'{bag}.png')


def _views(outputs: Outputs, source: str, name: str) -> None:
    for mode in MODES:
        picture = f'{name}_{mode}.png'
        outputs.run('view', source, '-q', '--mode', mode, '-o', picture, out=picture)
    outputs.run('info', source)
    outputs.run('report', source, '-q', '-o', f'{name}.html', out=f'{name}.html')


def synthetic(folder: Path) -> list[str]:
    """Synthetic recordings of all layouts, and the path of each."""
    made = []
    for layout in SYNTHETIC:
        Outputs(folder).run('demo', layout, '--layout', layout, '--count', '3', '-q')
        made.append(f'{layout}/kitti')
    return made


def real(folder: Path, samples: Path) -> tuple[list[str], list[str]]:
    """Copies of real recordings and bags, and the path of each."""
    recordings = []
    for layout, part in (
        ('raw', '2011_09_26/2011_09_26_drive_0005_sync'),
        ('raw', '2011_09_26/2011_09_26_drive_0052_sync'),
        ('object', 'training'),
        ('odometry', 'dataset/sequences/00'),
        ('tracking', 'training'),
    ):
        if not (folder / f'real_{layout}').exists():
            shutil.copytree(samples / layout, folder / f'real_{layout}')
        recordings.append(f'real_{layout}/{part}')
    shutil.copytree(samples / 'bags', folder, dirs_exist_ok=True)
    bags = [each.name for each in (samples / 'bags').iterdir() if each.suffix != '.xz']
    return recordings, sorted(bags)


def main() -> None:
    """Print the list, sorted by what its lines are of."""
    parser = make_parser(__doc__)
    parser.add_argument('--samples', type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(os.cpu_count()) as pool:
        folder = Path(name)
        recordings, bags = real(folder, args.samples) if args.samples else ([], [])
        works = [pool.submit(of_recording, folder, each) for each in synthetic(folder) + recordings]
        works += [pool.submit(of_bag, folder, each) for each in bags]
        works.append(pool.submit(of_help))
        lines = [line for work in works for line in work.result()]
    print(*sorted(lines, key=lambda line: line.split('  ', 1)[1]), sep='\n')


if __name__ == '__main__':
    main()
