# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""100 Hz packets in bags and players: topics, times, covariances, and the way back."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from extract_drive import FAST, copy_extract, fast_drive, open_with

import kitti_ros2
from kitti_ros2.api.arguments import KittiRos2Warning
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import deserialize, stamp_ns_of
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Stream
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import make_play_settings, make_settings
from kitti_ros2.player.bag_program import open_program
from kitti_ros2.synthetic.drive import extract_of

IMU, FIX, VEL = '/kitti/oxts/imu', '/kitti/oxts/fix', '/kitti/oxts/vel'
VEL_COVARIANCE = '/kitti/oxts/vel_with_covariance'
POINTS = '/kitti/velo/points'
FAST_TOPICS = (IMU, FIX, VEL, VEL_COVARIANCE)


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    return fast_drive(tmp_path_factory)


@pytest.fixture(scope='module')
def bag(drive, tmp_path_factory):
    """The drive with the packets of its extract."""
    out = tmp_path_factory.mktemp('bags') / 'fast.mcap'
    kitti_ros2.to_bag(drive, out, imu_from=extract_of(drive))
    return out


def messages_of(path):
    """All messages by topic, each as its stamp and its bytes."""
    found = {}
    with open_messages(path) as messages:
        for message in messages:
            found.setdefault(message.topic, []).append((message.stamp_ns, bytes(message.data)))
    return found


def decoded(path, topic):
    with open_messages(path, [topic]) as messages:
        return [deserialize(message.data, message.msgtype) for message in messages]


def files_in(folder):
    return {
        path.relative_to(folder): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob('*')
        if path.is_file()
    }


def test_imu_spans_each_scan_and_the_rest_has_its_frames(drive, bag):
    found = messages_of(bag)
    recording = open_with(drive)
    stamps = recording.streams[Stream.OXTS_EXTRACT].stamps_ns
    for topic in FAST_TOPICS:
        assert [stamp for stamp, _ in found[topic]] == stamps.tolist(), topic
    for topic in ('/tf', '/kitti/ground_truth/odometry', '/kitti/source/oxts', POINTS):
        assert len(found[topic]) == FAST.frames, topic
    times = [stamp_ns_of(imu.header) for imu in decoded(bag, IMU)]
    assert times == stamps.tolist()
    first, last = recording.turns[0].start_ns, recording.turns[FAST.frames - 1].end_ns
    assert times[0] < first < last < times[-1]


def test_the_bag_gives_back_the_drive_byte_for_byte(drive, bag, tmp_path):
    assert main(['to-kitti', str(bag), str(tmp_path / 'back'), '-q']) == 0
    back = tmp_path / 'back' / drive.parent.name
    assert files_in(back / drive.name) == files_in(drive)
    assert not (back / extract_of(drive).name).exists()


def test_messages_of_other_topics_do_not_change(drive, bag, tmp_path):
    plain = tmp_path / 'plain.mcap'
    kitti_ros2.to_bag(drive, plain)
    before, after = messages_of(plain), messages_of(bag)
    changed = {*FAST_TOPICS, '/kitti/source/recording'}
    once = {
        '/tf_static',
        '/kitti/source/calibration',
        '/kitti/source/files',
        '/kitti/ground_truth/path',
    }  # due with the first message, which is earlier
    assert before.keys() == after.keys() - {VEL_COVARIANCE}
    for topic in before.keys() - changed - once:
        assert before[topic] == after[topic], topic
    assert not any(imu.orientation_covariance.any() for imu in decoded(plain, IMU))


def test_the_player_publishes_the_bytes_of_the_bag(drive, bag):
    settings = make_play_settings(
        {'imu_from': str(extract_of(drive)), 'images': 'compressed', 'topics': '/kitti/oxts/*'}
    )
    program = open_program(drive, settings)
    played = {}
    for index in range(len(program.stamps_ns)):
        for message in program.fetch(index, range(len(program.channels)))[0]:
            topic = program.channels[message.channel].topic
            played.setdefault(topic, []).append((message.stamp_ns, bytes(message.data)))
    stored = messages_of(bag)
    assert played == {topic: stored[topic] for topic in FAST_TOPICS}
    assert set(program.frames.tolist()) == set(range(FAST.frames))


