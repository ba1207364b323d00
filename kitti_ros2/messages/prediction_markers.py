# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions compared with labels -> visualization_msgs/MarkerArray, for RViz and Foxglove.

An array begins with a DELETEALL. Each namespace is a result of the comparison, so that a viewer can
hide it: true_positive, false_positive and uncounted (on a neighbouring class or a DontCare region)
are predictions, miss are labels that no prediction finds. Without labels, all are in namespace
prediction. Each object has box, edges, heading and text (class, track, score, result, IoU,
distance), as those of labels in markers.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..drawing.objects import distance_of, is_missed, name_of
from ..drawing.palette import NEUTRAL_COLOR, PREDICTION_COLOR, VERDICT_COLORS
from ..model.matching import Verdict
from .marker_drawing import OBJECT_PARTS, MarkerDrawing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..drawing.objects import LabelledObject
    from ..options.markers import MarkerOptions
    from .cdr import Parts

_NAMESPACES = {
    Verdict.TRUE_POSITIVE: 'true_positive',
    Verdict.FALSE_POSITIVE: 'false_positive',
    Verdict.FALSE_NEGATIVE: 'miss',
}


def encode_prediction_markers(
    labels: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    stamp_ns: int,
    frame_id: str,
    options: MarkerOptions,
) -> Parts:
    """Make the markers of the predictions of a frame and of the labels that none finds, serialised.

    Args:
        labels: Compared with the predictions.
        predictions: Those without a 3D box are left out.
        stamp_ns: Nanoseconds.
        frame_id: Name of velo_link.
        options: Sizes of markers.
    """
    missed = [each for each in labels if is_missed(each)]
    shown = [each for each in (*predictions, *missed) if each.cuboid is not None]
    drawing = MarkerDrawing(1 + len(OBJECT_PARTS) * len(shown), options, stamp_ns)
    drawing.clear(frame_id)
    for place, each in enumerate(shown):
        namespace, rgb = _look(each)
        first = len(OBJECT_PARTS) * place
        names = [(namespace, first + part) for part in range(len(OBJECT_PARTS))]
        red, green, blue = (value / 255 for value in rgb)
        text = f'{name_of(each)}\n{distance_of(each):.1f} m'
        if each.cuboid is not None:
            drawing.object(each.cuboid, frame_id, names, (red, green, blue), text)
    return drawing.parts()


def _look(each: LabelledObject) -> tuple[str, tuple[int, int, int]]:
    """Return namespace and colour (red, green, blue, 0..255) of an object."""
    if each.match is None:
        return 'prediction', PREDICTION_COLOR
    if each.match.verdict is None:
        return 'uncounted', NEUTRAL_COLOR
    return _NAMESPACES[each.match.verdict], VERDICT_COLORS[each.match.verdict]
