# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of our own is addressed by KITTI's numbers, whatever is missing from it."""

from __future__ import annotations

import json
import tracemalloc
from collections import Counter
from itertools import groupby

import foreign
import numpy as np
import pytest
from folder_and_bag import OBJECT_NUMBERS, make_bag, make_holes, rerecord
from hypothesis import given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from kitti_ros2.bags.reader import bag_stamps, open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import serialize
from kitti_ros2.messages.ros_types import TYPESTORE, String
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.recording import BY_POSITION
from kitti_ros2.model.streams import FRAME_STREAMS, Layout, Stream
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.outputs import BagOptions, PlaybackOptions
from kitti_ros2.options.read import Bound, ReadOptions, SelectionOptions
from kitti_ros2.own_bags.numbering import number_bag
from kitti_ros2.own_bags.schedule import UNKNOWN, frame_runs, frames_of, make_schedule
from kitti_ros2.own_bags.source_files import UndescribedError, parse_description
from kitti_ros2.pictures.recording_frames import open_frames
from kitti_ros2.player.bag_program import BagProgram
from kitti_ros2.player.playback import Playback, Send
from kitti_ros2.player.program import RecordingProgram

ALL = SelectionOptions()
HUGE = json.dumps(
    {
        'layout': 'object',
        'name': 'training',
        'epoch_ns': 10**30,
        'files': {
            'scan': {'folder': 'a', 'digits': 6, 'suffix': '.bin', 'numbers': [[0, 5]]},
        },
    }
)


@pytest.fixture(scope='module', params=list(Layout), ids=[layout.value for layout in Layout])
def holed(request, recordings, tmp_path_factory):
    """A recording with holes, one layout after the other."""
    folder = tmp_path_factory.mktemp('holed')
    return make_holes(recordings[request.param], request.param, folder)


@pytest.fixture(scope='module')
def holed_bag(holed, tmp_path_factory):
    return make_bag(holed, tmp_path_factory.mktemp('bag'))


def numbers_of(path):
    """The numbers that the folder's own streams have."""
    streams = open_recording(path).streams
    frames = [streams[stream].numbers for stream in FRAME_STREAMS if stream in streams]
    return sorted({*np.concatenate(frames).tolist()})


def play(program):
    """All messages, with their frames."""
    found = Counter()
    for index, frame in enumerate(program.frames.tolist()):
        due, missing = program.fetch(index, range(len(program.channels)))
        assert not missing
        for each in due:
            found[frame, program.channels[each.channel].topic, each.stamp_ns, each.data] += 1
    return found


def played(path, **selection):
    options = MessageOptions()
    return RecordingProgram(open_recording(path), options, SelectionOptions(**selection), 1)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
def test_a_bag_plays_the_frames_of_its_folder(holed, tmp_path, storage):
    program = BagProgram(make_bag(holed, tmp_path, storage), ALL)
    assert sorted({*program.frames.tolist()}) == numbers_of(holed)
    assert (np.diff(program.frames) >= 0).all()
    assert program.notes() == ()


def test_every_message_is_in_the_frame_that_its_folder_has_it_in(holed, holed_bag):
    frames = {(name, stamp): frame for frame, name, stamp, _ in play(BagProgram(holed_bag, ALL))}
    expected = {(name, stamp): frame for frame, name, stamp, _ in play(played(holed))}
    # A bag does not repeat what is the same as before.
    assert {each: frame for each, frame in expected.items() if each[0] not in ONCE}.items() <= (
        frames.items()
    )
    assert frames.items() <= expected.items()


def test_start_and_end_are_numbers_of_kitti(holed, holed_bag):
    middle = numbers_of(holed)[1:-1]
    first, last = Bound(frame=middle[0]), Bound(frame=middle[-1])
    program = BagProgram(holed_bag, SelectionOptions(start=first, end=last))
    assert sorted({*program.frames.tolist()}) == middle
    # What holds for the whole recording is due once in a folder; a bag keeps it for late ones.
    whole = {name for _, name, _, _ in play(BagProgram(holed_bag, SelectionOptions(end=first)))}
    expected = play(played(holed, start=first, end=last))
    samples = Counter({each: n for each, n in expected.items() if each[1] not in ONCE})
    found = play(program)
    assert Counter({each: n for each, n in found.items() if each[1] not in ONCE}) == samples
    assert whole >= {name for _, name, _, _ in found} & ONCE


