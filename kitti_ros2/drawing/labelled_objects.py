# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The objects of a frame, the colours of classes, pixel arrays and plot files."""

from __future__ import annotations

import colorsys
import math
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias
from warnings import catch_warnings, simplefilter
from zlib import crc32

import numpy as np
import numpy.typing as npt

from ..model.boxes import Verdict, cuboid_of, has_cuboid, is_absurd, match
from ..model.classes import KITTI_OVERLAPS
from ..model.samples import identified, rect_from_velo
from ..options.messages import MarkerColors

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from ..model.boxes import Box, Cuboid, Match
    from ..model.classes import LeastOverlaps
    from ..model.geometry import Transform
    from ..model.samples import Calibration, FrameLabels


# The labelled objects of a frame, in the form that all drawing uses.

_LEAST_SHOWN = 0.005

LABEL_CAMERA = 2
"""KITTI's 2D boxes are in pixels of this camera: the left colour one, rectified."""


@dataclass(frozen=True, eq=False)
class LabelledObject:
    """One object of a frame.

    Attributes:
        class_name: DontCare for a region without labels.
        cuboid: Its 3D box in velo_link, None without one.
        box_2d: left, top, right, bottom in pixels of the labelled camera (KITTI's camera 2), None
            without one (tracklets).
        truncated: 0..1, None if unknown.
        occluded: 0 visible, 1 partly, 2 largely, 3 unknown, None without a value.
        score: Detection score, None for ground truth.
        track_id: Identity across frames, None without one.
        match: Comparison of labels and predictions, None without one.
    """

    class_name: str
    cuboid: Cuboid | None
    box_2d: tuple[float, float, float, float] | None = None
    truncated: float | None = None
    occluded: int | None = None
    score: float | None = None
    track_id: int | None = None
    match: Match | None = None


def objects_of(labels: FrameLabels, calibration: Calibration | None) -> list[LabelledObject]:
    """Return the objects of a frame, from label lines or from tracklets.

    If the calibration or its cam0_T_velo is missing, objects of label lines have 2D boxes only.
    """
    if labels.cuboids:
        return [
            LabelledObject(cuboid.class_name, cuboid, score=cuboid.score, track_id=cuboid.track_id)
            for cuboid in labels.cuboids
        ]
    return objects_of_boxes(labels, _rect_t_velo(calibration))


def objects_of_boxes(labels: FrameLabels, rect_t_velo: Transform | None) -> list[LabelledObject]:
    """Return the objects of label lines, their 3D boxes in velo_link.

    Args:
        labels: Labels of a frame.
        rect_t_velo: velo_link to the rectified camera 0; None for 2D boxes only.
    """
    return [_object_of(identity, box, rect_t_velo) for identity, box in identified(labels)]


def resized(
    objects: Sequence[LabelledObject], scale_x: float, scale_y: float
) -> list[LabelledObject]:
    """Return the objects with the 2D boxes of the resized image."""
    scales = np.array([scale_x, scale_y] * 2)
    shifts = (scales - 1) / 2
    return [
        obj
        if obj.box_2d is None
        else replace(obj, box_2d=tuple((np.array(obj.box_2d) * scales + shifts).tolist()))
        for obj in objects
    ]


def compared(
    labels: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
) -> tuple[list[LabelledObject], list[LabelledObject]]:
    """Return labels and predictions with their matches.

    Args:
        labels: Labels of a frame.
        predictions: Predictions of the same frame.
        overlaps: The IoU above which a prediction matches a label.
    """
    matches = match(labels, predictions, overlaps)
    with_labels, with_predictions = (
        [replace(obj, match=obj_match) for obj, obj_match in zip(objects, of_some, strict=True)]
        for objects, of_some in zip((labels, predictions), matches, strict=True)
    )
    return with_labels, with_predictions


def is_missed(obj: LabelledObject) -> bool:
    """Return whether an object is a label without a matching prediction."""
    return obj.match is not None and obj.match.verdict is Verdict.FALSE_NEGATIVE


def name_of(obj: LabelledObject) -> str:
    """Format class, track, score, and the result of the comparison."""
    track = '' if obj.track_id is None else f' {obj.track_id}'
    score = '' if obj.score is None else f' {obj.score:.2f}'
    return f'{obj.class_name}{track}{score}{_mark(obj)}'


def distance_of(obj: LabelledObject) -> float:
    """Return metres from the scanner, infinity without a 3D box."""
    if obj.cuboid is None:
        return math.inf
    distance = float(np.linalg.norm(obj.cuboid.velo_T_box.translation))
    return distance if math.isfinite(distance) else math.inf


def _mark(obj: LabelledObject) -> str:
    """Format the result of the comparison of a prediction, or of a missed label."""
    verdict, overlap = (None, 0.0) if obj.match is None else (obj.match.verdict, obj.match.overlap)
    if verdict is None or (obj.score is None and verdict is Verdict.TRUE_POSITIVE):
        return ''
    shown = f' IoU {overlap:.2f}' if overlap >= _LEAST_SHOWN and obj.score is not None else ''
    return f' {verdict.value}{shown}'


