# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writing the files of a restored data set: none overwrites another."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING

from ..kitti.store import STORE
from ..model.errors import UsageError
from ..model.losses import Loss
from .source_texts import TEXT_FILE

if TYPE_CHECKING:
    from pathlib import Path

    from .recorded_layout import Blueprint

_OF_NAME = (errno.EEXIST, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.EINVAL)
"""Errors that a file's own name causes, not the disk."""


def write_texts(root: Path, blueprint: Blueprint, bag: Path) -> tuple[Loss, ...]:
    """Write the text files; recordings of a data set may share some."""
    losses = []
    for path, text in (*blueprint.texts.items(), *blueprint.calibrations.items()):
        target = root / path
        if target.is_file() and STORE.read_text(target) != text:
            raise UsageError(f'{bag}: its {path} differs from that of another bag')
        error = '' if target.is_file() else write_new(target, text.encode())
        if error:
            losses.append(Loss(TEXT_FILE, 1, error))
    return tuple(losses)


def write_new(target: Path, content: bytes | memoryview) -> str:
    """Write a new file; returns the reason if its name is invalid or exists.

    Raises:
        OSError: It cannot be written.
    """
    try:
        STORE.write(target, content, new=True)
    except OSError as error:
        if error.errno not in _OF_NAME:
            raise
        return f'{target.name}: {error.strerror}; the file of that name is kept'
    return ''
