# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tasks on the workers of a Dask cluster, existing or started on this machine."""

from __future__ import annotations

import asyncio
import logging
import os
import pydoc
import socket
import tempfile
import time
import uuid
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from ..files.local_staging import taking_over
from ..files.processes import keep_freed_memory
from ..model.errors import ClusterError, UsageError
from ..options.table import LOCAL
from .pool import JobResult, no_interrupt, prepare_workers, use_one_thread

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping

    from .pool import JobTask, Outcome, RunJob, ShowJob, TaskQueue


# A job as a task of Dask: runs on a worker, reports progress, stops when cancelled.

TOPIC = 'kitti_ros2'
"""Topic of the workers' events: run, kind, name of the job, samples done, of all."""
_ADVANCE_S = 1.0  # between reports of progress, which all go through the scheduler
_RUNNING = 'executing'


@dataclass(frozen=True)
class DaskTask:
    """A task for a worker.

    Attributes:
        run: Function of a module that runs a task.
        task: The task, with absolute paths.
        number: Random number of the run over the collection, which its events have.
        version: Version of this package at the client.
        witness: A file in the output folder that every worker must see; None for a remote folder.
    """

    run: RunJob
    task: JobTask
    number: str
    version: str
    witness: Path | None


class _UnwantedError(BaseException):
    """The task was cancelled. No Exception, which functions of jobs return as a result."""


def distributed() -> Any:  # noqa: ANN401 - it has few types
    """Return Dask's package distributed, imported only here."""
    return import_module('distributed')


def absolute_task(task: JobTask) -> JobTask:
    """Return a task without relative paths: workers have other working folders."""
    options: Mapping[str, object] = {
        name: _absolute(value) if isinstance(value, Path) else value
        for name, value in task.options.items()
    }
    job = replace(task.job, source=_absolute(task.job.source))
    return replace(task, job=job, out=_absolute(task.out), options=options)


def is_url(path: Path) -> bool:
    """Return whether a path is a store's, equal for all workers."""
    return '://' in str(path)


def _absolute(path: Path) -> Path:
    return path if is_url(path) else path.absolute()


def run_dask_task(dask_task: DaskTask) -> JobResult | None:
    """Run a job on a worker of Dask; return None if cancelled.

    Raises:
        ClusterError: The worker has another version of this package.
    """
    worker = distributed().get_worker()
    if (version := own_version()) != dask_task.version:
        raise ClusterError(wrong_version(worker.address, version, dask_task.version))
    unseen = _unseen(dask_task)
    if unseen is not None:
        return JobResult(
            reason=f'{unseen}: not found on the worker {worker.address} ({socket.gethostname()});'
            ' SRC and OUT must be at the same path on all workers, or be URLs'
        )
    use_one_thread()
    keep_freed_memory()
    reporter = _Reporter(worker, dask_task)
    reporter.report('begin')
    try:
        with taking_over():  # by an attempt on a worker that Dask removed
            return dask_task.run(dask_task.task, reporter)
    except _UnwantedError:
        return None
    finally:
        reporter.report('end')


def wrong_version(address: str, version: str | None, expected: str) -> str:
    """Describe a worker or scheduler of another version."""
    has = 'has no kitti_ros2' if version is None else f'has kitti_ros2 {version}'
    return (
        f'{address} {has}, expected {expected}; install the same version on the scheduler and on'
        ' all workers'
    )


@cache
def own_version() -> str:
    """Return the version of this package in this process."""
    from .. import __version__  # noqa: PLC0415 - 22 ms

    return __version__


def _unseen(dask_task: DaskTask) -> Path | None:
    """Return a path that is missing on this worker; None without any.

    Without its folder an output would be written to the worker's own disk, and lost.
    """
    paths = (dask_task.task.job.source, dask_task.witness, dask_task.task.out.parent)
    for path in paths:
        if path is not None and not is_url(path) and not os.path.lexists(path):
            return path
    return None


class _Reporter:
    """Reports the progress of a job; raises once it is cancelled."""

    def __init__(self, worker: Any, dask_task: DaskTask) -> None:  # noqa: ANN401 - Dask is untyped
        self._worker = worker
        self._key = worker.get_current_task()
        self._run, self._name = dask_task.number, dask_task.task.job.name
        self._last = time.monotonic()

    def report(self, kind: str, *counts: int) -> None:
        self._worker.log_event(TOPIC, (self._run, kind, self._name, *counts))

    def __call__(self, done: int, total: int) -> None:
        if not self._is_wanted():
            raise _UnwantedError
        now = time.monotonic()
        if now - self._last >= _ADVANCE_S:
            self._last = now
            self.report('advance', done, total)

    def _is_wanted(self) -> bool:
        """Return whether the worker and its task are still in use.

        Threads cannot be killed: a worker that the scheduler removed, or whose task the client
        cancelled, stops here.
        """
        task = self._worker.state.tasks.get(self._key)
        closing = self._worker.status.name in {'closing', 'closed', 'failed'}
        return task is not None and task.state == _RUNNING and not closing


