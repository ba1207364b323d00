# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The score command of a stack scores what the stack publishes: a perfect one has no error."""

from __future__ import annotations

import json
import shlex

import pytest

from kitti_ros2.api.setup_files import commands_of, facts_of
from kitti_ros2.bags.open_source import open_folder
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import ODOMETRY, TF, Channel
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.options.stack_catalogue import STACKS

TRUTH = '/kitti/ground_truth/odometry'
ITS_BODY = {
    'genz-icp': ('', 'base_link'),
    'lio-sam': ('odom_mapping', 'velo_link'),
    'fast-lio2': ('body', 'imu_link'),
    'glim': ('imu_link', 'imu_link'),
}
"""child_frame_id in its Odometry, and the frame of the drive that it is; others: base_link."""
SCORED = [name for name, stack in STACKS.items() if stack.result.odometry]


@pytest.fixture(scope='module')
def truth(recordings, tmp_path_factory):
    """The transforms of a bag, and the pose of base_link of each frame."""
    bag = tmp_path_factory.mktemp('truth') / 'truth'
    words = ['--topics', '/tf*', TRUTH, '/kitti/source/*']
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q', *words]) == 0
    with open_messages(bag) as messages:
        return [(each.topic, each.stamp_ns, bytes(each.data)) for each in messages]


@pytest.mark.parametrize('name', SCORED)
def test_a_perfect_odometry_has_no_error(name, truth, recordings, tmp_path, monkeypatch, capsys):
    pytest.importorskip('evo')
    facts, _ = facts_of(open_folder(recordings[Layout.RAW], ReadOptions()))
    child, body = ITS_BODY.get(name, ('base_link', 'base_link'))
    base_t_body = {
        'base_link': Transform.identity(),
        'velo_link': facts.base_T_velo,
        'imu_link': facts.base_T_imu,
    }[body]
    monkeypatch.chdir(tmp_path)
    topic = STACKS[name].result.odometry
    with open_bag(tmp_path / f'{name}_run', BagOptions(), TYPESTORE) as writer:
        channels = {
            TRUTH: writer.add_channel(Channel(topic, ODOMETRY)),
            '/tf_static': writer.add_channel(Channel('/tf_static', TF, latched=True, depth=1)),
        }
        for own, stamp_ns, data in truth:
            if own == TRUTH:
                writer.write(channels[own], stamp_ns, (moved(data, base_t_body, child),))
            elif own == '/tf_static':
                writer.write(channels[own], stamp_ns, (data,))
    words = shlex.split(commands_of(STACKS[name], str(recordings[Layout.RAW]), {}).score)
    assert main([*words[1:], '--json']) == 0
    (figures,) = json.loads(capsys.readouterr().out)['odometry'].values()
    assert figures['ape_m'] < 1e-4


def moved(data, base_t_body, child):
    """The Odometry of another body that is fixed to base_link."""
    message = deserialize(data, ODOMETRY)
    pose = message.pose.pose
    place, turn = pose.position, pose.orientation
    map_t_base = Transform.from_quaternion(
        (turn.x, turn.y, turn.z, turn.w), (place.x, place.y, place.z)
    )
    map_t_body = map_t_base @ base_t_body
    place.x, place.y, place.z = map(float, map_t_body.translation)
    turn.x, turn.y, turn.z, turn.w = map(float, map_t_body.quaternion())
    message.child_frame_id = child
    return join(serialize(message))
