# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tar archives, plain or compressed: read from the beginning to the end, never backwards."""

from __future__ import annotations

import bz2
import gzip
import tarfile
from typing import TYPE_CHECKING, Any, cast

from ..model.errors import describe_error
from .errors import BadArchiveError, BadMemberError
from .members import DECOMPRESSION_ERRORS, PIECE_BYTES, Member, most_dictionary_bytes
from .xz_file import open_xz

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path
    from tarfile import TarFile, TarInfo
    from typing import IO

    from typing_extensions import Self

_ERRORS = (tarfile.TarError, EOFError, ValueError, RecursionError, *DECOMPRESSION_ERRORS)
_LONGEST_READ = 16 << 20
"""tarfile reads a header of any declared size at once."""
_MOST_PADDING = 1 << 20
"""After the end of the last member, to verify the checksum of the compression."""
_OPENERS: dict[bytes, Any] = {
    b'\x1f\x8b': gzip.GzipFile,
    b'BZh': bz2.BZ2File,
    b'\xfd7zXZ\0': lambda path: open_xz(path, most_dictionary_bytes(path)),
}
MAGICS = tuple(_OPENERS)


class _Forward:
    """A file for tarfile: limits how much is read at once and keeps what was read last."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.seek = file.seek
        self.tell = file.tell
        self.last = b''

    def read(self, size: int) -> bytes:
        if size > _LONGEST_READ:
            raise tarfile.ReadError('a header of unreasonable size')
        self.last = self._file.read(size)
        return self.last


class TarArchive:
    """An open tar archive.

    Raises:
        BadArchiveError: It is damaged at its beginning.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open('rb') as file:
            head = file.read(max(map(len, MAGICS)))
        found = [opener for magic, opener in _OPENERS.items() if head.startswith(magic)]
        self._open: Callable[[Path], IO[bytes]] = (
            found[0] if found else lambda path: path.open('rb')
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing stays open between two passes."""

    def members(self) -> Iterator[Member]:
        """List all members, by a pass over the archive.

        Raises:
            BadArchiveError: The archive is damaged or truncated.
        """
        try:
            with self._open(self.path) as file:
                forward = _Forward(file)
                with tarfile.open(fileobj=cast('IO[bytes]', forward), mode='r:') as archive:
                    for info in archive:
                        _forget(archive)
                        yield _member(info)
                self._check_end(forward, file)
        except _ERRORS as error:
            raise self._damaged(describe_error(error)) from error

    def _check_end(self, forward: _Forward, file: IO[bytes]) -> None:
        """Check that the marker of the end was read: tarfile takes damage for the end."""
        if len(forward.last) < tarfile.BLOCKSIZE or any(forward.last):
            raise self._damaged('its end is missing')
        left = _MOST_PADDING
        while left > 0 and (piece := file.read(1 << 16)):
            left -= len(piece)

    def _damaged(self, reason: str) -> BadArchiveError:
        found = f'is a truncated or damaged tar archive ({reason})'
        return BadArchiveError(self.path, found, 'download it again')

    def contents(self, wanted: Iterable[Member]) -> Iterator[tuple[Member, Iterator[bytes]]]:
        """Yield some members with the pieces of their content, by a pass over the archive."""
        left = {member.info.offset: member for member in wanted}
        try:
            with self._open(self.path) as file:
                forward = cast('IO[bytes]', _Forward(file))
                with tarfile.open(fileobj=forward, mode='r:') as archive:
                    for info in archive:
                        _forget(archive)
                        if info.offset in left:
                            yield left.pop(info.offset), _pieces(archive, info)
                        if not left:
                            return
        except _ERRORS as error:
            raise self._damaged(describe_error(error)) from error


def _forget(archive: TarFile) -> None:
    """Release the members so far: tarfile keeps all of them."""
    archive.members = []  # type: ignore[attr-defined]


def _pieces(archive: TarFile, info: TarInfo) -> Iterator[bytes]:
    try:
        stream = archive.extractfile(info)
        while stream is not None and (piece := stream.read(PIECE_BYTES)):
            yield piece
    except _ERRORS as error:
        raise BadMemberError(error) from error


def _member(info: TarInfo) -> Member:
    return Member(
        info.name,
        info.size,
        None,
        is_folder=info.isdir(),
        other=_tar_kind(info),
        locked='',
        info=info,
    )


def _tar_kind(info: TarInfo) -> str:
    """Return what a member is if it is neither a file nor a folder."""
    kinds = {
        'symbolic link': info.issym(),
        'hard link': info.islnk(),
        'device': info.ischr() or info.isblk(),
        'pipe': info.isfifo(),
        'sparse file': info.issparse(),
        'member of an unknown type': not (info.isreg() or info.isdir()),
    }
    return next((kind for kind, is_it in kinds.items() if is_it), '')
