# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Video in messages: codecs, key frames, and a decoder of the packets of a topic to Images."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from ..model.bag_formats import COMPRESSED, COMPRESSED_VIDEO, VIDEOS
from ..model.samples import MOST_PIXELS
from ..model.streams import from_sec_nanosec
from .h264_frames import FrameNumbers
from .images import encode_pixels, size_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .images import Pixels
    from .ros_types import ImageMsg


# The codecs of messages, and the packets at which decoding can begin.
#
# CompressedVideo.format is h264, h265, vp9 or av1 (docs.foxglove.dev/docs/sdk/schemas/
# compressed-video: Annex B, a frame a message, parameter sets with each key frame). FFMPEGPacket
# (ffmpeg_image_transport_msgs, 17c64d9) has the name of the encoder, such as libx264 or hevc_nvenc,
# or "codec;av_source_pixel_format;cv_bridge_target_format;ros_encoding". Encoders of Isaac ROS
# write CompressedImage with the format h264.

_WORDS = {'264': 'h264', 'avc': 'h264', '265': 'hevc', 'hevc': 'hevc', 'av1': 'av1', 'vp9': 'vp9'}
_FORMATS = frozenset({'h264', 'h265', 'hevc', 'av1', 'vp9'})
"""Formats of a CompressedImage that is no picture but a packet."""
_MONO = ('mono', '8UC1')

_NAL = re.compile(rb'\x00\x00\x01(.)', re.DOTALL)
"""The first byte of each unit, ITU-T H.264 and H.265, Annex B."""
_SEQUENCE_HEADER = 1


