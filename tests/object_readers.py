# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What programs that train on KITTI's object layout demand of a set, with the sources.

open-mmlab/mmdetection3d v1.4.0, tools/dataset_converters, as create_data.py kitti runs it;
open-mmlab/OpenPCDet 06751cb, pcdet/datasets/kitti/kitti_dataset.py, as create_kitti_infos runs it,
with pcdet/utils/calibration_kitti.py at fea61d3, and object3d_kitti.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from breaches import Breaches, read_points

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

_MM = 'mmdetection3d v1.4.0 tools/dataset_converters/'
_MM_UTILS = f'{_MM}kitti_data_utils.py'
_MM_CONVERTER = f'{_MM}kitti_converter.py'
_MM_V2 = f'{_MM}update_infos_to_v2.py'
_MM_BOXES = 'mmdetection3d v1.4.0 mmdet3d/structures/ops/box_np_ops.py'
_PCDET = 'OpenPCDet 06751cb pcdet/datasets/kitti/kitti_dataset.py'
_PCDET_CALIB = 'OpenPCDet fea61d3 pcdet/utils/calibration_kitti.py'
_PCDET_LABEL = 'OpenPCDet pcdet/utils/object3d_kitti.py'

AXES_DEGREES = 5.0
"""KITTI's own calibrations are within 1."""


def check_mmdet3d(root: Path, *, whole: bool = False, axes_degrees: float = AXES_DEGREES):
    """Check an object set as create_kitti_info_file and the ground truth database read it.

    Args:
        root: The folder of ImageSets and training.
        whole: Also what the rest of create_data.py kitti needs: no part of the set is empty.
        axes_degrees: How far the scan's axes may be turned from the camera's.
    """
    breaches = Breaches()
    for name in ('train', 'val', 'test'):
        path = root / 'ImageSets' / f'{name}.txt'
        source = f'{_MM_CONVERTER}:43-46'
        lines = breaches.attempt(path.read_text, path, 'cannot be read', source)
        if lines is None:
            continue
        parse = [lambda line=line: int(line) for line in lines.splitlines()]
        numbers = [breaches.attempt(each, path, 'no number', source) for each in parse]
        if whole:
            breaches.demand(numbers, path, 'an empty part stops create_data.py', f'{_MM_V2}:517')
        split = root / ('testing' if name == 'test' else 'training')
        for number in (number for number in numbers if number is not None):
            _check_mmdet3d_frame(breaches, split, f'{number:06d}', axes_degrees)
    return breaches.lines


def _check_mmdet3d_frame(breaches: Breaches, split: Path, name: str, axes_degrees: float) -> None:
    is_labelled = split.name == 'training'
    files = {'velodyne': 'bin', 'image_2': 'png', 'calib': 'txt'} | (
        {'label_2': 'txt'} if is_labelled else {}
    )
    paths = {folder: split / folder / f'{name}.{suffix}' for folder, suffix in files.items()}
    source = f'{_MM_UTILS}:36-37'
    found = [breaches.demand(p.exists(), p, 'is absent', source) for p in paths.values()]
    if not all(found):
        return
    path = paths['calib']
    lines = path.read_text().splitlines(keepends=True)
    rows = ((0, 13), (1, 13), (2, 13), (3, 13), (4, 10), (5, 13), (6, 13))
    read = [
        breaches.attempt(
            lambda row=row, end=end: np.array(
                [float(word) for word in lines[row].split(' ')[1:end]]
            ).reshape(3, -1),
            path,
            f'line {row + 1}',
            f'{_MM_UTILS}:239-267',
        )
        for row, end in rows
    ]
    if any(matrix is None for matrix in read):
        return
    p2, rect, tr = read[2], read[4], read[5]
    if not _check_matrices(breaches, path, read[:4], rect, tr, f'{_MM_BOXES}:544-550'):
        return
    source = f'{_MM_BOXES}:66 (yaw = -rotation_y - pi/2)'
    _check_axes(breaches, path, rect @ tr[:, :3], axes_degrees, source)
    points = read_points(breaches, paths['velodyne'], f'{_MM_CONVERTER}:131-132')
    shape = _image_shape(breaches, paths['image_2'], f'{_MM_UTILS}:225-226')
    if points is not None and shape is not None:
        _check_view(breaches, split.parent, name, points, (p2, rect, tr), shape)
    if is_labelled:
        _check_mmdet3d_labels(breaches, paths['label_2'])


