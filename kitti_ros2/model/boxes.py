# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""3D boxes: values and vectorised geometry.

A box has the form of KITTI's labels (source: readme.txt of the object devkit): the bottom
face's centre in the rectified camera 0 frame (x right, y down, z forward), height, width, length,
and rotation_y, the heading about y, 0 along +x. Its own frame has its origin in the box's middle,
x along the heading, y to its left, z up.

Corner order, (8, 3): the bottom face first, then the top face; each from front left, front right,
rear right to rear left, seen in the box's own frame. Corner i + 4 is above corner i.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, sin
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .geometry import Float64Array, Transform

if TYPE_CHECKING:
    from collections.abc import Sequence

OCCLUSIONS = ('visible', 'partly occluded', 'largely occluded', 'unknown')
"""Indexed by the number in a label file (readme.txt of the object devkit)."""

VISIBLE, UNKNOWN_OCCLUSION = 0, 3
"""Evaluations count labels with the first, and leave out those with the other."""

DONT_CARE = 'DontCare'
"""The class of image regions without labels, which have a 2D box only."""


@dataclass(frozen=True)
class Box:
    """One labelled object, as the KITTI object devkit's readme.txt defines it.

    Attributes:
        class_name: Custom names are legal.
        truncated: 0..1, or -1.
        occluded: 0 visible, 1 partly, 2 largely, 3 unknown, or -1.
        alpha: Observation angle, radians.
        box_2d: left, top, right, bottom, pixels of the image, 0-based.
        size_hwl: Height, width, length, metres; (-1, -1, -1) where there is no 3D box.
        location: Bottom face's centre x, y, z in the rectified camera 0 frame, metres.
        rotation_y: Heading about camera y, radians; 0 along +x.
        score: Detection score, None for ground truth.
        frame: File number, tracking only.
        track_id: Identity across frames, tracking only; -1 for DontCare.
    """

    class_name: str
    truncated: float
    occluded: int
    alpha: float
    box_2d: tuple[float, float, float, float]
    size_hwl: tuple[float, float, float]
    location: tuple[float, float, float]
    rotation_y: float
    score: float | None = None
    frame: int | None = None
    track_id: int | None = None


@dataclass(frozen=True, eq=False)
class Cuboid:
    """A box in ROS conventions.

    Attributes:
        class_name: Such as Car.
        identity: Unique in its frame: track id, or place in the file.
        velo_T_box: Its own frame (middle, x along the heading, y left, z up) in velo_link.
        size_lwh: Length, width, height along x, y, z, metres.
        score: Detection score, None for ground truth.
        track_id: Identity across frames, None where there is none.
        occluded: As in Box; None if it is not known.
        truncation: Level of the tracking benchmark, 0 to 2; None if it is not known.
    """

    class_name: str
    identity: str
    velo_T_box: Transform
    size_lwh: tuple[float, float, float]
    score: float | None = None
    track_id: int | None = None
    occluded: int | None = None
    truncation: int | None = None


_SIGNS = np.array(
    [
        (1, 1, -1),
        (1, -1, -1),
        (-1, -1, -1),
        (-1, 1, -1),
        (1, 1, 1),
        (1, -1, 1),
        (-1, -1, 1),
        (-1, 1, 1),
    ],
    dtype=np.float64,
)

EDGES = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)
"""(12, 2) corners that an edge joins."""

NEAR_M = 0.1
"""The depth at which a box that reaches behind the camera is cut before projection."""


def wrap_angle(angle: npt.ArrayLike) -> Float64Array:
    """Wrap angles in radians to [-pi, pi]."""
    return (np.asarray(angle, np.float64) + np.pi) % (2 * np.pi) - np.pi


def unit_corners() -> Float64Array:
    """Return the (8, 3) corners of the unit cube in its own frame, in the order given above."""
    return _SIGNS / 2


