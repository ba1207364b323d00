# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Frames and samples brought together by their stamps."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.importer.survey import usable_stamps
from kitti_ros2.model.samples import NONE, default_tolerance_ns, match_frames

T0 = 1317042145951199337
MS = 1_000_000

STAMPS = st.lists(st.integers(0, 60), max_size=14)
UNIQUE = st.lists(st.integers(0, 60), max_size=14, unique=True)
TOLERANCES = st.integers(0, 30)


def stamps(values):
    return np.array(values, dtype=np.int64)


def match(reference, stream, tolerance):
    return match_frames(stamps(reference), {'s': stamps(stream)}, tolerance)['s']


def nearest_first(reference, stream, tolerance):
    """What match_frames promises, word for word: all pairs by distance, the earlier first."""
    pairs = sorted(
        (abs(r - s), min(r, s), i, j)
        for i, r in enumerate(reference)
        for j, s in enumerate(stream)
        if abs(r - s) <= tolerance
    )
    made = []
    for _, _, i, j in pairs:
        fits = all(
            i != k and j != m and (reference[i] < reference[k]) == (stream[j] < stream[m])
            for k, m in made
        )
        if fits:
            made.append((i, j))
    indices = [NONE] * len(reference)
    for i, j in made:
        indices[i] = j
    return indices


@given(UNIQUE, UNIQUE, TOLERANCES)
def test_pairs_are_made_from_the_nearest_on(reference, stream, tolerance):
    expected = nearest_first(reference, stream, tolerance)
    assert match(reference, stream, tolerance).indices.tolist() == expected


@given(STAMPS, STAMPS, TOLERANCES)
def test_each_sample_serves_once_within_tolerance_and_in_order(reference, stream, tolerance):
    found = match(reference, stream, tolerance)
    pairs = sorted(
        (reference[i], stream[j], j) for i, j in enumerate(found.indices.tolist()) if j != NONE
    )
    used = [j for *_, j in pairs]
    errors = [abs(r - s) for r, s, _ in pairs]
    assert len(found.indices) == len(reference)
    assert found.indices.dtype == np.int64
    assert len(set(used)) == len(used)
    assert all(error <= tolerance for error in errors)
    assert [s for _, s, _ in pairs] == sorted(s for _, s, _ in pairs)
    assert found.matched == len(pairs)
    assert found.dropped == len(stream) - len(pairs)
    assert found.max_error_ns == max(errors, default=0)
    assert found.mean_error_ns == pytest.approx(np.mean(errors) if errors else 0)


@given(STAMPS, STAMPS, TOLERANCES)
def test_no_free_frame_lies_beside_a_free_sample_in_reach(reference, stream, tolerance):
    found = match(reference, stream, tolerance).indices
    free_frames = [r for i, r in enumerate(reference) if found[i] == NONE]
    free_samples = [s for j, s in enumerate(stream) if j not in found]
    taken = [
        (min(reference[i], stream[j]), max(reference[i], stream[j]))
        for i, j in enumerate(found.tolist())
        if j != NONE
    ]
    for r in free_frames:
        for s in free_samples:
            between = any(low <= max(r, s) and high >= min(r, s) for low, high in taken)
            assert abs(r - s) > tolerance or between


@given(STAMPS, STAMPS, TOLERANCES)
def test_the_order_of_stamps_in_their_arrays_does_not_matter(reference, stream, tolerance):
    def pairs(frames, samples):
        found = match(frames, samples, tolerance).indices.tolist()
        return sorted((frames[i], samples[j]) for i, j in enumerate(found) if j != NONE)

    assert pairs(reference, stream) == pairs(reference[::-1], stream[::-1])


@given(st.lists(st.integers(-49, 49), min_size=1, max_size=50))
def test_jitter_below_half_a_period_loses_nothing(jitter):
    reference = T0 + np.arange(len(jitter)) * 100
    found = match(reference, reference + stamps(jitter), 50)
    assert found.indices.tolist() == list(range(len(jitter)))
    assert found.max_error_ns == max(abs(shift) for shift in jitter)


def test_every_stream_is_matched_for_itself():
    found = match_frames(stamps([10, 20]), {'a': stamps([11, 19]), 'b': stamps([20])}, 4)
    assert found['a'].indices.tolist() == [0, 1]
    assert found['b'].indices.tolist() == [NONE, 0]


