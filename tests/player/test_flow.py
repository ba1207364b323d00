# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Flow control, with publishers and a clock that the test makes."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='needs rclpy')

from rclpy.qos import QoSProfile, ReliabilityPolicy

from kitti_ros2.player.outlets import FlowControl

SECOND = 1_000_000_000
DEPTH = 10


class Subscriber:
    """Acknowledges everything so many seconds after it was asked first; None never."""

    def __init__(self, clock, seconds, reliability=ReliabilityPolicy.RELIABLE):
        self.clock = clock
        self.seconds = seconds
        self.asked_ns = None
        self.topic_name = '/scan'
        self.qos_profile = QoSProfile(depth=DEPTH, reliability=reliability)

    def wait_for_all_acked(self, timeout):
        if self.asked_ns is None:
            self.asked_ns = self.clock.now
        end = self.clock.now + timeout.nanoseconds
        if self.seconds is None or self.asked_ns + self.seconds * SECOND > end:
            self.clock.now = end
            return False
        self.clock.now = max(self.clock.now, self.asked_ns + int(self.seconds * SECOND))
        self.asked_ns = None
        return True


@pytest.fixture
def clock():
    return SimpleNamespace(now=40 * SECOND)


def flow_to(clock, *subscribers):
    said = []

    def warning(text, throttle_duration_sec):
        assert throttle_duration_sec >= 1
        said.append(text)

    flow = FlowControl(
        dict(enumerate(subscribers)), SimpleNamespace(warning=warning), lambda: clock.now
    )
    return flow, said


def send(flow, messages, patience=0.2, most=1000):
    """How many were sent, and how often there was no room."""
    waits = 0
    for count in range(messages):
        while not flow.make_room(0, patience):
            waits += 1
            if waits == most:
                return count, waits
    return messages, waits


def test_a_quick_subscriber_is_never_spoken_of(clock):
    flow, said = flow_to(clock, Subscriber(clock, 0.01))
    assert send(flow, 100) == (100, 0)
    assert said == []


def test_a_slow_one_is_called_slow(clock):
    flow, said = flow_to(clock, Subscriber(clock, 2.7))
    assert send(flow, DEPTH) == (DEPTH, 13)
    assert said == ['/scan: slow subscriber, 2.7 s to acknowledge 9 messages']


def test_one_that_acknowledges_nothing_is_said_to_have_stopped_with_for_how_long(clock):
    flow, said = flow_to(clock, Subscriber(clock, None))
    assert send(flow, DEPTH, most=26) == (DEPTH - 1, 26)
    assert said[0] == (
        '/scan: the last 9 messages are not all acknowledged after 5 s; a subscriber may have'
        ' stopped'
    )
    assert 'slow' not in ''.join(said)


def test_the_wait_counts_anew_after_an_acknowledgement(clock):
    flow, said = flow_to(clock, Subscriber(clock, 4))
    assert send(flow, 5 * DEPTH)[0] == 5 * DEPTH
    assert said
    assert all('slow subscriber, 4.0 s' in text for text in said)


def test_a_best_effort_publisher_waits_for_nobody(clock):
    flow, _ = flow_to(clock, Subscriber(clock, None, ReliabilityPolicy.BEST_EFFORT))
    assert send(flow, 100) == (100, 0)
    assert flow.finish(1) == ()


def test_the_end_waits_no_longer_than_it_is_told_however_many_have_stopped(clock):
    stopped = [Subscriber(clock, None) for _ in range(7)]
    for index, each in enumerate(stopped):
        each.topic_name = f'/topic{index}'
    flow, _ = flow_to(clock, Subscriber(clock, 0), *stopped)
    begin = clock.now
    assert flow.finish(1.0) == tuple(f'/topic{index}' for index in range(7))
    assert clock.now - begin == SECOND
