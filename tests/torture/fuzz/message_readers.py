# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What reads a message of each type, as importers, players and readers of results do."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import foreign
import numpy as np

from kitti_ros2.bags.reader import ForwardStamps
from kitti_ros2.messages.camera_info import camera_model, decode_static
from kitti_ros2.messages.clouds import TurnTimes, decode_cloud, file_order
from kitti_ros2.messages.detections import (
    boxes_in,
    boxes_of_detections_2d,
    cuboids_in,
    frames_in,
    has_scores,
)
from kitti_ros2.messages.images import (
    decode_compressed,
    decode_image,
    picture_kind,
    pixels_of,
    png_of,
    size_of,
)
from kitti_ros2.messages.oxts import (
    decode_odometry,
    has_fix,
    has_orientation,
    poses_of,
    poses_of_link,
)
from kitti_ros2.messages.scan import decode_scan
from kitti_ros2.messages.scan_sources import (
    MODELS,
    SCAN_SOURCES,
    ScanNeeds,
    find_model,
    nominal_lasers,
    parse_lasers,
)
from kitti_ros2.messages.source_texts import decode_text
from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.geometry import Transform
from kitti_ros2.own_bags.source_files import parse_description

from .message_inputs import SIZE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from kitti_ros2.messages.camera_info import CameraModel
    from kitti_ros2.messages.scan_sources import Lasers, ScanSource

PATH = Path('folder/image.png')


@contextmanager
def attempted() -> Iterator[None]:
    """What the readers of bags make a loss of; a refusal of one decoder is not that of the next."""
    with suppress(ValueError, KittiRos2Error):
        yield


def read_scan(message: Any, msgtype: str) -> None:
    for source in SCAN_SOURCES:
        if msgtype in source.msgtypes:
            source.suits(message)
            with attempted():
                source.scale([message])
            for needs in _needs(source):
                with attempted():
                    source.decode(message, needs)


@cache
def _needs(source: ScanSource) -> list[ScanNeeds]:
    """Scanners, or cameras: distorted ones, rectified ones, and one with numbers it cannot have."""
    if source.has_model:
        return [
            ScanNeeds(255.0, model=model, lasers=_lasers(name)) for name, model in MODELS.items()
        ]
    camera = _camera()
    if not source.needs_info:
        return [ScanNeeds(255.0)]
    return [
        *(ScanNeeds(camera=camera, rectified=rectified) for rectified in (True, False)),
        ScanNeeds(camera=replace(camera, d=np.zeros(5))),
        ScanNeeds(camera=replace(camera, d=np.full(3, 0.1))),
        ScanNeeds(camera=replace(camera, size=(9, 9))),
    ]


@cache
def _lasers(model: str) -> Lasers:
    each = '- {laser_id: %d, vert_correction: 0.1, two_pt_correction_available: true}\n'
    text = 'lasers:\n' + ''.join(each % number for number in range(64))
    return nominal_lasers(model) or parse_lasers(text, PATH)


@cache
def _camera() -> CameraModel:
    model = camera_model(foreign.camera_info(1, 'a', right=False))
    return replace(model, size=(SIZE[1], SIZE[0]))


def _cloud(message: Any) -> None:
    TurnTimes().span_ns(message)
    with attempted():
        file_order(message)
    with attempted():
        decode_cloud(message, 255.0)
    with attempted():
        decode_scan(message)


def _image(message: Any) -> None:
    size_of(message)
    for deep in (True, False):
        with attempted():
            pixels_of(message, deep=deep)
    with attempted():
        decode_image(message)


def _compressed(message: Any) -> None:
    with attempted():
        picture_kind(message)
    size_of(message)
    for deep in (True, False):
        with attempted():
            pixels_of(message, deep=deep)
    with attempted():
        png_of(message)
    with attempted():
        decode_compressed(message, PATH)


def _boxes(message: Any) -> None:
    with attempted():
        boxes_in(message)
    with attempted():
        frames = frames_in(message)
        for names in (frames, [*frames][:1], ()):
            joined = dict.fromkeys(names, Transform.identity())
            for scores in (True, False):
                with attempted():
                    cuboids_in(message, joined, scores=scores)


def _boxes_2d(message: Any) -> None:
    has_scores(message)
    with attempted():
        boxes_of_detections_2d(message)


def _odometry(message: Any) -> None:
    with attempted():
        decode_odometry(message, Transform.identity())
    with attempted():
        poses_of(message)


def _poses(message: Any) -> None:
    with attempted():
        poses_of(message)


def _camera_info(message: Any) -> None:
    with attempted():
        _ = camera_model(message).offset


def _static(message: Any) -> None:
    with attempted():
        decode_static(message)
    for each in message.transforms[:3]:
        link = each.header.frame_id.lstrip('/'), each.child_frame_id.lstrip('/')
        with attempted():
            poses_of_link(message, link)


def _velodyne(message: Any) -> None:
    with attempted():
        find_model(message)


def _string(message: Any) -> None:
    decode_text(message)
    sweeps = ForwardStamps()
    for topic in sorted(ForwardStamps.topics):
        with attempted():
            sweeps.take(topic, message, 1)
    sweeps.forward([1])
    parse_description(message, PATH)


READERS: dict[str, Callable[[Any], object]] = {
    types.CLOUD: _cloud,
    types.IMAGE: _image,
    types.COMPRESSED: _compressed,
    types.CAMERA_INFO: _camera_info,
    types.IMU: has_orientation,
    types.FIX: has_fix,
    types.TWIST: lambda message: message.twist.linear.x,
    types.TWIST_COVARIANCE: lambda message: message.twist.twist.linear.x,
    types.ODOMETRY: _odometry,
    types.POSE: _poses,
    types.PATH: _poses,
    types.TF: _static,
    types.MARKERS: _boxes,
    types.DETECTIONS_3D: _boxes,
    types.DETECTIONS_2D: _boxes_2d,
    types.DETECTED_OBJECTS: _boxes,
    types.TRACKED_OBJECTS: _boxes,
    types.LASER_SCAN: lambda _: None,
    'livox_ros_driver2/msg/CustomMsg': lambda _: None,
    types.VELODYNE: _velodyne,
    types.STRING: _string,
}
