# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table: message types and what Rerun shows of them.

A row is a type and what is called once for each topic of it; what that gives is called with each
message. Further types are one more row.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import rerun as rr

from ..messages.clouds import decode_cloud, guess_intensity_scale
from ..messages.pixels import decode_pixels, picture_kind
from .boxes import Boxes2D, Boxes3D, unit_quaternions
from .cameras import Pinholes
from .colors import height_colors, reflectance_colors
from .entry import Entry, entity_path, image_frame
from .markers import Markers
from .survey import frame_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from ..messages.ros_types import (
        CompressedImage,
        ImageMsg,
        Imu,
        NavSatFix,
        Odometry,
        Path,
        PointCloud2,
        PoseStamped,
        String,
        TFMessage,
        TwistStamped,
    )
    from .entry import Context

Shower: TypeAlias = 'Callable[[Any], Iterable[Entry]]'
"""A message of a topic to what is shown of it; ValueError where it cannot be decoded."""

_POINT_PX = 1.5
_FIX_PX = 5.0
_AXIS_M = 1.0
_PATH_PX = 2.0
_PATH_RGB = (76, 175, 80)
_MEDIA = {'PNG': 'image/png', 'JPEG': 'image/jpeg'}
_AXES = ('x', 'y', 'z')
_AXES_RGB = ((231, 76, 60), (46, 204, 113), (52, 152, 219))


class Clouds:
    """sensor_msgs/PointCloud2: points coloured by reflectance, or by height where there is none."""

    def __init__(self, topic: str, context: Context) -> None:  # noqa: ARG002 - one form for all
        self._path = entity_path(topic)
        self._scale: float | None = None

    def __call__(self, message: PointCloud2) -> Iterator[Entry]:
        """One entry; points that are not finite are left out."""
        if self._scale is None and message.width * message.height:
            self._scale = guess_intensity_scale([message])
        points, _ = decode_cloud(message, self._scale or 1.0)
        reflectance = points[:, 3]
        colors = reflectance_colors(reflectance) if reflectance.any() else height_colors(points)
        components = rr.Points3D(points[:, :3], colors=colors, radii=rr.Radius.ui_points(_POINT_PX))
        yield Entry(self._path, [components], frame_name(message.header.frame_id))


class Images:
    """sensor_msgs/Image: its pixels."""

    def __init__(self, topic: str, context: Context) -> None:  # noqa: ARG002 - one form for all
        self._place = (entity_path(topic), image_frame(topic))

    def __call__(self, message: ImageMsg) -> Iterator[Entry]:
        """One entry; where it is in space, CameraInfo tells."""
        pixels = decode_pixels(message)
        path, frame = self._place
        yield Entry(path, [rr.Image(pixels, 'L' if pixels.ndim == 2 else 'BGR')], frame)


class CompressedImages:
    """sensor_msgs/CompressedImage: the bytes of its PNG or JPEG, untouched."""

    def __init__(self, topic: str, context: Context) -> None:  # noqa: ARG002 - one form for all
        self._place = (entity_path(topic), image_frame(topic))

    def __call__(self, message: CompressedImage) -> Iterator[Entry]:
        """One entry."""
        media = _MEDIA[picture_kind(message)]
        path, frame = self._place
        yield Entry(path, [rr.EncodedImage(contents=message.data, media_type=media)], frame)


class Transforms:
    """tf2_msgs/TFMessage: links between named frames.

    Rerun wants all links of a frame to its parent at one entity, whichever topic they come on.
    """

    def __init__(self, topic: str, context: Context) -> None:
        pass

    def __call__(self, message: TFMessage) -> Iterator[Entry]:
        """An entry for each link."""
        for link in message.transforms:
            child = frame_name(link.child_frame_id)
            place, turn = link.transform.translation, link.transform.rotation
            components = rr.Transform3D(
                translation=(place.x, place.y, place.z),
                quaternion=unit_quaternions([(turn.x, turn.y, turn.z, turn.w)])[0],
                parent_frame=frame_name(link.header.frame_id),
                child_frame=child,
            )
            yield Entry(entity_path('transforms', child), [components])


