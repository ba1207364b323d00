# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is missing is noticed in every layout, and counted only where it was asked for."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.cli.command import load_config
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import deserialize, stamp_ns_of, transform_of, vector_of
from kitti_ros2.model.errors import KittiRos2Error, Loss, UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MessageOptions, Preset
from kitti_ros2.options.read import Bound, SelectionOptions
from kitti_ros2.options.table import TO_BAG_OPTIONS, make_settings

from builders import SMALL, convert_recording  # isort: skip


def run(path, out, *, strict=False, messages=None, **selection):
    return convert_recording(path, out, messages, SelectionOptions(**selection), strict=strict)


@pytest.fixture
def copy(recordings, tmp_path):
    """A copy of a recording, by layout."""

    def make(layout: Layout):
        root = tmp_path / layout.value
        source = recordings[layout]
        source = source.parent if layout is Layout.RAW else source
        shutil.copytree(source, root)
        return root / recordings[layout].name if layout is Layout.RAW else root

    return make


def test_losses_outside_the_selection_are_none(drive, tmp_path):
    (drive / 'velodyne_points' / 'data' / '0000000003.bin').unlink()
    for name, selection in (
        ('frames', {'end': Bound(frame=2)}),
        ('streams', {'streams': ('oxts',)}),
        ('topics', {'topics': ('/kitti/oxts/*',)}),
        ('seconds', {'end': Bound(offset_ns=150_000_000)}),
    ):
        report = run(drive, tmp_path / f'{name}.mcap', strict=True, **selection)
        assert not report.losses, name
    with pytest.raises(KittiRos2Error, match='frames 3,'):
        run(drive, tmp_path / 'all.mcap', strict=True)


def test_a_loss_is_cut_to_a_span():
    loss = Loss('scan', 4, 'no file for frames {}', (1, 2, 3, 9))
    assert loss.within(2, 5) == Loss('scan', 2, 'no file for frames {}', (2, 3))
    assert loss.within(4, 8) is None
    assert loss.among({1, 2, 3, 5, 9}) is loss
    assert loss.among({9, 10}) == Loss('scan', 1, 'no file for frames {}', (9,))
    assert loss.among(()) is None
    assert Loss('scan', 4, 'damaged').among(()) == Loss('scan', 4, 'damaged')
    assert loss.text() == 'no file for frames 1-3, 9'


@pytest.mark.parametrize(
    ('layout', 'name', 'stream'),
    [
        (Layout.OBJECT, 'training/velodyne/000002.bin', 'scan'),
        (Layout.OBJECT, 'training/calib/000002.txt', 'calibration'),
        (Layout.OBJECT, 'training/image_3/000002.png', 'image_3'),
        (Layout.OBJECT, 'training/label_2/000004.txt', 'labels'),
        (Layout.TRACKING, 'training/velodyne/0000/000004.bin', 'scan'),
        (Layout.ODOMETRY, 'sequences/00/velodyne/000000.bin', 'scan'),
    ],
)
def test_a_missing_file_is_named_in_every_layout(copy, layout, name, stream):
    root = copy(layout)
    (root / name).unlink()
    losses = [loss for loss in open_recording(root).losses if loss.stream == stream]
    assert sum(loss.count for loss in losses) == 1
    assert str(int(name[-10:-4])) in losses[0].text()


def test_a_missing_file_is_named_without_stamps_too(copy):
    root = copy(Layout.ODOMETRY)
    (root / 'sequences' / '00' / 'times.txt').unlink()
    (root / 'sequences' / '00' / 'velodyne' / '000002.bin').unlink()
    assert [(loss.stream, loss.numbers) for loss in open_recording(root).losses] == [('scan', (2,))]


