# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fetching ahead: what comes, in which order, and how much of it waits."""

from __future__ import annotations

import os
import threading
from concurrent.futures import wait

import numpy as np
import pytest

from kitti_ros2.messages.cdr import Message
from kitti_ros2.player.program import ReadAhead

from broken_lock import strike_each_lock  # isort: skip
from waiting import PATIENCE_S  # isort: skip

TOTAL = 20
ALL = frozenset({0, 1})


class Counting:
    """A program of one message a position; it knows what was fetched, and may fail or wait."""

    def __init__(self, workers=1, total=TOTAL):
        self.stamps_ns = np.arange(total)
        self.workers = workers
        self.fetched = []
        self.failing = set()
        self.gate = threading.Event()
        self.gate.set()

    def fetch(self, index, wanted):
        self.fetched.append((index, frozenset(wanted)))
        assert self.gate.wait(PATIENCE_S)
        if index in self.failing:
            raise ZeroDivisionError(f'at {index}')
        return [Message(0, index, (repr(sorted(wanted)).encode(),))], []

    @property
    def positions(self):
        return [index for index, _ in self.fetched]


def stamps(fetched):
    due, missing = fetched
    assert missing == []
    return [message.stamp_ns for message in due]


def settle(ahead, program):
    """Wait for all fetches that were started; return how many there were so far."""
    wait(
        {each._fetched for each in ahead._ahead}
        | {each._again or each._fetched for each in ahead._ahead}
    )
    return len(program.fetched)


@pytest.fixture(params=[1, 4], ids=['one worker', 'four workers'])
def program(request):
    return Counting(request.param)


@pytest.mark.parametrize('samples', [1, 3, 100])
@pytest.mark.parametrize('polite', [True, False])
def test_messages_come_in_order_and_each_is_fetched_once(program, samples, polite):
    with ReadAhead(program, samples, polite=polite) as ahead:
        for position in range(TOTAL):
            assert stamps(ahead.take(position)) == [position]
            if position + samples < TOTAL:
                ahead.refill()
    assert sorted(program.positions) == list(range(TOTAL))


def test_the_beginning_follows_the_end(program):
    with ReadAhead(program, 4, polite=False) as ahead:
        for _ in range(3):
            for position in range(TOTAL):
                ahead.refill()
                assert stamps(ahead.take(position)) == [position]
    assert len(program.fetched) <= 3 * TOTAL + 4


@pytest.mark.parametrize('samples', [1, 3, 100])
def test_what_is_prepared_is_there(program, samples):
    program.failing.add(9)
    with ReadAhead(program, 4, polite=False) as ahead:
        ahead.refill()
        for position in (0, 8, 18):
            ahead.prepare(position, samples)
            ready = [each._fetched.done() for each in ahead._ahead]
            assert ready[: min(samples, 4)] == [True] * min(samples, 4)
            assert stamps(ahead.take(position)) == [position]
        ahead.prepare(9, samples)
        with pytest.raises(ZeroDivisionError):
            ahead.take(9)


def test_a_jump_forgets_what_was_ahead(program):
    with ReadAhead(program, 4, polite=False) as ahead:
        for position in (0, 1, 7, 8, 3, 3, 19, 0, 5):
            assert stamps(ahead.take(position)) == [position]
            ahead.refill()


def test_never_more_than_the_samples_are_ahead(program):
    with ReadAhead(program, 6, polite=False) as ahead:
        ahead.refill()
        ahead.refill()
        assert settle(ahead, program) == 6
        ahead.take(0)
        assert settle(ahead, program) == 6
        ahead.refill()
        assert settle(ahead, program) == 7
        assert sorted(program.positions) == list(range(7))


def test_a_short_program_is_not_fetched_twice_ahead():
    program = Counting(total=3)
    with ReadAhead(program, 100, polite=False) as ahead:
        ahead.refill()
        assert settle(ahead, program) == 3


def test_low_is_less_than_half(program):
    with ReadAhead(program, 4, polite=False) as ahead:
        assert ahead.low()
        ahead.refill()
        lows = []
        for position in range(3):
            ahead.take(position)
            lows.append(ahead.low())
        assert lows == [False, False, True]


