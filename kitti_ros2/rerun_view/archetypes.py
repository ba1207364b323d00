# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of message types with their converters to Rerun archetypes.

To support another type, add a row with its converter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import rerun as rr

from ..messages.clouds import decode_cloud, guess_intensity_scale
from ..messages.pixels import decode_compressed_pixels, decode_pixels, picture_kind
from .boxes import Box2DConverter, Box3DConverter, rows_of, unit_quaternions
from .cameras import PinholeConverter
from .colors import height_colors, reflectance_colors
from .entities import Converter, EntityUpdate, entity_path, image_frame
from .markers import MarkerConverter
from .program_survey import frame_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ..messages.ros_types import (
        CompressedImage,
        Header,
        ImageMsg,
        NavSatFix,
        Odometry,
        Path,
        Point,
        PointCloud2,
        PoseStamped,
        Quaternion,
        String,
        TFMessage,
        Vector3,
    )
    from .entities import Context

_POINT_PX = 1.5
_FIX_PX = 5.0
_AXIS_M = 1.0
_PATH_PX = 2.0
_PATH_RGB = (76, 175, 80)
_MEDIA = {'PNG': 'image/png', 'JPEG': 'image/jpeg'}
_FIX_RGB = (231, 76, 60)
_AXES = rr.SeriesLines(names=list('xyz'), colors=((231, 76, 60), (46, 204, 113), (52, 152, 219)))


class CloudConverter(Converter):
    """sensor_msgs/PointCloud2: points coloured by reflectance, or by height without it."""

    _scale: float | None = None

    def convert(self, message: PointCloud2) -> Iterator[EntityUpdate]:
        """Yield one update without points that are not finite."""
        if self._scale is None and message.width * message.height:
            self._scale = guess_intensity_scale([message])
        points, _ = decode_cloud(message, self._scale or 1.0)
        reflectance = points[:, 3]
        colors = reflectance_colors(reflectance) if reflectance.any() else height_colors(points)
        components = rr.Points3D(points[:, :3], colors=colors, radii=rr.Radius.ui_points(_POINT_PX))
        yield EntityUpdate(self.path, [components], frame_name(message.header.frame_id))


class ImageConverter(Converter):
    """sensor_msgs/Image: its pixels; CameraInfo gives the place in space."""

    def convert(self, message: ImageMsg) -> Iterator[EntityUpdate]:
        """Yield one update."""
        pixels = decode_pixels(message)
        components = rr.Image(pixels, 'L' if pixels.ndim == 2 else 'BGR')
        yield EntityUpdate(self.path, [components], image_frame(self.topic))


class CompressedImageConverter(Converter):
    """sensor_msgs/CompressedImage: the unchanged bytes of its PNG or JPEG, or the pixels."""

    def convert(self, message: CompressedImage) -> Iterator[EntityUpdate]:
        """Yield one update."""
        media = _MEDIA.get(picture_kind(message))
        components: rr.EncodedImage | rr.Image
        if media is None:
            pixels = decode_compressed_pixels(message)
            components = rr.Image(pixels, 'L' if pixels.ndim == 2 else 'BGR')
        else:
            components = rr.EncodedImage(contents=message.data, media_type=media)
        yield EntityUpdate(self.path, [components], image_frame(self.topic))


class TransformConverter(Converter):
    """tf2_msgs/TFMessage: links between named frames.

    Rerun needs all links of a frame to its parent at one entity, whatever their topic.
    """

    def convert(self, message: TFMessage) -> Iterator[EntityUpdate]:
        """Yield an update for each link."""
        for link in message.transforms:
            child = frame_name(link.child_frame_id)
            place, turn = link.transform.translation, link.transform.rotation
            components = _transform(link.header, place, turn, child)
            yield EntityUpdate(entity_path('transforms', child), [components])


class PoseConverter(Converter):
    """geometry_msgs/PoseStamped, PoseWithCovarianceStamped and nav_msgs/Odometry: axes at a place.

    If no transform places the child frame of an Odometry, the Odometry does.
    """

    def convert(self, message: PoseStamped | Odometry) -> Iterator[EntityUpdate]:
        """Yield one update."""
        pose: Any = getattr(message.pose, 'pose', message.pose)
        child = frame_name(getattr(message, 'child_frame_id', ''))
        linked = child in self.context.survey.parents
        child_frame = None if linked or not child else child
        components = _transform(message.header, pose.position, pose.orientation, child_frame)
        yield EntityUpdate(self.path, [components], always=[rr.TransformAxes3D(_AXIS_M)])


