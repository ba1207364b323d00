# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table: each stream's topics, with message type, QoS, encoder and decoder.

A row is one topic, and encode and decode are an inverse pair: the converter writes what encode
makes, the player publishes it, and the readers of bags written by to-bag get the sample back with
decode. What comes back:

- /kitti/source/{calibration,files}: the text files of a frame or of the recording, verbatim
- /kitti/source/{oxts,labels}: the text of each frame, verbatim
- /kitti/source/recording: the values of the description
- odometry: pose in map, motion and sigmas, up to rounding; a motion of zeros is unknown
- points: points and labels, bit for bit; not the turn, nor start and end of the sweep
- sick points: bit for bit
- points in a format with a loss (model/bag_formats.py): the nearest scan; /kitti/source/points is
  beside them, with the points of the file bit for bit
- points of --clouds compact: the same by /kitti/source/rest, else within half a millimetre
- images: the bytes of the PNG file; of pixels, another PNG file of the same pixels

decode is None where other rows restore what the messages contain: /tf_static, camera_info (the
calibration's files), pinhole (the images of fisheyes), path, /tf (the odometry), imu, fix, vel (the
packets' texts), sweep (the time stamps among the files), detections, objects, boxes_2d, markers,
annotated, annotations (the labels' texts, or tracklets among the files). Predictions and the
packets of an unsynchronised drive are not restored: they are no files of the recording. Nor is
label_info, the same for all recordings.

Names by preset and stack are in naming.py.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..drawing.labelled_objects import colour_pixels, compared, is_missed, objects_of
from ..files.image_files import encode_png
from ..model.bag_formats import (
    ANNOTATIONS,
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    COMPRESSED_POINTS,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    FIX,
    FORMATS,
    IMAGE,
    IMU,
    LABEL_INFO,
    MARKERS,
    ODOMETRY,
    PATH,
    STRING,
    TF,
    TRACKED_OBJECTS,
    TWIST,
    TWIST_COVARIANCE,
    Channel,
    Points,
)
from ..model.classes import KITTI_360_IMAGE_LABELS
from ..model.errors import (
    BadFileError,
    MissingDataError,
    UsageError,
    did_you_mean,
    similarity,
    some_of,
)
from ..model.samples import PNG, Description, Image, cuboids_of, identified
from ..model.streams import (
    CAMERA_COUNT,
    CAMERA_NAMES,
    IMAGE_STREAMS,
    LABEL_STREAMS,
    Layout,
    PngForm,
    Stream,
)
from ..options.messages import Clouds, Fisheye, Images, MessageOptions, Objects
from .camera_info import (
    encode_camera_info,
    encode_static,
    image_frame_camera,
    static_links,
    with_nominal_mounts,
)
from .cdr import Parts, restamp, serialize
from .detections import (
    ObjectFrame,
    encode_boxes_2d,
    encode_detected_objects,
    encode_detections,
    encode_label_info,
    encode_tracked_objects,
)
from .images import decode_compressed, decode_image, encode_compressed, encode_pixels
from .markers import encode_annotations, encode_markers, encode_prediction_markers
from .naming import (
    CALIBRATION,
    FILE_CHECKS,
    FILES,
    IMAGE_TOPICS,
    LABEL_LINES,
    OXTS_LINES,
    POINTS,
    RECORDING,
    REST,
    SWEEP,
    every_naming,
    naming_of,
    pose_in_map,
    trajectory_in_map,
)
from .oxts import (
    decode_odometry,
    encode_fix,
    encode_imu,
    encode_odometry,
    encode_path,
    encode_tf,
    encode_velocity,
    encode_velocity_with_covariance,
)
from .pinhole_view import pinhole_view
from .scan import decode_line_scan, decode_scan, encode_line_scan, encode_scan
from .source_texts import (
    decode_description,
    decode_text,
    decode_texts,
    encode_description,
    encode_file_check,
    encode_sweep,
    encode_text,
    encode_texts,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Mapping, Sequence

    from ..drawing.labelled_objects import LabelledObject
    from ..model.boxes import Cuboid
    from ..model.samples import (
        Calibration,
        CompactScan,
        FrameLabels,
        LineScan,
        OxtsPacket,
        Pose,
        Sample,
        Scan,
        Trajectory,
    )
    from ..model.streams import LayoutTraits
    from ..options.read import SelectionOptions
    from .naming import BagContext, EncodeContext
    from .pinhole_view import PinholeView


# Topics that --topics and --exclude-topics select.


def select_topics(table: list[Topic], selection: SelectionOptions) -> list[Topic]:
    """Select the rows whose names match a pattern of topics and none of exclude_topics.

    Patterns are shell wildcards; without topics all are selected.

    Raises:
        UsageError: No row is selected.
    """
    names = set(match_names([row.topic for row in table], selection))
    return [row for row in table if row.topic in names]


def match_names(names: list[str], selection: SelectionOptions) -> list[str]:
    """Select topic names; see select_topics."""
    patterns, excluded = selection.topics, selection.exclude_topics
    selected = [name for name in names if not patterns or _matches(name, patterns)]
    if not selected and patterns:
        raise _no_topic(patterns, names)
    matching = [name for name in selected if not _matches(name, excluded)]
    if selected and not matching:
        raise UsageError(f'no topic is left without {" and ".join(excluded)}; exclude fewer')
    return matching


def _matches(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def unmatched(names: Collection[str], selection: SelectionOptions) -> list[str]:
    """Return a note on each pattern of topics and exclude_topics that matches no topic.

    Raises:
        UsageError: No pattern of exclude_topics matches a topic.
    """
    excluded = selection.exclude_topics
    if excluded and not any(_matches(name, excluded) for name in names):
        raise _no_topic(excluded, sorted(names))
    return [
        f'no topic is called {pattern}{_close_topics(pattern, sorted(names))}'
        for pattern in (*selection.topics, *selection.exclude_topics)
        if not any(fnmatchcase(name, pattern) for name in names)
    ]


def _no_topic(patterns: tuple[str, ...], names: list[str]) -> UsageError:
    hints = ''.join(_close_topics(pattern, names) for pattern in patterns)
    nearest = sorted(names, key=partial(similarity, patterns[0]), reverse=True)
    hint = hints or f'; there are {some_of(nearest, 6) or "no topics"}'
    return UsageError(f'no topic is called {" or ".join(patterns)}{hint}')


def _close_topics(pattern: str, names: Sequence[str]) -> str:
    """Return the question for a misspelt topic, or for a misspelt pattern of several."""
    if '*' in pattern:
        words = [name.split('/') for name in names]
        choices = [f'{"/".join(word[:at])}/*' for word in words for at in range(1, len(word))]
        choices += [f'*/{"/".join(word[at:])}' for word in words for at in range(1, len(word))]
        return did_you_mean(pattern, choices)
    word = pattern.strip('/')
    count = sum(word in name for name in names)
    if word and count > 1:
        return f"; there are {count} with {word} in their names: give '*{word}*'"
    return did_you_mean(pattern, names)


# The encoders of the table's rows: a sample and its context to messages.
#
# They return a message of a rosbags class or a serialised one, a list of several, or None if the
# sample has no data for it.


def make_static(calibration: Calibration, context: EncodeContext) -> object:
    """Make the static tree, with nominal mounts of cameras where the calibration has none."""
    rig = context.rig
    mounted = with_nominal_mounts(calibration, rig.cameras, own=rig.options.own_frames)
    links = static_links(mounted, rig.base_t_imu, rig.frames)
    return encode_static(links, context.stamp_ns)


def make_files(sample: Calibration | Description, context: EncodeContext) -> object | None:  # noqa: ARG001 - one form for all
    """Make a String of the text files of a calibration or a recording; None without any."""
    return encode_texts(sample.files) if sample.files else None


def make_source(sample: FrameLabels | OxtsPacket, context: EncodeContext) -> object | None:  # noqa: ARG001
    """Make a String of the text that a sample was read from."""
    return None if sample.source is None else encode_text(sample.source)


def make_label_info(_: Description, context: EncodeContext) -> object:
    """Make the LabelInfo of KITTI-360's label images."""
    return encode_label_info(KITTI_360_IMAGE_LABELS, context.stamp_ns)


def make_path(trajectory: Trajectory, context: EncodeContext) -> object | None:
    """Make the Path of all poses in map."""
    if not trajectory.world_T_imu:
        return None
    in_map = trajectory_in_map(trajectory, context.rig.map_T_world)
    return encode_path(in_map, context.rig.base_t_imu, context.stamp_ns, context.rig.frames.map)


def make_odometry(pose: Pose, context: EncodeContext) -> object:
    """Make the Odometry of base_link in map."""
    frames = (context.rig.frames.map, context.rig.frames.truth)
    in_map = pose_in_map(pose, context.rig.map_T_world)
    return encode_odometry(in_map, context.rig.base_t_imu, context.stamp_ns, frames)


def make_tf(pose: Pose, context: EncodeContext) -> object:
    """Make the transform map -> base_link."""
    frames = (context.rig.frames.map, context.rig.frames.truth)
    in_map = pose_in_map(pose, context.rig.map_T_world)
    return encode_tf(in_map, context.rig.base_t_imu, context.stamp_ns, frames)


def make_imu(packet: OxtsPacket, context: EncodeContext) -> object:
    """Make the Imu of a packet, with covariances if the options request them."""
    return encode_imu(packet, *context.at_imu, covariances=bool(context.rig.options.covariances))


def make_scan(scan: Scan, context: EncodeContext) -> object:
    """Make the PointCloud2 of a scan, in the format that the options request."""
    options = context.rig.options
    labels = scan.labels if options.semantic else None
    frame = context.rig.frames.velo
    return encode_scan(scan, context.stamp_ns, frame, options.cloud, labels, context.note)


def make_source_scan(scan: Scan, context: EncodeContext) -> object:
    """Make the PointCloud2 of a scan with the points of its file, unchanged."""
    return encode_scan(scan, context.stamp_ns, context.rig.frames.velo)


def make_line_scan(scan: LineScan, context: EncodeContext) -> object:
    """Make the PointCloud2 of a scan of KITTI-360's SICK."""
    return encode_line_scan(scan, context.stamp_ns, context.rig.frames.sick)


def make_compact(scan: Scan, context: EncodeContext) -> object:
    """Make the CompressedPointCloud2 of a scan."""
    from .compact_clouds import OFF_GRID, encode_compact  # noqa: PLC0415 - for compact clouds only

    multiples = _compact(scan, context).multiples
    if multiples is None:
        context.note(OFF_GRID)
    return encode_compact(scan.points, multiples, context.stamp_ns, context.rig.frames.velo)


def make_rest(scan: Scan, context: EncodeContext) -> object:
    """Make a String of the rest of a scan's file."""
    from .compact_clouds import encode_rest  # noqa: PLC0415 - as above

    return encode_rest(_compact(scan, context).rest, context.path())


def _compact(scan: Scan, context: EncodeContext) -> CompactScan:
    if context.compact is None:
        raise ValueError('the context of compact clouds does not round points')
    return context.compact(scan.points)


def make_compressed(image: Image, context: EncodeContext) -> object:
    """Make the CompressedImage of an image: the bytes of its file."""
    return encode_compressed(image, context.stamp_ns, _image_frame(context))


def make_image(image: Image, context: EncodeContext) -> object:
    """Make the Image of an image's pixels, of colour in the encoding that the options request."""
    encoding = context.rig.options.color_encoding
    return encode_pixels(context.pixels(image), context.stamp_ns, _image_frame(context), encoding)


def make_file_check(image: Image, context: EncodeContext) -> object | None:
    """Make a String by which the PNG file made of an image's pixels is compared with its own."""
    return encode_file_check(context.path(), image.data) if image.format == PNG else None


def make_annotated(image: Image, context: EncodeContext) -> object:
    """Make the Image of an image with its frame's labels drawn on it."""
    from ..drawing.annotate import annotate  # noqa: PLC0415 - 0.2 s of OpenCV that others do without

    calibration = context.calibration()
    picture = np.array(colour_pixels(context.pixels(image)))
    labels = context.labels()
    objects = [] if labels is None else objects_of(labels, calibration)
    annotate(picture, objects, calibration, context.camera)
    return encode_pixels(picture, context.stamp_ns, _image_frame(context))


def make_annotations(image: Image, context: EncodeContext) -> object:
    """Make the ImageAnnotations of an image: the 2D boxes of its frame's labels."""
    labels = context.labels()
    objects = [] if labels is None else objects_of(labels, context.calibration())
    return _annotations(image, context, objects, [])


def make_prediction_annotations(image: Image, context: EncodeContext) -> object:
    """Make the ImageAnnotations of predictions, compared with the labels if there are any."""
    predictions = context.predictions()
    boxes = ([], []) if predictions is None else _compared_with_labels(predictions, context)
    return _annotations(image, context, *boxes)


def _annotations(
    image: Image,
    context: EncodeContext,
    objects: list[LabelledObject],
    predictions: list[LabelledObject],
) -> object:
    from ..drawing.annotate import image_boxes  # noqa: PLC0415 - as above

    size = image.width, image.height
    boxes = image_boxes(objects, predictions, context.calibration(), context.camera, size)
    return encode_annotations(boxes, context.stamp_ns)


def make_camera_info(image: Image, context: EncodeContext) -> object:
    """Make the CameraInfo of an image."""
    calibration = _camera_calibration(context, 'camera_info')
    size = (image.width, image.height)
    stereo = context.rig.options.stereo
    frame = _image_frame(context)
    template = _camera_info_template(calibration, context.camera, size, frame, stereo=stereo)
    return restamp(template, context.stamp_ns)


def make_view_info(_image: Image, context: EncodeContext) -> object:
    """Make the CameraInfo of the pinhole view of a fisheye."""
    view, frame = _view(context), _image_frame(context)
    template = _camera_info_template(
        view.calibration, context.camera, view.size, frame, stereo=False
    )
    return restamp(template, context.stamp_ns)


def make_view(image: Image, context: EncodeContext) -> object:
    """Make the Image of the pinhole view of a fisheye."""
    pixels = _view(context).of(context.pixels(image))
    encoding = context.rig.options.color_encoding
    return encode_pixels(pixels, context.stamp_ns, _image_frame(context), encoding)


def make_compressed_view(image: Image, context: EncodeContext) -> object:
    """Make the CompressedImage of the pinhole view of a fisheye: a PNG, without loss."""
    view = _view(context)
    png = encode_png(view.of(context.pixels(image)), PngForm.FAST)
    picture = Image(png, *view.size, image.channels)
    return encode_compressed(picture, context.stamp_ns, _image_frame(context))


def _view(context: EncodeContext) -> PinholeView:
    return pinhole_view(_camera_calibration(context, 'the pinhole view'), context.camera)


def _camera_calibration(context: EncodeContext, purpose: str) -> Calibration:
    """Return the calibration of a frame.

    Raises:
        MissingDataError: It has not the camera.
    """
    calibration = context.calibration()
    if context.camera not in calibration.cameras:
        reason = _reason_without_camera(calibration, context.camera)
        raise MissingDataError(f'{reason}; it is needed for {purpose}')
    return calibration


def _reason_without_camera(calibration: Calibration, camera: int) -> str:
    missing = calibration.missing
    name = calibration.files[0].name if calibration.files else 'calibration'
    return missing.get(f'P{camera}') or missing.get('file') or f'{name}: no P{camera}'


def _image_frame(context: EncodeContext) -> str:
    own = context.rig.options.own_frames
    return context.rig.frames.camera(
        image_frame_camera(context.calibration(), context.camera, own=own)
    )


@lru_cache(maxsize=64)
def _camera_info_template(
    calibration: Calibration, camera: int, size: tuple[int, int], frame_id: str, *, stereo: bool
) -> Parts:
    """Return a camera's message, of which only the stamp differs between images."""
    return serialize(encode_camera_info(calibration, camera, size, 0, frame_id, stereo=stereo))


def make_detections(labels: FrameLabels, context: EncodeContext) -> object:
    """Make the Detection3DArray of a frame's labels or predictions."""
    return encode_detections(_cuboids(labels, context), context.stamp_ns, context.rig.frames.velo)


def make_detected_objects(labels: FrameLabels, context: EncodeContext) -> object:
    """Make the DetectedObjects of a frame's labels or predictions."""
    cuboids = _cuboids(labels, context)
    return encode_detected_objects(cuboids, context.stamp_ns, _object_frame(context))


def make_tracked_objects(labels: FrameLabels, context: EncodeContext) -> object | None:
    """Make the TrackedObjects of a frame's labels or predictions; None without tracks."""
    cuboids = _cuboids(labels, context)
    tracked = any(cuboid.track_id is not None for cuboid in cuboids)
    if not (tracked or (context.rig.tracked and not cuboids)):
        return None
    return encode_tracked_objects(cuboids, context.stamp_ns, _object_frame(context))


def _object_frame(context: EncodeContext) -> ObjectFrame:
    """Return base_link: Autoware's detectors and trackers work in the frame of the vehicle."""
    rig = context.rig
    base_t_velo = rig.base_t_imu @ context.calibration().velo_T_imu.inverse()
    return ObjectFrame(rig.frames.base, base_t_velo, dict(rig.options.autoware_labels))


def make_boxes_2d(labels: FrameLabels, context: EncodeContext) -> object | None:
    """Make the Detection2DArray of a frame's labels or predictions; None of tracklets.

    These have no 2D boxes.
    """
    if labels.source is None:
        return None
    frame = context.rig.frames.camera(context.rig.labelled_camera)
    return encode_boxes_2d(identified(labels), context.stamp_ns, frame)


def make_markers(labels: FrameLabels, context: EncodeContext) -> object:
    """Make the MarkerArray of a frame's labels."""
    options = context.rig.options.markers
    positions = context.trails() if options.trails else {}
    trails = {track: context.rig.map_T_world.apply(points) for track, points in positions.items()}
    cuboids = _cuboids(labels, context)
    return encode_markers(cuboids, trails, context.stamp_ns, context.rig.frames, options)


def make_prediction_markers(predictions: FrameLabels, context: EncodeContext) -> object:
    """Make the MarkerArray of a frame's predictions, compared with its labels if it has any."""
    _cuboids(predictions, context)  # raises for a calibration without the scanner
    missed, compared_predictions = _compared_with_labels(predictions, context)
    frame, options = context.rig.frames.velo, context.rig.options.markers
    return encode_prediction_markers(missed, compared_predictions, context.stamp_ns, frame, options)


def _compared_with_labels(
    predictions: FrameLabels, context: EncodeContext
) -> tuple[list[LabelledObject], list[LabelledObject]]:
    """Return the labels that no prediction finds, and the predictions, both with their matches."""
    calibration, labels = context.calibration(), context.labels()
    boxes = objects_of(predictions, calibration)
    if labels is None:
        return [], boxes
    truth, boxes = compared(objects_of(labels, calibration), boxes, context.rig.options.overlaps)
    return [label for label in truth if is_missed(label)], boxes


def _cuboids(labels: FrameLabels, context: EncodeContext) -> list[Cuboid]:
    calibration = context.calibration()
    try:
        return _cuboids_once(labels, calibration)
    except ValueError as error:
        reason = next(iter(calibration.missing.values()), str(error))
        raise MissingDataError(f'{reason}; it is needed for the 3D boxes of labels') from None


@lru_cache(maxsize=16)
def _cuboids_once(labels: FrameLabels, calibration: Calibration) -> list[Cuboid]:
    """Return the cuboids of a frame, cached for several topics."""
    return cuboids_of(labels, calibration)


if TYPE_CHECKING:
    Encode: TypeAlias = Callable[[Any, EncodeContext], object | None]
    Decode: TypeAlias = Callable[[Any, BagContext], Any]


@dataclass(frozen=True)
class Topic(Channel):
    """One row of the table.

    Attributes:
        stream: The stream of its samples.
        encode: Sample to message; see row_encoders.
        decode: Message, of the bag's types, to the sample or the part of it that it contains.
        change_key: Returns a key of a sample; a message with the key of the previous one is
            not sent again.
        restores: Whether the file of a sample can be restored from its messages.
        needs: Streams, of which the row needs one besides its own; none are no need.
    """

    stream: Stream
    encode: Encode
    decode: Decode | None = None
    change_key: Callable[[Any], Hashable] | None = None
    restores: bool = False
    needs: tuple[Stream, ...] = ()

    @property
    def is_frame_text(self) -> bool:
        """True if each message is the text of a frame: a file, or its lines of a common file."""
        return self.restores and not self.latched and not self.on_demand

    def serialize(self, sample: Sample, context: EncodeContext) -> Parts | None:
        """Serialise the sample's message as CDR; None without one.

        Raises:
            BadFileError: The sample cannot be decoded.
            MissingDataError: A required part of the calibration is missing.
        """
        try:
            message = self.encode(sample, context)
            parts = message if message is None or isinstance(message, tuple) else serialize(message)
        except ValueError as error:
            raise BadFileError(context.path(), str(error), f'data for {self.topic}') from None
        except (struct.error, OverflowError) as error:
            what = f'a number that {self.msgtype} cannot hold ({error})'
            raise BadFileError(context.path(), what, 'stamps before 2038 and 32-bit ids') from None
        return parts


def _calibration_key(calibration: Calibration) -> Hashable:
    return tuple(file.text for file in calibration.files)


_files: tuple[Encode, Decode] = (make_files, lambda message, _: decode_texts(message))
_source: tuple[Encode, Decode] = (make_source, lambda message, _: decode_text(message))
_CLOUDS = '/kitti/velo/points'
_last: dict[str, Any] = {'latched': True, 'depth': 1}
_ROWS = (
    Topic('/tf_static', TF, Stream.CALIBRATION, make_static,
          change_key=_calibration_key, **_last),
    Topic(CALIBRATION, STRING, Stream.CALIBRATION, *_files, restores=True, **_last),
    Topic(RECORDING, STRING, Stream.RECORDING,
          lambda description, _: encode_description(dict(description.values)),
          lambda message, _: Description(decode_description(message)), **_last),
    Topic(FILES, STRING, Stream.RECORDING, *_files, restores=True, **_last),
    Topic('/kitti/label_info', LABEL_INFO, Stream.RECORDING, make_label_info,
          needs=LABEL_STREAMS, **_last),
    Topic('/kitti/ground_truth/path', PATH, Stream.PATH, make_path,
          **_last),
    Topic('/kitti/ground_truth/odometry', ODOMETRY, Stream.POSE,
          make_odometry,
          lambda message, bag: decode_odometry(message, bag.base_t_imu)),
    Topic('/kitti/oxts/imu', IMU, Stream.OXTS, make_imu),
    Topic('/kitti/oxts/fix', FIX, Stream.OXTS,
          lambda packet, context: encode_fix(packet, *context.at_imu)),
    Topic('/kitti/oxts/vel', TWIST, Stream.OXTS,
          lambda packet, context: encode_velocity(packet, *context.at_imu)),
    Topic(OXTS_LINES, STRING, Stream.OXTS, *_source, restores=True),
    Topic(_CLOUDS, CLOUD, Stream.SCAN,
          make_scan, lambda message, _: decode_scan(message), restores=True),
    Topic(SWEEP, STRING, Stream.SCAN, lambda scan, _: encode_sweep(scan)),
    Topic('/kitti/sick/points', CLOUD, Stream.SICK, make_line_scan,
          lambda message, _: decode_line_scan(message), restores=True),
    Topic('/kitti/labels/detections', DETECTIONS_3D, Stream.LABELS,
          make_detections),
    Topic('/kitti/labels/detected_objects', DETECTED_OBJECTS, Stream.LABELS,
          make_detected_objects),
    Topic('/kitti/labels/tracked_objects', TRACKED_OBJECTS, Stream.LABELS,
          make_tracked_objects),
    Topic('/kitti/labels/boxes_2d', DETECTIONS_2D, Stream.LABELS,
          make_boxes_2d),
    Topic('/kitti/labels/markers', MARKERS, Stream.LABELS,
          make_markers),
    Topic(LABEL_LINES, STRING, Stream.LABELS, *_source, restores=True),
    Topic('/kitti/predictions/detections', DETECTIONS_3D, Stream.PREDICTIONS,
          make_detections),
    Topic('/kitti/predictions/detected_objects', DETECTED_OBJECTS, Stream.PREDICTIONS,
          make_detected_objects),
    Topic('/kitti/predictions/tracked_objects', TRACKED_OBJECTS, Stream.PREDICTIONS,
          make_tracked_objects),
    Topic('/kitti/predictions/boxes_2d', DETECTIONS_2D, Stream.PREDICTIONS,
          make_boxes_2d),
    Topic('/kitti/predictions/markers', MARKERS, Stream.PREDICTIONS,
          make_prediction_markers),
)  # fmt: skip
"""The rows of all recordings."""
_LEFT_OUT = {
    Objects.VISION: {DETECTED_OBJECTS, TRACKED_OBJECTS},
    Objects.AUTOWARE: {DETECTIONS_3D},
    Objects.BOTH: set(),
}
"""By option the types of messages that are not made."""
_SOURCE_ROW = Topic(POINTS, CLOUD, Stream.SCAN, make_source_scan,
                    lambda message, _: decode_scan(message), restores=True)  # fmt: skip
"""The row of scans whose clouds are in a format with a loss: whole points, which restore the file
alone. It precedes them, since readers of bags take a stream's first topic with a decoder."""
_REST_ROW = Topic(REST, STRING, Stream.SCAN, make_rest)
_TF_ROW = Topic('/tf', TF, Stream.POSE, make_tf)
_COVARIANCE_ROW = Topic(
    '/kitti/oxts/vel_with_covariance',
    TWIST_COVARIANCE,
    Stream.OXTS,
    lambda packet, context: encode_velocity_with_covariance(packet, *context.at_imu),
)
_RARE = frozenset({Stream.SICK, *LABEL_STREAMS})
"""Streams that one layout alone has."""
EVERY_MESSAGE = MessageOptions(
    images=Images.BOTH,
    objects=Objects.BOTH,
    annotations=True,
    covariances=True,
    points=Points.OUSTER,
)
"""Options that make all messages which bags may have; not annotated images."""


def make_table(
    cameras: Mapping[int, str],
    image_topic: str,
    options: MessageOptions,
    packets: Stream = Stream.OXTS,
    traits: LayoutTraits | None = None,
) -> list[Topic]:
    """Make all rows for a recording.

    Args:
        cameras: Camera index to name.
        image_topic: One of naming.IMAGE_TOPICS.
        options: Options of the messages.
        packets: The stream of the messages of packets; their texts, which restore the files, are
            always those of OXTS.
        traits: Those of its layout: of cameras that are never rectified images are image_raw, and
            rows of streams that others alone have are left out; None for all rows.
    """
    raw_cameras = traits.raw_cameras if traits else ()
    source = [_SOURCE_ROW] if FORMATS[options.cloud].loss else []
    rows = [*source, *(row for row in _ROWS if row.msgtype not in _LEFT_OUT[options.objects])]
    if options.clouds is Clouds.COMPACT:
        rows = [_REST_ROW] + [
            replace(row, msgtype=COMPRESSED_POINTS, encode=make_compact)
            if row.topic == _CLOUDS
            else row
            for row in rows
        ]
    rows += [_TF_ROW] if options.publish_tf else []
    rows += [_COVARIANCE_ROW] if options.covariances else []
    rows = [
        replace(row, stream=packets) if row.stream is Stream.OXTS and not row.restores else row
        for row in rows
    ]
    for index, name in sorted(cameras.items()):
        is_raw, camera = index in raw_cameras, f'/kitti/camera_{name}'
        images = IMAGE_TOPICS[1] if is_raw else image_topic
        rows += _camera_rows(IMAGE_STREAMS[index], camera, images, options)
        if is_raw and options.fisheye is Fisheye.PINHOLE:
            rows += _view_rows(IMAGE_STREAMS[index], camera, options.images)
    rows += [_label_row(stream, cameras) for stream in LABEL_STREAMS]
    names = naming_of(options)
    return [
        replace(row, topic=names.topic(row.topic))
        for row in rows
        if traits is None or not _RARE.intersection({row.stream, *row.needs}) - traits.streams
    ]


def _label_row(stream: Stream, cameras: Mapping[int, str]) -> Topic:
    """Return the row of label images: always their PNG files, whose form pixels do not tell."""
    kind, camera = stream.label_image or ('', 0)
    topic = f'/kitti/camera_{cameras.get(camera, camera)}/{kind}/compressed'
    pair: tuple[Encode, Decode] = (
        make_compressed,
        lambda message, bag: decode_compressed(message, bag.path),
    )
    return Topic(topic, COMPRESSED, stream, *pair, restores=True)


def without_latched_calibrations(rows: Sequence[Topic]) -> list[Topic]:
    """Return the rows for a recording with a calibration a frame: a sample as any other."""
    return [
        Topic(row.topic, row.msgtype, row.stream, row.encode, row.decode, restores=row.restores)
        if row.topic == CALIBRATION
        else row
        for row in rows
    ]


def _camera_rows(
    stream: Stream, camera: str, image_topic: str, options: MessageOptions
) -> list[Topic]:
    image = f'{camera}/{image_topic}'
    info = CAMERA_INFO
    rows = [Topic(f'{camera}/camera_info', info, stream, make_camera_info)]
    pair: tuple[Encode, Decode]
    if options.images is not Images.RAW:
        compressed = COMPRESSED
        pair = (
            make_compressed,
            lambda message, bag: decode_compressed(message, bag.path),
        )
        rows.append(Topic(f'{image}/compressed', compressed, stream, *pair, restores=True))
    if options.images is Images.RAW:
        rows.append(Topic(FILE_CHECKS + stream.value, STRING, stream, make_file_check))
    if options.images is not Images.COMPRESSED:
        pair = make_image, lambda message, bag: decode_image(message, bag.png)
        rows.append(Topic(image, IMAGE, stream, *pair, restores=True))
    if options.annotated:
        rows.append(Topic(f'{camera}/annotated', IMAGE, stream, make_annotated))
    if options.annotations:
        rows += [
            Topic(f'{camera}/annotations', ANNOTATIONS, stream, make_annotations,
                  needs=(Stream.LABELS,)),
            Topic(f'{camera}/prediction_annotations', ANNOTATIONS, stream,
                  make_prediction_annotations, needs=(Stream.PREDICTIONS,)),
        ]  # fmt: skip
    return rows


def _view_rows(stream: Stream, camera: str, images: Images) -> list[Topic]:
    """Return the rows of the pinhole view of a fisheye, from which nothing is restored."""
    view = f'{camera}/pinhole'
    rows = [Topic(f'{view}/camera_info', CAMERA_INFO, stream, make_view_info)]
    image = f'{view}/{IMAGE_TOPICS[0]}'
    if images is not Images.RAW:
        rows.append(Topic(f'{image}/compressed', COMPRESSED, stream, make_compressed_view))
    if images is not Images.COMPRESSED:
        rows.append(Topic(image, IMAGE, stream, make_view))
    return rows


@lru_cache(maxsize=1)
def view_topics() -> Mapping[str, Topic]:
    """Return the rows of all pinhole views of fisheyes, by topic name."""
    return {
        row.topic: row
        for traits in (layout.traits for layout in Layout)
        for index in traits.raw_cameras
        for row in _view_rows(
            IMAGE_STREAMS[index], f'/kitti/camera_{traits.camera_names[index]}', Images.BOTH
        )
    }


@lru_cache(maxsize=1)
def own_topics() -> Mapping[str, Topic]:
    """Return all rows that to-bag may write, for all names and rigs, by topic name."""
    numbered = {index: str(index) for index in range(CAMERA_COUNT)}
    topics: dict[str, Topic] = {}
    for cameras in (CAMERA_NAMES, numbered):
        for image_topic in IMAGE_TOPICS:
            for images in (Images.RAW, Images.BOTH):
                options = replace(EVERY_MESSAGE, images=images)
                topics |= {row.topic: row for row in make_table(cameras, image_topic, options)}
    topics |= view_topics()
    topics[REST] = _REST_ROW  # compact clouds themselves are read as others are
    rows = list(topics.values())
    for names in every_naming():
        for row in rows:
            renamed = names.topic(row.topic)
            if renamed != row.topic:
                topics[renamed] = replace(row, topic=renamed)
    return topics


@lru_cache(maxsize=1)
def prediction_topics() -> frozenset[str]:
    """Return the topics of predictions, which are no labels."""
    return frozenset(row.topic for row in _ROWS if row.stream is Stream.PREDICTIONS)


@lru_cache(maxsize=1)
def decoders() -> Mapping[str, Decode]:
    """Return the decoders of the rows that have one, by topic name."""
    return {name: row.decode for name, row in own_topics().items() if row.decode is not None}
