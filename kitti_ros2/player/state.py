# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The state of a player as text and as a message."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..messages.diagnostics import OK, WARN, encode_diagnostics
from ..model.stamps import format_stamp

if TYPE_CHECKING:
    from .playback import Playback, PlaybackState
    from .session import Counts


def where(playback: Playback) -> str:
    """Describe the state in words, such as 'paused, frame 5'."""
    state = playback.state()
    return f'{_doing(state)}, frame {state.frame}'


def _doing(state: PlaybackState) -> str:
    if state.paused:
        return 'paused'
    return 'waiting for subscribers' if state.waiting else 'playing'


def encode_state(name: str, source: str, state: PlaybackState, counts: Counts) -> bytes:
    """Encode the state as a DiagnosticArray: OK, or WARN if messages could not be made.

    Args:
        name: The player's name.
        source: The source's name.
        state: The current state.
        counts: The statistics so far.
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
    doing = 'finished' if state.finished else _doing(state)
    return encode_diagnostics(
        state.stamp_ns,
        level=WARN if counts.failures else OK,
        name=name,
        message=f'{doing}, frame {state.frame}'
        + (f'; {counts.failures} messages could not be made' if counts.failures else ''),
        hardware_id=source,
        values={key: str(value) for key, value in values.items()},
    )
