# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How a bag is written: storage, compression, splitting."""

from __future__ import annotations

from dataclasses import dataclass

from ..model.containers import CONTAINERS
from ..model.errors import UsageError


@dataclass(frozen=True)
class BagOptions:
    """How a bag is written.

    Attributes:
        storage: The container, one of model.containers.
        compression: One of the container's.
        compression_level: One of the compression's; None is the compressor's own default.
        split_size: Bytes of messages, before compression, after which a new file begins.
        split_duration_ns: Nanoseconds of recording after which a new file begins.
        overwrite: Whether an existing bag at the output may be replaced.

    Raises:
        UsageError: A value is unknown or does not go with the others.
    """

    storage: str = 'mcap'
    compression: str = 'none'
    compression_level: int | None = None
    split_size: int | None = None
    split_duration_ns: int | None = None
    overwrite: bool = False

    def __post_init__(self) -> None:
        if self.storage not in CONTAINERS:
            raise UsageError(
                f'there is no storage {self.storage!r}; choose one of {", ".join(CONTAINERS)}'
            )
        known = CONTAINERS[self.storage].compressions
        if self.compression not in known:
            raise UsageError(
                f'storage {self.storage} takes compression {" or ".join(known)},'
                f' not {self.compression!r}'
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
                f'compression {self.compression} of storage {self.storage} has no level to choose'
            )
        if level not in levels:
            raise UsageError(
                f'compression level {level} is out of range;'
                f' {self.compression} takes {levels[0]} to {levels[-1]}'
            )

    @property
    def split(self) -> bool:
        """Whether the bag may become several files."""
        return self.split_size is not None or self.split_duration_ns is not None
