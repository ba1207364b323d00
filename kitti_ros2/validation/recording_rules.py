# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a recording: its folders, numbers, and what its files have in common."""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..model.boxes import UNKNOWN_OCCLUSION
from ..model.losses import format_numbers
from ..model.streams import Stream
from ..model.text import some_of
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in, breach_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ..kitti.recording import KittiRecording
    from ..model.losses import Loss

_FEW_POINTS = 0.5  # of the median; KITTI's scans have 113,000 to 127,000 points
_LEAST_SCANS = 3
_MOST_UNKNOWN = 0.5

T = TypeVar('T')
ImageShape = tuple[int, int, int]
"""Width, height and channels."""


@dataclass
class RecordingFacts:
    """What the files of a recording have in common.

    Attributes:
        recording: The recording, open.
        scans, points: The numbers of the scans, and how many points each has.
        images: The numbers of the images of each shape, by stream.
        reported: Beginnings of the reader's losses that other rules report.
        occlusions: Number of labels of each occlusion, without DontCare.
    """

    recording: KittiRecording
    scans: array[int] = field(default_factory=lambda: array('q'))
    points: array[int] = field(default_factory=lambda: array('q'))
    images: dict[Stream, dict[ImageShape, array[int]]] = field(default_factory=dict)
    reported: set[str] = field(default_factory=set)
    occlusions: Counter[int] = field(default_factory=Counter)

    def enter_scan(self, number: int, points: int) -> None:
        """Enter the number of a scan's points."""
        self.scans.append(number)
        self.points.append(points)

    def enter_image(self, stream: Stream, number: int, shape: ImageShape) -> None:
        """Enter the shape of an image."""
        self.images.setdefault(stream, {}).setdefault(shape, array('q')).append(number)

    def losses(self) -> Iterator[tuple[Loss, bool]]:
        """Yield the losses that no other rule reports; whether files are just not there."""
        for loss in self.recording.losses:
            if not loss.text().startswith(tuple(self.reported)):
                yield loss, self._is_absence(loss)

    def _is_absence(self, loss: Loss) -> bool:
        stream = Stream(loss.stream)
        listing = self.recording.listings.get(stream)
        if listing is None or not loss.numbers:
            return False
        return loss.numbers[0] not in listing.numbers


def _find_other_columns(facts: RecordingFacts) -> Iterator[Breach]:
    error = facts.recording.scan_error
    if error is not None:
        breach = breach_of(error, facts.recording.root)
        yield breach._replace(text=f'{breach.text}; {error.remedy}')


def _find_missing_frames(facts: RecordingFacts) -> Iterator[Breach]:
    for loss, absent in facts.losses():
        if absent:
            yield breach_in(loss.text(), facts.recording.root)


def _find_losses(facts: RecordingFacts) -> Iterator[Breach]:
    for loss, absent in facts.losses():
        if not absent:
            yield breach_in(loss.text(), facts.recording.root)


def _find_missing_streams(facts: RecordingFacts) -> Iterator[Breach]:
    for note in facts.recording.notes:
        if 'left out' in note and ('absent' in note or 'passed over' in note):
            yield breach_in(note, facts.recording.root)


def _find_no_stamps(facts: RecordingFacts) -> Iterator[Breach]:
    for note in facts.recording.notes:
        if 'stamps are nominal' in note:
            yield breach_in(note, facts.recording.root)


def _find_unnumbered(facts: RecordingFacts) -> Iterator[Breach]:
    for listing in facts.recording.listings.values():
        if listing.strays:
            text = f'{some_of(listing.strays)}; names are like {listing.names.example}'
            yield Breach(text, listing.folder)


def _find_sparse(facts: RecordingFacts) -> Iterator[Breach]:
    if len(facts.points) < _LEAST_SCANS:
        return
    counts = np.array(facts.points, np.int64)
    usual = float(np.median(counts))
    for index in np.flatnonzero(counts < _FEW_POINTS * usual).tolist():
        text = f'{counts[index]} points; the median of the scans is {usual:.0f}'
        yield Breach(text, facts.recording.path(Stream.SCAN, facts.scans[index]))


def _find_other_size(facts: RecordingFacts) -> Iterator[Breach]:
    if facts.recording.layout.traits.calibration_per_frame:
        return
    for stream, shapes in facts.images.items():
        camera = facts.recording.calibration(0).cameras.get(stream.camera or 0)
        usual = _most_common({shape: shape[:2] for shape in shapes}, shapes)
        stated = None if camera is None else camera.size
        expected, source = (usual, 'other images') if stated is None else (stated, 'calibration')
        for (width, height, _), numbers in shapes.items():
            for number in numbers if (width, height) != expected else ():
                text = f'{width}x{height}; {source}: {expected[0]}x{expected[1]}'
                yield Breach(text, facts.recording.path(stream, number))


