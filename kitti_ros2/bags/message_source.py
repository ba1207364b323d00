# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of bags in time order, always as CDR, from any container."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from functools import cached_property, partial
from typing import TYPE_CHECKING

from ..model.errors import BadBagError
from ..model.losses import Loss
from .bag_files import opened, path_of
from .definitions import Definitions
from .findings import Findings
from .foxglove_channels import (
    MissingLibraryError,
    described,
    stored,
    types_of,
    why_unread,
)
from .reading import LENT_FROM, BagMessage, Reading
from .summary import LAST_NS
from .time_order import in_time_order
from .to_cdr import READ, ToCdr, is_stored_as_cdr

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from rosbags.typesys.store import Typestore
    from typing_extensions import Self

    from .bag_files import BagSource
    from .pieces import StoredChannel

_BEGINNING = -(2**63)
_LAST_STORED_NS = 2**64 - 1


class BagMessages:
    """The messages of bags: a context manager, and inside it an iterable in time order.

    Damaged messages are skipped and entered into the findings when they are found, which may be
    while messages are read.

    Args:
        bags: The bags to read; several are merged by time. Those that are open already stay open.
        topics: The topics to read; all of them by default.
        as_stored: For copies: ROS 1 messages are not converted, types without definition are read,
            and the typestore returns the original texts of definitions.
        as_ros: Whether messages with Foxglove's schemas are converted, and log times beyond int64
            become the last one; by default unless as_stored.
        must_read: Whether a requested topic that cannot be read is an error; else it is left out.

    Attributes:
        channels: Topic and type of each channel that is read, sorted by topic.
        sources: The channels as stored in their files, by topic; of several the first.
        left_out: Unreadable channels, of an unsupported encoding or an undefined type, with the
            number of their messages and the reason.
        latched: The depth of each topic that offers its last messages to late subscribers.
        compressions: Names of the compressions known before messages are read.

    Raises:
        BadBagError: A bag cannot be read at all, bags disagree about a topic's type, or the type of
            a topic that must be read is undefined, or defined differently by two bags.
    """

    def __init__(
        self,
        bags: Sequence[BagSource],
        topics: Collection[str] | None = None,
        *,
        as_stored: bool = False,
        as_ros: bool | None = None,
        must_read: bool = True,
    ) -> None:
        self._path = path_of(bags[0])
        self._findings = Findings()
        self._must_read = must_read and topics is not None
        self._as_stored = as_stored
        as_ros = not as_stored if as_ros is None else as_ros
        self._last_ns = LAST_NS if as_ros else _LAST_STORED_NS
        self._to_cdr = ToCdr(lambda: self.typestore, as_stored=as_stored)
        self.left_out: list[tuple[StoredChannel, Loss]] = []
        self._first_lost: dict[tuple[Reading, str], int] = {}
        with ExitStack() as stack:
            entered = [stack.enter_context(opened(bag)) for bag in bags]
            found = [
                (bag.path, path, file)
                for bag in entered
                for path, file in bag.files(self._findings, stack)
            ]
            self._files = [file for _, _, file in found]
            self._readings = {
                (number, channel_id): Reading(
                    number, channel_id, bag, path, channel if as_ros else stored(channel)
                )
                for number, (bag, path, file) in enumerate(found)
                for channel_id, channel in file.channels.items()
                if topics is None or channel.topic in topics
            }
            self.compressions = {'zstd' for bag in entered if bag.located.compression_mode}.union(
                *(file.compressions for file in self._files)
            )
            self._leave_out_encodings()
            self._leave_out_second_types()
            self._define()
            self._prepare()
            self._stack = stack.pop_all()
        readings = self._readings.values()
        self.sources = {each.channel.topic: each.channel for each in reversed(readings)}
        self.channels = tuple(sorted((topic, each.msgtype) for topic, each in self.sources.items()))
        self.latched = {
            each.channel.topic: each.channel.depth for each in readings if each.channel.latched
        }

    @cached_property
    def typestore(self) -> Typestore:
        """The types as the bags themselves define them, to decode the data with.

        Made when first used: generating the classes of types that are new to the process takes
        35 ms, and many readers do without.
        """
        store = self._definitions.typestore()
        return self._definitions.with_original_texts(store) if self._as_stored else store

    @property
    def complete(self) -> bool:
        """Whether no file is known to be truncated or damaged, as far as it was read."""
        return self._findings.complete

    @property
    def findings(self) -> tuple[str, ...]:
        """Notes and losses found so far, one line each."""
        return self._findings.lines

    @property
    def expected(self) -> int:
        """Number of messages listed in the files, including those in damaged pieces."""
        return sum(map(self._count, self._readings.values()))

    @property
    def losses(self) -> dict[str, int | None]:
        """The damage, one line each, with the number of messages lost; None if unknown."""
        return dict(self._findings.losses)

    def skim(self, is_enough: Callable[[str], bool]) -> None:
        """Let the MessageStart of a large message do, where files save work by it.

        Args:
            is_enough: Asked with a topic before a message of it is read, which may be before the
                message before it is yielded if a topic is in several files. It is also asked some
                messages ahead, without effect on what is yielded.
        """
        known: list[dict[int, str]] = [{} for _ in self._files]
        for each in self._readings.values():
            if is_stored_as_cdr(each.channel):
                known[each.number][each.channel_id] = each.channel.topic
        for file, topics in zip(self._files, known, strict=True):
            file.is_start_enough = partial(_is_enough, topics, is_enough)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; does nothing if they are closed."""
        self._stack.close()

    def __iter__(self) -> Iterator[BagMessage]:
        return self.since(None)

    def since(self, start_ns: int | None) -> Iterator[BagMessage]:
        """Yield the messages from a log time on; None is the beginning."""
        channels: list[set[int]] = [set() for _ in self._files]
        for number, channel_id in self._readings:
            channels[number].add(channel_id)
        files = list(zip(self._files, channels, strict=True))
        since_ns = _BEGINNING if start_ns is None else start_ns
        for number, (stamp_ns, channel_id, data) in in_time_order(files, since_ns):
            reading = self._readings[number, channel_id]
            try:
                cdr = self._to_cdr(reading.channel, data, stamp_ns)
            except Exception as error:  # noqa: BLE001 - converters may raise anything
                self._lose(reading, stamp_ns, error)
                continue
            if isinstance(cdr, memoryview) and len(cdr) < LENT_FROM:
                cdr = bytes(cdr)
            channel = reading.channel
            yield BagMessage(channel.topic, channel.msgtype, min(stamp_ns, self._last_ns), cdr)

    def _lose(self, reading: Reading, stamp_ns: int, error: Exception) -> None:
        """Enter a lost message; those of one topic and reason share one line."""
        reason = ' '.join(str(error).split())
        first_ns = self._first_lost.setdefault((reading, reason), stamp_ns)
        place = f'{reading.file}: messages of {reading.channel.topic} from {first_ns} on'
        self._findings.lose_one(f'{place} cannot be read ({reason})')

    def _leave_out_encodings(self) -> None:
        """Skip channels that cannot be converted to CDR.

        Raises:
            BadBagError: No channel is left.
        """
        found: set[str] = set()
        for reading in list(self._readings.values()):
            channel = reading.channel
            if channel.encoding not in READ:
                found.add(channel.encoding)
                self._leave_out(reading, why_unread(channel))
        if found and not self._readings:
            kinds = ', '.join(each or 'an encoding that is not named' for each in sorted(found))
            expected = 'messages in cdr or of ROS 1, of which none is there'
            raise BadBagError(self._path, f'has messages in {kinds}', expected)

    def _leave_out(self, reading: Reading, text: str) -> None:
        """Skip a channel that is undamaged: a loss only if the bag is copied."""
        del self._readings[reading.number, reading.channel_id]
        reason = f'{reading.file}: {text}'
        channel, count = reading.channel, self._count(reading)
        self.left_out.append((channel, Loss(channel.topic, count, reason)))
        if self._as_stored:
            self._findings.lose(reason, count)
        else:
            self._findings.note(reason)

    def _leave_out_second_types(self) -> None:
        """Read only the first type of each topic.

        Raises:
            BadBagError: Bags disagree about the type.
        """
        first: dict[str, Reading] = {}
        for reading in list(self._readings.values()):
            topic, msgtype = reading.channel.topic, reading.channel.msgtype
            known = first.setdefault(topic, reading)
            if known.channel.msgtype == msgtype:
                continue
            both = f'{topic} is {msgtype} here, and {known.channel.msgtype}'
            if known.bag != reading.bag:
                expected = 'bags of one recording, which agree; give those of the other apart'
                raise BadBagError(reading.bag, f'{both} in {known.bag}', expected)
            self._lose_channel(reading, f'{both} before; the latter is read')

    def _define(self) -> None:
        """Make the typestore, and skip topics of undefined types.

        Raises:
            BadBagError: Such a topic was requested by name.
        """
        definitions = Definitions(self._findings)
        for reading in list(self._readings.values()):
            conflict = definitions.add(reading.bag, reading.file, described(reading.channel))
            if conflict:
                self._leave_out_undefined(reading, conflict)
        needed = {name for each in self._readings.values() for name in types_of(each.channel)}
        undefined = definitions.complete(needed)
        self._definitions = definitions
        reasons = {
            msgtype: f'neither the bag nor ROS 2 Jazzy defines {msgtype or "a type without a name"}'
            for msgtype in sorted(undefined)
        }
        if self._as_stored:
            for reason in reasons.values():
                self._findings.note(f'{self._path}: {reason}; it is copied as it is')
            return
        for reading in list(self._readings.values()):
            lacking = [name for name in types_of(reading.channel) if name in reasons]
            if lacking:
                self._leave_out_undefined(reading, reasons[lacking[0]])

    def _prepare(self) -> None:
        """Skip channels whose messages cannot be converted.

        Raises:
            MissingLibraryError: A library is not installed, and a topic was requested by name, or
                nothing can be read without it.
        """
        encodings = {stored(each.channel).encoding for each in self._readings.values()}
        for reading in list(self._readings.values()):
            try:
                self._to_cdr.prepare(reading.channel, self._definitions)
            except MissingLibraryError as error:
                if self._must_read or encodings == {'protobuf'}:
                    raise
                self._lose_channel(reading, str(error))
            except ValueError as error:
                self._lose_channel(reading, f'{reading.channel.topic} cannot be read: {error}')

    def _leave_out_undefined(self, reading: Reading, reason: str) -> None:
        text = f'{reading.channel.topic} cannot be read: {reason}'
        if self._must_read:
            raise BadBagError(reading.bag, text, 'a definition that holds for all that is read')
        if reading.channel.definition.strip():
            # The definition is present but unusable: it may be damaged.
            self._lose_channel(reading, text)
        else:
            self._leave_out(reading, text)

    def _lose_channel(self, reading: Reading, text: str) -> None:
        """Skip a channel whose messages are lost."""
        del self._readings[reading.number, reading.channel_id]
        self._findings.lose(f'{reading.file}: {text}', self._count(reading))

    def _count(self, reading: Reading) -> int:
        return self._counts[reading.number][reading.channel_id]

    @cached_property
    def _counts(self) -> list[Counter[int]]:
        """Messages by file and channel id: a sum for each channel would take channels x pieces."""
        found: list[Counter[int]] = [Counter() for _ in self._files]
        for file, counts in zip(self._files, found, strict=True):
            for piece in file.pieces:
                counts.update(piece.counts)
        return found


def _is_enough(
    topics: Mapping[int, str], is_enough: Callable[[str], bool], channel_id: int
) -> bool:
    return channel_id in topics and is_enough(topics[channel_id])
