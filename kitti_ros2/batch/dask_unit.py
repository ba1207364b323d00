# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A unit as a task of Dask: runs on a worker, reports its progress, stops when it is cancelled."""

from __future__ import annotations

import os
import socket
import time
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.freed_memory import keep_freed_memory
from ..files.staging import taking_over
from ..model.errors import ClusterError
from .pool import use_one_thread
from .results import UnitResult

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .pool import RunUnit
    from .results import UnitJob

TOPIC = 'kitti_ros2'
"""Topic of the events that workers report: run, kind, name of the unit, samples done, of all."""
_ADVANCE_S = 1.0  # between two reports of progress: all go through the scheduler
_RUNNING = 'executing'


@dataclass(frozen=True)
class UnitTask:
    """A job as it is sent to a worker.

    Attributes:
        run: Runs a job; a function of a module.
        job: The job, with absolute paths.
        number: Of the run over the collection, random: it tells its events from those of others.
        version: Of this package, at the client.
        witness: A file in the output folder, which every worker must see; None if it is remote.
    """

    run: RunUnit
    job: UnitJob
    number: str
    version: str
    witness: Path | None


class _UnwantedError(BaseException):
    """The unit is not wanted any more. No Exception: units turn those into results."""


def distributed() -> Any:  # noqa: ANN401 - it has few types
    """Return the package distributed of Dask; most commands do not need it."""
    return import_module('distributed')


def absolute_job(job: UnitJob) -> UnitJob:
    """Return a job without relative paths: workers have working folders of their own."""
    options: Mapping[str, object] = {
        name: _absolute(value) if isinstance(value, Path) else value
        for name, value in job.options.items()
    }
    unit = replace(job.unit, source=_absolute(job.unit.source))
    return replace(job, unit=unit, out=_absolute(job.out), options=options)


def is_url(path: Path) -> bool:
    """Whether a path is that of a store, which all workers reach under the same name."""
    return '://' in str(path)


def _absolute(path: Path) -> Path:
    return path if is_url(path) else path.absolute()


def run_task(task: UnitTask) -> UnitResult | None:
    """Run a unit on a worker of Dask; None if it was cancelled.

    Raises:
        ClusterError: The worker has another version of this package.
    """
    worker = distributed().get_worker()
    if (found := own_version()) != task.version:
        raise ClusterError(wrong_version(worker.address, found, task.version))
    unseen = _unseen(task)
    if unseen is not None:
        return UnitResult(
            reason=f'{unseen}: not found on the worker {worker.address} ({socket.gethostname()});'
            ' SRC and OUT must be at the same path on all workers, or be URLs'
        )
    use_one_thread()
    keep_freed_memory()
    reporter = _Reporter(worker, task)
    reporter.report('begin')
    try:
        with taking_over():  # of an attempt on a worker that Dask has given up
            return task.run(task.job, reporter)
    except _UnwantedError:
        return None
    finally:
        reporter.report('end')


def wrong_version(address: str, found: str | None, expected: str) -> str:
    """Describe a worker, or the scheduler, that cannot run units of this version."""
    has = 'has no kitti_ros2' if found is None else f'has kitti_ros2 {found}'
    return (
        f'{address} {has}, expected {expected}; install the same version on the scheduler and on'
        ' all workers'
    )


@cache
def own_version() -> str:
    """Return the version of this package in this process."""
    from .. import __version__  # noqa: PLC0415 - 22 ms

    return __version__


def _unseen(task: UnitTask) -> Path | None:
    """Return a path that this worker does not see.

    Without its folder an output would be written to the worker's own disk, and lost.
    """
    places = (task.job.unit.source, task.witness, task.job.out.parent)
    for path in places:
        if path is not None and not is_url(path) and not os.path.lexists(path):
            return path
    return None


class _Reporter:
    """Reports the progress of a unit; raises when it is not wanted any more."""

    def __init__(self, worker: Any, task: UnitTask) -> None:  # noqa: ANN401 - Dask is untyped
        self._worker = worker
        self._key = worker.get_current_task()
        self._run, self._name = task.number, task.job.unit.name
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
        """Whether the worker still counts, and its task too.

        Threads cannot be killed: a worker that the scheduler has given up, or whose task the
        client has cancelled, stops here.
        """
        task = self._worker.state.tasks.get(self._key)
        closing = self._worker.status.name in {'closing', 'closed', 'failed'}
        return task is not None and task.state == _RUNNING and not closing
