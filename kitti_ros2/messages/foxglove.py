# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with Foxglove's schemas -> the ROS messages of the same content."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype

from ..model.bag_formats import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    COMPRESSED_VIDEO,
    FIX,
    IMAGE,
    MARKERS,
    ODOMETRY,
    POSE,
    TF,
)
from ..model.streams import to_sec_nanosec
from .cdr import CdrWriter, join, make_header, make_pose, serialize
from .foxglove_scene import encode_boxes, encode_shapes
from .ros_types import (
    TYPESTORE,
    CameraInfo,
    CompressedImage,
    ImageMsg,
    NavSatFix,
    NavSatStatus,
    Odometry,
    PointCloud2,
    PointField,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    RegionOfInterest,
    TFMessage,
    Time,
    TransformMsg,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from ..model.geometry import Transform
    from .foxglove_fields import Fields
    from .ros_types import Header


# Foxglove's PointCloud -> sensor_msgs/PointCloud2; the points are not copied one by one.


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
    if len(data) % stride if stride else len(data):
        raise ValueError(f'its data has {len(data)} bytes, no multiple of point_stride, {stride}')
    fields = []
    for child in cloud.children('fields'):
        name, offset, kind = child.text('name'), child.integer('offset'), child.integer('type')
        if kind not in _TYPES:
            raise ValueError(f'its field {name} is of the unknown type {kind}')
        datatype, form = _TYPES[kind]
        if offset + np.dtype(form).itemsize > stride:
            raise ValueError(f'its field {name} ends beyond point_stride, {stride}')
        fields.append(PointField(name, offset, datatype, 1))
    return place_cloud(cloud, log_ns, fields, stride, data)


def place_cloud(
    cloud: Fields,
    log_ns: int,
    fields: Sequence[PointField],
    stride: int,
    data: bytes | memoryview,
) -> PointCloud2:
    """Make the PointCloud2 of packed points at the time, in the frame and the pose of a message.

    Args:
        cloud: A PointCloud or CompressedPointCloud.
        log_ns: Its stamp if it has none, nanoseconds.
        fields: Of a point, each within it.
        stride: Bytes of a point.
        data: Whole points.

    Raises:
        ValueError: Points with a pose have no x, y and z.
    """
    count = len(data) // stride if stride else 0
    names = [field.name for field in fields]
    pose = cloud.pose('pose')
    points = np.frombuffer(data, np.uint8)
    if count and not np.array_equal(pose.matrix(), np.eye(4)):
        if len(set(names)) < len(names) or not {'x', 'y', 'z'} <= set(names):
            raise ValueError('it has a pose, and its points have no x, y and z to apply it to')
        forms = dict(_TYPES.values())
        layout = {
            'names': names,
            'formats': [forms[field.datatype] for field in fields],
            'offsets': [field.offset for field in fields],
            'itemsize': stride,
        }
        points = _moved(points, np.dtype(layout), pose)  # type: ignore[call-overload]
    return PointCloud2(
        header=make_header(cloud.stamp_ns('timestamp', log_ns), cloud.text('frame_id')),
        height=1,
        width=count,
        fields=list(fields),
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


# Messages with Foxglove's schemas -> the ROS messages of the same content.
#
# Source: https://docs.foxglove.dev/docs/sdk/schemas, and the files of foxglove-schemas-protobuf
# 0.4. Coordinates, angles and units are those of ROS. A message without a time has its log time.

if TYPE_CHECKING:
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
        earlier_losses: Returns what the message had lost before it was stored.
    """

    msgtype: str
    encode: Encode
    earlier_losses: Callable[[Fields], Sequence[str]] = lambda _fields: ()


def translate(translation: Translation, fields: Fields, log_ns: int) -> bytes:
    """Return the ROS message of a message's fields as CDR.

    Raises:
        ValueError: A value is of a wrong type or invalid.
    """
    try:
        encoded = translation.encode(fields, log_ns)
        return encoded if isinstance(encoded, bytes) else join(serialize(encoded))
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


def _video(fields: Fields, log_ns: int) -> bytes:
    cdr = CdrWriter()
    cdr.header(fields.stamp_ns('timestamp', log_ns), fields.text('frame_id'))
    data = fields.data('data')
    cdr.uint32(len(data))
    cdr.octets(bytes(data))
    cdr.text(fields.text('format'))
    return cdr.finish()


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
    return TFMessage([_transform(child, log_ns) for child in fields.children('transforms')])


def _pose(fields: Fields, log_ns: int) -> PoseStamped:
    return PoseStamped(_header(fields, log_ns), make_pose(fields.pose('pose')))


def _poses(fields: Fields, log_ns: int) -> bytes:
    """Serialise a PoseArray: the poses have no times of their own, as those of a Path would."""
    cdr = CdrWriter()
    cdr.header(fields.stamp_ns('timestamp', log_ns), fields.text('frame_id'))
    poses = fields.children('poses')
    cdr.uint32(len(poses))
    for pose in poses:
        cdr.float64((*pose.xyz('position'), *pose.xyzw('orientation')))
    return cdr.finish()


def _odometry(fields: Fields, log_ns: int) -> Odometry:
    pose_covariance, velocity_covariance = (
        np.resize(values, 36) if len(values := fields.numbers(name, 0, 36)) else np.zeros(36)
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
    'CompressedVideo': Translation(COMPRESSED_VIDEO, _video),
    'FrameTransform': Translation(TF, lambda tf, ns: TFMessage([_transform(tf, ns)])),
    'FrameTransforms': Translation(TF, _transforms),
    'LaserScan': Translation(LASER_SCAN, _laser_scan),
    'LocationFix': Translation(FIX, _fix),
    'Odometry': Translation(ODOMETRY, _odometry),
    'PointCloud': Translation(CLOUD, encode_cloud),
    'PoseInFrame': Translation(POSE, _pose),
    'PosesInFrame': Translation(POSE_ARRAY, _poses),
    'RawImage': Translation(IMAGE, _image),
    'SceneUpdate': Translation(MARKERS, encode_boxes),
}
"""By the name of the schema, without its package."""


# Schemas that have no counterpart in ROS -> messages of foxglove_msgs, which has all schemas.


def _of_foxglove_msgs(name: str) -> Translation:
    msgtype = f'foxglove_msgs/msg/{name}'
    return Translation(msgtype, lambda fields, log_ns: _mirrored(msgtype, fields, log_ns))


def _mirrored(msgtype: str, fields: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    """Make a message of a type with the fields of its schema; missing times are the log time."""
    values = [
        _mirrored_value(name, description, fields, log_ns)
        for name, description in TYPESTORE.fielddefs[msgtype][1]
    ]
    return TYPESTORE.types[msgtype](*values)


def _mirrored_value(name: str, description: Any, fields: Fields, log_ns: int) -> Any:  # noqa: ANN401
    kind, content = description
    if kind == Nodetype.SEQUENCE:
        (element, inner), _ = content
        if element == Nodetype.BASE:
            return np.frombuffer(fields.data(name), np.uint8)
        return [_mirrored(inner, child, log_ns) for child in fields.children(name)]
    if kind == Nodetype.BASE:
        readers: dict[str, Callable[[str], Any]] = {'string': fields.text, 'float64': fields.number}
        return readers.get(content[0], fields.integer)(name)
    if content == 'builtin_interfaces/msg/Time':
        return Time(*to_sec_nanosec(fields.stamp_ns(name, log_ns)))
    if content == 'geometry_msgs/msg/Pose':
        return make_pose(fields.pose(name))
    return _mirrored(content, fields.child(name), log_ns)


OF_COPIES = {
    'SceneUpdate': Translation(MARKERS, encode_shapes),
    **{name: _of_foxglove_msgs(name) for name in ('GeoJSON', 'Grid', 'ImageAnnotations', 'Log')},
}
"""Of bags that are written as other bags: all shapes of a scene, and what ROS has no counterpart
of."""
