# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rectified images against projections written out here, which share nothing with OpenCV's."""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.messages.camera_info import EQUIDISTANT, CameraModel, lens_model
from kitti_ros2.messages.rectified_cameras import (
    Rectifier,
    has_lens_of_larger_image,
    needs_rectifying,
)
from kitti_ros2.model.geometry import rotation_from_rpy

SIZE = (640, 400)
K = np.array([[350.0, 0, 322.3], [0, 347.0, 197.6], [0, 0, 1]])
R = rotation_from_rpy(0.02, -0.03, 0.015)
P = np.array([[300.0, 0, 310.0, -160.0], [0, 300.0, 205.0, 3.0], [0, 0, 1, 0.002]])
"""Its fourth column, a stereo offset, moves no pixel."""

CAMERAS = [
    ('plumb_bob', [-0.28, 0.09, 0.0011, -0.0008]),
    ('plumb_bob', [-0.28, 0.09, 0.0011, -0.0008, -0.012]),
    ('rational_polynomial', [0.6, 0.05, 0.0006, -0.0004, 0.003, 0.95, 0.2, 0.01]),
    ('equidistant', [-0.02, 0.006, -0.004, 0.0008]),
    ('fisheye', [0.03, -0.01, 0.004, -0.0006]),
    ('kannala_brandt', [0.03, -0.01, 0.004, -0.0006]),
    ('EQUIDISTANT', [0.03, -0.01, 0.004, -0.0006]),
    ('radtan', [-0.28, 0.09, 0.0011, -0.0008]),
    ('brown_conrady', [-0.28, 0.09, 0.0011, -0.0008, -0.012]),
    ('none', [0.0, 0, 0]),
    ('', []),
    ('inverse_brown_conrady', [0.0] * 5),
]


def see(points: np.ndarray, model: str, d: list[float]) -> np.ndarray:
    """(N, 2) pixels of the image as it comes, of (N, 3) points of the camera's frame."""
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r = np.hypot(x, y)
    if lens_model(model, np.array(d)) == EQUIDISTANT:
        theta = np.arctan(r)
        bent = theta * (1 + sum(k * theta ** (2 * i + 2) for i, k in enumerate(d)))
        x, y = x * bent / r, y * bent / r
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = [*d, *[0] * 8][:8]
        radial = (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
        x, y = (
            x * radial + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2),
            y * radial + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y,
        )
    return np.column_stack([x, y, np.ones_like(x)]) @ K[:2].T


