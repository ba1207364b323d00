# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan <-> sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..samples import Scan
from .header import make_header
from .ros_types import PointCloud2, PointField
from .semantic import packed_colors

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..samples import Float32Array

_DATATYPES = {'<f4': PointField.FLOAT32, '<u2': PointField.UINT16}
_KINDS = {datatype: kind for kind, datatype in _DATATYPES.items()}
_XYZI = ('x', 'y', 'z', 'intensity')
_XYZI_BYTES = 16


def encode_scan(
    scan: Scan,
    stamp_ns: int,
    frame_id: str,
    *,
    ring_and_time: bool = False,
    labels: npt.NDArray[np.uint32] | None = None,
) -> PointCloud2:
    """An unorganised cloud of x y z intensity, float32, the file's bytes untouched (step 16).

    Args:
        scan: N points.
        stamp_ns: Nanoseconds.
        frame_id: velo_link.
        ring_and_time: Adds ring (uint16, 0 the lowest laser, as velodyne drivers count) and time
            (float32, seconds since the sweep's start).
        labels: (N,) SemanticKITTI labels; add label and instance (uint16) and rgb (float32).
    """
    points = np.ascontiguousarray(scan.points, dtype='<f4')
    more: list[tuple[str, str, npt.NDArray[np.generic]]] = []
    if ring_and_time:
        more += [('ring', '<u2', rings(points)), ('time', '<f4', times(scan))]
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


def decode_scan(message: PointCloud2) -> Scan:
    """The scan of a cloud made by encode_scan; its points are a view where the step is 16.

    Raises:
        ValueError: The cloud has other fields.
    """
    cloud = decode_points(message)
    if cloud.dtype.names is None or cloud.dtype.names[:4] != _XYZI:
        raise ValueError(f'a cloud of fields {cloud.dtype.names}')
    if message.point_step == _XYZI_BYTES:
        return Scan(message.data.view('<f4').reshape(-1, 4))
    return Scan(np.column_stack([cloud[name] for name in _XYZI]))


def decode_points(message: PointCloud2) -> npt.NDArray[np.void]:
    """(N,) structured array of all fields of a cloud made by encode_scan, a view.

    Raises:
        ValueError: A field is of another type, or the data are of another length.
    """
    if any(field.datatype not in _KINDS or field.count != 1 for field in message.fields):
        raise ValueError('a cloud with fields other than single float32 and uint16')
    count = message.width * message.height
    if len(message.data) != count * message.point_step:
        raise ValueError(f'a cloud of {count} points with {len(message.data)} bytes of data')
    return message.data.view(
        np.dtype(
            {
                'names': [field.name for field in message.fields],
                'formats': [_KINDS[field.datatype] for field in message.fields],
                'offsets': [field.offset for field in message.fields],
                'itemsize': message.point_step,
            }
        )
    )


def _fields(point: np.dtype[np.void]) -> list[PointField]:
    fields = []
    for name in point.names or ():
        kind, offset = point.fields[name][:2] if point.fields else (point, 0)
        fields.append(PointField(name, offset, _DATATYPES[kind.str], 1))
    return fields


def rings(points: Float32Array) -> npt.NDArray[np.uint16]:
    """The laser of each point, (N,) uint16, 0 the lowest.

    KITTI's files hold the lasers one after the other, top to bottom, each turning once
    counter-clockwise from straight ahead: a laser begins where the azimuth wraps from behind 2 pi
    to 0. The count is right where no laser lacks every return near the front.
    """
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    wraps = (azimuth[:-1] < 0) & (azimuth[1:] >= 0) & (azimuth[:-1] - azimuth[1:] > -np.pi)
    row = np.concatenate([[0], np.cumsum(wraps)]) if len(points) else np.empty(0, np.int64)
    lowest = row[-1] if len(row) else 0
    return (lowest - row).astype(np.uint16)


def times(scan: Scan) -> Float32Array:
    """Seconds of each point since the sweep's start, (N,) float32; 0 without a start and end.

    The scanner turns counter-clockwise and faces forward in the middle of its sweep.
    """
    points = scan.points
    if scan.start_ns is None or scan.end_ns is None:
        return np.zeros(len(points), dtype=np.float32)
    turned = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) + 0.5
    return (turned * ((scan.end_ns - scan.start_ns) / 1e9)).astype(np.float32)