def is_video(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether a message is a packet of a video."""
    msgtype = message.__msgtype__
    return msgtype in VIDEOS or (msgtype == COMPRESSED and message.format.lower() in _FORMATS)


def codec_of(message: Any) -> str:  # noqa: ANN401 - of the bag's types
    """Return the codec of a packet: h264, hevc, av1 or vp9.

    Raises:
        ValueError: It is another one.
    """
    text = str(getattr(message, 'encoding', '') or getattr(message, 'format', ''))
    name = text.partition(';')[0].lower()
    for word, codec in _WORDS.items():
        if word in name:
            return codec
    raise ValueError(f'video of an unsupported codec, {text!r}; expected h264, h265, av1 or vp9')


def begins_video(message: Any, *, surely: bool = True) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether decoding can begin at a packet: a key frame with its parameter sets.

    Unless surely, one of both is enough.

    Raises:
        ValueError: As codec_of.
    """
    parts = _BEGINNINGS[codec_of(message)](message.data.tobytes())
    return all(parts) if surely else any(parts)


def _h264_parts(data: bytes) -> tuple[bool, bool]:
    """Return whether there are a sequence parameter set and an IDR slice."""
    types = {unit[0] & 31 for unit in _NAL.findall(data)}
    return 7 in types, 5 in types


def _hevc_parts(data: bytes) -> tuple[bool, bool]:
    """Return whether there are a sequence parameter set and a slice of an IRAP picture."""
    types = {unit[0] >> 1 & 63 for unit in _NAL.findall(data)}
    return 33 in types, not types.isdisjoint(range(16, 22))


def _av1_parts(data: bytes) -> tuple[bool]:
    """Return whether there is a sequence header (AV1, 5.3 and 7.5: at each random access point)."""
    return (_SEQUENCE_HEADER in _av1_units(data),)


def _av1_units(data: bytes) -> Iterator[int]:
    """Yield the types of the units (OBU) of a packet."""
    position = 0
    while position < len(data):
        head = data[position]
        yield head >> 3 & 15
        position += 2 if head & 4 else 1
        if not head & 2:  # without a size it is the last
            return
        size = shift = 0
        while position < len(data):
            byte = data[position]
            size |= (byte & 127) << shift
            position, shift = position + 1, shift + 7
            if byte < 128 or shift > 56:
                break
        position += size


def _vp9_parts(data: bytes) -> tuple[bool]:
    """Return whether the first frame is a key frame (VP9, 6.2: frame_marker to frame_type)."""
    first = data[0] if data else 0
    bits = first << 1 if first & 0x30 == 0x30 else first  # profile 3 has a reserved bit
    return (first >> 6 == 2 and not bits & 0x0C,)


_BEGINNINGS: dict[str, Callable[[bytes], tuple[bool, ...]]] = {
    'h264': _h264_parts,
    'hevc': _hevc_parts,
    'av1': _av1_parts,
    'vp9': _vp9_parts,
}
_DECODERS = {'av1': 'libdav1d'}
TITLES = {'h264': 'H.264', 'hevc': 'H.265', 'av1': 'AV1', 'vp9': 'VP9'}
"""The codecs, for people."""


# The decoder of the packets of one topic.
#
# Frames depend on those before them, so packets must be given in the order of the bag. A decoder
# may hold frames back (B-frames), so each is matched to its packet by a number. After a damaged or
# missing packet FFmpeg goes on with frames that look sound and are not, so all are refused up to
# the next packet at which decoding can begin.

Key = TypeVar('Key')

NO_PYAV = "decoding video needs PyAV, which is not installed; run pip install 'kitti_ros2[video]'"
_NO_KEY_FRAME = 'the frame cannot be decoded: no key frame precedes it'
_AFTER_DAMAGE = 'the frame cannot be decoded: it depends on a damaged one before'
_AFTER_MISSING = 'the frame cannot be decoded: a packet before it is missing'
_NO_FRAME = 'the decoder makes no frame of it'


@dataclass(frozen=True)
class _Packet(Generic[Key]):
    key: Key
    stamp_ns: int
    frame_id: str
    is_grey: bool


class VideoDecoder(Generic[Key]):
    """Decodes the packets of one topic in their order; for one thread at a time.

    Attributes:
        beyond_range: Number of images with luma beyond the limited range, and no flag of the full.
    """

    def __init__(self) -> None:
        self.beyond_range = 0
        self._context: Any = None
        self._codec = ''
        self._waiting: dict[int, _Packet[Key]] = {}
        self._fed = 0
        self._refusal = _NO_KEY_FRAME
        self._numbers = FrameNumbers()

    def feed(self, key: Key, message: Any) -> list[tuple[Key, ImageMsg | ValueError]]:  # noqa: ANN401
        """Decode a packet.

        Args:
            key: Returned with its image.
            message: The packet, of the bag's types.

        Returns:
            The images decoded so far, mono8 or bgr8 with the header of their packet, or why
            there is none, each with its key; those held back come later.
        """
        images = []
        try:
            codec, begins = codec_of(message), begins_video(message, surely=False)
            if begins and (self._context is None or codec != self._codec):
                images = self._end(_NO_KEY_FRAME)
                self._context, self._codec = _open(codec), codec
                self._numbers = FrameNumbers()
        except ValueError as error:
            self._refusal = str(error)
            return [*images, (key, error)]
        if self._context is None:
            return [(key, ValueError(self._refusal))]
        if codec == 'h264' and not self._numbers.follows(message.data.tobytes()):
            return [*self._end(_AFTER_MISSING), (key, ValueError(_AFTER_MISSING))]
        return [*images, *self._decode(key, message)]

    def rest(self) -> list[tuple[Key, ImageMsg | ValueError]]:
        """Return the images that are held back; decoding begins anew with the next packet."""
        return self._end(_NO_KEY_FRAME)

    def _decode(self, key: Key, message: Any) -> list[tuple[Key, ImageMsg | ValueError]]:  # noqa: ANN401
        import av  # noqa: PLC0415 - an extra

        number, self._fed = self._fed, self._fed + 1
        self._waiting[number] = _packet(key, message)
        packet = av.Packet(message.data.tobytes())
        packet.pts = number
        try:
            frames = self._context.decode(packet)
        except (av.FFmpegError, ValueError) as error:
            del self._waiting[number]
            reason = str(getattr(error, 'strerror', '') or error)
            damaged = ValueError(f'the packet is damaged, or one before is missing ({reason})')
            return [*self._end(_AFTER_DAMAGE), (key, damaged)]
        images = self._results(frames)
        if any(frame.is_corrupt for frame in frames):
            images += self._end(_AFTER_DAMAGE)
        return images

    def _end(self, refusal: str) -> list[tuple[Key, ImageMsg | ValueError]]:
        """Close the decoder, and return what it holds back; the reason is that of packets to come.

        The reason does not change while the decoder is closed.
        """
        if self._context is None:
            return []
        import av  # noqa: PLC0415 - an extra

        try:
            images = self._results(self._context.decode(None))
        except (av.FFmpegError, ValueError):
            images = []
        images += [(packet.key, ValueError(_NO_FRAME)) for packet in self._waiting.values()]
        self._context, self._refusal = None, refusal
        self._waiting.clear()
        return images

    def _results(self, frames: Any) -> list[tuple[Key, ImageMsg | ValueError]]:  # noqa: ANN401 - of PyAV
        images: list[tuple[Key, ImageMsg | ValueError]] = []
        for frame in frames:
            packet = self._waiting.pop(-1 if frame.pts is None else frame.pts, None)
            if packet is None:  # that of a damaged packet
                continue
            if frame.is_corrupt:
                images.append((packet.key, ValueError('the frame is damaged')))
            else:
                images.append((packet.key, _image(frame, packet)))
                self.beyond_range += _is_beyond_range(frame)
        return images


def _packet(key: Key, message: Any) -> _Packet[Key]:  # noqa: ANN401 - of the bag's types
    if message.__msgtype__ == COMPRESSED_VIDEO:
        stamp, frame_id = message.timestamp, message.frame_id
    else:
        stamp, frame_id = message.header.stamp, message.header.frame_id
    stamp_ns = from_sec_nanosec(stamp.sec, stamp.nanosec)
    return _Packet(key, stamp_ns, frame_id, recorded_encoding(message).startswith(_MONO))


def recorded_encoding(message: Any) -> str:  # noqa: ANN401 - of the bag's types
    """Return the encoding of the camera's images, such as mono8; empty if a packet has it not."""
    return str(getattr(message, 'encoding', '')).partition(';')[2].rpartition(';')[2]


def _open(codec: str) -> Any:  # noqa: ANN401 - of PyAV
    """Open a decoder of FFmpeg.

    Raises:
        ValueError: PyAV is missing, or has no such decoder.
    """
    try:
        import av  # noqa: PLC0415 - an extra
    except ImportError:
        raise ValueError(NO_PYAV) from None
    try:
        context = av.CodecContext.create(_DECODERS.get(codec, codec), 'r')
    except (av.FFmpegError, ValueError) as error:
        raise ValueError(f'PyAV {av.__version__} cannot decode {TITLES[codec]} ({error})') from None
    context.thread_count = 1  # threads hold frames back
    context.options = {'err_detect': 'explode', 'max_pixels': str(MOST_PIXELS)}
    return context


# Luma of 8 bits is 16 to 235, and little more at edges, unless a flag says that it is 0 to 255.

_UNSPECIFIED = 0
_PLANAR = frozenset({'yuv420p', 'yuv422p', 'yuv444p', 'nv12'})
_BEYOND = (8, 243)
_SHARE = 0.01
_STEP = 4
"""Of the rows that are read."""


def _is_beyond_range(frame: Any) -> bool:  # noqa: ANN401 - of PyAV
    if frame.format.name not in _PLANAR or int(frame.color_range) != _UNSPECIFIED:
        return False
    plane = frame.planes[0]
    luma = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[::_STEP, : frame.width]
    low, high = _BEYOND
    return bool(np.count_nonzero((luma < low) | (luma > high)) > _SHARE * luma.size)


def _image(frame: Any, packet: _Packet[Key]) -> ImageMsg | ValueError:  # noqa: ANN401 - of PyAV
    import av  # noqa: PLC0415 - an extra

    is_grey = packet.is_grey or frame.format.name.startswith('gray')
    try:
        pixels = frame.to_ndarray(format='gray' if is_grey else 'bgr24')
    except (av.FFmpegError, ValueError) as error:  # of a damaged description of colours
        return ValueError(f'no pixels of the format {frame.format.name} ({error})')
    return encode_pixels(np.ascontiguousarray(pixels), packet.stamp_ns, packet.frame_id)


def picture_size(message: Any) -> tuple[int, int] | None:  # noqa: ANN401 - of the bag's types
    """Return (width, height) of an Image, a CompressedImage or a key frame; None if unknown."""
    if not is_video(message):
        return size_of(message)
    decoder: VideoDecoder[int] = VideoDecoder()
    for _, image in (*decoder.feed(0, message), *decoder.rest()):
        if not isinstance(image, ValueError):
            return int(image.width), int(image.height)
    return None


def scaled_to_odd(pixels: Pixels, size: tuple[int, int]) -> Pixels | None:
    """Scale an image to an odd (width, height) that its encoder made even; None for others.

    Chroma is stored for pairs of pixels; pymcap-cli scales the image.
    """
    if not is_made_even((pixels.shape[1], pixels.shape[0]), size):
        return None
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    return np.asarray(cv2.resize(pixels, size), dtype=pixels.dtype)


def is_made_even(own: tuple[int, int], size: tuple[int, int]) -> bool:
    """Return whether an image has a (width, height) of which its encoder made odd lengths even."""
    lengths = zip(size, own, strict=True)
    return own != size and all(mine in {length, length - length % 2} for length, mine in lengths)
