# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A session between a program and a transport that the test makes."""

import threading
import time

import numpy as np
import pytest

from kitti_ros2.files.processes import FreeMemory
from kitti_ros2.messages.cdr import Message
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.session import LAST_WAIT_S, Audience, Session

from waiting import PATIENCE_S, wait_until  # isort: skip

SCAN, IMU, STATIC = range(3)
POSITIONS = 6


class SmallProgram:
    """One message of each topic at each position; the scans are on demand."""

    name = 'small'
    workers = 1
    losses = ()
    longest_gap_ns = None
    channels = (
        Channel('/scan', 'sensor_msgs/msg/PointCloud2', latched=False, depth=10),
        Channel('/imu', 'sensor_msgs/msg/Imu', latched=False, depth=10),
        Channel('/static', 'tf2_msgs/msg/TFMessage', latched=True, depth=1),
    )

    def __init__(self):
        self.stamps_ns = np.arange(1, POSITIONS + 1) * 1_000_000
        self.frames = np.arange(7, 7 + POSITIONS)

    def fetch(self, index, wanted):
        stamp_ns = int(self.stamps_ns[index])
        return [
            Message(outlet, stamp_ns, (b'data',) if outlet in wanted or outlet != SCAN else ())
            for outlet in (IMU, STATIC, SCAN)
        ], []

    def latched_before(self, _index):
        return []

    def close(self):
        pass


class FakeTransport:
    """Has the subscribers that the test says; keeps what happened, in order."""

    def __init__(self, *audiences):
        self.unpublishable = {}
        self.audiences = [Audience(*each) for each in audiences]
        self.happened = []
        self.subscribed = {IMU}
        self.has_room = lambda: True
        self.finished = []
        self.late = ()
        self.looked = threading.Event()

    def audience(self):
        now = self.audiences.pop(0) if len(self.audiences) > 1 else self.audiences[0]
        self.happened.append(now)
        self.looked.set()
        return now

    def query_wanted(self):
        return frozenset(self.subscribed & {SCAN})

    def wanted(self, _now_ns):
        return self.query_wanted()

    def has_subscriber(self, outlet):
        return outlet in self.subscribed

    def publish(self, outlet, _data, _stamp_ns):
        self.happened.append(outlet)

    def may_begin(self, _frame, _seconds):
        return True

    def make_room(self, _outlet, _seconds):
        return self.has_room()

    def publish_time(self, _stamp_ns):
        pass

    def jump(self, _stamp_ns):
        pass

    def finish(self, seconds):
        self.finished.append(seconds)
        return self.late

    def close(self):
        self.happened.append('closed')


class Run:
    """A session that has begun."""

    def __init__(self, transport, program=None, **settings):
        self.said = []
        self.ended = threading.Event()
        self.session = Session(
            program or SmallProgram(),
            make_play_settings({'clock': 0, **settings}),
            lambda _: transport,
            self.said.append,
            lambda: None,
            self.said.append,
        )
        self.session.start(lambda error: (self.said.append(error), self.ended.set()))

    def to_the_end(self):
        assert self.ended.wait(PATIENCE_S)
        assert self.said.pop() is None
        self.session.stop()
        return self.session


@pytest.fixture(autouse=True)
def settled_at_once(monkeypatch):
    monkeypatch.setattr('kitti_ros2.player.session.SETTLED_NS', 0)


def test_lossless_publishes_nothing_before_a_subscriber_is_there():
    transport = FakeTransport((0, 0), (0, 0), (1, 2))
    run = Run(transport, lossless=True)
    run.to_the_end()
    assert transport.happened[:4] == [(0, 0), (0, 0), (1, 2), IMU]
    assert run.said == [
        'waiting for a subscriber; --wait-for 0 starts at once',
        'subscribers: 1, with 2 subscriptions',
    ]


def test_so_many_subscribers_are_waited_for():
    transport = FakeTransport((0, 0), (1, 30), (2, 31))
    run = Run(transport, wait_for=2)
    run.to_the_end()
    assert transport.happened[:3] == [(0, 0), (1, 30), (2, 31)]
    assert run.said[-1] == 'subscribers: 2, with 31 subscriptions'


@pytest.mark.parametrize('settings', [{}, {'lossless': True, 'wait_for': 0}])
def test_without_a_wait_it_begins_at_once(settings):
    transport = FakeTransport((0, 0))
    run = Run(transport, **settings)
    run.to_the_end()
    assert (0, 0) not in transport.happened
    assert run.said == []


def test_the_wait_ends_by_a_stop():
    transport = FakeTransport((0, 0))
    run = Run(transport, lossless=True)
    assert transport.looked.wait(PATIENCE_S)
    assert run.session.playback.state().waiting
    run.session.stop()
    assert run.ended.is_set()
    assert set(transport.happened) == {(0, 0), 'closed'}


def test_messages_that_nobody_receives_are_counted_made_or_not():
    transport = FakeTransport((0, 0))
    transport.subscribed = set()
    session = Run(transport).to_the_end()
    # Not the latched ones: they wait for whoever comes.
    assert session.reception.describe().startswith(f'{2 * POSITIONS} of {2 * POSITIONS} messages')
    assert SCAN not in transport.happened


def test_messages_before_the_first_subscriber_are_counted():
    transport = FakeTransport((0, 0))
    transport.subscribed = set()
    publish = transport.publish

    def publish_and_subscribe(outlet, data, stamp_ns):
        publish(outlet, data, stamp_ns)
        if transport.happened.count(IMU) == 2:
            transport.subscribed = {IMU}

    transport.publish = publish_and_subscribe
    text = Run(transport).to_the_end().reception.describe()
    assert text.startswith(f'{2 + POSITIONS} of {2 * POSITIONS} messages had no subscriber')
    assert '; 2 of these on topics that had one at another time' in text


