#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the README's picture: the synthetic street as its bag has it, the scan over the image.

    python docs/make_picture.py docs/street.jpg

Above, the colour image with the scan's points through /tf_static and camera_info, coloured by
distance; below, the same scan from above.
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

from kitti_ros2.geometry import Transform
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions

FRAME = 12
FARTHEST_M = 60.0
PIXELS_PER_METRE = 12.0


def distance_colours(points: np.ndarray) -> np.ndarray:
    """(N, 3) BGR, near is red."""
    near = 1.0 - np.clip(np.linalg.norm(points[:, :3], axis=1) / FARTHEST_M, 0.0, 1.0)
    shades = (near * 255).astype(np.uint8).reshape(-1, 1)
    return cv2.applyColorMap(shades, cv2.COLORMAP_TURBO).reshape(-1, 3)


def over_the_image(drive: SyntheticDrive, points: np.ndarray) -> np.ndarray:
    """The colour image with every second point on it, the nearest on top."""
    calibration = drive.calibration
    rect_t_velo = Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo
    picture = drive.picture(FRAME, 2).copy()
    seen = np.column_stack([rect_t_velo.apply(points[:, :3]), np.ones(len(points))])
    pixels = seen @ calibration.cameras[2].p_rect.T
    order = np.argsort(-pixels[:, 2])[::2]
    colours = distance_colours(points)
    height, width = picture.shape[:2]
    for (u, v, depth), colour in zip(pixels[order], colours[order], strict=True):
        if depth > 1 and 0 <= u / depth < width and 0 <= v / depth < height:
            centre = (round(u / depth), round(v / depth))
            cv2.circle(picture, centre, 1, colour.tolist(), -1, cv2.LINE_AA)
    return picture


def from_above(points: np.ndarray, width: int, height: int) -> np.ndarray:
    """The scan from above, x to the right."""
    view = np.full((height, width, 3), 18, np.uint8)
    column = (points[:, 0] * PIXELS_PER_METRE + width * 0.35).astype(int)
    row = (height / 2 - points[:, 1] * PIXELS_PER_METRE).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    view[row[inside], column[inside]] = distance_colours(points)[inside]
    return view


def main() -> None:
    """Write the picture to the path given."""
    drive = SyntheticDrive(SyntheticOptions(frames=FRAME + 1))
    points = drive.scan(FRAME).points
    image = over_the_image(drive, points)
    view = from_above(points, image.shape[1], image.shape[0])
    cv2.imwrite(sys.argv[1], np.vstack([image, view]), [cv2.IMWRITE_JPEG_QUALITY, 82])


if __name__ == '__main__':
    main()
