# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged images cost a line each cause: libraries print nothing beside the losses."""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import cv2
import numpy as np
import pytest
import small_rigs

from kitti_ros2.cli import main


def damaged(kind: str) -> np.ndarray:
    """A compressed image with a fault."""
    rng = np.random.default_rng(5)
    pixels = rng.integers(0, 255, (camera_rigs.SIZE[1], camera_rigs.SIZE[0], 3), np.uint8)
    suffix = '.png' if 'png' in kind else '.webp' if 'webp' in kind else '.jpg'
    data = cv2.imencode(suffix, pixels)[1].ravel()
    if 'cut' in kind:
        return data[: len(data) // 2]
    if 'premature' in kind:  # its end is there
        return np.concatenate([data[: len(data) // 2], data[-2:]])
    if 'code' in kind:
        data = data.copy()
        data[len(data) // 2 : len(data) // 2 + 400] = [0xFF, 0] * 200  # no code is all ones
        return data
    if 'noise' in kind:
        data = data.copy()
        data[len(data) // 2 : len(data) // 2 + 400] = rng.integers(0, 255, 400, np.uint8)
        return data
    if 'huge' in kind:
        data = data.copy()
        data[16:24] = 255
        return data
    return data[:30]


KINDS = [
    'jpeg cut', 'jpeg head', 'jpeg noise', 'jpeg premature', 'jpeg code',
    'png cut', 'png noise', 'png huge', 'png head', 'webp cut', 'webp head',
]  # fmt: skip


@pytest.mark.one_in(3)
@pytest.mark.parametrize('kind', KINDS)
def test_a_damaged_image_is_a_loss_and_nothing_else_is_printed(kind, tmp_path, capfd, monkeypatch):
    base = small_rigs.sides('front')
    camera = replace(base.cameras[0], image='image_rect_color/compressed')
    true = camera_rigs._Messages.image
    start = camera_rigs.START_NS

    def image(self, camera):
        made = true(self, camera)
        if self.stamp_ns == start + camera_rigs.PERIOD_NS:
            return replace(made, format=kind.partition(' ')[0], data=damaged(kind))
        return made

    monkeypatch.setattr(camera_rigs._Messages, 'image', image)
    bag = camera_rigs.write(replace(base, cameras=(camera,)), tmp_path / 'bag')
    capfd.readouterr()
    code = main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'object'])
    said = capfd.readouterr().err
    lines = [line for line in said.splitlines() if not line.startswith(('skipped', 'kitti-ros2:'))]
    assert lines == []
    assert code == 1
    assert 'skipped /front/image_rect_color/compressed (1)' in said
