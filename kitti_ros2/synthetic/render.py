# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic cameras: flat textured faces drawn with a depth buffer, the ground, the sky.

For a face with origin O and sides S, T (points O + s S + t T, 0 <= s, t <= 1) the matrix
G = (P [S T O])^-1 takes a pixel to (s, t, 1) / depth. So the face covers a pixel where
G1 >= 0, G2 >= 0, G3 - G1 >= 0 and G3 - G2 >= 0, which holds without clipping for faces that reach
behind the camera, and G3 is the inverse depth: all four are planes over the image. A pixel's ray
goes through its centre, which has whole coordinates as KITTI's P has it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from .textures import HAZE, Texture, as_picture

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from .scene import PlacedSolid
    from .textures import Picture

SUN = np.array([-0.45, 0.6, 0.66])
"""Towards the sun in velo_link: fixed to the car, so that the lit sides face the cameras."""

NOTHING = 0
_HAZE_DISTANCE = 260.0
_FACE_SHADE = 0.55

# Of each face: origin, s side and t side, in units of half length, half width and height.
_FACES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]] = {
    'left': ((1, 1, 1), (-2, 0, 0), (0, 0, -1)),
    'right': ((-1, -1, 1), (2, 0, 0), (0, 0, -1)),
    'front': ((1, -1, 1), (0, 2, 0), (0, 0, -1)),
    'back': ((-1, 1, 1), (0, -2, 0), (0, 0, -1)),
    'top': ((1, 1, 1), (0, -2, 0), (-2, 0, 0)),
    'bottom': ((1, -1, 0), (0, 2, 0), (-2, 0, 0)),
}
_FACE_NAMES = tuple(_FACES)
_CORNERS = np.array(list(_FACES.values()), dtype=np.float64)


class Face(NamedTuple):
    """One face of a box in the view of a camera.

    Attributes:
        owner: Index of its box.
        name: Name of the face.
        g: (3, 3), pixel to (s, t, 1) / depth.
        shade: Illumination, 0..1.
        distance: Of its box, metres.
    """

    owner: int
    name: str
    g: Float64Array
    shade: float
    distance: float


@dataclass(frozen=True, eq=False)
class Canvas:
    """An image being drawn.

    Attributes:
        pixels: (height, width) or (height, width, 3) uint8, None if only ids are requested.
        inverse_depth: (height, width) float32, 1/m, 0 without a box.
        ids: (height, width) uint16, index of the box drawn plus one, NOTHING elsewhere.
        covered: Pixels of each box without occlusion by others.
    """

    pixels: Picture | None
    inverse_depth: Float32Array
    ids: npt.NDArray[np.uint16]
    covered: npt.NDArray[np.int64]


def visible_faces(
    placed: Sequence[PlacedSolid], projection: Float64Array, size: tuple[int, int]
) -> list[Face]:
    """Return the faces that are turned to a camera and may be in its image, nearest box first.

    Args:
        placed: The boxes, in velo_link.
        projection: (3, 4), velo_link to pixels.
        size: (width, height).
    """
    eye = -np.linalg.inv(projection[:, :3]) @ projection[:, 3]
    origins, sides_s, sides_t = _face_corners(placed)
    normals = np.cross(sides_t, sides_s)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    towards = ((eye - origins) * normals).sum(axis=2) > 1e-3
    columns = np.stack(
        [
            sides_s @ projection[:, :3].T,
            sides_t @ projection[:, :3].T,
            origins @ projection[:, :3].T + projection[:, 3],
        ],
        axis=3,
    )
    seen = towards & _may_be_seen(columns, size)
    shades = _FACE_SHADE + (1 - _FACE_SHADE) * np.clip(normals @ SUN, 0.0, 1.0)
    return [
        Face(
            int(owner),
            _FACE_NAMES[face],
            np.linalg.inv(columns[owner, face]),
            float(shades[owner, face]),
            placed[owner].distance,
        )
        for owner, face in zip(*np.nonzero(seen), strict=True)
    ]


def draw_face(canvas: Canvas, face: Face, texture: Texture | None) -> None:
    """Draw the pixels of a face that nothing nearer hides."""
    height, width = canvas.inverse_depth.shape
    window = _covered_window(face.g, width, height)
    if window is None:
        return
    top, left, inside = window
    canvas.covered[face.owner] += int(np.count_nonzero(inside))
    rows, columns = inside.shape
    area = (slice(top, top + rows), slice(left, left + columns))
    inverse_depth = _plane(face.g[2], left, top, columns, rows)
    nearer = inside & (inverse_depth > canvas.inverse_depth[area])
    if not nearer.any():
        return
    np.copyto(canvas.inverse_depth[area], inverse_depth, where=nearer)
    np.copyto(canvas.ids[area], np.uint16(face.owner + 1), where=nearer)
    if canvas.pixels is not None and texture is not None:
        patch = _warp(face, texture, (left, top, columns, rows), inside)
        cv2.copyTo(patch, nearer.view(np.uint8), canvas.pixels[area])


