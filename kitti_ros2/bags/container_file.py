# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A file of a bag open for reading, of any container, and what its readers share.

It is read in chunks, those of MCAP or ROS 1, or all rows of a database. Damage costs its own chunk.
"""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import rosbags.typesys  # noqa: F401 - whole, before its modules: else threads wait in a circle
from rosbags.typesys.msg import normalize_msgtype

from ..model.bag_formats import ZSTD_MAGIC, Channel
from ..model.errors import naming
from .decompression import FileLimits

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Self

    from .decompression import Buffer


# Notes and losses found while a bag is read.


@dataclass
class Problems:
    """Notes and losses of a bag, each listed once.

    Attributes:
        notes: Notes, one line each.
        losses: Damaged or unreadable parts, one line each with their position (file, byte or row),
            and the number of lost messages; None if that is unknown.
    """

    notes: dict[str, None] = field(default_factory=dict)
    losses: dict[str, int | None] = field(default_factory=dict)

    def note(self, text: str) -> None:
        """Enter a note."""
        self.notes[text] = None

    def lose(self, text: str, messages: int | None = None) -> None:
        """Enter a loss."""
        self.losses[text] = messages

    def lose_one(self, text: str) -> None:
        """Enter one more message that is lost for the same reason as others."""
        self.losses[text] = (self.losses.get(text) or 0) + 1

    def add(self, other: Problems) -> None:
        """Enter those of another so far."""
        self.notes |= other.notes
        self.losses |= other.losses

    @property
    def complete(self) -> bool:
        """True if nothing is known to be damaged."""
        return not self.losses

    @property
    def lines(self) -> tuple[str, ...]:
        """Notes and losses, one line each."""
        return (*self.notes, *self.losses)


# Names of types as ROS 2 spells them.


@lru_cache(1024)  # its paths take longer than the rest of a channel, which shares the string
def ros2_spelling(name: str) -> str:
    """Return the name of a type as ROS 2 spells it: sensor_msgs/msg/Imu for sensor_msgs/Imu."""
    return normalize_msgtype(name)


# The QoS of a channel, from rosbag2's text of offered QoS profiles.

UNKNOWN_DEPTH = 100  # if a bag contains no depth: enough for every text file of a recording

_MOST = 2**31 - 1

# Metadata versions before 9 contain the number of rmw.
_TRANSIENT_LOCAL = ('1', 'transient_local')
_POLICIES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default',
        'automatic',
        'manual_by_node',
        'manual_by_topic',
        'unknown',
        'best_available',
    ),
}
"""The words of each policy, at the index of their numbers. Source: rmw/types.h."""
_LONGEST_KEPT = 10_000
_MATCHED = ('reliability', 'durability')
"""Policies by which subscribers are matched with publishers."""
_TIME = r':\n    sec: \d+\n    nsec: \d+\n'
_PROFILE = re.compile(
    r'- history: \w+\n  depth: (?P<depth>0|[1-9]\d{0,8})\n  reliability: \w+\n'
    r'  durability: (?P<durability>\w+)\n'
    rf'  deadline{_TIME}  lifespan{_TIME}  liveliness: \w+\n  liveliness_lease_duration{_TIME}'
    r'  avoid_ros_namespace_conventions: \w+(?:\n|$)',
    re.ASCII,
)
"""A profile as rosbag2 and to-bag write it."""
_HINT = re.compile(r'durability\W+(1\b|transient_local)', re.IGNORECASE)


def offered_qos(profiles: str) -> dict[str, Any]:
    """Return profiles, latched and depth of a StoredChannel from the text of its profiles."""
    depth = _kept_depth(profiles)
    return {'profiles': profiles, **(latched_qos(depth) if depth else {})}


def latched_qos(depth: int = UNKNOWN_DEPTH) -> dict[str, Any]:
    """Return latched and depth of a latched Channel."""
    return {'latched': True, 'depth': depth}


def _kept_depth(profiles: str) -> int:
    """Return the number of messages that publishers keep for late subscribers, 0 for none."""
    # A bag repeats a few texts, and is opened several times; long ones would fill the memory.
    find = _find_kept_depth if len(profiles) <= _LONGEST_KEPT else _find_kept_depth.__wrapped__
    return find(profiles)


@lru_cache(1000)
def _find_kept_depth(profiles: str) -> int:
    if not _HINT.search(profiles):
        return 0  # parsing YAML is slow
    try:
        for profile in _parse_profiles(profiles):
            durability = profile.get('durability')
            if durability == 1 or str(durability).lower() in _TRANSIENT_LOCAL:
                depth = int(profile.get('depth') or UNKNOWN_DEPTH)
                return depth if 0 < depth <= _MOST else UNKNOWN_DEPTH
    except (TypeError, AttributeError, ValueError, OverflowError):
        return UNKNOWN_DEPTH
    return 0


def _parse_profiles(profiles: str) -> Any:  # noqa: ANN401 - a list of mappings, or any YAML
    if not _PROFILE.sub('', profiles):
        return [match.groupdict() for match in _PROFILE.finditer(profiles)]
    from ..model.yaml_text import load_yaml  # noqa: PLC0415 - 13 ms that most bags do without

    return load_yaml(profiles)


def qos_faults(profiles: str) -> list[str]:
    """List what is wrong with the text of a channel's profiles; one is stored for each publisher.

    A text without any is valid: recorders write it where they do not know the publishers.
    """
    if not profiles.strip():
        return []
    from ..model.yaml_text import YamlTextError, load_yaml  # noqa: PLC0415 - as above

    try:
        parsed = load_yaml(profiles)
    except YamlTextError:
        parsed = None
    if not isinstance(parsed, list) or not all(isinstance(profile, dict) for profile in parsed):
        return ['the QoS profiles are no YAML list']
    faults = []
    offered: dict[str, set[object]] = {}
    for profile, (policy, words) in product(parsed, _POLICIES.items()):
        value = profile.get(policy)
        is_number = isinstance(value, int) and value in range(len(words))
        word = words[value] if is_number else value
        if word not in words:
            faults.append(f'{policy} of a publisher is {value!r}'[:100])
        offered.setdefault(policy, set()).add(str(word))
    differing = [policy for policy in _MATCHED if len(offered.get(policy, ())) > 1]
    faults += [f'publishers differ in {policy}' for policy in differing]
    return list(dict.fromkeys(faults))


def stored_profiles(profiles: str) -> list[dict[str, Any]]:
    """Return the profiles of a text, with the numbers of rmw; none if it is no valid list."""
    if not profiles.strip():
        return []
    from ..model.yaml_text import load_yaml  # noqa: PLC0415 - as above

    try:
        return [
            {**profile, **{name: _policy_number(name, profile[name]) for name in _POLICIES}}
            for profile in load_yaml(profiles)
        ]
    except (TypeError, KeyError, ValueError):  # YamlTextError is one
        return []


def _policy_number(policy: str, value: object) -> int:
    """Return the number of a policy from its number or word.

    Raises:
        ValueError: It is neither.
    """
    words = _POLICIES[policy]
    if isinstance(value, int) and value in range(len(words)):
        return int(value)
    return words.index(str(value).lower())


# Summaries of bags from the stamps of their messages.

StampArray: TypeAlias = npt.NDArray[np.int64]
TopicKey: TypeAlias = tuple[str, str]
"""Topic name and message type."""

LAST_NS = 2**63 - 1
"""The stamp of all later messages: readers count with int64, MCAP with uint64."""


@dataclass
class BagIndex:
    """The stamps of a bag's messages, as its container stores them.

    Attributes:
        stamps: Nanoseconds by topic and type, in any order, in any number of arrays.
        compressions: Names of the compressions found.
        complete: Whether no file is truncated or damaged.
        problems: Notes and losses, one line each.
        losses: The losses among them.
    """

    stamps: dict[TopicKey, list[StampArray]] = field(default_factory=dict)
    compressions: set[str] = field(default_factory=set)
    complete: bool = True
    problems: list[str] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)

    def add(self, key: TopicKey, stamps: npt.ArrayLike) -> None:
        """Add stamps (nanoseconds) of a topic; no stamps add the topic alone."""
        stamps_ns = np.asarray(stamps)
        if stamps_ns.dtype.kind == 'u':
            stamps_ns = np.minimum(stamps_ns, np.uint64(LAST_NS))
        self.stamps.setdefault(key, []).append(stamps_ns.astype(np.int64, copy=False))

    def merge(self, other: BagIndex) -> None:
        """Add the index of another file of the same bag."""
        for key, arrays in other.stamps.items():
            self.stamps.setdefault(key, []).extend(arrays)
        self.compressions |= other.compressions
        self.complete = self.complete and other.complete
        self.problems += other.problems
        self.losses += other.losses

    def by_topic(self) -> dict[str, StampArray]:
        """Return by topic the stamps of its messages, (N,) nanoseconds, ascending."""
        stamps: dict[str, list[StampArray]] = {}
        for (topic, _), parts in self.stamps.items():
            stamps.setdefault(topic, []).extend(parts)
        return {topic: np.sort(np.concatenate(parts)) for topic, parts in stamps.items() if parts}

    @property
    def total(self) -> int:
        """Number of all messages."""
        return sum(len(array) for arrays in self.stamps.values() for array in arrays)


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag; None for values that need more messages.

    Attributes:
        name: Topic.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        count: Messages.
        start_ns, end_ns: First and last stamp.
        median_period_ns: Median difference of consecutive stamps.
        largest_gap_ns: Greatest difference of consecutive stamps.
        largest_gap_at_ns: The stamp at the start of that gap.
        mean_rate_hz: Messages per second between the first and the last.
    """

    name: str
    msgtype: str
    count: int
    start_ns: int | None = None
    end_ns: int | None = None
    median_period_ns: int | None = None
    largest_gap_ns: int | None = None
    largest_gap_at_ns: int | None = None
    mean_rate_hz: float | None = None


