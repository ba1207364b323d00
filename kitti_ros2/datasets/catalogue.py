# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's public archives and raw drives, and their selection.

The figures and their sources are in archives.txt and raw_drives.txt.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ..kitti import archives, names
from ..model.errors import UsageError, did_you_mean, either, not_one_of
from ..options.declare import parse_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


KITTI_URL = 'https://s3.eu-central-1.amazonaws.com/avg-kitti'
"""The bucket of KITTI's download links and its raw_data_downloader.sh."""
CALIB_BYTES = 4100  # they have 4068 to 4075, by the source of the drives' sizes


@dataclass(frozen=True)
class CatalogueEntry:
    """A downloadable archive.

    Attributes:
        benchmark: raw, object, tracking or odometry.
        part: Name on the command line.
        name: Name of the file.
        path: Path below the base URL.
        about_bytes: Size, rounded; None if unknown.
        sha256: Checksum; empty if unknown.
        own_url: URL of an archive outside of KITTI's bucket.
    """

    benchmark: str
    part: str
    name: str
    path: str
    about_bytes: int | None
    sha256: str = ''
    own_url: str = ''

    def urls(self, base_url: str) -> tuple[str, ...]:
        """Return its URLs at a base URL, in the order of attempts."""
        if base_url == KITTI_URL:
            return (self.own_url or f'{base_url}/{self.path}',)
        return tuple(dict.fromkeys((f'{base_url}/{self.path}', f'{base_url}/{self.name}')))


def raw_entry(drive: str, kind: str, about_bytes: int | None) -> CatalogueEntry:
    """Return an archive of a raw drive.

    Args:
        drive: Name without the kind.
        kind: sync, extract or tracklets.
        about_bytes: Size; None if unknown.
    """
    name = f'{drive}_{kind}.zip'
    return CatalogueEntry('raw', f'{drive}_{kind}', name, f'raw_data/{drive}/{name}', about_bytes)


def calib_entry(date: str) -> CatalogueEntry:
    """Return the archive with the calibration of a day."""
    name = archives.raw_calib(date)
    return CatalogueEntry('raw', f'{date}_calib', name, f'raw_data/{name}', CALIB_BYTES)


def _rows(name: str) -> Iterator[list[str]]:
    """Yield the words of each line of a table beside this module."""
    for line in Path(__file__).with_name(name).read_text('utf-8').splitlines():
        if line and not line.startswith('#'):
            yield line.split()


ENTRIES = tuple(
    CatalogueEntry(
        benchmark,
        part,
        name,
        name,
        None if size == '-' else parse_bytes(size),
        sha256.strip('-'),
        url.strip('-'),
    )
    for benchmark, part, name, size, sha256, url in _rows('archives.txt')
)
"""All archives but those of raw drives and calibrations."""
BENCHMARKS = ('raw', 'object', 'tracking', 'odometry')


# KITTI's raw drives.

CATEGORIES = ('city', 'residential', 'road', 'campus', 'person', 'calibration')


@dataclass(frozen=True)
class RawDrive:
    """A drive of KITTI's raw data.

    Attributes:
        name: Date and number, without sync or extract.
        category: One of CATEGORIES.
        frames: Number of frames of sync; None if unknown.
        sync_bytes: Size of the archive of sync.
        has_tracklets: True if an archive of tracklets exists.
    """

    name: str
    category: str
    frames: int | None
    sync_bytes: int
    has_tracklets: bool

    @property
    def date(self) -> str:
        """The date in the name, shared with the archive of the calibration."""
        return self.name.partition('_drive_')[0]

    @property
    def number(self) -> int:
        """The number in the name."""
        return int(self.name[-4:])


@cache
def raw_drives() -> dict[str, RawDrive]:
    """Return all drives by name, in the order of their dates and numbers."""
    drives = {}
    for name, category, frames, size, tracklets in _rows('raw_drives.txt'):
        count = None if frames == '-' else int(frames)
        drives[name] = RawDrive(name, category, count, int(size), tracklets != '-')
    return drives


# Archives by a user's words: a benchmark with its parts, raw drives, ranges of them, dates.
#
# object image_2 calib label_2          parts of a benchmark; all selects each of them
# raw 2011_09_26_drive_0005             a drive, with the calibration of its day
# raw 2011_09_26_drive_0001..0017       the drives of a day between two numbers, both included
# raw 2011_09_26                        all drives of a day
# raw 2011_09_26_calib                  a calibration alone
# data_object_calib.zip                 an archive by its name, alone

_DRIVE = re.compile(r'(\d{4}_\d{2}_\d{2}_drive_\d{4})(?:_(sync|extract|tracklets))?(?:\.zip)?')
_RANGE = re.compile(r'(\d{4}_\d{2}_\d{2})_drive_(\d{4})\.\.(?:\1_drive_)?(\d{4})')
_CALIB = re.compile(r'(\d{4}_\d{2}_\d{2})_calib(?:\.zip)?')
_ALL = 'all'
_ALIASES = {'image_2': 'image_02', 'image_3': 'image_03', 'label_2': 'label_02'}
"""Parts of tracking by the names of their archives."""


