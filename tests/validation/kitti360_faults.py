# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of a drive of KITTI-360: each has a row."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
from planting import (
    Fault,
    add_line,
    change_points,
    cut,
    edit_line,
    empty,
    flip,
    make_folder,
    make_huge,
    make_loop,
    make_pipe,
    remove,
    set_key,
    set_points,
    set_word,
    write_blank,
)
from sick_scans import SICK, add_sick, sick_file
from sick_scans import TO_VELO as SICK_TO_VELO

from kitti_ros2.kitti.scan_grid import on_grid
from kitti_ros2.kitti.text_file import format_timestamps, parse_timestamps
from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from pathlib import Path

MS = 1_000_000
D = '2013_05_28_drive_0000_sync'
VELODYNE = f'data_3d_raw/{D}/velodyne_points'
LEFT, RIGHT = (f'data_2d_raw/{D}/image_0{camera}' for camera in (0, 1))
POSES, CAMERAS = (f'data_poses/{D}/{name}' for name in ('poses.txt', 'cam0_to_world.txt'))
PERSPECTIVE, TO_POSE, TO_VELO = (
    f'calibration/{name}.txt' for name in ('perspective', 'calib_cam_to_pose', 'calib_cam_to_velo')
)
_T = 'timestamps.txt'
_ALL = slice(None)


def scan(root: Path, n: int) -> Path:
    return root / VELODYNE / f'data/{n:010d}.bin'


def image(root: Path, n: int, folder: str = RIGHT) -> Path:
    return root / folder / f'data_rect/{n:010d}.png'


def of(find, damage, *rest: object):
    return lambda root, n: damage(find(root, n), *rest)


def whole(name: str, damage, *rest: object):
    return lambda root, _: damage(root / name, *rest)


def line_of(name: str, text: str):
    return lambda root, n: edit_line(root / name, n + 1, lambda _: text)


def moved(folder: str, by_ns: int, *, all_later: bool = False):
    def plant(root: Path, n: int) -> Path:
        path = root / folder / _T
        stamps = parse_timestamps(path.read_text(), path).values
        for index in range(n, len(stamps) if all_later else n + 1):
            stamps[index] += by_ns
        path.write_text(format_timestamps(stamps))
        return path

    return plant


def repeated(root: Path, n: int) -> Path:
    path = root / RIGHT / _T
    line = path.read_text().splitlines()[n - 1]
    return edit_line(path, n + 1, lambda _: line)


def no_stamps(root: Path, _: int) -> Path:
    for path in root.glob(f'*/{D}/*/{_T}'):
        path.unlink()
    return root


def gone(path: Path) -> Path:
    path.unlink()
    return path


def folder_gone(path: Path) -> Path:
    shutil.rmtree(path)
    return path


def first_word(value: str):
    return lambda words: [value, *words[1:]]


def scaled(root: Path, n: int) -> Path:
    words = (root / POSES).read_text().splitlines()[n - 1].split()
    return set_word(root / POSES, n, 1, f'{float(words[1]) * 1.2:.6f}')