@dataclass(frozen=True)
class BagSummary:
    """The contents of a bag.

    Attributes:
        container: mcap, rosbag2 mcap, rosbag2 sqlite3, sqlite3 or ros1.
        files: The files with messages, in order.
        size_bytes: Size of those files together.
        start_ns, end_ns: First and last stamp, None without messages.
        topics: By name.
        compression: none, or the names of the compressions found.
        complete: False if a file is truncated or damaged; readable messages are counted.
        problems: Notes and losses, one line each.
    """

    container: str
    files: tuple[Path, ...]
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    topics: tuple[TopicSummary, ...]
    compression: str
    complete: bool
    problems: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """Number of all messages."""
        return sum(topic.count for topic in self.topics)


def summarize(container: str, files: tuple[Path, ...], index: BagIndex) -> BagSummary:
    """Summarize an index."""
    topics = tuple(
        summarize_topic(*key, np.concatenate(arrays))
        for key, arrays in sorted(index.stamps.items())
    )
    starts = [topic.start_ns for topic in topics if topic.start_ns is not None]
    ends = [topic.end_ns for topic in topics if topic.end_ns is not None]
    return BagSummary(
        container=container,
        files=files,
        size_bytes=sum(path.stat().st_size for path in files),
        start_ns=min(starts, default=None),
        end_ns=max(ends, default=None),
        topics=topics,
        compression=', '.join(sorted(index.compressions - {'none', ''})) or 'none',
        complete=index.complete,
        problems=tuple(index.problems),
    )


