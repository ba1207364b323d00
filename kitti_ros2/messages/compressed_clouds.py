# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""CompressedPointCloud2 (point_cloud_interfaces), CompressedPointCloud (Foxglove) -> PointCloud2.

Sources: https://github.com/ros-perception/point_cloud_transport_plugins, 9f643f5, the publishers of
draco, zlib and zstd, and https://github.com/facontidavide/cloudini, d202e52, cloudini_ros.

- cloudini: see cloudini.py. Its publisher leaves `format` empty.
- draco: see draco.py. An attribute a field, in their order; other programs write x, y and z as
  one, and the name of others in their metadata.
- zlib: a gzip stream of the data of the PointCloud2; its subscriber detects zlib's own as well.
- zstd: a zstd frame of the data of the PointCloud2.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, Any

import numpy as np
import zstandard

from ..model.bag_formats import CLOUD
from . import cloudini, draco
from .cdr import make_header
from .foxglove import Translation, place_cloud
from .ros_types import PointCloud2, PointField

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from .foxglove_fields import Fields

_LARGEST_ALWAYS = 2**27
_LARGEST_RATIO = 64
"""Bytes of points: always accepted; for each byte of compressed data. Others would fill memory."""
_XYZ = ('x', 'y', 'z')
_ANY_HEADER = 32 + zlib.MAX_WBITS

_MAGICS = {
    b'CLOUDINI_V': 'cloudini',
    b'DRACO': 'draco',
    b'\x28\xb5\x2f\xfd': 'zstd',
    b'\x1f\x8b': 'zlib',
}
"""The first bytes of compressed data of each format."""


def decompress_cloud(compressed: Fields, log_ns: int) -> PointCloud2:
    """Make the PointCloud2 of a CompressedPointCloud2.

    Args:
        compressed: The message.
        log_ns: Its stamp if it has none, nanoseconds.

    Raises:
        ValueError: Its data are damaged, too large, or of a format that is not read.
    """
    width, height = compressed.integer('width'), compressed.integer('height')
    point_step, row_step = compressed.integer('point_step'), compressed.integer('row_step')
    data = bytes(compressed.data('compressed_data'))
    most = max(_LARGEST_ALWAYS, _LARGEST_RATIO * len(data))
    _check_size(height * max(row_step, width * point_step), data)
    points = b'' if not width * height else _decoder_of(compressed, data)(compressed, data, most)
    header = compressed.child('header')
    return PointCloud2(
        header=make_header(header.stamp_ns('stamp', log_ns), header.text('frame_id')),
        height=height,
        width=width,
        fields=[
            PointField(
                field.text('name'),
                field.integer('offset'),
                field.integer('datatype', 0xFF),
                field.integer('count'),
            )
            for field in compressed.children('fields')
        ],
        is_bigendian=bool(compressed.value('is_bigendian')),
        point_step=point_step,
        row_step=row_step,
        data=np.frombuffer(points, np.uint8),
        is_dense=bool(compressed.value('is_dense')),
    )


def losses_of_cloud(compressed: Fields) -> list[str]:
    """Return how the compression of a message, which can be read, has changed its points."""
    data = bytes(compressed.data('compressed_data'))
    find_losses = _LOSSES.get(_format_of(compressed, data))
    if find_losses is None or not compressed.integer('width') * compressed.integer('height'):
        return []
    return find_losses(compressed, data)


def _cloudini_losses(_compressed: Fields, data: bytes) -> list[str]:
    steps = cloudini.read_header(data).lossy_fields
    return _describe('Cloudini', {name: f'{step:.6g}' for name, step in steps.items()})


def _losses_of_fields(compressed: Fields, data: bytes) -> list[str]:
    header = draco.read_draco_header(data)
    return _draco_losses(header, _names_of(compressed, header.attributes))


def _draco_losses(header: draco.DracoHeader, all_names: Sequence[tuple[str, ...]]) -> list[str]:
    """Describe the losses of a cloud; all_names are those of each attribute."""
    steps: dict[str, str] = {}
    inexact: list[str] = []
    for names, attribute in zip(all_names, header.attributes, strict=True):
        if attribute.is_rounded:
            step = f'{attribute.bits} bits' if attribute.bits else 'an unknown number of bits'
            steps |= dict.fromkeys(names, f'{step} of their range')
        inexact += names if attribute.is_inexact else ()
    losses = _describe('Draco', steps, is_sorted=header.is_sorted)
    if inexact:
        losses.append(f'read with the precision of float32 in {" ".join(inexact)}')
    return losses


