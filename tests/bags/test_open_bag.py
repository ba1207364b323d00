# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An open bag: one set of files for its index and all messages, problems by reader.

A command opens its bag, surveys it, makes its plan and reads its description once.
"""

from __future__ import annotations

from contextlib import closing

import pytest

from kitti_ros2.bags import bag_files
from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.reader import bag_stamps, open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.importer import guess, survey
from kitti_ros2.importer.labelled_images import LabelledImages
from kitti_ros2.messages.cdr import serialize
from kitti_ros2.messages.ros_types import TYPESTORE, String
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.own_bags import source_files
from kitti_ros2.player.bag_program import open_program

import foreign  # isort: skip

from builders import convert_recording  # isort: skip

NAMES = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}
TEXT = 'text of a message ' * 40
COMMANDS = {
    'info': ('info',),
    'to-kitti': ('to-kitti', '-q', '--layout', 'object', 'out'),
    'plan': ('to-kitti', '--plan', '--layout', 'odometry'),
    'report': ('report', '-q', '-o', 'page.html'),
    'view': ('view', '-q', '-o', 'picture.png'),
}
PASSES = {
    'written by to-bag': {
        'info': ['description'],
        'to-kitti': ['description'],
        'plan': ['description', 'survey', 'plan'],
        'report': ['description', 'survey'],
        'view': ['survey', 'description'],
    },
    'of another recorder': {
        'info': [],
        'to-kitti': ['survey', 'plan'],
        'plan': ['survey', 'plan'],
        'report': ['survey', 'plan'],
        'view': ['survey', 'plan'],
    },
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


@pytest.fixture
def passes(monkeypatch):
    """What was made of a bag so far: survey, plan, description."""
    found = []

    def count(name, module, function):
        original = getattr(module, function)

        def counted(*args):
            found.append(name)
            return original(*args)

        monkeypatch.setattr(module, function, counted)

    count('survey', survey, '_SurveyPass')
    count('plan', guess, 'guess_cameras')
    count('description', source_files, 'parse_description')
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
        assert len(first.problems) == 1
        assert second.problems == ()
        assert bag.index.problems == []
        list(second)
        assert second.problems == first.problems


@pytest.mark.one_in(3)
@pytest.mark.parametrize('command', list(COMMANDS))
@pytest.mark.parametrize('kind', ['written by to-bag', 'of another recorder'])
def test_a_command_reads_its_bag_once(
    tmp_path, recordings, monkeypatch, opened, passes, command, kind
):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'bag.mcap'
    if kind == 'of another recorder':
        foreign.write_foreign(path, foreign.make_truth()[:3])
    else:
        convert_recording(recordings[Layout.OBJECT], path)
    name, *words = COMMANDS[command]
    assert main([name, str(path), *words]) == 0
    assert opened == [path]
    assert passes == PASSES[kind][command]


def test_labels_are_drawn_from_one_opening(tmp_path, opened, passes):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth()[:3])
    with OpenBag(path) as bag:
        LabelledImages(bag)
    assert opened == [path]
    assert passes == ['survey', 'plan']


@pytest.mark.parametrize('annotated', [False, True])
def test_a_player_opens_its_bag_once(tmp_path, recordings, opened, annotated):
    path = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.OBJECT], path)
    with closing(open_program(path, make_play_settings({'annotated': annotated}))) as program:
        wanted = range(len(program.channels))
        fetched = [program.fetch(index, wanted) for index in range(len(program.stamps_ns))]
    assert all(messages and not losses for messages, losses in fetched)
    assert opened == [path]
