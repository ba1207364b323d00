# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the files of a frame together: labels against calibration, image and scan.

Limits, from tracking 0000 (711 boxes) and object 000000..2 (6 boxes): projected 3D boxes overlap
their 2D boxes with an IoU of 0.52 at least, alpha is within 0.09 rad of rotation_y and the ray, 2D
boxes are inside the image. KITTI's principal points are within 4 % of the image's middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import (
    alpha_of,
    box_corners,
    clip_bounds,
    has_cuboid,
    project_corners,
    wrap_angle,
)
from ..model.labels import rect_from_velo
from ..model.overlaps import ious_2d
from .places import places_of_boxes, places_of_cuboids, places_without_points
from .rule import Breach, Rule, RuleScope, RuleSeverity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration, Float32Array
    from .label_rules import LabelLine
    from .places import BoxInScan

Size = tuple[int, int]
_LEAST_IOU = 0.3
_ALPHA_RAD = 0.2
_BEYOND_PX = 2.0
_MIDDLE = 0.25  # of the image's size
_FARTHEST_LABEL_M = 1000.0  # labels beyond have a finding of their own, and overflow
_LABELLED_CAMERA = 2
_NEAR_M = 40.0


@dataclass(frozen=True, eq=False)
class FrameFiles:
    """The parsed files of a frame, but for its scan.

    Attributes:
        number: Of the frame.
        calibration: Of the frame.
        sizes: (width, height) of its images, by camera.
        calibration_path, label_path: The files.
        lines: The labels.
        cuboids: Those of tracklets, in velo_link.
    """

    number: int
    calibration: Calibration
    sizes: Mapping[int, tuple[int, int]]
    calibration_path: Path
    label_path: Path
    lines: Sequence[LabelLine] = ()
    cuboids: Sequence[Cuboid] = ()

    @cached_property
    def solid(self) -> list[LabelLine]:
        """The labels with a valid 3D box."""
        return [
            each
            for each in self.lines
            if has_cuboid(each.box)
            and min(each.box.size_hwl) > 0
            and max(map(abs, (*each.box.location, *each.box.size_hwl))) < _FARTHEST_LABEL_M
        ]

    @property
    def p_rect(self) -> Float64Array | None:
        """The projection of the camera that labels refer to."""
        camera = self.calibration.cameras.get(_LABELLED_CAMERA)
        is_usable = camera is not None and not self.calibration.independent_cameras
        return camera.p_rect if is_usable and camera is not None else None


class NearBox(NamedTuple):
    """A 3D box that is visible and near the scanner.

    Attributes:
        name: Its class; of a tracklet also its identity.
        line: Of the label file, from 1; None for a tracklet.
        place: Its place.
    """

    name: str
    line: int | None
    place: BoxInScan


@dataclass(frozen=True, eq=False)
class LabelledScan:
    """A frame with the points of its scan, (N, 4), and the boxes near the scanner."""

    frame: FrameFiles
    points: Float32Array
    boxes: Sequence[NearBox]


def near_boxes(frames: Sequence[FrameFiles]) -> dict[int, list[NearBox]]:
    """Return the boxes that are visible and near, by frame: numpy takes them all at once."""
    known = [
        (frame, velo_t_rect)
        for frame in frames
        if (velo_t_rect := _velo_from_rect(frame.calibration)) is not None
    ]
    labels = [
        (frame.number, each, velo_t_rect)
        for frame, velo_t_rect in known
        for each in frame.solid
        if each.box.occluded <= 0
    ]
    cuboids = [(frame.number, each) for frame, _ in known for each in frame.cuboids]
    named: list[tuple[int, str, int | None]] = [
        *((number, box.class_name, line) for number, (line, box), _ in labels),
        *((number, f'{each.class_name} {each.identity}', None) for number, each in cuboids),
    ]
    places = [
        *places_of_boxes([each.box for _, each, _ in labels], [each for *_, each in labels]),
        *places_of_cuboids([each for _, each in cuboids]),
    ]
    near: dict[int, list[NearBox]] = {}
    for (number, name, line), place in zip(named, places, strict=True):
        if place.distance < _NEAR_M:
            near.setdefault(number, []).append(NearBox(name, line, place))
    return near


def _find_projection(frames: Sequence[FrameFiles]) -> Iterator[Breach]:
    groups: dict[tuple[int, Size], list[FrameFiles]] = {}
    for frame in frames:
        size = frame.sizes.get(_LABELLED_CAMERA)
        if frame.solid and frame.p_rect is not None and size is not None:
            groups.setdefault((id(frame.p_rect), size), []).append(frame)
    for (_, size), alike in groups.items():
        p_rect = alike[0].p_rect
        if p_rect is not None:
            yield from _find_apart(alike, p_rect, size)


