# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: the definitions of message types in bags, and the texts of QoS profiles."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from kitti_ros2.bags.container_file import Problems, StoredChannel, offered_qos, qos_faults
from kitti_ros2.bags.reader import BagMessage, Decoder
from kitti_ros2.bags.stored_messages import Definitions
from kitti_ros2.kitti.store import decode_text
from kitti_ros2.messages.ros_types import TYPESTORE

from .target import YAML_WORDS, Target


def _qos(data: bytes) -> None:
    text = data.decode('utf-8', 'replace')
    offered_qos(text)
    qos_faults(text)


def _qos_texts() -> list[bytes]:
    latched = b'- history: 1\n  depth: 9\n  durability: transient_local\n  reliability: reliable\n'
    other = b'- history: keep_last\n  depth: 3\n  durability: 2\n  reliability: 1\n'
    return [latched, other, latched + other, b'']


def _definition(data: bytes) -> None:
    name, _, text = decode_text(data, Path('definition')).partition('\n')
    for encoding in ('ros2msg', 'ros1msg', 'ros2idl', 'other'):
        channel = StoredChannel('/t', name, 'cdr', text, encoding)
        Definitions(Problems()).add(Path('a'), Path('a'), channel)


def _typestore(data: bytes) -> None:
    """Go on to messages of the type, which is slow."""
    name, _, text = decode_text(data, Path('definition')).partition('\n')
    for encoding in ('ros2msg', 'ros1msg', 'ros2idl'):
        definitions = Definitions(Problems())
        for bag, each in ((Path('a'), text), (Path('b'), text.replace('64', '32'))):
            channel = StoredChannel('/t', name, 'cdr', each, encoding)
            definitions.add(bag, bag, channel)
        if name in definitions.complete([name]):
            continue
        with suppress(ValueError):  # what its caller reports
            definitions.check_known(name)
        store = definitions.typestore()
        definitions.with_original_texts(store).generate_msgdef(name, 2)
        with suppress(ValueError):
            Decoder(store)(BagMessage('/t', name, 1, bytes(400)))


def _definition_texts() -> list[bytes]:
    kinds = ('sensor_msgs/msg/Imu', 'tf2_msgs/msg/TFMessage', 'sensor_msgs/msg/PointCloud2')
    made = [TYPESTORE.generate_msgdef(kind, ros_version=2)[0].encode() for kind in kinds]
    texts = [kind.encode() + b'\n' + text for kind, text in zip(kinds, made, strict=True)]
    idl = (b'a/msg/B\nmodule a { module msg { const long C = 3; typedef double d[3];'
           b' struct B { @verbatim(language="x", text="y") d place; sequence<string> names;'
           b' a::msg::E e; }; }; };')  # fmt: skip
    small = b'a/msg/B\nstd_msgs/Header header\nfloat64 x\nuint8 A=1\nstring S=text\n'
    return [small, *texts, idl]


_TYPE_WORDS = (
    *(b'string<=3', b'[<=4]', b'[2]', b'uint8', b'===', b'MSG: a/B', b'=1', b'module ', b'header'),
    *(b'(', b'sequence<', b'/*', b'//', b'"', b'#', b'a/B'),
)

_MODULES = ('bags/stored_messages.py', 'messages/type_definitions.py')
TARGETS = (
    Target('qos', _qos, _qos_texts, ('bags/container_file.py',), YAML_WORDS, is_text=True,
           long=100_000),
    Target('definition', _definition, _definition_texts,
           _MODULES, _TYPE_WORDS, is_text=True, long=100_000),
    Target('typestore', _typestore, _definition_texts,
           (*_MODULES, 'bags/reader.py'), _TYPE_WORDS, is_text=True, short=40),
)  # fmt: skip
"""All of them."""
