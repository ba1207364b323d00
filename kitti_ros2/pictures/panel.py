# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The panel: one page with the images, the scan, the objects, and the facts of a frame.

Left, the camera image with 2D boxes, with 3D boxes and with the scan; right, the view from above,
the facts, and the scan by direction. A part that cannot be drawn shows the reason in its place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from ..drawing.birds_eye import BACKGROUND
from ..drawing.range_maps import ROWS, range_maps
from ..drawing.scales import SCALES, color_table, colored, draw_ramp
from ..drawing.strokes import new_picture
from ..drawing.text import extent_of, fitted, put_text
from ..model.errors import MissingDataError
from ..options.pictures import ColorBy
from .facts import draw_classes, draw_facts, moment_of
from .frame_parts import camera_image, frame_points, name_of, of_classes
from .painters import Shown, draw_bird, paint_boxes_2d, paint_boxes_3d, paint_scan

if TYPE_CHECKING:
    from ..drawing.pixels import Pixels
    from ..drawing.strokes import Color
    from ..options.pictures import BirdOptions, PictureOptions
    from .frame import Frame

SIZE = (1920, 1080)
"""(width, height) of the page, pixels."""

_PAGE: Color = (14, 12, 11)
_TITLE: Color = (205, 200, 196)
_QUIET: Color = (140, 132, 126)
_MISSING: Color = (96, 176, 245)
_TITLE_ROOM = 22
_TITLE_SCALE = 0.42
_HEAD_SCALE = 0.7
_DIM = 0.3


class Area(NamedTuple):
    """A rectangle of the page, pixels."""

    left: int
    top: int
    width: int
    height: int

    def of(self, page: Pixels) -> Pixels:
        """Return the part of the page for drawing."""
        return page[self.top : self.top + self.height, self.left : self.left + self.width]


_EDGE = 12
_LEFT_WIDTH, _IMAGE_HEIGHT = 1024, 312
_RIGHT = _EDGE + _LEFT_WIDTH + _EDGE
_RIGHT_WIDTH = SIZE[0] - _EDGE - _RIGHT
_FIRST = 48 + _TITLE_ROOM
_STEP = _IMAGE_HEIGHT + _TITLE_ROOM + 9
_MAP_HEIGHT = 2 * ROWS
_LAST = SIZE[1] - _EDGE
_BIRD_WIDTH = 524
_BIRD_HEIGHT = _LAST - 2 * (_MAP_HEIGHT + _TITLE_ROOM + 9) - _FIRST
_SIDE = _RIGHT + _BIRD_WIDTH + 2 * _EDGE

BOXES_2D = Area(_EDGE, _FIRST, _LEFT_WIDTH, _IMAGE_HEIGHT)
BOXES_3D = BOXES_2D._replace(top=_FIRST + _STEP)
LIDAR = BOXES_2D._replace(top=_FIRST + 2 * _STEP)
BIRD = Area(_RIGHT, _FIRST, _BIRD_WIDTH, _BIRD_HEIGHT)
FACTS = Area(_SIDE, _FIRST, SIZE[0] - _EDGE - _SIDE, 300)
CLASSES = FACTS._replace(top=_FIRST + 300 + _TITLE_ROOM, height=_BIRD_HEIGHT - 300 - _TITLE_ROOM)
DISTANCE = Area(_RIGHT, _LAST - _MAP_HEIGHT, _RIGHT_WIDTH, _MAP_HEIGHT)
INTENSITY = DISTANCE._replace(top=DISTANCE.top - _MAP_HEIGHT - _TITLE_ROOM - 9)

TITLES = {
    BOXES_2D: '2D boxes',
    BOXES_3D: '3D boxes',
    LIDAR: 'Scan over the image',
    BIRD: "Bird's-eye view",
    FACTS: 'Facts',
    CLASSES: 'Classes',
    INTENSITY: 'Intensity by direction, ahead in the middle',
    DISTANCE: 'Distance by direction, m',
}


def draw_panel(frame: Frame, options: PictureOptions) -> Pixels:
    """Draw the page of a frame, (1080, 1920, 3) BGR."""
    frame = of_classes(frame, options)
    page = new_picture(SIZE, _PAGE)
    for area, title in TITLES.items():
        put_text(page, title, (area.left, area.top - 7), _TITLE_SCALE, _TITLE, bold=True)
        if area not in (FACTS, CLASSES):
            cv2.rectangle(area.of(page), (0, 0), (area.width, area.height), BACKGROUND, cv2.FILLED)
    _draw_head(page, frame)
    _draw_images(page, frame, options)
    _draw_bird(page, frame, options)
    _draw_maps(page, frame, options)
    draw_facts(FACTS.of(page), frame, options)
    draw_classes(CLASSES.of(page), frame)
    return page


