# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The scan of a ROS 1 .bag file (or .bag.active), and the descriptions of its connections."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .chunk_scan import ChunkScan
from .limits import LimitError
from .offered_qos import latched_qos
from .pieces import StoredChannel
from .ros1_records import (
    CONNECTION,
    MESSAGE,
    ROS1,
    Fields,
    opcode_of,
    parse_fields,
    parse_message,
)
from .spelling import ros2_spelling

if TYPE_CHECKING:
    from .chunk_scan import Run
    from .findings import Findings
    from .limits import DescriptionLimits
    from .pieces import Buffer, FileBytes


@dataclass(frozen=True)
class Ros1Channel(StoredChannel):
    """A connection.

    Attributes:
        md5sum: Of the definition.
        callerid: The publisher's node.
    """

    md5sum: str = ''
    callerid: str | None = None


class DescribedConnections:
    """The connections of a file.

    Args:
        room: How many there may be.

    Attributes:
        by_id: The last description of each.
    """

    def __init__(self, room: DescriptionLimits) -> None:
        self.by_id: dict[int, StoredChannel] = {}
        self._room = room

    def enter(self, fields: Fields, body: Buffer) -> None:
        """Enter a connection.

        Raises:
            LimitError: There are too many.
            ValueError: The connection is damaged.
        """
        channel_id, channel = parse_connection(fields, body)
        if channel_id not in self.by_id:
            self._room.add(len(body))
        self.by_id[channel_id] = channel


class Ros1Scan(ChunkScan[Fields]):
    """A scan of a ROS 1 .bag file.

    Args:
        file: The file to read.
        findings: Damage is entered there.
    """

    noun = 'connection'
    descriptions = (CONNECTION,)

    def __init__(self, file: FileBytes, findings: Findings) -> None:
        super().__init__(file, findings, ROS1)
        self._connections = DescribedConnections(file.limits.descriptions())

    def _enter_record(self, head: Fields, body: Buffer, run: Run) -> None:
        opcode = opcode_of(head)
        if opcode == MESSAGE:
            channel_id, stamp_ns = parse_message(head)
            self._stamps.setdefault(channel_id, array('Q')).append(stamp_ns)
            run.add(channel_id, stamp_ns)
        elif opcode == CONNECTION and self._refused is None:
            try:
                self._connections.enter(head, body)
            except LimitError as error:
                self._refused = error
            except ValueError as error:
                text = f'{self._file.name}: a connection is damaged ({error})'
                self._findings.lose(text)

    def _channels(self) -> dict[int, StoredChannel]:
        return self._connections.by_id


def parse_connection(fields: Fields, body: Buffer) -> tuple[int, Ros1Channel]:
    """Parse a connection and its id.

    Raises:
        ValueError: The connection is damaged.
    """
    described = parse_fields(body)
    try:
        topic, msgtype = fields[b'topic'].decode(), described[b'type'].decode()
        definition = described[b'message_definition'].decode(errors='replace')
        md5sum = described[b'md5sum'].decode('ascii')
    except KeyError as error:
        raise ValueError(f'it has no {error}') from error
    caller = described.get(b'callerid')
    latched = described.get(b'latching') == b'1'
    return int.from_bytes(fields[b'conn'], 'little'), Ros1Channel(
        '/' * topic.startswith('/') + '/'.join(filter(None, topic.split('/'))),
        ros2_spelling(msgtype),
        'ros1',
        definition,
        'ros1msg',
        md5sum,
        None if caller is None else caller.decode(errors='replace'),
        **(latched_qos() if latched else {}),
    )
