# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Image files: sizes of all kinds, PNG parsed, decoded and encoded, JPEG decoded.

The kind is detected from the bytes: some programs give a JPEG the name of a PNG.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from ..model.errors import BadFileError
from ..model.samples import JPEG, MOST_PIXELS, Image
from ..model.streams import PngForm
from .local_files import adler32, crc32

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    import numpy.typing as npt


# The size of a PNG, JPEG or WebP and the chunks of a PNG, from the bytes of any program's file.
#
# Sources: PNG (W3C, 3rd edition), sections 5.2 and 5.3; ITU T.81 (JPEG), B.1.1.3 and B.2.2; RFC
# 9649 (WebP), sections 2.4 to 2.7 and 3.4; RFC 6386 (VP8), section 9.1.

PNG_SIGNATURE = b'\x89PNG\r\n\x1a\n'
JPEG_SIGNATURE = b'\xff\xd8\xff'
_RIFF_HEAD = 8
_WEBP_BODY = 10
_CHUNK = struct.Struct('>I4s')
_CRC_AND_CHUNK = struct.Struct('>II4s')
_CRC_BYTES = 4
_PNG_SIZE = struct.Struct('>16xII')
# Frame headers are C0 to CF without C4, C8 and CC.
_JPEG_SEGMENT = struct.Struct('>BBH')
_JPEG_FRAME = struct.Struct('>BHHB')
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def png_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros if the header is truncated."""
    return _PNG_SIZE.unpack_from(data) if len(data) >= _PNG_SIZE.size else (0, 0)


class JpegFrame(NamedTuple):
    """The frame header of a JPEG: its size, its number of components, and where it ends."""

    width: int
    height: int
    components: int
    end: int


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros without a frame header."""
    frame = jpeg_frame(data)
    return (0, 0) if frame is None else frame[:2]


def jpeg_frame(data: bytes) -> JpegFrame | None:
    """Return the frame header; None without one."""
    offset = 2
    while offset + _JPEG_SEGMENT.size + _JPEG_FRAME.size <= len(data):
        mark, kind, length = _JPEG_SEGMENT.unpack_from(data, offset)
        if mark != 0xFF:
            break
        if kind in _JPEG_FRAMES:
            _, height, width, count = _JPEG_FRAME.unpack_from(data, offset + _JPEG_SEGMENT.size)
            return JpegFrame(width, height, count, offset + 2 + length)
        # Fill bytes before a marker, and markers without a segment, are one and two bytes.
        offset += 1 if kind == 0xFF else 2 + length
    return None


def is_webp(data: bytes) -> bool:
    """Return whether data begin as a WebP."""
    return data[:4] == b'RIFF' and data[8:12] == b'WEBP'


def is_whole_webp(data: bytes) -> bool:
    """Return whether a WebP has all the bytes that its header states."""
    return len(data) >= _RIFF_HEAD + int.from_bytes(data[4:8], 'little')