def summarize_topic(name: str, msgtype: str, stamps: StampArray) -> TopicSummary:
    """Return count, times, rate and largest gap of one topic; stamps in ns, in any order."""
    if not len(stamps):
        return TopicSummary(name, msgtype, 0)
    stamps = np.sort(stamps)
    start_ns, end_ns = int(stamps[0]), int(stamps[-1])
    if len(stamps) == 1:
        return TopicSummary(name, msgtype, 1, start_ns, end_ns)
    gaps = np.diff(stamps)
    widest = int(gaps.argmax())
    return TopicSummary(
        name,
        msgtype,
        len(stamps),
        start_ns,
        end_ns,
        median_period_ns=int(np.median(gaps)),
        largest_gap_ns=int(gaps[widest]),
        largest_gap_at_ns=int(stamps[widest]),
        mean_rate_hz=len(gaps) * 1e9 / (end_ns - start_ns) if end_ns > start_ns else None,
    )


# The files of a bag as chunks with a time span each.
#
# Each is read at once: one of MCAP or ROS 1, or all rows of a database. Damage costs its own chunk.

StoredMessage: TypeAlias = 'tuple[int, int, Buffer]'
"""Stamp in nanoseconds, channel id, and the data in stored form."""

FoundMessage: TypeAlias = 'tuple[int, int, Buffer | UnreadMessage]'
"""The same, where the data may be read later."""


class MessageStart(bytes):
    """The first kilobyte or more of a large message, of which the rest was not kept.

    Attributes:
        size: Bytes of the whole message as stored.
    """

    size: int

    @classmethod
    def of(cls, data: Buffer, size: int) -> MessageStart:
        """Return the start of a message from its first bytes and the size of the whole."""
        start = cls(data[:START_BYTES])
        start.size = size
        return start


