# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs: cameras 0 and 1, 2 and 3, with one stamp a pair, that of the left image.

KITTI triggers its cameras together, but each image has a stamp of its own: in drive 0001 image_3
is 0.47 to 0.64 ms before image_2, and image_1 2.69 ms before to 2.43 ms after image_0. Stereo
nodes pair by equal stamps (ExactTime) unless configured otherwise: image_pipeline 0131608,
stereo_image_proc/src/stereo_image_proc/disparity_node.cpp, parameter approximate_sync.

Images of one file number are a pair; in a raw extract, whose cameras are numbered independently,
the nearest in time, at most 10 ms apart. An image without a partner keeps its stamp.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import TYPE_CHECKING

import numpy as np

from ..model.cameras import LEFT_OF
from ..model.losses import format_numbers
from ..model.recording import StreamIndex
from ..model.streams import IMAGE_STREAMS
from ..model.text import format_count

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.streams import Stream
    from .recording import KittiRecording

LEFT_STREAM_OF = {IMAGE_STREAMS[right]: IMAGE_STREAMS[left] for right, left in LEFT_OF.items()}
"""The stream of the left images of a stream of right ones."""
_NS_PER_MS = 1_000_000
_FARTHEST_NS = 10 * _NS_PER_MS


def prepare_stereo(recording: KittiRecording) -> None:
    """Give the right images of a recording the stamps of their left ones, if options request it."""
    if not recording.options.stereo:
        return
    streams = recording.streams
    pairs = [(left, right) for right, left in LEFT_STREAM_OF.items() if {left, right} <= {*streams}]
    own = bool(pairs) and recording.calibration(_first(streams[pairs[0][0]])).independent_cameras
    if own or not pairs:
        why = 'each camera has extrinsics of its own' if own else 'no two cameras are a pair'
        recording.notes.append(f'stereo changes nothing: {why}')
        return
    recording.stereo = True
    for left, right in pairs:
        _stamp(recording, left, right)


def pair_numbers(
    left_ns: Mapping[int, int], right_ns: Mapping[int, int], *, common: bool
) -> dict[int, int]:
    """Map the file numbers of right images to those of their left ones.

    Args:
        left_ns: Stamps of the left images, nanoseconds, by file number.
        right_ns: Those of the right ones.
        common: Whether a number is the same moment in both.
    """
    if common:
        return {number: number for number in right_ns if number in left_ns}
    lefts = sorted((stamp_ns, number) for number, stamp_ns in left_ns.items())
    nearest: dict[int, tuple[int, int]] = {}
    for number, stamp_ns in right_ns.items():
        place = bisect_left(lefts, (stamp_ns, 0))
        for left_stamp_ns, left in lefts[max(place - 1, 0) : place + 1]:
            found = abs(left_stamp_ns - stamp_ns), number
            if found[0] <= _FARTHEST_NS:
                nearest[left] = min(nearest.get(left, found), found)
    # A right image between two left ones is the nearest of both: it belongs to the nearer.
    best: dict[int, tuple[int, int]] = {}
    for left, (apart_ns, number) in nearest.items():
        best[number] = min(best.get(number, (apart_ns, left)), (apart_ns, left))
    return {number: left for number, (_, left) in best.items()}


def pair_stamps(
    left_ns: Mapping[int, int], right_ns: Mapping[int, int], *, common: bool
) -> dict[int, int]:
    """Map the file numbers of right images to stamps: of their left ones, else their own."""
    pairs = pair_numbers(left_ns, right_ns, common=common)
    return {
        number: left_ns[pairs[number]] if number in pairs else stamp_ns
        for number, stamp_ns in right_ns.items()
    }


def _stamp(recording: KittiRecording, left: Stream, right: Stream) -> None:
    """Stamp the right images of a pair of streams; note how far apart they are, and lone ones."""
    left_ns, right_ns = (_stamps(recording.streams[stream]) for stream in (left, right))
    pairs = pair_numbers(left_ns, right_ns, common=recording.common_numbers)
    stamps = pair_stamps(left_ns, right_ns, common=recording.common_numbers)
    recording.streams[right] = StreamIndex(
        recording.streams[right].numbers, np.array([*stamps.values()], dtype=np.int64)
    )
    moved_ms = [(left_ns[of] - right_ns[number]) / _NS_PER_MS for number, of in pairs.items()]
    if any(moved_ms):
        recording.notes.append(
            f'{right.value} has the stamps of {left.value}, {min(moved_ms):+.2f} to'
            f' {max(moved_ms):+.2f} ms from its own, in {len(pairs)} pairs'
        )
    lone = {right: right_ns.keys() - pairs.keys(), left: left_ns.keys() - {*pairs.values()}}
    for stream, numbers in lone.items():
        if numbers:
            frames = format_numbers(sorted(numbers))
            count = format_count(len(numbers), 'image')
            other = left if stream is right else right
            recording.notes.append(
                f'{stream.value} of frames {frames} ({count}) has no {other.value}:'
                f' written with its own stamp, without a pair'
            )


def _stamps(index: StreamIndex) -> dict[int, int]:
    return dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))


def _first(index: StreamIndex) -> int:
    return int(index.numbers[0])
