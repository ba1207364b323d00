# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes in velo_link -> KITTI's labels: their classes, their 2D boxes, each object once."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from ..kitti.label_file import parse_box
from ..messages.naming import RECORDING
from ..messages.rectified_cameras import rectify_pixels
from ..messages.topics import own_topics
from ..model.boxes import (
    DONT_CARE,
    VISIBLE,
    Box,
    Cuboid,
    alpha_of,
    box_corners,
    box_of,
    clip_bounds,
    project_corners,
    wrap_angle,
)
from ..model.classes import OTHERS, kitti_class, plain
from ..model.errors import one_line, some_of
from ..model.geometry import Transform
from ..model.samples import rect_from_velo

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from ..messages.camera_info import CameraModel
    from ..messages.detections import ImageBox
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration
    from .plan import LabelPlan
    from .survey import Survey


# Boxes in velo_link -> KITTI labels.
#
# A label's box is upright in the rectified camera 0 and turns about its y axis alone: the heading
# is kept, a lean is lost. That of a tracklet is upright in velo_link. Its 2D box is the projection
# of its corners clipped to the image, truncated is the part outside of the image; occluded is set
# by the plan, since boxes have none. Tracklets have an occlusion and a level of truncation, which
# are kept.

T = TypeVar('T')

OUT_OF_VIEW = 'out of view'

_OTHERS = 'Misc'
_UNSEEN = (-1.0, -1.0, -1.0, -1.0)
_BLANKS = re.compile(r'\s+')
_LONGEST_NUMBER = 9  # ids of markers are int32


class ImageOf(NamedTuple):
    """An image with boxes.

    Attributes:
        camera: KITTI index.
        size: (width, height) of the rectified image.
    """

    camera: int
    size: tuple[int, int]


class UprightFrame(NamedTuple):
    """The frame in which boxes are upright.

    Attributes:
        frame_T_velo: velo_link in the frame of the labels, which turn about its y axis; None for
            the rectified camera 0.
        velo_up: (3,) up in velo_link; None for that of the frame.
    """

    frame_T_velo: Transform | None = None
    velo_up: Float64Array | None = None

    def of(self, calibration: Calibration) -> tuple[Transform, Float64Array]:
        """Return both for a calibration.

        Raises:
            ValueError: A required part of the calibration is missing.
        """
        frame_t_velo = self.frame_T_velo or rect_from_velo(calibration)
        up = -frame_t_velo.rotation[1] if self.velo_up is None else self.velo_up
        return frame_t_velo, up


_IN_CAMERA = UprightFrame()


def boxes_of_lines(text: str, tracks: TrackIds) -> list[Box]:
    """Parse the label lines of a frame in a bag written by to-bag; a missing track is added.

    Raises:
        ValueError: A line is not a label.
    """
    boxes = []
    for number, line in enumerate(text.splitlines()):
        try:
            box = parse_box(line)
        except ValueError as error:
            raise ValueError(f'{line!r} is no label ({error})') from None
        if box.track_id is None:
            track = -1 if box.class_name == DONT_CARE else tracks.number(f'line {number}')
            box = replace(box, track_id=track)
        boxes.append(replace(box, frame=None))
    return boxes


def own_number(identity: str) -> int | None:
    """Parse a track's name that is a number, also after a namespace (box/7); None for a word."""
    word = identity.rpartition('/')[2]
    return int(word) if word.isdecimal() and len(word) <= _LONGEST_NUMBER else None


