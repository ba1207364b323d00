# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of the writer of one file of a bag, and what the writers of all containers share.

That is compression, and rosbag2's metadata.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from io import BytesIO
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from ..model.bag_formats import CONTAINERS
from .container_file import StoredChannel, stored_profiles

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Mapping

    from rosbags.typesys.store import Typestore

    from ..model.bag_formats import Channel
    from ..options.outputs import BagOptions


# The data of bags being written, and the interface that the writer of a container implements.

Parts: TypeAlias = Sequence[bytes | memoryview]
"""One CDR message (encapsulation header included) as buffers to be concatenated, so that a bulk
payload is never copied. A memoryview is flat bytes (format 'B'); no buffer may change afterwards.
"""


@dataclass
class Tally:
    """Message counts of a whole bag, or of one of its files.

    Attributes:
        counts: Messages by channel id.
        start_ns, end_ns: Least and greatest stamp; undefined without messages.
    """

    counts: list[int] = field(default_factory=list)
    start_ns: int = 2**63 - 1
    end_ns: int = -(2**63)

    @property
    def total(self) -> int:
        """Number of all messages."""
        return sum(self.counts)


@dataclass(frozen=True)
class WriterContext:
    """Arguments of the writer of one file.

    Attributes:
        options: Storage, compression and level.
        typestore: Contains the definition of every channel's type.
        source_metadata: Origin of the data, stored in the file if the container supports that.
        threads: Number of threads that compress.
    """

    options: BagOptions
    typestore: Typestore
    source_metadata: Mapping[str, str]
    threads: int = 1


class FileWriter(Protocol):
    """The writer of one file of a container; it may raise OSError and errors of its library."""

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Declare a channel under an id of the bag (0, 1, 2, ...)."""
        ...

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message."""
        ...

    def close(self, information: bytes) -> None:
        """Complete the file; information is the bag's metadata as YAML, empty outside rosbag2."""
        ...

    def abort(self) -> None:
        """Release everything without completing the file."""
        ...


# The compressions of bags, as thread-safe functions.

_ZSTD_LEVEL = 3
_LZ4_LEVEL = 0

POOL_AHEAD = 2  # few, because each pending chunk takes megabytes


def compressor(name: str, level: int | None) -> Callable[[bytes], bytes]:
    """Return the function that compresses a block.

    Args:
        name: zstd or lz4 (frame format).
        level: The compression level, None for the compressor's own default.
    """
    if name == 'zstd':
        return partial(_zstd, _ZSTD_LEVEL if level is None else level)
    from lz4 import frame  # noqa: PLC0415 - as below

    return partial(frame.compress, compression_level=_LZ4_LEVEL if level is None else level)


def ros1_lz4(data: bytes) -> bytes:
    """Compress to an lz4 frame that ROS 1 reads.

    roslz4, the reader of rosbag, rejects a frame unless its blocks are independent, its content
    has a checksum, and its header names no content size. ROS 1 writes blocks of 1 MiB.

    Source: ros_comm, utilities/roslz4/src/lz4s.c, processHeader.
    """
    from lz4 import frame  # noqa: PLC0415 - most bags are not compressed

    compressed: bytes = frame.compress(
        data,
        compression_level=_LZ4_LEVEL,
        block_size=frame.BLOCKSIZE_MAX1MB,
        block_linked=False,
        content_checksum=True,
        store_size=False,
    )
    return compressed


def _zstd(level: int, data: bytes) -> bytes:
    import zstandard  # noqa: PLC0415 - most bags are not compressed

    # A compressor is not thread-safe, and cheap to create.
    return zstandard.ZstdCompressor(level=level).compress(data)


