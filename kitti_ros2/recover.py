# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag that was cut off or damaged -> a sound bag of every message that can be read."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .bags.reader import open_messages
from .bags.writer import Channel, open_bag
from .errors import BadBagError
from .samples import Loss

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .bags.reader import BagMessages
    from .bags.writer import BagWriter
    from .options import BagOptions

_DEPTH = 10


@dataclass(frozen=True)
class Recovery:
    """What was recovered.

    Attributes:
        path: The sound bag.
        counts: Messages by topic.
        size_bytes: Of all messages.
        losses: What is damaged or cannot be read, each with its place.
        notes: What is worth a word and no loss.
    """

    path: Path
    counts: dict[str, int]
    size_bytes: int
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def recover(
    path: Path,
    out: Path,
    bag: BagOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> Recovery:
    """Write what a bag still holds: types as it defines them, log times and latching kept.

    Messages keep their bytes; those of ROS 1 pass through CDR, so the seq of their headers is 0.

    Args:
        path: The bag to read.
        out: The bag to write.
        bag: Container and compression.
        progress: Called with the messages and the bytes written so far.

    Raises:
        BadBagError: Nothing of it can be read.
        OutputExistsError: The output exists and the options do not overwrite.
        OutputError: The output cannot be written.
        UsageError: The options do not fit the output.
    """
    with open_messages(path) as messages:
        if not messages.channels:
            raise BadBagError(path, 'holds nothing that can be recovered')
        with open_bag(out, bag, messages.typestore) as writer:
            counts, size_bytes = _copy(messages, writer, progress)
            if not counts:
                raise BadBagError(path, 'holds no message that can be recovered')
        losses = tuple(Loss(path.name, count or 1, text) for text, count in messages.losses.items())
        notes = tuple(text for text in messages.warnings if text not in messages.losses)
    return Recovery(writer.path, counts, size_bytes, losses, notes)


def _copy(
    messages: BagMessages, writer: BagWriter, progress: Callable[[int, int], None]
) -> tuple[dict[str, int], int]:
    ids: dict[str, int] = {}
    counts: Counter[str] = Counter()
    size_bytes = 0
    for done, message in enumerate(messages, 1):
        topic = message.topic
        if topic not in ids:
            depth = messages.latched.get(topic, _DEPTH)
            latched = topic in messages.latched
            ids[topic] = writer.add_channel(
                Channel(topic, message.msgtype, latched=latched, depth=depth)
            )
        writer.write(ids[topic], message.stamp_ns, (message.data,))
        counts[topic] += 1
        size_bytes += len(message.data)
        progress(done, size_bytes)
    return dict(counts), size_bytes
