# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A synchronised drive with the 100 Hz packets of the unsynchronised one beside it."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from shared_files import made_once

from kitti_ros2.kitti.extract_oxts import add_extract
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import ImuOptions, ImuStamps
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic
from kitti_ros2.synthetic.drive import extract_of

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from kitti_ros2.kitti.kitti_recording import KittiRecording
    from kitti_ros2.options.read import ReadOptions

FAST = SyntheticOptions(
    frames=12,
    seed=6,
    image_size=(32, 16),
    lidar_columns=64,
    speed=15.0,
    turn_rate=30.0,
    swept=True,
    extract=True,
)
"""15 m/s and 30 degrees/s; the packets have repeats, a gap and jitter."""


def fast_drive(factory: pytest.TempPathFactory) -> Path:
    """The synchronised drive, made once in a test run; not to be changed."""
    return made_once(
        factory, 'extract_drive', lambda folder: write_synthetic(folder / 'raw', Layout.RAW, FAST)
    )


def copy_extract(drive: Path, folder: Path) -> Path:
    """Copy the unsynchronised drive beside a drive, to be damaged."""
    return shutil.copytree(extract_of(drive), folder / extract_of(drive).name)


def open_with(
    drive: Path,
    extract: Path | None = None,
    stamps: ImuStamps = ImuStamps.ORIGINAL,
    read: ReadOptions | None = None,
) -> KittiRecording:
    """Open a drive with the packets of an unsynchronised one: by default that beside it."""
    recording = open_recording(drive, read)
    add_extract(recording, ImuOptions(extract or extract_of(drive), stamps))
    return recording
