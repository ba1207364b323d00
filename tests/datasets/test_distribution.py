# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Histograms with moments that are computed value by value, and merged."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.datasets.recording_statistics import Distribution

EDGES = (0.0, 1.0, 5.0, 20.0)
VALUES = st.lists(st.floats(-10, 1e4), max_size=60)


def made_of(values):
    found = Distribution(EDGES)
    for value in values:
        found.add(value)
    return found


def check(found, values):
    assert found.count == len(values) == sum(found.counts)
    if not values:
        assert math.isnan(found.mean)
        assert math.isnan(found.deviation)
        return
    clipped = np.maximum(values, EDGES[0])
    assert found.counts == np.histogram(clipped, [*EDGES, np.inf])[0].tolist()
    assert found.mean == pytest.approx(np.mean(values), abs=1e-9)
    assert found.deviation == pytest.approx(np.std(values), abs=1e-6)
    assert (found.least, found.greatest) == (min(values), max(values))


@given(VALUES)
def test_it_is_what_numpy_computes_of_all_values(values):
    check(made_of(values), values)


@given(VALUES, VALUES)
def test_merging_is_adding_all(one, other):
    found = made_of(one)
    found.merge(made_of(other))
    check(found, one + other)


@given(VALUES)
def test_values_that_are_not_finite_are_left_out(values):
    check(made_of([math.nan, *values, math.inf]), values)


def test_bins_are_named_by_their_edges():
    assert Distribution((0, 0.25, 80)).names == ['0-0.25', '0.25-80', '80+']


def test_bins_that_differ_are_not_merged():
    with pytest.raises(ValueError, match='zip'):
        made_of([1.0]).merge(Distribution((0.0, 1.0)))
