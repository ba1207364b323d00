# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the text files of a whole recording: stamps, poses, packets, labels, calibration."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from ..kitti import names
from ..kitti.poses_file import parse_poses
from ..kitti.stamps_file import parse_times, parse_timestamps
from ..model.errors import BadFileError, describe_error
from ..model.samples import OxtsPacket
from ..model.streams import Stream
from .calib_rules import CALIBRATION_RULES, CalibrationFile
from .file_rules import FILE_RULES, DataFile
from .label_rules import LABEL_RULES, LabelFile
from .motion_rules import OXTS_RULES, POSE_RULES, PacketTrack, PosesFile
from .rule import find_breaches
from .stamp_rules import STAMP_RULES, StampsFile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from .recording_rules import RecordingFacts
    from .rule import Breach

T = TypeVar('T')


class SequenceChecks:
    """Checks of a recording's own text files.

    Args:
        facts: What is said by its rules is entered there as reported.

    Attributes:
        found: Breaches, each with the id of its rule.
        files, size_bytes: Of the files.
        labels: The labels of all frames, where they are in one file.
        packets: The packets by number, where they are in one file.
    """

    def __init__(self, facts: RecordingFacts) -> None:
        self._facts = facts
        self._recording: KittiRecording = facts.recording
        self.found: list[tuple[str, Breach]] = []
        self.files = 0
        self.size_bytes = 0
        self.labels: LabelFile | None = None
        self.packets: dict[int, OxtsPacket] = {}

    @property
    def calibration_path(self) -> Path:
        """The file of the calibration, or the folder of several."""
        return self._recording.path(Stream.CALIBRATION, 0)

    def run(self, *, quick: bool) -> None:
        """Check the files; with quick their sizes only."""
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
                poses = self._parsed(path, text, parse_poses)
                self._report(poses.errors)
                self.found += find_breaches(POSE_RULES, PosesFile(path, poses))
            elif path.parent.name == names.TRACKING_LABELS:
                self.labels = self._parsed(path, text, partial(LabelFile.parse, tracking=True))
                self._report({each.line: each for each in self.labels.errors})
                self.found += find_breaches(LABEL_RULES, self.labels)
        if self._recording.layout.traits.line_streams >= {Stream.OXTS}:
            self._read_packets()
        self._check_calibration()

    def check_packets(self) -> None:
        """Check the packets, which may have been read with their frames, against each other."""
        index = self._recording.streams.get(Stream.OXTS)
        if index is None:
            return
        stamps = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
        known = sorted(number for number in self.packets if number in stamps)
        in_lines = Stream.OXTS in self._recording.layout.traits.line_streams

        def place(number: int) -> tuple[Path, int]:
            line = number + 1 if in_lines else 1
            return self._recording.path(Stream.OXTS, number), line

        first = self._recording.path(Stream.OXTS, 0)
        track = PacketTrack(
            first if in_lines else first.parent,
            place,
            known,
            [stamps[number] for number in known],
            [self.packets[number] for number in known],
        )
        self.found += find_breaches(OXTS_RULES, track)

    def _read(self, path: Path, *, quick: bool) -> str | None:
        """Read a text file; None if that is impossible, which is a breach."""
        file = DataFile.look(Stream.RECORDING, path)
        self.files += 1
        self.size_bytes += file.size
        text = None
        if file.is_worth_reading and not quick and path.suffix == names.TXT:
            try:
                text = self._recording.common_files.take_text(path)
            except (BadFileError, OSError) as error:
                file = replace(file, error=error)
                self._facts.reported.add(describe_error(error))
        self.found += find_breaches(FILE_RULES, file)
        return text

    def _parsed(self, path: Path, text: str, parse: Callable[[str, Path], T]) -> T:
        """Parse a text; if that is impossible it is a breach, and empty."""
        try:
            return parse(text, path)
        except BadFileError as error:
            self._facts.reported.add(str(error))
            file = replace(DataFile.look(Stream.RECORDING, path), error=error)
            self.found += find_breaches(FILE_RULES, file)
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
        paired = scans if self._recording.common_numbers else None
        for path, file in files.items():
            self._report(file.lines.errors)
            ends = files.get(path.with_name(names.TIMESTAMPS_END))
            if path.name == names.TIMESTAMPS_START and ends is not None:
                checked = replace(file, scans=paired, ends=ends.lines.values)
            elif path.name == names.TIMESTAMPS:
                checked = replace(file, scans=paired)
            else:
                checked = file
            self.found += find_breaches(STAMP_RULES, checked)

    def _read_packets(self) -> None:
        index = self._recording.streams.get(Stream.OXTS)
        for number in () if index is None else index.numbers.tolist():
            path = self._recording.path(Stream.OXTS, number)
            try:
                packet = self._recording.read(Stream.OXTS, number)
            except (BadFileError, OSError) as error:
                self.found += find_breaches(FILE_RULES, DataFile(Stream.OXTS, path, 0, error))
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
        self.found += find_breaches(CALIBRATION_RULES, file)


def _is_poses(path: Path) -> bool:
    return path.parent.name == names.POSES or path.name == f'{names.POSES}{names.TXT}'


def _is_of_scans(path: Path) -> bool:
    return path.name == names.TIMESTAMPS and path.parent.name == names.RAW_SCANS
