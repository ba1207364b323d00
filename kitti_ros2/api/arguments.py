# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments of the library: options as keywords, and open sources."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING, Any

from ..model.errors import MissingPathError
from ..options.declare import make_options, options_of, parse_values
from ..options.read import ReadOptions
from ..pictures.recording_frames import open_frames

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from ..model.errors import Loss
    from ..options.declare import Option
    from ..pictures.recording_frames import RecordingFrames


# Options as keywords; options/keywords.py has their types.


def keyword_of(option: Option) -> str:
    """Return the keyword of an option; the command line may have other names."""
    return option.keyword or option.name


def by_name(keywords: Mapping[str, object], options: Sequence[Option]) -> dict[str, object]:
    """Return the values by option name; unknown keywords are passed on, and refused later."""
    names = {keyword_of(option): option.name for option in options}
    return {names.get(keyword, keyword): value for keyword, value in keywords.items()}


# The open files of a recording, shared by its frames.

_OPTIONS = options_of(ReadOptions)


class OpenSource:
    """The open files of a recording, opened again after a fork or unpickling."""

    def __init__(self, path: Path, options: Mapping[str, Any]) -> None:
        self.path = path
        self.options = dict(options)
        self._process = 0
        self._frames: RecordingFrames | None = None

    @property
    def frames(self) -> RecordingFrames:
        """The frames; processes do not share file positions of a bag."""
        if self._frames is None or self._process != os.getpid():
            read = make_options(ReadOptions, parse_values(self.options, _OPTIONS))
            self._frames = open_frames(self.path, read)
            self._process = os.getpid()
        return self._frames

    def close(self) -> None:
        """Close the files."""
        if self._frames is not None and self._process == os.getpid():
            self._frames.close()
        self._frames = None

    def __getstate__(self) -> dict[str, Any]:
        return {'path': self.path, 'options': self.options, '_process': 0, '_frames': None}


class KittiRos2Warning(UserWarning):
    """Missing or damaged data was skipped; the text contains the path and line."""


def require(path: Path) -> Path:
    """Return an existing path.

    Raises:
        MissingPathError: It does not.
    """
    if not path.exists():
        raise MissingPathError(path)
    return path


def warn(text: str) -> None:
    """Warn of skipped data, at the line that called the caller."""
    warnings.warn(text, KittiRos2Warning, stacklevel=3)


def warn_of(losses: Iterable[Loss]) -> None:
    """Warn of each loss, at the line that called the caller."""
    for loss in losses:
        warnings.warn(loss.text(), KittiRos2Warning, stacklevel=3)
