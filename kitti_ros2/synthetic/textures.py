# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Textures of the synthetic street: one for each face of each look.

A texture is a pyramid of uint8 BGR pictures, each half the size of the one before, drawn once.
Textures are seen from outside: left to right, top to bottom.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .scene import Look

Picture: TypeAlias = npt.NDArray[np.uint8]
Colour: TypeAlias = tuple[int, int, int]

FACES = ('left', 'right', 'front', 'back', 'top', 'bottom')
HAZE: Colour = (214, 208, 200)

_BODIES: tuple[Colour, ...] = (
    (42, 40, 38), (186, 188, 190), (120, 122, 126), (38, 40, 150),
    (128, 74, 34), (206, 206, 204), (70, 84, 60), (60, 120, 168),
)  # fmt: skip
_PLASTERS: tuple[Colour, ...] = (
    (146, 176, 200), (170, 186, 190), (70, 92, 150), (186, 196, 204), (120, 150, 178),
)  # fmt: skip
_SHIRTS: tuple[Colour, ...] = (
    (40, 40, 170), (150, 80, 40), (60, 150, 70), (40, 170, 210), (90, 60, 110), (200, 200, 196),
)  # fmt: skip
_GLASS: Colour = (74, 62, 50)
_BLACK: Colour = (24, 24, 24)
_PIXELS_PER_BAY = 64
_NOMINAL_SIZES = {
    'Car': (4.1, 1.72, 1.5),
    'Van': (4.9, 1.9, 2.0),
    'Truck': (7.2, 2.4, 3.0),
    'Pedestrian': (0.6, 0.6, 1.75),
    'Cyclist': (1.8, 0.62, 1.75),
    'Hedge': (14.9, 3.0, 4.5),
    'Crown': (1.5, 1.5, 2.5),
    'Trunk': (0.3, 0.3, 2.4),
    'Post': (0.2, 0.2, 6.0),
}
"""Nominal size of a style, metres; its boxes share textures, houses have their own."""


