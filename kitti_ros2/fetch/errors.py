# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of archives and downloads."""

from __future__ import annotations

import errno
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..model.errors import KittiRos2Error

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class BadArchiveError(KittiRos2Error):
    """An archive that is refused as a whole: damaged, hostile, or without KITTI's folders."""

    def __init__(self, path: Path, found: str, remedy: str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: {found}; nothing of it was extracted ({remedy})')


class BadMemberError(KittiRos2Error):
    """A file in an archive that cannot be read; the others can."""


class StoppedError(KittiRos2Error):
    """An extraction or a download that stopped, such as on a full disk; it can be continued."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: {reason}; what is complete is kept, run it again to go on')


@contextmanager
def stopping(path: Path) -> Iterator[None]:
    """Convert errors of the disk to StoppedError.

    Args:
        path: What is written.
    """
    try:
        yield
    except OSError as error:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT}
        reason = 'the disk is full' if full else f'cannot be written ({error.strerror or error})'
        raise StoppedError(path, reason) from error