def cuboid_corners(cuboids: Sequence[Cuboid]) -> Float64Array:
    """Return the (N, 8, 3) corners of cuboids in velo_link, metres."""
    rotations = np.array([each.velo_T_box.rotation for each in cuboids]).reshape(-1, 3, 3)
    middles = np.array([each.velo_T_box.translation for each in cuboids]).reshape(-1, 1, 3)
    sizes = np.array([each.size_lwh for each in cuboids], np.float64).reshape(-1, 1, 3)
    corners: Float64Array = (_SIGNS / 2 * sizes) @ np.swapaxes(rotations, 1, 2) + middles
    return corners


def box_rotations(rotation_y: npt.ArrayLike) -> Float64Array:
    """Return (N, 3, 3) rect_R_box: columns are forward, left and up in the camera's frame."""
    angle = np.atleast_1d(np.asarray(rotation_y, np.float64))
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [[c, s, zero], [zero, zero, -one], [-s, c, zero]]
    return np.moveaxis(np.array(rows), -1, 0)


def box_corners(
    location: npt.ArrayLike, size_hwl: npt.ArrayLike, rotation_y: npt.ArrayLike
) -> Float64Array:
    """Return the (N, 8, 3) corners of (N, 3) locations, (N, 3) sizes and (N,) headings."""
    size = np.atleast_2d(np.asarray(size_hwl, np.float64))
    half_lwh = size[:, ::-1] / 2
    middle = np.atleast_2d(np.asarray(location, np.float64)) - [0.0, 1.0, 0.0] * half_lwh[:, 2:]
    offsets = _SIGNS * half_lwh[:, None, :]
    corners: Float64Array = middle[:, None, :] + offsets @ np.swapaxes(
        box_rotations(rotation_y), 1, 2
    )
    return corners


def alpha_of(location: npt.ArrayLike, rotation_y: npt.ArrayLike) -> Float64Array:
    """Return (N,) observation angles: headings relative to the ray to the box, in [-pi, pi)."""
    place = np.atleast_2d(np.asarray(location, np.float64))
    return wrap_angle(np.asarray(rotation_y) - np.arctan2(place[:, 0], place[:, 2]))


def project_corners(corners: Float64Array, p_rect: Float64Array) -> Float64Array:
    """Return (N, 4) left, top, right, bottom of the corners' projection, not clipped to the image.

    A box that reaches behind the camera is cut just in front of it; NaN for one wholly behind.

    Args:
        corners: (N, 8, 3) in the frame that p_rect projects from.
        p_rect: (3, 4).
    """
    seen = corners @ p_rect[:, :3].T + p_rect[:, 3]
    start, end = seen[:, EDGES[:, 0]], seen[:, EDGES[:, 1]]
    crossing = (start[..., 2] < NEAR_M) != (end[..., 2] < NEAR_M)
    depth = np.where(crossing, end[..., 2] - start[..., 2], 1.0)
    cut = start + ((NEAR_M - start[..., 2]) / depth)[..., None] * (end - start)
    points = np.concatenate([seen, cut], axis=1)
    valid = np.concatenate([seen[..., 2] >= NEAR_M, crossing], axis=1)
    pixels = points[..., :2] / np.where(valid, points[..., 2], 1.0)[..., None]
    low = np.where(valid[..., None], pixels, np.inf).min(axis=1)
    high = np.where(valid[..., None], pixels, -np.inf).max(axis=1)
    bounds = np.concatenate([low, high], axis=1)
    bounds[~valid.any(axis=1)] = np.nan
    return bounds


