# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cloudini's compressed clouds -> the bytes of their points. Versions 3 to 5.

The data are a header, text or binary, and chunks of 32768 points. A chunk is its length (uint32)
and a block of zstd, of lz4 (without a frame) or as it is. All numbers are little-endian.

A block has the points in turn, each with the fields in turn:

- A float with a resolution, in LOSSY: its multiple of the resolution, less that of the point
  before, as a varint; one byte of 0 is NaN, after which the one before counts as 0.
- An integer of 16 bits and more: the difference from the point before, as a varint.
- FLOAT32 in LOSSLESS, and FLOAT64 before version 4: its bits, XOR those of the point before.
- FLOAT64 without a resolution, from version 4 on: the same with fewer bits, see read_gorilla.
- Any other field, and all in NONE: its bytes.

In version 5 and LOSSY, the integers follow behind the points instead, one section a field. Of a
signed varint 1 is taken first, then zigzag undone. Source: cloudini_lib/src of
https://github.com/facontidavide/cloudini, d202e52 (1.2.2): cloudini.cpp (header, chunks),
codec_common.cpp (fields), v4_codec.cpp, v5_codec.cpp (sections), field_decoder.hpp.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import zstandard
from lz4 import block as lz4_block

from .cloudini_values import (
    GORILLA,
    VARINT,
    read_fixed,
    read_gorilla,
    read_records,
    read_short_differences,
    read_varints,
    too_short,
    undo_zigzag,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    Octets = npt.NDArray[np.uint8]
    Positions = npt.NDArray[np.intp]

MAGIC = b'CLOUDINI_V'

_VERSIONS = range(3, 6)
_GORILLA_VERSION, _SECTIONED_VERSION = 4, 5  # the first of each
POINTS_PER_CHUNK = 32768
_NONE, _LOSSY, _LOSSLESS = _ENCODINGS = ('NONE', 'LOSSY', 'LOSSLESS')
_COMPRESSIONS = ('NONE', 'LZ4', 'ZSTD')
_TYPES = {
    'INT8': 'i1',
    'UINT8': 'u1',
    'INT16': 'i2',
    'UINT16': 'u2',
    'INT32': 'i4',
    'UINT32': 'u4',
    'FLOAT32': 'f4',
    'FLOAT64': 'f8',
    'INT64': 'i8',
    'UINT64': 'u8',
}
"""In the order of their numbers, from 1 on: up to 8 they are those of PointField."""
_GROUPS = (3, 4)  # numbers of first fields that have 32-bit multiples
_LARGEST_PER_FIELD = 24  # bytes of a value in a block: 11, and 20 of a run of its own
_BLOCK_SLACK = 2**20


# The header.


@dataclass(frozen=True)
class PackedField:
    """A field of the points: kind is its numpy type, little-endian; resolution None without one."""

    name: str
    offset: int
    datatype: int
    kind: str
    resolution: float | None

    @property
    def is_wide_integer(self) -> bool:
        """True for an integer of 16 bits and more."""
        return self.kind[1] != 'f' and self.kind[2] != '1'


@dataclass(frozen=True)
class PackedHeader:
    """The header of a compressed cloud; begin is the offset of its first chunk."""

    version: int
    width: int
    height: int
    point_step: int
    encoding: str
    compression: str
    fields: tuple[PackedField, ...]
    begin: int

    @property
    def lossy_fields(self) -> dict[str, float]:
        """The resolutions of the fields that are rounded, by name."""
        return {
            field.name: field.resolution
            for field in self.fields
            if field.resolution is not None and _is_rounded(self, field)
        }

    @property
    def count(self) -> int:
        """Number of points."""
        return self.width * self.height


def read_header(data: bytes) -> PackedHeader:
    """Read the header of a compressed cloud.

    Raises:
        ValueError: It is damaged or of another version.
    """
    if not data.startswith(MAGIC):
        raise ValueError(f'its data begin with {data[: len(MAGIC)]!r}, not {MAGIC.decode()}')
    begin = len(MAGIC) + 2
    digits = data[len(MAGIC) : begin]
    if not digits.isdigit() or int(digits) not in _VERSIONS:
        raise ValueError(f'Cloudini of version {digits!r}; versions {_VERSIONS[0]} to 5 are read')
    is_text = data[begin : begin + 1] == b'\n' and data[begin + 1 : begin + 2] != b'{'
    try:
        values = _text_header(data, begin + 1) if is_text else _binary_header(data, begin)
        header = PackedHeader(int(digits), **values)
    except (KeyError, TypeError, ValueError, IndexError, struct.error) as error:
        raise ValueError(f'its Cloudini header is damaged ({error!r})') from error
    for field in header.fields:
        if field.offset + int(field.kind[2]) > header.point_step:
            raise ValueError(f'its field {field.name} ends beyond point_step, {header.point_step}')
    return header


def _text_header(data: bytes, begin: int) -> dict[str, Any]:
    """Read lines of `key: value`; those of a field begin with two spaces, its first with a dash."""
    end = data.index(b'\0', begin)
    values: dict[str, str] = {}
    fields: list[dict[str, str]] = []
    for line in data[begin:end].decode().splitlines():
        if line.startswith('  - '):
            fields.append({})
        key, _, value = line.lstrip(' -').partition(':')
        (fields[-1] if line.startswith('  ') else values)[key] = value.strip()
    return {
        **{key: _natural(values[key]) for key in ('width', 'height', 'point_step')},
        'encoding': _one_of(_ENCODINGS, values['encoding_opt']),
        'compression': _one_of(_COMPRESSIONS, values['compression_opt']),
        'fields': tuple(
            _make_field(
                field['name'],
                _natural(field['offset']),
                list(_TYPES).index(field['type']) + 1,
                -1.0 if field['resolution'] == 'null' else float(field['resolution']),
            )
            for field in fields
        ),
        'begin': end + 1,
    }


def _binary_header(data: bytes, begin: int) -> dict[str, Any]:
    width, height, point_step, encoding, compression, count = struct.unpack_from(
        '<IIIBBH', data, begin
    )
    at = begin + struct.calcsize('<IIIBBH')
    fields = []
    for _ in range(count):
        [length] = struct.unpack_from('<H', data, at)
        name = data[at + 2 : at + 2 + length].decode()
        fields.append(_make_field(name, *struct.unpack_from('<IBf', data, at + 2 + length)))
        at += 2 + length + struct.calcsize('<IBf')
    return {
        'width': width,
        'height': height,
        'point_step': point_step,
        'encoding': _ENCODINGS[encoding],
        'compression': _COMPRESSIONS[compression],
        'fields': tuple(fields),
        'begin': at,
    }


def _natural(digits: str) -> int:
    if not (digits.isdecimal() and digits.isascii()) or int(digits) >= 2**32:
        raise ValueError(f'{digits!r} is no number from 0 to 2^32 - 1')
    return int(digits)


def _one_of(words: tuple[str, ...], word: str) -> str:
    if word not in words:
        raise ValueError(f'{word!r} is not one of {", ".join(words)}')
    return word


def _make_field(name: str, offset: int, datatype: int, resolution: float) -> PackedField:
    if not 0 < datatype <= len(_TYPES):
        raise ValueError(f'field {name} has the unknown type {datatype}')
    kind = '<' + list(_TYPES.values())[datatype - 1]
    step = float(np.float32(resolution)) if resolution > 0 else None
    return PackedField(name, offset, datatype, kind, step)


def _is_rounded(header: PackedHeader, field: PackedField) -> bool:
    return field.kind[1] == 'f' and field.resolution is not None and header.encoding == _LOSSY


# Chunks -> the bytes of the points.


def decode_points(data: bytes, header: PackedHeader) -> Octets:
    """Return (count x point_step,) bytes of the points; those of no field are 0.

    Args:
        data: The whole compressed data.
        header: Its header, whose number of bytes the caller has found acceptable.

    Raises:
        ValueError: The data are damaged.
    """
    points = np.zeros((header.count, header.point_step), np.uint8)
    done = 0
    for block in _blocks(data, header):
        count = min(header.count - done, POINTS_PER_CHUNK)
        if not count:
            raise ValueError('its data have more chunks than its points need')
        _decode_block(block, header, points[done : done + count])
        done += count
    if done < header.count:
        raise ValueError(f'its data end after {done} of {header.count} points')
    return points.reshape(-1)


def _blocks(data: bytes, header: PackedHeader) -> Iterator[Octets]:
    view, at = memoryview(data), header.begin
    most = POINTS_PER_CHUNK * _LARGEST_PER_FIELD * len(header.fields) + _BLOCK_SLACK
    while at < len(view):
        if at + 4 > len(view):
            raise ValueError('its last chunk is cut off')
        end = at + 4 + int.from_bytes(view[at : at + 4], 'little')
        if end > len(view):
            raise ValueError(f'its chunk at byte {at} is cut off')
        yield _decompressed(view[at + 4 : end], header.compression, most)
        at = end


def _decompressed(block: memoryview, compression: str, most: int) -> Octets:
    try:
        if compression == 'ZSTD':
            if zstandard.frame_content_size(block) > most:
                raise ValueError('a chunk declares more bytes than its points can have')
            plain: Any = zstandard.ZstdDecompressor().decompress(block, max_output_size=most)
        elif compression == 'LZ4':
            plain = lz4_block.decompress(block, uncompressed_size=most)
        else:
            plain = block
    except (zstandard.ZstdError, lz4_block.LZ4BlockError) as error:
        raise ValueError(f'a chunk cannot be decompressed ({error})') from error
    return np.frombuffer(plain, np.uint8)


def _decode_block(block: Octets, header: PackedHeader, points: Octets) -> None:
    """Enter the fields of a block into its (N, point_step) points."""
    fields = header.fields
    group = _group_of(header)
    if group == len(fields) and _decode_group(block, header, points):
        return
    sectioned = (
        [field for field in fields if field.is_wide_integer]
        if header.version >= _SECTIONED_VERSION and header.encoding == _LOSSY
        else []
    )
    interleaved = [field for field in fields if field not in sectioned]
    widths = [_width(header, field) for field in interleaved]
    columns, at = read_records(block, 0, widths, len(points))
    for index, (field, starts) in enumerate(zip(interleaved, columns, strict=True)):
        values = _decode_field(block, starts, header, field, is_grouped=index < group)
        _enter(points, field, values)
    for field in sectioned:
        values, at = _decode_section(block, at, field, len(points))
        _enter(points, field, values)
    if at != len(block):
        raise ValueError(f'a chunk has {len(block) - at} bytes more than its points')


def _decode_group(block: Octets, header: PackedHeader, points: Octets) -> bool:
    """Enter fields that are all encoded together, all at once; False if this is not possible.

    Those with NaN, longer integers and damage are left to the decoding field by field.
    """
    shape = len(points), len(header.fields)
    differences = read_short_differences(block, shape[0] * shape[1])
    if differences is None:
        return False
    multiples = np.cumsum(differences.reshape(shape), axis=0, dtype=np.int32)
    for index, field in enumerate(header.fields):
        step = np.float32(field.resolution or 0)
        _enter(points, field, multiples[:, index].astype(np.float32) * step)
    return True


def _enter(points: Octets, field: PackedField, values: npt.NDArray[Any]) -> None:
    size = int(field.kind[2])
    if field.offset % size == points.shape[1] % size == 0:
        points.view(field.kind)[:, field.offset // size] = values
        return
    stored = np.ascontiguousarray(values.astype(field.kind, copy=False))
    points[:, field.offset : field.offset + size] = stored.view(np.uint8).reshape(-1, size)


def _group_of(header: PackedHeader) -> int:
    """Return how many of the first fields are encoded together: 3 or 4 lossy FLOAT32, or none."""
    count = 0
    for field in header.fields:
        if field.kind != '<f4' or not _is_rounded(header, field):
            break
        count += 1
    return count if count in _GROUPS else 0


# Values of fields.


def _width(header: PackedHeader, field: PackedField) -> int:
    if header.encoding == _NONE:
        return int(field.kind[2])
    if field.is_wide_integer or _is_rounded(header, field):
        return VARINT
    if field.kind == '<f8' and field.resolution is None and header.version >= _GORILLA_VERSION:
        return GORILLA
    return int(field.kind[2])


def _decode_field(
    block: Octets, starts: Positions, header: PackedHeader, field: PackedField, *, is_grouped: bool
) -> npt.NDArray[Any]:
    width = _width(header, field)
    if width == GORILLA:
        return np.bitwise_xor.accumulate(read_gorilla(block, starts)).view('<f8')
    if width == VARINT and _is_rounded(header, field):
        return _decode_rounded(block, starts, field, is_grouped=is_grouped)
    if width == VARINT:
        return np.cumsum(undo_zigzag(read_varints(block, starts)))
    is_xored = field.kind[1] == 'f' and (
        header.encoding == _LOSSLESS or (header.encoding == _LOSSY and field.kind == '<f8')
    )
    if not is_xored:
        return read_fixed(block, starts, field.kind)
    bits = read_fixed(block, starts, field.kind.replace('f', 'u'))
    return np.bitwise_xor.accumulate(bits).view(field.kind)


def _decode_rounded(
    block: Octets, starts: Positions, field: PackedField, *, is_grouped: bool
) -> npt.NDArray[Any]:
    """Decode floats that are multiples of their resolution; a NaN counts as 0 for the next."""
    is_nan = block[starts] == 0
    unsigned = read_varints(block, starts)
    unsigned[is_nan] = 1  # no difference
    multiples = np.cumsum(undo_zigzag(unsigned))
    if is_nan.any():
        last_nan = np.maximum.accumulate(np.where(is_nan, np.arange(len(starts)), -1))
        multiples -= np.where(last_nan < 0, 0, multiples[last_nan])
    kind = np.float32 if field.kind == '<f4' else np.float64
    whole = multiples.astype(np.int32) if is_grouped else multiples
    values: npt.NDArray[Any] = whole.astype(kind) * kind(field.resolution)
    values[is_nan] = np.nan
    return values


def _decode_section(
    block: Octets, at: int, field: PackedField, count: int
) -> tuple[npt.NDArray[Any], int]:
    """Decode the section of an integer field; also return where it ends.

    Its first byte is its mode: 0 has differences; 1 a number of values (uint16), these, and as
    few bits a point as their indices need; 2 a number of runs (uint32), and of each its value and
    length; 3 the same of differences.
    """
    mode, at = _head(block, at, 'u1')
    if mode == 0:
        [starts], at = read_records(block, at, [VARINT], count)
        return np.cumsum(undo_zigzag(read_varints(block, starts))), at
    size = int(field.kind[2])
    kind = f'<u{size}'
    if mode == 1:
        return _decode_palette(block, at, kind, count)
    if mode not in {2, 3}:
        raise ValueError(f'a section of field {field.name} has the unknown mode {mode}')
    runs, at = _head(block, at, '<u4')
    if runs > count:
        raise ValueError(f'field {field.name} has {runs} runs in {count} points')
    widths = [size if mode == 2 else VARINT, VARINT]
    [values, lengths], at = read_records(block, at, widths, runs)
    repeats = read_varints(block, lengths)
    if (repeats > count).any() or repeats.sum() != count:
        raise ValueError(f'the runs of field {field.name} do not fill {count} points')
    if mode == 2:
        return np.repeat(read_fixed(block, values, kind), repeats.astype(np.intp)), at
    differences = undo_zigzag(read_varints(block, values))
    return np.cumsum(np.repeat(differences, repeats.astype(np.intp))), at


def _decode_palette(block: Octets, at: int, kind: str, count: int) -> tuple[npt.NDArray[Any], int]:
    number, at = _head(block, at, '<u2')
    values, at = (
        read_fixed(block, at + int(kind[2]) * np.arange(number), kind),
        at + (int(kind[2]) * number),
    )
    bits = (number - 1).bit_length()
    end = at + (bits * count + 7) // 8
    if not number or end > len(block):
        raise too_short(count)
    digits = np.unpackbits(block[at:end], bitorder='little')[: bits * count].reshape(count, bits)
    indices = digits @ (1 << np.arange(bits))
    if (indices >= number).any():
        raise ValueError('an index is beyond the values of its section')
    return values[indices], end


def _head(block: Octets, at: int, kind: str) -> tuple[int, int]:
    """Read one number; also return where it ends."""
    end = at + np.dtype(kind).itemsize
    if end > len(block):
        raise ValueError('a chunk ends within the head of a section')
    return int(block[at:end].view(kind)[0]), end
