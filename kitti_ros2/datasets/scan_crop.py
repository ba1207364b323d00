# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cuts one scan with the labels of its points, and drops labels of its frame without points."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, cast

import numpy as np

from ..drawing.projection import Projection
from ..files.local_files import walk_files
from ..kitti import names
from ..kitti.find import tree_of
from ..kitti.kitti_recording import image_size
from ..kitti.prepare import CHANGES_NOTHING
from ..kitti.scan_file import (
    format_point_labels,
    format_scan_text,
    parse_point_labels,
    parse_points,
    parse_rows,
    parse_scan_text,
)
from ..kitti.store import STORE
from ..model.boxes import count_points, cuboid_of, has_cuboid, is_absurd
from ..model.errors import KittiRos2Error, MissingDataError, describe_error
from ..model.samples import Scan, rect_from_velo
from ..model.streams import KITTI_COLUMNS, Stream
from ..options.datasets import LASERS, EmptyLabels, View

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
    from pathlib import Path, PurePosixPath

    import numpy.typing as npt

    from ..files.local_files import FileLinker
    from ..kitti.kitti_recording import KittiRecording
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, Float32Array, FrameLabels
    from ..options.datasets import CropOptions


# The files of a cropped recording, and their paths in the new data set.

if TYPE_CHECKING:
    FileTarget = tuple[Path, PurePosixPath]


class CropPaths:
    """The files of a recording, each with its path below the root of the new data set.

    Attributes:
        numbers: File numbers of the scans.
        tops: The files and folders that contain all of its files.
        single_files: Paths of files outside of the recording's folders, which recordings share.
        scan_folder: Path of the cut scans.
        in_place: True if these replace the scans; else they lie beside them.
        labelled: Numbers of frames whose empty labels are dropped.
        track_labels: The label file of the whole recording, if empty labels are dropped in it.
        notes: Lines that cost no data.
    """

    def __init__(self, recording: KittiRecording, options: CropOptions) -> None:
        self._recording = recording
        self._tree = tree = tree_of(recording)
        self.numbers: list[int] = tree.scans.numbers.tolist()
        self.tops = frozenset(path for path, _ in tree.parts)
        self.single_files = frozenset(target for path, target in tree.parts if path.is_file())
        scan_name = tree.scan_root.name
        folder = options.folder or scan_name
        self.in_place = folder == scan_name
        self._scan_root = tree.target / folder
        below = tree.scans.folder.relative_to(tree.scan_root)
        self.scan_folder = self._scan_root / below.as_posix()
        self._replaced = None if self.in_place else tree.scan_root.with_name(folder)
        index = recording.streams.get(Stream.LABELS)
        drop = options.empty_labels is EmptyLabels.DROP and index is not None
        labels: list[int] = index.numbers.tolist() if drop and index is not None else []
        self.labelled = frozenset(labels).intersection(self.numbers)
        common = Stream.LABELS in recording.layout.traits.line_streams
        self.track_labels = recording.path(Stream.LABELS, 0) if common and self.labelled else None
        self.notes = [note for note in recording.notes if _is_on_motion(note)]
        if options.empty_labels is EmptyLabels.DROP and index is None:
            self.notes.append(f'empty_labels {CHANGES_NOTHING}: {recording.name} has no labels')
        self.notes += self._find_notes()

    def scan(self, number: int) -> FileTarget:
        """Return the path of a scan, and of the cut one."""
        path = self._tree.scans.path(number)
        return path, self.scan_folder / path.name

    def point_labels(self, number: int) -> list[FileTarget]:
        """Return the files with labels of the points of a scan; they may not exist."""
        if not self.in_place:
            return []
        name = f'{self._tree.scans.stem(number)}{names.LABEL}'
        return [self._with_target(folder / name) for folder in self._tree.point_labels]

    def frame_labels(self, number: int) -> FileTarget | None:
        """Return the label file of one frame, if its empty labels are dropped."""
        if self.track_labels is not None or number not in self.labelled:
            return None
        return self._with_target(self._recording.path(Stream.LABELS, number))

    def tracks(self) -> FileTarget | None:
        """Return the label file of the whole recording, if empty labels are dropped in it."""
        return None if self.track_labels is None else self._with_target(self.track_labels)

    def others(self, failed: Callable[[OSError], None]) -> Iterator[FileTarget]:
        """Yield all other, unchanged files.

        Args:
            failed: Called with the error of an unreadable folder.
        """
        rewritten = self._rewritten()
        for top, _ in self._tree.parts:
            if self._replaced in top.parents:
                continue
            for path in walk_files(top, lambda folder: folder == self._replaced, failed):
                if path not in rewritten:
                    yield self._with_target(path)
        if not self.in_place:
            yield from self._beside_scans()

    def _beside_scans(self) -> Iterator[FileTarget]:
        """Yield files beside the folder of scans, such as time stamps, for the cut scans."""
        root = self._tree.scan_root
        if root.parent in (top for top, _ in self._tree.parts) and root != self._tree.scans.folder:
            for name in STORE.names(root):
                if (root / name).is_file():
                    yield root / name, self._scan_root / name

    def _rewritten(self) -> set[Path]:
        """Return the cut and rewritten files."""
        rewritten = {self.scan(number)[0] for number in self.numbers} if self.in_place else set()
        for number in self.numbers:
            rewritten.update(path for path, _ in self.point_labels(number))
            labels = self.frame_labels(number)
            rewritten.update([labels[0]] if labels else [])
        return rewritten | ({self.track_labels} if self.track_labels is not None else set())

    def _with_target(self, path: Path) -> FileTarget:
        return path, self._tree.target_of(path)

    def _find_notes(self) -> list[str]:
        tree = self._tree
        if not self.numbers:
            return [f'{tree.scans.folder}: no scans; the other files are unchanged']
        expected = {self._replaced, tree.scan_root}
        beside = [tree.scan_root.with_name(name) for name in STORE.names(tree.scan_root.parent)]
        notes = [
            f'{path}: unchanged, since only {tree.scan_root.name} is cut'
            for path in beside
            if path.name.startswith(names.SCANS) and path not in expected
        ]
        if not self.in_place and tree.point_labels:
            listed = ', '.join(folder.name for folder in tree.point_labels)
            notes.append(f'{tree.target}: {listed} unchanged, with the scans in {names.SCANS}')
        return notes


