# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a rosbag2 database: from its tables, or from its pages if it is damaged."""

from __future__ import annotations

import sqlite3
from contextlib import suppress
from typing import TYPE_CHECKING

from .offered_qos import offered_qos
from .pieces import StoredChannel
from .spelling import ros2_spelling

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from .limits import DescriptionLimits
    from .sqlite_scan import Pages

_DEFINITION_COLUMNS = 4
_LEAST_TOPIC_COLUMNS = 3


def stored_topics(
    connection: sqlite3.Connection, room: DescriptionLimits
) -> dict[int, StoredChannel]:
    """Read the topics by the id of their row; earlier versions of the schema have fewer columns.

    Raises:
        sqlite3.Error: The topics cannot be read.
        TypeError: The topics are damaged.
        LimitError: There are too many.
    """
    definitions = {}
    with suppress(sqlite3.OperationalError):  # the table is missing before version 4
        for row in connection.execute(
            'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
        ):
            room.add(_size(row))
            definitions[row[0]] = (row[2], row[1])
    # Columns by number: the id, and about four texts.
    topics = {}
    for topic_id, *texts in connection.execute('SELECT * FROM topics'):
        room.add(_size(texts))
        topics[topic_id] = _channel(texts, definitions)
    return topics


def scanned_topics(pages: Pages, room: DescriptionLimits) -> dict[int, StoredChannel]:
    """Return the topics found in the pages, by the id of their row.

    Raises:
        LimitError: There are too many.
    """
    definitions = {}
    topics = {}
    for row_id, texts in pages.texts():
        room.add(_size(texts))
        if len(texts) == _DEFINITION_COLUMNS and texts[1].startswith('ros2'):
            definitions[texts[0]] = (texts[2], texts[1])
        elif len(texts) >= _LEAST_TOPIC_COLUMNS and '/' in texts[1]:
            topics[row_id] = texts
    return {topic_id: _channel(texts, definitions) for topic_id, texts in topics.items()}


def _size(row: Sequence[object]) -> int:
    return sum(len(each) for each in row if isinstance(each, (str, bytes)))


def _channel(texts: Sequence[str], definitions: Mapping[str, tuple[str, str]]) -> StoredChannel:
    """Make a topic from its row: name, type, serialization format, from version 2 on QoS profiles.

    Raises:
        TypeError: A column is not a text.
    """
    topic, msgtype, encoding, *rest = texts
    if not all(isinstance(text, str) for text in (topic, msgtype, encoding or '')):
        raise TypeError('the names of topics are no texts')
    return StoredChannel(
        topic,
        ros2_spelling(msgtype) if '/' in msgtype else msgtype,
        encoding or '',
        *definitions.get(msgtype, ('', '')),
        **offered_qos(rest[0] if rest else ''),
    )
