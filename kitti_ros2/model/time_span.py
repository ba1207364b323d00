# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The time of samples, with the whole turns of their scans."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .streams import Stream

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy as np
    import numpy.typing as npt

    from .recording import StreamIndex
    from .samples import Int64Array, Turn

MARGIN_NS = 100_000_000
"""Time before and after samples in which packets of an unsynchronised drive are taken, too.

LIO-SAM (src/imageProjection.cpp, deskewInfo) and FAST-LIO2 (src/laserMapping.cpp, sync_packages)
wait until the packets reach beyond both ends of a turn, which begins half a turn before its stamp.
"""

_HIGHEST = 10**10 - 1  # KITTI's names have ten digits


def time_span(
    streams: Mapping[Stream, StreamIndex],
    turns: Mapping[int, Turn],
    taken: Mapping[Stream, npt.NDArray[np.bool_]],
) -> tuple[int, int] | None:
    """Return the first and last moment of samples and of the turns of scans; None without any.

    Args:
        streams: The samples of a recording.
        turns: The turn of each scan, by file number.
        taken: (N,) bool by stream: which samples count.
    """
    moments: list[int] = []
    for stream, mask in taken.items():
        stamps_ns = streams[stream].stamps_ns[mask]
        if len(stamps_ns):
            moments += [int(stamps_ns.min()), int(stamps_ns.max())]
        if stream is Stream.SCAN:
            moments += turn_ends(streams[stream].numbers[mask].tolist(), turns)
    return (min(moments), max(moments)) if moments else None


def turn_ends(numbers: Iterable[int], turns: Mapping[int, Turn]) -> list[int]:
    """Return start and end of the turns of scans, of those that have one."""
    known = [turns[number] for number in numbers if number in turns]
    return [moment for turn in known for moment in (turn.start_ns, turn.end_ns)]


def around(stamps_ns: Int64Array, span: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Return (N,) bool: which stamps are within a span, or within the margin of its ends."""
    within: npt.NDArray[np.bool_] = (stamps_ns >= span[0] - MARGIN_NS) & (
        stamps_ns <= span[1] + MARGIN_NS
    )
    return within


def numbers_around(numbers: Int64Array, taken: Int64Array) -> tuple[int, int]:
    """Return the lowest and highest file number that may be of the time of some samples.

    Samples without a file or a stamp have no known time: those next to taken ones count.

    Args:
        numbers: (N,) of a stream.
        taken: (M,) of its samples in that time, M > 0.
    """
    first, last = int(taken.min()), int(taken.max())
    before, after = numbers[numbers < first], numbers[numbers > last]
    lowest = int(before.max()) + 1 if len(before) else 0
    return lowest, int(after.min()) - 1 if len(after) else _HIGHEST
