# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The images of the synthetic cameras: backgrounds, and faces with a depth buffer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ..files.image_files import encode_png
from ..model.geometry import rotation_to_rpy
from ..model.samples import Image
from ..model.streams import PngForm
from .scene import ROAD_CENTRE, ROAD_LEFT, ROAD_RIGHT, SCANNER_HEIGHT
from .textures import (
    HAZE,
    Colour,
    Picture,
    Texture,
    as_picture,
    grained,
    paint,
    without_colour,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Float32Array
    from .scene import Course, Look, PlacedSolid


# The synthetic cameras: flat textured faces drawn with a depth buffer, the ground, the sky.
#
# For a face with origin O and sides S, T (points O + s S + t T, 0 <= s, t <= 1) the matrix
# G = (P [S T O])^-1 takes a pixel to (s, t, 1) / depth. So the face covers a pixel where
# G1 >= 0, G2 >= 0, G3 - G1 >= 0 and G3 - G2 >= 0, which holds without clipping for faces that reach
# behind the camera, and G3 is the inverse depth: all four are planes over the image. A pixel's ray
# goes through its centre, which has whole coordinates as KITTI's P has it.

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

    @classmethod
    def empty(cls, size: tuple[int, int], background: Picture | None, boxes: int) -> Canvas:
        """Return a canvas of (width, height) without any of so many boxes."""
        shape = size[::-1]
        return cls(
            background,
            np.zeros(shape, np.float32),
            np.full(shape, NOTHING, np.uint16),
            np.zeros(boxes, np.int64),
        )

    def take(
        self,
        area: tuple[slice, slice],
        inside: npt.NDArray[np.bool_],
        inverse_depth: Float32Array,
        owner: int,
    ) -> npt.NDArray[np.bool_]:
        """Enter a face's pixels in a window; return those that nothing nearer hides."""
        self.covered[owner] += int(np.count_nonzero(inside))
        nearer: npt.NDArray[np.bool_] = inside & (inverse_depth > self.inverse_depth[area])
        np.copyto(self.inverse_depth[area], inverse_depth, where=nearer)
        np.copyto(self.ids[area], np.uint16(owner + 1), where=nearer)
        return nearer


def visible_faces(
    placed: Sequence[PlacedSolid], projection: Float64Array, size: tuple[int, int] | None = None
) -> list[Face]:
    """Return the faces that are turned to a camera and may be in its image, nearest box first.

    Args:
        placed: The boxes, in velo_link.
        projection: (3, 4), velo_link to pixels.
        size: (width, height); None: in any direction.
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
    seen = towards if size is None else towards & _may_be_seen(columns, size)
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
    rows, columns = inside.shape
    area = (slice(top, top + rows), slice(left, left + columns))
    inverse_depth = _plane(face.g[2], left, top, columns, rows)
    nearer = canvas.take(area, inside, inverse_depth, face.owner)
    if canvas.pixels is not None and texture is not None and nearer.any():
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
    picture = texture.level(int(np.count_nonzero(inside)))
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
    return shaded(patch, face)


def shaded(patch: npt.NDArray[Any], face: Face) -> Picture:
    """Return a part of the texture of a face, shaded, paler with distance."""
    haze = face.distance / _HAZE_DISTANCE
    alpha, beta = face.shade * (1 - haze), haze * HAZE[1]
    return as_picture(cv2.convertScaleAbs(patch, alpha=alpha, beta=beta))


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
    canvas = Canvas.empty(size, background, len(placed))
    for face in visible_faces(placed, projection, size):
        texture = None if background is None else textures(placed[face.owner], face.name)
        draw_face(canvas, face, texture)
    return canvas


# Backgrounds of the synthetic images: the winding road on the ground, and the sky.

_PER_METRE = 32
ROAD_PERIOD = 24.0
ROAD_HALF_WIDTH = 16.0
FARTHEST = 400.0
_BANDS = 5.0 * 1.6 ** np.arange(10)
"""Depths at which the ground changes to a coarser picture of the road, metres."""


class Road:
    """The picture of the road, shrunk along and across it separately.

    Args:
        seed: Of the grain.
        grey: Whether it has no colour.
    """

    def __init__(self, seed: int, *, grey: bool) -> None:
        road = _paint_road(seed, (ROAD_RIGHT, ROAD_LEFT), ROAD_CENTRE, _PER_METRE)
        self._shrunk = {(0, 0): without_colour(road) if grey else road}

    def shrunk(self, along: float, across: float) -> Picture:
        """Return the picture with about one texel in a pixel, where the whole one has so many."""
        key = int(np.clip(np.log2(along), 0, 7)), int(np.clip(np.log2(across), 0, 6))
        if key not in self._shrunk:
            rows, columns = self._shrunk[0, 0].shape[:2]
            size = (max(1, columns >> key[0]), max(1, rows >> key[1]))
            small = cv2.resize(self._shrunk[0, 0], size, interpolation=cv2.INTER_AREA)
            self._shrunk[key] = as_picture(small)
        return self._shrunk[key]


class Backdrop:
    """Draws sky and ground of one camera.

    Seen from a car, the road is foreshortened a hundred times more along than across.

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
        self._road = Road(seed, grey=grey)
        sky = paint_sky(round(2 * np.pi * focal), size[1], seed)
        sky = np.concatenate([sky, sky[:, : size[0]]], axis=1)
        self._sky = without_colour(sky) if grey else sky

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
        depths = np.where(inverse_depth > 1 / FARTHEST, 1 / inverse_depth, np.inf)
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
        x += start_x % np.float32(ROAD_PERIOD)
        y += np.float32(ROAD_HALF_WIDTH)
        across = texels_at(depth, self._focal)
        picture = self._road.shrunk(across * depth / SCANNER_HEIGHT, across)
        scale_x = np.float32(picture.shape[1] / ROAD_PERIOD)
        scale_y = np.float32(picture.shape[0] / (2 * ROAD_HALF_WIDTH))
        image[rows] = cv2.remap(
            picture,
            x * scale_x - np.float32(0.5),
            np.clip(y * scale_y - np.float32(0.5), 0, picture.shape[0] - 1),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_WRAP,
        )


def texels_at(depth: float, focal: float) -> float:
    """Return the texels of the whole picture of the road in a pixel at a depth."""
    return depth / focal * _PER_METRE


def _paint_road(seed: int, edges: tuple[float, float], centre: float, per_metre: int) -> Picture:
    """Draw the ground along the ego lane, which is at y = 0.

    Args:
        seed: Of the grain.
        edges: y of the road's right and left kerb, metres.
        centre: y of the line between its lanes, metres.
        per_metre: Pixels.

    Returns:
        Rows across, from y = -ROAD_HALF_WIDTH; columns along, for one period of ROAD_PERIOD.
    """
    rng = np.random.default_rng([seed, 3])
    right, left = edges
    shape = (round(2 * ROAD_HALF_WIDTH * per_metre), round(ROAD_PERIOD * per_metre), 3)
    ground = np.empty(shape, np.uint8)
    ground[:] = (64, 112, 96)

    def strip(start: float, end: float, colour: Colour, columns: slice = slice(None)) -> None:
        ground[_along(start + ROAD_HALF_WIDTH, end + ROAD_HALF_WIDTH, per_metre), columns] = colour

    strip(right - 5.0, left + 5.0, (150, 156, 160))
    for joint in np.arange(0.0, ROAD_PERIOD, 1.0):
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


def paint_sky(width: int, height: int, seed: int) -> Picture:
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


# The synthetic cameras: their textures, and their images as PNG files.

_PNG_LEVEL = 1
_PIXEL_NOISE = 1.6
_NOISE_MARGIN = 64


class Noise:
    """The noise of images: windows of one large picture of it, placed by camera and frame.

    Args:
        size: (width, height) of the images.
        seed: Of the noise.
        grey: Whether the images have no colour.
    """

    def __init__(self, size: tuple[int, int], seed: int, *, grey: bool) -> None:
        self._size = width, height = size
        shape: tuple[int, ...] = (height + _NOISE_MARGIN, width + _NOISE_MARGIN)
        rng = np.random.default_rng([seed, 6])
        noise = rng.normal(0.0, _PIXEL_NOISE, shape if grey else (*shape, 3))
        self._noise = noise.round().astype(np.int16)

    def added(self, image: Picture, camera: int, frame: int) -> Picture:
        """Return an image with noise."""
        width, height = self._size
        top = (frame * 29 + camera * 17) % _NOISE_MARGIN
        left = (frame * 43 + camera * 31) % _NOISE_MARGIN
        noise = self._noise[top : top + height, left : left + width]
        return as_picture(cv2.add(image, noise, dtype=cv2.CV_8U))


class Cameras:
    """Draws images; textures are made once, on first use.

    Args:
        size: (width, height) of the images.
        focal: Focal length, pixels.
        seed: Of the textures' grain and the sensors' noise.
        course: The ego lane.
    """

    def __init__(self, size: tuple[int, int], focal: float, seed: int, course: Course) -> None:
        self._course = course
        self._size = size
        self._focal = focal
        self._seed = seed
        self._textures: dict[tuple[Look, tuple[float, float, float], bool], dict[str, Texture]] = {}
        self._backdrops: dict[bool, Backdrop] = {}
        self._noise: dict[bool, Noise] = {}

    def instances(self, placed: Sequence[PlacedSolid], projection: Float64Array) -> Canvas:
        """Return the box and the depth of each pixel, without an image.

        Args:
            placed: The boxes in velo_link, nearest first.
            projection: (3, 4), velo_link to pixels.
        """
        return draw_solids(placed, projection, self._size, None, self.texture)

    def photograph(
        self,
        camera: int,
        frame: int,
        placed: Sequence[PlacedSolid],
        projection: Float64Array,
        street_T_velo: Transform,
        *,
        grey: bool,
    ) -> Picture:
        """Draw an image, (height, width) or (height, width, 3) uint8, BGR.

        Args:
            camera: KITTI's index.
            frame: File number; the noise differs from one to the next.
            placed: The boxes in velo_link, nearest first.
            projection: (3, 4), velo_link to pixels.
            street_T_velo: Pose of the scanner.
            grey: Whether the image has no colour.
        """
        if grey not in self._backdrops:
            self._noise[grey] = Noise(self._size, self._seed, grey=grey)
            self._backdrops[grey] = Backdrop(
                self._size, self._focal, self._seed, self._course, grey=grey
            )
        image = self._backdrops[grey].draw(projection, street_T_velo)
        texture = self._grey_texture if grey else self.texture
        draw_solids(placed, projection, self._size, image, texture)
        return self._noise[grey].added(image, camera, frame)

    def texture(self, one: PlacedSolid, face: str) -> Texture:
        """Return the texture of a face of a box."""
        return self._painted(one, grey=False)[face]

    def _grey_texture(self, one: PlacedSolid, face: str) -> Texture:
        return self._painted(one, grey=True)[face]

    def _painted(self, one: PlacedSolid, *, grey: bool) -> dict[str, Texture]:
        look = one.solid.look._replace(reflectance=0.0)
        size = one.solid.size if look.style == 'Building' else (0.0, 0.0, 0.0)
        key = (look, size, grey)
        if key not in self._textures:
            if grey:
                faces = self._painted(one, grey=False)
                self._textures[key] = {name: face.grey() for name, face in faces.items()}
            else:
                self._textures[key] = paint(look, one.solid.size, self._seed)
        return self._textures[key]


def encode_image(picture: Picture, form: PngForm = PngForm.KITTI) -> Image:
    """Encode a picture as a PNG file in the form of a layout."""
    height, width = picture.shape[:2]
    channels = 1 if picture.ndim == 2 else picture.shape[2]
    return Image(encode_png(picture, form), width, height, channels)
