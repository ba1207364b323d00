# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Check of the numbers of a plan."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

_LONGEST_S = 4e9
"""127 years: header stamps, 32-bit seconds, plus that are still int64 nanoseconds."""


def as_number(value: float, where: str) -> float:
    """Return a number of a file as float.

    Raises:
        UsageError: It is not finite.
    """
    try:
        number = float(value)
    except OverflowError:  # of a whole number
        number = float('inf')
    if not isfinite(number):
        raise UsageError(f'{where}: {number}; expected a finite number')
    return number


def check_numbers(values: Mapping[str, Any], place: str) -> None:
    """Check the values of a plan, or of a part of it, against their limits.

    Args:
        values: By the names of the fields.
        place: The file and the part, for errors.

    Raises:
        UsageError: One is outside of its limits; the error names the key.
    """
    for key, value in values.items():
        if not isinstance(value, float):
            continue
        if key.endswith('offset_s') and abs(value) > _LONGEST_S:
            expected = f'seconds from -{_LONGEST_S:.0f} to {_LONGEST_S:.0f}'
        elif key == 'tolerance_s' and not 0 <= value <= _LONGEST_S:
            expected = f'seconds from 0 to {_LONGEST_S:.0f}'
        elif key == 'minimum_range_m' and value < 0:
            expected = '0 or more'
        elif key in {'intensity_scale', 'unit_m'} and value <= 0:
            expected = 'more than 0'
        else:
            continue
        raise UsageError(f'{place}{key}: {value}; expected {expected}')
