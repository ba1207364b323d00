# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""point_cloud_interfaces/CompressedPointCloud2 -> sensor_msgs/PointCloud2.

Sources: https://github.com/ros-perception/point_cloud_transport_plugins, 9f643f5, the publishers of
draco, zlib and zstd, and https://github.com/facontidavide/cloudini, d202e52, cloudini_ros.

- cloudini: see cloudini.py. Its publisher leaves `format` empty.
- zlib: a gzip stream of the data of the PointCloud2; its subscriber detects zlib's own as well.
- zstd: a zstd frame of the data of the PointCloud2.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np
import zstandard

from ..model.bag_formats import CLOUD
from . import cloudini
from .cdr import make_header
from .foxglove import Translation
from .ros_types import PointCloud2, PointField

if TYPE_CHECKING:
    from collections.abc import Callable

    from .foxglove_fields import Fields

_LARGEST_ALWAYS = 2**27
_LARGEST_RATIO = 64
"""Bytes of points: always accepted; for each byte of compressed data. Others would fill memory."""
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
    size = height * max(row_step, width * point_step)
    if size > most:
        raise ValueError(f'its points are {size} bytes, {len(data)} if compressed: too many')
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
    """Return how the compression of a message has changed its points."""
    data = bytes(compressed.data('compressed_data'))
    if not data.startswith(cloudini.MAGIC):
        return []
    by_step: dict[float, list[str]] = {}
    for name, resolution in cloudini.read_header(data).lossy_fields.items():
        by_step.setdefault(resolution, []).append(name)
    steps = '; '.join(f'{" ".join(names)} to {step:.6g}' for step, names in by_step.items())
    return [f'compressed with loss by Cloudini, which rounded {steps}'] if steps else []


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
    'zlib': _decode_zlib,
    'zstd': _decode_zstd,
}
"""By the name of the format."""

COMPRESSED_CLOUD = Translation(CLOUD, decompress_cloud, losses_of_cloud)
