# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a command over a collection: skips what is done, records what happens in the manifest."""

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
from .manifest import DONE, FAILED, MANIFEST, Identity, Manifest, UnitRecord, open_place
from .pool import LostWorker, UnitJob, UnitResult, run_on_processes, run_serially

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from ..files.remote import RemotePath
    from ..files.remote_reads import RemoteEntry
    from ..model.streams import Layout
    from ..options.table import BatchOptions
    from .dask_cluster import DaskCluster
    from .manifest import LocalPlace
    from .pool import Outcome, RunUnit
    from .units import WorkUnit


# Fingerprints of a unit's input: the names, sizes and times of change of its files.
#
# Of files in stores also their ETags. All come from the listings of the folders; those of web
# servers have names only.

_SHARED_MEMORY = '.db3-shm'  # that readers of SQLite make


class InputFile(NamedTuple):
    """A file of a unit.

    Attributes:
        name: Path below the unit's folder.
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
        """The number in its name, if that is a frame's."""
        return number_of(Path(self.name).stem)


def fingerprint(unit: WorkUnit) -> str:
    """Return the fingerprint of a unit's files; of a slice those of its frames and common files.

    A file that does not exist has no part in it.

    Raises:
        OSError: A folder cannot be read.
    """
    files: Iterable[InputFile]
    if unit.layout is None:
        files = _walk(unit.source, unit.source.parent)
    else:
        files = _files_of(unit.source, unit.layout, unit.sequence)
    if unit.result is not None:
        files = [*files, *_walk(unit.result, unit.result.parent)]
    if unit.first is not None and unit.last is not None:
        first, last = unit.first, unit.last
        files = (file for file in files if file.number is None or first <= file.number <= last)
    return _digest(files)


