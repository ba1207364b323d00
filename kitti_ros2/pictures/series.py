# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of many frames, drawn on all cores and yielded in order."""

from __future__ import annotations

import struct
from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.output_rules import keep_all_but_files
from ..files.threads import ordered_map, worker_count
from ..kitti.prepare import within
from ..model.errors import KittiRos2Error, Loss, MissingDataError, UsageError, describe_frames
from ..model.streams import NS_PER_S, Stream
from ..options.read import NOMINAL_PERIOD_NS
from .painters import name_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Self

    from ..drawing.labelled_objects import Pixels
    from ..options.outputs import PictureOptions
    from ..options.read import SelectionOptions
    from .panel import Mode
    from .recording_frames import FrameData, RecordingFrames


_NOMINAL_HZ = NS_PER_S / NOMINAL_PERIOD_NS
_LEAST_HZ, _MOST_HZ = 0.1, 60.0


class Drawn(NamedTuple):
    """The picture of a frame, None if required data is missing.

    Attributes:
        number: The frame number.
        picture: (H, W, 3) uint8 BGR.
        missing: Missing data of the frame: name to the reason, one line; {} stands for numbers.
        kinds: The classes of its objects and predictions, drawn or not.
    """

    number: int
    picture: Pixels | None
    missing: Mapping[str, str]
    kinds: frozenset[str] = frozenset()


def draw_frames(
    source: RecordingFrames,
    numbers: Sequence[int],
    mode: Mode,
    options: PictureOptions,
    refine: Callable[[FrameData], FrameData] = lambda frame: frame,
) -> Iterator[Drawn]:
    """Draw the pictures of some frames, in their order.

    Args:
        source: The frames.
        numbers: Frame numbers.
        mode: The kind of picture.
        options: Picture options.
        refine: Adds data to a frame that the source does not have, such as predictions.

    Raises:
        UsageError: A frame does not exist.
    """
    streams = mode.streams(source.cameras, options, source.main_camera)

    def draw(number: int) -> Drawn:
        frame = refine(source.frame(number, streams))
        kinds = frozenset(obj.class_name for obj in (*frame.objects, *frame.predictions))
        try:
            return Drawn(number, mode.draw(frame, options), frame.missing, kinds)
        except MissingDataError as error:
            # One line per reason, independent of the number of frames.
            reason = str(error).removeprefix(name_of(frame)).lstrip(': ')
            return Drawn(number, None, {'picture': f'{reason}; frames not drawn: {{}}'}, kinds)

    return ordered_map(draw, numbers, worker_count(most=None))


def concerned_losses(
    source: RecordingFrames, numbers: Sequence[int], mode: Mode, options: PictureOptions
) -> tuple[Loss, ...]:
    """Return the losses of the source itself that concern pictures of some frames."""
    shown = mode.streams(source.cameras, options, source.main_camera) | {Stream.CALIBRATION.value}
    others = {stream.value for stream in Stream} - shown
    drawn = set(numbers)
    losses = []
    for loss in source.losses:
        if loss.stream in others:
            continue
        lost = tuple(number for number in loss.numbers if number in drawn)
        if lost:
            losses.append(Loss(loss.stream, len(lost), loss.message, lost))
        elif not loss.numbers:
            losses.append(loss)
    return tuple(losses)


class PictureTally:
    """Result of drawing a series of frames."""

    def __init__(self) -> None:
        self.drawn = 0
        self.kinds: set[str] = set()
        self._missing: dict[tuple[str, str], list[int]] = {}

    def pictures(
        self, series: Iterable[Drawn], progress: Callable[[int], None] = lambda _: None
    ) -> Iterator[tuple[int, Pixels]]:
        """Yield the pictures with their frame numbers; count missing data."""
        for done, drawn in enumerate(series, 1):
            for name, reason in drawn.missing.items():
                self._missing.setdefault((name.split()[0], reason), []).append(drawn.number)
            self.kinds |= drawn.kinds
            if drawn.picture is not None:
                self.drawn += 1
                yield drawn.number, drawn.picture
            progress(done)

    def check(self) -> None:
        """Raise if nothing was drawn.

        Raises:
            MissingDataError: Nothing was drawn; the message contains the reason.
        """
        if not self.drawn:
            losses = self.losses() or (Loss('picture', 0, 'no frames'),)
            raise MissingDataError(f'nothing to draw: {losses[-1].text()}')

    def losses(self) -> tuple[Loss, ...]:
        """Return the missing data, one loss per reason."""
        return tuple(
            Loss(name, len(numbers), reason, tuple(numbers))
            for (name, reason), numbers in self._missing.items()
        )


