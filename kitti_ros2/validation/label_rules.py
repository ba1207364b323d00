# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a label file: what the devkits' readme.txt allow, and what contradicts itself.

Limits, from tracking 0000 (1089 rows) and object 000000..2: objects are up to 13 m long, tracks
move at most 0.9 m a frame relative to the car, so 15 m is far beyond oncoming traffic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from ..kitti.label_file import parse_labels
from ..model.boxes import DONT_CARE, has_cuboid, is_absurd
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.errors import BadFileError

CLASSES = frozenset(
    {'Car', 'Van', 'Truck', 'Pedestrian', 'Person_sitting', 'Cyclist', 'Tram', 'Misc', DONT_CARE}
)
"""The classes of KITTI (source: readme.txt of the object devkit)."""
_ALSO = {'Person': 'Person_sitting'}  # the name in tracking
_ANGLE = math.pi + 0.01  # two decimals round pi up
_FARTHEST_M = 10_000.0
_LONGEST_M = 100.0
_JUMP_M = 15.0
_OCCLUDED = range(-1, 4)
_TRUNCATED_LEVELS = (-1, 0, 1, 2)


class LabelLine(NamedTuple):
    """A labelled object with its line in the file, from 1."""

    line: int
    box: Box


@dataclass(frozen=True)
class LabelFile:
    """A parsed label file.

    Attributes:
        path: The file.
        lines: The valid lines.
        errors: Those of the invalid lines.
        tracking: Whether it is a tracking file, of many frames.
    """

    path: Path
    lines: Sequence[LabelLine]
    errors: Sequence[BadFileError] = ()
    tracking: bool = False
    by_frame: dict[int | None, list[LabelLine]] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str, path: Path, *, tracking: bool = False) -> LabelFile:
        """Parse the text of a file."""
        parsed = parse_labels(text, path)
        lines = [LabelLine(line + 1, box) for line, box in parsed.sound().items()]
        by_frame: dict[int | None, list[LabelLine]] = {}
        for each in lines:
            by_frame.setdefault(each.box.frame, []).append(each)
        return cls(path, lines, tuple(parsed.errors.values()), tracking, by_frame)


def _find_invalid_labels(file: LabelFile) -> Iterator[Breach]:
    for error in file.errors:
        yield breach_of(error, file.path)


