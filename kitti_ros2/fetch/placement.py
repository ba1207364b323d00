# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which files of an archive are extracted, and to which places; nothing is written here."""

from __future__ import annotations

import os
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..kitti.archive_places import is_known, is_part_of_set, is_top, places, places_in
from ..model.errors import UsageError
from ..model.text import format_count
from .errors import BadArchiveError
from .members import checked
from .open_archive import open_archive

if TYPE_CHECKING:
    from collections.abc import Iterable

    from .members import Limits, Member

_NOISE = frozenset({'__MACOSX', '.DS_Store', 'Thumbs.db', 'desktop.ini'})
_REPACKED = 'it was not packed by KITTI; extract it with another program'


@dataclass(frozen=True)
class Placement:
    """What is extracted of an archive.

    Attributes:
        path: The archive.
        files: Its files with their places below the root, in the order of the archive.
        notes: Non-fatal remarks.
    """

    path: Path
    files: tuple[tuple[Member, str], ...]
    notes: tuple[str, ...]

    @property
    def size_bytes(self) -> int:
        """Declared bytes of all files."""
        return sum(member.size for member, _ in self.files)


def place_files(path: Path, root: Path, limits: Limits) -> Placement:
    """List an archive and choose the place of each of its files.

    Raises:
        BadArchiveError: The archive is damaged or hostile, or contains nothing of KITTI's.
        MissingPathError: There is no such file.
        UsageError: The root is a part of a data set.
    """
    with open_archive(path) as packed:
        files = [each for each in checked(packed, limits) if not each.is_folder]
    chosen = [each for each in files if not _is_noise(each.name)]
    found = [each.name for each in chosen]
    known = [name for name in found if is_known(name, path.name)]
    if not known:
        what = f'contains no folder of KITTI in {format_count(len(found), "file")}'
        raise BadArchiveError(path, what, 'extract it with another program')
    wanted = places_in(root, places(found, path.name))
    if is_part_of_set(Path(os.path.realpath(root)).name) and any(
        _is_whole(place) for place in wanted
    ):
        raise UsageError(
            f'{root}: is a part of a data set, and {path} contains whole data sets;'
            f' give the folder above it'
        )
    placed = list(zip(chosen, wanted, strict=True))
    _check_collisions(path, placed)
    skipped = len(files) - len(chosen)
    note = f'{path}: {format_count(skipped, "file")} of desktop programs left out, as .DS_Store'
    return Placement(path, tuple(placed), (note,) if skipped else ())


def _is_noise(name: str) -> bool:
    parts = name.split('/')
    return not _NOISE.isdisjoint(parts) or parts[-1].startswith('._')


def _is_whole(place: str) -> bool:
    """Whether a place begins with a folder that belongs above a part of a data set."""
    return is_top(place.partition('/')[0])


def _check_collisions(path: Path, placed: Iterable[tuple[Member, str]]) -> None:
    """Refuse names that are the same file on some file systems, and files with files in them."""
    spellings: dict[str, str] = {}
    files: dict[str, Member] = {}
    folders: set[str] = set()
    for member, place in placed:
        parts = place.split('/')
        for depth in range(1, len(parts) + 1):
            part = '/'.join(parts[:depth])
            key = unicodedata.normalize('NFC', part).casefold()
            if spellings.setdefault(key, part) != part:
                what = f'contains both {spellings[key]!r} and {part!r}'
                raise BadArchiveError(path, what, _REPACKED)
        folders.update('/'.join(parts[:depth]) for depth in range(1, len(parts)))
        other = files.setdefault(place, member)
        if (other.size, other.crc) != (member.size, member.crc):
            raise BadArchiveError(path, f'contains two different files {place!r}', _REPACKED)
    both = folders & files.keys()
    if both:
        raise BadArchiveError(path, f'contains {min(both)!r} as a file and as a folder', _REPACKED)