def test_a_new_outlet_wanted_is_fetched_again(program):
    with ReadAhead(program, 4, polite=False) as ahead:
        ahead.want(frozenset({0}))
        ahead.refill()
        assert ahead.take(0)[0][0].data == b'[0]'
        ahead.want(ALL)
        for position in range(1, 6):
            assert ahead.take(position) == ([Message(0, position, (b'[0, 1]',))], [])


def test_a_new_outlet_holds_nothing_up(program):
    with ReadAhead(program, 4, polite=False) as ahead:
        ahead.want(frozenset({0}))
        ahead.refill()
        settle(ahead, program)
        program.gate.clear()
        ahead.want(ALL, at_once=False)
        assert [ahead.take(position)[0][0].data for position in (0, 1)] == [b'[0]'] * 2
        ahead.want(frozenset({0, 1, 2}), at_once=False)
        program.gate.set()
        settle(ahead, program)
        found = [ahead.take(position)[0][0].data for position in (2, 3, 4)]
        assert found == [b'[0, 1, 2]'] * 3


@pytest.mark.parametrize('at_once', [True, False])
def test_what_had_not_begun_is_fetched_once(at_once):
    program = Counting(workers=1)
    program.gate.clear()
    with ReadAhead(program, 4, polite=False) as ahead:
        ahead.want(frozenset({0}))
        ahead.refill()
        ahead.want(ALL, at_once=at_once)
        ahead.refill()
        program.gate.set()
        found = [ahead.take(position)[0][0].data for position in range(5)]
    assert found[1:] == [b'[0, 1]'] * 4
    assert len(program.fetched) <= 6


def test_an_outlet_less_fetches_nothing_again(program):
    with ReadAhead(program, 4, polite=False) as ahead:
        ahead.want(ALL)
        ahead.refill()
        ahead.want(frozenset({1}))
        ahead.want(frozenset({1}))
        assert [ahead.take(position)[0][0].data for position in range(5)] == [
            *([b'[0, 1]'] * 4),
            b'[1]',
        ]
    assert sorted(program.positions) == list(range(5))


def test_what_a_fetch_raises_comes_with_its_position(program):
    program.failing = {3}
    with ReadAhead(program, 6, polite=False) as ahead:
        ahead.refill()
        for position in range(3):
            assert stamps(ahead.take(position)) == [position]
        with pytest.raises(ZeroDivisionError, match='at 3'):
            ahead.take(3)
        assert stamps(ahead.take(4)) == [4]


def test_what_is_not_taken_may_fail(program):
    program.failing = {1, 2, 3}
    with ReadAhead(program, 6, polite=False) as ahead:
        ahead.refill()
        assert stamps(ahead.take(0)) == [0]
        assert stamps(ahead.take(4)) == [4]


def leave(program, error):
    """Enter, fill and leave; the fetches under way can end when the leaving waits for them."""
    with ReadAhead(program, TOTAL, polite=False) as ahead:
        shutdown = ahead._pool.shutdown
        ahead._pool.shutdown = lambda **options: (program.gate.set(), shutdown(**options))
        program.gate.clear()
        ahead.refill()
        if error is not None:
            raise error


@pytest.mark.parametrize('error', [None, KeyError('x')])
def test_leaving_waits_for_the_fetches_under_way_alone(program, error):
    before = threading.active_count()
    try:
        leave(program, error)
    except KeyError as caught:
        assert caught is error  # noqa: PT017 - the same object
    assert len(program.fetched) <= program.workers
    assert threading.active_count() <= before


def test_one_worker_fetches_one_at_a_time_even_after_jumps():
    busy = threading.Lock()
    program = Counting()
    fetch = program.fetch

    def guarded(index, wanted):
        if not busy.acquire(blocking=False):
            raise AssertionError('two at once')
        try:
            os.sched_yield()  # to another thread, if there is one
            return fetch(index, wanted)
        finally:
            busy.release()

    program.fetch = guarded
    with ReadAhead(program, 5, polite=False) as ahead:
        for position in (0, 9, 2, 15, 7, 8, 1):
            assert stamps(ahead.take(position)) == [position]
            ahead.refill()


def test_threads_end_whenever_a_handler_raises(program, monkeypatch):
    def play():
        with ReadAhead(program, 3, polite=False) as ahead:
            ahead.want(frozenset({0}))
            ahead.prepare(0, 2)
            for position in range(4):
                ahead.take(position)
                ahead.want(ALL, at_once=False)
                ahead.refill()

    strike_each_lock(play, monkeypatch)