def test_fewer_poses_and_packets_than_frames(copy):
    odometry = copy(Layout.ODOMETRY)
    path = odometry / 'poses' / '00.txt'
    path.write_text(''.join(path.read_text().splitlines(keepends=True)[:3]))
    [loss] = open_recording(odometry).losses
    assert (loss.stream, loss.numbers) == ('pose', (3, 4))
    tracking = copy(Layout.TRACKING)
    path = tracking / 'training' / 'oxts' / '0000.txt'
    path.write_text(''.join(path.read_text().splitlines(keepends=True)[:4]))
    [loss] = open_recording(tracking).losses
    assert (loss.stream, loss.numbers) == ('oxts', (4,))


@pytest.mark.parametrize(
    ('layout', 'name'),
    [
        (Layout.RAW, '../calib_cam_to_cam.txt'),
        (Layout.TRACKING, 'training/oxts/0000.txt'),
        (Layout.TRACKING, 'training/label_02/0000.txt'),
        (Layout.TRACKING, 'training/calib/0000.txt'),
        (Layout.ODOMETRY, 'poses/00.txt'),
        (Layout.OBJECT, 'training/calib/000000.txt'),
    ],
)
def test_a_text_file_that_is_no_text_is_never_fatal(copy, tmp_path, layout, name):
    root = copy(layout)
    with (root / name).open('ab') as file:
        file.write(b'# caf\xe9\n')
    report = run(root, tmp_path / 'o.mcap')
    assert any(name.rsplit('/', 1)[-1] in loss.text() for loss in report.losses)
    assert report.counts['/kitti/velo/points'] == SMALL.frames


@pytest.mark.parametrize('moment', ['1969-12-31 23:00:00', '2099-01-01 00:00:00'])
def test_moments_that_ros_cannot_hold(drive, tmp_path, moment):
    path = drive / 'image_02' / 'timestamps.txt'
    lines = path.read_text().splitlines()
    path.write_text('\n'.join([lines[0], f'{moment}.000000000', *lines[2:]]) + '\n')
    report = run(drive, tmp_path / 'o.mcap')
    [loss] = report.losses
    assert 'timestamps.txt:2: ' in loss.text()
    assert report.counts['/kitti/camera_color_left/camera_info'] == SMALL.frames - 1


def test_extract_needs_the_unrectified_camera(drive):
    extract = drive.rename(drive.with_name(drive.name.replace('_sync', '_extract')))
    path = extract.parent / 'calib_cam_to_cam.txt'
    lines = [
        line for line in path.read_text().splitlines() if not line.startswith(('K_02', 'R_03'))
    ]
    path.write_text('\n'.join(lines) + '\n')
    calibration = open_recording(extract).calibration(0)
    assert set(calibration.cameras) == {0, 1}
    assert 'no K of camera 02' in calibration.missing['P2']
    assert 'no R, T of camera 03' in calibration.missing['P3']


def test_poses_are_found_from_within_the_set(copy, tmp_path, monkeypatch):
    monkeypatch.chdir(copy(Layout.ODOMETRY) / 'sequences')
    assert main(['to-bag', '00', str(tmp_path / 'o.mcap'), '-q']) == 0
    with open_messages(tmp_path / 'o.mcap', ['/tf']) as messages:
        assert len(list(messages)) == SMALL.frames


def test_calibration_inside_the_drive_keeps_its_place(drive):
    for path in drive.parent.glob('calib_*.txt'):
        path.rename(drive / path.name)
    names = [file.name for file in open_recording(drive).calibration(0).files]
    assert names
    assert all(name.startswith(f'{drive.name}/calib_') for name in names)


def test_a_calibration_that_does_not_parse_travels_all_the_same(copy):
    root = copy(Layout.OBJECT)
    path = root / 'training' / 'calib' / '000001.txt'
    path.write_text('@@@\n' + path.read_text())
    calibration = open_recording(root).calibration(1)
    assert calibration.files[0].text == path.read_text()
    assert '000001.txt:1: ' in calibration.missing['file']


