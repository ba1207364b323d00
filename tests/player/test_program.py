# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording as something to play, and the frames its samples belong to."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import Bound, SelectionOptions
from kitti_ros2.own_bags.encode import Encoder
from kitti_ros2.own_bags.schedule import make_schedule, nearest_frames
from kitti_ros2.player.program import RecordingProgram

from builders import SMALL  # isort: skip

BOTH = MessageOptions(images=Images.BOTH)
STAMPS = st.lists(st.integers(0, 10**19 // 8), min_size=1, max_size=30).map(sorted)


def make(recording, messages=BOTH, **selection):
    return RecordingProgram(recording, messages, SelectionOptions(**selection), 2)


def every(program):
    return range(len(program.channels))


def flat(due):
    return sorted((each.channel, each.stamp_ns, each.data) for each in due)


def test_each_position_gives_what_the_encoder_gives(recording):
    program = make(recording)
    schedule = make_schedule(recording, SelectionOptions())
    encoder = Encoder(recording, schedule, BOTH, SelectionOptions())
    assert [outlet.topic for outlet in program.channels] == [row.topic for row in encoder.table]
    assert len(program.stamps_ns) == len(program.frames) == len(schedule)
    found = set()
    for index, entry in enumerate(schedule):
        messages, failures = encoder.encode(entry)
        assert failures == []
        due, missing = program.fetch(index, every(program))
        assert missing == []
        assert flat(due) == sorted((m.channel, m.stamp_ns, m.data) for m in messages)
        assert {each.stamp_ns for each in due} <= {int(program.stamps_ns[index])}
        large = [program.channels[each.channel].on_demand for each in due]
        assert large == sorted(large)
        assert all(len(each.data) % 4 == 0 for each in due)
        found |= {each.channel for each in due}
    assert found <= set(every(program))
    assert {program.channels[outlet].topic for outlet in found} >= {
        '/tf_static', '/kitti/velo/points', '/kitti/source/recording'
    }  # fmt: skip


def test_large_messages_are_made_only_where_they_are_wanted(recording):
    program = make(recording)
    large = {index for index in every(program) if program.channels[index].on_demand}
    assert {program.channels[index].msgtype.rsplit('/')[-1] for index in large} == {
        'Image', 'CompressedImage', 'PointCloud2'
    }  # fmt: skip
    one = min(large)
    for index in range(len(program.stamps_ns)):
        whole = flat(program.fetch(index, every(program))[0])
        for wanted in (frozenset(), {one}):
            due, missing = program.fetch(index, wanted)
            left_out = large - wanted
            assert missing == []
            made = [each for each in due if each.data]
            assert flat(made) == [each for each in whole if each[0] not in left_out]
            unmade = [each.channel for each in due if not each.data]
            assert sorted(unmade) == sorted(each[0] for each in whole if each[0] in left_out)


def test_latched_messages_before_a_position_are_the_last_ones(recording):
    program = make(recording)
    last = {}
    for index in range(len(program.stamps_ns)):
        found = flat(program.latched_before(index))
        assert found == sorted(message for messages in last.values() for message in messages)
        here = {}
        for message in flat(program.fetch(index, ())[0]):
            if program.channels[message[0]].latched:
                here.setdefault(message[0], []).append(message)
        last |= here
    assert program.latched_before(0) == []
    expected = {'/tf_static', '/kitti/source/recording'}
    if recording.layout is not Layout.OBJECT:  # whose frames have a calibration each
        expected.add('/kitti/source/calibration')
    assert {program.channels[outlet].topic for outlet in last} >= expected


def test_a_late_subscriber_gets_no_copies_of_earlier_rounds(recording):
    program = make(recording)
    assert {channel.depth for channel in program.channels if channel.latched} == {1}


def test_a_file_that_fails_is_missing_with_its_topics(drive):
    scan = drive / 'velodyne_points' / 'data' / '0000000003.bin'
    program = make(open_recording(drive))
    scan.write_bytes(b'1234567')
    missing = [
        each
        for index in range(len(program.stamps_ns))
        for each in program.fetch(index, every(program))[1]
    ]
    ((text, count),) = ((loss.message, loss.count) for loss in missing)
    assert '/kitti/velo/points' in text
    assert scan.name in text
    assert '\n' not in text
    assert count == len(text.split(': ')[0].split(', '))
    scan.unlink()
    again = [program.fetch(index, every(program))[1] for index in range(len(program.stamps_ns))]
    assert len(list(chain.from_iterable(again))) == 1


def test_the_outlets_are_those_of_the_topics_chosen(recordings):
    program = make(open_recording(recordings[Layout.RAW]), topics=('/kitti/oxts/*',))
    assert {outlet.topic for outlet in program.channels} == {
        '/kitti/oxts/imu', '/kitti/oxts/fix', '/kitti/oxts/vel'
    }  # fmt: skip
    sent = [program.fetch(index, ())[0] for index in range(len(program.stamps_ns))]
    assert len(list(chain.from_iterable(sent))) == 3 * SMALL.frames


@pytest.mark.parametrize('selection', [{'start': Bound(frame=99)}, {'topics': ('/nothing',)}])
def test_a_selection_of_nothing_is_wrong_usage(recording, selection):
    with pytest.raises(UsageError):
        make(recording, **selection)


def test_frames_are_the_file_numbers_and_never_fall(recording):
    program = make(recording)
    schedule = make_schedule(recording, SelectionOptions())
    assert program.frames.dtype == np.int64
    assert (np.diff(program.frames) >= 0).all()
    assert sorted(set(program.frames.tolist())) == list(range(SMALL.frames))
    for entry, frame in zip(schedule, program.frames.tolist(), strict=True):
        assert frame == entry.number


def test_what_holds_for_all_belongs_to_the_first_frame_taken(recording):
    program = make(recording, start=Bound(frame=2), end=Bound(frame=3))
    assert sorted(set(program.frames.tolist())) == [2, 3]
    assert program.frames[0] == 2


@pytest.mark.parametrize('common', [True, False])
@pytest.mark.parametrize('stream', ['recording', 'calibration', 'scan', 'oxts', 'image'])
def test_any_stream_alone_has_frames(recordings, stream, common):
    recording = open_recording(recordings[Layout.RAW])
    recording.common_numbers = common
    program = make(recording, streams=(stream,))
    once = stream in {'recording', 'calibration'}
    assert sorted(set(program.frames.tolist())) == list(range(1 if once else SMALL.frames))


def test_without_common_numbers_a_frame_is_what_is_nearest_to_a_scan(recordings):
    recording = open_recording(recordings[Layout.RAW])
    schedule = make_schedule(recording, SelectionOptions())
    frames = replace(schedule, common_numbers=False).frame_numbers
    assert (np.diff(frames) >= 0).all()
    scans = recording.streams[Stream.SCAN]
    away = np.abs(schedule.stamps_ns[:, None] - scans.stamps_ns)
    assert frames.tolist() == scans.numbers[away.argmin(1)].tolist()


def test_without_scans_frames_go_by_the_first_stream_there_is(recordings):
    recording = open_recording(recordings[Layout.RAW])
    schedule = make_schedule(recording, SelectionOptions(streams=('oxts', 'calibration')))
    frames = replace(schedule, common_numbers=False).frame_numbers
    assert frames.tolist() == [0, 0, 1, 2, 3, 4]


@given(STAMPS, STAMPS, st.data())
def test_the_nearest_frame_is_the_nearest(stamps, reference, data):
    numbers = data.draw(
        st.lists(
            st.integers(0, 10**6),
            min_size=len(reference),
            max_size=len(reference),
            unique=True,
        ).map(sorted)
    )
    frames = nearest_frames(*(np.array(each, np.int64) for each in (stamps, reference, numbers)))
    assert (np.diff(frames) >= 0).all()
    for stamp, frame in zip(stamps, frames.tolist(), strict=True):
        distance = abs(stamp - reference[numbers.index(frame)])
        assert distance <= min(abs(stamp - each) for each in reference) + 1
