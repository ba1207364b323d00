# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI folders at URLs: the same bags as from a disk, with few requests."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('fsspec', reason='URLs need fsspec')

from builders import convert_recording
from counted_store import CountedStore, put

from kitti_ros2.kitti.layouts import open_recording
from kitti_ros2.kitti.store import STORE

if TYPE_CHECKING:
    from pathlib import Path


def test_bags_of_every_layout_have_the_same_bytes(recording_path: Path, tmp_path: Path):
    own = tmp_path / 'sets' / recording_path.name
    shutil.copytree(recording_path, own)
    scans = sorted(path for path in own.rglob('*.bin'))
    scans[2].unlink()  # a hole in the numbers
    images = sorted(path for path in own.rglob('*.png'))
    images[1].unlink()
    shutil.copytree(recording_path.parent, tmp_path / 'sets', dirs_exist_ok=True)
    scans[2].unlink()
    images[1].unlink()
    url = put(tmp_path / 'sets') / recording_path.name
    local = convert_recording(own, tmp_path / 'local.mcap')
    remote = convert_recording(url, tmp_path / 'remote.mcap')
    assert (tmp_path / 'remote.mcap').read_bytes() == (tmp_path / 'local.mcap').read_bytes()
    assert remote.counts == local.counts
    assert [str(loss).replace(str(url), str(own)) for loss in remote.losses] == [
        str(loss) for loss in local.losses
    ]
