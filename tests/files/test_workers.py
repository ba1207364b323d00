# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ordered pool and map: the same results as map, whatever the workers; never far ahead."""

import os
import signal
import threading
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.files.threads import OrderedPool, SpareThreads, ordered_map, worker_count

from waiting import PATIENCE_S, wait_until  # isort: skip


@given(st.lists(st.integers(), max_size=60), st.integers(1, 4), st.integers(1, 9))
def test_it_is_map(items, workers, batch):
    assert list(ordered_map(str, items, workers, batch)) == [*map(str, items)]


@pytest.mark.parametrize('batch', [1, 8])
def test_it_takes_a_few_batches_ahead_only(batch):
    taken = []
    results = ordered_map(lambda item: item, (taken.append(n) or n for n in range(1000)), 1, batch)
    assert next(results) == 0
    assert len(taken) <= 5 * batch
    results.close()


def test_an_error_comes_in_its_place():
    results = ordered_map(lambda item: 1 // item, [1, 1, 0, 1], 1, 2)
    assert next(results) == 1
    with pytest.raises(ZeroDivisionError):
        list(results)


def test_a_pool_takes_results_in_order_and_only_when_it_is_full():
    with OrderedPool(2, ahead=1) as pool:
        results = [pool.put(partial(str, number)) for number in range(5)]
        assert results == [[], [], [], ['0'], ['1']]
        assert list(pool.drain()) == ['2', '3', '4']


def test_a_closed_pool_cancels_what_has_not_begun():
    begun, has_begun, pending = [], threading.Event(), []

    def task(number):
        begun.append(number)
        has_begun.set()
        wait_until(lambda: pending and pending[-1].has_failed())

    pool = OrderedPool(1, ahead=5)
    for number in range(5):
        pool.put(partial(task, number))
    assert has_begun.wait(PATIENCE_S)
    pending.extend(pool._pending)
    pool.close()
    assert begun == [0]
    assert list(pool.drain()) == []


def test_a_signal_does_not_cut_the_wait_for_its_threads(monkeypatch):
    begun, go, closing, handled = (threading.Event() for _ in range(4))
    cut, ended = [], []

    def task():
        begun.set()
        assert go.wait(PATIENCE_S)
        ended.append(True)

    def handle(*_):
        handled.set()
        raise KeyboardInterrupt

    def interrupt():
        assert closing.wait(PATIENCE_S)
        os.kill(os.getpid(), signal.SIGINT)
        cut.append(handled.wait(0.3))
        go.set()

    pool = OrderedPool(1, ahead=1)
    close_threads = pool._threads.close
    monkeypatch.setattr(pool._threads, 'close', lambda: (closing.set(), close_threads()))
    pool.put(task)
    assert begun.wait(PATIENCE_S)
    before = signal.signal(signal.SIGINT, handle)
    try:
        threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt):
            pool.close()
        assert (cut, ended) == ([False], [True])
    finally:
        signal.signal(signal.SIGINT, before)


def test_workers_are_as_many_as_the_processors_up_to_a_bound(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(12)))
    assert (worker_count(), worker_count(4), worker_count(None)) == (8, 4, 12)


@pytest.mark.parametrize(('available', 'has_threads'), [(1, False), (2, True)])
def test_there_are_spare_threads_where_there_are_processors(available, has_threads, monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(available)))
    threads = SpareThreads()
    task = threads.submit(divmod, 7, 2)
    assert (task is not None) == has_threads
    assert task is None or task.result() == (3, 1)
    threads.close()


def test_without_a_thread_left_there_are_no_spare_ones(monkeypatch):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1})

    def refuse(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, 'start', refuse)
    threads = SpareThreads()
    assert [threads.submit(str), threads.submit(str)] == [None, None]
    threads.close()
