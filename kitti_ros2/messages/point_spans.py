# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The time of the first and last point of each turn, of clouds, Livox' messages, packets and rings.

Drivers agree neither on the field nor on its unit: t (Ouster, uint32 nanoseconds), time (Velodyne,
float32 seconds), timestamp (Hesai and RoboSense, float64 seconds since 1970; Livox, nanoseconds),
time_stamp (Autoware, uint32 nanoseconds), offset_time (Livox, uint32 nanoseconds), offset_ns
(Argoverse 2). A turn lasts 0.05 to 0.2 s, so that the span of the values tells their unit; once it
is known, a part of a turn or several turns in one message have their times, too. The
points of a CustomMsg have nanoseconds from its timebase, which is its stamp; the packets of a
VelodyneScan each have a stamp; a LaserScan has that of its first ray, and seconds between rays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.stamps import NS_PER_S, from_sec_nanosec
from .clouds import read_field
from .header import stamp_ns_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from .ros_types import PointCloud2

_FIELDS = (
    't',
    'time',
    'timestamp',
    'time_stamp',
    'timeStamp',
    'offset_time',
    'time_offset',
    'offset_ns',
    'timeOffset',
    'ts',
)
_UNITS_NS = (1_000_000_000, 1_000_000, 1_000, 1)
_LEAST_SPAN_NS = 15_000_000
_MOST_SPAN_NS = 350_000_000
_LEAST_PART_NS, _MOST_TURNS_NS = 1_000_000, NS_PER_S
"""The same where the unit is known: a part of a turn, or several of a slow scanner."""


