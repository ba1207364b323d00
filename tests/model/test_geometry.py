# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.geometry import (
    Transform,
    quaternion_to_rotation,
    rotation_from_rpy,
    rotation_to_quaternion,
    rotation_to_rpy,
)

ANGLES = st.floats(-3.14, 3.14)
PITCHES = st.floats(-1.5, 1.5)
METRES = st.floats(-1e4, 1e4)
TRANSFORMS = st.builds(
    lambda r, p, y, t: Transform(rotation_from_rpy(r, p, y), np.array(t)),
    ANGLES,
    PITCHES,
    ANGLES,
    st.tuples(METRES, METRES, METRES),
)


@given(ANGLES, PITCHES, ANGLES)
def test_rpy_and_back(roll, pitch, yaw):
    np.testing.assert_allclose(
        rotation_to_rpy(rotation_from_rpy(roll, pitch, yaw)), (roll, pitch, yaw), atol=1e-9
    )


@given(ANGLES, PITCHES, ANGLES)
def test_quaternion_and_back(roll, pitch, yaw):
    rotation = rotation_from_rpy(roll, pitch, yaw)
    quaternion = rotation_to_quaternion(rotation)
    assert np.linalg.norm(quaternion) == pytest.approx(1)
    assert quaternion[3] >= 0
    np.testing.assert_allclose(quaternion_to_rotation(quaternion), rotation, atol=1e-12)


@pytest.mark.parametrize('axis', range(3))
def test_half_turns_have_a_quaternion(axis):
    diagonal = -np.ones(3)
    diagonal[axis] = 1
    quaternion = rotation_to_quaternion(np.diag(diagonal))
    np.testing.assert_allclose(np.abs(quaternion), np.eye(4)[axis], atol=1e-12)


def test_rpy_is_rz_ry_rx():
    yawed = rotation_from_rpy(0, 0, np.pi / 2)
    np.testing.assert_allclose(yawed @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    pitched = rotation_from_rpy(0, np.pi / 2, 0)
    np.testing.assert_allclose(pitched @ [1, 0, 0], [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(
        rotation_from_rpy(0.1, 0.2, 0.3),
        rotation_from_rpy(0, 0, 0.3) @ rotation_from_rpy(0, 0.2, 0) @ rotation_from_rpy(0.1, 0, 0),
        atol=1e-15,
    )


@given(TRANSFORMS)
def test_inverse_undoes(a_t_b):
    points = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(a_t_b.inverse().apply(a_t_b.apply(points)), points, atol=1e-8)


@given(TRANSFORMS, TRANSFORMS)
def test_composition_is_one_after_the_other(a_t_b, b_t_c):
    points = np.array([[1.0, -2.0, 0.5]])
    np.testing.assert_allclose(
        (a_t_b @ b_t_c).apply(points), a_t_b.apply(b_t_c.apply(points)), atol=1e-8
    )


@given(TRANSFORMS)
def test_matrix_and_quaternion_hold_the_same_transform(a_t_b):
    again = Transform.from_matrix(a_t_b.matrix())
    np.testing.assert_array_equal(again.matrix(), a_t_b.matrix())
    turned = Transform.from_quaternion(a_t_b.quaternion(), a_t_b.translation)
    np.testing.assert_allclose(turned.matrix(), a_t_b.matrix(), atol=1e-12)


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r'\(3, 3\)'):
        Transform(np.eye(4), np.zeros(3))


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('size', [0.0, np.nan, np.inf, 1e300, 1e-300])
def test_a_quaternion_without_a_length_is_no_rotation(size):
    assert np.isnan(quaternion_to_rotation(np.full(4, size))).all()
