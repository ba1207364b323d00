# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Velocities from places that scatter: a moving vehicle has one at each moment, a standing none."""

from __future__ import annotations

import numpy as np
import pytest

from kitti_ros2.importer.bag_poses import SLOWEST_FIX_M_S, DerivedVelocities

SECONDS, START_NS = 12, 1_690_000_000_000_000_000
MOST_NS = 2_500_000_000


def velocities(rate_hz, scatter_m, speed):
    """East and north, each 0.1 s to the last fix, of a vehicle that drives to the east."""
    times = np.arange(0, SECONDS, 1 / rate_hz)
    places = np.column_stack([speed * times, 0 * times, 0 * times])
    places += np.random.default_rng(7).normal(0, scatter_m, places.shape)
    stamps = START_NS + (times * 1e9).astype(np.int64)
    derived = DerivedVelocities(stamps, places, MOST_NS, SLOWEST_FIX_M_S)
    moments = range(START_NS, int(stamps[-1]) + 1, 100_000_000)
    return np.array([derived.at(moment)[:2] for moment in moments])


@pytest.mark.parametrize(
    ('rate_hz', 'scatter_m', 'speed', 'off'),
    [(1, 1.0, 8.0, 4.0), (10, 0.3, 8.0, 2.5), (10, 0.1, 1.5, 0.8), (5, 0.5, 5.0, 2.6)],
)
def test_a_vehicle_that_drives_never_stands(rate_hz, scatter_m, speed, off):
    made = velocities(rate_hz, scatter_m, speed)
    assert made.any(axis=1).all()
    assert np.linalg.norm(made - [speed, 0], axis=1).max() < off


@pytest.mark.parametrize(('rate_hz', 'scatter_m'), [(1, 1.0), (10, 0.3), (100, 0.1)])
def test_one_that_stands_has_none(rate_hz, scatter_m):
    assert not velocities(rate_hz, scatter_m, 0.0).any()


@pytest.mark.parametrize('speed', [0.0, 8.0])
def test_a_place_far_off_its_neighbours_is_passed_over(speed):
    times = np.arange(0, SECONDS, 0.1)
    places = np.column_stack([speed * times, 0 * times, 0 * times])
    places[30, 1] += 300.0
    kept = [*range(60), *range(75, len(times))]
    stamps = START_NS + (times[kept] * 1e9).astype(np.int64)
    derived = DerivedVelocities(stamps, places[kept], MOST_NS, SLOWEST_FIX_M_S)
    found = np.array([derived.at(stamp)[:2] for stamp in stamps.tolist()])
    np.testing.assert_allclose(found, np.tile([speed, 0], (len(kept), 1)), atol=1e-6)


@pytest.mark.parametrize(('count', 'known'), [(0, False), (1, False), (2, True), (4, True)])
def test_few_places_tell_a_velocity_from_two_on(count, known):
    stamps = START_NS + np.arange(count) * 100_000_000
    places = np.arange(count)[:, None] * np.array([[0.8, 0.0, 0.0]])
    derived = DerivedVelocities(stamps, places, MOST_NS, SLOWEST_FIX_M_S)
    assert (derived.at(START_NS) is not None) == known
