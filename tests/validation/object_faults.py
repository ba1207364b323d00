# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of object sets: each has a row."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from planting import (
    Fault,
    add_line,
    change_points,
    cut,
    drop_key,
    edit_line,
    empty,
    flip,
    make_folder,
    make_huge,
    make_loop,
    make_pipe,
    png_size,
    remove,
    set_key,
    set_points,
    write_blank,
    write_png,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CAR = 'Car 0.00 0 0.00 10.00 10.00 20.00 15.00 1.50 1.60 4.00 0.00 1.60 20.00 0.00'
"""A label that is valid alone; its 2D box is not that of its 3D box."""
_ALL = slice(None)


def scan(root: Path, n: int) -> Path:
    return root / f'training/velodyne/{n:06d}.bin'


def image(root: Path, n: int) -> Path:
    return root / f'training/image_2/{n:06d}.png'


def labels(root: Path, n: int) -> Path:
    return root / f'training/label_2/{n:06d}.txt'


def calib(root: Path, n: int) -> Path:
    return root / f'training/calib/{n:06d}.txt'


def splits(root: Path, name: str) -> Path:
    return root / f'ImageSets/{name}.txt'


def of(find: Callable[[Path, int], Path], damage: Callable[..., Path], *rest: object):
    """Plant a damage in the file of a frame."""
    return lambda root, n: damage(find(root, n), *rest)


def label(line: str):
    """Write a label file of one line."""

    def plant(root: Path, n: int) -> Path:
        labels(root, n).write_text(line + '\n')
        return labels(root, n)

    return plant


def word(index: int, value: str):
    """A label with another word."""
    words = CAR.split()
    words[index] = value
    return label(' '.join(words))


def scaled(factor: float):
    return lambda words: [f'{float(each) * factor:.12e}' for each in words]


def placed(index: int, value: str):
    def change(words: list[str]) -> list[str]:
        words[index] = value
        return words

    return change


def invert(words: list[str]) -> list[str]:
    matrix = np.array(words, np.float64).reshape(3, 4)
    rotation = matrix[:, :3].T
    inverse = np.column_stack([rotation, -rotation @ matrix[:, 3]])
    return [f'{each:.12e}' for each in inverse.ravel()]


def not_inflatable(root: Path, n: int) -> Path:
    return write_png(image(root, n), b'no zlib stream', png_size(image(root, n)))


def blank(root: Path, n: int) -> Path:
    return write_blank(image(root, n), png_size(image(root, n)))


def grey(root: Path, n: int) -> Path:
    return write_blank(image(root, n), png_size(image(root, n)), colour=0)


def jpeg(path: Path) -> Path:
    path.write_bytes(b'\xff\xd8\xff\xe0' + bytes(200))
    return path


def repeated(root: Path, n: int) -> Path:
    return label(f'{CAR}\n{CAR}')(root, n)


def stray(root: Path, n: int) -> Path:
    (root / f'training/velodyne/{n}.bin.part').touch()
    return root / 'training/velodyne'


def beyond(root: Path, n: int) -> Path:  # noqa: ARG001 - one form for all
    labels(root, 999).write_text(CAR + '\n')
    return labels(root, 999)


def unknown_occlusion(root: Path, n: int) -> Path:  # noqa: ARG001
    paths = sorted((root / 'training/label_2').iterdir())
    for path in paths:
        rows = [line.split() for line in path.read_text().splitlines()]
        path.write_text(''.join(f'{" ".join([*row[:2], "3", *row[3:]])}\n' for row in rows))
    return paths[0]


def overlap(root: Path, n: int) -> Path:  # noqa: ARG001
    add_line(splits(root, 'val'), splits(root, 'train').read_text().split()[0])
    return splits(root, 'train')


def listed(name: str, line: str):
    return lambda root, _: add_line(splits(root, name), line)


def listed_twice(root: Path, n: int) -> Path:  # noqa: ARG001
    path = splits(root, 'train')
    return add_line(path, path.read_text().split()[0])


def shifted(points: np.ndarray) -> np.ndarray:
    """Bytes that are read from the wrong place."""
    return np.frombuffer(points.tobytes()[1:] + b'\0', np.float32).reshape(-1, 4)


