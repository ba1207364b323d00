# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 bags are written in parts, with the bytes of a writer that joins each message and chunk."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from bag_samples import jazzy, make_samples, random_message, write_bag
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.file_writer import ros1_lz4
from kitti_ros2.messages.cdr import serialize, split
from kitti_ros2.messages.ros_versions import Ros1Types
from kitti_ros2.options.outputs import BagOptions

HEADER_BYTES = 4096
BULKY = ('sensor_msgs/msg/PointCloud2', 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
NOETIC = get_typestore(Stores.ROS1_NOETIC)


class PeerWriter(Writer):
    """rosbags' writer, with frames of lz4 and a bag header as ROS 1 needs them."""

    def __init__(self, path, compression):
        super().__init__(path)
        if compression != 'none':
            self.set_compression(self.CompressionFormat[compression.upper()])
        if compression == 'lz4':
            self.compressor = ros1_lz4

    def open(self):
        super().open()
        self.bio.flush()
        self.lengthen_header()
        self.bio.seek(0, 2)

    def close(self):
        super().close()
        self.lengthen_header()

    def lengthen_header(self):
        with self.path.open('r+b') as file:
            file.seek(13)
            (size,) = struct.unpack('<I', file.read(4))
            file.seek(size, 1)
            file.write(struct.pack('<I', HEADER_BYTES - size) + b' ' * (HEADER_BYTES - size))


def peer_bag(path, compression, samples):
    with PeerWriter(path, compression) as writer:
        connections = {}
        for channel in dict.fromkeys(sample.channel for sample in samples):
            definition, md5sum = NOETIC.generate_msgdef(channel.msgtype, ros_version=1)
            connections[channel] = writer.add_connection(
                channel.topic,
                channel.msgtype,
                msgdef=definition,
                md5sum=md5sum,
                callerid='/kitti_ros2',
                latching=int(channel.latched),
            )
        for sample in samples:
            data = jazzy().cdr_to_ros1(sample.data, sample.channel.msgtype)
            writer.write(connections[sample.channel], sample.stamp_ns, data)
    return path


@pytest.mark.parametrize('cloud_bytes', [0, 60_000, 400_000, 1_100_000])
@pytest.mark.parametrize('compression', ['none', 'lz4', 'bz2'])
def test_the_bytes_are_those_of_a_writer_that_joins_them(compression, cloud_bytes, tmp_path):
    """Of messages that lie across the ends of chunks, in and out of order, and of none at all."""
    known = [
        sample
        for sample in make_samples(rounds=5, cloud_bytes=cloud_bytes)
        if sample.channel.msgtype in NOETIC.fielddefs and 'Marker' not in sample.channel.msgtype
    ]
    for name, samples in (('a', known), ('b', known[::-1]), ('c', [])):
        options = BagOptions(storage='ros1', compression=compression)
        ours = write_bag(tmp_path / f'{name}.bag', options, samples)
        peers = peer_bag(tmp_path / f'{name}.peer.bag', compression, samples)
        assert ours.read_bytes() == peers.read_bytes()


def bulky(msgtype, rng, size):
    message = random_message(jazzy(), msgtype, rng)
    message.data = rng.integers(0, 256, size).astype(np.uint8)
    return message


@pytest.mark.parametrize('msgtype', BULKY)
def test_a_bulk_is_a_part_of_its_own_however_the_message_was_cut(msgtype):
    """The message converted in parts is what rosbags makes of the whole, without a copy."""
    rng = np.random.default_rng(1)
    convert = Ros1Types(jazzy()).converter(msgtype)
    for size in [0, 1, 2, 3, 4, 5, 1000] * 10:
        message = bulky(msgtype, rng, size)
        parts = serialize(message)
        whole = b''.join(parts)
        expected = bytes(jazzy().cdr_to_ros1(whole, msgtype))
        cut = int(rng.integers(0, len(whole)))
        for given in (parts, [whole], [memoryview(whole)], [whole[:cut], whole[cut:]]):
            assert b''.join(split(given, msgtype)) == whole
            converted = convert(given)
            assert b''.join(converted) == expected
            assert bytes(converted[2]) == message.data.tobytes()


@pytest.mark.parametrize('msgtype', [*BULKY, 'sensor_msgs/msg/Imu'])
def test_invalid_messages_are_refused_as_wholes_are(msgtype):
    """Too short, too long, with any byte changed, or big-endian."""

    def outcome(function, *arguments):
        try:
            made = function(*arguments)
        except Exception as error:  # noqa: BLE001 - whatever rosbags raises
            return type(error), str(error)
        return made if isinstance(made, memoryview) else b''.join(made)

    rng = np.random.default_rng(2)
    convert = Ros1Types(jazzy()).converter(msgtype)
    message = random_message(jazzy(), msgtype, rng)
    whole = bytes(jazzy().serialize_cdr(message, msgtype))
    damaged = [whole[:end] for end in range(len(whole))]
    damaged += [whole + bytes(extra) for extra in range(1, 9)]
    damaged += [whole[:at] + b'\xff' + whole[at + 1 :] for at in range(len(whole))]
    damaged.append(bytes(jazzy().serialize_cdr(message, msgtype, little_endian=False)))
    refused = 0
    for data in damaged:
        expected = outcome(jazzy().cdr_to_ros1, memoryview(data), msgtype)
        assert outcome(convert, [data]) == expected
        refused += isinstance(expected, tuple)
    assert refused > 20
