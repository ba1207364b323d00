# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Motion compensation: the points of a turn of the scanner, moved to one moment, and back."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from .geometry import Float64Array
    from .samples import Float32Array, Turn
    from .scanner_motion import ScannerMotion

_ORDER = 3  # of the terms in time; see _LARGEST_ANGLE of scanner_motion.py
_PRECISE = 1e-7  # of a turn: 10 ns, in which a car drives less than a micrometre
_MOST_STEPS = 30


class Deskew(str, Enum):
    """What was done to the scans of a recording: compensated for motion, or that undone."""

    ON = 'on'
    UNDO = 'undo'

    @property
    def state(self) -> str:
        """What the scans are then, and the option that made them so."""
        if self is Deskew.ON:
            return 'compensated for motion (--deskew)'
        return 'as measured (--undo-deskew)'


def turned(points: Float32Array) -> Float64Array:
    """Return the part of its turn at which the scanner faces each point, (N,) float64, 0..1.

    The scanner turns clockwise seen from above, from straight behind (azimuth pi) over the left,
    front and right to straight behind (-pi): time decreases with azimuth. Points without an azimuth
    (NaN) have the time of straight ahead. Sources: see kitti/turns.py; KISS-ICP's
    kitti_raw loader and CT-ICP's reader do the same.

    Args:
        points: (N, 4), measured in velo_link at different moments (not compensated for motion).
    """
    return turned_to(np.arctan2(points[:, 1], points[:, 0]))


def turned_to(azimuth: Float32Array) -> Float64Array:
    """Return the part of its turn at which the scanner faces each azimuth, as turned."""
    parts = azimuth.astype(np.float64)
    parts[np.isnan(parts)] = 0.0
    parts /= 2 * np.pi
    clipped: Float64Array = np.clip(0.5 - parts, 0.0, 1.0)
    return clipped


def compensate(points: Float32Array, turn: Turn, motion: ScannerMotion, to_ns: int) -> Float32Array:
    """Return (N, 4) points as they would have been measured at one moment.

    Args:
        points: (N, 4) in velo_link, each measured when the scanner faced it.
        turn: The turn of the scanner.
        motion: The motion of the scanner; the surroundings are taken as static.
        to_ns: The moment, nanoseconds since 1970.
    """
    return _move(points, turned(points), turn, _terms(turn, motion, to_ns))


def undo_compensation(
    points: Float32Array, turn: Turn, motion: ScannerMotion, from_ns: int
) -> Float32Array:
    """Return (N, 4) points as they were measured: the inverse of compensate.

    The time of a point follows from where it was measured, and that from its time: both are found
    by a fixed point iteration. A step reduces the error by the factor (speed / distance + rate of
    turn) length / 2 pi: it converges for points that are further away than the scanner drives in a
    sixth of a turn, 0.25 m at 15 m/s. In a right-hand bend, directions straight behind are seen
    twice, at the start and at the end: such a point may belong to either, and is taken as measured
    on the side that it is on.

    Args:
        points: (N, 4) in velo_link at from_ns.
        turn: The turn of the scanner.
        motion: The motion of the scanner.
        from_ns: The moment that the points were moved to.
    """
    terms = _terms(turn, motion, from_ns, back=True)
    parts = turned(points)
    left = _settle(points, parts, turn, terms)
    # A step across straight behind leads to the other end of the turn: these begin at either end.
    for end in (0.0, 1.0):
        own = np.full(len(left), end)
        still = _settle(points[left], own, turn, terms, end)
        found = np.setdiff1d(np.arange(len(left)), still)
        parts[left[found]] = own[found]
        left = left[still]
    return _move(points, parts, turn, terms)


