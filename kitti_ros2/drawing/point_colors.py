# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The colours of a scan's points, by a quantity or by class, with their legend."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from ..options.pictures import ColorBy, ColorMap
from .scales import DIM, SCALES, color_table, colored, draw_bar
from .semantic import semantic_names, semantic_shades, semantic_table
from .text import extent_of, put_text

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Float32Array
    from .pixels import Pixels

_BAR_SIZE = (150, 7)
_TEXT_SCALE = 0.38


class PointColors(NamedTuple):
    """How the points of a scan are coloured.

    Attributes:
        by: The quantity shown.
        color_map: Its colours; classes have their own.
        labels: (N,) SemanticKITTI labels of the scan, required to show classes.
    """

    by: ColorBy = ColorBy.DEPTH
    color_map: ColorMap = ColorMap.VIRIDIS
    labels: npt.NDArray[np.uint32] | None = None

    def shades(
        self, points: Float32Array, chosen: npt.NDArray[np.intp], depth: Float32Array | None = None
    ) -> npt.NDArray[np.uint8]:
        """Return (K,) shades 1..255 of the chosen of (N, 4) points.

        Args:
            points: x y z in velo_link, metres, and reflectance.
            chosen: (K,) indices.
            depth: (K,) depth in metres; the distance from the scanner by default.
        """
        if self.by is ColorBy.SEMANTIC:
            labels = np.zeros(len(points), np.uint32) if self.labels is None else self.labels
            return semantic_shades(labels[chosen])
        if self.by is ColorBy.DEPTH:
            shown = np.linalg.norm(points[chosen, :3], axis=1) if depth is None else depth
        else:
            shown = points[chosen, 2 if self.by is ColorBy.HEIGHT else 3]
        return SCALES[self.by].shades(shown)

    def paint(self, picture: Pixels, layer: npt.NDArray[np.uint8]) -> None:
        """Draw (H, W) shades on a picture; EMPTY ones leave it as it is."""
        cv2.copyTo(colored(layer, self._table()), layer, picture)

    def draw_legend(
        self, picture: Pixels, layer: npt.NDArray[np.uint8], scale: float, *, below: bool = False
    ) -> None:
        """Draw the meaning of the colours: a bar in a corner, or classes along the upper edge.

        Args:
            picture: Drawn on in place.
            layer: The shades shown.
            scale: Of the text, 1 for KITTI's images.
            below: Whether the bar is in the lower left corner; else it is in the upper left one.
        """
        if self.by is ColorBy.SEMANTIC:
            _draw_classes(picture, layer, scale)
            return
        bar = (round(_BAR_SIZE[0] * scale), round(_BAR_SIZE[1] * scale))
        top = picture.shape[0] - 7 * bar[1] if below else bar[1]
        draw_bar(picture, SCALES[self.by], self.color_map, (bar[1], top), bar)

    def _table(self) -> Pixels:
        return _classes_table() if self.by is ColorBy.SEMANTIC else color_table(self.color_map)


@lru_cache(maxsize=1)
def _classes_table() -> Pixels:
    return semantic_table()


def _draw_classes(picture: Pixels, layer: npt.NDArray[np.uint8], scale: float) -> None:
    """Draw the name of each class shown beside its colour, in lines across the upper edge."""
    text_scale, table = _TEXT_SCALE * scale, _classes_table()
    extent = extent_of('0', text_scale)
    line, swatch = extent.above + extent.below + 2, extent.above
    rows: list[list[tuple[int, str, int]]] = [[]]
    left = swatch
    for name, shade in semantic_names(layer[layer > 0]):
        width = 3 * swatch + extent_of(name, text_scale).width
        if left + width > picture.shape[1] and rows[-1]:
            rows.append([])
            left = swatch
        rows[-1].append((left, name, shade))
        left += width
    strip = picture[: len(rows) * line + 2]
    strip[:] = cv2.convertScaleAbs(strip, alpha=DIM)
    for place, row in enumerate(rows):
        baseline = place * line + extent.above + 1
        for left, name, shade in row:
            color = tuple(table[shade, 0].tolist())
            corner = (left, baseline - swatch + 2)
            cv2.rectangle(strip, corner, (left + swatch - 2, baseline), color, cv2.FILLED)
            put_text(strip, name, (left + 1.5 * swatch, baseline), text_scale)
