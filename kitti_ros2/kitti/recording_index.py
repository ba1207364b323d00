# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The index of a recording: file numbers and stamps of each stream, and what is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError, Loss, some_of
from ..model.recording import StreamIndex
from ..model.samples import Turn
from ..model.streams import LAST_NS, NS_PER_S, Stream
from ..options.read import ScanStamp
from .names import FRAME_DIGITS, IMAGE_SUFFIXES, OTHER_FORMATS, SIX_DIGITS, FileNames, split_name
from .store import STORE, CommonFiles

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from ..model.recording import Deskew, FrameOrigin
    from ..model.samples import Int64Array, Scan
    from ..options.read import ReadOptions
    from .label_file import ResultFiles
    from .store import Listing
    from .text_file import Lines, PacketFiles


# Start and length of each turn of the scanner.
#
# KITTI's HDL-64E turns clockwise seen from above. A turn begins and ends straight behind (azimuth
# pi and -pi), and the scan's own stamp is the time at which the scanner faces forward (it
# triggers the cameras then): A. Geiger et al., "Vision meets Robotics: The KITTI Dataset", IJRR
# 2013, section 2. In the raw files that time is the middle of timestamps_start.txt and
# timestamps_end.txt, to the nanosecond (drives 0001 and 0005), so the start of a turn is the line
# of timestamps_start.txt. Turns do not always follow each other without a gap (0001: 96 of 107 do).
#
# Object, tracking and raw scans are as measured: each laser's points lie on one line z = T rho + D.
# Odometry scans do so only after x is moved by 0.8 m azimuth / 2 pi, the car having moved 0.86 m:
# KITTI has compensated them for motion, and their points are all of one time.

_LONGEST_TURN_NS = 1_000_000_000  # an HDL-64E's slowest takes 0.2 s