# rosbag2's metadata, version 8: offered QoS profiles, and metadata.yaml.
#
# The same text is stored in three places: metadata.yaml of a directory, the metadata table of a
# sqlite3 file, and the Metadata record ``rosbag2`` of an MCAP file.
#
# Version 8 is read by every living ROS 2; Humble (d256a5ba) and Iron (a269cd41) refuse version 9:
# offered_qos_profiles are a text with the numbers of rmw there (Humble's metadata_io.cpp:71, and
# qos.cpp:85-88). From Jazzy (64717ee8) on they are a list from version 9 only (yaml.hpp:130-136),
# and the history of a profile, number or word, decides how its other policies are read, also in a
# file alone (qos.cpp, decode of rclcpp::QoS).

VERSION = 8
ROS_DISTRO = 'jazzy'

# RMW_DURATION_INFINITE of rmw, which rosbag2 writes for "no deadline" and "no lifespan".
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}

_PLAIN = re.compile(r'[A-Za-z_/][\w/.]*', re.ASCII)
_WORDS = {'true', 'false', 'yes', 'no', 'on', 'off', 'y', 'n', 'null'}
_UNPRINTABLE = re.compile('[\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]')


def qos_profile(channel: Channel) -> dict[str, Any]:
    """Return the QoS offered by a channel's publisher, with the numbers of rmw."""
    return dict(_profile(channel.depth, latched=channel.latched))


def qos_text(channel: Channel) -> str:
    """Return the offered_qos_profiles of a channel as the YAML text that containers store.

    The profiles of a channel of another bag are kept.
    """
    stored = channel.profiles if isinstance(channel, StoredChannel) else ''
    return _qos_text(channel.depth, stored, latched=channel.latched)


def bag_information(
    options: BagOptions,
    typestore: Typestore,
    channels: Sequence[Channel],
    files: Mapping[str, Tally],
    source: Mapping[str, str],
) -> dict[str, Any]:
    """Return the content of rosbag2_bagfile_information.

    Args:
        options: Storage and compression.
        typestore: Contains the channels' types.
        channels: By channel id.
        files: The message counts of each file, by name, in order.
        source: Origin of the data; becomes custom_data.
    """
    start_ns, duration_ns = _span(list(files.values()))
    by_message = CONTAINERS[options.storage].compresses_messages
    message_mode = by_message and options.compression != 'none'
    hashes = {
        name: typestore.hash_rihs01(name) for name in {channel.msgtype for channel in channels}
    }
    return {
        'version': VERSION,
        'storage_identifier': options.storage,
        'duration': {'nanoseconds': duration_ns},
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'message_count': sum(tally.total for tally in files.values()),
        'topics_with_message_count': _TopicList(channels, hashes, list(files.values())),
        'compression_format': options.compression if message_mode else '',
        'compression_mode': 'message' if message_mode else '',
        'relative_file_paths': list(files),
        'files': [_file_information(name, tally) for name, tally in files.items()],
        'custom_data': dict(source) or None,
        'ros_distro': ROS_DISTRO,
    }


def information_text(information: Mapping[str, Any]) -> bytes:
    """Return the text of the information alone, as the files of a bag store it, in UTF-8."""
    return _yaml(information)


def metadata_yaml(information: Mapping[str, Any]) -> bytes:
    """Return the content of metadata.yaml."""
    return _yaml({'rosbag2_bagfile_information': information}, end='\n')


@lru_cache  # one for all topics: 65,000 of their own take 30 MB
def _profile(depth: int, *, latched: bool) -> dict[str, Any]:
    return {
        'history': 1,  # keep last
        'depth': depth,
        'reliability': 1,  # reliable
        'durability': 1 if latched else 2,  # transient local, volatile
        'deadline': _INFINITE,
        'lifespan': _INFINITE,
        'liveliness': 1,  # automatic
        'liveliness_lease_duration': _INFINITE,
        'avoid_ros_namespace_conventions': False,
    }


@lru_cache
def _qos_text(depth: int, stored: str, *, latched: bool) -> str:
    made = _profile(depth, latched=latched)
    kept = [_completed(profile, made) for profile in stored_profiles(stored)]
    return _yaml(kept or [made]).decode()


