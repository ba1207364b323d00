# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic scanner and GPS/IMU unit, and the labels of what the cameras see."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, ceil, floor, hypot, pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import Box, alpha_of, box_to_rect, clip_bounds, project_corners
from ..model.streams import NS_PER_S
from .scene import CAR_T_VELO, ROAD_CENTRE, ROAD_LEFT, ROAD_RIGHT, SCANNER_HEIGHT

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Float32Array, Int64Array
    from .render import Canvas
    from .scene import Course, PlacedSolid


# The synthetic scanner: 64 rows ray-cast against the ground and upright boxes.
#
# A ray leaves the scanner's origin along (cos az, sin az, tan el) and is measured by its horizontal
# range. So a box's four walls depend on the column alone and its top and bottom on the
# row alone, so the slab test is one line a column and one comparison a ray.

ELEVATIONS = np.radians(
    np.concatenate([np.linspace(2.0, -8.33, 32), np.linspace(-8.87, -24.8, 32)])
)
"""Elevations of the 64 rows, top to bottom, radians: the upper half denser, as on an HDL-64E."""

MAX_RANGE = 120.0
_TANGENTS = np.tan(ELEVATIONS)
_GROUND = -1
_GROUND_RANGES: Float64Array = np.array(
    [-SCANNER_HEIGHT / tangent if tangent < 0 else np.inf for tangent in _TANGENTS]
)


def cast_scan(
    placed: Sequence[PlacedSolid], columns: int
) -> tuple[Float64Array, npt.NDArray[np.int64]]:
    """Cast every ray.

    Args:
        placed: The boxes, in velo_link.
        columns: Rays a row; column c looks at azimuth (c + 1/2) / columns of a turn.

    Returns:
        (64, columns) horizontal range in metres, infinite for a miss; and the index into placed of
        the box hit, -1 for the ground.
    """
    ranges = np.repeat(_GROUND_RANGES[:, None], columns, axis=1)
    hits = np.full(ranges.shape, _GROUND, dtype=np.int64)
    for index, one in enumerate(placed):
        for part in _column_slices(one, columns):
            azimuths = column_azimuths(columns)[part]
            nearer = _cast_box(one, azimuths)
            closer = nearer < ranges[:, part]
            np.copyto(ranges[:, part], nearer, where=closer)
            np.copyto(hits[:, part], index, where=closer)
    return ranges, hits


def column_azimuths(columns: int) -> Float64Array:
    """Return (columns,) azimuths in radians, counter-clockwise from just left of straight ahead."""
    azimuths: Float64Array = (np.arange(columns, dtype=np.float64) + 0.5) * (2 * pi / columns)
    return azimuths


def scan_points(
    ranges: Float64Array, reflectance: Float64Array, noise: Float64Array | None
) -> Float32Array:
    """Return (N, 4) float32 points in KITTI's order: by row, each from straight ahead to the left.

    Rays without a return within range are left out.

    Args:
        ranges: (64, columns) horizontal range, metres.
        reflectance: (64, columns), 0..1.
        noise: (64, columns), added to the slant range, metres, or None.
    """
    slant = np.sqrt(1 + _TANGENTS * _TANGENTS)[:, None]
    kept = ranges * slant <= MAX_RANGE
    if noise is not None:
        ranges = ranges + noise / slant
    azimuths = column_azimuths(ranges.shape[1])
    with np.errstate(invalid='ignore'):
        stacked = (
            ranges * np.cos(azimuths),
            ranges * np.sin(azimuths),
            ranges * _TANGENTS[:, None],
            np.clip(reflectance, 0.0, 0.99).round(2),
        )
    return np.stack([values[kept] for values in stacked], axis=1).astype(np.float32)


def ground_reflectance(
    ranges: Float64Array, street_T_velo: Transform, course: Course
) -> Float64Array:
    """Return the (rows, columns) reflectance of the ground: asphalt, paint, pavement."""
    azimuths = column_azimuths(ranges.shape[1])
    reached = np.where(np.isfinite(ranges), ranges, 0.0)
    rotation, origin = street_T_velo.rotation, street_T_velo.translation
    cosines, sines = np.cos(azimuths), np.sin(azimuths)
    x = origin[0] + reached * (rotation[0, 0] * cosines + rotation[0, 1] * sines)
    y = origin[1] + reached * (rotation[1, 0] * cosines + rotation[1, 1] * sines)
    across = y - course.y_array(x)
    on_road = (across > ROAD_RIGHT) & (across < ROAD_LEFT)
    dashed = (np.abs(across - ROAD_CENTRE) < 0.08) & (x % 12 < 6)
    reflectance: Float64Array = np.where(dashed, 0.7, np.where(on_road, 0.2, 0.35))
    return reflectance


