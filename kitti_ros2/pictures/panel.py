# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The panel: one page with the images, the scan, the objects, and the facts of a frame.

A part that cannot be drawn shows the reason in its place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..drawing.birds_eye import BACKGROUND
from ..drawing.range_maps import range_maps
from ..drawing.route import draw_route
from ..drawing.scales import SCALES, color_table, colored, draw_ramp
from ..drawing.strokes import new_picture
from ..drawing.text import extent_of, fitted, put_text
from ..model.errors import MissingDataError
from ..options.pictures import ColorBy
from .facts import draw_classes, draw_facts, moment_of
from .frame_parts import camera_image, frame_points, name_of, of_classes
from .painters import draw_bird, fit_image, paint_boxes_2d, paint_boxes_3d, paint_scan
from .panel_parts import CLASSES, EDGE, FACTS, SIZE, parts_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..drawing.pixels import Pixels
    from ..drawing.strokes import Color
    from ..options.pictures import BirdOptions, PictureOptions
    from .frame import FrameData
    from .panel_parts import Area

_PAGE: Color = (14, 12, 11)
_TITLE: Color = (205, 200, 196)
_QUIET: Color = (140, 132, 126)
_MISSING: Color = (96, 176, 245)
_TITLE_SCALE = 0.42
_HEAD_SCALE = 0.7
_DIM = 0.3


def draw_panel(frame: FrameData, options: PictureOptions) -> Pixels:
    """Draw the page of a frame, (1080, 1920, 3) BGR."""
    frame = of_classes(frame, options)
    page = new_picture(SIZE, _PAGE)
    parts = parts_of(frame)
    for area, title in parts.titles().items():
        put_text(page, title, (area.left, area.top - 7), _TITLE_SCALE, _TITLE, bold=True)
        if area not in (FACTS, CLASSES):
            cv2.rectangle(area.of(page), (0, 0), (area.width, area.height), BACKGROUND, cv2.FILLED)
    _draw_head(page, frame)
    if parts.images:
        _draw_images(page, parts.images, frame, options)
    _draw_bird(parts.bird.of(page), frame, options)
    if parts.route and frame.path is not None:
        draw_route(parts.route.of(page), frame.path)
    if parts.maps:
        _draw_maps(page, parts.maps, frame, options)
    draw_facts(FACTS.of(page), frame, options)
    draw_classes(CLASSES.of(page), frame)
    return page


def _draw_head(page: Pixels, frame: FrameData) -> None:
    """Draw source and frame on the left, time on the right."""
    number = f'frame {frame.number}'
    moment = moment_of(frame) or ''
    baseline = 34
    right = SIZE[0] - EDGE - extent_of(moment, _HEAD_SCALE).width
    put_text(page, moment, (right, baseline), _HEAD_SCALE, _QUIET)
    room = right - 4 * EDGE - extent_of(number, _HEAD_SCALE).width
    source = fitted(frame.source, room, _HEAD_SCALE, bold=True)
    put_text(page, source, (EDGE, baseline), _HEAD_SCALE, _TITLE, bold=True)
    left = EDGE + extent_of(source, _HEAD_SCALE, bold=True).width + 2 * EDGE
    put_text(page, number, (left, baseline), _HEAD_SCALE, _QUIET)


def _say(window: Pixels, frame: FrameData, error: MissingDataError) -> None:
    """Draw the reason for missing data in the middle of a window."""
    window[:] = cv2.convertScaleAbs(window, alpha=_DIM)
    width = window.shape[1]
    reason = str(error).removeprefix(f'{name_of(frame)}: ')
    text = fitted(reason, width - 2 * EDGE, _TITLE_SCALE)
    left = (width - extent_of(text, _TITLE_SCALE).width) / 2
    put_text(window, text, (left, window.shape[0] / 2), _TITLE_SCALE, _MISSING)


def _draw_images(
    page: Pixels, areas: Sequence[Area], frame: FrameData, options: PictureOptions
) -> None:
    """Draw the camera image three times: with 2D boxes, 3D boxes, and the scan."""
    try:
        shown = fit_image(*camera_image(frame, options), (areas[0].width, areas[0].height))
    except MissingDataError as error:
        for area in areas:
            _say(area.of(page), frame, error)
        return
    height, width = shown.picture.shape[:2]
    for area, paint in zip(areas, (paint_boxes_2d, paint_boxes_3d, paint_scan), strict=True):
        left, top = (area.width - width) // 2, (area.height - height) // 2
        window = area.of(page)[top : top + height, left : left + width]
        window[:] = shown.picture
        try:
            paint(window, shown, frame, options)
        except MissingDataError as error:
            _say(area.of(page), frame, error)


def _draw_bird(window: Pixels, frame: FrameData, options: PictureOptions) -> None:
    """Draw the scan and the boxes from above."""
    try:
        window[:] = draw_bird(frame, replace(options, bird=_filling(options.bird, window)))
    except MissingDataError as error:
        _say(window, frame, error)


def _filling(bird: BirdOptions, window: Pixels) -> BirdOptions:
    """Return the view with ranges widened about their centres to fill a window."""
    height, width = window.shape[:2]
    spans = (bird.y_range[1] - bird.y_range[0], bird.x_range[1] - bird.x_range[0])
    scale = min(width / spans[0], height / spans[1])
    y_range, x_range = (
        ((low + high) / 2 - pixels / scale / 2, (low + high) / 2 + pixels / scale / 2)
        for (low, high), pixels in ((bird.y_range, width), (bird.x_range, height))
    )
    return replace(bird, x_range=x_range, y_range=y_range, pixels_per_metre=scale)


def _draw_maps(
    page: Pixels, areas: Sequence[Area], frame: FrameData, options: PictureOptions
) -> None:
    """Draw the scan by direction: intensity and distance."""
    try:
        maps = range_maps(frame_points(frame), areas[0].width)
    except MissingDataError as error:
        for area in areas:
            _say(area.of(page), frame, error)
        return
    table = color_table(options.color_map)
    kinds = (ColorBy.INTENSITY, ColorBy.DEPTH)
    for shades, area, kind in zip(maps, areas, kinds, strict=True):
        size = area.width, area.height
        large = np.asarray(cv2.resize(shades, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        cv2.copyTo(colored(large, table), large, area.of(page))
        draw_ramp(page, SCALES[kind], options.color_map, (area.left + area.width, area.top - 7))
