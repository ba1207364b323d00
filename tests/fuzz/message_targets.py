# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: messages in CDR, a target for each type that is decoded."""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import foreign
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.decoding import Decoder
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.reading import BagMessage
from kitti_ros2.importer.motion import LinkTracks
from kitti_ros2.messages.camera_info import camera_model
from kitti_ros2.messages.clouds import file_order
from kitti_ros2.messages.detections import boxes_of_detections_2d, has_scores
from kitti_ros2.messages.header import body_after_header, peek_first_stamp, peek_header
from kitti_ros2.messages.image import decode_compressed, decode_image
from kitti_ros2.messages.oxts import has_fix, has_orientation
from kitti_ros2.messages.pixels import picture_kind, pixels_of, png_of, size_of
from kitti_ros2.messages.point_spans import turn_of
from kitti_ros2.messages.pose import decode_odometry, poses_of
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.messages.scan import decode_scan
from kitti_ros2.messages.scan_sources import SCAN_SOURCES, ScanNeeds
from kitti_ros2.messages.solid_boxes import classes_in, cuboids_in, frames_in
from kitti_ros2.messages.source import decode_text
from kitti_ros2.messages.transforms import decode_static
from kitti_ros2.messages.velodyne_models import MODELS, nominal_lasers, parse_lasers
from kitti_ros2.messages.velodyne_packets import find_model
from kitti_ros2.model import msgtypes as types
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.layouts import Layout
from kitti_ros2.own_bags.description import parse_description

from .inputs import own_bag
from .message_inputs import SIZE, Messages
from .target import Target, place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosbags.typesys.store import Typestore

PATH = Path('folder/image.png')


@contextmanager
def _attempted() -> Iterator[None]:
    """What the readers of bags make a loss of: every caller of a decoder takes ValueError."""
    with suppress(ValueError):
        yield


def _scan(message: Any, msgtype: str) -> None:
    for source in SCAN_SOURCES:
        if msgtype in source.msgtypes and source.suits(message):
            with _attempted():
                source.scale([message])
            for model in MODELS if source.has_model else ('',):
                needs = ScanNeeds(255.0, _camera(), model=MODELS.get(model), lasers=_lasers(model))
                with _attempted():
                    source.decode(message, needs)


@cache
def _lasers(model: str):
    each = '- {laser_id: %d, vert_correction: 0.1, two_pt_correction_available: true}\n'
    text = 'lasers:\n' + ''.join(each % number for number in range(64))
    return nominal_lasers(model) or parse_lasers(text, PATH)


@cache
def _camera():
    model = camera_model(foreign.camera_info(1, 'a', right=False))
    return replace(model, size=(SIZE[1], SIZE[0]))


def _cloud(message: Any) -> None:
    turn_of([message])
    with _attempted():
        file_order(message)
    with _attempted():
        decode_scan(message)


def _image(message: Any) -> None:
    size_of(message)
    for deep in (True, False):
        with _attempted():
            pixels_of(message, deep=deep)
    with _attempted():
        decode_image(message)


def _compressed(message: Any) -> None:
    with _attempted():
        picture_kind(message)
    size_of(message)
    for deep in (True, False):
        with _attempted():
            pixels_of(message, deep=deep)
    with _attempted():
        png_of(message)
    with _attempted():
        decode_compressed(message, PATH)


def _boxes(message: Any) -> None:
    with _attempted():
        classes_in(message)
    with _attempted():
        joined = dict.fromkeys(frames_in(message), Transform.identity())
        for scores in (True, False):
            cuboids_in(message, joined, scores=scores)


def _boxes_2d(message: Any) -> None:
    has_scores(message)
    with _attempted():
        boxes_of_detections_2d(message)


def _odometry(message: Any) -> None:
    with _attempted():
        decode_odometry(message, Transform.identity())
    with _attempted():
        poses_of(message)


def _poses(message: Any) -> None:
    with _attempted():
        poses_of(message)


def _camera_info(message: Any) -> None:
    with _attempted():
        camera_model(message)


def _static(message: Any) -> None:
    with _attempted():
        decode_static(message)


def _velodyne(message: Any) -> None:
    with _attempted():
        find_model(message)


def _string(message: Any) -> None:
    decode_text(message)
    parse_description(message, PATH)


_READERS: dict[str, Callable[[Any], object]] = {
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


def _run(msgtype: str, data: bytes) -> None:
    for peek in (peek_header, peek_first_stamp, body_after_header):
        with _attempted():
            peek(data)
    if msgtype == types.TF:
        tracks = LinkTracks()
        with _attempted():
            tracks.add(data, 1)
        tracks.tracks()
    try:
        message = _decoder()(BagMessage('/t', msgtype, 1, data))
    except ValueError:
        return
    _READERS[msgtype](message)
    _scan(message, msgtype)


@cache
def _store() -> Typestore:
    """The types of ROS 2 and of this package."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register({**TYPESTORE.fielddefs, **store.fielddefs})
    return store


@cache
def _decoder() -> Decoder:
    return Decoder(_store())


@cache
def _messages() -> dict[str, list[bytes]]:
    """Messages of bags, by type; the shortest of each topic."""
    other = place('all_types.mcap')
    foreign.write_foreign(other, foreign.make_truth()[:1])
    found: dict[tuple[str, str], bytes] = {}
    for path in (other, *(own_bag('a.mcap', layout) for layout in Layout)):
        with open_messages(path) as messages:
            for each in messages:
                key, data = (each.msgtype, each.topic), bytes(each.data)
                if key not in found or len(data) < len(found[key]):
                    found[key] = data
    by_type: dict[str, list[bytes]] = {}
    for (msgtype, _), data in found.items():
        if len(data) < 60_000:
            by_type.setdefault(msgtype, []).append(data)
    return by_type


def _seeds(msgtype: str) -> list[bytes]:
    return [*Messages(_store()).of(msgtype), *_messages().get(msgtype, [])]


_MODULES = (
    'messages/autoware_objects.py',
    'messages/camera_info.py',
    'messages/clouds.py',
    'messages/depth_images.py',
    'messages/detections.py',
    'messages/image.py',
    'messages/jpeg.py',
    'messages/laser_scan.py',
    'messages/livox_points.py',
    'messages/marker_boxes.py',
    'messages/pixels.py',
    'messages/point_spans.py',
    'messages/pose.py',
    'messages/scan.py',
    'messages/solid_boxes.py',
    'messages/source.py',
    'messages/transform_numbers.py',
    'messages/transforms.py',
    'messages/velodyne_models.py',
    'messages/velodyne_packets.py',
    'own_bags/description.py',
)
_WORDS = (
    *(b'rgb8', b'bgra8', b'mono16', b'16UC1', b'32FC1', b'bayer_rggb8', b'yuv422', b'png', b'jpeg'),
    *(b'x', b'intensity', b'time', b'plumb_bob', b'equidistant', b'16UC1; compressedDepth png'),
    *(
        b'{"',
        b'"numbers": [[0, 9]]',
        b'NaN',
        b'"\\ud800"',
        b'\xff\xd8\xff\xe0',
        b'\x89PNG\r\n\x1a\n',
    ),
    *(bytes(8), b'\xff' * 8, b'\0\0\xc0\x7f', b'\0\0\0\0\0\0\xf8\x7f', b'\0\0\x80\x7f'),
)


TARGETS = (
    *(
        Target(f'cdr_{msgtype.rpartition("/")[2]}', partial(_run, msgtype),
               partial(_seeds, msgtype), _MODULES, _WORDS, short=60)
        for msgtype in _READERS
    ),
)  # fmt: skip
"""All of them."""
