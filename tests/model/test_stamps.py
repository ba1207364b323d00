# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.streams import (
    LAST_NS,
    format_seconds,
    format_stamp,
    from_sec_nanosec,
    parse_seconds,
    parse_stamp,
    to_sec_nanosec,
)

STAMPS = st.integers(0, LAST_NS)


@given(STAMPS)
def test_text_and_back_keeps_all_nine_digits(stamp_ns):
    assert parse_stamp(format_stamp(stamp_ns)) == stamp_ns


@given(STAMPS)
def test_sec_nanosec_and_back(stamp_ns):
    sec, nanosec = to_sec_nanosec(stamp_ns)
    assert 0 <= nanosec < 10**9
    assert from_sec_nanosec(sec, nanosec) == stamp_ns


def test_kitti_stamp_is_utc():
    assert parse_stamp('2011-09-26 13:02:25.951199337') == 1317042145951199337
    assert parse_stamp('2011-09-26 13:02:25.951199337\n') == 1317042145951199337


@pytest.mark.parametrize(
    ('text', 'fraction'), [('', 0), ('.5', 500_000_000), ('.000000001', 1), ('.120', 120_000_000)]
)
def test_fraction_of_any_length(text, fraction):
    assert parse_stamp(f'1970-01-01 00:00:01{text}') == 10**9 + fraction


@pytest.mark.parametrize(
    'text',
    [
        '',
        '1969-12-31 23:59:59',
        '2038-01-19 03:14:08',
        '13:02:25',
        '2011-13-26 13:02:25.0',
        '2011-09-26 13:02:25.1234567890',
        '1317042145.95',
        'x',
    ],
)
def test_what_is_no_stamp(text):
    with pytest.raises(ValueError):  # noqa: PT011 - the message is the standard library's at times
        parse_stamp(text)


@given(st.integers(0, 9_999_999), st.integers(0, 3))
def test_seconds_text_and_back(mantissa, exponent):
    offset_ns = mantissa * 10 ** (exponent + 2)
    assert parse_seconds(format_seconds(offset_ns)) == offset_ns


def test_seconds_are_exact_decimals():
    assert parse_seconds('1.037359e-01') == 103_735_900
    assert parse_seconds('4.704816e+02') == 470_481_600_000


@pytest.mark.parametrize('text', ['', 'abc', 'nan', 'inf', '1.0.0', '-1', '1e30'])
def test_what_is_no_count_of_seconds(text):
    with pytest.raises(ValueError, match='number'):
        parse_seconds(text)
