# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as `ros2 bag record -a` makes it of a player: with its clock and its state."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from mcap.reader import make_reader
from mcap.writer import Writer

from kitti_ros2.messages.cdr import make_header
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import DIAGNOSTICS

if TYPE_CHECKING:
    from pathlib import Path

    from mcap.reader import McapReader

DiagnosticArray = TYPESTORE.types[DIAGNOSTICS]

CLOCK = '/clock'
CLOCK_TYPE = 'rosgraph_msgs/msg/Clock'
CLOCK_TEXT = b"""builtin_interfaces/Time clock
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
STATE = '/kitti_player/state'
STATES = (STATE, '/robot/kitti_player/state')
OTHER = '/battery/state'
CLOCKS = 9
AHEAD_NS = 86_400_000_000_000
"""How far the recorded clock is ahead of the messages' time."""


def serialized_clock(stamp_ns: int) -> bytes:
    return struct.pack('<4siI', b'\0\1\0\0', *divmod(stamp_ns, 10**9))


def serialized_state(frame: str) -> bytes:
    """A DiagnosticArray without a status."""
    return bytes(TYPESTORE.serialize_cdr(DiagnosticArray(make_header(1, frame), []), DIAGNOSTICS))


def write_recorded(source: Path, path: Path) -> list[int]:
    """Copy an MCAP file and add clocks and states; returns the recorded clock, nanoseconds."""
    with source.open('rb') as copied, path.open('wb') as target:
        writer = Writer(target)
        writer.start(profile='ros2')
        stamps = _copy(make_reader(copied), writer)
        clock = writer.register_schema(CLOCK_TYPE, 'ros2msg', CLOCK_TEXT)
        clock = writer.register_channel(CLOCK, 'cdr', clock)
        times = [stamps[0] + (stamps[-1] - stamps[0]) * n // CLOCKS for n in range(CLOCKS)]
        for at in times:
            writer.add_message(clock, at, serialized_clock(at + AHEAD_NS), at)
        text, _ = TYPESTORE.generate_msgdef(DIAGNOSTICS, ros_version=2)
        schema = writer.register_schema(DIAGNOSTICS, 'ros2msg', text.encode())
        for topic in (*STATES, OTHER):
            channel = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channel, stamps[0], serialized_state(topic), stamps[0])
        writer.finish()
    return [at + AHEAD_NS for at in times]


def _copy(reader: McapReader, writer: Writer) -> list[int]:
    """Copy all messages; returns their log times."""
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    stamps = []
    for schema, channel, message in reader.iter_messages():
        if schema.name not in schemas:
            known = writer.register_schema(schema.name, schema.encoding, schema.data)
            schemas[schema.name] = known
        if channel.topic not in channels:
            metadata = dict(channel.metadata)
            known = writer.register_channel(channel.topic, 'cdr', schemas[schema.name], metadata)
            channels[channel.topic] = known
        at, data = message.log_time, message.data
        writer.add_message(channels[channel.topic], at, data, message.publish_time)
        stamps.append(at)
    return stamps
