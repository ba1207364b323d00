# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An interrupted command: the threads that write end before what they wrote is removed."""

import threading

import pytest

import kitti_ros2
from kitti_ros2.datasets import crop
from kitti_ros2.files.local_staging import Staging
from kitti_ros2.model.streams import Layout

from builders import convert_recording  # isort: skip
from foreign import make_truth, write_foreign  # isort: skip


def restore(recordings, out, progress):
    bag = convert_recording(recordings[Layout.ODOMETRY], out.with_name('in.mcap')).path
    kitti_ros2.to_kitti(bag, out, progress=progress)


def convert(_, out, progress):
    bag = out.with_name('robot.mcap')
    write_foreign(bag, make_truth())
    kitti_ros2.to_kitti(bag, out, layout='odometry', progress=progress)


def cut(recordings, out, progress):
    crop(recordings[Layout.ODOMETRY], out, voxel=1, progress=progress)


@pytest.mark.parametrize('command', [restore, convert, cut])
def test_threads_end_before_what_they_write_is_removed(recordings, tmp_path, monkeypatch, command):
    before = set(threading.enumerate())
    left = []

    def interrupt(done, _):
        if done:
            raise KeyboardInterrupt

    def discard(staging):
        now = set(threading.enumerate()) - before
        left.append([each.name for each in now if each.name.startswith('worker')])
        Staging.__dict__['_remove_all'](staging)

    monkeypatch.setattr(Staging, 'discard', discard)
    out = tmp_path / 'out'
    with pytest.raises(KeyboardInterrupt):
        command(recordings, out, interrupt)
    assert left
    assert left[-1] == []
    assert not out.exists()
