# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic recording as KITTI-360: fisheyes that show what points fall on, poses, scans."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

import kitti_ros2
from kitti_ros2.kitti.scan_grid import grid_share
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions, write_synthetic
from kitti_ros2.synthetic.render import NOTHING
from kitti_ros2.synthetic.scene import CAR_T_VELO
from kitti_ros2.synthetic.sensors import ELEVATIONS, MAX_RANGE, cast_scan

if TYPE_CHECKING:
    from pathlib import Path

OPTIONS = SyntheticOptions(frames=2, seed=4, image_size=(621, 188), lidar_columns=1000)
FRAME = 1
FISHEYES = (2, 3)


@pytest.fixture(scope='module')
def made() -> SyntheticDrive:
    return SyntheticDrive(OPTIONS, Layout.KITTI_360)


@pytest.fixture(scope='module')
def opened(tmp_path_factory: pytest.TempPathFactory) -> kitti_ros2.Recording:
    folder: Path = tmp_path_factory.mktemp('fisheyes') / 'set'
    return kitti_ros2.open(write_synthetic(folder, Layout.KITTI_360, OPTIONS))


def test_all_cameras_have_colour(opened) -> None:
    assert [opened.frame(FRAME).image(camera).ndim for camera in range(4)] == [3] * 4


@pytest.mark.parametrize('camera', FISHEYES)
def test_points_fall_on_the_pixels_of_what_they_hit(made, opened, camera: int) -> None:
    frame = opened.frame(FRAME)
    ranges, hits = cast_scan(made.placed(FRAME), OPTIONS.lidar_columns)
    slant = np.sqrt(1 + np.tan(ELEVATIONS) ** 2)[:, None]
    hits = hits[ranges * slant <= MAX_RANGE]
    uv, depth = frame.calibration.project(frame.points, camera)
    assert len(uv) == len(hits)
    canvas = made.instances(FRAME, camera)
    height, width = canvas.ids.shape
    inside = np.isfinite(uv).all(axis=1)
    columns, rows = np.rint(np.where(inside[:, None], uv, -1)).astype(int).T
    inside &= (columns >= 1) & (columns < width - 1) & (rows >= 1) & (rows < height - 1)
    # Those whose pixel is not at a border of two objects.
    ids = canvas.ids.astype(np.float32)
    uniform = cv2.erode(ids, np.ones((3, 3))) == cv2.dilate(ids, np.ones((3, 3)))
    inside[inside] = uniform[rows[inside], columns[inside]]
    # Posts may be between two pixels.
    wide = np.array([min(one.solid.size[:2]) > 0.4 for one in made.placed(FRAME)])
    inside &= (hits >= 0) & wide[hits] & (depth < 40)
    at = rows[inside], columns[inside]
    seen = canvas.ids[at].astype(int) - 1
    nearest = np.divide(1, canvas.inverse_depth[at], out=np.full(len(seen), np.inf),
                        where=canvas.inverse_depth[at] > 0)  # fmt: skip
    same = seen == hits[inside]
    assert same.sum() > 2000
    assert len(np.unique(seen[same])) > 10
    off = np.abs(nearest - depth[inside])[same] / depth[inside][same]
    assert np.median(off) < 2e-3
    # The camera is half a metre from the scanner: it sees other points behind something nearer.
    assert same.mean() > 0.97
    assert (nearest[~same] < depth[inside][~same]).all()