def test_topics_that_match_nothing_are_refused(recordings, tmp_path):
    with pytest.raises(UsageError, match='no topic is called /kitty/'):
        run(recordings[Layout.RAW], tmp_path / 'o.mcap', topics=('/kitty/*',))
    report = run(recordings[Layout.RAW], tmp_path / 'o.mcap', topics=('/tf', '/kitty/*'))
    assert 'no topic is called /kitty/*; did you mean /kitti/*?' in report.notes


def test_cameras_that_are_lost_can_be_excluded(copy, tmp_path):
    drive = copy(Layout.RAW)
    for path in drive.glob('image_0*/timestamps.txt'):
        path.unlink()
    assert run(drive, tmp_path / 'o.mcap').losses
    report = run(drive, tmp_path / 'part.mcap', exclude_topics=('*camera*',))
    assert not report.losses
    assert not [note for note in report.notes if 'no topic is called' in note]


def test_config_values_are_taken_as_they_are_written(tmp_path):
    path = tmp_path / 'c.yaml'
    path.write_text(
        'sequence: 0010\nepoch: 2011-09-26 13:02:25.123456789\n'
        'start: 2011-09-26 13:02:25.951199337\nend: 12\ncompression: zstd\ncompression_level: 3\n'
    )
    settings = make_settings(load_config(path, TO_BAG_OPTIONS))
    assert settings.read.sequence == '0010'
    assert settings.read.epoch_ns % 10**9 == 123456789
    assert settings.selection.start == Bound(stamp_ns=1317042145951199337)
    assert settings.selection.end == Bound(frame=12)
    assert settings.bag('mcap').compression_level == 3


def test_a_stated_base_wins_over_the_preset_s(recordings, tmp_path):
    options = MessageOptions(preset=Preset.KITTI2BAG, base_to_imu=(-0.05, 0.32, 0.93))
    run(recordings[Layout.RAW], tmp_path / 'o.mcap', messages=options)
    with open_messages(tmp_path / 'o.mcap', ['/tf_static']) as messages:
        [item] = messages
    links = deserialize(item.data, item.msgtype).transforms
    assert {t.child_frame_id: t.transform.translation.x for t in links}['imu_link'] == -0.05


def test_latched_topics_keep_all_their_messages(recording_path, tmp_path):
    """A late subscriber, or a player, gets as many as the publisher's depth."""
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    out = run(recording_path, tmp_path / 'o.mcap').path
    with AnyReader([out]) as reader:
        for connection in reader.connections:
            qos = connection.ext.offered_qos_profiles[0]
            changing = connection.topic == '/tf_static'
            if qos.durability.name == 'TRANSIENT_LOCAL' and not changing:
                assert connection.msgcount <= qos.depth, connection.topic


def motion(path, tmp_path):
    """Positions, their stamps, attitudes and the twists of /kitti/ground_truth/odometry."""
    run(path, tmp_path / 'o.mcap')
    with open_messages(tmp_path / 'o.mcap', ['/kitti/ground_truth/odometry']) as messages:
        found = [deserialize(item.data, item.msgtype) for item in messages]
    poses = [transform_of(message.pose.pose) for message in found]
    linear = np.array([vector_of(message.twist.twist.linear) for message in found])
    stamps = np.array([stamp_ns_of(message.header) for message in found]) / 1e9
    return poses, stamps - stamps[0], linear


def moved(poses, stamps):
    """Velocity in the body's axes from neighbouring positions, (N - 2, 3)."""
    places = np.array([pose.translation for pose in poses])
    rates = (places[2:] - places[:-2]) / (stamps[2:] - stamps[:-2])[:, None]
    return np.array([pose.rotation.T @ rate for pose, rate in zip(poses[1:-1], rates, strict=True)])


def test_twist_is_the_derivative_of_the_pose(recordings, tmp_path):
    poses, stamps, linear = motion(recordings[Layout.RAW], tmp_path)
    np.testing.assert_allclose(linear[1:-1], moved(poses, stamps), atol=0.02)


