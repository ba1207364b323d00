# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the synthetic recording to disk, in any of the four layouts."""

from __future__ import annotations

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from ..kitti.write_object import ObjectWriter
from ..kitti.write_odometry import OdometryWriter
from ..kitti.write_raw import RawWriter
from ..kitti.write_tracking import TrackingWriter
from ..model.errors import OutputExistsError
from ..model.streams import Layout, Stream
from .drive import SyntheticDrive

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from ..kitti.writer import LayoutWriter
    from .options import SyntheticOptions

DATE = '2011_09_26'
_CAMERAS = {
    Layout.RAW: (0, 1, 2, 3),
    Layout.OBJECT: (2, 3),
    Layout.ODOMETRY: (0, 1, 2, 3),
    Layout.TRACKING: (2, 3),
}
_WRITERS: dict[Layout, Callable[[Path], LayoutWriter]] = {
    Layout.RAW: lambda root: RawWriter(root, DATE, drive=1),
    Layout.OBJECT: ObjectWriter,
    Layout.ODOMETRY: OdometryWriter,
    Layout.TRACKING: TrackingWriter,
}


def write_synthetic(
    root: Path,
    layout: Layout,
    options: SyntheticOptions | None = None,
    *,
    progress: Callable[[int], None] | None = None,
) -> Path:
    """Write a synthetic recording.

    Everything is written beside root and moved there when it is complete, so an interrupted run
    leaves no half recording under its name.

    Args:
        root: A folder that is not there yet, or is empty.
        layout: Which of the four layouts.
        options: What to make.
        progress: Called with the number of frames done after each frame.

    Returns:
        The folder to convert: the drive (raw), else root.

    Raises:
        OutputExistsError: root is taken.
        OSError: The disk refuses.
    """
    root = root.resolve()
    if root.exists() and not (root.is_dir() and not any(root.iterdir())):
        raise OutputExistsError(root, 'choose a folder that is not there yet, or is empty')
    partial = root.with_name(f'.{root.name}.partial')
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        _write(partial, layout, SyntheticDrive(options), progress)
        if root.exists():
            root.rmdir()
        partial.rename(root)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return root / DATE / f'{DATE}_drive_0001_sync' if layout is Layout.RAW else root


def _write(
    root: Path, layout: Layout, drive: SyntheticDrive, progress: Callable[[int], None] | None
) -> None:
    cameras = _CAMERAS[layout]
    with ThreadPoolExecutor(os.cpu_count()) as pool, _WRITERS[layout](root) as writer:
        for frame in range(len(drive)):
            images = [pool.submit(drive.image, frame, camera) for camera in cameras]
            _write_frame(writer, drive, frame)
            stamps = drive.stamps(frame).images
            for camera, image in zip(cameras, images, strict=True):
                writer.write_image(camera, frame, stamps[camera], image.result().png)
            if progress is not None:
                progress(frame + 1)


def _write_frame(writer: LayoutWriter, drive: SyntheticDrive, frame: int) -> None:
    """All samples of a frame that the layout has a place for, but the images."""
    stamps = drive.stamps(frame)
    if frame == 0 or writer.layout is Layout.OBJECT:
        writer.write_calibration(frame, drive.calibration)
    writer.write_scan(frame, stamps.scan, drive.scan(frame))
    if Stream.OXTS in writer.accepts:
        writer.write_oxts(frame, stamps.oxts, drive.packet(frame))
    if Stream.POSE in writer.accepts:
        writer.write_pose(frame, stamps.scan, drive.pose(frame).matrix()[:3])
    if Stream.LABELS in writer.accepts:
        writer.write_labels(frame, drive.boxes(frame))
