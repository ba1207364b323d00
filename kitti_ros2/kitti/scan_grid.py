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
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.errors import format_count

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Scan

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
_STRAIGHT_AHEAD = 5e-4
"""Of a turn: a car that climbs by 2 m/s moved points so near to straight ahead by 0.1 mm."""
_MOVED_AHEAD_MM = 0.2
_LEAST_AHEAD = 30
_SHARE_NEAR = 0.7
"""Chance gives 0.4."""
_MOST_ROUNDS = 40
_SETTLED = 1e-7
_LEAST_ANGLE = 1e-300
_POLISHES = 4
_MOST_PLACES = 1.5
_SMALL = np.float32(1e-3)
_STEPS = 4
"""The time of a point settles by a factor of 20 or more with each; faster ones need more."""
_NEWTON_STEPS = 2
_UNCERTAIN = np.array([0.2, 0.1, 0.05, 0.005, 0.005, 0.05])
"""Of a start, one sigma: a car brakes and steers, and hardly pitches or rolls."""
_STARTS = tuple(np.array([metres, 0, 0, 0, 0, 0]) for metres in (0.8, 1.4, 0.2, 2.0, 2.6, 3.2))
"""Without poses; each is near enough to what is up to 0.6 m off, in bends as well."""

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
    axes = np.ascontiguousarray(points.T)
    parts = _parts(axes)
    moved = _rotated(axes, parts, twist[3:])
    moved += parts * twist[:3, None]
    rows: Float64Array = moved.T
    return rows


def measured(points: Float64Array, twist: Float64Array, end: float | None = None) -> Float64Array:
    """Return (N, 3) compensated points as they were measured: the inverse of compensated.

    Args:
        points: (N, 3), metres.
        twist: (6,) of a turn.
        end: -0.5 or 0.5: of points straight behind, which may be of either end of a turn, this one.
    """
    axes = np.ascontiguousarray(points.T)
    before = axes
    for _ in range(_STEPS + int(np.linalg.norm(twist[:3]))):
        parts = _parts(before)
        if end is not None:
            parts += np.rint(end - parts)
        before = _rotated(axes - parts * twist[:3, None], -parts, twist[3:])
    rows: Float64Array = before.T
    return rows


def measured_near(points: Float32Array, twist: Float64Array) -> Float64Array:
    """Return (N, 3) points of the grid, metres, that compensated points near theirs are made of.

    By Newton's method, which needs fewer steps than measured: points of half a millimetre.
    """
    axes = np.ascontiguousarray(points.T, dtype=np.float64)
    velocity = twist[:3, None]
    first = parts = _parts(axes)
    for _ in range(_NEWTON_STEPS):
        before = _rotated(axes - parts * velocity, -parts, twist[3:])
        across = axes[0] * before[1] - axes[1] * before[0]
        along = axes[0] * before[0] + axes[1] * before[1]
        off = first - np.arctan(across / along) / (2 * np.pi) - parts
        slope = before[0] * twist[1] - before[1] * twist[0]
        slope /= before[0] ** 2 + before[1] ** 2
        parts = parts + off / (1 - (slope + twist[5]) / (2 * np.pi))
    before = _rotated(axes - parts * velocity, -parts, twist[3:])
    nearest: Float64Array = on_grid(before.T).astype(np.float64)
    return nearest


def _parts(axes: Float64Array) -> Float64Array:
    """Return (N,) the part of a turn from facing forward to (3, N) points, -0.5..0.5."""
    parts: Float64Array = np.arctan2(axes[1], axes[0])
    parts /= -2 * np.pi
    return parts


def _rotated(axes: Float64Array, parts: Float64Array, rotation: Float64Array) -> Float64Array:
    """Rotate (3, N) points about an axis, each by its part of an angle (Rodrigues)."""
    angle = float(np.linalg.norm(rotation)) or _LEAST_ANGLE
    angles = parts * angle
    sine, rest = np.sin(angles), 1 - np.cos(angles)
    u, v, w = (rotation / angle).tolist()
    x, y, z = axes
    along = u * x + v * y + w * z
    along *= rest
    stay = 1 - rest
    rotated: Float64Array = np.stack(
        [
            x * stay + (v * z - w * y) * sine + u * along,
            y * stay + (w * x - u * z) * sine + v * along,
            z * stay + (u * y - v * x) * sine + w * along,
        ]
    )
    return rotated


