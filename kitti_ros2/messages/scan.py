# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan <-> sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__PointCloud2 as PointCloud2,
)
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__PointField as PointField,
)

from ..samples import Scan
from .header import make_header

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..samples import Float32Array

_FLOAT32 = PointField.FLOAT32
_UINT16 = PointField.UINT16
_XYZI = tuple(
    PointField(name, 4 * i, _FLOAT32, 1) for i, name in enumerate(('x', 'y', 'z', 'intensity'))
)
_RING_TIME = (PointField('ring', 16, _UINT16, 1), PointField('time', 18, _FLOAT32, 1))
_RICH_POINT = np.dtype([('xyzi', '<f4', 4), ('ring', '<u2'), ('time', '<f4')])


def encode_scan(
    scan: Scan, stamp_ns: int, frame_id: str, *, ring_and_time: bool = False
) -> PointCloud2:
    """An unorganised cloud of x y z intensity, float32, the file's bytes untouched (step 16).

    With ring_and_time each point also has ring (uint16, 0 the lowest laser, as velodyne drivers
    count) and time (float32, seconds since the sweep's start): step 22.
    """
    points = np.ascontiguousarray(scan.points, dtype='<f4')
    fields, step, data = list(_XYZI), 16, points.reshape(-1).view(np.uint8)
    if ring_and_time:
        rich = np.empty(len(points), dtype=_RICH_POINT)
        rich['xyzi'], rich['ring'], rich['time'] = points, rings(points), times(scan)
        fields, step, data = [*_XYZI, *_RING_TIME], 22, rich.view(np.uint8)
    return PointCloud2(
        header=make_header(stamp_ns, frame_id),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * len(points),
        data=data,
        is_dense=bool(np.isfinite(points).all()),
    )


def decode_scan(message: PointCloud2) -> Scan:
    """The scan of a cloud made by encode_scan; its points are a view where the step is 16.

    Raises:
        ValueError: The cloud has other fields.
    """
    names = [field.name for field in message.fields]
    if names[:4] != ['x', 'y', 'z', 'intensity'] or message.point_step not in {16, 22}:
        raise ValueError(f'a cloud of fields {names}, step {message.point_step}')
    if message.point_step == 16:
        return Scan(message.data.view('<f4').reshape(-1, 4))
    return Scan(np.ascontiguousarray(message.data.view(_RICH_POINT)['xyzi']))


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
