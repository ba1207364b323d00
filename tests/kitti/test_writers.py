# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.calib_file import format_odometry, parse_calibration
from kitti_ros2.kitti.label_file import fitting_decimals
from kitti_ros2.kitti.scan_file import parse_scan
from kitti_ros2.kitti.text_file import (
    COLUMNS,
    format_packet,
    format_poses,
    format_times,
    format_timestamps,
    parse_packet,
    parse_poses,
    parse_times,
    parse_timestamps,
)
from kitti_ros2.kitti.tracklet_file import Tracklet, TrackletPose, format_tracklets
from kitti_ros2.kitti.writers import (
    DATAFORMAT,
    ObjectWriter,
    OdometryWriter,
    RawWriter,
    TrackingWriter,
    WriteOptions,
    fill_stamps,
    truncation_level,
)
from kitti_ros2.model.boxes import Box, box_to_rect, box_to_velo
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.samples import Scan, rect_from_velo
from kitti_ros2.model.streams import Stream
from kitti_ros2.synthetic.scene import CAR_T_VELO, make_calibration, motion_at, packet_of

from builders import parse_boxes  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

    from kitti_ros2.kitti.writers import LayoutWriter

PNG = b'any bytes will do'
STAMP = 1_317_042_000_123_456_789
STEP = 100_000_001
CALIBRATION = make_calibration()
POINTS = np.arange(12, dtype=np.float32).reshape(3, 4)
SCAN = Scan(POINTS, start_ns=STAMP - 50, end_ns=STAMP + 50)
PACKET = packet_of(motion_at(1.0, CAR_T_VELO))
BOX = Box('Car', 0.3, 3, 0.1, (1, 2, 3, 4), (1.5, 1.6, 4.0), (-2.0, 1.65, 20.0), -1.5, track_id=4)


def write_all(writer: LayoutWriter, numbers: tuple[int, ...] = (0, 1, 2)) -> None:
    """Write a sample of every stream that the layout has a place for, frame by frame."""
    with writer:
        for number in numbers:
            stamp = STAMP + number * STEP
            writer.write_calibration(number, CALIBRATION)
            writer.write_scan(number, stamp, SCAN)
            for stream in sorted(writer.accepts):
                if stream.camera is not None:
                    writer.write_image(stream.camera, number, stamp + 7, PNG)
            if Stream.OXTS in writer.accepts:
                writer.write_oxts(number, stamp + 3, PACKET)
            if Stream.POSE in writer.accepts:
                writer.write_pose(number, stamp, np.eye(4)[:3])
            if Stream.LABELS in writer.accepts:
                writer.write_labels(number, [BOX])


def tree(root: Path) -> list[str]:
    return sorted(path.relative_to(root).as_posix() for path in root.rglob('*') if path.is_file())


def test_raw_tree(tmp_path: Path) -> None:
    write_all(RawWriter(tmp_path, '2011_09_26', 5))
    drive = '2011_09_26/2011_09_26_drive_0005_sync'
    images = [f'image_0{camera}' for camera in range(4)]
    data = [(image, 'png') for image in images] + [('velodyne_points', 'bin'), ('oxts', 'txt')]
    expected = [f'2011_09_26/calib_{name}.txt' for name in CALIB_NAMES]
    expected += [f'{drive}/{d}/data/{n:010d}.{suffix}' for d, suffix in data for n in range(3)]
    expected += [f'{drive}/{folder}/timestamps.txt' for folder, _ in data]
    expected += [f'{drive}/velodyne_points/timestamps_{end}.txt' for end in ('start', 'end')]
    expected += [f'{drive}/oxts/dataformat.txt', f'{drive}/tracklet_labels.xml']
    assert tree(tmp_path) == sorted(expected)


CALIB_NAMES = ('cam_to_cam', 'velo_to_cam', 'imu_to_velo')


def test_object_tree(tmp_path: Path) -> None:
    write_all(ObjectWriter(tmp_path), (3, 7, 8))
    folders = [(f'image_{camera}', 'png') for camera in range(5)]
    folders += [('velodyne', 'bin'), ('calib', 'txt'), ('label_2', 'txt')]
    expected = [f'training/{d}/{n:06d}.{suffix}' for d, suffix in folders for n in (3, 7, 8)]
    expected += [f'ImageSets/{name}.txt' for name in ('train', 'val', 'trainval', 'test')]
    assert tree(tmp_path) == sorted(expected)
    assert (tmp_path / 'ImageSets/train.txt').read_text() == '000003\n000007\n'
    assert (tmp_path / 'ImageSets/val.txt').read_text() == '000008\n'
    assert (tmp_path / 'ImageSets/test.txt').read_text() == ''
    keys = [line.split()[0] for line in (tmp_path / 'training/calib/000003.txt').open() if line[1:]]
    assert keys == ['P0:', 'P1:', 'P2:', 'P3:', 'R0_rect:', 'Tr_velo_to_cam:', 'Tr_imu_to_velo:']


