# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The window of a selection: the file numbers and stamps from its start to its end."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.errors import UsageError
from ..model.losses import describe_frames
from ..model.stamps import format_stamp
from ..model.streams import UNNUMBERED, Stream
from ..model.text import either, format_duration

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from ..model.recording import ReadableRecording, StreamIndex
    from ..model.samples import Int64Array
    from ..options.selection import Bound, SelectionOptions

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
        common: Whether a number is the same moment in all streams.
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
    """Return the streams of a recording whose file numbers are its own."""
    return {each: at for each, at in recording.streams.items() if each not in UNNUMBERED}


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
    wanted = [name for name in selection.streams if name in {*present, 'image'}]
    if selection.streams and not wanted:
        return UsageError(
            f'{recording.name}: the selection takes no sample: no {either(selection.streams)};'
            f' it has {", ".join(present)}'
        )
    found = list(present.values())
    if not recording.common_numbers:  # frames are those of the reference stream
        found = [recording.streams[_reference(numbered(recording))]]
    numbers = np.unique(np.concatenate([index.numbers for index in found]))
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
    found: Stream = next(s for s in (Stream.SCAN, *Stream) if s in streams)
    return found


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
