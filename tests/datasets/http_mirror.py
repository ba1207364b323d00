# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An HTTP server on 127.0.0.1 with the files of a mirror, and with faults of real servers."""

from __future__ import annotations

import hashlib
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@dataclass
class Mirror:
    """What the server has, and how it behaves.

    Attributes:
        files: Content by path.
        fault: Called with each request before anything is sent; True if it has replied.
        faulty_head: Whether the fault is for HEAD, too.
        break_after: Bytes of each response after which the connection is closed.
        ranges: Whether Range is supported.
        validators: Whether ETag is sent.
        requests: Path, Range and Authorization of each request.
    """

    files: dict[str, bytes]
    fault: Callable[[Handler], bool] = lambda _: False
    faulty_head: bool = False
    break_after: int | None = None
    ranges: bool = True
    validators: bool = True
    requests: list[tuple[str, str, str]] = field(default_factory=list)
    url: str = ''


class Handler(BaseHTTPRequestHandler):
    """Replies to GET from a Mirror."""

    protocol_version = 'HTTP/1.1'
    mirror: Mirror

    def do_GET(self) -> None:
        asked = self.headers.get('Range', '')
        self.mirror.requests.append((self.path, asked, self.headers.get('Authorization', '')))
        if self.mirror.fault(self):
            return
        content = self.mirror.files.get(self.path)
        if content is None:
            self.reply(404)
            return
        tag = etag_of(content)
        start = int(asked.removeprefix('bytes=').removesuffix('-')) if asked else 0
        if self.headers.get('If-Range', tag) != tag or not self.mirror.ranges:
            start = 0
        headers = {'ETag': tag} if self.mirror.validators else {}
        if start and start >= len(content):
            self.reply(416, {'Content-Range': f'bytes */{len(content)}'})
        elif start:
            where = f'bytes {start}-{len(content) - 1}/{len(content)}'
            self.reply(206, {**headers, 'Content-Range': where}, content[start:])
        else:
            self.reply(200, headers, content)

    def do_HEAD(self) -> None:
        if self.mirror.faulty_head and self.mirror.fault(self):
            return
        content = self.mirror.files.get(self.path)
        self.send_response(404 if content is None else 200)
        self.send_header('Content-Length', str(len(content or b'')))
        self.end_headers()

    def reply(self, code: int, headers: dict[str, str] | None = None, body: bytes = b'') -> None:
        """Send a response; break off within its body if the mirror says so."""
        self.send_response(code)
        for name, value in {'Content-Length': str(len(body)), **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        most = self.mirror.break_after
        self.wfile.write(body if most is None else body[:most])
        if most is not None and len(body) > most:
            self.close_connection = True

    def hang_up(self) -> bool:
        """Close the connection without a reply."""
        self.close_connection = True
        return True

    def log_message(self, *_: object) -> None:
        """Stay silent."""


def etag_of(content: bytes) -> str:
    return f'"{hashlib.md5(content).hexdigest()}"'


@contextmanager
def serving(mirror: Mirror) -> Iterator[Mirror]:
    """Run a server for a mirror, with its URL in mirror.url."""
    handler = type('MirrorHandler', (Handler,), {'mirror': mirror})
    server = ThreadingHTTPServer(('127.0.0.1', 0), handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    mirror.url = f'http://127.0.0.1:{server.server_address[1]}'
    try:
        yield mirror
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
