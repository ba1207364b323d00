# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

from ..model.errors import UsageError
from .declare import choice, option
from .parsers import parse_integer, parse_number, parse_texts
from .quantity_parsers import parse_four_numbers


class ColorBy(str, Enum):
    """Quantity that the colour of a scan's point shows."""

    DEPTH = 'depth'
    HEIGHT = 'height'
    INTENSITY = 'intensity'
    SEMANTIC = 'semantic'


class ColorMap(str, Enum):
    """Colours of a scale."""

    VIRIDIS = 'viridis'
    PLASMA = 'plasma'
    INFERNO = 'inferno'
    MAGMA = 'magma'
    CIVIDIS = 'cividis'
    TURBO = 'turbo'
    JET = 'jet'


MOST_BIRD_PIXELS = 8192
MOST_POINT_SIZE = 15


@dataclass(frozen=True)
class BirdOptions:
    """Extent and resolution of a bird's-eye view; forward is up, left is left.

    Attributes:
        x_range: From and to, metres forward of the scanner.
        y_range: From and to, metres to the left of the scanner.
        pixels_per_metre: Resolution.

    Raises:
        UsageError: A range is empty, or the picture would be of no pixels or of too many.
    """

    group: ClassVar = "Bird's-eye view"

    # --range sets both ranges; table.py takes it apart.
    x_range: tuple[float, float] = option(
        (-10.0, 60.0),
        'Metres forward from, to; metres to the left from, to',
        parse_four_numbers,
        name='range',
        unset='-10,60,-25,25',
        metavar='X,X,Y,Y',
    )
    y_range: tuple[float, float] = (-25.0, 25.0)
    pixels_per_metre: float = option(14.0, 'Pixels per metre', parse_number, name='resolution')

    def __post_init__(self) -> None:
        for name, (low, high) in (('x', self.x_range), ('y', self.y_range)):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise UsageError(
                    f"the bird's-eye view is empty in {name}: {low:g} to {high:g} metres"
                )
        if not (math.isfinite(self.pixels_per_metre) and self.pixels_per_metre > 0):
            raise UsageError(
                f'a resolution of {self.pixels_per_metre:g} is not positive, in pixels per metre'
            )
        width, height = sides = self._sides()
        if not all(side < math.inf and 1 <= round(side) <= MOST_BIRD_PIXELS for side in sides):
            raise UsageError(
                f"a bird's-eye view of {width:.6g} x {height:.6g} pixels; expected 1 to"
                f' {MOST_BIRD_PIXELS} a side (change its range or resolution)'
            )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture."""
        width, height = self._sides()
        return round(width), round(height)

    def _sides(self) -> tuple[float, float]:
        """Return (width, height), not rounded; infinity where no float is so large."""
        width, height = (
            (high - low) * self.pixels_per_metre for low, high in (self.y_range, self.x_range)
        )
        return width, height


@dataclass(frozen=True)
class PictureOptions:
    """Options of pictures.

    Attributes:
        camera: KITTI camera index; None is camera 2, or the first of the recording.
        color_by: Quantity that the colour of a point shows; None is depth on an image, else
            height.
        color_map: Its colours; classes of points have their own.
        point_size: Diameter of a point on an image or in perspective, pixels.
        bird: The bird's-eye view.
        classes: Classes of the objects to draw; empty is all.
        named: Whether boxes have tags with class, track and score.

    Raises:
        UsageError: A value is out of range.
    """

    group: ClassVar = 'Pictures'

    camera: int | None = option(
        None, "KITTI's camera number", parse_integer, unset='2, or the first'
    )
    color_by: ColorBy | None = choice(
        None,
        "What the colour of a point shows; semantic: SemanticKITTI's labels",
        ColorBy,
        unset='depth on images, else height',
    )
    color_map: ColorMap = choice(ColorMap.VIRIDIS, 'Colours of its scale', ColorMap)
    point_size: int = option(2, 'Diameter of a point, pixels', parse_integer)
    bird: BirdOptions = field(default_factory=BirdOptions)
    classes: tuple[str, ...] = option((), 'Only objects of these classes', parse_texts, unset='all')
    named: bool = True

    def __post_init__(self) -> None:
        if self.camera is not None and self.camera < 0:
            raise UsageError(f'camera {self.camera} is negative; KITTI counts them from 0')
        if not 1 <= self.point_size <= MOST_POINT_SIZE:
            raise UsageError(
                f'a point size of {self.point_size} is not within 1 to {MOST_POINT_SIZE} pixels'
            )
