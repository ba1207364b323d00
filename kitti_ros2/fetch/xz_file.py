# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files of xz whose dictionary is bounded; lzma.LZMAFile takes up to 4 GB for one."""

from __future__ import annotations

import io
from lzma import FORMAT_XZ, LZMADecompressor, LZMAError
from typing import TYPE_CHECKING

from ..model.text import format_bytes
from .errors import BadArchiveError

if TYPE_CHECKING:
    from pathlib import Path

    from typing_extensions import Buffer

_READ_BYTES = 1 << 16
_OVERHEAD_BYTES = 4 << 20
"""What liblzma needs beside the dictionary, at most."""


class _XzReader(io.RawIOBase):
    """The content of a file of one or more xz streams, which is best read forwards."""

    def __init__(self, path: Path, most_dictionary_bytes: int) -> None:
        self._path = path
        self._file = path.open('rb')
        self._most_dictionary_bytes = most_dictionary_bytes
        self._rewind()

    def close(self) -> None:
        self._file.close()
        super().close()

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: Buffer) -> int:
        view = memoryview(buffer).cast('B')
        piece = self._decompressed(len(view))
        view[: len(piece)] = piece
        self._position += len(piece)
        return len(piece)

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        if whence == io.SEEK_CUR:
            offset += self._position
        elif whence != io.SEEK_SET:
            raise io.UnsupportedOperation('xz has no size')
        if offset < self._position:
            self._rewind()
        while self._position < offset and self.read(min(_READ_BYTES, offset - self._position)):
            pass
        return self._position

    def tell(self) -> int:
        return self._position

    def _rewind(self) -> None:
        self._file.seek(0)
        self._position = 0
        self._begin_stream()

    def _begin_stream(self) -> None:
        self._stream = LZMADecompressor(FORMAT_XZ, self._most_dictionary_bytes + _OVERHEAD_BYTES)

    def _decompressed(self, most: int) -> bytes:
        while True:
            piece = b''
            if self._stream.eof:
                piece = self._next_stream()
                if not piece:
                    return b''
            elif self._stream.needs_input:
                piece = self._file.read(_READ_BYTES)
                if not piece:
                    raise EOFError('the compressed stream has no end')
            if content := self._inflated(piece, most):
                return content

    def _next_stream(self) -> bytes:
        """Begin a stream with the bytes behind padding that it returns; none at the end."""
        piece = self._stream.unused_data.lstrip(b'\0')
        while not piece and (read := self._file.read(_READ_BYTES)):
            piece = read.lstrip(b'\0')
        if piece:
            self._begin_stream()
        return piece

    def _inflated(self, piece: bytes, most: int) -> bytes:
        try:
            return self._stream.decompress(piece, most)
        except LZMAError as error:
            if 'limit' not in str(error):
                raise
            most_text = format_bytes(self._most_dictionary_bytes)
            raise BadArchiveError(
                self._path, f'needs a dictionary of over {most_text}', 'extract it with xz and tar'
            ) from error


def open_xz(path: Path, most_dictionary_bytes: int) -> io.BufferedReader:
    """Open a file of xz for reading.

    Args:
        path: A file that begins with the magic of xz.
        most_dictionary_bytes: The largest dictionary, which is memory.

    Raises:
        lzma.LZMAError, EOFError: While reading: it is damaged or truncated.
        BadArchiveError: While reading: it needs a larger dictionary.
    """
    return io.BufferedReader(_XzReader(path, most_dictionary_bytes))
