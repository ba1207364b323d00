# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a command over a collection: skips jobs that are done, records all in the manifest."""

from __future__ import annotations

import hashlib
import json
import os
from collections import deque
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..files.remote import is_remote, relative_path
from ..files.threads import worker_count
from ..kitti.names import number_of
from ..kitti.opening import parts_of
from ..kitti.store import cached_listings
from ..model.errors import KittiRos2Error, UsageError, describe_error
from .dask_cluster import open_cluster
from .manifest import DONE, FAILED, MANIFEST, Identity, JobRecord, Manifest, open_out_folder
from .pool import JobResult, JobTask, LostWorker, run_on_processes, run_serially

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from ..files.remote import RemotePath
    from ..files.remote_reads import RemoteEntry
    from ..model.streams import Layout
    from ..options.table import BatchOptions
    from .dask_cluster import DaskCluster
    from .jobs import Job
    from .manifest import OutFolder
    from .pool import Outcome, RunJob


# Fingerprints of a job's input: the names, sizes and times of change of its files.
#
# Files in stores also have ETags. All come from listings of folders; web servers list names only.

_SHARED_MEMORY = '.db3-shm'  # made by readers of SQLite


class InputFile(NamedTuple):
    """A file of a job.

    Attributes:
        name: Path below the job's folder.
        size: Bytes; -1 if a store does not list them.
        mtime_ns: Time of the last change.
        tag: A store's ETag; empty if there is none.
    """

    name: str
    size: int
    mtime_ns: int
    tag: str = ''

    @property
    def number(self) -> int | None:
        """The number of a frame in its name; None in others."""
        return number_of(Path(self.name).stem)


def fingerprint(job: Job) -> str:
    """Return the fingerprint of a job's files: for a slice, those of its frames and common ones.

    Missing files are left out.

    Raises:
        OSError: A folder cannot be read.
    """
    files: Iterable[InputFile]
    if job.layout is None:
        files = _walk(job.source, job.source.parent)
    else:
        files = _files_of(job.source, job.layout, job.sequence)
    if job.result is not None:
        files = [*files, *_walk(job.result, job.result.parent)]
    if job.first is not None and job.last is not None:
        first, last = job.first, job.last
        files = (file for file in files if file.number is None or first <= file.number <= last)
    return _digest(files)


def fingerprint_paths(paths: Iterable[Path]) -> str:
    """Return the fingerprint of files and folders in options.

    Raises:
        OSError: A folder cannot be read.
    """
    return _digest(input_file for path in paths for input_file in _walk(path, path.parent))


def _digest(files: Iterable[InputFile]) -> str:
    digest = hashlib.sha256()
    for file in sorted(files):
        tag = f'\0{file.tag}' if file.tag else ''
        text = f'{file.name}\0{file.size}\0{file.mtime_ns}{tag}\n'
        digest.update(text.encode(errors='replace'))
    return digest.hexdigest()


@lru_cache(maxsize=1)  # slices of a set are successive
@cached_listings()
def _files_of(source: Path, layout: Layout, sequence: str | None) -> tuple[InputFile, ...]:
    try:
        parts = parts_of(source, layout, sequence)
    except KittiRos2Error:
        parts = [source]  # its job fails with this error, until something there changes
    return tuple(sorted({input_file for part in parts for input_file in _walk(part, source)}))


def _walk(path: Path, base: Path) -> Iterator[InputFile]:
    """Yield the files at a path, except those that disappear meanwhile."""
    if is_remote(path):
        yield from _walk_store(path, relative_path(path, base))
        return
    if not path.is_dir():
        if path.is_file():
            status = path.stat()
            yield InputFile(os.path.relpath(path, base), status.st_size, status.st_mtime_ns)
        return
    prefix = os.path.relpath(path, base)
    folders = [(str(path), prefix)]
    while folders:
        folder, prefix = folders.pop()
        with os.scandir(folder) as entries:
            for entry in entries:
                name = f'{prefix}/{entry.name}'
                if entry.is_dir(follow_symlinks=False):
                    folders.append((entry.path, name))
                elif entry.is_file() and not name.endswith(_SHARED_MEMORY):
                    status = entry.stat()
                    yield InputFile(name, status.st_size, status.st_mtime_ns)


