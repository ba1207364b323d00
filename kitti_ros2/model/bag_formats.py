# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of bags: containers, channels, message types, and formats of clouds."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


# The containers of bags: their names, and how their files are named, begin and are compressed.
#
# A new container gets its entry here; bags/bag_files.py opens its reader, and bags/writer.py its
# writer.


@dataclass(frozen=True)
class Container:
    """A file format of bags.

    Attributes:
        title: Its name for people.
        suffix: Suffix of its files.
        magic: The first bytes of its files.
        globs: File names that belong to a bag in a directory.
        side_suffixes: Suffixes of files that its library may leave beside.
        in_file: Whether a bag can be written to a single file of that suffix.
        in_rosbag2: Whether rosbag2 supports it: a directory then has a metadata.yaml.
        encoding: Encoding of its messages: cdr or ros1.
        compressions: Name of each to its levels; None for one without levels.
        compresses_messages: Whether it is messages that are compressed (rosbag2's message mode).
        stamp_limit_ns: The first log time that it cannot hold.
    """

    title: str
    suffix: str
    magic: bytes
    globs: tuple[str, ...]
    compressions: dict[str, range | None]
    stamp_limit_ns: int
    side_suffixes: tuple[str, ...] = ()
    in_file: bool = True
    in_rosbag2: bool = True
    encoding: str = 'cdr'
    compresses_messages: bool = False


# By the name that options and metadata.yaml give it.
CONTAINERS = {
    'mcap': Container(
        title='MCAP',
        suffix='.mcap',
        magic=b'\x89MCAP0\r\n',
        globs=('*.mcap', '*.mcap.zstd'),
        compressions={'none': None, 'lz4': range(17), 'zstd': range(1, 23)},
        stamp_limit_ns=2**63,
    ),
    'sqlite3': Container(
        title='SQLite',
        suffix='.db3',
        magic=b'SQLite format 3\0',
        globs=('*.db3', '*.db3.zstd'),
        compressions={'none': None, 'zstd': range(1, 23)},
        stamp_limit_ns=2**63,
        side_suffixes=('.db3-shm', '.db3-wal'),
        in_file=False,
        compresses_messages=True,
    ),
    'ros1': Container(
        title='ROS 1',
        suffix='.bag',
        magic=b'#ROSBAG V',
        globs=('*.bag', '*.bag.active'),
        compressions={'none': None, 'lz4': None, 'bz2': None},
        stamp_limit_ns=2**32 * 10**9,
        in_rosbag2=False,
        encoding='ros1',
    ),
}

ZSTD_MAGIC = b'(\xb5/\xfd'
"""The first bytes of files and messages that rosbag2 compressed."""

# As messages and help texts list them.
ANY_BAG = 'an MCAP file, a rosbag2 directory or a ROS 1 .bag'
FILE_NAMES = ', '.join(f'NAME{kind.suffix}' for kind in CONTAINERS.values() if kind.in_file)


def container_of(suffix: str) -> str | None:
    """Return the name of the container that is written to single files of a suffix, if any."""
    for name, container in CONTAINERS.items():
        if container.in_file and container.suffix == suffix:
            return name
    return None


# The names of ROS message types, in ROS 2's spelling.

