# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The bags in a folder by their names, the container of a bag by its content, and its files."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from ..files.remote import is_remote, refuse_incomplete
from ..model.bag_formats import CONTAINERS, ZSTD_MAGIC
from ..model.errors import BadBagError, NotABagError, naming, some_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from ..files.remote import RemotePath


# Detection of the container of a bag from its content, and of the files that belong to it.

METADATA = 'metadata.yaml'
_MOST_METADATA = 32 << 20  # of a recording in a hundred thousand files
_REINDEXED = re.compile(r'.+_\d+\.[a-zA-Z0-9]+', re.ASCII)
_LONGEST_MAGIC = max(len(container.magic) for container in CONTAINERS.values())


@dataclass(frozen=True)
class BagFiles:
    """A bag on disk.

    Attributes:
        path: As the user gave it.
        storage: The container of its files, one of model.bag_formats.
        files: The files with messages, in order.
        directory: Whether it is a rosbag2 directory (or one of ROS 1 files).
        compression_mode: rosbag2's own compression around the storage: '', file or message.
        message_count: From metadata.yaml, None without one.
        topics: Those listed in metadata.yaml.
        losses: Losses so far, one line each.
        notes: Lines that are no loss.
    """

    path: Path
    storage: str
    files: tuple[Path, ...]
    directory: bool = False
    compression_mode: str = ''
    message_count: int | None = None
    topics: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def container(self) -> str:
        """The name of the container for users."""
        in_rosbag2 = self.directory and CONTAINERS[self.storage].in_rosbag2
        return f'rosbag2 {self.storage}' if in_rosbag2 else self.storage


