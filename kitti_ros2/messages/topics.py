# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table: each stream's topics, with message type, frame, QoS and encoder.

A row is one topic. The converter writes its messages and the player publishes them. Names by preset
are in naming.py; own_bags/ finds the topics of a bag by this table.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.objects import objects_of
from ..drawing.pixels import colour_pixels
from ..files.png.decode import decode_png
from ..model.channels import Channel
from ..model.errors import BadFileError, MissingDataError, UsageError
from ..model.labels import cuboids_of, identified
from ..model.samples import (
    Calibration,
    Description,
    FrameLabels,
    Image,
    OxtsPacket,
    Pose,
    Sample,
    Scan,
    Trajectory,
)
from ..model.streams import IMAGE_STREAMS, Stream
from ..options.messages import Images, MessageOptions
from .camera_info import encode_camera_info, image_frame_camera
from .cdr import Parts, restamp, serialize
from .detections import encode_boxes_2d, encode_detections
from .image import encode_compressed, encode_pixels
from .map_frame import map_from_world, place_pose, place_trajectory
from .markers import encode_markers
from .mounts import with_nominal_mounts
from .naming import FrameNames, base_t_imu, make_frames, rename_topic
from .oxts import encode_fix, encode_imu, encode_velocity
from .pose import encode_odometry, encode_path, encode_tf
from .scan import encode_scan
from .source import SWEEP, encode_description, encode_sweep, encode_text
from .transforms import encode_static, static_links

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping
    from pathlib import Path

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array, Transform
    from ..model.recording import Recording
    from .pixels import Pixels


LABELLED_CAMERA = 2
"""The camera of KITTI's labels: the left colour camera."""


@dataclass(frozen=True)
class Rig:
    """The parameters common to all messages of a recording.

    Attributes:
        frames: Frame names.
        cameras: Those whose images or labels are in messages.
        base_t_imu: imu_link in base_link.
        map_T_world: The fixed frame of the reader's poses in map.
        options: Of the messages.
    """

    frames: FrameNames
    cameras: frozenset[int]
    base_t_imu: Transform
    map_T_world: Transform
    options: MessageOptions


@dataclass(frozen=True)
class Moment:
    """The context of an encoder besides its sample.

    Attributes:
        rig: The parameters common to all messages.
        stamp_ns: The sample's own.
        path: Its file, for errors.
        calibration: Returns the calibration of the sample's frame.
        trails: Returns the earlier positions of the tracks in the sample's frame, in the reader's
            fixed frame.
        camera: KITTI camera index of an image.
        pixels: Decodes an image.
        labels: Returns the labels of the sample's frame, if any.
    """

    rig: Rig
    stamp_ns: int
    path: Path
    calibration: Callable[[], Calibration]
    trails: Callable[[], Mapping[int, Float64Array]]
    camera: int = 0
    pixels: Callable[[Image], Pixels] = decode_png
    labels: Callable[[], FrameLabels] = FrameLabels


@dataclass(frozen=True)
class Topic(Channel):
    """One row of the table.

    Attributes:
        stream: The stream of its samples.
        encode: Sample to a message of a rosbags class, or to a serialised one; None if the sample
            has no data for it, a list for several messages.
        change_key: Returns a key of a sample; a message with the key of the previous one is
            not sent again.
        restores: Whether the file of a sample can be restored from its messages.
    """

    stream: Stream
    encode: Callable[[Any, Moment], object | None]
    change_key: Callable[[Any], Hashable] | None = None
    restores: bool = False

    def serialize(self, sample: Sample, moment: Moment) -> list[Parts]:
        """Serialise the sample's messages as CDR.

        Raises:
            BadFileError: The sample cannot be decoded.
            MissingDataError: A required part of the calibration is missing.
        """
        try:
            made = self.encode(sample, moment)
            found = made if isinstance(made, list) else [] if made is None else [made]
            messages = [item if isinstance(item, tuple) else serialize(item) for item in found]
        except ValueError as error:
            raise BadFileError(moment.path, str(error), f'data for {self.topic}') from None
        except (struct.error, OverflowError) as error:
            what = f'a number that {self.msgtype} cannot hold ({error})'
            raise BadFileError(moment.path, what, 'stamps before 2038 and 32-bit ids') from None
        return messages


