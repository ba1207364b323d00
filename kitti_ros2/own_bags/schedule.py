# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The schedule of a recording: the samples of a selection in chronological order."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ..model.errors import UsageError, describe_frames, did_you_mean, either, format_duration
from ..model.recording import around, numbers_around, time_span
from ..model.streams import (
    FRAME_STREAMS,
    IMAGE_STREAMS,
    STREAM_ALIASES,
    UNNUMBERED,
    Stream,
    format_stamp,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from ..model.errors import Loss
    from ..model.recording import ReadableRecording, StreamIndex
    from ..model.samples import Int64Array, Turn
    from ..options.read import Bound, SelectionOptions


# The streams that a selection names.

_CAMERA = re.compile(r'(?:image|camera|cam)_?0?(\d)', re.ASCII)
_PACKETS = {Stream.OXTS, Stream.OXTS_EXTRACT}


def requested_streams(asked: tuple[str, ...]) -> set[Stream]:
    """Return the streams of the option --streams; all without names.

    Raises:
        UsageError: A name is unknown.
    """
    if not asked:
        return set(Stream)
    streams: set[Stream] = set()
    for name in asked:
        if name == 'image':
            streams |= set(IMAGE_STREAMS)
        elif name in {stream.value for stream in Stream}:
            streams |= _PACKETS if name == Stream.OXTS.value else {Stream(name)}
        else:
            raise _no_stream(name)
    return streams


def _no_stream(name: str) -> UsageError:
    choices = ['image', *(stream.value for stream in Stream)]
    other = STREAM_ALIASES.get(name.lower())
    hint = f'; did you mean {other.value}?' if other else did_you_mean(_numbered(name), choices)
    return UsageError(f'there is no stream {name!r}{hint or f"; choose from {either(choices)}"}')


def _numbered(name: str) -> str:
    """Return image_2 for the names of a camera in KITTI's folders, and in topics."""
    camera = _CAMERA.fullmatch(name.lower())
    return f'image_{camera[1]}' if camera else name


# The window of a selection: the file numbers and stamps from its start to its end.

UNLIMITED = (np.iinfo(np.int64).min, np.iinfo(np.int64).max)


class Window(NamedTuple):
    """Limits of file numbers and stamps, both included.

    Attributes:
        numbers: Lowest and highest file number.
        stamps_ns: Lowest and highest stamp.
    """

    numbers: tuple[int, int]
    stamps_ns: tuple[int, int]

    def takes(self, index: StreamIndex) -> npt.NDArray[np.bool_]:
        """Return (N,) bool: which samples of a stream are inside."""
        (first, last), (begin_ns, end_ns) = self
        numbers = (index.numbers >= first) & (index.numbers <= last)
        return numbers & (index.stamps_ns >= begin_ns) & (index.stamps_ns <= end_ns)


def select_window(
    streams: Mapping[Stream, StreamIndex], selection: SelectionOptions, *, common: bool
) -> Window:
    """Return the window of a selection.

    Args:
        streams: The samples of a recording, but those of UNNUMBERED streams.
        selection: Its start and end.
        common: Whether a number is the same time in all streams.
    """
    numbers, stamps = list(UNLIMITED), list(UNLIMITED)
    for side, bound in enumerate((selection.start, selection.end)):
        if bound is None:
            continue
        if bound.frame is not None and common:
            numbers[side] = bound.frame
        else:
            stamps[side] = _bound_ns(streams, bound, side)
    return Window((numbers[0], numbers[1]), (stamps[0], stamps[1]))


def numbered(recording: ReadableRecording) -> dict[Stream, StreamIndex]:
    """Return the streams of a recording whose file numbers are frames; all without any."""
    own = {s: index for s, index in recording.streams.items() if s not in UNNUMBERED}
    return own or dict(recording.streams)


def nothing_selected(recording: ReadableRecording, selection: SelectionOptions) -> UsageError:
    """Return the error for a selection without samples: empty, or its end is before its start."""
    start, end = selection.start, selection.end
    if start is not None and end is not None:
        streams = numbered(recording)
        first, last = _bound_ns(streams, start, 0), _bound_ns(streams, end, 1)
        # Start and end are of different kinds, both inside the recording.
        if UNLIMITED[0] < last < first < UNLIMITED[1]:
            return selection.reversed_error()
    present = {stream.value: index for stream, index in numbered(recording).items()}
    requested = [name for name in selection.streams if name in {*present, 'image'}]
    if selection.streams and not requested:
        return UsageError(
            f'{recording.name}: the selection takes no sample: no {either(selection.streams)};'
            f' it has {", ".join(present)}'
        )
    indexes = list(present.values())
    if not recording.common_numbers:  # frames are those of the reference stream
        indexes = [recording.streams[_reference(numbered(recording))]]
    numbers = np.unique(np.concatenate([index.numbers for index in indexes]))
    stamps_ns = np.sort(np.concatenate([index.stamps_ns for index in present.values()]))
    extent = describe_extent(numbers, stamps_ns, selection)
    return UsageError(f'{recording.name}: {selection} takes no sample; it has {extent}')


def describe_extent(numbers: Int64Array, stamps_ns: Int64Array, selection: SelectionOptions) -> str:
    """Describe what a selection could take, in the units of its start and end.

    Args:
        numbers: (N,) the frames, ascending.
        stamps_ns: (M,) the stamps of all samples, ascending.
        selection: A selection that takes nothing.
    """
    bounds = [bound for bound in (selection.start, selection.end) if bound is not None]
    parts = [describe_frames(numbers)]
    first_ns, last_ns = int(stamps_ns[0]), int(stamps_ns[-1])
    if any(bound.offset_ns is not None for bound in bounds):
        parts.append(f'in {format_duration(last_ns - first_ns)}')
    if any(bound.stamp_ns is not None for bound in bounds):
        parts.append(f'from {format_stamp(first_ns)} to {format_stamp(last_ns)}')
    return ', '.join(parts)


def _reference(streams: Mapping[Stream, StreamIndex]) -> Stream:
    reference: Stream = next(s for s in (Stream.SCAN, *Stream) if s in streams)
    return reference


def _bound_ns(streams: Mapping[Stream, StreamIndex], bound: Bound, side: int) -> int:
    """Return the first (side 0) or last (side 1) stamp within a bound."""
    if bound.stamp_ns is not None:
        return bound.stamp_ns
    if bound.offset_ns is not None:
        first = min(int(index.stamps_ns.min()) for index in streams.values())
        return first + bound.offset_ns
    # Streams without a common frame number are cut where the reference stream has that frame.
    index = streams[_reference(streams)]
    frame = bound.frame or 0
    position = int(np.searchsorted(index.numbers, frame, 'right' if side else 'left')) - side
    if position < 0:
        return UNLIMITED[0]
    return int(index.stamps_ns[position]) if position < len(index) else UNLIMITED[1]


# The schedule of a recording: the selected samples in chronological order.

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
        common_numbers: Whether a file number is the same time in all streams.
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
            column[start:stop].tolist() for column in (self.streams, self.numbers, self.stamps_ns)
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
            in_frame = np.isin(self.numbers, frames) & ~np.isin(self.streams, _UNNUMBERED)
            return frame_runs(np.where(in_frame, self.numbers, UNKNOWN))
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
        common: Whether a number is the same time in all streams.
    """
    arrays = [numbers[stream] for stream in FRAME_STREAMS if stream in numbers]
    joined = np.concatenate([*(arrays if common else arrays[:1]), np.empty(0, np.int64)])
    # Without return_index numpy imports numpy.ma, which takes longer than a short drive.
    frames, _ = np.unique(joined, return_index=True)
    return frames


def frame_runs(numbers: Int64Array) -> Int64Array:
    """Return (N,) the frame of each of (N,) samples in order of time, from their file numbers.

    Frames follow each other in order of their first sample. A sample of number UNKNOWN, or of an
    earlier frame, belongs to the frame of the one before it; those before the first to the first.
    """
    is_known = numbers != UNKNOWN
    if not is_known.any():
        return np.zeros_like(numbers)
    values, first, inverse = np.unique(numbers[is_known], return_index=True, return_inverse=True)
    order = np.argsort(first)
    ranks = np.zeros(len(numbers), dtype=np.int64)
    ranks[is_known] = np.argsort(order)[inverse]
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
    streams = requested_streams(selection.streams)
    common = recording.common_numbers
    own = numbered(recording)
    window = select_window(own, selection, common=common)
    masks = {stream: window.takes(index) for stream, index in own.items()}
    rows = [_row(stream, own[stream], masks[stream]) for stream in own if stream in streams]
    rows += _rows_around(recording, masks, streams, window)
    stamps = np.concatenate([row[2] for row in rows]) if rows else np.empty(0, np.int64)
    if not len(stamps) and streams <= set(ONCE):
        stamps = np.concatenate([index.stamps_ns for index in own.values()])
    if not len(stamps):
        raise nothing_selected(recording, selection)
    first = int(stamps.min())
    present = {row[0] for row in rows}
    once = np.array([first], dtype=np.int64)
    rows += [
        (stream, np.zeros(1, np.int64), once)
        for stream in ONCE
        if stream in streams and stream not in present and _has_once(recording, stream, present)
    ]
    if not rows:
        raise nothing_selected(recording, selection)
    spans = {stream: _span(rows, stream, recording, window) for stream in streams}
    known_spans = {stream: span for stream, span in spans.items() if span is not None}
    return _in_order(rows, known_spans, recording)


def _row(stream: Stream, index: StreamIndex, mask: npt.NDArray[np.bool_]) -> _Row:
    return stream, index.numbers[mask], index.stamps_ns[mask]


def _rows_around(
    recording: ReadableRecording,
    masks: Mapping[Stream, npt.NDArray[np.bool_]],
    streams: set[Stream],
    window: Window,
) -> list[_Row]:
    """Return the rows of UNNUMBERED streams, as long as the taken samples of the others."""
    present = recording.streams.keys() & streams - masks.keys()
    taken = masks_around(recording.streams, recording.turns, masks, window)
    return [_row(stream, recording.streams[stream], taken[stream]) for stream in present]


def masks_around(
    streams: Mapping[Stream, StreamIndex],
    turns: Mapping[int, Turn],
    masks: Mapping[Stream, npt.NDArray[np.bool_]],
    window: Window,
) -> dict[Stream, npt.NDArray[np.bool_]]:
    """Return by stream without a mask (N,) bool: which samples are of the time of the others."""
    others = streams.keys() - masks.keys()
    is_whole = window == (UNLIMITED, UNLIMITED)
    span = time_span(streams, turns, masks) if others and not is_whole else None
    return {
        stream: around(streams[stream].stamps_ns, span)
        if span
        else np.full(len(streams[stream]), is_whole)
        for stream in others
    }


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
    numbers = [row[1] for row in rows if len(row[1]) and row[0] in indexed]
    basis = own or (numbers if recording.common_numbers else [])
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