class SlowProgram(SmallProgram):
    """Scans take until the gate is open. Keeps the positions begun without them."""

    def __init__(self):
        super().__init__()
        self.gate = threading.Event()
        self.begun = set()

    def fetch(self, index, wanted):
        if SCAN in wanted:
            assert self.gate.wait(PATIENCE_S)
        else:
            self.begun.add(index)
        return super().fetch(index, wanted)


def test_a_new_subscriber_holds_up_no_others():
    transport = FakeTransport((0, 0))
    program = SlowProgram()
    publish = transport.publish

    def publish_and_subscribe(outlet, data, stamp_ns):
        publish(outlet, data, stamp_ns)
        wait_until(lambda: len(program.begun) == POSITIONS)  # else they are made once, with scans
        transport.subscribed = {IMU, SCAN}
        if transport.happened.count(IMU) == POSITIONS:
            program.gate.set()

    transport.publish = publish_and_subscribe
    Run(transport, program, read_ahead=POSITIONS).to_the_end()
    assert transport.happened.count(IMU) == POSITIONS


class TimedProgram(SmallProgram):
    """Frames of three positions, the first ones not there until a gate is open."""

    def __init__(self):
        super().__init__()
        self.frames = np.repeat([7, 9], 3)
        self.gate = threading.Event()
        self.made_ns = {}

    def fetch(self, index, wanted):
        assert self.gate.wait(PATIENCE_S)
        made = super().fetch(index, wanted)
        self.made_ns.setdefault(index, time.monotonic_ns())
        return made


def test_time_begins_when_the_first_frame_is_there():
    program = TimedProgram()
    due_ns = []
    run = Run(FakeTransport((0, 0)), program)
    run.session.on_publish = lambda _outlet, due, _now: due_ns.append(due)
    threading.Timer(0.1, program.gate.set).start()
    assert run.session.playback.state().offset_ns == 0
    run.to_the_end()
    assert due_ns[0] >= max(program.made_ns[position] for position in range(3))


def test_after_a_jump_time_goes_on_when_its_frame_is_there():
    program = TimedProgram()
    program.gate.set()
    due_ns = []
    run = Run(FakeTransport((0, 0)), program, start_paused=True, read_ahead=1)
    run.session.on_publish = lambda _outlet, due, _now: due_ns.append(due)
    wait_until(lambda: 2 in program.made_ns)
    program.gate.clear()
    run.session.playback.seek_frame(9)
    run.session.playback.resume()
    threading.Timer(0.1, program.gate.set).start()
    run.to_the_end()
    assert due_ns[0] >= max(program.made_ns[position] for position in range(3, 6))


@pytest.mark.parametrize(
    'settings', [{'start_paused': True}, {'loop': 2, 'rate': 10.0}], ids=['long gaps', 'rounds']
)
def test_free_memory_is_given_back_where_nothing_is_due(settings, monkeypatch):
    given_back = threading.Event()
    monkeypatch.setattr(FreeMemory, 'give_back', lambda _: given_back.set())
    run = Run(FakeTransport((0, 0)), **settings)
    assert given_back.wait(PATIENCE_S)
    run.session.stop()


class CachedTransport(FakeTransport):
    """Sees a new subscriber only when it looks."""

    cached = frozenset()

    def query_wanted(self):
        self.cached = super().query_wanted()
        return self.cached

    def wanted(self, _now_ns):
        self.looked.set()
        return self.cached


def test_a_subscriber_that_comes_before_a_resume_misses_nothing():
    transport = CachedTransport((0, 0))
    run = Run(transport, start_paused=True)
    assert transport.looked.wait(PATIENCE_S)
    transport.subscribed = {IMU, SCAN}
    run.session.playback.resume()
    run.to_the_end()
    assert transport.happened.count(SCAN) == POSITIONS


def test_nothing_is_said_where_all_is_received():
    transport = FakeTransport((0, 0))
    transport.subscribed = {IMU, SCAN}
    assert Run(transport).to_the_end().reception.describe() == ''
    assert transport.happened.count(SCAN) == POSITIONS


def test_the_last_messages_have_a_bounded_time_to_arrive():
    transport = FakeTransport((0, 0))
    run = Run(transport)
    run.to_the_end()
    assert transport.finished == [LAST_WAIT_S]
    assert LAST_WAIT_S < 2
    assert run.said == []


@pytest.mark.parametrize('lossless', [False, True])
def test_topics_whose_last_messages_did_not_arrive_are_named(lossless):
    transport = FakeTransport((0, 0))
    transport.late = ('/scan', '/imu')
    run = Run(transport, lossless=lossless, wait_for=0)
    session = run.to_the_end()
    assert session.late == ('/scan', '/imu')
    assert [text.split(':')[0] for text in run.said] == ['/scan, /imu'] * lossless


def test_a_stop_while_there_is_no_room_publishes_no_more_and_waits_less():
    transport = FakeTransport((0, 0))
    asked = threading.Event()

    def has_no_room():
        asked.set()
        return False

    transport.has_room = has_no_room
    run = Run(transport, lossless=True, wait_for=0)
    assert asked.wait(PATIENCE_S)
    run.session.stop()
    assert run.ended.is_set()
    assert transport.happened == ['closed']
    (seconds,) = transport.finished
    assert seconds < LAST_WAIT_S
    assert run.session.late == ()
