# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The texts and numbers of a panel: the facts of a frame, and its objects by class."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import cv2

from ..drawing.looks import PREDICTION_BGR, class_color
from ..drawing.text import extent_of, fitted, put_text
from ..model.boxes import DONT_CARE
from ..model.matching import Verdict
from ..model.stamps import format_stamp
from .frame_parts import chosen_camera

if TYPE_CHECKING:
    from ..drawing.pixels import Pixels
    from ..drawing.strokes import Color
    from ..options.pictures import PictureOptions
    from .frame import FrameData

_SCALE = 0.45
_LINE = 22
_VALUES = 100
"""Left edge of the values, pixels."""

_LABEL: Color = (140, 132, 126)
_VALUE: Color = (225, 221, 218)
_WARNING: Color = (96, 176, 245)
_BAR_HEIGHT = 8


def moment_of(frame: FrameData) -> str | None:
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
    cared = sum(each.class_name != DONT_CARE for each in frame.objects)
    ignored = len(frame.objects) - cared
    facts.append(('objects', f'{cared}' + (f' and {ignored} DontCare' if ignored else '')))
    if frame.predictions:
        facts.append(('predictions', f'{len(frame.predictions)}'))
    return facts + _compared(frame) + _motion(frame)


def _compared(frame: FrameData) -> list[tuple[str, str]]:
    """Return the number of predictions that are right and wrong, and of labels that none finds."""
    matches = [each.match for each in frame.objects], [each.match for each in frame.predictions]
    missed, found = (Counter(match.verdict for match in some if match) for some in matches)
    if not missed and not found:
        return []
    right, wrong = found[Verdict.TRUE_POSITIVE], found[Verdict.FALSE_POSITIVE]
    return [('compared', f'{right} TP, {wrong} FP, {missed[Verdict.FALSE_NEGATIVE]} FN')]


def _motion(frame: FrameData) -> list[tuple[str, str]]:
    """Return the facts from the GPS/IMU unit, or else from the pose."""
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
        x, y, z = (round(value, 1) + 0.0 for value in pose.world_T_imu.translation.tolist())
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


def draw_classes(window: Pixels, frame: FrameData) -> None:
    """Draw the number of objects of each class with bars, and below them the predictions."""
    counts = Counter(each.class_name for each in frame.objects if each.class_name != DONT_CARE)
    found = Counter(each.class_name for each in frame.predictions)
    most = max([*counts.values(), *found.values()], default=0)
    classes = sorted(
        {*counts, *found},
        key=lambda class_name: (-counts[class_name], -found[class_name], class_name),
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
    for place, class_name in enumerate(shown):
        baseline = place * row + _LINE - 4
        put_text(window, fitted(class_name, names - 8, _SCALE), (0, baseline), _SCALE, _VALUE)
        for line, count in enumerate((counts[class_name], found[class_name])[: row // _LINE]):
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