def _rect_t_velo(calibration: Calibration | None) -> Transform | None:
    try:
        return None if calibration is None else rect_from_velo(calibration)
    except ValueError:
        return None


def _object_of(identity: str, box: Box, rect_t_velo: Transform | None) -> LabelledObject:
    solid = rect_t_velo is not None and has_cuboid(box) and not is_absurd(box)
    left, top, right, bottom = box.box_2d
    return LabelledObject(
        box.class_name,
        cuboid_of(box, identity, rect_t_velo) if solid and rect_t_velo is not None else None,
        box.box_2d if right > left and bottom > top else None,
        box.truncated if box.truncated >= 0 else None,
        box.occluded if box.occluded >= 0 else None,
        box.score,
        box.track_id if box.track_id is not None and box.track_id >= 0 else None,
    )


# Colours of classes and tracks, and the size of the recording car.

CLASS_COLORS = {
    'Car': (2, 150, 249),
    'Van': (5, 163, 183),
    'Truck': (36, 84, 225),
    'Tram': (141, 71, 142),
    'Pedestrian': (203, 84, 76),
    'Person_sitting': (181, 86, 131),
    'Person (sitting)': (181, 86, 131),
    'Cyclist': (189, 140, 0),
    'Misc': (154, 147, 135),
}
"""KITTI's classes: red, green, blue, 0..255.

Any two, and PREDICTION_COLOR, are a CIEDE2000 difference of 12 apart, also for people with
deuteranopia (G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, "A Physiologically-based Model for
Simulation of Color Vision Deficiency", IEEE TVCG 15(6), 2009; severity 1). Each has a contrast of
3:1 to white and to the background of pictures (WCAG 2.1, 1.4.11).
"""

PREDICTION_COLOR = (248, 87, 172)
"""Predictions of any class: red, green, blue, 0..255."""

VERDICT_COLORS = {
    Verdict.TRUE_POSITIVE: (0, 158, 115),
    Verdict.FALSE_POSITIVE: (213, 94, 0),
    Verdict.FALSE_NEGATIVE: (240, 228, 66),
}
"""Compared predictions, and missed labels: red, green, blue, 0..255.

M. Okabe, K. Ito, "Color Universal Design", 2008: bluish green, vermilion, yellow. Any two of them,
NEUTRAL_COLOR and PREDICTION_COLOR are a CIEDE2000 difference of 15 apart, as above.
"""

NEUTRAL_COLOR = (215, 215, 215)
"""Matched labels, and objects that a comparison ignores: red, green, blue, 0..255."""

EGO_COLOR = (0.30, 0.69, 0.31)
"""Red, green, blue, 0..1."""

EGO_SIZE_LWH = (4.0, 1.7, 1.5)
"""The recording car, a Passat, metres."""

_GOLDEN_TURN = 0.6180339887498949


def rgb_of(class_name: str) -> tuple[int, int, int]:
    """Return red, green, blue, 0..255, of a class."""
    red, green, blue = color_of(class_name, 0, MarkerColors.CLASS)
    return round(255 * red), round(255 * green), round(255 * blue)


def color_of(class_name: str, number: int, colors: MarkerColors) -> tuple[float, float, float]:
    """Return red, green, blue, 0..1, of a class, or of a track's number.

    Unknown classes get a colour by their name, the same in every run.
    """
    if colors is MarkerColors.CLASS and class_name in CLASS_COLORS:
        red, green, blue = CLASS_COLORS[class_name]
        return red / 255, green / 255, blue / 255
    seed = number if colors is MarkerColors.TRACK else crc32(class_name.encode())
    return colorsys.hsv_to_rgb(seed * _GOLDEN_TURN % 1.0, 0.75, 0.95)


# SemanticKITTI's classes of points.
#
# Source: labels and color_map of semantic-kitti.yaml, in the semantic-kitti-api.

_CLASSES = {
    0: ('unlabeled', 0x000000),
    1: ('outlier', 0xFF0000),
    10: ('car', 0x6496F5),
    11: ('bicycle', 0x64E6F5),
    13: ('bus', 0x6450FA),
    15: ('motorcycle', 0x1E3C96),
    16: ('on-rails', 0x0000FF),
    18: ('truck', 0x501EB4),
    20: ('other-vehicle', 0x0000FF),
    30: ('person', 0xFF1E1E),
    31: ('bicyclist', 0xFF28C8),
    32: ('motorcyclist', 0x961E5A),
    40: ('road', 0xFF00FF),
    44: ('parking', 0xFF96FF),
    48: ('sidewalk', 0x4B004B),
    49: ('other-ground', 0xAF004B),
    50: ('building', 0xFFC800),
    51: ('fence', 0xFF7832),
    52: ('other-structure', 0xFF9600),
    60: ('lane-marking', 0x96FFAA),
    70: ('vegetation', 0x00AF00),
    71: ('trunk', 0x873C00),
    72: ('terrain', 0x96F050),
    80: ('pole', 0xFFF096),
    81: ('traffic-sign', 0xFF0000),
    99: ('other-object', 0x32FFFF),
    252: ('moving-car', 0x6496F5),
    253: ('moving-bicyclist', 0xFF28C8),
    254: ('moving-person', 0xFF1E1E),
    255: ('moving-motorcyclist', 0x961E5A),
    256: ('moving-on-rails', 0x0000FF),
    257: ('moving-bus', 0x6450FA),
    258: ('moving-truck', 0x501EB4),
    259: ('moving-other-vehicle', 0x0000FF),
}

