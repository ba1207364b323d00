# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of a TF tree of the ground truth alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..model.errors import UsageError
from .declare import option
from .parsers import parse_flag, parse_text

_MAP, _BASE = 'map_gt', 'base_link_gt'


@dataclass(frozen=True)
class GroundTruthOptions:
    """Options of a TF tree of the ground truth alone.

    Attributes:
        tree: Whether the poses are on a TF tree of their own, so that a stack may own map, odom
            and base_link.
        map, base: The frames of that tree.

    Raises:
        UsageError: A frame is invalid, or given without the tree.
    """

    group: ClassVar = 'Ground truth'

    tree: bool = option(
        False,
        'Ground truth on a TF tree of its own; map, odom and base_link are left to a stack',
        parse_flag,
        name='ground_truth_tree',
    )
    map: str = option(
        _MAP,
        'With --ground-truth-tree: its fixed frame',
        parse_text,
        name='ground_truth_map',
        metavar='FRAME',
    )
    base: str = option(
        _BASE,
        'With --ground-truth-tree: its moving frame',
        parse_text,
        name='ground_truth_base',
        metavar='FRAME',
    )

    def __post_init__(self) -> None:
        frames = self.map, self.base
        if not self.tree:
            if frames != (_MAP, _BASE):
                raise UsageError(
                    'ground_truth_map and ground_truth_base are for ground_truth_tree; give it too'
                )
            return
        for name in frames:
            if not name or name.startswith('/') or any(map(str.isspace, name)):
                raise UsageError(f'{name!r} is not a TF frame: no blanks, and no / at the start')
        if frames[0] == frames[1]:
            raise UsageError(f'ground_truth_map and ground_truth_base are both {frames[0]}')
