# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where pictures are written: beside their place, and moved there when they are whole."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..bags.staging import Staging, reported
from ..errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..drawing.pixels import Pixels

PICTURES = ('.png', '.jpg', '.jpeg', '.webp')
_JPEG_QUALITY = 92


@contextmanager
def staged_file(out: Path, *, overwrite: bool) -> Iterator[Path]:
    """A path to write a file at, which is at out when all went well.

    Raises:
        OutputExistsError: out is there, and may not be replaced.
        OutputError: The disk refuses.
    """
    staging = Staging(out, _refuse_all_but_files if overwrite else _refuse)
    try:
        with reported(out):
            staging.content.mkdir()
            # Libraries that write pictures and films look at the ending.
            file = staging.content / out.name
            yield file
            whole = staging.content.with_name('whole' + out.suffix)
            file.rename(whole)
            staging.content.rmdir()
            whole.rename(staging.content)
        staging.publish()
    finally:
        staging.discard()


@contextmanager
def staged_folder(out: Path) -> Iterator[Path]:
    """A folder to fill, which is at out when all went well; out may be there and empty.

    Raises:
        OutputExistsError: out holds something.
        OutputError: The disk refuses.
    """
    staging = Staging(out, _refuse_content)
    try:
        with reported(out):
            staging.content.mkdir()
            yield staging.content
        staging.publish()
    finally:
        staging.discard()


def write_picture(path: Path, picture: Pixels) -> None:
    """Write (H, W, 3) uint8 BGR, as the ending says.

    Raises:
        UsageError: The ending is that of no picture.
        OSError: It cannot be written.
    """
    path.write_bytes(encode_picture(picture, path.suffix))


def encode_picture(picture: Pixels, suffix: str) -> bytes:
    """The file of a picture by the ending of its name, such as .png.

    Raises:
        UsageError: The ending is that of no picture.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that a command which draws nothing does not need

    from ..messages.png_writer import encode_png  # noqa: PLC0415 - as above

    ending = suffix.lower()
    if ending not in PICTURES:
        raise UsageError(f'a picture ends in {", ".join(PICTURES)}, not in {suffix or "nothing"}')
    if ending == '.png':
        return encode_png(picture)
    settings = [] if ending == '.webp' else [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    done, data = cv2.imencode(ending, picture, settings)
    if not done:
        raise UsageError(f'this OpenCV writes no {suffix}; choose .png')
    return data.tobytes()


def _refuse(path: Path) -> str:  # noqa: ARG001 - one form for all
    return 'choose another name, or pass --overwrite'


def _refuse_all_but_files(path: Path) -> str | None:
    if path.is_file():
        return None
    return 'it is no file, so --overwrite does not touch it; choose another name'


def _refuse_content(path: Path) -> str | None:
    if path.is_dir() and not any(path.iterdir()):
        return None
    return 'it holds something; choose another name'
