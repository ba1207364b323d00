# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of scoring a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from ..model.errors import UsageError
from .declare import choice, option
from .parsers import parse_text, parse_texts
from .quantity_parsers import parse_seconds_ns


class Alignment(str, Enum):
    """Alignment of a result with the ground truth before errors are computed."""

    NONE = 'none'
    FIRST = 'first'
    SE3 = 'se3'
    SIM3 = 'sim3'
    SCALE = 'scale'

    @property
    def has_scale(self) -> bool:
        """Whether it scales the result, for KITTI's segments too."""
        return self in {Alignment.SIM3, Alignment.SCALE}


@dataclass(frozen=True)
class OdometryOptions:
    """Options of scoring a trajectory.

    Attributes:
        topic: The topic of a result in a bag; None is the only one with poses.
        tf: Parent and child of the link whose transforms are the result; empty for a topic.
        gt_topic: The topic of a ground truth in a bag that to-bag did not write; None is chosen.
        frame: The frame whose poses the result has; None is that of the messages, in files the
            rectified camera 0.
        align: How the result is aligned for APE and RPE; a scale is also that of the segments.
        tolerance_ns: Largest accepted difference of the stamps of a pose and its frame; None is
            half the period of the ground truth.

    Raises:
        UsageError: A value is invalid, or excludes another.
    """

    group: ClassVar = 'Evaluation'

    topic: str | None = option(
        None,
        'Topic of RESULT, a bag; Odometry, PoseStamped, Path',
        parse_text,
        unset='the only one',
        metavar='TOPIC',
    )
    tf: tuple[str, ...] = option(
        (),
        'Instead of a topic: the link on /tf that is RESULT',
        parse_texts,
        unset='none',
        metavar='PARENT CHILD',
    )
    gt_topic: str | None = option(
        None,
        'Topic of GT, a bag that to-bag did not write',
        parse_text,
        unset='chosen by name and type',
        metavar='TOPIC',
    )
    frame: str | None = option(
        None,
        'Frame whose poses RESULT has, such as velo_link',
        parse_text,
        unset='that of the messages, in files camera 0',
        metavar='FRAME',
    )
    align: Alignment = choice(
        Alignment.FIRST,
        'Alignment: the first pose, or all positions; sim3, scale: segments are scaled, too',
        Alignment,
    )
    tolerance_ns: int | None = option(
        None,
        'Largest difference of the stamps of a pose and its frame',
        parse_seconds_ns,
        name='tolerance',
        unset="half of GT's period",
    )

    def __post_init__(self) -> None:
        if self.tf and self.topic is not None:
            raise UsageError('--topic and --tf exclude each other; give one of them')
        if self.tf and len(self.tf) != 2:
            raise UsageError(
                f'--tf takes the parent and the child of a link, such as odom base_link, not'
                f' {" ".join(self.tf)!r}'
            )
