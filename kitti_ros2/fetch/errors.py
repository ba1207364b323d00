# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of archives and downloads."""

from __future__ import annotations

import errno
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..model.errors import KittiRos2Error, describe_error

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class BadArchiveError(KittiRos2Error):
    """An archive that is refused as a whole: damaged, hostile, or without KITTI's folders."""

    def __init__(self, path: Path, found: str, remedy: str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: {found}; nothing of it was extracted ({remedy})')


class BadMemberError(KittiRos2Error):
    """A file in an archive that cannot be read; the others can.

    Args:
        reason: An error of the disk, or of what unpacks the file.
    """

    def __init__(self, reason: Exception | str) -> None:
        text = str(reason)
        if isinstance(reason, OSError) and reason.errno is not None:
            text = f'cannot be read: {describe_error(reason)}'
        elif isinstance(reason, Exception):
            text = f'damaged: {reason}'
        super().__init__(text)


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
