# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""When a scan was made: stamps and turns of every layout."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.recording_index import find_turns, scan_stamps
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream, format_stamp, parse_stamp
from kitti_ros2.options.read import ReadOptions, ScanStamp
from kitti_ros2.options.table import make_play_settings, make_settings

if TYPE_CHECKING:
    from pathlib import Path

PERIOD = 103_600_000
START = ReadOptions(scan_stamp=ScanStamp.START)
STAMPS = st.dictionaries(st.integers(0, 9), st.integers(0, 4 * 10**9))


def lines(path: Path) -> list[int]:
    return [parse_stamp(line) for line in path.read_text().splitlines()]


def write(path: Path, stamps: list[int]) -> None:
    path.write_text(''.join(f'{format_stamp(stamp)}\n' for stamp in stamps))


@pytest.mark.parametrize('sequence', ['0001', '0005'])
def test_the_start_of_a_real_turn_is_the_line_of_the_start_file(real_kitti, sequence):
    folder = real_kitti / f'raw/2011_09_26/2011_09_26_drive_{sequence}_sync/velodyne_points'
    forward, starts, ends = (
        dict(enumerate(lines(folder / f'timestamps{part}.txt'))) for part in ('', '_start', '_end')
    )
    turns = find_turns(forward, starts, ends, PERIOD)
    assert scan_stamps(forward, turns, ScanStamp.START) == starts
    assert scan_stamps(forward, turns, ScanStamp.FORWARD) == forward
    for number, turn in turns.items():
        assert not turn.nominal
        assert turn.start_ns + turn.length_ns == ends[number]
        assert abs(turn.start_ns + turn.length_ns // 2 - forward[number]) <= 1


def test_a_real_scan_has_the_turn_of_its_own_line(real_kitti):
    path = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0005_sync'
    for options, stamp in ((START, 1317042272283701593), (ReadOptions(), 1317042272335337762)):
        recording = open_recording(path, options)
        assert recording.streams[Stream.SCAN].stamps_ns.tolist() == [stamp]
        turn = recording.read(Stream.SCAN, 0).turn
        assert (turn.start_ns, turn.length_ns) == (1317042272283701593, 103272338)
        assert turn.start_ns + turn.length_ns == 1317042272386973931


def test_only_scans_are_stamped_otherwise(recordings):
    for layout, path in recordings.items():
        plain, shifted = open_recording(path), open_recording(path, START)
        for stream, index in plain.streams.items():
            gaps = index.stamps_ns - shifted.streams[stream].stamps_ns
            if stream is not Stream.SCAN or layout is Layout.ODOMETRY:
                assert not gaps.any(), (layout, stream)
            elif layout is Layout.RAW:
                folder = path / 'velodyne_points'
                assert shifted.streams[stream].stamps_ns.tolist() == lines(
                    folder / 'timestamps_start.txt'
                )
            else:
                assert set(gaps.tolist()) == {PERIOD // 2}


def test_odometry_has_no_turn_and_says_so(recordings):
    recording = open_recording(recordings[Layout.ODOMETRY], START)
    assert recording.read(Stream.SCAN, 0).turn is None
    assert any('compensated for motion' in note for note in recording.notes)
    assert not any('compensated' in n for n in open_recording(recordings[Layout.ODOMETRY]).notes)


@pytest.mark.parametrize(
    'damage',
    ['no start file', 'no end file', 'bad start line', 'short end file', 'end before start', 'far'],
)
def test_a_turn_without_start_and_end_is_nominal_for_that_scan_alone(drive, damage):
    folder = drive / 'velodyne_points'
    forward = lines(folder / 'timestamps.txt')
    start_file, end_file = (folder / f'timestamps_{part}.txt' for part in ('start', 'end'))
    starts, ends = lines(start_file), lines(end_file)
    expected = {2}
    if damage == 'no start file':
        start_file.unlink()
        expected = set(range(5))
    elif damage == 'no end file':
        end_file.unlink()
        expected = set(range(5))
    elif damage == 'bad start line':
        broken = start_file.read_text().splitlines()
        broken[2] = 'x'
        start_file.write_text('\n'.join(broken) + '\n')
    elif damage == 'short end file':
        write(end_file, ends[:2])
        expected = {2, 3, 4}
    elif damage == 'end before start':
        ends[2] = starts[2] - 1
        write(end_file, ends)
    else:
        ends[2] += 10**10
        write(end_file, ends)
    recording = open_recording(drive, START)
    index = recording.streams[Stream.SCAN]
    assert index.numbers.tolist() == list(range(5))
    for number, stamp in zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True):
        turn = recording.read(Stream.SCAN, number).turn
        assert turn.nominal == (number in expected)
        assert turn.start_ns == stamp
        assert stamp == (forward[number] - PERIOD // 2 if number in expected else starts[number])


def test_without_stamps_turns_are_nominal(drive):
    for path in drive.glob('*/timestamps*.txt'):
        path.unlink()
    recording = open_recording(drive, ReadOptions(period_ns=10**8, scan_stamp=ScanStamp.START))
    scans, images = (recording.streams[s].stamps_ns for s in (Stream.SCAN, Stream.IMAGE_0))
    assert set((images - scans).tolist()) == {50_000_000}
    assert set(np.diff(scans).tolist()) == {10**8}
    assert recording.read(Stream.SCAN, 3).turn.nominal


@given(STAMPS, STAMPS, STAMPS, st.integers(10**6, 10**9), st.sampled_from(ScanStamp))
def test_every_scan_has_a_turn_and_a_stamp_that_ros_can_hold(forward, starts, ends, period, moment):
    turns = find_turns(forward, starts, ends, period)
    stamps = scan_stamps(forward, turns, moment)
    assert turns.keys() == stamps.keys() == forward.keys()
    for number, turn in turns.items():
        assert 0 < turn.length_ns <= 10**9
        assert turn.start_ns == forward[number] - turn.length_ns // 2
        assert 0 <= stamps[number] <= forward[number]


@pytest.mark.parametrize('make', [make_settings, make_play_settings])
def test_the_stamp_of_scans_goes_with_ring_and_time_unless_asked_for(make):
    for values, moment in (
        ({}, ScanStamp.FORWARD),
        ({'ring_time': False}, ScanStamp.FORWARD),
        ({'ring_time': True}, ScanStamp.START),
        ({'ring_time': True, 'scan_stamp': 'forward'}, ScanStamp.FORWARD),
        ({'scan_stamp': 'start'}, ScanStamp.START),
    ):
        assert make(values).read.scan_stamp is moment
    assert make({}).read.period_ns == PERIOD
    assert make({'period': '0.1s'}).read.period_ns == 10**8
    assert make({'period': 0.1036}).read.period_ns == PERIOD


@pytest.mark.parametrize('period', ['0', '0.0001', '61', '1e9'])
def test_a_period_out_of_range_is_refused(period):
    with pytest.raises(UsageError, match=r'not within 0\.001 to 60: Seconds'):
        make_settings({'period': period})


def test_other_values_are_refused():
    with pytest.raises(UsageError, match="scan_stamp takes start or forward, not 'end'"):
        make_settings({'scan_stamp': 'end'})
    with pytest.raises(UsageError, match='period takes seconds'):
        make_settings({'period': 'nan'})
