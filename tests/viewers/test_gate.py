# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The gate over real sockets: who gets through, and what hostile connections cost."""

import base64
import re
import socket
import struct
import threading
from contextlib import suppress

import pytest

from kitti_ros2.viewers import foxglove_gate as gates
from kitti_ros2.viewers import foxglove_gate as relays
from kitti_ros2.viewers.foxglove_gate import Gate, hidden_address
from kitti_ros2.viewers.websocket import HEAD_LIMIT, Admission

from waiting import PATIENCE_S  # isort: skip

ANSWER = b'HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\n\r\n'
GREETING = b'\x81\x02{}'
HOSTILE = 'https://attacker.example'


class Behind:
    """The server behind: it greets each connection, and sends back what it receives."""

    def __init__(self):
        self.listener = socket.create_server((hidden_address(), 0))
        self.address = self.listener.getsockname()
        self.heads = []
        self.greets = threading.Event()
        self.greets.set()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection):
        with connection:
            head = b''
            while not head.endswith(b'\r\n\r\n'):
                head += connection.recv(4096)
            self.heads.append(head)
            connection.sendall(ANSWER)
            assert self.greets.wait(PATIENCE_S)
            connection.sendall(GREETING)
            try:
                while data := connection.recv(4096):
                    # Unmasked, as a server sends it: the mask of the tests is zero.
                    connection.sendall(re.sub(rb'\x82\x85\0{4}', b'\x82\x05', data))
            except OSError:
                return


@pytest.fixture
def behind():
    server = Behind()
    yield server
    server.listener.close()


@pytest.fixture
def gate(behind):
    complaints = []
    opened = Gate('127.0.0.1', 0, Admission('127.0.0.1'), complaints.append)
    opened.complaints = complaints
    opened.open(*behind.address)
    yield opened
    opened.close(0)


def request(port, *more, version='13', host=None, path='/', protocol='HTTP/1.1', method='GET'):
    lines = [
        f'{method} {path} {protocol}',
        *([f'Host: {host or f"127.0.0.1:{port}"}'] if host != '' else []),
        'Upgrade: websocket',
        'Connection: Upgrade',
        f'Sec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}',
        f'Sec-WebSocket-Version: {version}',
        *more,
    ]
    return '\r\n'.join([*lines, '', '']).encode()


