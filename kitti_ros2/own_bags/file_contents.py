# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The contents of files with one sample, as KITTI has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti import names
from ..kitti.scan_file import format_points, format_scan, format_scan_text
from ..kitti.semantic_file import format_point_labels
from ..model.samples import Image
from .source_texts import write_new

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from ..model.samples import Scan
    from ..model.scan_columns import ScanColumns


def format_sample(
    decode: Callable[[], Scan | Image],
    path: Path,
    columns: ScanColumns | None = None,
) -> tuple[bytes | memoryview, str]:
    """Format a sample's file, and describe its difference from KITTI's; '' if there is none.

    The labels of a scan's points are written to a file of their own.

    Args:
        decode: Returns the sample.
        path: Of the file.
        columns: Of scans; None are KITTI's.

    Raises:
        ValueError: The message cannot be decoded, or the file of labels cannot be written.
        BadFileError: The PNG in the message is damaged.
    """
    sample = decode()
    if isinstance(sample, Image):
        return sample.data, ''
    if sample.labels is not None:
        labels = path.parents[1] / names.POINT_LABELS / f'{path.stem}{names.LABEL}'
        error = write_new(labels, format_point_labels(sample.labels))
        if error:
            raise ValueError(error)
    is_text = path.suffix.lower() == names.TXT
    if is_text:
        return format_scan_text(sample.points), sample.difference
    if columns is None:
        return format_scan(sample.points), sample.difference
    return format_points(sample, columns), sample.difference
