# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A drive of KITTI-360 whose fisheyes see a wall of known brightness."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from kitti_ros2.kitti.kitti360_calib import format_kitti360_calibration
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.lenses import MeiLens
from kitti_ros2.model.samples import CameraCalibration

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (400, 400)
RADIUS_PX = 140
FRAMES = range(5)
LENSES = {
    2: MeiLens(2.2, np.array([0.017, 1.65, 0.0004, 0.0004])),
    3: MeiLens(2.6, np.array([0.049, 4.5, 0.0013, -0.0007])),
}
K = {
    2: np.array([[380.0, 0, 203, 0], [0, 379, 198, 0], [0, 0, 1, 0]]),
    3: np.array([[424.0, 0, 199, 0], [0, 424, 200, 0], [0, 0, 1, 0]]),
}
LEFT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""velo_link to the axes of camera 2; camera 3 looks the other way."""


def brightness(x, y):
    """Of a wall at depth 1: smooth, and other in each place."""
    return 128 + 50 * np.sin(2.5 * x + 0.5) + 50 * np.cos(2 * y)


def fisheye(index: int, turn: Transform) -> CameraCalibration:
    return CameraCalibration(K[index], size=SIZE, cam_T_velo=turn, lens=LENSES[index])


@lru_cache(maxsize=2)
def fisheye_image(index: int) -> np.ndarray:
    """(H, W, 3) the wall through a lens, as far as a view shows it; black around."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    offsets = np.stack([columns, rows], axis=-1) - K[index][:2, 2]
    seen = np.linalg.norm(offsets, axis=-1) < RADIUS_PX
    rays = LENSES[index].rays(offsets[seen] / np.diag(K[index][:2, :2]))
    image = np.zeros((*SIZE[::-1], 3), np.uint8)
    image[seen] = np.rint(brightness(*rays[:, :2].T / rays[:, 2]))[:, None]
    return image


def add_fisheyes(source: Path, root: Path) -> Path:
    """A copy of a drive with both fisheyes: their calibration, and images."""
    shutil.copytree(source, root)
    calibration = open_recording(source).calibration(0)
    turns = {2: LEFT, 3: np.diag([-1.0, 1, -1]) @ LEFT}
    cameras = {
        **calibration.cameras,
        **{index: fisheye(index, Transform(turn, np.zeros(3))) for index, turn in turns.items()},
    }
    texts = format_kitti360_calibration(replace(calibration, cameras=cameras))
    for name, text in texts.items():
        (root / 'calibration' / name).write_text(text)
    (drive,) = (root / 'data_2d_raw').iterdir()
    for index in turns:
        folder = drive / f'image_{index:02d}' / 'data_rgb'
        shutil.rmtree(folder.parent, ignore_errors=True)
        folder.mkdir(parents=True)
        shutil.copy(drive / 'image_00' / 'timestamps.txt', folder.parent)
        for number in FRAMES:
            assert cv2.imwrite(str(folder / f'{number:010d}.png'), fisheye_image(index))
    return root
