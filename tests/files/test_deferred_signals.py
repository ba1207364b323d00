# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Signals are handled after the context, once, and only those that are handled at all."""

from __future__ import annotations

import signal
import threading

import pytest

from kitti_ros2.files.signal_hold import deferred_signals


@pytest.fixture
def caught():
    """The signals that were handled; SIGHUP is ignored."""
    found = []
    before = {signal.SIGTERM: signal.signal(signal.SIGTERM, lambda number, _: found.append(number))}
    before[signal.SIGHUP] = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    yield found
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_signal_waits_for_the_end(caught):
    with deferred_signals():
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        assert caught == []
    assert caught == [signal.SIGTERM]
    signal.raise_signal(signal.SIGTERM)
    assert len(caught) == 2


def test_an_ignored_signal_stays_ignored(caught):
    with deferred_signals():
        signal.raise_signal(signal.SIGHUP)
    assert caught == []


def test_an_error_does_not_lose_a_signal(caught):
    def fail():
        with deferred_signals():
            signal.raise_signal(signal.SIGTERM)
            raise OSError('disk')

    with pytest.raises(OSError, match='disk'):
        fail()
    assert caught == [signal.SIGTERM]


@pytest.mark.usefixtures('caught')
def test_other_threads_leave_the_handlers_alone():
    handlers = []

    def work():
        with deferred_signals():
            handlers.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=work)
    before = signal.getsignal(signal.SIGTERM)
    thread.start()
    thread.join()
    assert handlers == [before]