def test_covariances_are_those_of_the_unit(drive, bag):
    packets = open_with(drive)
    imu, fix = decoded(bag, IMU)[0], decoded(bag, FIX)[0]
    twist = decoded(bag, VEL_COVARIANCE)[0]
    number = int(packets.streams[Stream.OXTS_EXTRACT].numbers[0])
    packet = packets.read(Stream.OXTS_EXTRACT, number)
    eye = np.eye(3).ravel()
    np.testing.assert_allclose(imu.orientation_covariance, np.radians(0.1) ** 2 * eye)
    np.testing.assert_allclose(imu.angular_velocity_covariance, np.radians(0.01) ** 2 * eye)
    np.testing.assert_allclose(imu.linear_acceleration_covariance, 1e-4 * eye)
    np.testing.assert_allclose(fix.position_covariance, packet.pos_accuracy**2 * eye)
    expected = np.diag([packet.vel_accuracy**2] * 3 + [np.radians(0.01) ** 2] * 3)
    np.testing.assert_allclose(twist.twist.covariance, expected.ravel())
    velocity = decoded(bag, VEL)[0]
    assert (twist.header, twist.twist.twist) == (velocity.header, velocity.twist)
    least = 1e-9  # below, robot_localization replaces a variance
    assert min(np.diag(expected).min(), imu.angular_velocity_covariance[0]) > least


def test_covariances_without_an_extract_and_an_extract_without_covariances(drive, tmp_path):
    kitti_ros2.to_bag(drive, tmp_path / 'slow.mcap', covariances=True, topics='/kitti/oxts/*')
    assert len(decoded(tmp_path / 'slow.mcap', VEL_COVARIANCE)) == FAST.frames
    assert decoded(tmp_path / 'slow.mcap', IMU)[0].orientation_covariance.any()
    extract = extract_of(drive)
    kitti_ros2.to_bag(drive, tmp_path / 'bare.mcap', imu_from=extract, covariances=False)
    assert VEL_COVARIANCE not in messages_of(tmp_path / 'bare.mcap')
    assert not decoded(tmp_path / 'bare.mcap', IMU)[0].orientation_covariance.any()


@pytest.mark.parametrize('make', [make_settings, make_play_settings])
def test_an_extract_turns_covariances_on(make):
    assert make({}).messages.covariances is None
    assert make({'imu_from': 'x'}).messages.covariances is True
    assert make({'imu_from': 'x', 'covariances': False}).messages.covariances is False
    assert MessageOptions().covariances is None


@pytest.mark.parametrize(
    ('selection', 'frames'),
    [({'start': 3, 'end': 4}, (3, 4)), ({'start': '0.3s', 'end': '0.42s'}, None)],
)
def test_a_selection_takes_the_packets_of_its_time(drive, tmp_path, selection, frames):
    out = tmp_path / 'part.mcap'
    kitti_ros2.to_bag(drive, out, imu_from=extract_of(drive), **selection)
    found, recording = messages_of(out), open_with(drive)
    scans = [stamp for stamp, _ in found[POINTS]]
    stamps = [stamp for stamp, _ in found[IMU]]
    numbers = [n for n, turn in recording.turns.items() if turn.forward_ns in scans]
    assert frames is None or tuple(numbers) == frames
    first, last = recording.turns[numbers[0]], recording.turns[numbers[-1]]
    assert first.start_ns - 200_000_000 <= stamps[0] < first.start_ns
    assert last.end_ns < stamps[-1] <= last.end_ns + 200_000_000


def test_seconds_count_from_the_first_sample_of_the_drive(drive, tmp_path):
    kitti_ros2.to_bag(drive, tmp_path / 'a.mcap', start='0.5s')
    kitti_ros2.to_bag(drive, tmp_path / 'b.mcap', start='0.5s', imu_from=extract_of(drive))
    plain, fast = messages_of(tmp_path / 'a.mcap'), messages_of(tmp_path / 'b.mcap')
    assert plain[POINTS] == fast[POINTS]


