# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose points are in order of time, back to KITTI and into pictures."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.cli import main
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import NS_PER_S, Layout, Stream, parse_stamp
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.read import ReadOptions, ScanStamp, SelectionOptions
from kitti_ros2.pictures.recording_frames import RecordingFrames
from kitti_ros2.player.bag_program import BagProgram
from kitti_ros2.player.program import RecordingProgram

POINTS = '/kitti/velo/points'


def to_bag(source: Path, out: Path, *options: str, code: int = 0) -> Path:
    assert main(['to-bag', str(source), str(out), '-q', '--ring-time', *options]) == code
    return out


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


def data_set_of(source: Path) -> Path:
    return source.parent.parent if 'drive' in source.name else source


def messages_of(path: Path, topic: str):
    """(log time, message) by a reader that is not ours."""
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [each for each in reader.connections if each.topic == topic]
        for connection, log_ns, data in reader.messages(wanted):
            yield log_ns, reader.deserialize(data, connection.msgtype)


def clouds_of(path: Path):
    """(log time, stamp, the fields of a cloud by name)."""
    kinds = {4: '<u2', 6: '<u4', 7: '<f4'}
    for log_ns, message in messages_of(path, POINTS):
        point = {
            'names': [field.name for field in message.fields],
            'formats': [kinds[field.datatype] for field in message.fields],
            'offsets': [field.offset for field in message.fields],
            'itemsize': message.point_step,
        }
        stamp = message.header.stamp
        cloud = np.frombuffer(message.data.tobytes(), np.dtype(point))
        yield log_ns, stamp.sec * NS_PER_S + stamp.nanosec, cloud


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('ending', 'options'),
    [
        ('.mcap', ()),
        ('', ()),
        ('.bag', ()),
        ('.mcap', ('--scan-stamp', 'forward')),
        ('', ('--period', '0.25', '--epoch', '2020-02-02 00:00:00')),
    ],
    ids=['mcap', 'folder', 'ros1', 'forward', 'period'],
)
def test_every_file_comes_back_to_the_byte(recording_path, tmp_path, ending, options):
    bag = to_bag(recording_path, tmp_path / f'bag{ending}', *options)
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q']) == 0
    assert files_of(tmp_path / 'out') == files_of(data_set_of(recording_path))


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_numbers_with_holes_that_do_not_begin_with_0_come_back(recordings, tmp_path, layout):
    source = tmp_path / 'set'
    shutil.copytree(recordings[layout], source)
    folder = source / 'training' / ('velodyne' if layout is Layout.OBJECT else 'velodyne/0000')
    (folder / '000000.bin').unlink()
    (folder / '000003.bin').unlink()
    bag = to_bag(source, tmp_path / 'bag.mcap', code=1)
    main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q'])
    assert files_of(tmp_path / 'out') == files_of(source)


@pytest.mark.parametrize('part', ['', '_start', '_end'])
def test_damaged_stamps_cost_no_other_scan(drive, tmp_path, part):
    """Without a line of its own a scan is lost; without start or end its turn is nominal."""
    path = drive / 'velodyne_points' / f'timestamps{part}.txt'
    lines = path.read_text().splitlines()
    lines[1] = '2011-13-40 what'
    path.write_text('\n'.join(lines) + '\n')
    bag = to_bag(drive, tmp_path / 'bag.mcap', code=1)
    main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q'])
    made, true = files_of(tmp_path / 'out' / drive.parent.name), files_of(drive.parent)
    for name, data in made.items():
        assert true[name] == data, name
    lost = {name for name in true.keys() - made.keys() if 'velodyne_points/data' in name}
    assert {Path(name).stem for name in lost} == (set() if part else {'0000000001'})


