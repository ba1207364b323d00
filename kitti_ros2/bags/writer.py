# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opening bags for writing; a bag of any container, split or not, appears only when complete.

The files made from OUT:

==================  ======================  =====================================================
OUT                 storage                 on disk
==================  ======================  =====================================================
``drive.mcap``      mcap                    that file
``drive.bag``       ros1                    that file
``drive``           mcap or sqlite3         rosbag2 directory: metadata.yaml, drive_0.mcap, ...
``drive``           ros1, no split          ``drive.bag``, as rosbag record -O does
``drive``           ros1, split             directory: drive_0.bag, drive_1.bag, ...
==================  ======================  =====================================================
"""

from __future__ import annotations

import os
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from itertools import chain, count
from typing import TYPE_CHECKING

from ..files.local_staging import Staging, output_error
from ..files.output_rules import keep_all_but_bags, refusal_of
from ..files.remote import is_remote
from ..files.staging import open_staging
from ..files.threads import DeferredSignals, worker_count
from ..model.bag_formats import CONTAINERS, FILE_NAMES, container_of
from ..model.errors import OutputError, UsageError, add_note, format_count, not_one_of
from .file_writer import (
    Parts,
    Tally,
    WriterContext,
    bag_information,
    information_text,
    metadata_yaml,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from rosbags.typesys.store import Typestore
    from typing_extensions import Self

    from ..files.uploads import UploadStaging
    from ..model.bag_formats import Channel
    from ..options.outputs import BagOptions
    from .file_writer import FileWriter


# A partial bag: what remains of one whose writing was interrupted.

_PARTIAL = 'partial'


@dataclass(frozen=True)
class PartialBag:
    """The remains of a bag whose writing was interrupted.

    Attributes:
        path: The bag.
        messages: Number of written messages.
        whole: Whether the bag is valid, not truncated.
    """

    path: Path
    messages: int
    whole: bool

    @property
    def text(self) -> str:
        """Readable text, for the end of an error."""
        text = f'{format_count(self.messages, "message")} written so far are kept in {self.path}'
        return text if self.whole else f'{text}, which kitti-ros2 recover repairs'

    def name_in(self, error: BaseException) -> None:
        """Add the path of the partial bag to an error."""
        if isinstance(error, OutputError):
            error.leave(self.text)
        else:
            add_note(error, self.text)


def is_interruption(error: BaseException) -> bool:
    """Return whether an exception is of a signal, the disk or the memory, not of the data."""
    return isinstance(error, (KeyboardInterrupt, SystemExit, OutputError, OSError, MemoryError))


def move_aside(staging: Staging | UploadStaging, *, single_file: bool) -> Path | None:
    """Move what was written beside the output: to drive.partial.mcap, or drive.partial.

    Returns:
        Its path; None if the disk refuses.
    """
    if not isinstance(staging, Staging):  # in a store
        return None
    path = _free_path(staging.path, single_file=single_file)
    try:
        staging.keep(path)
    except OSError:
        return None
    return path


def _free_path(path: Path, *, single_file: bool) -> Path:
    stem, suffix = (path.stem, path.suffix) if single_file else (path.name, '')
    marks = chain([_PARTIAL], (f'{_PARTIAL}-{number}' for number in count(2)))
    paths = (path.with_name(f'{stem}.{mark}{suffix}') for mark in marks)
    return next(candidate for candidate in paths if not os.path.lexists(candidate))


# A bag as a sequence of files: staging, splitting, counting and metadata.yaml.


# Suffix of incomplete files, even inside the hidden directory they are written in.
_UNFINISHED = '.unfinished'


def _open_file(path: Path, context: WriterContext) -> FileWriter:
    """Make a file of the container, and open it for writing; its writer is imported here."""
    storage = context.options.storage
    if storage == 'mcap':
        from .mcap_writer import McapFileWriter  # noqa: PLC0415 - most runs write one container

        return McapFileWriter(path, context)
    if storage == 'sqlite3':
        from .sqlite_writer import SqliteFileWriter  # noqa: PLC0415 - as above

        return SqliteFileWriter(path, context)
    from .ros1_writer import Ros1FileWriter  # noqa: PLC0415 - as above

    return Ros1FileWriter(path, context)


def _write_errors(storage: str) -> tuple[type[Exception], ...]:
    """Return the exceptions of a writer's library, besides OSError, when the disk refuses."""
    if storage != 'sqlite3':
        return ()
    from sqlite3 import Error  # noqa: PLC0415 - of one container

    return (Error,)


