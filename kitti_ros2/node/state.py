# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player's state as diagnostic_msgs, for ~/state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ..stamps import format_stamp

if TYPE_CHECKING:
    from ..playback import PlaybackState
    from .session import Counts


def make_state(name: str, source: str, state: PlaybackState, counts: Counts) -> DiagnosticArray:
    """The state of a player: OK, or WARN when messages could not be made.

    Args:
        name: The node's.
        source: What is played.
        state: Where it stands.
        counts: What was done so far.
    """
    values = {
        'source': source,
        'frame': state.frame,
        'time': format_stamp(state.stamp_ns),
        'seconds': f'{state.offset_ns / 1e9:.3f}',
        'rate': f'{state.rate:g}',
        'paused': str(state.paused).lower(),
        'finished': str(state.finished).lower(),
        'round': state.round,
        'messages': counts.messages,
        'failures': counts.failures,
        'late_ms': f'{counts.late_ns / 1e6:.1f}',
    }
    doing = 'finished' if state.finished else 'paused' if state.paused else 'playing'
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if counts.failures else DiagnosticStatus.OK,
        name=name,
        message=f'{doing}, frame {state.frame}'
        + (f'; {counts.failures} messages could not be made' if counts.failures else ''),
        hardware_id=source,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    seconds, nanoseconds = divmod(state.stamp_ns, 1_000_000_000)
    message.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
    return message
