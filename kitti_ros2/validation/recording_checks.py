# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording of any layout: its text files, its frames, and all together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..files.image_files import parse_image
from ..files.processes import can_fork, forked_map
from ..files.threads import ordered_map, worker_count
from ..kitti import names
from ..kitti.calib_file import parse_calibration
from ..kitti.find import LAYOUTS
from ..kitti.kitti360 import LEANING
from ..kitti.kitti_recording import no_calibration
from ..kitti.scan_file import LINE_POINT_BYTES, POINT_BYTES
from ..kitti.store import STORE
from ..kitti.text_file import parse_times, parse_timestamps
from ..model.boxes import DONT_CARE
from ..model.errors import BadFileError, KittiRos2Error, describe_error
from ..model.samples import Calibration, FrameLabels, LineScan, OxtsPacket, Scan
from ..model.streams import (
    IMAGE_STREAMS,
    KITTI_COLUMNS,
    LABEL_IMAGES,
    LABEL_STREAMS,
    UNNUMBERED,
    Clock,
    Stream,
)
from .file_rules import (
    CALIBRATION_RULES,
    FILE_RULES,
    LABEL_RULES,
    CalibrationFile,
    DataFile,
    LabelFile,
    LabelLine,
)
from .frame_rules import (
    FRAME_RULES,
    IMAGE_RULES,
    LABEL_FRAME_RULES,
    SCAN_FRAME_RULES,
    SCAN_RULES,
    TRACKLET_RULES,
    FrameFiles,
    ImageFile,
    LabelledScan,
    ScanFile,
    TrackletFrame,
    near_boxes,
)
from .recording_rules import (
    OXTS_RULES,
    POSE_RULES,
    RECORDING_RULES,
    STAMP_RULES,
    PacketTrack,
    PosesFile,
    RecordingFacts,
    StampsFile,
)
from .rule import SOURCE_RULES, CheckedSource, Unopened, find_breaches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..kitti.find import Candidate
    from ..kitti.kitti_recording import KittiRecording
    from ..kitti.text_file import NumberedPoses
    from ..model.boxes import Cuboid
    from ..model.streams import Layout
    from ..options.read import ReadOptions, ValidateOptions
    from .frame_rules import NearBox
    from .recording_rules import ImageShape
    from .rule import Breach, FindingTally


# Checks of the files of one frame: each is read once, checked alone and with the others.

T = TypeVar('T')
_PNG_BITS = 24
"""Offset of the bits a channel in a PNG."""
_MOST_STORED = 64
"""Number of stored calibrations, for frames with equal files."""


@dataclass
class FrameResult:
    """The result of checking the files of a frame.

    Attributes:
        number: File number.
        breaches: Breaches, each with the id of its rule.
        files, size_bytes: Number and size of its files.
        points: Number of points of the scan.
        images: Shapes of the images by stream.
        packet: OXTS packet.
        occlusions: Occlusions of its labels except DontCare.
    """

    number: int
    breaches: list[tuple[str, Breach]] = field(default_factory=list)
    files: int = 0
    size_bytes: int = 0
    points: int | None = None
    images: dict[Stream, ImageShape] = field(default_factory=dict)
    packet: OxtsPacket | None = None
    occlusions: Sequence[int] = ()

    def add(self, stream: Stream, path: Path, point_bytes: int = POINT_BYTES) -> DataFile | None:
        """Count a file and check its size; return None for a wrong size."""
        file = DataFile.from_path(stream, path, point_bytes)
        self.files += 1
        if file.is_worth_reading:
            self.size_bytes += file.size
            return file
        self.breaches += find_breaches(FILE_RULES, file)
        return None

    def try_read(self, stream: Stream, path: Path, read: Callable[[], T]) -> T | None:
        """Return the result of a reader; None if it fails, which is a breach."""
        try:
            return read()
        except (BadFileError, OSError) as error:
            self.breaches += find_breaches(FILE_RULES, DataFile(stream, path, 0, error))
        return None


