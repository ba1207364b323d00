# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""TrackEval's figures for tracks: HOTA, CLEAR-MOT and IDF1, by its class for KITTI's 2D boxes.

The rules of the benchmark are those of TrackEval (Luiten et al., IJCV 2021), kitti_2d_box.py:
vans and sitting people are distractors, whose matches are removed; so are labels with a truncation
above 0 or an occlusion above 2; unmatched boxes that are at most 25 px high, or more than half
inside a DontCare region, are removed. A box matches a label with an IoU of at least 0.5.

The boxes are written to temporary files in KITTI's format, with all digits of their numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from contextlib import redirect_stdout
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ..kitti.label_file import parse_labels
from ..kitti.store import STORE
from ..model.boxes import DONT_CARE
from ..model.errors import BadFileError, Loss, MissingDataError, UsageError, some_of

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable, Mapping, Sequence

    from ..model.boxes import Box


# Mapping of the classes of results to KITTI's.

CLASSES = ('Car', 'Van', 'Truck', 'Pedestrian', 'Person_sitting', 'Cyclist', 'Tram', 'Misc')
"""The classes of KITTI's labels; those of tracking have Person for Person_sitting."""

_OTHERS = '*'
_SHOWN = 5
_PUNCTUATION = re.compile(r'[\s()_-]+')


class ClassMap:
    """Maps the classes of results to KITTI's, and counts unmapped ones.

    Args:
        class_map: KITTI's class by the name or numeric id of a class; an empty one leaves its boxes
            out, and * is all other classes.
        classes: KITTI's own classes, matched in any case and with any blanks or brackets.
    """

    def __init__(self, class_map: Mapping[str, str], classes: Iterable[str] = CLASSES) -> None:
        self._kitti = {_word(name): name for name in classes}
        self._map = {own: self._kitti.get(_word(name), name) for own, name in class_map.items()}
        self._kitti |= {_word(name): name for name in self._map.values() if name}
        self._unknown: Counter[str] = Counter()

    def find(self, *names: str) -> str:
        """Return KITTI's class of a box by the first of its names that has one.

        Empty for a box that is left out.
        """
        for name in names:
            if name in self._map:
                return self._map[name]
        for name in names:
            if _word(name) in self._kitti:
                return self._kitti[_word(name)]
        if _OTHERS in self._map:
            return self._map[_OTHERS]
        self._unknown[next(filter(None, names), '')] += 1
        return ''

    def losses(self, stream: str) -> tuple[Loss, ...]:
        """Return the boxes so far of classes that are unknown.

        Args:
            stream: Their topic or file.
        """
        if not self._unknown:
            return ()
        counted = [f'{name!r} ({count})' for name, count in self._unknown.most_common()]
        first = next(iter(self._unknown)) or _OTHERS
        text = (
            f"{stream}: boxes of classes that are not among KITTI's: {some_of(counted, _SHOWN)};"
            f" map them, such as --class-map '{first}=Car', or leave them out with '{first}='"
        )
        count = sum(self._unknown.values())
        return (Loss(stream, count, text.replace('{', '(').replace('}', ')')),)


def _word(name: str) -> str:
    """Return a class for comparisons: Person (sitting), as in tracklets, is person_sitting."""
    return _PUNCTUATION.sub('_', name).strip('_').lower()


# The boxes of tracks from label_02, a tracker's files, or a bag.

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
"""TrackEval's class by the class of a label; other labels are ignored."""


class TrackBox(NamedTuple):
    """A box with its class of TrackEval."""

    class_name: str
    frame: int
    track_id: int
    box: Box


class TrackBoxes(NamedTuple):
    """The boxes of a sequence.

    Attributes:
        boxes: Boxes of the benchmark's classes.
        losses: Unusable lines.
        others: Number of boxes of KITTI's other classes.
    """

    boxes: Sequence[TrackBox]
    losses: tuple[Loss, ...] = ()
    others: int = 0

    def among(self, numbers: Container[int] | None) -> TrackBoxes:
        """Return the same with the boxes of some frames only; None is all."""
        if numbers is None:
            return self
        return self._replace(boxes=[box for box in self.boxes if box.frame in numbers])


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
    boxes = [(row, box, _OF_TRUTH.get(box.class_name.lower(), '')) for row, box in rows.items()]
    regions = [_track_box_of(box, name) for _, box, name in boxes if name == _REGION]
    objects = [line for line in boxes if line[2] not in {'', _REGION}]
    tracked, lost = _tracked(objects, path, 'ground truth', length)
    inside = [region for region in regions if 0 <= region.frame < length]
    return TrackBoxes([*inside, *tracked], (*losses, *lost))


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
    classified = [(row, box, classes.find(box.class_name).lower()) for row, box in rows.items()]
    return _scored(classified, losses, path, length)


def tracks_of_frames(frames: Mapping[int, Iterable[Box]], source: Path, length: int) -> TrackBoxes:
    """Return the tracks of results by frame.

    Raises:
        BadFileError: A track has two boxes in a frame.
    """
    classified = [(-1, box, box.class_name.lower()) for boxes in frames.values() for box in boxes]
    return _scored(classified, [], source, length)