def test_odometry_tree(tmp_path: Path) -> None:
    write_all(OdometryWriter(tmp_path, 3))
    folders = [(f'image_{camera}', 'png') for camera in range(4)] + [('velodyne', 'bin')]
    expected = [f'sequences/03/{d}/{n:06d}.{suffix}' for d, suffix in folders for n in range(3)]
    expected += ['sequences/03/calib.txt', 'sequences/03/times.txt', 'poses/03.txt']
    assert tree(tmp_path) == sorted(expected)
    times = tmp_path / 'sequences/03/times.txt'
    assert parse_times(times.read_text(), times).values == [0, 100_000_000, 200_000_000]


def test_tracking_tree(tmp_path: Path) -> None:
    write_all(TrackingWriter(tmp_path, 12))
    folders = [(f'image_0{camera}', 'png') for camera in range(4)] + [('velodyne', 'bin')]
    expected = [f'training/{d}/0012/{n:06d}.{suffix}' for d, suffix in folders for n in range(3)]
    expected += [f'training/{name}/0012.txt' for name in ('calib', 'oxts', 'label_02')]
    assert tree(tmp_path) == sorted(expected)
    boxes = parse_boxes((tmp_path / 'training/label_02/0012.txt').read_text(), 'label')
    assert [(box.frame, box.track_id, box.truncated) for box in boxes] == [
        (frame, 4, 1.0) for frame in range(3)
    ]
    assert len((tmp_path / 'training/oxts/0012.txt').read_text().splitlines()) == 3


def test_raw_stamps_stay_with_their_file_number(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path)
    write_all(writer, (1, 2, 5))
    path = writer.path / 'velodyne_points' / 'timestamps.txt'
    stamps = parse_timestamps(path.read_text(), path).values
    assert stamps == [STAMP + number * STEP for number in range(6)]
    start = (writer.path / 'velodyne_points' / 'timestamps_start.txt').read_text()
    assert start.splitlines()[5] == '2011-09-26 13:00:00.123456739'
    assert (writer.path / 'oxts' / 'dataformat.txt').read_text() == DATAFORMAT


@given(
    st.dictionaries(st.integers(0, 60), st.integers(0, 2**40), min_size=1).map(
        lambda steps: dict(
            zip(sorted(steps), np.cumsum(sorted(steps.values())).tolist(), strict=True)
        )
    )
)
def test_filled_stamps_keep_those_that_are_known(stamps: dict[int, int]) -> None:
    filled = fill_stamps(stamps)
    assert len(filled) == max(stamps) + 1
    assert all(filled[number] == stamp for number, stamp in stamps.items())
    assert filled == sorted(filled)


def test_dataformat_names_every_column() -> None:
    assert tuple(line.split(':')[0] for line in DATAFORMAT.splitlines()) == COLUMNS


def test_scan_bytes_are_untouched(tmp_path: Path) -> None:
    write_all(ObjectWriter(tmp_path))
    path = tmp_path / 'training' / 'velodyne' / '000000.bin'
    np.testing.assert_array_equal(parse_scan(path.read_bytes(), path), POINTS)


def test_verbatim_text_is_written_as_it_is(tmp_path: Path) -> None:
    with TrackingWriter(tmp_path) as writer:
        writer.write_calibration_text(0, {'calib/0000.txt': 'P0: 1\r\n'})
        writer.write_oxts(0, STAMP, '1 2 3')
        writer.write_labels(0, '0 1 Car ...')
        writer.write_labels(1, '')
    assert (tmp_path / 'training/calib/0000.txt').read_bytes() == b'P0: 1\r\n'
    assert (tmp_path / 'training/oxts/0000.txt').read_text() == '1 2 3\n'
    assert (tmp_path / 'training/label_02/0000.txt').read_text() == '0 1 Car ...\n'


def test_frame_without_objects_has_an_empty_label_file(tmp_path: Path) -> None:
    for split in ('training', 'testing'):
        with ObjectWriter(tmp_path, split) as writer:
            writer.write_labels(0, [])
    assert (tmp_path / 'testing/label_2/000000.txt').read_text() == ''
    assert (tmp_path / 'ImageSets/test.txt').read_text() == '000000\n'
    assert (tmp_path / 'ImageSets/trainval.txt').read_text() == '000000\n'


