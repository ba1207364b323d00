# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs tasks one after the other, or on worker processes.

Workers are forked from a server process, a new interpreter with their imports: a fork of this
process would copy locks that other threads hold. They ignore Ctrl-C, which a terminal sends to all
processes, and end with the process that started them.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.util import get_temp_dir
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from ..files.processes import keep_freed_memory
from ..files.threads import limit_to_one_thread

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from multiprocessing.context import ForkServerProcess
    from pathlib import Path

    from .jobs import Job


# Tasks and results; both are pickled.

Advance: TypeAlias = Callable[[int, int], None]
"""A callback for the samples done and the number of all."""


@dataclass(frozen=True)
class JobTask:
    """A job with its output and options.

    Attributes:
        job: The job.
        out: Path of its output.
        options: Values of the command's options by name.
        attempt: Number of the attempt, from 1; later ones follow lost workers.
    """

    job: Job
    out: Path
    options: Mapping[str, object]
    attempt: int = 1


@dataclass(frozen=True)
class JobResult:
    """The result of a job.

    Attributes:
        counts: Number of written frames, messages, bytes.
        bad: Number of skipped samples and files.
        losses: First few reasons for skipping, one line each.
        notes: Lines that cost no data.
        reason: Reason of failure; empty for success.
        seconds: Time taken.
    """

    counts: Mapping[str, int] = field(default_factory=dict)
    bad: int = 0
    losses: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    reason: str = ''
    seconds: float = 0.0

    @property
    def failed(self) -> bool:
        """True without an output."""
        return bool(self.reason)


@dataclass(frozen=True)
class LostWorker:
    """A worker process ended in the middle of a job.

    Attributes:
        how: The signal or exit code.
    """

    how: str


if TYPE_CHECKING:
    RunJob: TypeAlias = Callable[[JobTask, Advance], JobResult]
    Outcome: TypeAlias = tuple[JobTask, JobResult | LostWorker]
    ShowJob: TypeAlias = Callable[[str, int, int], None]

_EXIT_TERMINATED = 143
_LONGEST_FOLDER = 60  # bytes; multiprocessing adds 32
_ADVANCE_S = 0.2  # between two reports of progress
_PATIENCE_S = 10.0  # for removing the partial output of a worker


def prepare_workers(*, cluster: bool = False) -> None:
    """Start the server of workers, which imports their modules in parallel.

    Args:
        cluster: True for workers of a local Dask cluster.
    """
    context = multiprocessing.get_context('forkserver')
    imports = 'cluster_imports' if cluster else 'worker_imports'
    context.set_forkserver_preload([f'{__package__}.{imports}'])
    resource_tracker.ensure_running()  # its start unblocks Ctrl-C
    with no_interrupt(), _short_socket_names():
        forkserver.ensure_running()


@contextmanager
def _short_socket_names() -> Iterator[None]:
    """Keep multiprocessing's sockets out of a TMPDIR with a long name: unix(7) allows 107 bytes."""
    before = tempfile.tempdir
    if len(os.fsencode(tempfile.gettempdir())) > _LONGEST_FOLDER:
        tempfile.tempdir = '/tmp'  # noqa: S108 - mkdtemp makes a folder of this user in it
    try:
        get_temp_dir()
        yield
    finally:
        tempfile.tempdir = before


def use_one_thread() -> None:
    """Limit this package and OpenCV to one thread."""
    limit_to_one_thread()
    os.environ['OPENCV_FOR_THREADS_NUM'] = '1'  # read at its import
    if 'cv2' in sys.modules:
        sys.modules['cv2'].setNumThreads(1)


class TaskQueue(Protocol):
    """Tasks to run."""

    def take(self) -> JobTask | None:
        """Return the next task; None without any now."""


def run_serially(queue: TaskQueue, run: RunJob, show: ShowJob) -> Iterator[Outcome]:
    """Yield the result of each task, run in this process.

    Args:
        queue: The tasks.
        run: Function that runs a task.
        show: Called with the name of a job, the samples done and the number of all.
    """
    while (task := queue.take()) is not None:
        name = task.job.name
        yield task, run(task, lambda done, total, name=name: show(name, done, total))  # type: ignore[misc]