def parse_frames(text: str, source: RecordingFrames) -> list[int]:
    """Parse FIRST:LAST or FIRST:LAST:STEP, both ends included; each part may be omitted.

    Raises:
        UsageError: The text is invalid, or matches no frame.
    """
    words = text.split(':')
    if len(words) not in {2, 3} or not all(not word or word.isdecimal() for word in words):
        raise UsageError(f'{text!r} are no frames; write FIRST:LAST, such as 0:99, or : for all')
    first, last, step = (int(word) if word else None for word in (*words, '')[:3])
    if step == 0:
        raise UsageError(f'{text!r}: a step of 0')
    if first is not None and last is not None and last < first:
        raise UsageError(f'{text!r}: the last frame is before the first')
    numbers = source.numbers
    chosen = numbers[
        (numbers >= (first or 0)) & (numbers <= (int(numbers[-1]) if last is None else last))
    ]
    if not len(chosen):
        raise UsageError(f'{source.name} has no frame in {text}; it has {describe_frames(numbers)}')
    stepped: list[int] = chosen[:: step or 1].tolist()
    return stepped


def select_frames(source: RecordingFrames, selection: SelectionOptions) -> list[int]:
    """Return the frames from the start to the end of a selection, both included.

    Raises:
        UsageError: There are none.
    """
    chosen = within(selection, source.numbers, source.stamps_ns)
    if not chosen.any():
        span = f'{source.numbers[0]} to {source.numbers[-1]}'
        raise UsageError(f'{source.name}: the selection takes no frame; it has {span}')
    frames: list[int] = source.numbers[chosen].tolist()
    return frames


def first_whole(numbers: Sequence[int], source: RecordingFrames) -> int:
    """Return the first of some frames that has a sample of as many streams as any of them.

    KITTI-360 has frames with a pose alone, and its first frame has none, and so no boxes.
    """
    counts = sum(np.isin(numbers, files).astype(int) for files in source.streams.values())
    return numbers[int(np.argmax(counts))]


def rate_of(source: RecordingFrames, numbers: Sequence[int]) -> float:
    """Return the rate of some frames, from the median interval, in Hz."""
    periods = np.diff(np.sort(source.stamps_ns[np.isin(source.numbers, numbers)]))
    period = float(np.median(periods)) if len(periods) else 0.0
    return min(max(NS_PER_S / period, _LEAST_HZ), _MOST_HZ) if period > 0 else _NOMINAL_HZ


# Films of pictures: MP4 and GIF.
#
# PyAV (the extra video) encodes H.264, which every player and browser supports; without it OpenCV
# encodes MPEG-4 Part 2, which players support and browsers do not. GIF is for pages that show no
# other film.

