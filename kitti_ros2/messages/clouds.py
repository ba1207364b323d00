# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Any sensor_msgs/PointCloud2 -> points in KITTI's format: x y z reflectance, float32.

Reflectance is 0..1. Drivers use other scales, which a cloud does not contain: the divisor is
estimated once, from a few clouds of a stream, and applied to all of them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.streams import NS_PER_S, from_sec_nanosec
from .cdr import stamp_ns_of
from .ros_types import PointField

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from .ros_types import PointCloud2


# The points that a message of any sensor was decoded to.


@dataclass(frozen=True, eq=False)
class ScanPoints:
    """The points of a message.

    Attributes:
        points: (N, 4) float32 x y z reflectance, metres and 0..1, in the message's frame.
        dropped: Number of values without a return, by reason.
        lost: Number of parts that could not be decoded, by reason.
        labels: (N,) uint32 as SemanticKITTI's: low 16 bits class, high 16 instance; None without.
    """

    points: Float32Array
    dropped: Mapping[str, int]
    lost: Mapping[str, int] = field(default_factory=dict)
    labels: npt.NDArray[np.uint32] | None = None


def make_points(xyz: Float64Array, reflectance: Float64Array) -> Float32Array:
    """Make (N, 4) float32 of (N, 3) and (N,); reflectance is clipped to 0..1, and 0 for NaN."""
    points = np.empty((len(xyz), 4), dtype=np.float32)
    points[:, :3] = xyz
    points[:, 3] = np.clip(np.nan_to_num(reflectance, nan=0.0), 0.0, 1.0)
    return points


_KINDS = {
    PointField.INT8: 'i1',
    PointField.UINT8: 'u1',
    PointField.INT16: 'i2',
    PointField.UINT16: 'u2',
    PointField.INT32: 'i4',
    PointField.UINT32: 'u4',
    PointField.FLOAT32: 'f4',
    PointField.FLOAT64: 'f8',
}
_FAR_M = 1000.0
_XYZ = ('x', 'y', 'z')
INTENSITIES = ('intensity', 'reflectivity', 'reflectance', 'i')
"""Fields that become reflectance, best first."""
_KITTI_POINT = np.dtype([(name, '<f4') for name in (*_XYZ, 'intensity')])
_FULL_SCALES = (255.0, 4095.0, 65535.0)
_RANGE = 'range'
_LEAST_COINCIDENT = 2
_CLASSES = (
    'label', 'labels', 'labelid', 'pointlabel', 'class', 'classid', 'classlabel', 'category',
    'categoryid', 'semantic', 'semanticid', 'semanticlabel', 'semanticclass', 'semlabel',
    'semclass', 'objtag',
)  # fmt: skip
_INSTANCES = (
    'instance', 'instances', 'instanceid', 'instancelabel', 'inst', 'instid', 'objectid', 'objid',
    'objidx',
)  # fmt: skip
"""Fields with labels of points, SemanticKITTI's own names before others."""
_MOST_LABEL = 0xFFFF
_NO_LABEL = -1  # of programs in which 0 is a class or an instance
NOT_FINITE = 'x y z not finite'
AT_ZERO = 'x y z 0 0 0'
RANGE_ZERO = 'range 0'
FILE_INDEX = 'file_index'
"""The field with a point's index in KITTI's file, in clouds that to-bag sorted by time."""


