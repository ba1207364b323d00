# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The grid of KITTI's scans: 1 mm, and 0.01 of reflectance; also behind the scans of odometry.

Every coordinate in scans of raw and object is a multiple of 1 mm, rounded to float32. Those of
odometry are such points that KITTI compensated for motion: file = float32(R(s w) p + s v), with p
the measured point, s = -azimuth(p) / 360 degrees, and a twist of six numbers, v in metres and w in
radians of a turn of 0.1 s. Both was seen in the files (167 of 167 scans, 16 of 17 of odometry). So
the twist can be found in a scan alone: with it, its points lie on the grid.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import chain
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.errors import format_count

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Scan

    Axes = npt.NDArray[np.floating]

PER_METRE = 1000
PER_REFLECTANCE = 100
OFF_GRID_M = 20e-6
"""A point nearer to the grid is on it: float32 rounds by up to 4 um, at 100 m."""
_PER_UNIT = np.array([*[PER_METRE] * 3, PER_REFLECTANCE], np.float32)
KITTI_SHARE = 0.99
"""Of the points of a scan that must be on the grid."""
OFF_GRID_REFLECTANCE = 1e-3
"""A reflectance nearer to a multiple of 0.01 is one: codecs may round it to that."""
_SUBSET_POINTS = 500
"""Points of a scan that show most scans of other scanners to be off the grid."""

_NOISE_MM = 0.05
"""What the fit takes for rounding, of a coordinate."""
_CERTAIN_MM = 0.12
"""A point is used whose predicted error, one sigma, is less."""
_OUTLIER_MM = 0.35
_AHEAD = 0.01
"""Of a turn: all points nearer to straight ahead are used."""
_MOST_POINTS = 6000
_FEW_POINTS = 1000
"""With which a twist makes nearly as many points again as with all; fewer may fit by chance."""
_SHARE_AHEAD = 3
_STRAIGHT_AHEAD = 0.0015
"""Of a turn: the forward motion of points so near to straight ahead tells on their x alone."""
_LEAST_IN_PHASE = 0.3
"""Of the points there; chance gives 0.15."""
_MOST_STARTS = 3
"""Of synthetic scans, whose columns are an exact part of a turn apart, several speeds fit."""
_SPEEDS = np.arange(-1, 4, 0.08)
"""Metres a turn that are tried; to each belong those nearer than 0.1."""
_MOST_ROUNDS = 40
_SETTLED = 1e-6
_POLISHES = 3
_MOST_PLACES = 1.5
_SMALL = np.float32(1e-3)
_UNCERTAIN = np.array([0.2, 0.1, 0.05, 0.005, 0.005, 0.05])
"""Of a start, one sigma: a car brakes and steers, and hardly pitches or rolls."""

_STAYING = {'off': 'scan', 'points off': 'point'}
"""What was counted and is as it was, with its noun."""


class MeasuredScan(NamedTuple):
    """A scan of odometry as it was measured.

    Attributes:
        xyz: (N, 3) float32, metres, on the grid.
        twist: (6,) v (metres) and w (radians) of a turn: compensated(xyz, twist) is the file.
        share: Of its points that were nearer than OFF_GRID_M to the grid.
    """

    xyz: Float32Array
    twist: Float64Array
    share: float


def grid_share(points: npt.NDArray[np.floating]) -> float:
    """Return the part of (N, 3) points, metres, that is on the grid of 1 mm; 0 of none."""
    return float(_is_on_grid(points).mean()) if len(points) else 0.0


