# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Paths of the files that are read and written one by one.

A file that cannot be used raises a KittiRos2Error whose `path` and `line` say where; one that is
missing is a FileNotFoundError as well. Writers create folders, and replace a file that exists.
"""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias

from ..files.remote import as_path
from ..model.errors import MissingPathError, UnreadableFileError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

AnyPath: TypeAlias = str | os.PathLike[str]


@contextmanager
def file_at(path: AnyPath) -> Iterator[Path]:
    """Yield the path; errors of the operating system are raised as KittiRos2Error."""
    try:
        yield as_path(path)
    except MissingPathError:
        raise
    except FileNotFoundError as error:
        raise MissingPathError(error.filename or str(path)) from None
    except OSError as error:
        raise UnreadableFileError(error.filename or str(path), error) from None
