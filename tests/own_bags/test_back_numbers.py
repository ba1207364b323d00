# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Any file numbers come back, in every layout and container: compared by diff -r."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from builders import png_bytes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kitti_ros2.cli import main

from waiting import PATIENCE_S  # isort: skip

DATE = '2011_09_26'
DRIVE = f'{DATE}_drive_0009_sync'
LAST = 120
CALIB = 'P0: 700 0 600 0 0 700 180 0 0 0 1 0\n'
PNG = png_bytes(16, 8)
PACKET = '49.0 8.4 115.0 ' + '0.1 ' * 22 + '4 10 6 6 6\n'
ENDINGS = ('.mcap', '.bag', '')

numbers = st.sets(st.integers(0, LAST), max_size=5)


def put(path: Path, data: bytes | str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())


def scan_bytes(number: int) -> bytes:
    return np.full((number % 3 + 1, 4), number, '<f4').tobytes()


def put_scans(folder: Path, found: set[int], digits: int) -> None:
    for number in found:
        put(folder / f'{number:0{digits}d}.bin', scan_bytes(number))


def put_images(folder: Path, found: set[int], digits: int) -> None:
    """Images that differ in the bytes behind their end, which readers ignore."""
    for number in found:
        put(folder / f'{number:0{digits}d}.png', PNG + b'\0' * (number % 50))


def stamp_lines(offsets: list[int]) -> str:
    """A timestamps.txt; equal and falling offsets are allowed."""
    return ''.join(
        f'2011-09-26 13:02:{offset // 10:02d}.{offset % 10}00000001\n' for offset in offsets
    )


def lay_out(root: Path, layout: str, scans: set[int], images: set[int], lines: list[int] | None):
    """A set of the layout; returns what to convert and the data set's root."""
    if layout == 'raw':
        drive = root / DATE / DRIVE
        put_scans(drive / 'velodyne_points/data', scans, 10)
        put_images(drive / 'image_02/data', images, 10)
        for number in images:
            put(drive / f'oxts/data/{number:010d}.txt', PACKET)
        for folder in ('velodyne_points', 'image_02', 'oxts') if lines is not None else ():
            if (drive / folder).is_dir():
                put(drive / folder / 'timestamps.txt', stamp_lines(lines))
        return drive
    if layout == 'odometry':
        sequence = root / 'sequences/07'
        put_scans(sequence / 'velodyne', scans, 6)
        put_images(sequence / 'image_2', images, 6)
        put(sequence / 'calib.txt', CALIB)
        if lines is not None:
            put(sequence / 'times.txt', ''.join(f'{line / 10:e}\n' for line in lines))
        return sequence
    if layout == 'tracking':
        put_scans(root / 'training/velodyne/0001', scans, 6)
        put_images(root / 'training/image_02/0001', images, 6)
        put(root / 'training/calib/0001.txt', CALIB)
        rows = ''.join(f'{n} 1 Car 0 0 0 1 1 2 2 1 1 1 1 1 9 0\n' for n in sorted(scans))
        put(root / 'training/label_02/0001.txt', rows)
        return root / 'training'
    split = root / 'testing'
    put_scans(split / 'velodyne', scans, 6)
    put_images(split / 'image_2', images, 6)
    for number in scans | images:
        put(split / f'calib/{number:06d}.txt', CALIB.replace('180', str(180 + number)))
    return split


def there_and_back(source: Path, root: Path, ending: str, folder: Path) -> tuple[int, str]:
    """The exit code of the way back, and what diff says of the two sets."""
    bag, out = folder / f'bag{ending}', folder / 'out'
    words = ['to-bag', str(source), str(bag), '-q']
    assert main(words if ending else [*words, '--storage', 'sqlite3']) in {0, 1}
    code = main(['to-kitti', str(bag), str(out), '-q'])
    done = subprocess.run(
        ['diff', '-r', root, out], capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    return code, done.stdout + done.stderr


@pytest.mark.one_in(3)
@pytest.mark.parametrize('ending', ENDINGS)
@pytest.mark.parametrize('layout', ['raw', 'object', 'odometry', 'tracking'])
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scans=numbers, images=numbers, stamped=st.booleans(), data=st.data())
def test_any_numbers_come_back(layout, ending, scans, images, stamped, data):
    if not scans | images:
        return
    lines = None
    if stamped and layout in {'raw', 'odometry'}:
        count = max(scans | images) + 1 + data.draw(st.integers(0, 3))
        lines = data.draw(st.lists(st.integers(0, 599), min_size=count, max_size=count))
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / 'in'
        source = lay_out(root, layout, scans, images, lines)
        assert there_and_back(source, root, ending, Path(folder)) == (0, '')


@pytest.mark.one_in(3)
@pytest.mark.parametrize('stamped', [True, False])
@pytest.mark.parametrize('found', [{0, 2}, {8, 114}, {3, 4, 5}, {7}])
@pytest.mark.parametrize('layout', ['raw', 'object', 'odometry', 'tracking'])
def test_numbers_with_holes_and_later_beginnings_come_back(layout, found, stamped, tmp_path):
    lines = list(range(LAST)) if stamped else None
    source = lay_out(tmp_path / 'in', layout, found, found, lines)
    assert there_and_back(source, tmp_path / 'in', '.mcap', tmp_path) == (0, '')


def test_a_tracking_sequence_without_some_scans_comes_back(tmp_path):
    """KITTI's own sequence 0001 lacks scans 177 to 180."""
    every = set(range(25))
    source = lay_out(tmp_path / 'in', 'tracking', every - {17, 18, 19, 20}, every, None)
    assert there_and_back(source, tmp_path / 'in', '.bag', tmp_path) == (0, '')


@pytest.mark.parametrize('ending', ENDINGS)
def test_the_real_frame_000002_alone_comes_back(real_kitti, ending, tmp_path):
    """One frame that is not frame 0, as testing/000007 would be."""
    root = tmp_path / 'in'
    for folder, suffix in (('image_2', 'png'), ('velodyne', 'bin'), ('calib', 'txt')):
        path = real_kitti / 'object/training' / folder / f'000002.{suffix}'
        target = root / 'testing' / folder / f'000007.{suffix}'
        target.parent.mkdir(parents=True)
        shutil.copyfile(path, target)
    assert there_and_back(root / 'testing', root, ending, tmp_path) == (0, '')


@pytest.mark.parametrize('ending', ENDINGS)
@pytest.mark.parametrize('layout', ['raw', 'odometry'])
def test_a_damaged_stamp_line_costs_that_frame_only(layout, ending, tmp_path, capsys):
    """to-bag has no stamp for the frame and says so; the rest comes back, the bad line included."""
    root, found = tmp_path / 'in', {0, 1, 3, 4}
    source = lay_out(root, layout, found, found, [0, 1, 2, 3, 4, 5])
    spoiled = [path for path in root.rglob('*.txt') if path.name in {'timestamps.txt', 'times.txt'}]
    for path in spoiled:
        lines = path.read_text().splitlines(keepends=True)
        path.write_text(''.join([*lines[:3], 'O.3e-##\n', *lines[4:]]))
    code, difference = there_and_back(source, root, ending, tmp_path)
    said = capsys.readouterr().err
    assert 'internal error' not in said
    missing = difference.splitlines()
    assert missing
    assert all(line.startswith(f'Only in {root}/') for line in missing)
    assert {int(Path(line.rsplit(': ', 1)[1]).stem) for line in missing} == {3}
    assert code == 0  # the bag was never made to hold frame 3, which to-bag named
