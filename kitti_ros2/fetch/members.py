# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files in an archive as the archive lists them, and what is refused of them."""

from __future__ import annotations

import lzma
import re
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from ..model.text import format_bytes
from .errors import BadArchiveError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from typing_extensions import Self

_DRIVE_LETTER = re.compile(r'[A-Za-z]:')
_LONGEST_PART_BYTES = 255 - len('..part')
_LONGEST_NAME_BYTES = 2048
_MOST_MEMBERS = 1_000_000
_LEAST_SUSPICIOUS_BYTES = 100_000_000
"""Smaller contents may be compressed by any ratio, as files of zeros are."""
_LEAST_DICTIONARY_BYTES = 1 << 26
DECOMPRESSION_ERRORS = (zlib.error, lzma.LZMAError, OSError)
"""bz2 and gzip raise OSError."""
PIECE_BYTES = 1 << 20
"""Read at a time."""
_UNTRUSTED = 'download it from a source that you trust'


@dataclass(frozen=True)
class Member:
    """A file, a folder or something else in an archive.

    Attributes:
        name: As the archive has it, with / between folders.
        size: Declared bytes.
        crc: CRC-32 of the content; None in a tar.
        is_folder: Whether it is a folder.
        other: What it is if it is neither a file nor a folder, such as a symbolic link.
        locked: Why its content cannot be read, such as a password; empty if it can.
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

    def contents(self, wanted: Iterable[Member]) -> Iterator[tuple[Member, Iterator[bytes]]]:
        """Yield some members with the pieces of their content, in the order of the archive.

        The pieces of a member that cannot be read raise BadMemberError.
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
    """Yield the members of an archive as long as none is hostile.

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
            found = f'declares at least {format_bytes(total)} of content, {ratio}'
            raise BadArchiveError(packed.path, found, 'allow more with --max-ratio')
        if total > limits.size:
            found = f'declares at least {format_bytes(total)} of content'
            raise BadArchiveError(packed.path, found, 'allow more with --max-size')
        yield member


def most_dictionary_bytes(archive: Path) -> int:
    """Return the largest LZMA dictionary, which is memory, for an archive of its size.

    64 MB is that of xz -9 and 7-Zip's ultra; no sound archive has one far larger than itself.
    """
    return max(_LEAST_DICTIONARY_BYTES, 16 * archive.stat().st_size)


def _refusal(member: Member) -> str:
    """Return why a member is hostile; empty if it is not."""
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
