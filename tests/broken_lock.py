# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Locks that an interruption breaks."""

import signal
import threading
from itertools import count


def break_a_lock(lock, error):
    """Raise an error as threading.Condition.wait does while it has released its lock."""
    condition = threading.Condition(lock())
    with condition:
        condition.release()
        raise error


class _Strike:
    """Raises SIGINT right after the main thread has taken the n-th lock of a condition."""

    def __init__(self, monkeypatch, number):
        self._left = number
        main, taken = threading.main_thread().ident, threading.Condition.__enter__

        def take(condition):
            found = taken(condition)
            if threading.get_ident() == main:
                self._left -= 1
                if not self._left:
                    signal.raise_signal(signal.SIGINT)
            return found

        monkeypatch.setattr(threading.Condition, '__enter__', take)

    @property
    def has_struck(self):
        return self._left <= 0


def strike_each_lock(work, monkeypatch):
    """Let a handler raise after each lock of a condition; assert that it does, and threads end."""
    threads = set(threading.enumerate())
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs ignore it
    try:
        for number in count(1):
            with monkeypatch.context() as patch:
                strike = _Strike(patch, number)
                try:
                    work()
                except KeyboardInterrupt:
                    pass
                else:
                    assert not strike.has_struck, 'the signal was lost'
            assert set(threading.enumerate()) <= threads
            if not strike.has_struck:
                break
    finally:
        signal.signal(signal.SIGINT, before)
    assert number > 1
