# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's file numbers of the messages in a bag written by to-bag.

All commands that address the frames of a bag use these numbers. The description in the bag and its
text files map stamps to numbers. A bag recorded from a player has other log times: its messages are
identified by the stamps in their headers, and texts by the names in them.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..bags.reader import open_messages, path_of
from ..exporter.schedule import UNKNOWN, frame_runs, frames_of, nearest_frames
from ..kitti.layout_files import LAYOUTS
from ..messages.header import peek_header
from ..messages.moment import Origin
from ..messages.topics import decoders, own_topics
from ..model.msgtypes import ANNOTATIONS, MARKERS, STRING, TF_TYPES
from ..model.streams import FRAME_STREAMS, Clock, Stream
from ..options.read import ScanStamp
from .folders import owner_of
from .recorded_layout import find_blueprint
from .stamp_numbers import StampNumbers, row_frames

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from ..bags.reader import BagSource
    from ..model.samples import Int64Array, TextFile
    from .blueprint import Blueprint

BY_POSITION = 'frames of this bag are numbered by position, from 0'
"""The remark on a bag that was not written by to-bag."""

_HEADLESS = frozenset({ANNOTATIONS, STRING, MARKERS, *TF_TYPES})


class NumberedTopic(NamedTuple):
    """A topic whose messages are samples.

    Attributes:
        stream: Their stream.
        log_ns: (N,) log times, nanoseconds, ascending.
        stamps_ns: (N,) the samples' own stamps.
        numbers: (N,) KITTI's file numbers, UNKNOWN for a message with an unknown stamp.
    """

    stream: Stream
    log_ns: Int64Array
    stamps_ns: Int64Array
    numbers: Int64Array

    @property
    def is_numbered(self) -> bool:
        """Whether any number is known."""
        return bool((self.numbers != UNKNOWN).any())


class NumberedBag(NamedTuple):
    """The messages of a bag written by to-bag with KITTI's numbers.

    Attributes:
        blueprint: The layout of the recording.
        topics: By name; topics of the recording as a whole are absent.
    """

    blueprint: Blueprint
    topics: Mapping[str, NumberedTopic]

    @property
    def frames(self) -> Int64Array:
        """(N,) the numbers of its frames, ascending; see samples.FRAME_STREAMS."""
        return frames_of(self.by_stream(), common=self.common)

    @property
    def common(self) -> bool:
        """Whether a number is the same moment in all streams; not in a raw extract."""
        return has_common_numbers(self.blueprint)

    @property
    def clock(self) -> Clock:
        """The meaning of its stamps."""
        return clock_of(self.blueprint)

    def frames_at(self, stamps_ns: Int64Array, topics: Collection[str]) -> Int64Array:
        """Return (N,) the frame of each of (N,) messages.

        Args:
            stamps_ns: (N,) log times of the messages of some topics, ascending; those in the index
                of a damaged bag may differ from those of its messages.
            topics: Their names.
        """
        if not self.common:
            return nearest_frames(stamps_ns, *self._reference())
        log_ns = np.concatenate([each.log_ns for each in self.topics.values()])
        numbers = np.concatenate([each.numbers for each in self.topics.values()])
        order = np.lexsort((numbers, log_ns))
        last = np.searchsorted(log_ns[order], stamps_ns, 'right') - 1
        frames = frame_runs(numbers[order])[np.maximum(last, 0)]
        for each in (self.topics[topic] for topic in topics if topic in self.topics):
            known = (each.numbers != UNKNOWN) & np.isin(each.log_ns, stamps_ns)
            frames[np.searchsorted(stamps_ns, each.log_ns[known])] = each.numbers[known]
        return frames

    def _reference(self) -> tuple[Int64Array, Int64Array]:
        """Return log times and numbers of the stream that defines frames without common numbers."""
        present = self.by_stream()
        stream = next(each for each in FRAME_STREAMS if len(present.get(each, ())))
        topic = next(t for t in self.topics.values() if t.stream is stream and t.is_numbered)
        known = topic.numbers != UNKNOWN
        log_ns = topic.log_ns[known]
        if stream is Stream.SCAN and self.blueprint.scan_stamp is ScanStamp.START:
            # Images come after facing forward: between both is the middle of a frame.
            log_ns = log_ns + self.blueprint.period_ns // 4
        return log_ns, frame_runs(topic.numbers[known])

    def by_stream(self) -> dict[Stream, Int64Array]:
        """Return by stream (N,) the file numbers of its topics, ascending."""
        found: dict[Stream, list[Int64Array]] = {}
        for each in self.topics.values():
            found.setdefault(each.stream, []).append(each.numbers[each.numbers != UNKNOWN])
        return {stream: np.unique(np.concatenate(parts)) for stream, parts in found.items()}


