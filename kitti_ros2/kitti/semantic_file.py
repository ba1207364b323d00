# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""SemanticKITTI's point labels, labels/NNNNNN.label: one uint32 a point, in the scan's order.

The low 16 bits are the class, the high 16 the instance, 0 for none. Source: README of
semantic-kitti-api.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt


def parse_point_labels(data: bytes, points: int, path: Path | str) -> npt.NDArray[np.uint32]:
    """Parse the (N,) uint32 labels of a scan of N points.

    Raises:
        BadFileError: The file has another number of labels.
    """
    if len(data) != points * 4:
        raise BadFileError(path, f'{len(data)} bytes', f'{points * 4}, four a point of its scan')
    return np.frombuffer(data, dtype='<u4')


def format_point_labels(labels: npt.NDArray[np.uint32]) -> bytes:
    """Format a .label file; the inverse of parse_point_labels."""
    return np.ascontiguousarray(labels, dtype='<u4').tobytes()
