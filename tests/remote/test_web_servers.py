# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Web servers that are not trusted: what they send is bounded, and refused in one line."""

from __future__ import annotations

import gzip
import threading
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING

import pytest
from allocations import little_memory

pytest.importorskip('fsspec', reason='URLs need fsspec')
pytest.importorskip('aiohttp', reason='http:// needs aiohttp')

from kitti_ros2.cli import main
from kitti_ros2.files import http_session, remote_requests
from kitti_ros2.files.remote import as_path
from kitti_ros2.model.errors import RemoteError

from waiting import PATIENCE_S  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SIZE = 5000
CONTENT = bytes(range(250)) * (SIZE // 250)


class Handler(BaseHTTPRequestHandler):
    """Answers HEAD with the size of a file, GET as a test wants it to."""

    protocol_version = 'HTTP/1.1'
    answer: Callable[[Handler], None]
    answers_head = False
    asked: list[str]

    def do_HEAD(self) -> None:
        if self.answers_head:
            self.do_GET()
            return
        self.send_response(200)
        self.send_header('Content-Length', str(SIZE))
        self.end_headers()

    def do_GET(self) -> None:
        self.asked.append(self.headers.get('Accept-Encoding', ''))
        type(self).answer(self)

    def reply(self, code: int, headers: dict[str, str], body: bytes) -> None:
        self.send_response(code)
        for name, value in {'Content-Length': str(len(body)), **headers}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Stay silent."""


class Server(ThreadingHTTPServer):
    """A server that says nothing when a client breaks off."""

    daemon_threads = True

    def handle_error(self, *_: object) -> None:
        """Stay silent."""


@contextmanager
def serving(answer: Callable[[Handler], None]) -> Iterator[tuple[str, list[str]]]:
    """Run a server; yield the URL of a file, and what codings were asked for."""
    asked: list[str] = []
    handler = type('OwnHandler', (Handler,), {'answer': answer, 'asked': asked})
    server = Server(('127.0.0.1', 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield f'http://127.0.0.1:{server.server_address[1]}/b.bin', asked
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.fixture(autouse=True)
def no_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote_requests, 'wait', lambda _: None)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('coding', ['gzip', 'deflate, gzip', 'x' * 3000], ids=range(3))
@pytest.mark.parametrize('ranges', [True, False])
def test_compressed_answers_are_refused(coding: str, ranges: bool, capsys):
    """Before anything is decompressed: 65 kB may be gigabytes."""
    body = gzip.compress(bytes(64 << 20))

    def answer(handler: Handler) -> None:
        headers = {'Content-Encoding': coding}
        if ranges:
            headers['Content-Range'] = f'bytes 0-{SIZE - 1}/{SIZE}'
        handler.reply(206 if ranges else 200, headers, body)

    with serving(answer) as (url, asked):
        path = as_path(f'{url}?signature=secret')
        for read in (path.read_bytes, lambda: path.open('rb').read(10)):
            refused = pytest.raises(RemoteError, match=r'b\.bin: the server compresses the file')
            with little_memory(), refused as raised:
                read()
            message = str(raised.value)
            assert 'secret' not in message
            assert len(message) < 400
        assert main(['info', url.replace('.bin', '.mcap')]) == 2
    assert set(asked) == {'identity'}
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert 'b.mcap: the server compresses the file' in error


def test_a_server_that_does_not_compress_may_say_so():
    def answer(handler: Handler) -> None:
        handler.reply(200, {'Content-Encoding': 'identity'}, CONTENT)

    with serving(answer) as (url, _):
        assert as_path(url).read_bytes() == CONTENT


def test_headers_that_come_by_and_by_are_given_up(monkeypatch: pytest.MonkeyPatch, capsys):
    """The server is never silent for long; HEAD, GET and redirects share their time."""
    monkeypatch.setattr(http_session, '_HEADERS_S', 0.4)
    monkeypatch.setattr(remote_requests, 'TRIES', 2)
    monkeypatch.setattr(Handler, 'answers_head', True)
    broken_off, never = threading.Event(), threading.Event()

    def answer(handler: Handler) -> None:
        handler.close_connection = True
        if not handler.path.endswith('x'):
            handler.reply(302, {'Location': f'{handler.path}x'}, b'')
            return
        with suppress(OSError):
            handler.wfile.write(b'HTTP/1.1 200 OK\r\nX: ')
            while not never.wait(0.02):
                handler.wfile.write(b'x')
        broken_off.set()

    with serving(answer) as (url, asked):
        assert main(['info', url]) == 2
        assert broken_off.wait(PATIENCE_S)
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert 'b.bin: no answer in time, 2 times; try again later' in error
    assert len(asked) < 9
