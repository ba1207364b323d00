# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A few frames of a conversion: their choice, and the part of the bags that they are read from."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .sync import NONE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from ..bags.reader import BagMessage, BagMessages
    from ..model.samples import Int64Array
    from ..model.streams import Stream
    from .frames import Frames
    from .survey import Survey

_MARGIN_NS = 100_000_000
"""Read before and after each sample: messages of one moment are logged one after the other."""


class Excerpt:
    """The first and the last frame of a conversion, and those at even distances between them.

    Frames with a sample of every stream are preferred.

    Args:
        most: Number of frames.

    Attributes:
        numbers: (K,) those that were chosen, by position in the conversion; K <= most.
        stamps_ns: (K,) of these frames.
        total: Number of frames of the conversion.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.numbers: Int64Array = np.zeros(0, np.int64)
        self.stamps_ns: Int64Array = np.zeros(0, np.int64)
        self.total = 0

    def of(self, frames: Frames) -> Frames:
        """Return the chosen frames of a conversion."""
        self.total = len(frames)
        present = np.zeros(len(frames), np.int64)
        for places in frames.samples.values():
            present += places != NONE
        self.numbers = spread(present, self._most)
        self.stamps_ns = frames.stamps_ns[self.numbers]
        samples = {stream: places[self.numbers] for stream, places in frames.samples.items()}
        return replace(frames, stamps_ns=self.stamps_ns, samples=samples)

    def read(
        self,
        messages: BagMessages,
        survey: Survey,
        frames: Frames,
        topics: Mapping[Stream, str],
    ) -> Iterator[tuple[int, BagMessage]]:
        """Yield messages around the samples of frames, each with its place in its topic.

        Args:
            messages: The bags.
            survey: The log times of all their messages.
            frames: The chosen ones.
            topics: By stream of the frames its topic.
        """
        log_ns = {topic: survey.topics[topic].log_ns for topic, _ in messages.channels}
        moments = [
            log_ns[topics[stream]][place]
            for stream, places in frames.samples.items()
            for place in places.tolist()
            if place != NONE and topics[stream] in log_ns
        ]
        for start_ns, end_ns in _spans(sorted(moments)):
            seen = {topic: bisect_left(stamps, start_ns) for topic, stamps in log_ns.items()}
            for message in messages.since(start_ns):
                if message.stamp_ns > end_ns:
                    break
                yield seen[message.topic], message
                seen[message.topic] += 1


def spread(present: Int64Array, most: int) -> Int64Array:
    """Return the positions of the first and the last frame, and of those evenly between them.

    Args:
        present: (N,) number of streams that have a sample in each frame; only frames with the most
            are taken.
        most: Number of frames.
    """
    best = np.flatnonzero(present == present.max())
    steps = np.linspace(0, len(best) - 1, min(most, len(best)))
    return np.asarray(best[np.rint(steps).astype(np.int64)], np.int64)


def numbered(messages: Iterable[BagMessage]) -> Iterator[tuple[int, BagMessage]]:
    """Yield all messages of bags, each with its place in its topic."""
    seen: Counter[str] = Counter()
    for message in messages:
        yield seen[message.topic], message
        seen[message.topic] += 1


def _spans(moments: Sequence[int]) -> list[tuple[int, int]]:
    """Return the parts of the time to read, from and to, ascending and apart."""
    found: list[tuple[int, int]] = []
    for moment in moments:
        start_ns, end_ns = moment - _MARGIN_NS, moment + _MARGIN_NS
        if found and start_ns <= found[-1][1]:
            start_ns = found.pop()[0]
        found.append((start_ns, end_ns))
    return found
