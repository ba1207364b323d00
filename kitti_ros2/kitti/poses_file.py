# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry ground truth, poses/NN.txt: line n is the pose of frame n.

Twelve numbers a line, the row-major (3, 4) matrix first_cam0_T_cam0 of the rectified camera 0 in
its own first frame. Source: readme.txt of the odometry devkit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .text_file import Lines, parse_lines, parse_numbers

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from ..model.geometry import Float64Array


def parse_poses(text: str, path: Path | str) -> Lines[Float64Array]:
    """Parse a poses file: a (3, 4) float64 matrix a line."""
    return parse_lines(text, path, 'twelve numbers, a 3x4 pose matrix', _parse_pose)


def format_poses(matrices: Iterable[Float64Array]) -> str:
    """Format a poses file, six decimals of mantissa as the benchmark's own."""
    return ''.join(
        ' '.join(f'{value:.6e}' for value in matrix[:3].ravel()) + '\n' for matrix in matrices
    )


def _parse_pose(line: str) -> Float64Array:
    return np.array(parse_numbers(line.split(), 12)).reshape(3, 4)
