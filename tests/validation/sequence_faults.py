# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of raw drives, odometry and tracking sequences: each has a row."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from planting import (
    Fault,
    add_line,
    cut,
    drop_key,
    edit_line,
    empty,
    flip,
    remove,
    set_key,
    set_word,
    write_blank,
)

from kitti_ros2.kitti.text_file import format_timestamps, parse_timestamps
from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from pathlib import Path

MS = 1_000_000
DATE = '2011_09_26'


def drive(root: Path, name: str) -> Path:
    return root / DATE / f'{DATE}_drive_0001_sync' / name


def data(stream: str, suffix: str):
    return lambda root, n: drive(root, f'{stream}/data/{n:010d}{suffix}')


def moved(stream: str, by_ns: int, *, all_later: bool = False, file: str = 'timestamps.txt'):
    """Move the stamp of a frame, or those of the frames from it on, too."""

    def plant(root: Path, n: int) -> Path:
        path = drive(root, f'{stream}/{file}')
        stamps = parse_timestamps(path.read_text(), path).values
        for index in range(n, len(stamps) if all_later else n + 1):
            stamps[index] += by_ns
        path.write_text(format_timestamps(stamps))
        return path

    return plant


def repeated(root: Path, n: int) -> Path:
    path = drive(root, 'image_03/timestamps.txt')
    line = path.read_text().splitlines()[n - 1]
    return edit_line(path, n + 1, lambda _: line)


def line_of(name: str, text: str):
    return lambda root, n: edit_line(drive(root, name), n + 1, lambda _: text)


def column(index: int, value: str):
    """A packet with another value in a column, from 0."""
    return lambda root, n: set_word(data('oxts', '.txt')(root, n), 1, index, value)


def every_packet(index: int, value: str):
    def plant(root: Path, n: int) -> Path:
        folder = data('oxts', '.txt')(root, n).parent
        for path in folder.iterdir():
            set_word(path, 1, index, value)
        return folder

    return plant


def of(find, damage, *rest: object):
    return lambda root, n: damage(find(root, n), *rest)


def whole(name: str, damage, *rest: object):
    """Damage a file of the drive."""
    return lambda root, _: damage(drive(root, name), *rest)


def dated(name: str, damage, *rest: object):
    """Damage a file of the date; findings name the folder, unless a line is known."""
    return lambda root, _: damage(root / DATE / name, *rest)


def negative_height(root: Path, _: int) -> Path:
    path = drive(root, 'tracklet_labels.xml')
    head, _, rest = path.read_text().partition('<h>')
    path.write_text(f'{head}<h>-{rest}')
    return path


def no_stamps(root: Path, _: int) -> Path:
    for path in drive(root, '').glob('*/timestamps*.txt'):
        path.unlink()
    return drive(root, '')


def text_scans(root: Path, n: int) -> Path:
    """Scans as text, as extracts have them; one with three numbers a line."""
    folder = data('velodyne_points', '')(root, n).parent
    for path in list(folder.iterdir()):
        path.unlink()
        path.with_suffix('.txt').write_text('1 2 3 0.5\n')
    path = data('velodyne_points', '.txt')(root, n)
    path.write_text('1 2 3\n')
    return path


def first_word(value: str):
    return lambda words: [value, *words[1:]]


def other_place(root: Path, _: int) -> Path:
    return set_key(root / DATE / 'calib_cam_to_cam.txt', 'T_03', first_word('-1'))


def sequence(name: str):
    return lambda root, _: root / 'sequences/00' / name


def poses(root: Path, _: int) -> Path:
    return root / 'poses/00.txt'


def scaled_pose(root: Path, n: int) -> Path:
    words = poses(root, n).read_text().splitlines()[n].split()
    return set_word(poses(root, n), n + 1, 0, f'{float(words[0]) * 1.2:.6e}')