def _column_slices(one: PlacedSolid, columns: int) -> list[slice]:
    """Return the columns that can see a box: two slices if it covers straight ahead."""
    middle = atan2(one.centre[1], one.centre[0])
    corners = [
        (atan2(y, x) - middle + pi) % (2 * pi) - pi
        for x, y in one.footprint()
    ]  # fmt: skip
    per_radian = columns / (2 * pi)
    first = floor((middle + min(corners)) * per_radian - 0.5)
    last = ceil((middle + max(corners)) * per_radian - 0.5) + 1
    if last - first >= columns:
        return [slice(0, columns)]
    first, last = first % columns, (last - 1) % columns + 1
    if first < last:
        return [slice(first, last)]
    return [slice(first, columns), slice(0, last)]


def _cast_box(one: PlacedSolid, azimuths: Float64Array) -> Float64Array:
    """Return the (64, len(azimuths)) horizontal range to a box, infinite for a miss."""
    enter, leave = _cast_walls(one, azimuths)
    low = one.centre[2]
    high = low + one.solid.size[2]
    tangents = _TANGENTS[:, None]
    at_wall = tangents * enter
    hit = np.where((low <= at_wall) & (at_wall <= high), enter, np.inf)
    with np.errstate(divide='ignore', invalid='ignore'):
        for lid, passes in ((high, at_wall > high), (low, at_wall < low)):
            at_lid = lid / tangents
            reached = passes & (at_lid > enter) & (at_lid <= leave)
            hit = np.where(reached, at_lid, hit)
    return np.where(enter <= leave, hit, np.inf)


def _cast_walls(one: PlacedSolid, azimuths: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return, by azimuth, the ranges at which a ray enters and leaves a box's footprint."""
    x, y, _ = one.centre
    distance, bearing = hypot(x, y), atan2(y, x) - one.yaw
    enter = np.zeros(len(azimuths))
    leave = np.full(len(azimuths), np.inf)
    along = (np.cos(azimuths - one.yaw), np.cos(bearing), one.solid.size[0] / 2)
    across = (np.sin(azimuths - one.yaw), np.sin(bearing), one.solid.size[1] / 2)
    with np.errstate(divide='ignore'):
        for direction, centre, half in (along, across):
            one_side = (centre * distance - half) / direction
            other_side = (centre * distance + half) / direction
            enter = np.maximum(enter, np.minimum(one_side, other_side))
            leave = np.minimum(leave, np.maximum(one_side, other_side))
    return enter, leave


# Points as a scanner measures them that turns while the car drives.
#
# The exact scan is a snapshot at the moment of facing forward. Each of its points is measured at
# the moment at which the moving scanner faces it: clockwise seen from above, from the rear to the
# rear.

_KNOTS = 201
_ROUNDS = 40
_SETTLED_S = 1e-9
_KITTI_TURN_S = 0.1


def measure(
    points: Float32Array, course: Course, forward_s: float, half_turn_s: float
) -> Float32Array:
    """Return the points as measured, those that the scanner faces, in their order.

    Args:
        points: (N, 4) of a snapshot at forward_s, velo_link.
        course: The motion of the car.
        forward_s: The moment of facing forward, seconds.
        half_turn_s: Half the length of a turn, seconds.
    """
    knots = np.linspace(-2 * half_turn_s, 2 * half_turn_s, _KNOTS) + forward_s
    poses = np.array([_pose(course, time) for time in knots.tolist()]).T
    x, y = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    forward_x, forward_y, forward_yaw = _pose(course, forward_s)
    c, s = np.cos(forward_yaw), np.sin(forward_yaw)
    street_x, street_y = forward_x + c * x - s * y, forward_y + s * x + c * y
    times = np.full(len(points), forward_s)
    before = times.copy()
    changing = np.arange(len(points))
    for _ in range(_ROUNDS):
        at_x, at_y, yaw = (np.interp(times[changing], knots, column) for column in poses)
        c, s = np.cos(yaw), np.sin(yaw)
        away_x, away_y = street_x[changing] - at_x, street_y[changing] - at_y
        x[changing] = c * away_x + s * away_y
        y[changing] = c * away_y - s * away_x
        before[changing] = times[changing]
        times[changing] = forward_s - np.arctan2(y[changing], x[changing]) / np.pi * half_turn_s
        changing = changing[times[changing] != before[changing]]
    measured = points.copy()
    measured[:, 0], measured[:, 1] = x, y
    settled: Float32Array = measured[np.abs(times - before) < _SETTLED_S]
    return settled


def kitti_twist(course: Course, forward_s: float) -> Float64Array:
    """Return (6,) the motion of 0.1 s, metres and radians, with which KITTI compensates a scan."""
    before, after = (_pose(course, forward_s + side * _KITTI_TURN_S / 2) for side in (-1, 1))
    (x, y, turned), yaw = np.subtract(after, before), _pose(course, forward_s)[2]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * x + s * y, c * y - s * x, 0.0, 0.0, 0.0, turned])


