# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from kitti_ros2.kitti.scan_grid import find_measured, on_grid
from kitti_ros2.model.boxes import box_to_velo
from kitti_ros2.model.samples import rect_from_velo
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions
from kitti_ros2.synthetic.scene import SCANNER_HEIGHT
from kitti_ros2.synthetic.sensors import MAX_RANGE

if TYPE_CHECKING:
    from kitti_ros2.model.boxes import Box
    from kitti_ros2.model.geometry import Float64Array

BUMPER = 0.02


def in_box_axes(points: Float64Array, box: Box, drive: SyntheticDrive) -> Float64Array:
    """Points of velo_link from a label's bottom centre, x along its length, z up."""
    centre, yaw = box_to_velo(box.location, box.rotation_y, rect_from_velo(drive.calibration))
    c, s = np.cos(yaw), np.sin(yaw)
    shifted: Float64Array = (points - centre) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return shifted


def iou(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    left, top = max(first[0], second[0]), max(first[1], second[1])
    right, bottom = min(first[2], second[2]), min(first[3], second[3])
    both = max(0.0, right - left) * max(0.0, bottom - top)
    areas = [(one[2] - one[0]) * (one[3] - one[1]) for one in (first, second)]
    return both / (sum(areas) - both)


@pytest.mark.parametrize('frame', [0, 5])
def test_points_lie_on_the_labelled_boxes(drive: SyntheticDrive, frame: int) -> None:
    points = drive.scan(frame).points[:, :3].astype(np.float64)
    met = 0
    for box in drive.boxes(frame):
        height, width, length = box.size_hwl
        half = np.array([length / 2, width / 2, height / 2])
        local = in_box_axes(points, box, drive) - (0.0, 0.0, height / 2)
        within = (np.abs(local) <= half + BUMPER).all(axis=1) & (local[:, 2] > -half[2] + 0.05)
        depth = (half - np.abs(local[within])).min(axis=1)
        np.testing.assert_allclose(depth, 0.0, atol=1e-3)
        met += int(within.sum())
    assert met > 300


def test_other_points_lie_on_the_ground_or_on_something(drive: SyntheticDrive) -> None:
    points = drive.scan(0).points[:, :3].astype(np.float64)
    ground = np.abs(points[:, 2] + SCANNER_HEIGHT) < 1e-5
    assert 0.2 < ground.mean() < 0.9
    assert points[:, 2].min() > -SCANNER_HEIGHT - 1e-5
    surface = np.full(len(points), np.inf)
    for one in drive.placed(0):
        c, s = np.cos(one.yaw), np.sin(one.yaw)
        local = (points - one.centre) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        half = np.array(one.solid.size) / 2
        outside = np.abs(local - (0, 0, half[2])) - half
        surface = np.minimum(surface, np.abs(outside.max(axis=1)))
    assert surface[~ground].max() < 1e-3


def test_scan_is_in_kittis_order(drive: SyntheticDrive) -> None:
    points = drive.scan(0).points
    assert points.dtype == np.float32
    assert points.shape[1] == 4
    azimuths = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    wraps = np.flatnonzero(np.diff(azimuths) < 0)
    assert len(wraps) == 63
    elevations = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    rows = np.split(elevations, wraps + 1)
    assert all(np.ptp(row) < 0.03 for row in rows), 'half a millimetre at 4 m'
    assert (np.diff([row[0] for row in rows]) < 0).all()
    assert elevations[0] == pytest.approx(2.0, abs=0.015)
    assert elevations[-1] == pytest.approx(-24.8, abs=0.015)
    assert azimuths[0] < np.radians(2)


def test_scans_are_on_kittis_grid_and_those_of_odometry_are_moved_from_it() -> None:
    options = SyntheticOptions(frames=1, image_size=(64, 32), lidar_columns=2000, swept=True)
    measured = SyntheticDrive(options).scan(0).points
    np.testing.assert_array_equal(measured[:, :3], on_grid(measured[:, :3]))
    hundredths = np.rint(measured[:, 3].astype(np.float64) * 100) / 100
    np.testing.assert_array_equal(measured[:, 3], hundredths.astype(np.float32))
    found = find_measured(SyntheticDrive(options).scan(0, is_compensated=True).points)
    assert found is not None
    assert (found.xyz == measured[:, :3]).all(axis=1).mean() > 0.999


def test_scan_values_are_in_range(drive: SyntheticDrive) -> None:
    points = drive.scan(1).points
    assert np.isfinite(points).all()
    assert points[:, 3].min() >= 0
    assert points[:, 3].max() < 1
    assert len(np.unique(points[:, 3])) > 30
    assert np.linalg.norm(points[:, :3], axis=1).max() <= MAX_RANGE + 1e-3


def test_noise_moves_points_along_their_rays() -> None:
    options = SyntheticOptions(frames=1, image_size=(64, 32), lidar_columns=200)
    clean = SyntheticDrive(options).scan(0).points[:, :3]
    noisy = SyntheticDrive(replace(options, range_noise_m=0.05)).scan(0).points[:, :3]
    moved = np.linalg.norm(noisy, axis=1) - np.linalg.norm(clean, axis=1)
    assert moved.std() == pytest.approx(0.05, rel=0.1)
    across = np.linalg.norm(np.cross(noisy, clean), axis=1) / np.linalg.norm(clean, axis=1)
    assert across.max() < 2e-3, 'two roundings to a millimetre'


def test_boxes_project_onto_the_pixels_that_show_them(drive: SyntheticDrive) -> None:
    compared = 0
    for frame in range(len(drive)):
        canvas = drive.instances(frame, 2)
        owners = {one.solid.track_id: index for index, one in enumerate(drive.placed(frame), 1)}
        for box in drive.boxes(frame):
            shown = canvas.ids == owners[box.track_id or 0]
            rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
            bounds = (columns[0], rows[0], columns[-1], rows[-1])
            slack = (*np.subtract(box.box_2d[:2], 1e-6), *np.add(box.box_2d[2:], 1e-6))
            assert bounds[0] >= slack[0]
            assert bounds[1] >= slack[1]
            assert bounds[2] <= slack[2]
            assert bounds[3] <= slack[3]
            whole = shown.sum() == canvas.covered[owners[box.track_id or 0] - 1]
            if whole and shown.sum() > 300:
                assert np.max(np.abs(np.subtract(bounds, box.box_2d))) < 1.0 + 1e-6
                assert iou(bounds, box.box_2d) > 0.85
                compared += 1
    assert compared >= 6


@pytest.mark.parametrize('camera', [0, 1, 2, 3])
def test_points_fall_on_pixels_of_their_depth(drive: SyntheticDrive, camera: int) -> None:
    """A point that a camera can see has the depth that the camera drew there."""
    canvas = drive.instances(0, camera)
    points = drive.scan(0).points[:, :3].astype(np.float64)
    projection = drive.projection(camera)
    projected = points @ projection[:, :3].T + projection[:, 3]
    height, width = canvas.ids.shape
    on_box = points[:, 2] > -SCANNER_HEIGHT + 0.02
    projected = projected[(projected[:, 2] > 1) & on_box]
    u, v = np.rint(projected[:, :2] / projected[:, 2:]).astype(int).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    drawn = canvas.inverse_depth[v[inside], u[inside]]
    ratio = drawn * projected[inside, 2]
    # The cameras stand beside the scanner: edges hide a few points, grazed faces vary in a pixel.
    assert np.mean(np.abs(ratio - 1) < 0.03) > 0.9
    assert np.median(np.abs(ratio - 1)) < 0.004


def test_labels_are_as_the_devkit_says(drive: SyntheticDrive) -> None:
    boxes = [box for frame in range(len(drive)) for box in drive.boxes(frame)]
    assert {'Car', 'Pedestrian'} <= {box.class_name for box in boxes}
    p2 = drive.calibration.cameras[2].p_rect
    width, height = drive.options.image_size
    for box in boxes:
        x, y, z = box.location
        assert y == pytest.approx(SCANNER_HEIGHT - 0.0747, abs=5e-2), 'stands on the ground'
        assert np.cos(box.rotation_y - np.arctan2(x, z) - box.alpha) == pytest.approx(1.0)
        assert -np.pi <= box.alpha <= np.pi
        assert 0 <= box.truncated <= 1
        left, top, right, bottom = box.box_2d
        assert 0 <= left < right <= width - 1
        assert 0 <= top < bottom <= height - 1
        middle = p2 @ (x, y - box.size_hwl[0] / 2, z, 1)
        if box.truncated == 0:
            assert left < middle[0] / middle[2] < right
            assert top < middle[1] / middle[2] < bottom
    assert min(box.truncated for box in boxes) == 0
    assert max(box.truncated for box in boxes) > 0
    assert {box.occluded for box in boxes} >= {0, 2}


def test_tracks_keep_their_identity(drive: SyntheticDrive) -> None:
    tracks: dict[int, list[Box]] = {}
    for frame in range(len(drive)):
        for box in drive.boxes(frame):
            assert box.frame == frame
            tracks.setdefault(box.track_id or 0, []).append(box)
    for boxes in tracks.values():
        assert len({(box.class_name, box.size_hwl) for box in boxes}) == 1
        places = np.array([box.location for box in boxes])
        steps = np.diff(places, axis=0) / np.diff([box.frame or 0 for box in boxes])[:, None]
        assert (np.linalg.norm(steps, axis=1) < 2.2).all()


def test_images_are_as_kittis(drive: SyntheticDrive) -> None:
    for camera, channels in ((0, 1), (1, 1), (2, 3), (3, 3)):
        image = drive.image(0, camera)
        assert (image.width, image.height, image.channels) == (414, 125, channels)
        pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert pixels is not None
        assert pixels.shape[:2] == (125, 414)
        assert 60 < pixels.mean() < 190
        assert pixels.std() > 30
    assert not np.array_equal(drive.picture(0, 2), drive.picture(0, 3))


def test_full_size_images_weigh_as_much_as_kittis() -> None:
    full = SyntheticDrive(SyntheticOptions(frames=1))
    assert 200_000 < len(full.image(0, 0).data) < 400_000
    assert 600_000 < len(full.image(0, 2).data) < 1_100_000
    assert 100_000 < len(full.scan(0).points) < 130_000