class PathConverter(Converter):
    """nav_msgs/Path: a line through its poses."""

    def convert(self, message: Path) -> Iterator[EntityUpdate]:
        """Yield one update."""
        places = rows_of(stamped.pose.position for stamped in message.poses)
        strips = [places] if len(places) > 1 else []
        radii = rr.Radius.ui_points(_PATH_PX)
        components = rr.LineStrips3D(strips, colors=[_PATH_RGB], radii=radii)
        yield EntityUpdate(self.path, [components], frame_name(message.header.frame_id))


class FixConverter(Converter):
    """sensor_msgs/NavSatFix: a point on the map, and at the end a line through all points."""

    def __init__(self, topic: str, context: Context) -> None:
        super().__init__(topic, context)
        self._track: list[tuple[float, float]] = []

    def convert(self, message: NavSatFix) -> Iterator[EntityUpdate]:
        """Yield one update; none without a position (NaN in NavSatFix)."""
        place = (message.latitude, message.longitude)
        if all(map(math.isfinite, place)):
            self._track.append(place)
            radii = rr.Radius.ui_points(_FIX_PX)
            yield EntityUpdate(
                self.path, [rr.GeoPoints(lat_lon=[place], radii=radii, colors=_FIX_RGB)]
            )

    def flush(self) -> Iterator[EntityUpdate]:
        """Yield the line."""
        if len(self._track) > 1:
            radii = rr.Radius.ui_points(_PATH_PX)
            line = rr.GeoLineStrings(lat_lon=[self._track], colors=[_PATH_RGB], radii=radii)
            yield EntityUpdate(entity_path(self.topic, 'track'), always=[line])


class VectorConverter(Converter):
    """sensor_msgs/Imu and geometry_msgs/TwistStamped: three curves for each of their vectors."""

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield one update for each vector."""
        holder = getattr(message, 'twist', message)
        for name in VECTORS[message.__msgtype__]:
            vector = getattr(holder, name)
            path = entity_path(self.topic, name)
            yield EntityUpdate(path, always=[_AXES], scalars=(vector.x, vector.y, vector.z))


class TextConverter(Converter):
    """std_msgs/String: a line of a log."""

    def convert(self, message: String) -> Iterator[EntityUpdate]:
        """Yield one update."""
        yield EntityUpdate(self.path, [rr.TextLog(message.data)])


def _transform(
    header: Header, place: Point | Vector3, turn: Quaternion, child: str | None
) -> rr.Transform3D:
    return rr.Transform3D(
        translation=(place.x, place.y, place.z),
        quaternion=unit_quaternions([turn])[0],
        parent_frame=frame_name(header.frame_id),
        child_frame=child,
    )


VECTORS: Mapping[str, tuple[str, str]] = {
    'geometry_msgs/msg/TwistStamped': ('linear', 'angular'),
    'sensor_msgs/msg/Imu': ('linear_acceleration', 'angular_velocity'),
}
"""The vectors of a message type that are shown as curves."""
TABLE: Mapping[str, type[Converter]] = {
    'geometry_msgs/msg/PoseStamped': PoseConverter,
    'geometry_msgs/msg/PoseWithCovarianceStamped': PoseConverter,
    'geometry_msgs/msg/TwistStamped': VectorConverter,
    'nav_msgs/msg/Odometry': PoseConverter,
    'nav_msgs/msg/Path': PathConverter,
    'sensor_msgs/msg/CameraInfo': PinholeConverter,
    'sensor_msgs/msg/CompressedImage': CompressedImageConverter,
    'sensor_msgs/msg/Image': ImageConverter,
    'sensor_msgs/msg/Imu': VectorConverter,
    'sensor_msgs/msg/NavSatFix': FixConverter,
    'sensor_msgs/msg/PointCloud2': CloudConverter,
    'std_msgs/msg/String': TextConverter,
    'tf2_msgs/msg/TFMessage': TransformConverter,
    'vision_msgs/msg/Detection2DArray': Box2DConverter,
    'vision_msgs/msg/Detection3DArray': Box3DConverter,
    'visualization_msgs/msg/Marker': MarkerConverter,
    'visualization_msgs/msg/MarkerArray': MarkerConverter,
}
