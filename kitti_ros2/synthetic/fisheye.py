# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The images of the synthetic fisheyes: faces, road and sky along the ray of each pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .render import (
    FARTHEST,
    ROAD_HALF_WIDTH,
    ROAD_PERIOD,
    Canvas,
    Noise,
    Road,
    paint_sky,
    shaded,
    texels_at,
    visible_faces,
)
from .textures import HAZE, as_picture

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array, Transform
    from ..model.lenses import Lens
    from ..model.samples import CameraCalibration, Float32Array
    from .render import Face
    from .scene import Course, PlacedSolid
    from .textures import Picture, Texture

_WIDEST = np.cos(np.radians(100.0))
"""Pixels that look further off the axis, in the corners, are black."""
_BLOCK = 16
_BANDS = 6.0 * 2.0 ** np.arange(6)
"""Distances at which the ground changes to a coarser picture of the road, metres."""


class FisheyeCamera:
    """Draws the images of a camera with a lens.

    The matrix G of a face (see render) takes the unit ray of a pixel, instead of the pixel, to
    (s, t, 1) / distance, so a face covers a pixel by the same four comparisons. It is looked for in
    the blocks of pixels that its cone, around its corners, may reach.

    Args:
        camera: With a lens and extrinsics of its own.
        seed: Of the textures' grain and the sensor's noise.
        course: The ego lane.
    """

    def __init__(self, camera: CameraCalibration, seed: int, course: Course) -> None:
        if camera.lens is None or camera.cam_T_velo is None or camera.size is None:
            raise AssertionError('the synthetic fisheyes have a lens, a mount and a size')
        self._cam_T_velo = camera.cam_T_velo
        self._size = width, height = camera.size
        self._course = course
        k = camera.p_rect
        rows, columns = np.mgrid[:height, :width].reshape(2, -1)
        bent = np.column_stack([(columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1]])
        rays = _rays(camera.lens, bent)
        rays[~(rays[:, 2] > _WIDEST)] = np.nan
        self._rays = rays.astype(np.float32).reshape(height, width, 3)
        self._blocks, self._block_spans = _cones_of_blocks(self._rays)
        self._focal = k[0, 0] * camera.lens.scale
        self._road = Road(seed, grey=False)
        self._sky = paint_sky(round(2 * np.pi * self._focal), round(np.pi / 2 * self._focal), seed)
        self._noise = Noise(self._size, seed, grey=False)

    def instances(self, placed: Sequence[PlacedSolid]) -> Canvas:
        """Return the box and the distance of each pixel, without an image."""
        return self._draw(placed, None, None)

    def photograph(
        self,
        camera: int,
        frame: int,
        placed: Sequence[PlacedSolid],
        street_T_velo: Transform,
        textures: Callable[[PlacedSolid, str], Texture],
    ) -> Picture:
        """Draw an image, (height, width, 3) uint8, BGR; see Cameras."""
        image = self._backdrop(street_T_velo)
        self._draw(placed, image, textures)
        return self._noise.added(image, camera, frame)

    def _draw(
        self,
        placed: Sequence[PlacedSolid],
        background: Picture | None,
        textures: Callable[[PlacedSolid, str], Texture] | None,
    ) -> Canvas:
        canvas = Canvas.empty(self._size, background, len(placed))
        faces = visible_faces(placed, self._cam_T_velo.matrix()[:3])
        for face, area in zip(faces, self._areas(faces), strict=True):
            if area is not None:
                texture = textures(placed[face.owner], face.name) if textures else None
                self._draw_face(canvas, face, area, texture)
        return canvas

    def _draw_face(
        self, canvas: Canvas, face: Face, area: tuple[slice, slice], texture: Texture | None
    ) -> None:
        """Draw the pixels of a face that nothing nearer hides."""
        s, t, inverse_depth = np.moveaxis(self._rays[area] @ face.g.T.astype(np.float32), 2, 0)
        inside = (s >= 0) & (t >= 0) & (inverse_depth >= s) & (inverse_depth >= t)
        nearer = canvas.take(area, inside, inverse_depth, face.owner)
        if canvas.pixels is not None and texture is not None and nearer.any():
            picture = texture.level(int(np.count_nonzero(inside)))
            height, width = picture.shape[:2]
            depth = 1 / inverse_depth[nearer]
            columns = (s[nearer] * depth * width).astype(np.intp).clip(0, width - 1)
            rows = (t[nearer] * depth * height).astype(np.intp).clip(0, height - 1)
            canvas.pixels[area][nearer] = shaded(picture[rows, columns], face)

    def _areas(self, faces: Sequence[Face]) -> Iterator[tuple[slice, slice] | None]:
        """Yield the rows and columns of the blocks that each face may reach, None without any."""
        if not faces:
            return
        sides = np.linalg.inv(np.array([face.g for face in faces]))
        s, t, origins = np.moveaxis(sides, 2, 0)
        corners = origins[:, None] + np.stack([np.zeros_like(s), s, t, s + t], axis=1)
        corners /= np.linalg.norm(corners, axis=2, keepdims=True)
        middles = corners.sum(axis=1)
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        least = np.einsum('ijc,ic->ij', corners, middles).min(axis=1)
        # A cone of less than 90 degrees around the corners is around all that is between them.
        spans = np.where(least > 0, np.arccos(least.clip(-1, 1)), np.pi)
        away = np.arccos((self._blocks @ middles.T).clip(-1, 1))
        reached = np.moveaxis(away <= spans + self._block_spans[..., None], 2, 0)
        in_rows, in_columns = reached.any(axis=2), reached.any(axis=1)
        for rows, columns in zip(in_rows, in_columns, strict=True):
            yield (_span(rows), _span(columns)) if rows.any() else None

    def _backdrop(self, street_T_velo: Transform) -> Picture:
        """Return a new image of road and sky."""
        street_t_cam = street_T_velo @ self._cam_T_velo.inverse()
        height, width = self._rays.shape[:2]
        image = np.zeros((height, width, 3), np.uint8)
        sees = np.isfinite(self._rays[..., 2])
        x, y, up = (self._rays[sees] @ street_t_cam.rotation.T.astype(np.float32)).T
        eye = street_t_cam.translation.astype(np.float32)
        pixels = np.empty((len(up), 3), np.uint8)
        pixels[:] = HAZE
        above = up > 0
        turn, rows = self._sky.shape[1], self._sky.shape[0]
        columns = (np.arctan2(-y[above], x[above]) * np.float32(turn / (2 * np.pi))).astype(np.intp)
        down = (1 - np.arcsin(up[above].clip(0, 1)) * np.float32(2 / np.pi)) * (rows - 1)
        pixels[above] = self._sky[down.astype(np.intp), columns % turn]
        ground = np.flatnonzero(up < -eye[2] / np.float32(FARTHEST))
        reach = -eye[2] / up[ground]
        bands = np.searchsorted(_BANDS, reach)
        for band in np.unique(bands).tolist():
            there = bands == band
            texels = texels_at(float(np.median(reach[there])), self._focal)
            picture = self._road.shrunk(texels, texels)
            at, far = ground[there], reach[there]
            along, across = eye[0] + far * x[at], eye[1] + far * y[at]
            across += np.float32(ROAD_HALF_WIDTH) - self._course.y_array(along)
            rows, columns = _texels(picture, along % np.float32(ROAD_PERIOD), across)
            pixels[at] = picture[rows, columns]
        image[sees] = pixels
        return as_picture(image)


