# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cuts the scans of data sets into a new data set of the same layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..bags.open_folder import open_folders
from ..files.hard_links import FilePlacer
from ..files.remote import as_path, is_remote
from ..files.staging import lies_inside, refuse_inside, staged
from ..kitti.find import absolute
from ..kitti.replacing import keep_all_but_data_sets
from ..kitti.store import STORE
from ..model.errors import MissingDataError, UsageError
from ..model.streams import Stream
from ..model.text import format_count, some_of
from ..options.crop import EmptyLabels
from .recording_crop import RecordingCrop

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike
    from pathlib import Path, PurePosixPath

    from typing_extensions import Unpack

    from ..api.keywords import CropKeywords
    from ..kitti.recording import KittiRecording
    from ..model.losses import Loss
    from ..options.crop import CropOptions
    from .recording_crop import CroppedRecording

    AnyPath = str | PathLike[str]
    Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CropReport:
    """The data set that was written.

    Attributes:
        path: Its folder.
        layout: Its layout.
        recordings: Its drives, splits or sequences.
        losses: What could not be used.
        notes: Remarks.
    """

    path: Path
    layout: str
    recordings: tuple[CroppedRecording, ...]
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def crop(
    src: AnyPath,
    out: AnyPath,
    *,
    progress: Progress | None = None,
    **options: Unpack[CropKeywords],
) -> CropReport:
    """Cut the scans of a KITTI folder into a new data set, as `kitti-ros2 crop` does.

    Args:
        src: A drive, split, sequence or a whole set of them.
        out: The folder to create.
        progress: Called with the scans done and the number of all.
        options: Those of `kitti-ros2 crop --help`, with underscores and the same defaults:
            view='reduced', box=[0, -40, -3, 70.4, 40, 1], range=(0.5, 80), lasers=32, voxel=0.1,
            folder='velodyne_reduced', empty_labels='drop', copy=True, sequence='00'.

    Returns:
        What was written: points before and after for each recording, losses, notes. Each loss is
        also a KittiRos2Warning.

    Raises:
        KittiRos2Error: The source, an option or the output is invalid; nothing is left behind.

    Examples:
        >>> from kitti_ros2.datasets import crop
        >>> crop('2011_09_26/2011_09_26_drive_0005_sync', 'in_view', view='reduced')
        CropReport(...)
    """
    from ..api.keywords import by_name  # noqa: PLC0415 - for the library only
    from ..api.source import warn  # noqa: PLC0415 - pictures
    from ..options.dataset_tables import CROP, make_crop_options  # noqa: PLC0415 - as above

    settings = make_crop_options(by_name(options, CROP))
    report = crop_sets(as_path(src), as_path(out), settings, progress)
    for loss in report.losses:
        warn(loss.text())
    return report


def crop_sets(
    src: Path, out: Path, options: CropOptions, progress: Progress | None = None
) -> CropReport:
    """Cut the scans of all recordings at a path, or of the chosen one.

    Raises:
        KittiRos2Error: The source, an option or the output is invalid; nothing is left behind.
    """
    if is_remote(src) or is_remote(out):
        raise UsageError(
            f'{src if is_remote(src) else out}: crop links files: it takes folders of'
            f' this machine only'
        )
    recordings = open_folders(src, options.read)
    _check_places(src, out)
    _refuse_tracklets(recordings, options)
    placer = FilePlacer(copy=options.copy)
    jobs = [RecordingCrop(recording, options, placer) for recording in recordings]
    if not any(map(len, jobs)):
        raise MissingDataError(f'{src}: no scans; crop cuts the .bin files of a KITTI folder')
    refusal = keep_all_but_data_sets(len(jobs)) if options.overwrite else None
    with staged(out, refusal, fsync=options.fsync) as root:
        _run(jobs, root, progress)
        losses = tuple(loss for job in jobs for loss in job.losses)
        results = tuple(job.result for job in jobs)
        if not any(each.scans for each in results):
            raise MissingDataError(f'{src}: no scan can be cut; {losses[0].text()}')
    notes = [note for job in jobs for note in job.notes]
    if options.read.sequence is None:
        notes += _note_left_out(absolute(src), frozenset().union(*(job.tops for job in jobs)))
    if placer.why:
        copied = sum(each.copied for each in results)
        notes.append(f'{format_count(copied, "file")} copied, not hard-linked: {placer.why}')
    if not options.cuts:
        notes.append('no filter is given, so all scans are unchanged')
    return CropReport(out, recordings[0].layout.value, results, losses, tuple(notes))


def _run(jobs: list[RecordingCrop], root: Path, progress: Progress | None) -> None:
    total, done = sum(map(len, jobs)), 0
    taken: set[PurePosixPath] = set()
    for job in jobs:
        for _ in job.run(root, taken):
            done += 1
            if progress is not None:
                progress(done, total)


def _note_left_out(src: Path, tops: frozenset[Path]) -> list[str]:
    """Note the files and folders of a source that belong to no recording."""
    found: list[str] = []
    pending = [] if any(top in src.parents for top in tops) else [src]
    while pending:
        path = pending.pop()
        if any(path in top.parents for top in tops):
            names = reversed(STORE.names(path))
            pending += [path / name for name in names if not name.startswith('.')]
        elif path not in tops:
            found.append(str(path.relative_to(src)))
    return [f'{src}: {some_of(found)} left out, as part of no recording'] if found else []


def _check_places(src: Path, out: Path) -> None:
    """Refuse an output inside the source, or around it: --overwrite would remove the source."""
    refuse_inside(src, out)
    if lies_inside(src, out):
        raise UsageError(f'{out}: contains the source {src}; give a path outside of it')


def _refuse_tracklets(recordings: list[KittiRecording], options: CropOptions) -> None:
    """Refuse to drop labels of tracklets."""
    for each in recordings:
        if (
            options.empty_labels is EmptyLabels.DROP
            and each.layout.traits.tracklets
            and Stream.LABELS in each.streams
        ):
            raise UsageError(
                f'{each.path(Stream.LABELS, 0)}: --empty-labels drop does not support tracklets,'
                f' whose poses cannot have gaps; leave it out, and they are kept'
            )