ONCE = {
    '/tf_static', '/kitti/source/calibration', '/kitti/source/recording', '/kitti/source/files',
    '/kitti/ground_truth/path',
}  # fmt: skip


def test_numbers_are_kept_after_start(holed, tmp_path):
    first = numbers_of(holed)[2]
    bag = make_bag(holed, tmp_path, selection=SelectionOptions(start=Bound(frame=first)))
    expected = [number for number in numbers_of(holed) if number >= first]
    assert sorted({*BagProgram(bag, ALL).frames.tolist()}) == expected
    again = BagProgram(bag, SelectionOptions(start=Bound(frame=expected[1])))
    assert again.frames[0] == expected[1]


def test_a_frame_that_is_missing_is_refused_with_those_that_are_there(recordings, tmp_path):
    holed = make_holes(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path)
    bag = make_bag(holed, tmp_path / 'bag')
    with pytest.raises(UsageError, match='it has 5 frames, 8 to 30'):
        BagProgram(bag, SelectionOptions(start=Bound(frame=31)))


def test_a_player_goes_to_frames_by_number(holed, holed_bag):
    program = BagProgram(holed_bag, ALL)
    playback = Playback(program.stamps_ns, program.frames, PlaybackOptions())
    for number in numbers_of(holed):
        playback.seek_frame(number)
        sent = next(each for each in playback.events() if isinstance(each, Send))
        assert playback.state().frame == program.frames[sent.position] == number
    with pytest.raises(UsageError, match=f'there is no frame {numbers_of(holed)[-1] + 1}'):
        playback.seek_frame(numbers_of(holed)[-1] + 1)


@pytest.mark.parametrize('text', ['{', '[]', '{"layout": "raw"}', HUGE], ids=len)
def test_a_hostile_description_leaves_the_bag_numbered_by_position(text, tmp_path):
    path = tmp_path / 'bag.mcap'
    kinds = {'/kitti/source/recording': String(text), '/kitti/velo/points': String('x')}
    with open_bag(path, BagOptions(), TYPESTORE) as writer:
        for topic, message in kinds.items():
            channel = writer.add_channel(Channel(topic, 'std_msgs/msg/String', depth=1))
            writer.write(channel, 5, serialize(message))
    assert number_bag(path, bag_stamps(path)) is None
    assert BagProgram(path, ALL).frames.tolist() == [0, 0]


def test_a_description_of_more_files_than_fit_is_refused_before_any_is_counted(tmp_path):
    """A short text may name the numbers of a billion files."""
    spans = [[first, first + 999_999] for first in range(0, 10**9, 10**6)]
    folder = {'folder': 'a', 'digits': 12, 'suffix': '.bin', 'numbers': spans}
    text = json.dumps({'layout': 'object', 'name': 'a', 'epoch_ns': 0, 'files': {'scan': folder}})
    tracemalloc.start()
    with pytest.raises(UndescribedError, match='more than 1000000 files'):
        parse_description(String(text), tmp_path / 'a.mcap')
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10_000_000


@pytest.mark.parametrize('name', ['chunkflip_tl.bag', 'flip_utf8_t.bag'])
def test_a_damaged_text_leaves_the_bag_its_numbers(real_kitti, name):
    """A text file that the bag carries is no UTF-8 any more."""
    path = real_kitti.parent / 'found' / name
    if not path.is_file():
        pytest.skip(f'no {path}')
    numbered = number_bag(path, bag_stamps(path))
    assert numbered is not None
    assert numbered.frames.tolist() == [0, 1, 2]
    assert BagProgram(path, ALL).notes() == ()


def test_bad_tracklets_cost_the_labels_only(drive, tmp_path):
    (drive / 'tracklet_labels.xml').write_text('<no')
    source = open_frames(make_bag(drive, tmp_path / 'bag'), ReadOptions())
    assert source.numbers.tolist() == numbers_of(drive)
    assert source.frame(3).images
    assert not source.frame(3).objects