FAULTS = tuple(
    Fault(*row)
    for row in (
        ('scan of 0 bytes', 'file-empty', of(scan, empty)),
        ('scan cut inside a point', 'scan-size', of(scan, cut, -3)),
        ('scan with NaN', 'scan-finite', of(scan, set_points, slice(3, 4), 1, np.nan)),
        ('scan with infinity', 'scan-finite', of(scan, set_points, slice(5, 9), 3, np.inf)),
        ('scan shifted by a byte', 'scan-finite', of(scan, change_points, shifted)),
        ('scan of zeros', 'scan-constant', of(scan, set_points, _ALL, _ALL, 0)),
        ('scan in centimetres', 'scan-range', of(scan, set_points, slice(2, 5), 0, 4000)),
        ('reflectance 0 to 255', 'scan-reflectance', of(scan, set_points, slice(9), 3, 255)),
        ('scan of 10 GB', 'file-huge', of(scan, make_huge)),
        ('pipe named like a scan', 'file-readable', of(scan, make_pipe)),
        ('circular link', 'file-readable', of(scan, make_loop)),
        ('folder named like a scan', 'file-readable', of(scan, make_folder)),
        ('scan cut at a point', 'scan-points', of(scan, cut, 160)),
        ('scan missing', 'frames-missing', of(scan, remove)),
        ('image of 0 bytes', 'file-empty', of(image, empty)),
        ('image cut', 'image-file', of(image, cut, -40)),
        ('bit of an image flipped', 'image-file', of(image, flip, 60)),
        ('JPEG named .png', 'image-file', of(image, jpeg)),
        ('pixels damaged', 'image-pixels', not_inflatable, ('decode',)),
        ('black image', 'image-blank', blank, ('decode',)),
        ('grey image of a colour camera', 'image-channels', grey),
        ('image missing', 'frames-missing', of(image, remove)),
        ('file of another name', 'names-unusual', stray),
        ('label with NaN', 'label-line', word(11, 'nan')),
        ('label with inf', 'label-line', word(13, 'inf')),
        ('label with a word too few', 'label-line', label(CAR.rsplit(' ', 1)[0])),
        ('label at 1e300', 'label-location', word(13, '1e300')),
        ('label file not in UTF-8', 'text-file', of(labels, jpeg)),
        ('occluded 7', 'label-level', word(2, '7')),
        ('truncated 3.5', 'label-level', word(1, '3.5')),
        ('labels of unknown occlusion', 'label-occlusion', unknown_occlusion, (), True),
        ('degrees', 'label-angle', word(14, '90')),
        ('2D box reversed', 'label-box', word(6, '5')),
        ('negative width', 'label-size', word(9, '-1.6')),
        ('class in lower case', 'label-class', word(0, 'car')),
        ('object listed twice', 'label-repeated', repeated),
        ('line of a tracking file', 'label-columns', label(f'0 1 {CAR}')),
        ('3D box elsewhere', 'label-projection', label(CAR)),
        ('alpha of another object', 'label-alpha', word(3, '1.5')),
        ('2D box outside', 'label-outside', word(6, '5000')),
        ('box above the street', 'label-points', word(12, '-20')),
        ('label of a frame that is not there', 'label-frame', beyond),
        ('text in a calibration', 'calib-value', of(calib, set_key, 'P2', placed(0, 'seven'))),
        ('NaN in a calibration', 'calib-value', of(calib, set_key, 'P2', placed(3, 'nan'))),
        ('rotation scaled', 'calib-value', of(calib, set_key, 'R0_rect', scaled(1.1))),
        ('rotation rounded', 'calib-rotation', of(calib, set_key, 'R0_rect', scaled(1.0001))),
        ('P of another order', 'calib-projection', of(calib, set_key, 'P3', placed(8, '5'))),
        ('fx unlike fy', 'calib-projection', of(calib, set_key, 'P3', placed(0, '2000'))),
        ('right camera on the left', 'calib-baseline', of(calib, set_key, 'P3', placed(3, '400'))),
        ('inverse extrinsics', 'calib-scanner', of(calib, set_key, 'Tr_velo_to_cam', invert)),
        ('calibration of larger images', 'calib-image',
         of(calib, set_key, 'P2', placed(2, '2000'))),
        ('calibration with a placeholder', 'calib-placeholder',
         of(calib, set_key, 'P0', lambda _: ['0'] * 12)),
        ('calibration without P2', 'calib-missing', of(calib, drop_key, 'P2')),
        ('placeholder of a camera with images', 'calib-missing',
         of(calib, set_key, 'P2', lambda _: [])),
        ('calibration missing', 'frames-missing', of(calib, remove)),
        ('calibration empty', 'file-empty', of(calib, empty)),
        ('calibration not in UTF-8', 'text-file', of(calib, jpeg)),
        ('line without a key', 'calib-value', of(calib, edit_line, 1, lambda line: line[4:])),
        ('word in a list', 'split-line', listed('train', 'abc')),
        ('frame of a list missing', 'split-frame', listed('trainval', '777777')),
        ('frame listed twice', 'split-repeated', listed_twice),
        ('train and val overlap', 'split-overlap', overlap),
        ('trainval is another set', 'split-whole', listed('trainval', '888888')),
    )
)  # fmt: skip
