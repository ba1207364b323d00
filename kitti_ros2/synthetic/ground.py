# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Backgrounds of the synthetic images: the winding road on the ground, and the sky."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..model.geometry import rotation_to_rpy
from .rig import SCANNER_HEIGHT
from .scene import ROAD_CENTRE, ROAD_LEFT, ROAD_RIGHT
from .textures import HAZE, as_picture, grained, without_colour

if TYPE_CHECKING:
    from ..model.geometry import Float64Array, Transform
    from .path import Course
    from .textures import Colour, Picture

_PER_METRE = 32
_ROAD_PERIOD = 24.0
_ROAD_HALF_WIDTH = 16.0
_FARTHEST = 400.0
_BANDS = 5.0 * 1.6 ** np.arange(10)
"""Depths at which the ground changes to a coarser picture of the road, metres."""


class Backdrop:
    """Draws sky and ground of one camera.

    The pictures of the road are shrunk along and across it separately: seen from a car it is
    foreshortened a hundred times more along than across.

    Args:
        size: (width, height) of the images.
        focal: Focal length, pixels.
        seed: Of the grain and the clouds.
        course: The ego lane.
        grey: Whether the images have no colour.
    """

    def __init__(
        self, size: tuple[int, int], focal: float, seed: int, course: Course, *, grey: bool
    ) -> None:
        self._course = course
        self._size = size
        self._focal = focal
        self._grey = grey
        road = _paint_road(seed, (ROAD_RIGHT, ROAD_LEFT), ROAD_CENTRE, _PER_METRE)
        sky = _paint_sky(round(2 * np.pi * focal), size[1], seed)
        self._sky = self._toned(np.concatenate([sky, sky[:, : size[0]]], axis=1))
        self._road = self._toned(road)
        self._shrunk: dict[tuple[int, int], Picture] = {(0, 0): self._road}

    def draw(self, projection: Float64Array, street_T_velo: Transform) -> Picture:
        """Return a new image: (height, width) or (height, width, 3) uint8.

        Args:
            projection: (3, 4), velo_link to pixels.
            street_T_velo: Pose of the scanner.
        """
        width, height = self._size
        g = self._ground_matrix(projection, street_T_velo)
        middle = g[2, 0] * width / 2 + g[2, 1] * np.arange(height) + g[2, 2]
        image = np.empty((height, width) if self._grey else (height, width, 3), np.uint8)
        image[:] = HAZE[1] if self._grey else HAZE
        above = int(np.argmax(middle > 0)) if (middle > 0).any() else height
        _, _, heading = rotation_to_rpy(street_T_velo.rotation)
        self._draw_sky(image[:above], heading)
        self._draw_ground(image, g, middle, street_T_velo)
        return image

    def _toned(self, picture: Picture) -> Picture:
        return without_colour(picture) if self._grey else picture

    def _draw_sky(self, image: Picture, heading: float) -> None:
        rows = image.shape[0]
        turn = self._sky.shape[1] - self._size[0]
        start = round(-heading * self._focal) % turn
        image[:] = self._sky[self._sky.shape[0] - rows :, start : start + self._size[0]]

    def _ground_matrix(self, projection: Float64Array, street_T_velo: Transform) -> Float64Array:
        """Return (3, 3), pixel to (x, y, 1) / depth, x and y from the scanner along street axes."""
        velo_r_street = street_T_velo.rotation.T
        below = np.array([0.0, 0.0, -SCANNER_HEIGHT])
        columns = (
            projection[:, :3] @ velo_r_street[:, 0],
            projection[:, :3] @ velo_r_street[:, 1],
            projection[:, :3] @ below + projection[:, 3],
        )
        inverse: Float64Array = np.linalg.inv(np.column_stack(columns))
        return inverse

    def _draw_ground(
        self, image: Picture, g: Float64Array, inverse_depth: Float64Array, street_T_velo: Transform
    ) -> None:
        depths = np.where(inverse_depth > 1 / _FARTHEST, 1 / inverse_depth, np.inf)
        bands = np.searchsorted(_BANDS, depths)
        for band in np.unique(bands[np.isfinite(depths)]):
            rows = np.flatnonzero((bands == band) & np.isfinite(depths))
            middle = float(np.median(depths[rows]))
            self._draw_band(image, slice(rows[0], rows[-1] + 1), g, street_T_velo, middle)

    def _draw_band(
        self, image: Picture, rows: slice, g: Float64Array, street_T_velo: Transform, depth: float
    ) -> None:
        u = np.arange(self._size[0], dtype=np.float32)[None, :]
        v = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None]
        a, b, c = g.astype(np.float32)
        reach = 1 / (c[0] * u + (c[1] * v + c[2]))
        x = (a[0] * u + (a[1] * v + a[2])) * reach
        y = (b[0] * u + (b[1] * v + b[2])) * reach
        start_x, start_y, _ = street_T_velo.translation.astype(np.float32)
        y += start_y - self._course.y_array(x + start_x)
        x += start_x % np.float32(_ROAD_PERIOD)
        y += np.float32(_ROAD_HALF_WIDTH)
        along, across = self._levels(depth)
        picture = self._shrunk_road(along, across)
        scale_x = np.float32(picture.shape[1] / _ROAD_PERIOD)
        scale_y = np.float32(picture.shape[0] / (2 * _ROAD_HALF_WIDTH))
        image[rows] = cv2.remap(
            picture,
            x * scale_x - np.float32(0.5),
            np.clip(y * scale_y - np.float32(0.5), 0, picture.shape[0] - 1),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_WRAP,
        )

    def _levels(self, depth: float) -> tuple[int, int]:
        """Return how often the road is halved along and across for one texel a pixel at a depth."""
        across = depth / self._focal * _PER_METRE
        along = across * depth / SCANNER_HEIGHT
        return (
            int(np.clip(np.log2(along), 0, 7)),
            int(np.clip(np.log2(across), 0, 6)),
        )

    def _shrunk_road(self, along: int, across: int) -> Picture:
        key = (along, across)
        if key not in self._shrunk:
            rows, columns = self._road.shape[:2]
            size = (max(1, columns >> along), max(1, rows >> across))
            small = cv2.resize(self._road, size, interpolation=cv2.INTER_AREA)
            self._shrunk[key] = as_picture(small)
        return self._shrunk[key]