def _draw_head(page: Pixels, frame: Frame) -> None:
    """Draw source and frame on the left, time on the right."""
    number = f'frame {frame.number}'
    moment = moment_of(frame) or ''
    baseline = 34
    right = SIZE[0] - _EDGE - extent_of(moment, _HEAD_SCALE).width
    put_text(page, moment, (right, baseline), _HEAD_SCALE, _QUIET)
    room = right - 4 * _EDGE - extent_of(number, _HEAD_SCALE).width
    source = fitted(frame.source, room, _HEAD_SCALE, bold=True)
    put_text(page, source, (_EDGE, baseline), _HEAD_SCALE, _TITLE, bold=True)
    left = _EDGE + extent_of(source, _HEAD_SCALE, bold=True).width + 2 * _EDGE
    put_text(page, number, (left, baseline), _HEAD_SCALE, _QUIET)


def _say(window: Pixels, frame: Frame, error: MissingDataError) -> None:
    """Draw the reason for missing data in the middle of a window."""
    window[:] = cv2.convertScaleAbs(window, alpha=_DIM)
    width = window.shape[1]
    reason = str(error).removeprefix(f'{name_of(frame)}: ')
    text = fitted(reason, width - 2 * _EDGE, _TITLE_SCALE)
    left = (width - extent_of(text, _TITLE_SCALE).width) / 2
    put_text(window, text, (left, window.shape[0] / 2), _TITLE_SCALE, _MISSING)


def _draw_images(page: Pixels, frame: Frame, options: PictureOptions) -> None:
    """Draw the camera image three times: with 2D boxes, 3D boxes, and the scan."""
    try:
        shown = _fit(*camera_image(frame, options), BOXES_2D)
    except MissingDataError as error:
        for area in (BOXES_2D, BOXES_3D, LIDAR):
            _say(area.of(page), frame, error)
        return
    height, width = shown.picture.shape[:2]
    for area, paint in (
        (BOXES_2D, paint_boxes_2d),
        (BOXES_3D, paint_boxes_3d),
        (LIDAR, paint_scan),
    ):
        left, top = (area.width - width) // 2, (area.height - height) // 2
        window = area.of(page)[top : top + height, left : left + width]
        window[:] = shown.picture
        try:
            paint(window, shown, frame, options)
        except MissingDataError as error:
            _say(area.of(page), frame, error)


def _fit(camera: int, image: Pixels, area: Area) -> Shown:
    """Scale the image to fit an area."""
    scale = min(area.width / image.shape[1], area.height / image.shape[0])
    width, height = (max(round(side * scale), 1) for side in image.shape[1::-1])
    # Down to half the size, linear interpolation still uses every pixel, at a fifth of the cost of
    # area averaging.
    interpolation = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    picture = np.asarray(cv2.resize(image, (width, height), interpolation=interpolation), np.uint8)
    return Shown(camera, picture, width / image.shape[1], height / image.shape[0])


def _draw_bird(page: Pixels, frame: Frame, options: PictureOptions) -> None:
    """Draw the scan and the boxes from above, and the colour bar."""
    window = BIRD.of(page)
    try:
        window[:] = draw_bird(frame, replace(options, bird=_filling(options.bird, BIRD)))
    except MissingDataError as error:
        _say(window, frame, error)


def _filling(bird: BirdOptions, area: Area) -> BirdOptions:
    """Return the view with ranges widened about their centres to fill an area."""
    spans = (bird.y_range[1] - bird.y_range[0], bird.x_range[1] - bird.x_range[0])
    scale = min(area.width / spans[0], area.height / spans[1])
    y_range, x_range = (
        ((low + high) / 2 - pixels / scale / 2, (low + high) / 2 + pixels / scale / 2)
        for (low, high), pixels in ((bird.y_range, area.width), (bird.x_range, area.height))
    )
    return replace(bird, x_range=x_range, y_range=y_range, pixels_per_metre=scale)


def _draw_maps(page: Pixels, frame: Frame, options: PictureOptions) -> None:
    """Draw the scan by direction: intensity and distance."""
    try:
        maps = range_maps(frame_points(frame), _RIGHT_WIDTH)
    except MissingDataError as error:
        _say(INTENSITY.of(page), frame, error)
        _say(DISTANCE.of(page), frame, error)
        return
    parts = (INTENSITY, ColorBy.INTENSITY), (DISTANCE, ColorBy.DEPTH)
    for shades, (area, kind) in zip(maps, parts, strict=True):
        size = area.width, area.height
        large = np.asarray(cv2.resize(shades, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        cv2.copyTo(colored(large, color_table(options.color_map)), large, area.of(page))
        draw_ramp(page, SCALES[kind], options.color_map, (area.left + area.width, area.top - 7))
