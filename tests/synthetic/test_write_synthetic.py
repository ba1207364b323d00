# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.files.image_files import parse_png
from kitti_ros2.kitti.calib_file import parse_calibration
from kitti_ros2.kitti.opening import guess_layout, open_recording
from kitti_ros2.kitti.scan_file import parse_scan
from kitti_ros2.kitti.text_file import parse_packet, parse_poses, parse_timestamps
from kitti_ros2.model.errors import OutputExistsError, UsageError
from kitti_ros2.model.samples import Scan, rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions, write_synthetic

from builders import parse_boxes  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

TINY = SyntheticOptions(frames=3, seed=1, image_size=(124, 38), lidar_columns=100)


@pytest.fixture(scope='module')
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[Layout, Path]:
    """Each layout once: the folder that write_synthetic returns."""
    root = tmp_path_factory.mktemp('written')
    return {layout: write_synthetic(root / layout.value, layout, TINY) for layout in Layout}


def digest(root: Path) -> dict[str, str]:
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in root.rglob('*')
        if path.is_file()
    }


@pytest.mark.parametrize('layout', list(Layout))
def test_same_seed_same_bytes(tmp_path: Path, written: dict[Layout, Path], layout: Layout) -> None:
    assert digest(write_synthetic(tmp_path / 'again', layout, TINY)) == digest(written[layout])


def test_other_seed_other_street(tmp_path: Path, written: dict[Layout, Path]) -> None:
    other = SyntheticOptions(frames=3, seed=5, image_size=(124, 38), lidar_columns=100)
    write_synthetic(tmp_path / 'two', Layout.OBJECT, other)
    one, two = digest(written[Layout.OBJECT]), digest(tmp_path / 'two')
    for name in ('velodyne/000000.bin', 'image_2/000000.png', 'label_2/000000.txt'):
        assert one[f'training/{name}'] != two[f'training/{name}']


def test_samples_do_not_depend_on_the_order_of_asking() -> None:
    forward, backward = SyntheticDrive(TINY), SyntheticDrive(TINY)
    there = [forward.image(frame, camera).data for frame in range(3) for camera in range(4)]
    back = [
        backward.image(frame, camera).data
        for frame in reversed(range(3))
        for camera in reversed(range(4))
    ]
    assert there == back[::-1]


def test_raw_drive_is_complete(tmp_path: Path) -> None:
    done: list[int] = []
    drive = write_synthetic(tmp_path / 'raw', Layout.RAW, TINY, progress=done.append)
    assert done == [1, 2, 3]
    assert drive == tmp_path / 'raw' / '2011_09_26' / '2011_09_26_drive_0001_sync'
    assert sorted(path.name for path in drive.iterdir()) == [
        *(f'image_0{camera}' for camera in range(4)),
        'oxts',
        'tracklet_labels.xml',
        'velodyne_points',
    ]
    truth = SyntheticDrive(TINY)
    path = drive / 'velodyne_points' / 'data' / '0000000002.bin'
    np.testing.assert_array_equal(parse_scan(path.read_bytes(), path), truth.scan(2).points)
    path = drive / 'image_03' / 'timestamps.txt'
    assert parse_timestamps(path.read_text(), path).values == [
        truth.stamps(frame).images[3] for frame in range(3)
    ]
    image = parse_png((drive / 'image_02' / 'data' / '0000000000.png').read_bytes(), path)
    assert (image.width, image.height, image.channels) == (124, 38, 3)
    path = drive / 'oxts' / 'data' / '0000000001.txt'
    assert parse_packet(path.read_text(), path).vf == pytest.approx(truth.packet(1).vf)


def test_object_calibration_survives_its_file(written: dict[Layout, Path]) -> None:
    root = written[Layout.OBJECT]
    truth = SyntheticDrive(TINY).calibration
    path = root / 'training' / 'calib' / '000001.txt'
    read = parse_calibration(path.read_text(), path, path.name)
    assert read.cam0_T_velo is not None
    assert truth.cam0_T_velo is not None
    np.testing.assert_array_equal(read.cam0_T_velo.matrix(), truth.cam0_T_velo.matrix())
    for camera in range(4):
        np.testing.assert_array_equal(read.cameras[camera].p_rect, truth.cameras[camera].p_rect)


