# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of dividing a data set into lists of frames or sequences."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from .declare import option
from .parsers import parse_flag, parse_integer, parse_path, parse_paths, parse_texts
from .quantity_parsers import parse_shares

if TYPE_CHECKING:
    from fractions import Fraction
    from pathlib import Path

_NAME = re.compile(r'[A-Za-z0-9_][A-Za-z0-9_.-]*', re.ASCII)
_NAMES = ('train', 'val')
_ROUNDING = 1e-9
"""How far the sum of the shares may be from 1."""


@dataclass(frozen=True)
class SplitOptions:
    """Options of dividing a data set.

    Attributes:
        ratio: The share of each list; empty is equal shares.
        names: The name of each list; empty is train and val.
        seed: Chooses one of the random orders; None is 0.
        by_drive: Whether frames of one raw drive of an object set stay together.
        lists: Files of fixed lists to check and copy, in place of random ones.
        check: Whether the existing lists, or those of lists, are compared and nothing is written.
        mapping: The folder of the object devkit's mapping; None searches beside the set.
        out: The folder of the lists; None is ImageSets of the set.
        overwrite: Whether existing lists may be replaced.

    Raises:
        UsageError: A value is invalid, or excludes another.
    """

    group: ClassVar = 'Split'

    ratio: tuple[Fraction, ...] = option(
        (),
        'Share of each list, such as 0.8 0.2',
        parse_shares,
        unset='equal shares',
        metavar='SHARE...',
    )
    names: tuple[str, ...] = option((), 'Name of each list', parse_texts, unset='train val')
    seed: int | None = option(
        None, 'Number of the random order', parse_integer, unset='0', metavar='N'
    )
    by_drive: bool = option(
        False, "Keep frames of one raw drive together, by the devkit's mapping", parse_flag
    )
    lists: tuple[Path, ...] = option(
        (),
        'Check and copy these lists instead; with --check only check them',
        parse_paths,
        unset='none',
        flags=('--lists', '--from'),
        metavar='FILE...',
    )
    check: bool = option(
        False, 'Write nothing; compare the lists of the set, each with each', parse_flag
    )
    mapping: Path | None = option(
        None,
        "Folder of the devkit's train_mapping.txt",
        parse_path,
        unset='beside the set',
        metavar='DIR',
    )
    out: Path | None = option(
        None,
        'Folder of the lists',
        parse_path,
        unset='ImageSets in SRC',
        metavar='DIR',
    )
    overwrite: bool = option(False, 'Replace existing lists', parse_flag)

    def __post_init__(self) -> None:
        self._check_combination()
        for name in self.names:
            if not _NAME.fullmatch(name):
                raise UsageError(f'{name!r} is no name of a list; expected letters and digits')
        if len(set(self.names)) < len(self.names):
            raise UsageError(f'the lists {" ".join(self.names)} have not different names')
        if self.ratio and len(self.ratio) != len(self.list_names):
            raise UsageError(
                f'{len(self.ratio)} shares for the lists {" ".join(self.list_names)};'
                f' give a share and a name to each, with --ratio and --names'
            )
        if self.ratio and abs(float(sum(self.ratio)) - 1) > _ROUNDING:
            shares = ' '.join(f'{float(share):g}' for share in self.ratio)
            raise UsageError(f'the shares {shares} add up to {float(sum(self.ratio)):g}, not to 1')

    def _check_combination(self) -> None:
        random = {
            '--ratio': self.ratio,
            '--names': self.names,
            '--seed': self.seed is not None,
            '--by-drive': self.by_drive,
        }
        given = [flag for flag, value in random.items() if value]
        other = '--check' if self.check else '--lists' if self.lists else ''
        if given and other:
            raise UsageError(f'{given[0]} is for new random lists, not for {other}')
        if self.check and self.overwrite:
            raise UsageError('--check writes nothing, so it does not go with --overwrite')

    @property
    def list_names(self) -> tuple[str, ...]:
        """The names of new lists."""
        return self.names or _NAMES

    @property
    def shares(self) -> tuple[Fraction, ...]:
        """The share of each new list."""
        from fractions import Fraction  # noqa: PLC0415 - for one command

        count = len(self.list_names)
        return self.ratio or (Fraction(1, count),) * count
