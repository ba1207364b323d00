# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The 100 Hz packets of an unsynchronised drive, as a stream of the synchronised one.

DATE_drive_NNNN_extract/oxts has every packet of the GPS/IMU, DATE_drive_NNNN_sync/oxts one for
each frame. Both have the IMU's stamps, so packets and frames are paired by time; the poses and the
files of the recording remain those of the synchronised drive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..kitti import names
from ..model.errors import Loss, UsageError, format_count, format_numbers
from ..model.recording import StreamIndex, around, numbers_around, time_span
from ..model.streams import NS_PER_S, UNNUMBERED, Clock, Layout, Stream, format_stamp
from ..options.read import ImuStamps
from .recording_index import RecordingIndex
from .store import STORE
from .text_file import PacketFiles, parse_timestamps

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from ..options.read import ImuOptions, ReadOptions
    from .kitti_recording import KittiRecording


# Stamps of the packets of an unsynchronised drive: repeats, gaps, and evenly spaced stamps.
#
# The GPS/IMU sends 100 packets a second; a packet is stamped when it arrives. Irregular in KITTI:
#
# - Packets that come twice, with the stamps of the first time: in 2011_09_26_drive_0028_extract the
#   stamps step back by 0.05 s at 28 places, after which the last 6 packets are repeated
#   (www.cnblogs.com/goodknight/p/7426221.html).
# - Missing packets and jitter: in 2011_10_03_drive_0027 half of the intervals are within 9.967 and
#   10.025 ms, the longest is 0.52 s (github.com/AlexGeControl/Sensor-Fusion, issue 1).
#
# A stamp that does not increase stops others: gtsam throws at dt <= 0 (014b419,
# gtsam/navigation/ImuFactor.cpp, integrateMeasurement), which ends LIO-SAM; FAST-LIO2 clears its
# buffer at a step back (src/laserMapping.cpp, imu_cbk).
#
# LIO-SAM's own converter fits one line to all stamps by their position in the listing
# (config/doc/kitti2bag/kitti2bag.py, save_imu_data_raw), which shifts every packet after a gap or a
# repeat. Here each run of packets without a gap has its own offset, and all have the same period.

_REPEATED_WITHIN = 100  # packets: a second
_GAP_PERIODS = 1.5


@dataclass(frozen=True, eq=False)
class PacketOrder:
    """The order of packets in time.

    Attributes:
        kept: (N,) positions in the listing, in order of time, each with a later stamp.
        repeats: Positions of packets that repeat one shortly before, and of
        clashes: those that have the stamp of another one, but other values.
        late: How many of the kept ones are listed after one of a later stamp.
    """

    kept: Int64Array
    repeats: tuple[int, ...]
    clashes: tuple[int, ...]
    late: int


@dataclass(frozen=True, eq=False)
class PacketLine:
    """Least squares of stamp over packet number: one period, and an offset for each run.

    Attributes:
        stamps_ns: (N,) int64, the fitted stamps, increasing.
        starts: Position of the first packet of each run.
        period_ns: Nanoseconds from packet to packet in a run.
        missing: Number of packets missing before each run but the first.
        residuals_ns: (N,) original minus fitted stamps.
    """

    stamps_ns: Int64Array
    starts: Int64Array
    period_ns: float
    missing: Int64Array
    residuals_ns: Int64Array


def order_packets(stamps_ns: Int64Array, text_of: Callable[[int], str | None]) -> PacketOrder:
    """Bring packets in order of time, without repeats.

    Args:
        stamps_ns: (N,) in the order of the listing.
        text_of: Returns the text of the packet at a position, None if it cannot be read; called
            only near steps back.
    """
    highest = np.maximum.accumulate(stamps_ns)
    late = [int(at) + 1 for at in np.flatnonzero(stamps_ns[1:] <= highest[:-1])]
    repeats = _find_repeats(late, text_of)
    rest = np.delete(np.arange(len(stamps_ns)), repeats)
    rest = rest[np.argsort(stamps_ns[rest], kind='stable')]
    again = np.flatnonzero(np.diff(stamps_ns[rest]) == 0) + 1
    clashes = sorted(rest[again].tolist())
    return PacketOrder(
        kept=np.delete(rest, again),
        repeats=tuple(repeats),
        clashes=tuple(clashes),
        late=len({*late} - {*repeats} - {*clashes}),
    )


def _find_repeats(late: Sequence[int], text_of: Callable[[int], str | None]) -> list[int]:
    """Return the positions, of those given, of packets that one of the last second equals."""
    near = {at for index in late for at in range(max(0, index - _REPEATED_WITHIN), index + 1)}
    suspects, repeats = {*late}, []
    last: dict[str, int] = {}
    for at in sorted(near):
        text = text_of(at)
        if text is None:
            continue
        if at in suspects and text in last and at - last[text] <= _REPEATED_WITHIN:
            repeats.append(at)
        last[text] = at
    return repeats


