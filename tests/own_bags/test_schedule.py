# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.read import Bound, SelectionOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.own_bags.schedule import make_schedule
from kitti_ros2.player.bag_program import open_program

from builders import SMALL  # isort: skip
from counted_calls import runs_of  # isort: skip


def select(recording, **options):
    return make_schedule(recording, SelectionOptions(**options))


def test_every_sample_is_due_once_in_order_of_time(recording):
    schedule = select(recording)
    entries = list(schedule)
    assert len(entries) == len(schedule)
    assert [entry.stamp_ns for entry in entries] == sorted(entry.stamp_ns for entry in entries)
    assert len({(entry.stream, entry.number) for entry in entries}) == len(entries)
    for stream, index in recording.streams.items():
        due = {entry.number: entry.stamp_ns for entry in entries if entry.stream is stream}
        assert due == dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
    assert schedule.frames == SMALL.frames


def test_what_holds_for_all_comes_first(recording):
    entries = list(select(recording))
    assert entries[0].stream is Stream.RECORDING
    assert entries[1].stream is Stream.CALIBRATION
    assert entries[0].stamp_ns == min(int(i.stamps_ns.min()) for i in recording.streams.values())


def test_frames_are_numbers_both_ends_included(recording):
    schedule = select(recording, start=Bound(frame=1), end=Bound(frame=3))
    assert schedule.numbers_of(Stream.SCAN) == [1, 2, 3]


def test_seconds_and_stamps(recordings):
    recording = open_recording(recordings[Layout.RAW])
    scans = recording.streams[Stream.SCAN]
    first = min(int(index.stamps_ns.min()) for index in recording.streams.values())
    for bound in (
        Bound(offset_ns=int(scans.stamps_ns[2]) - first),
        Bound(stamp_ns=int(scans.stamps_ns[2])),
    ):
        assert select(recording, start=bound).numbers_of(Stream.SCAN) == [2, 3, 4]
        assert select(recording, end=bound).numbers_of(Stream.SCAN) == [0, 1, 2]


def test_frames_of_streams_without_common_numbers_go_by_the_scan(recordings):
    recording = open_recording(recordings[Layout.RAW])
    recording.common_numbers = False
    scans = recording.streams[Stream.SCAN].stamps_ns
    schedule = select(recording, start=Bound(frame=1), end=Bound(frame=2))
    timed = np.array([e.stamp_ns for e in schedule if e.stream in recording.streams])
    assert timed.min() >= scans[1]
    assert timed.max() <= scans[2]
    assert schedule.numbers_of(Stream.SCAN) == [1, 2]


def test_streams_by_name(recordings):
    recording = open_recording(recordings[Layout.RAW])
    assert {e.stream for e in select(recording, streams=('scan',))} == {Stream.SCAN}
    images = {e.stream.camera for e in select(recording, streams=('image',))}
    assert images == {0, 1, 2, 3}


def test_path_is_due_where_poses_are(recordings):
    for layout, path in recordings.items():
        schedule = select(open_recording(path))
        assert schedule.count(Stream.PATH) == (0 if layout is Layout.OBJECT else 1)


@pytest.mark.parametrize(
    ('options', 'said'),
    [
        ({'streams': ('radar',)}, "no stream 'radar'; choose from image, "),
        ({'start': Bound(frame=99)}, 'from frame 99 takes no sample; it has 5 frames, 0 to 4'),
        ({'streams': ('image_4',)}, 'takes no sample'),
        ({'streams': ('path',)}, 'takes no sample'),
        (
            {'start': Bound(frame=3), 'end': Bound(offset_ns=150_000_000)},
            r'the end \(0.15s\) is before the start \(frame 3\)',
        ),
        ({'start': Bound(frame=99), 'end': Bound(offset_ns=0)}, 'takes no sample'),
    ],
)
def test_selections_that_take_nothing(recording, options, said):
    with pytest.raises(UsageError, match=said):
        select(recording, **options)


@pytest.mark.parametrize(
    ('text', 'bound'),
    [
        ('12', Bound(frame=12)),
        ('3.5s', Bound(offset_ns=3_500_000_000)),
        ('2011-09-26 13:02:25.951199337', Bound(stamp_ns=1317042145951199337)),
    ],
)
def test_bounds_from_text(text, bound):
    assert Bound.parse(text) == bound


@pytest.mark.parametrize('text', ['', 'x', '-1', '1.5', 's', 'yesterday'])
def test_what_is_no_bound(text):
    with pytest.raises(UsageError, match='invalid start or end'):
        Bound.parse(text)


@pytest.mark.parametrize('use', ['to-bag', 'play'])
def test_the_schedule_of_a_run_is_made_once(recordings, tmp_path, use):
    source = recordings[Layout.OBJECT]

    def run():
        if use == 'to-bag':
            assert main(['to-bag', '-q', str(source), str(tmp_path / 'o.mcap')]) == 0
        else:
            open_program(source, make_play_settings({})).close()

    assert runs_of(make_schedule, run) == 1