def _describe(codec: str, steps: Mapping[str, str], *, is_sorted: bool = False) -> list[str]:
    """Describe the loss of fields that are rounded, by name with the step; none without any."""
    if not steps:
        return []
    by_step: dict[str, list[str]] = {}
    for name, step in steps.items():
        by_step.setdefault(step, []).append(name)
    rounded = '; '.join(f'{" ".join(names)} to {step}' for step, names in by_step.items())
    order = ', and put the points in another order' if is_sorted else ''
    return [f'compressed with loss by {codec}, which rounded {rounded}{order}']


def _format_of(compressed: Fields, data: bytes) -> str:
    """Return the format that a message names, or else that its data begin with."""
    begins = next((name for magic, name in _MAGICS.items() if data.startswith(magic)), '')
    return compressed.text('format').strip().lower() or begins


def _decoder_of(compressed: Fields, data: bytes) -> Callable[[Fields, bytes, int], bytes]:
    name = _format_of(compressed, data)
    if name not in _DECODERS:
        named = repr(name) if name else 'not named'
        raise ValueError(f'its format is {named}; {", ".join(_DECODERS)} are read')
    return _DECODERS[name]


def _decode_cloudini(compressed: Fields, data: bytes, _most: int) -> bytes:
    header = cloudini.read_header(data)
    sizes = tuple(map(compressed.integer, ('width', 'height', 'point_step')))
    if sizes != (header.width, header.height, header.point_step):
        own = header.width, header.height, header.point_step
        raise ValueError(f'its width, height and point_step are {sizes}, and {own} in its data')
    fields = [
        (field.text('name'), field.integer('offset'), field.integer('datatype'))
        for field in compressed.children('fields')
    ]
    if fields != [(field.name, field.offset, field.datatype) for field in header.fields]:
        raise ValueError('its fields are others than those of its data')
    return cloudini.decode_points(data, header).tobytes()


def _names_of(
    compressed: Fields, attributes: Sequence[draco.DracoAttribute]
) -> list[tuple[str, ...]]:
    """Return the names of the fields that each attribute has the values of.

    Each is one field, in their order; or the first is x, y and z together.

    Raises:
        ValueError: The fields are more or fewer.
    """
    names = [field.text('name') for field in compressed.children('fields')]
    widths = [1] * len(attributes)
    if attributes and attributes[0].is_position and attributes[0].components == len(_XYZ):
        names = [*_XYZ, *(name for name in names if name not in _XYZ)]
        widths[0] = len(_XYZ)
    if sum(widths) != len(names):
        raise ValueError(f'its fields are {len(names)}, and {sum(widths)} in its data')
    ends = np.cumsum(widths).tolist()
    return [tuple(names[end - width : end]) for end, width in zip(ends, widths, strict=True)]


def _decode_draco(compressed: Fields, data: bytes, _most: int) -> bytes:
    header = draco.read_draco_header(data)
    count = compressed.integer('width') * compressed.integer('height')
    if header.count != count:
        raise ValueError(f'its points are {count}, and {header.count} in its data')
    names = _names_of(compressed, header.attributes)
    offsets = {
        field.text('name'): field.integer('offset') for field in compressed.children('fields')
    }
    points = np.zeros((count, compressed.integer('point_step')), np.uint8)
    for own_names, attribute, values in zip(
        names, header.attributes, draco.decode_attributes(data, header), strict=True
    ):
        if attribute.name in offsets:
            own_names = (attribute.name,)  # noqa: PLW2901 - its own name goes first
        for name, column in zip(own_names, np.hsplit(values, len(own_names)), strict=True):
            _enter(points, name, offsets[name], column)
    return points.tobytes()


def _enter(points: npt.NDArray[np.uint8], name: str, offset: int, values: npt.NDArray[Any]) -> None:
    """Enter (N, ...) values at an offset in (N, point_step) bytes."""
    octets = np.ascontiguousarray(values).view(np.uint8).reshape(len(points), -1)
    end = offset + octets.shape[1]
    if end > points.shape[1]:
        raise ValueError(f'its field {name} ends beyond point_step, {points.shape[1]}')
    points[:, offset:end] = octets