def fit_line(stamps_ns: Int64Array) -> PacketLine:
    """Fit evenly spaced stamps to increasing ones.

    Runs are divided where an interval is above 1.5 median intervals; those between which less than
    1.5 periods remain after the fit are joined, since their packets came late, but none is missing.

    Args:
        stamps_ns: (N,) int64, increasing, N > 0.
    """
    if len(stamps_ns) == 1:
        none = np.zeros(0, np.int64)
        return PacketLine(stamps_ns, np.zeros(1, np.int64), 0.0, none, np.zeros(1, np.int64))
    intervals = np.diff(stamps_ns)
    starts = np.flatnonzero(np.r_[True, intervals > _GAP_PERIODS * np.median(intervals)])
    while True:
        fitted, period = _fit_runs(stamps_ns, starts)
        gaps = (fitted[starts[1:]] - fitted[starts[1:] - 1]) / period
        divided = np.r_[True, gaps >= _GAP_PERIODS]
        if divided.all():
            missing = np.rint(gaps).astype(np.int64) - 1
            return PacketLine(fitted, starts, period, missing, stamps_ns - fitted)
        starts = starts[divided]


def _fit_runs(stamps_ns: Int64Array, starts: Int64Array) -> tuple[Int64Array, float]:
    """Return fitted stamps and the common period of runs, of which one has two packets or more."""
    counts = np.diff(np.r_[starts, len(stamps_ns)])
    run = np.repeat(np.arange(len(starts)), counts)
    numbers = np.arange(len(stamps_ns)) - starts[run]
    origins = stamps_ns[starts]
    times = (stamps_ns - origins[run]).astype(np.float64)
    middle = (counts - 1) / 2
    mean = np.add.reduceat(times, starts) / counts
    steps: Float64Array = numbers - middle[run]
    period = float(steps @ (times - mean[run]) / (steps @ steps))
    offsets = np.floor(mean[run] + period * steps + 0.5).astype(np.int64)
    return origins[run] + offsets, period


def gaps_over(
    stamps_ns: Int64Array, begin_ns: Int64Array, end_ns: Int64Array, longest_ns: float
) -> npt.NDArray[np.bool_]:
    """Return (M,) bool: whether packets are missing within each span of time.

    Args:
        stamps_ns: (N,) of the packets, increasing, N > 0.
        begin_ns: (M,) of the spans.
        end_ns: The same.
        longest_ns: The longest interval between packets that is no gap.
    """
    outside = (begin_ns < stamps_ns[0]) | (end_ns > stamps_ns[-1])
    wide = np.diff(stamps_ns) > longest_ns
    before = np.r_[0, np.cumsum(wide)]  # gaps before each packet
    first = np.clip(np.searchsorted(stamps_ns, begin_ns, 'right') - 1, 0, None)
    last = np.clip(np.searchsorted(stamps_ns, end_ns, 'left'), None, len(stamps_ns) - 1)
    crossed: npt.NDArray[np.bool_] = outside | (before[last] > before[first])
    return crossed


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
        stamps = parse_timestamps(STORE.read_text(path), path)
        self._add_stamped(Stream.OXTS_EXTRACT, listing, stamps, path)
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
    """Check that a recording is a synchronised drive with stamps, raw or of KITTI-360.

    Raises:
        UsageError: It is not.
    """
    name, layout = recording.name, recording.layout
    if not (layout.traits.stamps_per_stream and Stream.OXTS in layout.traits.streams):
        drive = names.ODOMETRY_DRIVES.get(name) if layout is Layout.ODOMETRY else None
        raise UsageError(
            f'{name}: --imu-from is for drives, which have the stamps of the unit; this is'
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
    recording_name = names.RAW_DRIVE.fullmatch(recording.name)
    drive_name = names.RAW_DRIVE.fullmatch(drive.resolve().name)
    expected = recording_name and recording.name.removesuffix(recording_name[2]) + 'extract'
    if drive_name is not None and drive_name[2] != 'extract':
        raise UsageError(f'{drive}: is the synchronised drive, with 10 Hz packets; {_EXPECTED}')
    if recording_name is not None and drive_name is not None and drive_name[0] != expected:
        raise UsageError(f'{drive}: is not the drive of {recording.name}; expected {expected}')
    if drive_name is None and expected and (drive / expected).is_dir():
        raise UsageError(f'{drive}: contains drives; did you mean {drive / expected}?')


def _clip(recording: KittiRecording, extract: _ExtractIndex) -> StreamIndex:
    """Return the packets during a recording, and within the margin before and after it.

    Raises:
        UsageError: There are none.
    """
    index = extract.streams[Stream.OXTS_EXTRACT]
    own = {stream: at for stream, at in recording.streams.items() if stream not in UNNUMBERED}
    every = {stream: np.ones(len(at), np.bool_) for stream, at in own.items()}
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
    losses = [part for loss in extract.losses if (part := loss.within(*span))]
    if order.clashes:
        lost = tuple(numbers[list(order.clashes)].tolist())
        reason = f'{extract.folder}: packets {{}} have the stamp of another one, but other values'
        losses.append(Loss(Stream.OXTS_EXTRACT.value, len(lost), reason, lost))
    return losses


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
