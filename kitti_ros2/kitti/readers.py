# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The readers of the four layouts: raw, object, odometry, tracking."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..kitti import names
from ..kitti import object_set as append_journal
from ..model.errors import BadFileError, UsageError, describe_error
from ..model.recording import StreamIndex
from ..model.samples import Scan, TextFile
from ..model.streams import IMAGE_STREAMS, LAST_NS, Clock, Layout, Stream
from ..options.read import ScanStamp
from .archives import day_of_drive, describe_source
from .calib_file import parse_raw_calibration
from .kitti_recording import KittiRecording, no_calibration, pose_from_odometry
from .label_file import TrackFile, frame_labels, parse_labels
from .object_set import (
    ENDS,
    REAL_TIME,
    STARTS,
    DriveStamps,
    describe_times,
    find_mapping,
    find_raw_root,
)
from .scan_file import parse_point_labels, parse_scan_text
from .store import STORE, cached_listings
from .text_file import Lines, packet_lines, parse_packet, parse_poses, parse_times, parse_timestamps
from .tracklet_file import cuboids_by_frame, labels_of_tracklets, parse_tracklets

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, Description, FrameLabels, OxtsPacket, Pose
    from ..options.read import ReadOptions
    from .object_set import AppendJournal, RealTimes
    from .store import Listing


# Reader of raw drives: DATE/DATE_drive_NNNN_{sync,extract}.
#
# Each stream has its own numbers and its own stamps. In sync the same number is the same time; in
# extract the numbers of streams are independent and the images are not rectified. Scans are as
# measured, not compensated for motion.


