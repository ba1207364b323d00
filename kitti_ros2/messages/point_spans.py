# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The time of the first and last point of a turn, of clouds, Livox' messages, packets and rings.

Drivers agree neither on the field nor on its unit: t (Ouster, uint32 nanoseconds), time (Velodyne,
float32 seconds), timestamp (Hesai and RoboSense, float64 seconds since 1970; Livox, nanoseconds),
time_stamp (Autoware, uint32 nanoseconds), offset_time (Livox, uint32 nanoseconds), offset_ns
(Argoverse 2). A turn lasts 0.05 to 0.2 s, so that the span of the values tells their unit. The
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
    from collections.abc import Iterable

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


def turn_of(messages: Iterable[Any]) -> tuple[int, int] | None:
    """Return when the first and last points were measured, nanoseconds from the stamp.

    Args:
        messages: PointCloud2, CustomMsg of Livox, VelodyneScan or LaserScan.

    Returns:
        Medians over messages with a time for each point; None if there are none.
    """
    spans = [span for each in messages if (span := _span_ns(each)) is not None]
    if not spans:
        return None
    start, end = (int(each) for each in np.median(np.array(spans), axis=0))
    return start, end


def _span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the span of a message of any type; None where its definition has no times."""
    own = {
        'timebase': livox_span_ns,
        'packets': packet_span_ns,
        'time_increment': ray_span_ns,
        'fields': point_span_ns,
    }
    found = next((span_ns for name, span_ns in own.items() if hasattr(message, name)), None)
    try:
        return None if found is None else found(message)
    except (AttributeError, TypeError, ValueError):  # forks define fields without, or otherwise
        return None


def point_span_ns(cloud: PointCloud2) -> tuple[int, int] | None:
    """Return the times of the first and last point of a cloud, nanoseconds from its stamp.

    None if it has no such field, or if the times are not those of a turn around the stamp.
    """
    names = {field.name for field in cloud.fields}
    name = next((name for name in _FIELDS if name in names), None)
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
    lowest, highest = values.min().item(), values.max().item()
    for unit in _UNITS_NS:
        if not _LEAST_SPAN_NS <= (highest - lowest) * unit <= _MOST_SPAN_NS:
            continue
        start = round(lowest * unit)
        if abs(start) > _MOST_SPAN_NS:  # since 1970, or since the scanner started
            start -= stamp_ns_of(cloud.header)
        return _turn(start, start + round((highest - lowest) * unit))
    return None


def livox_span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the times of the first and last point of a CustomMsg, nanoseconds from its stamp.

    None if they are not those of a turn.
    """
    times = [each.offset_time for each in message.points if each.x or each.y or each.z]
    if not times:
        return None
    later = int(message.timebase) - stamp_ns_of(message.header)
    start = min(times) + (later if abs(later) <= _MOST_SPAN_NS else 0)  # else of another clock
    return _turn(start, start + max(times) - min(times))


def packet_span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the times of the first and last packet of a VelodyneScan, nanoseconds from its stamp.

    The driver stamps packets when they arrive, and the message as its last packet, or its first.
    None if they are not those of a turn.
    """
    scan_ns = stamp_ns_of(message.header)
    times = [
        from_sec_nanosec(each.stamp.sec, each.stamp.nanosec) - scan_ns for each in message.packets
    ]
    return _turn(min(times, default=0), max(times, default=0))


def ray_span_ns(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return the times of the first and last ray of a LaserScan, nanoseconds from its stamp.

    None if they are not those of a turn: simulators measure all rays at once.
    """
    seconds = float(message.time_increment) * max(len(message.ranges) - 1, 0)
    return _turn(0, round(seconds * NS_PER_S)) if abs(seconds) < 1 else None


def _turn(start_ns: int, end_ns: int) -> tuple[int, int] | None:
    """Return a span; None if it is not that of a turn around its stamp."""
    lasts = _LEAST_SPAN_NS <= end_ns - start_ns <= _MOST_SPAN_NS
    return (start_ns, end_ns) if lasts and max(-start_ns, end_ns) <= _MOST_SPAN_NS else None


def _is_return(cloud: PointCloud2) -> npt.NDArray[np.bool_]:
    """Return (N,) which points were measured: others may have any time.

    Raises:
        ValueError: A coordinate cannot be read.
    """
    places = np.stack([read_field(cloud, name) for name in 'xyz'])
    found: npt.NDArray[np.bool_] = np.isfinite(places).all(axis=0) & places.any(axis=0)
    return found