def webp_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros if the header is truncated or of an unknown kind."""
    kind, body = data[12:16], data[20:30]
    if len(body) < _WEBP_BODY:
        return 0, 0
    if kind == b'VP8X':
        width, height = (int.from_bytes(body[at : at + 3], 'little') + 1 for at in (4, 7))
        return width, height
    if kind == b'VP8L':
        bits = int.from_bytes(body[1:5], 'little')
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b'VP8 ':
        width, height = (int.from_bytes(body[at : at + 2], 'little') & 0x3FFF for at in (6, 8))
        return width, height
    return 0, 0


def png_chunks(png: bytes) -> tuple[set[bytes], int] | None:
    """Return the kinds of a PNG's chunks and the end of the last one, None if it is truncated.

    Raises:
        ValueError: The checksum of a chunk is wrong.
    """
    view, size = memoryview(png), len(png)
    offset = len(PNG_SIGNATURE)
    if offset + _CHUNK.size > size:
        return None
    length, kind = _CHUNK.unpack_from(png, offset)
    kinds = {kind}
    end = offset + _CHUNK.size + length
    # One unpacking a chunk: OpenCV writes one every 8 KiB.
    while kind != b'IEND' and end + _CRC_AND_CHUNK.size <= size:
        crc, length, following = _CRC_AND_CHUNK.unpack_from(png, end)
        if crc32(view[offset + 4 : end]) != crc:
            raise _wrong_checksum(kind, offset)
        offset, kind = end + _CRC_BYTES, following
        kinds.add(kind)
        end = offset + _CHUNK.size + length
    if end + _CRC_BYTES > size:
        return None
    if crc32(view[offset + 4 : end]) != int.from_bytes(view[end : end + _CRC_BYTES], 'big'):
        raise _wrong_checksum(kind, offset)
    return (kinds, end + _CRC_BYTES) if kind == b'IEND' else None


def _wrong_checksum(kind: bytes, offset: int) -> ValueError:
    name = kind.decode('ascii', 'replace')
    return ValueError(f'the PNG is damaged: its {name} at byte {offset} has a wrong checksum')


# JPEG files -> pixels; corrupt data is an error.
#
# libjpeg decodes corrupt data to wrong pixels, and only prints a warning to the process's standard
# error: OpenCV does not report it. So that output is read while a file is decoded. Source of the
# warnings: jerror.h and jerror.c of libjpeg, where a file's first warning is printed as one line.

_STDERR = 2
_LOCK = Lock()  # one standard error for all threads
_WARNING = re.compile(
    rb'(?:Corrupt JPEG data: |Premature end of JPEG file|Invalid SOS parameters|Inconsistent progr'
    rb'ession|Invalid crop request|Unknown Adobe color|Warning: unknown JFIF|Application transfer'
    rb'red too many).*\n'
)
_PADDING = re.compile(r'Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd9')
_MOST_PADDING = 16
"""Bytes before the end of the image, which the encoders of some cameras append."""

_HARMLESS = ('Warning: ', 'Unknown Adobe color')


def decode_jpeg(file: npt.NDArray[Any], flags: int) -> npt.NDArray[Any] | None:
    """Decode a JPEG file.

    Args:
        file: Its bytes, (N,) uint8.
        flags: Flags of cv2.imdecode.

    Returns:
        The pixels as cv2.imdecode returns them; None where it cannot decode any.

    Raises:
        ValueError: The data is corrupt.
        cv2.error: More pixels than OpenCV allows.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that most commands do not need

    warnings: list[str] = []
    with _warnings_of_libjpeg(warnings):
        pixels = cv2.imdecode(file, flags)
    for warning in warnings:
        if not _is_harmless(warning):
            raise ValueError(f'the JPEG is corrupt: {warning.removeprefix("Corrupt JPEG data: ")}')
    return pixels


def _is_harmless(warning: str) -> bool:
    padding = _PADDING.match(warning)
    if padding is not None:
        return int(padding[1]) <= _MOST_PADDING
    return warning.startswith(_HARMLESS)


@contextmanager
def _warnings_of_libjpeg(lines: list[str]) -> Iterator[None]:
    """Collect the warnings that libjpeg prints; all other output goes where it should.

    Where there is no standard error or no room for a file, they are not known.
    """
    from tempfile import TemporaryFile  # noqa: PLC0415 - 4 ms, for JPEG only

    with _LOCK, ExitStack() as exit_stack:
        try:
            caught = exit_stack.enter_context(TemporaryFile(buffering=0))
            own = os.dup(_STDERR)
        except OSError:
            yield
            return
        exit_stack.callback(os.close, own)
        os.dup2(caught.fileno(), _STDERR)
        try:
            yield
        finally:
            os.dup2(own, _STDERR)
            caught.seek(0)
            printed = caught.read()
            others = _WARNING.sub(b'', printed)
            if others:
                os.write(own, others)
        lines += [text.decode('ascii', 'replace').strip() for text in _WARNING.findall(printed)]