ANNOTATIONS = 'foxglove_msgs/msg/ImageAnnotations'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
CLOCK = 'rosgraph_msgs/msg/Clock'
CLOUD = 'sensor_msgs/msg/PointCloud2'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
COMPRESSED_POINTS = 'point_cloud_interfaces/msg/CompressedPointCloud2'
COMPRESSED_VIDEO = 'foxglove_msgs/msg/CompressedVideo'
DETECTIONS_2D = 'vision_msgs/msg/Detection2DArray'
DETECTIONS_3D = 'vision_msgs/msg/Detection3DArray'
DETECTED_OBJECTS = 'autoware_perception_msgs/msg/DetectedObjects'
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
FIX = 'sensor_msgs/msg/NavSatFix'
HEADER = 'std_msgs/msg/Header'
IMAGE = 'sensor_msgs/msg/Image'
LABEL_INFO = 'vision_msgs/msg/LabelInfo'
IMU = 'sensor_msgs/msg/Imu'
LASER_SCAN = 'sensor_msgs/msg/LaserScan'
LIVOX = frozenset({'livox_ros_driver/msg/CustomMsg', 'livox_ros_driver2/msg/CustomMsg'})
"""Clouds of Livox' drivers."""
MARKERS = 'visualization_msgs/msg/MarkerArray'
ODOMETRY = 'nav_msgs/msg/Odometry'
PATH = 'nav_msgs/msg/Path'
POSE = 'geometry_msgs/msg/PoseStamped'
STRING = 'std_msgs/msg/String'
TF = 'tf2_msgs/msg/TFMessage'
TF_TYPES = frozenset({TF, 'tf/msg/tfMessage'})
"""Types of dynamic and static transforms, also of ROS 1's first tf."""
HEADLESS = frozenset({ANNOTATIONS, STRING, MARKERS, *TF_TYPES})
"""Types of ours without a header of the message as a whole."""
TRACKED_OBJECTS = 'autoware_perception_msgs/msg/TrackedObjects'
TWIST = 'geometry_msgs/msg/TwistStamped'
TWIST_COVARIANCE = 'geometry_msgs/msg/TwistWithCovarianceStamped'
VELODYNE = 'velodyne_msgs/msg/VelodyneScan'
VIDEOS = frozenset(
    {
        COMPRESSED_VIDEO,
        'depthai_ros_msgs/msg/FFMPEGPacket',
        'ffmpeg_image_transport_msgs/msg/FFMPEGPacket',
    }
)
"""Packets of a video codec, each a frame."""


# Channels: topics with message type and QoS, whether played, written or stored.

PICTURES = frozenset({COMPRESSED, IMAGE})
"""Types of images."""

LARGE_TYPES = PICTURES | {CLOUD, COMPRESSED_POINTS}
"""Types of messages of a megabyte and more."""


@dataclass(frozen=True)
class Channel:
    """A topic with its message type and QoS.

    Attributes:
        topic: Full topic name.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        latched: Whether late subscribers receive the last messages: QoS transient local.
        depth: History depth of the offered QoS (keep last).
    """

    topic: str
    msgtype: str
    latched: bool = field(default=False, kw_only=True)
    depth: int = field(default=10, kw_only=True)

    @property
    def on_demand(self) -> bool:
        """True if its messages are large, so that a player encodes them for subscribers only."""
        return self.msgtype in LARGE_TYPES