class FrameChecks:
    """Checks frames of a recording; called by several threads.

    Args:
        recording: The recording.
        options: Options of the checks.
        calibration_path: The file of a calibration for all frames, or the folder of several.
        tracking: The labels of all frames, if in one file.
    """

    def __init__(
        self,
        recording: KittiRecording,
        options: ValidateOptions,
        calibration_path: Path,
        tracking: LabelFile | None,
    ) -> None:
        self._recording = recording
        self._options = options
        self._calibration_path = calibration_path
        self._tracking = tracking
        self._numbers = {
            stream: frozenset(listing.numbers.tolist())
            for stream, listing in recording.listings.items()
        }
        self._cameras = {
            stream: stream.camera for stream in self._numbers if stream.camera is not None
        }
        self._calibrations: dict[str, Calibration] = {}
        self._point_bytes = {
            Stream.SCAN: (recording.options.columns or KITTI_COLUMNS).point_bytes,
            Stream.SICK: LINE_POINT_BYTES,
        }

    @property
    def numbers(self) -> list[int]:
        """The numbers of all frames, ascending."""
        in_lines = [] if self._tracking is None else self._tracking.by_frame
        labelled = {number for number in in_lines if number is not None}
        framed = [numbers for s, numbers in self._numbers.items() if s not in UNNUMBERED]
        return sorted(labelled.union(*framed, self._tracklet_numbers))

    @property
    def others(self) -> list[int]:
        """The numbers of files that are those of no frame, ascending."""
        own = [numbers for s, numbers in self._numbers.items() if s in UNNUMBERED]
        return sorted(set().union(*own).difference(self.numbers))

    @cached_property
    def _tracklet_numbers(self) -> frozenset[int]:
        labels = self._recording.streams.get(Stream.LABELS)
        if labels is None or not self._recording.layout.traits.tracklets or self._options.quick:
            return frozenset()
        return frozenset(labels.numbers.tolist())

    def __call__(self, numbers: Sequence[int]) -> list[FrameResult]:
        """Check some frames, one after the other, and their labels together."""
        with np.errstate(all='ignore'):  # files may hold any numbers
            checked = [self._check_others(number) for number in numbers]
            frames = {frame.number: frame for _, frame in checked if frame is not None}
            near = near_boxes([*frames.values()])
            for result, frame in checked:
                others, result.breaches = result.breaches, []
                self._check_scan(result, frame, near.get(result.number, []))
                result.breaches += others
            results = [result for result, _ in checked]
            results[-1].breaches += find_breaches(LABEL_FRAME_RULES, [*frames.values()])
        return results

    def _check_others(self, number: int) -> tuple[FrameResult, FrameFiles | None]:
        """Check the files of a frame except its scan."""
        result = FrameResult(number)
        for stream in self._numbers.keys() & {*IMAGE_STREAMS, *LABEL_STREAMS}:
            self._check_image(stream, number, result)
        self._check_packet(number, result)
        self._check_line_scan(number, result)
        calibration, calibration_path = self._check_calibration(number, result)
        lines, cuboids, label_path = self._check_labels(number, result)
        result.occlusions = [
            line.box.occluded for line in lines if line.box.class_name != DONT_CARE
        ]
        if calibration is None or not self._recording.common_numbers:
            return result, None
        shapes = {s: shape for s, shape in result.images.items() if s in self._cameras}
        sizes = {self._cameras[stream]: shape[:2] for stream, shape in shapes.items()}
        frame = FrameFiles(number, calibration, sizes, calibration_path, label_path, lines, cuboids)
        result.breaches += find_breaches(FRAME_RULES, frame)
        return result, frame

    def _path(self, stream: Stream, number: int, result: FrameResult) -> Path | None:
        """Return the file of a stream; None if missing or not to be read."""
        if number not in self._numbers.get(stream, ()):
            return None
        path = self._recording.path(stream, number)
        file = result.add(stream, path, self._point_bytes.get(stream, POINT_BYTES))
        return None if file is None or self._options.quick else path

    def _check_scan(
        self, result: FrameResult, frame: FrameFiles | None, boxes: Sequence[NearBox]
    ) -> None:
        number = result.number
        if self._recording.scan_error is not None:
            return
        path = self._path(Stream.SCAN, number, result)
        if path is None:
            return
        scan = result.try_read(Stream.SCAN, path, lambda: self._recording.read(Stream.SCAN, number))
        if not isinstance(scan, Scan):
            return
        result.points = len(scan.points)
        on_grid = self._recording.layout.traits.scans_on_grid
        file = ScanFile(path, scan.points, next(iter(scan.missing.values()), ''), on_grid)
        result.breaches += find_breaches(SCAN_RULES, file)
        if frame is not None:
            labelled = LabelledScan(frame, scan.points, boxes)
            result.breaches += find_breaches(SCAN_FRAME_RULES, labelled)

    def _check_line_scan(self, number: int, result: FrameResult) -> None:
        path = self._path(Stream.SICK, number, result)
        if path is None:
            return
        scan = result.try_read(Stream.SICK, path, lambda: self._recording.read(Stream.SICK, number))
        if isinstance(scan, LineScan):
            file = ScanFile(path, np.pad(scan.points, ((0, 0), (0, 1))))
            result.breaches += find_breaches(SCAN_RULES, file)

    def _check_image(self, stream: Stream, number: int, result: FrameResult) -> None:
        path = self._path(stream, number, result)
        if path is None:
            return
        image = result.try_read(stream, path, lambda: parse_image(STORE.read(path), path))
        if image is None:
            return
        result.images[stream] = image.width, image.height, image.channels
        form = LABEL_IMAGES[stream.label_image[0]] if stream.label_image else None
        if form not in (None, (image.channels, image.data[_PNG_BITS])):
            has, expected = (
                f'{count} channels of {bits} bits'
                for count, bits in ((image.channels, image.data[_PNG_BITS]), form)
            )
            error = BadFileError(path, has, expected)
            result.breaches += find_breaches(FILE_RULES, DataFile(stream, path, 0, error))
        if self._options.decode:
            result.breaches += find_breaches(IMAGE_RULES, ImageFile(path, image))

    def _check_packet(self, number: int, result: FrameResult) -> None:
        path = self._path(Stream.OXTS, number, result)
        if path is not None:
            packet = result.try_read(
                Stream.OXTS, path, lambda: self._recording.read(Stream.OXTS, number)
            )
            result.packet = packet if isinstance(packet, OxtsPacket) else None

    def _check_calibration(
        self, number: int, result: FrameResult
    ) -> tuple[Calibration | None, Path]:
        if self._options.quick:
            self._path(Stream.CALIBRATION, number, result)
            return None, self._calibration_path
        if not self._recording.layout.traits.calibration_per_frame:
            return self._recording.calibration(number), self._calibration_path
        path = self._path(Stream.CALIBRATION, number, result)
        if path is None:
            return None, self._calibration_path
        text = result.try_read(Stream.CALIBRATION, path, lambda: STORE.read_text(path))
        # The frames of a day have equal files.
        calibration = self._calibrations.get(text or '')
        if calibration is not None or text is None:
            return calibration, path
        cameras = [
            camera for stream, camera in self._cameras.items() if number in self._numbers[stream]
        ]
        try:
            calibration = parse_calibration(text, path, path.name)
        except BadFileError as error:
            calibration = no_calibration(str(error))
        file = CalibrationFile(calibration, path, cameras)
        breaches = list(find_breaches(CALIBRATION_RULES, file))
        result.breaches += breaches
        if not breaches and len(self._calibrations) < _MOST_STORED:
            self._calibrations[text] = calibration
        return calibration, path

    def _check_labels(
        self, number: int, result: FrameResult
    ) -> tuple[list[LabelLine], list[Cuboid], Path]:
        if self._tracking is not None:
            return self._tracking.by_frame.get(number, []), [], self._tracking.path
        if number in self._tracklet_numbers:
            return self._check_tracklets(number, result)
        path = self._path(Stream.LABELS, number, result)
        if path is None:
            return [], [], self._calibration_path
        file = result.try_read(
            Stream.LABELS, path, lambda: LabelFile.parse(STORE.read_text(path), path)
        ) or LabelFile.parse('', path)
        result.breaches += find_breaches(LABEL_RULES, file)
        return list(file.lines), [], path

    def _check_tracklets(
        self, number: int, result: FrameResult
    ) -> tuple[list[LabelLine], list[Cuboid], Path]:
        path = self._recording.path(Stream.LABELS, number)
        labels = self._recording.read(Stream.LABELS, number)
        if not isinstance(labels, FrameLabels):
            return [], [], path
        result.breaches += find_breaches(TRACKLET_RULES, TrackletFrame(path, labels))
        return [], list(labels.cuboids), path