def _pose(course: Course, time: float) -> tuple[float, float, float]:
    """Return x, y and yaw of the scanner in the street frame."""
    car_x = course.ego_x(time)
    yaw = course.yaw(car_x)
    ahead: Float64Array = CAR_T_VELO.translation
    return (
        car_x + float(ahead[0] * np.cos(yaw)),
        course.y(car_x) + float(ahead[0] * np.sin(yaw)),
        yaw,
    )


# The synthetic GPS/IMU unit at 100 Hz, with the irregularities of KITTI's unsynchronised drives.
#
# A packet is exact at its own time; its stamp is the time of its arrival, some microseconds off,
# and seldom milliseconds late. Some packets are missing, and some come twice, with the same stamps;
# see kitti/extract_oxts.py for those of KITTI.

PERIOD_NS = 10_000_000
BEFORE_AND_AFTER_NS = 500_000_000
"""How long the unsynchronised drive begins before the first frame, and ends after the last."""

_JITTER_NS = 20_000
_LATE_SHARE = 0.005
_LATE_NS = (1_000_000, 4_000_000)
_SECONDS_PER_GAP = 8.0
_MISSING = (2, 13)  # packets, excluding the upper end
_SECONDS_PER_REPEAT = 1.5
_REPEATED = 6  # packets, as in KITTI


class Arrivals(NamedTuple):
    """The packets in the order of arrival, which is that of their file numbers.

    Attributes:
        times_ns: (N,) int64, the moments at which they are exact.
        stamps_ns: (N,) int64.
    """

    times_ns: Int64Array
    stamps_ns: Int64Array


def list_arrivals(seed: int, first_ns: int, last_ns: int) -> Arrivals:
    """Return the packets of a drive between the stamps of its first and its last frame."""
    rng = np.random.default_rng([seed, 9])
    begin_ns = first_ns - BEFORE_AND_AFTER_NS
    count = (last_ns + BEFORE_AND_AFTER_NS - begin_ns) // PERIOD_NS + 1
    times_ns = begin_ns + np.arange(count, dtype=np.int64) * PERIOD_NS
    late = np.where(rng.random(count) < _LATE_SHARE, rng.uniform(*_LATE_NS, count), 0.0)
    stamps_ns = times_ns + np.rint(rng.normal(0.0, _JITTER_NS, count) + late).astype(np.int64)
    order = _order_of_arrival(rng, int(count))
    return Arrivals(times_ns[order], stamps_ns[order])


