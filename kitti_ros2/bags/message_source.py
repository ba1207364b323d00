# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag in time order, always as CDR, whatever its storage."""

from __future__ import annotations

import heapq
import struct
from contextlib import ExitStack
from typing import TYPE_CHECKING, NamedTuple, Protocol

import zstandard
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability
from rosbags.rosbag1.reader import ReaderError as Ros1ReaderError
from rosbags.rosbag2.errors import ReaderError as Ros2ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from kitti_ros2.errors import BadBagError
from kitti_ros2.messages.ros_types import TYPESTORE

from .mcap_scan import scan_mcap, scanned_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from types import TracebackType

    from mcap.records import Channel
    from rosbags.interfaces import Connection
    from rosbags.interfaces.typing import Constdefs, Fielddefs, FieldDesc
    from rosbags.typesys.store import Typestore
    from typing_extensions import Self

    from .locate import BagFiles
    from .mcap_scan import McapScan

# What rosbags lets out on files that are cut or damaged; its own errors are not all of it.
_DAMAGE = (
    AnyReaderError,
    Ros1ReaderError,
    Ros2ReaderError,
    SerdeError,
    TypesysError,
    struct.error,
    zstandard.ZstdError,
    AssertionError,
    EOFError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
)
_ENDINGS = {'mcap': '.mcap', 'sqlite3': '.db3', 'ros1': '.bag'}
_HEADER = 'std_msgs/msg/Header'
_TRANSIENT = 'transient_local'
_DEPTH = 100  # where the bag does not tell: enough for every text file of a recording


class BagMessage(NamedTuple):
    """One message.

    Attributes:
        topic: Topic name.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        stamp_ns: Log time, nanoseconds since 1970.
        data: CDR with its encapsulation header; ROS 1 messages are converted.
    """

    topic: str
    msgtype: str
    stamp_ns: int
    data: bytes | memoryview


