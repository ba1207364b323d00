# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that were cut off or damaged: every whole message is read, and every loss is told."""

from __future__ import annotations

import errno
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
import yaml
import zstandard
from bag_samples import make_samples, write_bag
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Reader as Ros1Reader

from kitti_ros2.bags import mcap_writer
from kitti_ros2.bags.container_file import FileBytes
from kitti_ros2.bags.locate import reindex_steps
from kitti_ros2.bags.reader import bag_stamps, open_messages, summarize_bag
from kitti_ros2.cli import main
from kitti_ros2.model.errors import BadBagError
from kitti_ros2.options.outputs import BagOptions

CASES = {
    'mcap': ('bag.mcap', BagOptions()),
    'mcap zstd': ('bag.mcap', BagOptions(compression='zstd')),
    'mcap lz4': ('bag.mcap', BagOptions(compression='lz4')),
    'ros1': ('bag.bag', BagOptions(storage='ros1')),
    'ros1 lz4': ('bag.bag', BagOptions(storage='ros1', compression='lz4')),
    'ros1 bz2': ('bag.bag', BagOptions(storage='ros1', compression='bz2')),
    'sqlite3': ('bag', BagOptions(storage='sqlite3')),
    'sqlite3 zstd': ('bag', BagOptions(storage='sqlite3', compression='zstd')),
}
FEW = {
    'sensor_msgs/msg/PointCloud2',
    'geometry_msgs/msg/TwistStamped',
    'visualization_msgs/msg/MarkerArray',
    'tf2_msgs/msg/TFMessage',
    'std_msgs/msg/String',
}
"""Types to write: for each, code is made anew whenever a bag is opened."""

ROUND = 6
"""Messages of a round of samples; a chunk of MCAP holds one round or two here."""

LONG = 1000
"""Bytes of a message that stands in a database but once."""


@cache
def some(rounds, cloud_bytes):
    found = make_samples(rounds=rounds, cloud_bytes=cloud_bytes)
    return [each for each in found if each.channel.msgtype in FEW]


def samples():
    return some(8, 6_000)


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A function that gives the bag of a case, in small chunks; written once, not to be changed."""
    paths = {}

    def give(case):
        if case not in paths:
            name, options = CASES[case]
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(mcap_writer, 'TARGET_SIZE', 8_000)
                folder = tmp_path_factory.mktemp('made')
                paths[case] = write_bag(folder / name, options, samples())
        return paths[case]

    return give


@pytest.fixture
def mine(made, tmp_path):
    """A function that gives a bag of one's own, to break, and its file."""

    def give(case):
        source = made(case)
        path = tmp_path / source.name
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, path)
        return path, path if path.is_file() else next(path.glob('*.db3'))

    return give


def read(path, topics=None):
    """What is read, whether it is all, and what is told."""
    with open_messages(path, topics) as messages:
        found = [(each.stamp_ns, each.topic, bytes(each.data)) for each in messages]
        return found, messages.complete, messages.problems


@pytest.fixture(scope='module')
def written():
    return [(each.stamp_ns, each.channel.topic, each.data) for each in samples()]


@pytest.fixture(scope='module')
def whole(made):
    """A function that gives what is in the sound bag of a case; ROS 1 lacks fields of markers."""
    return cache(lambda case: read(made(case))[0])


def places(size, count, after=1):
    return sorted(random.Random(5).sample(range(after, size), count))


def ends_of(payloads, data):
    """Where the bytes of each message end, of messages that follow each other."""
    position, ends = 0, []
    for payload in payloads:
        position = data.index(payload, position) + len(payload)
        ends.append(position)
    return ends


def payloads_in(path):
    """The messages as a file without compression has them, read by the libraries of others."""
    if path.suffix == '.bag':
        with Ros1Reader(path) as reader:
            return [raw for _, _, raw in reader.messages()]
    with path.open('rb') as file:
        return [message.data for _, _, message in make_reader(file).iter_messages()]