def _settle(
    points: Float32Array,
    parts: Float64Array,
    turn: Turn,
    terms: Sequence[_Terms],
    end: float | None = None,
) -> npt.NDArray[np.intp]:
    """Iterate to the parts of the turn at which points were measured, in place.

    Args:
        points: (N, 4) of one moment.
        parts: (N,) to begin with.
        turn: The turn of the scanner.
        terms: The displacements back to the time of measurement.
        end: The end of the turn, 0 or 1, that steps by more than half a turn lead back to.

    Returns:
        The indices of the points that did not settle.
    """
    moving = np.arange(len(points))
    for _ in range(_MOST_STEPS):
        before = parts[moving]
        after = turned(_move(points[moving], before, turn, terms, axes=2))
        settled = np.abs(after - before) <= _PRECISE
        parts[moving] = after if end is None else np.where(np.abs(after - end) > 0.5, end, after)
        moving = moving[~settled]
        if not len(moving):
            break
    return moving


def move_rigidly(points: Float32Array, a_t_b: Float64Array) -> Float32Array:
    """Return (N, 4) points of one moment, moved by a (4, 4) transform."""
    moved: Float32Array = points.copy()
    place = _columns(points)
    with np.errstate(invalid='ignore'):
        for axis, factors in enumerate((a_t_b - np.eye(4))[:3].tolist()):
            moved[:, axis] += _affine(factors, place)
    return moved


class _Terms(NamedTuple):
    """The displacement of points in a part of the turn, a polynomial of time.

    Attributes:
        first, last: The part of the turn, 0..1.
        factors: By axis and power of the seconds since the middle of the part: those of x, y, z, 1.
    """

    first: float
    last: float
    factors: list[list[list[float]]]


def _terms(
    turn: Turn, motion: ScannerMotion, moment_ns: int, *, back: bool = False
) -> list[_Terms]:
    """Return the displacements from the time of measurement to a moment, or back."""
    found = []
    for low, high, twist in motion.pieces(turn.start_ns, turn.end_ns):
        powers = [np.eye(4)]
        for order in range(1, _ORDER + 1):
            powers.append(powers[-1] @ (-twist if back else twist) / order)
        middle_ns = turn.start_ns + round((low + high) / 2)
        if back:
            middle_t_moment = motion.relative(middle_ns, moment_ns)
            moved = [power @ middle_t_moment for power in powers]
        else:
            moment_t_middle = motion.relative(moment_ns, middle_ns)
            moved = [moment_t_middle @ power for power in powers]
        moved[0] = moved[0] - np.eye(4)
        factors = np.stack(moved, axis=1)[:3].tolist()
        found.append(_Terms(low / turn.length_ns, high / turn.length_ns, factors))
    return found


def _move(
    points: Float32Array,
    parts: Float64Array,
    turn: Turn,
    pieces: Sequence[_Terms],
    *,
    axes: int = 3,
) -> Float32Array:
    """Return the points displaced along the first axes, each by its part of the turn."""
    moved: Float32Array = points.copy()
    columns = _columns(points)
    with np.errstate(invalid='ignore'):
        for first, last, factors in pieces:
            chosen = np.flatnonzero((parts >= first) & (parts <= last))
            since_middle = (parts[chosen] - (first + last) / 2) * (turn.length_ns / NS_PER_S)
            seconds = since_middle.astype(np.float32)
            place = [column[chosen] for column in columns]
            for axis in range(axes):
                moved[chosen, axis] = place[axis] + _polynomial(factors[axis], place, seconds)
    return moved


def _polynomial(
    factors: list[list[float]], place: Sequence[Float32Array], seconds: Float32Array
) -> Float32Array:
    total = _affine(factors[-1], place)
    for each in factors[-2::-1]:
        total *= seconds
        total += _affine(each, place)
    return total


def _affine(factors: list[float], place: Sequence[Float32Array]) -> Float32Array:
    x, y, z, one = factors
    total = place[0] * x
    total += place[1] * y
    total += place[2] * z
    total += one
    return total


def _columns(points: Float32Array) -> list[Float32Array]:
    return [np.ascontiguousarray(points[:, axis]) for axis in range(3)]
