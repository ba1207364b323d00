# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of a report: timing, pairing, classes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.drawing.labelled_objects import LabelledObject
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.recording import StreamIndex
from kitti_ros2.report.contents import ClassTally, histogram, shifted_numbers, spread, timing_of

PERIOD = 100_000_000
START = 1_317_042_145_951_199_337


def every(count: int, *absent: int) -> np.ndarray:
    numbers = np.array([n for n in range(count) if n not in absent], dtype=np.int64)
    return START + numbers * PERIOD


def test_an_even_stream_has_no_jitter_and_no_gap():
    timing = timing_of(every(20))
    assert (timing.period_ns, timing.jitter_ns, timing.gaps) == (PERIOD, 0, ())
    assert timing.rate_hz == pytest.approx(10)
    assert timing.regular


@given(st.sets(st.integers(1, 38), max_size=12))
def test_gaps_are_where_samples_are_absent(absent):
    timing = timing_of(every(40, *absent))
    if not timing.regular:
        assert len(absent) > 8  # too few neighbours are left to tell a period
        return
    assert sum(gap.missing for gap in timing.gaps) == len(absent)
    for gap in timing.gaps:
        first = (gap.at_ns - START) // PERIOD + 1
        assert set(range(first, first + gap.missing)) <= absent
        assert first - 1 not in absent


def test_jitter_is_that_of_the_samples_and_not_of_gaps():
    stamps = every(100, 50) + np.tile([0, 3_000_000], 50)[:99]
    assert timing_of(stamps).jitter_ns == 6_000_000  # 103 and 97 ms by turns


def test_irregular_streams_have_no_gaps():
    stamps = START + np.cumsum(np.geomspace(1e6, 1e9, 30)).astype(np.int64)
    timing = timing_of(stamps)
    assert not timing.regular
    assert timing.gaps == ()


@given(st.permutations(range(6)))
def test_backward_stamps_are_counted_in_the_order_of_samples(order):
    timing = timing_of(every(6)[list(order)])
    assert timing.backward == sum(b < a for a, b in pairwise(order))
    assert timing.stamps_ns.tolist() == every(6).tolist()


def test_repeated_stamps():
    assert timing_of(np.repeat(every(5), [1, 3, 1, 1, 1])).repeated == 2


@pytest.mark.parametrize('count', [0, 1, 2])
def test_timing_of_next_to_nothing(count):
    timing = timing_of(every(count))
    assert len(timing) == count
    assert not timing.regular
    assert timing.jitter_ns is None


def test_one_stamp_for_all_has_no_rate():
    timing = timing_of(np.full(5, START))
    assert timing.rate_hz is None
    assert timing.repeated == 4


def test_shifted_numbers_are_seen():
    numbers = np.arange(20)
    scans = StreamIndex(numbers, every(20))
    late = StreamIndex(numbers, every(20) + 10_000_000)
    assert shifted_numbers(late, scans) == ([], 20)
    renumbered = StreamIndex(numbers, np.where(numbers >= 12, PERIOD, 0) + every(20))
    assert shifted_numbers(renumbered, scans) == ([*range(12, 20)], 20)
    assert shifted_numbers(StreamIndex(numbers + 50, every(20)), scans) == ([], 0)


def thing(kind, x=None, occluded=None, truncated=None, track=None):
    place = Transform.from_translation([x or 0.0, 0.0, 50.0])
    cuboid = None if x is None else Cuboid(kind, '0', place, (4.0, 2.0, 1.5))
    return LabelledObject(kind, cuboid, truncated=truncated, occluded=occluded, track_id=track)


def test_class_statistics():
    tally = ClassTally()
    tally.add([thing('Car', 3.0, 0, 0.0, 7), thing('Car', 8.0, 2, 0.4, 8), thing('DontCare')])
    tally.add([])
    tally.add([thing('Van'), thing('Car', 5.0, 0, 0.0, 7)])
    facts = tally.statistics()
    assert (facts.frames, facts.labelled, facts.dont_care, facts.count) == (3, 2, 1, 4)
    car, van = facts.classes
    assert (car.class_name, car.count, car.frames, car.most, car.tracks) == ('Car', 3, 2, 2, 2)
    assert sorted(car.distances_m) == [3, 5, 8]  # over the ground: their height does not count
    assert car.occlusions == (2, 0, 1, 0)
    assert car.truncated == 1
    assert (van.occlusions, van.truncated, van.tracks, len(van.distances_m)) == (
        None,
        None,
        None,
        0,
    )


@given(st.lists(st.floats(0, 500), max_size=50))
def test_every_value_is_in_a_bin(values):
    assert sum(histogram(np.array(values), range(0, 100, 10))) == len(values)


@given(st.integers(0, 300), st.integers(1, 9))
def test_spread(count, most):
    places = spread(count, most)
    assert len(places) == min(count, most)
    assert places == sorted(set(places))
    if count:
        assert places[0] == 0
        assert set(places) <= set(range(count))
    if most > 1 and count:
        assert places[-1] == count - 1
