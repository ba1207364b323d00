# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draco's compressed clouds -> attributes of points, by DracoPy.

What the data begin and end with is read here, before the library is given them: the number of
points, the attributes, and how many bits those that are rounded have. Source: version 2.2 of
https://google.github.io/draco/spec, sections 3 to 5 and Metadata, and src/draco/compression of
https://github.com/google/draco (point_cloud, attributes). Numbers are little-endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

MAGIC = b'DRACO'

_HEAD = struct.Struct('<BBBBH')
_VERSION = 2
_CLOUD, _KD_TREE = 0, 1  # encoder type and method
_HAS_METADATA = 0x8000
_QUANTIZED = 2  # sequential attribute decoder type
_POSITION = 0
_XYZ = 3
_KINDS = (None, 'i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'i8', 'u8', 'f4', 'f8', 'u1')
"""By the number of Draco's data type."""
_INEXACT = {'i4', 'i8', 'u8', 'f8'}
"""Types that DracoPy returns as float32."""
_MOST_BITS = 31


@dataclass
class DracoAttribute:
    """An attribute of the points.

    Attributes:
        name: By the metadata, '' without.
        is_position: Whether it is a position.
        kind: Its numpy type, without byte order.
        components: Values a point.
        is_rounded: Whether its values are rounded.
        bits: Of each rounded value, of the range that it has in the cloud; 0 if unknown.
    """

    name: str
    is_position: bool
    kind: str
    components: int
    is_rounded: bool = False
    bits: int = 0

    @property
    def is_inexact(self) -> bool:
        """True if it is read with the precision of float32."""
        return self.kind in _INEXACT


@dataclass(frozen=True)
class DracoHeader:
    """The number of points, their attributes, and whether the encoder put them in its own order."""

    count: int
    attributes: tuple[DracoAttribute, ...]
    is_sorted: bool


def read_draco_header(data: bytes) -> DracoHeader:
    """Read the header of a compressed cloud.

    Raises:
        ValueError: It is damaged, of another version or no cloud.
    """
    if not data.startswith(MAGIC):
        raise ValueError(f'its data begin with {data[: len(MAGIC)]!r}, not {MAGIC.decode()}')
    try:
        return _Cursor(data, len(MAGIC)).header()
    except (IndexError, struct.error) as error:
        raise ValueError('its Draco header is cut off') from error


class _Cursor:
    def __init__(self, data: bytes, at: int) -> None:
        self._data = data
        self._at = at

    def header(self) -> DracoHeader:
        major, minor, encoder, method, flags = _HEAD.unpack_from(self._data, self._at)
        self._at += _HEAD.size
        if major != _VERSION or encoder != _CLOUD:
            what = 'cloud' if encoder == _CLOUD else 'mesh'
            raise ValueError(
                f'its data are a {what} of Draco {major}.{minor}; clouds of 2 are read'
            )
        names: dict[int, str] = {}
        if flags & _HAS_METADATA:
            for _ in range(self._varint()):
                number = self._varint()
                names[number] = self._metadata().get(b'name', b'').decode(errors='replace')
            self._metadata()
        [count] = struct.unpack_from('<i', self._data, self._at)
        self._at += 4
        if self._octet() != 1:
            raise ValueError('its attributes are encoded in several groups')
        attributes = tuple(self._attribute(names) for _ in range(self._varint()))
        for attribute in attributes:
            is_rounded = (
                attribute.kind == 'f4' if method == _KD_TREE else self._octet() == _QUANTIZED
            )
            attribute.is_rounded = is_rounded
        # KD-trees have the least values of signed integers behind these.
        if method != _KD_TREE or all(attribute.kind[0] != 'i' for attribute in attributes):
            _read_bits(self._data, [attribute for attribute in attributes if attribute.is_rounded])
        return DracoHeader(count, attributes, method == _KD_TREE)

    def _attribute(self, names: Mapping[int, str]) -> DracoAttribute:
        semantic, datatype, components, _ = self._take(4)
        name = names.get(self._varint(), '')
        kind = _KINDS[datatype]
        if kind is None:
            raise ValueError('an attribute is of an invalid type')
        return DracoAttribute(name, semantic == _POSITION, kind, components)

    def _metadata(self) -> dict[bytes, bytes]:
        """Read the entries of metadata; those of its parts, which have names, are skipped."""
        entries = self._entries()
        parts = self._varint()
        while parts:
            self._take(self._octet())
            self._entries()
            parts += self._varint() - 1
        return entries

    def _entries(self) -> dict[bytes, bytes]:
        entries = {}
        for _ in range(self._varint()):
            key = self._take(self._octet())
            entries[key] = self._take(self._varint())
        return entries

    def _take(self, count: int) -> bytes:
        taken = self._data[self._at : self._at + count]
        if len(taken) < count:
            raise IndexError
        self._at += count
        return taken

    def _octet(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def _varint(self) -> int:
        value, shift = 0, 0
        while True:
            octet = self._octet()
            value |= (octet & 0x7F) << shift
            shift += 7
            if octet <= 0x7F or shift > _MOST_BITS:
                return value


def _read_bits(data: bytes, rounded: list[DracoAttribute]) -> None:
    """Enter the bits: least values, range (float32) and bits of each end the data."""
    at = len(data)
    for attribute in reversed(rounded):
        bits = data[at - 1]
        at -= 4 * attribute.components + 4 + 1
        attribute.bits = bits if 0 < bits <= _MOST_BITS else 0


def decode_attributes(data: bytes, header: DracoHeader) -> list[npt.NDArray[Any]]:
    """Decode a cloud.

    Args:
        data: The compressed data.
        header: Their header, whose number of points the caller has found acceptable.

    Returns:
        Of each attribute (N, components) values.

    Raises:
        ValueError: The data are damaged, or DracoPy is not installed.
    """
    try:
        import DracoPy  # noqa: PLC0415 - optional
    except ImportError as error:
        raise ValueError(
            "its format draco needs DracoPy; run pip install 'kitti_ros2[clouds]'"
        ) from error
    try:
        decoded_attributes = DracoPy.decode(data).attributes
    except Exception as error:  # of the library's own classes, which derive from it alone
        raise ValueError(f'its data cannot be decoded by Draco ({error})') from error
    columns = []
    for attribute, decoded in zip(header.attributes, decoded_attributes, strict=True):
        values = decoded['data']
        shape = header.count, attribute.components
        if values is None or values.shape != shape:
            raise ValueError(f'Draco decoded no {shape} values of an attribute')
        with np.errstate(invalid='ignore'):
            columns.append(values.astype(f'<{attribute.kind}'))
    return columns
