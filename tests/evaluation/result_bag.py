# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of results: the labels of a recording as a perfect detector would publish them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.cdr import join, serialize
from kitti_ros2.messages.detections import (
    ObjectFrame,
    encode_boxes_2d,
    encode_detected_objects,
    encode_detections,
    encode_tracked_objects,
)
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import (
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    TRACKED_OBJECTS,
    Channel,
)
from kitti_ros2.model.boxes import DONT_CARE, Box, Cuboid
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.samples import cuboids_of
from kitti_ros2.model.streams import Stream
from kitti_ros2.options.messages import BASE_T_IMU
from kitti_ros2.options.outputs import BagOptions

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from kitti_ros2.kitti.kitti_recording import KittiRecording

TOPIC = '/my/detections'
STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(
    {kind: TYPESTORE.fielddefs[kind] for kind in {*TYPESTORE.fielddefs} - {*STORE.types}}
)


class Published(NamedTuple):
    """A message of a bag: encoded, or one that the typestore can serialise."""

    topic: str
    log_ns: int
    message: object
    msgtype: str = DETECTIONS_3D


def write_bag(path: Path, messages: Iterable[Published]) -> Path:
    """Write a bag in the order of log time; transforms that do not move are latched."""
    with open_bag(path, BagOptions(), STORE) as writer:
        channels: dict[str, int] = {}
        for event in sorted(messages, key=lambda one: one.log_ns):
            if event.topic not in channels:
                channel = Channel(event.topic, event.msgtype, latched='static' in event.topic)
                channels[event.topic] = writer.add_channel(channel)
            parts = event.message if isinstance(event.message, tuple) else serialize(event.message)
            writer.write(channels[event.topic], event.log_ns, (join(parts),))
    return path


def stamps_of(recording: KittiRecording) -> dict[int, int]:
    """Stamp by number of the frames with labels."""
    index = recording.streams[Stream.LABELS]
    return dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))


def labels_of(recording: KittiRecording, number: int) -> list[Box]:
    """The objects of a frame."""
    boxes = recording.read(Stream.LABELS, number).boxes
    return [box for box in boxes if box is not None and box.class_name != DONT_CARE]


def detected(
    recording: KittiRecording,
    number: int,
    frame: str = 'velo_link',
    frame_T_velo: Transform | None = None,
    stamp_ns: int | None = None,
) -> tuple:
    """A Detection3DArray of the objects of a frame, in any coordinate frame."""
    labels = recording.read(Stream.LABELS, number)
    cuboids = cuboids_of(labels, recording.calibration(number))
    moved = [
        Cuboid(
            cuboid.class_name,
            cuboid.identity,
            (frame_T_velo or Transform.identity()) @ cuboid.velo_T_box,
            cuboid.size_lwh,
            0.5,
        )
        for cuboid in cuboids
    ]
    stamp = stamps_of(recording)[number] if stamp_ns is None else stamp_ns
    return encode_detections(moved, stamp, frame)


def answers(recording: KittiRecording, *rest: object, late_ns: int = 20_000_000) -> list[Published]:
    """A message for each frame, on TOPIC, in the frame of rest."""
    return [
        Published(TOPIC, stamp + late_ns, detected(recording, number, *rest))
        for number, stamp in stamps_of(recording).items()
    ]


def answers_of_autoware(recording: KittiRecording, *, tracked: bool) -> list[Published]:
    """DetectedObjects or TrackedObjects for each frame, on TOPIC, in base_link."""
    encode = encode_tracked_objects if tracked else encode_detected_objects
    published = []
    for number, stamp in stamps_of(recording).items():
        calibration = recording.calibration(number)
        labels = cuboids_of(recording.read(Stream.LABELS, number), calibration)
        base_t_imu = Transform.from_translation(BASE_T_IMU)
        frame = ObjectFrame('base_link', base_t_imu @ calibration.velo_T_imu.inverse(), {})
        message = encode([replace(label, score=0.5) for label in labels], stamp, frame)
        msgtype = TRACKED_OBJECTS if tracked else DETECTED_OBJECTS
        published.append(Published(TOPIC, stamp, message, msgtype))
    return published


def answers_2d(recording: KittiRecording, frame: str = '') -> list[Published]:
    """2D boxes for each frame."""
    return [
        Published(
            TOPIC,
            stamp,
            encode_boxes_2d(
                [(str(box.track_id or 0), box) for box in labels_of(recording, number)],
                stamp,
                frame,
            ),
            DETECTIONS_2D,
        )
        for number, stamp in stamps_of(recording).items()
    ]
