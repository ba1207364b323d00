# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs that exist either completely or not at all, local (local_staging) or in a store.

Also: which existing ones --overwrite may replace, and values as JSON text.
"""

from __future__ import annotations

import json
import os
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..model.bag_formats import CONTAINERS
from ..model.errors import UsageError
from .local_staging import (
    NAMED,
    Staging,
    lock_exclusively,
    may_exist,
    output_error,
    refuse_link,
    reported,
    sweep,
    taking_over,
)
from .remote import is_remote

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from ..model.errors import Loss
    from .uploads import UploadStaging


# Values as JSON text.


def json_text(values: object) -> str:
    """Return values as one JSON document; NaN and infinite numbers are null, paths are text."""
    return json.dumps(_finite(values), default=_json_value, indent=2) + '\n'


def losses_json(losses: Iterable[Loss]) -> list[dict[str, object]]:
    """Return losses with their texts, for json_text."""
    return [{'stream': loss.stream, 'count': loss.count, 'message': loss.text()} for loss in losses]


def _finite(value: Any) -> Any:  # noqa: ANN401 - any value of JSON
    """Return the value with null for NaN and infinite numbers, which JSON does not support."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _json_value(value: object) -> str:
    if isinstance(value, Path):
        return str(value)
    raise TypeError(type(value))


# Refusals for Staging: which existing outputs --overwrite may replace.

_NO_BAG = 'it is no bag, so --overwrite does not touch it; choose another name'
_IN_FILE = [each for each in CONTAINERS.values() if each.in_file]
_MAGICS = tuple(each.magic for each in _IN_FILE)
_DIRECTORY_FILES = (
    *(suffix for each in CONTAINERS.values() for suffix in (each.suffix, *each.side_suffixes)),
    '.zstd',
)
_WITHOUT_METADATA = tuple(each.suffix for each in CONTAINERS.values() if not each.in_rosbag2)


def keep_all_but_bags(path: Path) -> str | None:
    """Return why --overwrite does not replace a path; None for a bag."""
    return None if _looks_like_bag(path) else _NO_BAG


def keep_all(path: Path) -> str | None:  # noqa: ARG001 - one form for all
    """Return why a path is not replaced, whatever it is."""
    return 'choose another name, or pass --overwrite'


def keep_all_but_files(what: str, beginnings: Collection[bytes]) -> Callable[[Path], str | None]:
    """Return a refusal for Staging that lets only files of one kind be replaced.

    Args:
        what: The kind as messages name it, such as picture.
        beginnings: First bytes of such files; empty files may be replaced as well.
    """

    def refusal(path: Path) -> str | None:
        if path.is_file():
            with path.open('rb') as file:
                head = file.read(max(map(len, beginnings))).lower()
            if not head or any(head.startswith(beginning.lower()) for beginning in beginnings):
                return None
        return f'it is no {what}, so --overwrite does not touch it; choose another name'

    return refusal


KEEP_ALL_BUT_PAGES = keep_all_but_files('HTML page', [b'<!doctype html'])
KEEP_ALL_BUT_JSON = keep_all_but_files('JSON file', [b'{'])


def _looks_like_bag(path: Path) -> bool:
    if path.is_file():
        with path.open('rb') as file:
            head = file.read(max(map(len, _MAGICS)))
        known = path.suffix in {each.suffix for each in _IN_FILE}
        return known and (not head or head.startswith(_MAGICS))
    if not path.is_dir():
        return False
    names = set()
    for entry in path.iterdir():
        if entry.is_symlink() or not entry.is_file():
            return False
        names.add(entry.name)
    files = {name for name in names if name.endswith(_DIRECTORY_FILES)}
    if names - files - {'metadata.yaml'}:
        return False
    # A split ROS 1 bag has no metadata.yaml; an empty directory may be replaced as well.
    return 'metadata.yaml' in names or all(name.endswith(_WITHOUT_METADATA) for name in names)


# Outputs that exist either completely or not at all, local (local_staging) or in a store.

__all__ = [
    'Staging',
    'lies_inside',
    'lock_exclusively',
    'may_exist',
    'open_staging',
    'output_error',
    'refuse_inside',
    'refuse_link',
    'reported',
    'staged',
    'staged_file',
    'sweep',
    'taking_over',
]


def open_staging(
    path: Path, refusal: Callable[[Path], str | None], *, fsync: bool = True
) -> Staging | UploadStaging:
    """Open the temporary place of an output, local or in a store.

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
        refusal: As in Staging; None keeps all.
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
        staging.tell_remains(error)
        raise


def _is_empty(path: Path) -> bool:
    # A store has no empty folders.
    return not is_remote(path) and path.is_dir() and not any(path.iterdir())


def _keep_content(path: Path) -> str | None:  # noqa: ARG001 - one form for all
    return 'choose another name, an empty folder, or pass --overwrite'


def lies_inside(out: Path, source: Path) -> bool:
    """Whether an output is its source or lies inside it."""
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