def _completed(profile: Mapping[str, Any], made: Mapping[str, Any]) -> dict[str, Any]:
    """Return a stored profile in the form of one made here, which has what it lacks."""

    def value(name: str) -> Any:  # noqa: ANN401 - numbers and durations
        stored: Any = profile.get(name)
        default: Any = made[name]
        if type(stored) is not type(default):
            return default
        if not isinstance(default, dict):
            return stored if stored >= 0 else default
        parts = {part: stored.get(part) for part in default}
        return parts if all(isinstance(number, int) for number in parts.values()) else default

    return {name: value(name) for name in made}


class _TopicList:
    """The list of what is said of each channel, made while it is written: all of 65,000 take 30 MB.

    Args:
        channels: By channel id.
        hashes: Hashes of their types.
        tallies: By file; one that was closed before a channel was added does not count it.
    """

    def __init__(
        self, channels: Sequence[Channel], hashes: Mapping[str, str], tallies: Sequence[Tally]
    ) -> None:
        self._channels, self._hashes, self._tallies = channels, hashes, tallies

    def __len__(self) -> int:
        return len(self._channels)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for index, channel in enumerate(self._channels):
            counts = [tally.counts[index] for tally in self._tallies if index < len(tally.counts)]
            yield {
                'topic_metadata': {
                    'name': channel.topic,
                    'type': channel.msgtype,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': qos_text(channel),
                    'type_description_hash': self._hashes[channel.msgtype],
                },
                'message_count': sum(counts),
            }


_LISTS = (list, _TopicList)
_NESTED = (dict, *_LISTS)


def _file_information(name: str, tally: Tally) -> dict[str, Any]:
    start_ns, duration_ns = _span([tally])
    return {
        'path': name,
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'duration': {'nanoseconds': duration_ns},
        'message_count': tally.total,
    }


def _span(tallies: Sequence[Tally]) -> tuple[int, int]:
    """Return the first stamp and the duration in nanoseconds, (0, 0) without messages."""
    filled = [tally for tally in tallies if tally.total]
    if not filled:
        return 0, 0
    start_ns = min(tally.start_ns for tally in filled)
    return start_ns, max(tally.end_ns for tally in filled) - start_ns


def _yaml(value: Mapping[str, Any] | Sequence[Any], end: str = '') -> bytes:
    # PyYAML quotes and escapes differently; its Python emitter takes longer than a small bag does.
    # The lines of 65,000 topics take more memory than their text, of which StringIO makes copies.
    text = BytesIO()
    _write_lines(lambda line: text.write(line.encode()), value, '', '\n')
    text.write(end.encode())
    return text.getvalue()


def _write_lines(write: Callable[[str], object], value: object, first: str, others: str) -> None:
    """Write the lines of a value, the first one and the others behind what they begin with."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            if isinstance(item, _NESTED) and item:
                write(f'{first}{_scalar(key)}:')
                inner = f'{others}  ' if isinstance(item, dict) else others
                _write_lines(write, item, inner, inner)
            else:
                write(f'{first}{_scalar(key)}: {_scalar(item)}')
            first = others
    elif isinstance(value, _LISTS) and value:
        for item in value:
            _write_lines(write, item, f'{first}- ', f'{others}  ')
            first = others
    else:
        write(f'{first}{_scalar(value)}')


def _scalar(value: object) -> str:
    if isinstance(value, _NESTED):
        return '{}' if isinstance(value, dict) else '[]'
    return _scalar_text(value)


# Most lines of a topic are those of all other topics.
@lru_cache(maxsize=256, typed=True)
def _scalar_text(value: Hashable) -> str:
    if isinstance(value, str):
        if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
            return value
        # JSON's strings are valid YAML except for a few characters that YAML calls unprintable.
        quoted = json.dumps(value, ensure_ascii=False)
        return _UNPRINTABLE.sub(lambda match: f'\\u{ord(match[0]):04x}', quoted)
    return json.dumps(value)
