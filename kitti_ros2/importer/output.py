# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where a data set is built: beside its folder, and moved there when it is whole."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..bags.staging import Staging, reported
from ..errors import OutputExistsError, UsageError
from ..kitti import names
from ..kitti.store import STORE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def staged(out: Path, *, append: bool = False) -> Iterator[Path]:
    """A folder to build a data set in, whose content is in out when all went well.

    Args:
        out: The data set's folder.
        append: Whether out may hold an object set, which is continued.

    Raises:
        OutputExistsError: out holds something.
        OutputError: The disk refuses.
    """
    staging = Staging(out, _refuse_nothing if append else _refuse_content)
    try:
        with reported(out):
            staging.content.mkdir()
            yield staging.content
            if append and out.is_dir():
                _merge(staging.content, out)
        if not append or not out.is_dir():
            staging.publish()
    finally:
        staging.discard()


def next_number(out: Path, split: str) -> int:
    """The number after the last frame of an object set; 0 where there is none.

    Raises:
        UsageError: The folder holds something else.
    """
    if not out.is_dir():
        return 0  # a file there is refused when it is to be written
    folders = [out / split / name for name in STORE.names(out / split)]
    found = [
        int(name[: names.FRAME_DIGITS])
        for folder in folders
        for name in STORE.names(folder)
        if name[: names.FRAME_DIGITS].isdecimal() and len(name) == names.FRAME_DIGITS + 4
    ]
    if not found and any(out.iterdir()):
        raise UsageError(f'{out}: holds no object set to append to; expected {split}/ with frames')
    return max(found, default=-1) + 1


def _refuse_content(path: Path) -> str | None:
    if path.is_dir() and not any(path.iterdir()):
        return None
    return 'choose another name, or an empty folder'


def _refuse_nothing(path: Path) -> str | None:
    return None if path.is_dir() else 'it is no folder; choose another name'


def _merge(stage: Path, out: Path) -> None:
    """Move the new frames, then name them in ImageSets: what these name is always there."""
    files = sorted(path.relative_to(stage) for path in stage.rglob('*') if path.is_file())
    lists = [path for path in files if path.parts[0] == names.IMAGE_SETS]
    for path in files:
        target = out / path
        if path in lists:
            continue
        if target.exists():
            raise OutputExistsError(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        (stage / path).rename(target)
    for path in lists:
        target = out / path
        earlier = STORE.read_text(target) if target.exists() else ''
        if earlier and not earlier.endswith('\n'):
            earlier += '\n'
        STORE.write_text(stage / path, earlier + STORE.read_text(stage / path))
        target.parent.mkdir(parents=True, exist_ok=True)
        (stage / path).rename(target)