def _scored(
    classified: Sequence[tuple[int, Box, str]], losses: Sequence[Loss], path: Path, length: int
) -> TrackBoxes:
    in_benchmark = [line for line in classified if line[2] in SCORED]
    tracked, lost = _tracked(in_benchmark, path, 'tracks', length)
    others = sum(name not in {'', _REGION, *SCORED} for _, _, name in classified)
    return TrackBoxes(tracked, (*losses, *lost), others)


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
    classified: Iterable[tuple[int, Box, str]], path: Path, stream: str, length: int
) -> tuple[list[TrackBox], list[Loss]]:
    """Return the boxes with a track in a frame of the sequence, and the others as losses.

    Args:
        classified: Row, box and class of TrackEval.
        path: For errors.
        stream: For losses.
        length: Number of frames of the sequence.

    Raises:
        BadFileError: A track has two boxes in a frame.
    """
    tracked: dict[tuple[str, int, int], TrackBox] = {}
    untracked, beyond = 0, Counter[int]()
    for row, box, name in classified:
        track_box = _track_box_of(box, name)
        if track_box.track_id < 0:
            untracked += 1
        elif not 0 <= track_box.frame < length:
            beyond[track_box.frame] += 1
        elif tracked.setdefault(track_box[:3], track_box) is not track_box:
            raise BadFileError(
                path,
                f'track {track_box.track_id} of class {box.class_name} has two boxes in frame'
                f' {track_box.frame}',
                'one box of a track in a frame',
                line=row + 1 if row >= 0 else None,
            )
    name, numbers = _plain(str(path)), tuple(sorted(beyond))
    outside = f'{name}: boxes in frames {{}}; the sequence has {length} frames'
    lost = [
        Loss(stream, untracked, f'{name}: boxes with a track id below 0'),
        Loss(stream, beyond.total(), outside, numbers),
    ]
    return list(tracked.values()), [loss for loss in lost if loss.count]


def _track_box_of(box: Box, class_name: str) -> TrackBox:
    track_id = -1 if box.track_id is None else box.track_id
    return TrackBox(class_name, -1 if box.frame is None else box.frame, track_id, box)


def _plain(text: str) -> str:
    """Return a text without braces, which stand for frame numbers in losses."""
    return text.replace('{', '(').replace('}', ')')


_PERCENT = {
    'HOTA': ('HOTA', 'DetA', 'AssA', 'LocA'),
    'CLEAR': ('MOTA', 'MOTP'),
    'Identity': ('IDF1', 'IDP', 'IDR'),
}
_COUNTS = {'CLEAR': ('IDSW', 'Frag', 'MT', 'PT', 'ML', 'CLR_TP', 'CLR_FN', 'CLR_FP')}
TrackParts: TypeAlias = 'Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]'
"""Arrays and numbers by name of TrackEval, by sequence, class and metric."""
Figures: TypeAlias = 'Mapping[str, float | None]'
_TRACKER = 'tracker'
_SPLIT = 'training'
_UNSCORED = '1'


class TrackedSequence(NamedTuple):
    """A sequence with its tracks.

    Attributes:
        name: Sequence, such as 0000.
        length: Number of frames.
        truth: The labels.
        tracks: The boxes of the tracker.
    """

    name: str
    length: int
    truth: Sequence[TrackBox]
    tracks: Sequence[TrackBox]


class TrackFigures(NamedTuple):
    """Figures by class and by TrackEval's name: counts, or percent; None if no side has the class.

    Attributes:
        combined: Figures of all sequences together.
        by_sequence: Figures of each sequence.
        parts: TrackEval's results by sequence, class and metric, of which combined is made.
    """

    combined: Mapping[str, Figures]
    by_sequence: Mapping[str, Mapping[str, Figures]]
    parts: TrackParts


def check_trackeval() -> None:
    """Check that TrackEval is installed.

    Raises:
        UsageError: It is not.
    """
    if find_spec('trackeval') is None:
        raise UsageError(
            'eval tracking needs trackeval, which is not installed; run'
            " pip install 'kitti_ros2[eval]'"
        )


def score_sequences(
    sequences: Sequence[TrackedSequence], progress: Callable[[int, int], None]
) -> TrackFigures:
    """Score tracks.

    Args:
        sequences: At least one.
        progress: Called with the number of sequences done, and of all.

    Raises:
        UsageError: TrackEval is not installed.
        MissingDataError: TrackEval cannot evaluate the sequences.
    """
    check_trackeval()
    with TemporaryDirectory(prefix='kitti_ros2_tracks_') as folder:
        _write_tree(Path(folder), sequences)
        try:
            with redirect_stdout(StringIO()):
                return _evaluate(Path(folder), [sequence.name for sequence in sequences], progress)
        except load_trackeval().utils.TrackEvalException as error:
            raise MissingDataError(f'TrackEval: {error}') from None