def test_stamp_and_time_of_what_is_ahead_is_the_line_of_timestamps_txt(real_kitti, tmp_path):
    drive = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0005_sync'
    forward, start, end = (
        parse_stamp((drive / f'velodyne_points/timestamps{part}.txt').read_text().splitlines()[0])
        for part in ('', '_start', '_end')
    )
    for moment, expected in (('start', start), ('forward', forward)):
        bag = tmp_path / f'{moment}.mcap'
        options = ('--end', '0', '--streams', 'scan', '--scan-stamp', moment)
        [(log_ns, stamp, cloud)] = clouds_of(to_bag(drive, bag, *options))
        assert log_ns == stamp == expected
        time = cloud['time'].astype(np.float64)
        assert (np.diff(time) >= 0).all()
        assert stamp + time[0] * 1e9 == pytest.approx(start, abs=100_000)
        assert stamp + time[-1] * 1e9 == pytest.approx(end, abs=100_000)
        azimuth = np.arctan2(cloud['y'], cloud['x'])
        ahead = np.abs(azimuth) < np.radians(0.2)
        assert ahead.sum() > 50
        assert np.abs(stamp + time[ahead] * 1e9 - forward).max() < 1_000_000
        left = np.abs(azimuth - np.pi / 2) < np.radians(0.2)
        assert (stamp + time[left] * 1e9).mean() == pytest.approx((start + forward) / 2, abs=10**6)


def real_sources(real_kitti: Path) -> list[tuple[Path, tuple[str, ...]]]:
    raw = real_kitti / 'raw/2011_09_26'
    return [
        (raw / '2011_09_26_drive_0005_sync', ()),
        (raw / '2011_09_26_drive_0052_sync', ()),
        (real_kitti / 'object', ()),
        (real_kitti / 'odometry/dataset', ()),
        (real_kitti / 'tracking', ()),
    ]


def test_every_real_scan_comes_back_to_the_byte(real_kitti, tmp_path):
    count = 0
    for number, (source, options) in enumerate(real_sources(real_kitti)):
        bag, out = tmp_path / f'{number}.mcap', tmp_path / f'{number}'
        assert main(['to-bag', str(source), str(bag), '-q', '--ring-time', *options]) in {0, 1}
        assert main(['to-kitti', str(bag), str(out), '-q']) in {0, 1}
        made = files_of(out)
        root = source.parent.parent if 'drive' in source.name else source
        for name, data in made.items():
            assert (root / name).read_bytes() == data, name
        count += sum(name.endswith('.bin') for name in made)
    assert count == 1 + 8 + 3 + 2


def test_a_scan_of_semantickitti_comes_back_in_order_of_time(real_kitti, tmp_path):
    [scan] = (real_kitti / 'semantickitti').rglob('*.bin')
    folder = tmp_path / 'set/training/velodyne'
    folder.mkdir(parents=True)
    shutil.copy(scan, folder / '000012.bin')
    bag = to_bag(tmp_path / 'set', tmp_path / 'bag.mcap', '--layout', 'object', code=1)
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q']) == 0
    made = tmp_path / 'out/training/velodyne/000012.bin'
    assert made.read_bytes() == scan.read_bytes()


def test_tracking_turns_at_the_rate_of_its_yaw(real_kitti, tmp_path):
    """The yaw of the poses changes as fast as the twist says; 0.1 s a frame is 3.6 % off."""
    ratios = {}
    for period in ('0.1036', '0.1'):
        out = tmp_path / f'{period}.mcap'
        to_bag(real_kitti / 'tracking', out, '--streams', 'pose', '--period', period)
        odometry = [message for _, message in messages_of(out, '/kitti/ground_truth/odometry')]
        stamps = [m.header.stamp.sec * NS_PER_S + m.header.stamp.nanosec for m in odometry]
        w, x, y, z = np.transpose([
            [q.w, q.x, q.y, q.z] for q in (m.pose.pose.orientation for m in odometry)
        ])  # fmt: skip
        yaw = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
        rate = np.array([m.twist.twist.angular.z for m in odometry])
        middle = (rate[1:] + rate[:-1]) / 2
        change = np.diff(yaw) / np.diff(stamps) * 1e9
        ratios[period] = (change @ middle) / (middle @ middle)
    assert ratios['0.1036'] == pytest.approx(1, abs=0.005)
    assert ratios['0.1'] == pytest.approx(1.036, abs=0.005)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT, Layout.TRACKING])
