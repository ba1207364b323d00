# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens a KITTI folder for what reads no bags; the readers of bags are imported for errors only."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..kitti.layouts import open_recording, open_recordings
from ..model.errors import NotKittiError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from ..options.read import ReadOptions


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
        from .mistaken import explain_no_folder  # noqa: PLC0415 - for errors only

        raise explain_no_folder(path, error, forced=options.layout is not None) from None