def fingerprint_paths(paths: Iterable[Path]) -> str:
    """Return the fingerprint of files and folders that options name.

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


@lru_cache(maxsize=1)  # slices of one set follow each other
@cached_listings()
def _files_of(source: Path, layout: Layout, sequence: str | None) -> tuple[InputFile, ...]:
    try:
        parts = parts_of(source, layout, sequence)
    except KittiRos2Error:
        parts = [source]  # its unit will fail with this error, until something there changes
    return tuple(sorted({input_file for part in parts for input_file in _walk(part, source)}))


def _walk(path: Path, base: Path) -> Iterator[InputFile]:
    """Yield the files at a path; those that disappear meanwhile are left out."""
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
        folder, place = folders.pop()
        with os.scandir(folder) as entries:
            for entry in entries:
                name = f'{place}/{entry.name}'
                if entry.is_dir(follow_symlinks=False):
                    folders.append((entry.path, name))
                elif entry.is_file() and not name.endswith(_SHARED_MEMORY):
                    status = entry.stat()
                    yield InputFile(name, status.st_size, status.st_mtime_ns)


def _walk_store(path: RemotePath, place: str) -> Iterator[InputFile]:
    """Yield the files at a URL, by one listing of each folder."""
    from ..files.remote_reads import listing_of, sized_entry_of  # noqa: PLC0415 - for URLs only

    try:
        entry = sized_entry_of(path)
    except (FileNotFoundError, NotADirectoryError):
        return
    if not entry.is_folder:
        yield _stored(place, entry)
        return
    folders = [(path, place)]
    while folders:
        folder, place = folders.pop()
        for name, entry in listing_of(folder).items():
            if entry.is_folder:
                folders.append((folder / name, f'{place}/{name}'))
            else:
                yield _stored(f'{place}/{name}', entry)


def _stored(name: str, entry: RemoteEntry) -> InputFile:
    size = -1 if entry.size is None else entry.size
    return InputFile(name, size, entry.changed_ns, entry.tag)


_OF_DISK = {'overwrite', 'fsync'}
"""Options that change nothing in an output."""
_ATTEMPTS = 2  # a killed worker may have been unlucky once


class Progress:
    """What a collection reports while it runs; this one shows nothing."""

    def skip(self, unit: str) -> None:
        """A unit was done, or had failed, before."""

    def begin(self, unit: str) -> None:
        """A unit begins."""

    def advance(self, unit: str, done: int, total: int) -> None:
        """A unit has converted so many of its samples."""

    def end(self, unit: str) -> None:
        """A unit has ended."""

    def remark(self, text: str) -> None:
        """Something about the workers, such as that there are none yet."""


def _own_version() -> str:
    from .. import __version__  # noqa: PLC0415 - 22 ms

    return __version__


@dataclass(frozen=True)
class Collection:
    """A command over the units of a collection.

    Attributes:
        command: Its name.
        out: The folder of outputs.
        suffix: What is added to the name of a unit for its output.
        options: Values of the command's options by name.
        batch: How the collection is run.
        run: Runs a unit; a function of a module.
        version: Of this package.
    """

    command: str
    out: Path
    suffix: str
    options: Mapping[str, object]
    batch: BatchOptions
    run: RunUnit
    version: str = field(default_factory=_own_version)

    def convert(self, units: Sequence[WorkUnit], progress: Progress) -> CollectionReport:
        """Run all units that are not done.

        Raises:
            OutputError: Another run is writing there, or the disk refuses.
            ClusterError: The cluster cannot be used, or has ended.
            UsageError: The folder has the outputs of another command, or a cluster is requested and
                Dask is not installed.
        """
        jobs = min(self.batch.jobs or worker_count(), max(len(units), 1))
        if self.batch.scheduler is None:
            return self._convert(units, progress, jobs)
        with open_cluster(self.batch.scheduler, jobs, self.version, progress.remark) as cluster:
            return self._convert(units, progress, cluster.workers, cluster)

    def _convert(
        self,
        units: Sequence[WorkUnit],
        progress: Progress,
        jobs: int,
        cluster: DaskCluster | None = None,
    ) -> CollectionReport:
        with open_place(self.out) as place, Manifest(place.folder) as manifest:
            self._check(manifest.command)
            manifest.begin(self.command, jobs)
            manifest.add({unit.name: unit.origin for unit in units})
            outs = {self.output_of(unit.name): unit.name for unit in units}
            manifest.claim(outs[out] for out in place.absent(outs))
            place.save()
            queue = _Queue(self, units, manifest, place, progress)
            try:
                self._work(queue, jobs, place.lock, progress, cluster)
            finally:
                manifest.release()
            names = {unit.name for unit in units}
            records = [record for name, record in manifest.records().items() if name in names]
        return CollectionReport(self.out, tuple(records), frozenset(queue.ran), jobs)

    def _check(self, command: str | None) -> None:
        """Refuse a folder whose units another command would take for its own."""
        if command not in {None, self.command}:
            raise UsageError(
                f'{self.out}: has the outputs of kitti-ros2 {command}; give {self.command} a folder'
                f' of its own'
            )

    def _work(
        self, queue: _Queue, jobs: int, lock: int, progress: Progress, cluster: DaskCluster | None
    ) -> None:
        if cluster is not None:
            outcomes = cluster.run(queue, self.run, progress.advance, self.out / MANIFEST)
        elif jobs == 1:
            outcomes = run_serially(queue, self.run, progress.advance)
        else:
            outcomes = run_on_processes(queue, self.run, progress.advance, jobs, lock)
        with closing(outcomes):  # type: ignore[type-var]
            for outcome in outcomes:
                queue.settle(outcome)

    def output_of(self, name: str) -> Path:
        """Return the output of a unit."""
        return self.out / f'{name}{self.suffix}'

    def options_text(self) -> str:
        """Return the command and its options as JSON, with the state of the files they name."""
        chosen = {name: value for name, value in self.options.items() if name not in _OF_DISK}
        paths = [value for value in chosen.values() if isinstance(value, Path)]
        named = {'files': fingerprint_paths(paths)} if paths else {}
        return json.dumps(
            {'command': self.command, **named, 'options': chosen}, default=str, sort_keys=True
        )


@dataclass(frozen=True)
class CollectionReport:
    """The result of a run over a collection.

    Attributes:
        out: The folder of outputs.
        records: All units of the collection.
        ran: Names of the units that this run has run; the others were done or had failed before.
        jobs: Number of worker processes.
    """

    out: Path
    records: tuple[UnitRecord, ...]
    ran: frozenset[str]
    jobs: int

    @property
    def ok(self) -> bool:
        """Whether all units are done, without losses."""
        return all(record.state == DONE and not record.bad for record in self.records)


class _Queue:
    """The jobs of a collection, chosen when a worker is free."""

    def __init__(
        self,
        collection: Collection,
        units: Iterable[WorkUnit],
        manifest: Manifest,
        place: LocalPlace,
        progress: Progress,
    ) -> None:
        self._collection = collection
        self._units = iter(units)
        self._manifest = manifest
        self._place = place
        self._progress = progress
        self._known = manifest.records()
        self._options = collection.options_text()
        self._again: deque[UnitJob] = deque()
        self._identities: dict[str, Identity] = {}
        self.ran: set[str] = set()

    def take(self) -> UnitJob | None:
        """Return the next job, recorded as running."""
        if self._again:
            return self._begin(self._again.popleft())
        for unit in self._units:
            job = self._job(unit)
            if job is not None:
                return self._begin(job)
            self._manifest.flush()
            self._progress.skip(unit.name)
        self._manifest.flush()
        return None

    def settle(self, outcome: Outcome) -> None:
        """Record an outcome; the unit of a lost worker is run once more."""
        job, result = outcome
        name = job.unit.name
        if isinstance(result, LostWorker):
            if job.attempt < _ATTEMPTS:
                self._again.append(replace(job, attempt=job.attempt + 1))
                return
            result = UnitResult(
                reason=f'its worker process {result.how}, {job.attempt} times;'
                ' is there enough memory?'
            )
            self._place.sweep(job.out)
        self._manifest.end(name, result)
        self._place.changed()
        self._identities.pop(name, None)
        self._progress.end(name)

    def _job(self, unit: WorkUnit) -> UnitJob | None:
        """Return the job of a unit; None if it is done or has failed, and is not to be retried."""
        record = self._known[unit.name]
        try:
            files = fingerprint(unit)
        except OSError as error:  # its unit will fail with it
            files = describe_error(error)
        identity = Identity(unit.origin, files, self._options, self._collection.version)
        out = self._collection.output_of(unit.name)
        if record.identity == identity:
            is_done = record.state == DONE and self._place.has(out)
            retry = self._collection.batch.retry and (record.state == FAILED or record.bad)
            if (is_done or record.state == FAILED) and not retry:
                self._place.sweep(out)
                return None
        self._identities[unit.name] = identity
        options = self._collection.options
        if self._is_ours(record, unit, out):
            options = {**options, 'overwrite': True}
        return UnitJob(unit, out, options)

    def _is_ours(self, record: UnitRecord, unit: WorkUnit, out: Path) -> bool:
        """Whether a unit may replace what is at its output: nothing, or its own."""
        own = record.ours and record.identity.source == unit.origin
        return own or not self._place.has(out)

    def _begin(self, job: UnitJob) -> UnitJob:
        name = job.unit.name
        ours = bool(job.options.get('overwrite'))
        self._manifest.start(name, self._identities[name], attempt=job.attempt, ours=ours)
        self._place.make_room(job.out)
        self.ran.add(name)
        self._progress.begin(name)
        return job
