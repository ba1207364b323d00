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

from contextlib import redirect_stdout
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ..model.errors import MissingDataError, UsageError
from .track_boxes import SCORED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from .track_boxes import TrackBox

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
        name: Such as 0000.
        length: Number of frames.
        truth: The labels.
        tracks: Those of the tracker.
    """

    name: str
    length: int
    truth: Sequence[TrackBox]
    tracks: Sequence[TrackBox]


class TrackFigures(NamedTuple):
    """Figures by class and by TrackEval's name: counts, or percent; None if no side has the class.

    Attributes:
        combined: Of all sequences together.
        by_sequence: Of each sequence.
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
                return _evaluate(Path(folder), [each.name for each in sequences], progress)
        except load_trackeval().utils.TrackEvalException as error:
            raise MissingDataError(f'TrackEval: {error}') from None


def _evaluate(
    root: Path, names: Sequence[str], progress: Callable[[int, int], None]
) -> TrackFigures:
    """Do what Evaluator.evaluate of TrackEval does, without its output."""
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
            found = {key: metric.eval_sequence(data) for key, metric in metrics.items()}
            results[name][class_name] = found
        progress(done, len(names))
    by_sequence = {
        name: {class_name: _figures(values) for class_name, values in found.items()}
        for name, found in results.items()
    }
    return TrackFigures(combine_parts(results), by_sequence, results)


def combine_parts(parts: TrackParts) -> dict[str, Figures]:
    """Return the figures of several sequences together, by class.

    Args:
        parts: As in TrackFigures; lists in place of arrays, such as of JSON, are accepted.
    """
    metrics = _metrics(load_trackeval())
    return {
        class_name: _figures(
            {
                key: metric.combine_sequences(
                    {name: _arrays(found[class_name][key]) for name, found in parts.items()}
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
                metric: {key: np.asarray(each).tolist() for key, each in values.items()}
                for metric, values in metrics.items()
            }
            for class_name, metrics in found.items()
        }
        for name, found in parts.items()
    }


def _figures(values: Mapping[str, Mapping[str, Any]]) -> Figures:
    """Return the figures that are reported; those of HOTA are means over its 19 thresholds.

    TrackEval's percentages of a class that neither side has are 0: they are None here.
    """
    counts = {
        name: int(values[metric][name]) for metric, names in _COUNTS.items() for name in names
    }
    known = any(counts[name] for name in ('CLR_TP', 'CLR_FN', 'CLR_FP'))
    percent = {
        name: 100 * float(np.mean(values[metric][name])) if known else None
        for metric, names in _PERCENT.items()
        for name in names
    }
    return percent | counts


def _write_tree(root: Path, sequences: Sequence[TrackedSequence]) -> None:
    """Write the files that Kitti2DBox reads."""
    labels, tracks = root / 'label_02', root / _TRACKER / 'data'
    labels.mkdir(parents=True)
    tracks.mkdir(parents=True)
    for each in sequences:
        (labels / f'{each.name}.txt').write_text(_text(each.truth))
        (tracks / f'{each.name}.txt').write_text(_text(each.tracks))
    lengths = ''.join(f'{each.name} empty 000000 {each.length:06d}\n' for each in sequences)
    (root / f'evaluate_tracking.seqmap.{_SPLIT}').write_text(lengths)


def _text(boxes: Sequence[TrackBox]) -> str:
    """Format the lines of boxes; TrackEval finds the separator if all have as many columns.

    Tracks are numbered from 0, in the same order: TrackEval makes an array of the greatest id.
    """
    ids = sorted({each.track_id for each in boxes if each.track_id >= 0})
    places = {track_id: place for place, track_id in enumerate(ids)}
    return ''.join(f'{" ".join(_words(each, places))}\n' for each in boxes)


def _words(found: TrackBox, places: Mapping[int, int]) -> Iterable[str]:
    box = found.box
    yield from (str(found.frame), str(places.get(found.track_id, -1)), found.class_name)
    yield from (repr(box.truncated), str(box.occluded), repr(box.alpha))
    yield from map(repr, (*box.box_2d, *box.size_hwl, *box.location, box.rotation_y))
    yield _UNSCORED


def load_trackeval() -> Any:  # noqa: ANN401 - without types
    """Import TrackEval, without its remarks on data sets of other benchmarks."""
    with redirect_stdout(StringIO()):
        import trackeval  # noqa: PLC0415 - an extra
    return trackeval
