# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Zip archives: members from the directory at the end, contents with their CRC checked."""

from __future__ import annotations

import os
import stat
import struct
from typing import TYPE_CHECKING
from zipfile import BadZipFile, LargeZipFile, ZipFile, ZipInfo

from ..model.text import format_bytes
from .errors import BadArchiveError, BadMemberError
from .members import DECOMPRESSION_ERRORS, PIECE_BYTES, Member, most_dictionary_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from typing_extensions import Self

_UNIX = 3
_ENCRYPTED = 0x1
_STRONGLY_ENCRYPTED = 0x40
_LZMA = 14
_METHODS = {0, 8, 12, _LZMA}
"""Stored, deflate, bzip2, LZMA."""
_LOCAL_HEADER = struct.Struct('<26xHH')
_LZMA_HEADER = struct.Struct('<5xI')
"""After two versions, the length of the properties and a byte of them: APPNOTE.TXT 5.8.8."""
_KINDS = {
    stat.S_IFLNK: 'symbolic link',
    stat.S_IFCHR: 'device',
    stat.S_IFBLK: 'device',
    stat.S_IFIFO: 'pipe',
    stat.S_IFSOCK: 'socket',
}


class ZipArchive:
    """An open zip archive.

    Raises:
        BadArchiveError: It has no directory, or a damaged one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._zip = ZipFile(path)
        except (BadZipFile, LargeZipFile, NotImplementedError, ValueError, EOFError) as error:
            raise BadArchiveError(
                path, 'is a truncated or damaged zip archive', 'download it again'
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def members(self) -> Iterator[Member]:
        """List all members.

        Raises:
            BadArchiveError: Members overlap, as in archives that are made to fill disks.
        """
        infos = self._zip.infolist()
        if sum(info.compress_size for info in infos) > self.path.stat().st_size:
            raise BadArchiveError(
                self.path, 'has members that overlap', 'download it from a source that you trust'
            )
        for info in infos:
            yield Member(
                info.orig_filename,
                info.file_size,
                info.CRC,
                is_folder=info.orig_filename.endswith('/'),
                other=_zip_kind(info),
                locked=_lock(info),
                info=info,
            )

    def contents(self, wanted: Iterable[Member]) -> Iterator[tuple[Member, Iterator[bytes]]]:
        """Yield some members with the pieces of their content."""
        for member in wanted:
            yield member, self._pieces(member.info)

    def _pieces(self, info: ZipInfo) -> Iterator[bytes]:
        try:
            if info.compress_type == _LZMA:
                self._check_dictionary(info)
            with self._zip.open(info) as stream:
                while piece := stream.read(PIECE_BYTES):
                    yield piece
        except (BadZipFile, EOFError, RuntimeError, ValueError, *DECOMPRESSION_ERRORS) as error:
            raise BadMemberError(error) from error

    def _check_dictionary(self, info: ZipInfo) -> None:
        """Refuse a large dictionary: zipfile takes up to 4 GB for it."""
        with self.path.open('rb') as file:
            file.seek(info.header_offset)
            lengths = file.read(_LOCAL_HEADER.size)
            if len(lengths) == _LOCAL_HEADER.size:
                file.seek(sum(_LOCAL_HEADER.unpack(lengths)), os.SEEK_CUR)
            head = file.read(_LZMA_HEADER.size)
        if len(head) < _LZMA_HEADER.size:
            raise EOFError('ends in its header')
        dictionary_bytes: int = _LZMA_HEADER.unpack(head)[0]
        if dictionary_bytes > most_dictionary_bytes(self.path):
            text = f'needs a dictionary of {format_bytes(dictionary_bytes)}; extract it with 7z'
            raise BadMemberError(text)


def _zip_kind(info: ZipInfo) -> str:
    """Return what a member is if it is neither a file nor a folder."""
    mode = stat.S_IFMT(info.external_attr >> 16) if info.create_system == _UNIX else 0
    return _KINDS.get(mode, '')


def _lock(info: ZipInfo) -> str:
    if info.flag_bits & (_ENCRYPTED | _STRONGLY_ENCRYPTED):
        return 'encrypted; extract it with another program and its password'
    if info.compress_type not in _METHODS:
        return f'unsupported compression method {info.compress_type}; extract it with 7z'
    return ''
