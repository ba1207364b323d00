# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag as they are stored, and an MCAP file of such messages."""

from __future__ import annotations

from collections import Counter
from io import BytesIO
from typing import TYPE_CHECKING

from mcap.writer import CompressionType, Writer

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.messages.ros_types import TYPESTORE

from bags.bag_samples import jazzy  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

Stored = tuple[str, str, int, bytes]
"""Topic, type, stamp and data of a message."""


def make_mcap(messages: list[Stored], **options) -> bytes:
    """An MCAP file; no checksum stops mutations."""
    target = BytesIO()
    options.setdefault('compression', CompressionType.NONE)
    writer = Writer(target, enable_crcs=False, enable_data_crcs=False, **options)
    writer.start(profile='ros2')
    channels: dict[str, int] = {}
    for topic, kind, stamp_ns, data in messages:
        store = TYPESTORE if kind in TYPESTORE.fielddefs else jazzy()
        text = store.generate_msgdef(kind, ros_version=2)[0]
        if topic not in channels:
            schema = writer.register_schema(kind, 'ros2msg', text.encode())
            channels[topic] = writer.register_channel(topic, 'cdr', schema)
        channel = channels[topic]
        writer.add_message(channel, stamp_ns, data, stamp_ns)
    writer.add_metadata('m', {'a': 'b'})
    writer.add_attachment(1, 1, 'a', 'text/plain', b'content')
    writer.finish()
    return target.getvalue()


def messages_of(path: Path) -> list[Stored]:
    """The first messages of each topic."""
    counts: Counter[str] = Counter()
    found = []
    with open_messages(path) as messages:
        for each in messages:
            counts[each.topic] += 1
            if counts[each.topic] <= (20 if 'source' in each.topic else 2):
                found.append((each.topic, each.msgtype, each.stamp_ns, bytes(each.data)))
    return found
