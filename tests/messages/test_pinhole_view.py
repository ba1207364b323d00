# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The pinhole view of a fisheye shows each point where its P projects it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import fisheye_drive
import numpy as np
import pytest

import kitti_ros2
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import encode_camera_info, encode_static, static_links
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.messages.pinhole_view import pinhole_view
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.lenses import MeiLens
from kitti_ros2.model.samples import Calibration
from kitti_ros2.options.read import ReadOptions

from builders import seen_by  # isort: skip

FISHEYE_IMAGE = 'data_2d_raw/2013_05_28_drive_0003_sync/image_02/data_rgb/0000000000.png'
SCAN = 'data_3d_raw/2013_05_28_drive_0000_sync/velodyne_points/data/0000001134.bin'
BOTH = pytest.mark.parametrize('index', [2, 3])


def calibration_of(index, **changes):
    turn = Transform(fisheye_drive.LEFT, np.array([0.1, -0.2, 0.3]))
    camera = replace(fisheye_drive.fisheye(index, turn), **changes)
    return Calibration({index: camera}, np.eye(3), turn, Transform.identity())


def mei_pixels(camera, points):
    """(N, 2) pixels of (N, 3) points of the camera, as C. Mei's model is written; NaN unseen."""
    xi, (k1, k2, p1, p2) = camera.lens.xi, camera.lens.d
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    x, y = (unit[:, :2] / (unit[:, 2:] + xi)).T
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    bent_y = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    homogeneous = np.column_stack([bent_x, bent_y, np.ones(len(x))])
    pixels = homogeneous @ camera.p_rect[:2, :3].T
    return np.where(unit[:, 2:] > -1 / xi, pixels, np.nan)


def through(p, points):
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ p.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def sources_of(view, size):
    """(H, W, 2) the pixels of the fisheye that a view shows, by images of their coordinates."""
    columns, rows = np.meshgrid(*map(np.arange, size))
    return np.stack([view.of((each * 32).astype(np.uint16)) / 32 for each in (columns, rows)], -1)


def assert_pixels_show_their_rays(calibration, index):
    camera, view = calibration.cameras[index], pinhole_view(calibration, index)
    sources = sources_of(view, camera.size)
    columns, rows = np.meshgrid(*map(np.arange, view.size))
    pixels = np.stack([columns, rows, np.ones_like(rows)], -1).reshape(-1, 3)
    p = view.calibration.cameras[index].p_rect
    rays = pixels @ np.linalg.inv(p[:, :3]).T
    expected = mei_pixels(camera, rays)
    assert np.isfinite(expected).all()
    assert np.abs(sources.reshape(-1, 2) - expected).max() < 0.06  # OpenCV rounds to 1/32


@BOTH
def test_every_pixel_shows_its_ray(index):
    assert_pixels_show_their_rays(calibration_of(index), index)


@BOTH
def test_a_wall_is_seen_as_by_a_pinhole(index):
    view = pinhole_view(calibration_of(index), index)
    picture = view.of(fisheye_drive.fisheye_image(index))
    (focal, _, u, _), (_, _, v, _) = view.calibration.cameras[index].p_rect[:2]
    columns, rows = np.meshgrid(*map(np.arange, view.size))
    expected = fisheye_drive.brightness((columns - u) / focal, (rows - v) / focal)
    assert np.abs(picture - expected[..., None]).max() < 2