class TurnTimes:
    """Reads when the first and last points of a topic's messages were measured, in their order."""

    def __init__(self) -> None:
        self._unit_ns = 0  # of the times of points in clouds, once a whole turn has told it

    def span_ns(self, message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
        """Return the times of the first and last point, nanoseconds from the stamp.

        Args:
            message: A PointCloud2, CustomMsg of Livox, VelodyneScan or LaserScan.

        Returns:
            None where its definition has no times, or where they are not those of a turn.
        """
        own = {
            'timebase': livox_span_ns,
            'packets': packet_span_ns,
            'time_increment': ray_span_ns,
            'fields': self._points_ns,
        }
        found = next((span_ns for name, span_ns in own.items() if hasattr(message, name)), None)
        try:
            return None if found is None else found(message)
        except (AttributeError, TypeError, ValueError):  # forks define fields without, or otherwise
            return None

    def _points_ns(self, cloud: PointCloud2) -> tuple[int, int] | None:
        unit_ns, span_ns = _timed_points(cloud, self._unit_ns)
        self._unit_ns = unit_ns
        return span_ns


def has_times(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether a message of a type that scans are made from may have times of its points."""
    fields = getattr(message, 'fields', None)
    return fields is None or time_field(message) is not None


def time_field(cloud: PointCloud2) -> str | None:
    """Return the name of the field with the times of a cloud's points, None without one."""
    names = {field.name for field in cloud.fields}
    return next((name for name in _FIELDS if name in names), None)


def point_span_ns(cloud: PointCloud2) -> tuple[int, int] | None:
    """Return the times of the first and last point of a cloud, nanoseconds from its stamp.

    None if it has no such field, or if the times are not those of a turn around the stamp.
    """
    return _timed_points(cloud, 0)[1]


def tells_another_time(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether the points of a cloud have times that differ, and are not those of a turn."""
    if not hasattr(message, 'fields') or point_span_ns(message) is not None:
        return False
    limits = _least_and_greatest(message)
    return limits is not None and limits[0] < limits[1]


def _timed_points(cloud: PointCloud2, unit_ns: int) -> tuple[int, tuple[int, int] | None]:
    """Return the unit of the times of points, and their span; see point_span_ns.

    Args:
        cloud: Any.
        unit_ns: Of the times, 0 where only a whole turn tells it.
    """
    limits = _least_and_greatest(cloud)
    if limits is None:
        return unit_ns, None
    lowest, highest = limits
    farthest_ns = _MOST_TURNS_NS if unit_ns else _MOST_SPAN_NS
    for unit in (unit_ns,) if unit_ns else _UNITS_NS:
        lasts = (highest - lowest) * unit
        if not (unit_ns or _LEAST_SPAN_NS <= lasts <= _MOST_SPAN_NS):
            continue
        start = round(lowest * unit)
        if abs(start) > farthest_ns:  # since 1970, or since the scanner started
            start -= stamp_ns_of(cloud.header)
        if unit_ns:
            return unit, _near(start, start + round(lasts))
        span = _turn(start, start + round(lasts))
        return (0 if span is None else unit), span
    return unit_ns, None


def _least_and_greatest(cloud: PointCloud2) -> tuple[float, float] | None:
    """Return the least and the greatest time of the returns of a cloud, None without any."""
    name, names = time_field(cloud), {field.name for field in cloud.fields}
    if name is None or not {'x', 'y', 'z'} <= names or not cloud.width * cloud.height:
        return None
    try:
        values = read_field(cloud, name)[_is_return(cloud)]
    except ValueError:
        return None
    if values.dtype.kind == 'f':
        values = values[np.isfinite(values)]
    if not len(values):
        return None
    return values.min().item(), values.max().item()


def livox_span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the times of the first and last point of a CustomMsg, nanoseconds from its stamp.

    None if they are not those of a turn.
    """
    times = [each.offset_time for each in message.points if each.x or each.y or each.z]
    if not times:
        return None
    later = int(message.timebase) - stamp_ns_of(message.header)
    start = min(times) + (later if abs(later) <= _MOST_SPAN_NS else 0)  # else of another clock
    return _near(start, start + max(times) - min(times))


def packet_span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the times of the first and last packet of a VelodyneScan, nanoseconds from its stamp.

    The driver stamps packets when they arrive, and the message as its last packet, or its first.
    None if they are not those of a turn.
    """
    scan_ns = stamp_ns_of(message.header)
    times = [
        from_sec_nanosec(each.stamp.sec, each.stamp.nanosec) - scan_ns for each in message.packets
    ]
    return _near(min(times, default=0), max(times, default=0))


def ray_span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the times of the first and last ray of a LaserScan, nanoseconds from its stamp.

    None if they are not those of a turn: simulators measure all rays at once, and so are those that
    are made from a cloud or a depth image. Scanners with few turns a second may take several
    for one message.
    """
    seconds = float(message.time_increment) * max(len(message.ranges) - 1, 0)
    last_ns = round(seconds * NS_PER_S) if abs(seconds) < 1 else 0
    return _near(min(last_ns, 0), max(last_ns, 0))


def _turn(start_ns: int, end_ns: int) -> tuple[int, int] | None:
    """Return a span; None if it is not that of a turn around its stamp."""
    lasts = _LEAST_SPAN_NS <= end_ns - start_ns <= _MOST_SPAN_NS
    return (start_ns, end_ns) if lasts and max(-start_ns, end_ns) <= _MOST_SPAN_NS else None


def _near(start_ns: int, end_ns: int) -> tuple[int, int] | None:
    """Return a span of a known unit; None if it is not one of a scanner around its stamp."""
    lasts = _LEAST_PART_NS <= end_ns - start_ns < _MOST_TURNS_NS
    return (start_ns, end_ns) if lasts and max(-start_ns, end_ns) < _MOST_TURNS_NS else None


def _is_return(cloud: PointCloud2) -> npt.NDArray[np.bool_]:
    """Return (N,) which points were measured: others may have any time.

    Raises:
        ValueError: A coordinate cannot be read.
    """
    places = np.stack([read_field(cloud, name) for name in 'xyz'])
    found: npt.NDArray[np.bool_] = np.isfinite(places).all(axis=0) & places.any(axis=0)
    return found
