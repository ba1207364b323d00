# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The formats of clouds that --points chooses, one row each, with the sources they follow.

- Velodyne driver (ros-drivers/velodyne, 571758d, velodyne_pointcloud/src/lib/
  pointcloudXYZIRT.cpp:52-57): x y z intensity ring time, packed; time is seconds from the stamp.
  LIO-SAM (src/imageProjection.cpp, VelodynePointXYZIRT) and FAST-LIO2 (src/preprocess.h,
  velodyne_ros::Point) read them by name and type, so that a field behind them does no harm, and
  take the last point's time as the end of the scan. KISS-ICP (07020e8, ros/src/Utils.hpp:94-106)
  takes a field t, timestamp or time of uint32, float32 or float64.
- Autoware (autoware_core 73c7063, common/autoware_point_types/include/autoware/point_types/
  types.hpp:57-64 PointXYZIRC, :95-106 PointXYZIRCAEDT, :46-55 ReturnType). The check of XYZIRCAEDT
  is exact (10 fields), that of XYZIRC is a prefix check (memory.hpp, e25b009), yet some nodes
  require its 6 fields (PTv3TRT::detectCloudFormat), so no field may follow. azimuth is atan2(y, x),
  as the documentation of point cloud fields says, 0 to 2 pi as its nodes write it; time_stamp is
  nanoseconds since the stamp, and rises (sensing/autoware_pointcloud_preprocessor/src/
  distortion_corrector/distortion_corrector.cpp, undistort_pointcloud, 0f14dfb).
- Ouster driver (ouster-ros, include/ouster_ros/os_point.h:22-31, 7ef403d): a struct of PCL,
  48 bytes. src/point_cloud_compose.h (015f03e): one row a laser, the highest first; one column a
  moment; t is nanoseconds since the stamp, 0 where it would be negative. src/
  point_cloud_processor.h (015f03e): missing returns have NaN for x y z. LIO-SAM shuts down on
  clouds that are not dense (src/imageProjection.cpp, cachePointCloud): it needs xyzirt.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class Points(str, Enum):
    """Formats of clouds, by the names of their point types."""

    XYZI = 'xyzi'
    XYZIRT = 'xyzirt'
    XYZIRC = 'xyzirc'
    XYZIRCAEDT = 'xyzircaedt'
    OUSTER = 'ouster'


class Order(str, Enum):
    """Orders of the points of a cloud."""

    FILE = "of KITTI's file"
    TIME = "of time, else of KITTI's file"
    GRID = 'a row for each laser, columns of time'


VALUES = {
    'x': 'metres',
    'y': 'metres',
    'z': 'metres',
    'reflectance': '0 to 1',
    'brightness': 'reflectance, 0 to 255',
    'return_type': '1, a single strongest return',
    'laser': 'laser, 0 the lowest',
    'row': 'laser, 0 the highest',
    'seconds': 'seconds from header.stamp',
    'nanoseconds': 'nanoseconds since header.stamp',
    'file_index': "index in KITTI's file",
    'azimuth': 'radians, atan2(y, x), 0 to 2 pi',
    'elevation': 'radians',
    'distance': 'metres',
    'millimetres': 'distance, millimetres',
    'ambient': '0, not measured',
    'label_class': "SemanticKITTI's class",
    'label_instance': "SemanticKITTI's instance",
    'label_color': 'colour of the class, 0x00RRGGBB',
}
"""The values that a field may have, with their units."""


@dataclass(frozen=True)
class CloudField:
    """One field of a point.

    Attributes:
        name: As in PointField.
        kind: Its numpy type, little-endian.
        offset: Of its first byte in the point.
        value: Its value, one of VALUES.
        timed: Whether it is absent from scans whose points are all of one moment.
    """

    name: str
    kind: str
    offset: int
    value: str
    timed: bool = False

    @property
    def end(self) -> int:
        """The offset behind its last byte."""
        return self.offset + int(self.kind[2:])