SEMANTIC_NAMES = {number: name for number, (name, _) in _CLASSES.items()}
"""Class to name."""

SEMANTIC_COLORS = {number: color for number, (_, color) in _CLASSES.items()}
"""Class to 0xRRGGBB."""

OTHER_COLOR = 0x808080
"""Colour of classes that SemanticKITTI does not have."""

_OTHER = 1
_SHADES = {number: shade for shade, number in enumerate(_CLASSES, _OTHER + 1)}
_SHADE_OF_CLASS = np.full(1 << 16, _OTHER, np.uint8)
_SHADE_OF_CLASS[list(_SHADES)] = list(_SHADES.values())


def semantic_shades(labels: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint8]:
    """Return (N,) shades 1..255 of (N,) labels, one for each class; 1 for unknown classes."""
    shades: npt.NDArray[np.uint8] = _SHADE_OF_CLASS[labels & 0xFFFF]
    return shades


def semantic_table() -> npt.NDArray[np.uint8]:
    """Return (256, 1, 3) BGR of the shades.

    Points without a label, black in SemanticKITTI, are grey: pictures have a dark background.
    """
    colors = np.full(256, OTHER_COLOR, np.uint32)
    for number, shade in _SHADES.items():
        colors[shade] = SEMANTIC_COLORS[number] or OTHER_COLOR
    return np.stack([colors & 0xFF, colors >> 8 & 0xFF, colors >> 16], axis=1)[:, None].astype(
        np.uint8
    )


def semantic_names(shades: npt.NDArray[np.uint8]) -> list[tuple[str, int]]:
    """Return name and shade of the classes of some points, the most frequent first."""
    names = {_SHADES[number]: name for number, (name, _) in _CLASSES.items()}
    counts = np.bincount(shades, minlength=256)
    present = sorted(np.flatnonzero(counts).tolist(), key=lambda shade: -counts[shade])
    return [(names.get(shade, 'other'), shade) for shade in present]


# The pixel array that is drawn on.

Pixels: TypeAlias = npt.NDArray[np.uint8]
"""(H, W, 3) uint8, BGR."""


def colour_pixels(pixels: npt.NDArray[np.uint8 | np.uint16]) -> Pixels:
    """Convert (H, W) grey or (H, W, 3) BGR pixels to (H, W, 3) uint8 BGR; of 16 bits the upper 8.

    Colour pixels of 8 bits are returned without a copy.
    """
    import cv2  # noqa: PLC0415 - takes 0.2 s; commands without drawing skip it

    upper = pixels if pixels.dtype == np.uint8 else pixels // 256
    values = upper.astype(np.uint8, copy=False)
    return values if values.ndim == 3 else np.asarray(cv2.cvtColor(values, cv2.COLOR_GRAY2BGR))


# The style of plots, and the files that they are drawn to.

INK = '#30343b'
_STYLE: dict[str, Any] = {
    'axes.axisbelow': True,
    'axes.edgecolor': INK,
    'axes.grid': True,
    'axes.labelcolor': INK,
    'axes.linewidth': 0.6,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlesize': 9,
    'axes.titleweight': 'bold',
    'font.size': 7.5,
    'grid.color': '#e4e6ea',
    'grid.linewidth': 0.6,
    'legend.frameon': False,
    'legend.fontsize': 7,
    'svg.hashsalt': 'kitti_ros2',
    'text.color': INK,
    'text.parse_math': False,  # names of classes may hold any characters
    'xtick.color': INK,
    'ytick.color': INK,
}
"""For matplotlib's rc_context."""
BESIDE: dict[str, Any] = {
    'loc': 'upper left',
    'bbox_to_anchor': (1.02, 1),
    'borderaxespad': 0,
    'handlelength': 0.9,
    'handletextpad': 0.35,
    'labelspacing': 0.3,
    'alignment': 'left',
    'title_fontsize': 6.5,
}
"""Position of a legend right of the axes, so that it covers no data."""

_DPI = 200


@contextmanager
def plot_file(path: Path, inches: tuple[float, float], h_pad: float = 0.06) -> Iterator[Figure]:
    """Yield a figure that is written at the end.

    Args:
        path: The picture: .png, .pdf or .svg.
        inches: Width and height.
        h_pad: Above and below each panel, inches.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    from matplotlib import rc_context  # noqa: PLC0415 - heavy, and an extra
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above
    from matplotlib.layout_engine import ConstrainedLayoutEngine  # noqa: PLC0415 - as above

    with rc_context(_STYLE), catch_warnings():
        simplefilter('ignore')  # characters that the font does not have are drawn as boxes
        layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=h_pad, hspace=0.02, wspace=0.02)
        figure = Figure(inches, layout=layout)
        yield figure
        figure.savefig(path, dpi=_DPI, format=path.suffix[1:].lower())
