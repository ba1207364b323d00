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

if TYPE_CHECKING:
    from pathlib import Path


def test_bags_of_every_layout_have_the_same_bytes(recording_path: Path, tmp_path: Path):
    shutil.copytree(recording_path.parent, tmp_path / 'sets')
    own = tmp_path / 'sets' / recording_path.name
    sorted(own.rglob('*.bin'))[2].unlink()  # holes in the numbers
    sorted(own.rglob('*.png'))[1].unlink()
    url = put(tmp_path / 'sets') / recording_path.name
    local = convert_recording(own, tmp_path / 'local' / 'a.mcap')
    remote = convert_recording(url, tmp_path / 'remote' / 'a.mcap')
    assert (tmp_path / 'remote' / 'a.mcap').read_bytes() == (
        tmp_path / 'local' / 'a.mcap'
    ).read_bytes()
    assert remote.counts == local.counts
    assert [str(loss).replace(str(url), str(own)) for loss in remote.losses] == [
        str(loss) for loss in local.losses
    ]


def test_folders_are_listed_once_and_files_read_once(recording_path: Path, tmp_path: Path):
    url = put(recording_path.parent) / recording_path.name
    convert_recording(url, tmp_path / 'a.mcap')
    folders = {path.parent for path in recording_path.parent.rglob('*')}
    assert CountedStore.requests['ls'] <= len(folders) + 3  # names beside it that are not there
    assert CountedStore.requests['info'] < len(url.names)  # of the marks of uploads
    read = [key for key, _ in CountedStore.read]
    twice = {key for key in read if read.count(key) > 1}
    # The size in the first image's header, and the columns by the beginning of the first scan.
    assert all(key.endswith(('0000.png', '0000.bin')) for key in twice)
