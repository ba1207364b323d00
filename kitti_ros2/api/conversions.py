# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversions of recordings and single frames, with the options of the command line."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING

from ..bags.convert import check_options
from ..bags.convert import convert as convert_bag
from ..bags.locate import looks_like_bag
from ..bags.open_source import open_bag_source, open_folder
from ..files.remote import as_path
from ..files.staging import refuse_inside
from ..kitti.extract_oxts import add_extract
from ..kitti.kitti_recording import KittiRecording
from ..kitti.prepare import add_predictions
from ..model.bag_formats import STRING
from ..model.errors import KittiRos2Error, UsageError
from ..model.streams import Stream
from ..options.read import Bound
from ..options.table import TO_BAG, TO_KITTI, BatchOptions, make_import_options, make_settings
from ..own_bags.encode import Encoder
from ..own_bags.schedule import make_schedule
from ..own_bags.to_bag import ExportOptions, ExportReport, convert
from ..own_bags.to_kitti import Conversion
from .arguments import by_name, require, warn_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from contextlib import AbstractContextManager

    from typing_extensions import Unpack

    from ..importer.kitti_frames import ImportReport
    from ..options.keywords import ToBagKeywords, ToKittiKeywords
    from .open_recording import Frame
    from .single_files import AnyPath


# Conversions with the options of the command line.

if TYPE_CHECKING:
    Progress = Callable[[int, int], None]


def to_bag(
    src: AnyPath,
    out: AnyPath,
    *,
    progress: Progress | None = None,
    jobs: int = 1,
    **options: Unpack[ToBagKeywords],
) -> ExportReport:
    """Write a KITTI recording or a bag to a bag, as `kitti-ros2 to-bag` does.

    Args:
        src: A KITTI folder, or a bag.
        out: The bag: a name ending in .mcap or .bag, or that of a rosbag2 folder.
        progress: Called with the samples done and the number of all.
        jobs: Number of worker processes that encode, 1 to 256; 1 encodes in threads, as do
            programs that have threads. The bag is the same.
        options: Options of `kitti-ros2 to-bag --help-all`, with underscores and the same defaults:
            images='raw', topics=['/kitti/oxts/*'], start=12, end='3.5s', overwrite=True, ...

    Returns:
        The written bag: path, counts by topic, frames (0 for a bag), size_bytes, losses, notes.
        Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: The source, an option or the output is invalid; nothing is left behind.

    Examples:
        >>> kitti_ros2.to_bag('2011_09_26/2011_09_26_drive_0005_sync', 'drive.mcap', images='raw')
        ExportReport(...)
    """
    source, target = as_path(src), as_path(out)
    given = by_name(options, TO_BAG)
    settings = make_settings(given)
    if settings.read.layout is None and looks_like_bag(source):
        check_options(source, given, jobs if jobs != 1 else None)
        with open_bag_source(source, whole_chunks=True) as bag:
            converted = convert_bag(bag, target, settings, progress or (lambda _done, _all: None))
        warn_of(converted.losses)
        return ExportReport(frames=0, **vars(converted))
    exported = ExportOptions.of(settings, target)
    recording = open_folder(source, settings.read)
    add_predictions(recording, settings.predictions.path)
    add_extract(recording, settings.imu)
    refuse_inside(source, target)
    report = convert(
        recording,
        target,
        exported,
        progress=_shown(progress),
        jobs=BatchOptions(jobs=jobs).jobs or 1,
    )
    warn_of(report.losses)
    return report


