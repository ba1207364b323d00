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
from mcap.records import Statistics

from ..model.errors import BadBagError
from .chunk_scan import FileContents
from .chunked_file import ChunkedFile
from .mcap_records import (
    INDEX_BODY,
    MCAP,
    RECORD_HEAD,
    agrees,
    messages_in,
    parse_chunk_index,
    split_records,
)
from .mcap_scan import RECORD_ERRORS, Descriptions, McapScan
from .mcap_summary import MAGIC
from .open_bytes import open_bytes

if TYPE_CHECKING:
    from array import array
    from collections.abc import Collection, Mapping, Sequence

    import numpy.typing as npt

    from .findings import Findings
    from .pieces import Buffer, FileBytes, NamedFile, Piece, StoredMessage

_FOOTER = struct.Struct('<BQQQI')
_CRC_SIZE = 4


class McapFile(ChunkedFile[int]):
    """An MCAP file.

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
            raise BadBagError(file.name, 'does not begin as an MCAP file does')
        contents, self._described = _read_summary(data, findings) or _scan(data, findings)
        super().__init__(data, findings, contents, MCAP)
        self._index_lengths = contents.index_lengths
        self._clashes: dict[tuple[int, bytes], str] = {}

    def _messages_in(
        self, records: Buffer, wanted: Collection[int], since_ns: int
    ) -> tuple[list[StoredMessage], int]:
        return messages_in(records, wanted, since_ns, self._compare_description)

    def _compare_description(self, opcode: int, body: Buffer) -> None:
        """Enter a loss if a chunk describes a channel otherwise than others or the summary."""
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK):
            return
        key = opcode, b'' if opcode == Opcode.CHUNK else bytes(body)
        if key not in self._clashes:
            self._clashes[key] = self._clash(*key)
        if self._clashes[key]:
            cost = None if opcode == Opcode.CHUNK else 0
            self._findings.lose(f'{self._file.name}: {self._clashes[key]}', cost)

    def _clash(self, opcode: int, body: bytes) -> str:
        """Return what a record in a chunk contradicts, empty for nothing."""
        try:
            return self._described.enter(opcode, body)
        except RECORD_ERRORS:
            return ''  # the summary has it

    def _expect_indexes(self, pieces: Sequence[Piece]) -> None:
        for piece in pieces:
            start = piece.position + piece.length
            self._file.expect(start, self._index_lengths[piece.position])

    def _indexed(self, piece: Piece) -> dict[int, npt.NDArray[np.uint64]]:
        start = piece.position + piece.length
        block = self._file.read(start, self._index_lengths[piece.position])
        found = {}
        for opcode, at, end in split_records(block):
            if opcode == Opcode.MESSAGE_INDEX:
                channel_id, size = INDEX_BODY.unpack_from(block, at)
                entries = np.frombuffer(block[at + INDEX_BODY.size : end], '<u8')
                found[channel_id] = entries[: size // 8 : 2]
        return found

    def _scanned(self) -> Mapping[int, array[int]]:
        return McapScan(self._file, self._findings).run().stamps or {}


def _scan(file: FileBytes, findings: Findings) -> tuple[FileContents, Descriptions]:
    scan = McapScan(file, findings)
    return scan.run(), scan.described


def _read_summary(file: FileBytes, findings: Findings) -> tuple[FileContents, Descriptions] | None:
    """Parse the summary; None unless it indexes every message."""
    if file.size < _FOOTER.size + len(MAGIC):
        return None
    tail = file.read(file.size - _FOOTER.size - len(MAGIC), _FOOTER.size + len(MAGIC))
    if len(tail) < _FOOTER.size or not tail.endswith(MAGIC):
        return None
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - RECORD_HEAD.size) or not start:
        return None
    try:
        section = file.read_part(start, file.size - len(MAGIC) - start)
        if not agrees(section[:-_CRC_SIZE], crc):
            text = f'its summary, at byte {start}, is damaged (wrong checksum)'
            findings.lose(f'{file.name}: {text}', 0)
            return None
        return _summarized(file, section, start)
    except RECORD_ERRORS:
        return None


def _summarized(
    file: FileBytes, section: bytes, start: int
) -> tuple[FileContents, Descriptions] | None:
    contents, described = FileContents(), Descriptions(file.limits.descriptions())
    message_count: int | None = None
    for opcode, position, end in file.limits.counted(start, split_records(section)):
        body = section[position:end]
        if opcode == Opcode.STATISTICS:
            message_count = Statistics.read(ReadDataStream(BytesIO(body))).message_count
        elif opcode == Opcode.CHUNK_INDEX:
            piece, compression, index_length = parse_chunk_index(body)
            contents.compressions.add(compression)
            contents.pieces.append(piece)
            contents.index_lengths[piece.position] = index_length
        elif described.enter(opcode, body):
            return None  # the scan tells where it contradicts itself
    contents.channels = described.channels()
    found = sum(sum(piece.counts.values()) for piece in contents.pieces)
    known = all(contents.channels.keys() >= piece.counts.keys() for piece in contents.pieces)
    places = sorted(
        (piece.position, piece.position + piece.length + contents.index_lengths[piece.position])
        for piece in contents.pieces
    )
    starts = [*(position for position, _ in places[1:]), start]
    # Chunks and their indexes; each of those may otherwise be all of the file.
    apart = all(end <= after for (_, end), after in zip(places, starts, strict=False))
    # Messages outside of chunks, or chunks without index, are found by a scan only.
    return (contents, described) if message_count == found and known and apart else None
