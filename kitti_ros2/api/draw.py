# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of frames as arrays that notebooks show."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.image_files import encode_png
from ..model.errors import UsageError
from ..options.declare import options_of
from ..options.outputs import BirdOptions, PictureOptions
from ..options.table import make_view_settings
from ..pictures.panel import MODES
from .arguments import by_name, keyword_of

if TYPE_CHECKING:
    import os

    from typing_extensions import Unpack

    from ..options.keywords import DrawKeywords
    from .open_recording import Frame

DRAW = (*options_of(PictureOptions), *options_of(BirdOptions))


class Picture(np.ndarray[Any, np.dtype[np.uint8]]):
    """A picture, (H, W, 3) uint8 RGB: an array that notebooks show."""

    def png(self) -> bytes:
        """Return it as a PNG file.

        Raises:
            KittiRos2Error: The array is not (H, W, 3) uint8, such as after an operation.
        """
        if not self._is_picture:
            raise UsageError(f'an array of shape {self.shape}, {self.dtype} is no RGB picture')
        return encode_png(np.ascontiguousarray(self[..., ::-1]))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a PNG file."""
        Path(path).write_bytes(self.png())

    def show(self) -> None:
        """Show it in the output of a notebook, or else in the program for PNG files."""
        ipython = sys.modules.get('IPython')  # a notebook has imported it
        if ipython is not None and ipython.get_ipython() is not None:
            ipython.display.display(ipython.display.Image(self.png()))
            return
        with tempfile.NamedTemporaryFile(suffix='.png', delete=False) as file:
            file.write(self.png())
        webbrowser.open(Path(file.name).as_uri())

    def _repr_png_(self) -> bytes | None:
        return self.png() if self._is_picture else None

    @property
    def _is_picture(self) -> bool:
        return self.ndim == 3 and self.shape[2] == 3 and self.dtype == np.uint8 and self.size > 0


def draw(frame: Frame, mode: str = 'panel', **options: Unpack[DrawKeywords]) -> Picture:
    """Draw a frame as `kitti-ros2 view` does.

    Args:
        frame: A frame of a recording.
        mode: camera, boxes, lidar, bev or panel, as --mode.
        options: Options of view about a picture: camera, color_by, color_map, point_size,
            range, resolution, classes.

    Raises:
        KittiRos2Error: The frame has no data for the mode, or an option is invalid.

    Examples:
        >>> kitti_ros2.draw(recording[0], 'bev', range=(0, 40, -20, 20)).save('above.png')
    """
    unfit = sorted(set(options) - set(map(keyword_of, DRAW)))
    if unfit:
        keywords = ', '.join(map(keyword_of, DRAW))
        raise UsageError(f'unknown option {unfit[0]!r}; known are {keywords}')
    settings = make_view_settings({**by_name(options, DRAW), 'mode': mode})
    if settings.mode not in MODES:
        raise UsageError(f'no mode {mode!r}; there are {", ".join(MODES)}')
    view_mode = MODES[settings.mode]
    frames = frame.source.frames
    streams = view_mode.streams(frames.cameras, settings.pictures, frames.main_camera)
    pixels = view_mode.draw(frames.frame(frame.number, streams), settings.pictures)
    return np.ascontiguousarray(pixels[..., ::-1]).view(Picture)