def test_a_gap_in_a_stream_leaves_its_frames_without():
    reference = T0 + np.arange(10) * 100 * MS
    found = match(reference, np.delete(reference + 7 * MS, [3, 4, 5]), 50 * MS)
    assert found.indices.tolist() == [0, 1, 2, NONE, NONE, NONE, 3, 4, 5, 6]
    assert (found.dropped, found.max_error_ns) == (0, 7 * MS)
    assert np.count_nonzero(found.indices == NONE) == 3


def test_of_a_faster_stream_the_nearest_samples_are_taken():
    found = match([0, 100, 200], range(3, 250, 10), 50)
    assert found.indices.tolist() == [0, 10, 20]
    assert found.dropped == 22


@pytest.mark.parametrize(
    ('reference', 'stream', 'indices'),
    [
        ([0, 10], [6], [NONE, 0]),
        ([0, 10], [5], [0, NONE]),
        ([10], [5, 15], [0]),
        ([0, 10], [-3, 6], [0, 1]),
        ([0, 10], [-7, 4], [1, NONE]),
        ([0, 1], [4, 5], [NONE, 0]),
        ([5, 5], [5, 5], [0, 1]),
        ([5], [], [NONE]),
        ([], [5], []),
    ],
)
def test_who_yields_where_two_want_one(reference, stream, indices):
    assert match(reference, stream, 7).indices.tolist() == indices


def test_stamps_of_nineteen_digits_keep_their_last():
    found = match([T0, T0 + 3], [T0 + 1, T0 + 4], 1)
    assert found.indices.tolist() == [0, 1]
    assert found.max_error_ns == 1


def test_a_chain_of_ever_closer_stamps_takes_no_longer_than_any_other():
    """Each stamp is nearest to the next: a search that makes one pair a round would never end."""
    count = 500_000
    merged = np.cumsum(np.arange(2 * count, 0, -1, dtype=np.int64))
    start = time.process_time()
    found = match(merged[::2], merged[1::2], 10**9)
    assert time.process_time() - start < 5
    assert found.matched == count
    assert found.max_error_ns == 2 * count - 1


@pytest.mark.parametrize(
    ('reference', 'tolerance'),
    [
        ([0, 100, 200, 300], 50),
        ([0, 100, 200, 900, 1000], 50),
        ([300, 200, 200, 100], 50),
        ([T0, T0 + 103_333_333], 51_666_666),
        ([5], 50 * MS),
        ([], 50 * MS),
        ([5, 5], 50 * MS),
    ],
)
def test_the_tolerance_is_half_the_usual_period(reference, tolerance):
    assert default_tolerance_ns(stamps(reference)) == tolerance


@pytest.mark.parametrize(
    'header', [[], [7], [5, 5, 9], [0, 100 * MS, 200 * MS], [T0, T0 + 200 * MS, T0 + 100 * MS]]
)
def test_header_stamps_are_used_also_where_messages_were_delivered_late(header):
    used, reason = usable_stamps(stamps(header), stamps([20] * len(header)))
    assert used.tolist() == header
    assert reason is None


def test_header_stamps_of_zero_get_the_log_time_moved_by_the_others():
    header = [T0, 0, T0 + 200 * MS, 0, T0 + 400 * MS]
    log = [T0 + place * 100 * MS + late * MS for place, late in enumerate((80, 90, 80, 70, 81))]
    used, reason = usable_stamps(stamps(header), stamps(log))
    assert used.tolist() == [
        T0, T0 + 110 * MS, T0 + 200 * MS, T0 + 290 * MS, T0 + 400 * MS,
    ]  # fmt: skip
    assert reason is None


LATE = 'header stamps are more than a second earlier than one before'


@pytest.mark.parametrize(
    ('header', 'reason'),
    [
        ([0], '1 of 1 header stamps is 0 (the first that of message 1);'),
        ([0, 0, 100 * MS], '2 of 3 header stamps are 0 (the first that of message 1);'),
        ([0, T0], '1 of 2 header stamps is 0 (the first that of message 1);'),
        ([0, 0, 0], '3 of 3 header stamps are 0 (the first that of message 1);'),
        ([-5, -4, 3], '2 of 3 header stamps are before 1970 (the first that of message 1);'),
        (
            [T0, T0 - 1001 * MS, T0 - 1002 * MS],
            f'2 of 3 {LATE} (the first that of message 2);',
        ),
    ],
)
def test_log_time_replaces_stamps_that_cannot_be_right(header, reason):
    log = [20, 21, 22][: len(header)]
    used, why = usable_stamps(stamps(header), stamps(log))
    assert used.tolist() == log
    assert why == f'{reason} log time is used'
