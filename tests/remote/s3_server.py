# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An S3 server on 127.0.0.1 (moto's) that counts requests and injects faults.

Faults are planned by number (`fail`: the first, the k-th, all from the k-th request of some kinds)
or by a rate with a seed (`fail_at_rate`). As a program it prints its address, and ends with its
standard input::

    python tests/remote/s3_server.py [RATE [SEED]]
"""

from __future__ import annotations

import io
import json
import logging
import random
import select
import socket
import struct
import sys
import threading
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

from moto.backends import get_backend
from moto.core import DEFAULT_ACCOUNT_ID
from moto.moto_server.werkzeug_app import (
    DomainDispatcherApplication,
    MotoRequestHandler,
    create_backend_app,
)
from moto.s3.models import FakeKey
from werkzeug.serving import make_server
from werkzeug.test import Client

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

    from typing_extensions import Self

REGION = 'us-east-1'


def _remember_values() -> None:
    """Let moto keep the bytes of objects: it reads all of them from a file for each range."""
    stored = FakeKey.value

    def get(key: FakeKey) -> bytes:
        if '_whole' not in vars(key):
            vars(key)['_whole'] = stored.fget(key)
        return vars(key)['_whole']

    def put(key: FakeKey, value: bytes) -> None:
        vars(key).pop('_whole', None)
        stored.fset(key, value)

    FakeKey.value = property(get, put)


_remember_values()


class Fault(Enum):
    """What happens to a request."""

    ERROR = 'error'
    """500 InternalError, without an effect."""
    SLOW_DOWN = 'slow down'
    """503 SlowDown, without an effect."""
    RESET = 'reset'
    """The connection is reset, without an effect."""
    LOST = 'lost'
    """The request is carried out, and the connection reset instead of an answer."""
    TRUNCATED = 'truncated'
    """The request is carried out, and half of the answer's body is sent; as LOST without a body."""
    STALL = 'stall'
    """No answer until the client gives up, or release is called; without an effect."""


AT_ONCE = tuple(each for each in Fault if each is not Fault.STALL)
"""Faults that a client notices at once; STALL needs a client with a short time-out."""

KINDS = (
    'get', 'head', 'list', 'put', 'create', 'part', 'complete', 'abort', 'copy', 'delete', 'other',
)  # fmt: skip
"""Kinds of requests; create, part, complete and abort are those of a multipart upload."""


@dataclass(frozen=True)
class Request:
    """A request that came: its kind, its path, and the fault that it met, if any."""

    kind: str
    path: str
    fault: Fault | None = None


@dataclass
class _Plan:
    fault: Fault
    nth: int
    times: int
    kinds: Collection[str]
    path: str
    seen: int = 0