def on_its_side(root: Path, n: int) -> Path:
    rows = np.array((root / POSES).read_text().splitlines()[n - 1].split()[1:], float).reshape(3, 4)
    rows[:, :3] = rows[:, :3] @ [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    words = ' '.join(f'{value:.10f}' for value in rows.ravel())
    return edit_line(root / POSES, n, lambda _: f'{n} {words}')


def shifted_by_a_frame(root: Path, _: int) -> Path:
    """The poses by position instead of their number."""
    path = root / POSES
    rows = [line.split(' ', 1)[1] for line in path.read_text().splitlines()]
    path.write_text(''.join(f'{n} {row}\n' for n, row in enumerate(rows)))
    return root / CAMERAS


def z_up(root: Path, n: int) -> Path:
    """A pose of imu_link, as other programs write them."""
    words = (root / POSES).read_text().splitlines()[n - 1].split()
    turned = [negative(word) if i % 4 in (2, 3) else word for i, word in enumerate(words)]
    return edit_line(root / POSES, n, lambda _: ' '.join([words[0], *turned[1:]]))


def negative(word: str) -> str:
    return f'{-float(word):.10g}'


def turned_over(line: str) -> str:
    """A mount in a frame of y left and z up."""
    key, *words = line.split()
    return ' '.join([key, *words[:4], *map(negative, words[4:])])


def reversed_poses(root: Path, _: int) -> Path:
    path = root / POSES
    path.write_text(''.join(path.read_text().splitlines(keepends=True)[::-1]))
    return path


def renamed(path: Path, name: str) -> Path:
    return path.rename(path.with_name(name))


def write_pairs(path: Path, pairs) -> Path:
    path.write_bytes(np.array(pairs, '<f4').tobytes())
    return path


def of_sick(damage, *rest: object):
    """Add scans of the SICK, and damage one of them, whose number is that of no frame."""

    def plant(root: Path, n: int) -> Path:
        if not (root / SICK).is_dir():
            add_sick(root)
        return damage(sick_file(root, 50 + n), *rest)

    return plant


def with_sick(name: str, damage, *rest: object):
    def plant(root: Path, _: int) -> Path:
        add_sick(root)
        return damage(root / name, *rest)

    return plant


TO_THE_RIGHT = 'image_02: 1 0 0 0.7 0 0 1 0.1 0 -1 0 -1.1'
"""x forward, y up, z to the right, in a frame of x forward, y right, z down."""


def fisheye(root: Path, *changes: str) -> Path:
    """Give a fisheye other values of some keys."""
    path = root / 'calibration/image_02.yaml'
    text = path.read_text()
    for line in ''.join(changes).splitlines():
        key = line.partition(':')[0]
        text = ''.join(
            f'{line}\n' if each.startswith(f'{key}:') else each
            for each in text.splitlines(keepends=True)
        )
    path.write_text(text)
    return path


def put_on_grid(points):
    """What KITTI's other scans have."""
    points[:, :3] = on_grid(points[:, :3])
    points[:, 3] = np.rint(points[:, 3] * 100) / 100
    return points


_ROWS = (
    ('scan of 0 bytes', 'file-empty', of(scan, empty)),
    ('scan cut inside a point', 'scan-size', of(scan, cut, -3)),
    ('scan with NaN', 'scan-finite', of(scan, set_points, slice(3, 4), 1, np.nan)),
    ('scan of zeros', 'scan-constant', of(scan, set_points, _ALL, _ALL, 0)),
    ('scan in centimetres', 'scan-range', of(scan, set_points, slice(2, 5), 0, 4000)),
    ('reflectance 0 to 255', 'scan-reflectance', of(scan, set_points, slice(9), 3, 255)),
    ('scan of a raw drive', 'scan-grid', of(scan, change_points, put_on_grid)),
    ('scan of 10 GB', 'file-huge', of(scan, make_huge)),
    ('pipe named like a scan', 'file-readable', of(scan, make_pipe)),
    ('folder named like a scan', 'file-readable', of(scan, make_folder)),
    ('scan cut at a point', 'scan-points', of(scan, cut, 160)),
    ('scan missing', 'frames-missing', of(scan, remove)),
    ('scan of another name', 'names-unusual',
     lambda root, n: scan(root, n).rename(scan(root, n).with_name('scan.bin')).parent),
    ('no scans', 'stream-missing', whole(f'{VELODYNE}/data', folder_gone), (), True),
    ('image of 0 bytes', 'file-empty', of(image, empty)),
    ('image cut', 'image-file', of(image, cut, -40)),
    ('bit of an image flipped', 'image-file', of(image, flip, 60)),
    ('circular link', 'file-readable', of(image, make_loop)),
    ('image of another size', 'image-size', of(image, write_blank, (30, 20), 0)),
    ('image missing', 'frames-missing', of(image, remove)),
    ('camera missing', 'stream-missing', whole(RIGHT, folder_gone), (), True),
    ('stamp is text', 'stamps-line', line_of(f'{LEFT}/{_T}', 'yesterday')),
    ('stamp before the one above', 'stamps-order', moved(RIGHT, -300 * MS)),
    ('stamp twice', 'stamps-repeated', repeated),
    ('gap', 'stamps-gap', moved(LEFT, 1400 * MS, all_later=True), (), True),
    ('clock not set', 'stamps-date', line_of(f'{LEFT}/{_T}', '1980-01-06 00:00:01.000000000')),
    ('camera late', 'stamps-pair', moved(LEFT, 80 * MS)),
    ('stamps cut', 'data-unusable', whole(f'{LEFT}/{_T}', cut, 90), (), True),
    ('stamps not in UTF-8', 'text-file', whole(f'{LEFT}/{_T}', flip, 3), (), True),
    ('stamps empty', 'file-empty', whole(f'{RIGHT}/{_T}', empty), (), True),
    ('no stamps at all', 'stamps-missing', no_stamps, (), True),
    ('pose of 11 numbers', 'pose-line', lambda root, n: edit_line(
        root / POSES, n, lambda line: line.rsplit(' ', 1)[0])),
    ('pose without a frame', 'pose-line', lambda root, n: set_word(
        root / POSES, n, 0, 'x')),
    ('pose of a frame twice', 'pose-line', lambda root, n: add_line(
        root / POSES, (root / POSES).read_text().splitlines()[n - 1])),
    ('pose with NaN', 'pose-line', lambda root, n: set_word(root / POSES, n, 4, 'nan')),
    ('pose that is no rotation', 'pose-rotation', scaled),
    ('vehicle on its side', 'pose-tilt', on_its_side),
    ('pose far away', 'pose-jump', lambda root, n: set_word(root / POSES, n, 12, '500')),
    ('poses by position', 'texts-contradict', shifted_by_a_frame, (), True),
    ('camera pose moved', 'texts-contradict', lambda root, n: set_word(
        root / CAMERAS, n, 4, '12.5')),
    ('camera pose cut', 'texts-contradict', lambda root, n: edit_line(
        root / CAMERAS, n, lambda line: line.strip().rsplit(' ', 1)[0])),
    ('poses of other frames', 'data-unusable', lambda root, n: set_word(
        root / POSES, n, 0, '900').with_name('poses.txt') and root / VELODYNE / _T),
    ('no poses', 'stream-missing', lambda root, _: folder_gone(
        (root / POSES).parent) / 'poses.txt', (), True),
    ('calibration missing', 'calib-missing', whole(TO_VELO, gone), (), True),
    ('mount of camera 0 missing', 'calib-missing', whole(
        TO_POSE, edit_line, 1, lambda line: line.replace('image_00', 'image_07')), (), True),
    ('cam_to_velo of 11 numbers', 'calib-value', whole(
        TO_VELO, edit_line, 1, lambda line: line.rsplit(' ', 1)[0]), (), True),
    ('P_rect is text', 'calib-value', whole(PERSPECTIVE, set_key, 'P_rect_01', first_word('x'))),
    ('cam_to_velo inverted', 'calib-scanner', whole(
        TO_VELO, edit_line, 1, lambda _: '0 -1 0 0 0 0 -1 0 1 0 0 0'), (), True),
    ('P_rect of another calibration', 'calib-contradiction', whole(
        PERSPECTIVE, set_key, 'T_01', first_word('-1')), (), True),
    ('K that ends in 7', 'calib-projection', whole(
        PERSPECTIVE, set_key, 'K_00', lambda words: [*words[:-1], '7']), (), True),
    ('GPS/IMU with z up', 'calib-mounts', whole(
        TO_POSE, edit_line, 1, turned_over), (), True),
    ('fisheyes exchanged', 'calib-mounts', whole(
        TO_POSE, edit_line, 3, lambda _: TO_THE_RIGHT), (), True),
    ('fisheye of another camera', 'calib-value', lambda root, _: fisheye(
        root, 'camera_name: image_03'), (), True),
    ('fisheye of no pixels', 'calib-value', lambda root, _: fisheye(
        root, 'image_width: 0'), (), True),
    ('fisheye of another model', 'calib-value', lambda root, _: fisheye(
        root, 'model_type: EUCM'), (), True),
    ('fisheye of an image half as large', 'calib-fisheye', lambda root, _: fisheye(
        root, '   gamma1: 300\n   gamma2: 300'), (), True),
    ('distortion of another model', 'calib-fisheye', lambda root, _: fisheye(
        root, '   k1: -50'), (), True),
    ('poses of the camera as those of the GPS/IMU', 'pose-line', lambda root, n: edit_line(
        root / POSES, n, lambda line: f'{line} 0 0 0 1')),
    ('poses with z up', 'pose-tilt', z_up),
    ('poses in another order', 'pose-order', reversed_poses, (), True),
    ('pose far away after a hole', 'pose-jump', lambda root, n: set_word(
        edit_line(root / POSES, n - 1, lambda _: '') and root / POSES, n, 12, '500'), (), True),
    ('folder of poses without _sync', 'data-unusable', whole(
        f'data_poses/{D}', renamed, D.removesuffix('_sync')), (), True),
    ('line scan of 0 bytes', 'file-empty', of_sick(empty)),
    ('line scan cut inside a point', 'scan-size', of_sick(cut, -3)),
    ('line scan with infinity', 'scan-finite', of_sick(lambda path: write_pairs(
        path, [[1, 2], [np.inf, 3]]))),
    ('line scan of zeros', 'scan-constant', of_sick(lambda path: write_pairs(
        path, np.zeros((9, 2))))),
    ('line scan in millimetres', 'scan-range', of_sick(lambda path: write_pairs(
        path, [[1000, 2000], [3000, 4000]]))),
    ('pipe named like a line scan', 'file-readable', of_sick(make_pipe)),
    ('line scan of 10 GB', 'file-huge', of_sick(make_huge)),
    ('line scan missing', 'frames-missing', of_sick(remove)),
    ('line scan beyond the stamps', 'data-unusable', of_sick(lambda path: renamed(
        path, '0000000900.bin') and path.parents[1] / _T), (), True),
    ('line scan of another name', 'names-unusual', of_sick(lambda path: renamed(
        path, 'scan.bin').parent)),
    ('stamp of a line scan before the one above', 'stamps-order', with_sick(
        f'{SICK}/{_T}', edit_line, 40, lambda _: '2011-09-26 12:00:00.000000000'), (), True),
    ('line scans without stamps', 'data-unusable', with_sick(
        f'{SICK}/{_T}', gone), (), True),
    ('mount of the line scanner missing', 'calib-missing', with_sick(
        SICK_TO_VELO, gone), (), True),
    ('sick_to_velo of 11 numbers', 'calib-value', with_sick(
        SICK_TO_VELO, edit_line, 1, lambda line: line.rsplit(' ', 1)[0]), (), True),
    ('images in the folder of fisheyes', 'data-unusable', whole(
        f'{RIGHT}/data_rect', renamed, 'data_rgb'), (), True),
)  # fmt: skip

FAULTS = tuple(Fault(*row)._replace(layout=Layout.KITTI_360) for row in _ROWS)