class BagMessages:
    """The messages of a bag: a context manager, and inside it an iterable in time order.

    Attributes:
        channels: Topic and type of each channel that is read, by topic.
        latched: The depth of each topic that offers its last messages to late subscribers.
        typestore: The types as the bag itself defines them, to decode the data with.
        complete: False where a file was cut off or damaged; what can be read is read.
        warnings: What a user should know, one line each.

    Raises:
        BadBagError: The bag cannot be read at all.
    """

    def __init__(self, bag: BagFiles, topics: Collection[str] | None) -> None:
        self._path = bag.path
        self._source = _open_source(bag, topics)
        self.channels = tuple(sorted(set(self._source.channels)))
        self.latched = dict(self._source.latched)
        self.typestore = self._source.typestore
        self.complete = not self._source.warnings
        self.warnings = tuple(self._source.warnings)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; nothing happens the second time."""
        self._source.close()

    def __iter__(self) -> Iterator[BagMessage]:
        return self.since(None)

    def since(self, start_ns: int | None) -> Iterator[BagMessage]:
        """The messages from a log time on; None is the beginning."""
        messages = self._source.messages(start_ns)
        while True:
            try:
                message = next(messages)
            except StopIteration:
                return
            except _DAMAGE as error:
                raise BadBagError(self._path, f'is damaged ({error})') from error
            yield message


class _Source(Protocol):
    @property
    def channels(self) -> list[tuple[str, str]]: ...
    @property
    def latched(self) -> dict[str, int]: ...
    @property
    def typestore(self) -> Typestore: ...
    @property
    def warnings(self) -> list[str]: ...

    def messages(self, start_ns: int | None) -> Iterator[BagMessage]: ...

    def close(self) -> None: ...


def _open_source(bag: BagFiles, topics: Collection[str] | None) -> _Source:
    try:
        return _RosbagsSource(bag, topics)
    except _DAMAGE as error:
        if bag.storage != 'mcap' or bag.compression_mode:
            raise BadBagError(bag.path, f'cannot be read ({error})') from error
    # rosbags wants a footer and the profile ros2; a file without them may still be readable.
    return _ScannedSource(bag, topics)


class _RosbagsSource:
    """A sound bag, read by rosbags."""

    def __init__(self, bag: BagFiles, topics: Collection[str] | None) -> None:
        ending = _ENDINGS[bag.storage]
        if not bag.compression_mode and any(file.suffix != ending for file in bag.files):
            raise ValueError(f'its name does not end in {ending}')
        # As files they are merged by time; a directory's come one after the other.
        paths = [bag.path] if bag.compression_mode else list(bag.files)
        self._stack = ExitStack()
        self._reader = self._stack.enter_context(
            AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_JAZZY))
        )
        self._connections = [
            connection
            for connection in self._reader.connections
            if topics is None or connection.topic in topics
        ]
        self._convert: Callable[[bytes, str], memoryview] | None = None
        self.channels = [(each.topic, each.msgtype) for each in self._connections]
        self.latched = dict(filter(None, map(_latching, self._connections)))
        self.typestore = self._reader.typestore
        self.warnings: list[str] = []
        if bag.storage == 'ros1':
            self.typestore = _ros2_like(self._reader.typestore)
            self._convert = self.typestore.ros1_to_cdr

    def messages(self, start_ns: int | None) -> Iterator[BagMessage]:
        # rosbags takes an empty choice of connections for all of them.
        if not self._connections:
            return
        convert = self._convert
        for connection, stamp_ns, data in self._reader.messages(self._connections, start_ns):
            cdr = convert(data, connection.msgtype) if convert else data
            yield BagMessage(connection.topic, connection.msgtype, stamp_ns, cdr)

    def close(self) -> None:
        self._stack.close()


class _ScannedSource:
    """MCAP files read from their start as far as they go."""

    def __init__(self, bag: BagFiles, topics: Collection[str] | None) -> None:
        self._topics = topics
        self._scans = [scan_mcap(file) for file in bag.files]
        self.warnings = [warning for scan in self._scans for warning in scan.warnings]
        every = [(scan, each) for scan in self._scans for each in scan.channels.values()]
        if every and not any(each.message_encoding == 'cdr' for _, each in every):
            found = ', '.join(sorted({each.message_encoding for _, each in every}))
            raise BadBagError(bag.path, f'has messages in {found}, and only cdr is read')
        self.channels = [
            (each.topic, scan.msgtype(each)) for scan, each in every if self._is_read(each)
        ]
        self.latched = {
            each.topic: _DEPTH
            for _, each in every
            if _TRANSIENT in each.metadata.get('offered_qos_profiles', '')
        }
        self.typestore = _scanned_types(self._scans)

    def messages(self, start_ns: int | None) -> Iterator[BagMessage]:
        merged = heapq.merge(*map(self._of_one, self._scans), key=lambda each: each.stamp_ns)
        return (each for each in merged if start_ns is None or each.stamp_ns >= start_ns)

    def close(self) -> None:
        """Files are open only while they are iterated."""

    def _of_one(self, scan: McapScan) -> Iterator[BagMessage]:
        for channel, stamp_ns, data in scanned_messages(scan):
            if self._is_read(channel):
                yield BagMessage(channel.topic, scan.msgtype(channel), stamp_ns, data)

    def _is_read(self, channel: Channel) -> bool:
        wanted = self._topics is None or channel.topic in self._topics
        return wanted and channel.message_encoding == 'cdr'


def _latching(connection: Connection) -> tuple[str, int] | None:
    """Topic and depth of a connection whose publisher kept messages for late subscribers."""
    if not isinstance(connection.ext, ConnectionExtRosbag2):
        return (connection.topic, _DEPTH) if connection.ext.latching else None
    for profile in connection.ext.offered_qos_profiles:
        if profile.durability is QosDurability.TRANSIENT_LOCAL:
            return connection.topic, profile.depth
    return None


def _ros2_like(ros1: Typestore) -> Typestore:
    """The types of a ROS 1 bag as ROS 2 defines them: a Header without seq, names in lower case."""
    definitions = dict(ros1.fielddefs)
    if _HEADER in definitions:
        constants, fields = definitions[_HEADER]
        definitions[_HEADER] = (constants, [each for each in fields if each[0] != 'seq'])
    for name, known in TYPESTORE.fielddefs.items():
        if name in definitions and _kinds(definitions[name]) == _kinds(known):
            definitions[name] = known
    store = get_typestore(Stores.EMPTY)
    store.register(definitions)
    return store


def _kinds(definition: tuple[Constdefs, Fielddefs]) -> list[FieldDesc]:
    """What a definition's fields are, whatever they are called."""
    return [kind for _, kind in definition[1]]


def _scanned_types(scans: Iterable[McapScan]) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    for scan in scans:
        for schema in scan.schemas.values():
            if schema.encoding == 'ros2msg' and schema.name not in store.fielddefs:
                store.register(get_types_from_msg(schema.data.decode(), schema.name))
    return store