def make_rig(recording: Recording, options: MessageOptions) -> Rig:
    """Make the parameters common to all messages of a recording."""
    mount = base_t_imu(options)
    labelled = {LABELLED_CAMERA} if Stream.LABELS in recording.streams else set()
    return Rig(
        frames=make_frames(options.preset, recording.cameras),
        cameras=frozenset(recording.cameras) | labelled,
        base_t_imu=mount,
        map_T_world=map_from_world(recording.start, mount, options.map),
        options=options,
    )


def make_table(
    cameras: Mapping[int, str], image_topic: str, options: MessageOptions
) -> list[Topic]:
    """Make all rows for a recording.

    Args:
        cameras: Camera index to name.
        image_topic: One of naming.IMAGE_TOPICS.
        options: Of the messages.
    """
    every: dict[str, Any] = {'latched': True, 'depth': _MOST_FILES, 'restores': True}
    own: dict[str, Any] = {'restores': True}
    last: dict[str, Any] = {'latched': True, 'depth': 1}
    rows = [
        Topic('/tf_static', _TF, Stream.CALIBRATION, _static, change_key=_calibration_key, **last),
        Topic('/kitti/source/calibration', _STRING, Stream.CALIBRATION, _files, **every),
        Topic('/kitti/source/recording', _STRING, Stream.RECORDING, _description, **last),
        Topic('/kitti/source/files', _STRING, Stream.RECORDING, _files, **every),
        Topic('/kitti/ground_truth/path', 'nav_msgs/msg/Path', Stream.PATH, _path, **last),
        Topic('/kitti/ground_truth/odometry', 'nav_msgs/msg/Odometry', Stream.POSE, _odometry),
        Topic('/kitti/oxts/imu', 'sensor_msgs/msg/Imu', Stream.OXTS, _imu),
        Topic('/kitti/oxts/fix', 'sensor_msgs/msg/NavSatFix', Stream.OXTS, _fix),
        Topic('/kitti/oxts/vel', 'geometry_msgs/msg/TwistStamped', Stream.OXTS, _velocity),
        Topic('/kitti/source/oxts', _STRING, Stream.OXTS, _packet_text, **own),
        Topic('/kitti/velo/points', 'sensor_msgs/msg/PointCloud2', Stream.SCAN, _scan, **own),
        Topic(SWEEP, _STRING, Stream.SCAN, _sweep),
        Topic('/kitti/labels/detections', _DETECTIONS_3D, Stream.LABELS, _detections),
        Topic('/kitti/labels/boxes_2d', _DETECTIONS_2D, Stream.LABELS, _boxes_2d),
        Topic('/kitti/labels/markers', _MARKERS, Stream.LABELS, _markers),
        Topic('/kitti/source/labels', _STRING, Stream.LABELS, _label_text, **own),
    ]  # fmt: skip
    if options.publish_tf:
        rows.append(Topic('/tf', _TF, Stream.POSE, _tf))
    for index, name in sorted(cameras.items()):
        rows += _camera_rows(IMAGE_STREAMS[index], f'/kitti/camera_{name}', image_topic, options)
    return [replace(row, topic=rename_topic(row.topic, options.preset)) for row in rows]


