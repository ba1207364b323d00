# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ordered map: the same results as map, whatever the workers and batches; never far ahead."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.files.workers import ordered_map


@given(st.lists(st.integers(), max_size=60), st.integers(1, 4), st.integers(1, 9))
def test_it_is_map(items, workers, batch):
    assert list(ordered_map(str, items, workers, batch)) == [*map(str, items)]


@pytest.mark.parametrize('batch', [1, 8])
def test_it_takes_a_few_batches_ahead_only(batch):
    taken = []
    results = ordered_map(lambda item: item, (taken.append(n) or n for n in range(1000)), 1, batch)
    assert next(results) == 0
    assert len(taken) <= 5 * batch
    results.close()


def test_an_error_comes_in_its_place():
    results = ordered_map(lambda item: 1 // item, [1, 1, 0, 1], 1, 2)
    assert next(results) == 1
    with pytest.raises(ZeroDivisionError):
        list(results)