def test_tracklets_are_split_where_a_frame_is_missing(tmp_path: Path) -> None:
    with RawWriter(tmp_path) as writer:
        writer.write_calibration(0, CALIBRATION)
        for number in (2, 3, 6):
            writer.write_labels(number, [BOX])
    root = ET.parse(writer.path / 'tracklet_labels.xml').getroot()
    items = root.findall('tracklets/item')
    assert [item.findtext('first_frame') for item in items] == ['2', '6']
    assert [len(item.findall('poses/item')) for item in items] == [2, 1]
    pose = items[0].find('poses/item')
    assert pose is not None
    place = [float(pose.findtext(name) or 'nan') for name in ('tx', 'ty', 'tz')]
    (location, rotation_y) = box_to_rect(
        place, float(pose.findtext('rz') or 'nan'), rect_from_velo(CALIBRATION)
    )
    np.testing.assert_allclose(location, BOX.location, atol=1e-4)
    assert rotation_y == pytest.approx(BOX.rotation_y, abs=1e-6)
    assert (pose.findtext('truncation'), pose.findtext('occlusion')) == ('1', '-1')


def test_tracklets_are_split_where_class_or_size_changes(tmp_path: Path) -> None:
    height, width, length = BOX.size_hwl
    sizes = [1.3, 1.0, 1.02, 0.98, 1.0, 1.0]
    with RawWriter(tmp_path) as writer:
        writer.write_calibration(0, CALIBRATION)
        for number, size in enumerate(sizes):
            name = 'Van' if number == 5 else 'Car'
            resized = (height * size, width * size, length * size)
            writer.write_labels(number, [replace(BOX, class_name=name, size_hwl=resized)])
    root = ET.parse(writer.path / 'tracklet_labels.xml').getroot()
    items = root.findall('tracklets/item')
    assert [item.findtext('first_frame') for item in items] == ['0', '1', '5']
    assert [item.findtext('objectType') for item in items] == ['Car', 'Car', 'Van']
    lengths = [float(item.findtext('l') or 'nan') for item in items]
    assert lengths == pytest.approx([1.3 * length, length, length])
    several, off = writer.notes()
    assert '1 track became several' in several
    assert f'by up to {0.02 * length:.2f} m' in off


def test_two_boxes_of_a_track_in_a_frame_are_refused(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path)
    with pytest.raises(ValueError, match=f'two boxes of track {BOX.track_id} in a frame'):
        writer.write_labels(0, [BOX, BOX])


def test_tracklet_classes_are_declared_once() -> None:
    track = Tracklet('A&B', (1.0, 2.0, 3.0), 0, [TrackletPose((0.1, 0.2, 0.3), 0.4)] * 2)
    text = format_tracklets([track, track])
    ET.fromstring(text)
    assert text.count('class_id="1"') == text.count('class_id="3"') == 1
    assert '<objectType>A&amp;B</objectType>' in text


@given(
    st.tuples(*[st.floats(-90, 90)] * 3),
    st.floats(-3.1, 3.1),
)
def test_boxes_go_to_the_scanner_and_back(
    location: tuple[float, float, float], rotation_y: float
) -> None:
    rect_t_velo = rect_from_velo(CALIBRATION)
    centre, yaw = box_to_velo(location, rotation_y, rect_t_velo)
    back, rotation = box_to_rect(centre, yaw, rect_t_velo)
    np.testing.assert_allclose(back, location, atol=1e-4)
    assert rotation == pytest.approx(rotation_y, abs=1e-6)
    assert np.cos(yaw + np.pi / 2 + rotation_y) > 0.9999


def test_what_a_layout_has_no_place_for_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match='odometry layout has no place for oxts'):
        OdometryWriter(tmp_path).write_oxts(0, STAMP, PACKET)
    with pytest.raises(UsageError, match='no place for image_4'):
        RawWriter(tmp_path).write_image(4, 0, STAMP, PNG)
    with pytest.raises(UsageError, match='no place for labels'):
        OdometryWriter(tmp_path).write_labels(0, [BOX])
    with pytest.raises(UsageError, match='tracklets'):
        RawWriter(tmp_path).write_labels(0, 'Car ...')
    with pytest.raises(UsageError, match='is no drive'):
        RawWriter(tmp_path, 'today')
    with pytest.raises(UsageError, match='training and testing'):
        ObjectWriter(tmp_path, 'validation')


def test_gap_in_a_line_numbered_file_is_refused(tmp_path: Path) -> None:
    writer = TrackingWriter(tmp_path)
    writer.write_oxts(0, STAMP, PACKET)
    with pytest.raises(UsageError, match='packet of frame 1 must come before that of frame 2'):
        writer.write_oxts(2, STAMP, PACKET)
    sequence = OdometryWriter(tmp_path)
    sequence.write_scan(1, STAMP, SCAN)
    with pytest.raises(UsageError, match='there is no frame 0'):
        sequence.close()
    with pytest.raises(UsageError, match='pose of frame 0 must come before'):
        sequence.write_pose(1, STAMP, np.eye(4)[:3])


