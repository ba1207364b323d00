# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with clouds in each format, back to KITTI, as own bags and as anyone's."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import kitti_ros2
from kitti_ros2.cli import main
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.naming import POINTS
from kitti_ros2.model.bag_formats import FORMATS, Points
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.pictures.recording_frames import RecordingFrames

if TYPE_CHECKING:
    from pathlib import Path

CLOUDS = '/kitti/velo/points'
LOSSY = [each for each in Points if FORMATS[each].loss]
ENDINGS = ('.mcap', '', '.bag')


def run(*words: object) -> int:
    return main([*map(str, words), '-q'])


def data_set_of(source: Path) -> Path:
    return source.parent.parent if 'drive' in source.name else source


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


def clouds_of(path: Path, topic: str):
    """The clouds of a topic by a reader that is not ours."""
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [each for each in reader.connections if each.topic == topic]
        for connection, _, data in reader.messages(wanted):
            yield reader.deserialize(data, connection.msgtype)


@pytest.fixture(params=list(Layout), ids=lambda layout: layout.value)
def holed(request, recordings, tmp_path):
    """A recording with a hole in the numbers of its scans."""
    folder = data_set_of(recordings[request.param])
    shutil.copytree(folder, tmp_path / 'set')
    source = tmp_path / 'set' / recordings[request.param].relative_to(folder)
    open_recording(source).path(Stream.SCAN, 3).unlink()
    return request.param, source


@pytest.mark.one_in(3)
@pytest.mark.parametrize('points', LOSSY)
def test_every_file_comes_back_to_the_byte(holed, tmp_path, points):
    layout, source = holed
    ending = ENDINGS[(list(Layout).index(layout) + LOSSY.index(points)) % len(ENDINGS)]
    bag = tmp_path / f'bag{ending}'
    run('to-bag', source, bag, '--points', points.value)
    run('to-kitti', bag, tmp_path / 'out')
    made, expected = files_of(tmp_path / 'out'), files_of(data_set_of(source))
    assert made == {name: data for name, data in expected.items() if name in made}
    missing = expected.keys() - made.keys()
    assert not [name for name in missing if name.endswith(('.bin', '.png'))]
    count = len(open_recording(source).streams[Stream.SCAN])
    assert len(list(clouds_of(bag, POINTS))) == len(list(clouds_of(bag, CLOUDS))) == count


@pytest.mark.parametrize('points', Points)
def test_stamps_are_the_start_of_the_turn_where_points_have_times(recordings, tmp_path, points):
    source = recordings[Layout.RAW]
    run('to-bag', source, tmp_path / 'bag.mcap', '--points', points.value, '--streams', 'scan')
    start = '_start' if FORMATS[points].is_timed else ''
    stamps = (source / f'velodyne_points/timestamps{start}.txt').read_text().splitlines()
    found = [message.header.stamp for message in clouds_of(tmp_path / 'bag.mcap', CLOUDS)]
    assert [f'{stamp.nanosec:09}' for stamp in found] == [line[-9:] for line in stamps]


@pytest.mark.parametrize('points', LOSSY)
def test_without_the_source_the_difference_is_named_by_both_commands(
    recordings, tmp_path, capsys, points
):
    source, bag = recordings[Layout.OBJECT], tmp_path / 'bag.mcap'
    words = ('--points', points.value, '--exclude-topics', POINTS)
    assert main(['to-bag', str(source), str(bag), *words]) == 0
    left_out = f'{POINTS} is left out, so in the scans that to-kitti restores'
    assert f'note: {left_out}, {FORMATS[points].loss}' in capsys.readouterr().out
    assert run('to-kitti', bag, tmp_path / 'out') == 1
    said = capsys.readouterr().err
    count = len(open_recording(source).streams[Stream.SCAN])
    expected = f'{POINTS} is missing: in clouds of {points.value}, {FORMATS[points].loss}'
    assert f'skipped scan ({count})' in said
    assert expected in said
    assert run('view', bag, '--mode', 'bev', '-o', tmp_path / 'bev.png') == 0
    for made in (tmp_path / 'out/training/velodyne').iterdir():
        true = np.fromfile(source / 'training/velodyne' / made.name, '<f4').reshape(-1, 4)
        found = np.fromfile(made, '<f4').reshape(-1, 4)
        assert sorted(map(bytes, found[:, :3])) == sorted(map(bytes, true[:, :3]))
        np.testing.assert_allclose(np.sort(found[:, 3]), np.sort(true[:, 3]), atol=0.008)


