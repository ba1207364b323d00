# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A store in memory that counts its requests, and fails as a test wants it to."""

from __future__ import annotations

from collections import Counter
from itertools import count
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, ClassVar

import fsspec
from fsspec.implementations.memory import MemoryFileSystem

from kitti_ros2.files.remote import RemotePath

from waiting import PATIENCE_S  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PROTOCOL = 'counted'


class CountedStore(MemoryFileSystem):
    """The store.

    Attributes:
        requests: How often it was asked, by method.
        read: The bytes that were asked for, each of one file or range.
        faults: By a part of a key: called before each request for it with the method.
        short: By a part of a key: how many answers are cut, still.
    """

    protocol = PROTOCOL
    store: ClassVar[dict[str, Any]] = {}
    pseudo_dirs: ClassVar[list[str]] = ['']
    requests: ClassVar[Counter[str]] = Counter()
    read: ClassVar[list[tuple[str, int]]] = []
    faults: ClassVar[dict[str, Callable[[str], None]]] = {}
    short: ClassVar[Counter[str]] = Counter()
    lock = Lock()

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return '/' + path.removeprefix(f'{PROTOCOL}://').strip('/')

    @classmethod
    def reset(cls) -> None:
        cls.requests.clear()
        cls.read.clear()
        cls.faults.clear()
        cls.short.clear()

    def _ask(self, method: str, key: str) -> None:
        with self.lock:
            self.requests[method] += 1
        for part, fault in list(self.faults.items()):
            if part in key:
                fault(method)

    def ls(self, path: str, detail: bool = True, **kwargs: Any) -> Any:
        self._ask('ls', path)
        return super().ls(path, detail, **kwargs)

    def info(self, path: str, **kwargs: Any) -> Any:
        self._ask('info', path)
        return super().info(path, **kwargs)

    def cat_file(
        self, path: str, start: int | None = None, end: int | None = None, **_: Any
    ) -> bytes:
        self._ask('cat', path)
        key = self._strip_protocol(path)
        if key not in self.store:
            raise FileNotFoundError(path)
        data: bytes = self.store[key].getvalue()[start:end]
        with self.lock:
            self.read.append((key, len(data)))
            for part in [part for part in self.short if part in key and self.short[part] > 0]:
                self.short[part] -= 1
                return data[: len(data) // 2]
        return data


fsspec.register_implementation(PROTOCOL, CountedStore, clobber=True)
_NEXT = count()


def put(source: Path, name: str = '') -> RemotePath:
    """Copy a file or folder into the store, at a place of its own; return its URL."""
    base = RemotePath(f'{PROTOCOL}://box{next(_NEXT)}')
    files = CountedStore()
    target = base / (name or source.name)
    for path in [source] if source.is_file() else sorted(source.rglob('*')):
        place = target / path.relative_to(source).as_posix() if path != source else target
        if path.is_file():
            files.pipe_file(files._strip_protocol(str(place)), path.read_bytes())
    CountedStore.reset()
    return target


class Fails:
    """Fails some times, then no more."""

    def __init__(self, error: Exception, times: int, methods: tuple[str, ...] = ('cat',)) -> None:
        self.error, self.left, self.methods = error, times, methods
        self.met = 0

    def __call__(self, method: str) -> None:
        if method in self.methods and self.left > 0:
            self.left -= 1
            self.met += 1
            raise self.error


class Stalls:
    """Waits until a test lets it go on."""

    def __init__(self) -> None:
        self.begun, self.go_on = Event(), Event()

    def __call__(self, method: str) -> None:
        if method == 'cat':
            self.begun.set()
            assert self.go_on.wait(PATIENCE_S)