def _is_on_motion(note: str) -> bool:
    """Return whether a note of a recording is on its scans' motion, or on an idle option."""
    return CHANGES_NOTHING in note or note.startswith(('deskew ', 'undo_deskew: '))


# The points of a scan that a camera sees, by two common rules.
#
# - reference: reflectance > 0, depth >= 0, u and v rounded half to even, 0 < u < width,
#   0 < v < height. The rule of the crop scripts for the object benchmark.
# - reduced: 0.001 < depth < 100, 0 < u < width, 0 < v < height, any reflectance. The rule of
#   velodyne_reduced in OpenPCDet and mmdetection3d.
#
# Both project in float64 with the calibration of the scan's frame: P_i R0_rect Tr_velo_to_cam in
# object and tracking, P_i Tr in odometry, P_rect_i R_rect_00 [R|T] in raw, and by K and D of the
# camera in a raw extract. Width and height are those of the frame's own image in object, whose
# sizes differ; elsewhere all images of a camera have one size.

_NEAREST_M, _FARTHEST_M = 0.001, 100.0


@dataclass(frozen=True, eq=False)
class CameraView:
    """A camera at one frame.

    Attributes:
        rule: Rule for the points that it sees.
        projection: Projection from velo_link into its images.
        size: (width, height) of its images.
    """

    rule: View
    projection: Projection
    size: tuple[int, int]

    def sees(self, points: Float32Array, xyz: Float64Array) -> npt.NDArray[np.bool_]:
        """Return the (N,) mask of the visible of (N, 4) points, whose xyz are (N, 3) float64."""
        seen = self.projection.homogeneous(xyz)
        depth, pixels = self.projection.depth(seen), self.projection.pixels(seen)
        if self.rule is View.REFERENCE:
            near_enough = (points[:, 3] > 0) & (depth >= 0)
            pixels = np.rint(pixels)
        else:
            near_enough = (depth > _NEAREST_M) & (depth < _FARTHEST_M)
        inside = (pixels > 0) & (pixels < self.size)
        visible: npt.NDArray[np.bool_] = near_enough & inside[:, 0] & inside[:, 1]
        return visible


