# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writing of the synthetic recording to disk, in any layout."""

from __future__ import annotations

import os
import shutil
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.threads import Threads
from ..kitti.layout_files import make_writer
from ..model.errors import OutputExistsError, UsageError
from ..model.layouts import Layout
from ..model.streams import Stream
from .drive import SyntheticDrive

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..kitti.writer import LayoutWriter
    from .options import SyntheticOptions

DATE = '2011_09_26'


def write_synthetic(
    root: Path,
    layout: Layout,
    options: SyntheticOptions | None = None,
    *,
    progress: Callable[[int], None] | None = None,
) -> Path:
    """Write a synthetic recording.

    Everything is written beside root and moved there when complete, so an interrupted run leaves
    no incomplete recording under its name.

    Args:
        root: A folder that does not exist, or is empty.
        layout: The layout to write.
        options: Options of the recording.
        progress: Called with the number of frames done after each frame.

    Returns:
        The folder to convert: the drive (raw), else root.

    Raises:
        OutputExistsError: root exists and is not empty.
        UsageError: The options request an unsynchronised drive, which the layout does not have.
        OSError: A file cannot be written.
    """
    if options is not None and options.extract and not layout.traits.extracts:
        raise UsageError(f'layout {layout.value} has no unsynchronised drives; expected raw')
    root = Path(os.path.realpath(root))
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
    return root / DATE / _name(layout) if layout.traits.dated else root


def _name(layout: Layout) -> str:
    return layout.traits.default_name.format(date=DATE, kind='sync')


def extract_of(drive: Path) -> Path:
    """Return the folder of the unsynchronised drive beside a synchronised one."""
    return drive.with_name(drive.name.removesuffix('sync') + 'extract')


def _write(
    root: Path, layout: Layout, drive: SyntheticDrive, progress: Callable[[int], None] | None
) -> None:
    cameras = layout.traits.cameras
    with (
        Threads(os.cpu_count() or 1, 'image') as threads,
        make_writer(layout, root, _name(layout)) as writer,
    ):
        for frame in range(len(drive)):
            images = [threads.submit(partial(drive.image, frame, camera)) for camera in cameras]
            _write_frame(writer, drive, frame)
            stamps = drive.stamps(frame).images
            for camera, image in zip(cameras, images, strict=True):
                writer.write_image(camera, frame, stamps[camera], image.result().data)
            if progress is not None:
                progress(frame + 1)
    if drive.options.extract:
        write_extract(root, drive)


def write_extract(root: Path, drive: SyntheticDrive) -> None:
    """Write the packets of the unsynchronised drive below the folder of its date."""
    name = Layout.RAW.traits.default_name.format(date=DATE, kind='extract')
    with make_writer(Layout.RAW, root, name) as writer:
        for number, stamp_ns in enumerate(drive.arrivals.stamps_ns.tolist()):
            writer.write_oxts(number, stamp_ns, drive.arrived(number))


def _write_frame(writer: LayoutWriter, drive: SyntheticDrive, frame: int) -> None:
    """Write the samples of a frame that the layout has, without the images."""
    stamps = drive.stamps(frame)
    if frame == 0 or writer.layout.traits.calibration_per_frame:
        writer.write_calibration(frame, drive.calibration)
    writer.write_scan(frame, stamps.scan, drive.scan(frame))
    if Stream.OXTS in writer.accepts:
        writer.write_oxts(frame, drive.packet_stamp(frame), drive.packet(frame))
    if Stream.POSE in writer.accepts:
        writer.write_pose(frame, stamps.scan, drive.pose(frame).matrix()[:3])
    if Stream.LABELS in writer.accepts:
        writer.write_labels(frame, drive.boxes(frame))