def _check_mmdet3d_labels(breaches: Breaches, path: Path) -> None:
    rows = [line.strip().split(' ') for line in path.read_text().splitlines(keepends=True)]
    for place, row in enumerate(rows, 1):
        where = f'{path}:{place}'
        source = f'{_MM_UTILS}:134-155'
        if not breaches.demand(len(row) in (15, 16), where, f'{len(row)} columns', source):
            continue
        counts = len(row) == len(rows[0])
        breaches.demand(counts, where, 'a column more or less than in the first line', source)
        breaches.attempt(lambda row=row: int(row[2]), where, 'occluded', f'{_MM_UTILS}:139')
        breaches.attempt(
            lambda row=row: [float(word) for word in row[1:]], where, 'a number', source
        )
    names = [row[0] for row in rows]
    _check_dont_care_last(breaches, path, names, f'{_MM_CONVERTER}:141-147')


def check_openpcdet(root: Path, *, axes_degrees: float = AXES_DEGREES) -> list[str]:
    """Check an object set as create_kitti_infos reads it, and the ground truth database.

    Args:
        root: The folder of ImageSets and training.
        axes_degrees: How far the scan's axes may be turned from the camera's.
    """
    breaches = Breaches()
    for name in ('train', 'val', 'test'):
        path = root / 'ImageSets' / f'{name}.txt'
        if not breaches.demand(path.exists(), path, 'is absent', f'{_PCDET}:28-29,61-62'):
            continue
        split = root / ('testing' if name == 'test' else 'training')
        for number in (line.strip() for line in path.read_text().splitlines()):
            _check_openpcdet_frame(breaches, split, number, axes_degrees)
    return breaches.lines


def _check_openpcdet_frame(breaches: Breaches, split: Path, name: str, axes_degrees: float):
    is_labelled = split.name == 'training'
    files = {
        'velodyne': ('bin', 66),
        'image_2': ('png', 71),
        'calib': ('txt', 81),
        'label_2': ('txt', 76),
    }
    if not is_labelled:
        del files['label_2'], files['velodyne']
    paths = {folder: split / folder / f'{name}.{suffix}' for folder, (suffix, _) in files.items()}
    found = [
        breaches.demand(path.exists(), path, 'is absent', f'{_PCDET}:{files[folder][1]}')
        for folder, path in paths.items()
    ]
    if not all(found):
        return
    path = paths['calib']
    lines = path.read_text().splitlines(keepends=True)
    read = [
        breaches.attempt(
            lambda row=row, columns=columns: np.array(
                lines[row].strip().split(' ')[1:], dtype=np.float32
            ).reshape(3, columns),
            path,
            f'line {row + 1}',
            f'{_PCDET_CALIB}:8-20',
        )
        for row, columns in ((2, 4), (3, 4), (4, 3), (5, 4))
    ]
    if any(matrix is None for matrix in read):
        return
    p2, _, rect, tr = read
    if not _check_matrices(breaches, path, read[:2], rect, tr, f'{_PCDET_CALIB}:32-37'):
        return
    _check_axes(breaches, path, rect @ tr[:, :3], axes_degrees, f'{_PCDET}:167-168')
    shape = _image_shape(breaches, paths['image_2'], f'{_PCDET}:72')
    if not is_labelled:
        return
    points = read_points(breaches, paths['velodyne'], f'{_PCDET}:67')
    if points is not None and shape is not None:
        _check_view(breaches, split.parent, name, points, (p2, rect, tr), shape)
    path = paths['label_2']
    rows = [line.strip().split(' ') for line in path.read_text().splitlines(keepends=True)]
    empty = 'no object: np.concatenate of nothing raises'
    breaches.demand(rows, path, empty, f'{_PCDET}:150')
    for place, row in enumerate(rows, 1):
        breaches.attempt(
            lambda row=row: [float(row[column]) for column in range(1, 15)],
            f'{path}:{place}',
            'columns 2 to 15',
            f'{_PCDET_LABEL} Object3d.__init__',
        )
    _check_dont_care_last(breaches, path, [row[0] for row in rows], f'{_PCDET}:157-164')


def _check_matrices(
    breaches: Breaches,
    path: Path,
    projections: Iterable[np.ndarray],
    rect: np.ndarray,
    tr: np.ndarray,
    source: str,
) -> bool:
    """Whether the cameras can be inverted, and the rotations are rotations."""
    kept = [
        breaches.demand(
            np.isfinite(p).all() and abs(np.linalg.det(p[:, :3].astype(float))) > 1,
            path,
            f'a projection has no inverse: {p.tolist()}',
            source,
        )
        for p in projections
    ]
    for name, rotation in (('R0_rect', rect), ('Tr_velo_to_cam', tr[:, :3])):
        apart = np.abs(rotation @ rotation.T - np.eye(3)).max()
        is_rotation = apart < 1e-4 and np.linalg.det(rotation) > 0
        kept.append(breaches.demand(is_rotation, path, f'{name} is no rotation', source))
    return all(kept)


