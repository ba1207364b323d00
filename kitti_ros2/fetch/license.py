# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The terms of KITTI's data: shown until they are accepted, which is remembered."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from ..model.errors import UsageError

TERMS = (
    "KITTI's data is licensed under CC BY-NC-SA 3.0: name the authors, no commercial use, share"
    ' what you make of it alike. The authors ask you to register at'
    ' https://www.cvlibs.net/datasets/kitti/ before you download. SemanticKITTI has terms of its'
    ' own, see http://www.semantic-kitti.org'
)


def require_license(*, accepted: bool) -> None:
    """Remember that the terms are accepted.

    Args:
        accepted: Whether the user accepts them now.

    Raises:
        UsageError: The terms were never accepted.
    """
    path = _path()
    if accepted:
        with suppress(OSError):  # a home that cannot be written: it is asked for again
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f'{TERMS}\nAccepted with --accept-license.\n', encoding='utf-8')
    elif not path.is_file():
        raise UsageError(f'{TERMS}. To accept these terms, once, pass --accept-license')


def _path() -> Path:
    """Return the file that remembers it (XDG Base Directory Specification)."""
    given = os.environ.get('XDG_CONFIG_HOME', '')
    folder = Path(given) if given.startswith('/') else Path('~/.config').expanduser()
    return folder / 'kitti_ros2' / 'kitti_terms_accepted.txt'
