# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Types of the keyword options: those of the command line, with underscores."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence


class ExtractKeywords(TypedDict, total=False):
    """Options of extract."""

    overwrite: bool
    remove_archives: bool
    max_ratio: float
    max_size: int | str
    fsync: bool


class DownloadKeywords(TypedDict, total=False):
    """Options of download."""

    category: str | Sequence[str]
    sync: bool
    extract: bool
    tracklets: bool
    accept_license: bool
    base_url: str | None
    checksums: str | os.PathLike[str] | None
    verify: bool
    keep_archives: bool
    archives_only: bool
    jobs: int
    retries: int
    timeout: float | str
    overwrite: bool
    max_ratio: float
    max_size: int | str
    fsync: bool
