# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A lock in a store: an object whose owner writes it anew again and again.

Clocks of machines differ, so that a lease is not a time of day: a lock whose content stays the same
for the whole lease, as its observer measures it, is left over from a run that was killed.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.errors import KittiRos2Error, OutputError
from .signal_hold import deferred_signals
from .store_objects import StoreError, create_object, read_object, remove_objects, write_object

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .remote import RemotePath

LEASE_S = 30.0
_RENEWALS = 3  # within a lease
_POLL_S = 1.0


@dataclass
class StoreLock:
    """A lock that this process holds.

    Attributes:
        path: Its object.
        lost: Set if another run has taken the lock.
    """

    path: RemotePath
    lost: threading.Event

    def check(self) -> None:
        """Raise an error if the lock was lost.

        Raises:
            OutputError: Another run has taken it.
        """
        if self.lost.is_set():
            raise OutputError(
                self.path,
                'another run has taken this lock, as this one did not answer for too long',
                'run one of the two again',
            )


@contextmanager
def locked_in_store(
    path: RemotePath, lease_s: float = LEASE_S, wait: Callable[[float], None] = time.sleep
) -> Iterator[StoreLock]:
    """Hold a lock, renewed by a thread.

    Where a store has no conditional requests, two runs that begin at the same moment may both
    get it for a moment; the one that wrote first notices it at its first renewal.

    Args:
        path: The object.
        lease_s: After which time without renewals the lock is taken over.
        wait: Waits so many seconds.

    Raises:
        OutputError: Another run holds it.
        StoreError: The store cannot be asked.
    """
    lock = _Lock(path, lease_s)
    lock.acquire(wait)
    thread = threading.Thread(target=lock.renew_until_stopped, daemon=True)
    with deferred_signals():  # as the event below, it shares a condition with its thread
        thread.start()
    try:
        yield StoreLock(path, lock.lost)
    finally:
        with deferred_signals():
            lock.stopped.set()
        thread.join()
        lock.release()


class _Lock:
    def __init__(self, path: RemotePath, lease_s: float) -> None:
        self._path = path
        self._lease_s = lease_s
        self._owner = {**_this_process(), 'run': secrets.token_hex(8)}
        self._beat = 0
        self.lost = threading.Event()
        self.stopped = threading.Event()

    def acquire(self, wait: Callable[[float], None]) -> None:
        """Create the object, or take over one that is left over."""
        if create_object(self._path, self._content()):
            return
        seen = read_object(self._path)
        polls = max(1, round(self._lease_s / _POLL_S))
        for _ in range(0 if _is_dead(seen) else polls):
            wait(_POLL_S)
            now = read_object(self._path)
            if now is None:
                break
            if now != seen:
                raise OutputError(
                    self._path.parent,
                    f'another run is writing this ({_describe(now)})',
                    'wait for it, or choose another name',
                )
        remove_objects([self._path])
        if not create_object(self._path, self._content()):
            raise OutputError(
                self._path.parent, 'another run has just begun to write this', 'wait for it'
            )

    def renew_until_stopped(self) -> None:
        """Renew the lock until it is released or lost."""
        while not self.stopped.wait(self._lease_s / _RENEWALS):
            try:
                if not self._is_ours():
                    self.lost.set()
                    return
                self._beat += 1
                write_object(self._path, self._content())
            except KittiRos2Error:
                continue  # the store may answer again; if not, the run fails by itself

    def release(self) -> None:
        """Remove the object if it is ours; never raises an error of the store."""
        with suppress(StoreError):
            if self._is_ours():
                remove_objects([self._path])

    def _content(self) -> bytes:
        return json.dumps({**self._owner, 'beat': self._beat}, sort_keys=True).encode()

    def _is_ours(self) -> bool:
        return _parsed(read_object(self._path)).get('run') == self._owner['run']


def _this_process() -> dict[str, object]:
    return {'host': socket.gethostname(), 'space': _process_space(), 'pid': os.getpid()}


def _process_space() -> str:
    """Return what tells machines and containers apart: boot and process namespace."""
    with suppress(OSError):
        boot = Path('/proc/sys/kernel/random/boot_id').read_text(encoding='ascii').strip()
        return f'{boot} {Path("/proc/self/ns/pid").readlink()}'
    return ''


def _is_dead(content: bytes | None) -> bool:
    """Whether a lock is of a process of this machine that has ended."""
    owner = _parsed(content)
    space, pid = owner.get('space'), owner.get('pid')
    if not space or space != _process_space() or owner.get('host') != socket.gethostname():
        return False
    if not isinstance(pid, int):
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False


def _parsed(content: bytes | None) -> dict[str, object]:
    with suppress(ValueError):
        found = json.loads(content or b'{}')
        if isinstance(found, dict):
            return found
    return {}


def _describe(content: bytes) -> str:
    owner = _parsed(content)
    return f'process {owner.get("pid", "?")} on {owner.get("host", "?")}'
