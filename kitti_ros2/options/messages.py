# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What messages are made of a recording: names, frames, fields, markers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from ..model.errors import UsageError


class Preset(str, Enum):
    """Sets of topic and frame names."""

    DEFAULT = 'default'
    KITTI2BAG = 'kitti2bag'


class MapFrame(str, Enum):
    """What the map frame is: east-north-up from the first base_link, or KITTI's own."""

    ENU = 'enu'
    DEVKIT = 'devkit'


class Images(str, Enum):
    """How images are written: the PNG's own bytes, decoded pixels, or both."""

    COMPRESSED = 'compressed'
    RAW = 'raw'
    BOTH = 'both'


BASE_T_IMU = (-0.05, 0.32, 0.93)
KITTI2BAG_BASE_T_IMU = (-1.405, 0.32, 0.93)


class MarkerColors(str, Enum):
    """What the colour of an object's markers tells."""

    CLASS = 'class'
    TRACK = 'track'


@dataclass(frozen=True)
class MarkerOptions:
    """How labels are drawn.

    Attributes:
        colors: One colour a class, or one a track.
        alpha: Opacity of the boxes, 0..1.
        line_width: Of edges and trails, metres.
        arrow_length: How far a heading reaches out of its box, metres.
        text_height: Metres.
        lifetime_ns: After which a marker goes by itself, nanoseconds; 0 never.
        trails: Whether tracks draw where they were.
        ego: Whether the recording car is drawn.

    Raises:
        UsageError: A size is not positive, or alpha is out of range.
    """

    colors: MarkerColors = MarkerColors.CLASS
    alpha: float = 0.35
    line_width: float = 0.05
    arrow_length: float = 1.0
    text_height: float = 0.6
    lifetime_ns: int = 300_000_000
    trails: bool = False
    ego: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.alpha <= 1:
            raise UsageError(f'marker alpha {self.alpha:g} is not in 0..1')
        for name in ('line_width', 'arrow_length', 'text_height'):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise UsageError(
                    f'marker {name} {getattr(self, name):g} is not positive, in metres'
                )
        if self.lifetime_ns < 0:
            raise UsageError('the lifetime of markers is negative')


@dataclass(frozen=True)
class MessageOptions:
    """Which messages are made, and how.

    Attributes:
        images: compressed, raw or both.
        preset: Names of topics and frames.
        map: Axes and origin of the map frame; see messages/map_frame.py.
        publish_tf: Whether map -> base_link is on /tf; off where a SLAM stack owns it.
        ring_and_time: Whether points also have ring and time.
        base_to_imu: x, y, z of imu_link in base_link, metres; None as the preset has it.
        semantic: Whether points also have SemanticKITTI's label, instance and rgb.
        markers: How labels are drawn.
        annotated: Whether there are images with the labels drawn on them.

    Raises:
        UsageError: base_to_imu is not three finite numbers.
    """

    images: Images = Images.COMPRESSED
    preset: Preset = Preset.DEFAULT
    map: MapFrame = MapFrame.ENU
    publish_tf: bool = True
    ring_and_time: bool = False
    base_to_imu: tuple[float, ...] | None = None
    semantic: bool = False
    markers: MarkerOptions = field(default_factory=MarkerOptions)
    annotated: bool = False

    def __post_init__(self) -> None:
        place = self.base_to_imu or BASE_T_IMU
        if len(place) != 3 or not all(math.isfinite(value) for value in place):
            raise UsageError(f'base_to_imu {place} is not three finite numbers, metres')
