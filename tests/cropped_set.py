# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An object set whose frames have several sizes of images and calibrations, as KITTI's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kitti_ros2.files.image_files import decode_png, encode_png, parse_png

if TYPE_CHECKING:
    from pathlib import Path


def crop_frame(root: Path, number: int, left: int = 12, top: int = 4) -> None:
    """Crop the images of an object frame, with P, and move its scanner."""
    calib = root / f'training/calib/{number:06d}.txt'
    for camera in (2, 3):
        path = root / f'training/image_{camera}/{number:06d}.png'
        pixels = decode_png(parse_png(path.read_bytes(), path))
        path.write_bytes(encode_png(np.ascontiguousarray(pixels[top:, left:])))
    crop = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1.0]])
    lines = [changed(line, crop) for line in calib.read_text().splitlines()]
    calib.write_text('\n'.join(lines) + '\n')


def changed(line: str, crop: np.ndarray) -> str:
    """P of the cropped image; the scanner two centimetres higher."""
    key, _, words = line.partition(': ')
    if key not in {'P2', 'P3', 'Tr_velo_to_cam'}:
        return line
    matrix = np.array(words.split(), np.float64).reshape(3, 4)
    if key == 'Tr_velo_to_cam':
        matrix[:2, 3] += 0.01, 0.02
    else:
        matrix = crop @ matrix
    return f'{key}: {" ".join(f"{each:.12e}" for each in matrix.ravel())}'
