# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An MCAP file open for reading: by its summary, or by a scan if the summary is missing."""

from __future__ import annotations

import struct
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics
from rosbags.typesys.msg import normalize_msgtype

from ..model.errors import BadBagError
from .chunked_file import ChunkedFile
from .mcap_records import (
    INDEX_BODY,
    MESSAGE_BODY,
    RECORD_HEAD,
    agrees,
    messages_in,
    split_records,
    unpack_chunk,
)
from .mcap_scan import RECORD_ERRORS, McapContents, McapScan, enter_description, piece_records
from .mcap_summary import MAGIC
from .offered_qos import offered_qos
from .pieces import FileBytes, Piece, StoredChannel

if TYPE_CHECKING:
    from array import array
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from .findings import Findings
    from .pieces import StoredMessage

_FOOTER = struct.Struct('<BQQQI')
_CRC_SIZE = 4
_CHUNK = bytes([Opcode.CHUNK])


class McapFile(ChunkedFile):
    """An MCAP file.

    Args:
        path: The file.
        name: The path in messages.
        findings: Damage is entered there.

    Raises:
        BadBagError: The magic bytes are missing.
        OSError: The file cannot be read.
    """

    def __init__(self, path: Path, name: Path, findings: Findings) -> None:
        file = FileBytes(path, name)
        if file.read(0, len(MAGIC)) != MAGIC:
            raise BadBagError(name, 'does not begin as an MCAP file does')
        contents = _read_summary(file, findings) or McapScan(file, findings).run()
        channels = {key: _source_channel(contents, key) for key in contents.channels}
        self._index_lengths = {
            piece.position: length
            for piece, length in zip(contents.pieces, contents.index_lengths, strict=False)
        }
        super().__init__(
            file, findings, channels, contents.pieces, contents.stamps, contents.compressions
        )

    def _messages(
        self, data: bytes, wanted: Collection[int], since_ns: int
    ) -> tuple[list[StoredMessage], bool]:
        records, whole = unpack_chunk(data) if data[:1] == _CHUNK else (data, True)
        found, end = messages_in(records, wanted, since_ns)
        return found, whole and end == len(records)

    def _salvaged(self, position: int, data: bytes, cost: int) -> Iterator[StoredMessage]:
        for opcode, body in piece_records(self._file, position, data, self._findings, cost):
            if opcode == Opcode.MESSAGE:
                channel_id, _, stamp_ns, _ = MESSAGE_BODY.unpack_from(body)
                yield stamp_ns, channel_id, body[MESSAGE_BODY.size :]

    def _indexed(self, piece: Piece) -> dict[int, npt.NDArray[np.int64]]:
        start = piece.position + piece.length
        block = self._file.read(start, self._index_lengths[piece.position])
        found = {}
        for record in split_records(block):
            at = record.position + RECORD_HEAD.size
            if record.opcode == Opcode.MESSAGE_INDEX:
                channel_id, size = INDEX_BODY.unpack_from(block, at)
                entries = np.frombuffer(block[at + INDEX_BODY.size : record.end], '<i8')
                found[channel_id] = entries[: size // 8 : 2]
        return found

    def _scanned(self) -> Mapping[int, array[int]]:
        return McapScan(self._file, self._findings).run().stamps or {}


def _read_summary(file: FileBytes, findings: Findings) -> McapContents | None:
    """Parse the summary; None unless it indexes every message."""
    if file.size < _FOOTER.size + len(MAGIC):
        return None
    tail = file.read(file.size - _FOOTER.size - len(MAGIC), _FOOTER.size + len(MAGIC))
    if len(tail) < _FOOTER.size or not tail.endswith(MAGIC):
        return None
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - RECORD_HEAD.size) or not start:
        return None
    section = file.read(start, file.size - len(MAGIC) - start)
    if not agrees(section[:-_CRC_SIZE], crc):
        findings.lose(f'{file.name}: its summary, at byte {start}, is damaged (wrong checksum)', 0)
        return None
    try:
        return _summarized(section, start)
    except RECORD_ERRORS:
        return None


def _summarized(section: bytes, start: int) -> McapContents | None:
    contents = McapContents()
    message_count: int | None = None
    for opcode, position, end in split_records(section):
        body = section[position + RECORD_HEAD.size : end]
        if opcode == Opcode.STATISTICS:
            message_count = Statistics.read(ReadDataStream(BytesIO(body))).message_count
        elif opcode == Opcode.CHUNK_INDEX:
            chunk = ChunkIndex.read(ReadDataStream(BytesIO(body)))
            contents.compressions.add(chunk.compression)
            contents.pieces.append(_piece(chunk))
            contents.index_lengths.append(chunk.message_index_length)
        else:
            enter_description(contents, opcode, body)
    found = sum(sum(piece.counts.values()) for piece in contents.pieces)
    known = all(contents.channels.keys() >= piece.counts.keys() for piece in contents.pieces)
    inside = all(piece.position + piece.length <= start for piece in contents.pieces)
    # Messages outside of chunks, or chunks without index, are found by a scan only.
    return contents if message_count == found and known and inside else None


def _piece(chunk: ChunkIndex) -> Piece:
    position = chunk.chunk_start_offset
    end = position + chunk.chunk_length + chunk.message_index_length
    starts = sorted((start, key) for key, start in chunk.message_index_offsets.items())
    ends = [start for start, _ in starts[1:]] + [end]
    head = RECORD_HEAD.size + INDEX_BODY.size
    # Each entry is a stamp and an offset.
    counts = {
        key: (stop - start - head) // 16 for (start, key), stop in zip(starts, ends, strict=True)
    }
    times = chunk.message_start_time, chunk.message_end_time
    return Piece(*times, position, chunk.chunk_length, counts)


def _source_channel(contents: McapContents, channel_id: int) -> StoredChannel:
    channel = contents.channels[channel_id]
    schema = contents.schemas.get(channel.schema_id)
    name = schema.name if schema else ''
    cdr = channel.message_encoding == 'cdr' and '/' in name
    return StoredChannel(
        channel.topic,
        normalize_msgtype(name) if cdr else name,
        channel.message_encoding,
        schema.data.decode(errors='replace') if schema else '',
        schema.encoding if schema else '',
        **offered_qos(channel.metadata.get('offered_qos_profiles', '')),
    )
