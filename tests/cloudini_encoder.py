# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An encoder of Cloudini's clouds, value by value, as its field encoders describe them."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any

import lz4.block
import numpy as np
import zstandard

CHUNK = 32768
TYPES = ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8', 'i8', 'u8')
NAMES = [
    'INT8',
    'UINT8',
    'INT16',
    'UINT16',
    'INT32',
    'UINT32',
    'FLOAT32',
    'FLOAT64',
    'INT64',
    'UINT64',
]
COMPRESS = {
    'NONE': bytes,
    'LZ4': lambda data: lz4.block.compress(data, store_size=False),
    'ZSTD': zstandard.ZstdCompressor().compress,
}


@dataclass
class Encoder:
    """One way to encode: mode is that of all sections; steps are the resolutions by field."""

    version: int = 5
    encoding: str = 'LOSSY'
    compression: str = 'ZSTD'
    mode: int = 0
    binary: bool = False
    steps: dict[str, float] = field(default_factory=dict)

    def encode(self, points: np.ndarray, height: int = 1) -> bytes:
        """(N,) points of a structured type."""
        data = self.header(points, height)
        for first in range(0, len(points), CHUNK):
            block = COMPRESS[self.compression](self.block(points[first : first + CHUNK]))
            data += struct.pack('<I', len(block)) + block
        return data

    def header(self, points: np.ndarray, height: int = 1) -> bytes:
        kind, magic = points.dtype, b'CLOUDINI_V%02d' % self.version
        width, fields = len(points) // height, [*kind.fields.items()]
        if self.binary:
            codes = (
                ['NONE', 'LOSSY', 'LOSSLESS'].index(self.encoding),
                [*COMPRESS].index(self.compression),
            )
            sizes = (width, height, kind.itemsize, *codes, len(fields))
            data = magic + struct.pack('<IIIBBH', *sizes)
            for name, (own, offset) in fields:
                number, step = TYPES.index(own.str[1:]) + 1, self.steps.get(name, -1.0)
                data += struct.pack('<H', len(name)) + name.encode()
                data += struct.pack('<IBf', offset, number, step)
            return data
        lines = [
            *(f'version: {self.version}', f'width: {width}', f'height: {height}'),
            *(f'point_step: {kind.itemsize}', f'encoding_opt: {self.encoding}'),
            *(f'compression_opt: {self.compression}', 'fields:'),
        ]
        for name, (own, offset) in fields:
            lines += [f'  - name: {name}', f'    offset: {offset}']
            lines += [f'    type: {NAMES[TYPES.index(own.str[1:])]}']
            lines += [f'    resolution: {self.steps.get(name, "null")}']
        return magic + b'\n' + '\n'.join(lines).encode() + b'\n\0'

    def block(self, points: np.ndarray) -> bytes:
        columns = {name: self.column(points[name], name) for name in points.dtype.names}
        apart = [name for name in columns if self.is_apart(points.dtype[name])]
        names = [name for name in columns if name not in apart]
        data = b''.join(columns[name][row] for row in range(len(points)) for name in names)
        return data + b''.join(self.section(points[name]) for name in apart)

    def is_apart(self, kind: np.dtype[Any]) -> bool:
        wide = kind.kind in 'iu' and kind.itemsize > 1
        return wide and self.version > 4 and self.encoding == 'LOSSY'

    def column(self, values: np.ndarray, name: str) -> list[bytes]:
        kind, step = values.dtype, self.steps.get(name)
        if self.encoding == 'NONE' or kind.itemsize == 1:
            return [value.tobytes() for value in values]
        if kind.kind in 'iu':
            return [signed(step) for step in differences(values)]
        if self.encoding == 'LOSSY' and step is not None:
            return rounded(values, np.float32(step))
        if kind == 'f8' and step is None and self.version > 3:
            return gorilla(values.view('u8').tolist())
        if kind == 'f4' and self.encoding == 'LOSSY':
            return [value.tobytes() for value in values]
        bits = values.view(f'u{kind.itemsize}')
        return [value.tobytes() for value in bits ^ np.concatenate([bits[:1] * 0, bits[:-1]])]

    def section(self, values: np.ndarray) -> bytes:
        if self.mode == 0:
            return b'\0' + b''.join(map(signed, differences(values)))
        if self.mode == 1:
            palette, indices = np.unique(values, return_inverse=True)
            bits = (len(palette) - 1).bit_length()
            digits = (indices[:, None] >> np.arange(bits)) & 1
            packed = np.packbits(digits.astype(np.uint8).reshape(-1), bitorder='little')
            head = b'\1' + struct.pack('<H', len(palette))
            return head + palette.tobytes() + packed.tobytes()
        items = values.tolist() if self.mode == 2 else differences(values)
        runs = [(key, len([*run])) for key, run in groupby(items)]
        texts = [
            (np.array(key, values.dtype).tobytes() if self.mode == 2 else signed(key))
            + unsigned(length)
            for key, length in runs
        ]
        return bytes([self.mode]) + struct.pack('<I', len(runs)) + b''.join(texts)


def unsigned(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def signed(value: int) -> bytes:
    value = (value + 2**63) % 2**64 - 2**63
    return unsigned(((value << 1) ^ (value >> 63)) % 2**64 + 1)


def differences(values: np.ndarray) -> list[int]:
    return [after - before for before, after in pairwise([0, *values.tolist()])]


def rounded(values: np.ndarray, step: np.float32) -> list[bytes]:
    before, out = 0, []
    for value in values:
        if np.isnan(value):
            before = 0
            out.append(b'\0')
            continue
        multiple = round(float(value) / float(step))
        out.append(signed(multiple - before))
        before = multiple
    return out


def gorilla(words: list[int]) -> list[bytes]:
    out = [words[0].to_bytes(8, 'little')]
    window = None
    for before, word in pairwise(words):
        changed = before ^ word
        leading = min(64 - changed.bit_length(), 31)
        trailing = (changed & -changed).bit_length() - 1
        if not changed:
            value, length = 0, 1
        elif window and leading >= window[0] and trailing >= window[1]:
            count = 64 - sum(window)
            value, length = 0b01 | changed >> window[1] << 2, 2 + count
        else:
            window = leading, trailing
            count = 64 - leading - trailing
            value = 0b11 | leading << 2 | (count - 1) << 7 | changed >> trailing << 13
            length = 13 + count
        out.append(value.to_bytes((length + 7) // 8, 'little'))
    return out
