# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes of several messages of one moment -> each object once.

Several detectors may share a topic, and then each has boxes of its own. But recorders write
messages twice, trackers send a moment again, and detectors see one object where views overlap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .join_boxes import overlap_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import TypeVar

    from ..messages.detections import ImageBox
    from ..model.boxes import Cuboid

    _Box = TypeVar('_Box')

REPEATED = 'that another message of their stamp has, too,'

_SAME_OVERLAP = 0.7


def join_cuboids(messages: Sequence[Sequence[Cuboid]]) -> tuple[list[Cuboid], list[str]]:
    """Return the boxes of all messages, and REPEATED for each that an earlier message has.

    These have its class, and are nearer to it than half of its shortest side.
    """
    return _join(messages, _is_same)


def join_image_boxes(messages: Sequence[Sequence[ImageBox]]) -> tuple[list[ImageBox], list[str]]:
    """Return the boxes of all messages, and REPEATED for each that an earlier message has.

    These have its class and its camera, and cover it nearly.
    """
    return _join(messages, _is_same_2d)


def _join(
    messages: Sequence[Sequence[_Box]], is_same: Callable[[_Box, _Box], bool]
) -> tuple[list[_Box], list[str]]:
    made: list[_Box] = []
    count = sum(map(len, messages))
    for boxes in messages:
        earlier = list(made)
        made += [each for each in boxes if not any(is_same(one, each) for one in earlier)]
    return made, [REPEATED] * (count - len(made))


def _is_same(first: Cuboid, second: Cuboid) -> bool:
    away = first.velo_T_box.translation - second.velo_T_box.translation
    near = float(np.linalg.norm(away)) < min(first.size_lwh) / 2
    return near and first.class_name == second.class_name


def _is_same_2d(first: ImageBox, second: ImageBox) -> bool:
    alike = (first.class_name, first.frame) == (second.class_name, second.frame)
    return alike and overlap_of(first.box_2d, second.box_2d) >= _SAME_OVERLAP