def connect(gate):
    connection = socket.create_connection(('127.0.0.1', gate.port), timeout=PATIENCE_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def read_to_end(connection):
    found = b''
    try:
        while data := connection.recv(65536):
            found += data
    except ConnectionResetError:
        pass
    return found


def answered(gate, data):
    """Status and body of the answer to a request."""
    with connect(gate) as connection:
        connection.sendall(data)
        head, _, body = read_to_end(connection).partition(b'\r\n\r\n')
    return int(head.split()[1]), body.decode()


def admitted(gate, *more, **values):
    """A connection that got through."""
    connection = connect(gate)
    connection.sendall(request(gate.port, *more, **values))
    found = b''
    while len(found) < len(ANSWER + GREETING):
        data = connection.recv(len(ANSWER + GREETING) - len(found))
        assert data, found
        found += data
    assert found == ANSWER + GREETING
    return connection


def echo(connection, text=b'hello'):
    connection.sendall(struct.pack('>BBI', 0x82, 0x80 | len(text), 0) + text)
    found = b''
    while len(found) < 2 + len(text):
        found += connection.recv(2 + len(text) - len(found))
    assert found[2:] == text


@pytest.mark.parametrize('origin', [None, 'https://app.foxglove.dev', 'http://localhost:8080'])
def test_a_viewer_gets_through_unchanged(gate, behind, origin):
    more = [f'Origin: {origin}'] if origin else []
    with admitted(gate, *more) as viewer:
        echo(viewer)
    assert behind.heads == [request(gate.port, *more)]
    assert gate.complaints == []


def test_a_foreign_page_is_refused_and_named_once(gate, behind):
    for _ in range(3):
        status, body = answered(gate, request(gate.port, f'Origin: {HOSTILE}'))
        assert status == 403
        assert body.count('\n') == 1
        assert f'--allow-origin {HOSTILE}' in body
    assert len(gate.complaints) == 1
    assert HOSTILE in gate.complaints[0]
    assert behind.heads == []


def test_a_rebound_name_is_refused(gate, behind):
    status, body = answered(gate, request(gate.port, host='rebound.example:8765'))
    assert status == 403
    assert 'rebound.example' in body
    assert behind.heads == []


def test_endlessly_many_origins_do_not_fill_the_terminal(gate):
    for number in range(40):
        answered(gate, request(gate.port, f'Origin: https://a{number}.example'))
    assert len(gate.complaints) < 30
    assert gate.complaints[-1].endswith('further refusals are not shown')


@pytest.mark.parametrize(
    ('make', 'status'),
    [
        (lambda port: request(port, version='8'), 426),
        (lambda port: request(port, version=''), 426),
        (lambda port: request(port, protocol='HTTP/1.0'), 400),
        (lambda port: request(port, protocol='HTTP/2'), 400),
        (lambda port: request(port, method='POST'), 400),
        (lambda port: request(port, method='GETX'), 400),
        (lambda port: request(port, host=''), 400),
        (lambda port: request(port, 'Host: localhost'), 400),
        (lambda port: request(port, 'Origin: http://localhost', f'Origin: {HOSTILE}'), 400),
        (lambda port: request(port, ' folded: line'), 400),
        (lambda port: request(port, 'no colon'), 400),
        (lambda port: request(port, 'Origin : http://localhost'), 400),
        (lambda port: request(port, path='/ x'), 400),
        (lambda port: request(port) + b'too early', 400),
        (lambda _: b'GET / HTTP/1.1\r\nHost: localhost\r\n\r\n', 426),
        (lambda _: b'\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03', 400),
        (lambda port: request(port, f'X: {"x" * HEAD_LIMIT}'), 431),
        (lambda _: b'GET /' + b'x' * 2 * HEAD_LIMIT, 431),
        (lambda port: request(port, *('X: y' for _ in range(HEAD_LIMIT // 6))), 431),
    ],
)  # fmt: skip
def test_what_is_no_handshake_is_answered_and_goes_no_further(gate, behind, make, status):
    found, body = answered(gate, make(gate.port))
    assert found == status
    assert body.count('\n') == 1
    assert behind.heads == []
    with admitted(gate) as viewer:
        echo(viewer)


def test_a_handshake_may_come_byte_by_byte(gate):
    with connect(gate) as viewer:
        for each in request(gate.port):
            viewer.sendall(bytes([each]))
        assert viewer.recv(len(ANSWER), socket.MSG_WAITALL) == ANSWER


@pytest.mark.parametrize('begin', [b'', b'GET / HTTP/1.1\r\nHost: localhost\r\n'])
def test_a_handshake_without_an_end_is_cut_off(behind, monkeypatch, begin):
    monkeypatch.setattr(relays, 'HANDSHAKE_S', 0.2)
    opened = Gate('127.0.0.1', 0, Admission('127.0.0.1'), lambda _: None)
    opened.open(*behind.address)
    # It may be cut off before that is sent.
    with connect(opened) as slow, suppress(ConnectionError):
        slow.sendall(begin)
        assert slow.recv(1) == b''
    opened.close(0)


def test_a_hundred_connections_without_a_handshake_cost_nobody_a_place(gate):
    """The oldest make room; there are never more than a few dozen."""
    waiting = [connect(gate) for _ in range(100)]
    for each in waiting[:50]:
        each.sendall(b'GET / HTTP/1.1\r\n')
    with admitted(gate) as viewer:
        echo(viewer)
    assert read_to_end(waiting[0]) == b''
    assert len(gate._relays) <= gates.HANDSHAKES + gates.VIEWERS
    for each in waiting:
        each.close()


def test_more_viewers_than_allowed_are_refused_until_one_leaves(gate):
    viewers = [admitted(gate) for _ in range(gates.VIEWERS)]
    status, body = answered(gate, request(gate.port))
    assert status == 503
    assert f'{gates.VIEWERS} viewers are connected' in body
    assert len(gate.complaints) == 1
    for each in viewers:
        echo(each)
    viewers.pop().close()
    while answered_or_admitted(gate) == 503:
        pass
    for each in viewers:
        each.close()


def answered_or_admitted(gate):
    with connect(gate) as connection:
        connection.sendall(request(gate.port))
        return int(connection.recv(4096).split()[1])


def test_a_viewer_that_sends_too_much_is_disconnected(gate):
    with admitted(gate) as other, admitted(gate) as viewer:
        viewer.sendall(struct.pack('>BBQI', 0x82, 0xFF, 1 << 40, 0))
        assert read_to_end(viewer) == b''
        echo(other)
    (said,) = gate.complaints
    assert f'longer than {relays.CLIENT_MESSAGE_LIMIT} bytes' in said


def test_a_time_reaches_every_viewer_after_its_greeting(gate, behind):
    """Before that, a viewer does not know what to do with it."""
    frame = b'\x82\x09\x02' + struct.pack('<Q', 5 * 10**18)
    with connect(gate) as early, admitted(gate) as one, admitted(gate) as other:
        behind.greets.clear()
        early.sendall(request(gate.port))
        assert early.recv(len(ANSWER), socket.MSG_WAITALL) == ANSWER
        gate.tell_time(5 * 10**18)
        for viewer in (one, other):
            assert viewer.recv(len(frame), socket.MSG_WAITALL) == frame
            echo(viewer)
        behind.greets.set()
        assert early.recv(len(GREETING), socket.MSG_WAITALL) == GREETING
        echo(early)


def test_nothing_is_left_after_its_end(behind):
    opened = Gate('127.0.0.1', 0, Admission('127.0.0.1'), lambda _: None)
    opened.open(*behind.address)
    viewer = admitted(opened)
    opened.close(0)
    assert read_to_end(viewer) == b''
    with pytest.raises(ConnectionRefusedError):
        connect(opened)
    viewer.close()


def test_it_may_end_before_it_is_woken(behind):
    """Its thread looks at the time whenever a connection has something for it."""
    for _ in range(20):
        opened = Gate('127.0.0.1', 0, Admission('127.0.0.1'), lambda _: None)
        opened.open(*behind.address)
        viewer = connect(opened)
        closing = threading.Thread(target=viewer.close)
        closing.start()
        opened.close(0)
        closing.join()


def test_without_a_server_behind_a_viewer_is_disconnected():
    with socket.create_server((hidden_address(), 0)) as nobody:
        address = nobody.getsockname()
    opened = Gate('127.0.0.1', 0, Admission('127.0.0.1'), lambda _: None)
    opened.open(*address)
    with connect(opened) as viewer:
        viewer.sendall(request(opened.port))
        assert read_to_end(viewer) == b''
    opened.close(0)


def test_the_hidden_address_is_not_the_usual_one():
    found = {hidden_address() for _ in range(50)}
    assert len(found) > 40
    assert all(each.startswith('127.') for each in found)
