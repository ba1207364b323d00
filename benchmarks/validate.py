# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How fast validate reads an object set, against cat of the same files, and whether memory grows.

    python benchmarks/validate.py SRC [--frames N] [--copies] [--repeat N] [--dir DIR]

SRC is an object set with a split training. Its frames are repeated, N of them; all are in the page
cache after the first round. As hard links the few files of a sample stay in the processor's cache,
which cat gains most from; --copies are files of their own, as those of a whole data set are.

The bare row is a floor: the same processes read each file into one buffer, sum up PNGs by zlib's
CRC-32, and find the least and greatest of each column of a scan.
"""

from __future__ import annotations

import mmap
import shutil
import subprocess
from itertools import cycle
from pathlib import Path
from statistics import median

import numpy as np
from yardsticks import COMMAND, make_parser, parse_in_folder, peak_mb, report, seconds, tree_bytes

from kitti_ros2.datasets import validate
from kitti_ros2.files.local_files import crc32
from kitti_ros2.files.processes import forked_map
from kitti_ros2.files.threads import worker_count

FOLDERS = {'image_2': '.png', 'velodyne': '.bin', 'calib': '.txt', 'label_2': '.txt'}
SHORT = 100


def repeat_frames(source: Path, out: Path, frames: int, *, copies: bool) -> Path:
    """Make an object set whose frames are hard links to those of a split, or copies of them."""
    numbers = sorted(path.stem for path in (source / 'velodyne').glob('*.bin'))
    for folder, suffix in FOLDERS.items():
        (out / 'training' / folder).mkdir(parents=True)
        for number, stem in zip(range(frames), cycle(numbers), strict=False):
            target = out / 'training' / folder / f'{number:06d}{suffix}'
            if copies:
                shutil.copyfile(source / folder / f'{stem}{suffix}', target)
            else:
                target.hardlink_to(source / folder / f'{stem}{suffix}')
    return out


def cat(folder: Path) -> None:
    """Read all files of a folder."""
    command = 'find "$0" -type f -print0 | sort -z | xargs -0 cat > /dev/null'
    subprocess.run(['sh', '-c', command, str(folder)], check=True)


def read_bare(folder: Path) -> None:
    """Read all files with the least that a check of their bytes needs."""
    paths = sorted(path for path in folder.rglob('*') if path.is_file())
    batches = [paths[start : start + 96] for start in range(0, len(paths), 96)]
    for _ in forked_map(_check_bare, batches, worker_count()):
        pass


def _check_bare(paths: list[Path]) -> None:
    # New memory for each file costs page faults; at some places in a page copies take far longer.
    memory = memoryview(mmap.mmap(-1, max(path.stat().st_size for path in paths)))
    for path in paths:
        with path.open('rb', buffering=0) as file:
            data = memory[: file.readinto(memory)]
        if path.suffix == '.png':
            crc32(data)
        elif path.suffix == '.bin':
            columns = np.frombuffer(data[: len(data) // 4096 * 4096], np.float32).reshape(-1, 1024)
            np.minimum.reduce(columns)
            np.maximum.reduce(columns)


def run_command(folder: Path) -> None:
    """Run the command, start included."""
    subprocess.run([*COMMAND, 'validate', '-q', str(folder)], check=True)


def main() -> None:
    """Measure."""
    parser = make_parser(__doc__)
    parser.add_argument('src', type=Path)
    parser.add_argument('--frames', type=int, default=1000)
    parser.add_argument('--copies', action='store_true', help='files of their own')
    parser.add_argument('--repeat', type=int, default=5)
    with parse_in_folder(parser, 'where to link; on the disk of SRC') as (given, folder):
        copy = shutil.copytree(given.src / 'training', folder / 'source')
        many = repeat_frames(copy, folder / 'many', given.frames, copies=given.copies)
        few = repeat_frames(copy, folder / 'few', SHORT, copies=given.copies)
        size = tree_bytes(many)
        rounds = [
            (
                seconds(lambda: cat(many)),
                seconds(lambda: validate(many)),
                seconds(lambda: run_command(many)),
                seconds(lambda: read_bare(many)),
            )
            for _ in range(given.repeat)
        ]
        read, library, command, bare = (median(times) for times in zip(*rounds, strict=True))
        report('cat, MB/s', size / read / 1e6, '', f'{given.frames} frames, {size / 1e6:.0f} MB')
        report('validate, MB/s', size / library / 1e6, '')
        report('validate / cat', read / library, '>= 0.6')
        report('the command, start included / cat', read / command, '')
        report('bare / cat', read / bare, '')
        peak, longer = (peak_mb('validate', '-q', str(each)) for each in (few, many))
        report(f'peak memory, {SHORT} frames, MB', peak, '')
        report(
            f'{given.frames} frames / {SHORT}',
            longer / peak,
            '<= 1.1',
        )


if __name__ == '__main__':
    main()