# PNG files as OpenCV decodes them fastest and without a word: inflated, checked, nothing else.
#
# Two thirds of decoding is inflating, and isal inflates twice as fast as the zlib in OpenCV's
# wheels. So the image data is inflated here and passed on in a PNG whose data is merely stored.
# libpng prints what it does not like to standard error, and OpenCV allocates what a file declares;
# so what they would find is found here, and chunks that do not change pixels are left out.
# Formats: PNG (W3C, 3rd edition) sections 5.3, 8 and 11.2, zlib RFC 1950, deflate RFC 1951 section
# 3.2.4.

_LIBRARY: Any = zlib
try:
    from isal import isal_zlib
except ImportError:
    pass  # a workspace may do without
else:
    _LIBRARY = isal_zlib

_NUMBER = struct.Struct('>I')
_HEADER = struct.Struct('>IIBBBBB')
_MOST_SIDE = 10**6
"""Pixels of a row or a column that libpng takes."""
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Samples of a pixel, by colour type."""
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_PALETTE = 3
_ENTRY_BYTES = 3
_LAST_FILTER = 4
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
           (0, 1, 1, 2))  # fmt: skip
"""Passes of Adam7: first column and row, and the distance of columns and rows."""
_MOST_INFLATED = 1032
"""Bytes that a byte of deflated data becomes at most: 258 of each two bits."""
_MOST_BEYOND = 2**16
"""Bytes of image data beyond the image that some encoders write, and decoders ignore."""
_UPPER_CASE = 0x20
_BLOCK = struct.Struct('<BHH')
_BLOCK_BYTES = 0xFFFF
_STORED_HEAD = b'\x78\x01'


class _PixelRows(NamedTuple):
    """The rows of an image, or of a part if it is interlaced: each a filter's number, and bytes."""

    rows: int
    row_bytes: int


def inflated(png: bytes) -> bytes:
    """Return a PNG of the same pixels, stored instead of compressed, without any other chunk.

    Args:
        png: A file that begins with PNG's signature. Checksums of chunks are not checked.

    Raises:
        ValueError: It is damaged or cut off; it has fewer image data than its header states, or so
            many that they would fill the memory; or libpng does not take it.
    """
    header, palette, parts = _image_chunks(png)
    width, height, depth, colour, *methods = header
    if depth not in _DEPTHS.get(colour, ()) or methods not in ([0, 0, 0], [0, 0, 1]):
        raise ValueError(f'a PNG of colour type {colour} with {depth} bits, methods {methods}')
    passes = _passes(width, height, depth * _SAMPLES[colour], interlaced=methods[-1] == 1)
    size = sum(pixel_rows.rows * pixel_rows.row_bytes for pixel_rows in passes)
    stored = sum(map(len, parts))
    if size > _MOST_INFLATED * stored:
        raise ValueError(
            f'a PNG of {width} x {height} pixels with {stored} bytes of image data, which is too'
            f' little'
        )
    if not (0 < width <= _MOST_SIDE and 0 < height <= _MOST_SIDE):
        raise ValueError(f'a PNG of {width} x {height} pixels')
    raw = _inflate(parts, size)
    _check_filters(raw, passes)
    chunks = [PNG_SIGNATURE, *_chunk(b'IHDR', _HEADER.pack(*header))]
    if colour == _PALETTE:
        # All entries that pixels may name: libpng complains about others.
        most = _ENTRY_BYTES << depth
        chunks += _chunk(b'PLTE', bytes(palette[:most]).ljust(most, b'\0'))
    chunks += _chunk(b'IDAT', _STORED_HEAD, *_blocks(raw), _NUMBER.pack(adler32(raw)))
    return b''.join([*chunks, *_chunk(b'IEND')])


