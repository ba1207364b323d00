# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The appearance of an object: its colour, caption and line width.

Ground truth has the colour of its class, solid lines and a filled tag; predictions have a colour of
their own, dashed lines and an outlined tag. Where both are compared, predictions have the colour of
true or of false positives, labels that no prediction finds have that of misses, and all others are
grey; tags show TP or FP and the intersection over union, or FN.
Lines of an object that is labelled as occluded, is small, or is a label that was found are half as
wide; the tag of a 2D box shows how much is occluded (KITTI's 1 partly, 2 largely, ? unknown) and
truncated.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import cuboid_corners
from ..model.matching import Verdict
from .objects import distance_of, name_of
from .palette import NEUTRAL_COLOR, PREDICTION_COLOR, VERDICT_COLORS, rgb_of
from .strokes import has_pixels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from .objects import LabelledObject
    from .pixels import Pixels
    from .strokes import Bounds, Color

PREDICTION_BGR = PREDICTION_COLOR[::-1]
_KITTI_AREA = 1242 * 375
_SMALL = 40.0
_OCCLUSIONS = {1: ' occ 1', 2: ' occ 2', 3: ' occ ?'}


def bgr(rgb: tuple[float, float, float]) -> Color:
    """Convert red, green, blue in 0..1 to the colours of OpenCV."""
    red, green, blue = (round(255 * value) for value in rgb)
    return blue, green, red


def class_color(class_name: str) -> Color:
    """Return the colour of a class."""
    red, green, blue = rgb_of(class_name)
    return blue, green, red


def box_color(each: LabelledObject, *, predicted: bool) -> Color:
    """Return the colour of an object's box: where it was compared, that of the result."""
    if each.match is None:
        return PREDICTION_BGR if predicted else class_color(each.class_name)
    verdict = each.match.verdict
    found = not predicted and verdict is Verdict.TRUE_POSITIVE
    rgb = NEUTRAL_COLOR if found or verdict is None else VERDICT_COLORS[verdict]
    return rgb[::-1]


def is_quiet(each: LabelledObject) -> bool:
    """Whether an object was compared and is no error."""
    errors = (Verdict.FALSE_POSITIVE, Verdict.FALSE_NEGATIVE)
    return each.match is not None and each.match.verdict not in errors


def scale_of(picture: Pixels) -> float:
    """Return the scale of lines and letters: 1 in KITTI's images, more in larger ones."""
    return scale_for((picture.shape[1], picture.shape[0]))


def scale_for(size: tuple[int, int]) -> float:
    """Return the scale of lines and letters for the (width, height) of a picture."""
    return min(max(math.sqrt(size[0] * size[1] / _KITTI_AREA), 1.0), 3.0)


def line_width(each: LabelledObject, bounds: Bounds | None, scale: float) -> int:
    """Return the line width of a box with these bounds in the image, pixels."""
    small = bounds is None or min(bounds[2] - bounds[0], bounds[3] - bounds[1]) < _SMALL * scale
    thin = each.occluded or small or is_quiet(each)
    return max(round((1.0 if thin else 2.0) * scale), 1)


def caption_2d(each: LabelledObject) -> str:
    """Format class, track, score, occlusion and truncation."""
    occlusion = _OCCLUSIONS.get(each.occluded or 0, '')
    return name_of(each) + occlusion + _truncation(each.truncated or 0.0)


def _truncation(share: float) -> str:
    """Format the part outside the image; tracking labels have only a level (1, 2)."""
    if not share > 0:
        return ''
    return f' trunc {100 * share:.0f}%' if share < 1 else ' trunc'


def caption_3d(each: LabelledObject) -> str:
    """Format class, track, score and distance."""
    return f'{name_of(each)}, {distance_of(each):.1f} m'


def objects_to_draw(
    picture: Pixels,
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject] = (),
) -> list[tuple[LabelledObject, bool]]:
    """Return objects by ascending distance, each with whether it is a prediction.

    A picture without pixels has none.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    if not has_pixels(picture):
        return []
    both = [(each, False) for each in objects] + [(each, True) for each in predictions]
    return sorted(both, key=lambda pair: distance_of(pair[0]))


def corners_of(shown: Sequence[tuple[LabelledObject, bool]]) -> Float64Array:
    """Return the (N, 8, 3) corners of 3D boxes in velo_link, metres; NaN without a box."""
    corners = np.full((len(shown), 8, 3), np.nan)
    places = [place for place, (each, _) in enumerate(shown) if each.cuboid is not None]
    cuboids = [each.cuboid for each, _ in shown if each.cuboid is not None]
    corners[places] = cuboid_corners(cuboids)
    return corners