def point_labels(root: Path, n: int) -> Path:
    """Labels for every scan of the sequence; returns the file of a frame."""
    folder = root / 'sequences/00/labels'
    folder.mkdir(exist_ok=True)
    for path in (root / 'sequences/00/velodyne').glob('*.bin'):
        label = folder / f'{path.stem}.label'
        if not label.exists():
            label.write_bytes(bytes(path.stat().st_size // 4))
    return folder / f'{n:06d}.label'


def gone(path: Path) -> Path:
    path.unlink()
    return path


def folder_gone(path: Path) -> Path:
    shutil.rmtree(path)
    return path


def numbered(folder: str, suffix: str):
    return lambda root, n: root / folder / f'{n:06d}{suffix}'


def track_file(folder: str):
    return lambda root, _: root / 'training' / folder / '0000.txt'


LABEL = track_file('label_02')


def track_lines(root: Path, n: int) -> list[int]:
    """The lines of a frame's labels with a track, from 1."""
    rows = [each.split() for each in LABEL(root, n).read_text().splitlines()]
    return [line for line, row in enumerate(rows, 1) if row[0] == str(n) and row[1] != '-1']


def track_word(index: int, value: str, place: int = 0):
    def plant(root: Path, n: int) -> Path:
        return set_word(LABEL(root, n), track_lines(root, n)[place], index, value)

    return plant


def unknown_occlusion(root: Path, n: int) -> Path:
    rows = [line.split() for line in LABEL(root, n).read_text().splitlines()]
    text = ''.join(f'{" ".join([*row[:4], "3", *row[5:]])}\n' for row in rows)
    LABEL(root, n).write_text(text)
    return LABEL(root, n)


def track_twice(root: Path, n: int) -> Path:
    line = LABEL(root, n).read_text().splitlines()[track_lines(root, n)[0] - 1]
    words = line.split()
    words[-2] = f'{float(words[-2]) + 1:.6f}'
    return add_line(LABEL(root, n), ' '.join(words))


def oxts_word(index: int, value: str):
    return lambda root, n: set_word(track_file('oxts')(root, n), n + 1, index, value)


_T = 'timestamps.txt'
_RAW = (
    ('stamp is text', 'stamps-line', line_of(f'image_00/{_T}', 'yesterday')),
    ('stamp before the one above', 'stamps-order', moved('image_01', -300 * MS)),
    ('stamp twice', 'stamps-repeated', repeated),
    ('gap', 'stamps-gap', moved('image_03', 900 * MS, all_later=True), (), True),
    ('clock not set', 'stamps-date', line_of(f'image_00/{_T}', '1980-01-06 00:00:01.000000000')),
    ('camera late', 'stamps-pair', moved('image_02', 80 * MS)),
    ('turn that ends before it starts', 'stamps-turn',
     lambda root, n: moved('velodyne_points', -400 * MS, file='timestamps_end.txt')(
         root, n).with_name('timestamps_start.txt')),
    ('stamps cut', 'data-unusable', whole(f'image_02/{_T}', cut, 90), (), True),
    ('stamps of a stream missing', 'data-unusable', whole(f'image_01/{_T}', gone), (), True),
    ('stamps not in UTF-8', 'text-file', whole(f'image_00/{_T}', flip, 3), (), True),
    ('stamps empty', 'file-empty', whole(f'image_02/{_T}', empty), (), True),
    ('no stamps at all', 'stamps-missing', no_stamps, (), True),
    ('packet of 29 numbers', 'oxts-packet', of(data('oxts', '.txt'), edit_line, 1,
                                              lambda line: line.rsplit(' ', 1)[0])),
    ('packet with NaN', 'oxts-packet', column(4, 'nan')),
    ('GPS jumps', 'oxts-position', column(0, '49.1')),
    ('yaw jumps', 'oxts-yaw', column(5, '2.5')),
    ('vf in km/h', 'oxts-forward', column(8, '60')),
    ('gravity removed', 'oxts-gravity', every_packet(13, '0.01'), (), True),
    ('speed of 1000 m/s', 'oxts-extreme', column(7, '1000')),
    ('packet missing', 'frames-missing', of(data('oxts', '.txt'), remove)),
    ('scan of three numbers a line', 'scan-file', text_scans, (), True),
    ('image of another size', 'image-size', of(data('image_00', '.png'), write_blank, (30, 20), 0)),
    ('tracklets cut', 'data-unusable', whole('tracklet_labels.xml', cut, 400), (), True),
    ('tracklet of negative height', 'tracklet-size', negative_height),
    ('file of calibration missing', 'calib-missing', dated('calib_imu_to_velo.txt', gone)),
    ('calibration of another day', 'calib-day',
     dated('calib_cam_to_cam.txt', add_line, 'calib_time: 09-Jan-2012 14:00:15')),
    ('K is text', 'calib-value', dated('calib_cam_to_cam.txt', set_key, 'K_02', first_word('x'))),
    ('P_rect of another calibration', 'calib-contradiction',
     other_place),
)  # fmt: skip
_ODOMETRY = (
    ('time is text', 'stamps-line', of(sequence('times.txt'), edit_line, 2, lambda _: 'later')),
    ('time goes back', 'stamps-order', lambda root, n: edit_line(
        sequence('times.txt')(root, n), n + 1, lambda _: '0.0')),
    ('pose of 11 numbers', 'pose-line', lambda root, n: edit_line(
        poses(root, n), n + 1, lambda line: line.rsplit(' ', 1)[0])),
    ('pose that is no rotation', 'pose-rotation', scaled_pose),
    ('pose far away', 'pose-jump', lambda root, n: set_word(poses(root, n), n + 1, 11, '500')),
    ('poses cut', 'data-unusable', of(poses, cut, 400), (), True),
    ('labels of points cut', 'scan-labels', of(point_labels, cut, -4)),
    ('labels of points missing', 'scan-labels', of(point_labels, gone)),
    ('image missing', 'frames-missing', of(numbered('sequences/00/image_2', '.png'), remove)),
    ('camera missing', 'stream-missing', of(sequence('image_3'), folder_gone)),
    ('calibration without Tr', 'calib-missing', of(sequence('calib.txt'), drop_key, 'Tr')),
    ('calibration missing', 'calib-missing', of(sequence('calib.txt'), gone), (), True),
)  # fmt: skip
_TRACKING = (
    ('label with NaN', 'label-line', track_word(13, 'nan')),
    ('track twice in a frame', 'track-repeated', track_twice),
    ('track changes its class', 'track-class', track_word(2, 'Tram')),
    ('track jumps', 'track-jump', track_word(15, '300')),
    ('label without a frame', 'data-unusable', track_word(0, 'first')),
    ('line of an object file', 'label-columns', lambda root, n: edit_line(
        LABEL(root, n), track_lines(root, n)[0], lambda line: line.split(maxsplit=2)[2])),
    ('truncated of object files', 'label-level', track_word(3, '0.5')),
    ('labels of unknown occlusion', 'label-occlusion', unknown_occlusion, (), True),
    ('labels of no frame', 'label-frame', lambda root, n: add_line(
        LABEL(root, n), LABEL(root, n).read_text().splitlines()[0].replace('0', '900', 1))),
    ('packet of 29 numbers', 'oxts-packet', lambda root, n: edit_line(
        track_file('oxts')(root, n), n + 1, lambda line: line.split(' ', 1)[1])),
    ('GPS jumps', 'oxts-position', oxts_word(1, '8.6')),
    ('image of another size', 'image-size',
     of(numbered('training/image_02/0000', '.png'), write_blank, (30, 20))),
    ('scan missing', 'frames-missing', of(numbered('training/velodyne/0000', '.bin'), remove)),
    ('labels empty', 'file-empty', of(LABEL, empty), (), True),
    ('calibration missing', 'calib-missing', of(track_file('calib'), gone), (), True),
)  # fmt: skip

FAULTS = tuple(
    Fault(*row)._replace(layout=layout)
    for layout, rows in (
        (Layout.RAW, _RAW),
        (Layout.ODOMETRY, _ODOMETRY),
        (Layout.TRACKING, _TRACKING),
    )
    for row in rows
)
