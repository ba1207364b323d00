# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Answers to frames: when the next one is sent, latency, and what is missing."""

import threading

import pytest

from kitti_ros2.player.playback import MOST_ON_THE_WAY, Answers

from waiting import PATIENCE_S  # isort: skip

S = 1_000_000_000
TIMEOUT_NS = 30 * S
FRAMES = (0, 3, 7, 8, 20)
"""Numbers with holes."""
STAMPS = {number: 1_317_000_000 * S + n * 103_600_123 for n, number in enumerate(FRAMES)}


class Run:
    """Answers with a clock that is set by hand."""

    def __init__(self):
        self.now_ns = 5 * S
        self.answers = Answers(TIMEOUT_NS, lambda: self.now_ns)

    def send(self, *numbers):
        for number in numbers:
            self.answers.sent(number, STAMPS[number], scan=True)

    def answer(self, *numbers, after_ms=0):
        self.now_ns += after_ms * 1_000_000
        for number in numbers:
            self.answers.received(STAMPS[number])

    def may_begin(self, after_s=0):
        self.now_ns += int(after_s * S)
        return self.answers.may_begin(0)


@pytest.fixture
def run():
    return Run()


def test_a_frame_is_sent_when_the_one_before_is_answered(run):
    assert run.may_begin()
    run.send(0)
    assert not run.may_begin()
    run.answer(0)
    assert run.may_begin()


def test_one_more_is_sent_if_no_answer_comes(run):
    """A synchroniser answers a frame when it has the next one."""
    run.send(0)
    assert not run.may_begin(9.9)  # the first frame takes longest
    assert run.may_begin(0.1)
    run.send(3)
    run.answer(0)
    assert run.may_begin()
    run.send(7)
    assert not run.may_begin()
    run.answer(3)
    assert run.may_begin()
    assert run.answers.on_the_way == 2


def test_how_long_an_answer_is_waited_for_follows_the_longest(run):
    run.send(0)
    run.answer(0, after_ms=100)
    run.send(3)
    assert not run.may_begin(1.9)
    assert run.may_begin(0.1)
    run.answer(3, after_ms=0)  # 2 s after it was sent
    run.send(7)
    assert not run.may_begin(9.9)
    assert run.may_begin(0.1)


def test_after_a_slow_start_frames_go_one_by_one_again(run):
    run.send(0)
    assert run.may_begin(10)
    run.send(3)
    run.answer(0, 3)
    run.send(7)
    assert not run.may_begin()


def test_frames_that_are_skipped_cost_one_wait(run):
    run.send(0)
    run.answer(0, after_ms=1)
    run.send(3)
    assert run.may_begin(2)
    run.send(7)
    run.answer(7)
    run.send(8)
    assert run.may_begin()
    run.send(20)
    run.answer(20)
    assert sorted(run.answers.latencies_ns) == [0, 7, 20]
    assert run.answers.frames() == FRAMES


def test_no_more_are_on_their_way_than_a_queue_holds(run):
    for number in range(MOST_ON_THE_WAY):
        assert run.may_begin(10)
        run.answers.sent(number, number * S, scan=True)
    assert not run.may_begin(1000)


def test_latency_counts_from_the_scan(run):
    run.answers.sent(0, STAMPS[0] + 5_000_000, scan=False)  # an image
    run.now_ns += 3_000_000
    run.send(0)
    run.answer(0, after_ms=20)
    assert run.answers.latencies_ns == {0: 20_000_000}


def test_without_a_scan_it_counts_from_the_first_sample(run):
    run.answers.sent(0, STAMPS[0], scan=False)
    run.now_ns += 3_000_000
    run.answers.sent(0, STAMPS[0], scan=False)
    run.answer(0, after_ms=20)
    assert run.answers.latencies_ns == {0: 23_000_000}


def test_a_sample_after_the_answer_does_not_open_its_frame_again(run):
    run.send(0)
    run.answer(0)
    run.answers.sent(0, STAMPS[0] + 5_000_000, scan=False)
    assert run.may_begin()
    assert run.answers.all_in()


def test_an_answer_after_that_to_a_later_frame_is_a_straggler(run):
    run.send(0, 3)
    run.answer(3)
    assert run.answers.stragglers == 0
    run.answer(0)
    assert run.answers.stragglers == 1
    assert sorted(run.answers.latencies_ns) == [0, 3]


def test_further_messages_and_other_stamps_are_counted(run):
    run.send(0, 3)
    run.answer(0, 0, 0)
    run.answers.received(1_700_000_000 * S)
    run.answers.received(0)
    assert (run.answers.repeated, run.answers.strays) == (2, 2)
    assert run.answers.first_stray_ns == 1_700_000_000 * S
    assert run.answers.messages == 5
    assert [*run.answers.latencies_ns] == [0]


def test_odometry_may_have_a_higher_rate(run):
    run.send(0, 3)
    run.answers.received((STAMPS[0] + STAMPS[3]) // 2)
    run.answers.received(STAMPS[0] - 50_000_000)
    assert (run.answers.between, run.answers.strays) == (1, 1)
    assert run.answers.latencies_ns == {}


def test_a_message_before_the_first_frame_answers_none(run):
    run.answers.received(STAMPS[0])
    run.answers.received(None)
    assert run.answers.strays == 2
    assert run.answers.first_stray_ns == STAMPS[0]


def test_stamps_may_have_passed_through_float_seconds(run):
    run.send(*FRAMES)
    for number in FRAMES:
        run.answers.received(int(STAMPS[number] / 1e9 * 1e9))
    assert sorted(run.answers.latencies_ns) == sorted(FRAMES)


def test_a_message_without_a_stamp_answers_the_frame_that_waits_longest(run):
    run.send(0, 3)
    run.answers.received(None)
    assert [*run.answers.latencies_ns] == [0]


def test_all_are_in_when_no_answer_comes_any_more(run):
    run.send(0)
    run.answer(0)
    run.send(3)
    assert not run.answers.all_in()
    run.now_ns += 2 * S
    assert run.answers.all_in()


def test_it_is_silent_if_frames_wait_for_the_whole_time_limit(run):
    assert not run.answers.silent()
    run.now_ns += 2 * TIMEOUT_NS
    assert not run.answers.silent()
    run.send(0)
    run.now_ns += TIMEOUT_NS - 1
    assert not run.answers.silent()
    run.send(3)
    run.now_ns += 1
    assert run.answers.silent()
    run.answer(0)
    assert not run.answers.silent()


def test_a_flood_is_far_more_messages_than_frames(run):
    run.send(0)
    run.answer(*[0] * 1100)
    assert not run.answers.flooded()
    run.answer(0)
    assert run.answers.flooded()


def test_an_answer_ends_the_wait_at_once():
    answers = Answers(TIMEOUT_NS)
    answers.sent(0, STAMPS[0], scan=True)
    thread = threading.Thread(target=lambda: answers.received(STAMPS[0]))
    thread.start()
    assert answers.may_begin(PATIENCE_S)
    thread.join()
