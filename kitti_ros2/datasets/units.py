# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The units that lists of a data set name: frames of an object set, else sequences or drives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..exporter.schedule import frames_of
from ..kitti import names
from ..kitti.find import absolute
from ..kitti.layouts import find_candidates
from ..kitti.object_mapping import find_mapping
from ..model.errors import NotKittiError, UsageError
from ..model.losses import Loss
from ..options.read import ReadOptions

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..kitti.find import Candidate
    from ..kitti.object_mapping import ObjectMapping
    from ..kitti.recording import KittiRecording
    from ..model.layouts import Layout
    from ..model.samples import Int64Array

TEST = 'test'
"""Lists of an object set whose names begin so are of its testing frames."""


@dataclass(frozen=True)
class Unit:
    """What a line of a list names.

    Attributes:
        name: The line.
        frames: Number of frames.
        drive: The raw drive, None if it is unknown.
        number: The file number of a frame in its drive, None if it is unknown.
    """

    name: str
    frames: int = 1
    drive: str | None = None
    number: int | None = None


@dataclass(frozen=True)
class UnitSet:
    """The units of a data set.

    Attributes:
        layout: Its layout.
        folder: The folder in which ImageSets lies.
        noun: frame, sequence or drive.
        units: By name.
        testing: Those of the testing frames of an object set; None if they are not there, or if
            the set itself is of them.
        losses: Missing data.
        notes: Remarks.
        frames, testing_frames: How the frames of an object set are named.
    """

    layout: Layout
    folder: Path
    noun: str
    units: dict[str, Unit]
    testing: dict[str, Unit] | None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    frames: names.FileNames = names.SIX_DIGITS
    testing_frames: names.FileNames = names.SIX_DIGITS

    @property
    def lists_frames(self) -> bool:
        """Whether a unit is a frame."""
        return self.layout.traits.frame_set

    def is_of_testing(self, name: str) -> bool:
        """Whether a list of a name is of the testing frames beside the training frames."""
        return self.lists_frames and self.testing is not self.units and name.startswith(TEST)


def find_units(
    path: Path, layout: Layout | None, mapping: Path | None, *, by_drive: bool
) -> UnitSet:
    """List the units of a data set.

    Args:
        path: The set.
        layout: None detects it.
        mapping: The folder of the object devkit's mapping; None searches beside the set.
        by_drive: Whether the drive of each frame is needed.

    Raises:
        UsageError: There is nothing to divide, or no mapping where it is needed.
        KittiRos2Error, OSError: It cannot be read.
    """
    layout, candidates = _find(path, layout)
    if layout.traits.frame_set:
        return _frames(layout, candidates, mapping, by_drive=by_drive)
    if mapping is not None or by_drive:
        flag = '--by-drive' if by_drive else '--mapping'
        noun = layout.traits.noun
        raise UsageError(f'{path}: {flag} is for object sets; here each {noun} stays whole')
    return _recordings(path, layout, candidates)


def _find(path: Path, layout: Layout | None) -> tuple[Layout, list[Candidate]]:
    try:
        return find_candidates(path, ReadOptions(layout=layout))
    except NotKittiError as error:
        from ..bags.mistaken import explain_no_folder  # noqa: PLC0415 - for errors only

        raise explain_no_folder(path, error, forced=layout is not None) from None


def _frames(
    layout: Layout, candidates: list[Candidate], given: Path | None, *, by_drive: bool
) -> UnitSet:
    """List the frames of an object set: those of training, if there are any."""
    recordings = {each.name: each.open(ReadOptions()) for each in candidates}
    chosen = recordings[candidates[0].name]
    is_testing = chosen.name == names.SPLITS[1]
    mapping: ObjectMapping | None = None
    notes: tuple[str, ...] = ()
    if not is_testing:
        mapping, notes = _mapping(chosen.root, given, needed=by_drive)
    elif by_drive:
        raise UsageError(f'{chosen.root}: the devkit has the drives of training frames only')
    units = _units_of(chosen, mapping)
    losses = list(chosen.losses)
    if by_drive and mapping is not None:
        losses += _beyond(units, mapping, chosen.file_names)
        units = {name: unit for name, unit in units.items() if unit.drive is not None}
    other = recordings.get(names.SPLITS[1])
    testing = units if is_testing else None if other is None else _units_of(other, None)
    frames = chosen.file_names
    others = frames if other is None else other.file_names
    found = tuple(losses)
    return UnitSet(layout, chosen.root, 'frame', units, testing, found, notes, frames, others)


def _beyond(
    units: Mapping[str, Unit], mapping: ObjectMapping, frames: names.FileNames
) -> list[Loss]:
    """Return the frames without a drive, which are in no list."""
    numbers = tuple(frames.number(each.name) or 0 for each in units.values() if not each.drive)
    reason = mapping.beyond.replace('{', '(').replace('}', ')')
    text = f'{reason}; in no list: frames {{}}'
    return [Loss('frames', len(numbers), text, numbers)] if numbers else []


def _mapping(
    root: Path, given: Path | None, *, needed: bool
) -> tuple[ObjectMapping | None, tuple[str, ...]]:
    """Read the mapping; where it is not needed, none is a note."""
    try:
        return find_mapping(root, given), ()
    except UsageError as error:
        if needed or given is not None:
            raise
        return None, (f'drives in more than one list are not looked for: {error}',)


def _numbers(recording: KittiRecording) -> Int64Array:
    numbers = {stream: index.numbers for stream, index in recording.streams.items()}
    return frames_of(numbers, common=recording.common_numbers)


def _units_of(recording: KittiRecording, mapping: ObjectMapping | None) -> dict[str, Unit]:
    units = {}
    for number in _numbers(recording).tolist():
        name = recording.file_names.stem(number)
        origin = None if mapping is None else mapping.get(number)
        units[name] = Unit(name) if origin is None else Unit(name, 1, origin.drive, origin.number)
    return units


def _recordings(path: Path, layout: Layout, candidates: list[Candidate]) -> UnitSet:
    """List the sequences or drives of a set, without those of testing."""
    training = [each for each in candidates if '/' not in each.name] or candidates
    units, losses = {}, []
    for each in training:
        recording = each.open(ReadOptions())
        name = each.name.rpartition('/')[2]
        losses += recording.losses
        frames = len(_numbers(recording))
        if frames:
            units[name] = Unit(name, frames, names.drive_of(name))
    folder = absolute(path)
    if folder.name in {*names.SPLITS, names.SEQUENCES}:
        folder = folder.parent
    return UnitSet(layout, folder, layout.traits.noun, units, None, tuple(losses))
