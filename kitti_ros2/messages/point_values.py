# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The values of a scan's points for the fields of clouds: lasers, times, angles, labels."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.semantic import OTHER_COLOR, SEMANTIC_COLORS
from ..model.motion import turned_to
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Turn

LASERS = 64
MOST_LASERS = 128
_UPPER, _LOWER = (2.0, 3.0), (-8.83, 2.0)  # degrees of the highest laser, lasers a degree
_HALF = 32  # lasers of each block
_MOST_NS = 2**32 - 1

_COLOR_TABLE = np.full(1 << 16, OTHER_COLOR, dtype=np.uint32)
_COLOR_TABLE.put(list(SEMANTIC_COLORS), list(SEMANTIC_COLORS.values()))


class PointValues:
    """The values of N points by the names of model.cloud_formats.VALUES, each (N,) or a number.

    Args:
        points: (N, 4) float32.
        turn: When each direction was scanned; None if all points are of one moment.
        stamp_ns: The cloud's stamp.
        labels: (N,) SemanticKITTI labels, if they are in the cloud.
    """

    return_type = 1
    ambient = 0

    def __init__(
        self,
        points: Float32Array,
        turn: Turn | None,
        stamp_ns: int,
        labels: npt.NDArray[np.uint32] | None = None,
    ) -> None:
        self._turn = turn
        self._stamp_ns = stamp_ns
        self._labels = np.empty(0, np.uint32) if labels is None else labels
        self.x, self.y, self.z, self.reflectance = points.T

    @cached_property
    def _azimuth(self) -> Float32Array:
        azimuth: Float32Array = np.arctan2(self.y, self.x)
        return azimuth

    @cached_property
    def part(self) -> Float64Array:
        """The part of the turn at which the scanner faces each point, 0..1."""
        return turned_to(self._azimuth)

    @cached_property
    def laser(self) -> npt.NDArray[np.uint16]:
        """The laser, 0 the lowest; estimated from the elevation if they cannot be counted."""
        if not self.is_ordered:
            return _nominal_lasers(self.elevation)
        return self._counted.astype(np.uint16)

    @property
    def is_ordered(self) -> bool:
        """Whether the points are in the order of the lasers, as in KITTI's files."""
        return bool(self._counted.max(initial=0) < MOST_LASERS)

    @cached_property
    def _counted(self) -> npt.NDArray[np.int64]:
        return _count_lasers(self._azimuth)

    @property
    def is_timed(self) -> bool:
        """Whether the points have times."""
        return self._turn is not None

    @property
    def rows(self) -> int:
        """The rows of a grid with one for each laser: 64, or 128 if there are more lasers."""
        return LASERS if self.laser.max(initial=0) < LASERS else MOST_LASERS

    @cached_property
    def row(self) -> npt.NDArray[np.uint16]:
        """The laser, 0 the highest of the rows."""
        rows: npt.NDArray[np.uint16] = np.uint16(self.rows - 1) - self.laser
        return rows

    @cached_property
    def seconds(self) -> Float32Array:
        """Seconds from the stamp."""
        return (self._since_ns(self.part) / NS_PER_S).astype(np.float32)

    @cached_property
    def nanoseconds(self) -> npt.NDArray[np.uint32]:
        """Nanoseconds since the stamp; 0 before it, and of points that are all of one moment."""
        return self.nanoseconds_of(self.part)

    def nanoseconds_of(self, parts: Float64Array) -> npt.NDArray[np.uint32]:
        """Return nanoseconds since the stamp of parts of the turn."""
        return np.rint(np.clip(self._since_ns(parts), 0, _MOST_NS)).astype(np.uint32)

    def _since_ns(self, parts: Float64Array) -> Float64Array:
        if self._turn is None:
            return np.zeros(len(parts))
        return parts * self._turn.length_ns + (self._turn.start_ns - self._stamp_ns)

    @property
    def file_index(self) -> npt.NDArray[np.int64]:
        """The index in the file."""
        return np.arange(len(self.x))

    @cached_property
    def brightness(self) -> npt.NDArray[np.uint8]:
        """Reflectance in steps of 1/255; KITTI's two digits can be restored from it."""
        scaled = np.clip(np.nan_to_num(self.reflectance), 0, 1) * np.float32(255)
        brightness: npt.NDArray[np.uint8] = np.rint(scaled).astype(np.uint8)
        return brightness

    @property
    def azimuth(self) -> Float32Array:
        """The angle from x, clockwise seen from above as the scanner turns, 0 to 2 pi."""
        whole = np.float32(2 * np.pi)
        return np.where(self._azimuth > 0, whole - self._azimuth, np.abs(self._azimuth))

    @cached_property
    def elevation(self) -> Float32Array:
        """The angle above the plane of x and y."""
        elevation: Float32Array = np.arctan2(self.z, self._across)
        return elevation

    @cached_property
    def distance(self) -> Float32Array:
        """The distance from the scanner."""
        distance: Float32Array = np.hypot(self._across, self.z)
        return distance

    @cached_property
    def _across(self) -> Float32Array:
        across: Float32Array = np.hypot(self.x, self.y)
        return across

    @property
    def millimetres(self) -> npt.NDArray[np.uint32]:
        """The distance in millimetres, 0 where it is not a number."""
        scaled = np.nan_to_num(self.distance.astype(np.float64) * 1000, posinf=_MOST_NS)
        return np.rint(np.minimum(scaled, _MOST_NS)).astype(np.uint32)

    @property
    def label_class(self) -> npt.NDArray[np.uint16]:
        """The class of the label."""
        return (self._labels & 0xFFFF).astype(np.uint16)

    @property
    def label_instance(self) -> npt.NDArray[np.uint16]:
        """The instance of the label."""
        return (self._labels >> 16).astype(np.uint16)

    @property
    def label_color(self) -> Float32Array:
        """The colour of the class."""
        return packed_colors(self.label_class)