def read_points(
    message: PointCloud2, order: npt.NDArray[np.intp] | None, intensity_scale: float = 1.0
) -> Float32Array:
    """Read the points of a cloud as they are stored.

    Fields are found by name and may have any type, order, offset, padding and byte order; rows
    follow each other. Reflectance is intensity, else reflectivity, reflectance or i, divided by
    intensity_scale; it is 0 where there is none.

    Args:
        message: Organised or not. row_step is ignored for a single row.
        order: The result of file_order for the message.
        intensity_scale: The result of guess_intensity_scale for the stream.

    Returns:
        (N, 4) float32 x y z reflectance, in the message's frame and row by row, or in the order. A
        view of the message if it has this format already, as KITTI's does.

    Raises:
        ValueError: x, y or z is missing; a field cannot be read; the data are too short.
    """
    if not message.width * message.height:
        return np.empty((0, 4), dtype=np.float32)
    cloud = _fields_of(message, _chosen(message))
    if cloud.dtype == _KITTI_POINT and cloud.flags.c_contiguous:
        stored = cloud.reshape(-1).view('<f4').reshape(-1, 4)
        return stored if intensity_scale == 1.0 else _scaled(stored, intensity_scale)
    reflectance = _intensity_of(cloud)
    points = np.empty((*cloud.shape, 4), dtype=np.float32)
    with np.errstate(over='ignore', invalid='ignore'):
        for column, name in enumerate(_XYZ):
            points[..., column] = cloud[name]
        points[..., 3] = 0 if reflectance is None else cloud[reflectance] / intensity_scale
    points = points.reshape(-1, 4)
    return points if order is None else points.take(order, axis=0)


def _scaled(stored: Float32Array, intensity_scale: float) -> Float32Array:
    """Return a copy of (N, 4) points with their intensities divided: one copy, not one a field."""
    points = stored.astype(np.float32)
    with np.errstate(over='ignore', invalid='ignore'):
        points[:, 3] /= intensity_scale
    return points


def decode_cloud(message: PointCloud2, intensity_scale: float = 1.0) -> tuple[Float32Array, int]:
    """Decode the points of any cloud; also return how many were dropped as missing returns.

    As read_points, in the order of the file if to-bag sorted the cloud by time. Missing returns are
    not finite, or 0 0 0 in an organised cloud (as earlier Ouster drivers have them). Reflectance is
    clipped to 0..1; it is 0 where it is NaN.

    Raises:
        ValueError: As read_points.
    """
    points = read_points(message, file_order(message), intensity_scale)
    missing = _not_finite(points)
    if message.height > 1:
        missing |= _at_zero(points)
    return _kept(points, ~missing)


def decode_returns(message: PointCloud2, intensity_scale: float = 1.0) -> ScanPoints:
    """Decode the returns of any cloud with their labels, and count dropped points by reason.

    As decode_cloud, but 0 0 0 is a missing return in any cloud. So are points whose field range is
    0 if most of them are at one position: Ouster's clouds have it, and 0 0 0 is elsewhere after a
    transformation. Other points are returns, also where a driver leaves range at 0.

    Raises:
        ValueError: As read_points.
    """
    order = file_order(message)
    points = read_points(message, order, intensity_scale)
    labels, lost = read_labels(message, order)
    missing = np.zeros(len(points), dtype=np.bool_)
    dropped: Counter[str] = Counter()
    for reason, wrong in (
        (NOT_FINITE, _not_finite(points)),
        (AT_ZERO, _at_zero(points)),
        (RANGE_ZERO, _coincident(points, _range_zero(message, order, len(points)))),
    ):
        dropped[reason] = int(np.count_nonzero(wrong & ~missing))
        missing |= wrong
    returns, _ = _kept(points, ~missing)
    if labels is not None and dropped.total():
        labels = labels[~missing]
    return ScanPoints(returns, +dropped, lost, labels)


def _not_finite(points: Float32Array) -> npt.NDArray[np.bool_]:
    x, y, z = points.T[:3]
    return np.asarray(~(np.isfinite(x) & np.isfinite(y) & np.isfinite(z)))


def _at_zero(points: Float32Array) -> npt.NDArray[np.bool_]:
    x, y, z = points.T[:3]
    return np.asarray(~((x != 0) | (y != 0) | (z != 0)))


def _range_zero(
    message: PointCloud2, order: npt.NDArray[np.intp] | None, count: int
) -> npt.NDArray[np.bool_]:
    if not count or all(field.name != _RANGE for field in message.fields):
        return np.zeros(count, dtype=np.bool_)
    try:
        ranges = read_field(message, _RANGE)
    except ValueError:
        return np.zeros(count, dtype=np.bool_)
    return np.asarray((ranges if order is None else ranges[order]) == 0)