class UnreadMessage(NamedTuple):
    """A large message that is read when its turn comes.

    Attributes:
        read: Reads it, or its MessageStart where that is enough; None if the file was cut off.
    """

    read: Callable[[], Buffer | None]


def size_of(data: Buffer) -> int:
    """Return the size in bytes of a message, of which this may be the start."""
    return data.size if isinstance(data, MessageStart) else len(data)


START_BYTES = 2**10
"""Bytes of a MessageStart."""

_READAHEAD_BYTES = 2**18
"""Linux reads no more for one call of posix_fadvise than the disk takes in one request."""


@dataclass(frozen=True)
class StoredChannel(Channel):
    """A topic as stored in a file.

    Attributes:
        encoding: That of the messages: cdr, ros1, protobuf, json, or an unsupported one.
        definition: The text that defines the type and those in it, empty if missing.
        definition_encoding: ros2msg, ros2idl or ros1msg.
        profiles: rosbag2's text of the offered QoS profiles, empty if missing.
        schema: The definition of a protobuf type, a serialised FileDescriptorSet; empty for others.
    """

    encoding: str
    definition: str = ''
    definition_encoding: str = ''
    profiles: str = field(default='', kw_only=True)
    schema: bytes = field(default=b'', kw_only=True, repr=False)


class Chunk(NamedTuple):
    """A part of a file that is read at once.

    Attributes:
        start_ns, end_ns: Least and greatest stamp.
        position, length: In the file, in bytes.
        counts: Messages by channel id.
    """

    start_ns: int
    end_ns: int
    position: int
    length: int
    counts: Mapping[int, int]


class Wanted(NamedTuple):
    """The messages to read: of some channels, from a first to a last stamp."""

    channel_ids: Collection[int]
    since_ns: int
    until_ns: int

    def takes(self, stamp_ns: int, channel_id: int) -> bool:
        """Return whether a message is requested."""
        return channel_id in self.channel_ids and self.since_ns <= stamp_ns <= self.until_ns


class IndexedMessage(NamedTuple):
    """The position of a message as an index has it; they sort as the messages of a chunk do.

    Attributes:
        stamp_ns: Its stamp.
        position, end: Of its record in the file; the end is that of the chunk, or where the next
            message begins.
        channel_id: Its channel.
    """

    stamp_ns: int
    position: int
    end: int
    channel_id: int


class FetchedChunk(NamedTuple):
    """The bytes of a chunk, read before its messages are asked for.

    Attributes:
        data: As stored, fewer than its length if the file was cut off.
        unpacked: Its records, and whether it is whole; None if it is damaged, or too large to be
            unpacked before its turn.
    """

    data: bytes
    unpacked: tuple[Buffer, bool] | None