class Texture(NamedTuple):
    """A picture at full size, half, a quarter, ..."""

    levels: tuple[Picture, ...]

    @classmethod
    def of(cls, picture: Picture) -> Texture:
        """Build the pyramid of a picture."""
        levels = [picture]
        while min(levels[-1].shape[:2]) >= 4:
            height, width = levels[-1].shape[:2]
            levels.append(_shrunk(levels[-1], width // 2, height // 2))
        return cls(tuple(levels))

    def level(self, pixels: int) -> Picture:
        """Return the picture with about as many texels as a face has pixels."""
        height, width = self.levels[0].shape[:2]
        texels_per_pixel = height * width / max(1, pixels)
        level = int(np.clip(np.log2(texels_per_pixel) / 2 - 0.2, 0, len(self.levels) - 1))
        return self.levels[level]

    def grey(self) -> Texture:
        """Return the same texture without colour."""
        return Texture(tuple(without_colour(one) for one in self.levels))


def paint(look: Look, size: tuple[float, float, float], seed: int) -> dict[str, Texture]:
    """Return the textures of a box's faces, by the names of FACES.

    Args:
        look: Style and variant.
        size: Length, width, height, metres; a house gets as many bays and storeys as fit.
        seed: Of the grain.
    """
    rng = np.random.default_rng([seed, 2, look.variant])
    faces = _PAINTERS[look.style](look.variant, _NOMINAL_SIZES.get(look.style, size))
    # Faces that share a picture share the texture: opposite walls, all sides of a tree.
    textures = {id(face): Texture.of(grained(rng, face)) for face in faces}
    return {name: textures[id(face)] for name, face in zip(FACES, faces, strict=True)}


def _plain(width: int, height: int, colour: Colour) -> Picture:
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = colour
    return picture


def grained(rng: np.random.Generator, picture: Picture, strength: float = 5.0) -> Picture:
    """Return a picture with grey noise of a standard deviation added."""
    grain = rng.standard_normal(picture.shape[:2], np.float32) * np.float32(strength)
    return as_picture(cv2.add(picture, np.dstack([grain] * 3), dtype=cv2.CV_8U))


def as_picture(picture: npt.NDArray[Any]) -> Picture:
    """Return an array as contiguous uint8; no copy if it is that already."""
    return np.ascontiguousarray(picture, dtype=np.uint8)


def without_colour(picture: Picture) -> Picture:
    """Return the grey (height, width) of a BGR picture."""
    return as_picture(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))


def _shrunk(picture: Picture, width: int, height: int) -> Picture:
    size = (max(width, 1), max(height, 1))
    return as_picture(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


def _box(picture: Picture, corners: tuple[float, float, float, float], colour: Colour) -> None:
    """Fill left, top, right, bottom, given as fractions of the picture."""
    height, width = picture.shape[:2]
    left, top, right, bottom = corners
    rows = slice(round(top * height), round(bottom * height))
    picture[rows, round(left * width) : round(right * width)] = colour


def _disc(picture: Picture, at: tuple[float, float], radius: float, colour: Colour) -> None:
    """Fill a disc; at in fractions of the picture, radius of its height."""
    height, width = picture.shape[:2]
    rows, columns = np.mgrid[:height, :width]
    inside = np.hypot(columns - at[0] * width, rows - at[1] * height) < radius * height
    picture[inside] = colour


def _vehicle(variant: int, size: tuple[float, float, float], windows: float) -> list[Picture]:
    """Draw a car: windows reach down to a fraction of its height; the front is on the right."""
    body = _BODIES[variant % len(_BODIES)]
    dark: Colour = (body[0] * 2 // 3, body[1] * 2 // 3, body[2] * 2 // 3)
    length, width, height = (round(metres * 60) for metres in size)
    side = _plain(length, height, body)
    _box(side, (0.0, 0.86, 1.0, 1.0), _BLACK)
    for left, right in ((0.12, 0.34), (0.37, 0.58), (0.61, 0.82)):
        _box(side, (left, 0.1, right, windows), _GLASS)
    _box(side, (0.36, windows, 0.365, 0.86), dark)
    _box(side, (0.6, windows, 0.605, 0.86), dark)
    for wheel in (0.19, 0.81):
        _disc(side, (wheel, 0.8), 0.22, _BLACK)
        _disc(side, (wheel, 0.8), 0.12, (140, 140, 142))
    front = _plain(width, height, body)
    _box(front, (0.08, 0.08, 0.92, windows), _GLASS)
    _box(front, (0.0, 0.88, 1.0, 1.0), _BLACK)
    back = front.copy()
    for left, right in ((0.03, 0.2), (0.8, 0.97)):
        _box(front, (left, 0.58, right, 0.7), (220, 236, 240))
        _box(back, (left, 0.55, right, 0.7), (30, 30, 190))
    _box(front, (0.3, 0.6, 0.7, 0.78), _BLACK)
    _box(back, (0.36, 0.66, 0.64, 0.76), (225, 228, 228))
    top = _plain(width, length, body)
    _box(top, (0.08, 0.2, 0.92, 0.36), _GLASS)
    return [as_picture(side[:, ::-1]), side, front, back, top, _plain(8, 8, _BLACK)]


def _car(variant: int, size: tuple[float, float, float]) -> list[Picture]:
    return _vehicle(variant, size, 0.46)


def _truck(variant: int, size: tuple[float, float, float]) -> list[Picture]:
    faces = _vehicle(variant, size, 0.34)
    for side, cab in ((faces[0], (0.0, 0.22)), (faces[1], (0.78, 1.0))):
        load = (0.24, 1.0) if cab[0] == 0.0 else (0.0, 0.76)
        _box(side, (load[0], 0.02, load[1], 0.74), (188, 192, 196))
    _box(faces[3], (0.04, 0.03, 0.96, 0.5), (176, 180, 184))
    return faces


def _person(variant: int, size: tuple[float, float, float]) -> list[Picture]:
    shirt, skin = _SHIRTS[variant % len(_SHIRTS)], (120, 150, 205)
    width, height = 64, round(80 * size[2])
    body = _plain(width, height, (104, 104, 102))
    _box(body, (0.12, 0.2, 0.88, 0.55), shirt)
    _box(body, (0.2, 0.55, 0.47, 0.97), (90, 60, 40))
    _box(body, (0.53, 0.55, 0.8, 0.97), (90, 60, 40))
    _disc(body, (0.5, 0.11), 0.09, skin)
    _box(body, (0.35, 0.01, 0.65, 0.06), (30, 40, 52))
    top = _plain(32, 32, (40, 46, 56))
    return [body, as_picture(body[:, ::-1]), body, body, top, top]


def _cyclist(variant: int, size: tuple[float, float, float]) -> list[Picture]:
    faces = _person(variant, size)
    side = _plain(round(70 * size[0]), round(70 * size[2]), (104, 104, 102))
    _box(side, (0.36, 0.2, 0.62, 0.55), _SHIRTS[variant % len(_SHIRTS)])
    _box(side, (0.4, 0.5, 0.56, 0.82), (90, 60, 40))
    _disc(side, (0.54, 0.11), 0.09, (120, 150, 205))
    for wheel in (0.2, 0.8):
        _disc(side, (wheel, 0.8), 0.19, _BLACK)
        _disc(side, (wheel, 0.8), 0.15, (110, 110, 108))
    _box(side, (0.2, 0.72, 0.8, 0.75), (40, 40, 160))
    return [as_picture(side[:, ::-1]), side, *faces[2:]]


def _house(variant: int, size: tuple[float, float, float]) -> list[Picture]:
    """Draw storeys of windows over a ground floor with doors, brick or plaster."""
    plaster = _PLASTERS[variant % len(_PLASTERS)]
    bay = _plain(_PIXELS_PER_BAY, _PIXELS_PER_BAY * 6 // 5, plaster)
    if variant % 2 == 0:
        mortar: Colour = (plaster[0] * 4 // 5, plaster[1] * 4 // 5, plaster[2] * 4 // 5)
        for course, row in enumerate(range(0, bay.shape[0], 6)):
            bay[row] = mortar
            bay[row : row + 6, 6 * (course % 2) :: 12] = mortar
    window, door = bay.copy(), bay.copy()
    _box(window, (0.24, 0.2, 0.76, 0.74), (226, 230, 232))
    _box(window, (0.28, 0.23, 0.72, 0.71), _GLASS)
    _box(window, (0.49, 0.23, 0.51, 0.71), (226, 230, 232))
    _box(window, (0.2, 0.74, 0.8, 0.78), (160, 164, 166))
    _box(door, (0.3, 0.25, 0.7, 1.0), (44, 62, 96))
    _box(door, (0.62, 0.6, 0.66, 0.66), (190, 200, 210))

    def wall(metres: float) -> Picture:
        bays = max(1, round(metres / 2.5))
        upper = [np.concatenate([window] * bays, axis=1)] * (max(1, round(size[2] / 3.0)) - 1)
        ground = [door if index % 3 == 1 else window for index in range(bays)]
        return np.concatenate([*upper, np.concatenate(ground, axis=1)])

    roof = _plain(64, 64, (60, 62, 108))
    street, end = wall(size[0]), wall(size[1])
    return [street, street, end, end, roof, roof]


def _bulk(colour: Colour, mottle: int) -> Callable[..., list[Picture]]:
    """Draw one mottled colour on all faces: leaves, bark, metal."""

    def painter(variant: int, size: tuple[float, float, float]) -> list[Picture]:
        rng = np.random.default_rng([variant, 5])
        shape = (max(8, round(24 * size[2])), max(8, round(24 * size[0])), 1)
        spots = rng.normal(0, mottle, shape).astype(np.float32)
        spots = cv2.GaussianBlur(spots, (0, 0), 1.0)[:, :, None] * 2.5
        face = (np.array(colour) + spots).clip(0, 255).astype(np.uint8)
        return [face] * 6

    return painter


_PAINTERS: dict[str, Callable[[int, tuple[float, float, float]], Sequence[Picture]]] = {
    'Car': _car,
    'Van': _car,
    'Truck': _truck,
    'Pedestrian': _person,
    'Cyclist': _cyclist,
    'Building': _house,
    'Hedge': _bulk((52, 96, 70), 26),
    'Crown': _bulk((48, 104, 66), 34),
    'Trunk': _bulk((52, 70, 92), 12),
    'Post': _bulk((120, 122, 120), 3),
}
