# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Foxglove's PointCloud -> sensor_msgs/PointCloud2; the points are not copied one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .header import make_header
from .ros_types import PointCloud2, PointField

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Transform
    from .foxglove_fields import Fields

# PackedElementField.NumericType -> PointField, and the type in memory.
_TYPES = {
    1: (PointField.UINT8, '<u1'),
    2: (PointField.INT8, '<i1'),
    3: (PointField.UINT16, '<u2'),
    4: (PointField.INT16, '<i2'),
    5: (PointField.UINT32, '<u4'),
    6: (PointField.INT32, '<i4'),
    7: (PointField.FLOAT32, '<f4'),
    8: (PointField.FLOAT64, '<f8'),
}


def encode_cloud(cloud: Fields, log_ns: int) -> PointCloud2:
    """Make the PointCloud2 of a PointCloud; a pose in its frame is applied to x, y and z.

    Args:
        cloud: The message.
        log_ns: Its stamp if it has none, nanoseconds.

    Raises:
        ValueError: Fields and data do not agree, or points with a pose have no x, y and z.
    """
    stride, data = cloud.integer('point_stride'), cloud.data('data')
    count, rest = divmod(len(data), stride) if stride else (0, len(data))
    if rest:
        raise ValueError(f'its data has {len(data)} bytes, no multiple of point_stride, {stride}')
    fields, names, formats, offsets = [], [], [], []
    for each in cloud.children('fields'):
        name, offset, kind = each.text('name'), each.integer('offset'), each.integer('type')
        if kind not in _TYPES:
            raise ValueError(f'its field {name} is of the unknown type {kind}')
        datatype, form = _TYPES[kind]
        if offset + np.dtype(form).itemsize > stride:
            raise ValueError(f'its field {name} ends beyond point_stride, {stride}')
        fields.append(PointField(name, offset, datatype, 1))
        names.append(name)
        formats.append(form)
        offsets.append(offset)
    pose = cloud.pose('pose')
    points = np.frombuffer(data, np.uint8)
    if count and not np.array_equal(pose.matrix(), np.eye(4)):
        if len(set(names)) < len(names) or not {'x', 'y', 'z'} <= set(names):
            raise ValueError('it has a pose, and its points have no x, y and z to apply it to')
        layout = {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': stride}
        points = _moved(points, np.dtype(layout), pose)  # type: ignore[call-overload]
    return PointCloud2(
        header=make_header(cloud.stamp_ns('timestamp', log_ns), cloud.text('frame_id')),
        height=1,
        width=count,
        fields=fields,
        is_bigendian=False,
        point_step=stride,
        row_step=len(data),
        data=points,
        is_dense=False,
    )


def _moved(
    data: npt.NDArray[np.uint8], layout: np.dtype[np.void], pose: Transform
) -> npt.NDArray[np.uint8]:
    """Return the bytes of points, their coordinates moved by a pose."""
    moved: npt.NDArray[np.uint8] = data.copy()
    points = moved.view(layout)
    xyz = np.column_stack([points[name].astype(np.float64) for name in 'xyz'])
    for name, column in zip('xyz', pose.apply(xyz).T, strict=True):
        if points[name].dtype.kind != 'f':
            raise ValueError(f'it has a pose, and {name} of its points is no float')
        points[name] = column
    return moved
