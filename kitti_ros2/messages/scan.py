# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan <-> sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.samples import Scan
from ..model.stamps import NS_PER_S
from .header import make_header
from .ros_types import PointCloud2, PointField
from .semantic import packed_colors

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Float32Array, Turn

_DATATYPES = {'<f4': PointField.FLOAT32, '<u2': PointField.UINT16, '<u4': PointField.UINT32}
_KINDS = {datatype: kind for kind, datatype in _DATATYPES.items()}
_XYZI = ('x', 'y', 'z', 'intensity')
_XYZI_BYTES = 16
FILE_INDEX = 'file_index'
"""The field with a point's index in KITTI's file, in clouds sorted by time."""


def encode_scan(
    scan: Scan,
    stamp_ns: int,
    frame_id: str,
    *,
    ring_and_time: bool = False,
    labels: npt.NDArray[np.uint32] | None = None,
) -> PointCloud2:
    """Make an unorganised cloud of x y z intensity, float32, the file's bytes unchanged (step 16).

    Args:
        scan: N points.
        stamp_ns: Nanoseconds.
        frame_id: velo_link.
        ring_and_time: Adds ring (uint16, 0 the lowest laser, as velodyne drivers count) and, where
            the scan has a turn, time (float32, seconds from stamp_ns) and file_index (uint32, the
            point's index in the file). Points with time are sorted by time: several SLAM packages
            use the last point's as the end of the scan.
        labels: (N,) SemanticKITTI labels; add label and instance (uint16) and rgb (float32).
    """
    points = np.ascontiguousarray(scan.points, dtype='<f4')
    more: list[tuple[str, str, npt.NDArray[np.generic]]] = []
    order: npt.NDArray[np.intp] | None = None
    if ring_and_time:
        more.append(('ring', '<u2', rings(points)))
    if ring_and_time and scan.turn is not None:
        seconds = times(points, scan.turn, stamp_ns)
        order = seconds.argsort(kind='stable')
        more += [('time', '<f4', seconds), (FILE_INDEX, '<u4', np.arange(len(points)))]
    if labels is not None:
        classes = (labels & 0xFFFF).astype(np.uint16)
        more += [('label', '<u2', classes), ('instance', '<u2', (labels >> 16).astype(np.uint16))]
        more += [('rgb', '<f4', packed_colors(classes))]
    point = np.dtype(
        [*((name, '<f4') for name in _XYZI), *((name, kind) for name, kind, _ in more)]
    )
    data = points.reshape(-1).view(np.uint8)
    if more:
        rich = np.empty(len(points), dtype=point)
        for index, name in enumerate(_XYZI):
            rich[name] = points[:, index]
        for name, _, values in more:
            rich[name] = values
        data = _taken(rich, order).view(np.uint8)
    return PointCloud2(
        header=make_header(stamp_ns, frame_id),
        height=1,
        width=len(points),
        fields=_fields(point),
        is_bigendian=False,
        point_step=point.itemsize,
        row_step=point.itemsize * len(points),
        data=data,
        is_dense=bool(np.isfinite(points).all()),
    )


def decode_scan(message: PointCloud2) -> Scan:
    """Decode a cloud made by encode_scan, in the file's order; a view if the step is 16.

    Raises:
        ValueError: The cloud has other fields, or its points have no order.
    """
    cloud = decode_points(message)
    if cloud.dtype.names is None or cloud.dtype.names[:4] != _XYZI:
        raise ValueError(f'a cloud of fields {cloud.dtype.names}')
    if message.point_step == _XYZI_BYTES:
        return Scan(message.data.view('<f4').reshape(-1, 4))
    return Scan(np.column_stack([cloud[name] for name in _XYZI]))