def _paint_road(seed: int, edges: tuple[float, float], centre: float, per_metre: int) -> Picture:
    """Draw the ground along the ego lane, which is at y = 0.

    Args:
        seed: Of the grain.
        edges: y of the road's right and left kerb, metres.
        centre: y of the line between its lanes, metres.
        per_metre: Pixels.

    Returns:
        Rows across, from y = -_ROAD_HALF_WIDTH; columns along, for one period of _ROAD_PERIOD.
    """
    rng = np.random.default_rng([seed, 3])
    right, left = edges
    shape = (round(2 * _ROAD_HALF_WIDTH * per_metre), round(_ROAD_PERIOD * per_metre), 3)
    ground = np.empty(shape, np.uint8)
    ground[:] = (64, 112, 96)

    def strip(start: float, end: float, colour: Colour, columns: slice = slice(None)) -> None:
        ground[_along(start + _ROAD_HALF_WIDTH, end + _ROAD_HALF_WIDTH, per_metre), columns] = (
            colour
        )

    strip(right - 5.0, left + 5.0, (150, 156, 160))
    for joint in np.arange(0.0, _ROAD_PERIOD, 1.0):
        column = _along(joint, joint + 1 / per_metre, per_metre)
        strip(right - 5.0, right, (126, 130, 134), column)
        strip(left, left + 5.0, (126, 130, 134), column)
    strip(right - 0.2, left + 0.2, (176, 180, 184))
    strip(right, left, (92, 90, 88))
    for start in (0, 12):
        strip(centre - 0.07, centre + 0.07, (224, 228, 228), _along(start, start + 6, per_metre))
    for edge in (-2.0, 5.4):
        strip(edge - 0.05, edge + 0.05, (206, 210, 210))
    return grained(rng, ground, 11.0)


def _paint_sky(width: int, height: int, seed: int) -> Picture:
    """Draw a panorama of the sky, zenith to horizon; its two ends match."""
    rng = np.random.default_rng([seed, 4])
    down = np.linspace(0.0, 1.0, height)[:, None, None] ** 1.5
    blue = (1 - down) * np.array([222.0, 172.0, 128.0]) + down * np.array(HAZE)
    clouds = np.zeros((height, width), np.float32)
    for cells in (6, 14, 40):
        coarse = rng.random((max(2, cells // 4), cells), np.float32)
        coarse = np.concatenate([coarse, coarse[:, :1]], axis=1)
        clouds += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC) * 3 / cells
    clouds = np.clip((clouds - np.median(clouds)) * 2.2, 0.0, 0.75)[:, :, None]
    return as_picture((blue * (1 - clouds) + 246.0 * clouds).clip(0, 255))


def _along(start: float, end: float, per_metre: int) -> slice:
    return slice(round(start * per_metre), round(end * per_metre))