def _order_of_arrival(rng: np.random.Generator, count: int) -> Int64Array:
    """Return the packets that arrive, some of them twice; there is always a gap and a repeat."""
    seconds = count * PERIOD_NS / NS_PER_S
    kept = np.ones(count, np.bool_)
    for start in rng.integers(count // 3, count, max(1, int(seconds / _SECONDS_PER_GAP))):
        kept[start : start + int(rng.integers(*_MISSING))] = False
    arriving = np.flatnonzero(kept)
    repeats = max(1, int(seconds / _SECONDS_PER_REPEAT))
    ends = rng.integers(_REPEATED, len(arriving), repeats)
    packets, begun = [], 0
    for end in np.unique(ends).tolist():
        packets += [arriving[begun:end], arriving[end - _REPEATED : end]]
        begun = end
    return np.concatenate([*packets, arriving[begun:]])


# Labels of the objects that the synthetic cameras see, in the manner of KITTI's annotators.

FARTHEST = 80.0
LEAST_VISIBLE = 0.05
MOST_TRUNCATED = 0.9
_LEAST_PIXELS = 4
_OCCLUDED = ((0.8, 0), (0.4, 1), (0.0, 2))
"""(visible fraction, occlusion level): the level of a fraction above this one."""


def label_solids(
    placed: Sequence[PlacedSolid],
    canvas: Canvas,
    p_rect: Float64Array,
    rect_T_velo: Transform,
    frame: int,
) -> list[Box]:
    """Return the boxes of the objects that a camera sees, by track id.

    Args:
        placed: The drawn boxes, in velo_link.
        canvas: The drawing, with the visible pixels of each object.
        p_rect: (3, 4), rectified camera 0 to this camera's pixels.
        rect_T_velo: velo_link to the rectified camera 0.
        frame: File number.
    """
    visible = np.bincount(canvas.ids.ravel(), minlength=len(placed) + 1)[1:]
    boxes = []
    for index, one in enumerate(placed):
        covered = int(canvas.covered[index])
        if one.solid.class_name is None or covered < _LEAST_PIXELS:
            continue
        part = int(visible[index]) / covered
        if part >= LEAST_VISIBLE:
            box = _label(one, part, (p_rect, canvas.ids.shape), rect_T_velo, frame)
            if box is not None:
                boxes.append(box)
    return sorted(boxes, key=lambda box: box.track_id or 0)


def box_solids(
    placed: Sequence[PlacedSolid], hits: Int64Array, rect_T_velo: Transform, frame: int
) -> list[Box]:
    """Return the boxes of the objects that the scanner sees, whatever the cameras do, by track id.

    Args:
        placed: The boxes, in velo_link.
        hits: Indices in placed of what rays hit, or -1.
        rect_T_velo: velo_link to the rectified camera 0.
        frame: File number.
    """
    hit = [placed[index] for index in np.unique(hits).tolist() if index >= 0]
    boxes = [_place(one, rect_T_velo, frame) for one in hit if one.solid.class_name is not None]
    return sorted(boxes, key=lambda box: box.track_id or 0)


def _place(one: PlacedSolid, rect_T_velo: Transform, frame: int) -> Box:
    """Return the box of a solid, unseen by any camera."""
    (x, y, z), rotation_y = box_to_rect(one.centre, one.yaw, rect_T_velo)
    length, width, height = one.solid.size
    return Box(
        class_name=str(one.solid.class_name),
        truncated=-1.0,
        occluded=-1,
        alpha=float(alpha_of((x, y, z), rotation_y)[0]),
        box_2d=(-1.0, -1.0, -1.0, -1.0),
        size_hwl=(height, width, length),
        location=(float(x), float(y), float(z)),
        rotation_y=rotation_y,
        frame=frame,
        track_id=one.solid.track_id,
    )


def box_corners(one: PlacedSolid) -> Float64Array:
    """Return the (8, 3) corners of a solid in velo_link, the bottom four, then the top four."""
    footprint = np.array(one.footprint())
    low = one.centre[2]
    levels = (low, low + one.solid.size[2])
    return np.concatenate([np.column_stack([footprint, np.full(4, level)]) for level in levels])


def _label(
    one: PlacedSolid,
    visible: float,
    camera: tuple[Float64Array, tuple[int, ...]],
    rect_T_velo: Transform,
    frame: int,
) -> Box | None:
    """Return the box of a solid, None if it is too far or hardly in the image."""
    p_rect, (height, width) = camera
    bounds = project_corners(rect_T_velo.apply(box_corners(one))[None], p_rect)
    cut, truncation = clip_bounds(bounds, (width, height))
    truncated = float(truncation[0])
    box = _place(one, rect_T_velo, frame)
    if not 0 < box.location[2] < FARTHEST or truncated > MOST_TRUNCATED:
        return None
    left, top, right, bottom = cut[0].tolist()
    return replace(
        box,
        truncated=truncated,
        occluded=next(level for least, level in _OCCLUDED if visible >= least),
        box_2d=(left, top, right, bottom),
    )