def _decode_zlib(_compressed: Fields, data: bytes, most: int) -> bytes:
    stream = zlib.decompressobj(_ANY_HEADER)
    try:
        plain = stream.decompress(data, most)
    except zlib.error as error:
        raise ValueError(f'its data cannot be decompressed ({error})') from error
    if not stream.eof:
        raise ValueError('its data are cut off, or too large')
    return plain


def _decode_zstd(_compressed: Fields, data: bytes, most: int) -> bytes:
    try:
        if zstandard.frame_content_size(data) > most:
            raise ValueError('its data declare more bytes than can be its points')
        plain: bytes = zstandard.ZstdDecompressor().decompress(data, max_output_size=most)
    except zstandard.ZstdError as error:
        raise ValueError(f'its data cannot be decompressed ({error})') from error
    return plain


_DECODERS: dict[str, Callable[[Fields, bytes, int], bytes]] = {
    'cloudini': _decode_cloudini,
    'draco': _decode_draco,
    'zlib': _decode_zlib,
    'zstd': _decode_zstd,
}
"""By the name of the format."""


# foxglove.CompressedPointCloud -> sensor_msgs/PointCloud2, with the fields that its data name.

_DATATYPES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}


def decompress_packed_cloud(compressed: Fields, log_ns: int) -> PointCloud2:
    """Make the PointCloud2 of a CompressedPointCloud; its pose is applied to the points.

    Its schema names Draco alone; pymcap-cli roscompress writes Cloudini so as well.

    Args:
        compressed: The message.
        log_ns: Its stamp if it has none, nanoseconds.

    Raises:
        ValueError: Its data are damaged, too large, or neither of Draco nor of Cloudini.
    """
    data = bytes(compressed.data('data'))
    if data.startswith(cloudini.MAGIC):
        packed = cloudini.read_header(data)
        if any(field.datatype > max(_DATATYPES.values()) for field in packed.fields):
            raise ValueError('it has a field of 64-bit integers, as no PointField has')
        own = [PointField(field.name, field.offset, field.datatype, 1) for field in packed.fields]
        _check_size(packed.width * packed.height * packed.point_step, data)
        octets = cloudini.decode_points(data, packed).tobytes()
        return place_cloud(compressed, log_ns, own, packed.point_step, octets)
    header = draco.read_draco_header(data)
    fields: list[PointField] = []
    offset = 0
    for names, attribute in zip(_own_names(header), header.attributes, strict=True):
        if attribute.kind not in _DATATYPES:
            raise ValueError(f'its field {names[0]} has 64-bit integers, as no PointField has')
        for name in names:
            count = attribute.components // len(names)
            fields.append(PointField(name, offset, _DATATYPES[attribute.kind], count))
            offset += int(attribute.kind[1]) * count
    _check_size(header.count * offset, data)
    columns = draco.decode_attributes(data, header)
    parts = [np.ascontiguousarray(column).view(np.uint8) for column in columns]
    points = np.hstack(parts) if parts else np.empty((0, 0), np.uint8)
    return place_cloud(compressed, log_ns, fields, offset, points.tobytes())


def _own_names(header: draco.DracoHeader) -> list[tuple[str, ...]]:
    """Return the names of the fields of each attribute: its own, x y z for a position."""
    return [
        _XYZ
        if attribute.is_position and attribute.components == len(_XYZ)
        else (attribute.name or f'attribute_{number}',)
        for number, attribute in enumerate(header.attributes)
    ]


def _losses_of_packed_cloud(compressed: Fields) -> list[str]:
    data = bytes(compressed.data('data'))
    if data.startswith(cloudini.MAGIC):
        return _cloudini_losses(compressed, data)
    header = draco.read_draco_header(data)
    return _draco_losses(header, _own_names(header))


def _check_size(size: int, data: bytes) -> None:
    """Check the bytes of points that data are to become.

    Raises:
        ValueError: They are too many.
    """
    if size > max(_LARGEST_ALWAYS, _LARGEST_RATIO * len(data)):
        raise ValueError(f'its points are {size} bytes, {len(data)} if compressed: too many')


_LOSSES = {'cloudini': _cloudini_losses, 'draco': _losses_of_fields}

OF_CLOUDS = {
    'CompressedPointCloud': Translation(CLOUD, decompress_packed_cloud, _losses_of_packed_cloud),
    'CompressedPointCloud2': Translation(CLOUD, decompress_cloud, losses_of_cloud),
}
