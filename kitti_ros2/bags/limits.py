# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How large compressed data may become: some are made to fill the memory of who reads them."""

from __future__ import annotations

import os

from ..model.errors import UsageError
from ..model.text import format_bytes, shown
from ..options.quantity_parsers import parse_bytes

LARGEST_BLOCK = 'KITTI_ROS2_LARGEST_BLOCK'
_ALWAYS = 64 * 10**6
_RATIO = 16
_FILE_ALWAYS = 10**9
_FILE_RATIO = 100


def largest_block(stored: int) -> int:
    """Return the most bytes that a compressed block of so many bytes may have.

    Sensors' data shrink to a third, and blank images to a hundredth, but those are small.

    Raises:
        UsageError: The environment variable that sets it is no size.
    """
    return max(_limit(_ALWAYS), _RATIO * stored)


def check_block(stored: int, size: int) -> None:
    """Check the size of a block before compression.

    Raises:
        ValueError: It is too large.
    """
    _check(stored, size, largest_block(stored))


def check_file(stored: int, size: int) -> None:
    """Check the size of a file that is compressed as a whole; it goes to the disk.

    Raises:
        ValueError: It is too large.
    """
    _check(stored, size, max(_limit(_FILE_ALWAYS), _FILE_RATIO * stored))


def _check(stored: int, size: int, most: int) -> None:
    if size > most:
        raise ValueError(
            f'{format_bytes(stored)} that become {format_bytes(size)}; expected at most'
            f' {format_bytes(most)}; {LARGEST_BLOCK}=SIZE in the environment allows more'
        )


def _limit(default: int) -> int:
    text = os.environ.get(LARGEST_BLOCK)
    if not text:
        return default
    try:
        return max(parse_bytes(text), default)
    except ValueError:
        raise UsageError(f'{LARGEST_BLOCK} takes a size such as 2GB, not {shown(text)}') from None
