# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Frames in a stream, and the queue of those that wait for a viewer."""

import socket
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.viewers import foxglove_gate
from kitti_ros2.viewers.foxglove_gate import Outbox
from kitti_ros2.viewers.websocket import FrameError, FrameKind, FrameReader, kind_of

from waiting import PATIENCE_S  # isort: skip

TEXT, BINARY, CONTINUATION, PING = 1, 2, 0, 9
MESSAGE, TIME, PLAYBACK = 1, 2, 5


def frame(payload, opcode=BINARY, *, fin=True, mask=b''):
    """As RFC 6455 section 5.2 says."""
    first, masked, size = opcode | fin << 7, bool(mask) << 7, len(payload)
    if size < 126:
        head = struct.pack('>BB', first, masked | size)
    elif size < 65536:
        head = struct.pack('>BBH', first, masked | 126, size)
    else:
        head = struct.pack('>BBQ', first, masked | 127, size)
    return head + mask + payload


def message(number, size=100):
    return frame(bytes([MESSAGE]) + struct.pack('<I', number) + bytes(size))


class Pieces:
    """A socket that receives bytes in pieces."""

    def __init__(self, data, sizes):
        self.data, self.sizes = data, iter(sizes)

    def _take(self, most):
        count = min(most, next(self.sizes, most))
        taken, self.data = self.data[:count], self.data[count:]
        return taken

    recv = _take

    def recv_into(self, buffer):
        taken = self._take(len(buffer))
        buffer[: len(taken)] = taken
        return len(taken)


def read_all(reader, pieces):
    found = []
    while (frames := reader.receive(pieces)) is not None:
        found += frames
    return found


@given(
    payloads=st.lists(st.one_of(st.binary(max_size=300), st.just(bytes(70_000))), max_size=8),
    sizes=st.lists(st.integers(1, 400), max_size=200),
    mask=st.sampled_from([b'', b'\1\2\3\4']),
)
def test_frames_are_found_however_they_arrive(payloads, sizes, mask):
    frames = [frame(each, mask=mask) for each in payloads]
    assert read_all(FrameReader(), Pieces(b''.join(frames), sizes)) == frames


def test_a_long_message_is_refused_before_there_is_memory_for_it():
    head = struct.pack('>BBQ', 0x82, 0xFF, 1 << 62)
    with pytest.raises(FrameError, match='longer than 1000 bytes'):
        FrameReader(1000).receive(Pieces(head, []))


def test_a_message_of_many_fragments_is_as_long_as_all_of_them():
    part = frame(bytes(300), CONTINUATION, fin=False)
    pieces = Pieces(frame(bytes(300), BINARY, fin=False) + frame(b'', PING) + part * 3, [])
    with pytest.raises(FrameError, match='longer than 1000 bytes'):
        read_all(FrameReader(1000), pieces)


def test_many_short_messages_are_not_one_long_one():
    whole = frame(bytes(300), BINARY, fin=False) + frame(bytes(300), CONTINUATION)
    assert len(read_all(FrameReader(1000), Pieces(whole * 20, []))) == 40


@pytest.mark.parametrize(
    ('data', 'kind'),
    [
        (message(1), FrameKind.MESSAGE),
        (message(1, 1000), FrameKind.MESSAGE),
        (message(1, 70_000), FrameKind.MESSAGE),
        (frame(bytes([TIME]) + bytes(8)), FrameKind.TIME),
        (frame(bytes([PLAYBACK]) + bytes(20)), FrameKind.CONTROL),
        (frame(b'\1{"op": "advertise"}', TEXT), FrameKind.CONTROL),
        (frame(bytes([MESSAGE]), BINARY, fin=False), FrameKind.CONTROL),
        (frame(b'\1', PING), FrameKind.CONTROL),
        (frame(b'', BINARY), FrameKind.CONTROL),
    ],
)
def test_only_messages_and_times_may_be_dropped(data, kind):
    assert kind_of(data) is kind


def drain(box):
    """All that a queue sends, through a real socket."""
    ours, theirs = socket.socketpair()
    sent = b''
    with ours, theirs:
        theirs.settimeout(PATIENCE_S)
        while box:
            box.send(ours)
            sent += theirs.recv(1 << 20)
        ours.close()
        while more := theirs.recv(1 << 20):
            sent += more
    return sent


def test_everything_is_sent_in_order_while_there_is_room():
    frames = [message(1), frame(b'{}', TEXT), message(2), frame(b'\5', BINARY), message(3)]
    box = Outbox()
    for each in frames:
        box.put(each)
    assert drain(box) == b''.join(frames)
    assert not box
    assert box.dropped == 0


def test_the_oldest_messages_are_dropped_and_no_control(monkeypatch):
    monkeypatch.setattr(foxglove_gate, 'MESSAGE_LIMIT', 3 * len(message(0)))
    controls = [frame(b'{"n": %d}' % number, TEXT) for number in range(50)]
    box = Outbox()
    for number, control in enumerate(controls):
        box.put(message(number))
        box.put(control)
    sent = drain(box)
    assert all(each in sent for each in controls)
    assert [number for number in range(50) if message(number) in sent] == [47, 48, 49]
    assert box.dropped == 47


def test_of_times_the_newest_is_sent():
    times = [frame(bytes([TIME, number, 0, 0, 0, 0, 0, 0, 0])) for number in range(9)]
    box = Outbox()
    for each in times:
        box.put(each)
    assert drain(box) == times[-1]


def test_a_message_larger_than_the_limit_is_sent_alone(monkeypatch):
    monkeypatch.setattr(foxglove_gate, 'MESSAGE_LIMIT', 50)
    box = Outbox()
    box.put(message(1))
    box.put(message(2))
    assert drain(box) == message(2)


def test_what_is_being_sent_is_sent_to_its_end(monkeypatch):
    """A viewer that has read half of a message gets the other half, not the next one."""
    monkeypatch.setattr(foxglove_gate, 'MESSAGE_LIMIT', 100)
    large, newest = message(1, 8 << 20), message(3)
    box = Outbox()
    box.put(large)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.settimeout(0)
        box.send(ours)
        box.put(message(2))
        box.put(newest)
        received = b''
        while box or len(received) < len(large) + len(newest):
            received += theirs.recv(1 << 20)
            if box:
                box.send(ours)
    assert received == large + newest


def test_controls_that_nobody_reads_end_it(monkeypatch):
    monkeypatch.setattr(foxglove_gate, 'CONTROL_LIMIT', 1000)
    box = Outbox()
    for _ in range(9):
        box.put(frame(bytes(100), TEXT))
    with pytest.raises(FrameError, match='1000 bytes of controls wait'):
        box.put(frame(bytes(100), TEXT))
