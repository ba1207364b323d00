# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An open bag: one set of files for its index and all messages, findings by reader."""

from __future__ import annotations

import pytest
from kitti_ros2.model.channels import Channel

from kitti_ros2.bags import bag_files
from kitti_ros2.bags.reader import OpenBag, bag_stamps, open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.exporter.to_bag import convert
from kitti_ros2.kitti.layouts import open_recording
from kitti_ros2.messages.cdr import serialize
from kitti_ros2.messages.ros_types import TYPESTORE, String
from kitti_ros2.model.layouts import Layout
from kitti_ros2.options.bag import BagOptions
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.selection import SelectionOptions

import foreign  # isort: skip

NAMES = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}
TEXT = 'text of a message ' * 40
COMMANDS = {
    'info': ('info',),
    'to-kitti': ('to-kitti', '-q', '--layout', 'object', 'out'),
    'report': ('report', '-q', '-o', 'page.html'),
    'view': ('view', '-q', '-o', 'picture.png'),
}


@pytest.fixture
def opened(monkeypatch):
    """The bags whose files were opened so far."""
    found = []
    original = bag_files.open_files

    def counted(bag, *rest):
        found.append(bag.path)
        return original(bag, *rest)

    monkeypatch.setattr(bag_files, 'open_files', counted)
    return found


def write(path, storage='mcap'):
    with open_bag(path, BagOptions(storage), TYPESTORE) as bag:
        ids = [bag.add_channel(Channel(topic, 'std_msgs/msg/String')) for topic in ('/a', '/b')]
        for stamp_ns in range(1, 7):
            bag.write(ids[stamp_ns % 2], stamp_ns, serialize(String(f'{TEXT}{stamp_ns}')))
    return bag.path


@pytest.mark.parametrize('storage', list(NAMES))
def test_index_and_messages_are_read_from_one_set_of_files(tmp_path, opened, storage):
    path = write(tmp_path / NAMES[storage], storage)
    with OpenBag(path) as bag, open_messages(bag, {'/a'}) as some, open_messages(bag) as every:
        stamps = {topic: found.tolist() for topic, found in bag_stamps(bag).items()}
        pairs = zip(some, every, strict=False)  # both are read at a time
        assert [(one.stamp_ns, other.stamp_ns) for one, other in pairs] == [(2, 1), (4, 2), (6, 3)]
    assert stamps == {'/a': [2, 4, 6], '/b': [1, 3, 5]}
    assert opened == [path]


def test_files_are_open_until_the_last_reader_is_closed(tmp_path):
    with OpenBag(write(tmp_path / 'bag.mcap')) as bag:
        messages = open_messages(bag)
    assert len(list(messages)) == 6
    messages.close()
    with pytest.raises(ValueError, match='closed'):
        list(messages)


def test_damage_is_reported_to_the_reader_that_meets_it(tmp_path):
    path = write(tmp_path / 'bag.mcap')
    data = bytearray(path.read_bytes())
    data[data.index(TEXT.encode()) + 5] ^= 1
    path.write_bytes(data)
    with OpenBag(path) as bag, open_messages(bag) as first, open_messages(bag) as second:
        list(first)
        assert len(first.findings) == 1
        assert second.findings == ()
        assert bag.index.findings == []
        list(second)
        assert second.findings == first.findings


@pytest.mark.parametrize('command', list(COMMANDS))
@pytest.mark.parametrize('kind', ['written by to-bag', 'of another recorder'])
def test_a_command_opens_its_bag_once(tmp_path, recordings, monkeypatch, opened, command, kind):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'bag.mcap'
    if kind == 'of another recorder':
        foreign.write_foreign(path, foreign.make_truth()[:3])
    else:
        recording = open_recording(recordings[Layout.OBJECT])
        convert(recording, path, MessageOptions(), SelectionOptions(), BagOptions())
    name, *words = COMMANDS[command]
    assert main([name, str(path), *words]) == 0
    assert opened == [path]