def _find_other_channels(facts: RecordingFacts) -> Iterator[Breach]:
    for stream, shapes in facts.images.items():
        usual = _most_common({shape: shape[2] for shape in shapes}, shapes)
        for (_, _, channels), numbers in shapes.items():
            for number in numbers if channels != usual else ():
                text = f'{channels} channels; most images of the camera have {usual}'
                yield Breach(text, facts.recording.path(stream, number))


def _most_common(kinds: Mapping[ImageShape, T], shapes: Mapping[ImageShape, array[int]]) -> T:
    """Return the kind of most images."""
    counts: Counter[T] = Counter()
    for shape, numbers in shapes.items():
        counts[kinds[shape]] += len(numbers)
    return counts.most_common(1)[0][0]


def _find_unlabelled_frames(facts: RecordingFacts) -> Iterator[Breach]:
    """Find labels of frames that have neither an image nor a scan."""
    streams = facts.recording.streams
    data = [
        index.numbers
        for stream, index in streams.items()
        if stream is Stream.SCAN or stream.camera is not None
    ]
    if Stream.LABELS not in streams or not data:
        return
    labelled = streams[Stream.LABELS].numbers
    without = np.setdiff1d(labelled, np.concatenate(data)).tolist()
    if without:
        path = facts.recording.path(Stream.LABELS, without[0])
        yield Breach(f'labels of frames {format_numbers(without)}, which have no data', path)


def _find_unknown_occlusion(facts: RecordingFacts) -> Iterator[Breach]:
    """Find labels that evaluations leave out; single ones are usual in KITTI."""
    unknown, every = facts.occlusions[UNKNOWN_OCCLUSION], facts.occlusions.total()
    if unknown > _MOST_UNKNOWN * every:
        labels = facts.recording.streams[Stream.LABELS]
        path = facts.recording.path(Stream.LABELS, int(labels.numbers[0]))
        yield Breach(f'{unknown} of {every} labels have occlusion {UNKNOWN_OCCLUSION}', path)


_RECORDING = RuleScope.RECORDING
_ERROR = RuleSeverity.ERROR
_WARNING = RuleSeverity.WARNING
_NOTE = RuleSeverity.NOTE

RECORDING_RULES: tuple[Rule[RecordingFacts], ...] = (
    Rule(
        'data-unusable',
        _ERROR,
        _RECORDING,
        'Every file can be used: it has a stamp, its lines are of frames',
        'the conversion skips these data: correct or complete the file',
        _find_losses,
    ),
    Rule(
        'image-size',
        _ERROR,
        _RECORDING,
        'Images have the size in the calibration, or that of the other images of the camera',
        'calibration holds for one size only: copy the images of this camera again',
        _find_other_size,
    ),
    Rule(
        'scan-columns',
        RuleSeverity.ERROR,
        RuleScope.STREAM,
        'Scans have 4 float32 a point, by the size and values of the first ones',
        'give --columns, or convert them; until then they are not checked',
        _find_other_columns,
    ),
    Rule(
        'frames-missing',
        _WARNING,
        _RECORDING,
        'Streams have the same numbers, and those of their time stamps',
        'copy the missing files; KITTI itself has gaps, such as 177 to 180 of drive 0009',
        _find_missing_frames,
    ),
    Rule(
        'names-unusual',
        _WARNING,
        RuleScope.STREAM,
        'Files are named like the others in their folder',
        'rename or move them; they are not read',
        _find_unnumbered,
    ),
    Rule(
        'scan-points',
        _WARNING,
        RuleScope.STREAM,
        'Scans have at least half as many points as the median',
        'compare with the source: the file may be cut off',
        _find_sparse,
    ),
    Rule(
        'image-channels',
        _WARNING,
        RuleScope.STREAM,
        'Images of a camera are all grey or all coloured',
        'copy the images of this camera again',
        _find_other_channels,
    ),
    Rule(
        'label-frame',
        _WARNING,
        _RECORDING,
        'Labelled frames have an image or a scan',
        'check the frame numbers of the labels; copy the missing files',
        _find_unlabelled_frames,
    ),
    Rule(
        'label-occlusion',
        _WARNING,
        _RECORDING,
        'The occlusion of most labels is known, or 0',
        'evaluations leave out labels with 3, unknown: write 0 for visible objects',
        _find_unknown_occlusion,
    ),
    Rule(
        'stream-missing',
        _NOTE,
        _RECORDING,
        'The usual streams of the layout exist',
        'download the archive with them, if they are needed',
        _find_missing_streams,
    ),
    Rule(
        'stamps-missing',
        _NOTE,
        _RECORDING,
        'Layouts with time have time stamps',
        'download the archive with them; --period sets the time between frames',
        _find_no_stamps,
    ),
)
