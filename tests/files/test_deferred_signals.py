# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Signals are handled after the context, once, and only those that are handled at all."""

from __future__ import annotations

import signal
import threading
from itertools import count

import pytest

from kitti_ros2.files.threads import DeferredSignals, deferred_signals


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


def test_a_signal_is_handled_while_handlers_change(caught, monkeypatch):
    change = signal.signal
    for number in count(1):
        left = number

        def strike(*handler):
            nonlocal left
            left -= 1
            if not left:
                signal.raise_signal(signal.SIGTERM)
            return change(*handler)

        with monkeypatch.context() as patch:
            patch.setattr(signal, 'signal', strike)
            with deferred_signals():
                pass
        if left > 0:
            break
        assert len(caught) == number
    assert number > 2  # one at least when it begins, and one when it ends


def test_a_hold_that_ends_before_a_later_one_still_hands_on(caught):
    first, second = DeferredSignals(), DeferredSignals()
    first.close()
    signal.raise_signal(signal.SIGTERM)
    second.close()
    signal.raise_signal(signal.SIGTERM)
    assert len(caught) == 2


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