@BOTH
def test_its_middle_has_the_resolution_of_the_fisheye(index):
    """And nowhere less: no detail is lost or aliased."""
    calibration = calibration_of(index)
    view = pinhole_view(calibration, index)
    steps = [
        np.linalg.norm(np.diff(sources_of(view, fisheye_drive.SIZE), axis=axis), axis=-1)
        for axis in (0, 1)
    ]
    width, height = view.size
    middle = [each[height // 2 - 8 : height // 2 + 8, width // 2 - 8 : width // 2 + 8].mean()
              for each in steps]  # fmt: skip
    np.testing.assert_allclose(middle, 1, atol=0.01)
    assert max(each.max() for each in steps) < 1.07  # of 1/32


@BOTH
def test_its_camera_info_is_that_of_a_pinhole_in_the_fisheyes_own_frame(index):
    view = pinhole_view(calibration_of(index), index)
    info = encode_camera_info(view.calibration, index, view.size, 0, 'a_frame')
    assert (info.width, info.height) == view.size
    assert info.distortion_model == 'plumb_bob'
    assert info.d.tolist() == [0.0] * 5
    np.testing.assert_array_equal(info.r.reshape(3, 3), np.eye(3))
    p = info.p.reshape(3, 4)
    np.testing.assert_array_equal(info.k.reshape(3, 3), p[:, :3])
    assert p[:, 3].tolist() == [0.0] * 3
    assert p[0, 0] == p[1, 1]  # square pixels
    assert p[:2, 2].tolist() == [(view.size[0] - 1) / 2, (view.size[1] - 1) / 2]
    assert np.degrees(2 * np.arctan(view.size[0] / 2 / p[0, 0])) == pytest.approx(100, abs=3)


def test_images_of_any_depth_and_shape():
    calibration = calibration_of(2, size=(400, 240))
    view = pinhole_view(calibration, 2)
    assert view.size == (288, 176)
    for dtype in (np.uint8, np.uint16):
        grey = np.full((240, 400), 200, dtype)
        assert view.of(grey).dtype == dtype
        assert view.of(grey).shape == (176, 288)


def test_rays_that_the_lens_does_not_see_are_black():
    narrow = MeiLens(2.2, np.array([-4.5, 0.0, 0.0, 0.0]))
    view = pinhole_view(calibration_of(2, lens=narrow), 2)
    picture = view.of(np.full(fisheye_drive.SIZE[::-1], 200, np.uint8))
    assert picture[0, 0] == 0
    assert picture[view.size[1] // 2, view.size[0] // 2] == 200


def test_an_image_of_another_size_is_refused():
    view = pinhole_view(calibration_of(2), 2)
    with pytest.raises(ValueError, match='200x100 pixels; the fisheye is calibrated for 400x400'):
        view.of(np.zeros((100, 200), np.uint8))


@pytest.mark.parametrize('focal', [1e-3, 1e9])
def test_impossible_focal_lengths_are_refused(focal):
    k = np.array([[focal, 0, 203, 0], [0, focal, 198, 0], [0, 0, 1, 0]])
    with pytest.raises(ValueError, match='focal length has no pinhole view'):
        pinhole_view(calibration_of(2, p_rect=k), 2)


def test_a_camera_without_a_lens_is_refused():
    with pytest.raises(ValueError, match='no pinhole view'):
        pinhole_view(calibration_of(2, lens=None), 2)


# Real files of KITTI-360.


@pytest.fixture(scope='module')
def real_rig(real_360):
    return open_recording(real_360, ReadOptions(sequence='0000')).calibration(1134)


@BOTH
def test_every_pixel_of_the_real_views_shows_its_ray(real_rig, index):
    assert pinhole_view(real_rig, index).size == (992, 992)
    assert_pixels_show_their_rays(real_rig, index)


@BOTH
def test_real_points_land_where_the_fisheye_sees_them(real_360, real_rig, index):
    """By TF and P alone, 0.1 px from MEI's pixel after its distortion is undone."""
    points = kitti_ros2.read_scan(real_360 / SCAN)[:, :3].astype(np.float64)
    view = pinhole_view(real_rig, index)
    frame = FrameNames().camera(index)
    info = encode_camera_info(view.calibration, index, view.size, 0, frame)
    static = encode_static(static_links(real_rig, Transform.identity(), FrameNames()), 0)
    seen = seen_by(static, info, points)
    ahead = seen[:, 2] > 0.1
    pixels = through(info.p.reshape(3, 4), seen[ahead])
    inside = ((pixels >= 0) & (pixels <= np.array(view.size) - 1)).all(axis=1)
    pixels, seen = pixels[inside], seen[ahead][inside]
    assert len(pixels) > 20000
    camera = real_rig.cameras[index]
    bent = mei_pixels(camera, camera.cam_T_velo.apply(points[ahead][inside]))
    columns, rows = np.rint(pixels).astype(int).T
    sources = sources_of(view, camera.size)[rows, columns]
    # The pixel beside a point is at most 0.71 px of the view away, which magnifies.
    assert np.abs(sources - bent).max() < 0.75
    rays = camera.lens.rays((bent - camera.p_rect[:2, 2]) / np.diag(camera.p_rect[:2, :2]))
    undone = through(info.p.reshape(3, 4), rays)
    assert np.abs(undone - pixels).max() < 0.1


def edge_below(picture, columns, rows):
    """(N, 2) the steepest place from bright to dark in columns, between rows, to a fraction."""
    grey = cv2.GaussianBlur(picture.astype(np.float64), (0, 0), 1.5)
    found = []
    for column in columns:
        fall = -np.diff(grey[rows, column])
        at = int(fall.argmax())
        if 0 < at < len(fall) - 1:
            before, top, after = fall[at - 1 : at + 2]
            shift = (before - after) / (2 * (before - 2 * top + after))
            found.append((column, rows.start + at + 0.5 + shift))
    return np.array(found)


def off_line(edge):
    """Pixels that points are off their line, at 95 % of them."""
    line = np.polyfit(*edge.T, 1)
    off = np.abs(np.polyval(line, edge[:, 0]) - edge[:, 1])
    return float(np.percentile(off, 95))


def test_the_edge_of_a_real_road_is_straight(real_360, real_rig):
    """A kerb that crosses the image: 13 px off a line in the fisheye, within one in the view."""
    image = cv2.imread(str(real_360 / FISHEYE_IMAGE), cv2.IMREAD_GRAYSCALE)
    view = pinhole_view(real_rig, 2)
    straight = edge_below(view.of(image), range(10, 860, 5), slice(595, 625))
    assert len(straight) > 150
    assert off_line(straight) < 1.0
    sources = sources_of(view, image.shape[::-1])
    columns, rows = np.rint(straight).astype(int).T
    assert off_line(sources[rows, columns]) > 10
