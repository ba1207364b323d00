# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with Foxglove's schemas -> the ROS messages of the same content."""

from __future__ import annotations

import binascii
import struct
from base64 import b64decode
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

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
from ..model.geometry import Transform
from ..model.streams import NS_PER_S, to_sec_nanosec
from .cdr import CdrWriter, join, make_header, make_pose, serialize
from .ros_types import (
    TYPESTORE,
    CameraInfo,
    CompressedImage,
    ImageMsg,
    Marker,
    NavSatFix,
    NavSatStatus,
    Odometry,
    Point,
    PointCloud2,
    PointField,
    Pose,
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
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
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
    count, rest = divmod(len(data), stride) if stride else (0, len(data))
    if rest:
        raise ValueError(f'its data has {len(data)} bytes, no multiple of point_stride, {stride}')
    fields, names, formats, offsets = [], [], [], []
    for child in cloud.children('fields'):
        name, offset, kind = child.text('name'), child.integer('offset'), child.integer('type')
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


# The fields of a message with one of Foxglove's schemas, in protobuf, JSON or ROS encoding.
#
# A missing field has its default value, as in protobuf: older versions of a schema have fewer
# fields.

_SECONDS = ('sec', 'seconds')
_NANOSECONDS = ('nsec', 'nanos', 'nanosec')
_LARGEST = 2**32 - 1


class Fields:
    """The fields of a protobuf or ROS message, by the names of Foxglove's schemas.

    ROS spells all names in lower case. Subclasses read other encodings.

    Args:
        message: The decoded message; None is one without fields.
    """

    def __init__(self, message: Any) -> None:  # noqa: ANN401 - of any encoding
        self._message = message

    def value(self, name: str) -> Any:  # noqa: ANN401 - of any type
        """Return the value of a field, None if it is missing."""
        field = getattr(self._message, name, None)
        if field is None:
            return getattr(self._message, name.lower(), None)
        if hasattr(field, 'DESCRIPTOR') and not self._message.HasField(name):
            return None
        return field

    def text(self, name: str) -> str:
        """Return a string.

        Raises:
            ValueError: The value is of another type; so do all others.
        """
        text = self.value(name)
        if text is None:
            return ''
        if not isinstance(text, str):
            raise _wrong(name, 'a string', text)
        return text

    def number(self, name: str, default: float = 0.0) -> float:
        """Return a number."""
        number = self.value(name)
        if number is None:
            return default
        if isinstance(number, bool) or not isinstance(number, (int, float, np.number)):
            raise _wrong(name, 'a number', number)
        try:
            return float(number)
        except OverflowError as error:
            raise _wrong(name, 'a number', number) from error

    def integer(self, name: str, largest: int = _LARGEST) -> int:
        """Return an integer of 0 or more."""
        number = self.number(name)
        if not 0 <= number <= largest or number != int(number):
            raise _wrong(name, f'an integer from 0 to {largest}', number)
        return int(number)

    def numbers(self, name: str, *counts: int) -> Float64Array:
        """Return (N,) numbers; if counts are given, N is one of them."""
        sequence = self.value(name)
        try:
            numbers = np.array([] if sequence is None else sequence, np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise _wrong(name, 'a list of numbers', sequence) from error
        if numbers.ndim != 1 or (counts and len(numbers) not in counts):
            expected = ' or '.join(map(str, counts)) or 'a list of'
            raise _wrong(name, f'{expected} numbers', sequence)
        return numbers

    def data(self, name: str) -> bytes | memoryview:
        """Return bytes."""
        data = self.value(name)
        if isinstance(data, np.ndarray) and data.dtype == np.uint8:
            return memoryview(data.tobytes())
        if data is None:
            return b''
        if not isinstance(data, bytes):
            raise _wrong(name, 'bytes', data)
        return data

    def child(self, name: str) -> Fields:
        """Return the fields of a nested message; of a missing one all are missing."""
        return type(self)(self.value(name))

    def children(self, name: str) -> list[Fields]:
        """Return the fields of each message of a list."""
        messages = self.value(name)
        try:
            return [type(self)(message) for message in messages or ()]
        except TypeError as error:
            raise _wrong(name, 'a list', messages) from error

    def stamp_ns(self, name: str, default_ns: int) -> int:
        """Return a time, nanoseconds, or the default if the field is missing."""
        if self.value(name) is None:
            return default_ns
        time = self.child(name)
        seconds, nanoseconds = (
            next((key for key in keys if time.value(key) is not None), keys[0])
            for keys in (_SECONDS, _NANOSECONDS)
        )
        whole = time.integer(seconds, 2**31 - 1)
        return whole * NS_PER_S + time.integer(nanoseconds, NS_PER_S - 1)

    def xyz(self, name: str) -> tuple[float, float, float]:
        """Return a Vector3 or Point3."""
        point = self.child(name)
        return point.number('x'), point.number('y'), point.number('z')

    def xyzw(self, name: str) -> tuple[float, float, float, float]:
        """Return a Quaternion; a missing one, or one of zeros, is the identity."""
        fields = self.child(name)
        quaternion = (*self.xyz(name), fields.number('w'))
        return quaternion if any(quaternion) else (0.0, 0.0, 0.0, 1.0)

    def pose(self, name: str) -> Transform:
        """Return a Pose; a missing one is the identity.

        Raises:
            ValueError: Its numbers are no pose.
        """
        fields = self.child(name)
        xyzw = np.array(fields.xyzw('orientation'))
        position = np.array(fields.xyz('position'))
        length = np.linalg.norm(xyzw)
        if not (np.isfinite(position).all() and np.isfinite(length) and length > 0):
            raise ValueError(f'{name} is no pose: {position.tolist()}, {xyzw.tolist()}')
        return Transform.from_quaternion(xyzw / length, position)


class JsonFields(Fields):
    """The fields of a JSON object; bytes are base64.

    Args:
        message: The object as a dict; None is one without fields.

    Raises:
        ValueError: It is no object.
    """

    def __init__(self, message: Mapping[str, Any] | None) -> None:
        if message is not None and not isinstance(message, dict):
            raise ValueError(f'{_shown(message)} is no JSON object')
        super().__init__(message or {})

    def value(self, name: str) -> Any:  # noqa: ANN401 - of any type
        """Return the value of a field, None if it is missing."""
        return self._message.get(name)

    def data(self, name: str) -> bytes:
        """Return bytes."""
        try:
            return b64decode(self.text(name), validate=True)
        except (binascii.Error, ValueError) as error:
            raise ValueError(f'{name} is no base64 ({error})') from error

    def children(self, name: str) -> list[Fields]:
        """Return the fields of each object of a list."""
        messages = self.value(name)
        if messages is not None and not isinstance(messages, list):
            raise _wrong(name, 'a list', messages)
        return [JsonFields(message) for message in messages or ()]


def _wrong(name: str, expected: str, actual: object) -> ValueError:
    return ValueError(f'{name} is {_shown(actual)}; expected {expected}')


def _shown(value: object) -> str:
    """Return a value as a short text."""
    if isinstance(value, (str, int, float)):
        text = repr(value)
        return text if len(text) <= 40 else f'{text[:36]} ...'
    return f'a {type(value).__name__}'


# Foxglove's SceneUpdate -> visualization_msgs/MarkerArray: its cubes, which are boxes.
#
# A cube's namespace is the id of its entity, its text begins with the class: the value of a
# metadata key such as `category` (nuscenes2mcap writes it), or the entity's text. Entities without
# cubes that are drawn as pairs of points become line lists. Spheres, arrows, models and other
# shapes are no boxes and are not converted.

CLASS_KEYS = (
    'class',
    'category',
    'label',
    'type',
    'class_name',
    'category_name',
    'classification',
    'object_class',
    'object_type',
)
"""Keys of metadata, in lower case, whose value is the class of an entity."""

_SCORE_KEYS = ('score', 'confidence', 'probability')
_LINE_LIST = 2  # LinePrimitive.Type
_ALL = 1  # SceneEntityDeletion.Type
_NOTHING = np.empty(0, np.uint8)


class _Entity(NamedTuple):
    """Stamp (nanoseconds), frame and id."""

    stamp_ns: int
    frame_id: str
    name: str


def encode_scene(scene: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    """Make the MarkerArray of a SceneUpdate.

    Args:
        scene: The message.
        log_ns: Stamp of what has none, nanoseconds.

    Raises:
        ValueError: A value is of a wrong type.
    """
    markers = [_deletion(child, log_ns) for child in scene.children('deletions')]
    for entity in scene.children('entities'):
        owner = _Entity(
            entity.stamp_ns('timestamp', log_ns), entity.text('frame_id'), entity.text('id')
        )
        text = _caption(entity)
        cubes = entity.children('cubes')
        for number, cube in enumerate(cubes):
            marker = _marker(owner, number, Marker.CUBE)
            marker.pose = make_pose(cube.pose('pose'))
            marker.scale = Vector3(*cube.xyz('size'))
            marker.text = text
            _paint(marker, cube)
            markers.append(marker)
        if not cubes:
            lines = entity.children('lines')
            pairs = [line for line in lines if line.integer('type') == _LINE_LIST]
            markers += [_lines(owner, number, pair) for number, pair in enumerate(pairs)]
    return TYPESTORE.types[MARKERS](markers)


def _caption(entity: Fields) -> str:
    """Return class, texts and score of an entity, a line each; the first is the class if known."""
    metadata = {
        child.text('key').lower(): child.text('value') for child in entity.children('metadata')
    }
    lines = [metadata[key] for key in CLASS_KEYS if metadata.get(key)][:1]
    lines += [child.text('text') for child in entity.children('texts')]
    lines += [metadata[key] for key in _SCORE_KEYS if metadata.get(key)][:1]
    return '\n'.join(line for line in lines if line)


def _deletion(deletion: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    owner = _Entity(deletion.stamp_ns('timestamp', log_ns), '', deletion.text('id'))
    marker = _marker(owner, 0, Marker.CUBE)
    is_all = deletion.integer('type') == _ALL
    marker.action = Marker.DELETEALL if is_all else Marker.DELETE
    return marker


def _lines(owner: _Entity, number: int, line: Fields) -> Any:  # noqa: ANN401 - a rosbags class
    points = [
        Point(child.number('x'), child.number('y'), child.number('z'))
        for child in line.children('points')
    ]
    indices = line.numbers('indices')
    if len(indices):
        if not ((indices >= 0) & (indices < len(points))).all():
            raise ValueError('indices of a line are beyond its points')
        points = [points[int(index)] for index in indices]
    marker = _marker(owner, number, Marker.LINE_LIST)
    marker.pose = make_pose(line.pose('pose'))
    marker.scale = Vector3(line.number('thickness'), 0.0, 0.0)
    marker.points = points
    _paint(marker, line)
    return marker


def _marker(owner: _Entity, number: int, kind: int) -> Any:  # noqa: ANN401 - a rosbags class
    header = make_header(owner.stamp_ns, owner.frame_id)
    types = TYPESTORE.types
    return types['visualization_msgs/msg/Marker'](
        header=header,
        ns=owner.name,
        id=number,
        type=kind,
        action=Marker.ADD,
        pose=Pose(Point(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)),
        scale=Vector3(0.0, 0.0, 0.0),
        color=types['std_msgs/msg/ColorRGBA'](0.0, 0.0, 0.0, 0.0),
        lifetime=types['builtin_interfaces/msg/Duration'](*to_sec_nanosec(0)),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource='',
        texture=CompressedImage(make_header(0, ''), '', _NOTHING),
        uv_coordinates=[],
        text='',
        mesh_resource='',
        mesh_file=types['visualization_msgs/msg/MeshFile']('', _NOTHING),
        mesh_use_embedded_materials=False,
    )


def _paint(marker: Any, shape: Fields) -> None:  # noqa: ANN401 - a rosbags class
    color = shape.child('color')
    for name in 'rgba':
        setattr(marker.color, name, color.number(name))


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
    'SceneUpdate': Translation(MARKERS, encode_scene),
}
"""By the name of the schema, without its package."""
