# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with the same types share the classes of their messages, and nothing else."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from kitti_ros2.bags.container_file import Problems, StoredChannel
from kitti_ros2.bags.stored_messages import Definitions

from waiting import PATIENCE_S, wait_until  # isort: skip

NAME = 'robot_msgs/msg/State'
TEXT = 'uint8 LEVEL=3\nuint8 level\nstd_msgs/Header header\n'
OTHER = 'uint8 LEVEL=4\nuint8 level\nstd_msgs/Header header\n'


def definitions(text, path='bag'):
    found = Definitions(Problems())
    assert not found.add(Path(path), Path(path), StoredChannel('/a', NAME, 'cdr', text, 'ros2msg'))
    assert not found.complete([NAME])
    return found


def round_trip(store):
    types = store.types
    stamp = types['builtin_interfaces/msg/Time'](7, 8)
    message = types[NAME](2, types['std_msgs/msg/Header'](stamp, 'map'))
    read = store.deserialize_cdr(store.serialize_cdr(message, NAME), NAME)
    return read.level, read.header.stamp.sec, read.header.frame_id, read.LEVEL


def test_the_same_types_share_their_classes_and_functions():
    first, second = (definitions(TEXT, path).typestore() for path in ('a', 'b'))
    assert first is not second
    assert first.types[NAME] is second.types[NAME]
    assert round_trip(first) == (2, 7, 'map', 3)
    assert second.cache[NAME] is first.cache[NAME]


@pytest.mark.parametrize('text', [OTHER, TEXT.replace('uint8 level', 'int16 level')])
def test_other_types_share_none(text):
    first, second = definitions(TEXT).typestore(), definitions(text).typestore()
    assert first.types[NAME] is not second.types[NAME]
    assert round_trip(first)[3] == 3
    assert round_trip(second)[3] == (4 if text == OTHER else 3)
    assert first.serialize_cdr(first.types[NAME](1, _header(first)), NAME).nbytes


def _header(store):
    stamp = store.types['builtin_interfaces/msg/Time'](0, 0)
    return store.types['std_msgs/msg/Header'](stamp, '')


@pytest.mark.parametrize('read_before', [False, True])
def test_what_one_registers_the_other_does_not_have(read_before):
    first, second = definitions(TEXT).typestore(), definitions(TEXT).typestore()
    if read_before:
        round_trip(first)
    for store, kind in ((first, 'int8'), (second, 'float64')):
        added = 'robot_msgs/msg/Added'
        assert added not in store.fielddefs
        store.register({added: ([], [('value', (Nodetype.BASE, (kind, 0)))])})
        message = store.types[added](1)
        assert len(store.serialize_cdr(message, added)) == (5 if kind == 'int8' else 12)
    assert round_trip(first) == round_trip(second)


def test_original_texts_are_those_of_the_bag():
    found = definitions(TEXT)
    store = found.with_original_texts(found.typestore())
    assert store.generate_msgdef(NAME, ros_version=2)[0] == TEXT
    assert round_trip(store) == (2, 7, 'map', 3)
    plain = found.typestore()
    assert plain.generate_msgdef(NAME, ros_version=2)[0] != TEXT


def test_types_that_nobody_reads_get_no_class():
    found = definitions(TEXT)
    for number in range(100):
        other = StoredChannel(f'/{number}', f'a_msgs/msg/T{number}', 'cdr', 'Own a\n', 'ros2msg')
        found.add(Path('bag'), Path('bag'), other)
    store = found.typestore()
    assert len(store.fielddefs) > 100
    assert len(dict(store.types)) < 5
    assert round_trip(store) == (2, 7, 'map', 3)
    assert len(dict(store.types)) < 5
    with pytest.raises(KeyError):
        store.types['a_msgs/msg/Unknown']


def test_threads_that_ask_at_the_same_time_get_one_class(monkeypatch):
    store = definitions(TEXT.replace('LEVEL=3', 'LEVEL=5')).typestore()
    second_asks, made, register = Event(), [], Typestore.register

    def slow(self, types):
        made.append(types)
        assert second_asks.wait(PATIENCE_S)
        register(self, types)

    def ask(number):
        if number:
            wait_until(lambda: made)
            second_asks.set()
        return store.types[NAME]

    monkeypatch.setattr(Typestore, 'register', slow)
    with ThreadPoolExecutor(2) as pool:
        assert len(set(pool.map(ask, range(2)))) == 1
    assert len(made) == 1


@pytest.mark.parametrize('encoding', ['ros1msg', 'ros2msg'])
def test_a_field_that_differs_in_case_is_the_field(encoding):
    """rosbags-convert keeps D, K, R and P of ROS 1 in its bags of ROS 2."""
    name = 'sensor_msgs/msg/RegionOfInterest'
    text = 'uint32 X_OFFSET\nuint32 y_offset\nuint32 Height\nuint32 width\nuint32 extra\n'
    problems = Problems()
    found = Definitions(problems)
    found.add(Path('bag'), Path('bag'), StoredChannel('/a', name, 'cdr', text, encoding))
    fields = [field for field, _ in found.typestore().fielddefs[name][1]]
    assert fields == ['x_offset', 'y_offset', 'height', 'width', 'extra']
    assert bool(problems.notes) == (encoding == 'ros2msg')


@pytest.mark.parametrize('first', ['width', 'Width'])
def test_a_second_field_of_the_same_letters_stays(first):
    name = 'sensor_msgs/msg/RegionOfInterest'
    found = Definitions(Problems())
    text = f'uint32 {first}\nuint32 WIDTH\n'
    found.add(Path('bag'), Path('bag'), StoredChannel('/a', name, 'cdr', text, 'ros2msg'))
    fields = [field for field, _ in found.typestore().fielddefs[name][1]]
    assert fields == [first, 'WIDTH']


def test_a_definition_that_cannot_be_read_is_the_reason():
    found = Definitions(Problems())
    found.add(Path('bag'), Path('bag'), StoredChannel('/a', NAME, 'cdr', '%%%', 'ros2msg'))
    reasons = found.complete([NAME, 'robot_msgs/msg/Other'])
    assert reasons[NAME].startswith(f'the definition of {NAME} cannot be read (')
    other = 'neither the bag nor ROS 2 Jazzy defines robot_msgs/msg/Other'
    assert reasons['robot_msgs/msg/Other'] == other
