# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cuts the scans of data sets into a new data set of the same layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..bags.open_source import open_folders
from ..files.local_files import FileLinker
from ..files.output_rules import refusal_of
from ..files.remote import as_path, is_remote
from ..files.staging import lies_inside, refuse_inside, staged
from ..files.threads import ordered_map, worker_count
from ..kitti.find import absolute
from ..kitti.opening import keep_all_but_data_sets
from ..kitti.store import STORE
from ..model.errors import (
    KittiRos2Error,
    Loss,
    MissingDataError,
    UsageError,
    describe_error,
    format_count,
    format_numbers,
    some_of,
)
from ..model.streams import Stream
from ..options.datasets import EmptyLabels
from .scan_crop import CropPaths, ScanCropper, without_tracks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from os import PathLike
    from pathlib import Path, PurePosixPath

    from typing_extensions import Unpack

    from ..kitti.kitti_recording import KittiRecording
    from ..options.datasets import CropOptions
    from ..options.keywords import CropKeywords
    from .scan_crop import CutScan


# Cuts the scans of one recording, and links or copies its other files.


@dataclass
class CroppedRecording:
    """A recording of the new data set.

    Attributes:
        name: Name of the drive, split or sequence.
        folder: Folder of the cut scans in the data set.
        scans: Number of scans.
        points_before, points_after: Number of their points.
        labels_dropped: Number of dropped labels.
        linked, copied: Number of unchanged files: hard links, copies.
        size_bytes: Size of the new files.
    """

    name: str
    folder: str
    scans: int = 0
    points_before: int = 0
    points_after: int = 0
    labels_dropped: int = 0
    linked: int = 0
    copied: int = 0
    size_bytes: int = 0


class RecordingCrop:
    """Cuts the scans of one recording, and links or copies its other files.

    Attributes:
        result: The recording of the new data set, so far.
        tops: The files and folders that contain all of its files.
    """

    def __init__(self, recording: KittiRecording, options: CropOptions, linker: FileLinker) -> None:
        self._recording = recording
        self._options = options
        self._linker = linker
        self._paths = CropPaths(recording, options)
        self.tops = self._paths.tops
        self._failures: dict[tuple[Stream, str], list[int]] = {}
        self._emptied: list[int] = []
        self._noted: dict[str, list[int]] = {}
        self.result = CroppedRecording(recording.name, str(self._paths.scan_folder))

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self._paths.numbers)

    @property
    def losses(self) -> list[Loss]:
        """Data that is unusable so far, or missing in the recording."""
        failed = [
            _loss(stream, reason, numbers) for (stream, reason), numbers in self._failures.items()
        ]
        needed = {Stream.SCAN.value}
        drop = self._options.empty_labels is EmptyLabels.DROP
        if drop and Stream.LABELS not in self._recording.streams:  # an unreadable file
            needed.add(Stream.LABELS.value)
        return failed + [loss for loss in self._recording.losses if loss.stream in needed]

    @property
    def moved(self) -> str:
        """How its points are moved, '' if they are those of the files."""
        return '' if self._recording.deskew is None else self._recording.deskew.state

    @property
    def notes(self) -> list[str]:
        """Notes so far."""
        notes = [
            f'{self.result.folder}: {note}: scans {format_numbers(numbers)}'
            for note, numbers in self._noted.items()
        ]
        if self._emptied:
            numbers = format_numbers(self._emptied)
            notes.append(
                f'{self.result.folder}: no point is left in frames {numbers}; their files are empty'
            )
        return [*self._paths.notes, *notes]

    def run(self, root: Path, shared_paths: set[PurePosixPath]) -> Iterator[int]:
        """Write the recording, and yield the number of each finished scan.

        Args:
            root: Folder of the new data set.
            shared_paths: Targets of files that recordings share; those of this one are added.

        Raises:
            OSError: The output cannot be written.
        """
        for source, target in self._paths.others(self._fail):
            if target not in shared_paths:
                self._link(source, root / target)
        shared_paths |= self._paths.single_files
        cropper = ScanCropper(self._recording, self._options, self._paths, self._linker, root)
        rows: dict[int, Sequence[int]] = {}
        for cut in ordered_map(cropper.crop, self._paths.numbers, worker_count()):
            self._add(cut)
            if cut.empty_rows:
                rows[cut.number] = cut.empty_rows
            yield cut.number
        self._write_tracks(root, rows)

    def _add(self, cut: CutScan) -> None:
        """Add the result of a frame."""
        result = self.result
        result.scans += cut.done
        result.points_before += cut.before
        result.points_after += cut.after
        result.labels_dropped += len(cut.empty_rows)
        result.linked += sum(cut.linked)
        result.copied += len(cut.linked) - sum(cut.linked)
        result.size_bytes += cut.size_bytes
        if cut.before and not cut.after:
            self._emptied.append(cut.number)
        if cut.note:
            self._noted.setdefault(cut.note, []).append(cut.number)
        for failure in cut.failures:
            self._failures.setdefault(failure, []).append(cut.number)

    def _write_tracks(self, root: Path, rows: dict[int, Sequence[int]]) -> None:
        """Write the label file of the whole recording without the empty labels."""
        paths = self._paths.tracks()
        if paths is None:
            return
        source, target = paths
        if not rows:
            self._link(source, root / target)
            return
        try:
            data = without_tracks(STORE.read_text(source), rows).encode()
        except (KittiRos2Error, OSError) as error:
            self._fail(error)
            return
        STORE.write(root / target, data, new=True)
        self.result.size_bytes += len(data)

    def _link(self, source: Path, target: Path) -> None:
        try:
            linked = self._linker.link(source, target)
        except KittiRos2Error as error:
            self._fail(error)
            return
        self.result.linked += linked
        self.result.copied += not linked

    def _fail(self, error: KittiRos2Error | OSError) -> None:
        self._failures[Stream.RECORDING, f'{describe_error(error)}; it is left out'] = []