@pytest.mark.parametrize('camera', FISHEYES)
def test_they_see_to_the_side_and_behind(made, opened, camera: int) -> None:
    """Also behind their image plane, to 98 degrees; the corners are black."""
    frame = opened.frame(FRAME)
    uv, _ = frame.calibration.project(frame.points, camera)
    height, width = made.picture(FRAME, camera).shape[:2]
    seen = ((uv >= 0) & (uv < (width, height))).all(axis=1)
    x, y, _ = frame.points[seen, :3].T
    side = y if camera == FISHEYES[0] else -y
    assert (x > 5).sum() > 500
    assert (x < -5).sum() > 500
    assert side.min() < -1
    assert (side > 0).mean() > 0.8
    image = made.picture(FRAME, camera)
    for row in (0, -1):
        for column in (0, -1):
            assert image[row, column].max() < 12
    assert image[height // 10, width // 2].min() > 90  # the sky
    for column in (3, width - 4):
        assert image[height // 2, column].max() > 30


@pytest.mark.parametrize('camera', FISHEYES)
def test_images_show_the_objects(made, camera: int) -> None:
    """Where there is an object, the image is not that of the empty street."""
    canvas = made.instances(FRAME, camera)
    image = made.picture(FRAME, camera).astype(int)
    fisheye = made._fisheyes[camera]  # the same camera without objects
    street_t_velo = made.motion(FRAME).street_T_car @ CAR_T_VELO
    empty = fisheye.photograph(camera, FRAME, [], street_t_velo, lambda *_: None).astype(int)
    differs = np.abs(image - empty).max(axis=2) > 0
    assert not differs[canvas.ids == NOTHING].any()
    assert differs[canvas.ids != NOTHING].mean() > 0.9


def test_scans_are_on_no_grid(made) -> None:
    """As those of KITTI-360; and the same points as in KITTI's layouts, which are on one."""
    points = made.scan(FRAME).points
    steps = points[:, 3].astype(np.float64) * 256
    np.testing.assert_array_equal(steps, np.rint(steps))
    assert points[:, 3].max() < 1
    assert grid_share(points[:, :3].astype(np.float64)) < 0.1
    on_grid = SyntheticDrive(OPTIONS).scan(FRAME).points
    assert grid_share(on_grid[:, :3].astype(np.float64)) > 0.99
    np.testing.assert_allclose(points[:, :3], on_grid[:, :3], atol=6e-4)


def test_poses_have_the_digits_of_the_data_set(tmp_path: Path) -> None:
    """%f and %d of MATLAB in turn, which writes an exponent unless the number is whole."""
    options = replace(OPTIONS, frames=3, image_size=(16, 16), lidar_columns=16)
    root = write_synthetic(tmp_path / 'set', Layout.KITTI_360, options)
    (cameras,) = root.glob('data_poses/*/cam0_to_world.txt')
    pair = r'-?\d+\.\d{6} (-?\d\.\d{6}e[+-]\d\d|-?\d+) '
    for number, line in enumerate(cameras.read_text().splitlines(), 1):
        assert re.fullmatch(f'{number} ({pair}){{6}}0.000000 0 0.000000 1 ', line)
    for line in (root / cameras.parent / 'poses.txt').read_text().splitlines():
        words = line.split(' ')[1:]
        assert len(words) == 12
        assert all(word == f'{float(word):.10g}' for word in words)
        assert 1000 < np.hypot(float(words[3]), float(words[7])) < 5000


def test_frames_without_movement_have_no_pose(tmp_path: Path) -> None:
    """Frame 0 has none in any drive, frame 1 has one; then one for each 0.2 m."""
    options = replace(OPTIONS, frames=14, image_size=(16, 16), lidar_columns=16, rest=0.0)
    options = replace(options, speed=30.0)
    drive = SyntheticDrive(options, Layout.KITTI_360)
    posed = sorted(drive.posed)
    assert posed[0] == 1
    places = {number: drive.motion(number).map_T_imu.translation for number in range(14)}
    for before, after in pairwise(posed):
        steps = [np.linalg.norm(places[n] - places[before]) for n in range(before + 1, after + 1)]
        assert steps[-1] > 0.199
        assert all(step < 0.201 for step in steps[:-1])
    assert posed[1] > 3
    assert posed[-2:] == [12, 13]
    recording = kitti_ros2.open(write_synthetic(tmp_path / 'set', Layout.KITTI_360, options))
    assert not recording.losses
    assert [*recording.streams['pose']] == posed
    assert not {*recording.streams['labels']} - {*posed}
    assert [*recording.streams['oxts']] == [*range(14)]