def decode_points(message: PointCloud2) -> npt.NDArray[np.void]:
    """Decode all fields of a cloud made by encode_scan, in the file's order: (N,) structured.

    A view if the message has this order.

    Raises:
        ValueError: A field is of another type, the data are of another length, or file_index does
            not contain each index once.
    """
    if any(field.datatype not in _KINDS or field.count != 1 for field in message.fields):
        raise ValueError('a cloud with fields other than single float32, uint16 and uint32')
    count = message.width * message.height
    if len(message.data) != count * message.point_step:
        raise ValueError(f'a cloud of {count} points with {len(message.data)} bytes of data')
    points: npt.NDArray[np.void] = message.data.view(
        np.dtype(
            {
                'names': [field.name for field in message.fields],
                'formats': [_KINDS[field.datatype] for field in message.fields],
                'offsets': [field.offset for field in message.fields],
                'itemsize': message.point_step,
            }
        )
    )
    if FILE_INDEX not in (points.dtype.names or ()):
        return points
    places = points[FILE_INDEX]
    order = file_order(places) if places.dtype == np.uint32 else None
    if order is None:
        raise ValueError(f'a cloud whose {FILE_INDEX} does not give each place once')
    return _taken(points, order)


def file_order(places: npt.NDArray[np.uint32]) -> npt.NDArray[np.intp] | None:
    """Return indices that put points in the order of their file; None unless each is there once.

    Args:
        places: (N,) the field file_index.
    """
    order = np.full(len(places), -1, dtype=np.intp)
    inside = places < len(places)
    order[places[inside]] = np.flatnonzero(inside)
    return order if (order >= 0).all() else None


def _taken(
    points: npt.NDArray[np.void], order: npt.NDArray[np.intp] | None
) -> npt.NDArray[np.void]:
    """Reorder points; whole points are moved, which is faster than field by field."""
    if order is None:
        return points
    return points.view(f'V{points.dtype.itemsize}')[order].view(points.dtype)


def _fields(point: np.dtype[np.void]) -> list[PointField]:
    fields = []
    for name in point.names or ():
        kind, offset = point.fields[name][:2] if point.fields else (point, 0)
        fields.append(PointField(name, offset, _DATATYPES[kind.str], 1))
    return fields


def rings(points: Float32Array) -> npt.NDArray[np.uint16]:
    """Return the laser of each point, (N,) uint16, 0 the lowest.

    KITTI's files contain the lasers one after the other, top to bottom, the points of each sorted
    by rising azimuth from straight ahead (against the direction in which the scanner turns): a
    laser begins where the azimuth wraps from below 2 pi to 0. The count is correct if every laser
    has returns near the front.
    """
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    wraps = (azimuth[:-1] < 0) & (azimuth[1:] >= 0) & (azimuth[:-1] - azimuth[1:] > -np.pi)
    row = np.concatenate([[0], np.cumsum(wraps)]) if len(points) else np.empty(0, np.int64)
    lowest = row[-1] if len(row) else 0
    return (lowest - row).astype(np.uint16)


def times(points: Float32Array, turn: Turn, stamp_ns: int) -> Float32Array:
    """Return seconds of each point from a stamp, (N,) float32: stamp plus time is the measurement.

    The scanner turns clockwise seen from above, from straight behind (azimuth pi) over the left,
    front and right to straight behind (-pi): time decreases with azimuth. Points without an azimuth
    (NaN) have the time of straight ahead. Sources: see kitti/turns.py; KISS-ICP's
    kitti_raw loader and CT-ICP's reader do the same.

    Args:
        points: (N, 4), measured in velo_link at different moments (not compensated for motion).
        turn: Start and end of the scanner's turn.
        stamp_ns: The cloud's stamp; with the start of the turn, times are 0 to its length.
    """
    azimuth = np.nan_to_num(np.arctan2(points[:, 1], points[:, 0]), nan=0.0).astype(np.float64)
    turned = np.clip(0.5 - azimuth / (2 * np.pi), 0.0, 1.0)
    return ((turned * turn.length_ns + (turn.start_ns - stamp_ns)) / NS_PER_S).astype(np.float32)