def _find_columns(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if (box.frame is not None) != file.tracking:
            kinds = ('an object', 'a tracking') if file.tracking else ('a tracking', 'an object')
            text = f'a line of {kinds[0]} file; expected {kinds[1]} file'
            yield Breach(text, file.path, line)


def _find_levels(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if box.occluded not in _OCCLUDED:
            yield Breach(f'{box.class_name}: occluded is {box.occluded}', file.path, line)
        levels = box.truncated in _TRUNCATED_LEVELS
        if not (levels if file.tracking else 0 <= box.truncated <= 1 or box.truncated == -1):
            yield Breach(f'{box.class_name}: truncated is {box.truncated:g}', file.path, line)


def _find_angles(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        for name, angle in (('alpha', box.alpha), ('rotation_y', box.rotation_y)):
            if abs(angle) > _ANGLE and angle != -10:
                yield Breach(f'{box.class_name}: {name} is {angle:g}', file.path, line)


def _find_box_2d(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        left, top, right, bottom = box.box_2d
        if right < left or bottom < top:
            numbers = ' '.join(f'{value:g}' for value in box.box_2d)
            yield Breach(f'{box.class_name}: the 2D box is {numbers}', file.path, line)


def _find_sizes(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if is_absurd(box) or max(box.size_hwl) > _LONGEST_M:
            numbers = ' '.join(f'{value:g}' for value in box.size_hwl)
            yield Breach(f'{box.class_name}: height, width, length are {numbers}', file.path, line)


def _find_far(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if max(map(abs, box.location)) > _FARTHEST_M:
            numbers = ' '.join(f'{value:g}' for value in box.location)
            yield Breach(f'{box.class_name}: the location is {numbers}', file.path, line)


def _find_classes(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if box.class_name in CLASSES:
            continue
        meant = _KNOWN.get(_plain(box.class_name), box.class_name)
        if meant != box.class_name:
            yield Breach(f'{box.class_name}: did you mean {meant}?', file.path, line)


def _plain(name: str) -> str:
    return ''.join(filter(str.isalnum, name)).lower()


_KNOWN = {_plain(name): name for name in (*CLASSES, *_ALSO)}
"""The names that others may resemble."""


def _find_repeated(file: LabelFile) -> Iterator[Breach]:
    seen: dict[Box, int] = {}
    for line, box in file.lines:
        first = seen.setdefault(box, line)
        if first != line:
            yield Breach(f'{box.class_name}: the same object as in line {first}', file.path, line)


def _find_repeated_tracks(file: LabelFile) -> Iterator[Breach]:
    seen: dict[tuple[int | None, int | None], int] = {}
    for line, box in file.lines:
        if box.track_id is None or box.track_id < 0:
            continue
        first = seen.setdefault((box.frame, box.track_id), line)
        if first != line:
            text = f'{box.class_name}: track {box.track_id} is in frame {box.frame} twice'
            yield Breach(f'{text}, first in line {first}', file.path, line)


def _find_changing_tracks(file: LabelFile) -> Iterator[Breach]:
    for before, (line, box) in _successors(file):
        if before.class_name != box.class_name:
            text = f'track {box.track_id} changes from {before.class_name} to {box.class_name}'
            yield Breach(text, file.path, line)


def _find_jumps(file: LabelFile) -> Iterator[Breach]:
    for before, (line, box) in _successors(file):
        frames = (box.frame or 0) - (before.frame or 0)
        if frames > 0 and has_cuboid(box) and has_cuboid(before):
            moved = math.dist(before.location, box.location)
            if moved > _JUMP_M * frames:
                text = (
                    f'{box.class_name}: track {box.track_id} moves {moved:.0f} m in {frames} frame'
                )
                yield Breach(text + ('s' if frames > 1 else ''), file.path, line)


def _successors(file: LabelFile) -> Iterator[tuple[Box, LabelLine]]:
    """Yield each line of a track with the box of the track before it."""
    tracks: dict[int, list[LabelLine]] = {}
    for each in file.lines if file.tracking else ():
        if each.box.track_id is not None and each.box.track_id >= 0:
            tracks.setdefault(each.box.track_id, []).append(each)
    for lines in tracks.values():
        ordered = sorted(lines, key=lambda each: each.box.frame or 0)
        for before, after in pairwise(ordered):
            yield before.box, after


_FILE = RuleScope.FILE
_ERROR = RuleSeverity.ERROR
_WARNING = RuleSeverity.WARNING
_CORRECT = 'correct the line, or label the object again'

LABEL_RULES: tuple[Rule[LabelFile], ...] = (
    Rule(
        'label-line',
        _ERROR,
        _FILE,
        'Lines of labels have 15 or 16 columns (tracking 17 or 18) of finite numbers',
        _CORRECT,
        _find_invalid_labels,
    ),
    Rule(
        'label-columns',
        _ERROR,
        _FILE,
        'Object files have lines of objects, tracking files lines with frame and track',
        'give the label file of the same benchmark',
        _find_columns,
    ),
    Rule(
        'label-level',
        _ERROR,
        _FILE,
        'occluded is -1 to 3; truncated is 0 to 1 or -1, in tracking -1 to 2',
        _CORRECT,
        _find_levels,
    ),
    Rule(
        'label-angle',
        _WARNING,
        _FILE,
        'alpha and rotation_y are within -pi to pi, or -10 if unknown',
        'wrap the angle; radians, not degrees',
        _find_angles,
    ),
    Rule(
        'label-box',
        _ERROR,
        _FILE,
        '2D boxes are left, top, right, bottom',
        'check the order; KITTI has corners, not width and height',
        _find_box_2d,
    ),
    Rule(
        'label-size',
        _ERROR,
        _FILE,
        'Height, width and length are positive, below 100 m',
        'check the order (height, width, length) and the unit (metres)',
        _find_sizes,
    ),
    Rule(
        'label-location',
        _ERROR,
        _FILE,
        'Locations are within 10 km',
        'check the unit (metres) and the frame (rectified camera 0)',
        _find_far,
    ),
    Rule(
        'label-class',
        _WARNING,
        _FILE,
        'Class names that resemble those of KITTI are spelled as there',
        'evaluations compare names exactly: rename the class',
        _find_classes,
    ),
    Rule(
        'label-repeated',
        _WARNING,
        _FILE,
        'No object is listed twice in a frame',
        'remove one of the lines',
        _find_repeated,
    ),
    Rule(
        'track-repeated',
        _ERROR,
        _FILE,
        'No track is twice in a frame',
        'give one of the objects a track id of its own',
        _find_repeated_tracks,
    ),
    Rule(
        'track-class',
        _WARNING,
        _FILE,
        'Tracks keep their class',
        'correct the class, or give the second object a track id of its own',
        _find_changing_tracks,
    ),
    Rule(
        'track-jump',
        _WARNING,
        _FILE,
        'Tracks move at most 15 m a frame',
        'correct the location, or the frame number',
        _find_jumps,
    ),
)