def find_measured(points: Float32Array, start: Float64Array | None = None) -> MeasuredScan | None:
    """Take a scan of odometry back to the grid.

    Args:
        points: (N, 3) or more columns, as in the file.
        start: The twist to begin with, such as 0.1 s times the velocity.

    Returns:
        The scan, None unless at least KITTI_SHARE of its points come to lie on the grid.
    """
    file = np.asarray(points[:, :3], dtype=np.float64)
    for twist in _twists(_sample(file), start):
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
    if not _may_be_moved(points):
        return None
    some = points[:: 1 + len(points) // _FEW_POINTS, :3]
    ahead = points[_is_ahead(points, _AHEAD), :3]
    ahead = ahead[:: 1 + _SHARE_AHEAD * len(ahead) // _FEW_POINTS]
    sample = np.concatenate([ahead, some]).astype(np.float64)
    return next(_twists(sample[np.isfinite(sample).all(axis=1)]), None)


def _may_be_moved(points: Float32Array) -> bool:
    """Return False for most scans that are no grid: heights straight ahead hardly moved."""
    ahead = points[_is_ahead(points, _STRAIGHT_AHEAD), 2:3]
    near = np.abs(_off_grid(ahead)) < _MOVED_AHEAD_MM
    return len(ahead) < _LEAST_AHEAD or float(near.mean()) > _SHARE_NEAR


def _is_ahead(points: Float32Array, parts: float) -> npt.NDArray[np.bool_]:
    """Return which points are nearer to straight ahead than parts of a turn."""
    ahead: npt.NDArray[np.bool_] = (
        np.abs(points[:, 1]) < np.float32(2 * np.pi * parts) * points[:, 0]
    )
    return ahead


def _twists(sample: Float64Array, start: Float64Array | None = None) -> Iterator[Float64Array]:
    """Yield the twists with which points of a sample come to lie on the grid."""
    for first in _STARTS if start is None else (start, *_STARTS):
        twist = _fit(sample, first)
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
    return before


def _sample(file: Float64Array) -> Float64Array:
    """Return the points that a twist is fitted to: those straight ahead, and some of the others."""
    finite = file[np.isfinite(file).all(axis=1)]
    ahead = np.abs(_parts(finite.T)) < _AHEAD
    others = finite[~ahead]
    return np.concatenate([finite[ahead], others[:: 1 + len(others) // _MOST_POINTS]])


def _fit(file: Float64Array, start: Float64Array) -> Float64Array:
    """Fit the twist with which points lie on the grid.

    The grid tells each coordinate up to a multiple of a millimetre. So a point is used only when
    its predicted error, by the covariance of the twist so far, is a part of that: first those
    nearly straight ahead, which hardly moved, and with each round more, up to all.
    """
    twist: Float64Array = start
    prior = np.diag(_UNCERTAIN**-2.0)
    information, count = prior, -1
    for _ in range(_MOST_ROUNDS):
        before = measured(file, twist)
        change = _changes(before)
        covariance = np.linalg.inv(information)
        by_coordinate = change.reshape(-1, 6)
        spread = (
            np.sum(np.einsum('ni,ij->nj', by_coordinate, covariance) * by_coordinate, axis=1)
            .reshape(-1, 3)
            .max(axis=1)
        )
        certain = spread < _CERTAIN_MM**2
        off = _off_grid(before)
        certain &= (np.abs(off) < _OUTLIER_MM).all(axis=1)
        rows, errors = change[certain].reshape(-1, 6), off[certain].reshape(-1)
        normal, right = _normal_equations(rows, errors)
        information = prior + normal / _NOISE_MM**2
        gradient = prior @ (start - twist) - right / _NOISE_MM**2
        step = np.linalg.solve(information, gradient)
        twist = twist + step
        if certain.sum() == count and np.abs(step).max() < _SETTLED:
            break
        count = int(certain.sum())
    return twist


def _changes(before: Float64Array) -> Float64Array:
    """Return (N, 3, 6) the change of measured points, millimetres, with that of the twist."""
    parts = _parts(before.T)
    change = np.zeros((len(before), 3, 6))
    for axis in range(3):
        change[:, axis, axis] = -parts
    x, y, z = parts * before.T
    change[:, 1, 3], change[:, 2, 3] = z, -y
    change[:, 0, 4], change[:, 2, 4] = -z, x
    change[:, 0, 5], change[:, 1, 5] = y, -x
    change *= PER_METRE
    return change


def _polish(file: Float64Array, twist: Float64Array) -> Float64Array:
    """Return the twist that best gives the float32 of a file, from its points on the grid.

    An error counts in units of its coordinate's last place.
    """
    exact = file.astype(np.float32)
    weight = 1 / np.spacing(np.maximum(np.abs(exact), _SMALL)).astype(np.float64)
    for _ in range(_POLISHES):
        before = on_grid(measured(file, twist)).astype(np.float64)
        errors = (file - compensated(before, twist)) * weight
        rows = -_changes(before) / PER_METRE * weight[:, :, None]
        good = np.abs(errors) < _MOST_PLACES
        normal, right = _normal_equations(rows[good], errors[good])
        twist = twist + np.linalg.lstsq(normal, right, rcond=None)[0]
    return twist


def _normal_equations(
    rows: Float64Array, values: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return (6, 6) and (6,) of linear equations; the threads of a BLAS would wait for these."""
    return np.einsum('ni,nj->ij', rows, rows), np.einsum('ni,n->i', rows, values)