FILMS = ('.mp4', '.gif')
NO_H264 = (
    'the film is MPEG-4 Part 2, which browsers do not show, as PyAV is not installed; for H.264 run'
    " pip install 'kitti_ros2[video]', or write a .gif"
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
        path: The file to write, ending in one of FILMS.
        rate_hz: Pictures per second.

    Attributes:
        description: The format, for display.
    """

    def __init__(self, path: Path, rate_hz: float) -> None:
        self._path = path
        self._kind: type[_Gif | _H264 | _Mpeg4] = _H264 if has_h264() else _Mpeg4
        if path.suffix.lower() == '.gif':
            self._kind = _Gif
        self._rate_hz = min(rate_hz, self._kind.most_hz)
        self._encoder: _Gif | _H264 | _Mpeg4 | None = None
        self._size = (0, 0)

    @property
    def description(self) -> str:
        """The format, size and rate."""
        width, height = self._size
        return f'{self._kind.name}, {width}x{height}, {self._rate_hz:.4g} a second'

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
            height, width = picture.shape[:2]
            scale = min(1.0, self._kind.longest_side / max(height, width))
            step = self._kind.step
            self._size = (_multiple(width * scale, step), _multiple(height * scale, step))
            self._encoder = self._kind(self._path, self._rate_hz, self._size)
        self._encoder.write(fitted(picture, self._size))


def has_h264() -> bool:
    """Return whether PyAV is installed."""
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
        shape = [max(1, round(length * scale)) for length in picture.shape[1::-1]]
        picture = np.asarray(cv2.resize(picture, shape, interpolation=cv2.INTER_AREA))
    picture = picture[:height, :width]
    fit = np.zeros((height, width, 3), dtype=np.uint8)
    top, left = (height - picture.shape[0]) // 2, (width - picture.shape[1]) // 2
    fit[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return fit


def _multiple(length: float, step: int) -> int:
    """Round to whole pixels, and down to a multiple of a step."""
    return max(step, round(length) // step * step)


class _H264:
    name = 'H.264'
    longest_side = most_hz = inf
    step = 2  # video stores colour for pairs of pixels

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
    name = 'MPEG-4 Part 2'
    longest_side = most_hz = inf
    step = 2  # video stores colour for pairs of pixels

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
        readable = int(film.get(cv2.CAP_PROP_FRAME_COUNT)) if film.isOpened() else 0
        film.release()
        if readable != self._written:
            raise MovieError(
                self._path, f'only {readable} of {self._written} pictures could be written'
            )


class _Gif:
    """Each picture with its own 256 colours, written at once: a long film takes no memory."""

    name = 'GIF'
    longest_side = 960.0  # as wide as a page, and half a panel; larger files load slowly
    step = 1
    most_hz = 50.0  # browsers slow down pictures of less than two hundredths of a second

    def __init__(self, path: Path, rate_hz: float, size: tuple[int, int]) -> None:
        self._path = path
        self._rate_hz = rate_hz
        self._written = 0
        forever = b'!\xff\x0bNETSCAPE2.0\x03\x01\0\0\0'
        path.write_bytes(struct.pack('<6sHHBBB', b'GIF89a', *size, 0x70, 0, 0) + forever)

    def write(self, picture: Pixels) -> None:
        from PIL import GifImagePlugin, Image  # noqa: PLC0415 - for this format only

        colours = Image.fromarray(np.ascontiguousarray(picture[..., ::-1])).quantize(
            method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        )
        start, end = (round(100 * n / self._rate_hz) for n in (self._written, self._written + 1))
        data = GifImagePlugin.getdata(
            colours, duration=10 * (end - start), include_color_table=True
        )
        self._append(b''.join(data))
        self._written += 1

    def close(self) -> None:
        self._append(b';')

    def _append(self, data: bytes) -> None:
        with self._path.open('ab') as file:
            file.write(data)


# Writing of pictures in the format of their file names; the files that --overwrite may replace.


# An MP4 file begins with the length of its first box, which is short.
_MP4 = tuple(bytes([0, 0, 0, length]) for length in range(16, 64))
keep_all_but_pictures = keep_all_but_files(
    'picture or film', (b'\x89PNG', b'\xff\xd8\xff', b'RIFF', b'GIF8', *_MP4)
)
"""The refusal for --overwrite: it replaces only pictures and films."""

PICTURES = ('.png', '.jpg', '.jpeg', '.webp')
_JPEG_QUALITY = 92


def write_picture(path: Path, picture: Pixels) -> None:
    """Write (H, W, 3) uint8 BGR in the format of the file name's suffix.

    Raises:
        UsageError: The suffix is unsupported.
        OSError: The file cannot be written.
    """
    path.write_bytes(encode_picture(picture, path.suffix))


def encode_picture(picture: Pixels, suffix: str, jpeg_quality: int = _JPEG_QUALITY) -> bytes:
    """Encode a picture in the format of a suffix, such as .png.

    Raises:
        UsageError: The suffix is unsupported.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that a command which draws nothing does not need

    from ..files.image_files import encode_png  # noqa: PLC0415 - as above

    ending = suffix.lower()
    if ending not in PICTURES:
        raise UsageError(f'a picture ends in {", ".join(PICTURES)}, not in {suffix or "nothing"}')
    if ending == '.png':
        return encode_png(picture)
    settings = [] if ending == '.webp' else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    done, data = cv2.imencode(ending, picture, settings)
    if not done:
        raise UsageError(f'this OpenCV writes no {suffix}; choose .png')
    return data.tobytes()