def test_odometry_poses_are_the_truth(written: dict[Layout, Path]) -> None:
    root = written[Layout.ODOMETRY]
    path = root / 'poses' / '00.txt'
    truth = SyntheticDrive(TINY)
    for frame, pose in enumerate(parse_poses(path.read_text(), path).values):
        assert pose is not None
        np.testing.assert_allclose(pose, truth.pose(frame).matrix()[:3], atol=1e-6)


def test_tracking_labels_are_the_truth(written: dict[Layout, Path]) -> None:
    root = written[Layout.TRACKING]
    path = root / 'training' / 'label_02' / '0000.txt'
    truth = SyntheticDrive(TINY)
    expected = [box for frame in range(3) for box in truth.boxes(frame)]
    read = parse_boxes(path.read_text(), path)
    assert [(box.frame, box.track_id, box.class_name) for box in read] == [
        (box.frame, box.track_id, box.class_name) for box in expected
    ]
    np.testing.assert_allclose(
        [box.location for box in read], [box.location for box in expected], atol=1e-6
    )


@pytest.mark.parametrize('layout', list(Layout))
def test_every_layout_is_read_again(written: dict[Layout, Path], layout: Layout) -> None:
    path = written[layout]
    truth = SyntheticDrive(TINY, layout)
    assert guess_layout(path) is layout
    recording = open_recording(path)
    assert not recording.losses
    for stream, index in recording.streams.items():
        of_poses = stream in {Stream.POSE, Stream.LABELS} and layout.traits.world_boxes
        expected = truth.posed if of_poses else range(TINY.frames)
        assert index.numbers.tolist() == sorted(expected)
    scan = recording.read(Stream.SCAN, 2)
    assert isinstance(scan, Scan)
    made = truth.scan(2, is_compensated=layout is Layout.ODOMETRY)
    np.testing.assert_array_equal(scan.points, made.points)
    calibration = recording.calibration(2)
    assert calibration.r0_rect is not None
    rect_t_velo = rect_from_velo(calibration).matrix()
    for camera in layout.traits.raw_cameras:
        read, made_of = calibration.cameras[camera], truth.calibration.cameras[camera]
        assert read.size == made_of.size
        assert read.lens is not None
        assert made_of.lens is not None
        np.testing.assert_array_equal(read.p_rect, made_of.p_rect)
        np.testing.assert_array_equal(read.lens.numbers, made_of.lens.numbers)
        assert read.cam_T_velo is not None
        assert made_of.cam_T_velo is not None
        np.testing.assert_allclose(read.cam_T_velo.matrix(), made_of.cam_T_velo.matrix(), atol=1e-6)
    for camera in calibration.cameras.keys() - {*layout.traits.raw_cameras}:
        read = calibration.cameras[camera]
        np.testing.assert_allclose(
            read.p_rect @ rect_t_velo, truth.projection(camera), rtol=1e-6, atol=1e-5
        )


def test_taken_folder_is_refused_and_an_empty_one_is_used(tmp_path: Path) -> None:
    root = tmp_path / 'here'
    root.mkdir()
    write_synthetic(root, Layout.OBJECT, replace(TINY, frames=1))
    before = digest(root)
    with pytest.raises(OutputExistsError):
        write_synthetic(root, Layout.OBJECT, TINY)
    assert digest(root) == before


def test_interrupted_run_leaves_nothing(tmp_path: Path) -> None:
    def stop(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_synthetic(tmp_path / 'raw', Layout.RAW, TINY, progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    'wrong',
    [
        {'frames': 0},
        {'seed': -1},
        {'image_size': (4, 375)},
        {'lidar_columns': 3},
        {'range_noise_m': -0.1},
        {'range_noise_m': float('nan')},
    ],
)
def test_wrong_options_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=next(iter(wrong))):
        SyntheticOptions(**wrong)  # type: ignore[arg-type]
