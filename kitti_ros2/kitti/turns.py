# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Start and length of each turn of the scanner.

KITTI's HDL-64E turns clockwise seen from above. A turn begins and ends straight behind (azimuth pi
and -pi), and the scan's own stamp is the moment at which the scanner faces forward (it triggers the
cameras then): A. Geiger et al., "Vision meets Robotics: The KITTI Dataset", IJRR 2013, section 2.
In the raw files that moment is the middle of timestamps_start.txt and timestamps_end.txt, to the
nanosecond (drives 0001 and 0005), so the start of a turn is the line of timestamps_start.txt.
Turns do not always follow each other without a gap (0001: 96 of 107 do).

Object, tracking and raw scans are as measured: each laser's points lie on one line z = T rho + D.
Odometry scans do so only after x is moved by 0.8 m azimuth / 2 pi, the car having moved 0.86 m:
KITTI has compensated them for motion, and their points are all of one moment.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.samples import Turn
from ..options.read import ScanStamp

if TYPE_CHECKING:
    from collections.abc import Mapping

_LONGEST_TURN_NS = 1_000_000_000  # an HDL-64E's slowest takes 0.2 s


def find_turns(
    forward_ns: Mapping[int, int],
    starts_ns: Mapping[int, int],
    ends_ns: Mapping[int, int],
    period_ns: int,
) -> dict[int, Turn]:
    """Return the turn of each scan, by file number.

    Args:
        forward_ns: When the scanner faces forward, which is the scans' own stamps.
        starts_ns: When the turns begin, where it is known; start and end give the length.
        ends_ns: When they end.
        period_ns: The length of a turn whose start or end is missing or implausible.
    """
    turns = {}
    for number, forward in forward_ns.items():
        known = turn_length(starts_ns.get(number), ends_ns.get(number))
        length = period_ns if known is None else known
        turns[number] = Turn(forward - length // 2, length, nominal=known is None)
    return turns


def turn_length(start_ns: int | None, end_ns: int | None) -> int | None:
    """Return the length of a turn; None if start or end is missing, or the length implausible."""
    if start_ns is None or end_ns is None or not 0 < end_ns - start_ns <= _LONGEST_TURN_NS:
        return None
    return end_ns - start_ns


def scan_stamps(
    forward_ns: Mapping[int, int], turns: Mapping[int, Turn], moment: ScanStamp
) -> dict[int, int]:
    """Return the stamp of each scan, by file number.

    A turn that begins before 1970, which no stamp can hold, keeps the moment of facing forward.
    """
    if moment is ScanStamp.FORWARD:
        return dict(forward_ns)
    return {
        number: turns[number].start_ns if turns[number].start_ns > 0 else forward
        for number, forward in forward_ns.items()
    }