def _evaluate(
    root: Path, names: Sequence[str], progress: Callable[[int, int], None]
) -> TrackFigures:
    """Evaluate as TrackEval's Evaluator.evaluate, without its output."""
    library = load_trackeval()
    dataset = library.datasets.Kitti2DBox(
        {
            'GT_FOLDER': str(root),
            'TRACKERS_FOLDER': str(root),
            'TRACKERS_TO_EVAL': [_TRACKER],
            'SPLIT_TO_EVAL': _SPLIT,
            'CLASSES_TO_EVAL': list(SCORED),
            'PRINT_CONFIG': False,
        }
    )
    metrics = _metrics(library)
    results: dict[str, dict[str, dict[str, Any]]] = {}
    for done, name in enumerate(sorted(names), 1):
        raw = dataset.get_raw_seq_data(_TRACKER, name)
        results[name] = {}
        for class_name in SCORED:
            data = dataset.get_preprocessed_seq_data(raw, class_name)
            by_metric = {key: metric.eval_sequence(data) for key, metric in metrics.items()}
            results[name][class_name] = by_metric
        progress(done, len(names))
    by_sequence = {
        name: {class_name: _figures(values) for class_name, values in by_class.items()}
        for name, by_class in results.items()
    }
    return TrackFigures(combine_parts(results), by_sequence, results)


def combine_parts(parts: TrackParts) -> dict[str, Figures]:
    """Return the figures of several sequences together, by class.

    Args:
        parts: See TrackFigures; lists in place of arrays, such as of JSON, are accepted.
    """
    metrics = _metrics(load_trackeval())
    return {
        class_name: _figures(
            {
                key: metric.combine_sequences(
                    {name: _arrays(by_class[class_name][key]) for name, by_class in parts.items()}
                )
                for key, metric in metrics.items()
            }
        )
        for class_name in SCORED
    }


def _metrics(library: Any) -> dict[str, Any]:  # noqa: ANN401 - TrackEval
    quiet = {'PRINT_CONFIG': False}
    return {
        'HOTA': library.metrics.HOTA(),
        'CLEAR': library.metrics.CLEAR(quiet),
        'Identity': library.metrics.Identity(quiet),
    }


def _arrays(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: np.array(value, np.float64) if isinstance(value, list) else value
        for name, value in values.items()
    }


def plain_parts(parts: TrackParts) -> dict[str, Any]:
    """Return TrackEval's results of a sequence or more as values of JSON."""
    return {
        name: {
            class_name: {
                metric: {key: np.asarray(value).tolist() for key, value in values.items()}
                for metric, values in metrics.items()
            }
            for class_name, metrics in by_class.items()
        }
        for name, by_class in parts.items()
    }


def _figures(values: Mapping[str, Mapping[str, Any]]) -> Figures:
    """Return the figures that are reported; those of HOTA are means over its 19 thresholds.

    TrackEval's percentages of a class that neither side has are 0: they are None here.
    """
    counts = {
        name: int(values[metric][name]) for metric, names in _COUNTS.items() for name in names
    }
    present = any(counts[name] for name in ('CLR_TP', 'CLR_FN', 'CLR_FP'))
    percent = {
        name: 100 * float(np.mean(values[metric][name])) if present else None
        for metric, names in _PERCENT.items()
        for name in names
    }
    return percent | counts


def _write_tree(root: Path, sequences: Sequence[TrackedSequence]) -> None:
    """Write the files that Kitti2DBox reads."""
    labels, tracks = root / 'label_02', root / _TRACKER / 'data'
    labels.mkdir(parents=True)
    tracks.mkdir(parents=True)
    for sequence in sequences:
        (labels / f'{sequence.name}.txt').write_text(_text(sequence.truth))
        (tracks / f'{sequence.name}.txt').write_text(_text(sequence.tracks))
    lengths = ''.join(
        f'{sequence.name} empty 000000 {sequence.length:06d}\n' for sequence in sequences
    )
    (root / f'evaluate_tracking.seqmap.{_SPLIT}').write_text(lengths)


def _text(boxes: Sequence[TrackBox]) -> str:
    """Format the lines of boxes; TrackEval finds the separator if all have as many columns.

    Tracks are numbered from 0, in the same order: TrackEval makes an array of the greatest id.
    """
    ids = sorted({box.track_id for box in boxes if box.track_id >= 0})
    numbers = {track_id: number for number, track_id in enumerate(ids)}
    return ''.join(f'{" ".join(_words(box, numbers))}\n' for box in boxes)


def _words(track: TrackBox, numbers: Mapping[int, int]) -> Iterable[str]:
    box = track.box
    yield from (str(track.frame), str(numbers.get(track.track_id, -1)), track.class_name)
    yield from (repr(box.truncated), str(box.occluded), repr(box.alpha))
    yield from map(repr, (*box.box_2d, *box.size_hwl, *box.location, box.rotation_y))
    yield _UNSCORED


def load_trackeval() -> Any:  # noqa: ANN401 - without types
    """Import TrackEval, without its output on data sets of other benchmarks."""
    with redirect_stdout(StringIO()):
        import trackeval  # noqa: PLC0415 - an extra
    return trackeval
