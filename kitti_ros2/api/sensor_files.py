# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of files with an array each: scans, labels of points, images."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..drawing.pixels import colour_pixels
from ..files.image_files import decode_image, parse_image
from ..files.png.encode import encode_png
from ..kitti import names
from ..kitti.scan_check import HEAD_BYTES, find_mismatch, mismatch_error
from ..kitti.scan_file import (
    format_scan,
    format_scan_text,
    parse_points,
    parse_scan,
    parse_scan_text,
)
from ..kitti.semantic_file import format_point_labels, parse_point_labels
from ..kitti.store import STORE
from ..model.errors import BadFileError, UsageError
from ..model.scan_columns import ScanColumns
from .paths import file_at

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from ..model.samples import Float32Array
    from .paths import AnyPath

_POINT_COLUMNS = 4
_CHECKED: set[Path] = set()
"""Folders whose scans have the columns of KITTI's."""


def read_scan(path: AnyPath, *, columns: str | None = None) -> Float32Array:
    """Read velodyne_points/data/*.bin or velodyne/*.bin (or .txt of a raw extract).

    Args:
        path: Ends in .bin or .txt.
        columns: Those of a .bin file that is not KITTI's, such as 'x y z intensity - ring': - skips
            one, and :f8 behind a name is float64.

    Returns:
        (N, 4) float32, writable: x y z in metres in velo_link (x forward, y left, z up), and
        reflectance 0..1. Other columns that are named follow: (N, 4 + K).

    Raises:
        KittiRos2Error: The file is missing, empty, or truncated inside a point; or it has other
            columns, by its size and values.
    """
    with file_at(path) as file:
        if file.suffix == names.TXT:
            return parse_scan_text(STORE.read(file), file)
        data = STORE.read_array(file)
        if columns is not None:
            scan = parse_points(data, file, ScanColumns.parse(columns))
            return np.column_stack([scan.points, *scan.extra.values()]).astype(np.float32)
        _check_first(file, data)
        return parse_scan(data, file)


def _check_first(file: Path, data: npt.NDArray[np.uint8]) -> None:
    """Check the columns of the first scan that is read of a folder."""
    if file.parent not in _CHECKED:
        found = find_mismatch([(data[:HEAD_BYTES].tobytes(), len(data))])
        if found is not None:
            raise mismatch_error(file, found)
        _CHECKED.add(file.parent)


def write_scan(path: AnyPath, points: npt.ArrayLike) -> None:
    """Write a scan; the inverse of read_scan. A .txt file has three decimals, as raw extracts.

    Args:
        path: Ends in .bin or .txt.
        points: (N, 4), as of read_scan.

    Raises:
        KittiRos2Error: Another shape, or the file cannot be written.
    """
    values = np.asarray(points, np.float32)
    if values.ndim != 2 or values.shape[1] != _POINT_COLUMNS:
        raise UsageError(f'points of shape {values.shape}; expected (N, 4): x y z reflectance')
    with file_at(path) as file:
        text = file.suffix == names.TXT
        STORE.write(file, format_scan_text(values) if text else format_scan(values))


def read_point_labels(path: AnyPath) -> npt.NDArray[np.uint32]:
    """Read SemanticKITTI's labels/*.label: (N,) uint32, low 16 bits class, high 16 instance.

    Raises:
        KittiRos2Error: The file is missing or truncated.
    """
    with file_at(path) as file:
        data = STORE.read(file)
        return np.array(parse_point_labels(data, (len(data) + 3) // 4, file))


def write_point_labels(path: AnyPath, labels: npt.NDArray[np.uint32]) -> None:
    """Write the labels of points; the inverse of read_point_labels."""
    with file_at(path) as file:
        STORE.write(file, format_point_labels(labels))


def read_image(path: AnyPath) -> npt.NDArray[np.uint8]:
    """Read a PNG or JPEG: (H, W, 3) uint8 RGB; of a grey one all three channels are equal.

    Raises:
        KittiRos2Error: The file is missing or damaged.
    """
    with file_at(path) as file:
        image = parse_image(STORE.read(file), file)
        try:
            return np.ascontiguousarray(colour_pixels(decode_image(image))[..., ::-1])
        except ValueError as error:
            raise BadFileError(file, str(error), 'a whole image') from None


def write_image(path: AnyPath, pixels: npt.NDArray[np.uint8]) -> None:
    """Write a PNG, without loss: (H, W) grey or (H, W, 3) RGB, uint8.

    Raises:
        KittiRos2Error: Another shape or dtype, or the file cannot be written.
    """
    if pixels.dtype != np.uint8 or pixels.ndim not in {2, 3} or pixels.shape[2:] not in {(), (3,)}:
        found = f'pixels of shape {pixels.shape}, {pixels.dtype}'
        raise UsageError(f'{found}; expected (H, W) or (H, W, 3) uint8')
    bgr = pixels if pixels.ndim == 2 else pixels[..., ::-1]
    with file_at(path) as file:
        STORE.write(file, encode_png(np.ascontiguousarray(bgr)))