def run_on_processes(
    queue: TaskQueue, run: RunJob, show: ShowJob, workers: int, lock_fd: int
) -> Iterator[Outcome]:
    """Yield the results of tasks on worker processes, in the order of their ends.

    A task whose worker was killed yields LostWorker; another worker replaces it. The workers end
    with the iterator.

    Args:
        queue: The tasks, queried after each outcome.
        run: Function of a module that runs a task; it is pickled.
        show: Callback as of run_serially.
        workers: Number of processes.
        lock_fd: A descriptor that workers keep open to their end, such as that of a lock.
    """
    pool: list[_Worker] = []
    try:
        while busy := _busy(pool, queue, lambda: _Worker(run, lock_fd), workers):
            for ready in wait(list(busy)):
                worker = busy[ready]
                outcome = worker.receive(show)
                if outcome is None:
                    continue
                if isinstance(outcome[1], LostWorker):
                    pool.remove(worker)
                yield outcome
    finally:
        try:
            for worker in pool:
                worker.stop()
            for worker in pool:
                worker.join()
        except BaseException:  # Ctrl-C or SIGTERM again: exit would wait for a hanging worker
            for worker in pool:
                worker.kill()
            raise


def _busy(
    pool: list[_Worker], queue: TaskQueue, start: Callable[[], _Worker], workers: int
) -> dict[Any, _Worker]:
    """Send tasks to idle workers, and to new ones up to their number; return the busy ones."""
    for worker in pool:
        if worker.task is None:
            worker.send(queue.take())
    while len(pool) < workers and (task := queue.take()) is not None:
        pool.append(start())
        pool[-1].send(task)
    return {worker.connection: worker for worker in pool if worker.task is not None}


class _Worker:
    """A worker process and its task."""

    def __init__(self, run: RunJob, lock_fd: int) -> None:
        prepare_workers()
        context = multiprocessing.get_context('forkserver')
        self.connection, theirs = context.Pipe()
        self.task: JobTask | None = None
        with theirs, Connection(os.dup(lock_fd)) as lock, no_interrupt():
            self._process: ForkServerProcess = context.Process(
                target=_serve, args=(run, theirs, lock, dict(os.environ)), daemon=True
            )
            self._process.start()

    def send(self, task: JobTask | None) -> None:
        """Send a task."""
        self.task = task
        if task is not None:
            with suppress(BrokenPipeError, ConnectionResetError):  # noticed by receive
                self.connection.send(task)

    def receive(self, show: ShowJob) -> Outcome | None:
        """Receive a result; None for progress."""
        task = self.task
        if task is None:
            raise RuntimeError('a worker without a job reports')
        try:
            kind, content = self.connection.recv()
        except (EOFError, ConnectionResetError):
            self.connection.close()
            self._process.join()
            self.task = None
            return task, LostWorker(self._how())
        if kind == 'advance':
            show(task.job.name, *content)
            return None
        self.task = None
        return task, content

    def _how(self) -> str:
        code = self._process.exitcode or 0
        return f'was killed by signal {-code}' if code < 0 else f'ended with exit code {code}'

    def stop(self) -> None:
        """Terminate the process, which removes its partial output."""
        self._process.terminate()

    def kill(self) -> None:
        """End the process at once: the next run removes its partial output."""
        self._process.kill()

    def join(self) -> None:
        """Wait for the end of the process, or kill it."""
        self._process.join(_PATIENCE_S)
        self.kill()
        self._process.join()
        self.connection.close()


@contextmanager
def no_interrupt() -> Iterator[None]:
    """Block Ctrl-C here, and permanently in processes started inside."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(
    run: RunJob,
    connection: Any,  # noqa: ANN401 - a Connection
    lock: Any,  # noqa: ANN401, ARG001 - a Connection, kept open until this process ends
    environment: dict[str, str],
) -> None:
    """Run received tasks in a worker process.

    Its environment is that of the client: the server of workers has that of its start, which a
    program may have changed since, as for another store.
    """
    os.environ.clear()
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(_EXIT_TERMINATED))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    use_one_thread()
    keep_freed_memory()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            task: JobTask = connection.recv()
            connection.send(('end', run(task, _Advancing(connection))))


class _Advancing:
    """Reports the progress of a task at intervals."""

    def __init__(self, connection: Any) -> None:  # noqa: ANN401 - a Connection
        self._connection = connection
        self._last = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._last >= _ADVANCE_S:
            self._last = now
            self._connection.send(('advance', (done, total)))


def _end_with_parent() -> None:
    """End this process with its parent, which also ends a lock on its output."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(_EXIT_TERMINATED)