def _face_corners(
    placed: Sequence[PlacedSolid],
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return origins and sides (N, 6, 3) of all faces, velo_link."""
    sizes = np.array([one.solid.size for one in placed]).reshape(-1, 3) * (0.5, 0.5, 1.0)
    centres = np.array([one.centre for one in placed]).reshape(-1, 3)
    cosines = np.cos([one.yaw for one in placed])[:, None]
    sines = np.sin([one.yaw for one in placed])[:, None]

    def turned(units: Float64Array) -> Float64Array:
        x, y, z = np.moveaxis(units[None] * sizes[:, None], 2, 0)
        return np.stack([cosines * x - sines * y, sines * x + cosines * y, z], axis=2)

    origins, sides_s, sides_t = (turned(_CORNERS[:, part]) for part in range(3))
    return origins + centres[:, None], sides_s, sides_t


def _may_be_seen(columns: Float64Array, size: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Whether not all corners are beyond one border of the image, or behind the camera."""
    s, t, o = columns[..., 0], columns[..., 1], columns[..., 2]
    corners = np.stack([o, o + s, o + t, o + s + t], axis=2)
    u, v, depth = corners[..., 0], corners[..., 1], corners[..., 2]
    width, height = size
    beyond = (u < -depth, u > width * depth, v < -depth, v > height * depth, depth < 0.05)
    outside = np.zeros(u.shape[:2], dtype=np.bool_)
    for side in beyond:
        outside |= side.all(axis=2)
    return ~outside


def _covered_window(
    g: Float64Array, width: int, height: int
) -> tuple[int, int, npt.NDArray[np.bool_]] | None:
    """Return (top, left, mask) of the pixels of a face, None if there are none."""
    edges = np.stack([g[0], g[1], g[2] - g[0], g[2] - g[1]])
    rows = np.arange(height)
    left, right = np.zeros(height), np.full(height, width - 1.0)
    for a, b, c in edges:
        along = b * rows + c
        if abs(a) < 1e-12 * abs(c):
            right = np.where(along >= 0, right, -1.0)
        elif a > 0:
            left = np.maximum(left, along / -a)
        else:
            right = np.minimum(right, along / -a)
    first, last = np.ceil(left), np.floor(right)
    filled = np.flatnonzero(first <= last)
    if not len(filled):
        return None
    span = slice(filled[0], filled[-1] + 1)
    first, last = first[span, None], last[span, None]
    start, end = int(first.min()), int(last.max()) + 1
    start, end = max(start, 0), min(end, width)
    columns = np.arange(start, end)
    return int(filled[0]), start, (columns >= first) & (columns <= last)


def _plane(
    coefficients: Float64Array, left: int, top: int, columns: int, rows: int
) -> Float32Array:
    """Return A u + B v + C over a window of pixels."""
    a, b, c = coefficients
    across = (a * np.arange(left, left + columns)).astype(np.float32)
    down = (b * np.arange(top, top + rows) + c).astype(np.float32)
    values: Float32Array = across[None, :] + down[:, None]
    return values


def _warp(
    face: Face,
    texture: Texture,
    window: tuple[int, int, int, int],
    inside: npt.NDArray[np.bool_],
) -> Picture:
    """Return the texture of a face over a window of pixels, shaded, paler with distance."""
    left, top, columns, rows = window
    height, width = texture.levels[0].shape[:2]
    texels_per_pixel = height * width / max(1, np.count_nonzero(inside))
    level = int(np.clip(np.log2(texels_per_pixel) / 2 - 0.2, 0, len(texture.levels) - 1))
    picture = texture.levels[level]
    height, width = picture.shape[:2]
    to_texel = np.array([[width, 0, -0.5], [0, height, -0.5], [0, 0, 1.0]])
    to_pixel = np.array([[1, 0, left], [0, 1, top], [0, 0, 1.0]])
    patch = cv2.warpPerspective(
        picture,
        to_texel @ face.g @ to_pixel,
        (columns, rows),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    haze = face.distance / _HAZE_DISTANCE
    shaded = cv2.convertScaleAbs(patch, alpha=face.shade * (1 - haze), beta=haze * HAZE[1])
    return as_picture(shaded)


def draw_solids(
    placed: Sequence[PlacedSolid],
    projection: Float64Array,
    size: tuple[int, int],
    background: Picture | None,
    textures: Callable[[PlacedSolid, str], Texture],
) -> Canvas:
    """Draw all boxes over a background.

    Args:
        placed: The boxes in velo_link, nearest first.
        projection: (3, 4), velo_link to pixels.
        size: (width, height).
        background: The image to draw into, None if only depth and ids are requested.
        textures: The texture of a box's face.
    """
    width, height = size
    canvas = Canvas(
        background,
        np.zeros((height, width), np.float32),
        np.full((height, width), NOTHING, np.uint16),
        np.zeros(len(placed), np.int64),
    )
    for face in visible_faces(placed, projection, size):
        texture = None if background is None else textures(placed[face.owner], face.name)
        draw_face(canvas, face, texture)
    return canvas
