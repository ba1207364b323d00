# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player of one ROS 2 and a subscriber of another.

PLAYER_PYTHON names the interpreter of the player (live.py); without it both have the same ROS 2.
"""

import json
import subprocess

import pytest
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.messages.type_descriptions import defined_hash
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import live

from builders import convert_recording  # isort: skip
from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

RED = '\x1b[31'
SEGMENT = 32 << 20  # of fastdds2.xml and fastdds3.xml
LATCHED = {True: 'TRANSIENT_LOCAL', False: 'VOLATILE'}
JAZZY = get_typestore(Stores.ROS2_JAZZY)

HASHES = """
import json, sys
from importlib import import_module
from kitti_ros2.player.message_types import type_hash

found = {}
for name in json.load(sys.stdin):
    package, _, message = name.split('/')
    try:
        module = import_module(f'{package}.msg')
    except ModuleNotFoundError:
        continue
    if hasattr(module, message):
        found[name] = type_hash(getattr(module, message))
print(json.dumps(found))
"""


@pytest.fixture
def start():
    """Starts a player and a listener, and sees to it that neither is left."""
    started = []

    def run(src, topics, *options):
        player = live.play(src, '--start-paused', '--wait-for', '1', *options)
        started.append(player)
        listener = live.Listening(topics)
        started.append(listener.process)
        listener.wait_for_publishers(player)
        return player, listener

    yield run
    for process in started:
        live.stop(process)


def run_in_player(program, text):
    """What a program says that the interpreter of the player runs."""
    done = subprocess.run(
        [live.PLAYER_PYTHON, '-c', program], input=text, env=live.environment(live.PLAYER_PYTHON),
        capture_output=True, text=True, timeout=PATIENCE_S, check=True,
    )  # fmt: skip
    return done.stdout


def test_what_is_offered_is_heard(start, recordings, tmp_path):
    """Topics, types with their hashes, QoS and all bytes are the bag's; the profile is in use."""
    source, bag = recordings[Layout.RAW], tmp_path / 'o.mcap'
    convert_recording(source, bag, MessageOptions(images=Images.BOTH))
    digests = live.bag_digests(bag)
    with open_messages(bag) as messages:
        latched = {topic: source.latched for topic, source in messages.sources.items()}
    player, listener = start(source, dict(digests.keys()))
    for topic, msgtype in digests:
        expected = [msgtype, defined_hash(msgtype, TYPESTORE), 'RELIABLE', LATCHED[latched[topic]]]
        assert listener.tell('offer', topic) == [expected]
    assert max(live.shared_memory(player)) >= SEGMENT
    assert listener.tell('call', 'resume')[0]
    _, said = player.communicate(timeout=PATIENCE_S)
    assert player.returncode == 0, said
    assert RED not in said
    assert 'error' not in said.lower()
    heard = {topic: [digest for _, digest in found] for topic, found in listener.heard().items()}
    assert heard == {topic: found for (topic, _), found in digests.items()}


def test_numbers_and_texts_of_digits_are_accepted_as_parameters(start, recordings):
    imu = {'/kitti/oxts/imu': 'sensor_msgs/msg/Imu'}
    words = ('rate:=2', 'delay:=0', 'clock:=50', 'sequence:=0000', 'start:=0001', 'end:=03')
    options = [option for word in words for option in ('-p', word)]
    source = recordings[Layout.TRACKING]
    player, listener = start(source, imu, '--at-end', 'pause', '--ros-args', *options)
    assert listener.tell('set', 'rate', 1) == [True, '']
    assert listener.tell('call', 'play_next') == [True, 'paused, frame 1']
    code, said = live.end(player)
    assert code == 0, said
    assert 'tracking 0000: frames 1 to 3' in said


def test_types_are_those_of_the_ros_that_plays():
    """Messages are made by the definitions of Jazzy: a ROS that differs must be noticed."""
    names = sorted({*JAZZY.fielddefs, *TYPESTORE.fielddefs})
    expected = {
        name: defined_hash(name, TYPESTORE if name in TYPESTORE.fielddefs else JAZZY)
        for name in names
    }
    installed = json.loads(run_in_player(HASHES, json.dumps(names)))
    assert {'sensor_msgs/msg/PointCloud2', 'nav_msgs/msg/Odometry'} <= installed.keys()
    assert installed == {name: expected[name] for name in installed}