def _walk_store(path: RemotePath, prefix: str) -> Iterator[InputFile]:
    """Yield the files at a URL, by one listing of each folder."""
    from ..files.remote_reads import listing_of, sized_entry_of  # noqa: PLC0415 - for URLs only

    try:
        entry = sized_entry_of(path)
    except (FileNotFoundError, NotADirectoryError):
        return
    if not entry.is_folder:
        yield _stored(prefix, entry)
        return
    folders = [(path, prefix)]
    while folders:
        folder, prefix = folders.pop()
        for name, entry in listing_of(folder).items():
            if entry.is_folder:
                folders.append((folder / name, f'{prefix}/{name}'))
            else:
                yield _stored(f'{prefix}/{name}', entry)


def _stored(name: str, entry: RemoteEntry) -> InputFile:
    size = -1 if entry.size is None else entry.size
    return InputFile(name, size, entry.changed_ns, entry.tag)


_OF_DISK = {'overwrite', 'fsync'}
"""Options without effect on the content of an output."""
_ATTEMPTS = 2  # the cause of a killed worker may be another process


class Progress:
    """Reports of a running collection; this one shows nothing."""

    def skip(self, job: str) -> None:
        """Report a job that was done, or failed, before."""

    def begin(self, job: str) -> None:
        """Report the start of a job."""

    def advance(self, job: str, done: int, total: int) -> None:
        """Report the converted samples of a job."""

    def end(self, job: str) -> None:
        """Report the end of a job."""

    def note(self, text: str) -> None:
        """Report a line about the workers, such as that none has joined yet."""


def _own_version() -> str:
    from .. import __version__  # noqa: PLC0415 - 22 ms

    return __version__


@dataclass(frozen=True)
class Collection:
    """A command over the jobs of a collection.

    Attributes:
        command: Name.
        out: The folder of outputs.
        suffix: Suffix of outputs, added to the names of jobs.
        options: Values of the command's options by name.
        batch: Options of collections.
        run: Function of a module that runs a job.
        version: Version of this package.
    """

    command: str
    out: Path
    suffix: str
    options: Mapping[str, object]
    batch: BatchOptions
    run: RunJob
    version: str = field(default_factory=_own_version)

    def convert(self, jobs: Sequence[Job], progress: Progress) -> CollectionReport:
        """Run all unfinished jobs.

        Raises:
            OutputError: Another run is writing there, or the disk refuses.
            ClusterError: The cluster cannot be used, or has ended.
            UsageError: The folder has the outputs of another command, or a cluster is requested
                without Dask.
        """
        workers = min(self.batch.jobs or worker_count(), max(len(jobs), 1))
        if self.batch.scheduler is None:
            return self._convert(jobs, progress, workers)
        with open_cluster(self.batch.scheduler, workers, self.version, progress.note) as cluster:
            return self._convert(jobs, progress, cluster.workers, cluster)

    def _convert(
        self,
        jobs: Sequence[Job],
        progress: Progress,
        workers: int,
        cluster: DaskCluster | None = None,
    ) -> CollectionReport:
        with open_out_folder(self.out) as out_folder, Manifest(out_folder.folder) as manifest:
            self._check(manifest.command)
            manifest.begin(self.command, workers)
            manifest.add({job.name: job.origin for job in jobs})
            outs = {self.output_of(job.name): job.name for job in jobs}
            manifest.claim(outs[out] for out in out_folder.absent(outs))
            out_folder.save()
            queue = _Queue(self, jobs, manifest, out_folder, progress)
            try:
                self._work(queue, workers, out_folder.lock, progress, cluster)
            finally:
                manifest.release()
            names = {job.name for job in jobs}
            records = [record for name, record in manifest.records().items() if name in names]
        return CollectionReport(self.out, tuple(records), frozenset(queue.ran), workers)

    def _check(self, command: str | None) -> None:
        """Refuse a folder with the jobs of another command."""
        if command not in {None, self.command}:
            raise UsageError(
                f'{self.out}: has the outputs of kitti-ros2 {command}; give {self.command} a folder'
                f' of its own'
            )

    def _work(
        self,
        queue: _Queue,
        workers: int,
        lock: int,
        progress: Progress,
        cluster: DaskCluster | None,
    ) -> None:
        if cluster is not None:
            outcomes = cluster.run(queue, self.run, progress.advance, self.out / MANIFEST)
        elif workers == 1:
            outcomes = run_serially(queue, self.run, progress.advance)
        else:
            outcomes = run_on_processes(queue, self.run, progress.advance, workers, lock)
        with closing(outcomes):  # type: ignore[type-var]
            for outcome in outcomes:
                queue.settle(outcome)

    def output_of(self, name: str) -> Path:
        """Return the output of a job."""
        return self.out / f'{name}{self.suffix}'

    def options_text(self) -> str:
        """Return the command and its options as JSON, with fingerprints of the files they name."""
        options = {name: value for name, value in self.options.items() if name not in _OF_DISK}
        paths = [value for value in options.values() if isinstance(value, Path)]
        named = {'files': fingerprint_paths(paths)} if paths else {}
        return json.dumps(
            {'command': self.command, **named, 'options': options}, default=str, sort_keys=True
        )