class RawRecording(KittiRecording):
    """One raw drive."""

    layout = Layout.RAW

    @cached_listings()
    def __init__(self, drive: Path, options: ReadOptions) -> None:
        super().__init__(drive.parent, drive.name, options)
        self.drive = drive
        self.rectified = not self.layout.traits.is_extract(drive.name)
        self.common_numbers = self.rectified
        self.image_topic = 'image_rect' if self.rectified else 'image_raw'
        folders = {
            Stream.OXTS: (names.RAW_OXTS, (names.TXT,)),
            Stream.SCAN: (names.RAW_SCANS, (names.BIN, names.TXT)),
        } | {
            Stream(f'image_{index}'): (folder, names.IMAGE_SUFFIXES)
            for index, folder in enumerate(names.RAW_IMAGES)
        }
        if self.common_numbers:
            data = {drive / name / names.RAW_DATA: suffixes for name, suffixes in folders.values()}
            self._name_frames(data, names.RAW_DIGITS)
        else:  # each stream has numbers of its own
            self.frames = names.FileNames(names.RAW_DIGITS)
        self._stampless = not any(
            (drive / folder / names.TIMESTAMPS).is_file() for folder, _ in folders.values()
        )
        self.clock = Clock.NOMINAL if self._stampless else Clock.UTC
        self._unread: set[Stream] = set()
        for stream, (folder, suffixes) in folders.items():
            self._add_folder(stream, drive / folder, suffixes)
        self._require_common_names()
        if Stream.OXTS in self.streams:
            packets = self.streams[Stream.OXTS]
            self._add(Stream.POSE, packets.numbers, packets.stamps_ns, None)
        self._sweeps = tuple(
            self._sweep_stamps(name) for name in (names.TIMESTAMPS_START, names.TIMESTAMPS_END)
        )
        self._add_turns(
            *(
                {number: stamp for number, stamp in enumerate(stamps) if stamp is not None}
                for stamps in self._sweeps
            )
        )
        self._add_tracklets()
        if self._stampless and self.streams:
            self._find_gaps(folders)
            self.notes.append(f'{drive}: no {names.TIMESTAMPS} in any stream; {self._nominal_time}')

    def _add_folder(self, stream: Stream, folder: Path, suffixes: tuple[str, ...]) -> None:
        if not folder.is_dir():
            self.notes.append(f'{folder}: absent, {stream.value} is left out')
            return
        try:
            listing = self._list(folder / names.RAW_DATA, suffixes)
        except OSError as error:
            self._lose_lines(stream, describe_error(error))
            self._unread.add(stream)
            return
        stamps_path = folder / names.TIMESTAMPS
        if self._stampless:
            self._add_nominal(stream, listing.numbers, listing)
        elif stamps_path.exists():
            stamps, reason = self._stamps(stamps_path)
            if stamps is None:
                self._unread.add(stream)
                self._lose_all(stream, listing, f'{reason}; so no stamps')
            else:
                self._add_stamped(stream, listing, stamps, stamps_path)
        else:
            self._lose_all(stream, listing, f'{stamps_path}: no such file, so no stamps')

    def _lose_all(self, stream: Stream, listing: Listing, reason: str) -> None:
        self._lose(stream, listing.numbers.tolist(), f'{reason} for frames {{}}')

    def _stamps(self, path: Path) -> tuple[Lines[int] | None, str]:
        """Read the stamps of a file; None and the reason if it is unreadable."""
        try:
            return parse_timestamps(self.common_files.read_text(path), path), ''
        except (BadFileError, OSError) as error:
            return None, describe_error(error).replace('{', '(').replace('}', ')')

    @cached_property
    def _calibration(self) -> Calibration:
        """The calibration of the drive's date."""
        day = day_of_drive(self.name)
        # A folder that is not of the drive's day may have drives of others.
        dated = day in {self.root.name, ''}
        folders = (self.root, self.drive) if dated else (self.drive, self.root)
        calibrated = (at for at in folders if any((at / n).is_file() for n in names.RAW_CALIB))
        folder = next(calibrated, folders[0])
        texts, missing = {}, {}
        for name in names.RAW_CALIB:
            try:
                texts[name] = STORE.read_text(folder / name)
            except FileNotFoundError:
                continue
            except BadFileError as error:
                missing[name] = str(error)
            except OSError as error:
                missing[name] = describe_error(error)
                self._lose_late(Stream.CALIBRATION, missing[name])
        source = describe_source(self.layout, folder, self.name)
        parsed = parse_raw_calibration(
            texts, folder, rectified=self.rectified, source=source, day=day
        )
        below = folder.relative_to(self.root)
        files = tuple(TextFile((below / file.name).as_posix(), file.text) for file in parsed.files)
        return replace(parsed, files=files, missing={**parsed.missing, **missing})

    def text_paths(self) -> list[Path]:
        """List the time stamps and data format of every stream, and the tracklets."""
        files = (names.TIMESTAMPS, names.TIMESTAMPS_START, names.TIMESTAMPS_END, names.DATAFORMAT)
        folders = (*names.RAW_IMAGES, names.RAW_SCANS, names.RAW_OXTS)
        paths = [self.drive / folder / file for folder in folders for file in files]
        return [path for path in (*paths, self.drive / names.RAW_TRACKLETS) if path.is_file()]

    def _scan(self, number: int) -> Scan:
        path = self._listings[Stream.SCAN].path(number)
        start, end = (stamps[number] if number < len(stamps) else None for stamps in self._sweeps)
        if path.suffix.lower() == names.TXT:
            scan = Scan(parse_scan_text(STORE.read(path), path), turn=self.turns.get(number))
        else:
            scan = super()._scan(number)
        return replace(scan, start_ns=start, end_ns=end)

    def _sweep_stamps(self, name: str) -> list[int | None]:
        """Read the starts or ends of all sweeps; missing ones are losses."""
        path = self.drive / names.RAW_SCANS / name
        if not path.is_file():
            return []
        stamps, reason = self._stamps(path)
        values = stamps.values if stamps is not None else []
        for error in stamps.errors.values() if stamps is not None else ():
            self._lose_lines(Stream.SCAN, f'{error}; its sweep goes without')
        scans = self.streams[Stream.SCAN].numbers.tolist() if Stream.SCAN in self.streams else []
        beyond = [number for number in scans if number >= len(values)]
        reason = f'{reason}; so none' if reason else f'{path}: no line'
        self._lose(Stream.SCAN, beyond, f'{reason} for the sweeps of frames {{}}')
        return values

    @cached_property
    def _cuboids(self) -> dict[int, list[Cuboid]]:
        path = self.drive / names.RAW_TRACKLETS
        if not path.is_file():
            return {}
        try:
            return cuboids_by_frame(parse_tracklets(self.common_files.read(path), path))
        except (BadFileError, OSError) as error:
            self._lose_lines(Stream.LABELS, describe_error(error))
            return {}

    def _add_tracklets(self) -> None:
        """Add the tracklets; their frames have the stamps of the scans, or else of the images."""
        if not self._cuboids:
            return
        # An unreadable folder of scans does not change the stamps of the labels.
        scanned = Stream.SCAN in self.streams or Stream.SCAN in self._unread
        scan_stamps = f'{names.RAW_SCANS}/{names.TIMESTAMPS}'
        path = self.drive / (scan_stamps if scanned else names.RAW_LABEL_STAMPS)
        stamps, _ = self._stamps(path) if path.is_file() else (None, '')
        numbers = sorted(self._cuboids)
        if self._stampless:
            self._add_nominal(Stream.LABELS, np.array(numbers, dtype=np.int64), None)
            return
        without = self._add_at(Stream.LABELS, numbers, [] if stamps is None else stamps.values)
        self._lose(Stream.LABELS, without, f'{path}: no stamp for the tracklets of frames {{}}')

    def _labels(self, number: int) -> FrameLabels:
        return labels_of_tracklets(self._cuboids[number], self.drive / names.RAW_TRACKLETS)

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        if stream is Stream.LABELS:
            return self.drive / names.RAW_TRACKLETS
        return super().path(stream, number)

    def _packet(self, number: int) -> OxtsPacket:
        path = self._listings[Stream.OXTS].path(number)
        text = STORE.read_text(path)
        return parse_packet(text, path, 1, self._verbatim(path, text))


