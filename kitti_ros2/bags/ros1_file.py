# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 .bag file open for reading: by its index, or by a scan if the index is missing."""

from __future__ import annotations

import struct
from contextlib import suppress
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadBagError
from .chunk_scan import FileContents
from .chunked_file import ChunkedFile
from .limits import LimitError
from .open_bytes import open_bytes
from .pieces import FileBytes, Piece
from .ros1_records import (
    BAG_HEADER,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    MAGIC,
    ROS1,
    Fields,
    messages_in,
    opcode_of,
    parse_time,
    split_record,
)
from .ros1_scan import DescribedConnections, Ros1Scan, parse_connection

if TYPE_CHECKING:
    from array import array
    from collections.abc import Collection, Mapping

    import numpy.typing as npt

    from .findings import Findings
    from .limits import FileLimits
    from .pieces import Buffer, NamedFile, StoredMessage

_CHUNK_HEAD_READ = 4096
_COUNT = struct.Struct('<II')
_ENTRY = np.dtype([('seconds', '<u4'), ('nanoseconds', '<u4'), ('offset', '<u4')])


class Ros1File(ChunkedFile[Fields]):
    """A ROS 1 .bag file, format 2.0.

    Args:
        file: The file.
        findings: Damage is entered there.

    Raises:
        BadBagError: The magic bytes are missing.
        OSError: The file cannot be read.
    """

    def __init__(self, file: NamedFile, findings: Findings) -> None:
        data = open_bytes(file)
        if data.read(0, len(MAGIC)) != MAGIC:
            raise BadBagError(file.name, 'does not begin as a ROS 1 bag of format 2.0 does')
        contents = _read_index(data, findings) or Ros1Scan(data, findings).run()
        super().__init__(data, findings, contents, ROS1)
        if self.pieces:
            with suppress(ValueError):
                self._chunk_end(self.pieces[0])

    def _messages_in(
        self, records: Buffer, wanted: Collection[int], since_ns: int
    ) -> tuple[list[StoredMessage], int]:
        return messages_in(records, wanted, since_ns, self._compare_connection)

    def _compare_connection(self, fields: Fields, body: Buffer) -> None:
        """Enter a loss if a chunk and the index describe a connection differently."""
        try:
            channel_id, channel = parse_connection(fields, body)
        except ValueError as error:
            self._findings.lose(f'{self._file.name}: a connection is damaged ({error})', 0)
            return
        known = self.channels.get(channel_id)
        if known is not None and known != channel:
            both = f'{known.topic} ({known.msgtype}) and {channel.topic} ({channel.msgtype})'
            text = f'connection {channel_id} is described in two ways, {both}; the first counts'
            self._findings.lose(f'{self._file.name}: {text}', 0)

    def _indexed(self, piece: Piece) -> dict[int, npt.NDArray[np.int64]]:
        end = self._chunk_end(piece)
        block = self._file.read(piece.position + end, piece.length - end)
        found = {}
        position = 0
        while position < len(block):
            fields, start, position = split_record(block, position)
            if opcode_of(fields) == INDEX:
                entries = np.frombuffer(block[start:position], _ENTRY)
                times = entries['seconds'].astype(np.int64) * 10**9 + entries['nanoseconds']
                found[int.from_bytes(fields[b'conn'], 'little')] = times
        return found

    def _chunk_end(self, piece: Piece) -> int:
        """Return the offset in the piece of the indexes behind its chunk.

        Raises:
            ValueError: The chunk is damaged.
        """
        fields, _, end = split_record(self._file.read(piece.position, _CHUNK_HEAD_READ), 0)
        if opcode_of(fields) == CHUNK:
            self.compressions.add(fields[b'compression'].decode('ascii', 'replace'))
        return end

    def _scanned(self) -> Mapping[int, array[int]]:
        return Ros1Scan(self._file, self._findings).run().stamps or {}


def _read_index(file: FileBytes, findings: Findings) -> FileContents | None:
    """Read the index at the end; None if it is missing or damaged."""
    try:
        fields, _, _ = split_record(file.read(len(MAGIC), _CHUNK_HEAD_READ), 0)
        start = int.from_bytes(fields.get(b'index_pos', b''), 'little')
        if start == 0 and opcode_of(fields) == BAG_HEADER:
            findings.lose(f'{file.name}: was not closed by its recorder', 0)
            return None
        if start > file.size:
            return None  # the scan reports where it is truncated
        section = file.read_part(start, file.size - start)
        return _indexed_contents(section, start, fields, file.limits)
    except LimitError:
        return None  # the scan tells what is left out
    except ValueError as error:
        findings.lose(f'{file.name}: its index is damaged ({error})', 0)
        return None


def _indexed_contents(
    section: bytes, start: int, header: Fields, limits: FileLimits
) -> FileContents:
    """Parse an index, which must list as many chunks as the bag's header.

    Raises:
        ValueError: The index is damaged, or lists more than the limits of the file allow.
    """
    if opcode_of(header) != BAG_HEADER:
        raise ValueError('the header does not tell where it is')
    expected = int.from_bytes(header[b'chunk_count'], 'little')
    connections = DescribedConnections(limits.descriptions())
    infos: list[tuple[int, int, int, dict[int, int]]] = []
    position = 0
    while position < len(section):
        fields, at, position = split_record(section, position)
        if position > len(section):
            raise ValueError('cut')
        body = section[at:position]
        opcode = opcode_of(fields)
        if opcode == CONNECTION:
            connections.enter(fields, body)
        elif opcode == CHUNK_INFO:
            times = parse_time(fields[b'start_time']), parse_time(fields[b'end_time'])
            if len(body) != _COUNT.size * int.from_bytes(fields[b'count'], 'little'):
                raise ValueError('a chunk with other connections than it counts')
            counts = dict(_COUNT.iter_unpack(body))
            limits.add_records(start, len(infos))
            infos.append((int.from_bytes(fields[b'chunk_pos'], 'little'), *times, counts))
    if len(infos) != expected:
        raise ValueError(f'{len(infos)} chunks instead of {expected}')
    if any(not counts.keys() <= connections.by_id.keys() for _, _, _, counts in infos):
        raise ValueError('a connection is missing')
    infos.sort(key=itemgetter(0))
    ends = [*(info[0] for info in infos[1:]), start][: len(infos)]
    pieces = [
        Piece(start_ns, end_ns, place, end - place, counts)
        for (place, start_ns, end_ns, counts), end in zip(infos, ends, strict=True)
    ]
    return FileContents(connections.by_id, pieces)