class TrackIds:
    """Assigns a stable integer to each name of a track.

    A number is kept unless another name took it before, also one after a namespace (box/7); a word
    gets the next free number; each box without a name is a track of its own.
    """

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._used: set[int] = set()
        self.unnamed = 0
        """Number of boxes without a name so far."""
        self.repeated = 0
        """Number of boxes so far with the name of another one of their frame."""

    def find(self, identity: str) -> int | None:
        """Return the number of a track that has one already."""
        return self._numbers.get(identity)

    def of_frame(self, identities: Iterable[str]) -> list[int]:
        """Return the number of each box of a frame; one with the name of another is its own."""
        numbers: list[int] = []
        for identity in identities:
            number = self.number(identity)
            if number in numbers:
                self.repeated += 1
                number = max(self._used) + 1
                self._used.add(number)
            numbers.append(number)
        return numbers

    def number(self, identity: str) -> int:
        """Return the number of a track."""
        if identity in self._numbers:
            return self._numbers[identity]
        number = own_number(identity)
        if number is None or number in self._used:
            number = max(self._used, default=-1) + 1
        self._used.add(number)
        if identity:
            self._numbers[identity] = number
        else:
            self.unnamed += 1
        return number


def lean_angles(
    cuboids: Sequence[Cuboid], calibration: Calibration, upright: UprightFrame = _IN_CAMERA
) -> Float64Array:
    """Return (N,) radians by which boxes lean from the axis that their labels turn about.

    Raises:
        ValueError: A required part of the calibration is missing.
    """
    frame_t_velo, up = upright.of(calibration)
    cosines = [
        abs(frame_t_velo.rotation[1] @ _upright(cuboid, up).velo_T_box.rotation[:, 2])
        for cuboid in cuboids
    ]
    return np.arccos(np.clip(np.array(cosines, np.float64), 0.0, 1.0))


def _upright(cuboid: Cuboid, velo_up: Float64Array) -> Cuboid:
    """Reorder the axes of a box so that z points up or down.

    Its x axis stays the heading unless that is the vertical one.

    Args:
        cuboid: In velo_link.
        velo_up: (3,) up in velo_link.
    """
    rotation = cuboid.velo_T_box.rotation
    vertical = int(np.argmax(np.abs(velo_up @ rotation)))
    if vertical == 2:
        return cuboid
    order = (1, 2, 0) if vertical == 0 else (0, 2, 1)
    forward, up = rotation[:, order[0]], rotation[:, vertical]
    rotation_upright = np.column_stack([forward, np.cross(up, forward), up])
    length, width, height = (cuboid.size_lwh[axis] for axis in order)
    velo_t_box = Transform(rotation_upright, cuboid.velo_T_box.translation)
    return replace(cuboid, velo_T_box=velo_t_box, size_lwh=(length, width, height))


def make_boxes(
    cuboids: Sequence[Cuboid],
    calibration: Calibration,
    image: ImageOf,
    tracks: TrackIds,
    *,
    out_of_view: bool = False,
    occluded: int = VISIBLE,
    upright: UprightFrame = _IN_CAMERA,
) -> tuple[list[Box], int]:
    """Make labels of boxes; also return how many were skipped because they are out of view.

    Args:
        cuboids: In velo_link.
        calibration: Contains the camera and the pose of the scanner.
        image: Whose pixels the 2D boxes are.
        tracks: Gives track ids.
        out_of_view: Whether boxes out of view are kept, with a 2D box of -1.
        occluded: The occlusion of boxes of which it is not known, 0 to 3 (readme.txt of the object
            devkit).
        upright: The frame that they are upright in.

    Raises:
        ValueError: A required part of the calibration is missing.
    """
    if not cuboids:
        return [], 0
    rect_t_velo = rect_from_velo(calibration)
    frame_t_velo, up = upright.of(calibration)
    boxes = [box_of(_upright(cuboid, up), frame_t_velo) for cuboid in cuboids]
    locations, sizes, headings = (np.array(column) for column in zip(*boxes, strict=True))
    corners = box_corners(locations, sizes, headings)
    seen_by = calibration.cameras[image.camera]
    if upright.frame_T_velo is not None:
        corners = (rect_t_velo @ frame_t_velo.inverse()).apply(corners)
    if seen_by.cam_T_velo is not None:
        corners = (seen_by.cam_T_velo @ rect_t_velo.inverse()).apply(corners)
    bounds, truncated = clip_bounds(project_corners(corners, seen_by.p_rect), image.size)
    seen = [bool(np.isfinite(four).all()) for four in bounds]
    kept_indices = [index for index in range(len(cuboids)) if seen[index] or out_of_view]
    alphas = alpha_of(locations, headings)
    ids = tracks.of_frame(cuboids[index].identity for index in kept_indices)
    labels = [
        Box(
            class_name=class_name(cuboids[index].class_name),
            truncated=float(_or_default(cuboids[index].truncation, truncated[index])),
            occluded=_or_default(cuboids[index].occluded, occluded),
            alpha=float(alphas[index]),
            box_2d=_four(bounds[index]) if seen[index] else _UNSEEN,
            size_hwl=boxes[index][1],
            location=_three(locations[index]),
            rotation_y=float(wrap_angle(headings[index])),
            score=cuboids[index].score,
            track_id=track_id,
        )
        for index, track_id in zip(kept_indices, ids, strict=True)
    ]
    labels = [_region(box) if box.class_name == DONT_CARE else box for box in labels]
    return labels, len(cuboids) - len(labels)