# Connects to a Dask cluster, or starts one on this machine.

_CONNECT_S = 10.0
_CLOSE_S = 10.0
_FAILURES = 1  # of a local cluster: lost workers before a job fails


@contextmanager
def connected(scheduler: str, workers: int) -> Iterator[Any]:
    """Yield a client of a cluster; end the cluster if it was started here.

    Args:
        scheduler: Address of the scheduler; LOCAL starts one on the loopback interface.
        workers: Number of worker processes of a local cluster, of one thread each.

    Raises:
        UsageError: Dask is not installed.
        ClusterError: The scheduler does not answer.
    """
    if find_spec('distributed') is None:
        raise UsageError(
            '--scheduler needs distributed, which is not installed; run pip install'
            " 'kitti_ros2[cluster]'"
        )
    with distributed().utils.silence_logging_cmgr(logging.CRITICAL):
        if scheduler == LOCAL:
            with _local_cluster(workers) as local, _client(local, LOCAL) as client:
                yield client
        else:
            with _client(scheduler, scheduler) as client:
                yield client


@contextmanager
def _client(target: object, name: str) -> Iterator[Any]:
    try:
        if isinstance(target, str):
            asyncio.run(asyncio.wait_for(_greet(target), 2 * _CONNECT_S))
        client = distributed().Client(target, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, asyncio.TimeoutError, ValueError) as error:
        raise ClusterError(
            f'{name}: no Dask scheduler answers ({first_line(error)}); is it running, and is this'
            ' its address?'
        ) from error
    try:
        yield client
    finally:
        with suppress(Exception):  # of a scheduler that has ended
            client.close(timeout=_CLOSE_S)


async def _greet(address: str) -> None:
    """Connect once: the client waits without end for a server that accepts and is silent."""
    connection = await distributed().comm.connect(address, timeout=_CONNECT_S)
    await connection.close()


@contextmanager
def _local_cluster(workers: int) -> Iterator[Any]:
    """Start a scheduler and worker processes on the loopback interface."""
    prepare_workers(cluster=True)
    # The server of workers runs already: Dask would import pandas here for its list of imports.
    distributed().utils._forkserver_preload_set = True  # noqa: SLF001
    folder = tempfile.TemporaryDirectory(prefix='kitti_ros2_')
    settings = {
        'temporary-directory': folder.name,  # of the scheduler, which does not remove its own
        'distributed.scheduler.allowed-failures': _FAILURES,
        'distributed.worker.multiprocessing-method': 'forkserver',
        'distributed.worker.profile.enabled': False,  # for dashboards only
        # Dask makes malloc return freed memory at once, which slows reading of images.
        'distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_': None,
    }
    with folder, distributed().dask.config.set(settings):
        with no_interrupt():  # a terminal sends Ctrl-C to the workers, too
            cluster = distributed().LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                env=dict(os.environ),  # the server's is that of its start
                processes=True,
                host='127.0.0.1',
                # The default is port 8787, with a warning if in use.
                dashboard_address='127.0.0.1:0',
                scheduler_kwargs={'dashboard': False},
                memory_limit=0,
                local_directory=folder.name,
                silence_logs=logging.CRITICAL,
            )
        try:
            yield cluster
        finally:
            cluster.close(timeout=_CLOSE_S)


def first_line(error: BaseException) -> str:
    """Return the first line of an error's message, or its type."""
    return next(iter(str(error).splitlines()), type(error).__name__)


# Runs tasks on the workers of a Dask cluster.
#
# Dask distributes the tasks, also those of lost workers, and uses workers that join. Few tasks for
# each thread are at the scheduler at a time, for collections of any size.

_POLL_S = 1.0  # between two queries of the number of workers
_PATIENCE_S = 10.0  # for removing the partial outputs of cancelled jobs
_AHEAD = 2  # tasks for each thread: the running one and the next
_VERSION = 'kitti_ros2.__version__'


@contextmanager
def open_cluster(
    scheduler: str, workers: int, version: str, note: Callable[[str], None]
) -> Iterator[DaskCluster]:
    """Connect to a cluster and wait for its first worker; end it if it was started here.

    Args:
        scheduler: Address of the scheduler; LOCAL starts one on the loopback interface.
        workers: Number of worker processes of a local cluster, of one thread each.
        version: Version of this package, required of the workers.
        note: Called with a line about the workers.

    Raises:
        UsageError: Dask is not installed.
        ClusterError: The scheduler does not answer, or has workers of another version.
    """
    with connected(scheduler, workers) as client:
        name = 'the local cluster' if scheduler == LOCAL else scheduler
        yield DaskCluster(client, name, version, note)