def test_real_twist_goes_the_way_the_pose_goes(real_kitti, tmp_path):
    """Sideways too: the data set's own vl has the wrong sign."""
    drive = real_kitti / 'raw' / '2011_09_26' / '2011_09_26_drive_0001_sync'
    poses, stamps, linear = motion(drive, tmp_path)
    sideways = moved(poses, stamps)[:, 1]
    assert np.corrcoef(sideways, linear[1:-1, 1])[0, 1] > 0.8
    assert np.sqrt(np.mean((sideways - linear[1:-1, 1]) ** 2)) < 0.05


def test_odometry_poses_swing_about_the_camera(recordings):
    """imu_link's pose is the camera's, carried along the mounting: the nominal one included."""
    recording = open_recording(recordings[Layout.ODOMETRY])
    calibration = recording.calibration(0)
    assert calibration.velo_T_imu.translation.tolist() == [-0.81, 0.32, -0.8]
    first = recording.read(Stream.POSE, 0).world_T_imu
    np.testing.assert_allclose(first.matrix(), np.eye(4), atol=1e-5)


@pytest.mark.parametrize(('column', 'value'), [(0, '1e30'), (0, '90.0'), (1, '-400'), (5, '7')])
def test_places_that_are_none_on_earth(drive, tmp_path, column, value):
    path = drive / 'oxts' / 'data' / '0000000002.txt'
    words = path.read_text().split()
    words[column] = value
    path.write_text(' '.join(words))
    report = run(drive, tmp_path / 'o.mcap')
    assert all('0000000002.txt:1: ' in loss.text() for loss in report.losses)
    assert report.counts['/tf'] == SMALL.frames - 1


def test_an_absent_calibration_file_is_named_as_such(drive):
    (drive.parent / 'calib_velo_to_cam.txt').unlink()
    missing = open_recording(drive).calibration(0).missing
    assert 'calib_velo_to_cam.txt: no such file' in missing['calib_velo_to_cam.txt']
    assert len(missing) == 1


def test_calibration_alone_can_be_asked_for(recording_path, tmp_path):
    report = run(recording_path, tmp_path / 'o.mcap', streams=('calibration',))
    assert report.counts['/tf_static'] == 1


@pytest.mark.parametrize(
    ('layout', 'said'),
    [
        (Layout.RAW, ''),
        (Layout.OBJECT, 'missing for scans 0-4: a nominal turn of 0.1036 s is used'),
        (Layout.TRACKING, 'missing for scans 0-4: a nominal turn of 0.1036 s is used'),
        (Layout.ODOMETRY, 'points have ring but no time'),
    ],
)
def test_ring_and_time_without_stamps_of_the_turn_is_noted(recordings, tmp_path, layout, said):
    timed = MessageOptions(ring_and_time=True)
    notes = '\n'.join(run(recordings[layout], tmp_path / 'o.mcap', messages=timed).notes)
    assert said in notes if said else 'turn' not in notes
    plain = '\n'.join(run(recordings[layout], tmp_path / 'p.mcap').notes)
    assert 'turn' not in plain
    assert 'no time' not in plain


def test_overwrite_spares_what_only_has_a_bag_s_name(recordings, tmp_path, capsys):
    out = tmp_path / 'o.mcap'
    out.write_text('precious')
    assert main(['to-bag', str(recordings[Layout.RAW]), str(out), '-q', '--overwrite']) == 2
    assert 'no bag' in capsys.readouterr().err
    assert out.read_text() == 'precious'


def test_a_cut_bag_is_exit_code_1(recordings, tmp_path, capsys):
    out = run(recordings[Layout.RAW], tmp_path / 'o.mcap').path
    out.write_bytes(out.read_bytes()[:-1000])
    assert main(['info', str(out), '--json']) == 1
    assert '"complete": false' in capsys.readouterr().out
