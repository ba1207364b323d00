# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of bags of any container: summaries, and messages in time order."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property, partial
from heapq import heappop, heappush, heapreplace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from ..files.remote import canonical_path
from ..files.threads import SpareThreads, ThreadTask
from ..kitti.recording_index import turn_length
from ..messages.cdr import lacking_field
from ..messages.naming import RECORDING, SWEEP
from ..messages.source_texts import decode_description, decode_sweep
from ..model.bag_formats import STRING
from ..model.errors import BadBagError, Loss, UsageError, format_count
from ..options.read import NOMINAL_PERIOD_NS, ScanStamp, is_period
from .bag_files import BagSource, OpenBag, opened, path_of
from .container_file import (
    LAST_NS,
    BagIndex,
    BagSummary,
    Problems,
    TopicSummary,
    UnreadMessage,
    Wanted,
    summarize,
)
from .stored_messages import (
    READ,
    CdrConverter,
    Definitions,
    MissingLibraryError,
    defining_channel,
    has_starts,
    may_be_lossy,
    ros_channel,
    stored_channel,
    types_of,
    why_unread,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

    from rosbags.typesys.store import Typestore
    from typing_extensions import Self

    from ..messages.ros_types import String
    from ..model.samples import Int64Array
    from .container_file import (
        BagFile,
        Chunk,
        FetchedChunk,
        FoundMessage,
        IndexedMessage,
        StoredChannel,
    )


# A message read from a bag, and a channel that messages are read from.
#
# Nothing that outlives a message refers to the chunk that it was read from: one number that is kept
# would keep megabytes. Small messages have bytes of their own. Large ones are views of their chunk,
# for it takes long to copy them: see Decoder.

LENT_FROM = 2**16
"""Bytes of the smallest message that may be a view of its chunk."""


class BagMessage(NamedTuple):
    """One message.

    Attributes:
        topic: Topic name.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        stamp_ns: Log time, nanoseconds since 1970.
        data: CDR with its encapsulation header; ROS 1 messages are converted. A memoryview is of a
            chunk: what is kept of it must be copied. After BagMessages.skim perhaps only its
            MessageStart.
    """

    topic: str
    msgtype: str
    stamp_ns: int
    data: bytes | memoryview


class Reading(NamedTuple):
    """A channel that is read, with the number of its file, its id there, and bag and file."""

    number: int
    channel_id: int
    bag: Path
    file: Path
    channel: StoredChannel


# The merge of the messages of a bag's files by time.
#
# A chunk is read when its time comes and dropped after its last message, so merging a bag of any
# size takes the memory of the chunks that overlap, and of a few that threads read ahead of their
# turn.

_AHEAD = 4
_LEAST_FETCHED = 2**16  # handing over a smaller chunk costs as much as reading it
_MOST_FETCHED = 2**23  # bytes of all chunks ahead: they are the larger part of the memory


def in_time_order(
    files: Sequence[tuple[BagFile, Wanted]],
) -> Iterator[tuple[int, FoundMessage]]:
    """Yield the messages of files that are requested of each, with the number of their file."""
    # By stamp, file and position, which are unique, so messages are never compared.
    active: list[tuple[int, int, int, FoundMessage, Iterator[FoundMessage]]] = []
    with _ChunkQueue(files) as queue:
        while True:
            while queue.start_ns is not None and (not active or queue.start_ns <= active[0][0]):
                number, position, chunk_messages = queue.take()
                messages = iter(chunk_messages)
                first = next(messages, None)
                if first is not None:
                    heappush(active, (first[0], number, position, first, messages))
            if not active:
                return
            _, number, position, message, messages = active[0]
            yield number, message
            following = next(messages, None)
            if following is None:
                heappop(active)
            else:
                heapreplace(active, (following[0], number, position, following, messages))


class _ChunkQueue:
    """The chunks in the order of their first stamps; those that are next are read in threads.

    Their number grows with the number of chunks taken: a reader of the first message only does not
    wait for others. Chunks of which single messages are read, a few bytes, wait for their turn.
    """

    def __init__(self, files: Sequence[tuple[BagFile, Wanted]]) -> None:
        self._files = files
        waiting = [
            (number, chunk)
            for number, (file, (channel_ids, since_ns, until_ns)) in enumerate(files)
            for chunk in file.chunks
            if chunk.end_ns >= since_ns
            and chunk.start_ns <= until_ns
            and not chunk.counts.keys().isdisjoint(channel_ids)
        ]
        waiting.sort(key=lambda pair: (pair[1].start_ns, pair[0], pair[1].position))
        self._waiting = deque(waiting)
        self._ahead: deque[ThreadTask[FetchedChunk] | Sequence[IndexedMessage] | None] = deque()
        self._most_ahead = 0
        self._threads = SpareThreads()

    @property
    def start_ns(self) -> int | None:
        """The first stamp of the next chunk; None after the last one."""
        return self._waiting[0][1].start_ns if self._waiting else None

    def take(self) -> tuple[int, int, Iterable[FoundMessage]]:
        """Read the next chunk: the number of its file, its position, and its messages."""
        number, chunk = self._waiting.popleft()
        file, wanted = self._files[number]
        ahead = self._ahead.popleft() if self._ahead else file.select(chunk, wanted)
        fitting = max(1, _MOST_FETCHED // max(1, chunk.length))
        self._most_ahead = min(self._most_ahead + 1, _AHEAD, fitting)
        while len(self._ahead) < min(self._most_ahead, len(self._waiting)):
            self._ahead.append(self._request(*self._waiting[len(self._ahead)]))
        # Reads that failed in a thread are repeated here, where errors are handled.
        if isinstance(ahead, ThreadTask):
            return (
                number,
                chunk.position,
                file.read(chunk, wanted, None if ahead.error() else ahead.result()),
            )
        return number, chunk.position, file.read(chunk, wanted, ahead)

    def _request(
        self, number: int, chunk: Chunk
    ) -> ThreadTask[FetchedChunk] | Sequence[IndexedMessage] | None:
        file, wanted = self._files[number]
        selected = file.select(chunk, wanted)
        if selected is not None:
            return selected
        can_fetch = file.fetches and _LEAST_FETCHED <= chunk.length <= _MOST_FETCHED
        ahead = self._threads.submit(file.fetch, chunk) if can_fetch else None
        if ahead is None:
            file.expect(chunk)
        return ahead

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.close()


# The messages of bags in time order, always as CDR, from any container.

_BEGINNING = -(2**63)
_LAST_STORED_NS = 2**64 - 1


class BagMessages:
    """The messages of bags: a context manager, and inside it an iterable in time order.

    Damaged messages are skipped, and entered as losses when they are found, which may be
    while messages are read.

    Args:
        bags: The bags to read; several are merged by time. Those that are open already stay open.
        topics: The topics to read; all of them by default.
        as_stored: For copies: ROS 1 messages are not converted, types without definition are read,
            and the typestore returns the original texts of definitions. Chunks are read whole.
        as_ros: Whether messages with Foxglove's schemas are converted, and log times beyond int64
            become the last one; by default unless as_stored.
        converted: For copies: encodings whose messages are converted to CDR all the same.
        must_read: Whether a requested topic that cannot be read is an error; else it is left out.

    Attributes:
        channels: Topic and type of each channel that is read, sorted by topic.
        sources: The channels as stored in their files, by topic; of several the first.
        left_out: Unreadable channels, of an unsupported encoding or an undefined type, with the
            number of their messages and the reason.
        latched: The depth of each topic that offers its last messages to late subscribers.
        compressions: Names of the compressions known before messages are read.
        earlier_losses: What the messages read so far had lost before they were stored, one line
            each, as those of compressed clouds.

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
        converted: Collection[str] = (),
        must_read: bool = True,
    ) -> None:
        self._path = path_of(bags[0])
        self._problems = Problems()
        self._must_read = must_read and topics is not None
        self._as_stored = as_stored
        self._converted = frozenset(converted) if as_stored else READ
        as_ros = not as_stored if as_ros is None else as_ros
        self._last_ns = LAST_NS if as_ros else _LAST_STORED_NS
        self._converter = CdrConverter(
            lambda: self.typestore,
            self._note_earlier_loss,
            converts_ros1='ros1' in self._converted,
        )
        self.left_out: list[tuple[StoredChannel, Loss]] = []
        self.earlier_losses: dict[str, None] = {}
        self._first_lost: dict[tuple[Reading, str], int] = {}
        with ExitStack() as exit_stack:
            entered = [exit_stack.enter_context(opened(bag)) for bag in bags]
            files = [
                (bag.path, path, file)
                for bag in entered
                for path, file in bag.files(self._problems, exit_stack)
            ]
            self._files = [file for _, _, file in files]
            for file in self._files:
                file.whole_chunks |= as_stored
            if as_stored and not as_ros:
                self._lose_attachments(files)
            self._readings = {
                (number, channel_id): Reading(
                    number,
                    channel_id,
                    bag,
                    path,
                    channel if as_ros else self._as_copied(channel),
                )
                for number, (bag, path, file) in enumerate(files)
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
            self._exit_stack = exit_stack.pop_all()
        readings = self._readings.values()
        self.sources = {reading.channel.topic: reading.channel for reading in reversed(readings)}
        self.channels = tuple(
            sorted((topic, channel.msgtype) for topic, channel in self.sources.items())
        )
        self.latched = {
            reading.channel.topic: reading.channel.depth
            for reading in readings
            if reading.channel.latched
        }

    @cached_property
    def typestore(self) -> Typestore:
        """The types as the bags themselves define them, to decode the data with.

        Made when first used: generating the classes of types that are new to the process takes
        35 ms, and many readers do without.
        """
        store = self._definitions.typestore()
        return self.with_texts(store) if self._as_stored else store

    def with_texts(self, typestore: Typestore) -> Typestore:
        """Return a store of types whose definition texts are those of the bags: see Definitions."""
        return self._definitions.with_original_texts(typestore)

    @property
    def complete(self) -> bool:
        """True if no file is known to be truncated or damaged, as far as it was read."""
        return self._problems.complete

    @property
    def problems(self) -> tuple[str, ...]:
        """Notes and losses found so far, one line each."""
        return self._problems.lines

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes found so far, one line each."""
        return tuple(self._problems.notes)

    @property
    def expected(self) -> int:
        """Number of messages listed in the files, including those in damaged chunks."""
        return sum(map(self._count, self._readings.values()))

    @property
    def losses(self) -> dict[str, int | None]:
        """The damage, one line each, with the number of messages lost; None if unknown."""
        return dict(self._problems.losses)

    def skim(self, is_enough: Callable[[str], bool]) -> None:
        """Let the MessageStart of a large message do, where files save work by it.

        Args:
            is_enough: Asked with a topic before a message of it is read.
        """
        cdr_topics: list[dict[int, str]] = [{} for _ in self._files]
        for reading in self._readings.values():
            if has_starts(reading.channel):
                cdr_topics[reading.number][reading.channel_id] = reading.channel.topic
        for file, topics in zip(self._files, cdr_topics, strict=True):
            file.is_start_enough = partial(_is_enough, topics, is_enough)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; does nothing if they are closed."""
        self._exit_stack.close()

    def __iter__(self) -> Iterator[BagMessage]:
        return self.since(None)

    def since(self, start_ns: int | None) -> Iterator[BagMessage]:
        """Yield the messages from a log time on; None is the beginning."""
        return self._between(_BEGINNING if start_ns is None else start_ns, _LAST_STORED_NS)

    def at(self, topic: str, stamp_ns: int) -> Iterator[BagMessage]:
        """Yield the messages of a topic with a log time."""
        return self._between(stamp_ns, stamp_ns if stamp_ns < LAST_NS else _LAST_STORED_NS, topic)

    def _between(self, since_ns: int, until_ns: int, topic: str = '') -> Iterator[BagMessage]:
        channels: list[set[int]] = [set() for _ in self._files]
        for (number, channel_id), reading in self._readings.items():
            if topic in ('', reading.channel.topic):
                channels[number].add(channel_id)
        files = [
            (file, Wanted(channel_ids, since_ns, until_ns))
            for file, channel_ids in zip(self._files, channels, strict=True)
        ]
        for number, (stamp_ns, channel_id, stored) in in_time_order(files):
            reading = self._readings[number, channel_id]
            data = stored.read() if isinstance(stored, UnreadMessage) else stored
            if data is None:
                continue
            try:
                cdr = self._converter(reading.channel, data, stamp_ns)
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
        which = f'{reading.file}: messages of {reading.channel.topic} from {first_ns} on'
        self._problems.lose_one(f'{which} cannot be read ({reason})')

    def _lose_attachments(self, files: Iterable[tuple[Path, Path, BagFile]]) -> None:
        for _, path, file in files:
            if file.attachments:
                count = format_count(file.attachments, 'attachment')
                self._problems.lose(f'{path}: {count} of MCAP cannot be copied', 0)

    def _note_earlier_loss(self, text: str) -> None:
        self.earlier_losses[text] = None
        self._problems.note(f'{self._path}: {text}')

    def _as_copied(self, channel: StoredChannel) -> StoredChannel:
        """Return a channel as stored, unless its messages are converted from outside of ROS."""
        stored = stored_channel(channel)
        is_converted = stored.encoding in self._converted - READ
        return ros_channel(stored, for_copy=True) if is_converted else stored

    def _leave_out_encodings(self) -> None:
        """Skip channels that cannot be converted to CDR.

        Raises:
            BadBagError: No channel is left.
        """
        encodings: set[str] = set()
        for reading in list(self._readings.values()):
            channel = reading.channel
            if channel.encoding not in READ:
                encodings.add(channel.encoding)
                self._leave_out(reading, why_unread(channel))
        if encodings and not self._readings:
            kinds = ', '.join(name or 'an encoding that is not named' for name in sorted(encodings))
            expected = 'messages in cdr or of ROS 1, of which none is there'
            raise BadBagError(self._path, f'has messages in {kinds}', expected)

    def _leave_out(self, reading: Reading, text: str) -> None:
        """Skip a channel that is undamaged: a loss only if the bag is copied."""
        del self._readings[reading.number, reading.channel_id]
        reason = f'{reading.file}: {text}'
        channel, count = reading.channel, self._count(reading)
        self.left_out.append((channel, Loss(channel.topic, count, reason)))
        if self._as_stored:
            self._problems.lose(reason, count)
        else:
            self._problems.note(reason)

    def _leave_out_second_types(self) -> None:
        """Read only the first type of each topic.

        Raises:
            BadBagError: Bags disagree about the type.
        """
        first: dict[str, Reading] = {}
        for reading in list(self._readings.values()):
            topic, msgtype = reading.channel.topic, reading.channel.msgtype
            first_reading = first.setdefault(topic, reading)
            if first_reading.channel.msgtype == msgtype:
                continue
            both = f'{topic} is {msgtype} here, and {first_reading.channel.msgtype}'
            if first_reading.bag != reading.bag:
                expected = 'bags of one recording, which agree; give those of the other apart'
                raise BadBagError(reading.bag, f'{both} in {first_reading.bag}', expected)
            self._lose_channel(reading, f'{both} before; the latter is read')

    def _define(self) -> None:
        """Make the typestore, and skip topics of undefined types.

        Raises:
            BadBagError: Such a topic was requested by name.
        """
        definitions = Definitions(self._problems)
        for reading in list(self._readings.values()):
            conflict = definitions.add(reading.bag, reading.file, defining_channel(reading.channel))
            if conflict:
                self._leave_out_undefined(reading, conflict)
        types = {name for reading in self._readings.values() for name in types_of(reading.channel)}
        reasons = definitions.complete(types)
        self._definitions = definitions
        for reading in list(self._readings.values()):
            channel = reading.channel
            lacking = [name for name in types_of(channel) if name in reasons]
            if not lacking:
                continue
            if self._as_stored and stored_channel(channel).encoding not in self._converted:
                self._problems.note(f'{self._path}: {reasons[lacking[0]]}; it is copied as it is')
            else:
                self._leave_out_undefined(reading, reasons[lacking[0]])

    def _prepare(self) -> None:
        """Skip channels whose messages cannot be converted.

        Raises:
            MissingLibraryError: A library is not installed, and a topic was requested by name, or
                nothing can be read without it.
        """
        encodings = {
            stored_channel(reading.channel).encoding for reading in self._readings.values()
        }
        for reading in list(self._readings.values()):
            try:
                self._converter.prepare(reading.channel, self._definitions)
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
        self._problems.lose(f'{reading.file}: {text}', self._count(reading))

    def _count(self, reading: Reading) -> int:
        return self._counts[reading.number][reading.channel_id]

    @cached_property
    def _counts(self) -> list[Counter[int]]:
        """Messages by file and channel id: a sum for each channel would take channels x chunks."""
        by_file: list[Counter[int]] = [Counter() for _ in self._files]
        for file, counts in zip(self._files, by_file, strict=True):
            for chunk in file.chunks:
                counts.update(chunk.counts)
        return by_file


def _is_enough(
    topics: Mapping[int, str], is_enough: Callable[[str], bool], channel_id: int
) -> bool:
    return channel_id in topics and is_enough(topics[channel_id])


__all__ = [
    'BagIndex',
    'BagMessage',
    'BagMessages',
    'BagSource',
    'BagSummary',
    'OpenBag',
    'TopicSummary',
    'bag_stamps',
    'index_bag',
    'open_messages',
    'opened',
    'path_of',
    'summarize_bag',
]

Bags: TypeAlias = BagSource | Sequence[BagSource]
"""An .mcap, .db3 or .bag file or a directory of rosbag2, or several of them; or opened ones."""


def summarize_bag(bags: Bags) -> BagSummary:
    """Summarize topics, counts, times, rates and gaps of bags, from their index if they have one.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    with ExitStack() as exit_stack:
        open_bags = [exit_stack.enter_context(opened(bag)) for bag in _distinct(bags)]
        located = [bag.located for bag in open_bags]
        containers = ', '.join(dict.fromkeys(bag.container for bag in located))
        files = tuple(file for bag in located for file in bag.files)
        return summarize(containers, files, index_bag(open_bags))


def index_bag(bags: Bags) -> BagIndex:
    """Return the stamps of the messages of bags, and their problems.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    index = BagIndex()
    for source in _distinct(bags):
        with opened(source) as bag:
            index.merge(bag.index)
    return index


def bag_stamps(bags: Bags) -> dict[str, Int64Array]:
    """Return by topic the log times of its messages, (N,) int64 nanoseconds, ascending.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    return index_bag(bags).by_topic()


def read_earlier_losses(bag: BagSource, topics: Collection[str] | None = None) -> tuple[str, ...]:
    """Read what the first message of each topic, or of some, had lost before it was stored.

    Raises:
        BadBagError: The bag cannot be read.
    """
    losses: dict[str, None] = {}
    with opened(bag) as open_bag:
        with open_messages(open_bag, topics, must_read=False) as messages:
            lossy = [name for name, channel in messages.sources.items() if may_be_lossy(channel)]
        for topic in lossy:
            with open_messages(open_bag, {topic}, must_read=False) as messages:
                next(iter(messages), None)
                losses |= dict.fromkeys(
                    f'{path_of(bag)}: {loss}' for loss in messages.earlier_losses
                )
    return tuple(losses)


def open_messages(
    bags: Bags, topics: Collection[str] | None = None, *, must_read: bool = True
) -> BagMessages:
    """Open bags to read their messages; the result is a context manager, and an iterable.

    Args:
        bags: The bags to read; the messages of several are merged by time.
        topics: The topics to read; all of them by default.
        must_read: Whether a requested topic whose type has no definition, or two, is an error; else
            it is left out, as without topics.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all; bags disagree about a
            topic's type; or a requested topic cannot be read.
        UsageError: A path is given twice.
        OSError: A file cannot be read.
    """
    return BagMessages(_distinct(bags), topics, must_read=must_read)


def _distinct(bags: Bags) -> Sequence[BagSource]:
    if isinstance(bags, (Path, OpenBag)):
        return [bags]
    seen: set[str] = set()
    for path in map(path_of, bags):
        real_path = canonical_path(path)
        if real_path in seen:
            raise UsageError(f'{path}: is given twice; give each bag once')
        seen.add(real_path)
    return bags


# Decoding of messages by the definitions in their bags.


class Decoder:
    """A decoder of messages whose types have all the fields that are read.

    Args:
        typestore: The types as the bags define them.
        lent: Whether arrays of large messages may be views of the chunks of the bag; only where
            all of these are dropped before many more messages are read.
    """

    def __init__(self, typestore: Typestore, *, lent: bool = False) -> None:
        self._typestore = typestore
        self._lent = lent
        self._missing: dict[str, str] = {}

    def __call__(self, message: BagMessage, expected: str = '') -> Any:  # noqa: ANN401 - of the bag's types
        """Decode a message to an object.

        Args:
            message: A message of a bag with these types.
            expected: The type it must have; any if empty.

        Raises:
            ValueError: The message cannot be decoded, is of another type than expected, or a field
                is missing in its type.
        """
        msgtype = message.msgtype
        if expected and msgtype != expected:
            raise ValueError(f'is a {msgtype}, not a {expected}')
        if msgtype not in self._missing:
            self._missing[msgtype] = lacking_field(self._typestore, msgtype)
        if self._missing[msgtype]:
            raise ValueError(
                f'cannot be decoded (the bag defines {msgtype} without {self._missing[msgtype]},'
                f' or as another kind of value)'
            )
        data = message.data if self._lent else bytes(message.data)
        try:
            return self._typestore.deserialize_cdr(data, msgtype)
        except Exception as error:  # generated code may raise anything
            raise ValueError(f'cannot be decoded ({error})') from error


# The times at which the scanner faced forward, for bags whose scans are stamped at the start.
#
# In such a bag written by to-bag, scans are half a turn earlier than the images of their frame, and
# would match those of the previous frame.


class ForwardStamps:
    """A collector of the description of the scans that to-bag writes."""

    topics = frozenset({RECORDING, SWEEP})

    def __init__(self) -> None:
        self._at_start = False
        self._period_ns = NOMINAL_PERIOD_NS
        self._lengths: dict[int, int] = {}

    def take(self, topic: str, text: String, stamp_ns: int) -> None:
        """Enter a message of one of the topics.

        Raises:
            ValueError: The message was not written by to-bag.
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
        """Nanoseconds by which scan stamps precede facing forward, from the nominal period."""
        return self._period_ns // 2 if self._at_start else 0

    def forward(self, stamps_ns: Iterable[int]) -> dict[int, int]:
        """Map scan stamps to the times of facing forward; empty if they are the same."""
        if not self._at_start:
            return {}
        return {
            stamp: stamp + self._lengths.get(stamp, self._period_ns) // 2 for stamp in stamps_ns
        }


def read_lead_ns(bag: BagSource) -> int:
    """Read the nanoseconds by which a bag's scan stamps precede facing forward (nominal period).

    The result is 0 for bags not written by to-bag, and if their description cannot be read.

    Raises:
        BadBagError: The bag cannot be read.
    """
    stamps = ForwardStamps()
    with open_messages(bag, {RECORDING}) as messages:
        if (RECORDING, STRING) not in messages.channels:
            return 0
        for message in messages:
            try:
                text: Any = messages.typestore.deserialize_cdr(bytes(message.data), STRING)
                stamps.take(RECORDING, text, message.stamp_ns)
            except Exception:  # noqa: BLE001 - generated code may raise anything
                return 0
            break
    return stamps.lead_ns