def to_kitti(
    bag: AnyPath | Iterable[AnyPath],
    out: AnyPath,
    *,
    plan: AnyPath | None = None,
    progress: Progress | None = None,
    **options: Unpack[ToKittiKeywords],
) -> list[ImportReport]:
    """Write a bag as a KITTI data set, as `kitti-ros2 to-kitti` does.

    Args:
        bag: A bag, or several of one drive. A bag of to-bag becomes the original recording, byte
            for byte.
        out: The folder to create; with append=True an object set to add to.
        plan: A plan file, as printed by `kitti-ros2 to-kitti BAG --plan`.
        progress: Called with the samples done and the number of all.
        options: Options of `kitti-ros2 to-kitti --help-all`, with underscores, same defaults:
            layout='object', name='training', calib=..., split=0.8, append=True.

    Returns:
        A report for each written data set: layout, name, counts, frames, losses, notes.
        Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: A bag, an option or the output is invalid; nothing is left behind.

    Examples:
        >>> kitti_ros2.to_kitti('drive.mcap', 'dataset')
        [ImportReport(...)]
    """
    paths = [as_path(bag)] if isinstance(bag, (str, PathLike)) else [as_path(path) for path in bag]
    target = as_path(out)
    with ExitStack() as exit_stack:
        opened = []
        for path in paths:
            refuse_inside(require(path), target)
            opened.append(exit_stack.enter_context(open_bag_source(path, whole_chunks=True)))
        if not opened:
            raise UsageError('no bag; expected at least one')
        import_options = make_import_options(by_name(options, TO_KITTI))
        plan_file = None if plan is None else as_path(plan)
        reports = Conversion(
            opened, target, import_options, plan_file, lambda _: None, _shown(progress)
        ).run()
    for report in reports:
        warn_of(report.losses)
    return reports


def _shown(
    progress: Progress | None,
) -> Callable[[int, int], AbstractContextManager[Callable[[int, int], None]]]:
    """Return the callback of a conversion, for the library's progress function."""

    def begin(total: int, _frames: int) -> AbstractContextManager[Callable[[int, int], None]]:
        def show(done: int, _bytes: int) -> None:
            if progress is not None:
                progress(done, total)

        return nullcontext(show)

    return begin


# The messages of a frame, as to-bag writes and the player publishes them.

_OF_RECORDING = (Stream.RECORDING, Stream.PATH)


def encode(frame: Frame, **options: Unpack[ToBagKeywords]) -> dict[str, tuple[str, bytes]]:
    """Serialise the messages of a frame of a KITTI folder, without ROS.

    The bytes equal those of `kitti-ros2 to-bag` for the frame: its scan, images, camera_info,
    IMU, labels and transforms. Topics of the whole recording (path, and the verbatim texts on
    /kitti/source) are left out.

    Args:
        frame: A frame of a recording opened from a KITTI folder.
        options: Options of `kitti-ros2 to-bag` about messages and topics: images='raw',
            topics=[...], ring_time=True, preset='kitti2bag', map='devkit', ...

    Returns:
        Topic to the name of its type and its message, CDR with encapsulation header; with rclpy,
        `publisher.publish(data)` of a publisher of that type publishes it.

    Raises:
        KittiRos2Error: The frame is of a bag, an option is invalid, or data cannot be read.

    Examples:
        >>> msgtype, data = kitti_ros2.encode(recording.frame(1))['/kitti/velo/points']
        >>> msgtype
        'sensor_msgs/msg/PointCloud2'
    """
    recording = frame.source.frames.recording
    if not isinstance(recording, KittiRecording):
        raise UsageError(f'{frame.source.path}: encode needs a KITTI folder; a bag has messages')
    settings = make_settings(by_name(options, TO_BAG))
    only = Bound(frame=frame.number)
    selection = replace(settings.selection, start=only, end=only)
    schedule = make_schedule(recording, selection)
    encoder = Encoder(recording, schedule, settings.messages, selection)
    messages_by_topic: dict[str, tuple[str, bytes]] = {}
    for entry in schedule:
        if entry.stream in _OF_RECORDING:
            continue
        messages, losses = encoder.encode(entry)
        for loss in losses:
            raise KittiRos2Error(loss.text())
        for message in messages:
            row = encoder.table[message.channel]
            if row.msgtype != STRING:
                messages_by_topic[row.topic] = row.msgtype, b''.join(message.parts)
    return messages_by_topic
