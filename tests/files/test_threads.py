# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Threads end, whenever a signal's handler raises; tasks give what their calls did."""

import threading
import weakref
from functools import partial
from queue import SimpleQueue

import pytest

from kitti_ros2.files.threads import OrderedPool, SpareThreads, Threads, ThreadTask, ordered_map

from broken_lock import strike_each_lock  # isort: skip
from waiting import PATIENCE_S, wait_until  # isort: skip


def put_and_drain():
    with OrderedPool(2, 2) as pool:
        for number in range(6):
            pool.put(partial(str, number))
        list(pool.drain())


def leave_early():
    with OrderedPool(2, 2) as pool:
        for number in range(4):
            pool.put(partial(str, number))


def submit_spare():
    threads = SpareThreads()
    try:
        tasks = [threads.submit(divmod, number, 2) for number in range(6)]
        assert [task and task.result() for task in tasks]
    finally:
        threads.close()


def take_in_any_order():
    ended = SimpleQueue()
    with Threads(2, 'worker') as threads:
        for number in range(4):
            threads.submit(partial(str, number), ended)
        assert {ended.get().result() for _ in range(4)} == {'0', '1', '2', '3'}


WORKS = {
    'put and drain': put_and_drain,
    'leave early': leave_early,
    'map': lambda: list(ordered_map(str, range(9), 2, 2)),
    'spare': submit_spare,
    'in any order': take_in_any_order,
}


@pytest.mark.parametrize('work', WORKS)
def test_threads_end_whenever_a_handler_raises(work, monkeypatch):
    strike_each_lock(WORKS[work], monkeypatch)


def test_a_task_gives_the_result_or_the_error_of_its_call():
    with Threads(1, 'worker') as threads:
        good, bad = threads.submit(lambda: 7), threads.submit(lambda: 1 // 0)
        assert (good.result(), good.error(), good.has_failed()) == (7, None, False)
        for _ in range(2):
            with pytest.raises(ZeroDivisionError):
                bad.result()
        assert isinstance(bad.error(), ZeroDivisionError)
        assert bad.has_failed()


def test_a_task_that_is_cancelled_makes_no_call():
    made = []
    task = ThreadTask(lambda: made.append(1))
    task.cancel()
    task.run()
    with pytest.raises(RuntimeError, match='cancelled'):
        task.result()
    assert made == []


def test_closing_ends_tasks_that_wait():
    begun = threading.Event()

    def first():
        begun.set()
        wait_until(lambda: len(tasks) == 2 and tasks[1].has_failed())

    threads, tasks = Threads(1, 'worker'), []
    tasks.append(threads.submit(first))
    tasks.append(threads.submit(str))
    assert begun.wait(PATIENCE_S)
    threads.close()
    assert not tasks[0].has_failed()
    assert tasks[1].has_failed()


def test_a_thread_forgets_what_it_has_done():
    class Large:
        pass

    with Threads(1, 'worker') as threads:
        large = Large()
        gone = weakref.ref(large)
        assert threads.submit(partial(id, large)).result()
        del large
        threads.submit(str).result()
        assert gone() is None


def test_fewer_threads_where_the_system_has_no_more(monkeypatch):
    start = threading.Thread.start

    def refuse(thread):
        if thread.name.endswith('_1'):
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, 'start', refuse)
    with Threads(3, 'worker') as threads:
        assert [threads.submit(partial(str, n)).result() for n in range(5)] == [*'01234']
