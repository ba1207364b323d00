# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the pixels of an image; only with --decode."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from ..files.image_files import decode_image
from .rule import Breach, Rule, RuleScope, RuleSeverity

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from ..model.samples import Image


@dataclass(frozen=True, eq=False)
class ImageFile:
    """A parsed image.

    Attributes:
        path: The file.
        image: The image.
    """

    path: Path
    image: Image

    @cached_property
    def pixels(self) -> npt.NDArray[np.uint8 | np.uint16] | str:
        """The decoded pixels; the reason if they cannot be decoded."""
        try:
            return decode_image(self.image)
        except ValueError as error:
            return str(error)


def _find_undecodable(file: ImageFile) -> Iterator[Breach]:
    if isinstance(file.pixels, str):
        yield Breach(f'the pixels cannot be decoded: {file.pixels}', file.path)


def _find_blank(file: ImageFile) -> Iterator[Breach]:
    if not isinstance(file.pixels, str) and file.pixels.min() == file.pixels.max():
        yield Breach(f'all pixels are {int(file.pixels.max())}', file.path)


IMAGE_RULES: tuple[Rule[ImageFile], ...] = (
    Rule(
        'image-pixels',
        RuleSeverity.ERROR,
        RuleScope.FILE,
        'Pixels can be decoded (with --decode)',
        'copy or download the file again',
        _find_undecodable,
    ),
    Rule(
        'image-blank',
        RuleSeverity.WARNING,
        RuleScope.FILE,
        'Images are not of a single colour (with --decode)',
        'check the camera, or the program that wrote the image',
        _find_blank,
    ),
)
