# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images and their CameraInfo -> points in the optical frame.

16UC1 (or mono16) has millimetres, 32FC1 metres (REP 118); 0, NaN and infinity are no returns. The
depth is z, not the length of the ray. A CompressedImage of the transport compressedDepth begins
with 12 bytes, little-endian: format (int32), depth quantisation A and B (float32). Then follows a
PNG of 16 bits: millimetres, or for 32FC1 the inverse depth, depth = A / (value - B). Source:
image_transport_plugins, compressed_depth_image_transport, codec and compression_common.h.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.picture_headers import PNG_SIGNATURE, png_size
from ..files.png.inflate import inflated
from ..model.samples import MOST_PIXELS
from .camera_info import EQUIDISTANT
from .pixels import stored_values
from .scan_points import ScanPoints, make_points

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from .camera_info import CameraModel

DEPTH_ENCODINGS = frozenset({'16UC1', 'mono16', '32FC1'})
NO_DEPTH = 'depth 0 or not finite'
COMPRESSED_DEPTH = 'compressedDepth'

_HEAD = struct.Struct('<iff')
_MM_PER_M = 1000.0


def is_depth(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether an Image or CompressedImage is of depth: by its encoding (not mono16) or format."""
    if not hasattr(message, 'format'):
        return message.encoding in {'16UC1', '32FC1'}
    return COMPRESSED_DEPTH in message.format


def decode_depth(message: Any) -> Float64Array:  # noqa: ANN401 - of the bag's types
    """Decode to (H, W) metres, NaN without a return.

    Raises:
        ValueError: It is no depth image, is truncated, or too large.
    """
    if hasattr(message, 'format'):
        return _decode_compressed(message)
    if message.encoding not in DEPTH_ENCODINGS:
        known = ', '.join(sorted(DEPTH_ENCODINGS))
        raise ValueError(f'a depth image of encoding {message.encoding!r}; expected {known}')
    values = stored_values(message)
    metres = values.astype(np.float64)
    if values.dtype.kind == 'u':
        metres /= _MM_PER_M
    return _only_returns(metres)


def decode_depth_points(
    message: Any,  # noqa: ANN401 - of the bag's types
    camera: CameraModel,
    *,
    rectified: bool,
) -> ScanPoints:
    """Decode to points in the optical frame (x right, y down, z forward), reflectance 0.

    Args:
        message: An Image or CompressedImage of the bag's own types.
        camera: Its CameraInfo.
        rectified: Whether R and P are those of its pixels, or K and D.

    Raises:
        ValueError: As decode_depth; its size is not that of its CameraInfo.
    """
    depth = decode_depth(message)
    height, width = depth.shape
    if (width, height) != camera.size:
        raise ValueError(
            f'a depth image of {width}x{height}; its CameraInfo is of'
            f' {camera.size[0]}x{camera.size[1]}'
        )
    rows, columns = np.nonzero(np.isfinite(depth))
    pixels = np.column_stack([columns, rows]).astype(np.float64)
    rays = np.column_stack([_rays(pixels, camera, rectified=rectified), np.ones(len(pixels))])
    xyz = rays * depth[rows, columns, None]
    if rectified:
        xyz = xyz @ camera.r
    return ScanPoints(make_points(xyz, np.zeros(len(xyz))), {NO_DEPTH: depth.size - len(xyz)})


def _rays(pixels: Float64Array, camera: CameraModel, *, rectified: bool) -> Float64Array:
    """Return (N, 2) x / z and y / z of (N, 2) pixels."""
    if rectified or not camera.d.any() or not len(pixels):
        k = camera.p[:, :3] if rectified else camera.k
        return np.asarray(np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(k).T)[
            :, :2
        ]
    import cv2  # noqa: PLC0415 - 0.2 s that most depth images do not need

    undistort = (cv2.fisheye if camera.model == EQUIDISTANT else cv2).undistortPoints
    try:
        return np.asarray(undistort(pixels[:, None], camera.k, camera.d)[:, 0], np.float64)
    except cv2.error:
        raise ValueError(f'a lens of {len(camera.d)} numbers that {camera.model} has not') from None


def _decode_compressed(message: Any) -> Float64Array:  # noqa: ANN401 - of the bag's types
    import cv2  # noqa: PLC0415 - as above

    data = message.data.tobytes()
    if not data[_HEAD.size :].startswith(PNG_SIGNATURE):
        raise ValueError(
            f'a compressed depth image without a PNG (format {message.format!r}); only those'
            f' compressed as PNG can be read'
        )
    width, height = png_size(data[_HEAD.size :])
    if width * height > MOST_PIXELS:
        raise ValueError(f'a depth image of {width} x {height} pixels')
    file = np.frombuffer(inflated(data[_HEAD.size :]), dtype=np.uint8)
    try:
        values = cv2.imdecode(file, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        values = None
    if values is None or values.dtype != np.uint16 or values.ndim != 2:
        raise ValueError('a compressed depth image whose PNG is damaged or not of 16 bits grey')
    if not message.format.startswith('32FC1'):
        return _only_returns(values.astype(np.float64) / _MM_PER_M)
    _, a, b = _HEAD.unpack_from(data)
    with np.errstate(divide='ignore', invalid='ignore'):
        metres = a / (values.astype(np.float64) - b)
    metres[values == 0] = np.nan
    return _only_returns(metres)


def _only_returns(metres: Float64Array) -> Float64Array:
    metres[~(np.isfinite(metres) & (metres > 0))] = np.nan
    return metres