def _coincident(points: Float32Array, selected: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return (N,) which of the selected points coincide, if several and most of them are.

    Points that are missing returns by themselves are left out.
    """
    selected = selected & ~_not_finite(points) & ~_at_zero(points)
    [which] = np.nonzero(selected)
    if len(which) < _LEAST_COINCIDENT:
        return np.zeros(len(points), dtype=np.bool_)
    xyz = points[which, :3]
    same = (xyz == np.sort(xyz, axis=0)[len(xyz) // 2]).all(axis=1)
    mask = np.zeros(len(points), dtype=np.bool_)
    if np.count_nonzero(same) * 2 > len(which):
        mask[which[same]] = True
    return mask


def _kept(points: Float32Array, is_return: npt.NDArray[np.bool_]) -> tuple[Float32Array, int]:
    """Return the returns with their reflectance in 0..1, and the number of other points."""
    reflectance = points[:, 3]
    if is_return.all() and ((reflectance >= 0) & (reflectance <= 1)).all():
        return points, 0
    returns = points[is_return]
    reflectance = returns[:, 3]
    np.clip(reflectance, 0, 1, out=reflectance)
    reflectance[np.isnan(reflectance)] = 0
    return returns, len(points) - len(returns)


def guess_intensity_scale(clouds: Iterable[PointCloud2]) -> float:
    """Estimate the divisor that scales a stream's intensities to 0..1 from some of its clouds.

    ======================  ==================================================
    peak over the clouds    divisor
    ======================  ==================================================
    up to 1, float fields   1: they are 0..1 already
    up to 255               255: 8 bits, also where an integer peaks at 0 or 1
    up to 4095              4095: 12 bits
    up to 65535             65535: 16 bits
    beyond                  the peak itself
    no intensity at all     1
    ======================  ==================================================

    Clouds that decode_cloud refuses are ignored.
    """
    peaks = [peak for cloud in clouds if (peak := _intensity_peak(cloud)) is not None]
    if not peaks:
        return 1.0
    highest = max(value for _, value in peaks)
    return scale_of_peak(highest, is_float=all(is_float for is_float, _ in peaks))


def scale_of_peak(highest: float, *, is_float: bool) -> float:
    """Estimate the same from the largest intensity; see guess_intensity_scale."""
    if highest <= 1 and is_float:
        return 1.0
    return next((scale for scale in _FULL_SCALES if highest <= scale), highest)


def _intensity_peak(message: PointCloud2) -> tuple[bool, float] | None:
    """Return whether the intensities of a cloud are floats, and the largest finite one."""
    if not message.width * message.height:
        return None
    try:
        cloud = _fields_of(message, _chosen(message))
    except ValueError:
        return None
    name = _intensity_of(cloud)
    if name is None:
        return None
    values = cloud[name]
    finite = values[np.isfinite(values)]
    return (values.dtype.kind == 'f', float(finite.max())) if finite.size else None


def _intensity_of(cloud: npt.NDArray[np.void]) -> str | None:
    return next((name for name in cloud.dtype.names or () if name not in _XYZ), None)


def unit_doubt(clouds: Iterable[PointCloud2]) -> str:
    """Return why coordinates of a stream are hardly metres, from some of its clouds; '' if not.

    They are whole numbers, or half of the points are more than a kilometre away.
    """
    medians = []
    for cloud in clouds:
        kinds = [_KINDS.get(field.datatype, '') for field in cloud.fields if field.name in _XYZ]
        whole = [kind for kind in kinds if kind[:1] in {'i', 'u'}]
        if whole:
            return f'x y z are whole numbers ({np.dtype(whole[0]).name})'
        try:
            xyz = read_points(cloud, None)[:, :3].astype(np.float64)
        except ValueError:
            continue
        away = np.linalg.norm(xyz[np.isfinite(xyz).all(axis=1)], axis=1)
        if away.any():
            medians.append(float(np.median(away[away > 0])))
    half_m = float(np.median(medians)) if medians else 0.0
    return f'half of the points are more than {half_m:.0f} m away' if half_m > _FAR_M else ''


def file_order(message: PointCloud2) -> npt.NDArray[np.intp] | None:
    """Return indices that put points in the order of their file.

    None without the field file_index, or if it does not contain each index once.
    """
    field = next((field for field in message.fields if field.name == FILE_INDEX), None)
    if field is None or field.datatype != PointField.UINT32:
        return None
    indices = read_field(message, FILE_INDEX)
    order = np.full(len(indices), -1, dtype=np.intp)
    inside = indices < len(indices)
    order[indices[inside]] = np.flatnonzero(inside)
    return order if (order >= 0).all() else None


def label_fields(message: PointCloud2) -> tuple[str, ...]:
    """Return the fields with the class and the instance of points; no fields without a class.

    Their names are known in any case, with or without underscores: label and instance, semantic_id
    and instance_id, class_id and object_id, CARLA's ObjTag and ObjIdx.
    """
    names = {field.name.lower().replace('_', ''): field.name for field in reversed(message.fields)}
    field_names = [
        next((names[name] for name in spellings if name in names), '')
        for spellings in (_CLASSES, _INSTANCES)
    ]
    return tuple(filter(None, field_names)) if field_names[0] else ()


def read_labels(
    message: PointCloud2, order: npt.NDArray[np.intp] | None
) -> tuple[npt.NDArray[np.uint32] | None, dict[str, int]]:
    """Read the labels of a cloud as SemanticKITTI's: low 16 bits class, high 16 instance.

    Fields may have any type. One of 32 bits without a second may have both parts already; -1 is 0,
    without a label.

    Args:
        message: Any cloud.
        order: The result of file_order for the message.

    Returns:
        (N,) labels, None without such a field; and the number of values that do not fit,
        by reason: they become 0.
    """
    names, count = label_fields(message), message.width * message.height
    if not names or not count:
        return None, {}
    lost: dict[str, int] = {}
    most = _MOST_LABEL if len(names) > 1 else 0xFFFFFFFF
    try:
        parts = [_whole(read_field(message, name), most, name, lost) for name in names]
    except ValueError as error:
        return None, {f'labels of points cannot be read ({error})': count}
    labels = parts[0] if len(parts) == 1 else parts[0] | parts[1] << np.uint32(16)
    return labels if order is None else labels[order], lost


def _whole(
    values: npt.NDArray[Any], most: int, name: str, lost: dict[str, int]
) -> npt.NDArray[np.uint32]:
    """Return (N,) values as uint32; others are 0 and counted."""
    if values.dtype.kind == 'f':
        values = np.where(np.isnan(values), _NO_LABEL, values)
    fits = (values >= 0) & (values <= most)
    if values.dtype.kind == 'f':
        fits &= values == np.floor(values)
    wrong = int(np.count_nonzero(~fits & (values != _NO_LABEL)))
    if wrong:
        lost[f'values of {name} that are no whole numbers from 0 to {most}, written as 0'] = wrong
    return np.where(fits, values, 0).astype(np.uint32)


def read_field(message: PointCloud2, name: str) -> npt.NDArray[Any]:
    """Read one field of all points, (N,), row by row.

    Raises:
        ValueError: It cannot be read.
    """
    field = next(field for field in message.fields if field.name == name)
    _check_field(field, message.point_step)
    return _fields_of(message, {name: field})[name].reshape(-1)


def _chosen(message: PointCloud2) -> dict[str, PointField]:
    """Choose the fields to read, by name: x y z, and the first available intensity.

    Raises:
        ValueError: One is missing or is not a single number within the point.
    """
    fields = {field.name: field for field in message.fields}
    missing = [name for name in _XYZ if name not in fields]
    if missing:
        there = ', '.join(field.name for field in message.fields) or 'none'
        raise ValueError(f'a cloud without {" and ".join(missing)}; its fields: {there}')
    intensity = intensity_field(message)
    names = [*_XYZ, *([] if intensity is None else [intensity])]
    for name in names:
        _check_field(fields[name], message.point_step)
    return {name: fields[name] for name in names}


def intensity_field(message: PointCloud2) -> str | None:
    """Return the name of the field that becomes reflectance, in any case; None without one."""
    names = {field.name.lower(): field.name for field in reversed(message.fields)}
    return next((names[name] for name in INTENSITIES if name in names), None)


def _check_field(field: PointField, point_step: int) -> None:
    if field.datatype not in _KINDS:
        raise ValueError(f'field {field.name} has the datatype {field.datatype}; known are 1 to 8')
    if field.count not in {0, 1}:  # PCL writes and reads 0 for 1
        raise ValueError(f'field {field.name} has {field.count} values a point; expected 1')
    end = field.offset + np.dtype(_KINDS[field.datatype]).itemsize
    if end > point_step:
        raise ValueError(
            f'field {field.name} ends at byte {end} of a point, which has {point_step} bytes'
        )


def _fields_of(message: PointCloud2, fields: dict[str, PointField]) -> npt.NDArray[np.void]:
    """Return a (height, width) structured view of the chosen fields.

    Raises:
        ValueError: The rows overlap or the data are too short.
    """
    row = message.width * message.point_step
    row_step = message.row_step if message.height > 1 else row
    if row_step < row:
        raise ValueError(
            f'a row of {message.width} points of {message.point_step} bytes'
            f' does not fit in row_step, {row_step} bytes'
        )
    if len(message.data) < row_step * message.height:
        raise ValueError(
            f'{len(message.data)} bytes of data; {message.height} rows of {row_step} bytes'
            f' are {row_step * message.height}'
        )
    order = '>' if message.is_bigendian else '<'
    point = np.dtype(
        {
            'names': list(fields),
            'formats': [order + _KINDS[field.datatype] for field in fields.values()],
            'offsets': [field.offset for field in fields.values()],
            'itemsize': message.point_step,
        }
    )
    cloud: npt.NDArray[np.void] = np.ndarray(
        (message.height, message.width),
        point,
        np.ascontiguousarray(message.data),
        strides=(row_step, message.point_step),
    )
    return cloud


# The time of the first and last point of each turn, of clouds, Livox' messages, packets and rings.
#
# Drivers agree neither on the field nor on its unit: t (Ouster, uint32 nanoseconds), time
# (Velodyne, float32 seconds), timestamp (Hesai and RoboSense, float64 seconds since 1970; Livox,
# nanoseconds), time_stamp (Autoware, uint32 nanoseconds), offset_time (Livox, uint32 nanoseconds),
# offset_ns (Argoverse 2). A turn lasts 0.05 to 0.2 s, so that the span of the values shows their
# unit; once it is known, a part of a turn or several turns in one message have their times, too.
# The points of a CustomMsg have nanoseconds from its timebase, which is its stamp; the packets of a
# VelodyneScan each have a stamp; a LaserScan has that of its first ray, and seconds between rays.

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
        self._unit_ns = 0  # of the times of points in clouds, once a whole turn has shown it

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
        read_span = next((span_ns for name, span_ns in own.items() if hasattr(message, name)), None)
        try:
            return None if read_span is None else read_span(message)
        except (AttributeError, TypeError, ValueError):  # forks define fields without, or otherwise
            return None

    def _points_ns(self, cloud: PointCloud2) -> tuple[int, int] | None:
        unit_ns, span_ns = _timed_points(cloud, self._unit_ns)
        self._unit_ns = unit_ns
        return span_ns


def has_times(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether a message of a type that scans are made from may have times of its points."""
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


def has_unexplained_times(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether the points of a cloud have times that differ, and are not those of a turn."""
    if not hasattr(message, 'fields') or point_span_ns(message) is not None:
        return False
    limits = _least_and_greatest(message)
    return limits is not None and limits[0] < limits[1]


def _timed_points(cloud: PointCloud2, unit_ns: int) -> tuple[int, tuple[int, int] | None]:
    """Return the unit of the times of points, and their span; see point_span_ns.

    Args:
        cloud: Any.
        unit_ns: Unit of the times, 0 where only a whole turn determines it.
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
    times = [point.offset_time for point in message.points if point.x or point.y or point.z]
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
        from_sec_nanosec(packet.stamp.sec, packet.stamp.nanosec) - scan_ns
        for packet in message.packets
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
    xyz = np.stack([read_field(cloud, name) for name in 'xyz'])
    mask: npt.NDArray[np.bool_] = np.isfinite(xyz).all(axis=0) & xyz.any(axis=0)
    return mask
