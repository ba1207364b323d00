# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of a validation: how much of the files is read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..model.errors import UsageError
from .declare import option
from .parsers import parse_flag


@dataclass(frozen=True)
class ValidateOptions:
    """Options of a validation.

    Attributes:
        quick: Whether only names and sizes of files are checked; of bags only their index.
        decode: Whether the pixels of images are decoded, too.

    Raises:
        UsageError: Both are requested.
    """

    group: ClassVar = 'Checks'

    quick: bool = option(
        False, 'Check names and sizes only; of bags the index', parse_flag, flags=('--quick',)
    )
    decode: bool = option(
        False, 'Decode the pixels of images, too', parse_flag, flags=('--decode',)
    )

    def __post_init__(self) -> None:
        if self.quick and self.decode:
            raise UsageError('--quick reads no images: leave --decode out')
