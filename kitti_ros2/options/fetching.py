# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of extracting and downloading archives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from .declare import check_bounds, option
from .disk import fsync_option
from .parsers import parse_flag, parse_integer, parse_number, parse_path, parse_text, parse_texts
from .quantity_parsers import parse_seconds_ns, parse_size

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class ExtractOptions:
    """Options of extracting archives.

    Attributes:
        overwrite: Whether existing files with other content are replaced.
        remove_archives: Whether an archive is removed when all of it is extracted.
        max_ratio: Bytes of content for each byte of an archive, above which it is refused.
        max_size: Bytes of content of one archive, above which it is refused.
        fsync: Whether finished files outlast a power cut.

    Raises:
        UsageError: The ratio is out of range.
    """

    group: ClassVar = 'Extraction'

    overwrite: bool = option(False, 'Replace existing files that differ', parse_flag)
    remove_archives: bool = option(
        False, 'Remove each archive of which everything was extracted', parse_flag
    )
    max_ratio: float = option(
        200.0,
        'Refuse archives that grow to more than so many times their size',
        parse_number,
        bounds=(1.0, 2000.0),
    )
    max_size: int = option(
        500_000_000_000,
        'Refuse archives of more content, such as 2TB',
        parse_size,
        unset='500GB',
        metavar='SIZE',
    )
    fsync: bool = fsync_option()

    def __post_init__(self) -> None:
        check_bounds(self, 'max_ratio')


def parse_categories(name: str, value: object) -> tuple[str, ...]:
    """Parse categories of raw drives, separated by commas."""
    return parse_texts(name, value)


@dataclass(frozen=True)
class DownloadOptions:
    """Options of downloading archives.

    Attributes:
        categories: Only raw drives of these categories; empty selects all.
        sync, extract, tracklets: Which archives of raw drives; none selects sync and tracklets.
        base_url: Where the archives are.
        checksums: A file of SHA-256 checksums as sha256sum writes it, or None.
        verify: Whether known checksums are compared.
        keep_archives: Whether archives are kept after they are extracted.
        archives_only: Whether archives are not extracted at all.
        jobs: Number of archives to download at a time.
        retries: Attempts without any progress after which an archive is skipped.
        timeout_ns: Time without any data after which a transfer is broken off.
        accept_license: Whether the terms of KITTI are accepted.

    Raises:
        UsageError: A value is out of range.
    """

    group: ClassVar = 'Download'

    categories: tuple[str, ...] = option(
        (),
        'Raw: only drives of these, such as city,road',
        parse_categories,
        name='category',
        unset='all',
        metavar='NAMES',
    )
    sync: bool = option(
        False, 'Raw: rectified, paired by number (default)', parse_flag, flags=('--sync',)
    )
    extract: bool = option(
        False, 'Raw: unrectified, before synchronization', parse_flag, flags=('--extract',)
    )
    tracklets: bool = option(
        False, 'Raw: 3D labels (default, too, where they exist)', parse_flag, flags=('--tracklets',)
    )
    accept_license: bool = option(
        False,
        "Accept KITTI's terms (asked for once): CC BY-NC-SA 3.0",
        parse_flag,
        flags=('--accept-license',),
    )
    base_url: str | None = option(
        None,
        'A mirror: http(s)://... or file:///...',
        parse_text,
        unset="KITTI's own",
        metavar='URL',
    )
    checksums: Path | None = option(
        None,
        'SHA-256 checksums to compare, a file as sha256sum writes it',
        parse_path,
        unset='the public ones',
    )
    verify: bool = option(True, 'Compare known SHA-256 checksums', parse_flag)
    keep_archives: bool = option(
        False, 'Keep archives after extracting them', parse_flag, flags=('--keep-archives',)
    )
    archives_only: bool = option(
        False, 'Do not extract the archives', parse_flag, flags=('--archives-only',)
    )
    jobs: int = option(3, 'Archives to download at a time', parse_integer, bounds=(1, 16))
    retries: int = option(
        6, 'Attempts without progress before giving up', parse_integer, bounds=(0, 100)
    )
    timeout_ns: int = option(
        30_000_000_000,
        'Seconds without data before another attempt',
        parse_seconds_ns,
        name='timeout',
        bounds=(0.1, 3600.0),
    )

    def __post_init__(self) -> None:
        check_bounds(self, 'jobs', 'retries', 'timeout')
