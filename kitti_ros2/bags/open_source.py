# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens what a user names as a source: a KITTI folder or a bag, or one of them only."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..kitti.opening import open_recording, open_recordings
from ..model.errors import NotABagError, NotKittiError, UsageError
from .locate import looks_like_bag

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..kitti.kitti_recording import KittiRecording
    from ..options.read import ReadOptions
    from .bag_files import OpenBag


# Opens a KITTI folder for what reads no bags; the readers of bags are imported for errors only.


def open_folder(path: Path, options: ReadOptions) -> KittiRecording:
    """Open a KITTI folder.

    Raises:
        KittiRos2Error: There is no such path, or it is a bag, or it cannot be read.
        OSError: The same.
    """
    with explained(path, options):
        return open_recording(path, options)


def open_folders(path: Path, options: ReadOptions) -> list[KittiRecording]:
    """Open all recordings of a KITTI folder, or the one that the options choose.

    Raises:
        KittiRos2Error, OSError: As open_folder.
    """
    with explained(path, options):
        return open_recordings(path, options)


@contextmanager
def explained(path: Path, options: ReadOptions) -> Iterator[None]:
    """Explain what a path is that holds no KITTI recording, such as a bag.

    Raises:
        NotKittiError: It holds none.
    """
    try:
        yield
    except NotKittiError as error:
        from .bag_files import explain_no_folder  # noqa: PLC0415 - for errors only

        raise explain_no_folder(path, error, forced=options.layout is not None) from None


def open_source(path: Path, options: ReadOptions) -> OpenBag | KittiRecording:
    """Open a bag, to be closed by the caller, or a KITTI folder.

    Args:
        path: A file or folder.
        options: Read options of a folder; with a layout the path is a KITTI folder.

    Raises:
        KittiRos2Error: There is no such path, or it cannot be read.
        OSError: The same.
    """
    if options.layout is not None or not looks_like_bag(path):
        return open_folder(path, options)
    if options.deskew or options.undo_deskew:
        raise UsageError(
            f'{path}: deskew and undo_deskew are for KITTI folders, and this is a bag; to-bag takes'
            f' them when it makes the bag'
        )
    from .bag_files import OpenBag, explain_file  # noqa: PLC0415 - folders do without

    try:
        return OpenBag(path)
    except NotABagError:
        raise explain_file(path) from None


def open_bag_source(path: Path, *, whole_chunks: bool = False) -> OpenBag:
    """Open a bag, to be closed by the caller.

    Args:
        path: A file or folder.
        whole_chunks: See OpenBag.

    Raises:
        KittiRos2Error: There is no such path, or it is a KITTI folder, or it cannot be read.
        OSError: The same.
    """
    from .bag_files import OpenBag, explain_no_bag  # noqa: PLC0415 - as above

    try:
        return OpenBag(path, whole_chunks=whole_chunks)
    except NotABagError as error:
        raise explain_no_bag(path, error) from None
