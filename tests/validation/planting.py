# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Ways of damaging a file, for faults that a validation must find."""

from __future__ import annotations

import os
import struct
import zlib
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Fault(NamedTuple):
    """A fault to plant.

    Attributes:
        name: What it is.
        rule: The id of the rule that finds it.
        plant: Damages a data set at a frame; returns the file or folder that the finding names.
        options: Of validate.
        alone: Whether it hides other faults of the layout, or changes the whole recording.
        layout: The layout of the data set.
    """

    name: str
    rule: str
    plant: Callable[[Path, int], Path]
    options: tuple[str, ...] = ()
    alone: bool = False
    layout: Layout = Layout.OBJECT


def edit_line(path: Path, line: int, change: Callable[[str], str]) -> Path:
    """Change a line, from 1."""
    lines = path.read_text().splitlines()
    lines[line - 1] = change(lines[line - 1])
    path.write_text('\n'.join(lines) + '\n')
    return path


def set_word(path: Path, line: int, index: int, word: str) -> Path:
    """Replace a word of a line."""

    def change(text: str) -> str:
        words = text.split()
        words[index] = word
        return ' '.join(words)

    return edit_line(path, line, change)


def set_key(path: Path, key: str, change: Callable[[list[str]], list[str]]) -> Path:
    """Change the words of a calibration's key."""
    lines = path.read_text().splitlines()
    for index, line in enumerate(lines):
        words = line.split()
        if words and words[0].rstrip(':') == key:
            lines[index] = ' '.join([words[0], *change(words[1:])])
    path.write_text('\n'.join(lines) + '\n')
    return path


def drop_key(path: Path, key: str) -> Path:
    lines = [each for each in path.read_text().splitlines() if not each.startswith(key)]
    path.write_text('\n'.join(lines) + '\n')
    return path


def add_line(path: Path, line: str) -> Path:
    path.write_text(path.read_text() + line + '\n')
    return path


def cut(path: Path, size: int) -> Path:
    """Keep the first bytes of a file; a negative size leaves out the last ones."""
    path.write_bytes(path.read_bytes()[:size])
    return path


def empty(path: Path) -> Path:
    path.write_bytes(b'')
    return path


def remove(path: Path) -> Path:
    path.unlink()
    return path.parent


def flip(path: Path, at: int) -> Path:
    data = bytearray(path.read_bytes())
    data[at] ^= 0xC0
    path.write_bytes(data)
    return path


def make_huge(path: Path) -> Path:
    """A file of 10 GB that takes no room on the disk."""
    path.unlink()
    with path.open('wb') as file:
        file.truncate(10 * 10**9 // 16 * 16)
    return path


def make_pipe(path: Path) -> Path:
    path.unlink()
    os.mkfifo(path)
    return path


def make_loop(path: Path) -> Path:
    path.unlink()
    path.symlink_to(path.name)
    return path


def make_folder(path: Path) -> Path:
    path.unlink()
    path.mkdir()
    return path


def change_points(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> Path:
    points = np.fromfile(path, np.float32).reshape(-1, 4)
    np.ascontiguousarray(change(points), np.float32).tofile(path)
    return path


def set_points(path: Path, rows: slice, column: int, value: float) -> Path:
    def change(points: np.ndarray) -> np.ndarray:
        points[rows, column] = value
        return points

    return change_points(path, change)


def write_png(path: Path, body: bytes, size: tuple[int, int], colour: int = 2) -> Path:
    """A PNG whose chunks are right, with any image data."""
    header = struct.pack('>IIBBBBB', *size, 8, colour, 0, 0, 0)
    parts = [b'\x89PNG\r\n\x1a\n']
    for kind, data in ((b'IHDR', header), (b'IDAT', body), (b'IEND', b'')):
        crc = zlib.crc32(kind + data)
        parts += [struct.pack('>I', len(data)), kind, data, struct.pack('>I', crc)]
    path.write_bytes(b''.join(parts))
    return path


def write_blank(path: Path, size: tuple[int, int], colour: int = 2) -> Path:
    """A PNG of black pixels."""
    channels = 3 if colour == 2 else 1
    return write_png(path, zlib.compress(bytes((size[0] * channels + 1) * size[1])), size, colour)


def png_size(path: Path) -> tuple[int, int]:
    width, height = struct.unpack('>II', path.read_bytes()[16:24])
    return width, height