def _image_chunks(png: bytes) -> tuple[tuple[int, ...], memoryview, list[memoryview]]:
    """Return the header, the palette, and the consecutive parts of image data.

    Raises:
        ValueError: A chunk is longer than the file, unknown and critical, or missing.
    """
    header: tuple[int, ...] = ()
    palette, parts, last = memoryview(b''), list[memoryview](), b''
    for kind, body in _chunks(png):
        if kind == b'IHDR' and len(body) == _HEADER.size and not header:
            header = _HEADER.unpack(body)
        elif kind == b'IDAT':
            if not parts or last == kind:
                parts.append(body)
        elif kind == b'PLTE':
            palette = palette if parts else body
        elif not kind[0] & _UPPER_CASE:
            raise ValueError(f'a PNG with a chunk {kind!r} that no decoder knows')
        last = kind
    if not header:
        raise ValueError('a PNG whose header is cut off')
    if header[3] == _PALETTE and (not palette or len(palette) % _ENTRY_BYTES):
        raise ValueError('a PNG without the palette that its pixels refer to')
    return header, palette, parts


def _chunks(png: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Yield the kind and the body of the chunks up to the end, or to where the file is cut.

    Raises:
        ValueError: One is longer than the file: OpenCV would allocate what it declares.
    """
    view, offset = memoryview(png), len(PNG_SIGNATURE)
    while offset + _CHUNK.size <= len(png):
        length, kind = _CHUNK.unpack_from(png, offset)
        body = offset + _CHUNK.size
        if body + length > len(png):
            raise ValueError(
                f'a PNG with a chunk of {length} bytes at byte {offset}, beyond its end'
            )
        if kind == b'IEND':
            return
        yield kind, view[body : body + length]
        offset = body + length + _CRC_BYTES


def _passes(width: int, height: int, bits: int, *, interlaced: bool) -> list[_PixelRows]:
    """Return the rows of an image's passes, which are one unless it is interlaced."""
    passes = []
    for x, y, dx, dy in _PASSES if interlaced else ((0, 0, 1, 1),):
        columns, rows = -(-(width - x) // dx), -(-(height - y) // dy)
        if columns > 0 and rows > 0:
            passes.append(_PixelRows(rows, 1 + (columns * bits + 7) // 8))
    return passes


def _inflate(parts: list[memoryview], size: int) -> bytes:
    """Return the bytes of an image.

    Raises:
        ValueError: The data are damaged, or inflate to fewer or to many more.
    """
    inflater = _LIBRARY.decompressobj()
    most = size + _MOST_BEYOND
    try:
        raw: bytes = inflater.decompress(b''.join(parts), most)
    except _LIBRARY.error:
        raise ValueError('a PNG whose image data are damaged') from None
    if len(raw) < size:
        raise ValueError(f'a PNG with {len(raw)} of the {size} bytes of its image')
    if len(raw) == most and not inflater.eof:
        raise ValueError('a PNG with more image data than its header states')
    return raw if len(raw) == size else raw[:size]


def _check_filters(raw: bytes, passes: list[_PixelRows]) -> None:
    """Refuse a row with a filter that does not exist.

    Raises:
        ValueError: There is one.
    """
    values, start = np.frombuffer(raw, np.uint8), 0
    for rows, row_bytes in passes:
        end = start + rows * row_bytes
        if values[start:end:row_bytes].max() > _LAST_FILTER:
            raise ValueError('a PNG with a row whose filter does not exist')
        start = end


def _chunk(kind: bytes, *parts: bytes | memoryview) -> list[bytes | memoryview]:
    """Return the parts of a chunk: joined later, with those of others, they are copied once."""
    checksum = crc32(kind)
    for part in parts:
        checksum = crc32(part, checksum)
    return [_NUMBER.pack(sum(map(len, parts))), kind, *parts, _NUMBER.pack(checksum)]


def _blocks(raw: bytes) -> list[bytes | memoryview]:
    """Split data into stored deflate blocks, each preceded by its header."""
    view = memoryview(raw)
    blocks: list[bytes | memoryview] = []
    for start in range(0, len(raw), _BLOCK_BYTES):
        block = view[start : start + _BLOCK_BYTES]
        final = start + _BLOCK_BYTES >= len(raw)
        blocks += [_BLOCK.pack(final, len(block), len(block) ^ 0xFFFF), block]
    return blocks


# A PNG decoder: OpenCV, after the image data have been inflated and checked.


def decode_png(image: Image) -> npt.NDArray[np.uint8 | np.uint16]:
    """Decode to pixels: (H, W) uint8 or uint16, as in the file, or (H, W, 3) uint8 BGR.

    Of colour of 16 bits these are the upper 8.

    Raises:
        ValueError: The PNG cannot be decoded, or is too large.
    """
    if image.width * image.height > MOST_PIXELS:
        raise ValueError(f'a PNG of {image.width} x {image.height} pixels is not decoded')
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    grey = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
    flag = grey if image.channels == 1 else cv2.IMREAD_COLOR
    file = np.frombuffer(inflated(image.data), dtype=np.uint8)
    try:
        pixels = cv2.imdecode(file, flag)
    except cv2.error:  # more pixels than OpenCV allows
        pixels = None
    if pixels is None or pixels.shape[:2] != (image.height, image.width):
        raise ValueError('the PNG cannot be decoded')
    return cast('npt.NDArray[np.uint8 | np.uint16]', pixels)


# A PNG encoder: fast, or in the form of KITTI's own files.
#
# Fast: every row is filtered with Sub, each byte less that of the pixel to its left: the residuals
# of photographs compress best with it among the filters that cost next to nothing. What follows is
# mostly Huffman coding, so deflate searches as near as it can: a larger window costs time and, by
# longer codes, size. isal does it at 0.4 GB/s, and zlib where isal is not installed.
#
# KITTI's PNG files are a function of their pixels: each recipe below gave back, byte for byte, all
# originals that were tried: 521 camera images of all layouts and 96 of KITTI-360, as OpenCV's
# encoder wrote them in those years, and 51 depth maps, as pypng does. zlib-ng, where it is
# installed, writes the same bits with Z_HUFFMAN_ONLY, in 0.6 of the time; others differ.
#
# All of them release the GIL, and the same pixels give the same bytes in any thread.
#
# Formats: PNG (W3C, 3rd edition) sections 5.3, 9 and 11.2, zlib RFC 1950, deflate RFC 1951.

_GREY, _RGB = 0, 2
_SUB = 1
_ZLIB_HEAD = b'\x78\x01'
_FASTEST = 1
_RAW_DEFLATE = -15
_RAW_DEFLATE_NEAR = -9  # the smallest window of isal
_START_BYTES = 8
_MOST_MEMORY = 9
_IDAT_BYTES = 8192
_KITTI_STARTS = (_ZLIB_HEAD + b'\x04', _ZLIB_HEAD + b'\x05')
"""With the head of a block (RFC 1951, 3.2.7): last or not, BTYPE 2, HLIT 0."""
_FIRST_DATA = 33
"""Bytes of the signature and the header."""


def encode_png(pixels: npt.NDArray[np.uint8 | np.uint16], form: PngForm = PngForm.FAST) -> bytes:
    """Encode pixels as a PNG file, lossless.

    Args:
        pixels: (H, W), or (H, W, 3) BGR, uint8 or uint16; any strides.
        form: Which of the files with these pixels it is.

    Raises:
        ValueError: The pixels have another shape or type, or there are none.
    """
    kind = (pixels.dtype.type, pixels.shape[2:])
    if pixels.ndim < 2 or not pixels.size:
        raise ValueError(f'pixels of shape {pixels.shape}')
    if kind == (np.uint8, ()):
        return _file(pixels.view(np.uint8), _GREY, 1, form)
    if kind == (np.uint16, ()):
        return _file(pixels.astype('>u2', order='C').view(np.uint8), _GREY, 2, form)
    if kind == (np.uint8, (3,)):
        return _encode_colour(pixels, form)
    if kind == (np.uint16, (3,)):
        deep = pixels[..., ::-1].astype('>u2', order='C')
        return _file(deep.view(np.uint8).reshape(len(deep), -1), _RGB, 2, form)
    raise ValueError(f'pixels of shape {pixels.shape} and type {pixels.dtype}')


def _encode_colour(pixels: npt.NDArray[np.uint8 | np.uint16], form: PngForm) -> bytes:
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    rgb = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    return _file(rgb.reshape(len(rgb), -1), _RGB, 1, form)


def is_in_kitti_form(png: bytes) -> bool:
    """Return whether a PNG begins as KITTI's images: it need not be encoded anew.

    Its first block has Huffman codes of its own, and none for a length: Z_RLE has them for runs.
    """
    length, kind = _CHUNK.unpack_from(png.ljust(_FIRST_DATA + _CHUNK.size), _FIRST_DATA)
    start = _FIRST_DATA + _CHUNK.size
    is_first: bool = kind == b'IDAT' and length == _IDAT_BYTES
    return is_first and png[start : start + 3] in _KITTI_STARTS


def encode_depth_map(pixels: npt.NDArray[np.uint16]) -> bytes:
    """Encode (H, W) uint16 as a PNG file in the form of KITTI's depth maps."""
    rows = pixels.astype('>u2', order='C').view(np.uint8)
    plain = np.zeros((len(rows), 1 + rows.shape[1]), dtype=np.uint8)  # the filter None
    plain[:, 1:] = rows
    data = zlib.compress(plain.data)
    return _png(rows.shape, _GREY, 2, [data])


def _file(rows: npt.NDArray[np.uint8], colour: int, value_bytes: int, form: PngForm) -> bytes:
    """Return a PNG file of (H, N) bytes in the file's order."""
    filtered = _filtered(rows, _SAMPLES[colour] * value_bytes)
    if form is PngForm.FAST:
        data = b''.join([_ZLIB_HEAD, _deflated(filtered), _NUMBER.pack(adler32(filtered))])
        return _png(rows.shape, colour, value_bytes, [data])
    data = _deflated_by_opencv(filtered, form)
    parts = [data[start : start + _IDAT_BYTES] for start in range(0, len(data), _IDAT_BYTES)]
    return _png(rows.shape, colour, value_bytes, parts)


def _png(shape: tuple[int, ...], colour: int, value_bytes: int, data: Iterable[bytes]) -> bytes:
    """Return a PNG file of rows of bytes, whose data are in chunks already."""
    height, row_bytes = shape
    width = row_bytes // (_SAMPLES[colour] * value_bytes)
    header = _HEADER.pack(width, height, value_bytes * 8, colour, 0, 0, 0)
    parts = [PNG_SIGNATURE, *_chunk(b'IHDR', header)]
    for part in data:
        parts += _chunk(b'IDAT', part)
    return b''.join([*parts, *_chunk(b'IEND')])


def _filtered(rows: npt.NDArray[np.uint8], pixel_bytes: int) -> npt.NDArray[np.uint8]:
    """Return (H, N + 1) filtered rows, each preceded by the number of the filter, Sub."""
    height, width = rows.shape
    filtered = np.empty((height, 1 + width), dtype=np.uint8)
    filtered[:, 0] = _SUB
    filtered[:, 1 : 1 + pixel_bytes] = rows[:, :pixel_bytes]
    np.subtract(rows[:, pixel_bytes:], rows[:, :-pixel_bytes], out=filtered[:, 1 + pixel_bytes :])
    return filtered


def _deflated_by_opencv(filtered: npt.NDArray[np.uint8], form: PngForm) -> bytes:
    """Return the zlib stream of filtered rows, as OpenCV's encoder wrote KITTI's images."""
    library: Any = zlib
    strategy = zlib.Z_RLE
    if form is PngForm.KITTI:
        library, strategy = _huffman_library(), zlib.Z_HUFFMAN_ONLY
    packer = library.compressobj(
        _FASTEST, zlib.DEFLATED, zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, strategy
    )
    return b''.join([packer.compress(filtered.data), packer.flush()])


@lru_cache(maxsize=1)
def _huffman_library() -> Any:  # noqa: ANN401 - a module
    try:
        from zlib_ng import zlib_ng  # noqa: PLC0415 - an optional package
    except ImportError:
        return zlib
    return zlib_ng


def _deflated(data: npt.NDArray[np.uint8]) -> bytes:
    """Return a raw deflate stream that depends on the data alone.

    isal's compression of a stream's first bytes hashes the third of them from a register that it
    did not set (tmp2 in igzip_icf_body_h1_gr_bt.asm, after .write_first_byte): it holds an address
    on the thread's stack, and now and then other matches are found. A start of at most 16 bytes,
    flushed on its own, takes another path (igzip_icf_finish.asm), and no later byte is a first.
    """
    try:
        from isal import isal_zlib  # noqa: PLC0415 - a workspace may do without
    except ImportError:
        packer = zlib.compressobj(_FASTEST, zlib.DEFLATED, _RAW_DEFLATE, _MOST_MEMORY, zlib.Z_RLE)
        return packer.compress(data.data) + packer.flush()
    flat = data.reshape(-1)
    near = isal_zlib.compressobj(_FASTEST, isal_zlib.DEFLATED, _RAW_DEFLATE_NEAR)
    return b''.join(
        [
            near.compress(flat[:_START_BYTES]),
            near.flush(isal_zlib.Z_SYNC_FLUSH),
            near.compress(flat[_START_BYTES:]),
            near.flush(),
        ]
    )


# Checks of PNG files without decoding: header, chunks and their checksums.
#
# Source: the PNG specification (W3C, 3rd edition), sections 5.2 to 5.6 and 11.2.2.

_SIGNED_HEADER = struct.Struct('>8s4s4sIIBB')
_END = b'\x00\x00\x00\x00IEND\xaeB\x60\x82'
TRAILING_BYTES = 64
"""The end of a PNG is searched in so many of the last bytes."""

_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 1, 6: 3}


_REMEDY = 'copy the file again from its source'


def parse_png(data: bytes, path: Path | str, size: int | None = None) -> Image:
    """Parse an image from the bytes of a PNG file.

    Args:
        data: The whole file, or its two ends of 64 bytes, whose checksums are not checked.
        path: The file, for errors.
        size: Bytes of the file, where data is only its ends.

    Raises:
        BadFileError: The file is empty, not a PNG, truncated or damaged.
    """
    if not data:
        raise BadFileError(path, 'the file is empty', 'a PNG image', remedy=_REMEDY)
    if len(data) < _SIGNED_HEADER.size or not data.startswith(PNG_SIGNATURE):
        raise BadFileError(path, 'no PNG signature and header', 'a PNG image', remedy=_REMEDY)
    _, _, kind, width, height, _, colour = _SIGNED_HEADER.unpack_from(data)
    if kind != b'IHDR' or colour not in _CHANNELS or not width or not height:
        raise BadFileError(path, 'a broken PNG header', 'a PNG image', remedy=_REMEDY)
    # Some programs put a few bytes behind the end, which decoders ignore.
    if data.rfind(_END, -TRAILING_BYTES) < 0:
        raise BadFileError(
            path,
            f'the PNG is cut after {len(data) if size is None else size} bytes',
            'an image with its end',
            remedy=_REMEDY,
        )
    if size is None:
        defect = _find_damage(data)
        if defect:
            raise BadFileError(path, f'the PNG is damaged: {defect}', 'an image', remedy=_REMEDY)
    return Image(data, width, height, _CHANNELS[colour])


def _find_damage(data: bytes) -> str:
    """Return the first chunk with a wrong length or checksum; '' for a valid PNG.

    Args:
        data: A PNG file that ends with IEND and at most TRAILING_BYTES.
    """
    view = memoryview(data)
    offset, head, unpack = len(PNG_SIGNATURE), _CHUNK.size, _CRC_AND_CHUNK.unpack_from
    last = len(data) - _CRC_AND_CHUNK.size
    length, kind = _CHUNK.unpack_from(data, offset)
    kinds = set()
    while kind != b'IEND':
        end = offset + head + length
        if end > last:
            return f'its {_name(kind)} at byte {offset} has a wrong length, {length}'
        crc, next_length, next_kind = unpack(data, end)
        # The length is not part of the checksum, but a wrong one leads to a wrong offset.
        if crc32(view[offset + 4 : end]) != crc:
            return f'its {_name(kind)} at byte {offset} has a wrong checksum or length'
        kinds.add(kind)
        offset, length, kind = end + 4, next_length, next_kind
    if not data.startswith(_END, offset) or len(data) - offset > TRAILING_BYTES:
        return f'its IEND at byte {offset} is not its end'
    return '' if b'IDAT' in kinds else 'it has no image data (IDAT)'


def _name(kind: bytes) -> str:
    """A chunk's type, whatever its bytes are."""
    return kind.decode('ascii', 'backslashreplace')


# Image files of a data set: KITTI's PNG, and the JPEG of sets of others in its folders.
#
# The kind is detected from the bytes: some programs give a JPEG the name of a PNG.

_JPEG_END = b'\xff\xd9'


def parse_image(data: bytes, path: Path | str, size: int | None = None) -> Image:
    """Parse an image from the bytes of its file, without decoding it.

    Args:
        data: The whole file; of a PNG its two ends are enough, as in parse_png.
        path: The file, for errors.
        size: Bytes of the file, where data is only its ends.

    Raises:
        BadFileError: The file is empty, no PNG or JPEG, truncated or damaged.
    """
    if not data.startswith(JPEG_SIGNATURE):
        return parse_png(data, path, size)
    frame = jpeg_frame(data)
    if frame is None or not frame.width or not frame.height:
        raise BadFileError(path, 'a broken JPEG header', 'a JPEG image', remedy=_REMEDY)
    # A thumbnail before the frame has an end of its own.
    if data.find(_JPEG_END, frame.end) < 0:
        text = f'the JPEG is cut after {len(data) if size is None else size} bytes'
        raise BadFileError(path, text, 'an image with its end', remedy=_REMEDY)
    return Image(data, frame.width, frame.height, 1 if frame.components == 1 else 3, JPEG)


def decode_image(image: Image) -> npt.NDArray[np.uint8 | np.uint16]:
    """Decode to pixels: (H, W) uint8 or uint16, as in the file, or (H, W, 3) uint8 BGR.

    Raises:
        ValueError: The image is corrupt or too large, or cannot be decoded.
    """
    if image.format != JPEG:
        return decode_png(image)
    if image.width * image.height > MOST_PIXELS:
        raise ValueError(f'a JPEG of {image.width} x {image.height} pixels is not decoded')
    import cv2  # noqa: PLC0415 - 0.2 s that passing files through does not need

    # A camera's calibration is of the pixels as stored, whatever the orientation in EXIF.
    kind = cv2.IMREAD_GRAYSCALE if image.channels == 1 else cv2.IMREAD_COLOR
    file = np.frombuffer(image.data, dtype=np.uint8)
    try:
        pixels = decode_jpeg(file, kind | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:  # more pixels than OpenCV allows
        pixels = None
    if pixels is None or pixels.shape[:2] != (image.height, image.width):
        raise ValueError('the JPEG cannot be decoded')
    return cast('npt.NDArray[np.uint8 | np.uint16]', pixels)
