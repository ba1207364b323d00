# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Chains of links at any stamp: composed, interpolated link by link, unknown in gaps."""

from __future__ import annotations

import numpy as np
import pytest

from kitti_ros2.messages.moving_tree import (
    MAX_GAP_NS,
    MovingTree,
    PoseTrack,
    ProductTrack,
    TransformSeries,
)
from kitti_ros2.model.errors import MissingDataError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

STEP = 100_000_000
BASE_T_LIDAR = Transform(rotation_from_rpy(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))


def pose(x, yaw=0.0):
    return Transform(rotation_from_rpy(0, 0, yaw), np.array([x, 0.0, 0.0]))


def tree():
    odom = PoseTrack([0, STEP, 2 * STEP], [pose(0), pose(1, 0.2), pose(2, 0.4)])
    far = 2 * STEP + MAX_GAP_NS + 1
    corrections = PoseTrack([0, 2 * STEP, far], [pose(10, 1.0), pose(10, 2.0), pose(10, 2.0)])
    moving = {('map', '/odom'): corrections, ('odom', 'base'): odom}
    return MovingTree([('base', 'lidar', BASE_T_LIDAR)], moving)


@pytest.mark.parametrize('share', [0, 0.25, 0.5, 1])
def test_each_link_is_interpolated_by_itself_and_then_composed(share):
    stamp = round(share * STEP)
    expected = pose(10, 1.0 + share / 2) @ pose(share, 0.2 * share) @ BASE_T_LIDAR
    (found,) = tree().transforms('map', 'lidar', np.array([stamp]))
    np.testing.assert_allclose(found.matrix(), expected.matrix(), rtol=0, atol=1e-12)
    (back,) = tree().transforms('lidar', '/map', np.array([stamp]))
    np.testing.assert_allclose((found @ back).matrix(), np.eye(4), rtol=0, atol=1e-12)


def test_a_link_that_is_not_known_is_named_and_no_other_stamp_is_affected():
    stamps = np.array([-1, 0, 2 * STEP, 2 * STEP + 1])
    found = tree().transforms('map', 'base', stamps)
    assert [each is not None for each in found] == [False, True, True, False]
    assert tree().covers('map', 'base', stamps).tolist() == [False, True, True, False]
    reason = tree().reason('map', 'base', 2 * STEP + 1)
    assert 'map -> odom and odom -> base has none before and after it' in reason
    assert 'at most 1.5 s apart' in reason


def test_static_links_need_no_stamp():
    (found,) = tree().transforms('base', 'lidar', np.array([-5]))
    assert np.array_equal(found.matrix(), BASE_T_LIDAR.matrix())
    assert tree().moving_between('map', 'lidar') == [('map', 'odom'), ('odom', 'base')]


def test_frames_that_nothing_joins_are_refused():
    assert not tree().joins('map', 'camera')
    with pytest.raises(MissingDataError, match='there is no frame camera'):
        tree().transforms('map', 'camera', np.array([0]))


def test_a_chain_has_the_stamps_of_its_last_link_where_all_are_known():
    track = tree().track('map', 'lidar')
    assert track.stamps_ns.tolist() == [0, STEP, 2 * STEP]
    product = ProductTrack(pose(5), track, pose(0, 0.5))
    (found,) = product.at(np.array([0]))
    expected = pose(5) @ pose(10, 1.0) @ BASE_T_LIDAR @ pose(0, 0.5)
    np.testing.assert_allclose(found.matrix(), expected.matrix(), rtol=0, atol=1e-12)


def test_a_series_gives_back_its_transforms():
    series = TransformSeries()
    for x in range(5):
        series.append((x, 0.0, 0.0, *pose(0, 0.1 * x).quaternion()))
    assert len(series) == 5
    assert [each.translation[0] for each in series] == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(series[3].matrix(), pose(3, 0.3).matrix(), atol=1e-12)
    with pytest.raises(IndexError):
        series[5]
