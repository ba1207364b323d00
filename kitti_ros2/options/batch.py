# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of commands that take whole collections."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from .declare import make_options, option, options_of, parse_values
from .parsers import parse_flag, parse_integer, parse_text
from .table import REPORT, TO_BAG, TO_KITTI

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .declare import Option

LOCAL = 'local'
"""The value of `scheduler` that starts a cluster on this machine."""
_MOST_JOBS = 256
_MOST_FRAMES = 1_000_000
_ADDRESS = re.compile(r'[a-z]+://[^/\s]+:\d{1,5}/?', re.ASCII)


def parse_scheduler(name: str, value: object) -> str:
    """Parse the address of a Dask scheduler, or `local`.

    Raises:
        UsageError: It is neither.
    """
    text = parse_text(name, value)
    if text == LOCAL or _ADDRESS.fullmatch(text):
        return text
    raise UsageError(f'--{name} {text} is no address; expected tcp://HOST:PORT, or {LOCAL}')


@dataclass(frozen=True)
class BatchOptions:
    """Options of a collection.

    Attributes:
        whole: Whether SRC is a collection and OUT a folder of outputs.
        jobs: Number of worker processes. Without `whole` they encode one recording, and None is no
            process but this one; else they convert units, and None is one for each CPU, at most 8.
        slice_frames: Frames of a unit of an object set; None takes a split whole.
        retry: Whether failed units are run again.
        scheduler: Dask scheduler that runs the units: its address, or `local` to start one; None
            runs them on processes of this program.

    Raises:
        UsageError: A number is out of range, or an option is given without `all`.
    """

    group: ClassVar = 'Collections'

    whole: bool = option(
        False,
        'SRC is a collection (a root, a quoted glob, or a .txt list of folders), OUT a folder',
        parse_flag,
        name='all',
        flags=('--all',),
    )
    jobs: int | None = option(
        None,
        'Worker processes, 1 to 256: with --all for units, without it for frames',
        parse_integer,
        unset='with --all one per CPU, at most 8',
    )
    slice_frames: int | None = option(
        None,
        'With --all: divide object sets into units of so many frames',
        parse_integer,
        unset='one unit',
    )
    retry: bool = option(
        False,
        'With --all: run units again that failed or skipped data',
        parse_flag,
        flags=('--retry',),
    )
    scheduler: str | None = option(
        None,
        'With --all: run on a Dask cluster, tcp://HOST:PORT, or start one here: local',
        parse_scheduler,
        unset='processes',
    )

    def __post_init__(self) -> None:
        self._check('jobs', self.jobs, _MOST_JOBS)
        self._check('slice-frames', self.slice_frames, _MOST_FRAMES)
        given = {
            'slice-frames': self.slice_frames is not None,
            'retry': self.retry,
            'scheduler': self.scheduler is not None,
        }
        alone = [name for name, is_given in given.items() if is_given and not self.whole]
        if alone:
            raise UsageError(f'--{alone[0]} is for whole collections; give --all too')
        if self.jobs is not None and self.scheduler not in {None, LOCAL}:
            raise UsageError(
                f'--jobs is for workers on this machine, and the cluster at {self.scheduler} has'
                ' workers of its own; leave --jobs out'
            )

    @staticmethod
    def _check(name: str, value: int | None, most: int) -> None:
        if value is not None and not 1 <= value <= most:
            raise UsageError(f'--{name} {value} is out of range; expected 1 to {most}')


BATCH = options_of(BatchOptions)
"""Options of a collection; they are of the command line only."""
_SLICED = 'slice_frames'


def collection_options(meaning: str, *, sliced: bool = False) -> tuple[Option, ...]:
    """Return the options of a collection for a command.

    Args:
        meaning: Help of --all.
        sliced: Whether units may be slices of an object set.
    """
    return tuple(
        replace(each, meaning=meaning) if each.name == 'all' else each
        for each in BATCH
        if sliced or each.name != _SLICED
    )


TO_BAG_ALL = (
    *TO_BAG,
    *collection_options(
        'SRC is a collection (a root, a quoted glob, or a .txt list of folders), OUT a folder',
        sliced=True,
    ),
)
TO_KITTI_ALL = (
    *TO_KITTI,
    *collection_options(
        'BAG is a collection (a root, a quoted glob, or a .txt list of bags), OUT a folder of'
        ' a data set for each'
    ),
)
REPORT_ALL = (
    *REPORT,
    *collection_options(
        'SRC is a collection (a root, a quoted glob, or a .txt list), OUT a folder of pages'
    ),
)
"""Options of commands that take a collection."""


def split_batch_options(
    values: Mapping[str, object], *, jobs_alone: bool = False
) -> tuple[BatchOptions, dict[str, object]]:
    """Return the options of the collection, and the values of the others, by name.

    Args:
        values: Of all options, by name.
        jobs_alone: Whether the command has worker processes for a single recording, too.

    Raises:
        UsageError: A value is invalid.
    """
    names = {each.name for each in BATCH}
    own = {name: value for name, value in values.items() if name in names}
    rest = {name: value for name, value in values.items() if name not in names}
    batch = make_options(BatchOptions, parse_values(own, BATCH))
    if batch.jobs is not None and not (batch.whole or jobs_alone):
        raise UsageError('--jobs is for whole collections; give --all too')
    return batch, rest
