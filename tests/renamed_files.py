# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings whose files are named as sets of others in KITTI's folders name them."""

from __future__ import annotations

import hashlib
import shutil
from typing import TYPE_CHECKING

import cv2

from kitti_ros2.kitti.names import IMAGE_SETS
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from pathlib import Path


def token(number: int) -> str:
    """A name that is no number, in another order than the numbers."""
    return hashlib.md5(str(number).encode()).hexdigest()


def as_jpeg(path: Path, suffix: str = '.jpg') -> None:
    """Turn a PNG into a JPEG."""
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    done, data = cv2.imencode('.jpg', pixels)
    assert done
    path.unlink()
    path.with_suffix(suffix).write_bytes(data.tobytes())


def stems(name):
    """A kind that gives all files of a frame another name."""
    return lambda path, number: path.rename(path.with_name(f'{name(number)}{path.suffix}'))


def images(change):
    """A kind that changes images."""
    return lambda path, number: change(path, number) if path.suffix == '.png' else None


KINDS = {
    'five digits': stems('{:05d}'.format),
    'seven digits': stems('{:07d}'.format),
    'no zeros in front': stems('{}'.format),
    'tokens': stems(token),
    'time stamps': stems(lambda number: 1531883530449377000 + 10**8 * number),
    'prefix': stems('frame_{}'.format),
    '.jpg': images(lambda path, _: as_jpeg(path)),
    '.JPEG': images(lambda path, _: as_jpeg(path, '.JPEG')),
    '.PNG': images(lambda path, _: path.rename(path.with_suffix('.PNG'))),
    'JPEG named .png': images(lambda path, _: as_jpeg(path, '.png')),
    'some .jpg': images(lambda path, number: as_jpeg(path) if number % 2 else None),
    'some of five digits': lambda path, number: number % 2 and stems('{:05d}'.format)(path, number),
}
"""By name a function of a file and its number."""

BY_NAME = frozenset({'tokens', 'time stamps', 'prefix'})
"""The kinds whose names are no numbers."""


def renamed(source: Path, layout: Layout, folder: Path, kind: str) -> Path:
    """A copy of a recording with files of a kind; returns the folder to convert."""
    whole = source.parent if layout is Layout.RAW else source
    copy = folder / whole.name
    shutil.copytree(whole, copy)
    copied = copy / source.name if layout is Layout.RAW else copy
    for listing in open_recording(copied).listings.values():
        for number in listing.numbers.tolist():
            KINDS[kind](listing.path(number), number)
    for path in copy.glob(f'{IMAGE_SETS}/*.txt'):
        lines = [_renamed(int(line), kind, folder) for line in path.read_text().split()]
        path.write_text(''.join(f'{line}\n' for line in lines))
    return copied


def _renamed(number: int, kind: str, folder: Path) -> str:
    path = folder / f'{number:06d}.txt'
    path.touch()
    KINDS[kind](path, number)
    (found,) = folder.glob('*.txt')
    found.unlink()
    return found.stem
