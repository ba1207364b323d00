# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.errors import one_line


@given(st.text(st.characters(exclude_categories=())))
def test_any_text_is_one_line_that_a_terminal_shows_and_does_not_obey(text):
    line = one_line(text)
    assert line.isprintable()
    line.encode('utf-8')
    assert one_line(line) == line


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('plain text, ü and 車', 'plain text, ü and 車'),
        ('two\n  lines', 'two lines'),
        ('\x1b[31mred\x07', r'\x1b[31mred\x07'),
        ('\x9b31m', r'\x9b31m'),
        ('\u202egnp.exe', r'\u202egnp.exe'),
        (os.fsdecode(b'\xff.bag'), r'\udcff.bag'),
        (f'/{"t" * 10_000}: what', f'/{"t" * 119}...{"t" * 59}: what'),
    ],
)
def test_what_becomes_of(text, line):
    assert one_line(text) == line
