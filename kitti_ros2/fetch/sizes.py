# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of archives before they are downloaded, and the space that they need."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from .catalogue import KITTI_URL
from .sources import BrokenTransferError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..options.fetching import DownloadOptions
    from .catalogue import CatalogueEntry
    from .sources import ArchiveSource

_CONTENT_RATIO = 1.4
"""Size of the content of KITTI's archives, at most: 1.33 for a real drive of 120 frames."""


def archive_sizes(
    entries: Sequence[CatalogueEntry], source: ArchiveSource, base_url: str
) -> dict[str, int]:
    """Return the sizes of archives by name: what the server says, else what the catalogue has."""
    from_kitti = base_url == KITTI_URL
    sizes = {each.name: each.about_bytes or 0 if from_kitti else 0 for each in entries}
    with suppress(BrokenTransferError):  # that is for the transfers to report
        for entry in entries:
            found = (source.size(url) for url in entry.urls(base_url))
            sizes[entry.name] = next((size for size in found if size), sizes[entry.name])
    return sizes


def needed_bytes(sizes: Iterable[int], present: int, options: DownloadOptions) -> float:
    """Return the bytes that archives and their content need on a disk, at most at a time.

    Args:
        sizes: Those of the archives.
        present: Bytes of archives that are there, also in part.
        options: Whether archives are kept, and extracted.
    """
    largest = sorted(sizes, reverse=True)
    kept = options.keep_archives or options.archives_only
    archives = max(sum(largest if kept else largest[: options.jobs]) - present, 0)
    return archives + (0.0 if options.archives_only else _CONTENT_RATIO * sum(largest))