def _or_default(level: int | None, default: T) -> int | T:
    return default if level is None else level


def _region(box: Box) -> Box:
    """Return a box of DontCare, as KITTI's files have it: a region of the image alone."""
    return replace(
        box,
        truncated=-1.0,
        occluded=-1,
        alpha=-10.0,
        size_hwl=(-1.0, -1.0, -1.0),
        location=(-1000.0, -1000.0, -1000.0),
        rotation_y=-10.0,
        track_id=-1,
    )


def class_name(kind: str) -> str:
    """Format a class as a word of a label line: blanks become underscores, an empty one Misc."""
    return _BLANKS.sub('_', kind.strip()) or _OTHERS


def _three(values: Float64Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _four(values: Float64Array) -> tuple[float, float, float, float]:
    left, top, right, bottom = (float(value) for value in values)
    return left, top, right, bottom


# The classes of a bag's boxes as those of KITTI's labels, by a plan.

_SHOWN = 12


class LabelClasses:
    """Maps classes, counts those that become Misc, and finds entries of the plan without a box.

    The plan's classes come first, then the defaults (model/classes.py). Boxes of to-bag have
    KITTI's classes already, or those of the user's own labels: they have no defaults.
    """

    def __init__(self, plan: LabelPlan, *, own: bool) -> None:
        self._topic = plan.topic
        self._by_name = plan.classes
        self._by_word = {plain(name): kind for name, kind in plan.classes.items()}
        self._keeps = plan.keep_classes
        self._own = own
        self._others: Counter[str] = Counter()
        self._unmatched = {
            name for name, kind in plan.classes.items() if kind != (kitti_class(name) or OTHERS)
        }

    def find(self, name: str) -> str:
        """Return the class of a label for that of a box."""
        word = plain(name)
        planned_class = self._by_name.get(name) or self._by_word.get(word or name)
        if planned_class is not None and self._unmatched:
            self._unmatched = {
                other for other in self._unmatched if other != name and plain(other) != word
            }
        if self._own and planned_class is None:
            return class_name(name)
        default_class = kitti_class(name)
        label_class = planned_class or default_class or OTHERS
        if label_class != OTHERS or default_class == OTHERS:
            return label_class
        if self._keeps:
            return class_name(name)
        self._others[name.strip() or 'no class'] += 1
        return label_class

    def notes(self) -> list[str]:
        """Return notes on the boxes so far that became Misc, and on classes without a box."""
        notes = others_note(self._topic, self._others, 'were written')
        if self._unmatched:
            names = some_of([one_line(name) for name in sorted(self._unmatched)], _SHOWN)
            notes.append(f'{self._topic}: no box is of these labels.classes of the plan: {names}')
        return notes


def others_note(topic: str, others: Mapping[str, int], done: str) -> list[str]:
    """Return a note on boxes without a class of KITTI, none without such boxes."""
    if not others:
        return []
    ordered = sorted(others.items(), key=lambda name_count: (-name_count[1], name_count[0]))
    names = some_of([f'{one_line(name)} ({count})' for name, count in ordered], _SHOWN)
    note = (
        f'{topic}: {sum(others.values())} boxes {done} as {OTHERS}: {names}; labels.classes of the'
        f' plan maps them, labels.keep_classes: true keeps their names'
    )
    return [note]


def is_own(survey: Survey, topic: str) -> bool:
    """Return whether a topic was written by to-bag, with KITTI's classes; not of KITTI-360."""
    own = RECORDING in survey.topics and topic in own_topics()
    return own and not survey.kitti_360_camera


def default_classes(names: Iterable[str]) -> dict[str, str]:
    """Return KITTI's class of each name that is another, Misc for unknown ones."""
    classes = {name: kitti_class(name) or OTHERS for name in sorted(names) if name.strip()}
    return {name: kind for name, kind in classes.items() if name != kind}


def others_of(names: Mapping[str, int]) -> dict[str, int]:
    """Return the names without a class of KITTI, with their counts."""
    return {name: count for name, count in names.items() if kitti_class(name) is None}


# 2D boxes of a detector in the image -> the 2D columns of labels.
#
# A 2D box belongs to the 3D box with its id, else to the one whose projection it covers best. What
# is left becomes a label without a 3D box, as the readme.txt of the object devkit has it: size -1,
# location -1000, angles -10.

_LEAST_OVERLAP = 0.5
_SIDES = np.linspace(0.0, 1.0, 9)
_NO_SIZE = (-1.0, -1.0, -1.0)
_NO_LOCATION = (-1000.0, -1000.0, -1000.0)
_NO_ANGLE = -10.0


def join_boxes(
    boxes: Sequence[Box],
    flat: Sequence[ImageBox],
    size: tuple[int, int],
    tracks: TrackIds,
    *,
    occluded: int,
    scores: bool,
) -> tuple[list[Box], int]:
    """Return labels with the 2D boxes of a detector; also how many of these are out of the image.

    Args:
        boxes: Labels by 3D boxes; those without a 2D box of their own keep the projection.
        flat: Boxes in the pixels of the labels' camera.
        size: (width, height) of its image.
        tracks: Gives track ids, and those of the 3D boxes.
        occluded: The occlusion of labels without a 3D box.
        scores: Whether labels have scores.
    """
    if not flat:
        return list(boxes), 0
    bounds, truncated = clip_bounds(np.array([image_box.box_2d for image_box in flat]), size)
    seen = np.flatnonzero(np.isfinite(bounds).all(axis=1)).tolist()
    pairs = _pairs(boxes, flat, bounds, seen, tracks)
    labels = list(boxes)
    for index, (box, number) in enumerate(zip(boxes, pairs, strict=True)):
        if number is not None:
            labels[index] = replace(box, box_2d=_four(bounds[number]))
    for number in sorted(set(seen) - set(pairs)):
        image_box = flat[number]
        labels.append(
            Box(
                class_name=class_name(image_box.class_name),
                truncated=float(truncated[number]),
                occluded=occluded,
                alpha=_NO_ANGLE,
                box_2d=_four(bounds[number]),
                size_hwl=_NO_SIZE,
                location=_NO_LOCATION,
                rotation_y=_NO_ANGLE,
                score=(1.0 if image_box.score is None else image_box.score) if scores else None,
                track_id=tracks.number(image_box.identity),
            )
        )
    return labels, len(flat) - len(seen)


def rectified_boxes(flat: Sequence[ImageBox], camera: CameraModel) -> list[ImageBox]:
    """Return the boxes around the sides of boxes in unrectified pixels, in rectified ones."""
    boxes = []
    for box in flat:
        left, top, right, bottom = box.box_2d
        x, y = left + _SIDES * (right - left), top + _SIDES * (bottom - top)
        flat_x, flat_y = np.full_like(x, 1.0), np.full_like(y, 1.0)
        sides = [(x, flat_y * top), (x, flat_y * bottom), (flat_x * left, y), (flat_x * right, y)]
        moved = rectify_pixels(np.vstack([np.column_stack(side) for side in sides]), camera)
        boxes.append(box._replace(box_2d=_four(np.ravel([moved.min(axis=0), moved.max(axis=0)]))))
    return boxes


def _pairs(
    boxes: Sequence[Box],
    flat: Sequence[ImageBox],
    bounds: Float64Array,
    seen: Sequence[int],
    tracks: TrackIds,
) -> list[int | None]:
    """Return for each label the number of its 2D box: by id, then by overlap, the largest first."""
    pairs: list[int | None] = [None] * len(boxes)
    free = set(seen)
    by_track = {box.track_id: index for index, box in enumerate(boxes)}
    for number in sorted(free):
        track = tracks.find(flat[number].identity)
        index = by_track.get(track) if track is not None else None
        if index is not None and pairs[index] is None:
            pairs[index] = number
            free.discard(number)
    overlaps = sorted(
        (
            (overlap_of(boxes[index].box_2d, bounds[number]), index, number)
            for index in range(len(boxes))
            for number in free
        ),
        key=lambda pair: (-pair[0], pair[1], pair[2]),
    )
    for overlap, index, number in overlaps:
        if overlap >= _LEAST_OVERLAP and pairs[index] is None and number in free:
            pairs[index] = number
            free.discard(number)
    return pairs


def overlap_of(first: Sequence[float], second: Sequence[float] | Float64Array) -> float:
    """Return the intersection over union of two boxes, 0 where one is empty."""
    across = min(first[2], second[2]) - max(first[0], second[0])
    down = min(first[3], second[3]) - max(first[1], second[1])
    common = max(across, 0.0) * max(down, 0.0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (first, second)]
    union = sum(areas) - common
    return float(common / union) if common and union > 0 else 0.0


# Boxes of several messages of one stamp -> each object once.
#
# Several detectors may share a topic, and then each has boxes of its own. But recorders write
# messages twice, trackers send a stamp again, and detectors see one object where views overlap.

if TYPE_CHECKING:
    _Box = TypeVar('_Box')

REPEATED = 'that another message of their stamp has, too,'

_SAME_OVERLAP = 0.7


def join_cuboids(messages: Sequence[Sequence[Cuboid]]) -> tuple[list[Cuboid], list[str]]:
    """Return the boxes of all messages, and REPEATED for each that an earlier message has.

    These have its class, and are nearer to it than half of its shortest side.
    """
    return _join(messages, _is_same)


def join_image_boxes(messages: Sequence[Sequence[ImageBox]]) -> tuple[list[ImageBox], list[str]]:
    """Return the boxes of all messages, and REPEATED for each that an earlier message has.

    These have its class and its camera, and cover it nearly.
    """
    return _join(messages, _is_same_2d)


def _join(
    messages: Sequence[Sequence[_Box]], is_same: Callable[[_Box, _Box], bool]
) -> tuple[list[_Box], list[str]]:
    unique: list[_Box] = []
    count = sum(map(len, messages))
    for boxes in messages:
        earlier = list(unique)
        unique += [box for box in boxes if not any(is_same(first, box) for first in earlier)]
    return unique, [REPEATED] * (count - len(unique))


def _is_same(first: Cuboid, second: Cuboid) -> bool:
    away = first.velo_T_box.translation - second.velo_T_box.translation
    near = float(np.linalg.norm(away)) < min(first.size_lwh) / 2
    return near and first.class_name == second.class_name


def _is_same_2d(first: ImageBox, second: ImageBox) -> bool:
    alike = (first.class_name, first.frame) == (second.class_name, second.frame)
    return alike and overlap_of(first.box_2d, second.box_2d) >= _SAME_OVERLAP
