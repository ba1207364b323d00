# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Projections: KITTI's three kinds of cameras, and lines that reach behind them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import camera, project

from kitti_ros2.drawing.annotate import projected_bounds
from kitti_ros2.drawing.projection import Projection
from kitti_ros2.messages.camera_info import encode_camera_info
from kitti_ros2.model.boxes import NEAR_M, cuboid_corners, project_corners
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.recording_frames import open_frames
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions

from scenes import solid  # isort: skip

DRIVE = SyntheticDrive(SyntheticOptions(frames=1))
RIG = DRIVE.calibration
POINTS = np.random.default_rng(0).uniform((4, -6, -2), (40, 6, 2), (200, 3))


@pytest.mark.parametrize('index', sorted(RIG.cameras))
def test_rectified_cameras_are_p_r0_tr(index):
    pixels, depth = project(Projection.of(RIG, index), POINTS)
    seen = np.column_stack([POINTS, np.ones(len(POINTS))]) @ DRIVE.projection(index).T
    np.testing.assert_allclose(pixels, seen[:, :2] / seen[:, 2:], atol=1e-8)
    np.testing.assert_allclose(depth, seen[:, 2], atol=1e-12)


def test_cameras_with_extrinsics_of_their_own():
    side = Transform(rotation_from_rpy(-np.pi / 2, 0.0, -np.pi / 2), np.array([0.1, -0.2, 0.3]))
    own = replace(RIG.cameras[2], cam_T_velo=side)
    rig = replace(RIG, cameras={**RIG.cameras, 2: own}, cam0_T_velo=None, r0_rect=None)
    pixels, depth = project(Projection.of(rig, 2), POINTS)
    seen = np.column_stack([side.apply(POINTS), np.ones(len(POINTS))]) @ own.p_rect.T
    front = seen[:, 2] > 0
    np.testing.assert_allclose(pixels[front], (seen[:, :2] / seen[:, 2:])[front], atol=1e-8)
    np.testing.assert_allclose(depth, seen[:, 2])


@pytest.mark.parametrize('index', sorted(RIG.cameras))
def test_unrectified_cameras_are_where_rectifying_finds_them(index):
    """The other way round, by OpenCV and the CameraInfo that goes with the images."""
    rig = replace(RIG, rectified=False)
    pixels, _ = project(Projection.of(rig, index), POINTS)
    info = encode_camera_info(rig, index, (1392, 512), 0, 'camera')
    k, r, p = info.k.reshape(3, 3), info.r.reshape(3, 3), info.p.reshape(3, 4)[:, :3]
    # OpenCV tells of each rectified pixel which raw one it comes from.
    maps = cv2.initUndistortRectifyMap(k, info.d, r, p, (1242, 375), cv2.CV_32FC1)
    rectified = project(Projection.of(RIG, index), POINTS)[0]
    seen = ((rectified > 0) & (rectified < [1241, 374])).all(axis=1)
    assert seen.sum() > 50
    u, v = rectified[seen].astype(np.float32).T[:, :, None]
    expected = np.hstack([cv2.remap(remap, u, v, cv2.INTER_LINEAR) for remap in maps])
    np.testing.assert_allclose(pixels[seen], expected, atol=0.05)


def test_a_lens_folds_nothing_back_into_the_image():
    """Beyond some angle the polynomial of the distortion turns back."""
    rig = replace(RIG, rectified=False)
    angles = np.radians(np.arange(0, 90))
    points = 20 * np.column_stack([np.cos(angles), -np.sin(angles), np.zeros_like(angles)])
    pixels, _ = project(Projection.of(rig, 0), points)
    seen = np.isfinite(pixels[:, 0])
    assert 30 < seen.sum() < 80
    assert (np.diff(pixels[seen, 0]) > 0).all()
    assert not seen[seen.argmin() :].any()


def test_what_is_behind_has_no_pixel():
    pixels, depth = project(
        camera(), np.array([[-5.0, 0, 0], [0, 1, 0], [np.nan, 0, 0], [5, 0, 0]])
    )
    assert np.isnan(pixels[:3]).all()
    assert np.isfinite(pixels[3]).all()
    assert depth[0] == -5
    assert project(camera(), np.empty((0, 3)))[0].shape == (0, 2)


