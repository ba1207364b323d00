# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a preview: a row for each frame, with the points and boxes on the images of cameras.

Where points cannot be shown on an image, there is a bird's-eye view.
"""

from __future__ import annotations

import re
from contextlib import suppress
from itertools import zip_longest
from typing import TYPE_CHECKING

from ..drawing.birds_eye import BACKGROUND
from ..drawing.strokes import new_picture
from ..drawing.text import captioned
from ..model.errors import MissingDataError
from ..model.streams import Stream
from ..model.text import format_count
from ..options.pictures import BirdOptions, PictureOptions
from .frame_parts import frame_projection
from .painters import draw_bird, fit_image, paint_boxes_3d, paint_scan

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from ..drawing.pixels import Pixels
    from .frame import FrameData

_CAMERAS = (2, 3, 0, 1, 4)
"""Cameras by preference: that of the labels, then its partner to the right."""
_MOST_CAMERAS = 2
TILE = (960, 600)
"""Most width and height of an image on the page, pixels."""
_GAP = 6
_BIRD = PictureOptions(bird=BirdOptions((-10.0, 50.0), (-30.0, 30.0), 10.0))
_OPTIONS = PictureOptions()
_BLANK = (640, 60)
_PATH = re.compile(r'^/\S*: ')


class PreviewPage:
    """Collects the pictures of frames, row by row.

    Args:
        cameras: By KITTI's index the title of the images of each camera.
        labelled: Whether there are labels.
        calibrated: Whether there is a calibration.
        tile: Most width and height of an image, pixels.
    """

    def __init__(
        self,
        cameras: Mapping[int, str],
        *,
        labelled: bool,
        calibrated: bool = True,
        tile: tuple[int, int] = TILE,
    ) -> None:
        shown = [each for each in _CAMERAS if each in cameras][:_MOST_CAMERAS]
        self._cameras = {camera: cameras[camera] for camera in shown}
        self._labelled = labelled
        self._calibrated = calibrated
        self._tile = tile
        self._rows: list[list[Pixels]] = []
        self._missing: dict[str, None] = {}
        streams = Stream.SCAN.value, Stream.LABELS.value, *(f'image_{each}' for each in shown)
        self.streams = frozenset(streams)

    @property
    def missing(self) -> tuple[str, ...]:
        """What could not be drawn; a reason that frames have in common is there once."""
        return tuple(self._missing)

    def lack(self, reason: str) -> None:
        """Enter what could not be drawn."""
        self._missing[reason] = None

    def extend(self, other: PreviewPage) -> None:
        """Add the rows of another page."""
        self._rows += other._rows
        self._missing |= other._missing

    def in_a_row(self) -> PreviewPage:
        """Return a page with all pictures in one row."""
        self._rows = [[tile for row in self._rows for tile in row]] if self._rows else []
        return self

    def add(self, frame: FrameData, title: str, name: str) -> None:
        """Add the row of a frame.

        Args:
            frame: As it was read back.
            title: Of its images.
            name: Of the frame, for what is missing.
        """
        for part, reason in frame.missing.items():
            if self._calibrated or not part.startswith(Stream.CALIBRATION.value):
                # Without the path of the file, which is gone when it is read.
                self.lack(f'{name}: no {part}: {_PATH.sub("", reason)}')
        row = [self._image(frame, camera, title) for camera in self._cameras]
        if frame.points is not None and not _is_projected(frame, self._cameras):
            text = f"{title}: bird's-eye view{self._labels(frame)}"
            row.append(captioned(draw_bird(frame, _BIRD), text))
        if row:
            self._rows.append(row)

    def _image(self, frame: FrameData, camera: int, title: str) -> Pixels:
        """Draw the scan and the boxes on the image of a camera."""
        text = f'{title}: {self._cameras[camera]}'
        image = frame.images.get(camera)
        if image is None:
            return captioned(new_picture(_BLANK, BACKGROUND), f'{text}: no image')
        most = min(self._tile[0], image.shape[1]), min(self._tile[1], image.shape[0])
        shown = fit_image(camera, image, most)
        for paint in (paint_scan, paint_boxes_3d):
            with suppress(MissingDataError):  # it is among the missing data of the plan or frame
                paint(shown.picture, shown, frame, _OPTIONS)
        return captioned(shown.picture, text + self._labels(frame))

    def _labels(self, frame: FrameData) -> str:
        """Format the number of labels with a 3D box in a title."""
        count = sum(each.cuboid is not None for each in frame.objects)
        return f', {format_count(count, "label")}' if self._labelled else ''

    def picture(self) -> Pixels:
        """Return the rows below each other.

        Raises:
            MissingDataError: There is nothing to show.
        """
        if not self._rows:
            reason = '; '.join(self.missing) or 'no frame'
            raise MissingDataError(f'nothing to draw for --preview: {reason}')
        widths = [
            max(tile.shape[1] for tile in column if tile is not None)
            for column in zip_longest(*self._rows)
        ]
        heights = [max(tile.shape[0] for tile in row) for row in self._rows]
        size = sum(widths) + _GAP * (len(widths) - 1), sum(heights) + _GAP * (len(heights) - 1)
        page = new_picture(size, BACKGROUND)
        top = 0
        for row, height in zip(self._rows, heights, strict=True):
            left = 0
            for tile, width in zip(row, widths, strict=False):
                page[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
                left += width + _GAP
            top += height + _GAP
        return page


def _is_projected(frame: FrameData, cameras: Iterable[int]) -> bool:
    """Whether points can be shown on the image of any camera."""
    for camera in cameras:
        with suppress(MissingDataError):
            frame_projection(frame, camera)
            return True
    return False