class Poses:
    """geometry_msgs/PoseStamped, PoseWithCovarianceStamped and nav_msgs/Odometry: axes at a place.

    Where no transform tells where Odometry's child frame is, Odometry does.
    """

    def __init__(self, topic: str, context: Context) -> None:
        self._path = entity_path(topic)
        self._linked = context.survey.parents

    def __call__(self, message: PoseStamped | Odometry) -> Iterator[Entry]:
        """One entry."""
        pose: Any = getattr(message.pose, 'pose', message.pose)
        child = frame_name(getattr(message, 'child_frame_id', ''))
        p, q = pose.position, pose.orientation
        components = rr.Transform3D(
            translation=(p.x, p.y, p.z),
            quaternion=unit_quaternions([(q.x, q.y, q.z, q.w)])[0],
            parent_frame=frame_name(message.header.frame_id),
            child_frame=child if child and child not in self._linked else None,
        )
        yield Entry(self._path, [components, rr.TransformAxes3D(_AXIS_M)])


class Paths:
    """nav_msgs/Path: a line through its poses."""

    def __init__(self, topic: str, context: Context) -> None:  # noqa: ARG002 - one form for all
        self._path = entity_path(topic)

    def __call__(self, message: Path) -> Iterator[Entry]:
        """One entry."""
        places = [stamped.pose.position for stamped in message.poses]
        strips = [[(p.x, p.y, p.z) for p in places]] if len(places) > 1 else []
        components = rr.LineStrips3D(
            strips, colors=[_PATH_RGB], radii=rr.Radius.ui_points(_PATH_PX)
        )
        yield Entry(self._path, [components], frame_name(message.header.frame_id))


class Fixes:
    """sensor_msgs/NavSatFix: a point on the map."""

    def __init__(self, topic: str, context: Context) -> None:  # noqa: ARG002 - one form for all
        self._path = entity_path(topic)

    def __call__(self, message: NavSatFix) -> Iterator[Entry]:
        """One entry; none without a position, which NavSatFix says as NaN."""
        place = (message.latitude, message.longitude)
        if all(map(math.isfinite, place)):
            radius = rr.Radius.ui_points(_FIX_PX)
            yield Entry(self._path, [rr.GeoPoints(lat_lon=[place], radii=radius)])


class Vectors:
    """Vectors of a message as three curves each.

    Args:
        topic: Its name.
        names: The fields of the message, or of its twist.
    """

    def __init__(self, topic: str, names: Sequence[str]) -> None:
        self._paths = {name: entity_path(topic, name) for name in names}
        self._named = False

    def __call__(self, message: Imu | TwistStamped) -> Iterator[Entry]:
        """An entry for each vector."""
        holder: Any = getattr(message, 'twist', message)
        for name, path in self._paths.items():
            vector = getattr(holder, name)
            names = [f'{name} {axis}' for axis in _AXES]
            lines = rr.SeriesLines(names=names, colors=_AXES_RGB)
            scalars = rr.Scalars([vector.x, vector.y, vector.z])
            yield Entry(path, [scalars], always=() if self._named else [lines])
        self._named = True


def _imu(topic: str, context: Context) -> Shower:  # noqa: ARG001 - one form for all
    return Vectors(topic, ('linear_acceleration', 'angular_velocity'))


def _twist(topic: str, context: Context) -> Shower:  # noqa: ARG001 - one form for all
    return Vectors(topic, ('linear', 'angular'))


def _text(topic: str, context: Context) -> Shower:  # noqa: ARG001 - one form for all
    path = entity_path(topic)

    def show(message: String) -> Iterator[Entry]:
        yield Entry(path, [rr.TextLog(message.data)])

    return show


TABLE: Mapping[str, Callable[[str, Context], Shower]] = {
    'geometry_msgs/msg/PoseStamped': Poses,
    'geometry_msgs/msg/PoseWithCovarianceStamped': Poses,
    'geometry_msgs/msg/TwistStamped': _twist,
    'nav_msgs/msg/Odometry': Poses,
    'nav_msgs/msg/Path': Paths,
    'sensor_msgs/msg/CameraInfo': Pinholes,
    'sensor_msgs/msg/CompressedImage': CompressedImages,
    'sensor_msgs/msg/Image': Images,
    'sensor_msgs/msg/Imu': _imu,
    'sensor_msgs/msg/NavSatFix': Fixes,
    'sensor_msgs/msg/PointCloud2': Clouds,
    'std_msgs/msg/String': _text,
    'tf2_msgs/msg/TFMessage': Transforms,
    'vision_msgs/msg/Detection2DArray': Boxes2D,
    'vision_msgs/msg/Detection3DArray': Boxes3D,
    'visualization_msgs/msg/Marker': Markers,
    'visualization_msgs/msg/MarkerArray': Markers,
}