def find_turns(
    forward_ns: Mapping[int, int],
    starts_ns: Mapping[int, int],
    ends_ns: Mapping[int, int],
    period_ns: int,
) -> dict[int, Turn]:
    """Return the turn of each scan, by file number.

    Args:
        forward_ns: When the scanner faces forward, which is the scans' own stamps.
        starts_ns: When the turns begin, where it is known; start and end give the length.
        ends_ns: When they end.
        period_ns: The length of a turn whose start or end is missing or implausible.
    """
    turns = {}
    for number, forward in forward_ns.items():
        measured_ns = turn_length(starts_ns.get(number), ends_ns.get(number))
        length = period_ns if measured_ns is None else measured_ns
        turns[number] = Turn(forward - length // 2, length, nominal=measured_ns is None)
    return turns


def turn_length(start_ns: int | None, end_ns: int | None) -> int | None:
    """Return the length of a turn; None if start or end is missing, or the length implausible."""
    if start_ns is None or end_ns is None or not 0 < end_ns - start_ns <= _LONGEST_TURN_NS:
        return None
    return end_ns - start_ns


def scan_stamps(
    forward_ns: Mapping[int, int], turns: Mapping[int, Turn], scan_stamp: ScanStamp
) -> dict[int, int]:
    """Return the stamp of each scan, by file number.

    A turn that begins before 1970, which no stamp can hold, keeps the time of facing forward.
    """
    if scan_stamp is ScanStamp.FORWARD:
        return dict(forward_ns)
    return {
        number: turns[number].start_ns if turns[number].start_ns > 0 else forward
        for number, forward in forward_ns.items()
    }


class RecordingIndex:
    """The streams of a recording and its losses, filled by the constructors of the readers."""

    name: str

    def __init__(self, root: Path, options: ReadOptions) -> None:
        self.root = root
        self.options = options
        self.streams: dict[Stream, StreamIndex] = {}
        self.losses: list[Loss] = []
        self.notes: list[str] = []
        self.turns: dict[int, Turn] = {}
        self.origins: Mapping[int, FrameOrigin] = {}
        self.deskew: Deskew | None = None
        self.stereo = False
        self.adjust_scan: Callable[[int, Scan], Scan] = lambda _, scan: scan
        self.results: ResultFiles | None = None
        self.extract: PacketFiles | None = None
        self._late_losses: dict[tuple[Stream, str], Loss] = {}
        self._listings: dict[Stream, Listing] = {}
        self.frames = SIX_DIGITS
        self.common_files = CommonFiles()

    @property
    def file_names(self) -> FileNames:
        """The file names of a frame in most streams; for lists of frames."""
        digits = [
            listing.names.digits for listing in self._listings.values() if len(listing.numbers)
        ]
        return FileNames(digits[0] if digits else FRAME_DIGITS, stems=self.frames.stems)

    @property
    def late_losses(self) -> list[Loss]:
        """Losses of passes over many samples so far; see model.recording."""
        return list(self._late_losses.values())

    @property
    def listings(self) -> Mapping[Stream, Listing]:
        """The folders of numbered files, with or without stamps, by stream."""
        return self._listings

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        if stream is Stream.PREDICTIONS and self.results is not None:
            return self.results.path(number)
        if stream is Stream.OXTS_EXTRACT and self.extract is not None:
            return self.extract.path(number)
        listing = self._listings.get(Stream.OXTS if stream is Stream.POSE else stream)
        return self.root if listing is None else listing.path(number)

    def _add(
        self, stream: Stream, numbers: Int64Array, stamps_ns: Int64Array, listing: Listing | None
    ) -> None:
        """Add a stream to the index, unless it is empty."""
        if listing is not None:
            self._listings[stream] = listing
            self._report_names(stream, listing)
        if len(numbers):
            self.streams[stream] = StreamIndex(numbers, stamps_ns)

    def _name_frames(self, folders: Mapping[Path, tuple[str, ...]], digits: int) -> None:
        """Find how the frames in the folders of a recording are named; before any is listed."""
        self.frames = STORE.find_frames(folders, digits)
        if stems := self.frames.stems:
            last = len(stems) - 1
            self.notes.append(
                f'{self.name}: file names are no numbers; frames are numbered in their order,'
                f' 0 is {stems[0]}' + (f', {last} is {stems[last]}' if last else '')
            )

    def _list(self, folder: Path, suffixes: tuple[str, ...]) -> Listing:
        """List a folder of the recording."""
        return STORE.list_numbered(folder, suffixes, self.frames.digits, self.frames)

    def _report_names(self, stream: Stream, listing: Listing) -> None:
        """Report the files of a folder that are passed over for their names."""
        example, shown = listing.names.example, some_of(listing.strays)
        suffix = listing.names.suffix
        data = {*OTHER_FORMATS, *(IMAGE_SUFFIXES if suffix in IMAGE_SUFFIXES else (suffix,))}
        others = [name for name in listing.strays if split_name(name)[1].lower() in data]
        if others and not len(listing.numbers):
            text = f'{listing.folder}: {shown} not read; expected files like {example}'
            self._lose_lines(stream, text, len(others))
        elif listing.strays:
            so = '' if len(listing.numbers) else f'; {stream.value} is left out'
            text = f'{listing.folder}: {shown} passed over, not named like {example}{so}'
            self.notes.append(text)
        if listing.doubles:
            names = some_of([name for several in listing.doubles.values() for name in several])
            read_name = listing.path(min(listing.doubles)).name
            reason_start = f'{listing.folder}: {names} left out; {read_name} is'.replace('{', '(')
            reason = f'{reason_start.replace("}", ")")} another file of the same frame: {{}}'
            self._lose(stream, [*listing.doubles], reason)

    def _require_common_names(self) -> None:
        """Require that the files of a frame have one name, where names are no numbers.

        Raises:
            BadFileError: Two folders have no name in common.
        """
        listed = [files for files in self._listings.values() if len(files.numbers)]
        for listing in listed if self.frames.stems else ():
            others = [files for files in listed if files is not listing]
            if others and not any(np.isin(listing.numbers, o.numbers).any() for o in others):
                own, other = (files.path(int(files.numbers[0])) for files in (listing, others[0]))
                problem = f'{own.name} and others have no file of the same name in {other.parent}'
                raise BadFileError(listing.folder, problem, 'one name, or number, for a frame')

    def _add_stamped(
        self,
        stream: Stream,
        listing: Listing,
        stamps: Lines[int],
        stamps_path: Path,
        first: int = 0,
    ) -> None:
        """Add a stream with the stamps of a file, line n for file number n, from a first file."""
        numbers, lines = listing.numbers.tolist(), len(stamps)
        have = set(numbers)
        absent = [number for number in range(first, lines) if number not in have]
        self._lose(
            stream,
            absent,
            f'{listing.folder}: no file for frames {{}}, which {stamps_path.name} lists',
        )
        beyond = [number for number in numbers if number >= lines]
        self._lose(stream, beyond, f'{stamps_path}: {lines} lines, so no stamp for frames {{}}')
        for line, error in stamps.errors.items():
            if line in have:
                self._lose(stream, [line], str(error))
        good = [n for n in numbers if n < lines and stamps.values[n] is not None]
        values = np.array([stamps.values[number] for number in good], dtype=np.int64)
        self._note_backward(np.array(good, dtype=np.int64), values, stamps_path)
        self._add(stream, np.array(good, dtype=np.int64), values, listing)

    def _note_backward(self, numbers: Int64Array, stamps_ns: Int64Array, path: Path) -> None:
        """Note stamps that are earlier than the one before; the numbers count the file's lines."""
        backward = np.flatnonzero(np.diff(stamps_ns) < 0)
        if len(backward):
            self.notes.append(
                f'{path}:{numbers[backward[0] + 1] + 1}: {len(backward)} stamps earlier than'
                f' the line before; written in order of time, each with its own stamp'
            )

    def _add_at(
        self, stream: Stream, numbers: Sequence[int], stamps: Sequence[int | None]
    ) -> list[int]:
        """Add the samples that have a stamp, line n for number n; return the other numbers."""
        good = [n for n in numbers if n < len(stamps) and stamps[n] is not None]
        stamps_ns = np.array([stamps[n] for n in good], dtype=np.int64)
        self._add(stream, np.array(good, dtype=np.int64), stamps_ns, None)
        return sorted(set(numbers) - set(good))

    def _add_nominal(self, stream: Stream, numbers: Int64Array, listing: Listing | None) -> None:
        """Add a stream without time stamps: epoch plus file number times period, of the options."""
        epoch_ns, period_ns = self.options.epoch_ns, self.options.period_ns
        beyond = numbers > (LAST_NS - epoch_ns) // period_ns
        self._lose(
            stream, numbers[beyond].tolist(), f'{self.root}: no stamp in ROS 2 for frames {{}}'
        )
        numbers = numbers[~beyond]
        self._add(stream, numbers, epoch_ns + numbers * period_ns, listing)

    @property
    def _nominal_time(self) -> str:
        """The stamping of frames without time stamps, for notes."""
        return f'stamps are nominal, {self.options.period_ns / NS_PER_S:g} s a frame from the epoch'

    def _add_turns(
        self,
        starts_ns: Mapping[int, int] | None = None,
        ends_ns: Mapping[int, int] | None = None,
    ) -> None:
        """Compute the turn of each scan, and stamp the scans by the options."""
        index = self.streams.get(Stream.SCAN)
        if index is None:
            return
        numbers: list[int] = index.numbers.tolist()
        forward = dict(zip(numbers, index.stamps_ns.tolist(), strict=True))
        self.turns = find_turns(forward, starts_ns or {}, ends_ns or {}, self.options.period_ns)
        stamps = scan_stamps(forward, self.turns, self.options.scan_stamp)
        stamps_ns = np.array([stamps[number] for number in numbers], dtype=np.int64)
        self.streams[Stream.SCAN] = StreamIndex(index.numbers, stamps_ns)

    def leave_out(self, stream: Stream, numbers: Sequence[int], reason: str) -> None:
        """Remove frames of a stream and report them; {} in the reason stands for their numbers."""
        index = self.streams[stream]
        mask = ~np.isin(index.numbers, numbers)
        self.streams[stream] = StreamIndex(index.numbers[mask], index.stamps_ns[mask])
        self._lose(stream, numbers, reason)

    def _lose(self, stream: Stream, numbers: Sequence[int], reason: str) -> None:
        """Report missing frames of a stream; {} in the reason stands for their numbers."""
        if numbers:
            self.losses.append(Loss(stream.value, len(numbers), reason, tuple(numbers)))

    def _lose_late(self, stream: Stream, reason: str) -> None:
        """Report once a failure of a pass over many samples."""
        reason = reason.replace('{', '(').replace('}', ')')
        self._late_losses[stream, reason] = Loss(stream.value, 1, reason)

    def _lose_lines(self, stream: Stream, reason: str, count: int = 1) -> None:
        """Report missing samples without frame numbers."""
        self.losses.append(Loss(stream.value, count, reason.replace('{', '(').replace('}', ')')))

    def _find_gaps(self, streams: Iterable[Stream]) -> None:
        """Report the frames that one of these streams has and another has not."""
        present = [stream for stream in streams if stream in self.streams]
        numbers: set[int] = set()
        for stream in present:
            numbers.update(self.streams[stream].numbers.tolist())
        for stream in present:
            absent = sorted(numbers.difference(self.streams[stream].numbers.tolist()))
            folder = self.path(stream, 0).parent
            self._lose(
                stream,
                absent,
                f'{folder}: no {stream.value} for frames {{}}, which other streams have',
            )