@pytest.mark.parametrize('points', Points)
def test_a_plan_reads_clouds_of_anyone_in_every_format(recordings, tmp_path, points):
    source, bag, out = recordings[Layout.OBJECT], tmp_path / 'bag.mcap', tmp_path / 'out'
    words = ('--points', points.value, '--exclude-topics', '/kitti/source/*')
    assert run('to-bag', source, bag, *words) == 0
    assert run('to-kitti', bag, out, '--layout', 'object', '--name', 'training') in {0, 1}
    made = sorted((out / 'training/velodyne').iterdir())
    true = sorted((source / 'training/velodyne').iterdir())
    assert len(made) == len(true)
    for one, other in zip(made, true, strict=True):
        found, expected = (np.fromfile(each, '<f4').reshape(-1, 4) for each in (one, other))
        assert sorted(map(bytes, found[:, :3])) == sorted(map(bytes, expected[:, :3]))
        np.testing.assert_allclose(np.sort(found[:, 3]), np.sort(expected[:, 3]), atol=0.003)


@pytest.mark.parametrize('points', [Points.XYZIRC, Points.OUSTER])
def test_a_plan_and_pictures_take_the_points_of_the_source(recordings, tmp_path, points):
    source, bag = recordings[Layout.RAW], tmp_path / 'bag.mcap'
    assert run('to-bag', source, bag, '--points', points.value) == 0
    recording = open_recording(source)
    frames = RecordingFrames(PlannedRecording(bag, survey_bags([bag])))
    for number in frames.numbers.tolist():
        true = recording.read(Stream.SCAN, number).points
        assert frames.frame(number).points.tobytes() == true.tobytes()
    frames.close()
    assert run('to-kitti', bag, tmp_path / 'out', '--layout', 'object') in {0, 1}
    made = sorted((tmp_path / 'out').glob('*/velodyne/*.bin'))
    true = sorted((source / 'velodyne_points/data').iterdir())
    assert [path.read_bytes() for path in made] == [path.read_bytes() for path in true]


@pytest.mark.parametrize(
    ('layout', 'points', 'said'),
    [
        (Layout.ODOMETRY, Points.XYZIRT, 'points have ring but no time'),
        (Layout.ODOMETRY, Points.XYZIRCAEDT, 'points have the time 0'),
        (Layout.ODOMETRY, Points.OUSTER, 'points have the time 0'),
        (Layout.ODOMETRY, Points.XYZIRC, ''),
        (Layout.RAW, Points.OUSTER, ''),
    ],
)
def test_points_without_times_are_noted(recordings, tmp_path, capsys, layout, points, said):
    source, bag = recordings[layout], tmp_path / 'bag.mcap'
    words = ['--points', points.value, '--streams', 'scan']
    assert main(['to-bag', str(source), str(bag), *words]) == 0
    out = capsys.readouterr().out
    assert ('all points of a scan are of one moment' in out) == bool(said)
    assert said in out


def test_scans_in_another_order_are_noted_by_number(recordings, tmp_path, capsys):
    shutil.copytree(recordings[Layout.OBJECT], tmp_path / 'set')
    path = tmp_path / 'set/training/velodyne/000003.bin'
    points = np.fromfile(path, '<f4').reshape(-1, 4)
    np.random.default_rng(0).permutation(points).tofile(path)
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(tmp_path / 'set'), str(bag), '--points', 'ouster']) == 0
    assert (
        "note: points are not in the order of the scanner's lasers, which are estimated from the"
        ' elevation: scans 3'
    ) in capsys.readouterr().out
    assert run('to-kitti', bag, tmp_path / 'out') == 0
    assert files_of(tmp_path / 'out') == files_of(tmp_path / 'set')


def test_ring_time_is_short_for_xyzirt(recordings, tmp_path):
    bags = [tmp_path / name / 'bag.mcap' for name in ('short', 'long')]
    for bag, words in zip(bags, (['--ring-time'], ['--points', 'xyzirt']), strict=True):
        bag.parent.mkdir()
        assert run('to-bag', recordings[Layout.RAW], bag, *words) == 0
    assert bags[0].read_bytes() == bags[1].read_bytes()
    frame = kitti_ros2.open(recordings[Layout.RAW]).frame(1)
    long = kitti_ros2.encode(frame, points='xyzirt')
    assert kitti_ros2.encode(frame, ring_time=True) == long
    assert kitti_ros2.encode(frame, points='ouster').keys() - long.keys() == {POINTS}


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['--ring-time', '--points', 'xyzi'], 'ring_time is short for points xyzirt and does not'),
        (['--points', 'ouster', '--scan-stamp', 'forward'], 'scan_stamp forward does not go with'),
        (['--points', 'xyzirc', '--semantic'], 'semantic adds fields, but points xyzirc has a fix'),
        (['--points', 'xyzt'], 'points takes xyzi, xyzirt, xyzirc, xyzircaedt or ouster'),
    ],
)
def test_contradictions_are_one_line(recordings, tmp_path, capsys, words, complaint):
    assert main(['to-bag', str(recordings[Layout.RAW]), str(tmp_path / 'bag.mcap'), *words]) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / 'bag.mcap').exists()
