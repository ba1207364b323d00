# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes in velo_link -> KITTI labels.

A label's box is upright in the rectified camera 0 and turns about its y axis alone: the heading is
kept, a lean is lost. That of a tracklet is upright in velo_link. Its 2D box is the projection of
its corners clipped to the image, truncated is the part outside of the image; occluded is set by the
plan, since boxes have none. Tracklets have an occlusion and a level of truncation, which are kept.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from ..kitti.label_file import parse_box
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
from ..model.geometry import Transform
from ..model.labels import rect_from_velo

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..model.geometry import Float64Array
    from ..model.samples import Calibration

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


class Standing(NamedTuple):
    """What boxes are upright in.

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


_IN_THE_CAMERA = Standing()


def boxes_of_lines(text: str, tracks: TrackIds) -> list[Box]:
    """Parse the label lines of a frame in a bag written by to-bag; a missing track is added.

    Raises:
        ValueError: A line is not a label.
    """
    boxes = []
    for place, line in enumerate(text.splitlines()):
        try:
            box = parse_box(line)
        except ValueError as error:
            raise ValueError(f'{line!r} is no label ({error})') from None
        if box.track_id is None:
            track = -1 if box.class_name == DONT_CARE else tracks.number(f'line {place}')
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
        self._taken: set[int] = set()
        self.unnamed = 0
        """Number of boxes without a name so far."""
        self.repeated = 0
        """Number of boxes so far with the name of another one of their frame."""

    def find(self, identity: str) -> int | None:
        """Return the number of a track that has one already."""
        return self._numbers.get(identity)

    def of_frame(self, identities: Iterable[str]) -> list[int]:
        """Return the number of each box of a frame; one with the name of another is its own."""
        found: list[int] = []
        for identity in identities:
            number = self.number(identity)
            if number in found:
                self.repeated += 1
                number = max(self._taken) + 1
                self._taken.add(number)
            found.append(number)
        return found

    def number(self, identity: str) -> int:
        """Return the number of a track."""
        if identity in self._numbers:
            return self._numbers[identity]
        number = own_number(identity)
        if number is None or number in self._taken:
            number = max(self._taken, default=-1) + 1
        self._taken.add(number)
        if identity:
            self._numbers[identity] = number
        else:
            self.unnamed += 1
        return number


def leans(
    cuboids: Sequence[Cuboid], calibration: Calibration, standing: Standing = _IN_THE_CAMERA
) -> Float64Array:
    """Return (N,) radians by which boxes lean from the axis that their labels turn about.

    Raises:
        ValueError: A required part of the calibration is missing.
    """
    frame_t_velo, up = standing.of(calibration)
    found = [
        abs(frame_t_velo.rotation[1] @ _upright(each, up).velo_T_box.rotation[:, 2])
        for each in cuboids
    ]
    return np.arccos(np.clip(np.array(found, np.float64), 0.0, 1.0))


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
    turned = np.column_stack([forward, np.cross(up, forward), up])
    length, width, height = (cuboid.size_lwh[axis] for axis in order)
    velo_t_box = Transform(turned, cuboid.velo_T_box.translation)
    return replace(cuboid, velo_T_box=velo_t_box, size_lwh=(length, width, height))


def make_boxes(
    cuboids: Sequence[Cuboid],
    calibration: Calibration,
    image: ImageOf,
    tracks: TrackIds,
    *,
    out_of_view: bool = False,
    occluded: int = VISIBLE,
    standing: Standing = _IN_THE_CAMERA,
) -> tuple[list[Box], int]:
    """Make labels of boxes; also return how many were skipped because they are out of view.

    Args:
        cuboids: In velo_link.
        calibration: Contains the camera and the place of the scanner.
        image: Whose pixels the 2D boxes are.
        tracks: Gives track ids.
        out_of_view: Whether boxes out of view are kept, with a 2D box of -1.
        occluded: The occlusion of boxes of which it is not known, 0 to 3 (readme.txt of the object
            devkit).
        standing: What they are upright in.

    Raises:
        ValueError: A required part of the calibration is missing.
    """
    if not cuboids:
        return [], 0
    rect_t_velo = rect_from_velo(calibration)
    frame_t_velo, up = standing.of(calibration)
    boxes = [box_of(_upright(cuboid, up), frame_t_velo) for cuboid in cuboids]
    locations, sizes, headings = (np.array(column) for column in zip(*boxes, strict=True))
    corners = box_corners(locations, sizes, headings)
    seen_by = calibration.cameras[image.camera]
    if standing.frame_T_velo is not None:
        corners = (rect_t_velo @ frame_t_velo.inverse()).apply(corners)
    if seen_by.cam_T_velo is not None:
        corners = (seen_by.cam_T_velo @ rect_t_velo.inverse()).apply(corners)
    bounds, truncated = clip_bounds(project_corners(corners, seen_by.p_rect), image.size)
    seen = [bool(np.isfinite(four).all()) for four in bounds]
    kept = [place for place in range(len(cuboids)) if seen[place] or out_of_view]
    alphas = alpha_of(locations, headings)
    ids = tracks.of_frame(cuboids[place].identity for place in kept)
    made = [
        Box(
            class_name=class_name(cuboids[place].class_name),
            truncated=float(_known(cuboids[place].truncation, truncated[place])),
            occluded=_known(cuboids[place].occluded, occluded),
            alpha=float(alphas[place]),
            box_2d=_four(bounds[place]) if seen[place] else _UNSEEN,
            size_hwl=boxes[place][1],
            location=_three(locations[place]),
            rotation_y=float(wrap_angle(headings[place])),
            score=cuboids[place].score,
            track_id=track_id,
        )
        for place, track_id in zip(kept, ids, strict=True)
    ]
    made = [_region(box) if box.class_name == DONT_CARE else box for box in made]
    return made, len(cuboids) - len(made)


def _known(value: int | None, default: T) -> int | T:
    return default if value is None else value


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
