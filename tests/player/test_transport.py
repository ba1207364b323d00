# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The wait for subscribers, and the count of messages without one."""

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.player.session import SETTLED_NS, Audience, Reception, SubscriberWait

MS = 1_000_000


def begins(needed, audiences):
    """When the wait is over; audiences as (nanoseconds, subscribers, subscriptions)."""
    wait = SubscriberWait(needed)
    for now_ns, *audience in audiences:
        if wait.over(Audience(*audience), now_ns):
            return now_ns
    return None


def every_50_ms(*changes):
    """What a look every 50 ms sees for 10 s, the changes as (seconds, subscribers, count)."""
    for now in range(0, 10_000, 50):
        past = [audience for seconds, *audience in changes if seconds * 1000 <= now]
        yield (now * MS, *(past[-1] if past else (0, 0)))


def test_a_recorder_that_subscribes_one_by_one_is_waited_for():
    steps = [(2 + count * 0.4, 1, count + 1) for count in range(12)]
    last_ns = int(steps[-1][0] * 1000) * MS
    assert begins(1, every_50_ms(*steps)) == last_ns + SETTLED_NS


def test_the_second_subscriber_is_waited_for_however_late():
    assert begins(2, every_50_ms((0.5, 1, 30), (6, 2, 31))) == 6000 * MS + SETTLED_NS
    assert begins(2, every_50_ms((0.5, 1, 30))) is None


def test_one_that_leaves_is_not_counted():
    assert begins(1, every_50_ms((1, 1, 4), (1.5, 0, 0))) is None
    assert begins(1, every_50_ms((1, 1, 4), (1.5, 0, 0), (5, 1, 4))) == 5000 * MS + SETTLED_NS


@given(
    st.integers(1, 3),
    st.lists(
        st.tuples(st.integers(1, 2 * SETTLED_NS), st.integers(0, 4), st.integers(0, 9)),
        min_size=1,
        max_size=30,
    ),
)
def test_it_begins_with_enough_of_them_and_after_a_second_without_change(needed, looks):
    times = list(accumulate(pause for pause, _, _ in looks))
    seen = [(now, *audience) for now, (_, *audience) in zip(times, looks, strict=True)]
    begin = begins(needed, seen)
    for index, (now, subscribers, subscriptions) in enumerate(seen):
        same_since = now
        for before in reversed(seen[: index + 1]):
            if before[1:] != (subscribers, subscriptions):
                break
            same_since = before[0]
        settled = now - same_since >= SETTLED_NS and subscribers >= needed
        if begin is not None and now == begin:
            assert settled
            return
        assert not settled
    assert begin is None


@pytest.mark.parametrize(
    ('needed', 'text'), [(1, 'waiting for a subscriber'), (4, 'waiting for 4 subscribers')]
)
def test_the_wait_says_for_whom(needed, text):
    assert SubscriberWait(needed).beginning().startswith(text)


def received(*notes):
    reception = Reception()
    for outlet, was_received in notes:
        reception.note(outlet, received=was_received)
    return reception.describe()


def test_nothing_is_said_where_all_were_received():
    assert received() == ''
    assert received((3, True), (3, True), (7, True)) == ''


def test_messages_without_a_subscriber_are_counted():
    text = received((3, False), (3, False), (7, True))
    assert text == '2 of 3 messages had no subscriber (latched ones are not counted)'


def test_those_of_a_topic_that_had_a_subscriber_are_counted_apart():
    text = received(*[(3, False)] * 150, *[(3, True)] * 5, *[(7, False)] * 45)
    assert '195 of 200 messages had no subscriber' in text
    assert text.endswith('; 150 of these on topics that had one at another time')