def looks_like_bag(path: Path) -> bool:
    """Return whether a path is a file of any kind, or a folder that contains files of a bag."""
    if not path.is_dir():
        return path.exists()
    return (path / METADATA).is_file() or any(_files(path).values())


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag by its content or name, or a folder with files of one.

    Raises:
        BadBagError: A file is empty, or irregular.
        OSError: It cannot be read.
    """
    if path.is_dir() or not path.exists():
        return looks_like_bag(path)
    try:
        locate_bag(path)
    except NotABagError:
        return path.suffix in {container.suffix for container in CONTAINERS.values()}
    return True


def locate_bag(path: Path) -> BagFiles:
    """Locate the files of a bag, and detect its container.

    Raises:
        BadBagError: The path holds no bag.
        BadFileError: Its upload to a store was not completed.
        OSError: It cannot be read.
    """
    refuse_incomplete(path)
    if not path.exists():
        raise NotABagError(path, 'there is no such file or directory')
    if not path.is_dir():
        return BagFiles(path, _storage(path), (path,))
    if (path / METADATA).is_file():
        return _rosbag2(path)
    files = _files(path)
    for storage, own in files.items():
        if own and not CONTAINERS[storage].in_rosbag2:
            bag = BagFiles(path, storage, own, directory=True)
            return replace(bag, notes=_other_bags(bag, files))
    bag = _without_metadata(path, f'{path}: has no {METADATA}')
    if (path / METADATA).exists():
        return bag
    # Tools that write single files leave folders like this one. A cut file has a loss of its own.
    return replace(bag, losses=(), notes=(*bag.losses, *_other_bags(bag, files)))


def _other_bags(bag: BagFiles, files: dict[str, tuple[Path, ...]]) -> tuple[str, ...]:
    """Return a note on the files of a folder that are in another container than its bag."""
    names = [path.name for storage, own in files.items() if storage != bag.storage for path in own]
    if not names:
        return ()
    remedy = f'only its {bag.storage} files are read, give each bag by itself'
    return (f'{bag.path}: holds {some_of(names)} too; {remedy}',)


def _files(path: Path) -> dict[str, tuple[Path, ...]]:
    """List the files of each container in a folder, in the order of their numbers."""
    listing = _listed(path) if is_remote(path) else os.listdir(path)  # noqa: PTH208 - speed
    names = sorted(listing, key=lambda name: (len(name), name))
    return {
        storage: tuple(
            path / name
            for name in names
            if any(fnmatchcase(name, pattern) for pattern in container.globs)
        )
        for storage, container in CONTAINERS.items()
    }


def _listed(path: RemotePath) -> Iterable[str]:
    from ..files.remote_reads import listing_of  # noqa: PLC0415 - for URLs only

    return listing_of(path)


def _without_metadata(path: Path, reason: str) -> BagFiles:
    """Locate the files of a folder whose metadata.yaml is absent or unreadable, which is a loss.

    Raises:
        BadBagError: There are no files.
    """
    for storage, files in _files(path).items():
        if files and CONTAINERS[storage].in_rosbag2:
            loss = f'{reason}; its files are read as they are; {reindex_steps(path, files)}'
            return BagFiles(path, storage, files, directory=True, losses=(loss,))
    raise NotABagError(path, f'is a directory without {METADATA}')


def reindex_steps(path: Path, files: Sequence[Path]) -> str:
    """Return the steps by which a user gets a correct metadata.yaml for the files of a folder.

    ros2 bag reindex skips files that are not named NAME_N.SUFFIX, compressed ones among them, and
    fails if no file is left. Source: rosbag2_cpp/reindexer.cpp.
    """
    packed = any(file.suffix == '.zstd' for file in files)
    named = all(_REINDEXED.fullmatch(file.name.removesuffix('.zstd')) for file in files)
    if len(files) == 1 and not named and not packed:
        return f'give the file itself, {files[0]}, here and to ros2 bag play'
    steps = ['unpack its files with zstd -d --rm'] if packed else []
    if not named:
        ending = PurePath(files[0].name.removesuffix('.zstd')).suffix
        steps.append(f'name its files {path.name}_0{ending}, {path.name}_1{ending} and so on')
    return ', '.join([*steps, f'run ros2 bag reindex {path} to make it'])


def _storage(path: Path) -> str:
    if not path.is_file():
        raise BadBagError(path, 'is no regular file')
    with naming(path), path.open('rb') as file:
        head = file.read(_LONGEST_MAGIC)
        if head.startswith(ZSTD_MAGIC):
            from .decompression import decompress_file  # noqa: PLC0415 - for packed files only

            file.seek(0)
            head = next(decompress_file(file), b'')
    if not head:
        raise BadBagError(path, 'is empty')
    for storage, container in CONTAINERS.items():
        if head.startswith(container.magic):
            return storage
    raise NotABagError(path, 'is a file of another kind')


def _rosbag2(path: Path) -> BagFiles:
    # 15 ms that other sources do not need
    from ..model.yaml_text import load_yaml  # noqa: PLC0415

    source = path / METADATA
    try:
        with naming(source):
            information = load_yaml(metadata_bytes(path))['rosbag2_bagfile_information']
        storage = str(information['storage_identifier'])
        # Early versions wrote the directory's name before the file's.
        listed = Counter(PurePath(name).name for name in information['relative_file_paths'])
        names = [*listed]
        mode = _compression_mode(information)
        count = int(information['message_count'])
        entries = information.get('topics_with_message_count') or ()
        topics = tuple(str(entry['topic_metadata']['name']) for entry in entries)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        reason = ' '.join(str(error).split())
        if any(_files(path).values()):
            return _without_metadata(path, f'{source}: is no metadata of rosbag2 ({reason})')
        raise BadBagError(source, f'is no metadata of rosbag2 ({reason})') from error
    if storage not in CONTAINERS or not CONTAINERS[storage].in_rosbag2:
        raise BadBagError(path, f'has a storage {storage!r} that is not known here')
    files = tuple(path / name for name in names)
    missing = [file.name for file in files if not _is_file(file)]
    if missing and len(missing) == len(files):
        raise BadBagError(path, f'{missing[0]} is missing, which its {METADATA} lists')
    return BagFiles(
        path,
        storage,
        tuple(file for file in files if file.name not in missing),
        directory=True,
        compression_mode=mode,
        message_count=count,
        topics=topics,
        losses=(
            *(f'{path}: {name} is missing, which its {METADATA} lists' for name in missing),
            *(
                f'{path}: its {METADATA} lists {name} {count} times; it is read once'
                for name, count in listed.items()
                if count > 1
            ),
        ),
    )


def metadata_bytes(path: Path) -> bytes:
    """Read the metadata.yaml of a bag's folder.

    Raises:
        ValueError: It is no regular file, or larger than any.
        OSError: It cannot be read.
    """
    source = path / METADATA
    if not source.is_file():
        raise ValueError('no regular file')
    size = source.stat().st_size
    if size > _MOST_METADATA:
        raise ValueError(f'{size} bytes, more than {_MOST_METADATA}')
    return source.read_bytes()


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # of a name that no file can have
        return False


def _compression_mode(information: dict[str, Any]) -> str:
    mode = str(information.get('compression_mode') or '').lower()
    if mode in {'', 'none'}:
        return ''
    scheme = information.get('compression_format')
    if scheme != 'zstd' or mode not in {'file', 'message'}:
        raise ValueError(f'compression {scheme!r} by {mode} is not known here')
    return mode


# The bags in a folder, by the names of its files; none is opened.

_GLOBS = tuple(glob for container in CONTAINERS.values() for glob in container.globs)
_ENDINGS = tuple(glob.removeprefix('*') for glob in _GLOBS)


def is_bag_name(path: Path) -> bool:
    """Return whether a file has the name of a bag of any container."""
    return any(path.match(glob) for glob in _GLOBS)


def stem_of(path: Path) -> str:
    """Return the name of a bag without the ending of its container."""
    for ending in _ENDINGS:
        if path.name.endswith(ending) and path.name != ending:
            return path.name.removesuffix(ending)
    return path.name


def bags_among(folder: Path, names: Iterable[str]) -> list[Path]:
    """Return the bags in a folder, in the order of their names.

    Files named FOLDER_N are one bag, which is the folder: a ROS 1 bag that was split, or a rosbag2
    directory whose metadata.yaml is missing.

    Args:
        folder: A folder.
        names: Names of its files.
    """
    if METADATA in names:
        return [folder]
    files = [folder / name for name in sorted(names) if is_bag_name(folder / name)]
    part = re.compile(rf'{re.escape(folder.name)}_\d+\.')
    if files and all(part.match(file.name) for file in files):
        return [folder]
    return files
