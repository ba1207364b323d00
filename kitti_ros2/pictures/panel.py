# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The panel: one page with the images, the scan, the objects, and the facts of a frame.

A part that cannot be drawn shows the reason instead.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from ..drawing.birds_eye import BACKGROUND, draw_route
from ..drawing.labelled_objects import LABEL_CAMERA
from ..drawing.points import ROWS, SCALES, color_table, colored, draw_ramp, range_maps
from ..drawing.primitives import (
    PREDICTION_BGR,
    class_color,
    extent_of,
    fitted,
    new_picture,
    put_text,
)
from ..model.boxes import DONT_CARE, Verdict
from ..model.errors import MissingDataError
from ..model.streams import Stream, format_stamp
from ..options.outputs import ColorBy
from .painters import (
    Shown,
    camera_image,
    chosen_camera,
    draw_bird,
    draw_from_behind,
    fit_image,
    frame_points,
    name_of,
    of_classes,
    paint_boxes_2d,
    paint_boxes_3d,
    paint_scan,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from ..drawing.labelled_objects import Pixels
    from ..drawing.primitives import Color
    from ..options.outputs import BirdOptions, PictureOptions
    from .painters import Painter
    from .recording_frames import FrameData


# The areas of the parts of a panel.
#
# Left, the camera image three times; right, the view from above, the facts, and the scan by
# direction. Without images the view from above is on the left, larger, and the path so far on the
# right. Below the facts and the classes is the view from behind.

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
_LINE = 22
"""Height of a line of text, pixels."""
_MOST_FACTS = 12
_LEAST_BEHIND = 150
_MOST_BEHIND = 50_000
"""Points in the view from behind."""
_LAST = SIZE[1] - EDGE
_BIRD_WIDTH = 524
_BIRD_HEIGHT = _LAST - 2 * (_MAP_HEIGHT + TITLE_ROOM + 9) - _FIRST
_SIDE = _RIGHT + _BIRD_WIDTH + 2 * EDGE

BOXES_2D = Area(EDGE, _FIRST, _LEFT_WIDTH, _IMAGE_HEIGHT)
BOXES_3D = BOXES_2D._replace(top=_FIRST + _STEP)
LIDAR = BOXES_2D._replace(top=_FIRST + 2 * _STEP)
BIRD = Area(_RIGHT, _FIRST, _BIRD_WIDTH, _BIRD_HEIGHT)
_SIDE_PARTS = Area(_SIDE, _FIRST, SIZE[0] - EDGE - _SIDE, _BIRD_HEIGHT)
DISTANCE = Area(_RIGHT, _LAST - _MAP_HEIGHT, _RIGHT_WIDTH, _MAP_HEIGHT)
INTENSITY = DISTANCE._replace(top=DISTANCE.top - _MAP_HEIGHT - TITLE_ROOM - 9)


class PanelParts(NamedTuple):
    """The area of each part on a page, None for a part that it does not have.

    Attributes:
        images: With 2D boxes, with 3D boxes, and with the scan.
        bird: The view from above.
        route: The path so far.
        maps: The scan by direction: intensity and distance.
        facts: The facts of the frame.
        classes: The number of objects of each class.
        behind: The view from behind, None if facts and classes need its room.
    """

    images: tuple[Area, Area, Area] | None
    bird: Area
    route: Area | None
    maps: tuple[Area, Area] | None
    facts: Area = _SIDE_PARTS
    classes: Area = _SIDE_PARTS
    behind: Area | None = None

    def titles(self) -> dict[Area, str]:
        """Return the title of each part."""
        names = {self.bird: "Bird's-eye view", self.facts: 'Facts', self.classes: 'Classes'}
        if self.behind:
            names[self.behind] = 'View from behind'
        if self.images:
            names |= zip(self.images, ('2D boxes', '3D boxes', 'Scan over the image'), strict=True)
        if self.route:
            names[self.route] = 'Path so far'
        if self.maps:
            titles = 'Intensity by direction, ahead in the middle', 'Distance by direction, m'
            names |= zip(self.maps, titles, strict=True)
        return names


_WITH_IMAGES = PanelParts((BOXES_2D, BOXES_3D, LIDAR), BIRD, None, (INTENSITY, DISTANCE))


def parts_of(frame: FrameData, options: PictureOptions) -> PanelParts:
    """Return the parts of the page of a frame."""
    lines = len(facts_of(frame, options)) + len(frame.missing)
    facts = _SIDE_PARTS._replace(height=min(lines, _MOST_FACTS) * _LINE)
    top = facts.top + facts.height + TITLE_ROOM + 9
    classes = facts._replace(top=top, height=_SIDE_PARTS.top + _SIDE_PARTS.height - top)
    # Room for a few more classes than this frame may have: in a film the view from behind stays.
    lines = max(_class_lines(frame), 7 if frame.predictions else 5)
    used = lines * _LINE + TITLE_ROOM + 9
    behind = classes._replace(top=classes.top + used, height=classes.height - used)
    if behind.height < _LEAST_BEHIND:
        return _parts_of(frame)._replace(facts=facts, classes=classes)
    classes = classes._replace(height=lines * _LINE)
    return _parts_of(frame)._replace(facts=facts, classes=classes, behind=behind)


def _parts_of(frame: FrameData) -> PanelParts:
    if frame.images or frame.imaged:
        return _WITH_IMAGES
    scanned = frame.points is not None or frame.scanned
    if frame.path is None:
        height = _BIRD_HEIGHT if scanned else _LAST - _FIRST
        bird = Area(EDGE, _FIRST, _LEFT_WIDTH + EDGE + _BIRD_WIDTH, height)
        wide = (
            area._replace(left=EDGE, width=SIZE[0] - 2 * EDGE) for area in (INTENSITY, DISTANCE)
        )
        intensity, distance = wide
        return PanelParts(None, bird, None, (intensity, distance) if scanned else None)
    bird = Area(EDGE, _FIRST, _LEFT_WIDTH, _LAST - _FIRST)
    route = BIRD if scanned else BIRD._replace(height=_LAST - _FIRST)
    return PanelParts(None, bird, route, (INTENSITY, DISTANCE) if scanned else None)


# The texts and numbers of a panel: the facts of a frame, and its objects by class.

_SCALE = 0.45
_VALUES = 100
"""Left edge of the values, pixels."""

_LABEL: Color = (140, 132, 126)
_VALUE: Color = (225, 221, 218)
_WARNING: Color = (96, 176, 245)
_BAR_HEIGHT = 8


def format_time(frame: FrameData) -> str | None:
    """Format the frame's time to the millisecond; None if the layout has no times."""
    return f'{format_stamp(frame.stamp_ns)[:-6]} UTC' if frame.timed else None


def facts_of(frame: FrameData, options: PictureOptions) -> list[tuple[str, str]]:
    """Return names and values of the facts of a frame."""
    facts = [] if frame.timed else [('time', 'none in this layout')]
    camera = chosen_camera(frame.images, options)
    if camera is not None and camera in frame.images:
        height, width = frame.images[camera].shape[:2]
        facts.append(('image', f'{width} x {height}, camera {camera}'))
    if frame.points is not None:
        facts.append(('points', f'{len(frame.points):,}'.replace(',', ' ')))
    cared = sum(label.class_name != DONT_CARE for label in frame.objects)
    ignored = len(frame.objects) - cared
    facts.append(('objects', f'{cared}' + (f' and {ignored} DontCare' if ignored else '')))
    if frame.predictions:
        facts.append(('predictions', f'{len(frame.predictions)}'))
    return facts + _compared(frame) + _motion(frame)


def _compared(frame: FrameData) -> list[tuple[str, str]]:
    """Return the numbers of true positives, false positives and misses."""
    matches = (
        [label.match for label in frame.objects],
        [prediction.match for prediction in frame.predictions],
    )
    missed, predicted = (Counter(match.verdict for match in group if match) for group in matches)
    if not missed and not predicted:
        return []
    right, wrong = predicted[Verdict.TRUE_POSITIVE], predicted[Verdict.FALSE_POSITIVE]
    return [('compared', f'{right} TP, {wrong} FP, {missed[Verdict.FALSE_NEGATIVE]} FN')]


def _motion(frame: FrameData) -> list[tuple[str, str]]:
    """Return the facts from the GPS/IMU, or else from the pose."""
    packet, pose = frame.packet, frame.pose
    if packet is not None:
        speed = math.hypot(packet.vn, packet.ve)
        return [
            ('speed', f'{speed:.1f} m/s, {3.6 * speed:.0f} km/h'),
            ('latitude', f'{packet.lat:.6f} deg'),
            ('longitude', f'{packet.lon:.6f} deg'),
            ('altitude', f'{packet.alt:.1f} m'),
            ('yaw', f'{math.degrees(packet.yaw):.1f} deg from east'),
        ]
    if pose is not None:
        x, y, z = (round(axis_m, 1) + 0.0 for axis_m in pose.world_T_imu.translation.tolist())
        return [('place', f'{x:.1f} {y:.1f} {z:.1f} m')]
    return []


def draw_facts(window: Pixels, frame: FrameData, options: PictureOptions) -> None:
    """Draw the facts of a frame, one line each, and its missing data."""
    width = window.shape[1]
    baseline = _LINE - 4
    for name, value in facts_of(frame, options):
        put_text(window, name, (0, baseline), _SCALE, _LABEL)
        shown = fitted(value, width - _VALUES, _SCALE)
        put_text(window, shown, (_VALUES, baseline), _SCALE, _VALUE)
        baseline += _LINE
    for name in frame.missing:
        if baseline > window.shape[0]:
            break
        text = fitted(f'not readable: {name}', width, _SCALE)
        put_text(window, text, (0, baseline), _SCALE, _WARNING)
        baseline += _LINE


def _class_lines(frame: FrameData) -> int:
    """Return the number of lines that draw_classes takes for all classes of a frame."""
    classes = {label.class_name for label in frame.objects} - {DONT_CARE}
    classes |= {prediction.class_name for prediction in frame.predictions}
    return 2 * len(classes) + 1 if frame.predictions else len(classes)


def draw_classes(window: Pixels, frame: FrameData) -> None:
    """Draw the number of objects of each class with bars, and below them the predictions."""
    counts = Counter(label.class_name for label in frame.objects if label.class_name != DONT_CARE)
    predicted = Counter(prediction.class_name for prediction in frame.predictions)
    most = max([*counts.values(), *predicted.values()], default=0)
    classes = sorted(
        {*counts, *predicted},
        key=lambda class_name: (-counts[class_name], -predicted[class_name], class_name),
    )
    height, width = window.shape[:2]
    if not classes:
        put_text(window, 'no objects', (0, _LINE - 4), _SCALE, _LABEL)
        return
    if frame.predictions:
        height -= _LINE
        text = 'second bars: predictions'
        put_text(window, text, (0, height + _LINE - 6), _SCALE, PREDICTION_BGR)
    names = width // 3
    number = extent_of('0000', _SCALE).width
    row = 2 * _LINE if frame.predictions else _LINE
    fit = max(height // row, 1)
    shown = classes if len(classes) <= fit else classes[: fit - 1]
    for index, class_name in enumerate(shown):
        baseline = index * row + _LINE - 4
        put_text(window, fitted(class_name, names - 8, _SCALE), (0, baseline), _SCALE, _VALUE)
        for line, count in enumerate((counts[class_name], predicted[class_name])[: row // _LINE]):
            bottom = baseline + line * _LINE
            length = round((width - names - number) * count / most)
            corner, end = (names, bottom - _BAR_HEIGHT), (names + length, bottom)
            if length:
                color = PREDICTION_BGR if line else class_color(class_name)
                cv2.rectangle(window, corner, end, color, cv2.FILLED)
            put_text(window, f'{count}', (end[0] + 6, bottom), _SCALE, _VALUE)
    if len(shown) < len(classes):
        text = f'and {len(classes) - len(shown)} more classes'
        put_text(window, text, (0, len(shown) * row + _LINE - 4), _SCALE, _LABEL)


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
    parts = parts_of(frame, options)
    for area, title in parts.titles().items():
        put_text(page, title, (area.left, area.top - 7), _TITLE_SCALE, _TITLE, bold=True)
        if area not in (parts.facts, parts.classes):
            cv2.rectangle(area.of(page), (0, 0), (area.width, area.height), BACKGROUND, cv2.FILLED)
    _draw_head(page, frame)
    if parts.images:
        _draw_images(page, parts.images, frame, options)
    _draw_bird(parts.bird.of(page), frame, options)
    if parts.route and frame.path is not None:
        draw_route(parts.route.of(page), frame.path)
    if parts.maps:
        _draw_maps(page, parts.maps, frame, options)
    draw_facts(parts.facts.of(page), frame, options)
    draw_classes(parts.classes.of(page), frame)
    if parts.behind:
        _draw_behind(parts.behind.of(page), frame, options)
    return page


def _draw_head(page: Pixels, frame: FrameData) -> None:
    """Draw source and frame on the left, time on the right."""
    number = f'frame {frame.number}'
    stamp = format_time(frame) or ''
    baseline = 34
    right = SIZE[0] - EDGE - extent_of(stamp, _HEAD_SCALE).width
    put_text(page, stamp, (right, baseline), _HEAD_SCALE, _QUIET)
    room = right - 4 * EDGE - extent_of(number, _HEAD_SCALE).width
    source = fitted(frame.source, room, _HEAD_SCALE, bold=True)
    put_text(page, source, (EDGE, baseline), _HEAD_SCALE, _TITLE, bold=True)
    left = EDGE + extent_of(source, _HEAD_SCALE, bold=True).width + 2 * EDGE
    put_text(page, number, (left, baseline), _HEAD_SCALE, _QUIET)


def _draw_reason(window: Pixels, frame: FrameData, error: MissingDataError) -> None:
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
            _draw_reason(area.of(page), frame, error)
        return
    height, width = shown.picture.shape[:2]
    for area, paint in zip(areas, (paint_boxes_2d, paint_boxes_3d, paint_scan), strict=True):
        left, top = (area.width - width) // 2, (area.height - height) // 2
        window = area.of(page)[top : top + height, left : left + width]
        window[:] = shown.picture
        try:
            paint(window, shown, frame, options)
        except MissingDataError as error:
            _draw_reason(area.of(page), frame, error)


def _draw_bird(window: Pixels, frame: FrameData, options: PictureOptions) -> None:
    """Draw the scan and the boxes from above."""
    try:
        window[:] = draw_bird(frame, replace(options, bird=_fill_window(options.bird, window)))
    except MissingDataError as error:
        _draw_reason(window, frame, error)


def _draw_behind(window: Pixels, frame: FrameData, options: PictureOptions) -> None:
    """Draw the scan and the boxes from behind.

    The window is small: tags have no room in it, and some of the points fill it.
    """
    points, labels = frame.points, frame.point_labels
    step = 1 if points is None else len(points) // _MOST_BEHIND + 1
    try:
        window[:] = draw_from_behind(
            replace(
                frame,
                points=None if points is None else points[::step],
                point_labels=None if labels is None else labels[::step],
            ),
            replace(options, named=False, point_size=1),
            (window.shape[1], window.shape[0]),
        )
    except MissingDataError as error:
        _draw_reason(window, frame, error)


def _fill_window(bird: BirdOptions, window: Pixels) -> BirdOptions:
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
            _draw_reason(area.of(page), frame, error)
        return
    table = color_table(options.color_map)
    kinds = (ColorBy.INTENSITY, ColorBy.DEPTH)
    for shades, area, kind in zip(maps, areas, kinds, strict=True):
        size = area.width, area.height
        large = np.asarray(cv2.resize(shades, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        cv2.copyTo(colored(large, table), large, area.of(page))
        draw_ramp(page, SCALES[kind], options.color_map, (area.left + area.width, area.top - 7))


# The table of picture modes.


@dataclass(frozen=True)
class Mode:
    """One kind of picture.

    Attributes:
        draw: Draws it from a frame; raises MissingDataError if required data is missing.
        image: True if it shows a camera image.
        others: Other streams that it shows.
        instead: Streams that it shows if there are no images.
    """

    draw: Callable[[FrameData, PictureOptions], Pixels]
    image: bool
    others: frozenset[str]
    instead: frozenset[str] = frozenset()

    def streams(
        self, cameras: Collection[int], options: PictureOptions, main: int = LABEL_CAMERA
    ) -> frozenset[str]:
        """Return the streams that RecordingFrames.frame has to read.

        Args:
            cameras: Cameras whose images the source has.
            options: Picture options.
            main: The camera that is shown by default.
        """
        camera = chosen_camera(cameras, options, main) if self.image else None
        return self.others | (self.instead if camera is None else {f'image_{camera}'})


def _on_image(paint: Painter) -> Callable[[FrameData, PictureOptions], Pixels]:
    """Return a function that paints on a copy of the camera image."""

    def draw(frame: FrameData, options: PictureOptions) -> Pixels:
        camera, image = camera_image(frame, options)
        picture: Pixels = image.copy()
        paint(picture, Shown(camera, picture), of_classes(frame, options), options)
        return picture

    return draw


_LABELS = frozenset({Stream.LABELS.value})
_SCAN = frozenset({Stream.SCAN.value})
_MOTION = frozenset({Stream.OXTS.value, Stream.POSE.value})
_PATH = frozenset({Stream.PATH.value})

MODES: Mapping[str, Mode] = {
    'camera': Mode(_on_image(paint_boxes_2d), image=True, others=_LABELS),
    'boxes': Mode(_on_image(paint_boxes_3d), image=True, others=_LABELS),
    'lidar': Mode(_on_image(paint_scan), image=True, others=_SCAN),
    'bev': Mode(draw_bird, image=False, others=_SCAN | _LABELS),
    'perspective': Mode(draw_from_behind, image=False, others=_SCAN | _LABELS),
    'panel': Mode(draw_panel, image=True, others=_SCAN | _LABELS | _MOTION, instead=_PATH),
}
