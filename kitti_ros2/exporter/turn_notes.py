# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes on scans whose turn of the scanner is nominal, or has no length."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.losses import format_numbers
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.cloud_formats import CloudFormat
    from ..model.samples import Turn

_WITHOUT_TIME = 'points have ring but no time'


def turn_notes(
    scans: Mapping[int, int], turns: Mapping[int, Turn], cloud_format: CloudFormat
) -> list[str]:
    """Return notes on the scans whose points have no time, or a nominal time or stamp.

    Args:
        scans: Stamps of the scans to be encoded, nanoseconds, by file number.
        turns: The turn of each scan, by file number; none for scans compensated for motion.
        cloud_format: Of the clouds.
    """
    notes = []
    timed = cloud_format.is_timed
    if timed and not scans.keys() <= turns.keys():
        points = 'points have the time 0' if cloud_format.is_unsigned else _WITHOUT_TIME
        notes.append(
            f'{points}: the scans are compensated for motion, so all points of a scan are of one'
            f' moment'
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