# The formats of clouds that --points chooses, one row each, with the sources they follow.
#
# - Velodyne driver (ros-drivers/velodyne, 571758d, velodyne_pointcloud/src/lib/
#   pointcloudXYZIRT.cpp:52-57): x y z intensity ring time, packed; time is seconds from the stamp
#   (rawdata.cpp:330, 813, 04a7ca7), ring 0 the lowest laser (calibration.cpp:204-226). Its
#   intensity is 0 to 255; ours stays KITTI's reflectance, so that the file can be restored.
#   LIO-SAM (src/imageProjection.cpp, VelodynePointXYZIRT) and FAST-LIO2 (src/preprocess.h,
#   velodyne_ros::Point) read them by name and type, so that a field behind them does no harm, and
#   take the last point's time as the end of the scan. KISS-ICP (07020e8, ros/src/Utils.hpp:94-106)
#   takes a field t, timestamp or time of uint32, float32 or float64.
# - Autoware (autoware_core 73c7063, common/autoware_point_types/include/autoware/point_types/
#   types.hpp:57-64 PointXYZIRC, :95-106 PointXYZIRCAEDT, :46-55 ReturnType). The check of
#   XYZIRCAEDT is exact (10 fields), that of XYZIRC is a prefix check (memory.hpp, e25b009), yet
#   some nodes require its 6 fields (PTv3TRT::detectCloudFormat), so no field may follow. The
#   driver, tier4/nebula (606ac41), gives the values their meaning, and has a recorded VLP-16
#   (src/nebula_velodyne/nebula_velodyne/test_resources/decoder_ground_truth/vlp16/
#   1673400472138016708.pcd):
#
#   - azimuth is -atan2(y, x), 0 to 2 pi: it rises with time (vlp16_decoder.cpp:258-259, 313; all
#     14,831 recorded points). The ring outlier filter joins neighbours of a channel, in the order
#     of the cloud, only where it rises by less than a degree (autoware.universe 17799e5,
#     outlier_kernels.cu:46-51); a Hesai's is pi/2 more (hesai_decoder.hpp:228-233).
#   - elevation is radians (docs/point_types.md, hesai_decoder.hpp:234); the decoders of Velodyne
#     write its sine (vlp16_decoder.cpp:314), at most 0.003 from it in the recording.
#   - distance is metres from the sensor's origin; channel 0 is the lowest laser of a Velodyne
#     (recorded: channel 1 at -13, 15 at +15 degrees).
#   - return_type: 1 is Autoware's SINGLE_STRONGEST, and a primary return by the default of its
#     polar voxel filter (1, 6, 8, 10: autoware_universe 5fc2b34,
#     docs/polar-voxel-outlier-filter.md). Nebula's own enumeration (nebula_common.hpp:30-42) has 3,
#     which is Autoware's DUAL_STRONGEST_FIRST.
#   - time_stamp is nanoseconds since header.stamp (vlp16_decoder.cpp:315-317, decoder_wrapper.cpp:
#     207), and rises (sensing/autoware_pointcloud_preprocessor/src/distortion_corrector/
#     distortion_corrector.cpp, undistort_pointcloud, 0f14dfb).
# - Ouster driver (ouster-ros, include/ouster_ros/os_point.h:22-31, 7ef403d): a struct of PCL,
#   48 bytes. src/point_cloud_compose.h (8cd6278): ring is the row, the highest laser first (174);
#   one column a time; t is nanoseconds since the stamp, 0 where it would be negative (148-149).
#   src/impl/cartesian.h:14-22 (8cd6278): range is millimetres; missing returns have NaN for x y z.
#   Its intensity is a count of photons, for which KITTI has no value: ours is the reflectance, as
#   reflectivity is in steps of 1/255. LIO-SAM shuts down on clouds that are not dense
#   (src/imageProjection.cpp, cachePointCloud): it needs xyzirt.


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


EXTRA = 'extra'
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
    'azimuth': 'radians from x, clockwise seen from above: -atan2(y, x), 0 to 2 pi',
    'elevation': 'radians above the plane of x and y',
    'distance': 'metres',
    'millimetres': 'distance, millimetres',
    'ambient': '0, not measured',
    'label_class': "SemanticKITTI's class",
    'label_instance': "SemanticKITTI's instance",
    'label_color': 'colour of the class, 0x00RRGGBB',
    EXTRA: 'a column of the file, see --columns',
}
"""The values that a field may have, with their units."""


@dataclass(frozen=True)
class CloudField:
    """One field of a point.

    Attributes:
        name: As in PointField.
        kind: Its numpy type, little-endian.
        offset: Offset of its first byte in the point.
        value: Its value, one of VALUES.
        timed: Whether it is absent from scans whose points are all of one time.
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
        order: Of points. A grid is organised: 64 rows, or 128 for more than 64 lasers, and NaN
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
        """True if points have times; the stamp of the cloud is then the start of the turn."""
        return any(field.value in {'seconds', 'nanoseconds'} for field in self.fields)

    @property
    def is_unsigned(self) -> bool:
        """True if times cannot be negative, so that the stamp must be the start of the turn."""
        return any(field.value == 'nanoseconds' for field in self.fields)

    def fields_of(
        self, *, timed: bool, labelled: bool = False, extra: Mapping[str, str] | None = None
    ) -> tuple[CloudField, ...]:
        """Return the fields of a scan: whether its points have times, labels, extra columns."""
        fields = [field for field in self.fields if timed or not field.timed]
        step = self.point_step if len(fields) == len(self.fields) else fields[-1].end
        columns = (extra or {}) if self.extensible else {}
        for name, kind, value in (
            *(_LABELS if labelled else ()),
            *((name, kind, EXTRA) for name, kind in columns.items()),
        ):
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
