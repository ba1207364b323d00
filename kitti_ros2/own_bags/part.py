# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Part of the recording in a bag written by to-bag, from a first to a last frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..bags.reader import bag_stamps, path_of
from ..exporter.window import select_window
from ..model.errors import UsageError
from ..model.recording import StreamIndex
from ..model.streams import FRAME_STREAMS, Stream
from ..options.selection import Bound
from .numbering import has_common_numbers, number_bag
from .stamp_numbers import StampNumbers

if TYPE_CHECKING:
    from ..bags.reader import BagSource
    from ..model.samples import Int64Array
    from ..options.selection import SelectionOptions
    from .blueprint import Blueprint


def select_part(source: BagSource, blueprint: Blueprint, selection: SelectionOptions) -> Blueprint:
    """Return a layout whose selected files are those that to-bag writes for a selection.

    Raises:
        UsageError: The selection contains none of its frames.
    """
    if selection.is_whole:
        return blueprint
    mapped = StampNumbers(blueprint)
    streams = {}
    for stream in dict.fromkeys((*FRAME_STREAMS, *blueprint.folders)):
        stamps_ns, numbers = mapped.pairs(stream)
        if len(numbers):
            streams[stream] = StreamIndex(numbers, stamps_ns)
    if not streams:
        raise nothing_selected(source, np.empty(0, np.int64))
    window = select_window(streams, selection, common=has_common_numbers(blueprint))
    selected = {
        stream: frozenset(index.numbers[window.takes(index)].tolist())
        for stream, index in streams.items()
    }
    frames = [stream for stream in FRAME_STREAMS if stream in streams]
    if not any(selected[stream] for stream in frames):
        numbers = np.concatenate([np.empty(0, np.int64), *(streams[s].numbers for s in frames)])
        raise nothing_selected(source, numbers)
    calibrations = blueprint.calibrations
    folder = blueprint.folders.get(Stream.CALIBRATION)
    if folder is not None:
        kept = {folder.file(number) for number in selected.get(Stream.CALIBRATION, ())}
        calibrations = {path: text for path, text in calibrations.items() if path in kept}
    return replace(blueprint, selected=selected, calibrations=calibrations)


def select_times(
    source: BagSource, blueprint: Blueprint, topic: str, selection: SelectionOptions
) -> SelectionOptions:
    """Return a selection with the stamps of a topic's samples in place of KITTI's file numbers.

    Raises:
        UsageError: The topic has no sample of these numbers.
    """
    numbered = number_bag(source, bag_stamps(source), blueprint=blueprint)
    found = None if numbered is None else numbered.topics.get(topic)
    if found is None or not found.is_numbered:
        return selection
    bounds: list[Bound | None] = []
    for bound, compare, outer in (
        (selection.start, np.greater_equal, np.min),
        (selection.end, np.less_equal, np.max),
    ):
        if bound is not None and bound.frame is not None:
            stamps_ns = found.stamps_ns[compare(found.numbers, bound.frame)]
            if not len(stamps_ns):
                raise nothing_selected(source, found.numbers)
            bounds.append(Bound(stamp_ns=int(outer(stamps_ns))))
        else:
            bounds.append(bound)
    return replace(selection, start=bounds[0], end=bounds[1])


def nothing_selected(source: BagSource, numbers: Int64Array) -> UsageError:
    """Return the error for a selection without frames."""
    span = f'frames {numbers.min()} to {numbers.max()}' if len(numbers) else 'no numbered frames'
    return UsageError(f'{path_of(source)}: the selection takes no frame; it has {span}')
