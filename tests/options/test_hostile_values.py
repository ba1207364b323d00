# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers and names that the machine has no place for are refused in one line."""

import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.declare import (
    parse_four_numbers,
    parse_integer,
    parse_number,
    parse_path,
    parse_position,
    parse_shares,
    parse_span,
)

HUGE = 10**400


@pytest.mark.parametrize(
    ('parse', 'value'),
    [
        (parse_integer, HUGE),
        (parse_number, HUGE),
        (parse_number, -HUGE),
        (parse_position, [0, 0, HUGE]),
        (parse_four_numbers, [0, 0, 0, HUGE]),
        (parse_span, [None, HUGE]),
    ],
)
def test_a_huge_whole_number_is_refused(parse, value):
    with pytest.raises(UsageError, match='option takes '):
        parse('option', value)


@pytest.mark.parametrize('word', ['1e999999999', '1e-999999999', '1/' + '9' * 60])
def test_a_share_of_many_digits_is_refused_at_once(word):
    with pytest.raises(UsageError, match='option takes shares'):
        parse_shares('option', ['0.5', word])


def test_shares_may_be_written_in_any_way():
    assert [*map(float, parse_shares('option', '80 20'))] == [0.8, 0.2]
    assert [float(each) for each in parse_shares('option', '0.5 .25 1/8 1e-1 1')] == [
        *(0.5, 0.25, 0.125, 0.1, 1.0)
    ]


@pytest.mark.parametrize('name', ['a\0b', '\ud800', 'file:///a%00b'])
def test_a_name_that_no_file_can_have_is_refused(name):
    """YAML and JSON have escapes for these characters; a command line has not."""
    with pytest.raises(UsageError, match='no file can have this name'):
        parse_path('option', name)


def test_a_name_of_other_bytes_than_text_is_a_name():
    name = b'a\xff'.decode('utf-8', 'surrogateescape')
    assert str(parse_path('option', name)) == name
