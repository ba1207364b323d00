# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Connects to a Dask cluster, or starts one on this machine."""

from __future__ import annotations

import asyncio
import logging
import os
import tempfile
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from ..model.errors import ClusterError, UsageError
from ..options.batch import LOCAL
from .dask_unit import distributed
from .pool import no_interrupt, prepare_workers

if TYPE_CHECKING:
    from collections.abc import Iterator

_CONNECT_S = 10.0
_CLOSE_S = 10.0
_FAILURES = 1  # of a local cluster: how often a unit may lose its worker and be run again


@contextmanager
def connected(scheduler: str, jobs: int) -> Iterator[Any]:
    """Yield a client of a cluster; end the cluster if it was started here.

    Args:
        scheduler: Address of the scheduler; LOCAL starts one on the loopback interface.
        jobs: Number of worker processes of a local cluster, of one thread each.

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
            with _local_cluster(jobs) as local, _client(local, LOCAL) as client:
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
    """Connect once: the client waits without end for a server that accepts and says nothing."""
    connection = await distributed().comm.connect(address, timeout=_CONNECT_S)
    await connection.close()


@contextmanager
def _local_cluster(jobs: int) -> Iterator[Any]:
    """Start a scheduler and worker processes on the loopback interface."""
    prepare_workers(cluster=True)
    # The server of workers runs: Dask would import pandas here, for a list of what it is to import.
    distributed().utils._forkserver_preload_set = True  # noqa: SLF001
    folder = tempfile.TemporaryDirectory(prefix='kitti_ros2_')
    settings = {
        'temporary-directory': folder.name,  # of the scheduler; it would leave one behind
        'distributed.scheduler.allowed-failures': _FAILURES,
        'distributed.worker.multiprocessing-method': 'forkserver',
        'distributed.worker.profile.enabled': False,  # no dashboard shows it
        # Dask lets malloc return freed memory at once; reading images would fetch it again.
        'distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_': None,
    }
    with folder, distributed().dask.config.set(settings):
        with no_interrupt():  # a terminal sends Ctrl-C to the workers, too
            cluster = distributed().LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                env=dict(os.environ),  # the server of workers has the one of its start
                processes=True,
                host='127.0.0.1',
                # Without an address it takes port 8787, and warns if that is in use.
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