def test_a_plan_and_pictures_pair_each_scan_with_its_own_image(recordings, tmp_path, layout):
    """Stamped at the start of its turn, a scan is nearer to the image of the frame before."""
    source = recordings[layout]
    bag = to_bag(source, tmp_path / 'bag.mcap')
    plain = open_recording(source)
    scans = plain.streams[Stream.SCAN]
    assert np.array_equal(survey_bags([bag]).topics[POINTS].stamps()[0], scans.stamps_ns)
    frames = RecordingFrames(PlannedRecording(bag, survey_bags([bag])))
    assert len(frames.numbers) == len(scans)
    assert not any('dropped' in note for note in frames.notes)
    for number in frames.numbers.tolist():
        frame = frames.frame(number)
        assert np.array_equal(frame.points, plain.read(Stream.SCAN, number).points)
        assert set(frame.images) == {s.camera for s in plain.streams if s.camera is not None}
    frames.close()
    out = tmp_path / 'out'
    words = ['to-kitti', str(bag), str(out), '-q', '--layout', 'object', '--name', 'testing']
    assert main(words) == 0
    made = open_recording(out, ReadOptions(layout=Layout.OBJECT))
    assert len(made.streams[Stream.SCAN]) == len(scans)
    for index, number in enumerate(scans.numbers.tolist()):
        again = made.read(Stream.SCAN, index).points
        assert again.tobytes() == plain.read(Stream.SCAN, number).points.tobytes()
        png = made.read(Stream.IMAGE_2, index).data
        assert png == plain.read(Stream.IMAGE_2, number).data


@pytest.mark.parametrize('kind', ['folder', 'extract', 'bag'])
def test_a_frame_to_play_is_a_scan_and_its_own_images(recordings, tmp_path, kind):
    source = recordings[Layout.RAW]
    read, all_of_it = ReadOptions(scan_stamp=ScanStamp.START), SelectionOptions()
    if kind == 'bag':
        program = BagProgram(to_bag(source, tmp_path / 'bag.mcap'), all_of_it)
    else:
        recording = open_recording(source, read)
        recording.common_numbers = kind == 'folder'
        program = RecordingProgram(recording, MessageOptions(), all_of_it, workers=1)
    names = [outlet.topic for outlet in program.channels]
    wanted = range(len(names))
    frames: dict[str, list[int]] = {}
    for index, frame in enumerate(program.frames.tolist()):
        for due in program.fetch(index, wanted)[0]:
            frames.setdefault(names[due.channel], []).append(frame)
    program.close()
    for topic in (POINTS, '/kitti/camera_color_left/image_rect/compressed', '/kitti/oxts/imu'):
        assert frames[topic] == [0, 1, 2, 3, 4], topic


SCANS_AND_IMAGES = {
    Layout.RAW: ('velodyne_points/data/*.bin', 'image_02/data/*.png'),
    Layout.ODOMETRY: ('**/velodyne/*.bin', '**/image_2/*.png'),
    Layout.TRACKING: ('**/velodyne/*/*.bin', '**/image_02/*/*.png'),
}


@pytest.mark.parametrize('layout', SCANS_AND_IMAGES)
def test_scans_stay_with_the_images_of_their_frame(layout, recordings, tmp_path):
    source = recordings[layout]
    bag = to_bag(source, tmp_path / 'bag.mcap')
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q', '--layout', 'object']) in {0, 1}
    scans, images = (sorted(source.glob(glob)) for glob in SCANS_AND_IMAGES[layout])
    image_of = {
        np.sort(np.fromfile(scan, '<f4')).tobytes(): image.read_bytes()
        for scan, image in zip(scans, images, strict=True)
    }
    made = sorted((tmp_path / 'out').glob('*/velodyne/*.bin'))
    assert len(made) == len(image_of)
    for scan in made:
        image = scan.parent.parent / 'image_2' / f'{scan.stem}.png'
        assert image.read_bytes() == image_of[np.sort(np.fromfile(scan, '<f4')).tobytes()]