def clip_bounds(bounds: Float64Array, size: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
    """Clip bounds to the image, and return the clipped fraction of each.

    Args:
        bounds: (N, 4) left, top, right, bottom, pixels.
        size: (width, height) of the image.

    Returns:
        (N, 4) bounds within 0..width-1 and 0..height-1, NaN for a box out of view; (N,) truncation,
        0 for a box wholly in the image, 1 for one out of view.
    """
    limits = np.array([size[0] - 1, size[1] - 1] * 2, dtype=np.float64)
    cut = np.clip(bounds, 0.0, limits)
    whole = (bounds[:, 2] - bounds[:, 0]) * (bounds[:, 3] - bounds[:, 1])
    left_over = (cut[:, 2] - cut[:, 0]) * (cut[:, 3] - cut[:, 1])
    with np.errstate(invalid='ignore', divide='ignore'):
        truncation = np.clip(1.0 - left_over / whole, 0.0, 1.0)
    unseen = ~(left_over > 0)
    truncation[unseen] = 1.0
    return np.where(unseen[:, None], np.nan, cut), truncation


@np.errstate(over='ignore', invalid='ignore')  # scans and labels may hold any numbers
def count_points(cuboids: Sequence[Cuboid], points: npt.NDArray[np.float32]) -> list[int]:
    """Count the points of a scan inside each box, faces included.

    Args:
        cuboids: In velo_link.
        points: (N, 3) or (N, 4) x y z in velo_link, metres.
    """
    x, y = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
    counts = []
    for cuboid in cuboids:
        middle, half = cuboid.velo_T_box.translation, np.array(cuboid.size_lwh) / 2
        reach = np.linalg.norm(half)
        near = np.flatnonzero((np.abs(x - middle[0]) <= reach) & (np.abs(y - middle[1]) <= reach))
        offsets = cuboid.velo_T_box.inverse().apply(points[near, :3])
        counts.append(int(np.count_nonzero((np.abs(offsets) <= half).all(axis=1))))
    return counts


def is_absurd(box: Box) -> bool:
    """Whether a box has a 3D size that is invalid."""
    return has_cuboid(box) and min(box.size_hwl) <= 0


def has_cuboid(box: Box) -> bool:
    """Whether a label has a 3D box; DontCare and 2D detections have -1 for every size."""
    return box.class_name != DONT_CARE and box.size_hwl != (-1.0, -1.0, -1.0)


def cuboid_of(box: Box, identity: str, rect_T_velo: Transform) -> Cuboid:
    """Convert a label's box to velo_link with its full rotation: the same points stay inside.

    The camera and the scanner are not exactly upright to each other: the usual yaw,
    -(pi/2 + rotation_y), is this rotation without a tilt of about a degree.
    """
    height, width, length = box.size_hwl
    middle = np.array(box.location) - [0.0, height / 2, 0.0]
    rect_t_box = Transform(box_rotations(box.rotation_y)[0], middle)
    return Cuboid(
        box.class_name,
        identity,
        rect_T_velo.inverse() @ rect_t_box,
        (length, width, height),
        box.score,
        box.track_id,
    )


def box_of(
    cuboid: Cuboid, rect_T_velo: Transform
) -> tuple[Float64Array, tuple[float, float, float], float]:
    """Return (3,) location, size_hwl and rotation_y of a label; the inverse of cuboid_of."""
    rect_t_box = rect_T_velo @ cuboid.velo_T_box
    length, width, height = cuboid.size_lwh
    forward = rect_t_box.rotation[:, 0]
    location = rect_t_box.translation + np.array([0.0, height / 2, 0.0])
    return location, (height, width, length), float(np.arctan2(-forward[2], forward[0]))


def box_to_velo(
    location: npt.ArrayLike, rotation_y: float, rect_T_velo: Transform
) -> tuple[Float64Array, float]:
    """Convert a label's location and rotation_y to bottom centre and yaw in velo_link.

    A label's yaw is about the camera's y axis, a tracklet's about the scanner's z axis. The heading
    is carried over as a vector: where the two axes are parallel this is exact, and
    -(pi/2 + rotation_y) up to the small angle between the sensors.
    """
    velo_t_rect = rect_T_velo.inverse()
    heading = velo_t_rect.rotation @ np.array([cos(rotation_y), 0.0, -sin(rotation_y)])
    (centre,) = velo_t_rect.apply(np.reshape(location, (1, 3)))
    return centre, atan2(heading[1], heading[0])


def box_to_rect(
    centre: npt.ArrayLike, yaw: float, rect_T_velo: Transform
) -> tuple[Float64Array, float]:
    """Convert a bottom centre and yaw in velo_link to location and rotation_y, as box_to_velo."""
    heading = rect_T_velo.rotation @ np.array([cos(yaw), sin(yaw), 0.0])
    (location,) = rect_T_velo.apply(np.reshape(centre, (1, 3)))
    return location, atan2(-heading[2], heading[0])