def project(points: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of the rectified image, of (N, 3) points of the camera's frame."""
    seen = points @ R.T @ P[:, :3].T
    return seen[:, :2] / seen[:, 2:]


def look(pixels: np.ndarray, model: str, d: list[float]) -> np.ndarray:
    """(N, 3) points of the camera's frame, of (N, 2) pixels as they come: see, undone by Newton."""
    points = np.column_stack([(pixels - K[:2, 2]) / [K[0, 0], K[1, 1]], np.ones(len(pixels))])
    step = 1e-6
    for _ in range(6):
        here = see(points, model, d)
        by_x = (see(points + np.array([step, 0, 0]), model, d) - here) / step
        by_y = (see(points + np.array([0, step, 0]), model, d) - here) / step
        jacobian = np.stack([by_x, by_y], axis=2)
        points[:, :2] += np.linalg.solve(jacobian, (pixels - here)[..., None])[..., 0]
    np.testing.assert_allclose(see(points, model, d), pixels, atol=1e-6)
    return points


def dots(points: np.ndarray, model: str, d: list[float], dtype: type) -> np.ndarray:
    """(H, W) the image as it comes, black but for each point's dot, round when rectified."""
    picture = np.zeros(SIZE[::-1])
    v, u = np.mgrid[-9:10, -9:10]
    for corner, middle in zip(
        np.rint(see(points, model, d)).astype(int), project(points), strict=True
    ):
        near = corner + np.column_stack([u.ravel(), v.ravel()])
        off = project(look(near.astype(float), model, d)) - middle
        picture[near[:, 1], near[:, 0]] += np.exp(-(off**2).sum(axis=1) / (2 * 2.0**2))
    return np.rint(picture * np.iinfo(dtype).max * 0.99).astype(dtype)


def middles(picture: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(N, 2) centres of mass about each of (N, 2) places."""
    v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
    found = []
    for x, y in np.rint(near).astype(int):
        part = np.s_[y - 9 : y + 10, x - 9 : x + 10]
        weight = picture[part].astype(float)
        found.append([(weight * u[part]).sum(), (weight * v[part]).sum()] / weight.sum())
    return np.array(found)


def rays() -> np.ndarray:
    """(N, 3) points of the camera's frame all over its view, 40 px and more apart."""
    y, x = np.mgrid[-0.5:0.5:6j, -0.8:0.8:8j]
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) * 7.0


def rectifier_of(k, d, r, p, model, size):
    d = np.array(d, np.float64)
    return Rectifier(CameraModel('camera', size, k, d, r, p, lens_model(model, d)))


class TestRectifier:
    @pytest.mark.one_in(3)
    @pytest.mark.parametrize(('model', 'd'), CAMERAS)
    @pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
    def test_points_land_where_p_and_r_project_them(self, model, d, dtype):
        points = rays()
        came = see(points, model, d)
        assert came.min() > 12
        assert (came < np.array(SIZE) - 12).all()
        expected = project(points)
        assert np.abs(came - expected).max() > 20
        rectifier = rectifier_of(K, d, R, P, model, SIZE)
        rectified = rectifier.apply(dots(points, model, d, dtype))
        assert rectified.dtype == dtype
        assert rectified.shape == SIZE[::-1]
        np.testing.assert_allclose(middles(rectified, expected), expected, atol=0.05)

    def test_colours_are_rectified_alike(self):
        model, d = CAMERAS[1]
        grey = dots(rays(), model, d, np.uint8)
        colours = np.dstack([grey, grey[::-1], 255 - grey])
        rectifier = rectifier_of(K, d, R, P, model, SIZE)
        rectified = rectifier.apply(colours)
        assert rectified.shape == colours.shape
        for channel in range(3):
            single = rectifier.apply(np.ascontiguousarray(colours[..., channel]))
            np.testing.assert_array_equal(rectified[..., channel], single)

    def test_rows_may_be_padded(self):
        model, d = CAMERAS[1]
        padded = np.random.default_rng(0).integers(0, 256, (400, 700, 3), np.uint8)
        rectifier = rectifier_of(K, d, R, P, model, SIZE)
        view = padded[:, :640]
        np.testing.assert_array_equal(rectifier.apply(view), rectifier.apply(view.copy()))

    def test_it_is_black_where_the_camera_did_not_look(self):
        wide = P.copy()
        wide[0, 0] = wide[1, 1] = 100
        rectifier = rectifier_of(K, np.zeros(5), np.eye(3), wide, 'plumb_bob', SIZE)
        rectified = rectifier.apply(np.full((400, 640), 77, np.uint8))
        assert rectified[205, 310] == 77
        assert rectified[0, 0] == rectified[-1, -1] == 0

    @given(st.integers(0, 100), st.sampled_from([np.uint8, np.uint16]))
    @settings(deadline=None, max_examples=20)
    def test_a_rectified_image_stays_as_it_is(self, seed, dtype):
        rng = np.random.default_rng(seed)
        pixels = rng.integers(0, np.iinfo(dtype).max, (20, 30), dtype)
        p = np.column_stack([K, [5.0, 1.0, 0.0]])
        rectifier = rectifier_of(K, np.zeros(5), np.eye(3), p, 'plumb_bob', (30, 20))
        np.testing.assert_array_equal(rectifier.apply(pixels), pixels)

    def test_an_image_of_another_size_is_refused(self):
        rectifier = rectifier_of(K, np.zeros(5), R, P, 'plumb_bob', SIZE)
        with pytest.raises(ValueError, match='400 x 640 pixels; its camera_info is of 640 x 400'):
            rectifier.apply(np.zeros((640, 400), np.uint8))

    @pytest.mark.parametrize('model', ['plumb bob', 'omni', 'inverse_brown_conrady'])
    def test_an_unknown_model_is_named(self, model):
        with pytest.raises(ValueError, match=f"unknown distortion model '{model}'.*plumb_bob"):
            rectifier_of(K, np.full(5, 0.1), R, P, model, SIZE)

    @pytest.mark.parametrize(
        ('model', 'count', 'said'),
        [
            ('plumb_bob', 6, 'D has 6 numbers; plumb_bob has 4 or 5 or 8 or 12 or 14'),
            ('rational_polynomial', 9, 'D has 9 numbers; rational_polynomial has 4 or 5 or 8 or'),
            ('equidistant', 5, 'D has 5 numbers; equidistant has 4'),
            ('fisheye', 0, 'D has 0 numbers; equidistant has 4'),
        ],
    )
    def test_a_wrong_count_is_told(self, model, count, said):
        with pytest.raises(ValueError, match=said):
            rectifier_of(K, np.full(count, 0.01), R, P, model, SIZE)

    @pytest.mark.parametrize(
        ('model', 'd', 'same_as'),
        [
            ('rational_polynomial', [*CAMERAS[2][1], *[0.0] * 4], CAMERAS[2]),
            ('rational_polynomial', [*CAMERAS[2][1], *[0.0] * 6], CAMERAS[2]),
            ('plumb_bob', CAMERAS[2][1], CAMERAS[2]),
            ('plumb_bob', [], ('plumb_bob', [0.0] * 5)),
            ('rational_polynomial', [], ('plumb_bob', [0.0] * 5)),
        ],
    )
    def test_models_of_opencv_may_be_longer_or_empty(self, model, d, same_as):
        pixels = np.random.default_rng(0).integers(0, 256, SIZE[::-1], np.uint8)
        found = rectifier_of(K, d, R, P, model, SIZE).apply(pixels)
        other, numbers = same_as
        expected = rectifier_of(K, numbers, R, P, other, SIZE).apply(pixels)
        np.testing.assert_array_equal(found, expected)

    @pytest.mark.parametrize('name', ['K', 'R', 'P'])
    @pytest.mark.parametrize('value', [0.0, np.nan, np.inf])
    def test_a_camera_without_calibration_is_refused(self, name, value):
        numbers = {'K': K, 'R': R, 'P': P}
        numbers[name] = np.full_like(numbers[name], value)
        k, r, p = numbers.values()
        with pytest.raises(ValueError, match=f'{name} is .* not calibrated'):
            rectifier_of(k, np.zeros(5), r, p, 'plumb_bob', SIZE)

    @pytest.mark.parametrize(
        'size', [(0, 400), (640, 40000), (30000, 30000), (2**32 - 1, 2**32 - 1)]
    )
    def test_an_impossible_size_is_refused(self, size):
        with pytest.raises(ValueError, match=f'an image of {size[0]} x {size[1]} pixels'):
            rectifier_of(K, np.zeros(5), R, P, 'plumb_bob', size)


class TestNeedsRectifying:
    @pytest.mark.parametrize('d', [[], [0.0] * 4, [0.0] * 5, np.zeros(8)])
    def test_a_rectified_camera_does_not(self, d):
        p = np.column_stack([K, [-380.0, 0, 0]])
        assert not needs_rectifying(K, d, p)
        assert not needs_rectifying(K.ravel(), d, p.ravel())

    @pytest.mark.parametrize(
        ('d', 'p'),
        [
            ([0, 0, 0, 0, 1e-6], np.column_stack([K, np.zeros(3)])),
            ([], P),
            ([], np.zeros((3, 4))),
        ],
    )
    def test_any_other_does(self, d, p):
        assert needs_rectifying(K, d, p)


def lens_at(x: float, y: float) -> np.ndarray:
    """K with a principal point, in parts of the size."""
    return np.array([[480.0, 0, x * SIZE[0]], [0, 482.0, y * SIZE[1]], [0, 0, 1]])


class TestLensOfLargerImage:
    D = np.array([-0.3, 0.11, 0.0005, -0.0003, -0.01])
    PLACES = ((0.5, 0.5), (0.54, 0.56), (0.56, 0.62), (0.62, 0.55), (0.45, 0.6), (0.42, 0.4))

    def test_kitti_s_raw_cameras_have_that_of_a_larger_image_than_the_rectified(self, real_kitti):
        lines = (real_kitti / 'raw/2011_09_26/calib_cam_to_cam.txt').read_text().splitlines()
        found = dict(line.split(': ', 1) for line in lines)
        for index in range(4):
            d, s, k, r, p = (
                np.array(found[f'{name}_0{index}'].split(), float)
                for name in ('D', 'S', 'K', 'R_rect', 'P_rect')
            )
            size = tuple(int(float(each)) for each in found[f'S_rect_0{index}'].split())
            matrices = k.reshape(3, 3), d, r.reshape(3, 3), p.reshape(3, 4)
            assert has_lens_of_larger_image(CameraModel('camera', size, *matrices))
            whole = int(s[0]), int(s[1])
            assert not has_lens_of_larger_image(CameraModel('camera', whole, *matrices))

    @pytest.mark.parametrize('place', PLACES)
    @pytest.mark.parametrize('alpha', [-1, 0, 0.5, 1])
    @pytest.mark.parametrize('flags', [0, cv2.CALIB_ZERO_DISPARITY])
    def test_stereo_calibrations_have_that_of_their_images(self, place, alpha, flags):
        for other, yaw in product(self.PLACES, (-0.02, 0.03)):
            ks = lens_at(*place), lens_at(*other)
            motion = rotation_from_rpy(0.01, yaw, 0.005), np.array([[-0.12], [0.002], [0.003]])
            lenses = ks[0], self.D, ks[1], self.D
            r1, r2, p1, p2, *_ = cv2.stereoRectify(*lenses, SIZE, *motion, alpha=alpha, flags=flags)
            for k, r, p in zip(ks, (r1, r2), (p1, p2), strict=True):
                assert not has_lens_of_larger_image(CameraModel('', SIZE, k, self.D, r, p))

    @pytest.mark.parametrize('place', PLACES)
    @pytest.mark.parametrize('alpha', [0, 0.5, 1])
    @pytest.mark.parametrize('centred', [True, False])
    def test_calibrations_of_one_camera_have_that_of_their_images(self, place, alpha, centred):
        k = lens_at(*place)
        own, _ = cv2.getOptimalNewCameraMatrix(k, self.D, SIZE, alpha, centerPrincipalPoint=centred)
        for k_rect in (own, k):
            p = np.column_stack([k_rect, np.zeros(3)])
            assert not has_lens_of_larger_image(CameraModel('', SIZE, k, self.D, np.eye(3), p))

    def test_a_lens_that_is_unknown_is_none_of_a_larger_image(self):
        p = np.column_stack([lens_at(0.5, 0.5), np.zeros(3)])
        camera = CameraModel('', SIZE, lens_at(0.6, 0.6), self.D, R, p)
        assert has_lens_of_larger_image(camera)
        odd = CameraModel('', SIZE, camera.k, self.D, R, p, model='odd')
        assert not has_lens_of_larger_image(odd)
