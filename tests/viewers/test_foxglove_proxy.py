# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The proxy over real sockets: who gets through, and what hostile connections cost."""

import base64
import socket
import struct
import threading
from contextlib import suppress

import pytest

pytest.importorskip('websockets', reason='needs websockets (pip install kitti_ros2[foxglove])')

from websockets.sync.server import serve

from kitti_ros2.viewers import foxglove_proxy
from kitti_ros2.viewers.foxglove_proxy import ViewerProxy, hidden_address
from kitti_ros2.viewers.origin_check import OriginCheck

from waiting import PATIENCE_S  # isort: skip

PROTOCOL = 'foxglove.sdk.v1'
GREETING = b'\x81\x02{}'
HOSTILE = 'https://attacker.example'
TOO_LARGE = 9000
"""Bytes of a header line."""


class Behind:
    """The server behind: it greets each connection, and sends back what it receives."""

    def __init__(self):
        self.protocols = []
        self.greets = threading.Event()
        self.greets.set()
        self.server = serve(
            self._echo, hidden_address(), 0, subprotocols=['foxglove.sdk.v1.1', PROTOCOL]
        )
        self.address = self.server.socket.getsockname()
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def _echo(self, connection):
        self.protocols.append(connection.subprotocol)
        assert self.greets.wait(PATIENCE_S)
        connection.send('{}')
        for data in connection:
            connection.send(data)


@pytest.fixture
def behind():
    server = Behind()
    yield server
    server.server.shutdown()


@pytest.fixture
def open_proxy(behind):
    """A function that opens a proxy; what it says is in `complaints`."""
    proxies = []

    def open_one(address=behind.address):
        complaints = []
        proxy = ViewerProxy('127.0.0.1', 0, OriginCheck('127.0.0.1'), complaints.append)
        proxy.complaints = complaints
        proxy.open(*address)
        proxies.append(proxy)
        return proxy

    yield open_one
    for proxy in proxies:
        proxy.close(0)


@pytest.fixture
def proxy(open_proxy):
    return open_proxy()


def request(port, *more, version='13', host=None, offered=PROTOCOL, first='GET / HTTP/1.1'):
    lines = [
        first,
        *([f'Host: {host or f"127.0.0.1:{port}"}'] if host != '' else []),
        'Upgrade: websocket',
        'Connection: Upgrade',
        f'Sec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}',
        f'Sec-WebSocket-Version: {version}',
        f'Sec-WebSocket-Protocol: {offered}',
        *more,
    ]
    return '\r\n'.join([*lines, '', '']).encode()


def connect(proxy):
    connection = socket.create_connection(('127.0.0.1', proxy.port), timeout=PATIENCE_S)
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


def answered(proxy, data):
    """Status and body of the answer to a request; None for one that is not answered."""
    with connect(proxy) as connection:
        connection.sendall(data)
        head, _, body = read_to_end(connection).partition(b'\r\n\r\n')
    return (int(head.split()[1]), body.decode()) if head else (None, '')


def read(connection, size):
    found = b''
    while len(found) < size:
        data = connection.recv(size - len(found))
        assert data, found
        found += data
    return found


def read_head(connection):
    head = b''
    while not head.endswith(b'\r\n\r\n'):
        head += read(connection, 1)
    return head.decode()


def admitted(proxy, *more, **values):
    """A connection that got through."""
    connection = connect(proxy)
    connection.sendall(request(proxy.port, *more, **values))
    assert read_head(connection).startswith('HTTP/1.1 101 ')
    assert read(connection, len(GREETING)) == GREETING
    return connection


def frame(data, first=0x82):
    """A frame of a client, masked with zeros (RFC 6455 section 5.2)."""
    return struct.pack('>BBQI', first, 0xFF, len(data), 0) + data


def echo(connection, text=b'hello'):
    connection.sendall(frame(text))
    assert read(connection, 2 + len(text))[2:] == text


@pytest.mark.parametrize('origin', [None, 'https://app.foxglove.dev', 'http://localhost:8080'])
def test_a_viewer_gets_through_unchanged(proxy, behind, origin):
    more = [f'Origin: {origin}'] if origin else []
    with admitted(proxy, *more) as viewer:
        echo(viewer)
    assert behind.protocols == [PROTOCOL]
    assert proxy.complaints == []


