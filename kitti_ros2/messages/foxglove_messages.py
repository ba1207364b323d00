# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with Foxglove's schemas -> the ROS messages of the same content.

Source: https://docs.foxglove.dev/docs/sdk/schemas, and the files of foxglove-schemas-protobuf 0.4.
Coordinates, angles and units are those of ROS. A message without a time has its log time.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ..model.msgtypes import CAMERA_INFO, CLOUD, COMPRESSED, FIX, IMAGE, MARKERS, ODOMETRY, POSE, TF
from .cdr import join, serialize
from .cdr_writer import CdrWriter
from .foxglove_clouds import encode_cloud
from .foxglove_scene import encode_scene
from .header import make_header, make_pose
from .ros_types import (
    CameraInfo,
    CompressedImage,
    ImageMsg,
    NavSatFix,
    NavSatStatus,
    Odometry,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    RegionOfInterest,
    TFMessage,
    TransformMsg,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from .foxglove_fields import Fields
    from .ros_types import Header

    Encode: TypeAlias = Callable[[Fields, int], Any]

LASER_SCAN = 'sensor_msgs/msg/LaserScan'
POSE_ARRAY = 'geometry_msgs/msg/PoseArray'

_GPS = 1  # NavSatStatus.SERVICE_GPS
_KINDS_OF_COVARIANCE = 3


class Translation(NamedTuple):
    """The ROS message that a schema of Foxglove becomes.

    Attributes:
        msgtype: Its type.
        encode: Makes it of the fields and the log time (nanoseconds): a message of a rosbags class,
            or the serialised message.
    """

    msgtype: str
    encode: Encode


def translate(translation: Translation, fields: Fields, log_ns: int) -> bytes:
    """Return the ROS message of a message's fields as CDR.

    Raises:
        ValueError: A value is of a wrong type or invalid.
    """
    try:
        made = translation.encode(fields, log_ns)
        return made if isinstance(made, bytes) else join(serialize(made))
    except (OverflowError, struct.error) as error:
        raise ValueError(f'a number is beyond its type in ROS ({error})') from error


def _header(fields: Fields, log_ns: int) -> Header:
    return make_header(fields.stamp_ns('timestamp', log_ns), fields.text('frame_id'))


def _image(fields: Fields, log_ns: int) -> ImageMsg:
    data = np.frombuffer(fields.data('data'), np.uint8)
    size = fields.integer('height'), fields.integer('width')
    step, encoding = fields.integer('step'), fields.text('encoding')
    if len(data) < size[0] * step:
        raise ValueError(f'its data has {len(data)} bytes; {size[0]} rows need {size[0] * step}')
    return ImageMsg(_header(fields, log_ns), *size, encoding, 0, step, data)


def _compressed(fields: Fields, log_ns: int) -> CompressedImage:
    data = np.frombuffer(fields.data('data'), np.uint8)
    return CompressedImage(_header(fields, log_ns), fields.text('format'), data)


def _camera_info(fields: Fields, log_ns: int) -> CameraInfo:
    """Make a CameraInfo; a missing K, R or P is of zeros, which are missing in ROS as well."""
    k, r, p = (
        np.resize(fields.numbers(name, 0, count), count) if fields.numbers(name).any()
        else np.zeros(count)
        for name, count in (('K', 9), ('R', 9), ('P', 12))
    )  # fmt: skip
    return CameraInfo(
        header=_header(fields, log_ns),
        height=fields.integer('height'),
        width=fields.integer('width'),
        distortion_model=fields.text('distortion_model'),
        d=fields.numbers('D'),
        k=k,
        r=r,
        p=p,
        binning_x=0,
        binning_y=0,
        roi=RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


def _transform(fields: Fields, log_ns: int) -> TransformStamped:
    return TransformStamped(
        make_header(fields.stamp_ns('timestamp', log_ns), fields.text('parent_frame_id')),
        fields.text('child_frame_id'),
        TransformMsg(
            Vector3(*fields.xyz('translation')),
            Quaternion(*fields.xyzw('rotation')),
        ),
    )


def _transforms(fields: Fields, log_ns: int) -> TFMessage:
    return TFMessage([_transform(each, log_ns) for each in fields.children('transforms')])


def _pose(fields: Fields, log_ns: int) -> PoseStamped:
    return PoseStamped(_header(fields, log_ns), make_pose(fields.pose('pose')))


def _poses(fields: Fields, log_ns: int) -> bytes:
    """Serialise a PoseArray: the poses have no times of their own, as those of a Path would."""
    cdr = CdrWriter()
    cdr.header(fields.stamp_ns('timestamp', log_ns), fields.text('frame_id'))
    poses = fields.children('poses')
    cdr.uint32(len(poses))
    for each in poses:
        cdr.float64((*each.xyz('position'), *each.xyzw('orientation')))
    return cdr.finish()


def _odometry(fields: Fields, log_ns: int) -> Odometry:
    pose_covariance, velocity_covariance = (
        np.resize(found, 36) if len(found := fields.numbers(name, 0, 36)) else np.zeros(36)
        for name in ('pose_covariance', 'velocity_covariance')
    )
    twist = Twist(Vector3(*fields.xyz('linear_velocity')), Vector3(*fields.xyz('angular_velocity')))
    return Odometry(
        _header(fields, log_ns),
        fields.text('body_frame_id'),
        PoseWithCovariance(make_pose(fields.pose('pose')), pose_covariance),
        TwistWithCovariance(twist, velocity_covariance),
    )


def _fix(fields: Fields, log_ns: int) -> NavSatFix:
    covariance = fields.numbers('position_covariance', 0, 9)
    return NavSatFix(
        _header(fields, log_ns),
        NavSatStatus(NavSatStatus.STATUS_FIX, _GPS),  # type: ignore[arg-type]
        fields.number('latitude'),
        fields.number('longitude'),
        fields.number('altitude'),
        covariance if len(covariance) else np.zeros(9),
        fields.integer('position_covariance_type', _KINDS_OF_COVARIANCE),
    )


def _laser_scan(fields: Fields, log_ns: int) -> bytes:
    """Serialise a LaserScan; Foxglove's has no times of single returns, and no limits of range.

    Raises:
        ValueError: It has a pose in its frame, which ROS has no field for.
    """
    pose = fields.pose('pose')
    if not np.array_equal(pose.matrix(), np.eye(4)):
        raise ValueError(
            'its pose in its frame is not the identity, which LaserScan has no field for'
        )
    ranges, intensities = fields.numbers('ranges'), fields.numbers('intensities')
    first, last = fields.number('start_angle'), fields.number('end_angle')
    step = (last - first) / (len(ranges) - 1) if len(ranges) > 1 else 0.0
    cdr = CdrWriter()
    cdr.header(fields.stamp_ns('timestamp', log_ns), fields.text('frame_id'))
    for value in (first, last, step, 0.0, 0.0, 0.0, np.inf):
        cdr.float32(value)
    for values in (ranges, intensities):
        cdr.uint32(len(values))
        cdr.octets(values.astype('<f4').tobytes())
    return cdr.finish()


TRANSLATIONS = {
    'CameraCalibration': Translation(CAMERA_INFO, _camera_info),
    'CompressedImage': Translation(COMPRESSED, _compressed),
    'FrameTransform': Translation(TF, lambda each, ns: TFMessage([_transform(each, ns)])),
    'FrameTransforms': Translation(TF, _transforms),
    'LaserScan': Translation(LASER_SCAN, _laser_scan),
    'LocationFix': Translation(FIX, _fix),
    'Odometry': Translation(ODOMETRY, _odometry),
    'PointCloud': Translation(CLOUD, encode_cloud),
    'PoseInFrame': Translation(POSE, _pose),
    'PosesInFrame': Translation(POSE_ARRAY, _poses),
    'RawImage': Translation(IMAGE, _image),
    'SceneUpdate': Translation(MARKERS, encode_scene),
}
"""By the name of the schema, without its package."""
