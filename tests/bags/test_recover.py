# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a damaged bag still holds becomes a sound bag, and what is lost is named."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Reader

from kitti_ros2.bags.reader import open_messages, summarize_bag
from kitti_ros2.bags.recover import recover
from kitti_ros2.cli import main
from kitti_ros2.model.errors import BadBagError, OutputExistsError, UsageError
from kitti_ros2.model.streams import Layout

from builders import convert_recording  # isort: skip

STORAGES = {'mcap': '.mcap', 'sqlite3': '', 'ros1': '.bag'}


def messages_of(path):
    with open_messages(path) as messages:
        return Counter((each.topic, each.stamp_ns, bytes(each.data)) for each in messages)


@pytest.fixture(scope='module')
def bags(recordings, tmp_path_factory):
    """A sound bag of each storage."""
    folder = tmp_path_factory.mktemp('sound')
    made = {}
    for storage, ending in STORAGES.items():
        made[storage] = folder / f'{storage}{ending}'
        convert_recording(recordings[Layout.RAW], made[storage], storage=storage)
    return made


def cut_copy(source, path, part):
    file = next(source.glob('*.db3')) if source.is_dir() else source
    target = path.with_suffix(file.suffix)
    data = file.read_bytes()
    target.write_bytes(data[: int(len(data) * part)])
    return target


@pytest.mark.parametrize('storage', list(STORAGES))
def test_a_sound_bag_stays_what_it_is(bags, storage, tmp_path):
    out = tmp_path / f'out{STORAGES[storage]}'
    found = recover(bags[storage], out)
    assert found.losses == ()
    assert messages_of(out) == messages_of(bags[storage])
    assert summarize_bag(out).complete
    with open_messages(bags[storage]) as before, open_messages(out) as after:
        assert before.channels == after.channels
        assert before.latched.keys() == after.latched.keys()


@pytest.mark.parametrize('storage', list(STORAGES))
def test_a_cut_bag_becomes_a_sound_one_of_what_can_be_read(bags, storage, tmp_path):
    cut = cut_copy(bags[storage], tmp_path / 'cut', 0.97 if storage == 'sqlite3' else 0.6)
    out = tmp_path / f'out{STORAGES[storage]}'
    found = recover(cut, out, storage)
    assert found.losses
    assert all(str(cut) in loss for loss in found.losses)
    summary = summarize_bag(out)
    assert summary.complete
    assert summary.message_count == sum(found.counts.values())
    assert messages_of(out) == messages_of(cut)
    assert not messages_of(out) - messages_of(bags[storage])


@pytest.mark.one_in(3)
@pytest.mark.parametrize('seed', range(20))
def test_an_mcap_cut_anywhere_gives_all_that_was_whole(bags, seed, tmp_path):
    """Nothing is lost but what lies at the cut: one message, in a file without compression."""
    data = bags['mcap'].read_bytes()
    size = random.Random(seed).randrange(10_000, len(data))
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[:size])
    whole = [(stamp, topic, blob) for topic, stamp, blob in messages_of(bags['mcap']).elements()]
    before = [each for each in whole if 0 <= data.find(each[2]) <= size - len(each[2])]
    recover(cut, tmp_path / 'out.mcap')
    got = messages_of(tmp_path / 'out.mcap').total()
    # Equal texts occur several times, so only the number within the cut can be told.
    assert got <= len(before)
    large = [each for each in before if len(each[2]) > 2_000]
    kept = {blob for *_, blob in messages_of(tmp_path / 'out.mcap')}
    assert all(blob in kept for *_, blob in large)


def test_another_container_may_be_asked_for(bags, tmp_path):
    recover(bags['sqlite3'], tmp_path / 'out.mcap')
    assert messages_of(tmp_path / 'out.mcap') == messages_of(bags['sqlite3'])


def test_messages_of_ros_1_keep_their_bytes(bags, tmp_path):
    """Also what has no place in ROS 2, such as the seq of a header."""
    out = tmp_path / 'out.bag'
    recover(bags['ros1'], out)
    raw = []
    for path in (bags['ros1'], out):
        with Reader(path) as reader:
            rows = [(each.topic, ns, bytes(data)) for each, ns, data in reader.messages()]
            raw.append(Counter(rows))
    assert raw[0] == raw[1]


def test_a_bag_is_not_recovered_onto_itself(bags):
    with pytest.raises(UsageError, match='give another name'):
        recover(bags['mcap'], bags['mcap'], overwrite=True)


def test_nothing_recoverable_leaves_nothing(tmp_path):
    path = tmp_path / 'bad.mcap'
    path.write_bytes(b'\x89MCAP0\r\n' + bytes(100))
    with pytest.raises(BadBagError):
        recover(path, tmp_path / 'out.mcap')
    assert [each.name for each in tmp_path.iterdir()] == ['bad.mcap']


def test_an_existing_output_is_refused(bags, tmp_path):
    recover(bags['mcap'], tmp_path / 'out.mcap')
    with pytest.raises(OutputExistsError):
        recover(bags['mcap'], tmp_path / 'out.mcap')
    recover(bags['mcap'], tmp_path / 'out.mcap', overwrite=True)


def test_the_command_says_what_it_saved_and_what_is_lost(bags, tmp_path, capsys):
    sound = tmp_path / 'sound.mcap'
    assert main(['recover', str(bags['mcap']), str(sound)]) == 0
    assert 'messages on' in capsys.readouterr().out
    cut = cut_copy(bags['mcap'], tmp_path / 'cut', 0.5)
    assert main(['recover', str(cut), str(tmp_path / 'saved.mcap'), '-q']) == 1
    said = capsys.readouterr()
    assert said.out == ''
    assert 'cut off at byte' in said.err
    assert main(['recover', str(tmp_path / 'none'), str(tmp_path / 'x.mcap')]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_definition_that_refers_to_itself_is_named(tmp_path, capsys):
    with (tmp_path / 'in.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'test')
        schema = writer.register_schema('a/msg/S', 'ros2msg', b'a/S itself\n')
        channel = writer.register_channel('/a', 'cdr', schema)
        writer.add_message(channel, 1, b'\0\1\0\0', 1)
        writer.finish()
    assert main(['recover', str(tmp_path / 'in.mcap'), str(tmp_path / 'out.mcap')]) == 1
    said = capsys.readouterr().err
    assert '/a: a/msg/S cannot be written to mcap (its definition refers to itself)' in said
