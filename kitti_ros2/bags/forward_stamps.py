# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The times at which the scanner faced forward, for bags whose scans are stamped at the start.

In such a bag written by to-bag, scans are half a turn earlier than the images of their frame, and
would match those of the previous frame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..kitti.turns import turn_length
from ..messages.source import RECORDING, SWEEP, decode_description, decode_sweep
from ..model.msgtypes import STRING
from ..options.read import NOMINAL_PERIOD_NS, ScanStamp, is_period
from .reader import open_messages

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..messages.ros_types import String
    from .reader import BagSource


class ForwardStamps:
    """A collector of the description of the scans that to-bag writes."""

    topics = frozenset({RECORDING, SWEEP})

    def __init__(self) -> None:
        self._at_start = False
        self._period_ns = NOMINAL_PERIOD_NS
        self._lengths: dict[int, int] = {}

    def take(self, topic: str, text: String, stamp_ns: int) -> None:
        """Enter a message of one of the topics.

        Raises:
            ValueError: The message was not written by to-bag.
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

    @property
    def lead_ns(self) -> int:
        """Nanoseconds by which scan stamps precede facing forward, from the nominal period."""
        return self._period_ns // 2 if self._at_start else 0

    def forward(self, stamps_ns: Iterable[int]) -> dict[int, int]:
        """Map scan stamps to the times of facing forward; empty if they are the same."""
        if not self._at_start:
            return {}
        return {
            stamp: stamp + self._lengths.get(stamp, self._period_ns) // 2 for stamp in stamps_ns
        }


def read_lead_ns(bag: BagSource) -> int:
    """Read the nanoseconds by which a bag's scan stamps precede facing forward (nominal period).

    The result is 0 for bags not written by to-bag, and if their description cannot be read.

    Raises:
        BadBagError: The bag cannot be read.
    """
    found = ForwardStamps()
    with open_messages(bag, {RECORDING}) as messages:
        if (RECORDING, STRING) not in messages.channels:
            return 0
        for message in messages:
            try:
                text: Any = messages.typestore.deserialize_cdr(bytes(message.data), STRING)
                found.take(RECORDING, text, message.stamp_ns)
            except Exception:  # noqa: BLE001 - generated code may raise anything
                return 0
            break
    return found.lead_ns
