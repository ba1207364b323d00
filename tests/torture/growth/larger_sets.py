# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A KITTI data set in which one kind of file has N times its last line, or its bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

if TYPE_CHECKING:
    from pathlib import Path

    from kitti_ros2.model.streams import Layout

_TEXTS = frozenset({'.txt'})
_REPEATED = _TEXTS | {'.bin', '.label'}


def write_small(layout: Layout, folder: Path, frames: int = 3) -> Path:
    """Write a set of few and small frames; the folder to give to commands."""
    options = SyntheticOptions(frames=frames, image_size=(64, 24), lidar_columns=20)
    return write_synthetic(folder, layout, options)


def kinds_of(folder: Path) -> dict[str, list[Path]]:
    """Return the files that hold something to repeat, by their name, or folder if numbered."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.rglob('*')):
        if path.suffix in _REPEATED and path.stat().st_size:
            numbered = path.stem.isdigit()
            name = f'{path.parent.name}/*{path.suffix}' if numbered else path.name
            found.setdefault(name, []).append(path)
    return found


def enlarge(path: Path, count: int) -> None:
    """Repeat the last line of a text, or the bytes of another file."""
    data = path.read_bytes()
    if path.suffix in _TEXTS:
        lines = data.splitlines()
        data = b'\n'.join([*lines, *lines[-1:] * (count - 1), b''])
    else:
        data *= count
    path.write_bytes(data)
