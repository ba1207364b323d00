# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of a written bag: storage, compression, splitting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..model.containers import CONTAINERS
from ..model.errors import UsageError
from ..model.spelling import not_one_of
from .declare import option
from .disk import fsync_option
from .parsers import parse_flag, parse_integer, parse_text
from .quantity_parsers import parse_seconds_ns, parse_split_size

_COMPRESSIONS = tuple(
    dict.fromkeys(name for each in CONTAINERS.values() for name in each.compressions)
)


@dataclass(frozen=True)
class BagOptions:
    """Options of a written bag.

    Attributes:
        storage: The container, one of model.containers.
        compression: One of the container's.
        compression_level: One of the compression's; None is the compressor's default.
        split_size: Bytes of messages, before compression, after which a new file is started.
        split_duration_ns: Nanoseconds of recording after which a new file is started.
        overwrite: Whether an existing bag at the output may be replaced.
        fsync: Whether the finished bag outlasts a power cut.
        keep_partial: Whether what was written of an interrupted bag is kept beside the output.

    Raises:
        UsageError: A value is unknown or does not match the others.
    """

    group: ClassVar = 'Bag'

    storage: str = 'mcap'
    compression: str = option(
        'none', 'mcap: lz4, zstd; sqlite3: zstd; ros1: lz4, bz2', parse_text, choices=_COMPRESSIONS
    )
    compression_level: int | None = option(
        None, 'lz4 0 to 16, zstd 1 to 22', parse_integer, unset="the compressor's default"
    )
    split_size: int | None = option(
        None,
        'Start a new file after so many bytes, such as 2GB (at least 1MB)',
        parse_split_size,
        unset='never',
        metavar='SIZE',
    )
    split_duration_ns: int | None = option(
        None,
        'Start a new file after so many seconds, such as 60s',
        parse_seconds_ns,
        name='split_duration',
        unset='never',
    )
    overwrite: bool = option(False, 'Replace an existing bag', parse_flag)
    fsync: bool = fsync_option()
    keep_partial: bool = option(
        False, 'Keep what was written before an interruption, as OUT.partial', parse_flag
    )

    def __post_init__(self) -> None:
        if self.storage not in CONTAINERS:
            raise not_one_of('storage', self.storage, list(CONTAINERS))
        known = CONTAINERS[self.storage].compressions
        if self.compression not in known:
            raise not_one_of(
                f'compression of storage {self.storage}', self.compression, list(known)
            )
        self._check_level(known[self.compression])
        for name, value in (('size', self.split_size), ('duration', self.split_duration_ns)):
            if value is not None and value <= 0:
                raise UsageError(f'a split {name} of {value} is not positive')

    def _check_level(self, levels: range | None) -> None:
        level = self.compression_level
        if level is None:
            return
        if levels is None:
            raise UsageError(
                f'compression {self.compression} of storage {self.storage} has no levels'
            )
        if level not in levels:
            raise UsageError(
                f'compression level {level} is out of range;'
                f' {self.compression} supports {levels[0]} to {levels[-1]}'
            )

    @property
    def split(self) -> bool:
        """Whether the bag may be split into several files."""
        return self.split_size is not None or self.split_duration_ns is not None