def test_tables_are_not_written_after_an_error(tmp_path: Path) -> None:
    writer = RawWriter(tmp_path)
    writer.write_scan(0, STAMP, SCAN)
    with pytest.raises(AttributeError), writer:
        writer.write_scan(1, STAMP, None)  # type: ignore[arg-type]
    assert not (writer.path / 'velodyne_points' / 'timestamps.txt').exists()


@pytest.mark.parametrize(
    ('fraction', 'level'), [(0.0, 0), (0.1, 0), (0.3, 1), (0.6, 2), (1.0, 1), (2.0, 2), (-1.0, -1)]
)
def test_truncation_levels(fraction: float, level: int) -> None:
    assert truncation_level(fraction) == level


# Of real files: their values, written again.


def test_real_object_files_come_back_from_their_values(real_kitti: Path, tmp_path: Path) -> None:
    """Also with four decimals for boxes that have them."""
    source = real_kitti / 'object/training'
    with ObjectWriter(tmp_path, options=WriteOptions(label_decimals=4)) as writer:
        for number in range(3):
            path = source / f'calib/{number:06d}.txt'
            writer.write_calibration(
                number, parse_calibration(path.read_text(), path, path.name, source='')
            )
            labels = source / f'label_2/{number:06d}.txt'
            writer.write_labels(number, parse_boxes(labels.read_text(), labels))
    for name in (f'{folder}/{n:06d}.txt' for folder in ('calib', 'label_2') for n in range(3)):
        assert (tmp_path / 'training' / name).read_text() == (source / name).read_text()


def test_real_tracking_files_come_back_from_their_values(real_kitti: Path, tmp_path: Path) -> None:
    source = real_kitti / 'tracking/training'
    files = {name: source / name / '0000.txt' for name in ('calib', 'oxts', 'label_02')}
    frames: dict[int, list[Box]] = {}
    for box in parse_boxes(files['label_02'].read_text(), files['label_02']):
        frames.setdefault(box.frame, []).append(box)
    with TrackingWriter(tmp_path) as writer:
        path = files['calib']
        writer.write_calibration(0, parse_calibration(path.read_text(), path, path.name))
        for number, line in enumerate(files['oxts'].read_text().splitlines()):
            writer.write_oxts(number, STAMP, parse_packet(line, files['oxts']))
            writer.write_labels(number, frames.get(number, []))
    for name, path in files.items():
        assert (tmp_path / 'training' / name / path.name).read_text() == path.read_text()


def test_real_packets_and_stamps_come_back_from_their_values(real_kitti: Path) -> None:
    packets = sorted(real_kitti.glob('raw/2011_09_26/*/oxts/data/*.txt'))
    assert len(packets) >= 262
    for path in packets:
        text = path.read_text()
        assert f'{format_packet(parse_packet(text, path))}\n' == text, path
    for path in real_kitti.glob('raw/2011_09_26/*/*/timestamps*.txt'):
        text = path.read_text()
        assert format_timestamps(parse_timestamps(text, path).values) == text, path


def test_real_odometry_texts_come_back_from_their_values(real_kitti: Path) -> None:
    source = real_kitti / 'odometry/dataset'
    poses, times, calib = (
        source / name
        for name in ('poses/00.txt', 'sequences/00/times.txt', 'sequences/00/calib.txt')
    )
    assert format_poses(parse_poses(poses.read_text(), poses).values) == poses.read_text()
    assert format_times(parse_times(times.read_text(), times).values) == times.read_text()
    calibration = parse_calibration(calib.read_text(), calib, calib.name)
    assert format_odometry(calibration) == calib.read_text()


@pytest.mark.parametrize(
    ('values', 'decimals'),
    [
        ({}, 2),
        ({'location': (-2.0 + 4e-5, 1.65, 20.0)}, 2),
        ({'location': (-2.0 + 6e-5, 1.65, 20.0)}, 4),
        ({'rotation_y': -1.5001}, 4),
        ({'size_hwl': (1.5, 1.605, 4.0)}, 4),
        ({'box_2d': (1.2345, 2, 3, 4)}, 2),
        ({'box_2d': (1.2345, 2, 3, 4), 'size_hwl': (-1.0,) * 3, 'location': (-1000.0,) * 3}, 4),
        ({'box_2d': (1.25, 2, 3, 4), 'size_hwl': (-1.0,) * 3, 'location': (-1000.0,) * 3}, 2),
    ],
)
def test_labels_have_the_decimals_of_their_boxes(values: dict[str, object], decimals: int) -> None:
    assert fitting_decimals(replace(BOX, **values), 4) == decimals
    assert fitting_decimals(replace(BOX, **values), 2) == 2
