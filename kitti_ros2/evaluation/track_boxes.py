# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The boxes of tracks that are compared: of label_02, of a tracker's files, or of a bag."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from ..kitti.label_file import parse_labels
from ..kitti.store import STORE
from ..model.boxes import DONT_CARE
from ..model.errors import BadFileError
from ..model.losses import Loss
from .class_map import CLASSES

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Mapping, Sequence
    from pathlib import Path

    from ..model.boxes import Box
    from .class_map import ClassMap

SCORED = ('car', 'pedestrian')
"""The classes of KITTI's tracking benchmark."""

TRACKER_CLASSES = (*CLASSES, 'Person', DONT_CARE)
"""Classes that a tracker's lines may have."""

_REGION = 'dontcare'
_OF_TRUTH = {
    'car': 'car',
    'van': 'van',
    'pedestrian': 'pedestrian',
    'person': 'person',
    'person_sitting': 'person',
    _REGION: _REGION,
}
"""By class of a label that of TrackEval; other labels have no part in the benchmark."""


class TrackBox(NamedTuple):
    """A box with the class that TrackEval knows."""

    class_name: str
    frame: int
    track_id: int
    box: Box


class TrackBoxes(NamedTuple):
    """The boxes of a sequence.

    Attributes:
        boxes: Of classes that have a part in the benchmark.
        losses: Lines that could not be used.
        others: Number of boxes of KITTI's other classes.
    """

    boxes: Sequence[TrackBox]
    losses: tuple[Loss, ...] = ()
    others: int = 0

    def among(self, numbers: Container[int] | None) -> TrackBoxes:
        """Return the same with the boxes of some frames only; None is all."""
        if numbers is None:
            return self
        return self._replace(boxes=[each for each in self.boxes if each.frame in numbers])


def read_truth(path: Path, length: int) -> TrackBoxes:
    """Read the labels of a sequence.

    Args:
        path: A file of label_02.
        length: Number of frames of the sequence.

    Raises:
        BadFileError: The file is no text, or a track has two boxes in a frame.
        OSError: It cannot be read.
    """
    rows, losses = _read_rows(path, 'ground truth')
    found = [(row, box, _OF_TRUTH.get(box.class_name.lower(), '')) for row, box in rows.items()]
    regions = [_made(box, name) for _, box, name in found if name == _REGION]
    objects = [each for each in found if each[2] not in {'', _REGION}]
    kept, lost = _tracked(objects, path, 'ground truth', length)
    inside = [each for each in regions if 0 <= each.frame < length]
    return TrackBoxes([*inside, *kept], (*losses, *lost))


def read_tracks(path: Path, length: int, classes: ClassMap) -> TrackBoxes:
    """Read a tracker's file.

    Args:
        path: Lines as in label_02, maybe with a score.
        length: Number of frames of the sequence.
        classes: Maps the classes.

    Raises:
        BadFileError: The file is no text, or a track has two boxes in a frame.
        OSError: It cannot be read.
    """
    rows, losses = _read_rows(path, 'tracks')
    found = [(row, box, classes.find(box.class_name).lower()) for row, box in rows.items()]
    return _scored(found, losses, path, length)


def tracks_of_frames(frames: Mapping[int, Iterable[Box]], source: Path, length: int) -> TrackBoxes:
    """Return the tracks of results by frame.

    Raises:
        BadFileError: A track has two boxes in a frame.
    """
    found = [(-1, box, box.class_name.lower()) for boxes in frames.values() for box in boxes]
    return _scored(found, [], source, length)


def _scored(
    found: Sequence[tuple[int, Box, str]], losses: Sequence[Loss], path: Path, length: int
) -> TrackBoxes:
    known = [each for each in found if each[2] in SCORED]
    kept, lost = _tracked(known, path, 'tracks', length)
    others = sum(name not in {'', _REGION, *SCORED} for _, _, name in found)
    return TrackBoxes(kept, (*losses, *lost), others)


def _read_rows(path: Path, stream: str) -> tuple[dict[int, Box], list[Loss]]:
    """Return the valid lines of a file by row, and the others as losses.

    Raises:
        BadFileError: A line is a label without frame and track.
    """
    lines = parse_labels(STORE.read_text(path), path)
    rows = lines.sound()
    for row, box in rows.items():
        if box.frame is None:
            expected = '17 or 18 columns: frame, track id, class, ... as in label_02'
            raise BadFileError(path, 'no frame and no track id', expected, line=row + 1)
    losses = [Loss(stream, 1, _plain(str(error))) for error in lines.errors.values()]
    return rows, losses


def _tracked(
    found: Iterable[tuple[int, Box, str]], path: Path, stream: str, length: int
) -> tuple[list[TrackBox], list[Loss]]:
    """Return the boxes with a track in a frame of the sequence, and the others as losses.

    Args:
        found: Row, box and class of TrackEval.
        path: For errors.
        stream: For losses.
        length: Number of frames of the sequence.

    Raises:
        BadFileError: A track has two boxes in a frame.
    """
    kept: dict[tuple[str, int, int], TrackBox] = {}
    untracked, beyond = 0, Counter[int]()
    for row, box, name in found:
        made = _made(box, name)
        if made.track_id < 0:
            untracked += 1
        elif not 0 <= made.frame < length:
            beyond[made.frame] += 1
        elif kept.setdefault(made[:3], made) is not made:
            raise BadFileError(
                path,
                f'track {made.track_id} of class {box.class_name} has two boxes in frame'
                f' {made.frame}',
                'one box of a track in a frame',
                line=row + 1 if row >= 0 else None,
            )
    name, numbers = _plain(str(path)), tuple(sorted(beyond))
    outside = f'{name}: boxes in frames {{}}; the sequence has {length} frames'
    lost = [
        Loss(stream, untracked, f'{name}: boxes with a track id below 0'),
        Loss(stream, beyond.total(), outside, numbers),
    ]
    return list(kept.values()), [loss for loss in lost if loss.count]


def _made(box: Box, class_name: str) -> TrackBox:
    track_id = -1 if box.track_id is None else box.track_id
    return TrackBox(class_name, -1 if box.frame is None else box.frame, track_id, box)


def _plain(text: str) -> str:
    """Return a text without braces, which stand for frame numbers in losses."""
    return text.replace('{', '(').replace('}', ')')