# Checks of the text files of a recording: stamps, poses, packets, labels, calibration.


class SequenceChecks:
    """Checks the text files of a recording.

    Args:
        facts: Facts of the recording; errors of its files are added as reported.

    Attributes:
        breaches: Breaches, each with the id of its rule.
        files, size_bytes: Number and size of the files.
        labels: The labels of all frames, if in one file.
        packets: The packets by number, if in one file.
    """

    def __init__(self, facts: RecordingFacts) -> None:
        self._facts = facts
        self._recording: KittiRecording = facts.recording
        self.breaches: list[tuple[str, Breach]] = []
        self.files = 0
        self.size_bytes = 0
        self.labels: LabelFile | None = None
        self.packets: dict[int, OxtsPacket] = {}

    @property
    def calibration_path(self) -> Path:
        """The file of the calibration, or the folder of several."""
        return self._recording.path(Stream.CALIBRATION, 0)

    def run(self, *, quick: bool) -> None:
        """Check the files, or with quick their sizes only."""
        if not quick:  # first: the checks below take the texts
            self._facts.contradictions += self._recording.contradictions()
        texts = {}
        of_set = self._recording.layout.traits.frame_set  # lists of frames: see set_rules
        for path in () if of_set else self._recording.text_paths():
            text = self._read(path, quick=quick)
            if text is not None:
                texts[path] = text
        if quick:
            return
        self._check_stamps(texts)
        for path, text in texts.items():
            if _is_poses(path):
                parse = LAYOUTS[self._recording.layout].parse_poses
                poses = self._parsed(path, text, parse)
                self._report(poses.lines.errors)
                self._facts.reported.add(f'{path}: {LEANING}')
                self._check_poses(path, poses)
            elif path.parent.name == names.TRACKING_LABELS:
                self.labels = self._parsed(path, text, partial(LabelFile.parse, tracking=True))
                self._report({error.line: error for error in self.labels.errors})
                self.breaches += find_breaches(LABEL_RULES, self.labels)
        if self._recording.layout.traits.line_streams >= {Stream.OXTS}:
            self._read_packets()
        self._check_calibration()

    def _check_poses(self, path: Path, poses: NumberedPoses) -> None:
        index = self._recording.streams.get(Stream.POSE)
        stamps = {}
        if index is not None and self._recording.clock is not Clock.NOMINAL:
            stamps = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
        file = PosesFile(path, *poses, self._recording.level_poses, stamps)
        self.breaches += find_breaches(POSE_RULES, file)

    def check_packets(self) -> None:
        """Check the packets, read here or with their frames, against each other."""
        index = self._recording.streams.get(Stream.OXTS)
        if index is None:
            return
        stamps = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
        numbers = sorted(number for number in self.packets if number in stamps)
        in_lines = Stream.OXTS in self._recording.layout.traits.line_streams

        def line_of(number: int) -> tuple[Path, int]:
            line = number + 1 if in_lines else 1
            return self._recording.path(Stream.OXTS, number), line

        first = self._recording.path(Stream.OXTS, 0)
        track = PacketTrack(
            first if in_lines else first.parent,
            line_of,
            numbers,
            [stamps[number] for number in numbers],
            [self.packets[number] for number in numbers],
        )
        self.breaches += find_breaches(OXTS_RULES, track)

    def _read(self, path: Path, *, quick: bool) -> str | None:
        """Read a text file; None if unreadable, which is a breach."""
        file = DataFile.from_path(Stream.RECORDING, path)
        self.files += 1
        self.size_bytes += file.size
        text = None
        if file.is_worth_reading and not quick and path.suffix == names.TXT:
            try:
                text = self._recording.common_files.take_text(path)
            except (BadFileError, OSError) as error:
                file = replace(file, error=error)
                self._facts.reported.add(describe_error(error))
        self.breaches += find_breaches(FILE_RULES, file)
        return text

    def _parsed(self, path: Path, text: str, parse: Callable[[str, Path], T]) -> T:
        """Parse a text; an invalid one is a breach, and empty."""
        try:
            return parse(text, path)
        except BadFileError as error:
            self._facts.reported.add(str(error))
            file = replace(DataFile.from_path(Stream.RECORDING, path), error=error)
            self.breaches += find_breaches(FILE_RULES, file)
            return parse('', path)

    def _report(
        self, errors: Mapping[int, BadFileError] | Mapping[int | None, BadFileError]
    ) -> None:
        self._facts.reported.update(map(str, errors.values()))

    def _check_stamps(self, texts: Mapping[Path, str]) -> None:
        files = {}
        for path, text in texts.items():
            if path.name in {names.TIMESTAMPS, names.TIMESTAMPS_START, names.TIMESTAMPS_END}:
                files[path] = StampsFile(path, self._parsed(path, text, parse_timestamps))
            elif path.name == names.TIMES:
                files[path] = StampsFile(path, self._parsed(path, text, parse_times), relative=True)
        scans = next((files[path].lines.values for path in files if _is_of_scans(path)), None)
        listings = self._recording.listings
        own = {listings[stream].folder.parent for stream in UNNUMBERED & listings.keys()}
        for path, file in files.items():
            common = self._recording.common_numbers and path.parent not in own
            paired = scans if common else None
            self._report(file.lines.errors)
            ends = files.get(path.with_name(names.TIMESTAMPS_END))
            if path.name == names.TIMESTAMPS_START and ends is not None:
                checked = replace(file, scans=paired, ends=ends.lines.values)
            elif path.name == names.TIMESTAMPS:
                checked = replace(file, scans=paired)
            else:
                checked = file
            self.breaches += find_breaches(STAMP_RULES, checked)

    def _read_packets(self) -> None:
        index = self._recording.streams.get(Stream.OXTS)
        for number in () if index is None else index.numbers.tolist():
            path = self._recording.path(Stream.OXTS, number)
            try:
                packet = self._recording.read(Stream.OXTS, number)
            except (BadFileError, OSError) as error:
                self.breaches += find_breaches(FILE_RULES, DataFile(Stream.OXTS, path, 0, error))
                continue
            if isinstance(packet, OxtsPacket):
                self.packets[number] = packet

    def _check_calibration(self) -> None:
        if self._recording.layout.traits.calibration_per_frame:
            return
        cameras = [
            stream.camera for stream in self._recording.listings if stream.camera is not None
        ]
        calibration = self._recording.calibration(0)
        file = CalibrationFile(calibration, self.calibration_path, cameras)
        self.breaches += find_breaches(CALIBRATION_RULES, file)