class CameraViews:
    """The view of a camera by frame.

    Args:
        recording: The recording of the frames.
        options: Options with a view.
    """

    def __init__(self, recording: KittiRecording, options: CropOptions) -> None:
        self._recording = recording
        self._rule = options.view
        main_camera = recording.layout.traits.main_camera
        self._camera = main_camera if options.camera is None else options.camera
        self._size = options.image_size
        self._common = lru_cache(maxsize=1)(lambda: self._make(0))

    def at(self, number: int) -> CameraView | None:
        """Return the view at a frame; None without a view option.

        Raises:
            MissingDataError: The calibration or the size of the images is missing.
        """
        if self._rule is None:
            return None
        of_frame = self._recording.layout.traits.calibration_per_frame
        return self._make(number) if of_frame else self._common()

    def _make(self, number: int) -> CameraView:
        calibration = self._recording.calibration(number)
        try:
            projection = Projection.of(calibration, self._camera)
        except ValueError as error:
            parts = (f'P{self._camera}', 'R0_rect', 'Tr_velo_to_cam', 'file')
            reasons = [calibration.missing[part] for part in parts if part in calibration.missing]
            raise MissingDataError(
                reasons[0] if reasons else f'{self._recording.root}: {error}'
            ) from None
        return CameraView(self._rule or View.REDUCED, projection, self._size_at(number))

    def _size_at(self, number: int) -> tuple[int, int]:
        """Return the size of the images, from the options, the calibration or an image."""
        if self._size is not None:
            return self._size
        return image_size(self._recording, self._camera, number, '--image-size')


# The filters of the points of a scan.
#
# The lasers are counted on the whole scan. Each point must then pass every other filter: view,
# boxes, range and height. Of the points left, each voxel keeps the first one in the file. Points
# without finite coordinates pass no filter. The order of the points never changes.

if TYPE_CHECKING:
    Mask = npt.NDArray[np.bool_]


def kept_points(points: Float32Array, options: CropOptions, view: CameraView | None) -> Mask:
    """Return the (N,) mask of the (N, 4) points that pass the filters.

    Args:
        points: A whole scan: x y z in metres in velo_link, reflectance.
        options: The filters.
        view: The camera at this scan; None without a view option.

    Raises:
        ValueError: Lasers cannot be counted; the message contains the reason.
    """
    keep = np.ones(len(points), bool)
    if not options.cuts or not len(points):
        return keep
    xyz = points[:, :3].astype(np.float64)
    keep &= _every_axis(np.isfinite(xyz))
    xyz[~keep] = 0.0
    if options.lasers is not None:
        keep[keep] = _every_nth_laser(points[keep], options.lasers)
    if view is not None:
        keep &= view.sees(points, xyz)
    if options.boxes:
        keep &= _in_any_box(xyz, options.boxes)
    if options.range_m is not None:
        x, y, z = xyz.T
        keep &= _between(np.sqrt(x * x + y * y + z * z), options.range_m)
    if options.height_m is not None:
        keep &= _between(xyz[:, 2], options.height_m)
    if options.voxel_m is not None:
        keep[keep] = first_of_each_voxel(xyz[keep], options.voxel_m)
    return keep


def first_of_each_voxel(xyz: Float64Array, size_m: float) -> Mask:
    """Return the (N,) mask of the first point of each voxel; the grid begins at the origin."""
    cells = np.floor(xyz / size_m)
    order = np.lexsort(cells.T)  # stable: the points of a voxel stay in their order
    ordered = cells[order]
    first = np.ones(len(xyz), bool)
    first[1:] = ~_every_axis(ordered[1:] == ordered[:-1])
    keep = np.zeros(len(xyz), bool)
    keep[order[first]] = True
    return keep


