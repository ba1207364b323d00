# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The size of a camera's images, from the calibration or from an image."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.image_files import parse_image
from ..files.picture_headers import JPEG_SIGNATURE, jpeg_frame
from ..files.png.header import TRAILING_BYTES
from ..model.errors import BadFileError, MissingDataError, describe_error
from ..model.streams import Stream
from .names import JPEGS
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.samples import Image
    from .recording import KittiRecording


_JPEG_BYTES = 1 << 16
"""The frame header of a JPEG comes after its tables and a thumbnail."""


def read_image_header(path: Path) -> Image:
    """Read an image from the two ends of its file; its data are incomplete.

    Raises:
        BadFileError: It is no image, or cut.
        OSError: It cannot be read.
    """
    length = _JPEG_BYTES if path.suffix.lower() in JPEGS else TRAILING_BYTES
    ends, size = STORE.read_ends(path, length)
    if ends.startswith(JPEG_SIGNATURE) and jpeg_frame(ends) is None:
        return parse_image(STORE.read(path), path)
    return parse_image(ends, path, size)


def image_size(
    recording: KittiRecording, camera: int, number: int, otherwise: str = ''
) -> tuple[int, int]:
    """Return (width, height) of the images of a camera at a frame.

    They are those of the frame's own image where sizes differ (object), else of the calibration,
    or else of the first valid image.

    Args:
        recording: The recording.
        camera: KITTI index.
        number: Of the frame.
        otherwise: What else the user can do, the end of the error.

    Raises:
        MissingDataError: The size is not known.
    """
    stream = Stream(f'image_{camera}')
    if recording.layout.traits.calibration_per_frame:
        return _read_size(recording.path(stream, number), otherwise)
    seen_by = recording.calibration(number).cameras.get(camera)
    if seen_by is not None and seen_by.size is not None:
        return seen_by.size
    index = recording.streams.get(stream)
    for each in () if index is None else index.numbers.tolist():
        try:
            return _read_size(recording.path(stream, each), otherwise)
        except MissingDataError:
            continue
    raise MissingDataError(
        f'{recording.root}: {recording.name} has no image of camera {camera}, so its size is'
        f' unknown{otherwise and f"; give {otherwise}"}'
    )


def _read_size(path: Path, otherwise: str) -> tuple[int, int]:
    """Read the size of an image from its two ends.

    Raises:
        MissingDataError: There is no valid image.
    """
    try:
        image = read_image_header(path)
    except FileNotFoundError:
        raise MissingDataError(
            f'{path}: no such file; the size of the image is needed'
            f'{otherwise and f", or {otherwise}"}'
        ) from None
    except (BadFileError, OSError) as error:
        raise MissingDataError(describe_error(error)) from None
    return image.width, image.height
