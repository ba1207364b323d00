# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of pictures, as options.py has those of everything else."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from ..model.errors import UsageError


class ColorBy(str, Enum):
    """What the colour of a scan's point tells."""

    DEPTH = 'depth'
    HEIGHT = 'height'
    INTENSITY = 'intensity'


class ColorMap(str, Enum):
    """Which colours a scale has."""

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
    """What a bird's-eye view shows; forward is up, left is left.

    Attributes:
        x_range: From and to, metres forward of the scanner.
        y_range: From and to, metres to the left of the scanner.
        pixels_per_metre: Resolution.

    Raises:
        UsageError: A range is empty, or the picture would be of no pixels or of too many.
    """

    x_range: tuple[float, float] = (-10.0, 60.0)
    y_range: tuple[float, float] = (-25.0, 25.0)
    pixels_per_metre: float = 14.0

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
        if not all(1 <= pixels <= MOST_BIRD_PIXELS for pixels in self.size):
            width, height = self.size
            raise UsageError(
                f"a bird's-eye view of {width} x {height} pixels; expected 1 to"
                f' {MOST_BIRD_PIXELS} a side (change its range or resolution)'
            )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture."""
        width, height = (
            round((high - low) * self.pixels_per_metre)
            for low, high in (self.y_range, self.x_range)
        )
        return width, height


@dataclass(frozen=True)
class PictureOptions:
    """How pictures are drawn.

    Attributes:
        camera: KITTI camera index; None is camera 2, or the first there is.
        color_by: What the colour of a point over an image tells.
        color_map: Its colours.
        point_size: Diameter of a point over an image, pixels.
        bird: The bird's-eye view.
        classes: Those that are drawn; all where empty.
        named: Whether boxes have tags with class, track and score.

    Raises:
        UsageError: A value is out of range.
    """

    camera: int | None = None
    color_by: ColorBy = ColorBy.DEPTH
    color_map: ColorMap = ColorMap.TURBO
    point_size: int = 2
    bird: BirdOptions = field(default_factory=BirdOptions)
    classes: tuple[str, ...] = ()
    named: bool = True

    def __post_init__(self) -> None:
        if self.camera is not None and self.camera < 0:
            raise UsageError(f'camera {self.camera} is negative; KITTI counts them from 0')
        if not 1 <= self.point_size <= MOST_POINT_SIZE:
            raise UsageError(
                f'a point size of {self.point_size} is not within 1 to {MOST_POINT_SIZE} pixels'
            )