def _every_nth_laser(points: Float32Array, lasers: int) -> Mask:
    """Return the mask of points of the lowest laser and every n-th above it."""
    from ..messages.scan import rings  # noqa: PLC0415 - the messages of ROS

    if not len(points):
        return np.ones(0, bool)
    laser = rings(points)
    count = int(laser.max()) + 1
    if count not in {LASERS, lasers}:
        raise ValueError(
            f'the azimuth wraps {count - 1} times, so {count} lasers are found instead of {LASERS};'
            f' lasers can be counted only in whole scans in their original order'
        )
    every: Mask = laser % (count // lasers) == 0
    return every


def _in_any_box(xyz: Float64Array, boxes: tuple[tuple[float, ...], ...]) -> Mask:
    mask = np.zeros(len(xyz), bool)
    for box in boxes:
        mask |= _every_axis((xyz >= box[:3]) & (xyz <= box[3:]))
    return mask


def _every_axis(rows: Mask) -> Mask:
    """Return the mask of rows with three true values; eight times as fast as all(axis=1)."""
    every: Mask = rows[:, 0] & rows[:, 1] & rows[:, 2]
    return every


def _between(values: Float64Array, span: tuple[float, float]) -> Mask:
    inside: Mask = (values >= span[0]) & (values <= span[1])
    return inside


# Label lines whose 3D box contains no point.
#
# All other lines keep their bytes, also invalid ones and those without a 3D box (DontCare, 2D
# detections).


def empty_rows(labels: FrameLabels, calibration: Calibration, points: Float32Array) -> list[int]:
    """Return the rows of a frame's labels whose 3D box contains none of (N, 4) points.

    Raises:
        ValueError: The calibration has no transform from velo_link.
    """
    solid = [
        (row, box)
        for row, box in enumerate(labels.boxes)
        if box is not None and has_cuboid(box) and not is_absurd(box)
    ]
    if not solid:
        return []
    rect_t_velo = rect_from_velo(calibration)
    counts = count_points([cuboid_of(box, '', rect_t_velo) for _, box in solid], points)
    return [row for (row, _), count in zip(solid, counts, strict=True) if not count]


def without_rows(text: str, rows: Collection[int]) -> str:
    """Return a label file without some lines, counted from 0."""
    lines = text.splitlines(keepends=True)
    return ''.join(line for row, line in enumerate(lines) if row not in rows)


def without_tracks(text: str, rows: Mapping[int, Collection[int]]) -> str:
    """Return a label file of tracking without some lines of frames.

    Args:
        text: The whole file; the first column is the frame.
        rows: Lines to drop by frame, counted from 0 among the lines of that frame.
    """
    seen: Counter[int] = Counter()
    kept_lines = []
    for line in text.splitlines(keepends=True):
        word = line.split(maxsplit=1)[0] if line.strip() else ''
        frame = int(word) if word.isdecimal() and len(word) <= names.FRAME_DIGITS else -1
        if seen[frame] not in rows.get(frame, ()):
            kept_lines.append(line)
        seen[frame] += 1
    return ''.join(kept_lines)


@dataclass
class CutScan:
    """The result of cutting a frame.

    Attributes:
        number: File number.
        before, after: Number of points.
        done: True if the scan is written, linked or copied.
        linked: True for each hard link, False for each copy of an unchanged file.
        size_bytes: Size of new files.
        empty_rows: Dropped lines of the frame's labels.
        failures: Unusable data: stream and reason.
        note: On the points of the scan; empty for none.
    """

    number: int
    before: int = 0
    after: int = 0
    done: bool = False
    linked: list[bool] = field(default_factory=list)
    size_bytes: int = 0
    empty_rows: Sequence[int] = ()
    failures: list[tuple[Stream, str]] = field(default_factory=list)
    note: str = ''


class ScanCropper:
    """Cuts the scans of a recording, in any thread.

    Args:
        recording: The recording.
        options: The filters.
        paths: Files.
        linker: Links or copies unchanged files.
        root: Folder of the new data set.
    """

    def __init__(
        self,
        recording: KittiRecording,
        options: CropOptions,
        paths: CropPaths,
        linker: FileLinker,
        root: Path,
    ) -> None:
        self._recording = recording
        self._options = options
        self._paths = paths
        self._linker = linker
        self._root = root
        self._views = CameraViews(recording, options)

    def crop(self, number: int) -> CutScan:
        """Cut a scan; unusable data is a failure in the result.

        Raises:
            OSError: The output cannot be written.
        """
        result = CutScan(number)
        path, _ = self._paths.scan(number)
        try:
            scan = _ReadScan.read(path, self._recording)
            if self._recording.deskew is not None:
                scan = scan.moved(self._recording, number)
            keep = kept_points(scan.points, self._options, self._views.at(number))
        except (KittiRos2Error, OSError) as error:
            self._leave_out(result, describe_error(error))
        except ValueError as error:
            self._leave_out(result, f'{path}: {error}')
        else:
            result.note = scan.note
            result.before, result.after = len(keep), int(np.count_nonzero(keep))
            if not result.before:
                result.failures.append((Stream.SCAN, f'{path}: the file is empty, and stays so'))
            result.done = self._put(
                result, self._paths.scan(number), scan.cut, keep, changed=scan.is_moved
            )
            self._cut_point_labels(result, keep)
            self._find_empty_labels(result, scan.points[keep])
        self._write_labels(result)
        return result

    def _leave_out(self, result: CutScan, reason: str) -> None:
        """Report a scan that cannot be cut, nor the labels of its points."""
        labelled = any(path.exists() for path, _ in self._paths.point_labels(result.number))
        too = '; the labels of its points are left out, too' if labelled else ''
        result.failures.append((Stream.SCAN, f'{reason}{too}'))

    def _cut_point_labels(self, result: CutScan, keep: Mask) -> None:
        for paths in self._paths.point_labels(result.number):
            try:
                labels = parse_point_labels(STORE.read(paths[0]), len(keep), paths[0])
            except FileNotFoundError:
                continue
            except (KittiRos2Error, OSError) as error:
                reason = f'{describe_error(error)}; the labels are left out'
                result.failures.append((Stream.LABELS, reason))
            else:
                self._put(result, paths, _cutter(labels), keep)

    def _find_empty_labels(self, result: CutScan, points: Float32Array) -> None:
        if result.number not in self._paths.labelled:
            return
        calibration = self._recording.calibration(result.number)
        try:
            labels = cast('FrameLabels', self._recording.read(Stream.LABELS, result.number))
            result.empty_rows = empty_rows(labels, calibration, points)
        except (KittiRos2Error, OSError) as error:
            result.failures.append((Stream.LABELS, f'{describe_error(error)}; all are kept'))
        except ValueError as error:
            reason = next(iter(calibration.missing.values()), str(error))
            result.failures.append((Stream.LABELS, f'{reason}; all labels are kept'))

    def _write_labels(self, result: CutScan) -> None:
        """Write the labels of the frame without the empty ones."""
        paths = self._paths.frame_labels(result.number)
        if paths is None:
            return
        if not result.empty_rows:
            self._link(result, paths)
            return
        try:
            text = without_rows(STORE.read_text(paths[0]), result.empty_rows)
        except (KittiRos2Error, OSError) as error:
            result.empty_rows = ()
            reason = f'{describe_error(error)}; it is left out'
            result.failures.append((Stream.LABELS, reason))
        else:
            self._write(result, paths, text.encode())

    def _put(
        self,
        result: CutScan,
        paths: FileTarget,
        cut: Callable[[Mask], bytes],
        keep: Mask,
        *,
        changed: bool = False,
    ) -> bool:
        """Write a part of a file; link or copy a file that stays whole, unless it is changed."""
        if keep.all() and not changed:
            return self._link(result, paths)
        self._write(result, paths, cut(keep))
        return True

    def _link(self, result: CutScan, paths: FileTarget) -> bool:
        try:
            result.linked.append(self._linker.link(paths[0], self._root / paths[1]))
        except KittiRos2Error as error:
            result.failures.append((Stream.SCAN, f'{error}; it is left out'))
            return False
        return True

    def _write(self, result: CutScan, paths: FileTarget, data: bytes) -> None:
        STORE.write(self._root / paths[1], data, new=True)
        result.size_bytes += len(data)


@dataclass(frozen=True, eq=False)
class _ReadScan:
    """The points of a scan, and its unparsed rows: bytes or text lines.

    Attributes:
        is_moved: Whether they differ from the file's by the compensation of motion, or its undoing.
        note: On their motion; empty for none.
    """

    points: Float32Array
    rows: npt.NDArray[np.void] | None = None
    lines: list[bytes] | None = None
    is_moved: bool = False
    note: str = ''

    @classmethod
    def read(cls, path: Path, recording: KittiRecording) -> _ReadScan:
        """Read a .bin or a .txt file; an empty one has no points.

        Raises:
            BadFileError: The file is invalid.
            OSError: It cannot be read.
        """
        data = STORE.read_array(path)
        if not len(data):
            return cls(np.empty((0, 4), np.float32))
        if path.suffix != names.TXT:
            recording.check_scan(path, data)
            columns = recording.options.columns or KITTI_COLUMNS
            points = parse_points(data, path, columns).points
            return cls(points, parse_rows(data, path, columns))
        text = data.tobytes()
        lines = text.splitlines(keepends=True)
        return cls(parse_scan_text(text, path), lines=lines)

    def moved(self, recording: KittiRecording, number: int) -> _ReadScan:
        """Return the scan with its points compensated for motion, or as they were measured.

        Raises:
            MissingDataError: There are no packets or poses near.
        """
        scan = Scan(self.points, turn=recording.turns.get(number))
        adjusted = recording.adjust_scan(number, scan)
        points = adjusted.points
        if self.lines is not None:
            lines = format_scan_text(points).splitlines(keepends=True)
            return _ReadScan(points, lines=lines, is_moved=True, note=adjusted.note)
        if self.rows is None:
            return self
        rows = self.rows.copy()
        for axis, name in enumerate('xyz'):
            rows[name] = points[:, axis]
        return _ReadScan(points, rows, is_moved=True, note=adjusted.note)

    def cut(self, keep: Mask) -> bytes:
        """Return the bytes of some points."""
        if self.lines is not None:
            return b''.join(self.lines[row] for row in np.flatnonzero(keep).tolist())
        return b'' if self.rows is None else self.rows[keep].tobytes()


def _cutter(labels: npt.NDArray[np.uint32]) -> Callable[[Mask], bytes]:
    return lambda keep: format_point_labels(labels[keep])
