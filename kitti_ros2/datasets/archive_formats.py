# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tar and zip archives, opened by their first bytes, with checks of their content."""

from __future__ import annotations

import bz2
import errno
import gzip
import io
import lzma
import os
import re
import stat
import struct
import tarfile
import zlib
from contextlib import contextmanager
from dataclasses import dataclass
from lzma import FORMAT_XZ, LZMADecompressor, LZMAError
from typing import TYPE_CHECKING, Any, Protocol, cast
from zipfile import BadZipFile, LargeZipFile, ZipFile, ZipInfo

from ..model.errors import KittiRos2Error, MissingPathError, describe_error, format_bytes, naming

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path
    from tarfile import TarFile, TarInfo
    from typing import IO

    from typing_extensions import Buffer, Self


# Errors of archives and downloads.


class BadArchiveError(KittiRos2Error):
    """A refused archive: damaged, hostile, or without KITTI's folders."""

    def __init__(self, path: Path, reason: str, remedy: str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: {reason}; nothing of it was extracted ({remedy})')


class BadMemberError(KittiRos2Error):
    """An unreadable file in an archive; the others are readable.

    Args:
        reason: An error of the disk or of the decompression.
    """

    def __init__(self, reason: Exception | str) -> None:
        text = str(reason)
        if isinstance(reason, OSError) and reason.errno is not None:
            text = f'cannot be read: {describe_error(reason)}'
        elif isinstance(reason, Exception):
            text = f'damaged: {reason}'
        super().__init__(text)


class StoppedError(KittiRos2Error):
    """An extraction or download stopped, as on a full disk; it can be continued."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: {reason}; what is complete is kept, run it again to go on')


@contextmanager
def stopping(path: Path) -> Iterator[None]:
    """Convert errors of the disk to StoppedError.

    Args:
        path: The file being written.
    """
    try:
        yield
    except OSError as error:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT}
        reason = 'the disk is full' if full else f'cannot be written ({error.strerror or error})'
        raise StoppedError(path, reason) from error


# Files in an archive as the archive lists them, and their checks.

_DRIVE_LETTER = re.compile(r'[A-Za-z]:')
_LONGEST_PART_BYTES = 255 - len('..part')
_LONGEST_NAME_BYTES = 2048
_MOST_MEMBERS = 1_000_000
_LEAST_SUSPICIOUS_BYTES = 100_000_000
"""Smaller contents may have any compression ratio, as files of zeros do."""
_LEAST_DICTIONARY_BYTES = 1 << 26
DECOMPRESSION_ERRORS = (zlib.error, lzma.LZMAError, OSError)
"""bz2 and gzip raise OSError."""
CHUNK_BYTES = 1 << 20
"""Size of a read."""
_UNTRUSTED = 'download it from a source that you trust'


@dataclass(frozen=True)
class Member:
    """A file, a folder or something else in an archive.

    Attributes:
        name: Name in the archive, with / between folders.
        size: Declared bytes.
        crc: CRC-32 of the content; None in a tar.
        is_folder: True for a folder.
        other: Kind of anything else, such as a symbolic link; empty for files and folders.
        locked: Reason for unreadable content, such as a password; empty if readable.
        info: The record of zipfile or tarfile.
    """

    name: str
    size: int
    crc: int | None
    is_folder: bool
    other: str
    locked: str
    info: Any


class Packed(Protocol):
    """An open archive."""

    path: Path

    def __enter__(self) -> Self:
        """Return the archive."""
        ...

    def __exit__(self, *_: object) -> None:
        """Close the archive."""
        ...

    def members(self) -> Iterator[Member]:
        """List all members.

        Raises:
            BadArchiveError: The archive is damaged or truncated.
        """
        ...

    def contents(self, members: Iterable[Member]) -> Iterator[tuple[Member, Iterator[bytes]]]:
        """Yield some members with the chunks of their content, in the order of the archive.

        The chunks of a member that cannot be read raise BadMemberError.
        """
        ...


@dataclass(frozen=True)
class Limits:
    """Limits of what an archive may contain.

    Attributes:
        ratio: Bytes of the content for each byte of the archive.
        size: Bytes of the content.
    """

    ratio: float
    size: int


def checked(packed: Packed, limits: Limits) -> Iterator[Member]:
    """Yield the members of an archive up to a hostile one.

    Raises:
        BadArchiveError: A name leads out of the folder, a member is neither a file nor a folder, or
            the content is larger than the limits.
    """
    archive_bytes = packed.path.stat().st_size
    most = max(limits.ratio * archive_bytes, _LEAST_SUSPICIOUS_BYTES)
    total = 0
    for count, member in enumerate(packed.members(), 1):
        reason = _refusal(member)
        if reason:
            raise BadArchiveError(packed.path, f'{member.name!r} {reason}', _UNTRUSTED)
        total += member.size
        if count > _MOST_MEMBERS:
            raise BadArchiveError(packed.path, f'has over {_MOST_MEMBERS:,} entries', _UNTRUSTED)
        if total > most:
            ratio = f'{total / archive_bytes:.0f} times its own size'
            content = f'declares at least {format_bytes(total)} of content, {ratio}'
            raise BadArchiveError(packed.path, content, 'allow more with --max-ratio')
        if total > limits.size:
            content = f'declares at least {format_bytes(total)} of content'
            raise BadArchiveError(packed.path, content, 'allow more with --max-size')
        yield member


def most_dictionary_bytes(archive: Path) -> int:
    """Return the largest LZMA dictionary, in memory, for the size of an archive.

    xz -9 and 7-Zip's ultra take 64 MB; a valid archive has none far larger than itself.
    """
    return max(_LEAST_DICTIONARY_BYTES, 16 * archive.stat().st_size)


def _refusal(member: Member) -> str:
    """Return the reason to refuse a member; empty without one."""
    name = member.name
    parts = name.split('/')
    longest = max(len(part.encode('utf-8', 'surrogateescape')) for part in parts)
    reasons = {
        f'is a {member.other}': member.other,
        'has control characters in its name': not name.isprintable(),
        'has a backslash in its name': '\\' in name,
        'is an absolute path': name.startswith('/') or _DRIVE_LETTER.match(name),
        'leads out of the folder': '..' in parts,
        'is no name of a file': not name.strip('/.') and not member.is_folder,
        'has too long a name': longest > _LONGEST_PART_BYTES or len(name) > _LONGEST_NAME_BYTES,
    }
    return next((reason for reason, holds in reasons.items() if holds), '')


# Files of xz whose dictionary is bounded; lzma.LZMAFile takes up to 4 GB for one.

_READ_BYTES = 1 << 16
_OVERHEAD_BYTES = 4 << 20
"""Most bytes that liblzma needs beside the dictionary."""


class _XzReader(io.RawIOBase):
    """The content of a file of one or more xz streams; seeking backwards is slow."""

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
        chunk = self._decompressed(len(view))
        view[: len(chunk)] = chunk
        self._position += len(chunk)
        return len(chunk)

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
            chunk = b''
            if self._stream.eof:
                chunk = self._next_stream()
                if not chunk:
                    return b''
            elif self._stream.needs_input:
                chunk = self._file.read(_READ_BYTES)
                if not chunk:
                    raise EOFError('the compressed stream has no end')
            if content := self._inflated(chunk, most):
                return content

    def _next_stream(self) -> bytes:
        """Begin a stream; return its first bytes after padding, none at the end."""
        chunk = self._stream.unused_data.lstrip(b'\0')
        while not chunk and (read := self._file.read(_READ_BYTES)):
            chunk = read.lstrip(b'\0')
        if chunk:
            self._begin_stream()
        return chunk

    def _inflated(self, chunk: bytes, most: int) -> bytes:
        try:
            return self._stream.decompress(chunk, most)
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
        most_dictionary_bytes: Size of the largest dictionary, in memory.

    Raises:
        lzma.LZMAError, EOFError: While reading: it is damaged or truncated.
        BadArchiveError: While reading: it needs a larger dictionary.
    """
    return io.BufferedReader(_XzReader(path, most_dictionary_bytes))


# Tar archives, plain or compressed: read forwards only.

_ERRORS = (tarfile.TarError, EOFError, ValueError, RecursionError, *DECOMPRESSION_ERRORS)
_LONGEST_READ = 16 << 20
"""tarfile reads a header of any declared size at once."""
_MOST_PADDING = 1 << 20
"""Bytes read after the last member, to verify the checksum of the compression."""
_OPENERS: dict[bytes, Any] = {
    b'\x1f\x8b': gzip.GzipFile,
    b'BZh': bz2.BZ2File,
    b'\xfd7zXZ\0': lambda path: open_xz(path, most_dictionary_bytes(path)),
}
MAGICS = tuple(_OPENERS)


class _Forward:
    """A file for tarfile: limits the size of a read, and buffers the last one."""

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
        openers = [opener for magic, opener in _OPENERS.items() if head.startswith(magic)]
        self._open: Callable[[Path], IO[bytes]] = (
            openers[0] if openers else lambda path: path.open('rb')
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: no file is open between two passes."""

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
        """Check for the end marker: tarfile takes damage for the end."""
        if len(forward.last) < tarfile.BLOCKSIZE or any(forward.last):
            raise self._damaged('its end is missing')
        remaining = _MOST_PADDING
        while remaining > 0 and (chunk := file.read(1 << 16)):
            remaining -= len(chunk)

    def _damaged(self, reason: str) -> BadArchiveError:
        text = f'is a truncated or damaged tar archive ({reason})'
        return BadArchiveError(self.path, text, 'download it again')

    def contents(self, members: Iterable[Member]) -> Iterator[tuple[Member, Iterator[bytes]]]:
        """Yield some members with the chunks of their content, by a pass over the archive."""
        remaining = {member.info.offset: member for member in members}
        try:
            with self._open(self.path) as file:
                forward = cast('IO[bytes]', _Forward(file))
                with tarfile.open(fileobj=forward, mode='r:') as archive:
                    for info in archive:
                        _forget(archive)
                        if info.offset in remaining:
                            yield remaining.pop(info.offset), _pieces(archive, info)
                        if not remaining:
                            return
        except _ERRORS as error:
            raise self._damaged(describe_error(error)) from error


def _forget(archive: TarFile) -> None:
    """Release the members so far: tarfile stores all."""
    archive.members = []  # type: ignore[attr-defined]


def _pieces(archive: TarFile, info: TarInfo) -> Iterator[bytes]:
    try:
        stream = archive.extractfile(info)
        while stream is not None and (chunk := stream.read(CHUNK_BYTES)):
            yield chunk
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
    """Return the kind of a member that is neither a file nor a folder."""
    kinds = {
        'symbolic link': info.issym(),
        'hard link': info.islnk(),
        'device': info.ischr() or info.isblk(),
        'pipe': info.isfifo(),
        'sparse file': info.issparse(),
        'member of an unknown type': not (info.isreg() or info.isdir()),
    }
    return next((kind for kind, is_it in kinds.items() if is_it), '')


# Zip archives: members from the directory at the end, contents with CRC check.

_UNIX = 3
_ENCRYPTED = 0x1
_STRONGLY_ENCRYPTED = 0x40
_LZMA = 14
_METHODS = {0, 8, 12, _LZMA}
"""Stored, deflate, bzip2, LZMA."""
_LOCAL_HEADER = struct.Struct('<26xHH')
_LZMA_HEADER = struct.Struct('<5xI')
"""Two versions, the length of the properties and a byte of them: APPNOTE.TXT 5.8.8."""
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
            BadArchiveError: Members overlap, as in zip bombs.
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

    def contents(self, members: Iterable[Member]) -> Iterator[tuple[Member, Iterator[bytes]]]:
        """Yield some members with the chunks of their content."""
        for member in members:
            yield member, self._pieces(member.info)

    def _pieces(self, info: ZipInfo) -> Iterator[bytes]:
        try:
            if info.compress_type == _LZMA:
                self._check_dictionary(info)
            with self._zip.open(info) as stream:
                while chunk := stream.read(CHUNK_BYTES):
                    yield chunk
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
    """Return the kind of a member that is neither a file nor a folder."""
    mode = stat.S_IFMT(info.external_attr >> 16) if info.create_system == _UNIX else 0
    return _KINDS.get(mode, '')


def _lock(info: ZipInfo) -> str:
    if info.flag_bits & (_ENCRYPTED | _STRONGLY_ENCRYPTED):
        return 'encrypted; extract it with another program and its password'
    if info.compress_type not in _METHODS:
        return f'unsupported compression method {info.compress_type}; extract it with 7z'
    return ''


# Opening by the first bytes, for any file name.

_ZIP = (b'PK\x03\x04', b'PK\x05\x06')
_TAR_OFFSET = 257
_TAR = b'ustar'


def open_archive(path: Path) -> Packed:
    """Open a zip or tar archive.

    Raises:
        MissingPathError: There is no such file.
        BadArchiveError: The file is damaged or no archive.
    """
    if not path.exists():
        raise MissingPathError(path)
    if not path.is_file():
        raise BadArchiveError(path, 'is no file', 'give zip or tar archives, then the folder')
    with naming(path), path.open('rb') as file:
        head = file.read(tarfile.BLOCKSIZE)
    if head.startswith(_ZIP):
        return ZipArchive(path)
    if head.startswith(MAGICS) or head[_TAR_OFFSET:].startswith(_TAR):
        return TarArchive(path)
    if not head:
        raise BadArchiveError(path, 'is empty', 'download it again')
    if head.lstrip().lower().startswith((b'<!doctype', b'<html', b'<?xml')):
        reason = 'is a web page, such as that of a login, in place of an archive'
        raise BadArchiveError(path, reason, 'download it again')
    raise BadArchiveError(path, 'is neither a zip nor a tar archive', 'download it again')
