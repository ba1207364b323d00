# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table: each stream's topics, with message type, QoS, encoder and decoder.

A row is one topic, and encode and decode are an inverse pair: the converter writes what encode
makes, the player publishes it, and the readers of bags written by to-bag get the sample back with
decode. What comes back:

- /kitti/source/{calibration,files,oxts,labels}: the text of each file or frame, verbatim
- /kitti/source/recording: the values of the description
- odometry: pose in map, motion and sigmas, up to rounding; a motion of zeros is unknown
- points: points and labels, bit for bit; not the turn, nor start and end of the sweep
- points in a format with a loss (model/cloud_formats.py): the nearest scan; /kitti/source/points is
  beside them, with the points of the file bit for bit
- images: the bytes of the PNG file; of pixels, another PNG file of the same pixels

decode is None where other rows restore what the messages contain: /tf_static, camera_info (the
calibration's files), path, /tf (the odometry), imu, fix, vel (the packets' texts), sweep (the time
stamps among the files), detections, objects, boxes_2d, markers, annotated, annotations (the labels'
texts, or tracklets among the files). Predictions and the packets of an unsynchronised drive are not
restored: they are no files of the recording.

Names by preset and stack are in naming.py.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ..model.channels import Channel
from ..model.cloud_formats import FORMATS, Points
from ..model.errors import BadFileError
from ..model.msgtypes import (
    ANNOTATIONS,
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    FIX,
    IMAGE,
    IMU,
    MARKERS,
    ODOMETRY,
    PATH,
    STRING,
    TF,
    TRACKED_OBJECTS,
    TWIST,
    TWIST_COVARIANCE,
)
from ..model.samples import Description
from ..model.streams import CAMERA_COUNT, CAMERA_NAMES, IMAGE_STREAMS, Stream
from ..options.messages import Images, MessageOptions, Objects
from .row_encoders import make_annotated, make_annotations, make_boxes_2d, make_camera_info, make_compressed, make_detected_objects, make_detections, make_files, make_image, make_imu, make_markers, make_odometry, make_path, make_prediction_annotations, make_prediction_markers, make_scan, make_source, make_source_scan, make_static, make_tf, make_tracked_objects
from .cdr import Parts, serialize
from .image import decode_compressed, decode_image
from .naming import IMAGE_TOPICS, every_naming, naming_of
from .oxts import encode_fix, encode_velocity
from .oxts_covariance import encode_velocity_with_covariance
from .pose import decode_odometry
from .scan import decode_scan
from .source import (
    CALIBRATION,
    FILES,
    LABEL_LINES,
    OXTS_LINES,
    POINTS,
    RECORDING,
    SWEEP,
    decode_description,
    decode_text,
    encode_description,
    encode_sweep,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping

    from ..model.samples import Calibration, Sample
    from .moment import Moment, Origin

    Encode: TypeAlias = Callable[[Any, Moment], object | None]
    Decode: TypeAlias = Callable[[Any, Origin], Any]


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
        needs: A stream without which the row has no messages, besides its own.
    """

    stream: Stream
    encode: Encode
    decode: Decode | None = None
    change_key: Callable[[Any], Hashable] | None = None
    restores: bool = False
    needs: Stream | None = None

    @property
    def is_frame_text(self) -> bool:
        """Whether each message is the text of a frame: a file, or its lines of a common file."""
        return self.restores and not self.latched and not self.on_demand

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


def _calibration_key(calibration: Calibration) -> Hashable:
    return tuple(file.text for file in calibration.files)


_MOST_FILES = 100
"""Above the number of text files of any recording, so that late subscribers get them all."""

_files: tuple[Encode, Decode] = (make_files, lambda message, _: decode_text(message))
_source: tuple[Encode, Decode] = (make_source, lambda message, _: decode_text(message))
_every: dict[str, Any] = {'latched': True, 'depth': _MOST_FILES, 'restores': True}
_last: dict[str, Any] = {'latched': True, 'depth': 1}
_ROWS = (
    Topic('/tf_static', TF, Stream.CALIBRATION, make_static,
          change_key=_calibration_key, **_last),
    Topic(CALIBRATION, STRING, Stream.CALIBRATION, *_files, **_every),
    Topic(RECORDING, STRING, Stream.RECORDING,
          lambda description, _: encode_description(dict(description.values)),
          lambda message, _: Description(decode_description(message)), **_last),
    Topic(FILES, STRING, Stream.RECORDING, *_files, **_every),
    Topic('/kitti/ground_truth/path', PATH, Stream.PATH, make_path,
          **_last),
    Topic('/kitti/ground_truth/odometry', ODOMETRY, Stream.POSE,
          make_odometry,
          lambda message, origin: decode_odometry(message, origin.base_t_imu)),
    Topic('/kitti/oxts/imu', IMU, Stream.OXTS, make_imu),
    Topic('/kitti/oxts/fix', FIX, Stream.OXTS,
          lambda packet, moment: encode_fix(packet, *moment.at_imu)),
    Topic('/kitti/oxts/vel', TWIST, Stream.OXTS,
          lambda packet, moment: encode_velocity(packet, *moment.at_imu)),
    Topic(OXTS_LINES, STRING, Stream.OXTS, *_source, restores=True),
    Topic('/kitti/velo/points', CLOUD, Stream.SCAN,
          make_scan, lambda message, _: decode_scan(message), restores=True),
    Topic(SWEEP, STRING, Stream.SCAN, lambda scan, _: encode_sweep(scan)),
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
_TF_ROW = Topic('/tf', TF, Stream.POSE, make_tf)
_COVARIANCE_ROW = Topic(
    '/kitti/oxts/vel_with_covariance',
    TWIST_COVARIANCE,
    Stream.OXTS,
    lambda packet, moment: encode_velocity_with_covariance(packet, *moment.at_imu),
)
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
) -> list[Topic]:
    """Make all rows for a recording.

    Args:
        cameras: Camera index to name.
        image_topic: One of naming.IMAGE_TOPICS.
        options: Of the messages.
        packets: The stream of the messages of packets; their texts, which restore the files, are
            always those of OXTS.
    """
    source = [_SOURCE_ROW] if FORMATS[options.cloud].loss else []
    rows = [*source, *(row for row in _ROWS if row.msgtype not in _LEFT_OUT[options.objects])]
    rows += [_TF_ROW] if options.publish_tf else []
    rows += [_COVARIANCE_ROW] if options.covariances else []
    rows = [
        replace(row, stream=packets) if row.stream is Stream.OXTS and not row.restores else row
        for row in rows
    ]
    for index, name in sorted(cameras.items()):
        rows += _camera_rows(IMAGE_STREAMS[index], f'/kitti/camera_{name}', image_topic, options)
    names = naming_of(options)
    return [replace(row, topic=names.topic(row.topic)) for row in rows]


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
            lambda message, origin: decode_compressed(message, origin.path),
        )
        rows.append(Topic(f'{image}/compressed', compressed, stream, *pair, restores=True))
    if options.images is not Images.COMPRESSED:
        pair = make_image, lambda message, _: decode_image(message)
        rows.append(Topic(image, IMAGE, stream, *pair, restores=True))
    if options.annotated:
        rows.append(Topic(f'{camera}/annotated', IMAGE, stream, make_annotated))
    if options.annotations:
        rows += [
            Topic(f'{camera}/annotations', ANNOTATIONS, stream, make_annotations,
                  needs=Stream.LABELS),
            Topic(f'{camera}/prediction_annotations', ANNOTATIONS, stream,
                  make_prediction_annotations, needs=Stream.PREDICTIONS),
        ]  # fmt: skip
    return rows


@lru_cache(maxsize=1)
def own_topics() -> Mapping[str, Topic]:
    """Return all rows that to-bag may write, for all names and rigs, by topic name."""
    numbered = {index: str(index) for index in range(CAMERA_COUNT)}
    found: dict[str, Topic] = {}
    for cameras in (CAMERA_NAMES, numbered):
        for image_topic in IMAGE_TOPICS:
            for row in make_table(cameras, image_topic, EVERY_MESSAGE):
                found[row.topic] = row
    rows = list(found.values())
    for names in every_naming():
        for row in rows:
            renamed = names.topic(row.topic)
            if renamed != row.topic:
                found[renamed] = replace(row, topic=renamed)
    return found


@lru_cache(maxsize=1)
def prediction_topics() -> frozenset[str]:
    """Return the topics of predictions, which are no labels."""
    return frozenset(row.topic for row in _ROWS if row.stream is Stream.PREDICTIONS)


@lru_cache(maxsize=1)
def decoders() -> Mapping[str, Decode]:
    """Return the decoders of the rows that have one, by topic name."""
    return {name: row.decode for name, row in own_topics().items() if row.decode is not None}
