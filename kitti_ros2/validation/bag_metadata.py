# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the metadata.yaml of a bag says of its topics and times, against its files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..bags.locate import METADATA, metadata_bytes
from ..model.stamps import NS_PER_S
from ..model.yaml_text import load_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..bags.summary import BagIndex

_ROUNDED_NS = NS_PER_S // 1000


def find_differences(path: Path, index: BagIndex) -> list[str]:
    """Compare metadata.yaml with the index of the files; a damaged one is reported by others.

    Args:
        path: The bag.
        index: Of its files.

    Returns:
        Lines that begin with the path of metadata.yaml.
    """
    source = path / METADATA
    try:
        information = load_yaml(metadata_bytes(path))['rosbag2_bagfile_information']
        found = [*_of_topics(information, index), *_of_times(information, index)]
    except (OSError, LookupError, TypeError, ValueError):
        return []
    return [f'{source}: {each}' for each in found]


def _of_topics(information: dict[str, Any], index: BagIndex) -> Iterator[str]:
    counts = {key: sum(map(len, pieces)) for key, pieces in index.stamps.items()}
    types = dict(counts.keys())
    for entry in information.get('topics_with_message_count') or ():
        topic = str(entry['topic_metadata']['name'])
        msgtype, listed = str(entry['topic_metadata']['type']), int(entry['message_count'])
        count = counts.get((topic, types.get(topic, '')), 0)
        if topic in types and types[topic] != msgtype:
            yield f'{topic} is {msgtype} here, {types[topic]} in the files'
        if topic in types and listed != count:
            yield f'{topic} has {listed} messages here, {count} in the files'


def _of_times(information: dict[str, Any], index: BagIndex) -> Iterator[str]:
    stamps = [piece for pieces in index.stamps.values() for piece in pieces if len(piece)]
    if not stamps:
        return
    first, last = min(int(each.min()) for each in stamps), max(int(each.max()) for each in stamps)
    start = int(information['starting_time']['nanoseconds_since_epoch'])
    duration = int(information['duration']['nanoseconds'])
    if abs(start - first) > _ROUNDED_NS:
        yield f'the bag begins at {start} here, at {first} in the files'
    if abs(duration - (last - first)) > _ROUNDED_NS:
        yield f'the bag lasts {duration} ns here, {last - first} ns in the files'
