# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Images of messages: the pixels of any Image or CompressedImage, and images of KITTI as both."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

import numpy as np

from ..files.image_files import (
    JPEG_SIGNATURE,
    PNG_SIGNATURE,
    decode_jpeg,
    encode_png,
    inflated,
    is_webp,
    is_whole_webp,
    jpeg_size,
    parse_image,
    png_chunks,
    png_size,
    webp_size,
)
from ..model.samples import MOST_PIXELS, Image
from ..model.streams import PngForm
from ..options.messages import ColorEncoding
from .cdr import make_header
from .ros_types import CompressedImage, ImageMsg

if TYPE_CHECKING:
    from pathlib import PurePath

    import numpy.typing as npt


# Any sensor_msgs/Image or CompressedImage -> pixels: grey, or colour in the order BGR.
#
# Grey keeps its 8 or 16 bits. Colour has 8 bits a channel, the upper 8 of 16 as in cv_bridge,
# unless deep pixels are requested. Alpha is dropped. Sources: sensor_msgs/image_encodings.hpp;
# compressed_image_transport, whose format is "ENCODING; png compressed ..." where others write just
# "png".

if TYPE_CHECKING:
    Pixels: TypeAlias = npt.NDArray[np.uint8 | np.uint16]

_JPEG_END = b'\xff\xd9'
LOSSY = frozenset({'JPEG', 'WebP'})
"""Kinds of pictures whose pixels are not those that were encoded, usually."""
_SIZES = {'PNG': png_size, 'JPEG': jpeg_size, 'WebP': webp_size}
_PNG_HEADER = struct.Struct('>8s4s4sIIBBBBB')
_PLAIN = {(8, 0, 0, 0, 0), (8, 2, 0, 0, 0), (16, 0, 0, 0, 0), (16, 2, 0, 0, 0)}
"""Depth, colour (0 grey, 2 RGB), compression, filter and interlace, as in IHDR."""

_TRAILING_BYTES = 52
_DEPTH_HEAD_BYTES = 12
_SMALLEST_MOSAIC = 3


class _Encoding(NamedTuple):
    """The storage of a pixel, and OpenCV's conversion of it to BGR, '' for none."""

    value_bytes: int
    channels: int
    conversion: str = ''


