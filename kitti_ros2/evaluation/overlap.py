# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Overlaps of many pairs of boxes at once: in the image, on the ground, in space.

Source: imageBoxOverlap, groundBoxOverlap and box3DOverlap in evaluate_object.cpp of the object
devkit, in float64 as there. A box on the ground is the rectangle length by width, turned by
rotation_y about the location in x and z of camera 0; a box in space has it between y - height and
y. The tilt of the camera against the ground is neglected.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import DONT_CARE
from ..model.overlaps import shared_areas_2d, signed_areas
from .object_table import pairs_by_frame

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from .object_table import ObjectTable, Pairs


class Space(str, Enum):
    """The boxes that are compared."""

    IMAGE = '2d'
    GROUND = 'bev'
    SOLID = '3d'


class Overlaps(NamedTuple):
    """Pairs that overlap by more than a limit, by label, then by detection.

    Attributes:
        label, detection: (P,) indices, as in Pairs.
        overlap: (P,) intersection over union; with a DontCare region the intersection over the
            area (volume) of the detection.
    """

    label: Int64Array
    detection: Int64Array
    overlap: Float64Array


class _Shares(NamedTuple):
    """(P,) areas or volumes of labels, of detections, and of what they have in common."""

    label: Float64Array
    detection: Float64Array
    common: Float64Array


@np.errstate(all='ignore')  # empty boxes, and numbers of any size
def find_overlaps(
    labels: ObjectTable, detections: ObjectTable, above: float
) -> Mapping[Space, Overlaps]:
    """Return the pairs of the same frame that overlap by more than a limit, in each space."""
    uncounted = labels.of_classes({DONT_CARE.lower()})
    found: dict[Space, list[Overlaps]] = {space: [] for space in Space}
    for pairs in pairs_by_frame(labels, detections):
        for space, shares in _shares(labels, detections, pairs).items():
            union = shares.detection + shares.label - shares.common
            overlap = shares.common / np.where(uncounted[pairs.label], shares.detection, union)
            kept = overlap > above
            found[space].append(Overlaps(pairs.label[kept], pairs.detection[kept], overlap[kept]))
    return {space: _joined(parts) for space, parts in found.items()}


def _joined(parts: list[Overlaps]) -> Overlaps:
    if not parts:
        return Overlaps(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    return Overlaps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _shares(labels: ObjectTable, detections: ObjectTable, pairs: Pairs) -> Mapping[Space, _Shares]:
    first, second = labels.box_2d[pairs.label], detections.box_2d[pairs.detection]
    ground = _ground_shares(labels, detections, pairs)
    heights = labels.size_hwl[pairs.label, 0], detections.size_hwl[pairs.detection, 0]
    bottoms = labels.location[pairs.label, 1], detections.location[pairs.detection, 1]
    common_height = np.minimum(*bottoms) - np.maximum(
        bottoms[0] - heights[0], bottoms[1] - heights[1]
    )
    return {
        Space.IMAGE: _Shares(
            _area(first[:, 2:] - first[:, :2]),
            _area(second[:, 2:] - second[:, :2]),
            shared_areas_2d(first, second),
        ),
        Space.GROUND: ground,
        Space.SOLID: _Shares(
            heights[0] * ground.label,
            heights[1] * ground.detection,
            ground.common * np.maximum(common_height, 0.0),
        ),
    }


def _area(sides: Float64Array) -> Float64Array:
    area: Float64Array = sides[:, 0] * sides[:, 1]
    return area


def _ground_shares(labels: ObjectTable, detections: ObjectTable, pairs: Pairs) -> _Shares:
    """Return the areas on the ground; those of far pairs have nothing in common."""
    first, second = _footprints(labels), _footprints(detections)
    reach = [np.hypot(each[:, 2], each[:, 3]) / 2 for each in (first, second)]
    apart = first[pairs.label, :2] - second[pairs.detection, :2]
    near = np.flatnonzero(np.hypot(*apart.T) < reach[0][pairs.label] + reach[1][pairs.detection])
    common = np.zeros(len(pairs.label))
    common[near] = intersect_rectangles(first[pairs.label[near]], second[pairs.detection[near]])
    areas = [np.abs(_area(each[:, 2:4])) for each in (first, second)]
    return _Shares(areas[0][pairs.label], areas[1][pairs.detection], common)


def _footprints(table: ObjectTable) -> Float64Array:
    """Return (N, 5) x, z, length, width and rotation_y."""
    columns = (table.location[:, ::2], table.size_hwl[:, :0:-1], table.rotation_y[:, None])
    return np.concatenate(columns, axis=1)


def intersect_rectangles(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return (P,) areas that pairs of turned rectangles have in common.

    Args:
        first: (P, 5) x, z, length, width, metres; angle from x towards -z, radians.
        second: The same.
    """
    half = np.abs(first[:, 2:4]).T / 2
    return np.maximum(signed_areas(half, _corners_in(first, second)), 0.0)


def _corners_in(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return (2, 4, P) corners of the second rectangles in the frames of the first ones.

    They go round clockwise, with u to the right and v up.
    """
    (x, z), turn = (second[:, :2] - first[:, :2]).T, second[:, 4] - first[:, 4]
    cos, sin = np.cos(first[:, 4]), np.sin(first[:, 4])
    along = np.array([1.0, 1.0, -1.0, -1.0])[:, None] * np.abs(second[:, 2]) / 2
    across = np.array([1.0, -1.0, -1.0, 1.0])[:, None] * np.abs(second[:, 3]) / 2
    u = cos * x - sin * z + np.cos(turn) * along + np.sin(turn) * across
    v = sin * x + cos * z - np.sin(turn) * along + np.cos(turn) * across
    return np.array([u, v])
