# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Image and CompressedImage -> KITTI's images, rectified where the plan requests it."""

from __future__ import annotations

from collections import Counter
from threading import Lock
from typing import TYPE_CHECKING, Any

from ..files.png.encode import encode_png
from ..files.png.header import parse_png
from ..messages.pixels import pixels_of, png_of
from ..model.errors import BadFileError, UsageError
from ..rig.rectify import Rectifier
from .planned_topics import image_size, topic_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..messages.camera_info import CameraModel
    from ..messages.pixels import Pixels
    from .plan import CameraPlan, Plan
    from .survey import Survey

_DEPTH_BYTE = 24
"""The place of the bits a channel in a PNG: the signature, the head of IHDR, width and height."""
_USUAL_BITS = 8


class ImageConversion:
    """Converts the images of a plan's cameras; thread-safe.

    Attributes:
        models: Of the cameras with a CameraInfo, by KITTI index.
    """

    def __init__(self, plan: Plan, survey: Survey, models: Mapping[int, CameraModel]) -> None:
        """Prepare the rectification.

        Args:
            plan: Names the cameras.
            survey: Of the bag.
            models: Of the cameras with a CameraInfo, by KITTI index.

        Raises:
            UsageError: The plan names a missing topic, or rectifies what cannot be rectified.
        """
        self.models = models
        self._rectifiers = {
            index: _rectifier(plan.cameras[index], model)
            for index, model in models.items()
            if plan.cameras[index].rectify
        }
        self._models = models
        self._topics = {index: camera.topic for index, camera in plan.cameras.items()}
        self._deep: Counter[int] = Counter()
        self._lock = Lock()
        self._sizes = _sizes(plan, survey) | {index: model.size for index, model in models.items()}

    def model(self, camera: int) -> CameraModel | None:
        """Return the model of a camera, None without a CameraInfo."""
        return self._models.get(camera)

    def size(self, camera: int) -> tuple[int, int] | None:
        """Return (width, height) of a camera's images, None where it is not known yet."""
        return self._sizes.get(camera)

    def png(self, camera: int, message: Any) -> bytes:  # noqa: ANN401 - of the bag's types
        """Convert an Image or CompressedImage to a PNG file, rectified where the plan requests it.

        Raises:
            ValueError: It cannot be decoded, or its size differs from other images of the camera.
        """
        rectifier = self._rectifiers.get(camera)
        compressed = hasattr(message, 'format')
        own = png_of(message) if compressed and rectifier is None else None
        if own is not None:
            try:
                # png_of has checked its checksums.
                image = parse_png(own, 'the message', len(own))
            except BadFileError as error:
                raise ValueError(str(error)) from None
            self._check_size(camera, (image.width, image.height))
            if own[_DEPTH_BYTE] > _USUAL_BITS:
                self._count_deep(camera)
            return own
        pixels = self.pixels(camera, message)
        if pixels.dtype.itemsize > 1:
            self._count_deep(camera)
        return encode_png(pixels)

    def pixels(self, camera: int, message: Any) -> Pixels:  # noqa: ANN401 - of the bag's types
        """Decode an Image or CompressedImage, rectified where the plan requests it.

        Returns:
            (H, W), or (H, W, 3) BGR, uint8 or uint16.

        Raises:
            ValueError: As png.
        """
        pixels = pixels_of(message, deep=True)
        self._check_size(camera, (pixels.shape[1], pixels.shape[0]))
        rectifier = self._rectifiers.get(camera)
        return pixels if rectifier is None else rectifier.apply(pixels)

    def notes(self) -> list[str]:
        """Return what should be known of the images so far."""
        return [
            f'{self._topics[camera]}: {count} images have 16 bits a channel, and are written so;'
            f" KITTI's have 8"
            for camera, count in sorted(self._deep.items())
        ]

    def _count_deep(self, camera: int) -> None:
        with self._lock:
            self._deep[camera] += 1

    def _check_size(self, camera: int, size: tuple[int, int]) -> None:
        expected = self._sizes.setdefault(camera, size)
        if size != expected:
            raise ValueError(
                f'the image is {size[0]}x{size[1]}; expected {expected[0]}x{expected[1]}, as the'
                f' rest of its camera: calibration holds for one size only'
            )


def _sizes(plan: Plan, survey: Survey) -> dict[int, tuple[int, int]]:
    """Return (width, height) of each camera, from the first of its images with a known size."""
    found = {}
    for index, camera in plan.cameras.items():
        size = image_size(topic_of(survey, camera.topic))
        if size is not None:
            found[index] = size
    return found


def _rectifier(camera: CameraPlan, model: CameraModel) -> Rectifier:
    try:
        return Rectifier(model)
    except ValueError as error:
        raise UsageError(
            f'{camera.info}: {error}; set rectify: false in the plan where the images are rectified'
        ) from None