def _camera_rows(
    stream: Stream, camera: str, image_topic: str, options: MessageOptions
) -> list[Topic]:
    image = f'{camera}/{image_topic}'
    rows = [Topic(f'{camera}/camera_info', 'sensor_msgs/msg/CameraInfo', stream, _camera_info)]
    if options.images is not Images.RAW:
        compressed = 'sensor_msgs/msg/CompressedImage'
        rows.append(Topic(f'{image}/compressed', compressed, stream, _compressed, restores=True))
    if options.images is not Images.COMPRESSED:
        rows.append(Topic(image, 'sensor_msgs/msg/Image', stream, _image, restores=True))
    if options.annotated:
        rows.append(Topic(f'{camera}/annotated', 'sensor_msgs/msg/Image', stream, _annotated))
    return rows


def select_topics(table: list[Topic], patterns: tuple[str, ...]) -> list[Topic]:
    """Select the rows whose names match a pattern (shell wildcards); all without patterns.

    Raises:
        UsageError: There are patterns, and none matches a row.
    """
    names = set(match_names([row.topic for row in table], patterns))
    return [row for row in table if row.topic in names]


def match_names(names: list[str], patterns: tuple[str, ...]) -> list[str]:
    """Select the topic names that match a pattern; see select_topics."""
    if not patterns:
        return names
    selected = [name for name in names if any(fnmatchcase(name, each) for each in patterns)]
    if not selected:
        known = ', '.join(sorted(names))
        raise UsageError(f'no topic is called {" or ".join(patterns)}; there are {known}')
    return selected


def unmatched(table: list[Topic], patterns: tuple[str, ...]) -> list[str]:
    """Return the patterns that match no row."""
    return [each for each in patterns if not any(fnmatchcase(row.topic, each) for row in table)]


_MOST_FILES = 100
"""Above the number of text files of any recording, so that late subscribers get them all."""

_STRING = 'std_msgs/msg/String'
_TF = 'tf2_msgs/msg/TFMessage'
_DETECTIONS_3D = 'vision_msgs/msg/Detection3DArray'
_DETECTIONS_2D = 'vision_msgs/msg/Detection2DArray'
_MARKERS = 'visualization_msgs/msg/MarkerArray'


def _static(calibration: Calibration, moment: Moment) -> object:
    mounted = with_nominal_mounts(calibration, moment.rig.cameras)
    links = static_links(mounted, moment.rig.base_t_imu, moment.rig.frames)
    return encode_static(links, moment.stamp_ns)


def _calibration_key(calibration: Calibration) -> Hashable:
    return tuple(file.text for file in calibration.files)


def _label_text(labels: FrameLabels, moment: Moment) -> object | None:  # noqa: ARG001 - one form for all
    return None if labels.source is None else encode_text(labels.source)


@lru_cache(maxsize=16)
def _cuboids_once(labels: FrameLabels, calibration: Calibration) -> list[Cuboid]:
    """Return the cuboids of a frame, cached for several topics."""
    return cuboids_of(labels, calibration)


def _cuboids(labels: FrameLabels, moment: Moment) -> list[Cuboid]:
    calibration = moment.calibration()
    try:
        return _cuboids_once(labels, calibration)
    except ValueError as error:
        reason = next(iter(calibration.missing.values()), str(error))
        raise MissingDataError(f'{reason}; it is needed for the 3D boxes of labels') from None


def _detections(labels: FrameLabels, moment: Moment) -> object:
    return encode_detections(_cuboids(labels, moment), moment.stamp_ns, moment.rig.frames.velo)


def _boxes_2d(labels: FrameLabels, moment: Moment) -> Any:  # noqa: ANN401 - as encode_boxes_2d
    if labels.source is None:
        return None
    frame = moment.rig.frames.camera(LABELLED_CAMERA)
    return encode_boxes_2d(identified(labels), moment.stamp_ns, frame)


def _markers(labels: FrameLabels, moment: Moment) -> object:
    options = moment.rig.options.markers
    found = moment.trails() if options.trails else {}
    trails = {track: moment.rig.map_T_world.apply(places) for track, places in found.items()}
    cuboids = _cuboids(labels, moment)
    return encode_markers(cuboids, trails, moment.stamp_ns, moment.rig.frames, options)


