# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The 100 Hz packets of an unsynchronised drive, as a stream of the synchronised one.

DATE_drive_NNNN_extract/oxts has every packet of the GPS/IMU unit, DATE_drive_NNNN_sync/oxts one for
each frame. Both have the unit's stamps, so packets and frames are paired by time; the poses and the
files of the recording remain those of the synchronised drive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import UsageError
from ..model.layouts import Layout
from ..model.losses import Loss, format_numbers
from ..model.recording import StreamIndex
from ..model.stamps import NS_PER_S, format_stamp
from ..model.streams import UNNUMBERED, Clock, Stream
from ..model.text import format_count
from ..model.time_span import around, numbers_around, time_span
from ..options.imu import ImuStamps
from . import names
from .packet_files import PacketFiles
from .packet_stamps import fit_line, gaps_over, order_packets
from .recording_index import RecordingIndex
from .stamps_file import parse_timestamps
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.samples import Int64Array
    from ..options.imu import ImuOptions
    from ..options.read import ReadOptions
    from .packet_stamps import PacketLine, PacketOrder
    from .recording import KittiRecording

_LONGEST_PERIOD_NS = 50_000_000
_NS_PER_MS = 1_000_000
_IRREGULAR_NS = 1 * _NS_PER_MS


class _ExtractIndex(RecordingIndex):
    """The packets of an unsynchronised drive, and what is missing of them.

    Raises:
        UsageError: The drive has no packets.
        BadFileError, OSError: The stamps cannot be read.
    """

    def __init__(self, drive: Path, options: ReadOptions) -> None:
        super().__init__(drive, options)
        self.folder = drive / names.RAW_OXTS
        if not self.folder.is_dir():
            raise UsageError(f'{drive}: has no folder {names.RAW_OXTS}; {_EXPECTED}')
        listing = STORE.list_numbered(self.folder / names.RAW_DATA, (names.TXT,), names.RAW_DIGITS)
        path = self.folder / names.TIMESTAMPS
        if not path.is_file():
            raise UsageError(f'{path}: no such file, so no stamps of packets; {_EXPECTED}')
        found = parse_timestamps(STORE.read_text(path), path)
        self._add_stamped(Stream.OXTS_EXTRACT, listing, found, path)
        if Stream.OXTS_EXTRACT not in self.streams:
            raise UsageError(f'{self.folder}: has no packet with a stamp; {_EXPECTED}')

    def _note_backward(self, numbers: Int64Array, stamps_ns: Int64Array, path: Path) -> None:
        """Note nothing: add_extract does when it has recognised the repeats."""


_EXPECTED = 'expected the unsynchronised drive, DATE_drive_NNNN_extract'


def add_extract(recording: KittiRecording, options: ImuOptions) -> None:
    """Add the packets of an unsynchronised drive to a recording, as long as it and a margin.

    Missing, damaged and clashing packets are losses; gaps, repeats and irregular stamps are noted.

    Raises:
        UsageError: The recording is no synchronised raw drive with stamps, or the folder is not
            the unsynchronised drive of the same date and number and time.
        BadFileError, OSError: The stamps cannot be read.
    """
    drive = options.path
    if drive is None:
        return
    _check_source(recording)
    _check_drive(recording, drive)
    extract = _ExtractIndex(drive, recording.options)
    files = PacketFiles(drive.resolve().name, extract.listings[Stream.OXTS_EXTRACT], options.stamps)
    index = _clip(recording, extract)
    order = order_packets(index.stamps_ns, lambda at: files.text(int(index.numbers[at])))
    numbers, stamps_ns = index.numbers[order.kept], index.stamps_ns[order.kept]
    line = fit_line(stamps_ns)
    if line.period_ns > _LONGEST_PERIOD_NS:
        raise UsageError(
            f'{extract.folder}: its packets are {line.period_ns / NS_PER_S:.2g} s apart, as in a'
            f' synchronised drive; {_EXPECTED}, whose are 0.01 s apart'
        )
    regular = options.stamps is ImuStamps.REGULAR
    stamps_ns = line.stamps_ns if regular else stamps_ns
    recording.extract = files
    recording.streams[Stream.OXTS_EXTRACT] = StreamIndex(numbers, stamps_ns)
    recording.losses += _losses(extract, index.numbers, order)
    recording.notes += [*extract.notes, *_order_notes(extract, order)]
    recording.notes += _gap_notes(recording, extract, line)
    if line.period_ns:
        recording.notes += _line_note(extract, line, regular=regular)


def _check_source(recording: KittiRecording) -> None:
    """Check that a recording is a synchronised raw drive with stamps.

    Raises:
        UsageError: It is not.
    """
    name, layout = recording.name, recording.layout
    if layout is not Layout.RAW:
        drive = names.ODOMETRY_DRIVES.get(name) if layout is Layout.ODOMETRY else None
        raise UsageError(
            f'{name}: --imu-from is for raw drives, which have the stamps of the unit; this is'
            f' layout {layout.value}' + (f', a part of {drive}: give {drive}_sync' if drive else '')
        )
    if layout.traits.is_extract(name):
        raise UsageError(
            f'{name}: is unsynchronised itself, with 100 Hz packets; --imu-from is for the'
            f' synchronised drive, DATE_drive_NNNN_sync'
        )
    if recording.clock is not Clock.UTC:
        raise UsageError(f'{name}: has no stamps, by which --imu-from pairs packets and frames')


