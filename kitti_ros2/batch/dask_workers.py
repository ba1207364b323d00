# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs jobs on the workers of a Dask cluster, one that exists or one that is started here.

Dask places the tasks, moves those of a lost worker to another one, and uses workers that join. Only
a few tasks for each thread are at the scheduler at a time, so that a collection may be of any size.
"""

from __future__ import annotations

import pydoc
import time
import uuid
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from ..model.errors import ClusterError
from ..options.batch import LOCAL
from .dask_connection import connected, first_line
from .dask_unit import TOPIC, UnitTask, absolute_job, distributed, is_url, run_task, wrong_version
from .results import UnitResult

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path

    from .pool import JobQueue, Outcome, RunUnit, ShowUnit
    from .results import UnitJob

_POLL_S = 1.0  # between two looks at the number of workers
_PATIENCE_S = 10.0  # for cancelled units to remove their partial outputs
_AHEAD = 2  # tasks for each thread: the one that runs and the next
_VERSION = 'kitti_ros2.__version__'


@contextmanager
def open_cluster(
    scheduler: str, jobs: int, version: str, remark: Callable[[str], None]
) -> Iterator[DaskCluster]:
    """Connect to a cluster and wait for its first worker; end it if it was started here.

    Args:
        scheduler: Address of the scheduler; LOCAL starts one on the loopback interface.
        jobs: Number of worker processes of a local cluster, of one thread each.
        version: Of this package, which the workers must have.
        remark: Called with a line about the workers.

    Raises:
        UsageError: Dask is not installed.
        ClusterError: The scheduler does not answer, or has workers of another version.
    """
    with connected(scheduler, jobs) as client:
        name = 'the local cluster' if scheduler == LOCAL else scheduler
        yield DaskCluster(client, name, version, remark)


class DaskCluster:
    """A cluster whose workers have the same version of this package.

    Attributes:
        workers: Number of threads of its workers, when it was last seen.

    Args:
        client: Of Dask.
        name: The cluster in messages.
        version: Of this package.
        remark: Called with a line about the workers.

    Raises:
        ClusterError: The scheduler or a worker has another version, or the scheduler has ended.
    """

    def __init__(
        self,
        client: Any,  # noqa: ANN401 - Dask has few types
        name: str,
        version: str,
        remark: Callable[[str], None],
    ) -> None:
        self._client = client
        self._name = name
        self._version = version
        self._remark = remark
        self._number = uuid.uuid4().hex
        self._events: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
        self._looked = -_POLL_S
        self._checked: set[str] = set()
        self._pending: dict[str, tuple[Any, UnitJob]] = {}
        self._running: set[str] = set()
        self.workers = 1
        while not self._count_workers():
            with suppress(Empty):
                self._events.get(timeout=_POLL_S)
        self._check_scheduler()

    def run(
        self, queue: JobQueue, run: RunUnit, show: ShowUnit, witness: Path
    ) -> Iterator[Outcome]:
        """Yield the results of jobs in the order in which they end.

        When the iterator ends early, all tasks are cancelled.

        Args:
            queue: The jobs; asked for more after each outcome.
            run: Runs a job; a function of a module, since it is pickled.
            show: As in run_serially.
            witness: A file in the output folder, which shows a worker that it sees that folder.

        Raises:
            ClusterError: The scheduler has ended, or a worker has another version.
        """
        seen = None if is_url(witness) else witness.absolute()
        self._client.subscribe_topic(TOPIC, lambda event: self._events.put(('event', event[1])))
        try:
            while self._submit(queue, run, seen):
                outcome = self._receive(show)
                if outcome is not None:
                    yield outcome
        finally:
            self._cancel()

    def _submit(self, queue: JobQueue, run: RunUnit, witness: Path | None) -> bool:
        """Keep a few tasks for each thread at the scheduler; return False when all have ended."""
        window = _AHEAD * max(self._count_workers(), 1)
        while len(self._pending) < window and (job := queue.take()) is not None:
            task = UnitTask(run, absolute_job(job), self._number, self._version, witness)
            key = f'kitti_ros2-{uuid.uuid4().hex}'
            future = self._client.submit(run_task, task, key=key, pure=False)
            self._pending[key] = future, job
            future.add_done_callback(lambda future: self._events.put(('done', future.key)))
        return bool(self._pending)

    def _receive(self, show: ShowUnit) -> Outcome | None:
        """Wait a moment for an event; return the outcome if a task has ended."""
        try:
            kind, content = self._events.get(timeout=_POLL_S)
        except Empty:
            return None
        if kind == 'done':
            future, job = self._pending.pop(content)
            return job, self._result(future)
        self._follow(content, show)
        return None

    def _follow(self, event: tuple[Any, ...], show: ShowUnit | None) -> None:
        number, kind, name, *counts = event
        if number != self._number:
            return
        if kind == 'begin':
            self._running.add(name)
        elif kind == 'end':
            self._running.discard(name)
        elif show is not None:
            show(name, *counts)

    def _result(self, future: Any) -> UnitResult:  # noqa: ANN401 - Dask is untyped
        try:
            result: UnitResult = future.result()
        except distributed().KilledWorker as error:
            times = error.allowed_failures + 1
            return UnitResult(reason=f'its worker was lost, {times} times; is there enough memory?')
        except ClusterError:
            raise
        except ImportError as error:
            raise ClusterError(
                f'{self._name}: a worker cannot run units ({first_line(error)}); install'
                f' kitti_ros2 {self._version} on all workers'
            ) from error
        except BaseException as error:
            if future.status in {'cancelled', 'lost'} or self._client.status != 'running':
                raise self._ended() from error
            if not isinstance(error, Exception):
                raise
            text = f'{type(error).__name__}: {first_line(error)}'
            return UnitResult(reason=f'internal error on its worker, {text}; please report it')
        return result

    def _count_workers(self) -> int:
        """Return the number of threads of all workers, as it is now and then; say when none."""
        now = time.monotonic()
        if now - self._looked < _POLL_S:
            return self.workers
        self._looked = now
        if self._client.status != 'running':
            raise self._ended()
        try:
            threads: dict[str, int] = self._client.nthreads()
            self._check_workers(threads.keys() - self._checked)
        except OSError as error:
            raise self._ended() from error
        if self.workers and not threads:
            self._remark(f'{self._name} has no workers; waiting for one (Ctrl-C ends)')
        self.workers = sum(threads.values())
        return self.workers

    def _check_workers(self, joined: Collection[str]) -> None:
        """Refuse workers of another version; one that has gone meanwhile is ignored."""
        if not joined:
            return
        found = self._client.run(pydoc.locate, _VERSION, workers=list(joined), on_error='return')
        for address, version in found.items():
            if not isinstance(version, OSError):
                self._compare(f'the worker {address}', version)
                self._checked.add(address)

    def _check_scheduler(self) -> None:
        """Refuse a scheduler of another version: it reads the tasks, too."""
        try:
            found = self._client.run_on_scheduler(pydoc.locate, _VERSION)
        except OSError as error:
            raise self._ended() from error
        except Exception:  # noqa: BLE001 - the package fails to import there
            found = None
        self._compare(f'the scheduler of {self._name}', found)

    def _compare(self, name: str, found: object) -> None:
        if found != self._version:
            known = found if isinstance(found, str) else None
            raise ClusterError(wrong_version(name, known, self._version))

    def _ended(self) -> ClusterError:
        return ClusterError(
            f'{self._name}: the scheduler has ended or cannot be reached any more; run the command'
            ' again to do what is left (kitti-ros2 status OUT shows it)'
        )

    def _cancel(self) -> None:
        """Cancel the tasks, and wait until those that run have removed their partial outputs."""
        futures = [future for future, _ in self._pending.values()]
        self._pending.clear()
        if not futures or self._client.status != 'running':
            return
        end = time.monotonic() + _PATIENCE_S
        with suppress(OSError, Empty):
            self._client.cancel(futures)
            while self._running or not self._events.empty():
                kind, content = self._events.get(timeout=max(end - time.monotonic(), 0.0))
                if kind == 'event':
                    self._follow(content, None)
