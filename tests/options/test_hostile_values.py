# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers beyond those of the machine are refused in one line, from whatever they come."""

import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.parsers import parse_integer, parse_number
from kitti_ros2.options.quantity_parsers import parse_four_numbers, parse_place

HUGE = 10**400


@pytest.mark.parametrize(
    ('parse', 'value'),
    [
        (parse_integer, HUGE),
        (parse_number, HUGE),
        (parse_number, -HUGE),
        (parse_place, [0, 0, HUGE]),
        (parse_four_numbers, [0, 0, 0, HUGE]),
    ],
)
def test_a_huge_whole_number_is_refused(parse, value):
    with pytest.raises(UsageError, match='option takes '):
        parse('option', value)