@dataclass(frozen=True)
class CloudFormat:
    """The fields and the order of the points of a cloud.

    Attributes:
        follows: Whose format it is.
        fields: In the order of their offsets.
        point_step: Bytes of a point.
        order: Of the points. A grid is organised: 64 rows, or 128 for more than 64 lasers, and NaN
            for missing returns.
        loss: Difference of the points from KITTI's file; '' if the cloud restores the file.
        extensible: Whether fields may follow, such as those of labels.
    """

    follows: str
    fields: tuple[CloudField, ...]
    point_step: int
    order: Order
    loss: str = ''
    extensible: bool = False

    @property
    def is_timed(self) -> bool:
        """Whether points have times; the stamp of the cloud is then the start of the turn."""
        return any(field.value in {'seconds', 'nanoseconds'} for field in self.fields)

    @property
    def is_unsigned(self) -> bool:
        """Whether times cannot be negative, so that the stamp must be the start of the turn."""
        return any(field.value == 'nanoseconds' for field in self.fields)

    def fields_of(self, *, timed: bool, labelled: bool = False) -> tuple[CloudField, ...]:
        """Return the fields of a scan: whether its points have times, and labels."""
        fields = [field for field in self.fields if timed or not field.timed]
        step = self.point_step if len(fields) == len(self.fields) else fields[-1].end
        for name, kind, value in _LABELS if labelled else ():
            fields.append(CloudField(name, kind, step, value))
            step = fields[-1].end
        return tuple(fields)

    def step_of(self, fields: Sequence[CloudField]) -> int:
        """Return the bytes of a point with fields of this format."""
        whole = fields[-1].name == self.fields[-1].name
        return self.point_step if whole else fields[-1].end


_LABELS = (
    ('label', '<u2', 'label_class'),
    ('instance', '<u2', 'label_instance'),
    ('rgb', '<f4', 'label_color'),
)
_XYZ = tuple(CloudField(name, '<f4', 4 * index, name) for index, name in enumerate('xyz'))
_XYZI = (*_XYZ, CloudField('intensity', '<f4', 12, 'reflectance'))
_XYZIRC = (
    *_XYZ,
    CloudField('intensity', '|u1', 12, 'brightness'),
    CloudField('return_type', '|u1', 13, 'return_type'),
    CloudField('channel', '<u2', 14, 'laser'),
)
FORMATS = {
    Points.XYZI: CloudFormat("KITTI's files", _XYZI, 16, Order.FILE, extensible=True),
    Points.XYZIRT: CloudFormat(
        'the Velodyne driver, and `file_index` behind it',
        (
            *_XYZI,
            CloudField('ring', '<u2', 16, 'laser'),
            CloudField('time', '<f4', 18, 'seconds', timed=True),
            CloudField('file_index', '<u4', 22, 'file_index', timed=True),
        ),
        26,
        Order.TIME,
        extensible=True,
    ),
    Points.XYZIRC: CloudFormat(
        "Autoware's PointXYZIRC", _XYZIRC, 16, Order.FILE, loss='reflectance is rounded to 0.01'
    ),
    Points.XYZIRCAEDT: CloudFormat(
        "Autoware's PointXYZIRCAEDT",
        (
            *_XYZIRC,
            CloudField('azimuth', '<f4', 16, 'azimuth'),
            CloudField('elevation', '<f4', 20, 'elevation'),
            CloudField('distance', '<f4', 24, 'distance'),
            CloudField('time_stamp', '<u4', 28, 'nanoseconds'),
        ),
        32,
        Order.TIME,
        loss='points are in order of time, reflectance is rounded to 0.01',
    ),
    Points.OUSTER: CloudFormat(
        'the Ouster driver',
        (
            *_XYZ,
            CloudField('intensity', '<f4', 16, 'reflectance'),
            CloudField('t', '<u4', 20, 'nanoseconds'),
            CloudField('reflectivity', '<u2', 24, 'brightness'),
            CloudField('ring', '<u2', 26, 'row'),
            CloudField('ambient', '<u2', 28, 'ambient'),
            CloudField('range', '<u4', 32, 'millimetres'),
        ),
        48,
        Order.GRID,
        loss='points are in the order of the grid',
    ),
}  # fmt: skip
