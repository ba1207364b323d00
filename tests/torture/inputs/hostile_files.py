# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI folders whose files hold numbers that no sensor measures, or end too early."""

from __future__ import annotations

import re
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

ABSURD = ('nan', 'inf', '-inf', '1e300', '-1e38', '0', '1e-320', '1e160')
"""Numbers that are valid in a text file, and overflow or divide by zero when they are used."""

_NUMBER = re.compile(r'(?<![\w.+-])[+-]?\d+\.\d*(?:[eE][+-]?\d+)?(?![\w.])')
_TEXTS = {
    'calib': ('calib*.txt', 'calib/*.txt', 'calib.txt'),
    'labels': ('label_*/**/*.txt', 'tracklet_labels.xml'),
    'poses': ('oxts/data/*.txt', 'oxts/[0-9]*.txt', 'poses/*.txt'),
}


def texts_of(root: Path, kind: str) -> list[Path]:
    """The text files of a kind below a folder: calib, labels, poses (and oxts)."""
    return sorted({path for pattern in _TEXTS[kind] for path in root.rglob(pattern)})


def with_number(root: Path, kind: str, number: str) -> None:
    """Write a number in place of each that has a decimal point."""
    for path in texts_of(root, kind):
        path.write_text(_NUMBER.sub(number, path.read_text()))


def with_all_numbers(root: Path, kind: str) -> None:
    """Write an absurd number in place of every third; over the files it is each of them."""
    numbers = cycle(ABSURD)
    for path in texts_of(root, kind):
        places = cycle((True, False, False))
        path.write_text(
            _NUMBER.sub(
                lambda found: next(numbers) if next(places) else found[0],  # noqa: B023 - at once
                path.read_text(),
            )
        )


def hostile_scans(root: Path) -> None:
    """Fill a quarter of the first scan with numbers that no scanner measures; empty the second."""
    values = np.array([np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-40, 1e20, 0], np.float32)
    for path in sorted(root.rglob('*.bin')):
        if int(path.stem) % 2:
            path.write_bytes(b'')
            continue
        points = np.fromfile(path, np.float32)
        points[::4] = np.resize(values, len(points[::4]))
        rows = points.reshape(-1, 4)
        rows[:8] = values[:, None]
        path.write_bytes(points.tobytes())


def damaged_images(root: Path) -> None:
    """Cut images, flip their bytes, empty them, one kind of damage after the other."""
    for place, path in enumerate(sorted(root.rglob('*.png'))):
        data = bytearray(path.read_bytes())
        middle = len(data) // 2
        if place % 4 == 0:
            del data[middle:]
        elif place % 4 == 1:
            data[middle : middle + 9] = bytes(9)
        elif place % 4 == 2:
            data.clear()
        else:
            data[16:24] = b'\xff' * 8  # width and height
        path.write_bytes(data)


def hostile_stamps(root: Path) -> None:
    """Write stamps of other ages, and such as do not exist."""
    dates = ['1677-09-22 00:00:00.1', '2262-04-11 23:00:00.999999999', '9999-12-31 23:59:59.9']
    for path in sorted(root.rglob('timestamps*.txt')):
        lines = path.read_text().splitlines()
        path.write_text('\n'.join(dates[at % 3] for at in range(len(lines))) + '\n')
    for path in sorted(root.rglob('times.txt')):
        lines = path.read_text().splitlines()
        path.write_text('\n'.join(('-1e300', '9.2e9', 'nan')[at % 3] for at in range(len(lines))))
