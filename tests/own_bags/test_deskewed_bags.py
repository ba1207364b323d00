# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""--deskew and --undo-deskew on the command line and in the library, in bags and back from them."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from moving_scanner import TURN_NS, Bend, stamp_of, write_bend
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import kitti_ros2
from kitti_ros2.cli import main
from kitti_ros2.model.streams import NS_PER_S, Layout

from builders import one_line  # isort: skip

POINTS = '/kitti/velo/points'
DESCRIPTION = '/kitti/source/recording'


def messages_of(path, topic):
    """The messages of a topic, by a reader that is not ours."""
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [each for each in reader.connections if each.topic == topic]
        for connection, _, data in reader.messages(wanted):
            yield reader.deserialize(data, connection.msgtype)


def clouds_of(path):
    """Stamp, names of the fields and (N, 3) places of each cloud."""
    for message in messages_of(path, POINTS):
        stamp = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
        count, step = message.width, message.point_step
        places = np.ndarray((count, 3), '<f4', message.data, 0, (step, 4)).copy()
        yield stamp, [field.name for field in message.fields], places


def description_of(path):
    (text,) = messages_of(path, DESCRIPTION)
    return json.loads(text.data)


def distances(one, other):
    return np.linalg.norm(one[:, :3].astype(np.float64) - other[:, :3], axis=1)


@pytest.fixture(scope='module')
def bends(tmp_path_factory):
    root = tmp_path_factory.mktemp('bends')
    layouts = (Layout.RAW, Layout.TRACKING, Layout.ODOMETRY)
    return {each: write_bend(root / each.value, each, Bend(), columns=100) for each in layouts}


def to_bag(source, out, *options, code=0):
    assert main(['to-bag', str(source), str(out), '-q', *options]) == code
    return out


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING], ids=lambda each: each.value)
@pytest.mark.parametrize('options', [(), ('--ring-time',)], ids=['plain', 'ring_time'])
def test_a_deskewed_bag_has_exact_scans_and_no_time(bends, tmp_path, layout, options, capsys):
    folder, exact, _ = bends[layout]
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(folder), str(bag), '--deskew', *options]) == 0
    said = capsys.readouterr().out
    assert ('ring but no time: the scans are compensated for motion' in said) == bool(options)
    plain = to_bag(folder, tmp_path / 'plain.mcap')
    stamps = [stamp for stamp, *_ in clouds_of(plain)]
    for number, (stamp, names, points) in enumerate(clouds_of(bag)):
        assert names == ['x', 'y', 'z', 'intensity'] + ['ring'] * bool(options)
        assert stamp == stamps[number]  # of facing forward
        assert distances(points, exact[number]).max() < 0.01
    assert description_of(bag)['deskew'] == 'on'
    assert 'deskew' not in description_of(plain)


@pytest.mark.parametrize('ending', ['.mcap', '', '.bag'])
def test_undone_scans_have_a_time_for_each_point(bends, tmp_path, ending):
    folder, _, _ = bends[Layout.ODOMETRY]
    bag = to_bag(folder, tmp_path / f'bag{ending}', '--undo-deskew', '--ring-time')
    plain = to_bag(folder, tmp_path / 'plain.mcap')
    for (stamp, names, points), (forward, *_) in zip(clouds_of(bag), clouds_of(plain), strict=True):
        assert names == ['x', 'y', 'z', 'intensity', 'ring', 'time', 'file_index']
        assert forward - stamp == TURN_NS // 2
        assert len(points)
    assert description_of(bag)['deskew'] == 'undo'


@pytest.mark.parametrize(
    ('layout', 'option', 'how'),
    [
        (Layout.RAW, '--deskew', 'compensated for motion (--deskew)'),
        (Layout.TRACKING, '--deskew', 'compensated for motion (--deskew)'),
        (Layout.ODOMETRY, '--undo-deskew', 'as measured (--undo-deskew)'),
    ],
)
@pytest.mark.parametrize('more', [(), ('--ring-time',)], ids=['plain', 'ring_time'])
def test_the_way_back_says_that_scans_are_not_those_of_kitti(
    bends, tmp_path, capsys, layout, option, how, more
):
    folder, exact, measured = bends[layout]
    bag = to_bag(folder, tmp_path / 'bag.mcap', option, *more)
    assert main(['info', str(bag)]) == 0
    assert f'scans are {how}' in capsys.readouterr().out
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q']) == 1
    said = capsys.readouterr().err
    assert f"scans 0-3 are written {how}, not as in KITTI's files" in said
    base = folder.parent.parent if layout is Layout.RAW else folder
    true = measured if layout is Layout.ODOMETRY else exact
    found = 0
    for path in sorted(each for each in base.rglob('*') if each.is_file()):
        made = tmp_path / 'out' / path.relative_to(base)
        if path.suffix != '.bin':
            assert made.read_bytes() == path.read_bytes()
            continue
        points = np.fromfile(made, '<f4').reshape(-1, 4)
        assert np.quantile(distances(points, true[int(path.stem)]), 0.99) < 0.01
        found += 1
    assert found == 4