# Reader of the object layout: {training,testing}/{image_2,velodyne,calib,label_2,...}/%06d.
#
# Frames come from different days: each has its own calibration, and no time stamp. Stamps are
# nominal, by file number; in real time they are those of the raw drives, and
# frames without one are left out. Scans are as measured, not compensated for motion.

_KNOWN = {*names.OBJECT_IMAGES, names.SCANS, names.CALIB}


class ObjectRecording(KittiRecording):
    """One split (training or testing) of an object detection set."""

    layout = Layout.OBJECT

    @cached_listings()
    def __init__(self, split: Path, options: ReadOptions) -> None:
        super().__init__(split.parent, split.name, options)
        self.split = split
        self._journal = self._find_journal()
        present = STORE.names(split)
        labels = names.WAYMO_LABELS if names.WAYMO_LABELS in present else names.OBJECT_LABELS
        folders = {
            Stream.CALIBRATION: (split / names.CALIB, (names.TXT,)),
            Stream.SCAN: (split / names.SCANS, (names.BIN,)),
            Stream.LABELS: (split / labels, (names.TXT,)),
        } | {
            Stream(folder): (split / folder, names.IMAGE_SUFFIXES) for folder in names.OBJECT_IMAGES
        }
        self._name_frames(dict(folders.values()), names.FRAME_DIGITS)
        for stream, (folder, suffixes) in folders.items():
            listing = self._without_unfinished(stream, self._list(folder, suffixes))
            self._add_nominal(stream, listing.numbers, listing)
            expected = stream.camera in (None, *self.layout.traits.cameras)
            if expected and not len(listing.numbers) and not listing.strays:
                self.notes.append(f'{folder}: absent or empty, {stream.value} is left out')
        if labels == names.WAYMO_LABELS:
            self.notes.append(
                f'{split / labels}: 2D boxes of cameras other than 2 are left out;'
                ' the boxes in space are read'
            )
        self._require_common_names()
        self._find_gaps(folders)
        self._times: RealTimes | None = None
        if options.real_time:
            self._times = self._set_real_time()
            self._add_turns(*map(self._times.turn_stamps, (STARTS, ENDS)))
        else:
            self._add_turns()
        others = [n for n in present if n not in {*_KNOWN, labels} and (split / n).is_dir()]
        if others:
            self.notes.append(f'{split}: {", ".join(others)} not converted')
        self._calibration_cached = lru_cache(maxsize=32)(self._calibration_of)

    def _set_real_time(self) -> RealTimes:
        """Replace the nominal stamps by true ones; samples without one are losses.

        Raises:
            UsageError: There is no mapping or no raw drive, or not one true stamp.
        """
        if self.name == names.SPLITS[1]:
            raise UsageError(f'{self.split}: the devkit has the drives of training frames only')
        mapping = find_mapping(self.root, self.options.mapping)
        raw = find_raw_root(self.root, self.options.raw)
        numbers = {n for index in self.streams.values() for n in index.numbers.tolist()}
        drives = DriveStamps(mapping, raw, numbers)
        times = drives.read([*self.streams])
        for stream, index in [*self.streams.items()]:
            stamps = times.stamps(stream)
            stamped = [n for n in index.numbers.tolist() if n in stamps]
            absent = sorted(set(index.numbers.tolist()).difference(stamped))
            for reason, frames in drives.reasons_of(stream, absent).items():
                escaped = reason.replace('{', '(').replace('}', ')')
                self._lose(stream, frames, f'{escaped}; no true stamp for frames {{}}')
            stamps_ns = np.array([stamps[n] for n in stamped], dtype=np.int64)
            self.streams[stream] = StreamIndex(np.array(stamped, dtype=np.int64), stamps_ns)
        self.streams = {stream: index for stream, index in self.streams.items() if len(index)}
        if not self.streams and self.losses:
            reason = self.losses[-1].message.partition(';')[0]
            raise UsageError(f'{self.split}: no frame has a true stamp: {reason}; see --raw-drives')
        self.clock = Clock.UTC
        remaining = {n for index in self.streams.values() for n in index.numbers.tolist()}
        self.origins = {n: origin for n, origin in times.origins.items() if n in remaining}
        return times

    def _find_journal(self) -> AppendJournal | None:
        """Find the journal of an incomplete append: its frames are left out."""
        work = self.root / append_journal.FOLDER
        try:
            journal = append_journal.find_journal(self.root)
        except (BadFileError, OSError) as error:
            self._lose_lines(Stream.RECORDING, describe_error(error))
            return None
        if work.is_dir():
            self.notes.append(
                f'{work}: an append is running or was interrupted; its frames are left out'
            )
        return journal

    def _without_unfinished(self, stream: Stream, listing: Listing) -> Listing:
        """Return the files of a stream without those of an incomplete append."""
        if self._journal is None or self._journal.split != self.name:
            return listing
        ours = np.isin(listing.numbers, np.array(self._journal.numbers, dtype=np.int64))
        self._lose(
            stream,
            listing.numbers[ours].tolist(),
            f'{self.root}: frames {{}} are of an append that is not complete;'
            f' the next to-kitti --append removes them',
        )
        return replace(listing, numbers=listing.numbers[~ours])

    def describe(self) -> Description:
        """Describe the set; lists of frames are as before an incomplete append."""
        description = super().describe()
        if self._times is not None:
            values = {**description.values, REAL_TIME: describe_times(self._times)}
            description = replace(description, values=values)
        if self._journal is None:
            return description
        before = self.root / append_journal.FOLDER / append_journal.BEFORE
        earlier = [
            TextFile(path, STORE.read_text(before / path))
            for path in map(str, self._journal.lists)
            if (before / path).is_file()  # else it has been restored already
        ]
        replaced = {file.name for file in earlier} | set(map(str, self._journal.files))
        files = [file for file in description.files if file.name not in replaced]
        return replace(description, files=sorted([*files, *earlier], key=lambda file: file.name))

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame."""
        return self._calibration_cached(number)

    def _calibration_of(self, number: int) -> Calibration:
        folder = self.split / names.CALIB
        if Stream.CALIBRATION not in self.streams:
            source = describe_source(self.layout, folder)
            return no_calibration(f'{folder}: no calibration; {source}')
        return self._load_calibration(self._listings[Stream.CALIBRATION].path(number))

    def text_paths(self) -> list[Path]:
        """List the lists of frames in ImageSets."""
        folder = self.root / names.IMAGE_SETS
        return [folder / name for name in STORE.names(folder) if name.endswith(names.TXT)]

    def _find_expected_size(self, stream: Stream) -> None:  # noqa: ARG002 - sizes vary by day
        return None

    def _labels(self, number: int) -> FrameLabels:
        path = self._listings[Stream.LABELS].path(number)
        text = STORE.read_text(path)
        return frame_labels(parse_labels(text, path).rows(), self._verbatim(path, text), path)


# Reader of the odometry layout: sequences/NN, times relative to its start, and poses/NN.txt.
#
# KITTI has compensated the scans for motion; the time of a point within its turn is not known.


class OdometryRecording(KittiRecording):
    """One sequence of an odometry set."""

    layout = Layout.ODOMETRY
    level_poses = False

    @cached_listings()
    def __init__(self, sequence: Path, options: ReadOptions) -> None:
        grouped = sequence.parent.name == names.SEQUENCES
        super().__init__(
            sequence.parent.parent if grouped else sequence.parent, sequence.name, options
        )
        self.sequence = sequence
        self._times_path = sequence / names.TIMES
        self.clock = Clock.NOMINAL if self._times is None else Clock.RELATIVE
        folders = {Stream.SCAN: (sequence / names.SCANS, (names.BIN,))} | {
            Stream(f'image_{index}'): (sequence / f'image_{index}', names.IMAGE_SUFFIXES)
            for index in range(4)
        }
        self._name_frames(dict(folders.values()), names.FRAME_DIGITS)
        for stream, (folder, suffixes) in folders.items():
            listing = self._list(folder, suffixes)
            if not folder.is_dir():
                self.notes.append(f'{folder}: absent, {stream.value} is left out')
            elif self._times is None:
                self._add_nominal(stream, listing.numbers, listing)
            else:
                self._add_stamped(stream, listing, self._times, self._times_path)
        self._require_common_names()
        self._add_poses()
        labels = sequence / names.POINT_LABELS
        if labels.is_dir() and not options.semantic:
            self.notes.append(f'{labels}: not converted; --semantic takes it')
        if Stream.POSE in self.streams and self.calibration(0).cam0_T_velo is None:
            self.notes.append(f'{self._poses_path}: carried to imu_link by a nominal cam0_T_velo')
        if self._times is None:
            self._find_gaps([*folders, Stream.POSE])
            self.notes.append(f'{self._times_path}: absent; {self._nominal_time}')
        if options.undo_deskew:
            self._add_turns()
        elif Stream.SCAN in self.streams and options.scan_stamp is ScanStamp.START:
            self.notes.append(
                'scans are compensated for motion by KITTI: they have no start of a turn,'
                ' and keep the stamps of their frames'
            )

    @cached_property
    def _times(self) -> Lines[int] | None:
        """The stamps by frame: the epoch of the options plus times.txt."""
        if not self._times_path.is_file():
            return None
        offsets = self._parsed(self._times_path, Stream.SCAN, parse_times)
        epoch = self.options.epoch_ns
        stamps = [None if offset is None else epoch + offset for offset in offsets.values]
        return Lines([s if s is None or s <= LAST_NS else None for s in stamps], offsets.errors)

    @cached_property
    def _poses_path(self) -> Path:
        candidates = (
            self.root / names.POSES / f'{self.sequence.name}{names.TXT}',
            self.sequence / f'{names.POSES}{names.TXT}',
        )
        return next((path for path in candidates if path.is_file()), candidates[0])

    @cached_property
    def _poses(self) -> Lines[Float64Array]:
        return self._parsed(self._poses_path, Stream.POSE, parse_poses)

    def _add_poses(self) -> None:
        if not len(self._poses):
            self.notes.append(f'{self._poses_path}: absent or empty, pose is left out')
            return
        for error in self._poses.errors.values():
            self._lose_lines(Stream.POSE, str(error))
        numbers = list(self._poses.sound())
        if self._times is None:
            self._add_nominal(Stream.POSE, np.array(numbers, dtype=np.int64), None)
            return
        short = list(range(len(self._poses), len(self._times)))
        self._lose(Stream.POSE, short, f'{self._poses_path}: no line for frames {{}}')
        beyond = self._add_at(Stream.POSE, numbers, self._times.values)
        self._lose(Stream.POSE, beyond, f'{self._times_path}: no time for the poses of frames {{}}')

    @cached_property
    def _calibration(self) -> Calibration:
        return self._load_calibration(self.sequence / names.ODOMETRY_CALIB)

    def text_paths(self) -> list[Path]:
        """List the files of times and poses."""
        return [path for path in (self._times_path, self._poses_path) if path.is_file()]

    def _scan(self, number: int) -> Scan:
        scan = super()._scan(number)
        if not self.options.semantic:
            return scan
        name = f'{self._listings[Stream.SCAN].stem(number)}{names.LABEL}'
        path = self.sequence / names.POINT_LABELS / name
        try:
            return replace(
                scan, labels=parse_point_labels(STORE.read(path), len(scan.points), path)
            )
        except FileNotFoundError:
            reason = f'{path}: no such file; its points have label 0'
        except BadFileError as error:
            reason = f'{error}; its points have label 0'
        return replace(scan, labels=np.zeros(len(scan.points), np.uint32), missing={name: reason})

    def _pose(self, number: int) -> Pose:
        matrix = self._poses.values[number]
        if matrix is None:
            raise self._poses.errors[number]
        return pose_from_odometry(matrix, self._calibration)

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        if stream is Stream.CALIBRATION:
            return self.sequence / names.ODOMETRY_CALIB
        return self._poses_path if stream is Stream.POSE else super().path(stream, number)


# Reader of the tracking layout: {training,testing}/{image_02,velodyne,...}/SSSS/%06d.
#
# Calibration, oxts and labels are one file a sequence; a packet's line, and a label's first column,
# is the frame number. There is no time: stamps are nominal, by frame number. Scans are as
# measured, not compensated for motion.


class TrackingRecording(KittiRecording):
    """One sequence of a tracking set."""

    layout = Layout.TRACKING

    @cached_listings()
    def __init__(self, split: Path, sequence: str, options: ReadOptions) -> None:
        super().__init__(split.parent, sequence, options)
        self.split = split
        file = f'{sequence}{names.TXT}'
        self._calib_path = split / names.CALIB / file
        self._oxts_path = split / names.OXTS / file
        self._labels_path = split / names.TRACKING_LABELS / file
        folders = {Stream.SCAN: (split / names.SCANS / sequence, (names.BIN,))} | {
            Stream(f'image_{index}'): (split / folder / sequence, names.IMAGE_SUFFIXES)
            for index, folder in enumerate(names.TRACKING_IMAGES)
        }
        self._name_frames(dict(folders.values()), names.FRAME_DIGITS)
        for stream, (folder, suffixes) in folders.items():
            listing = self._list(folder, suffixes)
            self._add_nominal(stream, listing.numbers, listing)
            expected = stream.camera in (None, *self.layout.traits.cameras)
            if expected and not len(listing.numbers) and not listing.strays:
                self.notes.append(f'{folder}: absent or empty, {stream.value} is left out')
        self._require_common_names()
        packets = np.arange(len(self._oxts_lines), dtype=np.int64)
        self._add_nominal(Stream.OXTS, packets, None)
        self._find_gaps([Stream.OXTS, Stream.SCAN, *IMAGE_STREAMS])
        self._add_turns()
        self._add_nominal(Stream.POSE, packets, None)
        self._add_nominal(Stream.LABELS, np.array(sorted(self._tracks.rows), dtype=np.int64), None)

    @cached_property
    def _oxts_lines(self) -> list[str]:
        if not self._oxts_path.is_file():
            self.notes.append(f'{self._oxts_path}: absent, oxts and pose are left out')
        return self._parsed(self._oxts_path, Stream.OXTS, packet_lines)

    @cached_property
    def _tracks(self) -> TrackFile:
        """The label file; a line without a frame number is a loss."""
        tracks = self._parsed(self._labels_path, Stream.LABELS, TrackFile)
        for error in tracks.errors:
            self._lose_lines(Stream.LABELS, str(error))
        return tracks

    @cached_property
    def _calibration(self) -> Calibration:
        return self._load_calibration(self._calib_path)

    def text_paths(self) -> list[Path]:
        """List the oxts and label files."""
        return [path for path in (self._oxts_path, self._labels_path) if path.is_file()]

    def _packet(self, number: int) -> OxtsPacket:
        line = self._oxts_lines[number]
        source = self._verbatim(self._oxts_path, line)
        return parse_packet(line, self._oxts_path, number + 1, source)

    def _labels(self, number: int) -> FrameLabels:
        return self._tracks.labels(number, self._labels_path.relative_to(self.root).as_posix())

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        whole = {
            Stream.OXTS: self._oxts_path,
            Stream.POSE: self._oxts_path,
            Stream.LABELS: self._labels_path,
            Stream.CALIBRATION: self._calib_path,
        }
        return whole.get(stream) or super().path(stream, number)
