# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: messages in CDR, a target for each type that is decoded."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import foreign
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.reader import BagMessage, Decoder, open_messages
from kitti_ros2.importer.bag_poses import LinkTracks
from kitti_ros2.messages.cdr import body_after_header, peek_first_stamp, peek_header
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.streams import Layout

from .inputs import own_bag
from .message_inputs import Messages
from .message_readers import READERS, attempted, read_scan
from .target import Target, place

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


PATH = Path('folder/image.png')


def _run(msgtype: str, data: bytes) -> None:
    for peek in (peek_header, peek_first_stamp, body_after_header):
        with attempted():
            peek(data)
    if msgtype == types.TF:
        tracks = LinkTracks()
        with attempted():
            tracks.add(data, 1)
        tracks.tracks()
    try:
        message = _decoder()(BagMessage('/t', msgtype, 1, data))
    except ValueError:
        return
    READERS[msgtype](message)
    read_scan(message, msgtype)


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
    'bags/reader.py',
    'messages/detections.py',
    'messages/camera_info.py',
    'messages/clouds.py',
    'messages/scan_sources.py',
    'messages/images.py',
    'files/image_files.py',
    'messages/oxts.py',
    'messages/scan.py',
    'messages/source_texts.py',
    'own_bags/source_files.py',
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
        for msgtype in READERS
    ),
)  # fmt: skip
"""All of them."""
