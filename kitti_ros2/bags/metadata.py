# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""rosbag2's metadata, version 9 (Jazzy): offered QoS profiles, and metadata.yaml.

The same text is stored in three places: metadata.yaml of a directory, the metadata table of a
sqlite3 file, and the Metadata record ``rosbag2`` of an MCAP file.
"""

from __future__ import annotations

import json
import re
from io import StringIO
from typing import TYPE_CHECKING, Any

from ..model.containers import CONTAINERS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rosbags.typesys.store import Typestore

    from ..model.channels import Channel
    from ..options.bag import BagOptions
    from .contract import Tally

VERSION = 9
ROS_DISTRO = 'jazzy'

# RMW_DURATION_INFINITE of rmw, which rosbag2 writes for "no deadline" and "no lifespan".
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}

_PLAIN = re.compile(r'[A-Za-z_/][\w/.]*', re.ASCII)
_WORDS = {'true', 'false', 'yes', 'no', 'on', 'off', 'y', 'n', 'null'}
_UNPRINTABLE = re.compile('[\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]')


def qos_profile(channel: Channel) -> dict[str, Any]:
    """Return the QoS offered by a channel's publisher, as metadata version 9 spells it."""
    return {
        'history': 'keep_last',
        'depth': channel.depth,
        'reliability': 'reliable',
        'durability': 'transient_local' if channel.latched else 'volatile',
        'deadline': _INFINITE,
        'lifespan': _INFINITE,
        'liveliness': 'automatic',
        'liveliness_lease_duration': _INFINITE,
        'avoid_ros_namespace_conventions': False,
    }


def qos_text(channel: Channel) -> str:
    """Return the offered_qos_profiles of a channel as the YAML text that containers store."""
    return _yaml([qos_profile(channel)]).rstrip()


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
    return {
        'version': VERSION,
        'storage_identifier': options.storage,
        'duration': {'nanoseconds': duration_ns},
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'message_count': sum(tally.total for tally in files.values()),
        'topics_with_message_count': [
            _topic_information(typestore, channel, _count(files, index))
            for index, channel in enumerate(channels)
        ],
        'compression_format': options.compression if message_mode else '',
        'compression_mode': 'message' if message_mode else '',
        'relative_file_paths': list(files),
        'files': [_file_information(name, tally) for name, tally in files.items()],
        'custom_data': dict(source) or None,
        'ros_distro': ROS_DISTRO,
    }


def information_text(information: Mapping[str, Any]) -> str:
    """Return the text of the information alone, as the files of a bag store it."""
    return _yaml(information).rstrip()


def metadata_yaml(information: Mapping[str, Any]) -> str:
    """Return the text of metadata.yaml."""
    return _yaml({'rosbag2_bagfile_information': information})


def _topic_information(typestore: Typestore, channel: Channel, count: int) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': channel.topic,
            'type': channel.msgtype,
            'serialization_format': 'cdr',
            'offered_qos_profiles': [qos_profile(channel)],
            'type_description_hash': typestore.hash_rihs01(channel.msgtype),
        },
        'message_count': count,
    }


def _count(files: Mapping[str, Tally], index: int) -> int:
    # Files that were closed before a channel was added do not count it.
    return sum(tally.counts[index] for tally in files.values() if index < len(tally.counts))


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


def _yaml(value: Mapping[str, Any] | Sequence[Any]) -> str:
    text = StringIO()  # by line: a list of all lines of 65,000 topics takes more than the text
    for line in _lines(value):
        text.write(line)
        text.write('\n')
    return text.getvalue()


def _lines(value: object) -> Iterator[str]:
    # PyYAML quotes and escapes differently; its Python emitter takes longer than a small bag does.
    if isinstance(value, dict):
        for key, item in value.items():
            lines = _lines(item)
            if isinstance(item, list) and item:
                yield f'{_scalar(key)}:'
                yield from lines
            elif isinstance(item, dict) and item:
                yield f'{_scalar(key)}:'
                yield from (f'  {line}' for line in lines)
            else:
                yield f'{_scalar(key)}: {next(lines)}'
    elif isinstance(value, list):
        for item in value:
            lines = _lines(item)
            yield f'- {next(lines)}'
            yield from (f'  {line}' for line in lines)
    if not isinstance(value, (dict, list)) or not value:
        yield _scalar(value)


def _scalar(value: object) -> str:
    if isinstance(value, str):
        if _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
            return value
        # JSON's strings are valid YAML except for a few characters that YAML calls unprintable.
        quoted = json.dumps(value, ensure_ascii=False)
        return _UNPRINTABLE.sub(lambda match: f'\\u{ord(match[0]):04x}', quoted)
    return json.dumps(value)
