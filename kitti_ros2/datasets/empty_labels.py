# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of label files whose 3D box contains no point.

All other lines keep their bytes, and so do lines without a 3D box (DontCare, 2D detections) and
invalid ones.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from ..kitti import names
from ..model.boxes import count_points, cuboid_of, has_cuboid, is_absurd
from ..model.labels import rect_from_velo

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from ..model.samples import Calibration, Float32Array, FrameLabels


def empty_rows(labels: FrameLabels, calibration: Calibration, points: Float32Array) -> list[int]:
    """Return the rows of a frame's labels whose 3D box contains none of (N, 4) points.

    Raises:
        ValueError: The calibration has no transform from velo_link.
    """
    solid = [
        (row, box)
        for row, box in enumerate(labels.boxes)
        if box is not None and has_cuboid(box) and not is_absurd(box)
    ]
    if not solid:
        return []
    rect_t_velo = rect_from_velo(calibration)
    counts = count_points([cuboid_of(box, '', rect_t_velo) for _, box in solid], points)
    return [row for (row, _), count in zip(solid, counts, strict=True) if not count]


def without_rows(text: str, rows: Collection[int]) -> str:
    """Return a label file without some of its lines, counted from 0."""
    lines = text.splitlines(keepends=True)
    return ''.join(line for row, line in enumerate(lines) if row not in rows)


def without_tracks(text: str, rows: Mapping[int, Collection[int]]) -> str:
    """Return a label file of tracking without some lines of frames.

    Args:
        text: The whole file; the first column is the frame.
        rows: By frame the lines to leave out, counted from 0 among the lines of that frame.
    """
    seen: Counter[int] = Counter()
    kept = []
    for line in text.splitlines(keepends=True):
        word = line.split(maxsplit=1)[0] if line.strip() else ''
        frame = int(word) if word.isdecimal() and len(word) <= names.FRAME_DIGITS else -1
        if seen[frame] not in rows.get(frame, ()):
            kept.append(line)
        seen[frame] += 1
    return ''.join(kept)
