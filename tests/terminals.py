# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The end of a terminal that a program writes to."""

import os
import re


def read_until(master: int, expected: bytes) -> re.Match[bytes]:
    """What is written to a terminal up to a regular expression, as its match."""
    written = b''
    while not (found := re.search(expected, written)):
        written += os.read(master, 1 << 16)
    return found


def read_to_the_end(master: int) -> bytes:
    """What is written to a terminal until its last writer ends; closes it."""
    written = b''
    try:
        while part := os.read(master, 1 << 16):
            written += part
    except OSError:  # Linux: the other end is closed
        pass
    finally:
        os.close(master)
    return written