@pytest.mark.parametrize('case', ['mcap', 'ros1'])
def test_a_cut_file_gives_every_message_before_the_cut(case, mine, whole):
    path, file = mine(case)
    data = file.read_bytes()
    ends = ends_of(payloads_in(path), data)
    for place in places(len(data), 20):
        file.write_bytes(data[:place])
        found, complete, warnings = read(path)
        rows = zip(whole(case), ends, strict=True)
        assert found == [each for each, end in rows if end <= place]
        assert not complete
        assert any(f'{file}' in text and f'byte {place}' in text for text in warnings), warnings
        assert sum(map(len, bag_stamps(path).values())) == len(found)


def chunk_ends_in(path):
    """Where the chunk of each message of an MCAP file ends."""
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
    ends = []
    for chunk in sorted(summary.chunk_indexes, key=lambda each: each.chunk_start_offset):
        count = (chunk.message_index_length - 15 * len(chunk.message_index_offsets)) // 16
        ends += [chunk.chunk_start_offset + chunk.chunk_length] * count
    return ends


@pytest.mark.parametrize('case', ['mcap zstd', 'mcap lz4'])
def test_a_cut_file_of_compressed_chunks_gives_all_whole_ones(case, mine, whole):
    path, file = mine(case)
    ends = chunk_ends_in(path)
    assert len(set(ends)) >= 3
    data = file.read_bytes()
    for place in places(len(data), 20):
        file.write_bytes(data[:place])
        found, complete, warnings = read(path)
        assert found == whole(case)[: len(found)]
        assert len(found) >= sum(end <= place for end in ends)
        assert not complete
        assert f'byte {place}' in warnings[0]


@pytest.mark.parametrize('case', ['mcap zstd', 'mcap lz4', 'ros1 lz4'])
def test_the_beginning_of_a_chunk_that_is_cut_is_read_as_well(case, tmp_path):
    """In one chunk, so large that the compressor needs several blocks."""
    name, options = CASES[case]
    path = write_bag(tmp_path / name, options, some(8, 200_000))
    sound, _, _ = read(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * 0.8)])
    found, complete, _ = read(path)
    assert ROUND < len(found) < len(sound)
    assert found == sound[: len(found)]
    assert not complete


