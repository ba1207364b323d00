# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes on scans whose turn of the scanner is nominal, or has no length."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.losses import format_numbers
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.samples import Turn


def turn_notes(scans: Mapping[int, int], turns: Mapping[int, Turn], *, timed: bool) -> list[str]:
    """Return notes on the scans whose points have no time, or a nominal time or stamp.

    Args:
        scans: Stamps of the scans to be encoded, nanoseconds, by file number.
        turns: The turn of each scan, by file number; none for scans compensated for motion.
        timed: Whether points are to have ring and time.
    """
    notes = []
    if timed and not scans.keys() <= turns.keys():
        notes.append(
            'points have ring but no time: the scans are compensated for motion, so all points of a'
            ' scan are of one moment'
        )
    found = {
        number: turns[number]
        for number, stamp_ns in scans.items()
        if number in turns and (timed or stamp_ns == turns[number].start_ns)
    }
    nominal = sorted(number for number, turn in found.items() if turn.nominal)
    if nominal:
        notes.append(
            f'start and end of the turn are missing for scans {format_numbers(nominal)}: a nominal'
            f' turn of {found[nominal[0]].length_ns / NS_PER_S:g} s is used, facing forward at its'
            f' middle'
        )
    return notes