_FLOATS = _Encoding(4, 1)
_ENCODINGS = {
    'mono8': _Encoding(1, 1),
    'mono16': _Encoding(2, 1),
    'bgr8': _Encoding(1, 3),
    'rgb8': _Encoding(1, 3, 'COLOR_RGB2BGR'),
    'bgra8': _Encoding(1, 4, 'COLOR_BGRA2BGR'),
    'rgba8': _Encoding(1, 4, 'COLOR_RGBA2BGR'),
    'bgr16': _Encoding(2, 3),
    'rgb16': _Encoding(2, 3, 'COLOR_RGB2BGR'),
    'bgra16': _Encoding(2, 4, 'COLOR_BGRA2BGR'),
    'rgba16': _Encoding(2, 4, 'COLOR_RGBA2BGR'),
    '8UC1': _Encoding(1, 1),
    '8UC3': _Encoding(1, 3),
    '16UC1': _Encoding(2, 1),
    **{
        f'bayer_{pattern}{bits}': _Encoding(bits // 8, 1, f'COLOR_Bayer{pattern.upper()}2BGR')
        for pattern in ('rggb', 'bggr', 'gbrg', 'grbg')
        for bits in (8, 16)
    },
    'yuv422': _Encoding(1, 2, 'COLOR_YUV2BGR_UYVY'),
    'uyvy': _Encoding(1, 2, 'COLOR_YUV2BGR_UYVY'),
    'yuv422_yuy2': _Encoding(1, 2, 'COLOR_YUV2BGR_YUY2'),
    'yuyv': _Encoding(1, 2, 'COLOR_YUV2BGR_YUY2'),
}


def decode_pixels(message: ImageMsg, *, deep: bool = False) -> Pixels:
    """Decode to (H, W) uint8 or uint16, or (H, W, 3) uint8 BGR; a view if nothing is converted.

    8UC1, 16UC1 and 8UC3 are decoded as mono8, mono16 and bgr8; a mosaic is interpolated bilinearly.
    If deep, colour of 16 bits stays uint16.

    Raises:
        ValueError: The encoding is unknown, the image is empty, or the data are too short.
    """
    encoding = _encoding_of(message)
    values = _values(message, encoding)
    if encoding.conversion:
        return _converted(_kept_bits(values, deep=deep), encoding.conversion)
    return values if encoding.channels == 1 else _kept_bits(values, deep=deep)


def pixels_of(message: Any, *, deep: bool = False) -> Pixels:  # noqa: ANN401 - of the bag's types
    """Decode an Image or CompressedImage; see decode_pixels and decode_compressed_pixels.

    Raises:
        ValueError: It cannot be decoded.
    """
    decode = decode_compressed_pixels if hasattr(message, 'format') else decode_pixels
    return decode(message, deep=deep)


def stored_values(message: ImageMsg) -> npt.NDArray[Any]:
    """Return the values of an Image of any known encoding, or of 32FC1, as they are stored.

    Raises:
        ValueError: As decode_pixels.
    """
    encoding = _FLOATS if message.encoding == '32FC1' else _encoding_of(message)
    return _values(message, encoding)


def _encoding_of(message: ImageMsg) -> _Encoding:
    encoding = _ENCODINGS.get(message.encoding)
    if encoding is None:
        raise ValueError(
            f'unknown encoding {message.encoding!r}; known are {", ".join(_ENCODINGS)}'
        )
    return encoding


def _values(message: ImageMsg, encoding: _Encoding) -> npt.NDArray[Any]:
    """Return (H, W) or (H, W, channels) of the stored values.

    Raises:
        ValueError: The image is empty, its rows overlap, or the data are too short.
    """
    height, width, step = message.height, message.width, message.step
    if not height * width:
        raise ValueError(f'an image of {width} x {height} pixels')
    pixel_bytes = encoding.value_bytes * encoding.channels
    if step < width * pixel_bytes:
        raise ValueError(
            f'a row of {width} pixels of {pixel_bytes} bytes does not fit in step, {step} bytes'
        )
    data = np.ascontiguousarray(message.data, dtype=np.uint8)
    if len(data) < height * step:
        raise ValueError(
            f'{len(data)} bytes of data; {height} rows of {step} bytes are {height * step}'
        )
    order = '>' if message.is_bigendian else '<'
    kind = 'f' if encoding is _FLOATS else 'u'
    values: npt.NDArray[Any] = np.ndarray(
        (height, width, encoding.channels),
        f'{order}{kind}{encoding.value_bytes}',
        data,
        strides=(step, pixel_bytes, encoding.value_bytes),
    )
    if encoding.value_bytes > 1:
        values = np.require(values, values.dtype.newbyteorder('='), 'A')
    return values[..., 0] if encoding.channels == 1 else values


def _kept_bits(values: Pixels, *, deep: bool) -> Pixels:
    """Return the upper 8 bits of 16-bit values unless deep; others unchanged."""
    if deep or values.dtype.itemsize == 1:
        return values
    return (values >> 8).astype(np.uint8, copy=False)


def _converted(values: Pixels, conversion: str) -> Pixels:
    """Convert stored values to (H, W, 3) BGR.

    Raises:
        ValueError: The image is too small, or has an odd width where pixels share their colour.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    height, width = values.shape[:2]
    if values.ndim == 2 and min(height, width) < _SMALLEST_MOSAIC:
        raise ValueError(f'a mosaic of {width} x {height} pixels')
    if 'YUV' in conversion and width % 2:
        raise ValueError(f'an odd width, {width} pixels, of which each two share their colour')
    return np.asarray(cv2.cvtColor(values, getattr(cv2, conversion)), dtype=values.dtype)


_MOST_TINT = 16
"""Levels between the channels of a pixel without colour: encoders round them."""


def as_grey(pixels: Pixels, most_tint: int = _MOST_TINT) -> Pixels:
    """Return (H, W) of BGR pixels without colour, as of a grey camera; coloured ones as given."""
    if pixels.ndim == 2 or np.ptp(pixels, axis=2).max() > most_tint:
        return pixels
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=pixels.dtype)


def decode_compressed_pixels(message: CompressedImage, *, deep: bool = False) -> Pixels:
    """Decode a PNG, JPEG or WebP to (H, W) uint8 or uint16, or (H, W, 3) uint8 BGR.

    The kind is detected from the data; format only determines whether grey pixels are a mosaic.

    Raises:
        ValueError: The data are of another kind, truncated, corrupt or too large, or cannot be
            decoded.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    kind = picture_kind(message)
    data = message.data.tobytes()
    width, height = _SIZES[kind](data)
    if width * height > MOST_PIXELS:
        raise ValueError(f'a {kind} of {width} x {height} pixels')
    file = np.frombuffer(inflated(data) if kind == 'PNG' else data, dtype=np.uint8)
    # A camera's calibration is of the pixels as stored, whatever the orientation in EXIF.
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        pixels = decode_jpeg(file, flags) if kind == 'JPEG' else cv2.imdecode(file, flags)
    except cv2.error:  # more pixels than OpenCV allows
        pixels = None
    if pixels is None:
        raise ValueError(f'the {kind} cannot be decoded')
    values = cast('Pixels', pixels)
    if values.ndim == 3:
        return _kept_bits(values, deep=deep)
    mosaic = _mosaic(message.format)
    return _converted(_kept_bits(values, deep=deep), mosaic) if mosaic else values


def picture_kind(message: CompressedImage) -> str:
    """Detect PNG, JPEG or WebP from the data, not the format; the data are not decoded.

    Raises:
        ValueError: The data are of another kind, or truncated.
    """
    kind = _kind_of(message)
    if not kind:
        start = message.data[: len(PNG_SIGNATURE)].tobytes()
        raise ValueError(
            f'neither PNG nor JPEG nor WebP: format {message.format!r}, data {start!r}'
        )
    data = message.data.tobytes()
    if not _is_whole(kind, data):
        raise ValueError(f'the {kind} is cut after {len(data)} bytes')
    return kind


def _is_whole(kind: str, data: bytes) -> bool:
    if kind == 'WebP':
        return is_whole_webp(data)
    return _JPEG_END in data if kind == 'JPEG' else png_chunks(data) is not None


def size_of(message: ImageMsg | CompressedImage) -> tuple[int, int] | None:
    """Return (width, height) from an image's header, None if unknown."""
    if not hasattr(message, 'format'):
        size = int(message.width), int(message.height)
    else:
        data = message.data.tobytes()
        kind = 'PNG' if data.startswith(PNG_SIGNATURE) else 'WebP' if is_webp(data) else 'JPEG'
        size = _SIZES[kind](data)
    return size if all(size) else None


def png_of(message: CompressedImage) -> bytes | None:
    """Return the message's own bytes if KITTI's loaders support them, else None.

    They must be a complete PNG of 8 or 16 bits grey or RGB, not interlaced, without a transparent
    colour, and not a mosaic.

    Raises:
        ValueError: A depth image (compressedDepth), or a damaged PNG.
    """
    if _kind_of(message) != 'PNG' or _mosaic(message.format):
        return None
    png = message.data.tobytes()
    chunks = png_chunks(png)
    if chunks is None or len(png) < _PNG_HEADER.size:
        return None
    kinds, end = chunks
    _, _, first, width, height, *form = _PNG_HEADER.unpack_from(png)
    sound = first == b'IHDR' and width and height and b'IDAT' in kinds
    plain = tuple(form) in _PLAIN and b'tRNS' not in kinds
    # files.png accepts some bytes after the end, which some programs append.
    return png if sound and plain and len(png) - end <= _TRAILING_BYTES else None


def _kind_of(message: CompressedImage) -> str:
    """Detect PNG, JPEG or WebP from the first bytes, '' for others.

    Raises:
        ValueError: A depth image: a header of 12 bytes, then a PNG or run lengths.
    """
    head = message.data[: _DEPTH_HEAD_BYTES + len(PNG_SIGNATURE)].tobytes()
    if head.startswith(PNG_SIGNATURE):
        return 'PNG'
    if head.startswith(JPEG_SIGNATURE):
        return 'JPEG'
    if is_webp(head):
        return 'WebP'
    if head.endswith(PNG_SIGNATURE) or 'compressedDepth' in message.format:
        raise ValueError(f'a depth image (format {message.format!r}), which is no picture')
    return ''


def _mosaic(format_: str) -> str:
    """Return the conversion of a mosaic that was compressed as grey, '' for any other format.

    compressed_image_transport names it "bayer_rggb8; jpeg compressed ". In the case of
    "... compressed bgr8" it was converted before, and the pixels are not grey.
    """
    encoding, semicolon, _ = format_.partition(';')
    mosaic = bool(semicolon) and encoding.startswith('bayer_') and encoding in _ENCODINGS
    return _ENCODINGS[encoding].conversion if mosaic else ''


# Image <-> sensor_msgs/CompressedImage (the file's own bytes) and sensor_msgs/Image (pixels).

_GREY = {'uint8': 'mono8', 'uint16': 'mono16'}
_FROM_BGR = {ColorEncoding.RGB8: 'COLOR_BGR2RGB', ColorEncoding.MONO8: 'COLOR_BGR2GRAY'}


def encode_compressed(image: Image, stamp_ns: int, frame_id: str) -> CompressedImage:
    """Wrap the file's own bytes; format is png or jpeg, which image_transport and viewers read."""
    data = np.frombuffer(image.data, dtype=np.uint8)
    return CompressedImage(make_header(stamp_ns, frame_id), image.format, data)


def decode_compressed(message: CompressedImage, path: PurePath) -> Image:
    """Decode an image made by encode_compressed; path is for errors.

    Raises:
        BadFileError: It is empty, no PNG or JPEG, truncated or damaged.
    """
    return parse_image(message.data.tobytes(), str(path))


def encode_pixels(
    pixels: Pixels,
    stamp_ns: int,
    frame_id: str,
    color: ColorEncoding = ColorEncoding.BGR8,
) -> ImageMsg:
    """Wrap the pixels of decode_image: mono8 or mono16 of grey ones, the given encoding of colour.

    Colour becomes mono8 by OpenCV's weights, 0.299 R + 0.587 G + 0.114 B, as in cv_bridge.
    """
    encoding = _GREY[pixels.dtype.name] if pixels.ndim == 2 else color.value
    if pixels.ndim == 3 and color in _FROM_BGR:
        import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

        pixels = cast('Pixels', cv2.cvtColor(pixels, getattr(cv2, _FROM_BGR[color])))
    return ImageMsg(
        header=make_header(stamp_ns, frame_id),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels[0].nbytes,
        data=pixels.reshape(-1).view(np.uint8),
    )


def decode_image(message: ImageMsg, form: PngForm = PngForm.FAST) -> Image:
    """Decode any Image to a PNG file of its pixels, in one of its forms.

    Raises:
        ValueError: As decode_pixels.
    """
    pixels = decode_pixels(message)
    height, width = pixels.shape[:2]
    return Image(encode_png(pixels, form), width, height, 1 if pixels.ndim == 2 else 3)
