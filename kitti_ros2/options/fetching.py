# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of extracting and downloading archives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .declare import check_bounds, option
from .parsers import parse_flag, parse_number, parse_size


@dataclass(frozen=True)
class ExtractOptions:
    """Options of extracting archives.

    Attributes:
        overwrite: Whether existing files with other content are replaced.
        remove_archives: Whether an archive is removed when all of it is extracted.
        max_ratio: Bytes of content for each byte of an archive, above which it is refused.
        max_size: Bytes of content of one archive, above which it is refused.

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

    def __post_init__(self) -> None:
        check_bounds(self, 'max_ratio')
