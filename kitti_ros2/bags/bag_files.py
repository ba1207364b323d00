# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a bag opened for reading, of any container, decompressed if rosbag2 packed them."""

from __future__ import annotations

import os
import re
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeAlias

from ..model.bag_formats import ANY_BAG, ZSTD_MAGIC
from ..model.errors import (
    AmbiguousLayoutError,
    BadBagError,
    KittiRos2Error,
    NotABagError,
    NotKittiError,
    Remedy,
    UsageError,
    naming,
)
from .container_file import BagIndex, NamedFile, Problems, ros2_spelling
from .decompression import decompress_file
from .locate import METADATA, locate_bag, looks_like_bag, reindex_steps

if TYPE_CHECKING:
    from typing_extensions import Self

    from .container_file import BagFile, StoredChannel
    from .locate import BagFiles


_ROS2_TYPE = re.compile(r'\w+/(msg/)?\w+', re.ASCII)
_ROS2_TEXTS = frozenset({'ros2msg', 'ros2idl', ''})


def open_files(
    bag: BagFiles, problems: Problems, exit_stack: ExitStack
) -> list[tuple[Path, BagFile]]:
    """Open the files of a bag; if some of several cannot be read, they are entered as losses.

    Args:
        bag: The bag to open.
        problems: Collects notes and losses.
        exit_stack: Closes the files.

    Raises:
        BadBagError: No file can be read.
        OSError: A file cannot be opened.
    """
    for loss in bag.losses:
        problems.lose(loss)
    problems.notes.update(dict.fromkeys(bag.notes))
    from .stored_messages import ros_channel  # noqa: PLC0415 - 20 ms, for bags only

    files: list[tuple[Path, BagFile]] = []
    failure: BadBagError | None = None
    for path in bag.files:
        try:
            file = _open_file(bag.storage, _unpacked(path, exit_stack), problems)
        except BadBagError as error:
            failure = failure or error
            problems.lose(str(error))
            continue
        exit_stack.callback(file.close)
        unnamed = {
            key: _as_cdr(channel) for key, channel in file.channels.items() if _is_unnamed(channel)
        }
        if unnamed:
            topics = f'{len(unnamed)} of its {len(file.channels)} topics'
            problems.note(
                f'{path}: {topics} have an empty serialization_format; they are read as cdr'
            )
        channels = {**file.channels, **unnamed}
        file.channels = {key: ros_channel(channel) for key, channel in channels.items()}
        files.append((path, file))
    if failure is not None and not files:
        raise failure
    if failure is None and not bag.losses:
        file_topics = {channel.topic for _, file in files for channel in file.channels.values()}
        for topic in bag.topics:
            if topic not in file_topics:
                text = f'metadata.yaml names the topic {topic}, which its files lack'
                problems.lose(f'{bag.path}: {text}', 0)
    return files


def _open_file(storage: str, file: NamedFile, problems: Problems) -> BagFile:
    """Open a file of a container, one of model.bag_formats.

    Its reader is imported here: the libraries behind all of them take some tenths of a second.
    """
    if storage == 'mcap':
        from .mcap_reader import McapFile  # noqa: PLC0415

        return McapFile(file, problems)
    if storage == 'sqlite3':
        from .sqlite_reader import SqliteFile  # noqa: PLC0415

        return SqliteFile(file, problems)
    from .ros1_bag import Ros1File  # noqa: PLC0415

    return Ros1File(file, problems)


def _is_unnamed(channel: StoredChannel) -> bool:
    """Return whether a channel of a ROS 2 type names no encoding: ROS 2 itself has cdr alone.

    Recorders in drivers write this, where they create a topic without its serialization_format.
    """
    return (
        not channel.encoding
        and channel.definition_encoding in _ROS2_TEXTS
        and bool(_ROS2_TYPE.fullmatch(channel.msgtype))
    )


def _as_cdr(channel: StoredChannel) -> StoredChannel:
    return replace(channel, encoding='cdr', msgtype=ros2_spelling(channel.msgtype))


