# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files of SHA-256 checksums, one for each line: 64 hexadecimal digits, then the file's name."""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..model.errors import BadFileError, MissingPathError, naming

if TYPE_CHECKING:
    from pathlib import Path

_LINE = re.compile(r'([0-9A-Fa-f]{64})\s+\*?(\S.*)')


def read_checksums(path: Path) -> dict[str, str]:
    """Read the checksums in a file, by the last part of each name.

    Raises:
        MissingPathError: There is no such file.
        BadFileError: A line is no checksum.
    """
    if not path.is_file():
        raise MissingPathError(path)
    found = {}
    with naming(path):
        text = path.read_text('utf-8', errors='replace')
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith('#'):
            continue
        match = _LINE.fullmatch(line.strip())
        if match is None:
            raise BadFileError(path, 'no checksum', '64 hexadecimal digits and a name', line=number)
        found[PurePosixPath(match[2]).name] = match[1].lower()
    return found
