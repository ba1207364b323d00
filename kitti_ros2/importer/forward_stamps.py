# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The moments at which the scanner faced forward, of bags whose scans are stamped at the start.

Scans of such a bag of our own are half a turn earlier than the images of their frame, and would
match those of the frame before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti.turns import turn_length
from ..messages.source import RECORDING, decode_description, decode_sweep
from ..options import NOMINAL_PERIOD_NS, ScanStamp, is_period

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..messages.ros_types import String

SWEEP = '/kitti/source/sweep'


class ForwardStamps:
    """Collects a bag's own description of its scans."""

    topics = frozenset({RECORDING, SWEEP})

    def __init__(self) -> None:
        self._at_start = False
        self._period_ns = NOMINAL_PERIOD_NS
        self._lengths: dict[int, int] = {}

    def take(self, topic: str, text: String, stamp_ns: int) -> None:
        """Enter a message of one of the topics.

        Raises:
            ValueError: It is not what to-bag writes.
        """
        try:
            if topic == SWEEP:
                length = turn_length(*decode_sweep(text))
                if length is not None:
                    self._lengths[stamp_ns] = length
                return
            values = decode_description(text)
            self._at_start = values.get('scan_stamp') == ScanStamp.START.value
            period = values.get('period_ns')
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f'{topic} is not what kitti-ros2 writes ({error})') from error
        if isinstance(period, int) and is_period(period):
            self._period_ns = period

    def forward(self, stamps_ns: Iterable[int]) -> dict[int, int]:
        """Scan stamp to the moment of facing forward; empty unless scans are stamped otherwise."""
        if not self._at_start:
            return {}
        return {
            stamp: stamp + self._lengths.get(stamp, self._period_ns) // 2 for stamp in stamps_ns
        }