def test_a_foreign_page_is_refused_and_named_once(proxy, behind):
    for _ in range(3):
        status, body = answered(proxy, request(proxy.port, f'Origin: {HOSTILE}'))
        assert status == 403
        assert body.count('\n') == 1
        assert f'--allow-origin {HOSTILE}' in body
    assert len(proxy.complaints) == 1
    assert HOSTILE in proxy.complaints[0]
    assert behind.protocols == []


def test_a_rebound_name_is_refused(proxy, behind):
    status, body = answered(proxy, request(proxy.port, host='rebound.example:8765'))
    assert status == 403
    assert 'rebound.example' in body
    assert behind.protocols == []


def test_endlessly_many_origins_do_not_fill_the_terminal(proxy):
    for number in range(40):
        answered(proxy, request(proxy.port, f'Origin: https://a{number}.example'))
    assert len(proxy.complaints) < 30
    assert proxy.complaints[-1].endswith('further refusals are not shown')


@pytest.mark.parametrize(
    'make',
    [
        lambda port: request(port, version='8'),
        lambda port: request(port, version=''),
        lambda port: request(port, offered='mqtt'),
        lambda port: request(port, first='GET / HTTP/1.0'),
        lambda port: request(port, first='GET / HTTP/2'),
        lambda port: request(port, first='POST / HTTP/1.1'),
        lambda port: request(port, first='GETX / HTTP/1.1'),
        lambda port: request(port, first='GET / x HTTP/1.1'),
        lambda port: request(port, host=''),
        lambda port: request(port, 'Host: localhost'),
        lambda port: request(port, 'Origin: http://localhost', f'Origin: {HOSTILE}'),
        lambda port: request(port, ' folded: line'),
        lambda port: request(port, 'no colon'),
        lambda port: request(port, 'Origin : http://localhost'),
        lambda _: b'GET / HTTP/1.1\r\nHost: localhost\r\n\r\n',
        lambda _: b'\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n',
        lambda port: request(port, f'X: {"x" * TOO_LARGE}'),
        lambda _: b'GET /' + b'x' * TOO_LARGE,
        lambda port: request(port, *(f'X{number}: y' for number in range(200))),
    ],
)
def test_what_is_no_handshake_goes_no_further(proxy, behind, make):
    status, _ = answered(proxy, make(proxy.port))
    assert status is None or 400 <= status < 506
    assert behind.protocols == []
    with admitted(proxy) as viewer:
        echo(viewer)


def test_data_before_the_answer_to_a_handshake_goes_no_further(proxy):
    with connect(proxy) as viewer:
        viewer.sendall(request(proxy.port) + b'too early')
        assert b'hello' not in read_to_end(viewer)
    with admitted(proxy) as viewer:
        echo(viewer)


def test_a_handshake_may_come_byte_by_byte(proxy):
    with connect(proxy) as viewer:
        for byte in request(proxy.port):
            viewer.sendall(bytes([byte]))
        assert read_head(viewer).startswith('HTTP/1.1 101 ')


@pytest.mark.parametrize('begin', [b'', b'GET / HTTP/1.1\r\nHost: localhost\r\n'])
def test_a_handshake_without_an_end_is_cut_off(open_proxy, monkeypatch, begin):
    monkeypatch.setattr(foxglove_proxy, 'HANDSHAKE_S', 0.2)
    # It may be cut off before that is sent.
    with connect(open_proxy()) as slow, suppress(ConnectionError):
        slow.sendall(begin)
        assert slow.recv(1) == b''


def test_a_hundred_connections_without_a_handshake_cost_nobody_a_place(proxy):
    """The oldest make room; there are never more than a few dozen."""
    waiting = [connect(proxy) for _ in range(100)]
    for connection in waiting[:50]:
        with suppress(ConnectionError):
            connection.sendall(b'GET / HTTP/1.1\r\n')
    with admitted(proxy) as viewer:
        echo(viewer)
    for connection in waiting[: 100 - foxglove_proxy.HANDSHAKES]:
        assert read_to_end(connection) == b''
    for connection in waiting:
        connection.close()


