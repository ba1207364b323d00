# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The order of packets, the line that is fitted to their stamps, and gaps within turns."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.kitti.extract_oxts import fit_line, gaps_over, order_packets

BASE_NS = 1_317_042_000_123_456_789
PERIOD_NS = 10_000_000
LAST_NS = 2**62

few = settings(max_examples=40)


def ticks_of(counts, skipped):
    """Packet numbers of runs with so many packets missing before each but the first."""
    starts = np.cumsum([0, *(count + gap for count, gap in zip(counts, skipped, strict=False))])
    return np.concatenate(
        [start + np.arange(count) for start, count in zip(starts, counts, strict=False)]
    )


@st.composite
def regular(draw, jitter_ns=0):
    """Stamps with gaps and a jitter, and the true number of each packet."""
    counts = draw(st.lists(st.integers(25 if jitter_ns else 3, 60), min_size=1, max_size=4))
    skipped = draw(st.lists(st.integers(1, 50), min_size=len(counts), max_size=len(counts)))
    ticks = ticks_of(counts, skipped)
    stamps = draw(st.integers(0, LAST_NS // 2)) + ticks * PERIOD_NS
    if jitter_ns:
        seed = draw(st.integers(0, 2**32 - 1))
        stamps = stamps + np.random.default_rng(seed).integers(-jitter_ns, jitter_ns, len(stamps))
    return stamps, ticks


@few
@given(regular())
def test_even_stamps_stay_and_gaps_are_counted(made):
    stamps, ticks = made
    line = fit_line(stamps)
    np.testing.assert_array_equal(line.stamps_ns, stamps)
    assert line.period_ns == pytest.approx(PERIOD_NS)
    missing = np.diff(ticks)[np.diff(ticks) > 1] - 1
    np.testing.assert_array_equal(line.missing, missing)
    assert not line.residuals_ns.any()


@few
@given(regular(jitter_ns=PERIOD_NS // 10))
def test_uneven_stamps_become_even_and_the_gaps_remain(made):
    stamps, ticks = made
    line = fit_line(stamps)
    np.testing.assert_array_equal(line.stamps_ns + line.residuals_ns, stamps)
    np.testing.assert_array_equal(line.missing, np.diff(ticks)[np.diff(ticks) > 1] - 1)
    steps = np.diff(line.stamps_ns)[np.diff(ticks) == 1]
    assert np.ptp(steps) <= 1
    bounds = [*line.starts.tolist(), len(stamps)]
    for begin, end in pairwise(bounds):
        assert abs(line.residuals_ns[begin:end].mean()) <= 1
    assert np.abs(line.residuals_ns).max() <= PERIOD_NS // 2


@few
@given(regular(jitter_ns=PERIOD_NS // 10))
def test_the_line_is_that_of_least_squares(made):
    stamps, _ = made
    line = fit_line(stamps)
    run = np.searchsorted(line.starts, np.arange(len(stamps)), 'right') - 1
    design = np.column_stack(
        [np.arange(len(stamps)) - line.starts[run], *(run == each for each in np.unique(run))]
    ).astype(float)
    origins = stamps[line.starts][run]
    solution, *_ = np.linalg.lstsq(design, (stamps - origins).astype(float), rcond=None)
    np.testing.assert_allclose(line.stamps_ns - origins, design @ solution, atol=2)
    assert line.period_ns == pytest.approx(solution[0], abs=1e-3)


@few
@given(st.lists(st.integers(0, LAST_NS), min_size=1, max_size=80, unique=True))
def test_any_increasing_stamps_become_increasing_ones(stamps):
    line = fit_line(np.array(sorted(stamps), np.int64))
    assert len(line.stamps_ns) == len(line.residuals_ns) == len(stamps)
    assert (np.diff(line.stamps_ns) > 0).all()
    assert (line.missing >= 1).all()
    assert len(line.missing) == len(line.starts) - 1


@few
@given(regular(jitter_ns=PERIOD_NS // 10), st.integers(-1000, 10**15))
def test_a_shift_of_all_stamps_shifts_the_line(made, shift):
    stamps, _ = made
    np.testing.assert_array_equal(
        fit_line(stamps + shift).stamps_ns, fit_line(stamps).stamps_ns + shift
    )


def test_packets_that_come_late_are_not_missing():
    """The bus was busy for 30 ms; then the packets came all at once."""
    stamps = BASE_NS + np.arange(200) * PERIOD_NS
    late = stamps.copy()
    late[100:103] = stamps[103] - np.array([3, 2, 1]) * 1_000_000
    line = fit_line(late)
    assert line.missing.tolist() == []
    np.testing.assert_allclose(line.stamps_ns - BASE_NS, stamps - BASE_NS, atol=2_000_000)


def test_a_line_through_the_listing_would_shift_what_follows_a_gap():
    """LIO-SAM's refit, by position; the gap is of 30 packets."""
    ticks = np.r_[0:300, 330:600]
    stamps = BASE_NS + ticks * PERIOD_NS
    by_position = np.polyval(np.polyfit(range(len(ticks)), stamps - BASE_NS, 1), range(len(ticks)))
    assert np.abs(by_position - (stamps - BASE_NS)).max() > 50_000_000
    np.testing.assert_array_equal(fit_line(stamps).stamps_ns, stamps)


def test_repeats_are_left_out_and_the_rest_is_in_order():
    """As in drive 0028: the stamps step back by 0.05 s, and 6 packets come again."""
    stamps = BASE_NS + np.r_[0:20, 14:20, 20:40] * PERIOD_NS
    texts = [f'packet {stamp}' for stamp in stamps]
    order = order_packets(stamps, texts.__getitem__)
    assert order.repeats == tuple(range(20, 26))
    assert order.kept.tolist() == [*range(20), *range(26, 46)]
    assert (order.clashes, order.late) == ((), 0)


@given(
    st.lists(st.integers(1, 50_000_000), min_size=1, max_size=60),
    st.lists(st.integers(0, 200), max_size=5),
)
@few
def test_repeats_anywhere_leave_the_packets(intervals, places):
    true = BASE_NS + np.cumsum(intervals)
    listing = list(range(len(true)))
    for place in sorted({place % len(true) for place in places}, reverse=True):
        listing[place + 1 : place + 1] = listing[max(0, place - 5) : place + 1]
    order = order_packets(true[listing], lambda at: str(listing[at]))
    assert [listing[at] for at in order.kept] == list(range(len(true)))
    assert len(order.repeats) == len(listing) - len(true)
    assert order.clashes == ()


def test_packets_of_one_stamp_and_other_values_clash():
    stamps = BASE_NS + np.array([0, 1, 1, 2]) * PERIOD_NS
    order = order_packets(stamps, 'abcd'.__getitem__)
    assert (order.kept.tolist(), order.clashes, order.repeats) == ([0, 1, 3], (2,), ())


def test_packets_out_of_order_are_sorted_and_counted():
    stamps = BASE_NS + np.array([0, 2, 1, 3]) * PERIOD_NS
    order = order_packets(stamps, 'abcd'.__getitem__)
    assert (order.kept.tolist(), order.late, order.repeats) == ([0, 2, 1, 3], 1, ())


def test_unreadable_packets_are_no_repeats():
    stamps = BASE_NS + np.array([0, 1, 0, 1]) * PERIOD_NS
    order = order_packets(stamps, lambda _: None)
    assert (order.repeats, order.clashes) == ((), (2, 3))


def test_no_file_is_read_where_all_stamps_increase():
    def fail(_):
        raise AssertionError('read')

    order_packets(BASE_NS + np.arange(50) * PERIOD_NS, fail)


def brute(stamps, begin, end, longest):
    """Whether a span reaches beyond the packets, or into an interval above the longest."""
    if begin < stamps[0] or end > stamps[-1]:
        return True
    return any(
        later - earlier > longest and earlier < end and later > begin
        for earlier, later in pairwise(stamps)
    )


@few
@given(
    st.lists(st.integers(0, 300), min_size=1, max_size=30, unique=True).map(sorted),
    st.lists(st.tuples(st.integers(-10, 310), st.integers(1, 60)), max_size=10),
)
def test_gaps_within_spans(stamps, spans):
    begin = np.array([first for first, _ in spans], np.int64)
    end = np.array([first + length for first, length in spans], np.int64)
    found = gaps_over(np.array(stamps, np.int64), begin, end, 15.0)
    assert found.tolist() == [
        brute(stamps, first, last, 15) for first, last in zip(begin, end, strict=True)
    ]
