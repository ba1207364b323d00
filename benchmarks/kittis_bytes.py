#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What of KITTI's own files comes back from a bag, how small bags are, and at what cost.

    python benchmarks/kittis_bytes.py [--kitti FOLDER] [--repeat N] [--dir FOLDER]

FOLDER is that of real samples: raw drives 0005 (frame 0) and 0052 (8 frames), object, odometry.
Sizes are those of one copy of each real file. Times are CPU seconds, least of N by turns; that of
images beside bare zlib is printed by python -m benchmarks.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path
from shutil import copy
from statistics import mean
from typing import TYPE_CHECKING, Any

import numpy as np
import zstandard

from kitti_ros2.kitti.compact_scan import compact, restore
from kitti_ros2.messages.cloudini import decode_points, read_header
from kitti_ros2.messages.compact_clouds import encode_compact, encode_rest
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import COMPRESSED_POINTS, STRING

from yardsticks import COMMAND, fresh, make_parser, parse_in_folder, report, seconds  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

SHARED = Path(__file__).resolve().parents[2] / 'shared'
SCANS = {'raw': 0.22, 'object': 0.22, 'odometry': 0.23, 'semantickitti': 0.23}
"""Part of its .bin that a scan takes in a bag, the aim, by folder of the samples."""
DRIVE = 'raw/2011_09_26/2011_09_26_drive_0005_sync'
FOREIGN = ('--images', 'raw', '--preset', 'kitti2bag', '--exclude-topics', '/kitti/source/*')
FRAMES = 8


def run(*words: str | Path) -> tuple[float, float]:
    """Run a command of kitti-ros2; return its seconds of CPU, and of wall time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    took = seconds(lambda: subprocess.run([*COMMAND, *map(str, words), '-q'], check=True))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, took


def least(*works: Callable[[], object], repeat: int) -> list[float]:
    """Return the least CPU seconds of each work, by turns."""
    took: list[list[float]] = [[] for _ in works]
    for _ in range(repeat):
        for work, runs in zip(works, took, strict=True):
            started = time.process_time()
            work()
            runs.append(time.process_time() - started)
    return [min(runs) for runs in took]


def report_files(made: Path, true: Path, suffix: str, name: str) -> None:
    """Report the part of a drive's files with a suffix that are the same byte for byte."""
    files = sorted(true.rglob(f'*{suffix}'))
    same = 0
    for path in files:
        other = made / path.relative_to(true)
        same += other.exists() and other.read_bytes() == path.read_bytes()
    report(name, same / len(files), '1', f'{same} of {len(files)}')


def measure_files(drive: Path, folder: Path) -> None:
    """To bags of raw images and back: own ones, and such as kitti2bag writes."""
    cases = {'own': ('--images', 'raw', '--clouds', 'compact'), 'kitti2bag': FOREIGN}
    for name, words in cases.items():
        bag, out = folder / 'files.mcap', folder / name
        run('to-bag', drive, bag, *words)
        run('to-kitti', bag, out, '--layout', 'raw')
        made = next(out.rglob('velodyne_points')).parent
        for suffix in ('.png', '.bin', 'timestamps.txt'):
            report_files(made, drive, suffix, f'{name} bag: {suffix} identical')
        fresh(bag)


def measure_scans(kitti: Path, repeat: int) -> None:
    """Sizes of scans in a bag, and the cost of encoding and decoding, beside zstd."""
    for name, aim in SCANS.items():
        sizes, packed, costs = [], [], []
        for path in sorted((kitti / name).rglob('*.bin')):
            points = np.fromfile(path, '<f4').reshape(-1, 4)
            data = points.tobytes()
            cloud, rest = _encoded(points, path)
            octets = zstandard.ZstdCompressor(level=3).compress(data)
            sizes.append((len(cloud) + len(rest)) / len(data))
            packed.append(len(octets) / len(data))
            costs.append(_costs(points, path, cloud, octets, repeat))
        note = f'{mean(sizes):.4f} of {len(sizes)} scans; zstd {mean(packed):.4f}'
        report(f'{name}: scan in a bag / its .bin', mean(sizes), f'<= {aim}', note)
        encode, zstd, decode, made_again, unzstd = 1000 * np.mean(costs, axis=0)
        report(f'{name}: encoding / zstd', encode / zstd, '<= 0.33', f'{encode:.1f} ms of CPU')
        note = f'{decode:.1f} ms; the file of it {made_again:.1f}, unzstd {unzstd:.1f}'
        report(f'{name}: decoding / unzstd', decode / unzstd, '', note)


def _encoded(points: npt.NDArray[np.float32], path: Path) -> tuple[bytes, bytes]:
    scan = compact(points)
    cloud = encode_compact(points, scan.multiples, 0, 'velo_link')
    rest = encode_rest(scan.rest, path)
    return (
        bytes(TYPESTORE.serialize_cdr(cloud, COMPRESSED_POINTS)),
        bytes(TYPESTORE.serialize_cdr(rest, STRING)),
    )


