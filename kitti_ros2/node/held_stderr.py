# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the libraries of ROS write to stderr while they start, held back: an error is one line."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TOO_MANY = 'too many open files; raise the limit (ulimit -n)'


def lacks_files(error: str) -> bool:
    """Whether the text of an error says that no more files can be opened."""
    return TOO_MANY in error or os.strerror(errno.EMFILE) in error


@contextmanager
def held_stderr() -> Iterator[Callable[[], list[str]]]:
    """Hold back what libraries write to stderr; write it at the end unless it was read."""
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        held = os.dup(2)
        read = False

        def written() -> list[str]:
            nonlocal read
            read = True
            file.seek(0)
            return file.read().decode(errors='replace').splitlines()

        os.dup2(file.fileno(), 2)
        try:
            yield written
        finally:
            os.dup2(held, 2)
            os.close(held)
            if not read:
                sys.stderr.writelines(f'{line}\n' for line in written())
