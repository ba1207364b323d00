# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label images for a drive of KITTI-360, as its documentation has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

D = '2013_05_28_drive_0000_sync'
LABELS = f'data_2d_semantics/train/{D}'
KINDS = ('semantic', 'semantic_rgb', 'instance', 'confidence')


def label_file(root: Path, camera: int, kind: str, number: int) -> Path:
    return root / LABELS / f'image_0{camera}/{kind}/{number:010d}.png'


def classes_of(camera: int, number: int, shape: tuple[int, int]) -> np.ndarray:
    """(H, W) ids of classes."""
    return np.random.default_rng([camera, number]).integers(0, 45, shape, np.uint8)


def add_label_images(root: Path, size: tuple[int, int], numbers=(2, 4)) -> None:
    """Add those of some frames, of images of (width, height)."""
    for camera in (0, 1):
        for number in numbers:
            classes = classes_of(camera, number, size[::-1])
            images = {
                'semantic': classes,
                'semantic_rgb': np.dstack([classes, classes, classes]),
                'instance': classes.astype(np.uint16) * 1000 + 7,
                'confidence': np.full(size[::-1], 200, np.uint8),
            }
            for kind in KINDS:
                path = label_file(root, camera, kind, number)
                path.parent.mkdir(parents=True, exist_ok=True)
                # Deflated otherwise than images of cameras: only the files themselves tell.
                cv2.imwrite(str(path), images[kind], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    (root / LABELS / 'instanceDict.json').write_text('{}')