def _costs(
    points: npt.NDArray[np.float32], path: Path, cloud: bytes, octets: bytes, repeat: int
) -> list[float]:
    """Return CPU seconds: encoding, zstd, decoding, the file of that, unzstd."""
    message: Any = TYPESTORE.deserialize_cdr(cloud, COMPRESSED_POINTS)
    packed = message.compressed_data.tobytes()
    rest, data = compact(points).rest, points.tobytes()
    decoded = decode_points(packed, read_header(packed)).view('<f4').reshape(-1, 4)
    return least(
        lambda: _encoded(points, path),
        lambda: zstandard.ZstdCompressor(level=3).compress(data),
        lambda: decode_points(packed, read_header(packed)),
        lambda: restore(decoded, rest),
        lambda: zstandard.ZstdDecompressor().decompress(octets),
        repeat=repeat,
    )


def measure_frame(kitti: Path, folder: Path) -> None:
    """Report the bytes of a bag of one real frame, by all choices."""
    for images in ('compressed', 'raw', 'both'):
        for clouds in ('plain', 'compact'):
            sizes = []
            for compression in ('none', 'lz4', 'zstd'):
                bag, words = folder / 'frame.mcap', ('--images', images, '--clouds', clouds)
                first = ('--start', '0', '--end', '0')
                run('to-bag', kitti / DRIVE, bag, *words, *first, '--compression', compression)
                sizes.append(bag.stat().st_size / 1e6)
                fresh(bag)
            aim = '<= 2.85' if (images, clouds) == ('compressed', 'compact') else ''
            note = 'lz4 {:.2f}, zstd {:.2f}'.format(*sizes[1:])
            report(f'frame 0005/0, images {images}, clouds {clouds}, MB', sizes[0], aim, note)


def measure_conversion(name: str, words: tuple[str | Path, ...], bag: Path, repeat: int) -> None:
    """Report what to-bag costs by choice of clouds and compression, CPU ms a frame."""
    choices = {
        'plain': (),
        'zstd': ('--compression', 'zstd'),
        'lz4': ('--compression', 'lz4'),
        'compact': ('--clouds', 'compact'),
        'raw images': ('--images', 'raw'),
    }
    costs: dict[str, list[float]] = {choice: [] for choice in choices}
    starts: list[float] = []
    for _ in range(repeat):
        starts.append(run('to-bag', *words, fresh(bag), '--start', '0', '--end', '0')[0])
        for choice, options in choices.items():
            costs[choice].append(run('to-bag', *words, fresh(bag), *options)[0])
    least_of = {choice: min(cost) for choice, cost in costs.items()}
    of_frames = ', '.join(
        f'{choice} {1000 * (cost - min(starts)) / (FRAMES - 1):.0f}'
        for choice, cost in least_of.items()
    )
    ratio = least_of['compact'] / least_of['zstd']
    report(f'{name}: to-bag, compact / zstd', ratio, '<= 1', f'CPU ms a frame: {of_frames}')


def make_odometry(kitti: Path, folder: Path) -> Path:
    """Lay out a sequence of the real scans of odometry by turns, with images of the drive."""
    source, root = kitti / 'odometry/dataset', folder / 'odometry'
    sequence = root / 'sequences/00'
    scans = sorted((source / 'sequences/00/velodyne').iterdir())
    images = kitti / 'raw/2011_09_26/2011_09_26_drive_0052_sync'
    for number in range(FRAMES):
        paths = {'velodyne': scans[number % len(scans)]}
        for camera in range(4):
            of_camera = images / f'image_0{camera // 2 * 2}/data'
            paths[f'image_{camera}'] = sorted(of_camera.iterdir())[number]
        for stream, path in paths.items():
            (sequence / stream).mkdir(parents=True, exist_ok=True)
            copy(path, sequence / stream / f'{number:06d}{path.suffix}')
    copy(source / 'sequences/00/calib.txt', sequence)
    (root / 'poses').mkdir()
    for name, out in (('sequences/00/times.txt', sequence), ('poses/00.txt', root / 'poses')):
        lines = (source / name).read_text().splitlines(keepends=True)[:FRAMES]
        (out / Path(name).name).write_text(''.join(lines))
    return root


def main() -> None:
    """Run all measures."""
    parser = make_parser(__doc__)
    parser.add_argument('--kitti', type=Path, default=SHARED / 'kitti')
    parser.add_argument('--repeat', type=int, default=5)
    with parse_in_folder(parser) as (given, folder):
        make_drive = given.kitti.parent / 'tools/make_drive.py'
        if not (given.kitti / DRIVE).is_dir() or not make_drive.exists():
            print(f'skipped: {given.kitti} has no samples of KITTI, or {make_drive} is missing')
            return
        run_all(given.kitti, make_drive, folder, given.repeat)


def run_all(kitti: Path, make_drive: Path, folder: Path, repeat: int) -> None:
    """Run all measures on one copy of each real frame."""
    subprocess.run([sys.executable, make_drive, folder / 'drive', str(FRAMES)], check=True)
    [drive] = (folder / 'drive').glob('*/*_sync')
    measure_files(drive, folder)
    measure_scans(kitti, repeat)
    measure_frame(kitti, folder)
    bag = folder / 'out.mcap'
    measure_conversion('raw', (drive,), bag, repeat)
    odometry = make_odometry(kitti, folder)
    measure_conversion('odometry', (odometry, '--sequence', '00'), bag, repeat)


if __name__ == '__main__':
    main()