def _is_poses(path: Path) -> bool:
    return path.parent.name == names.POSES or path.name == f'{names.POSES}{names.TXT}'


def _is_of_scans(path: Path) -> bool:
    return path.name == names.TIMESTAMPS and path.parent.name == names.RAW_SCANS


_BATCH = 50
"""Number of frames checked at a time."""
_LEAST_FORKED = 4
"""Least number of batches for processes, which take 10 ms to start."""


def check_recording(
    candidate: Candidate,
    layout: Layout,
    read: ReadOptions,
    root: Path,
    options: ValidateOptions,
    tally: FindingTally,
    progress: Callable[[int, int], None],
) -> tuple[CheckedSource, list[int], names.FileNames]:
    """Check a recording.

    Args:
        candidate: The recording.
        layout: Layout.
        read: The columns of scans.
        root: Data set, named if it cannot be opened.
        options: Options of the checks.
        tally: Collects the breaches.
        progress: Called with the frames done and the number of all.

    Returns:
        The checked source, the numbers of its frames, and their file names.
    """
    folder = candidate.folder or root
    # Labels of points are checked if present.
    semantic = layout.traits.point_labels and (folder / names.POINT_LABELS).is_dir()
    try:
        recording = candidate.open(replace(read, layout=layout, semantic=semantic))
    except (KittiRos2Error, OSError) as error:
        tally.add(find_breaches(SOURCE_RULES, Unopened(folder, error)))
        unopened = CheckedSource(folder, layout.value, candidate.name, 0, 0, 0)
        return unopened, [], names.SIX_DIGITS
    return *_Check(recording, folder, options, tally).run(progress), recording.file_names


