# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What programs that read KITTI's drives and sequences demand of a set, with the sources.

utiasSTARS/pykitti 0.3.1; PRBonn/kiss-icp 1.3.0; MichaelGrupp/evo 1.38.1.
"""

from __future__ import annotations

import re
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from breaches import Breaches, read_points

if TYPE_CHECKING:
    from pathlib import Path

_PYKITTI = 'pykitti 0.3.1 pykitti/'
_KISS = 'kiss-icp 1.3.0 kiss_icp/datasets/kitti.py'
_EVO = 'evo 1.38.1 evo/tools/file_interface.py'


def check_pykitti(root: Path) -> list[str]:
    """Check each raw drive, odometry sequence or tracking sequence of a data set.

    pykitti pairs by position in listings, so each stream must have every frame.
    """
    breaches = Breaches()
    drives = [path for path in root.glob('*/*_drive_*') if path.is_dir()]
    for drive in drives:
        _check_pykitti_drive(breaches, drive)
    sequences = sorted((root / 'sequences').glob('*'))
    for sequence in sequences:
        _check_pykitti_sequence(breaches, sequence)
    tracks = sorted((root / 'training' / 'velodyne').glob('*/'))
    for track in tracks:
        streams = {
            folder: sorted((root / 'training' / folder / track.name).glob(f'*.{suffix}'))
            for folder, suffix in (('image_02', 'png'), ('image_03', 'png'), ('velodyne', 'bin'))
        }
        _check_paired(breaches, track, streams, f'{_PYKITTI}tracking.py:107-118')
    breaches.demand(drives or sequences or tracks, root, 'no drive and no sequence', _PYKITTI)
    return breaches.lines


def _check_pykitti_drive(breaches: Breaches, drive: Path) -> None:
    name = re.fullmatch(r'(\d{4}_\d\d_\d\d)_drive_(\d{4})_(sync|extract)', drive.name)
    well_named = name is not None and name[1] == drive.parent.name
    breaches.demand(well_named, drive, 'not DATE/DATE_drive_NNNN_sync', f'{_PYKITTI}raw.py:22-24')
    keys = {
        'calib_imu_to_velo.txt': {'R': 9, 'T': 3},
        'calib_velo_to_cam.txt': {'R': 9, 'T': 3},
        'calib_cam_to_cam.txt': {f'P_rect_{i:02d}': 12 for i in range(4)}
        | {f'R_rect_{i:02d}': 9 for i in range(4)},
    }
    for file, sizes in keys.items():
        source = f'{_PYKITTI}raw.py:148,164-182'
        _check_keys(breaches, drive.parent / file, sizes, source)
    streams = {
        'oxts': sorted((drive / 'oxts/data').glob('*.txt')),
        'velodyne': sorted((drive / 'velodyne_points/data').glob('*.bin')),
    } | {f'image_{i:02d}': sorted((drive / f'image_{i:02d}/data').glob('*.png')) for i in range(4)}
    _check_paired(breaches, drive, streams, f'{_PYKITTI}raw.py:111-127')
    path = drive / 'oxts/timestamps.txt'
    source = f'{_PYKITTI}raw.py:253-259'
    text = breaches.attempt(path.read_text, path, 'len() and oxts need it', source)
    if text is None:
        return
    lines = text.splitlines(keepends=True)
    for place, line in enumerate(lines, 1):
        parse = lambda line=line: datetime.strptime(line[:-4], '%Y-%m-%d %H:%M:%S.%f')  # noqa: E731, DTZ007
        breaches.attempt(parse, f'{path}:{place}', 'no time', source)
    count = len(streams['oxts'])
    breaches.demand(len(lines) == count, path, f'{len(lines)} times, {count} packets', source)
    for packet in streams['oxts']:
        rows = packet.read_text().splitlines()
        parsed = breaches.attempt(
            lambda rows=rows: [[float(word) for word in row.split()] for row in rows],
            packet,
            'is no packet',
            f'{_PYKITTI}utils.py:122-128',
        )
        is_one = parsed is not None and [len(row) for row in parsed] == [30]
        breaches.demand(is_one, packet, 'not one line of 30', f'{_PYKITTI}utils.py:122-128')


def _check_pykitti_sequence(breaches: Breaches, sequence: Path) -> None:
    sizes = {f'P{i}': 12 for i in range(4)} | {'Tr': 12}
    _check_keys(breaches, sequence / 'calib.txt', sizes, f'{_PYKITTI}odometry.py:147-169')
    path = sequence / 'times.txt'
    source = f'{_PYKITTI}odometry.py:201-204'
    times = breaches.attempt(
        lambda: [float(line) for line in path.read_text().splitlines()], path, 'no times', source
    )
    streams = {'velodyne': sorted((sequence / 'velodyne').glob('*.bin'))} | {
        f'image_{i}': sorted((sequence / f'image_{i}').glob('*.png')) for i in range(4)
    }
    _check_paired(breaches, sequence, streams, f'{_PYKITTI}odometry.py:110-124')
    if times is not None:
        counts = {len(files) for files in streams.values() if files} - {len(times)}
        breaches.demand(not counts, path, f'{len(times)} times, {counts} files', source)
    path = sequence.parent.parent / 'poses' / f'{sequence.name}.txt'
    if path.exists() and times is not None:
        lines = path.read_text().splitlines()
        source = f'{_PYKITTI}odometry.py:222-226'
        breaches.demand(len(lines) == len(times), path, f'{len(lines)} poses', source)


def _check_keys(breaches: Breaches, path: Path, sizes: dict[str, int], source: str) -> None:
    read = breaches.attempt(
        lambda: dict(line.split(':', 1) for line in path.read_text().splitlines()),
        path,
        'a line without a colon',
        f'{_PYKITTI}utils.py:74',
    )
    for key, size in sizes.items() if read is not None else ():
        values = breaches.attempt(
            lambda key=key: [float(word) for word in read[key].split()], path, f'no {key}', source
        )
        if values is None or not breaches.demand(len(values) == size, path, key, source):
            continue
        if key.startswith('P'):
            text = f'{key} has a focal length of 0, a divisor'
            breaches.demand(values[0], path, text, f'{_PYKITTI}raw.py:191; odometry.py:162')


def _check_paired(
    breaches: Breaches, where: Path, streams: dict[str, list[Path]], source: str
) -> None:
    names = {stream: [path.stem for path in files] for stream, files in streams.items() if files}
    counts = {stream: len(files) for stream, files in names.items()}
    text = f'streams are paired by position, and have not the same numbers: {counts}'
    breaches.demand(len({tuple(each) for each in names.values()}) <= 1, where, text, source)


def check_kiss_icp(root: Path, sequence: str = '00') -> list[str]:
    """Check an odometry sequence as kiss_icp_pipeline --dataloader kitti reads it."""
    breaches = Breaches()
    folder = root / 'sequences' / sequence
    number = breaches.attempt(lambda: int(sequence), folder, 'no number', f'{_KISS}:39')
    scans = sorted((folder / 'velodyne').glob('*.bin'))
    breaches.demand(scans, folder, 'no scans', f'{_KISS}:35')
    for scan in scans:
        points = read_points(breaches, scan, f'{_KISS}:66')
        if points is not None:
            breaches.demand(len(points), scan, 'no points', f'{_KISS}:66')
    path = folder / 'calib.txt'
    read = breaches.attempt(
        lambda: {
            line.split(' ')[0][:-1]: [float(word) for word in line.split(' ')[1:]]
            for line in path.read_text().splitlines(keepends=True)
        },
        path,
        'values',
        f'{_KISS}:96-107',
    )
    if read is not None:
        breaches.demand(len(read.get('Tr', ())) == 12, path, 'no Tr of 12', f'{_KISS}:62,73')
    if number is None or number >= 11:
        return breaches.lines
    path = root / 'poses' / f'{sequence}.txt'
    poses = breaches.attempt(
        lambda: np.loadtxt(path, delimiter=' '), path, 'poses of 00 to 10', f'{_KISS}:39-41,80'
    )
    if poses is not None:
        fits = poses.shape == (len(scans), 12)
        breaches.demand(fits, path, f'{poses.shape}, scans {len(scans)}', f'{_KISS}:80-85')
    return breaches.lines


def check_evo(path: Path) -> list[str]:
    """Check a file of poses as evo_traj kitti reads it, and that they are rigid."""
    breaches = Breaches()
    lines = path.read_text().splitlines()
    source = f'{_EVO}:183-201'
    breaches.demand(lines, path, 'no poses', source)
    for place, line in enumerate(lines, 1):
        where = f'{path}:{place}'
        words = line.split(' ')
        if not breaches.demand(len(words) == 12, where, f'{len(words)} entries', source):
            continue
        rotation = breaches.attempt(
            lambda words=words: np.array(words, dtype=float).reshape(3, 4)[:, :3],
            where,
            'a number',
            source,
        )
        if rotation is not None:
            is_rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
            source_rigid = 'evo 1.38.1 evo/core/lie_algebra.py is_so3, PosePath3D.check'
            breaches.demand(is_rigid, where, 'no rotation', source_rigid)
    return breaches.lines