class BagFile(ABC):
    """A file open for reading, of any container.

    Attributes:
        channels: By id.
        chunks: In any order.
        whole_chunks: Whether chunks are read whole, and compared with their checksums; else single
            messages are read at the offsets in the file's index where that takes fewer bytes.
        compressions: Names of the compressions of chunks found so far, including none.
        is_start_enough: Asked with the id of a channel before a large message is read: whether its
            MessageStart is enough. A file may give the whole message all the same.
        fetches: Whether any thread may fetch chunks.
        attachments: Number of attachments, which are not read, as far as it is known.
    """

    channels: Mapping[int, StoredChannel]
    chunks: Sequence[Chunk]
    whole_chunks: bool = False
    compressions: Collection[str] = ()
    is_start_enough: Callable[[int], bool] | None = None
    fetches: bool = False
    attachments: int = 0
    _problems: Problems

    @abstractmethod
    def read(
        self,
        chunk: Chunk,
        wanted: Wanted,
        fetched: FetchedChunk | Sequence[IndexedMessage] | None = None,
    ) -> Iterable[FoundMessage]:
        """Return the requested messages in a chunk, in time order.

        Unreadable messages are skipped and entered as losses.

        Args:
            chunk: One of chunks.
            wanted: The requested messages.
            fetched: The result of fetch or select for the chunk; None reads the whole chunk now.
        """

    def select(self, chunk: Chunk, wanted: Wanted) -> Sequence[IndexedMessage] | None:  # noqa: ARG002
        """Find requested messages by the index of a chunk; None if the chunk is to be read whole.

        Raises:
            OSError: The disk refuses.
        """
        return None

    def fetch(self, chunk: Chunk) -> FetchedChunk:
        """Read the bytes of a chunk for read, on any thread, where the file fetches.

        Raises:
            OSError: The disk refuses.
        """
        raise NotImplementedError

    @abstractmethod
    def close(self) -> None:
        """Close the file."""

    def index(self) -> BagIndex:
        """Return the stamps of all messages, by topic and type."""
        index = BagIndex()
        for channel in self.channels.values():
            index.add((channel.topic, channel.msgtype), [])
        for channel_id, stamps in self._all_stamps():
            if channel_id in self.channels:
                channel = self.channels[channel_id]
                index.add((channel.topic, channel.msgtype), stamps)
        index.compressions.update(self.compressions)
        return index

    def _wants_start(self, channel_id: int, data: Buffer) -> bool:
        """Return whether the start of a large message is enough; what is compressed stays whole."""
        is_enough = self.is_start_enough
        return is_enough is not None and data[:4] != ZSTD_MAGIC and is_enough(channel_id)

    def expect(self, chunk: Chunk) -> None:  # noqa: B027 - a database reads as it is asked
        """Ask the system to read a chunk ahead of its turn; it is only advice."""

    def reporting_to(self, problems: Problems) -> Self:
        """Return the same open file, which enters its problems elsewhere."""
        other = copy(self)
        other._problems = problems  # noqa: SLF001 - of the same class
        return other

    @abstractmethod
    def _all_stamps(self) -> Iterable[tuple[int, npt.ArrayLike]]:
        """Return the stamps of all messages, nanoseconds, by channel id."""


class NamedFile(NamedTuple):
    """A file of a bag that is to be opened.

    Attributes:
        path: The file; a copy of it if it had to be unpacked.
        name: The path in messages.
        packed: Bytes of the file that was unpacked, None if none was.
    """

    path: Path
    name: Path
    packed: int | None = None


class FileBytes:
    """A file's bytes by position; not memory-mapped, as a file may be truncated while it is read.

    Attributes:
        name: The path in messages.
        size: In bytes, when it was opened.
        waits: Whether each read waits for a store, so that what is needed is best requested early.

    Raises:
        OSError: The file cannot be opened.
    """

    waits = False
    _packed: int | None = None

    @cached_property
    def limits(self) -> FileLimits:
        """The limits of its content, by its packed size if it was unpacked."""
        return FileLimits(self.size if self._packed is None else self._packed)

    def __init__(self, file: NamedFile) -> None:
        self.name = file.name
        self._packed = file.packed
        self._file = file.path.open('rb', buffering=0)
        with naming(self.name):
            self.size = os.fstat(self._file.fileno()).st_size

    def read(self, position: int, length: int) -> bytes:
        """Read `length` bytes, fewer at the end of the file, none outside of it.

        Raises:
            OSError: The disk refuses.
        """
        if length <= 0 or not 0 <= position < self.size:
            return b''
        length = min(length, self.size - position)  # a damaged length asks for more than memory
        try:
            data = os.pread(self._file.fileno(), length, position)
            while 0 < len(data) < length:
                more = os.pread(self._file.fileno(), length - len(data), position + len(data))
                if not more:
                    break
                data += more
        except OSError as error:
            error.filename = str(self.name)
            raise
        return data

    def read_part(self, position: int, length: int) -> bytes:
        """Read a part that stays in memory as a whole, such as an index; as read.

        Raises:
            ValueError: It is larger than a file of its packed size may have.
            OSError: The disk refuses.
        """
        if length > self.limits.largest_part:
            raise ValueError(f'{length} bytes, at most {self.limits.largest_part} are read')
        return self.read(position, length)

    def expect(self, position: int, length: int) -> None:
        """Ask the system to read bytes from the disk meanwhile; it is only advice."""
        if hasattr(os, 'posix_fadvise'):
            with suppress(OSError):  # of a file system without a page cache
                file, end = self._file.fileno(), min(position + length, self.size)
                for start in range(position, end, _READAHEAD_BYTES):
                    os.posix_fadvise(file, start, _READAHEAD_BYTES, os.POSIX_FADV_WILLNEED)

    def is_cut(self) -> bool:
        """Return whether it has become shorter since it was opened."""
        return os.fstat(self._file.fileno()).st_size < self.size

    def close(self) -> None:
        """Close the file; does nothing if it is closed."""
        self._file.close()
