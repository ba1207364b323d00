# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan <-> sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.semantic import OTHER_COLOR, SEMANTIC_COLORS
from ..model.motion import turned
from ..model.samples import Scan
from ..model.stamps import NS_PER_S
from .clouds import FILE_INDEX, file_order, read_field, read_points
from .header import make_header
from .ros_types import PointCloud2, PointField

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.samples import Float32Array, Turn

_KINDS = dict.fromkeys(('x', 'y', 'z', 'intensity', 'time', 'rgb'), '<f4')
_KINDS |= {'ring': '<u2', 'label': '<u2', 'instance': '<u2', FILE_INDEX: '<u4'}
_DATATYPES = {'<f4': PointField.FLOAT32, '<u2': PointField.UINT16, '<u4': PointField.UINT32}
_XYZI = ('x', 'y', 'z', 'intensity')

_COLOR_TABLE = np.full(1 << 16, OTHER_COLOR, dtype=np.uint32)
_COLOR_TABLE[list(SEMANTIC_COLORS)] = list(SEMANTIC_COLORS.values())


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
    more = {} if labels is None else _label_fields(labels)
    order: npt.NDArray[np.intp] | None = None
    if ring_and_time:
        more = _ring_and_time(points, scan.turn, stamp_ns) | more
        order = more['time'].argsort(kind='stable') if 'time' in more else None
    point = _point((*_XYZI, *more))
    data = points.reshape(-1).view(np.uint8)
    if more:
        rich = np.empty(len(points), dtype=point)
        for name, values in (*zip(_XYZI, points.T, strict=True), *more.items()):
            rich[name] = values
        # Whole points are moved, which is faster than field by field.
        rich = rich if order is None else rich.view(f'V{point.itemsize}')[order].view(point)
        data = rich.view(np.uint8)
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


def _ring_and_time(
    points: Float32Array, turn: Turn | None, stamp_ns: int
) -> dict[str, npt.NDArray[Any]]:
    found: dict[str, npt.NDArray[Any]] = {'ring': rings(points)}
    if turn is not None:
        found['time'] = times(points, turn, stamp_ns)
        found[FILE_INDEX] = np.arange(len(points))
    return found


def _label_fields(labels: npt.NDArray[np.uint32]) -> dict[str, npt.NDArray[Any]]:
    classes = (labels & 0xFFFF).astype(np.uint16)
    instances = (labels >> 16).astype(np.uint16)
    return {'label': classes, 'instance': instances, 'rgb': packed_colors(classes)}


def decode_scan(message: PointCloud2) -> Scan:
    """Decode a cloud made by encode_scan, in the file's order: points and SemanticKITTI labels.

    The points are a view of the message if its step is 16. ring and time follow from the points,
    start and end of the sweep are not in the message.

    Raises:
        ValueError: The cloud has other fields or data of another length, or file_index does not
            contain each index once.
    """
    names = tuple(field.name for field in message.fields)
    found = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    known = names[:4] == _XYZI and _KINDS.keys() >= set(names)
    made = _fields(_point(names)) if known else []
    if message.is_bigendian or found != [
        (field.name, field.offset, field.datatype, field.count) for field in made
    ]:
        raise ValueError(f'a cloud of fields {names}, or with other types or offsets')
    count = message.width * message.height
    if len(message.data) != count * message.point_step:
        raise ValueError(f'a cloud of {count} points with {len(message.data)} bytes of data')
    order = file_order(message)
    if order is None and FILE_INDEX in names:
        raise ValueError(f'a cloud whose {FILE_INDEX} does not give each place once')
    labels = None
    if 'label' in names and 'instance' in names:
        labels = read_field(message, 'label').astype(np.uint32)
        labels |= read_field(message, 'instance').astype(np.uint32) << np.uint32(16)
        labels = labels if order is None else labels[order]
    return Scan(read_points(message, order), labels=labels)


def _point(names: Sequence[str]) -> np.dtype[np.void]:
    return np.dtype([(name, _KINDS[name]) for name in names])


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

    See model/motion.py for the direction in which the scanner turns.

    Args:
        points: (N, 4), measured in velo_link at different moments (not compensated for motion).
        turn: Start and end of the scanner's turn.
        stamp_ns: The cloud's stamp; with the start of the turn, times are 0 to its length.
    """
    since_ns = turned(points) * turn.length_ns + (turn.start_ns - stamp_ns)
    return (since_ns / NS_PER_S).astype(np.float32)


def packed_colors(classes: npt.NDArray[np.uint16]) -> npt.NDArray[np.float32]:
    """Return (N,) float32 with the bits 0x00RRGGBB, the format of the field rgb in PCL and RViz."""
    return _COLOR_TABLE[classes].view(np.float32)