class DaskCluster:
    """A cluster whose workers have the same version of this package.

    Attributes:
        workers: Number of threads of its workers, at the last query.

    Args:
        client: Dask's client.
        name: Name of the cluster in messages.
        version: Version of this package.
        note: Called with a line about the workers.

    Raises:
        ClusterError: The scheduler or a worker has another version, or the scheduler has ended.
    """

    def __init__(
        self,
        client: Any,  # noqa: ANN401 - Dask has few types
        name: str,
        version: str,
        note: Callable[[str], None],
    ) -> None:
        self._client = client
        self._name = name
        self._version = version
        self._note = note
        self._number = uuid.uuid4().hex
        self._events: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
        self._looked = -_POLL_S
        self._checked: set[str] = set()
        self._pending: dict[str, tuple[Any, JobTask]] = {}
        self._running: set[str] = set()
        self.workers = 1
        while not self._count_workers():
            with suppress(Empty):
                self._events.get(timeout=_POLL_S)
        self._check_scheduler()

    def run(self, queue: TaskQueue, run: RunJob, show: ShowJob, witness: Path) -> Iterator[Outcome]:
        """Yield the results of tasks in the order of their ends.

        When the iterator ends early, all tasks are cancelled.

        Args:
            queue: The tasks, queried after each outcome.
            run: Function of a module that runs a task; it is pickled.
            show: Callback as of run_serially.
            witness: A file in the output folder that every worker must see.

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

    def _submit(self, queue: TaskQueue, run: RunJob, witness: Path | None) -> bool:
        """Submit a few tasks for each thread; return False when all have ended."""
        window = _AHEAD * max(self._count_workers(), 1)
        while len(self._pending) < window and (task := queue.take()) is not None:
            dask_task = DaskTask(run, absolute_task(task), self._number, self._version, witness)
            key = f'kitti_ros2-{uuid.uuid4().hex}'
            future = self._client.submit(run_dask_task, dask_task, key=key, pure=False)
            self._pending[key] = future, task
            future.add_done_callback(lambda future: self._events.put(('done', future.key)))
        return bool(self._pending)

    def _receive(self, show: ShowJob) -> Outcome | None:
        """Wait briefly for an event; return the outcome of an ended task."""
        try:
            kind, content = self._events.get(timeout=_POLL_S)
        except Empty:
            return None
        if kind == 'done':
            future, task = self._pending.pop(content)
            return task, self._result(future)
        self._follow(content, show)
        return None

    def _follow(self, event: tuple[Any, ...], show: ShowJob | None) -> None:
        number, kind, name, *counts = event
        if number != self._number:
            return
        if kind == 'begin':
            self._running.add(name)
        elif kind == 'end':
            self._running.discard(name)
        elif show is not None:
            show(name, *counts)

    def _result(self, future: Any) -> JobResult:  # noqa: ANN401 - Dask is untyped
        try:
            result: JobResult = future.result()
        except distributed().KilledWorker as error:
            times = error.allowed_failures + 1
            return JobResult(reason=f'its worker was lost, {times} times; is there enough memory?')
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
            return JobResult(reason=f'internal error on its worker, {text}; please report it')
        return result

    def _count_workers(self) -> int:
        """Return the number of threads of all workers, queried at intervals; note when none."""
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
            self._note(f'{self._name} has no workers; waiting for one (Ctrl-C ends)')
        self.workers = sum(threads.values())
        return self.workers

    def _check_workers(self, joined: Collection[str]) -> None:
        """Refuse workers of another version; ignore lost ones."""
        if not joined:
            return
        versions = self._client.run(pydoc.locate, _VERSION, workers=list(joined), on_error='return')
        for address, version in versions.items():
            if not isinstance(version, OSError):
                self._compare(f'the worker {address}', version)
                self._checked.add(address)

    def _check_scheduler(self) -> None:
        """Refuse a scheduler of another version, which unpickles the tasks, too."""
        try:
            version = self._client.run_on_scheduler(pydoc.locate, _VERSION)
        except OSError as error:
            raise self._ended() from error
        except Exception:  # noqa: BLE001 - the import fails there
            version = None
        self._compare(f'the scheduler of {self._name}', version)

    def _compare(self, name: str, version: object) -> None:
        if version != self._version:
            version_text = version if isinstance(version, str) else None
            raise ClusterError(wrong_version(name, version_text, self._version))

    def _ended(self) -> ClusterError:
        return ClusterError(
            f'{self._name}: the scheduler has ended or cannot be reached any more; run the command'
            ' again to do what is left (kitti-ros2 status OUT shows it)'
        )

    def _cancel(self) -> None:
        """Cancel the tasks, and wait until running ones have removed their partial outputs."""
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
