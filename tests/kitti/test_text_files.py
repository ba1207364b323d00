# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Time stamps, poses and oxts packets: each parser against its writer, and against bad lines."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.store import STORE
from kitti_ros2.kitti.text_file import (
    COLUMNS,
    format_packet,
    format_poses,
    format_times,
    format_timestamps,
    parse_packet,
    parse_poses,
    parse_times,
    parse_timestamps,
)
from kitti_ros2.model.errors import BadFileError
from kitti_ros2.model.samples import OxtsPacket
from kitti_ros2.model.streams import LAST_NS, parse_stamp

NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@given(st.lists(st.integers(0, LAST_NS)))
def test_timestamps_and_back(stamps):
    assert parse_timestamps(format_timestamps(stamps), 'x').values == stamps


CLOCK_TEXTS = st.builds(
    '{:04d}-{:02d}-{:02d} {:02d}:{:02d}:{:02d}.{:09d}'.format,
    st.integers(1900, 2099) | st.integers(1968, 2039),
    *(st.integers(0, limit) for limit in (13, 32, 24, 60, 61, 999_999_999)),
)


@given(st.lists(CLOCK_TEXTS, min_size=1, max_size=3))
def test_lines_parsed_together_have_the_values_that_each_has_alone(texts):
    def alone(text):
        try:
            return parse_stamp(text)
        except ValueError:
            return None

    lines = parse_timestamps('\n'.join([*texts, '']), 'x')
    assert lines.values == [alone(text) for text in texts]
    assert [*lines.errors] == [n for n, text in enumerate(texts) if alone(text) is None]


@given(st.lists(st.integers(0, 9_999_999).map(lambda n: n * 100_000)))
def test_times_and_back(offsets):
    assert parse_times(format_times(offsets), 'x').values == offsets


@given(st.lists(st.lists(NUMBERS, min_size=12, max_size=12), max_size=5))
def test_poses_and_back(rows):
    text = format_poses(np.array(row).reshape(3, 4) for row in rows)
    again = parse_poses(text, 'x').values
    assert format_poses(again) == text
    assert len(again) == len(rows)


PACKETS = st.builds(
    OxtsPacket,
    *[st.floats(-limit, limit) for limit in (89, 180, 9000, 3, 3, 3)],
    *[NUMBERS] * (COLUMNS.index('navstat') - 6),
    *[st.integers(0, 20)] * 5,
)


@given(PACKETS)
def test_packet_and_back(packet):
    text = format_packet(packet)
    again = parse_packet(text, 'x')
    assert format_packet(again) == text
    for name in COLUMNS:
        assert getattr(again, name) == pytest.approx(getattr(packet, name), rel=1e-13)


def test_columns_are_the_devkit_s():
    assert len(COLUMNS) == 30
    assert COLUMNS.index('ax') == 11
    assert COLUMNS.index('az') == 13
    assert COLUMNS.index('wx') == 17
    assert COLUMNS.index('pos_accuracy') == 23


def test_a_bad_line_costs_that_line_only():
    text = '2011-09-26 13:02:25.951199337\nyesterday\n\n2011-09-26 13:02:26.154281661\n\n\n'
    lines = parse_timestamps(text, 'd/timestamps.txt')
    assert len(lines) == 4
    assert [value is None for value in lines.values] == [False, True, True, False]
    assert str(lines.errors[1]).startswith("d/timestamps.txt:2: 'yesterday' is no time stamp")


def test_windows_line_ends_are_read():
    text = '2011-09-26 13:02:25.951199337\r\n2011-09-26 13:02:26.154281661\r\n'
    assert parse_timestamps(text, 'x').values == [1317042145951199337, 1317042146154281661]


@pytest.mark.parametrize(
    ('words', 'said'), [(['1'] * 11, '11 values'), (['1'] * 11 + ['one'], "'one' is no number")]
)
def test_bad_pose(words, said):
    lines = parse_poses(' '.join(['1'] * 12) + '\n' + ' '.join(words), 'p.txt')
    assert said in str(lines.errors[1])
    assert 'p.txt:2' in str(lines.errors[1])
    assert lines.values[0] is not None


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['1'] * 29, '29 values'),
        ([], '0 values'),
        (['1'] * 29 + ['x'], "'x' is no number"),
        (['nan'] + ['1'] * 29, 'no finite number'),
        (['1'] * 23 + ['1e200'] + ['1'] * 6, 'pos_accuracy is 1e\\+200'),
    ],
)
def test_bad_packet(words, said):
    with pytest.raises(BadFileError, match=said) as caught:
        parse_packet(' '.join(words), 'o.txt', 7)
    assert str(caught.value).startswith('o.txt:7: ')


def test_the_source_line_does_not_make_packets_differ():
    packet = parse_packet(' '.join(['1'] * 30), 'x')
    assert replace(packet, source=None) == packet


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    for path in (tmp_path / 'pipe', Path('/dev/zero')):
        with pytest.raises(BadFileError, match='is no regular file'):
            STORE.read_text(path)
        with pytest.raises(BadFileError, match='is no regular file'):
            STORE.read_ends(path, 8)


@pytest.mark.parametrize('size', [0, 1, 4, 5, 8, 9, 100])
def test_the_ends_of_a_file(tmp_path, size):
    data = bytes(range(size))
    (tmp_path / 'file').write_bytes(data)
    ends, found = STORE.read_ends(tmp_path / 'file', 4)
    assert (ends, found) == (data if size <= 8 else data[:4] + data[-4:], size)
