# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded clock and the player's own: a subscriber hears one of them."""

import pytest

from kitti_ros2.model.streams import Layout

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

from kitti_ros2.cli import main
from kitti_ros2.player.node import KittiPlayer, to_parameters

from builders import convert_recording, one_line  # isort: skip
from recorded import CLOCKS, STATE, write_recorded  # isort: skip
from waiting import PATIENCE_S, wait_until  # isort: skip


@pytest.fixture(scope='module')
def recorded(recordings, tmp_path_factory):
    """A drive's bag with what a recorder adds to it, and the recorded clock."""
    folder = tmp_path_factory.mktemp('recorded')
    convert_recording(recordings[Layout.RAW], folder / 'o.mcap')
    clock = write_recorded(folder / 'o.mcap', folder / 'recorded.mcap')
    return folder / 'recorded.mcap', clock


def heard(path, **values):
    """The clock that a subscriber hears while a bag is played once, and how many tell it."""
    context = rclpy.Context()
    rclpy.init(context=context)
    ears = rclpy.create_node('clock_listener', context=context)
    profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
    ears.create_subscription(Clock, '/clock', lambda _: None, profile)
    (subscription,) = ears.subscriptions
    parameters = to_parameters({'source': str(path), 'start_paused': True, **values})
    player = KittiPlayer(parameters, context=context)
    try:
        player.start()
        wait_until(lambda: ears.count_publishers('/clock'))
        (publisher,) = (each for each in player.publishers if each.topic == '/clock')
        wait_until(publisher.get_subscription_count)
        player.playback.resume()
        assert player.ended.wait(PATIENCE_S)
        tellers, states = ears.count_publishers('/clock'), ears.count_publishers(STATE)
        times = []
        while taken := subscription.handle.take_message(Clock, False):
            times.append(taken[0].clock.sec * 10**9 + taken[0].clock.nanosec)
    finally:
        player.stop()
        player.destroy_node()
        ears.destroy_node()
        context.try_shutdown()
    return times, tellers, states


def test_the_players_clock_never_goes_back(recorded):
    path, clock = recorded
    times, tellers, states = heard(path)
    assert (tellers, states) == (1, 1)
    assert times == sorted(times)
    assert times[-1] < clock[0]


def test_without_it_the_recorded_one_is_heard(recorded):
    path, clock = recorded
    assert heard(path, clock=0.0) == (clock, 1, 1)


def test_nothing_but_the_clock_is_wrong_usage(recorded, capsys):
    assert main(['play', str(recorded[0]), '--topics', '/clock']) == 2
    complaint = one_line(capsys.readouterr().err)
    assert f'/clock is left out, {CLOCKS} messages: the player publishes its own' in complaint
