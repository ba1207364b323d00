# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How often the node publishes ~/state, counted by a subscriber who is there first."""

import pytest

from kitti_ros2.model.streams import Layout

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from kitti_ros2.player import node as player_module
from kitti_ros2.player.node import KittiPlayer, to_parameters

from waiting import wait_until  # isort: skip

LAST = 'the last one'


class Played:
    """A paused player and a subscriber of its state, both in this process."""

    def __init__(self, context, **values):
        parameters = to_parameters({'start_paused': True, 'at_end': 'pause', **values})
        self.player = KittiPlayer(parameters, context=context)
        self.node = rclpy.create_node('state_listener', context=context)
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_ALL, depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL
        )
        topic = f'{self.player.get_fully_qualified_name()}/state'
        self.subscription = self.node.create_subscription(
            DiagnosticArray, topic, lambda _: None, profile
        )
        self.publisher = self.player._state_publisher
        wait_until(lambda: self.publisher.get_subscription_count() == 1)
        wait_until(lambda: self.node.count_publishers(topic) == 1)

    def set(self, name, value):
        """Set a parameter, as the service does."""
        parameter = self.player.get_parameter(name)
        (result,) = self.player.set_parameters([type(parameter)(name, value=value)])
        assert result.successful, result.reason

    def states(self):
        """What doing each message told, up to now: a message of our own ends the row."""
        self.publisher.publish(DiagnosticArray(status=[DiagnosticStatus(message=LAST)]))
        found = []

        def heard_the_last():
            while taken := self.subscription.handle.take_message(DiagnosticArray, False):
                found.append(taken[0].status[0].message)
            return found[-1:] == [LAST]

        wait_until(heard_the_last)
        return found[:-1]

    def close(self):
        self.player.stop()
        self.player.destroy_node()
        self.node.destroy_node()


@pytest.fixture
def played(monkeypatch):
    """Starts players whose state is published when it changes, and not by time."""
    monkeypatch.setattr(player_module, '_STATE_EVERY_NS', 3_600_000_000_000)
    context = rclpy.Context()
    rclpy.init(context=context)
    started = []

    def start(**values):
        started.append(Played(context, **values))
        return started[-1]

    yield start
    for each in started:
        each.close()
    context.try_shutdown()


def test_it_begins_with_one_state(played, recordings):
    """Each publisher declares parameters (qos_overrides.*); those change nothing of the player."""
    player = played(source=str(recordings[Layout.RAW]))
    player.player.start()
    assert len([name for name in player.player._parameters if name.startswith('qos_')]) > 50
    assert player.states() == ['paused, frame 0']


def test_each_change_is_one_state(played, recordings):
    player = played(source=str(recordings[Layout.RAW]))
    player.player.start()
    player.set('position', 3)
    player.set('rate', 2.0)
    assert player.states() == ['paused, frame 0', 'paused, frame 2', 'paused, frame 2']


def test_another_source_is_one_state(played, recordings):
    player = played(source=str(recordings[Layout.RAW]))
    player.player.start()
    player.set('source', str(recordings[Layout.TRACKING]))
    assert len(player.states()) == 2


def test_parameters_of_others_are_no_change(played, recordings):
    player = played(source=str(recordings[Layout.RAW]))
    player.player.start()
    player.player.declare_parameter('qos_overrides./other.publisher.depth', 3)
    assert player.states() == ['paused, frame 0']
