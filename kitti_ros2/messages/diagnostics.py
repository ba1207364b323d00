# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A state in words -> diagnostic_msgs/DiagnosticArray, which viewers display."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .cdr_writer import CdrWriter

if TYPE_CHECKING:
    from collections.abc import Mapping


OK = 0
WARN = 1
"""DiagnosticStatus.level."""


def encode_diagnostics(
    stamp_ns: int,
    *,
    level: int,
    name: str,
    message: str,
    hardware_id: str,
    values: Mapping[str, str],
) -> bytes:
    """Make a DiagnosticArray with one DiagnosticStatus, serialised.

    Args:
        stamp_ns: Of the header, nanoseconds.
        level: OK or WARN.
        name: Of the component that reports.
        message: Its state, in a line.
        hardware_id: What it reports on.
        values: Its state in detail.
    """
    cdr = CdrWriter()
    cdr.header(stamp_ns, '')
    cdr.uint32(1)
    cdr.byte(level)
    for text in (name, message, hardware_id):
        cdr.text(text)
    cdr.uint32(len(values))
    for key, value in values.items():
        cdr.text(key)
        cdr.text(value)
    return cdr.finish()