def rings(points: Float32Array) -> npt.NDArray[np.uint16]:
    """Return the laser of each point, (N,) uint16, 0 the lowest.

    KITTI's files contain the lasers one after the other, top to bottom, the points of each sorted
    by rising azimuth from straight ahead (against the direction in which the scanner turns): a
    laser begins where the azimuth wraps from below 2 pi to 0. The count is correct if every laser
    has returns near the front.
    """
    return _count_lasers(np.arctan2(points[:, 1], points[:, 0])).astype(np.uint16)


def _count_lasers(azimuth: Float32Array) -> npt.NDArray[np.int64]:
    wraps = (azimuth[:-1] < 0) & (azimuth[1:] >= 0) & (azimuth[:-1] - azimuth[1:] > -np.pi)
    row = np.concatenate([[0], np.cumsum(wraps)]) if len(azimuth) else np.empty(0, np.int64)
    lowest = row[-1] if len(row) else 0
    found: npt.NDArray[np.int64] = lowest - row
    return found


def _nominal_lasers(elevation: Float32Array) -> npt.NDArray[np.uint16]:
    """Return the laser by the nominal angles of an HDL-64E, 0 the lowest.

    Two blocks of 32: three lasers a degree from +2, two a degree from -8.83 (the same rule as in
    A-LOAM, src/scanRegistration.cpp). In KITTI's scans it is right to about two lasers.
    """
    degrees = np.degrees(np.nan_to_num(elevation))
    upper, lower = (np.rint((first - degrees) * dense) for first, dense in (_UPPER, _LOWER))
    from_top = np.where(degrees > _LOWER[0] + 0.25, np.clip(upper, 0, _HALF - 1), lower + _HALF)
    return (LASERS - 1 - np.clip(from_top, 0, LASERS - 1)).astype(np.uint16)


def packed_colors(classes: npt.NDArray[np.uint16]) -> npt.NDArray[np.float32]:
    """Return (N,) float32 with the bits 0x00RRGGBB, the format of the field rgb in PCL and RViz."""
    return _COLOR_TABLE[classes].view(np.float32)