def _loss(stream: Stream, reason: str, numbers: list[int]) -> Loss:
    """Return the loss of frames for one reason, which has the file of a single frame."""
    text = reason.replace('{', '(').replace('}', ')')
    frames = ' (frames {})' if len(numbers) > 1 else ''
    return Loss(stream.value, max(1, len(numbers)), text + frames, tuple(numbers))


if TYPE_CHECKING:
    AnyPath = str | PathLike[str]
    Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class CropReport:
    """A written data set.

    Attributes:
        path: Folder.
        layout: Layout.
        recordings: Drives, splits or sequences.
        losses: Unusable data.
        notes: Lines that cost no data.
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
        options: Options of `kitti-ros2 crop --help-all`, with underscores and the same defaults:
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
    from ..api.arguments import by_name, warn_of  # noqa: PLC0415 - for the library only
    from ..options.datasets import CROP, make_crop_options  # noqa: PLC0415 - as above

    settings = make_crop_options(by_name(options, CROP))
    report = crop_sets(as_path(src), as_path(out), settings, progress)
    warn_of(report.losses)
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
    _check_out(src, out)
    _refuse_tracklets(recordings, options)
    if not options.changes:
        raise UsageError(
            'crop without a filter would write all scans unchanged; give --range :80, --view'
            ' reduced or another one, see kitti-ros2 crop --help'
        )
    linker = FileLinker(copy=options.copy)
    jobs = [RecordingCrop(recording, options, linker) for recording in recordings]
    if not any(map(len, jobs)):
        raise MissingDataError(f'{src}: no scans; crop cuts the .bin files of a KITTI folder')
    refusal = refusal_of(keep_all_but_data_sets(len(jobs)), overwrite=options.overwrite)
    with staged(out, refusal, fsync=options.fsync) as root:
        _run(jobs, root, progress)
        losses = tuple(loss for job in jobs for loss in job.losses)
        results = tuple(job.result for job in jobs)
        if not any(result.scans for result in results):
            raise MissingDataError(f'{src}: no scan can be cut; {losses[0].text()}')
    notes = [note for job in jobs for note in job.notes]
    if options.read.sequence is None:
        notes += _note_left_out(absolute(src), frozenset().union(*(job.tops for job in jobs)))
    notes += _note_links(src, linker, results)
    moved = next((job.moved for job in jobs if job.moved), '')
    if moved:
        notes.append(f"scans are written {moved}, not as in KITTI's files")
    elif not options.cuts:
        notes.append('no filter of points is given, so all scans are unchanged')
    return CropReport(out, recordings[0].layout.value, results, losses, tuple(notes))


def _note_links(
    src: Path, linker: FileLinker, results: Sequence[CroppedRecording]
) -> Iterator[str]:
    """Note which of the unchanged files are hard links, and why others are none."""
    linked = sum(result.linked for result in results)
    if linked:
        yield (
            f'{format_count(linked, "unchanged file")} shared with {src} (hard links): who edits'
            f' one changes both; --copy makes copies'
        )
    if linker.why:
        copied = sum(result.copied for result in results)
        yield f'{format_count(copied, "file")} copied, not hard-linked: {linker.why}'


def _run(jobs: list[RecordingCrop], root: Path, progress: Progress | None) -> None:
    total, done = sum(map(len, jobs)), 0
    shared_paths: set[PurePosixPath] = set()
    for job in jobs:
        for _ in job.run(root, shared_paths):
            done += 1
            if progress is not None:
                progress(done, total)


def _note_left_out(src: Path, tops: frozenset[Path]) -> list[str]:
    """Note the files and folders of a source that belong to no recording."""
    left_out: list[str] = []
    pending = [] if any(top in src.parents for top in tops) else [src]
    while pending:
        path = pending.pop()
        if any(path in top.parents for top in tops):
            names = reversed(STORE.names(path))
            pending += [path / name for name in names if not name.startswith('.')]
        elif path not in tops:
            left_out.append(str(path.relative_to(src)))
    return [f'{src}: {some_of(left_out)} left out, as part of no recording'] if left_out else []


def _check_out(src: Path, out: Path) -> None:
    """Refuse an output inside the source, or around it: --overwrite would remove the source."""
    refuse_inside(src, out)
    if lies_inside(src, out):
        raise UsageError(f'{out}: contains the source {src}; give a path outside of it')


def _refuse_tracklets(recordings: list[KittiRecording], options: CropOptions) -> None:
    """Refuse to drop labels of tracklets."""
    for recording in recordings:
        if (
            options.empty_labels is EmptyLabels.DROP
            and (recording.layout.traits.tracklets or recording.layout.traits.world_boxes)
            and Stream.LABELS in recording.streams
        ):
            raise UsageError(
                f'{recording.path(Stream.LABELS, 0)}: --empty-labels drop does not support labels'
                f' of objects over several frames; leave it out, and they are kept'
            )
