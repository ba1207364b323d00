# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1's own rosbag reads the bags of the commands; where Debian's python3-rosbag is installed.

apt-get install python3-rosbag python3-{std,sensor,geometry,nav,visualization,tf2}-msgs
"""

from __future__ import annotations

import hashlib
import json
import subprocess
from pathlib import Path

import pytest
from lz4 import frame
from rosbags.rosbag1 import Reader

from kitti_ros2.bags.file_writer import ros1_lz4
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

pytestmark = pytest.mark.programs

DEBIAN = Path('/usr/bin/python3')
SCRIPT = Path(__file__).with_name('ros1_itself.py')
COMPRESSIONS = ['none', 'bz2', 'lz4']


def debian(*arguments):
    words = [DEBIAN, *map(str, arguments)]
    return subprocess.run(words, check=False, capture_output=True, text=True)


@pytest.fixture(scope='session')
def ros1():
    """A function that runs the script with ROS 1's own rosbag."""
    if not DEBIAN.exists() or debian('-c', 'import rosbag, roslz4, sensor_msgs').returncode:
        pytest.skip(f'{DEBIAN} has no rosbag: apt-get install python3-rosbag python3-sensor-msgs')

    def run(*arguments):
        done = debian(SCRIPT, *arguments)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def kitti_ros2(*arguments):
    assert main([*map(str, arguments)]) == 0


def written(path):
    """What the bag holds, by a reader that is neither ours nor ROS 1's."""
    with Reader(path) as reader:
        return sorted(
            [each.topic, stamp_ns, hashlib.sha256(data).hexdigest()]
            for each, stamp_ns, data in reader.messages()
        )


@pytest.mark.one_in(3)
@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('layout', list(Layout), ids=[layout.value for layout in Layout])
def test_ros1_reads_every_message(ros1, recordings, layout, compression, tmp_path):
    """Also after `rosbag reindex`; and `rosbag info` counts them."""
    bag = tmp_path / 'bag.bag'
    images = 'both' if compression == 'lz4' else 'compressed'
    options = ['--compression', compression, '--images', images]
    kitti_ros2('to-bag', '-q', recordings[layout], bag, *options)
    expected = written(bag)
    assert expected
    for found in ros1('read', bag, tmp_path / 'reindexed.bag'):
        print(
            f'{compression}: {len(found["messages"])} of {len(expected)} messages, {layout.value}'
        )
        assert found['messages'] == expected
        assert found['counted'] == len(expected)
        assert found['compression'] == compression
        assert found['unlike'] == []
        assert f'messages: {len(expected)} ' in ' '.join(found['information'].split())


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_ros1_reads_what_recover_makes_of_its_own_bag(ros1, compression, tmp_path):
    bag = tmp_path / 'ros1.bag'
    expected = ros1('write', bag, compression)['messages']
    kitti_ros2('recover', '-q', bag, tmp_path / 'recovered.bag')
    found = ros1('read', tmp_path / 'recovered.bag')
    print(f'{compression}: {len(found["messages"])} of {len(expected)} messages, recovered')
    assert found['messages'] == expected
    assert found['compression'] == compression
    assert found['unlike'] == []


def test_ros1_reads_what_recover_makes_of_a_real_bag(ros1, real_kitti, tmp_path):
    bag = real_kitti / 'bags' / 'example-lz4.bag'
    kitti_ros2('recover', '-q', bag, tmp_path / 'recovered.bag')
    found = ros1('read', tmp_path / 'recovered.bag')
    assert found['messages'] == ros1('read', bag)['messages'] == written(bag)
    assert found['compression'] == 'lz4'


def test_ros1_reads_messages_larger_than_a_block(ros1, make_drive, tmp_path):
    """Pixels and scans of real sizes, of which lz4 makes several blocks."""
    bag = tmp_path / 'bag.bag'
    options = ['--compression', 'lz4', '--images', 'raw']
    kitti_ros2('to-bag', '-q', make_drive(3), bag, *options)
    assert ros1('read', bag)['messages'] == written(bag)


@pytest.mark.parametrize('size', [1, 100, 2**20, 2**20 + 1, 3_000_000])
def test_lz4_frames_are_as_ros1_demands(size):
    """The flags of a frame's header that roslz4's processHeader refuses or demands."""
    data = bytes(range(251)) * (size // 251 + 1)
    compressed = ros1_lz4(data[:size])
    version, flags, block = compressed[4] >> 6, compressed[4], compressed[5]
    assert compressed[:4] == b'\x04\x22\x4d\x18'
    assert version == 1
    assert flags & 0b100000  # independent blocks
    assert not flags & 0b010000  # no checksum of each block
    assert not flags & 0b001000  # no content size
    assert flags & 0b000100  # a checksum of the content
    assert not flags & 0b000011  # reserved, and no dictionary
    assert block >> 4 in {4, 5, 6, 7}
    assert not block & 0b10001111
    assert frame.decompress(compressed) == data[:size]
