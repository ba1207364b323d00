# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The places of the parts of a panel.

Left, the camera image three times; right, the view from above, the facts, and the scan by
direction. For a recording without images the view from above is on the left, larger, and the path
so far is in its place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..drawing.range_maps import ROWS

if TYPE_CHECKING:
    from ..drawing.pixels import Pixels
    from .frame import FrameData

SIZE = (1920, 1080)
"""(width, height) of the page, pixels."""

EDGE = 12
TITLE_ROOM = 22
"""Height of a title above its part, pixels."""


class Area(NamedTuple):
    """A rectangle of the page, pixels."""

    left: int
    top: int
    width: int
    height: int

    def of(self, page: Pixels) -> Pixels:
        """Return the part of the page for drawing."""
        return page[self.top : self.top + self.height, self.left : self.left + self.width]


_LEFT_WIDTH, _IMAGE_HEIGHT = 1024, 312
_RIGHT = EDGE + _LEFT_WIDTH + EDGE
_RIGHT_WIDTH = SIZE[0] - EDGE - _RIGHT
_FIRST = 48 + TITLE_ROOM
_STEP = _IMAGE_HEIGHT + TITLE_ROOM + 9
_MAP_HEIGHT = 2 * ROWS
_LAST = SIZE[1] - EDGE
_BIRD_WIDTH = 524
_BIRD_HEIGHT = _LAST - 2 * (_MAP_HEIGHT + TITLE_ROOM + 9) - _FIRST
_SIDE = _RIGHT + _BIRD_WIDTH + 2 * EDGE

BOXES_2D = Area(EDGE, _FIRST, _LEFT_WIDTH, _IMAGE_HEIGHT)
BOXES_3D = BOXES_2D._replace(top=_FIRST + _STEP)
LIDAR = BOXES_2D._replace(top=_FIRST + 2 * _STEP)
BIRD = Area(_RIGHT, _FIRST, _BIRD_WIDTH, _BIRD_HEIGHT)
FACTS = Area(_SIDE, _FIRST, SIZE[0] - EDGE - _SIDE, 300)
CLASSES = FACTS._replace(top=_FIRST + 300 + TITLE_ROOM, height=_BIRD_HEIGHT - 300 - TITLE_ROOM)
DISTANCE = Area(_RIGHT, _LAST - _MAP_HEIGHT, _RIGHT_WIDTH, _MAP_HEIGHT)
INTENSITY = DISTANCE._replace(top=DISTANCE.top - _MAP_HEIGHT - TITLE_ROOM - 9)


class PanelParts(NamedTuple):
    """The place of each part on a page, None for one that it does not have.

    Attributes:
        images: With 2D boxes, with 3D boxes, and with the scan.
        bird: The view from above.
        route: The path so far.
        maps: The scan by direction: intensity and distance.
    """

    images: tuple[Area, Area, Area] | None
    bird: Area
    route: Area | None
    maps: tuple[Area, Area] | None

    def titles(self) -> dict[Area, str]:
        """Return the title of each part."""
        found = {self.bird: "Bird's-eye view", FACTS: 'Facts', CLASSES: 'Classes'}
        if self.images:
            found |= zip(self.images, ('2D boxes', '3D boxes', 'Scan over the image'), strict=True)
        if self.route:
            found[self.route] = 'Path so far'
        if self.maps:
            titles = 'Intensity by direction, ahead in the middle', 'Distance by direction, m'
            found |= zip(self.maps, titles, strict=True)
        return found


_WITH_IMAGES = PanelParts((BOXES_2D, BOXES_3D, LIDAR), BIRD, None, (INTENSITY, DISTANCE))


def parts_of(frame: FrameData) -> PanelParts:
    """Return the parts of the page of a frame."""
    if frame.images or frame.imaged:
        return _WITH_IMAGES
    scanned = frame.points is not None or frame.scanned
    if frame.path is None:
        height = _BIRD_HEIGHT if scanned else _LAST - _FIRST
        bird = Area(EDGE, _FIRST, _LEFT_WIDTH + EDGE + _BIRD_WIDTH, height)
        wide = (
            each._replace(left=EDGE, width=SIZE[0] - 2 * EDGE) for each in (INTENSITY, DISTANCE)
        )
        intensity, distance = wide
        return PanelParts(None, bird, None, (intensity, distance) if scanned else None)
    bird = Area(EDGE, _FIRST, _LEFT_WIDTH, _LAST - _FIRST)
    route = BIRD if scanned else BIRD._replace(height=_LAST - _FIRST)
    return PanelParts(None, bird, route, (INTENSITY, DISTANCE) if scanned else None)
