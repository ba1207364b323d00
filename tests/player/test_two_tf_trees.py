# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A player beside a node that owns map -> odom -> base_link: what all others hear of TF.

The conditions are those under which tf2's BufferCore::setTransform takes a transform without an
error or a warning (geometry2, tf2/src/buffer_core.cpp: self transform, empty names, quaternion that
is not normalised, repeated and old data), and that every frame has one parent.
"""

import json
import subprocess
import sys

import pytest

from kitti_ros2.model.streams import Layout

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import live

from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

SCANS = '/kitti/velo/points'
NODES = 2  # of tf_stack.py


@pytest.fixture
def hear(recordings):
    """A function that plays the synthetic drive beside the stack; returns what was heard."""
    started = []

    def run(*options):
        words = [sys.executable, str(live.HERE / 'tf_stack.py'), SCANS]
        stack = subprocess.Popen(
            words, env=live.environment(), text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        started.append(stack)
        assert stack.stdout.readline() == 'ready\n'
        drive = recordings[Layout.RAW]
        player = live.play(drive, '--lossless', '--wait-for', NODES, *options, program=live.MAIN)
        started.append(player)
        _, said = player.communicate(timeout=PATIENCE_S)
        assert player.returncode == 0, said
        heard, _ = stack.communicate(timeout=PATIENCE_S)
        return json.loads(heard.splitlines()[-1])

    yield run
    for process in started:
        live.stop(process)


def parents_of(heard):
    """The parents of each frame."""
    found = {}
    for _, parent, child, *_ in heard:
        found.setdefault(child, set()).add(parent)
    return found


def rejected(heard):
    """What tf2 would not take, or complain of."""
    found, last = [], {}
    for topic, parent, child, stamp_ns, length in heard:
        names_valid = parent != child and all(
            name and not name.startswith('/') for name in (parent, child)
        )
        is_new = topic == '/tf_static' or stamp_ns > last.get(child, -1)
        if not (names_valid and is_new and abs(length - 1) < 1e-6):
            found.append((topic, parent, child, stamp_ns))
        last[child] = stamp_ns
    return found


def root_of(frame, parents):
    """The root of a frame's tree; fails in a circle."""
    passed = [frame]
    while passed[-1] in parents:
        (parent,) = parents[passed[-1]]
        assert parent not in passed, f'a circle: {passed}'
        passed.append(parent)
    return passed[-1]


def test_both_trees_are_whole_and_apart(hear):
    heard = hear('--ground-truth-tree')
    assert rejected(heard) == []
    parents = parents_of(heard)
    assert {child for child, above in parents.items() if len(above) != 1} == set()
    roots = {frame: root_of(frame, parents) for frame in parents}
    truth = {frame for frame, root in roots.items() if root == 'map_gt'}
    assert truth == {'base_link_gt'}
    assert {root for frame, root in roots.items() if frame not in truth} == {'map'}
    assert {'odom', 'base_link', 'imu_link', 'velo_link'} < roots.keys()


def test_without_it_base_link_has_two_parents(hear):
    assert parents_of(hear())['base_link'] == {'map', 'odom'}
