# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The queue of messages that wait for a viewer."""

import asyncio
import struct

import pytest

pytest.importorskip('websockets', reason='needs websockets (pip install kitti_ros2[foxglove])')

from kitti_ros2.viewers import foxglove_proxy
from kitti_ros2.viewers.foxglove_proxy import QueueFullError, SendQueue

MESSAGE, TIME, PLAYBACK = 1, 2, 5


def message(number, size=100):
    return bytes([MESSAGE]) + struct.pack('<I', number) + bytes(size)


def filled(*messages):
    queue = SendQueue()
    for data in messages:
        queue.put(data)
    return queue


def drain(queue):
    """All that a queue returns, to its end."""

    async def take_all():
        queue.end()
        taken = []
        while (data := await queue.get()) is not None:
            taken.append(data)
        return taken

    return asyncio.run(take_all())


def test_everything_is_sent_in_order_while_there_is_room():
    messages = [message(1), '{}', message(2), bytes([PLAYBACK]), b'', message(3)]
    queue = filled(*messages)
    assert drain(queue) == messages
    assert queue.dropped == 0


def test_the_oldest_messages_are_dropped_and_no_control(monkeypatch):
    monkeypatch.setattr(foxglove_proxy, 'MESSAGE_LIMIT', 3 * len(message(0)))
    controls = [f'\1{number}' for number in range(50)]
    queue = SendQueue()
    for number, control in enumerate(controls):
        queue.put(message(number))
        queue.put(control)
    sent = drain(queue)
    assert [data for data in sent if isinstance(data, str)] == controls
    assert [number for number in range(50) if message(number) in sent] == [47, 48, 49]
    assert queue.dropped == 47


def test_of_times_the_newest_is_sent():
    times = [bytes([TIME, number, 0, 0, 0, 0, 0, 0, 0]) for number in range(9)]
    queue = filled(*times[:5], '{}', *times[5:])
    assert drain(queue) == ['{}', times[-1]]


def test_a_message_larger_than_the_limit_is_sent_alone(monkeypatch):
    monkeypatch.setattr(foxglove_proxy, 'MESSAGE_LIMIT', 50)
    assert drain(filled(message(1), message(2))) == [message(2)]


def test_what_was_sent_makes_room(monkeypatch):
    monkeypatch.setattr(foxglove_proxy, 'MESSAGE_LIMIT', 2 * len(message(0)))
    monkeypatch.setattr(foxglove_proxy, 'CONTROL_LIMIT', 100)

    async def pass_through(queue):
        for number in range(10):
            queue.put(message(number))
            queue.put('x' * 60)
            queue.put(bytes([TIME]) + bytes(8))
            assert await queue.get() == message(number)
            await queue.get()
            await queue.get()

    queue = SendQueue()
    asyncio.run(pass_through(queue))
    assert drain(queue) == []
    assert queue.dropped == 0


def test_controls_that_nobody_reads_end_it(monkeypatch):
    monkeypatch.setattr(foxglove_proxy, 'CONTROL_LIMIT', 1000)
    queue = filled(*['x' * 100] * 10)
    with pytest.raises(QueueFullError, match='1000 bytes of controls wait'):
        queue.put('x')