@dataclass(frozen=True)
class RawKinds:
    """A selection of archives of raw drives.

    Attributes:
        kinds: Any of sync, extract, tracklets; empty selects sync and existing tracklets.
        categories: Categories of the drives; empty selects all.

    Raises:
        UsageError: A category is unknown.
    """

    kinds: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for category in self.categories:
            if category not in CATEGORIES:
                raise not_one_of('category', category, CATEGORIES)

    def entries(self, drives: Iterable[RawDrive], kind: str = '') -> list[CatalogueEntry]:
        """Return the archives of drives, each day's calibration first.

        Args:
            drives: The drives; those of other categories are left out.
            kind: The kind in a drive's name.

        Raises:
            UsageError: None of them is of the categories.
        """
        named = list(drives)
        matching = [
            drive for drive in named if not self.categories or drive.category in self.categories
        ]
        if named and not matching:
            raise UsageError(f'none of these drives is of category {either(self.categories)}')
        entries = [calib_entry(date) for date in dict.fromkeys(drive.date for drive in matching)]
        for drive in matching:
            kinds = (kind,) if kind else self.kinds or ('sync', *self._labels(drive))
            sizes = {'sync': drive.sync_bytes}
            entries += [raw_entry(drive.name, part, sizes.get(part)) for part in kinds]
        return entries

    @staticmethod
    def _labels(drive: RawDrive) -> tuple[str, ...]:
        return ('tracklets',) if drive.has_tracklets else ()


def select(words: Sequence[str], raw: RawKinds) -> list[CatalogueEntry]:
    """Return the archives that words name, without duplicates.

    Raises:
        UsageError: A word is unknown, or nothing is selected.
    """
    entries: list[CatalogueEntry] = []
    benchmark, chosen = '', False
    for word in words:
        if word in BENCHMARKS:
            entries += _close(benchmark, raw, chosen=chosen)
            benchmark, chosen = word, False
            continue
        entries += _select_word(word, benchmark, raw)
        chosen = True
    entries += _close(benchmark, raw, chosen=chosen)
    if not entries:
        raise UsageError(
            f'nothing is selected; give {either(BENCHMARKS)} with parts, such as object calib'
            f' label_2, or raw 2011_09_26_drive_0005 (--list shows all)'
        )
    return list(dict.fromkeys(entries))


def _close(benchmark: str, raw: RawKinds, *, chosen: bool) -> list[CatalogueEntry]:
    """Return the archives of a benchmark without parts, which needs --category."""
    if chosen or not benchmark:
        return []
    if benchmark == 'raw' and raw.categories:
        return raw.entries(raw_drives().values())
    if benchmark == 'raw':
        parts = ['2011_09_26_drive_0005', '2011_09_26', '2011_09_26_calib', _ALL]
    else:
        parts = [*_parts(benchmark), _ALL]
    raise UsageError(f'{benchmark}: give parts of it: {either(parts)}')


def _parts(benchmark: str) -> dict[str, CatalogueEntry]:
    return {entry.part: entry for entry in ENTRIES if entry.benchmark == benchmark}


def _select_word(word: str, benchmark: str, raw: RawKinds) -> list[CatalogueEntry]:
    """Return the archives that a word names."""
    by_name = {entry.name: entry for entry in ENTRIES}
    if word in by_name:
        return [by_name[word]]
    parts = _parts(benchmark)
    part = _ALIASES.get(word, word) if benchmark == 'tracking' else word
    if part in parts:
        return [parts[part]]
    if word == _ALL and benchmark == 'raw':
        return raw.entries(raw_drives().values())
    if word == _ALL and benchmark:
        return list(parts.values())
    if benchmark in {'', 'raw'}:
        entries = _select_raw(word, raw)
        if entries:
            return entries
    words = [*parts, _ALL] if benchmark else [*BENCHMARKS, *by_name]
    if benchmark == 'raw':
        words += [*raw_drives()]
    hint = did_you_mean(word, words) or f'; there are {either(words[:9])} (--list shows all)'
    raise UsageError(f'there is no {f"{benchmark} " if benchmark else ""}{word}{hint}')


def _select_raw(word: str, raw: RawKinds) -> list[CatalogueEntry]:
    drives = raw_drives()
    dates = {drive.date for drive in drives.values()}
    drive, span, calib = _DRIVE.fullmatch(word), _RANGE.fullmatch(word), _CALIB.fullmatch(word)
    if drive is not None and drive[1] in drives:
        if word.endswith('.zip') and drive[2]:
            size = drives[drive[1]].sync_bytes if drive[2] == 'sync' else None
            return [raw_entry(drive[1], drive[2], size)]
        return RawKinds(raw.kinds).entries([drives[drive[1]]], drive[2] or '')
    if span is not None:
        first, last = int(span[2]), int(span[3])
        within = [
            drive
            for drive in drives.values()
            if drive.date == span[1] and first <= drive.number <= last
        ]
        if not within:
            raise UsageError(f'{word}: there is no drive between these; --list shows all')
        return raw.entries(within)
    if calib is not None and calib[1] in dates:
        return [calib_entry(calib[1])]
    if names.RAW_DATE.fullmatch(word) and word in dates:
        return raw.entries([drive for drive in drives.values() if drive.date == word])
    return []