class OpenBag:
    """A bag open for reading: its index and all messages are read from one set of open files.

    The files are closed when the bag is closed, and everything that was opened from it.

    Args:
        path: A file or folder.
        whole_chunks: Whether chunks are read whole and compared with their checksums, as by all
            that writes the data elsewhere; else single messages are read by the index of a file
            where that takes fewer bytes, and damage that no longer shows is not found.

    Attributes:
        path: The same.
        located: Its files.

    Raises:
        BadBagError: The path holds no bag, or one that cannot be read at all.
        OSError: It cannot be read.
    """

    def __init__(self, path: Path, *, whole_chunks: bool = False) -> None:
        self.path = path
        self.located = locate_bag(path)
        self._problems = Problems()
        self._users = 1
        self._is_open = True
        with ExitStack() as exit_stack:
            self._files = open_files(self.located, self._problems, exit_stack)
            for _, file in self._files:
                file.whole_chunks = whole_chunks
            self._exit_stack = exit_stack.pop_all()

    def files(self, problems: Problems, exit_stack: ExitStack) -> list[tuple[Path, BagFile]]:
        """Return the open files with their paths.

        Args:
            problems: Collects the problems found so far, and those that these files find later.
            exit_stack: Ends their use.
        """
        self._users += 1
        exit_stack.callback(self._leave)
        problems.add(self._problems)
        return [(path, file.reporting_to(problems)) for path, file in self._files]

    @cached_property
    def index(self) -> BagIndex:
        """The stamps of the messages without their payloads."""
        index, problems = BagIndex(), Problems()
        with ExitStack() as exit_stack:
            for _, file in self.files(problems, exit_stack):
                index.merge(file.index())
        if self.located.compression_mode:
            index.compressions.add('zstd')
        index.complete = problems.complete
        index.problems += problems.lines
        index.losses += problems.losses
        expected = self.located.message_count
        if expected is not None and expected != index.total:
            text = (
                f'{self.path}: metadata.yaml counts {expected} messages, the files hold'
                f' {index.total}; {reindex_steps(self.path, self.located.files)}'
            )
            index.problems.append(text)
            index.losses.append(text)
        return index

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files once nothing else uses them; nothing happens the second time."""
        if self._is_open:
            self._is_open = False
            self._leave()

    def _leave(self) -> None:
        self._users -= 1
        if not self._users:
            self._exit_stack.close()


BagSource: TypeAlias = Path | OpenBag
"""A bag by its path, or open already."""


def opened(bag: BagSource) -> AbstractContextManager[OpenBag]:
    """Return a context with the open bag; at its end one that was given open stays open."""
    return nullcontext(bag) if isinstance(bag, OpenBag) else OpenBag(bag)


def path_of(bag: BagSource) -> Path:
    """Return the path of a bag."""
    return bag.path if isinstance(bag, OpenBag) else bag


def _unpacked(path: Path, exit_stack: ExitStack) -> NamedFile:
    """Return the file itself, or a decompressed copy if rosbag2 compressed it as a whole.

    A truncated file is decompressed up to its end.

    Raises:
        BadBagError: The path is a pipe or a device, or what it unpacks to is too large.
        OSError: The file cannot be read, or the disk has no room for the copy.
    """
    if not path.is_file():
        raise BadBagError(path, 'is no regular file')
    with naming(path), path.open('rb') as source:
        if source.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
            return NamedFile(path, path)
        source.seek(0)
        folder = Path(exit_stack.enter_context(TemporaryDirectory()))
        plain = folder / path.stem
        try:
            with plain.open('wb') as target:
                target.writelines(decompress_file(source))
        except ValueError as error:
            raise BadBagError(path, str(error), expected='') from None
        except OSError as error:
            error.filename = f'{path} (unpacked to {folder.parent})'
            raise
        packed = os.fstat(source.fileno()).st_size
    return NamedFile(plain, Path(f'{path} (unpacked)'), packed)


# Explains paths that are no source: a bag in place of a KITTI folder, the reverse, or neither.

_QUICKLY_READ_BYTES = 1 << 30


def explain_no_folder(path: Path, error: NotKittiError, *, forced: bool) -> KittiRos2Error:
    """Return the error for a path that holds no recording, where a KITTI folder is needed.

    Args:
        path: The path.
        error: The error of the readers.
        forced: Whether a layout was requested.
    """
    bag = _find_bag(path)
    if bag is None or (error.remedies and not _has_bag_alone(path)):
        return error
    return _is_bag(bag, forced=forced)


def explain_no_bag(path: Path, error: NotABagError) -> KittiRos2Error:
    """Return the error for a path that holds no bag, where a bag is needed."""
    if not path.exists() or _is_metadata(path):
        near = explain_file(path)
        return near if near.remedies else error
    from ..kitti.opening import guess_layout  # noqa: PLC0415 - for errors only

    try:
        kind = f'layout {guess_layout(path).value}'
    except AmbiguousLayoutError:
        kind = 'several layouts'
    except NotKittiError as near:
        if not near.explained:
            return error
        if not near.remedies or any(remedy.before for remedy in near.remedies):  # archives
            return near
        remedies = (replace(remedy, command='to-bag') for remedy in near.remedies)
        return UsageError(f'{near} to to-bag').with_remedies(*remedies)
    text = f'{path}: is a KITTI folder ({kind}), not a bag; convert it to a bag'
    return UsageError(text).with_remedies(Remedy(path, path, command='to-bag'))


def explain_file(path: Path) -> KittiRos2Error:
    """Return the error for a file that is no bag."""
    if _is_metadata(path):
        text = f'{path}: describes the bag {path.parent}; give that folder'
        return UsageError(text).with_remedies(Remedy(path, path.parent))
    from ..kitti.opening import explain  # noqa: PLC0415 - for errors only

    near = explain(path)
    if near.explained:
        return near
    return BadBagError(path, 'is a file of another kind', f'a KITTI folder, {ANY_BAG}')


def _is_metadata(path: Path) -> bool:
    return path.name == METADATA and looks_like_bag(path.parent)


def _has_bag_alone(path: Path) -> bool:
    """Return whether a path is a file or a rosbag2 directory, not a folder that also holds bags."""
    return path.is_file() or (path / METADATA).is_file()


def _find_bag(path: Path) -> BagFiles | None:
    if not looks_like_bag(path):
        return None
    try:
        return locate_bag(path)
    except (BadBagError, OSError):
        return None


def _is_bag(bag: BagFiles, *, forced: bool) -> UsageError:
    """Return the error for a bag in place of a KITTI folder."""
    path = bag.path
    text = f'{path}: is a bag ({bag.container}), not a KITTI folder'
    if forced:
        return UsageError(f'{text}; leave --layout out')
    commands, hint = ['play', 'to-kitti'], 'play it, or convert it to KITTI'
    if _is_damaged(bag):
        commands.append('recover')
        hint = 'play it, convert it to KITTI, or repair it, as it is damaged'
    remedies = (Remedy(path, path, command=command) for command in commands)
    return UsageError(f'{text}; {hint}').with_remedies(*remedies)


def _is_damaged(bag: BagFiles) -> bool:
    """Return whether a bag is damaged, as far as a short read shows."""
    if bag.losses or sum(file.stat().st_size for file in bag.files) > _QUICKLY_READ_BYTES:
        return bool(bag.losses)
    try:
        with OpenBag(bag.path) as opened:
            return not opened.index.complete
    except (BadBagError, OSError):
        return True
