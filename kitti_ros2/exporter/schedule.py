# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The schedule of a recording: the selected samples in chronological order."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..model.streams import FRAME_STREAMS, UNNUMBERED, Stream
from ..model.time_span import around, numbers_around, time_span
from .stream_names import wanted_streams
from .window import UNLIMITED, nothing_selected, numbered, select_window

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from ..model.losses import Loss
    from ..model.recording import ReadableRecording, StreamIndex
    from ..model.samples import Int64Array, Turn
    from ..options.selection import SelectionOptions
    from .window import Window

_Row: TypeAlias = 'tuple[Stream, Int64Array, Int64Array]'
"""A stream, and the numbers and stamps of its samples."""

_STREAMS = tuple(Stream)
ONCE = (Stream.RECORDING, Stream.CALIBRATION, Stream.PATH)
"""Streams that may apply to a whole recording, and are then due once."""

_UNNUMBERED = [_STREAMS.index(stream) for stream in UNNUMBERED]
UNKNOWN = -1
"""Placeholder for an unknown file number."""


@dataclass(frozen=True)
class Entry:
    """A scheduled sample."""

    stream: Stream
    number: int
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class Schedule:
    """The samples to send, in order of time, at equal times in the order of Stream.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        streams: (N,) indices into Stream.
        numbers: (N,) int64 file numbers.
        spans: First and last selected file number, by selected stream.
        common_numbers: Whether a file number is the same moment in all streams.
        turns: The turn of the scanner of each scan, by file number, if known.
    """

    stamps_ns: Int64Array
    streams: Int64Array
    numbers: Int64Array
    spans: Mapping[Stream, tuple[int, int]]
    common_numbers: bool = True
    turns: Mapping[int, Turn] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __iter__(self) -> Iterator[Entry]:
        columns = (self.streams.tolist(), self.numbers.tolist(), self.stamps_ns.tolist())
        for code, number, stamp_ns in zip(*columns, strict=True):
            yield Entry(_STREAMS[code], number, stamp_ns)

    def part(self, start: int, stop: int) -> list[Entry]:
        """Return the samples from one position to another, which is not included."""
        columns = (
            each[start:stop].tolist() for each in (self.streams, self.numbers, self.stamps_ns)
        )
        return [
            Entry(_STREAMS[code], number, ns) for code, number, ns in zip(*columns, strict=True)
        ]

    def count(self, stream: Stream) -> int:
        """Return the number of scheduled samples of a stream."""
        return int((self.streams == _STREAMS.index(stream)).sum())

    def numbers_of(self, stream: Stream) -> list[int]:
        """Return the scheduled file numbers of a stream, in order of time."""
        numbers: list[int] = self.numbers[self.streams == _STREAMS.index(stream)].tolist()
        return numbers

    def concerned(self, loss: Loss) -> Loss | None:
        """Return the part of a loss within the selection, None without any."""
        span = self.spans.get(Stream(loss.stream))
        return None if span is None else loss.within(*span)

    @property
    def frames(self) -> int:
        """Number of frames; see streams.FRAME_STREAMS."""
        return len(frames_of(self._frame_streams, common=self.common_numbers))

    @cached_property
    def frame_numbers(self) -> Int64Array:
        """(N,) int64: the frame of each entry, each frame in one piece.

        Without common numbers a frame extends half-way to its neighbours. The reference time of a
        scan stamped at its start is half-way to facing forward, where the images are taken.
        """
        streams = self._frame_streams
        frames = frames_of(streams, common=self.common_numbers)
        if not len(frames):
            return np.zeros(len(self), dtype=np.int64)
        if self.common_numbers:
            # Streams of the whole recording are due with the first sample.
            known = np.isin(self.numbers, frames) & ~np.isin(self.streams, _UNNUMBERED)
            return frame_runs(np.where(known, self.numbers, UNKNOWN))
        reference = next(stream for stream in FRAME_STREAMS if stream in streams)
        chosen = self.streams == _STREAMS.index(reference)
        numbers, reference_ns = self.numbers[chosen], self.stamps_ns[chosen]
        if reference is Stream.SCAN and self.turns:
            forward_ns = np.array([self.turns[number].forward_ns for number in numbers.tolist()])
            reference_ns = np.maximum.accumulate((reference_ns + forward_ns) // 2)
        return nearest_frames(self.stamps_ns, reference_ns, numbers)

    @cached_property
    def _frame_streams(self) -> dict[Stream, Int64Array]:
        """The numbers of the streams that define frames, of those with samples."""
        return {
            stream: np.array(numbers)
            for stream in FRAME_STREAMS
            if (numbers := self.numbers_of(stream))
        }


def frames_of(numbers: Mapping[Stream, Int64Array], *, common: bool) -> Int64Array:
    """Return (N,) int64 numbers of the frames, ascending.

    Args:
        numbers: The file numbers of each stream.
        common: Whether a number is the same moment in all streams.
    """
    found = [numbers[stream] for stream in FRAME_STREAMS if stream in numbers]
    every = np.concatenate([*(found if common else found[:1]), np.empty(0, np.int64)])
    # Without return_index numpy imports numpy.ma, which takes longer than a short drive.
    frames, _ = np.unique(every, return_index=True)
    return frames


def frame_runs(numbers: Int64Array) -> Int64Array:
    """Return (N,) the frame of each of (N,) samples in order of time, from their file numbers.

    Frames follow each other in order of their first sample. A sample of number UNKNOWN, or of an
    earlier frame, belongs to the frame of the one before it; those before the first to the first.
    """
    known = numbers != UNKNOWN
    if not known.any():
        return np.zeros_like(numbers)
    values, first, place = np.unique(numbers[known], return_index=True, return_inverse=True)
    order = np.argsort(first)
    ranks = np.zeros(len(numbers), dtype=np.int64)
    ranks[known] = np.argsort(order)[place]
    frames: Int64Array = values[order][np.maximum.accumulate(ranks)]
    return frames


def nearest_frames(
    stamps_ns: Int64Array, reference_ns: Int64Array, numbers: Int64Array
) -> Int64Array:
    """Return (N,) int64: the number of the reference sample nearest to each stamp.

    Args:
        stamps_ns: (N,) nanoseconds, ascending.
        reference_ns: (M,) nanoseconds, ascending, M > 0.
        numbers: (M,) of the reference samples, ascending.
    """
    middles = reference_ns[:-1] + np.diff(reference_ns) // 2
    frames: Int64Array = numbers[np.searchsorted(middles, stamps_ns, 'right')]
    return frames


def make_schedule(recording: ReadableRecording, selection: SelectionOptions) -> Schedule:
    """Schedule the samples of a recording in a selection.

    Data of the whole recording (its description, a constant calibration, the path) is due once, at
    the first selected stamp.

    Raises:
        UsageError: A stream's name is unknown, or the selection is empty.
    """
    wanted = wanted_streams(selection.streams)
    common = recording.common_numbers
    own = numbered(recording)
    window = select_window(own, selection, common=common)
    taken = {stream: window.takes(index) for stream, index in own.items()}
    rows = [_row(stream, own[stream], taken[stream]) for stream in own if stream in wanted]
    rows += _rows_around(recording, taken, wanted)
    stamps = np.concatenate([row[2] for row in rows]) if rows else np.empty(0, np.int64)
    if not len(stamps) and wanted <= set(ONCE):
        stamps = np.concatenate([index.stamps_ns for index in own.values()])
    if not len(stamps):
        raise nothing_selected(recording, selection)
    first = int(stamps.min())
    present = {row[0] for row in rows}
    once = np.array([first], dtype=np.int64)
    rows += [
        (stream, np.zeros(1, np.int64), once)
        for stream in ONCE
        if stream in wanted and stream not in present and _has_once(recording, stream, present)
    ]
    if not rows:
        raise nothing_selected(recording, selection)
    spans = {stream: _span(rows, stream, recording, window) for stream in wanted}
    known = {stream: span for stream, span in spans.items() if span is not None}
    return _in_order(rows, known, recording)


def _row(stream: Stream, index: StreamIndex, taken: npt.NDArray[np.bool_]) -> _Row:
    return stream, index.numbers[taken], index.stamps_ns[taken]


def _rows_around(
    recording: ReadableRecording,
    taken: Mapping[Stream, npt.NDArray[np.bool_]],
    wanted: set[Stream],
) -> list[_Row]:
    """Return the rows of UNNUMBERED streams, as long as the taken samples of the others."""
    present = recording.streams.keys() & wanted & UNNUMBERED
    span = time_span(recording.streams, recording.turns, taken) if present else None
    if span is None:
        return []
    indexed = [(stream, recording.streams[stream]) for stream in present]
    return [_row(stream, index, around(index.stamps_ns, span)) for stream, index in indexed]


def _span(
    rows: Sequence[_Row], stream: Stream, recording: ReadableRecording, window: Window
) -> tuple[int, int] | None:
    """Return the first and last selected file number of a stream, None if unknown."""
    own = [row[1] for row in rows if len(row[1]) and row[0] is stream]
    if stream in UNNUMBERED:
        return numbers_around(recording.streams[stream].numbers, own[0]) if own else None
    if window.stamps_ns == UNLIMITED:
        return window.numbers
    indexed = recording.streams.keys() - UNNUMBERED
    taken = [row[1] for row in rows if len(row[1]) and row[0] in indexed]
    basis = own or (taken if recording.common_numbers else [])
    if not basis:
        return None
    return min(int(part.min()) for part in basis), max(int(part.max()) for part in basis)


def _has_once(recording: ReadableRecording, stream: Stream, present: set[Stream]) -> bool:
    if stream is Stream.CALIBRATION:
        return stream not in recording.streams
    return stream is Stream.RECORDING or Stream.POSE in present


def _in_order(
    rows: Sequence[_Row], spans: Mapping[Stream, tuple[int, int]], recording: ReadableRecording
) -> Schedule:
    streams = np.concatenate([np.full(len(row[1]), _STREAMS.index(row[0])) for row in rows])
    numbers = np.concatenate([row[1] for row in rows])
    stamps = np.concatenate([row[2] for row in rows])
    order = np.lexsort((numbers, streams, stamps))
    codes = streams[order].astype(np.int64)
    common = recording.common_numbers
    return Schedule(stamps[order], codes, numbers[order], spans, common, recording.turns)