class S3Server:
    """The server, run by a thread of this process; use it as a context manager.

    Attributes:
        url: Its address.
        requests: All requests that came since the last clear, in order.
        stalled: Set while a request is stalled.
    """

    def __init__(self) -> None:
        self.requests: list[Request] = []
        self.stalled = threading.Event()
        self._plans: list[_Plan] = []
        self._rate = 0.0
        self._random = random.Random(0)
        self._faults: tuple[Fault, ...] = AT_ONCE
        self._rate_kinds: Collection[str] = KINDS
        self._lock = threading.Lock()
        self._released = threading.Event()
        self._moto = DomainDispatcherApplication(create_backend_app)
        self._buckets = 0
        logging.getLogger('werkzeug').setLevel(logging.ERROR)
        self._server = make_server('127.0.0.1', 0, self, threaded=True, request_handler=_Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self.url = f'http://127.0.0.1:{self._server.server_port}'

    def __enter__(self) -> Self:
        # The first request loads the service, which takes longer than clients may wait.
        Client(self._moto).get('/', headers={'Host': 's3.amazonaws.com'}).close()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._released.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def environment(self, *, attempts: int | None = None, timeout_s: float = 0.0) -> dict[str, str]:
        """Return the variables that lead clients here.

        Args:
            attempts: How often the client library tries by itself; None is its default.
            timeout_s: After which time it gives a request up; 0 is its default.
        """
        values = {
            'AWS_ACCESS_KEY_ID': 'testing',
            'AWS_SECRET_ACCESS_KEY': 'testing',
            'AWS_DEFAULT_REGION': REGION,
            'AWS_ENDPOINT_URL': self.url,
            'AWS_EC2_METADATA_DISABLED': 'true',
            'AWS_CONFIG_FILE': '/dev/null',
            'AWS_SHARED_CREDENTIALS_FILE': '/dev/null',
        }
        if attempts is not None:
            values['AWS_MAX_ATTEMPTS'] = str(attempts)
        if timeout_s:
            values['FSSPEC_S3'] = json.dumps({'config_kwargs': {'read_timeout': timeout_s}})
        return values

    def new_bucket(self) -> str:
        """Make a bucket of a new name and return the name."""
        with self._lock:
            self._buckets += 1
            name = f'bucket-{self._server.server_port}-{self._buckets}'
        self._backend().create_bucket(name, REGION)
        return name

    def objects(self, bucket: str) -> dict[str, bytes]:
        """Return the complete objects of a bucket by key, past all faults and counts."""
        keys = self._backend().list_objects(
            self._backend().get_bucket(bucket), None, None, None, None
        )[0]
        return {key.name: bytes(key.value) for key in keys}

    def put(self, bucket: str, key: str, data: bytes) -> None:
        """Write an object, past all faults and counts."""
        self._backend().put_object(bucket, key, data)

    def unfinished(self, bucket: str) -> list[str]:
        """Return the keys of multipart uploads that are neither completed nor aborted."""
        uploads = self._backend().get_bucket(bucket).multiparts.values()
        return sorted(each.key_name for each in uploads)

    def remove_bucket(self, name: str) -> None:
        """Remove a bucket with all that it holds."""
        self._backend().buckets.pop(name, None)

    def fail(
        self,
        fault: Fault,
        nth: int = 1,
        times: int = 1,
        kinds: Collection[str] = KINDS,
        path: str = '',
    ) -> None:
        """Plan a fault: of so many requests from the n-th on that match, counted from now.

        Args:
            fault: What happens.
            nth: From 1.
            times: Number of requests that fail, one after the other.
            kinds: Which requests are counted.
            path: A part of their path (bucket and key).
        """
        with self._lock:
            self._plans.append(_Plan(fault, nth, times, kinds, path))

    def fail_at_rate(
        self,
        rate: float,
        seed: int,
        faults: Iterable[Fault] = AT_ONCE,
        kinds: Collection[str] = KINDS,
    ) -> None:
        """Let a share of all requests fail, from 0 to 1, drawn by a seed."""
        with self._lock:
            self._rate, self._random, self._faults = rate, random.Random(seed), tuple(faults)
            self._rate_kinds = kinds

    def clear(self) -> None:
        """Forget all planned faults and all requests; release stalled ones."""
        with self._lock:
            self._plans.clear()
            self._rate = 0.0
            self.requests.clear()
        self.release()

    def release(self) -> None:
        """Reset the connections of stalled requests."""
        released, self._released = self._released, threading.Event()
        released.set()
        self.stalled.clear()

    def counts(self) -> Counter[str]:
        """Return how many requests of each kind came since the last clear."""
        return Counter(each.kind for each in list(self.requests))

    def failures(self) -> int:
        """Return how many requests met a fault since the last clear."""
        return sum(each.fault is not None for each in list(self.requests))

    def __call__(
        self, environ: dict[str, Any], start_response: Callable[..., Any]
    ) -> Iterable[bytes]:
        """Answer a request (WSGI)."""
        kind = _kind_of(environ)
        with self._lock:
            fault = self._draw(kind, environ['PATH_INFO'])
            self.requests.append(Request(kind, environ['PATH_INFO'], fault))
        if fault is None:
            return self._moto(environ, start_response)  # type: ignore[no-any-return]
        return self._fail(fault, environ, start_response)

    def _draw(self, kind: str, path: str) -> Fault | None:
        drawn = None
        for plan in self._plans:
            if kind not in plan.kinds or plan.path not in path:
                continue
            plan.seen += 1
            if plan.nth <= plan.seen < plan.nth + plan.times:
                drawn = drawn or plan.fault
        at_random = drawn is None and self._rate and kind in self._rate_kinds
        if at_random and self._random.random() < self._rate:
            drawn = self._random.choice(self._faults)
        return drawn

    def _fail(
        self, fault: Fault, environ: dict[str, Any], start_response: Callable[..., Any]
    ) -> Iterable[bytes]:
        # An answer before the end of the request would be a reset connection for the client.
        body = _read_body(environ)
        if fault in {Fault.ERROR, Fault.SLOW_DOWN}:
            code = 'InternalError' if fault is Fault.ERROR else 'SlowDown'
            status = '500 Internal Server Error' if fault is Fault.ERROR else '503 Slow Down'
            text = f'<?xml version="1.0"?><Error><Code>{code}</Code><Message>injected</Message>'
            data = f'{text}<RequestId>0</RequestId></Error>'.encode()
            headers = [('Content-Type', 'application/xml'), ('Content-Length', str(len(data)))]
            start_response(status, headers)
            return [data]
        if fault is Fault.STALL:
            self._stall(environ['werkzeug.socket'])
        if fault in {Fault.LOST, Fault.TRUNCATED}:
            answer = self._answer({**environ, 'wsgi.input': io.BytesIO(body)})
            if fault is Fault.TRUNCATED and len(answer[2]) > 1:
                return _truncated(environ['werkzeug.socket'], start_response, *answer)
        _reset(environ['werkzeug.socket'])
        raise ConnectionResetError

    def _stall(self, connection: socket.socket) -> None:
        released = self._released
        self.stalled.set()
        while not released.is_set():
            # Readable is the end of the stream: the request has been read.
            if select.select([connection], [], [], 0.05)[0]:
                return

    def _answer(self, environ: dict[str, Any]) -> tuple[str, list[tuple[str, str]], bytes]:
        answer: list[Any] = []
        body = self._moto(environ, lambda status, headers, _=None: answer.extend((status, headers)))
        data = b''.join(body)
        return answer[0], answer[1], data

    @staticmethod
    def _backend() -> Any:
        return get_backend('s3')[DEFAULT_ACCOUNT_ID]['aws']


class _Handler(MotoRequestHandler):
    """Answers `Expect: 100-continue` once.

    http.server and werkzeug both do; the second answer may reach aiohttp after the body is sent,
    and ends its time-out of reading: a request that stalls is then waited for without end.
    """

    def handle_expect_100(self) -> bool:
        return True  # werkzeug answers


def _kind_of(environ: Mapping[str, Any]) -> str:
    method = environ['REQUEST_METHOD']
    query = parse_qs(environ.get('QUERY_STRING', ''), keep_blank_values=True)
    if method in {'GET', 'HEAD'}:
        has_key = '/' in environ['PATH_INFO'].strip('/')
        return method.lower() if has_key or method == 'HEAD' else 'list'
    if method == 'PUT' and 'HTTP_X_AMZ_COPY_SOURCE' in environ:
        return 'copy'
    if method == 'PUT':
        return 'part' if 'uploadId' in query else 'put'
    if method == 'DELETE':
        return 'abort' if 'uploadId' in query else 'delete'
    for word, kind in (('uploads', 'create'), ('uploadId', 'complete'), ('delete', 'delete')):
        if word in query:
            return kind
    return 'other'


def _read_body(environ: Mapping[str, Any]) -> bytes:
    stream = environ['wsgi.input']
    if environ.get('wsgi.input_terminated'):
        return bytes(stream.read())
    return bytes(stream.read(int(environ.get('CONTENT_LENGTH') or 0)))


def _truncated(
    connection: socket.socket,
    start_response: Callable[..., Any],
    status: str,
    headers: list[tuple[str, str]],
    data: bytes,
) -> Iterator[bytes]:
    rest = [(name, value) for name, value in headers if name.lower() != 'content-length']
    start_response(status, [*rest, ('Content-Length', str(len(data)))])
    yield data[: len(data) // 2]
    connection.shutdown(socket.SHUT_RDWR)
    raise ConnectionResetError


def _reset(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
    connection.shutdown(socket.SHUT_RD)


@contextmanager
def s3_server() -> Iterator[S3Server]:
    """Yield a running server."""
    with S3Server() as server:
        yield server


def main() -> None:
    """Print the address and the name of a bucket; serve until the standard input ends."""
    rate, seed = (*map(float, sys.argv[1:]), 0.0, 0.0)[:2]
    with s3_server() as server:
        sys.stdout.write(f'{server.url} {server.new_bucket()}\n')
        sys.stdout.flush()
        server.fail_at_rate(rate, int(seed))
        for _ in sys.stdin:
            sys.stdout.write(json.dumps({**server.counts(), 'failures': server.failures()}) + '\n')
            sys.stdout.flush()
            server.requests.clear()


if __name__ == '__main__':
    main()
