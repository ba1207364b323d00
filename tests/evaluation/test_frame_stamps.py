# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Frames by stamp, in recordings whose numbers have holes."""

from __future__ import annotations

import pytest

from kitti_ros2.evaluation.ground_truth import PlayedTime, frames_of, read_ground_truth
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import FRAME_STREAMS, Layout, Stream
from kitti_ros2.options.read import ReadOptions

from builders import convert_recording  # isort: skip
from folder_and_bag import make_holes  # isort: skip


@pytest.fixture(params=list(Layout))
def holed(request, recordings, tmp_path):
    return open_recording(make_holes(recordings[request.param], request.param, tmp_path / 'holes'))


def test_stamps_of_every_sensor_are_those_of_their_frame(holed):
    frames = frames_of(holed)
    image = next(
        stream for stream in FRAME_STREAMS if stream.camera is not None and stream in holed.streams
    )
    for stream in (Stream.SCAN, image):
        index = holed.streams[stream]
        for number, stamp in zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True):
            assert frames.nearest(stamp) == (number, 0)
            assert frames.nearest(stamp + 1)[0] == number
    for number, turn in holed.turns.items():
        assert frames.nearest(turn.start_ns) == (number, 0)
    assert frames.numbers == sorted(set(frames.numbers))


LABELLED = [layout for layout in Layout if Stream.LABELS in layout.traits.streams]


@pytest.mark.parametrize('layout', LABELLED)
def test_frames_of_the_ground_truth(layout, recordings, tmp_path):
    """A frame of KITTI-360 without a pose has no known boxes, which is another thing than none."""
    expected = [1, 2, 3, 4] if layout.traits.world_boxes else [0, 1, 2, 3, 4]
    convert_recording(recordings[layout], tmp_path / 'bag.mcap')
    for path in (recordings[layout], tmp_path / 'bag.mcap'):
        truth = read_ground_truth(path, ReadOptions())
        assert not truth.losses
        assert sorted(truth.boxes) == expected
        assert all(truth.boxes.values())


def test_what_is_too_far_belongs_to_no_frame(holed):
    frames = frames_of(holed, 1000)
    first = frames.first_ns
    assert frames.nearest(first - 1000)[1] == 1000
    assert frames.nearest(first - 1001) is None
    assert frames.latest(first - 1) is None
    assert frames.latest(first + 2000) == (frames.nearest(first)[0], 2000)
    assert frames.latest(first + 2001) is None
    assert frames.nearest(10**19) is None


def test_the_time_of_a_player_is_that_of_the_last_clock():
    time = PlayedTime([10, 20, 30], [1000, 2000, 500])
    assert [time.at(log) for log in (5, 10, 19, 25, 40)] == [1000, 1000, 1000, 2000, 500]
    assert PlayedTime([], []).at(7) == 7