def test_stamps_that_are_not_in_the_index_cost_no_other_frame(holed_bag):
    stamps = bag_stamps(holed_bag)
    numbered = number_bag(holed_bag, stamps)
    every = np.unique(np.concatenate([*stamps.values()]))
    frames = numbered.frames_at(every, set(stamps))
    for start in (0, 1):
        part = slice(start, None, 2)
        assert (numbered.frames_at(every[part], set(stamps)) == frames[part]).all()


def test_topics_alone_keep_the_frames_of_the_bag(recordings, tmp_path):
    holed = make_holes(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path)
    bag = make_bag(holed, tmp_path / 'bag')
    program = BagProgram(bag, SelectionOptions(topics=('/kitti/velo/points',)))
    assert program.frames.tolist() == list(OBJECT_NUMBERS)
    alone = BagProgram(bag, SelectionOptions(topics=('/tf_static',)))
    assert alone.frames[0] == OBJECT_NUMBERS[0]


def test_a_bag_recorded_from_a_player_has_the_same_numbers(holed, holed_bag, tmp_path):
    again = rerecord(holed_bag, tmp_path / 'again.mcap', 10**18 + 12_345)
    with AnyReader([again]) as reader:
        assert reader.start_time > 2 * 10**18
    assert sorted({*BagProgram(again, ALL).frames.tolist()}) == numbers_of(holed)


def test_a_bag_of_stamps_that_are_not_the_recordings_is_numbered_by_position(tmp_path, holed_bag):
    without = tmp_path / 'without.mcap'
    with open_messages(holed_bag) as messages, open_bag(without, BagOptions(), TYPESTORE) as writer:
        ids = {
            topic: writer.add_channel(Channel(topic, msgtype, depth=1))
            for topic, msgtype in messages.channels
            if topic != '/kitti/source/recording'
        }
        for message in messages:
            if message.topic in ids:
                writer.write(ids[message.topic], message.stamp_ns, [bytes(message.data)])
    program = BagProgram(without, ALL)
    assert program.frames[0] == 0
    assert program.notes() == (BY_POSITION,)


def test_bags_of_others_are_numbered_by_position(tmp_path):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth())
    assert number_bag(path, bag_stamps(path)) is None
    assert BagProgram(path, ALL).notes() == (BY_POSITION,)


def test_an_extract_goes_by_its_scans(recordings, tmp_path):
    holed = make_holes(recordings[Layout.RAW], Layout.RAW, tmp_path)
    drive = holed.rename(holed.with_name(holed.name.replace('sync', 'extract')))
    bag = make_bag(drive, tmp_path / 'bag')
    program = BagProgram(bag, ALL)
    scans = open_recording(drive).streams[Stream.SCAN]
    assert sorted({*program.frames.tolist()}) == scans.numbers.tolist() == [1, 3, 4]
    away = np.abs(program.stamps_ns[:, None] - scans.stamps_ns)
    assert program.frames.tolist() == scans.numbers[away.argmin(1)].tolist()
    assert make_schedule(open_recording(drive), ALL).frames == 3


@given(st.lists(st.integers(-1, 50)))
def test_each_frame_is_one_run_that_begins_with_its_first_sample(numbers):
    frames = frame_runs(np.array(numbers, np.int64))
    known = [number for number in numbers if number != UNKNOWN]
    assert len(frames) == len(numbers)
    runs = [number for number, _ in groupby(frames.tolist())]
    assert runs == [*dict.fromkeys(known)] or (not known and {*runs} <= {0})
    for place, number in enumerate(numbers):
        if number != UNKNOWN and number not in numbers[:place]:
            assert frames[place] == number


@given(st.dictionaries(st.sampled_from(FRAME_STREAMS), st.lists(st.integers(0, 30), min_size=1)))
def test_every_number_of_a_stream_is_a_frame(streams):
    arrays = {stream: np.array(numbers) for stream, numbers in streams.items()}
    every = {number for numbers in streams.values() for number in numbers}
    assert frames_of(arrays, common=True).tolist() == sorted(every)
    first = next((streams[stream] for stream in FRAME_STREAMS if stream in streams), [])
    assert frames_of(arrays, common=False).tolist() == sorted({*first})
