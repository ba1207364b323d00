# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The moments at which the scanner faced forward, of bags whose scans are stamped at the start.

Scans of such a bag of our own are half a turn earlier than the images of their frame, and would
match those of the frame before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..kitti.turns import turn_length
from ..messages.source import RECORDING, SWEEP, decode_description, decode_sweep
from ..options.read import NOMINAL_PERIOD_NS, ScanStamp, is_period
from .reader import open_messages

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from ..messages.ros_types import String

_STRING = 'std_msgs/msg/String'


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

    @property
    def lead_ns(self) -> int:
        """How long before facing forward scans are stamped, by the nominal period."""
        return self._period_ns // 2 if self._at_start else 0

    def forward(self, stamps_ns: Iterable[int]) -> dict[int, int]:
        """Scan stamp to the moment of facing forward; empty unless scans are stamped otherwise."""
        if not self._at_start:
            return {}
        return {
            stamp: stamp + self._lengths.get(stamp, self._period_ns) // 2 for stamp in stamps_ns
        }


def read_lead_ns(path: Path) -> int:
    """How long before facing forward the scans of a bag are stamped, by the nominal period.

    It is 0 for bags of others, and where the bag's own description cannot be read.

    Raises:
        BadBagError: It is no bag.
    """
    found = ForwardStamps()
    with open_messages(path, {RECORDING}) as messages:
        if (RECORDING, _STRING) not in messages.channels:
            return 0
        for message in messages:
            try:
                text: Any = messages.typestore.deserialize_cdr(bytes(message.data), _STRING)
                found.take(RECORDING, text, message.stamp_ns)
            except Exception:  # noqa: BLE001 - generated code lets anything out
                return 0
            break
    return found.lead_ns
