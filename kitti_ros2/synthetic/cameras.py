# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic cameras: their textures, and their images as PNG files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..model.samples import Image
from .ground import Backdrop
from .render import Canvas, draw_solids
from .textures import Texture, as_picture, paint

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array, Transform
    from .path import Course
    from .scene import Look, PlacedSolid
    from .textures import Picture

GREY_CAMERAS = (0, 1)
_PNG_LEVEL = 1
_PIXEL_NOISE = 1.6
_NOISE_MARGIN = 64


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
        self._noise: dict[bool, npt.NDArray[np.int16]] = {}

    def instances(self, placed: Sequence[PlacedSolid], projection: Float64Array) -> Canvas:
        """Return the box and the depth of each pixel, without an image.

        Args:
            placed: The boxes in velo_link, nearest first.
            projection: (3, 4), velo_link to pixels.
        """
        return draw_solids(placed, projection, self._size, None, self._texture)

    def photograph(
        self,
        camera: int,
        frame: int,
        placed: Sequence[PlacedSolid],
        projection: Float64Array,
        street_T_velo: Transform,
    ) -> Picture:
        """Draw an image, (height, width) or (height, width, 3) uint8, BGR.

        Args:
            camera: KITTI's index: 0 and 1 are grey.
            frame: File number; the noise differs from one to the next.
            placed: The boxes in velo_link, nearest first.
            projection: (3, 4), velo_link to pixels.
            street_T_velo: Pose of the scanner.
        """
        grey = camera in GREY_CAMERAS
        if grey not in self._backdrops:
            self._backdrops[grey] = Backdrop(
                self._size, self._focal, self._seed, self._course, grey=grey
            )
        image = self._backdrops[grey].draw(projection, street_T_velo)
        texture = self._grey_texture if grey else self._texture
        draw_solids(placed, projection, self._size, image, texture)
        noise = self._noise_of(camera, frame, grey=grey)
        return as_picture(cv2.add(image, noise, dtype=cv2.CV_8U))

    def _texture(self, one: PlacedSolid, face: str) -> Texture:
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

    def _noise_of(self, camera: int, frame: int, *, grey: bool) -> npt.NDArray[np.int16]:
        """Return a window of one large noise picture, placed by camera and frame."""
        width, height = self._size
        if grey not in self._noise:
            shape: tuple[int, ...] = (height + _NOISE_MARGIN, width + _NOISE_MARGIN)
            rng = np.random.default_rng([self._seed, 6])
            noise = rng.normal(0.0, _PIXEL_NOISE, shape if grey else (*shape, 3))
            self._noise[grey] = noise.round().astype(np.int16)
        top = (frame * 29 + camera * 17) % _NOISE_MARGIN
        left = (frame * 43 + camera * 31) % _NOISE_MARGIN
        return self._noise[grey][top : top + height, left : left + width]


def encode_png(picture: Picture) -> Image:
    """Encode a picture as a PNG file."""
    done, data = cv2.imencode('.png', picture, [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL])
    if not done:
        raise RuntimeError('OpenCV cannot encode a PNG')
    height, width = picture.shape[:2]
    channels = 1 if picture.ndim == 2 else picture.shape[2]
    return Image(data.tobytes(), width, height, channels)
