# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's file numbers by stamp, from the folders and text files of a recording in a bag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from ..exporter.schedule import UNKNOWN
from ..kitti import names
from ..kitti.layout_files import LAYOUTS
from ..kitti.tracklet_file import cuboids_by_frame, parse_tracklets
from ..model.errors import BadFileError
from ..model.losses import Loss
from ..model.streams import Clock, Stream
from .folders import Folder

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ..model.boxes import Cuboid
    from ..model.samples import Int64Array
    from .blueprint import Blueprint


class StampNumbers:
    """Maps stamps to file numbers, by stream."""

    def __init__(self, blueprint: Blueprint) -> None:
        self.blueprint = blueprint
        self._sorted: dict[Stream, tuple[Int64Array, Int64Array]] = {}

    def of(self, stream: Stream, stamps_ns: Int64Array) -> Int64Array:
        """Return (N,) numbers of (N,) ascending stamps; equal stamps get theirs in order."""
        known, numbers = self.pairs(stream)
        first, after = (np.searchsorted(known, stamps_ns, side) for side in ('left', 'right'))
        turn = np.arange(len(stamps_ns)) - np.searchsorted(stamps_ns, stamps_ns)
        found = np.full(len(stamps_ns), UNKNOWN, dtype=np.int64)
        is_known = after > first
        found[is_known] = numbers[np.minimum(first + turn, after - 1)[is_known]]
        return found

    def pairs(self, stream: Stream) -> tuple[Int64Array, Int64Array]:
        """Return the stamps of a stream's messages, ascending, and the number of each."""
        if stream not in self._sorted:
            mapping = _with_folder(self.blueprint, stream).numbers_by_stamp(stream) or {}
            pairs = sorted((stamp, n) for stamp, several in mapping.items() for n in several)
            table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
            self._sorted[stream] = (table[:, 0], table[:, 1])
        return self._sorted[stream]


def _with_folder(blueprint: Blueprint, stream: Stream) -> Blueprint:
    """Add a substitute for the folder of a stream stored in a common file, beside its stamps."""
    if stream in blueprint.folders:
        return blueprint
    if stream is Stream.POSE and Stream.OXTS in blueprint.folders:
        folder = blueprint.folders[Stream.OXTS]
    elif blueprint.layout.traits.tracklets:
        folder = _substitute(_tracklet_stamps(blueprint), sorted(tracklets_of(blueprint)))
    else:
        stamps = LAYOUTS[blueprint.layout].stamps
        path = next((path for path in blueprint.texts if path.name == stamps), PurePosixPath())
        folder = _substitute(path, _lines(blueprint, stream))
    return replace(blueprint, folders={**blueprint.folders, stream: folder})


def _substitute(stamps: PurePosixPath, numbers: Iterable[int]) -> Folder:
    """Return a folder without files of its own, in the folder of a file of stamps."""
    found = tuple(numbers)
    return Folder(stamps, names.SIX_DIGITS, found, found)


def _tracklet_stamps(blueprint: Blueprint) -> PurePosixPath:
    """Return the file whose stamps tracklets use: see RawRecording."""
    scans = blueprint.folders.get(Stream.SCAN)
    if scans is not None and scans.numbers:
        return blueprint.stamps_path(Stream.SCAN)
    drives = (path.parent for path in blueprint.texts if path.name == names.RAW_TRACKLETS)
    return next(drives, PurePosixPath()) / names.RAW_LABEL_STAMPS


def tracklets_of(blueprint: Blueprint) -> dict[int, list[Cuboid]]:
    """Return the boxes of a raw drive by frame, from the tracklets in its bag; {} if invalid."""
    for path, text in blueprint.texts.items():
        if path.name == names.RAW_TRACKLETS:
            try:
                return cuboids_by_frame(parse_tracklets(text.encode(), Path(path)))
            except BadFileError:
                break  # to-bag has reported it, and made no labels of it
    return {}


def tracklets_by_stamp(blueprints: Iterable[Blueprint]) -> dict[int, dict[int, Cuboid]]:
    """Return the boxes of raw drives by the stamp of their frame's message, and by track."""
    found: dict[int, dict[int, Cuboid]] = {}
    for blueprint in blueprints:
        boxes = tracklets_of(blueprint)
        if boxes:
            stamps, numbers = StampNumbers(blueprint).pairs(Stream.LABELS)
            for stamp_ns, number in zip(stamps.tolist(), numbers.tolist(), strict=True):
                found[stamp_ns] = {
                    each.track_id: each for each in boxes[number] if each.track_id is not None
                }
    return found


def absent_frames(blueprint: Blueprint) -> tuple[Loss, ...]:
    """Return the frames that the recording has no file of, as its folder reports them.

    They are those that the stream's file of stamps lists, or without one those that other streams
    have. Of a bag of a part of the recording they are those within that part.
    """
    folders = blueprint.folders
    carried = [number for folder in folders.values() for number in folder.carried]
    if blueprint.times is not None or not carried:
        return ()
    partial = any(folder.carried != folder.numbers for folder in folders.values())
    span = {*range(min(carried), max(carried) + 1)} if partial else None
    lines = blueprint.layout.traits.line_streams - {Stream.LABELS}
    common = {n for stream in lines for n in _lines(blueprint, stream)}
    common.update(*(folder.numbers for folder in folders.values()))
    losses = []
    for stream, folder in folders.items():
        listed = _listed(blueprint, stream)
        found = sorted((common if listed is None else listed).difference(folder.numbers))
        absent = tuple(found if span is None else (number for number in found if number in span))
        # A stream that has files here, and none in the bag, was not selected.
        has_no_file = listed is not None and not (span or listed).intersection(folder.numbers)
        if absent and (folder.carried or has_no_file):
            text = f'{folder.path}: no {stream.value} for frames {{}}, which other streams have'
            if listed is not None:
                name = blueprint.stamps_path(stream).name
                text = f'{folder.path}: no file for frames {{}}, which {name} lists'
            losses.append(Loss(stream.value, len(absent), text, absent))
    return tuple(losses)


def _listed(blueprint: Blueprint, stream: Stream) -> set[int] | None:
    """Return the numbers that a stream's file of stamps lists; None without the file."""
    path = blueprint.stamps_path(stream)
    if blueprint.layout.traits.clock is Clock.NOMINAL or path not in blueprint.texts:
        return None
    return {*(blueprint.file_stamps(stream) or ())}


def _lines(blueprint: Blueprint, stream: Stream) -> Iterable[int]:
    """Return the frames with lines in the common file of a stream, ascending."""
    folder = LAYOUTS[blueprint.layout].line_folders.get(stream)
    for path, text in blueprint.texts.items():
        if folder in {path.parent.name, path.stem}:
            lines = text.splitlines()
            return sorted({*row_frames(lines)}) if stream is Stream.LABELS else range(len(lines))
    return ()


def row_frames(lines: Iterable[str]) -> Iterator[int]:
    """Yield the frame at the beginning of each row of a tracking label file."""
    for line in lines:
        word = line.split(maxsplit=1)[0] if line.strip() else ''
        if word.isdecimal() and len(word) <= names.FRAME_DIGITS:
            yield int(word)
