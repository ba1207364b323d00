# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""MP4 films of pictures.

PyAV (the extra video) encodes H.264, which every player and browser supports; without it OpenCV
encodes MPEG-4 Part 2, which players support and browsers do not.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import KittiRos2Error

if TYPE_CHECKING:
    from pathlib import Path

    from typing_extensions import Self

    from ..drawing.pixels import Pixels

NO_H264 = (
    'the film is MPEG-4 Part 2, which browsers do not show, as PyAV is not installed; for H.264 run'
    " pip install 'kitti_ros2[video]'"
)

_CONSTANT_QUALITY = '20'
_SPEED = 'superfast'
_MOST_DENOMINATOR = 1000


class MovieError(KittiRos2Error):
    """A film that cannot be encoded."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(
            f'{path.name}: {reason}; give a folder instead of a film, for a PNG of each frame'
        )


class Movie:
    """A context manager that writes a film.

    Pictures of another size than the first are scaled to fit.

    Args:
        path: The file to write, ending in .mp4.
        rate_hz: Pictures per second.

    Attributes:
        codec: Display name of the codec.
    """

    def __init__(self, path: Path, rate_hz: float) -> None:
        self._path = path
        self._rate_hz = rate_hz
        self._encoder: _H264 | _Mpeg4 | None = None
        self._size = (0, 0)
        self.codec = 'H.264' if has_h264() else 'MPEG-4 Part 2'

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if self._encoder is not None and kind is None:
            self._encoder.close()

    def write(self, picture: Pixels) -> None:
        """Add a picture, (H, W, 3) uint8 BGR.

        Raises:
            MovieError: The encoder fails.
        """
        if self._encoder is None:
            self._size = (_even(picture.shape[1]), _even(picture.shape[0]))
            kind = _H264 if has_h264() else _Mpeg4
            self._encoder = kind(self._path, self._rate_hz, self._size)
        self._encoder.write(fitted(picture, self._size))


def has_h264() -> bool:
    """Whether PyAV is installed."""
    try:
        import av  # noqa: F401, PLC0415 - an extra
    except ImportError:
        return False
    return True


def fitted(picture: Pixels, size: tuple[int, int]) -> Pixels:
    """Scale a picture into (width, height), padded with black; unchanged if of that size."""
    import cv2  # noqa: PLC0415 - 0.2 s that a command which draws nothing does not need

    width, height = size
    if picture.shape[:2] == (height, width):
        return picture
    scale = min(width / picture.shape[1], height / picture.shape[0])
    if abs(scale - 1) > 0.01:
        shape = (max(1, int(picture.shape[1] * scale)), max(1, int(picture.shape[0] * scale)))
        picture = np.asarray(cv2.resize(picture, shape, interpolation=cv2.INTER_AREA))
    picture = picture[:height, :width]
    fit = np.zeros((height, width, 3), dtype=np.uint8)
    top, left = (height - picture.shape[0]) // 2, (width - picture.shape[1]) // 2
    fit[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return fit


def _even(length: int) -> int:
    """Round down to an even length, as video stores colour for pairs of pixels."""
    return max(2, length - length % 2)


class _H264:
    def __init__(self, path: Path, rate_hz: float, size: tuple[int, int]) -> None:
        import av  # noqa: PLC0415 - an extra

        self._av = av
        self._file = av.open(str(path), 'w', format='mp4', options={'movflags': '+faststart'})
        rate = Fraction(rate_hz).limit_denominator(_MOST_DENOMINATOR)
        self._stream = self._file.add_stream('libx264', rate=rate)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = 'yuv420p'
        self._stream.options = {'crf': _CONSTANT_QUALITY, 'preset': _SPEED}

    def write(self, picture: Pixels) -> None:
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format='bgr24')
        self._file.mux(self._stream.encode(frame))

    def close(self) -> None:
        self._file.mux(self._stream.encode(None))
        self._file.close()


class _Mpeg4:
    def __init__(self, path: Path, rate_hz: float, size: tuple[int, int]) -> None:
        import cv2  # noqa: PLC0415 - 0.2 s that a command which draws nothing does not need

        code = cv2.VideoWriter.fourcc(*'mp4v')
        self._path = path
        self._written = 0
        self._writer = cv2.VideoWriter(str(path), code, rate_hz, size)
        if not self._writer.isOpened():
            raise MovieError(path, 'this OpenCV encodes no MPEG-4 (pip install av does)')

    def write(self, picture: Pixels) -> None:
        self._writer.write(picture)
        self._written += 1

    def close(self) -> None:
        import cv2  # noqa: PLC0415 - as above

        self._writer.release()
        # Neither writing nor closing reports a full disk: the written pictures are counted.
        film = cv2.VideoCapture(str(self._path))
        found = int(film.get(cv2.CAP_PROP_FRAME_COUNT)) if film.isOpened() else 0
        film.release()
        if found != self._written:
            raise MovieError(
                self._path, f'only {found} of {self._written} pictures could be written'
            )