def test_more_viewers_than_allowed_are_refused_until_one_leaves(proxy):
    viewers = [admitted(proxy) for _ in range(foxglove_proxy.VIEWERS)]
    status, body = answered(proxy, request(proxy.port))
    assert status == 503
    assert f'{foxglove_proxy.VIEWERS} viewers are connected' in body
    assert len(proxy.complaints) == 1
    for viewer in viewers:
        echo(viewer)
    viewers.pop().close()
    while answered_or_admitted(proxy) == 503:
        pass
    for viewer in viewers:
        viewer.close()


def answered_or_admitted(proxy):
    with connect(proxy) as connection:
        connection.sendall(request(proxy.port))
        return int(connection.recv(4096).split()[1])


@pytest.mark.parametrize(
    'data',
    [
        struct.pack('>BBQI', 0x82, 0xFF, 1 << 40, 0),
        frame(bytes(600_000), 0x02) + frame(bytes(600_000), 0x80),
    ],
)
def test_a_viewer_that_sends_too_much_is_disconnected(proxy, data):
    with admitted(proxy) as other, admitted(proxy) as viewer:
        with suppress(ConnectionError):
            viewer.sendall(data)
        read_to_end(viewer)
        echo(other)
    (said,) = proxy.complaints
    assert f'longer than {foxglove_proxy.CLIENT_MESSAGE_LIMIT} bytes' in said


def test_a_message_of_fragments_arrives_whole(proxy):
    with admitted(proxy) as viewer:
        viewer.sendall(frame(b'he', 0x02) + frame(b'', 0) + frame(b'l', 0) + frame(b'lo', 0x80))
        assert read(viewer, 7) == b'\x82\x05hello'


def test_a_viewer_that_pings_and_does_not_read_is_disconnected(proxy, monkeypatch):
    monkeypatch.setattr(foxglove_proxy, 'CONTROL_LIMIT', 1 << 18)
    pings = struct.pack('>BBI', 0x89, 0x80 | 125, 0) + bytes(125)
    with admitted(proxy) as other, admitted(proxy) as viewer:
        with pytest.raises(ConnectionError):
            viewer.sendall(pings * 1_000_000)
        echo(other)
    (said,) = proxy.complaints
    assert f'{1 << 18} bytes of answers wait' in said


def test_a_time_reaches_every_viewer_after_its_greeting(proxy, behind):
    """Before that, a viewer does not know what to do with it."""
    time = b'\x82\x09\x02' + struct.pack('<Q', 5 * 10**18)
    with connect(proxy) as early, admitted(proxy) as one, admitted(proxy) as other:
        behind.greets.clear()
        early.sendall(request(proxy.port))
        assert read_head(early).startswith('HTTP/1.1 101 ')
        proxy.publish_time(5 * 10**18)
        for viewer in (one, other):
            assert read(viewer, len(time)) == time
            echo(viewer)
        behind.greets.set()
        assert read(early, len(GREETING)) == GREETING
        echo(early)


def test_nothing_is_left_after_its_end(open_proxy):
    proxy = open_proxy()
    with admitted(proxy) as viewer:
        proxy.close(0)
        assert read_to_end(viewer) == b''
    with pytest.raises(ConnectionRefusedError):
        connect(proxy)


def test_it_may_end_while_viewers_come_and_go(open_proxy):
    for _ in range(20):
        proxy = open_proxy()
        viewer = connect(proxy)
        closing = threading.Thread(target=viewer.close)
        closing.start()
        proxy.close(0)
        closing.join()


def test_without_a_server_behind_a_viewer_is_disconnected(open_proxy):
    with socket.create_server((hidden_address(), 0)) as nobody:
        address = nobody.getsockname()
    proxy = open_proxy(address)
    with connect(proxy) as viewer:
        viewer.sendall(request(proxy.port))
        assert read_head(viewer).startswith('HTTP/1.1 101 ')
        assert read(viewer, 1) == b'\x88'  # a close frame


def test_the_hidden_address_is_not_the_usual_one():
    addresses = {hidden_address() for _ in range(50)}
    assert len(addresses) > 40
    assert all(address.startswith('127.') for address in addresses)