def _rays(lens: Lens, bent: Float64Array) -> Float64Array:
    """Return the rays of pixels; NaN for those in the corners, whose search would take seconds."""
    turns = np.linspace(0, 2 * np.pi, 60)
    sines = np.sqrt(1 - _WIDEST**2) * np.array([np.cos(turns), np.sin(turns)])
    edge = lens.bent(np.column_stack([*sines, np.full(len(turns), _WIDEST)]))
    radii = np.linalg.norm(bent, axis=1)
    inside = np.flatnonzero(radii < np.linalg.norm(edge, axis=1).max())
    rays = np.full((len(bent), 3), np.nan)
    # Those in the middle take fewer steps.
    for ring in np.array_split(inside[np.argsort(radii[inside])], 1 + len(inside) // 10_000):
        rays[ring] = lens.rays(bent[ring])
    return rays


def _span(blocks: npt.NDArray[np.bool_]) -> slice:
    """Return the pixels from the first to the last block."""
    there = np.flatnonzero(blocks)
    return slice(int(there[0]) * _BLOCK, (int(there[-1]) + 1) * _BLOCK)


def _texels(
    picture: Picture, along: Float32Array, across: Float32Array
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return rows and columns in a picture of the road."""
    height, width = picture.shape[:2]
    rows = (across * np.float32(height / (2 * ROAD_HALF_WIDTH))).astype(np.intp)
    columns = (along * np.float32(width / ROAD_PERIOD)).astype(np.intp)
    return rows.clip(0, height - 1), columns.clip(0, width - 1)


def _cones_of_blocks(rays: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Return the middle rays of blocks of pixels, (rows, columns, 3), and their spans.

    The span is the angle to the farthest ray, radians; -pi of a block that sees nothing.
    """
    height, width = (-(-side // _BLOCK) for side in rays.shape[:2])
    padded = np.full((height * _BLOCK, width * _BLOCK, 3), np.nan)
    padded[: rays.shape[0], : rays.shape[1]] = rays
    blocks = padded.reshape(height, _BLOCK, width, _BLOCK, 3).transpose(0, 2, 1, 3, 4)
    blocks = blocks.reshape(height, width, _BLOCK * _BLOCK, 3)
    sees = np.isfinite(blocks[..., 2])
    middles = np.where(sees[..., None], blocks, 0).sum(axis=2)
    lengths = np.linalg.norm(middles, axis=2, keepdims=True)
    middles = np.divide(middles, lengths, out=np.zeros_like(middles), where=lengths > 0)
    cosines = np.where(sees, np.einsum('ijkc,ijc->ijk', blocks, middles), 1).min(axis=2)
    spans = np.where(sees.any(axis=2), np.arccos(cosines.clip(-1, 1)), -np.pi)
    return middles, spans
