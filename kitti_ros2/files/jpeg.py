# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""JPEG files -> pixels; corrupt data is an error.

libjpeg decodes corrupt data to wrong pixels, and only prints a warning to the process's standard
error: OpenCV does not report it. So that output is read while a file is decoded. Source of the
warnings: jerror.h and jerror.c of libjpeg, where a file's first warning is printed as one line.
"""

from __future__ import annotations

import os
import re
import tempfile
from contextlib import ExitStack, contextmanager
from threading import Lock
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

_STDERR = 2
_LOCK = Lock()  # one standard error for all threads
_WARNING = re.compile(
    rb'(?:Corrupt JPEG data: |Premature end of JPEG file|Invalid SOS parameters|Inconsistent progr'
    rb'ession|Invalid crop request|Unknown Adobe color|Warning: unknown JFIF|Application transfer'
    rb'red too many).*\n'
)
_PADDING = re.compile(r'Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd9')
_MOST_PADDING = 16
"""Bytes before the end of the image, which the encoders of some cameras append."""

_HARMLESS = ('Warning: ', 'Unknown Adobe color')


def decode_jpeg(file: npt.NDArray[Any], flags: int) -> npt.NDArray[Any] | None:
    """Decode a JPEG file.

    Args:
        file: Its bytes, (N,) uint8.
        flags: Of cv2.imdecode.

    Returns:
        The pixels as cv2.imdecode returns them; None where it cannot decode any.

    Raises:
        ValueError: The data is corrupt.
        cv2.error: More pixels than OpenCV allows.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that most commands do not need

    warnings: list[str] = []
    with _warnings_of_libjpeg(warnings):
        pixels = cv2.imdecode(file, flags)
    for warning in warnings:
        if not _is_harmless(warning):
            raise ValueError(f'the JPEG is corrupt: {warning.removeprefix("Corrupt JPEG data: ")}')
    return pixels


def _is_harmless(warning: str) -> bool:
    padding = _PADDING.match(warning)
    if padding is not None:
        return int(padding[1]) <= _MOST_PADDING
    return warning.startswith(_HARMLESS)


@contextmanager
def _warnings_of_libjpeg(found: list[str]) -> Iterator[None]:
    """Collect the warnings that libjpeg prints; all other output goes where it should.

    Where there is no standard error or no room for a file, they are not known.
    """
    with _LOCK, ExitStack() as opened:
        try:
            caught = opened.enter_context(tempfile.TemporaryFile(buffering=0))
            own = os.dup(_STDERR)
        except OSError:
            yield
            return
        opened.callback(os.close, own)
        os.dup2(caught.fileno(), _STDERR)
        try:
            yield
        finally:
            os.dup2(own, _STDERR)
            caught.seek(0)
            printed = caught.read()
            others = _WARNING.sub(b'', printed)
            if others:
                os.write(own, others)
        found += [each.decode('ascii', 'replace').strip() for each in _WARNING.findall(printed)]
