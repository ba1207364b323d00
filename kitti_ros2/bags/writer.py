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

from typing import TYPE_CHECKING

from ..files.workers import worker_count
from ..model.containers import CONTAINERS, container_of
from ..model.errors import UsageError
from ..model.spelling import not_one_of
from .contract import Parts, SegmentContext
from .segments import BagWriter

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from rosbags.typesys.store import Typestore

    from ..options.bag import BagOptions

__all__ = ['BagWriter', 'Parts', 'guess_storage', 'open_bag', 'output_path']


def guess_storage(path: Path, asked: str | None = None, default: str = 'mcap') -> str:
    """Return the storage for an output path: the requested one, else the suffix's, else a default.

    Raises:
        UsageError: The suffix and the storage contradict each other, or one of them is unknown.
    """
    if asked is not None and asked not in CONTAINERS:
        raise not_one_of('storage', asked, list(CONTAINERS))
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
    context = SegmentContext(options, typestore, source, threads or worker_count())
    target = output_path(path, options)
    return BagWriter(target, context, single_file=container_of(target.suffix) is not None)