@pytest.mark.parametrize(
    ('rig', 'index', 'reason'),
    [
        (RIG, 7, 'no calibration of camera 7 (there is: 0, 1, 2, 3)'),
        (replace(RIG, cam0_T_velo=None), 2, 'Tr_velo_to_cam'),
        (replace(RIG, r0_rect=None), 2, 'R0_rect'),
        (replace(RIG, cameras={2: replace(RIG.cameras[2], p_rect=np.zeros((3, 4)))}), 2, 'empty'),
        (
            replace(RIG, cameras={2: replace(RIG.cameras[2], p_rect=np.full((3, 4), np.nan))}),
            2,
            'finite',
        ),
        (
            replace(RIG, rectified=False, cameras={2: replace(RIG.cameras[2], k=None)}),
            2,
            'K and D of camera 2',
        ),
        (
            replace(RIG, rectified=False, cameras={2: replace(RIG.cameras[2], cam_T_cam0=None)}),
            2,
            'R and T of camera 2',
        ),
    ],
)
def test_what_a_calibration_lacks_is_named(rig, index, reason):
    with pytest.raises(ValueError, match='calibration') as caught:
        Projection.of(rig, index)
    assert reason in str(caught.value)


@pytest.mark.parametrize('rectified', [True, False])
@given(st.floats(0.1, 4), st.floats(0.1, 4))
def test_resized_images_keep_their_edges(rectified, scale_x, scale_y):
    """The image's edge is half a pixel from the middle of its first pixel."""
    projection = Projection.of(replace(RIG, rectified=rectified), 2)
    pixels, depth = project(projection, POINTS)
    other, same = project(projection.resized(scale_x, scale_y), POINTS)
    np.testing.assert_allclose(other + 0.5, (pixels + 0.5) * [scale_x, scale_y], atol=1e-6)
    np.testing.assert_array_equal(same, depth)


POSES = st.tuples(
    st.floats(-20, 20), st.floats(-20, 20), st.floats(-4, 4), st.floats(-3.2, 3.2)
)  # x, y, z, yaw


@given(POSES)
def test_bounds_are_those_of_the_corners(pose):
    x, y, z, yaw = pose
    corners = cuboid_corners([solid(x, y, z, yaw=yaw).cuboid])
    projection = camera()
    np.testing.assert_allclose(
        projected_bounds(corners, projection),
        project_corners(corners, projection.matrix),
        rtol=1e-6, atol=1e-6,
    )  # fmt: skip


PLACES = st.tuples(*[st.floats(-30, 30)] * 3)


@given(PLACES, PLACES)
def test_lines_are_cut_before_the_camera(start, end):
    ends = np.array([[start, end]])
    pieces, lines = camera().segments(ends)
    ahead = ends[0, :, 0] >= NEAR_M
    assert len(pieces) == len(lines) == ahead.any()
    for piece, place, seen in zip(pieces[:1].reshape(-1, 2), ends[0], ahead, strict=False):
        if seen:
            np.testing.assert_allclose(piece, project(camera(), place[None])[0][0], atol=1e-6)
        else:
            share = (NEAR_M - ends[0, 0, 0]) / (ends[0, 1, 0] - ends[0, 0, 0])
            cut = ends[0, 0] + share * (ends[0, 1] - ends[0, 0])
            expected = camera().pixels(camera().homogeneous(cut[None]))[0]
            np.testing.assert_allclose(piece, expected, rtol=1e-3, atol=1e-3)


def test_real_points_are_in_the_image(real_kitti):
    """As many as velodyne_reduced holds: 0 < u < W, 0 < v < H, 0.001 < depth < 100."""
    source = open_frames(real_kitti / 'object', ReadOptions())
    for number, expected in zip((0, 1, 2), (20285, 18630, 20210), strict=True):
        frame = source.frame(number, frozenset({'scan', 'image_2'}))
        (u, v), depth = (part.T for part in project(Projection.of(frame.calibration, 2),
            frame.points[:, :3]
        ))  # fmt: skip
        height, width = frame.images[2].shape[:2]
        inside = (u > 0) & (u < width) & (v > 0) & (v < height) & (depth > 0.001) & (depth < 100)
        assert inside.sum() == expected
