# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of message types with their converters to Rerun archetypes.

A row with a converter adds a type.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import rerun as rr

from ..drawing.labelled_objects import PREDICTION_COLOR, rgb_of
from ..messages.camera_info import LENS_MODELS, camera_model
from ..messages.cdr import stamp_ns_of, transform_of
from ..messages.clouds import decode_cloud, guess_intensity_scale
from ..messages.images import decode_compressed_pixels, decode_pixels, picture_kind
from ..messages.naming import without_transport
from ..messages.rectified_cameras import has_lens_of_larger_image
from ..messages.ros_types import Marker
from ..messages.topics import prediction_topics
from ..messages.videos import codec_of, is_video
from ..model.bag_formats import DETECTIONS_3D, VIDEOS
from ..model.boxes import DONT_CARE
from ..model.geometry import Transform
from ..model.streams import from_sec_nanosec
from .rerun_series import frame_name

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence

    import numpy.typing as npt
    from rerun import AsComponents

    from ..messages.camera_info import CameraModel
    from ..messages.rectified_cameras import Viewpoint
    from ..messages.ros_types import (
        CameraInfo,
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
    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from .rerun_series import ProgramCameras, ProgramSurvey


# Colours of points in Rerun's format: 0xRRGGBBAA.


# Nine of the colours of viridis (S. van der Walt, N. Smith; CC0), evenly spaced.
_VIRIDIS = (
    (68, 1, 84),
    (71, 44, 122),
    (59, 81, 139),
    (44, 113, 142),
    (33, 144, 141),
    (39, 173, 129),
    (92, 200, 99),
    (170, 220, 50),
    (253, 231, 37),
)
_HEIGHTS_M = (-2.5, 2.5)


def _palette() -> npt.NDArray[np.uint32]:
    """Return (256,) colours from dark to bright."""
    positions = np.linspace(0, len(_VIRIDIS) - 1, 256)
    channels = np.array(_VIRIDIS, np.float64).T
    red, green, blue = (
        np.interp(positions, range(len(_VIRIDIS)), channel).round().astype(np.uint32)
        for channel in channels
    )
    packed: npt.NDArray[np.uint32] = red << 24 | green << 16 | blue << 8 | 0xFF
    return packed


_PALETTE = _palette()


def reflectance_colors(reflectance: Float32Array) -> npt.NDArray[np.uint32]:
    """Return (N,) colours of reflectances 0..1 by their square root, as most are low."""
    return _PALETTE.take((np.sqrt(reflectance) * 255).astype(np.uint8))


def height_colors(points: Float32Array) -> npt.NDArray[np.uint32]:
    """Return (N,) colours of (N, 3+) points by z, from 2.5 m below to 2.5 m above the sensor."""
    low, high = _HEIGHTS_M
    share: Float32Array = np.clip((points[:, 2] - low) / (high - low), 0, 1)
    return _PALETTE.take((share * 255).astype(np.uint8))


# Rerun entities: updates of their components, their converters, and their paths.

TIME = 'time'
FRAME = 'frame'


class TimePoint(NamedTuple):
    """A point on both timelines: nanoseconds since 1970, and the frame number."""

    stamp_ns: int
    frame: int


class EntityUpdate(NamedTuple):
    """Components of one entity, at the time of their message.

    Attributes:
        path: Entity path, escaped by entity_path.
        components: Archetypes.
        frame: Coordinate frame of the entity, a header's frame_id; '' if unknown.
        always: Static archetypes, valid for all time.
        scalars: Numbers of a curve; those of many times are sent together.
    """

    path: str
    components: Sequence[AsComponents] = ()
    frame: str = ''
    always: Sequence[AsComponents] = ()
    scalars: tuple[float, ...] = ()


@dataclass(frozen=True)
class Context:
    """Data shared by the converters of a recording.

    Attributes:
        survey: The survey of the program's beginning.
        rig: The cameras.
        note: Shows a note; equal notes are shown once.
    """

    survey: ProgramSurvey
    rig: ProgramCameras
    note: Callable[[str], object]


class Converter:
    """Converts the messages of one topic."""

    def __init__(self, topic: str, context: Context) -> None:
        self.topic = topic
        self.path = entity_path(topic)
        self.context = context

    def convert(self, message: Any) -> Iterable[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield the updates of a message.

        Raises:
            ValueError: The message cannot be decoded; a damaged one may raise any exception.
        """
        raise NotImplementedError

    def flush(self) -> Iterable[EntityUpdate]:
        """Yield the remaining updates after the last message."""
        return ()


@lru_cache(maxsize=4096)
def entity_path(topic: str, *below: str) -> str:
    """Return the entity path of a topic, or of a part of it: /camera/image -> camera/image."""
    parts = [part for part in topic.split('/') if part] + list(below)
    return '/'.join(rr.escape_entity_path_part(part) for part in parts)


def image_frame(image: str) -> str:
    """Return the frame of an image topic's pixels."""
    return f'{image.strip("/")}/pixels'


# vision_msgs/Detection3DArray and Detection2DArray -> boxes with class, id and colour.
#
# vision_msgs before version 4 has other names for some fields; both are supported.

_DONT_CARE_RGB = (120, 120, 120)


class Box3DConverter(Converter):
    """The boxes of a Detection3DArray topic."""

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield one update; without boxes it removes those of the last message."""
        boxes = [detection.bbox for detection in message.detections]
        names = [_class_and_score(detection) for detection in message.detections]
        components = rr.Boxes3D(
            centers=rows_of(box.center.position for box in boxes),
            sizes=rows_of(box.size for box in boxes),
            quaternions=unit_quaternions(box.center.orientation for box in boxes),
            colors=_class_colors(self.topic, names),
            labels=_labels(message.detections, names),
            fill_mode=rr.components.FillMode.MajorWireframe,
        )
        yield EntityUpdate(self.path, [components], _frame_of(message))


class Box2DConverter(Converter):
    """The boxes of a Detection2DArray topic, over the images of their camera."""

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield one update for each of those images, or a single one without images."""
        survey = self.context.survey
        boxes = [detection.bbox for detection in message.detections]
        centers = [getattr(box.center, 'position', box.center) for box in boxes]
        names = [_class_and_score(detection) for detection in message.detections]
        components = rr.Boxes2D(
            centers=rows_of(centers, ('x', 'y')),
            sizes=rows_of(boxes, ('size_x', 'size_y')),
            colors=_class_colors(self.topic, names),
            labels=_labels(message.detections, names),
            # The 3D boxes of the same objects have labels.
            show_labels=not survey.of_type(DETECTIONS_3D),
        )
        frame = _frame_of(message)
        images = survey.images_in(frame)
        for image in images:
            path = entity_path(image, *self.topic.strip('/').split('/'))
            yield EntityUpdate(path, [components], image_frame(image))
        if not images:
            yield EntityUpdate(self.path, [components], frame)


def rows_of(messages: Iterable[Any], fields: Sequence[str] = ('x', 'y', 'z')) -> Float64Array:
    """Return the (N, len(fields)) numbers in fields of N messages."""
    rows = [[getattr(message, name) for name in fields] for message in messages]
    return np.array(rows, np.float64).reshape(-1, len(fields))


def unit_quaternions(turns: Iterable[Any]) -> list[rr.Quaternion]:
    """Normalise geometry_msgs/Quaternion; zeros become the identity."""
    rows = rows_of(turns, ('x', 'y', 'z', 'w'))
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.where(lengths > 0, rows / np.where(lengths > 0, lengths, 1), (0.0, 0.0, 0.0, 1.0))
    return [rr.Quaternion(xyzw=row) for row in rows]


def _frame_of(message: Any) -> str:  # noqa: ANN401 - a rosbags class
    """Return the frame of an array, or else of its first detection."""
    headers = [message.header, *(detection.header for detection in message.detections[:1])]
    return next((name for header in headers if (name := frame_name(header.frame_id))), '')


def _class_and_score(detection: Any) -> tuple[str, float]:  # noqa: ANN401 - a rosbags class
    """Return class and score of the first best hypothesis; ('', 1) without any."""
    hypotheses = [getattr(result, 'hypothesis', result) for result in detection.results]
    if not hypotheses:
        return '', 1.0
    best = max(hypotheses, key=lambda hypothesis: hypothesis.score)
    return str(best.class_id if hasattr(best, 'class_id') else best.id), float(best.score)


def _labels(detections: list[Any], names: list[tuple[str, float]]) -> list[str]:
    labels = []
    for detection, (class_name, score) in zip(detections, names, strict=True):
        words = [class_name, getattr(detection, 'id', ''), '' if score == 1.0 else f'{score:.2f}']
        labels.append(' '.join(word for word in words if word))
    return labels


def _class_colors(topic: str, names: list[tuple[str, float]]) -> list[tuple[int, int, int]]:
    """Return the colours of classes, or of predictions: red, green, blue, 0..255."""
    if topic in prediction_topics():
        return [PREDICTION_COLOR] * len(names)
    return [
        _DONT_CARE_RGB if class_name == DONT_CARE else rgb_of(class_name) for class_name, _ in names
    ]


# sensor_msgs/CameraInfo -> a pinhole for each of its images.
#
# P, after R, projects points of header.frame_id, and a pinhole has neither a rotation nor an
# offset: if there is one, the pinhole gets a frame of its own.

_IMAGE_PLANE_M = 3.0
_SAME = 1e-9


class PinholeConverter(Converter):
    """The pinholes of a CameraInfo topic, updated when its content changes."""

    def __init__(self, topic: str, context: Context) -> None:
        super().__init__(topic, context)
        self._images = context.survey.images_of(topic)
        self._last: Hashable = None

    def convert(self, message: CameraInfo) -> Iterator[EntityUpdate]:
        """Yield updates if the message changed and the camera is calibrated."""
        matrices = (message.k, message.d, message.r, message.p)
        key = (
            *(matrix.tobytes() for matrix in matrices),
            str(message.roi),
            message.header.frame_id,
        )
        if key == self._last:
            return
        self._last = key
        try:
            model = camera_model(message)
        except ValueError as error:
            self.context.note(f'{self.topic}: {error}; its images are shown without a pose')
            return
        view = self.context.rig.update(self.topic, model)
        for image in self._images:
            if model.model not in LENS_MODELS and not is_rectified(image, model):
                # Its K is no pinhole's, not even in the middle of the image.
                self.context.note(
                    f'{image}: Rerun has no camera of model {model.model}, so it is shown without a'
                    f' pose; its pinhole view, by --fisheye pinhole, has one'
                )
                continue
            yield from _pinhole(image, model, view)


def _pinhole(image: str, model: CameraModel, view: Viewpoint) -> Iterator[EntityUpdate]:
    k, pinhole_t_frame = projection_of(model, view, rectified=is_rectified(image, model))
    frame = view.frame
    if np.abs(pinhole_t_frame.matrix() - np.eye(4)).max() > _SAME:
        frame_t_pinhole = pinhole_t_frame.inverse()
        frame = f'{image.strip("/")}/pinhole'
        yield EntityUpdate(
            entity_path(image, 'pinhole'),
            [
                rr.Transform3D(
                    translation=frame_t_pinhole.translation,
                    quaternion=rr.Quaternion(xyzw=frame_t_pinhole.quaternion()),
                    parent_frame=view.frame,
                    child_frame=frame,
                )
            ],
        )
    yield EntityUpdate(
        entity_path(image),
        [
            rr.Pinhole(
                image_from_camera=k,
                resolution=model.size,
                parent_frame=frame,
                child_frame=image_frame(image),
                image_plane_distance=_IMAGE_PLANE_M,
            )
        ],
        image_frame(image),
    )


def is_rectified(image: str, model: CameraModel) -> bool:
    """Return whether an image is rectified (the target of P after R), by name or calibration.

    image_proc names such images image_rect and image_rect_color.
    """
    name = without_transport(image).rpartition('/')[2]
    rotated = np.abs(model.r - np.eye(3)).max() > _SAME
    plain = model.is_as_rectified or not (model.d.any() or rotated)
    return 'rect' in name or plain or has_lens_of_larger_image(model)


def projection_of(
    model: CameraModel, view: Viewpoint, *, rectified: bool
) -> tuple[Float64Array, Transform]:
    """Return K (3, 3), and pinhole_T_frame, which maps the view's frame to the pinhole.

    A distorted image is not rectified here; it is shown with K as if it had no distortion.
    """
    if not rectified:
        return model.k, view.cam_T_frame
    k = view.p[:, :3]
    offset = np.asarray(np.linalg.solve(k, view.p[:, 3]), np.float64)
    return k, Transform(model.r, offset) @ view.cam_T_frame


# visualization_msgs/MarkerArray and Marker -> boxes, lines, arrows and texts.
#
# As in RViz, markers stay until they are replaced, deleted, or their lifetime has expired; each
# message of a topic updates all its remaining markers.

_KINDS = {
    Marker.CUBE: 'boxes',
    Marker.LINE_STRIP: 'lines',
    Marker.LINE_LIST: 'lines',
    Marker.ARROW: 'arrows',
    Marker.TEXT_VIEW_FACING: 'texts',
}
_OTHERS = {
    getattr(Marker, name): name
    for name in (
        'SPHERE',
        'CYLINDER',
        'CUBE_LIST',
        'SPHERE_LIST',
        'POINTS',
        'MESH_RESOURCE',
        'TRIANGLE_LIST',
        'ARROW_STRIP',
    )
}


class MarkerConverter(Converter):
    """The markers of a topic."""

    def __init__(self, topic: str, context: Context) -> None:
        super().__init__(topic, context)
        self._shown: dict[tuple[str, int], Any] = {}
        self._groups: dict[tuple[str, str], list[Any]] = {}

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield an update for each kind of marker in each frame, also for removed ones."""
        markers = message.markers if hasattr(message, 'markers') else [message]
        for marker in markers:
            self._take(marker)
        if markers:
            self._outlive(max(stamp_ns_of(marker.header) for marker in markers))
        for group in self._groups.values():
            group.clear()
        for marker in self._shown.values():
            key = (_KINDS[marker.type], frame_name(marker.header.frame_id))
            self._groups.setdefault(key, []).append(marker)
        for (kind, frame), group in self._groups.items():
            path = entity_path(self.topic, kind, frame)
            yield EntityUpdate(path, [_SHAPES[kind](group)], frame)

    def _take(self, marker: Any) -> None:  # noqa: ANN401 - a rosbags class
        key = (marker.ns, marker.id)
        if marker.action == Marker.DELETEALL:
            self._shown.clear()
        elif marker.action == Marker.DELETE:
            self._shown.pop(key, None)
        elif marker.type in _KINDS:
            self._shown[key] = marker
        else:
            name = _OTHERS.get(marker.type, str(marker.type))
            self.context.note(f'{self.topic}: markers of type {name} are not shown')

    def _outlive(self, now_ns: int) -> None:
        for key, marker in list(self._shown.items()):
            lifetime = from_sec_nanosec(marker.lifetime.sec, marker.lifetime.nanosec)
            if lifetime and stamp_ns_of(marker.header) + lifetime < now_ns:
                del self._shown[key]


def _boxes(markers: list[Any]) -> rr.AsComponents:
    return rr.Boxes3D(
        centers=rows_of(marker.pose.position for marker in markers),
        sizes=rows_of(marker.scale for marker in markers),
        quaternions=unit_quaternions(marker.pose.orientation for marker in markers),
        colors=_marker_colors(markers),
    )


def _lines(markers: list[Any]) -> rr.AsComponents:
    strips: list[Float64Array] = []
    colors: list[tuple[float, ...]] = []
    for marker, color in zip(markers, _marker_colors(markers), strict=True):
        points = _points(marker)
        pairs = marker.type == Marker.LINE_LIST
        lines = list(points[: len(points) // 2 * 2].reshape(-1, 2, 3)) if pairs else [points]
        strips += lines
        colors += [color] * len(lines)
    return rr.LineStrips3D(strips, colors=colors)


def _arrows(markers: list[Any]) -> rr.AsComponents:
    origins, vectors = [], []
    for marker in markers:
        ends = _points(marker)
        if len(ends) < 2:
            # Without points an arrow lies along x of its pose; its length is scale.x.
            ends = _frame_t_marker(marker).apply([[0.0, 0.0, 0.0], [marker.scale.x, 0.0, 0.0]])
        origins.append(ends[0])
        vectors.append(ends[1] - ends[0])
    return rr.Arrows3D(
        origins=np.reshape(origins, (-1, 3)),
        vectors=np.reshape(vectors, (-1, 3)),
        colors=_marker_colors(markers),
    )


def _texts(markers: list[Any]) -> rr.AsComponents:
    return rr.Points3D(
        rows_of(marker.pose.position for marker in markers),
        labels=[marker.text for marker in markers],
        show_labels=True,
        colors=_marker_colors(markers),
        radii=[0.0],
    )


def _frame_t_marker(marker: Any) -> Transform:  # noqa: ANN401 - a rosbags class
    """Return frame_T_marker; a quaternion of zeros means no rotation."""
    q = marker.pose.orientation
    if not any((q.x, q.y, q.z, q.w)):
        p = marker.pose.position
        return Transform.from_translation((p.x, p.y, p.z))
    return transform_of(marker.pose)


def _points(marker: Any) -> Float64Array:  # noqa: ANN401 - a rosbags class
    """Return (N, 3) points in the marker's frame."""
    return _frame_t_marker(marker).apply(rows_of(marker.points))


def _marker_colors(markers: list[Any]) -> list[tuple[int, int, int, int]]:
    """Return red, green, blue and opacity, 0..255."""
    return [
        tuple(round(255 * min(max(value, 0.0), 1.0)) for value in (c.r, c.g, c.b, c.a))
        for c in (marker.color for marker in markers)
    ]


_SHAPES: dict[str, Callable[[list[Any]], rr.AsComponents]] = {
    'boxes': _boxes,
    'lines': _lines,
    'arrows': _arrows,
    'texts': _texts,
}


_POINT_PX = 1.5
_FIX_PX = 5.0
_AXIS_M = 1.0
_PATH_PX = 2.0
_PATH_RGB = (76, 175, 80)
_MEDIA = {'PNG': 'image/png', 'JPEG': 'image/jpeg'}
_CODECS = {'h264': 'H264', 'hevc': 'H265', 'av1': 'AV1', 'vp9': 'VP9'}
"""Names in VideoCodec; earlier versions of Rerun have some of them."""
_FIX_RGB = (231, 76, 60)
_AXES = rr.SeriesLines(names=list('xyz'), colors=((231, 76, 60), (46, 204, 113), (52, 152, 219)))


class CloudConverter(Converter):
    """sensor_msgs/PointCloud2: points coloured by reflectance, else by height."""

    _scale: float | None = None

    def convert(self, message: PointCloud2) -> Iterator[EntityUpdate]:
        """Yield one update with the finite points."""
        if self._scale is None and message.width * message.height:
            self._scale = guess_intensity_scale([message])
        points, _ = decode_cloud(message, self._scale or 1.0)
        reflectance = points[:, 3]
        colors = reflectance_colors(reflectance) if reflectance.any() else height_colors(points)
        components = rr.Points3D(points[:, :3], colors=colors, radii=rr.Radius.ui_points(_POINT_PX))
        yield EntityUpdate(self.path, [components], frame_name(message.header.frame_id))


class ImageConverter(Converter):
    """sensor_msgs/Image: its pixels; CameraInfo gives the pose."""

    def convert(self, message: ImageMsg) -> Iterator[EntityUpdate]:
        """Yield one update."""
        pixels = decode_pixels(message)
        components = rr.Image(pixels, 'L' if pixels.ndim == 2 else 'BGR')
        yield EntityUpdate(self.path, [components], image_frame(self.topic))


class VideoConverter(Converter):
    """A video: the unchanged packets, which the viewer decodes."""

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield one update."""
        name = _CODECS[codec_of(message)]
        codec = getattr(rr.VideoCodec, name, None)
        if codec is None:
            raise ValueError(f'Rerun {rr.__version__} does not show video of {name}')
        packet = rr.VideoStream.from_fields(sample=message.data.tobytes())
        always = [rr.VideoStream(codec)]
        yield EntityUpdate(self.path, [packet], image_frame(self.topic), always)


class CompressedImageConverter(VideoConverter):
    """sensor_msgs/CompressedImage: the unchanged PNG, JPEG or packet, or the pixels."""

    def convert(self, message: CompressedImage) -> Iterator[EntityUpdate]:
        """Yield one update."""
        if is_video(message):
            yield from super().convert(message)
            return
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

    Rerun needs all links of a frame to its parent at one entity, for all topics.
    """

    def convert(self, message: TFMessage) -> Iterator[EntityUpdate]:
        """Yield an update for each link."""
        for link in message.transforms:
            child = frame_name(link.child_frame_id)
            translation, rotation = link.transform.translation, link.transform.rotation
            components = _transform(link.header, translation, rotation, child)
            yield EntityUpdate(entity_path('transforms', child), [components])


class PoseConverter(Converter):
    """geometry_msgs/PoseStamped, PoseWithCovarianceStamped and nav_msgs/Odometry: axes.

    An Odometry also gives the pose of a child frame without transforms.
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
        positions = rows_of(stamped.pose.position for stamped in message.poses)
        strips = [positions] if len(positions) > 1 else []
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
        lat_lon = (message.latitude, message.longitude)
        if all(map(math.isfinite, lat_lon)):
            self._track.append(lat_lon)
            radii = rr.Radius.ui_points(_FIX_PX)
            yield EntityUpdate(
                self.path, [rr.GeoPoints(lat_lon=[lat_lon], radii=radii, colors=_FIX_RGB)]
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
    header: Header, translation: Point | Vector3, rotation: Quaternion, child: str | None
) -> rr.Transform3D:
    return rr.Transform3D(
        translation=(translation.x, translation.y, translation.z),
        quaternion=unit_quaternions([rotation])[0],
        parent_frame=frame_name(header.frame_id),
        child_frame=child,
    )


VECTORS: Mapping[str, tuple[str, str]] = {
    'geometry_msgs/msg/TwistStamped': ('linear', 'angular'),
    'sensor_msgs/msg/Imu': ('linear_acceleration', 'angular_velocity'),
}
"""The vectors of message types shown as curves."""
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
    **dict.fromkeys(sorted(VIDEOS), VideoConverter),
}