def axes_of(rect_r_velo: np.ndarray) -> tuple[float, float]:
    """Return how far a scan is turned about the up axis, and tilted, from the camera; degrees."""
    forward, up = rect_r_velo[:, 0], rect_r_velo[:, 2]
    turn = np.degrees(np.arctan2(forward[0], forward[2]))
    return float(turn), float(np.degrees(np.arccos(np.clip(-up[1], -1, 1))))


def _check_axes(breaches: Breaches, path: Path, rotation: np.ndarray, limit: float, source: str):
    """Check that boxes moved into the scan's frame by their yaw alone stay where they are."""
    turn, tilt = axes_of(rotation)
    text = (
        f'boxes in the scan are turned by {turn:.1f} and tilted by {tilt:.1f} degrees:'
        f' they are moved there as if x of the scan were the optical axis, and z up'
    )
    breaches.demand(abs(turn) <= limit and tilt <= 2 * limit, path, text, source)


def _check_dont_care_last(breaches: Breaches, path: Path, names: list[str], source: str) -> None:
    boxes = len([name for name in names if name != 'DontCare'])
    text = 'DontCare stands before an object: the first N rows are taken for the objects'
    breaches.demand('DontCare' not in names[:boxes], path, text, source)


def _image_shape(breaches: Breaches, path: Path, source: str) -> tuple[int, int] | None:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if not breaches.demand(image is not None, path, 'is no image', source):
        return None
    return image.shape[:2]


def _check_view(
    breaches: Breaches,
    root: Path,
    name: str,
    points: np.ndarray,
    matrices: tuple[np.ndarray, ...],
    shape: tuple[int, int],
) -> None:
    """Check that the camera sees points: training scans are cut to its view."""
    seen = int(in_view(points, matrices, shape).sum())
    source = f'{_PCDET}:114-118; {_MM_BOXES}:573-581'
    breaches.demand(seen or not len(points), f'{root}, frame {name}', 'no point in view', source)


def in_view(points: np.ndarray, matrices: tuple[np.ndarray, ...], shape: tuple[int, int]):
    """Return (N,) which points of a scan the camera sees, as OpenPCDet's get_fov_flag.

    Args:
        points: (N, 4) of the scan.
        matrices: P2 (3, 4), R0_rect (3, 3) and Tr_velo_to_cam (3, 4).
        shape: Height and width of the image.
    """
    p2, rect, tr = matrices
    places = (points[:, :3] @ tr[:, :3].T + tr[:, 3]) @ rect.T
    image = places @ p2[:, :3].T + p2[:, 3]
    with np.errstate(divide='ignore', invalid='ignore'):
        u, v = image[:, 0] / places[:, 2], image[:, 1] / places[:, 2]
    inside = (u >= 0) & (u < shape[1]) & (v >= 0) & (v < shape[0])
    return inside & (image[:, 2] - p2[2, 3] >= 0)


def points_in_labels(root: Path, split: str = 'training') -> dict[str, list[int]]:
    """Count the points in each box of an object set as num_points_in_gt does; -1 of DontCare.

    The boxes are moved into the scan's frame as OpenPCDet and mmdet3d do it; only points in view
    of the camera count (OpenPCDet kitti_dataset.py:162-187).

    Returns:
        By frame name, a count for each line of its label file.
    """
    counts = {}
    for path in sorted((root / split / 'label_2').glob('*.txt')):
        lines = (root / split / 'calib' / path.name).read_text().splitlines()
        p2, rect, tr = (
            np.array(lines[row].split()[1:], dtype=float).reshape(3, -1) for row in (2, 4, 5)
        )
        points = np.fromfile(root / split / 'velodyne' / f'{path.stem}.bin', np.float32)
        points = points.reshape(-1, 4)
        image = cv2.imread(str(root / split / 'image_2' / f'{path.stem}.png'), -1)
        places = points[in_view(points, (p2, rect, tr), image.shape[:2])][:, :3]
        rows = [line.split(' ') for line in path.read_text().splitlines()]
        counts[path.stem] = [
            -1 if row[0] == 'DontCare' else _points_in_box(places, row, rect, tr) for row in rows
        ]
    return counts


def _points_in_box(places: np.ndarray, row: list[str], rect: np.ndarray, tr: np.ndarray) -> int:
    height, width, length, x, y, z, turn = map(float, row[8:15])
    velo_place = tr[:, :3].T @ (rect.T @ [x, y, z] - tr[:, 3])
    yaw = -(np.pi / 2 + turn)
    from_box = places - velo_place - [0, 0, height / 2]
    along = from_box[:, 0] * np.cos(yaw) + from_box[:, 1] * np.sin(yaw)
    across = -from_box[:, 0] * np.sin(yaw) + from_box[:, 1] * np.cos(yaw)
    inside = (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2)
    return int((inside & (np.abs(from_box[:, 2]) <= height / 2)).sum())