def _find_apart(frames: Sequence[FrameFiles], p_rect: Float64Array, size: Size) -> Iterator[Breach]:
    """Find 3D boxes away from their 2D boxes, in frames of one projection."""
    solid = [(frame.label_path, each) for frame in frames for each in frame.solid]
    boxes = [each.box for _, each in solid]
    corners = box_corners(
        [box.location for box in boxes],
        [box.size_hwl for box in boxes],
        [box.rotation_y for box in boxes],
    )
    bounds, _ = clip_bounds(project_corners(corners, p_rect), size)
    overlaps = ious_2d(bounds, np.array([box.box_2d for box in boxes]).reshape(-1, 4)).tolist()
    for (path, (line, box)), overlap in zip(solid, overlaps, strict=True):
        left, top, right, bottom = box.box_2d
        if right > left and bottom > top and overlap < _LEAST_IOU:
            text = (
                f'{box.class_name}: the projected 3D box overlaps the 2D box by {overlap:.2f} (IoU)'
            )
            yield Breach(text, path, line)


def _find_alpha(frames: Sequence[FrameFiles]) -> Iterator[Breach]:
    known = [
        (frame.label_path, each)
        for frame in frames
        if not frame.calibration.independent_cameras
        for each in frame.solid
        if each.box.alpha != -10
    ]
    if not known:
        return
    boxes = [each.box for _, each in known]
    expected = alpha_of([box.location for box in boxes], [box.rotation_y for box in boxes])
    off = wrap_angle(np.array([box.alpha for box in boxes]) - expected)
    for index in np.flatnonzero(np.abs(off) > _ALPHA_RAD).tolist():
        path, (line, box) = known[index]
        angle = f'{expected[index]:.2f}'
        text = f'{box.class_name}: alpha is {box.alpha:g}; location and rotation_y make {angle}'
        yield Breach(text, path, line)


def _find_outside(frame: FrameFiles) -> Iterator[Breach]:
    size = frame.sizes.get(_LABELLED_CAMERA)
    if size is None:
        return
    width, height = size
    for line, box in frame.lines:
        left, top, right, bottom = box.box_2d
        beyond = max(-left, -top, right - (width - 1), bottom - (height - 1))
        if beyond > _BEYOND_PX:
            numbers = ' '.join(f'{value:g}' for value in box.box_2d)
            text = f'{box.class_name}: the 2D box {numbers} leaves the image, {width}x{height}'
            yield Breach(text, frame.label_path, line)


@lru_cache(maxsize=64)
def _velo_from_rect(calibration: Calibration) -> Transform | None:
    """Return velo_T_rect; None without it."""
    try:
        return rect_from_velo(calibration).inverse()
    except ValueError:
        return None


def _find_unscanned(scan: LabelledScan) -> Iterator[Breach]:
    for index in places_without_points(scan.points, [each.place for each in scan.boxes]):
        name, line, place = scan.boxes[index]
        text = f'frame {scan.frame.number}: {name} at {place.distance:.0f} m'
        yield Breach(f'{text}: no point of the scan is inside', scan.frame.label_path, line)


def _find_off_middle(frame: FrameFiles) -> Iterator[Breach]:
    for index, (width, height) in frame.sizes.items():
        camera = frame.calibration.cameras.get(index)
        if camera is None:
            continue
        x, y = float(camera.p_rect[0, 2]), float(camera.p_rect[1, 2])
        if abs(x / width - 0.5) > _MIDDLE or abs(y / height - 0.5) > _MIDDLE:
            text = f'P{index}: the principal point {x:.0f} {y:.0f} is far from the middle of images'
            yield Breach(f'{text} of {width}x{height}', frame.calibration_path)


_FRAME, _WARNING = RuleScope.FRAME, RuleSeverity.WARNING

LABEL_FRAME_RULES: tuple[Rule[Sequence[FrameFiles]], ...] = (
    Rule(
        'label-projection',
        _WARNING,
        _FRAME,
        '3D boxes, projected by P2, overlap their 2D boxes (IoU of 0.3 at least)',
        'check that calibration and labels are of this frame, and the order of the columns',
        _find_projection,
    ),
    Rule(
        'label-alpha',
        _WARNING,
        _FRAME,
        'alpha is rotation_y less the direction to the object, to 0.2 rad',
        'compute alpha = rotation_y - atan2(x, z)',
        _find_alpha,
    ),
)
"""Rules that see several frames at once: numpy takes as long for one as for ten."""
SCAN_FRAME_RULES: tuple[Rule[LabelledScan], ...] = (
    Rule(
        'label-points',
        RuleSeverity.NOTE,
        _FRAME,
        'Points of the scan are inside each 3D box that is visible and within 40 m',
        'usual for some objects; if most are listed, check the calibration',
        _find_unscanned,
    ),
)
FRAME_RULES: tuple[Rule[FrameFiles], ...] = (
    Rule(
        'label-outside',
        _WARNING,
        _FRAME,
        '2D boxes are inside the image of camera 2',
        'clip the box; check that the image was not resized or cropped',
        _find_outside,
    ),
    Rule(
        'calib-image',
        _WARNING,
        _FRAME,
        'Principal points are near the middle of the image',
        'give the calibration of these images; scale it if they were resized',
        _find_off_middle,
    ),
)
