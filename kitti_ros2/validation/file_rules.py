# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about one file: it can be opened, has a possible size, and can be parsed."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..files.remote import is_remote
from ..kitti import names
from ..kitti.scan_file import POINT_BYTES
from ..kitti.store import MOST_BYTES
from ..model.errors import BadFileError
from ..model.streams import IMAGE_STREAMS, Stream
from ..model.text import format_bytes
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_MOST_TEXT = 16 << 20  # the largest text file of KITTI has 1 MB
_COPY = 'copy or download the file again'


@dataclass(frozen=True)
class DataFile:
    """A file of a stream.

    Attributes:
        stream: Its stream.
        path: The file.
        size: In bytes; 0 if it cannot be opened.
        error: Why it cannot be opened or parsed.
        regular: Whether it is a regular file, not a pipe or a folder.
        point_bytes: Of a scan.
    """

    stream: Stream
    path: Path
    size: int
    error: Exception | None = None
    regular: bool = True
    point_bytes: int = POINT_BYTES

    @classmethod
    def look(cls, stream: Stream, path: Path, point_bytes: int = POINT_BYTES) -> DataFile:
        """Return what the file system tells of a file."""
        try:
            status = path.stat() if is_remote(path) else os.stat(path)  # noqa: PTH116 - a tenth of the time of Path.stat
        except OSError as error:
            return cls(stream, path, 0, error)
        regular = stat.S_ISREG(status.st_mode)
        return cls(stream, path, status.st_size, regular=regular, point_bytes=point_bytes)

    @property
    def most_bytes(self) -> int:
        """The largest size that is read."""
        return _MOST_TEXT if self.path.suffix == names.TXT else MOST_BYTES

    @property
    def is_worth_reading(self) -> bool:
        """Whether no rule about sizes is broken."""
        return not (
            self.error
            or not self.regular
            or self.size > self.most_bytes
            or _is_empty(self)
            or _is_cut(self)
        )


def _is_empty(file: DataFile) -> bool:
    # A frame without objects may have an empty label file.
    return file.regular and not file.error and not file.size and file.stream is not Stream.LABELS


def _is_cut(file: DataFile) -> bool:
    return file.path.suffix.lower() == names.BIN and file.size % file.point_bytes != 0


def _find_unreadable(file: DataFile) -> Iterator[Breach]:
    if isinstance(file.error, OSError):
        yield breach_of(file.error, file.path)
    elif not file.regular:
        yield Breach('is a pipe, a device or a folder', file.path)


def _find_empty(file: DataFile) -> Iterator[Breach]:
    if _is_empty(file):
        yield Breach('the file is empty', file.path)


def _find_huge(file: DataFile) -> Iterator[Breach]:
    if file.regular and file.size > file.most_bytes:
        limit = format_bytes(file.most_bytes)
        text = f'{format_bytes(file.size)}; files of more than {limit} are not read'
        yield Breach(text, file.path)


def _find_cut(file: DataFile) -> Iterator[Breach]:
    if _is_cut(file):
        text = f'{file.size} bytes, which is no multiple of {file.point_bytes}'
        yield Breach(text, file.path)


def _failed(*streams: Stream) -> Callable[[DataFile], Iterator[Breach]]:
    """Return the function that finds files of some streams that cannot be parsed."""

    def find(file: DataFile) -> Iterator[Breach]:
        if file.stream in streams and isinstance(file.error, BadFileError):
            yield breach_of(file.error, file.path)

    return find


_FILE = RuleScope.FILE
_ERROR = RuleSeverity.ERROR

FILE_RULES: tuple[Rule[DataFile], ...] = (
    Rule(
        'file-readable',
        _ERROR,
        _FILE,
        'Files can be opened, and are regular files',
        'check permissions, links and the disk',
        _find_unreadable,
    ),
    Rule('file-empty', _ERROR, _FILE, 'Files are not empty', _COPY, _find_empty),
    Rule(
        'file-huge',
        _ERROR,
        _FILE,
        'Binary files have at most 268 MB, text files 17 MB',
        f'{_COPY}; check which program wrote it',
        _find_huge,
    ),
    Rule(
        'scan-size',
        _ERROR,
        _FILE,
        'Scans have 16 bytes a point, or those of --columns',
        _COPY,
        _find_cut,
    ),
    Rule('scan-file', _ERROR, _FILE, 'Scans can be parsed', _COPY, _failed(Stream.SCAN)),
    Rule(
        'image-file',
        _ERROR,
        _FILE,
        'Images are whole PNGs, and the checksum of each chunk is right',
        _COPY,
        _failed(*IMAGE_STREAMS),
    ),
    Rule(
        'oxts-packet',
        _ERROR,
        _FILE,
        'GPS/IMU packets have 30 finite numbers, on earth',
        _COPY,
        _failed(Stream.OXTS),
    ),
    Rule(
        'text-file',
        _ERROR,
        _FILE,
        'Text files are UTF-8; tracklets are whole XML',
        _COPY,
        _failed(Stream.LABELS, Stream.CALIBRATION, Stream.RECORDING),
    ),
)
