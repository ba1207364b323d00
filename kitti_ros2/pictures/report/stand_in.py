# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plain drawings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ...labels import rect_from_velo

if TYPE_CHECKING:
    from ..frame import Frame, Pixels


def draw(mode: str, frame: Frame, camera: int | None) -> Pixels:
    """A picture of a frame."""
    if mode == 'bev':
        return _bev(frame)
    pixels = frame.images[camera or 0].copy()
    if mode == 'lidar':
        _lidar(pixels, frame, camera or 0)
    return pixels


def _bev(frame: Frame) -> Pixels:
    pixels = np.zeros((700, 700, 3), np.uint8)
    if frame.points is not None:
        cols = (350 - frame.points[:, 1] * 7).astype(int)
        rows = (700 - frame.points[:, 0] * 7).astype(int)
        inside = (cols >= 0) & (cols < 700) & (rows >= 0) & (rows < 700)
        pixels[rows[inside], cols[inside]] = 220
    return pixels


def _lidar(pixels: Pixels, frame: Frame, camera: int) -> None:
    calibration = frame.calibration
    if calibration is None or frame.points is None:
        return
    place = rect_from_velo(calibration)
    seen = place.apply(frame.points[:, :3]) @ calibration.cameras[camera].p_rect[:, :3].T
    seen += calibration.cameras[camera].p_rect[:, 3]
    seen = seen[seen[:, 2] > 1]
    uv = (seen[:, :2] / seen[:, 2:]).astype(int)
    inside = (uv >= 0).all(1) & (uv < [pixels.shape[1], pixels.shape[0]]).all(1)
    depth = np.clip(seen[inside, 2] * 4, 0, 255).astype(np.uint8)[:, None]
    colours = cv2.applyColorMap(depth, cv2.COLORMAP_TURBO)[:, 0]
    for (u, v), colour in zip(uv[inside].tolist(), colours.tolist(), strict=True):
        cv2.circle(pixels, (u, v), 1, colour, -1)