def _check_drive(recording: KittiRecording, drive: Path) -> None:
    """Check the name of an unsynchronised drive, if both names are KITTI's.

    Raises:
        UsageError: It is of another kind, date or number, or no folder.
    """
    if not drive.is_dir():
        what = 'is not a folder' if drive.exists() else 'no such folder'
        raise UsageError(f'{drive}: {what}; {_EXPECTED}')
    known = names.RAW_DRIVE.fullmatch(recording.name)
    given = names.RAW_DRIVE.fullmatch(drive.resolve().name)
    expected = known and recording.name.removesuffix(known[2]) + 'extract'
    if given is not None and given[2] != 'extract':
        raise UsageError(f'{drive}: is the synchronised drive, with 10 Hz packets; {_EXPECTED}')
    if known is not None and given is not None and given[0] != expected:
        raise UsageError(f'{drive}: is not the drive of {recording.name}; expected {expected}')
    if given is None and expected and (drive / expected).is_dir():
        raise UsageError(f'{drive}: contains drives; did you mean {drive / expected}?')


def _clip(recording: KittiRecording, extract: _ExtractIndex) -> StreamIndex:
    """Return the packets during a recording, and within the margin before and after it.

    Raises:
        UsageError: There are none.
    """
    index = extract.streams[Stream.OXTS_EXTRACT]
    own = {each: at for each, at in recording.streams.items() if each not in UNNUMBERED}
    every = {each: np.ones(len(at), np.bool_) for each, at in own.items()}
    span = time_span(own, recording.turns, every)
    within = around(index.stamps_ns, span) if span else np.zeros(len(index), np.bool_)
    if span is None or not within.any():
        ends = format_stamp(int(index.stamps_ns.min())), format_stamp(int(index.stamps_ns.max()))
        during = f', from {format_stamp(span[0])} to {format_stamp(span[1])}' if span else ''
        raise UsageError(
            f'{extract.folder}: has packets from {ends[0]} to {ends[1]}, none during'
            f' {recording.name}{during}'
        )
    return StreamIndex(index.numbers[within], index.stamps_ns[within])


def _losses(extract: _ExtractIndex, numbers: Int64Array, order: PacketOrder) -> list[Loss]:
    """Return the losses of packets among those of a time, which have these numbers."""
    span = numbers_around(extract.streams[Stream.OXTS_EXTRACT].numbers, numbers)
    found = [part for loss in extract.losses if (part := loss.within(*span))]
    if order.clashes:
        lost = tuple(numbers[list(order.clashes)].tolist())
        reason = f'{extract.folder}: packets {{}} have the stamp of another one, but other values'
        found.append(Loss(Stream.OXTS_EXTRACT.value, len(lost), reason, lost))
    return found


def _order_notes(extract: _ExtractIndex, order: PacketOrder) -> list[str]:
    notes = []
    if order.repeats:
        notes.append(
            f'{extract.folder}: {format_count(len(order.repeats), "packet")} left out that'
            f' repeat one shortly before'
        )
    if order.late:
        notes.append(
            f'{extract.folder}: {format_count(order.late, "packet")} listed after one of a later'
            f' stamp; taken in order of time'
        )
    return notes


def _gap_notes(recording: KittiRecording, extract: _ExtractIndex, line: PacketLine) -> list[str]:
    """Return notes on missing packets, and on the frames whose turns they leave uncovered."""
    notes, missing = [], int(line.missing.sum())
    stamps_ns = line.stamps_ns + line.residuals_ns
    if missing:
        longest = int(np.diff(stamps_ns)[line.starts[1:] - 1].max())
        notes.append(
            f'{extract.folder}: {format_count(missing, "packet")} missing in'
            f' {format_count(len(line.missing), "gap")}, the longest of {longest / NS_PER_S:.2f} s'
        )
    turns = sorted(recording.turns.items())
    begin = np.array([turn.start_ns for _, turn in turns], np.int64)
    end = np.array([turn.end_ns for _, turn in turns], np.int64)
    longest_ns = 1.5 * line.period_ns
    crossed = gaps_over(line.stamps_ns, begin, end, longest_ns)
    frames = [number for (number, _), gap in zip(turns, crossed.tolist(), strict=True) if gap]
    if frames:
        notes.append(f'{extract.folder}: packets are missing during the turns of {_scans(frames)}')
    return notes


def _scans(numbers: list[int]) -> str:
    return f'{format_count(len(numbers), "scan")} ({format_numbers(numbers)})'


def _line_note(extract: _ExtractIndex, line: PacketLine, *, regular: bool) -> list[str]:
    """Return a note on irregular stamps, or on how the regular ones were made."""
    off = np.abs(line.residuals_ns)
    rms, most = (value / _NS_PER_MS for value in (np.sqrt(np.mean(np.square(off))), off.max()))
    period = f'{line.period_ns / _NS_PER_MS:.4f} ms'
    irregular = int((off > _IRREGULAR_NS).sum())
    note = (
        f'{extract.folder}: {irregular} of {format_count(len(off), "stamp")} more than 1 ms off'
        f' even intervals of {period}, at most {most:.2f} ms; --imu-stamps regular evens them out'
    )
    if regular:
        note = (
            f'{extract.folder}: regular stamps, {period} apart, by least squares over'
            f' {format_count(len(off), "packet")} in {format_count(len(line.starts), "run")};'
            f' the original ones differ by {rms:.2f} ms (RMS), at most {most:.2f} ms'
        )
    return [note] if regular or irregular else []