def _is_on_grid(points: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
    near: npt.NDArray[np.bool_] = np.abs(_off_grid(points)).max(axis=1) < OFF_GRID_M * PER_METRE
    return near


def on_grid(points: npt.NDArray[np.floating]) -> Float32Array:
    """Return the nearest points of the grid, float32, metres."""
    nearest: Float32Array = (np.rint(_scaled(points)) / PER_METRE).astype(np.float32)
    return nearest


def _scaled(points: npt.NDArray[np.floating]) -> Float64Array:
    return np.asarray(points, dtype=np.float64) * PER_METRE


def _off_grid(points: npt.NDArray[np.floating]) -> Float64Array:
    scaled = _scaled(points)
    with np.errstate(invalid='ignore'):  # of infinities
        off: Float64Array = scaled - np.rint(scaled)
    return off


class SnappedScan(NamedTuple):
    """A scan whose points are on the grid, but for the rounding of what they went through.

    Attributes:
        points: (N, 4) float32, rounded to the grid.
        off: Number of points that are not near it, and are as they were.
        reflectance: Whether reflectances were near multiples of 0.01, and are rounded to these.
    """

    points: Float32Array
    off: int
    reflectance: bool

    def differs(self, points: Float32Array) -> bool:
        """Whether the points are others, to the bit."""
        return self.points.tobytes() != points.tobytes()


def snap(points: Float32Array) -> SnappedScan | None:
    """Round the points of a scan to the grid, those that are on it already to themselves.

    Points that went through float64, another frame and back, or a codec with an error of 0.01 mm
    get KITTI's float32 back; a zero keeps the sign that it has, which then may not be KITTI's.

    Args:
        points: (N, 4) x y z reflectance.

    Returns:
        None unless more than KITTI_SHARE of the points are near the grid, and on no coarser one:
        a codec that rounds to 2 mm or 1 cm lost more than rounding gives back.
    """
    if grid_share(points[:: 1 + len(points) // _SUBSET_POINTS, :3]) < KITTI_SHARE / 2:
        return None
    with np.errstate(over='ignore'):
        exact = np.rint(points * _PER_UNIT) / _PER_UNIT
    if exact.tobytes() == points.tobytes():
        return SnappedScan(points, 0, reflectance=True)
    near = _is_on_grid(points[:, :3])
    if not near.sum() > KITTI_SHARE * len(points) or _is_coarser(points[near, :3]):
        return None
    rounded = np.ascontiguousarray(points).copy()
    rounded[near, :3] = on_grid(points[near, :3])
    scaled = points[:, 3].astype(np.float64) * PER_REFLECTANCE
    nearest = np.rint(scaled)
    valued = np.abs(scaled - nearest) < OFF_GRID_REFLECTANCE * PER_REFLECTANCE
    reflectance = bool(valued.sum() > KITTI_SHARE * len(points))
    if reflectance:
        rounded[valued, 3] = nearest[valued] / PER_REFLECTANCE
    return SnappedScan(rounded, int(np.count_nonzero(~near)), reflectance)


def _is_coarser(points: Float32Array) -> bool:
    """Return whether nearly all coordinates are multiples of 2 or 5 mm."""
    steps = np.rint(_scaled(points))
    return any(float((steps % factor == 0).mean()) > KITTI_SHARE for factor in (2, 5))


class GridTally:
    """Rounds the scans that are on KITTI's grid but for rounding to it; thread-safe.

    Args:
        enabled: Whether it does.
    """

    def __init__(self, *, enabled: bool) -> None:
        self._enabled = enabled
        self._lock = Lock()
        self._counts: Counter[str] = Counter()

    def snapped(self, scan: Scan) -> Scan:
        """Return a scan on the grid; as it is where it is not near, or exactly there already."""
        grid = snap(scan.points) if self._enabled and len(scan.points) else None
        differs = grid is not None and grid.differs(scan.points)
        with self._lock:
            self._counts['scans'] += 1
            self._counts['off'] += grid is None
            if grid is not None and differs:
                self._counts['moved'] += 1
                self._counts['points off'] += grid.off
                self._counts['reflectance'] += grid.reflectance
        return replace(scan, points=grid.points) if grid is not None and differs else scan

    def notes(self, topic: str) -> Iterator[str]:
        """Yield a note on scans that were rounded; none if none was."""
        count = self._counts
        if not count['moved']:
            return
        as_they_were = [
            format_count(count[name], noun) for name, noun in _STAYING.items() if count[name]
        ]
        scans = f'{count["moved"]} of {format_count(count["scans"], "scan")}'
        yield (
            f"{topic}: {scans} are within 0.02 mm of a grid of 1 mm, as KITTI's are exactly, and"
            f' are rounded to it (reflectances of {count["reflectance"]} to 0.01)'
            + (f'; {" and ".join(as_they_were)} off it stay as they are' if as_they_were else '')
            + '; --no-snap keeps all'
        )


def compensated(points: Float64Array, twist: Float64Array) -> Float64Array:
    """Return (N, 3) measured points as KITTI compensated them for motion, before its rounding."""
    rows: Float64Array = compensated_axes(np.ascontiguousarray(points.T), twist).T
    return rows


def compensated_axes(axes: Float64Array, twist: Float64Array) -> Float64Array:
    """Do the same with (3, N) points."""
    parts = _parts(axes)
    file: Float64Array = twist[:3, None] * parts
    file += _turns(axes, parts, twist[3:])
    file += axes
    return file


def measured(points: Float64Array, twist: Float64Array, end: float | None = None) -> Float64Array:
    """Return (N, 3) compensated points as they were measured: the inverse of compensated.

    Args:
        points: (N, 3), metres.
        twist: (6,) of a turn.
        end: -0.5 or 0.5: of points straight behind, which may be of either end of a turn, this one.
    """
    axes = np.ascontiguousarray(points.T)
    rows: Float64Array = (axes + moves_back(axes, twist, end)).T
    return rows


def moves_back(axes: Axes, twist: Float64Array, end: float | None = None) -> Axes:
    """Return (3, N) vectors from compensated points to where they were measured.

    In the dtype of the points. With float32, all machines give the same bits: angles are rounded
    from float64, and all else is sums, products and quotients.

    The unknown is the part s of a turn, by two steps of Newton's method: the first in the plane,
    where the angle between file and p is arctan(s c / (1 - s d)) - s e, the second with p itself.
    """
    with np.errstate(divide='ignore', invalid='ignore'):  # points on the axis have no direction
        x, y, z = axes
        vx, vy, _, wx, wy, wz = twist.tolist()
        velocity = twist[:3, None].astype(axes.dtype)
        file_parts = _parts(axes)
        if end is not None:
            file_parts += np.rint(end - file_parts)
        file_parts = file_parts.astype(axes.dtype, copy=False)
        far = 1 / (x * x + y * y)
        across, along = (y * vx - x * vy) * far, 1 - file_parts * ((x * vx + y * vy) * far)
        turning = wz - (x * wx + y * wy) * z * far
        tangent = file_parts * across / along
        slope = across / (along * along * (1 + tangent * tangent)) - turning
        slope /= 2 * np.pi
        slope += 1
        parts = (_arctan(tangent) - file_parts * turning) / slope
        parts /= -2 * np.pi
        parts += file_parts
        moves: Axes = -velocity * parts
        moves += _turns(axes + moves, -parts, twist[3:])
        px, py, _ = before = axes + moves
        off = file_parts - _arctan((x * py - y * px) / (x * px + y * py)) / (2 * np.pi) - parts
        off /= slope
        moves -= off * (_cross(twist[3:], before) + velocity)
        return moves


def _turns(axes: Axes, parts: Axes, rotation: Float64Array) -> Axes:
    """Return R(s w) p - p of (3, N) points, each with its part s of a rotation w.

    That is sin(s a) / a * w x p + (1 - cos(s a)) / a^2 * w x (w x p), a being the angle of w, with
    the first terms of their series: to 1e-15 for w up to 0.1, and the same on all machines.
    """
    once = _cross(rotation, axes)
    twice = _cross(rotation, once)
    squares = parts * parts
    angles = squares * float(rotation @ rotation)
    once *= parts * (1 - angles * (1 - angles * (1 - angles / 42) / 20) / 6)
    twice *= squares * (1 - angles * (1 - angles * (1 - angles / 56) / 30) / 12) / 2
    once += twice
    return once


def _parts(axes: Axes) -> Float64Array:
    """Return (N,) the part of a turn from facing forward to (3, N) points, -0.5..0.5."""
    parts: Float64Array = np.arctan2(axes[1], axes[0], dtype=np.float64)
    parts /= -2 * np.pi
    return parts


def _arctan(tangents: Axes) -> Axes:
    angles: Axes = np.arctan(tangents, dtype=np.float64).astype(tangents.dtype, copy=False)
    return angles


def _cross(vector: Float64Array, axes: Axes) -> Axes:
    """Return the cross products of a vector and (3, N) points."""
    u, v, w = vector.tolist()
    x, y, z = axes
    product = np.empty_like(axes)
    for out, first, second in zip(
        product, (v * z, w * x, u * y), (w * y, u * z, v * x), strict=True
    ):
        np.subtract(first, second, out=out)
    return product


def find_measured(points: Float32Array, start: Float64Array | None = None) -> MeasuredScan | None:
    """Take a scan of odometry back to the grid.

    Args:
        points: (N, 3) or more columns, as in the file.
        start: The twist to begin with, such as 0.1 s times the velocity.

    Returns:
        The scan, None unless at least KITTI_SHARE of its points come to lie on the grid.
    """
    file = np.asarray(points[:, :3], dtype=np.float64)
    sample = _sample(file)
    for twist in _twists(sample, chain([] if start is None else [start], _starts(sample))):
        before = _measured_on_grid(file, twist)
        share = grid_share(before)
        if share >= KITTI_SHARE:
            return MeasuredScan(on_grid(before), twist, share)
    return None


def find_twist(points: Float32Array) -> Float64Array | None:
    """Find the twist of a scan of odometry from some of its points alone.

    Args:
        points: (N, 3) or more columns, as in the file.

    Returns:
        (6,) of a turn, None if these points do not come to lie on the grid, or are too few.
    """
    if len(points) < _FEW_POINTS:
        return None
    some = points[:: 1 + len(points) // _FEW_POINTS, :3]
    ahead = points[_is_ahead(points, _AHEAD), :3].astype(np.float64)
    few = ahead[:: 1 + _SHARE_AHEAD * len(ahead) // _FEW_POINTS]
    sample = _with_azimuth(np.concatenate([few, some]))
    return next(_twists(sample, _starts(ahead)), None)


def _starts(ahead: Float64Array) -> Iterator[Float64Array]:
    """Yield the forward motion with which the x of most points straight ahead are on the grid.

    None of nearly all scans that are no grid.
    """
    points = ahead[_is_ahead(ahead, _STRAIGHT_AHEAD)]
    if not len(points):
        return
    moves = np.outer(_SPEEDS, _parts(points.T))
    in_phase = np.abs(np.exp(2j * np.pi * PER_METRE * (points[:, 0] - moves)).mean(axis=1))
    around = np.pad(in_phase, 1)
    peaks = (in_phase > np.maximum(around[:-2], around[2:])) & (in_phase > _LEAST_IN_PHASE)
    order = np.argsort(-in_phase)
    for speed in _SPEEDS[order[peaks[order]]][:_MOST_STARTS]:
        yield np.array([speed, 0, 0, 0, 0, 0])


def _is_ahead(points: npt.NDArray[np.floating], parts: float) -> npt.NDArray[np.bool_]:
    """Return which points are nearer to straight ahead than parts of a turn."""
    ahead: npt.NDArray[np.bool_] = np.abs(points[:, 1]) < 2 * np.pi * parts * points[:, 0]
    return ahead


def _twists(sample: Float64Array, starts: Iterable[Float64Array]) -> Iterator[Float64Array]:
    """Yield the twists with which points of a sample come to lie on the grid."""
    for start in starts:
        twist = _fit(sample, start)
        if grid_share(measured(sample, twist)) >= KITTI_SHARE / 2:
            yield _polish(sample, twist)


def _measured_on_grid(file: Float64Array, twist: Float64Array) -> Float64Array:
    """Return compensated points as they were measured; straight behind, at the end that fits."""
    before = measured(file, twist)
    for end in (-0.5, 0.5):
        off = np.flatnonzero(~_is_on_grid(before))
        other = measured(file[off], twist, end)
        fits = _is_on_grid(other)
        before[off[fits]] = other[fits]
    axis = ~file[:, :2].any(axis=1)
    before[axis] = file[axis]
    return before


def _sample(file: Float64Array) -> Float64Array:
    """Return the points that a twist is fitted to: those straight ahead, and some of the others."""
    finite = _with_azimuth(file)
    ahead = np.abs(_parts(finite.T)) < _AHEAD
    others = finite[~ahead]
    return np.concatenate([finite[ahead], others[:: 1 + len(others) // _MOST_POINTS]])


def _with_azimuth(points: Float64Array) -> Float64Array:
    """Return the points that are finite and off the axis of the scanner, such as no 0 0 0."""
    return points[np.isfinite(points).all(axis=1) & points[:, :2].any(axis=1)]


def _fit(file: Float64Array, start: Float64Array) -> Float64Array:
    """Fit the twist with which points lie on the grid.

    The grid tells each coordinate up to a multiple of a millimetre. So a point is used only when
    its predicted error, by the covariance of the twist so far, is a part of that: first those
    nearly straight ahead, which hardly moved, and with each round more, up to all.
    """
    twist: Float64Array = start
    prior = np.diag(_UNCERTAIN**-2.0)
    information = prior
    for _ in range(_MOST_ROUNDS):
        before = measured(file, twist)
        change = _changes(before)
        covariance = np.linalg.inv(information)
        spread = np.sum(np.einsum('ij,ian->jan', covariance, change) * change, axis=0).max(axis=0)
        off = _off_grid(before).T
        certain = (spread < _CERTAIN_MM**2) & (np.abs(off) < _OUTLIER_MM).all(axis=0)
        normal, right = _normal_equations(change * certain, off * certain)
        information = prior + normal / _NOISE_MM**2
        gradient = prior @ (start - twist) - right / _NOISE_MM**2
        step = np.linalg.solve(information, gradient)
        twist = twist + step
        if np.abs(step).max() < _SETTLED:
            break
    return twist


def _changes(before: Float64Array) -> Float64Array:
    """Return (6, 3, N) the change of measured coordinates, millimetres, with that of the twist."""
    parts = -PER_METRE * _parts(before.T)
    change = np.zeros((6, 3, len(before)))
    for axis in range(3):
        change[axis, axis] = parts
    x, y, z = parts * before.T
    change[3, 1], change[3, 2] = -z, y
    change[4, 0], change[4, 2] = z, -x
    change[5, 0], change[5, 1] = -y, x
    return change


def _polish(file: Float64Array, twist: Float64Array) -> Float64Array:
    """Return the twist that best gives the float32 of a file, from its points on the grid.

    An error counts in units of its coordinate's last place.
    """
    exact = np.ascontiguousarray(file.T).astype(np.float32)
    weight = 1 / np.spacing(np.maximum(np.abs(exact), _SMALL)).astype(np.float64)
    for _ in range(_POLISHES):
        before = on_grid(measured(file, twist)).astype(np.float64)
        errors = (file - compensated(before, twist)).T * weight
        rows = _changes(before) * (-weight / PER_METRE)
        good = np.abs(errors) < _MOST_PLACES
        normal, right = _normal_equations(rows * good, errors * good)
        twist = twist + np.linalg.lstsq(normal, right, rcond=None)[0]
    return twist


def _normal_equations(
    rows: Float64Array, values: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return (6, 6) and (6,) of (6, 3, N) linear equations; a BLAS would wait for its threads."""
    rows, values = rows.reshape(len(rows), -1), values.reshape(-1)
    return np.einsum('in,jn->ij', rows, rows), np.einsum('in,n->i', rows, values)