@pytest.mark.parametrize('option', ['--deskew', '--undo-deskew'])
@pytest.mark.parametrize('command', ['play', 'view', 'report', 'open'])
def test_a_bag_is_refused(bends, tmp_path, capsys, option, command):
    bag = to_bag(bends[Layout.RAW][0], tmp_path / 'bag.mcap')
    out = tmp_path / ('o.png' if command == 'view' else 'o.html')
    keyword = option.lstrip('-').replace('-', '_')
    if command == 'open':
        with pytest.raises(kitti_ros2.KittiRos2Error, match='are for KITTI folders, and this is'):
            kitti_ros2.open(bag, **{keyword: True})
        return
    words = {'play': [], 'view': ['-o', str(out)], 'report': ['-o', str(out)]}[command]
    assert main([command, str(bag), *words, option]) == 2
    assert 'deskew and undo_deskew are for KITTI folders' in one_line(capsys.readouterr().err)
    assert not out.exists()


def test_a_scan_that_cannot_be_compensated_is_named_and_the_rest_is_written(
    bends, tmp_path, capsys
):
    folder, exact, _ = bends[Layout.RAW]
    drive = tmp_path / folder.parent.name / folder.name
    shutil.copytree(folder.parent, drive.parent)
    for number in (0, 1):
        (drive / 'oxts' / 'data' / f'{number:010d}.txt').unlink()
    bag = to_bag(drive, tmp_path / 'bag.mcap', '--deskew', code=1)
    assert (
        'no oxts packets near the turns of scans 0, which deskew needs' in capsys.readouterr().err
    )
    for number, (_, _, points) in zip((1, 2, 3), clouds_of(bag), strict=True):
        assert distances(points, exact[number]).max() < 0.01
    (tmp_path / 'o').mkdir()
    shutil.rmtree(drive / 'oxts')
    assert main(['to-bag', str(drive), str(tmp_path / 'o' / 'bag.mcap'), '--deskew', '-q']) == 2
    assert 'deskew needs the motion of the car' in one_line(capsys.readouterr().err)
    assert not list((tmp_path / 'o').iterdir())


def test_pictures_and_reports_of_compensated_scans(bends, tmp_path):
    folder, _, _ = bends[Layout.RAW]
    for command, out in (('view', 'o.png'), ('report', 'o.html')):
        for options in ((), ('--deskew',)):
            name = tmp_path / f'{len(options)}{out}'
            more = ['--mode', 'bev'] if command == 'view' else []
            assert main([command, str(folder), '-o', str(name), '-q', *more, *options]) in (0, 1)
        one, other = (tmp_path / f'{count}{out}' for count in (0, 1))
        assert one.read_bytes() != other.read_bytes()


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING, Layout.ODOMETRY])
@pytest.mark.parametrize('options', [(), ('--ring-time',)], ids=['plain', 'ring_time'])
def test_a_bag_has_the_points_at_a_moment_of_its_folder(bends, tmp_path, layout, options):
    folder, _, _ = bends[layout]
    with kitti_ros2.open(to_bag(folder, tmp_path / 'bag.mcap', *options)) as bag:
        for frame, other in zip(kitti_ros2.open(folder), bag, strict=True):
            moment_ns = frame.stamp_ns + 10_000_000
            found = other.points_at(moment_ns)
            assert distances(found, frame.points_at(moment_ns)).max() < 1e-4


@pytest.mark.parametrize(
    ('option', 'most'),
    [('--deskew', 1e-3), ('--undo-deskew', 0.02)],
    ids=['deskew', 'undone, since KITTI compensated too little'],
)
def test_a_deskewed_bag_has_the_points_at_a_moment_too(bends, tmp_path, option, most):
    folder, _, _ = bends[Layout.RAW if option == '--deskew' else Layout.ODOMETRY]
    with kitti_ros2.open(to_bag(folder, tmp_path / 'bag.mcap', option)) as bag:
        for frame, other in zip(kitti_ros2.open(folder), bag, strict=True):
            moment_ns = frame.stamp_ns + 10_000_000
            found = other.points_at(moment_ns)
            assert distances(found, frame.points_at(moment_ns)).mean() < most


def test_a_bag_without_the_stamps_of_turns_is_an_error(bends, tmp_path):
    bag = to_bag(
        bends[Layout.RAW][0], tmp_path / 'bag.mcap', '--exclude-topics', '/kitti/source/f*'
    )
    with kitti_ros2.open(bag) as recording:
        moved = [frame for frame in recording if 'scan' in frame.streams]
        for frame in moved:
            with pytest.raises(kitti_ros2.KittiRos2Error, match='the time of the points is not'):
                frame.points_at(frame.stamp_ns)


def test_frames_in_python(bends):
    folder, exact, measured = bends[Layout.RAW]
    plain, moved = kitti_ros2.open(folder), kitti_ros2.open(folder, deskew=True)
    for frame, other in zip(plain, moved, strict=True):
        number = frame.number
        assert (frame.points == measured[number]).all()
        found = frame.points_at(frame.stamp_ns)
        assert found.dtype == np.float32
        assert found.flags.writeable
        assert (found == other.points).all()
        assert distances(found, exact[number]).max() < 0.01
        assert distances(other.points_at(other.stamp_ns), found).max() < 1e-4
        later = stamp_of(number) + 10_000_000
        assert distances(other.points_at(later), frame.points_at(later)).max() < 1e-4


def test_points_at_of_a_frame_without_motion(recordings):
    with pytest.raises(kitti_ros2.KittiRos2Error, match='no readable oxts packets or poses near'):
        kitti_ros2.open(recordings[Layout.OBJECT])[0].points_at(0)