@pytest.mark.parametrize('streams', [['oxts'], ['oxts_extract'], ['scan', 'oxts']])
def test_the_packets_are_taken_with_the_stream_of_packets(drive, tmp_path, streams):
    out = tmp_path / 'part.mcap'
    kitti_ros2.to_bag(drive, out, imu_from=extract_of(drive), streams=streams)
    found = messages_of(out)
    assert len(found[IMU]) > 100
    assert ('/kitti/source/oxts' in found) is ('oxts' in streams)


def test_without_the_stream_there_are_none(drive, tmp_path):
    out = tmp_path / 'scans.mcap'
    kitti_ros2.to_bag(drive, out, imu_from=extract_of(drive), streams=['scan'])
    assert messages_of(out).keys() & set(FAST_TOPICS) == set()


def test_damaged_packets_are_counted_and_the_others_written(drive, tmp_path, capsys):
    extract = copy_extract(drive, tmp_path)
    numbers = open_with(drive).streams[Stream.OXTS_EXTRACT].numbers
    for number in numbers[60:62].tolist():
        (extract / 'oxts' / 'data' / f'{number:010d}.txt').write_text('1 2 3\n')
    (extract / 'oxts' / 'data' / f'{numbers[70]:010d}.txt').unlink()
    out = tmp_path / 'lossy.mcap'
    assert main(['to-bag', str(drive), str(out), '-q', '--imu-from', str(extract)]) == 1
    told = capsys.readouterr().err
    assert f'{numbers[60]:010d}.txt:1: ' in told
    assert f'no file for frames {numbers[70]}, which timestamps.txt lists' in told
    assert len(messages_of(out)[IMU]) == len(numbers) - 3


def test_a_missing_packet_is_a_warning_in_python(drive, tmp_path):
    extract = copy_extract(drive, tmp_path)
    number = int(open_with(drive).streams[Stream.OXTS_EXTRACT].numbers[60])
    (extract / 'oxts' / 'data' / f'{number:010d}.txt').unlink()
    with pytest.warns(KittiRos2Warning, match='no file for frames'):
        kitti_ros2.to_bag(drive, tmp_path / 'x.mcap', imu_from=extract, topics=IMU)


def test_names_of_kitti2bag(drive, tmp_path):
    out = tmp_path / 'named.bag'
    kitti_ros2.to_bag(drive, out, imu_from=extract_of(drive), preset='kitti2bag')
    found = messages_of(out)
    assert {'/kitti/oxts/gps/vel', '/kitti/oxts/gps/vel_with_covariance'} <= found.keys()


def test_a_bag_is_no_source_for_packets(bag, drive):
    settings = make_play_settings({'imu_from': str(extract_of(drive))})
    with pytest.raises(UsageError, match='--imu-from is for raw drives, and this is a bag'):
        open_program(bag, settings)


def test_frames_count_as_without_the_packets(drive):
    plain = open_program(drive, make_play_settings({}))
    fast = open_program(drive, make_play_settings({'imu_from': str(extract_of(drive))}))
    assert set(plain.frames.tolist()) == set(fast.frames.tolist())
    assert (np.diff(fast.stamps_ns) >= 0).all()
    assert SelectionOptions() == make_play_settings({}).selection


def test_packets_of_one_stamp_are_losses_though_one_is_left(drive, tmp_path, capsys):
    extract = copy_extract(drive, tmp_path)
    stamps = extract / 'oxts' / 'timestamps.txt'
    lines = stamps.read_text().splitlines()
    stamps.write_text(f'{lines[len(lines) // 2]}\n' * len(lines))
    out = tmp_path / 'one.mcap'
    arguments = [str(drive), str(out), '--imu-from', str(extract), '-q', '--streams', 'oxts']
    assert main(['to-bag', *arguments]) == 1
    assert 'have the stamp of another one, but other values' in capsys.readouterr().err
    assert len(decoded(out, IMU)) == 1