class BagWriter:
    """A bag open for writing; as a context manager it closes on success and aborts on failure.

    Args:
        path: The path of the bag once closed.
        context: Arguments of the writer of each file.
        single_file: Whether path is the only file, not a directory of files.

    Attributes:
        path: The path of the bag once closed.

    Raises:
        OutputExistsError: The output exists and may not be replaced.
        OutputError: Another run is writing there, or the disk refuses.
    """

    def __init__(self, path: Path, context: WriterContext, *, single_file: bool) -> None:
        self._context = context
        self._container = CONTAINERS[context.options.storage]
        self._signals: DeferredSignals | nullcontext[None] = nullcontext()
        errors = _write_errors(context.options.storage)
        self._errors: tuple[type[Exception], ...] = (OSError, *errors)
        self._single_file = single_file
        self._split_size = context.options.split_size
        self._split_duration_ns = context.options.split_duration_ns
        self._split = context.options.split
        self._channels: list[Channel] = []
        self._topics: set[str] = set()
        self._tallies: list[Tally] = []
        self._file: FileWriter | None = None
        self._size = 0
        self._done = False
        self._failure: OutputError | None = None
        if context.options.keep_partial and is_remote(path):
            raise UsageError(f'{path}: --keep-partial keeps local bags only; leave it out')
        refusal = refusal_of(keep_all_but_bags, overwrite=context.options.overwrite)
        self._staging = open_staging(path, refusal, fsync=context.options.fsync)
        self.path = self._staging.path
        try:
            with self._reported():
                if not single_file:
                    self._staging.content.mkdir()
                self._next_file()
            if context.options.keep_partial:
                # A message that is cut in two would look like a damaged bag.
                self._signals = DeferredSignals()
        except BaseException as error:
            self.abort()
            self._staging.note_remains(error)
            raise

    def add_channel(self, channel: Channel) -> int:
        """Declare a topic and return its channel id.

        Raises:
            UsageError: The topic is declared already.
            OutputError: The disk refuses.
        """
        if channel.topic in self._topics:
            raise UsageError(f'topic {channel.topic} is to be written twice; rename one of the two')
        file = self._opened()
        channel_id = len(self._channels)
        with self._reported(), self._signals:
            file.add_channel(channel_id, channel)
            self._channels.append(channel)
            self._topics.add(channel.topic)
            self._tallies[-1].counts.append(0)
        return channel_id

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message, to a new file if the present one is full.

        Args:
            channel_id: From add_channel.
            stamp_ns: Log and publish time, nanoseconds since 1970, not negative.
            parts: The message as CDR, little endian, unless the channel is a stored one.

        Raises:
            OutputError: The disk refuses; the bag is given up, and later calls raise this again.
        """
        if stamp_ns < 0:
            raise ValueError(f'bags hold no stamps before 1970, such as {stamp_ns} ns')
        try:
            with self._signals:
                if self._split:
                    self._make_room(stamp_ns, sum(map(len, parts)))
                self._opened().write(channel_id, stamp_ns, parts)
                tally = self._tallies[-1]
                tally.counts[channel_id] += 1
                tally.start_ns = min(tally.start_ns, stamp_ns)
                tally.end_ns = max(tally.end_ns, stamp_ns)
        except self._errors as error:
            # A caller that continues must not end with a bag in which a message is missing.
            self._failure = self._error(error)
            self._give_up(self._failure)
            raise self._failure from error

    def close(self) -> None:
        """Complete the bag and move it to its path; nothing happens the second time.

        Raises:
            OutputError: The disk refuses; nothing is left behind.
            OutputExistsError: The output was created by another process meanwhile.
        """
        if self._failure is not None:
            raise self._failure
        if self._done:
            return
        try:
            with self._reported(), self._signals:
                self._close_file()
                self._finish_names()
            self._staging.publish()
            self._done = True
        except BaseException as error:
            self._give_up(error)
            raise
        finally:
            self._release()

    def abort(self) -> None:
        """Give the bag up and remove its files; never raises OSError."""
        if self._done:
            return
        self._done = True
        file, self._file = self._file, None
        try:
            if file is not None:
                with suppress(*self._errors):
                    file.abort()
        finally:
            self._staging.discard()
            self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if error is None:
            self.close()
            return
        self._give_up(error)

    def _give_up(self, error: BaseException) -> None:
        """Abort; with keep_partial, keep the written messages and name their bag in the error."""
        broken = isinstance(error, (OSError, OutputError))
        partial_bag = self._keep(broken=broken) if is_interruption(error) else None
        self.abort()
        self._staging.note_remains(error)
        if partial_bag is not None:
            partial_bag.name_in(error)

    def _keep(self, *, broken: bool) -> PartialBag | None:
        """Keep the written messages as a partial bag.

        Args:
            broken: Whether the disk has refused a part of the file being written.
        """
        messages = sum(tally.total for tally in self._tallies)
        if not self._context.options.keep_partial or self._done or not messages:
            return None
        whole = not broken
        with self._signals:
            if whole and self._file is not None:
                try:
                    self._close_file()
                except self._errors:
                    whole = False
            file, self._file = self._file, None
            with suppress(*self._errors):
                if file is not None:
                    file.abort()
            with suppress(OSError):
                self._finish_names()
            path = move_aside(self._staging, single_file=self._single_file)
        return None if path is None else PartialBag(path, messages, whole)

    def _release(self) -> None:
        signals, self._signals = self._signals, nullcontext()
        if isinstance(signals, DeferredSignals):
            signals.close()

    def _opened(self) -> FileWriter:
        if self._failure is not None:
            raise self._failure
        if self._file is None:
            raise ValueError(f'{self.path}: the bag is closed')
        return self._file

    def _name(self, index: int) -> str:
        name, suffix = self.path.name, self._container.suffix
        return name if self._single_file else f'{name}_{index}{suffix}'

    def _built(self, index: int) -> Path:
        content = self._staging.content
        return content if self._single_file else content / (self._name(index) + _UNFINISHED)

    def _next_file(self) -> None:
        file = _open_file(self._built(len(self._tallies)), self._context)
        self._file = file
        self._tallies.append(Tally([0] * len(self._channels)))
        self._size = 0
        for channel_id, channel in enumerate(self._channels):
            file.add_channel(channel_id, channel)

    def _make_room(self, stamp_ns: int, size: int) -> None:
        tally = self._tallies[-1]
        full = self._split_size is not None and self._size + size > self._split_size
        over = (
            self._split_duration_ns is not None
            and stamp_ns - tally.start_ns >= self._split_duration_ns
        )
        # A message larger than the limit gets a file of its own, never an empty one before it.
        if (full or over) and tally.end_ns >= tally.start_ns:
            self._close_file()
            self._next_file()
        self._size += size

    def _close_file(self) -> None:
        file = self._opened()
        in_rosbag2 = self._container.in_rosbag2
        file.close(information_text(self._information()) if in_rosbag2 else b'')
        self._file = None

    def _information(self) -> dict[str, object]:
        return bag_information(
            self._context.options,
            self._context.typestore,
            self._channels,
            {self._name(index): tally for index, tally in enumerate(self._tallies)},
            self._context.source_metadata,
        )

    def _finish_names(self) -> None:
        if self._single_file:
            return
        for index in range(len(self._tallies)):
            built = self._built(index)
            built.rename(built.with_name(self._name(index)))
        if self._container.in_rosbag2:
            (self._staging.content / 'metadata.yaml').write_bytes(
                metadata_yaml(self._information())
            )

    def _error(self, error: Exception) -> OutputError:
        if isinstance(error, OSError):
            return output_error(self.path, error)
        return OutputError(
            self.path, f'cannot be written ({error})', 'check the disk and its space'
        )

    @contextmanager
    def _reported(self) -> Iterator[None]:
        try:
            yield
        except self._errors as error:
            raise self._error(error) from error


__all__ = ['BagWriter', 'Parts', 'guess_storage', 'open_bag', 'output_path']


_NO_BAGS = {'.bin', '.gif', '.html', '.jpg', '.mp4', '.png', '.rrd', '.txt', '.webp', '.zip'}
"""Endings that a directory of rosbag2 does not have, unless by mistake."""


def guess_storage(path: Path, asked: str | None = None, default: str = 'mcap') -> str:
    """Return the storage for an output path: the requested one, else the suffix's, else a default.

    Raises:
        UsageError: The suffix and the storage contradict each other, or one of them is unknown.
    """
    if asked is not None and asked not in CONTAINERS:
        raise not_one_of('storage', asked, list(CONTAINERS))
    if path.suffix.lower() in _NO_BAGS:
        raise UsageError(f'{path}: expected a bag, {FILE_NAMES} or a directory')
    for name, container in CONTAINERS.items():
        if path.suffix == container.suffix and not container.in_file:
            raise UsageError(
                f'{path}: a {name} bag is a directory that holds the {path.suffix} file;'
                f' give {path.stem} and --storage {name}'
            )
    named = container_of(path.suffix)
    if named is None:
        return asked or default
    if asked not in {None, named}:
        raise UsageError(
            f'{path}: the ending {path.suffix} means storage {named}, not {asked};'
            f' give {path.stem} for storage {asked}, or leave --storage out'
        )
    return named


def output_path(path: Path, options: BagOptions) -> Path:
    """Return the path of the bag that is written for an output path.

    Raises:
        UsageError: The path's suffix contradicts the options.
    """
    storage = guess_storage(path, options.storage)
    in_file = container_of(path.suffix) is not None
    if in_file and options.split:
        raise UsageError(
            f'{path}: a bag that is split becomes several files in a directory;'
            f' give {path.stem} and --storage {storage}'
        )
    container = CONTAINERS[storage]
    if not (in_file or container.in_rosbag2 or options.split) and path.name:
        return path.with_name(f'{path.name}{container.suffix}')
    return path


def open_bag(
    path: Path,
    options: BagOptions,
    typestore: Typestore,
    *,
    source_metadata: Mapping[str, str] | None = None,
    threads: int | None = None,
) -> BagWriter:
    """Open a bag for writing; use it as a context manager.

    Args:
        path: Output path; see the table above and BagWriter.path.
        options: Storage, compression, split, overwrite.
        typestore: Contains the ROS 2 definitions of the types to be written.
        source_metadata: Origin of the data, stored in the bag if the container supports that.
        threads: Number of threads that compress; None: worker_count().

    Raises:
        UsageError: The path's suffix contradicts the options.
        OutputExistsError: The output exists and may not be replaced.
        OutputError: Another run is writing there, or the disk refuses.
    """
    # File names may contain bytes that are not UTF-8, which bags cannot store.
    source = {
        key: value.encode('utf-8', 'replace').decode()
        for key, value in (source_metadata or {}).items()
    }
    context = WriterContext(options, typestore, source, threads or worker_count())
    target = output_path(path, options)
    return BagWriter(target, context, single_file=container_of(target.suffix) is not None)
