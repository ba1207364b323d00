# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The services with rosbag2's types: requests and responses have the fields of its .srv files."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.outputs import AtEnd, PlaybackOptions
from kitti_ros2.player.playback import Playback, Send

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

from kitti_ros2.player import node as node_player

SECOND = 1_000_000_000
NAMES = ['Pause', 'Resume', 'TogglePaused', 'IsPaused', 'GetRate', 'SetRate']
NAMES += ['PlayNext', 'Burst', 'Seek', 'Stop']
TYPES = SimpleNamespace(**{name: name for name in NAMES})


class Player:
    """What the services act on, without a node."""

    def __init__(self):
        stamps = np.arange(1, 11) * SECOND
        self.playback = Playback(stamps, np.arange(10), PlaybackOptions(start_paused=True))
        self.told = 0

    def set_rate(self, rate):
        self.playback.change(rate=rate)

    def publish_state(self):
        self.told += 1


@pytest.fixture
def player():
    return Player()


@pytest.fixture
def call(player):
    services = node_player.rosbag2_services(player, TYPES)

    def call(name, **request):
        response = SimpleNamespace()
        handle = node_player._handler(player, services[name][1])
        assert handle(SimpleNamespace(**request), response) is response
        return vars(response)

    call.services = services
    return call


def test_names_and_types_are_rosbag2s(call):
    assert {name: kind for name, (kind, _) in call.services.items()} == {
        'pause': 'Pause',
        'resume': 'Resume',
        'toggle_paused': 'TogglePaused',
        'is_paused': 'IsPaused',
        'get_rate': 'GetRate',
        'set_rate': 'SetRate',
        'play_next': 'PlayNext',
        'burst': 'Burst',
        'seek': 'Seek',
        'stop': 'Stop',
    }


def test_pause_resume_and_toggle(call, player):
    assert call('is_paused') == {'paused': True}
    assert call('resume') == {}
    assert call('is_paused') == {'paused': False}
    call('toggle_paused')
    assert player.playback.state().paused
    call('toggle_paused')
    call('pause')
    assert player.playback.state().paused
    assert player.told == 6


def test_rate(call):
    assert call('set_rate', rate=2.5) == {'success': True}
    assert call('get_rate') == {'rate': 2.5}
    assert call('set_rate', rate=0.0) == {'success': False}
    assert call('get_rate') == {'rate': 2.5}


def test_seek(call, player):
    assert call('seek', time=SimpleNamespace(sec=4, nanosec=5)) == {'success': True}
    assert player.playback.state().stamp_ns == 4 * SECOND + 5
    assert call('seek', time=SimpleNamespace(sec=99, nanosec=0)) == {'success': False}


def test_seek_before_the_beginning_goes_there_and_past_the_end_stays(call, player):
    assert call('seek', time=SimpleNamespace(sec=0, nanosec=1)) == {'success': True}
    assert player.playback.state().stamp_ns == SECOND
    assert call('seek', time=SimpleNamespace(sec=10, nanosec=0)) == {'success': True}
    call('seek', time=SimpleNamespace(sec=4, nanosec=0))
    assert call('seek', time=SimpleNamespace(sec=10, nanosec=1)) == {'success': False}
    assert player.playback.state().stamp_ns == 4 * SECOND
    assert not player.playback.state().finished


@pytest.fixture
def frames_of_three():
    """A player whose frames have three samples, each of them two messages; and what it sent."""
    stamps, frames = np.arange(1, 10) * SECOND, np.repeat([2, 5, 6], 3)
    player = SimpleNamespace(
        playback=Playback(stamps, frames, PlaybackOptions(start_paused=True, at_end=AtEnd.PAUSE)),
        publish_state=lambda: None,
    )
    sent = []

    def play():
        for event in player.playback.events():
            if isinstance(event, Send):
                sent.append(event.position)
                player.playback.sent(2)

    thread = threading.Thread(target=play)
    thread.start()
    services = node_player.rosbag2_services(player, TYPES)

    def call(name, **request):
        response = SimpleNamespace()
        services[name][1](SimpleNamespace(**request), response)
        return vars(response)

    yield call, sent
    player.playback.stop()
    thread.join()


def test_play_next_plays_a_whole_frame(frames_of_three):
    call, sent = frames_of_three
    assert call('play_next') == {'success': True}
    assert sent == [0, 1, 2]
    assert [call('play_next')['success'] for _ in range(3)] == [True, True, False]
    assert sent == list(range(9))


def test_burst_plays_whole_samples(frames_of_three):
    call, sent = frames_of_three
    assert call('burst', num_messages=3) == {'actually_burst': 4}
    assert sent == [0, 1]
    assert call('burst', num_messages=0) == {'actually_burst': 14}
    assert call('burst', num_messages=1) == {'actually_burst': 0}


def test_while_time_runs_nothing_is_stepped(call):
    call('resume')
    assert call('play_next') == {'success': False}
    assert call('burst', num_messages=3) == {'actually_burst': 0}


def test_stop(call, player):
    call('stop')
    assert player.playback.stopped


def test_without_rosbag2_they_are_triggers(player, monkeypatch):
    monkeypatch.setattr(node_player, '_PACKAGE', 'no_such_package')
    assert node_player._rosbag2_types() is None
    services = node_player.plain_services(player)
    player.playback.resume()
    response = SimpleNamespace(success=None, message='')
    services['play_next'][1](None, response)
    assert not response.success
    assert set(services) == {'pause', 'resume', 'toggle_paused', 'play_next', 'stop'}


def test_only_what_is_wrong_is_no_success():
    def fail():
        raise UsageError('no')

    def break_down():
        raise KeyError

    assert not node_player._succeeds(fail)
    with pytest.raises(KeyError):
        node_player._succeeds(break_down)
