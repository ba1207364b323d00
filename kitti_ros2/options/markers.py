# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the markers of labels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from ..model.errors import UsageError
from .declare import check_bounds, choice, option
from .parsers import parse_flag, parse_number
from .quantity_parsers import parse_seconds_ns


class MarkerColors(str, Enum):
    """Property that determines the colour of an object's markers."""

    CLASS = 'class'
    TRACK = 'track'


@dataclass(frozen=True)
class MarkerOptions:
    """Options of the markers of labels.

    Attributes:
        colors: One colour per class, or one per track.
        alpha: Opacity of the boxes, 0..1.
        line_width: Width of edges and trails, metres.
        arrow_length: How far a heading arrow extends beyond its box, metres.
        text_height: Height of the text, metres.
        lifetime_ns: Nanoseconds after which viewers remove a marker; 0 never.
        trails: Whether tracks show their past positions.
        ego: Whether the recording car is drawn.

    Raises:
        UsageError: A size is not positive, or alpha is out of range.
    """

    group: ClassVar = 'Label markers'

    colors: MarkerColors = choice(
        MarkerColors.CLASS, 'One colour per class or per track', MarkerColors, name='marker_colors'
    )
    alpha: float = option(
        0.35, 'Opacity of label boxes', parse_number, name='marker_alpha', bounds=(0.0, 1.0)
    )
    line_width: float = option(
        0.05,
        'Width of label edges and trails, metres',
        parse_number,
        name='marker_line_width',
        bounds=(0.001, 10.0),
    )
    arrow_length: float = option(
        1.0,
        'How far a heading arrow extends beyond its box, metres',
        parse_number,
        name='marker_arrow_length',
        bounds=(0.01, 100.0),
    )
    text_height: float = option(
        0.6,
        'Height of label text, metres',
        parse_number,
        name='marker_text_height',
        bounds=(0.01, 100.0),
    )
    lifetime_ns: int = option(
        300_000_000,
        'Seconds after which a label marker disappears; 0 is never',
        parse_seconds_ns,
        name='marker_lifetime',
        bounds=(0.0, 3600.0),
    )
    trails: bool = option(False, 'Label markers also show the past positions of tracks', parse_flag)
    ego: bool = option(True, 'Marker of the recording car', parse_flag, name='ego_marker')

    def __post_init__(self) -> None:
        check_bounds(self, 'marker_alpha')
        for name in ('line_width', 'arrow_length', 'text_height'):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise UsageError(
                    f'marker {name} {getattr(self, name):g} is not positive, in metres'
                )
        if self.lifetime_ns < 0:
            raise UsageError('the lifetime of markers is negative')