class _Check:
    """The check of an open recording."""

    def __init__(
        self, recording: KittiRecording, folder: Path, options: ValidateOptions, tally: FindingTally
    ) -> None:
        self._recording = recording
        self._folder = folder
        self._options = options
        self._tally = tally
        self._facts = RecordingFacts(recording)
        self._files = 0
        self._size_bytes = 0

    def run(self, progress: Callable[[int, int], None]) -> tuple[CheckedSource, list[int]]:
        """Check everything once."""
        sequence = SequenceChecks(self._facts)
        with np.errstate(all='ignore'):  # files may hold any numbers
            sequence.run(quick=self._options.quick)
        path = sequence.calibration_path
        frames = FrameChecks(self._recording, self._options, path, sequence.labels)
        numbers, others = frames.numbers, frames.others
        batches = [
            part[at : at + _BATCH]
            for part in (numbers, others)
            for at in range(0, len(part), _BATCH)
        ]
        done = 0
        for results in _map(frames, batches):
            for result in results:
                self._enter(result)
                if result.packet is not None:
                    sequence.packets[result.number] = result.packet
            done += len(results)
            progress(done, len(numbers) + len(others))
        with np.errstate(all='ignore'):
            if not self._options.quick:
                sequence.check_packets()
        self._tally.add(sequence.breaches)
        self._tally.add(find_breaches(RECORDING_RULES, self._facts))
        source = CheckedSource(
            self._folder,
            self._recording.layout.value,
            self._recording.name,
            len(numbers),
            self._files + sequence.files,
            self._size_bytes + sequence.size_bytes,
        )
        return source, numbers

    def _enter(self, result: FrameResult) -> None:
        self._tally.add(result.breaches)
        self._files += result.files
        self._size_bytes += result.size_bytes
        if result.points is not None:
            self._facts.enter_scan(result.number, result.points)
        self._facts.occlusions.update(result.occlusions)
        for stream, shape in result.images.items():
            self._facts.enter_image(stream, result.number, shape)


def _map(check: FrameChecks, batches: Sequence[Sequence[int]]) -> Iterator[list[FrameResult]]:
    """Check batches of frames in processes: threads gain less, as half of the time is Python's."""
    workers = worker_count()
    if workers > 1 and len(batches) >= _LEAST_FORKED and can_fork():
        return forked_map(check, batches, workers)
    return ordered_map(check, batches, workers)
