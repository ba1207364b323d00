# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs that exist either completely or not at all, local (local_staging) or in a store."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from .local_staging import (
    NAMED,
    Staging,
    lock_exclusively,
    may_exist,
    output_error,
    refuse_link,
    remove_leftovers,
    reported,
    taking_over,
)
from .remote import is_remote

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .uploads import UploadStaging

__all__ = [
    'Staging',
    'lies_inside',
    'lock_exclusively',
    'may_exist',
    'open_staging',
    'output_error',
    'refuse_inside',
    'refuse_link',
    'remove_leftovers',
    'reported',
    'staged',
    'staged_file',
    'taking_over',
]


def open_staging(
    path: Path, refusal: Callable[[Path], str | None], *, fsync: bool = True
) -> Staging | UploadStaging:
    """Open the temporary directory of an output, local or in a store.

    Args and errors are those of Staging and UploadStaging; a store needs no fsync.
    """
    if is_remote(path):
        from .uploads import UploadStaging  # noqa: PLC0415 - for URLs only

        return UploadStaging(path, refusal)
    return Staging(path, refusal, fsync=fsync)


@contextmanager
def staged(
    out: Path, refusal: Callable[[Path], str | None] | None = None, *, fsync: bool = True
) -> Iterator[Path]:
    """Yield a folder to build a data set in; its content is moved to out on success.

    Args:
        out: The data set: absent, an empty folder, or one that the refusal lets be replaced.
        refusal: As in Staging; None: all are kept, and no option replaces them.
        fsync: As in Staging.

    Raises:
        OutputExistsError: out is not empty.
        OutputError: It cannot be written.
    """
    keep = refusal or _keep_content
    staging = open_staging(out, lambda path: None if _is_empty(path) else keep(path), fsync=fsync)
    with _published(staging), reported(out):
        staging.content.mkdir()
        yield staging.content


@contextmanager
def _published(staging: Staging | UploadStaging) -> Iterator[None]:
    """Publish an output at the end; after an error remove it, and name what could not be."""
    try:
        yield
        staging.publish()
    except BaseException as error:
        staging.discard()
        staging.note_remains(error)
        raise


def _is_empty(path: Path) -> bool:
    # A store has no empty folders.
    return not is_remote(path) and path.is_dir() and not any(path.iterdir())


def _keep_content(path: Path) -> str | None:  # noqa: ARG001 - one form for all
    return 'choose another name, or an empty folder'


def lies_inside(out: Path, source: Path) -> bool:
    """Return whether an output is its source or lies inside it."""
    if is_remote(out) or is_remote(source):
        return is_remote(out) and is_remote(source) and out.is_relative_to(source)
    # Unlike Path.resolve, this accepts circular links.
    target, origin = (Path(os.path.realpath(path)) for path in (out, source))
    return target == origin or origin in target.parents


def refuse_inside(source: Path, out: Path) -> None:
    """Refuse an output inside the recording that it is made from.

    Raises:
        UsageError: The output lies inside.
    """
    if lies_inside(out, source):
        raise UsageError(f'{out}: lies inside the recording {source}; give a path outside of it')


@contextmanager
def staged_file(out: Path, refusal: Callable[[Path], str | None]) -> Iterator[Path]:
    """Yield a path of the same name to write a file to; on success it is moved to out.

    Raises:
        OutputExistsError: out exists and may not be replaced.
        OutputError: The disk refuses.
    """
    staging = open_staging(out, refusal)
    with _published(staging), reported(out):
        # Programs that write pictures and films use the suffix of the name.
        folder = staging.content.with_name(NAMED)
        folder.mkdir()
        yield folder / out.name
        (folder / out.name).rename(staging.content)
        folder.rmdir()