@dataclass(frozen=True)
class CollectionReport:
    """The result of a run over a collection.

    Attributes:
        out: The folder of outputs.
        records: All jobs of the collection.
        ran: Names of the jobs of this run; the others were done or failed before.
        workers: Number of worker processes.
    """

    out: Path
    records: tuple[JobRecord, ...]
    ran: frozenset[str]
    workers: int

    @property
    def ok(self) -> bool:
        """True if all jobs are done, without losses."""
        return all(record.state == DONE and not record.bad for record in self.records)


class _Queue:
    """The tasks of a collection, chosen for each free worker."""

    def __init__(
        self,
        collection: Collection,
        jobs: Iterable[Job],
        manifest: Manifest,
        out_folder: OutFolder,
        progress: Progress,
    ) -> None:
        self._collection = collection
        self._jobs = iter(jobs)
        self._manifest = manifest
        self._out_folder = out_folder
        self._progress = progress
        self._known = manifest.records()
        self._options = collection.options_text()
        self._again: deque[JobTask] = deque()
        self._identities: dict[str, Identity] = {}
        self.ran: set[str] = set()

    def take(self) -> JobTask | None:
        """Return the next task, recorded as running."""
        if self._again:
            return self._begin(self._again.popleft())
        for job in self._jobs:
            task = self._task(job)
            if task is not None:
                return self._begin(task)
            self._manifest.flush()
            self._progress.skip(job.name)
        self._manifest.flush()
        return None

    def settle(self, outcome: Outcome) -> None:
        """Record an outcome; repeat the job of a lost worker once."""
        task, result = outcome
        name = task.job.name
        if isinstance(result, LostWorker):
            if task.attempt < _ATTEMPTS:
                self._again.append(replace(task, attempt=task.attempt + 1))
                return
            result = JobResult(
                reason=f'its worker process {result.how}, {task.attempt} times;'
                ' is there enough memory?'
            )
            self._out_folder.remove_leftovers(task.out)
        self._manifest.end(name, result)
        self._out_folder.changed()
        self._identities.pop(name, None)
        self._progress.end(name)

    def _task(self, job: Job) -> JobTask | None:
        """Return the task of a job; None for one that is done, or failed without retry."""
        record = self._known[job.name]
        try:
            files = fingerprint(job)
        except OSError as error:  # its job fails with it
            files = describe_error(error)
        identity = Identity(job.origin, files, self._options, self._collection.version)
        out = self._collection.output_of(job.name)
        if record.identity == identity:
            is_done = record.state == DONE and self._out_folder.has(out)
            retry = self._collection.batch.retry and (record.state == FAILED or record.bad)
            if (is_done or record.state == FAILED) and not retry:
                self._out_folder.remove_leftovers(out)
                return None
        self._identities[job.name] = identity
        options = self._collection.options
        if self._may_replace(record, job, out):
            options = {**options, 'overwrite': True}
        return JobTask(job, out, options)

    def _may_replace(self, record: JobRecord, job: Job, out: Path) -> bool:
        """Return whether the output of a job is absent or its own."""
        is_own = record.ours and record.identity.source == job.origin
        return is_own or not self._out_folder.has(out)

    def _begin(self, task: JobTask) -> JobTask:
        name = task.job.name
        ours = bool(task.options.get('overwrite'))
        self._manifest.start(name, self._identities[name], attempt=task.attempt, ours=ours)
        self._out_folder.make_room(task.out)
        self.ran.add(name)
        self._progress.begin(name)
        return task