def test_a_cut_database_gives_every_message_whose_pages_are_there(mine, whole):
    path, file = mine('sqlite3')
    data = file.read_bytes()
    sound = whole('sqlite3')
    page = int.from_bytes(data[16:18], 'big')

    def end_of(payload):
        # A row's beginning is in a leaf, the end of a long one in the last page of its chain.
        found = data.index(payload[:60]), data.index(payload[-60:])
        return max(-(-place // page) * page for place in found)

    long = [(each, end_of(each[2])) for each in sound if len(each[2]) > LONG]
    first = min(end for _, end in long)  # the pages with the topics come before
    for place in places(len(data), 20, after=first):
        file.write_bytes(data[:place])
        found, complete, warnings = read(path)
        there = [each for each, end in long if end <= place]
        assert [each for each in found if len(each[2]) > LONG] == there
        assert not set(found) - set(sound)
        assert not complete
        assert f'{file}: cut off at byte {place} of {len(data)}' in warnings


def check_flipped(case, path, sound):
    """Of a bag with a flipped byte: nothing is made up, and what is lost is told.

    Without checksums, as in ROS 1 and SQLite, a flip within a message or its name changes that.
    """
    try:
        found, complete, warnings = read(path)
    except BadBagError:
        return
    stamps = [stamp for stamp, _, _ in found]
    assert stamps == sorted(stamps)
    strange, lost = Counter(found) - Counter(sound), Counter(sound) - Counter(found)
    if 'mcap' in case:
        assert not strange
        assert complete == (not warnings)
    else:
        assert strange.total() <= lost.total()
    if lost.total() > strange.total():
        assert warnings
    assert all('\n' not in text for text in warnings)
    summarize_bag(path)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('case', list(CASES))
def test_a_flipped_byte_is_told_and_makes_up_nothing(case, mine, whole):
    path, file = mine(case)
    data = file.read_bytes()
    sound = whole(case)
    generator = random.Random(7)
    for place in places(len(data), 30, after=0):
        broken = bytearray(data)
        broken[place] ^= generator.choice([1, 4, 16, 32, 64, 128, 255])
        file.write_bytes(broken)
        check_flipped(case, path, sound)


@pytest.mark.parametrize('case', ['mcap', 'ros1', 'sqlite3'])
def test_a_flipped_byte_where_a_file_tells_of_itself(case, mine, whole):
    """In its head and its end; there stand sizes and places, which may become huge."""
    path, file = mine(case)
    data = file.read_bytes()
    sound = whole(case)
    head = range(13, 60)
    end = [len(data) - distance for distance in range(1, 60, 3)]
    for place in head if case == 'sqlite3' else [*head[::3], *end]:
        broken = bytearray(data)
        broken[place] ^= 1 if place % 2 else 128
        file.write_bytes(broken)
        check_flipped(case, path, sound)


@pytest.mark.parametrize('what', [b'/kitti/oxts/vel', b'geometry_msgs/msg/TwistStamped', b'twist'])
def test_a_damaged_summary_changes_no_topic_and_no_type(what, mine, whole):
    """It has a checksum; what it copies stands in the file as well."""
    path, file = mine('mcap')
    data = file.read_bytes()
    place = data.rindex(what)
    file.write_bytes(data[:place] + b'%' + data[place + 1 :])
    found, complete, warnings = read(path)
    assert found == whole('mcap')
    assert not complete
    assert 'its summary' in warnings[0]


def test_a_connection_that_is_described_in_two_ways_is_told(mine):
    """A ROS 1 bag describes each in a chunk and in its index, and has no checksums."""
    path, file = mine('ros1')
    data = file.read_bytes()
    what = b'topic=/kitti/oxts/vel'  # last in the connection's data, before that in its head
    place = data.rindex(what, 0, data.rindex(what)) + 10
    file.write_bytes(data[:place] + b'X' + data[place + 1 :])
    found, complete, warnings = read(path)
    assert len(found) == len(samples())
    assert not complete
    assert 'is described in two ways' in warnings[0]


def test_a_message_under_an_id_of_nobody_is_told(mine, whole):
    path, file = mine('ros1')
    data = bytearray(file.read_bytes())
    place = data.index(b'op=\x02')
    place = data.rindex(b'conn=', place - 40, place + 40) + 5
    data[place] ^= 64
    file.write_bytes(data)
    found, complete, warnings = read(path)
    assert found == whole('ros1')[1:]
    assert not complete
    assert 'has other messages than its index lists' in warnings[0]


def test_a_topic_that_the_metadata_names_and_no_file_has_is_told(mine):
    path, file = mine('sqlite3')
    data = file.read_bytes()
    file.write_bytes(data.replace(b'/kitti/oxts/vel', b'/kitti/oxts/veX'))
    _, complete, warnings = read(path)
    assert not complete
    text = 'metadata.yaml names the topic /kitti/oxts/vel, which its files lack'
    assert f'{path}: {text}' in warnings


def test_a_type_whose_name_is_no_name_is_not_defined(tmp_path):
    """Types become classes of Python."""
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema('3d_msgs/msg/Point', 'ros2msg', b'float64 x\n')
        channel = writer.register_channel('/a', 'cdr', schema)
        writer.add_message(channel, 1, bytes(12), 1)
        writer.finish()
    _, _, warnings = read(path)
    assert "'3d_msgs' is no name" in warnings[0]
    assert '/a cannot be read' in warnings[1]


@pytest.mark.parametrize('case', ['mcap', 'mcap zstd', 'ros1', 'sqlite3'])
@pytest.mark.parametrize('filler', ['zeros', 'noise'])
def test_what_comes_after_a_hole_is_read(case, filler, mine, whole):
    path, file = mine(case)
    data = bytearray(file.read_bytes())
    start, size = len(data) // 2, 1000
    hole = bytes(size) if filler == 'zeros' else random.Random(1).randbytes(size)
    data[start : start + size] = hole
    file.write_bytes(data)
    found, complete, warnings = read(path)
    sound = whole(case)
    assert len(set(found) - set(sound)) <= (0 if 'mcap' in case else 1)
    assert (found[0], found[-1]) == (sound[0], sound[-1])
    assert len(sound) - len(found) <= 2 * ROUND
    if len(found) < len(sound):
        assert not complete
        assert str(file) in warnings[0]


@pytest.mark.parametrize('case', ['mcap', 'ros1'])
def test_a_damaged_head_of_a_chunk_costs_no_message(case, mine, whole):
    """The records in a chunk that is not compressed are found without it."""
    path, file = mine(case)
    data = bytearray(file.read_bytes())
    if case == 'mcap':
        with path.open('rb') as stream:
            chunks = make_reader(stream).get_summary().chunk_indexes
        place = sorted(each.chunk_start_offset for each in chunks)[1]
        data[place : place + 9] = bytes(9)
        data[-8:] = bytes(8)  # and no summary to go by
    else:
        place = data.index(b'op=\x05')
        data[place : place + 4] = b'op=x'
    file.write_bytes(data)
    found, complete, warnings = read(path)
    assert found == whole(case)
    assert not complete
    assert any('damaged' in text for text in warnings)


def write_texts(path, stamps, **options):
    """Texts by an MCAP writer of others."""
    with path.open('wb') as file:
        writer = Writer(file, compression=CompressionType.NONE, **options)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/text', 'cdr', schema)
        for stamp in stamps:
            text = f'text {stamp}'.encode() + b'\0'
            size = len(text).to_bytes(4, 'little')
            writer.add_message(channel, stamp, b'\0\1\0\0' + size + text, stamp)
        writer.finish()


HEAD = 31 + 8
"""Bytes of a message's record before its text, and of the length of that record before those."""


def test_a_message_of_a_chunk_without_checksum_may_be_damaged_alone(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_texts(path, range(50), enable_crcs=False)
    data = bytearray(path.read_bytes())
    place = data.index(b'text 25') - HEAD
    data[place : place + 4] = b'\xff\xff\xff\x7f'
    path.write_bytes(data)
    found, complete, warnings = read(path)
    assert [stamp for stamp, _, _ in found] == [each for each in range(50) if each != 25]
    assert not complete
    assert 'the chunk at byte' in warnings[0]


@pytest.mark.parametrize('place', ['in the summary', 'in a message', 'cut'])
def test_messages_outside_of_chunks(place, tmp_path):
    path = tmp_path / 'bag.mcap'
    write_texts(path, range(50), use_chunking=False)
    data = bytearray(path.read_bytes())
    at = data.index(b'text 25') - HEAD
    expected = list(range(50))
    if place == 'in a message':
        data[at : at + 4] = b'\xff\xff\xff\x7f'
        expected.remove(25)
    elif place == 'cut':
        del data[at:]
        expected = list(range(25))
    else:
        data[-40] ^= 255
    path.write_bytes(data)
    found, complete, _ = read(path)
    assert [stamp for stamp, _, _ in found] == expected
    assert not complete
    assert bag_stamps(path)['/text'].tolist() == expected


def test_what_a_ros1_recorder_left_open_is_read(mine, whole):
    """rosbag writes the size of a chunk, and where the index is, when it comes to their end."""
    path, file = mine('ros1')
    data = bytearray(file.read_bytes())
    where = data.index(b'index_pos=') + 10
    end = int.from_bytes(data[where : where + 8], 'little')
    data[where : where + 8] = bytes(8)
    head = data.index(b'op=\x05') - 8
    length = head + 4 + int.from_bytes(data[head : head + 4], 'little')
    size = data.index(b'size=', head) + 5
    assert data[size : size + 4] == data[length : length + 4]
    data[size : size + 4] = data[length : length + 4] = bytes(4)
    (path.parent / 'left').mkdir()
    left = path.parent / 'left' / 'bag.bag.active'
    left.write_bytes(data[: end - 5000])
    for bag in (left, left.parent):
        found, complete, warnings = read(bag)
        assert len(found) > 2 * ROUND
        assert found == whole('ros1')[: len(found)]
        assert not complete
        assert any('was not closed' in text for text in warnings)


@pytest.mark.parametrize('damage', ['cut', 'empty', 'missing', 'noise'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_one_bad_file_of_a_split_bag_costs_its_own_messages(storage, damage, tmp_path):
    options = BagOptions(storage=storage, split_duration_ns=200_000_000)
    path = write_bag(tmp_path / 'bag', options, some(8, 40_000))
    written, _, _ = read(path)
    file = sorted(path.glob('bag_*'))[1]
    data = file.read_bytes()
    if damage == 'missing':
        file.unlink()
    else:
        part = 0.9 if storage == 'sqlite3' else 0.7
        left = {'cut': data[: int(len(data) * part)], 'empty': b'', 'noise': bytes(range(99))}
        file.write_bytes(left[damage])
    found, complete, warnings = read(path)
    assert found == [each for each in written if each in set(found)]
    ns = [stamp - written[0][0] for stamp, _, _ in found]
    inside = [each for each in ns if 200_000_000 <= each < 400_000_000]
    assert len(ns) - len(inside) == 6 * ROUND
    assert len(inside) < 2 * ROUND
    assert bool(inside) == (damage == 'cut')
    assert not complete
    assert any(file.name in text for text in warnings)
    summary = summarize_bag(path)
    assert not summary.complete
    assert any('metadata.yaml counts' in text for text in summary.problems)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('metadata', ['absent', 'cut'])
def test_a_folder_is_read_without_metadata(storage, metadata, tmp_path, written):
    """A killed recorder leaves such a folder, and so do tools that write single files."""
    path = write_bag(tmp_path / 'bag', BagOptions(storage=storage), samples())
    source = path / 'metadata.yaml'
    text = source.read_text()
    source.unlink()
    if metadata == 'cut':
        source.write_text(text[:40])
    found, complete, (warning,) = read(path)
    assert found == written
    assert complete == (metadata == 'absent')
    assert 'metadata' in warning
    assert f'run ros2 bag reindex {path}' in warning


@pytest.mark.parametrize('metadata', ['absent', 'cut'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_file_that_reindex_does_not_take_is_to_be_given_itself(storage, metadata, tmp_path):
    """rosbag2 reindexes only files named NAME_N.ENDING."""
    path = write_bag(tmp_path / 'bag', BagOptions(storage=storage), samples())
    [file] = path.glob('bag_0.*')
    single = file.rename(path / f'single{file.suffix}')
    (path / 'metadata.yaml').write_text('rosbag2: {')
    if metadata == 'absent':
        (path / 'metadata.yaml').unlink()
    found, _, (warning,) = read(path)
    assert 'ros2 bag reindex' not in warning
    assert f'give the file itself, {single}, here and to ros2 bag play' in warning
    assert read(single) == (found, True, ())


def give_metadata(path, kind):
    """Put something else in the place of a metadata.yaml."""
    source = path / 'metadata.yaml'
    text = source.read_text()
    source.unlink()
    if kind == 'pipe':
        os.mkfifo(source)
    elif kind == 'device':
        source.symlink_to('/dev/zero')
    elif kind == 'huge':
        with source.open('wb') as file:
            file.truncate(1 << 36)
    elif kind == 'repeated':
        information = yaml.safe_load(text)
        names = information['rosbag2_bagfile_information']['relative_file_paths']
        information['rosbag2_bagfile_information']['relative_file_paths'] = names * 5000
        source.write_text(yaml.safe_dump(information))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('kind', ['pipe', 'device', 'huge', 'repeated'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_metadata_that_is_no_file_of_its_size_is_named(storage, kind, tmp_path, written, capsys):
    path = write_bag(tmp_path / 'bag', BagOptions(storage=storage), samples())
    give_metadata(path, kind)
    found, complete, (warning,) = read(path)
    assert found == written
    assert not complete
    said = {
        'huge': 'is no metadata of rosbag2 (68719476736 bytes, more than 33554432)',
        'repeated': 'its metadata.yaml lists bag_0.',
    }
    assert said.get(kind, 'has no metadata.yaml') in warning
    assert main(['validate', str(path), '-q']) == 1
    assert 'error bag-metadata' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('names', 'said'),
    [
        (['bag_0.mcap', 'bag_12.mcap'], 'run ros2 bag reindex /b to make it'),
        (['my_bag.mcap'], 'give the file itself, /b/my_bag.mcap, here'),
        (['bag_1_.mcap'], 'give the file itself'),
        (['_0.db3'], 'give the file itself'),
        (
            ['a.mcap', 'b_1.mcap'],
            'name its files b_0.mcap, b_1.mcap and so on, run ros2 bag reindex',
        ),
        (['b_0.db3.zstd'], 'unpack its files with zstd -d --rm, run ros2 bag reindex'),
        (['b.mcap.zstd'], 'zstd -d --rm, name its files b_0.mcap, b_1.mcap and so on, run ros2'),
    ],
)
def test_advice_about_metadata_goes_by_the_names(names, said):
    assert said in reindex_steps(Path('/b'), [Path('/b') / name for name in names])


def pack(path, keep=1.0):
    """Compress the files of a bag as rosbag2's file mode does; keep a part of each."""
    names = []
    for file in sorted(path.glob('bag_*')):
        packed = zstandard.compress(file.read_bytes())
        target = file.with_name(f'{file.name}.zstd')
        target.write_bytes(packed[: int(len(packed) * keep)])
        file.unlink()
        names.append(target.name)
    information = yaml.safe_load((path / 'metadata.yaml').read_text())
    inner = information['rosbag2_bagfile_information']
    inner |= {'compression_mode': 'FILE', 'compression_format': 'zstd'}
    inner['relative_file_paths'] = names
    (path / 'metadata.yaml').write_text(yaml.safe_dump(information))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_cut_compressed_file_is_read_as_far_as_it_goes(storage, tmp_path):
    many = some(16, 40_000)
    path = write_bag(tmp_path / 'bag', BagOptions(storage=storage), many)
    sound, _, _ = read(path)
    pack(path, 0.8)
    (file,) = path.glob('*.zstd')
    for bag in (path, file):
        found, complete, warnings = read(bag)
        assert ROUND < len(found) < len(sound)
        assert found == [each for each in sound if each in set(found)]
        assert not complete
        assert str(file) in warnings[0]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_whole_compressed_file_is_read_by_itself(storage, tmp_path, written):
    path = write_bag(tmp_path / 'bag', BagOptions(storage=storage), samples())
    pack(path)
    for bag in (path, next(path.glob('*.zstd'))):
        assert read(bag) == (written, True, ())


def test_a_damaged_compressed_message_is_lost_alone(mine, written):
    path, file = mine('sqlite3 zstd')
    with sqlite3.connect(file) as connection:
        row = 'SELECT id, data FROM messages WHERE length(data) > 1000 LIMIT 1'
        row_id, data = connection.execute(row).fetchone()
        for bad in (data[:500], data[:4] + bytes(len(data) - 4)):
            connection.execute('UPDATE messages SET data = ? WHERE id = ?', (bad, row_id))
            connection.commit()
            found, complete, (warning,) = read(path)
            assert found == written[: row_id - 1] + written[row_id:]
            assert not complete
            assert f'{file}: messages of {written[row_id - 1][1]}' in warning
    connection.close()


@pytest.fixture
def unclosed(tmp_path):
    """What a killed recorder leaves: SQLite had not yet put all into the file itself."""
    path = tmp_path / 'bag.db3'
    code = """
import os, sqlite3, sys
connection = sqlite3.connect(sys.argv[1], isolation_level=None)
connection.executescript('''
PRAGMA journal_mode = WAL;
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,
    offered_qos_profiles TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO topics VALUES(1, '/a', 'std_msgs/msg/String', 'cdr', '');
''')
for i in range(50):
    row = (100 - i, bytes([0, 1, 0, 0, 2, 0, 0, 0, i + 1, 0]))
    connection.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)', row)
os._exit(1)
"""
    subprocess.run([sys.executable, '-c', code, path], check=False)
    assert (tmp_path / 'bag.db3-wal').stat().st_size > 10_000
    (tmp_path / 'bag.db3-shm').unlink()
    return path


def test_the_rest_of_a_recorders_database_is_in_its_log(unclosed, tmp_path):
    path = unclosed
    found, complete, (warning,) = read(path)
    assert [stamp for stamp, _, _ in found] == list(range(51, 101))
    assert not complete
    assert 'did not close' in warning
    assert sorted(file.name for file in tmp_path.iterdir()) == ['bag.db3', 'bag.db3-wal']
    summary = summarize_bag(path)
    assert (summary.message_count, summary.complete) == (50, False)


def test_the_log_is_read_in_a_folder_that_cannot_be_written(unclosed, tmp_path, monkeypatch):
    """SQLite must create a file beside a log: it gets a copy, which does not stay."""
    temporary = tmp_path / 'temporary'
    temporary.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(temporary))
    monkeypatch.setattr(os, 'access', lambda *_: False)
    seen = []
    copied = shutil.copyfile
    monkeypatch.setattr(shutil, 'copyfile', lambda *ends: seen.append(copied(*ends)))
    before = unclosed.parent.stat().st_mtime_ns
    found, _, (warning,) = read(unclosed)
    assert [stamp for stamp, _, _ in found] == list(range(51, 101))
    assert 'did not close' in warning
    assert [each.parent.parent for each in seen] == [temporary] * 2
    assert not any(temporary.iterdir())
    assert unclosed.parent.stat().st_mtime_ns == before


def test_a_disk_without_room_for_the_copy_is_named(unclosed, tmp_path, monkeypatch):
    temporary = tmp_path / 'temporary'
    temporary.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(temporary))
    monkeypatch.setattr(os, 'access', lambda *_: False)

    def full(*_):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(shutil, 'copyfile', full)
    with pytest.raises(OSError, match='No space left') as caught:
        read(unclosed)
    assert caught.value.filename == f'{unclosed} (copied to {temporary})'
    assert not any(temporary.iterdir())


@pytest.mark.parametrize('case', ['mcap', 'ros1', 'sqlite3'])
def test_a_cut_bag_can_be_entered_anywhere(case, mine):
    path, file = mine(case)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 9 // 10])
    found, _, _ = read(path)
    with open_messages(path) as messages:
        for stamp in (found[0][0] - 1, found[17][0], found[-1][0], found[-1][0] + 1):
            later = [each.stamp_ns for each in messages.since(stamp)]
            assert later == [each[0] for each in found if each[0] >= stamp]
    topic = found[20][1]
    assert read(path, [topic])[0] == [each for each in found if each[1] == topic]


@pytest.mark.parametrize('case', list(CASES))
def test_nothing_of_a_file_of_noise_is_a_message(case, mine):
    path, file = mine(case)
    size = file.stat().st_size
    head = file.read_bytes()[:13]
    file.write_bytes(head + random.Random(2).randbytes(size - len(head)))
    if 'sqlite3' in case:
        with pytest.raises(BadBagError):
            read(path)
    else:
        found, complete, _ = read(path)
        assert (found, complete) == ([], False)


def test_chunks_without_content_are_passed_over_once(tmp_path, monkeypatch):
    """Their size is 0, as that of a chunk that was not finished, which goes on to the end."""
    head = b''.join(
        len(each).to_bytes(4, 'little') + each
        for each in (b'op=\5', b'compression=none', b'size=' + bytes(4))
    )
    empty = len(head).to_bytes(4, 'little') + head + bytes(4)
    path = tmp_path / 'bag.bag'
    path.write_bytes(b'#ROSBAG V2.0\n' + empty * 3000)
    amounts = []

    class Counted(FileBytes):
        def read(self, position, length):
            data = super().read(position, length)
            amounts.append(len(data))
            return data

    monkeypatch.setattr('kitti_ros2.bags.ros1_bag.open_bytes', Counted)
    summarize_bag(path)
    assert 0 < sum(amounts) < 40 * path.stat().st_size