def has_common_numbers(blueprint: Blueprint) -> bool:
    """Whether a file number is the same moment in all streams of a recording."""
    return not blueprint.layout.traits.is_extract(blueprint.name)


def clock_of(blueprint: Blueprint) -> Clock:
    """Return the meaning of a recording's stamps, by the time files in its bag."""
    if blueprint.times is not None:
        return Clock.UTC
    files = {path.name for path in blueprint.texts}
    is_stamped = LAYOUTS[blueprint.layout].stamps in files
    return blueprint.layout.traits.clock if is_stamped else Clock.NOMINAL


def number_bag(
    bag: BagSource,
    log_ns: Mapping[str, Int64Array],
    *,
    blueprint: Blueprint | None = None,
    by_header: bool = True,
) -> NumberedBag | None:
    """Map the messages of a bag to KITTI's numbers.

    Args:
        bag: Any bag.
        log_ns: Log times by topic, (N,) nanoseconds, ascending.
        blueprint: Its layout, if already read.
        by_header: Whether a bag with other log times is read to get the stamps in its headers.

    Returns:
        None for a bag that was not written by to-bag, or whose stamps are not those of its
        recording: its frames are numbered by position.

    Raises:
        OSError: It cannot be read.
    """
    try:
        blueprint = blueprint or find_blueprint(bag)
        if blueprint is None:
            return None
        streams = {
            row.topic: row.stream
            for row in own_topics().values()
            if row.stream in FRAME_STREAMS or row.stream in blueprint.folders
        }
        mapped = StampNumbers(blueprint)
        found = _by_log(mapped, {t: (streams[t], log_ns[t]) for t in streams if t in log_ns})
        if by_header and not _is_numbered(found):
            found = _by_header(bag, mapped, streams)
    except OSError:
        raise
    except Exception:  # noqa: BLE001 - a description may hold anything; reading the bag names damage
        return None
    return NumberedBag(blueprint, found) if _is_numbered(found) else None


def _is_numbered(topics: Mapping[str, NumberedTopic]) -> bool:
    return any(each.stream in FRAME_STREAMS and each.is_numbered for each in topics.values())


def _by_log(
    mapped: StampNumbers, topics: Mapping[str, tuple[Stream, Int64Array]]
) -> dict[str, NumberedTopic]:
    """Number by log time, which is the sample's own stamp in a bag written by to-bag."""
    return {
        name: NumberedTopic(stream, log_ns, log_ns, mapped.of(stream, log_ns))
        for name, (stream, log_ns) in topics.items()
    }


def _by_header(
    bag: BagSource, mapped: StampNumbers, streams: Mapping[str, Stream]
) -> dict[str, NumberedTopic]:
    """Number by the stamps in headers, and by the names in texts."""
    found: dict[str, list[tuple[int, int, int]]] = {}
    with open_messages(bag, set(streams), must_read=False) as messages:
        for message in messages:
            stamp_ns, number = message.stamp_ns, UNKNOWN
            try:
                if own_topics()[message.topic].is_frame_text:
                    decoded = messages.typestore.deserialize_cdr(message.data, message.msgtype)
                    text = decoders()[message.topic](decoded, Origin(path_of(bag)))
                    number = _named(text, mapped.blueprint, streams[message.topic])
                elif message.msgtype not in _HEADLESS:
                    stamp_ns, _ = peek_header(message.data)
                else:
                    continue
            except Exception:  # noqa: BLE001, S112 - damage is reported where the bag is read
                continue
            row = (message.stamp_ns, stamp_ns, number)
            found.setdefault(message.topic, []).append(row)
    topics = {}
    for name, rows in found.items():
        log_ns, stamps_ns, numbers = np.array(rows, dtype=np.int64).T
        if not own_topics()[name].is_frame_text:
            order = np.argsort(stamps_ns, kind='stable')
            numbers[order] = mapped.of(streams[name], stamps_ns[order])
        topics[name] = NumberedTopic(streams[name], log_ns, stamps_ns, numbers)
    return topics


def _named(text: TextFile, blueprint: Blueprint, stream: Stream) -> int:
    """Return the frame of a text, by the name of its file or by its first column."""
    if stream in blueprint.layout.traits.line_streams:
        return (
            next(row_frames(text.text.splitlines()), UNKNOWN)
            if stream is Stream.LABELS
            else UNKNOWN
        )
    owner = owner_of(PurePosixPath(text.name), blueprint.folders)
    return UNKNOWN if owner is None else owner[1]
