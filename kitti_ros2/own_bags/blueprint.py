# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The layout of one recording in a bag written by to-bag: its files, by stamps of messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..kitti import names
from ..kitti.layout_files import LAYOUTS
from ..kitti.real_time import ENDS, STARTS
from ..kitti.stamps_file import parse_times, parse_timestamps
from ..kitti.stereo_pairs import LEFT_STREAM_OF, pair_stamps
from ..kitti.turns import find_turns, scan_stamps
from ..messages.topics import own_topics
from ..model.losses import Loss
from ..model.motion import Deskew
from ..model.streams import Clock, Stream
from ..options.read import ScanStamp
from .description import DescribedRecording

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.samples import Turn


@dataclass(frozen=True, kw_only=True)
class Blueprint(DescribedRecording):
    """The layout of one recording.

    Attributes:
        texts: Whole text files by path relative to the recording's root, calibration apart.
        calibrations: Calibration files, in the order of their frames.
        topics: Topics of the bag.
        missing: Text files missing in the bag.
        selected: File numbers of the requested part, by stream; None is all.
        losses: Those files, and texts that are unreadable or invalid.
        damage: Damage that the bag's reader found so far, and the number of messages lost by each;
            None: unknown.
    """

    texts: Mapping[PurePosixPath, str]
    calibrations: Mapping[PurePosixPath, str]
    topics: frozenset[str] = frozenset()
    missing: frozenset[PurePosixPath] = frozenset()
    selected: Mapping[Stream, frozenset[int]] | None = None
    losses: tuple[Loss, ...] = ()
    damage: Mapping[str, int | None] = field(default_factory=dict)

    @property
    def root(self) -> PurePosixPath:
        """The recording's root in a data set: raw drives are in the folder of their date.

        Source: readme.txt of the raw devkit; pykitti expects this.
        """
        drive = self.layout.traits.dated and names.RAW_DRIVE.fullmatch(self.name)
        return PurePosixPath(self.name[: len('2011_09_26')] if drive else '')

    @property
    def files(self) -> int:
        """Number of requested numbered files."""
        return sum(len(self.requested(stream)) for stream in self.folders)

    def requested(self, stream: Stream) -> frozenset[int]:
        """Return the numbers of a stream's files to restore, of those written to the bag."""
        carried = frozenset(self.folders[stream].carried)
        return carried if self.selected is None else carried & self.selected.get(stream, carried)

    def numbers_by_stamp(self, stream: Stream) -> dict[int, list[int]] | None:
        """Map stamps to the file numbers of a stream; None if the file of the stamps is missing."""
        stamps = self._stamps(stream)
        if stamps is None:
            return None
        found: dict[int, list[int]] = {}
        for number in self.folders[stream].carried:
            if number in stamps:
                found.setdefault(stamps[number], []).append(number)
        return found

    def stamps_path(self, stream: Stream) -> PurePosixPath:
        """Return the text file with a stream's stamps, in layouts that have one."""
        return self.folders[stream].path.parent / LAYOUTS[self.layout].stamps

    def _stamps(self, stream: Stream) -> Mapping[int, int] | None:
        """Map file numbers to stamps of messages; numbers without a valid stamp are skipped."""
        stamps = self.file_stamps(stream)
        left = self.stamped_as(stream)
        if left is not stream:
            return self._paired_stamps(left, stream)
        if (
            stream is not Stream.SCAN
            or stamps is None
            or self.scan_stamp is ScanStamp.FORWARD
            or self._compensated
        ):
            return stamps
        turns = self.turns()
        return None if turns is None else scan_stamps(stamps, turns, self.scan_stamp)

    def stamped_as(self, stream: Stream) -> Stream:
        """Return the stream whose stamps a stream's messages have: itself, or its left images."""
        left = LEFT_STREAM_OF.get(stream, stream)
        return left if self.stereo and left in self.folders else stream

    def _paired_stamps(self, *pair: Stream) -> dict[int, int] | None:
        """Map the numbers of right images to stamps of messages; see kitti/stereo_pairs.py."""
        found = []
        for stream in pair:
            stamps = self.file_stamps(stream)
            if stamps is None:
                return None
            numbers = self.folders[stream].numbers
            found.append({number: stamps[number] for number in numbers if number in stamps})
        left_ns, right_ns = found
        return pair_stamps(left_ns, right_ns, common=not self.layout.traits.is_extract(self.name))

    @property
    def _compensated(self) -> bool:
        """Whether the scans in the bag are compensated for motion."""
        of_layout = self.layout.traits.compensated_scans
        return self.deskew is Deskew.ON or (of_layout and self.deskew is None)

    def turns(self) -> Mapping[int, Turn] | None:
        """Return the turn of each scan, by file number; None if a file of stamps is missing.

        Scans compensated for motion have none.
        """
        if self._compensated:
            return {}
        stamps = self.file_stamps(Stream.SCAN)
        starts = self._turn_stamps(names.TIMESTAMPS_START, STARTS)
        ends = self._turn_stamps(names.TIMESTAMPS_END, ENDS)
        if stamps is None or starts is None or ends is None:
            return None
        return find_turns(stamps, starts, ends, self.period_ns)

    def _turn_stamps(self, name: str, column: str) -> Mapping[int, int] | None:
        """Parse the starts or ends of the scanner's turns; None if they are missing."""
        if self.times is not None:
            return self.times.turn_stamps(column)
        path = self.folders[Stream.SCAN].path.parent / name
        if path in self.missing:
            return None
        return parse_timestamps(self.texts.get(path, ''), str(path)).sound()

    def file_stamps(self, stream: Stream) -> Mapping[int, int] | None:
        """Map file numbers to stamps of files; None if their text file is missing."""
        if self.times is not None:
            return self.times.stamps(stream)
        path = self.stamps_path(stream)
        if path in self.missing:
            return None
        clock = self.layout.traits.clock
        if clock is Clock.UTC and path in self.texts:
            return parse_timestamps(self.texts[path], str(path)).sound()
        if clock is Clock.RELATIVE and path in self.texts:
            offsets = parse_times(self.texts[path], str(path)).sound()
            return {line: self.epoch_ns + offset for line, offset in offsets.items()}
        numbers = self.folders[stream].carried
        return {number: self.epoch_ns + number * self.period_ns for number in numbers}

    def shortfall(self, counts: Mapping[str, int]) -> tuple[Loss, ...]:
        """Return the streams of which a bag contains fewer messages than its description lists.

        Args:
            counts: Messages by topic.
        """
        losses = []
        for stream, folder in self.folders.items():
            rows = (row for row in own_topics().values() if row.restores and row.stream is stream)
            found = max((counts.get(row.topic, 0) for row in rows), default=0)
            absent = len(folder.carried) - found
            if absent > 0:
                text = f'the bag holds {found} of {len(folder.carried)} {stream.value} messages'
                losses.append(Loss(stream.value, absent, text))
        return tuple(losses)
