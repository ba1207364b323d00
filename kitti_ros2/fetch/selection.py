# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Words of a user to archives: a benchmark with its parts, raw drives, ranges of them, dates.

object image_2 calib label_2          parts of a benchmark; all selects each of them
raw 2011_09_26_drive_0005             a drive, with the calibration of its day
raw 2011_09_26_drive_0001..0017       the drives of a day between two numbers, both included
raw 2011_09_26                        all drives of a day
raw 2011_09_26_calib                  a calibration alone
data_object_calib.zip                 an archive by its name, alone
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..kitti import names
from ..model.errors import UsageError
from ..model.spelling import did_you_mean, not_one_of
from ..model.text import either
from .catalogue import BENCHMARKS, ENTRIES, calib_entry, raw_entry
from .raw_drives import CATEGORIES, raw_drives

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from .catalogue import CatalogueEntry
    from .raw_drives import RawDrive

_DRIVE = re.compile(r'(\d{4}_\d{2}_\d{2}_drive_\d{4})(?:_(sync|extract|tracklets))?(?:\.zip)?')
_RANGE = re.compile(r'(\d{4}_\d{2}_\d{2})_drive_(\d{4})\.\.(?:\1_drive_)?(\d{4})')
_CALIB = re.compile(r'(\d{4}_\d{2}_\d{2})_calib(?:\.zip)?')
_ALL = 'all'
_ALIASES = {'image_2': 'image_02', 'image_3': 'image_03', 'label_2': 'label_02'}
"""Parts of tracking by the names of their archives."""


@dataclass(frozen=True)
class RawKinds:
    """Which archives of raw drives are selected.

    Attributes:
        kinds: Of sync, extract and tracklets; empty selects sync, and tracklets where they exist.
        categories: Only drives of these; empty selects all.

    Raises:
        UsageError: A category is unknown.
    """

    kinds: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for each in self.categories:
            if each not in CATEGORIES:
                raise not_one_of('category', each, CATEGORIES)

    def entries(self, drives: Iterable[RawDrive], kind: str = '') -> list[CatalogueEntry]:
        """Return the archives of drives, each day's calibration first.

        Args:
            drives: The drives; those of other categories are left out.
            kind: The kind that was given with a drive's name.

        Raises:
            UsageError: None of them is of the categories.
        """
        given = list(drives)
        chosen = [each for each in given if not self.categories or each.category in self.categories]
        if given and not chosen:
            raise UsageError(f'none of these drives is of category {either(self.categories)}')
        found = [calib_entry(date) for date in dict.fromkeys(each.date for each in chosen)]
        for drive in chosen:
            kinds = (kind,) if kind else self.kinds or ('sync', *self._labels(drive))
            sizes = {'sync': drive.sync_bytes}
            found += [raw_entry(drive.name, each, sizes.get(each)) for each in kinds]
        return found

    @staticmethod
    def _labels(drive: RawDrive) -> tuple[str, ...]:
        return ('tracklets',) if drive.has_tracklets else ()


def select(words: Sequence[str], raw: RawKinds) -> list[CatalogueEntry]:
    """Return the archives that words name, each once.

    Raises:
        UsageError: A word is unknown, or nothing is selected.
    """
    found: list[CatalogueEntry] = []
    benchmark, chosen = '', False
    for word in words:
        if word in BENCHMARKS:
            found += _close(benchmark, raw, chosen=chosen)
            benchmark, chosen = word, False
            continue
        found += _select_word(word, benchmark, raw)
        chosen = True
    found += _close(benchmark, raw, chosen=chosen)
    if not found:
        raise UsageError(
            f'nothing is selected; give {either(BENCHMARKS)} with parts, such as object calib'
            f' label_2, or raw 2011_09_26_drive_0005 (--list shows all)'
        )
    return list(dict.fromkeys(found))


def _close(benchmark: str, raw: RawKinds, *, chosen: bool) -> list[CatalogueEntry]:
    """Return the archives of a benchmark without parts: only --category selects some."""
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
    return {each.part: each for each in ENTRIES if each.benchmark == benchmark}


def _select_word(word: str, benchmark: str, raw: RawKinds) -> list[CatalogueEntry]:
    """Return the archives that a word names."""
    by_name = {each.name: each for each in ENTRIES}
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
        found = _select_raw(word, raw)
        if found:
            return found
    known = [*parts, _ALL] if benchmark else [*BENCHMARKS, *by_name]
    if benchmark == 'raw':
        known += [*raw_drives()]
    hint = did_you_mean(word, known) or f'; there are {either(known[:9])} (--list shows all)'
    raise UsageError(f'there is no {f"{benchmark} " if benchmark else ""}{word}{hint}')


def _select_raw(word: str, raw: RawKinds) -> list[CatalogueEntry]:
    drives = raw_drives()
    dates = {each.date for each in drives.values()}
    drive, span, calib = _DRIVE.fullmatch(word), _RANGE.fullmatch(word), _CALIB.fullmatch(word)
    if drive is not None and drive[1] in drives:
        if word.endswith('.zip') and drive[2]:
            size = drives[drive[1]].sync_bytes if drive[2] == 'sync' else None
            return [raw_entry(drive[1], drive[2], size)]
        return RawKinds(raw.kinds).entries([drives[drive[1]]], drive[2] or '')
    if span is not None:
        first, last = int(span[2]), int(span[3])
        within = [
            each
            for each in drives.values()
            if each.date == span[1] and first <= each.number <= last
        ]
        if not within:
            raise UsageError(f'{word}: there is no drive between these; --list shows all')
        return raw.entries(within)
    if calib is not None and calib[1] in dates:
        return [calib_entry(calib[1])]
    if names.RAW_DATE.fullmatch(word) and word in dates:
        return raw.entries([each for each in drives.values() if each.date == word])
    return []