def _files(sample: Calibration | Description, moment: Moment) -> list[object]:  # noqa: ARG001
    return [encode_text(file) for file in sample.files]


def _description(description: Description, moment: Moment) -> object:  # noqa: ARG001
    return encode_description(dict(description.values))


def _path(trajectory: Trajectory, moment: Moment) -> object | None:
    if not trajectory.world_T_imu:
        return None
    placed = place_trajectory(trajectory, moment.rig.map_T_world)
    return encode_path(placed, moment.rig.base_t_imu, moment.stamp_ns, moment.rig.frames.map)


def _odometry(pose: Pose, moment: Moment) -> object:
    frames = (moment.rig.frames.map, moment.rig.frames.base)
    placed = place_pose(pose, moment.rig.map_T_world)
    return encode_odometry(placed, moment.rig.base_t_imu, moment.stamp_ns, frames)


def _tf(pose: Pose, moment: Moment) -> object:
    frames = (moment.rig.frames.map, moment.rig.frames.base)
    placed = place_pose(pose, moment.rig.map_T_world)
    return encode_tf(placed, moment.rig.base_t_imu, moment.stamp_ns, frames)


def _imu(packet: OxtsPacket, moment: Moment) -> object:
    return encode_imu(packet, moment.stamp_ns, moment.rig.frames.imu)


def _fix(packet: OxtsPacket, moment: Moment) -> object:
    return encode_fix(packet, moment.stamp_ns, moment.rig.frames.imu)


def _velocity(packet: OxtsPacket, moment: Moment) -> object:
    return encode_velocity(packet, moment.stamp_ns, moment.rig.frames.imu)


def _packet_text(packet: OxtsPacket, moment: Moment) -> object | None:  # noqa: ARG001
    return None if packet.source is None else encode_text(packet.source)


def _scan(scan: Scan, moment: Moment) -> object:
    options = moment.rig.options
    return encode_scan(
        scan,
        moment.stamp_ns,
        moment.rig.frames.velo,
        ring_and_time=options.ring_and_time,
        labels=scan.labels if options.semantic else None,
    )


def _sweep(scan: Scan, moment: Moment) -> object | None:  # noqa: ARG001
    return encode_sweep(scan)


def _image_frame(moment: Moment) -> str:
    calibration = moment.calibration()
    return moment.rig.frames.camera(image_frame_camera(calibration, moment.camera))


def _compressed(image: Image, moment: Moment) -> object:
    return encode_compressed(image, moment.stamp_ns, _image_frame(moment))


def _image(image: Image, moment: Moment) -> object:
    return encode_pixels(moment.pixels(image), moment.stamp_ns, _image_frame(moment))


def _annotated(image: Image, moment: Moment) -> object:
    from ..drawing.annotate import annotate  # noqa: PLC0415 - 0.2 s of OpenCV that others do without

    calibration = moment.calibration()
    picture = np.array(colour_pixels(moment.pixels(image)))
    objects = objects_of(moment.labels(), calibration)
    annotate(picture, objects, calibration, moment.camera)
    return encode_pixels(picture, moment.stamp_ns, _image_frame(moment))


def _camera_info(image: Image, moment: Moment) -> object:
    calibration = moment.calibration()
    if moment.camera not in calibration.cameras:
        part = f'P{moment.camera}'
        reason = calibration.missing.get(part) or next(
            iter(calibration.missing.values()), 'no ' + part
        )
        raise MissingDataError(f'{reason}; it is needed for camera_info')
    size = (image.width, image.height)
    template = _camera_info_template(calibration, moment.camera, size, _image_frame(moment))
    return restamp(template, moment.stamp_ns)


@lru_cache(maxsize=64)
def _camera_info_template(
    calibration: Calibration, camera: int, size: tuple[int, int], frame_id: str
) -> Parts:
    """Return a camera's message, of which only the stamp differs between images."""
    return serialize(encode_camera_info(calibration, camera, size, 0, frame_id))
