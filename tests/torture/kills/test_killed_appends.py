# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An append that is killed, or finds the disk full, at any call: the set is as before or after."""

from __future__ import annotations

import shutil
from itertools import count

import pytest
from test_append import (
    COMPLETE,
    FOLDER,
    KILLED,
    NEW,
    NOT_UNDONE,
    OLD,
    REPORTED,
    Full,
    append,
    assert_lists_name_whole_frames,
    assert_readers_see,
    in_child,
    interrupted,
    made,
    tree,
    visible,
)

from kitti_ros2.kitti.append import mend
from kitti_ros2.kitti.object_set import find_journal
from kitti_ros2.kitti.opening import open_recording

__all__ = ['made']  # a fixture


def test_killed_at_any_call_the_set_is_as_before_or_as_after(made, tmp_path):
    before, once, twice = made
    done = set()
    for at in count():
        out = tmp_path / 'out'
        shutil.copytree(before, out)
        code = in_child(out, at, lambda out=out: append(out))
        if code == COMPLETE:
            break
        assert code == KILLED
        pending = find_journal(out) is not None
        is_after = not pending and visible(out) == visible(once)
        assert is_after or pending or visible(out) == visible(before), at
        assert_lists_name_whole_frames(out)
        assert_readers_see(out, OLD + NEW if is_after else OLD)
        left = (out / FOLDER).exists()
        said = [note for note in open_recording(out).notes if 'was interrupted' in note]
        assert len(said) == left
        notes = append(out)
        assert tree(out) == tree(twice if is_after else once), at
        assert len(notes) == left
        done |= {
            word for note in notes for word in ('undone', 'removed', 'complete') if word in note
        }
        shutil.rmtree(out)
    assert at > 60
    assert done == {'undone', 'removed', 'complete'}


@pytest.mark.parametrize('last_moved', ['training/velodyne/000008.bin', 'ImageSets/train.txt'])
def test_undoing_can_be_killed_at_any_call_too(made, tmp_path, last_moved):
    before = made[0]
    out = tmp_path / 'out'
    interrupted(before, out, last_moved)
    for at in count():
        copy = tmp_path / 'copy'
        shutil.copytree(out, copy)
        code = in_child(copy, at, lambda copy=copy: mend(copy))
        assert_lists_name_whole_frames(copy)
        assert_readers_see(copy, OLD)
        mend(copy)
        assert tree(copy) == tree(before), at
        shutil.rmtree(copy)
        if code == COMPLETE:
            break
    assert at > 20


@pytest.mark.parametrize('full', list(Full))
def test_a_disk_that_is_full_at_any_call_leaves_the_set_as_before(made, tmp_path, full):
    before, once, _ = made
    codes = set()
    for at in count():
        out = tmp_path / 'out'
        shutil.copytree(before, out)
        code = in_child(out, at, lambda out=out: append(out), full)
        if code == COMPLETE:
            break
        codes.add(code)
        if code == REPORTED:
            assert tree(out) == tree(before), at
        assert_lists_name_whole_frames(out)
        assert_readers_see(out, OLD)
        append(out)
        assert tree(out) == tree(once), at
        shutil.rmtree(out)
    assert at > 30
    assert codes == {REPORTED} | ({NOT_UNDONE} if full is Full.NO_RENAME else set())
