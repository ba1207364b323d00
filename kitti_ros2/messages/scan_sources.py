# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of message types that scans are made from: decoder, and what each needs.

A message type is one row. The rows are in the order of preference: a cloud of points has all that
the others have, and is decoded by the sensor's own driver.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.image_files import PNG_SIGNATURE, inflated, png_size
from ..model import bag_formats as types
from ..model.errors import BadFileError
from ..model.samples import MOST_PIXELS
from .camera_info import EQUIDISTANT
from .clouds import ScanPoints, decode_returns, guess_intensity_scale, make_points, scale_of_peak
from .images import stored_values

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from .camera_info import CameraModel


# sensor_msgs/LaserScan -> points: one ring in the plane z = 0 of its frame.

OUT_OF_RANGE = 'not finite, or not within range_min to range_max'
_MOST_RAYS = 10**6
_MOST_TURNS = 2


def decode_laser_scan(
    message: Any,  # noqa: ANN401 - of the bag's types
    intensity_scale: float = 1.0,
) -> ScanPoints:
    """Decode a scan; ranges outside of range_min to range_max are no returns (LaserScan.msg).

    Without an intensity for each range, reflectance is 0.

    Raises:
        ValueError: Its angles or its number of ranges are invalid.
    """
    if len(message.ranges) > _MOST_RAYS:
        count = len(message.ranges)
        raise ValueError(f'a LaserScan of {count} ranges; expected at most {_MOST_RAYS}')
    ranges = np.asarray(message.ranges, dtype=np.float64)
    start, step = float(message.angle_min), float(message.angle_increment)
    swept_rad = abs(step) * max(len(ranges) - 1, 0)
    if not (np.isfinite(start) and np.isfinite(step)):
        raise ValueError(f'a LaserScan with angle_min {start}, angle_increment {step}')
    if len(ranges) > 1 and not 0 < swept_rad < _MOST_TURNS * 2 * np.pi:
        raise ValueError(
            f'a LaserScan of {len(ranges)} ranges with angle_increment {step}; expected less than'
            f' {_MOST_TURNS} turns, and not 0'
        )
    nearest, farthest = float(message.range_min), float(message.range_max)
    with np.errstate(invalid='ignore'):
        is_return = np.isfinite(ranges) & (ranges > 0) & (ranges >= nearest)
        is_return &= ranges <= farthest
    angles = (start + step * np.arange(len(ranges)))[is_return]
    hits = ranges[is_return]
    xyz = np.column_stack([hits * np.cos(angles), hits * np.sin(angles), np.zeros(len(hits))])
    shine = np.asarray(message.intensities, dtype=np.float64)
    shine = shine[is_return] / intensity_scale if len(shine) == len(ranges) else np.zeros(len(hits))
    return ScanPoints(make_points(xyz, shine), {OUT_OF_RANGE: len(ranges) - len(hits)})


def peak_of_scans(messages: Iterable[Any]) -> float:
    """Return the largest finite intensity of some scans, 0 without one."""
    peaks = [0.0]
    for message in messages:
        values = np.asarray(message.intensities, dtype=np.float64)
        peaks += values[np.isfinite(values)].max(initial=0.0, keepdims=True).tolist()
    return max(peaks)


# CustomMsg of Livox' drivers -> points.
#
# A point has x y z in metres, x forward, y left, z up, and reflectivity 0 to 255; 0 0 0 is no
# return. Sources: livox_ros_driver/msg and livox_ros_driver2/msg, CustomMsg.msg and
# CustomPoint.msg.

NO_RETURN = 'x y z 0 0 0, or not finite'
MISSING = 'points that point_num counts, and that the message does not have'


def decode_livox(
    message: Any,  # noqa: ANN401 - of the bag's types
    intensity_scale: float = 255.0,
) -> ScanPoints:
    """Decode a message; points that it declares and does not have are lost."""
    values = np.array(
        [(point.x, point.y, point.z, point.reflectivity) for point in message.points],
        dtype=np.float64,
    ).reshape(-1, 4)
    xyz = values[:, :3]
    is_return = np.isfinite(xyz).all(axis=1) & xyz.any(axis=1)
    hits = values[is_return]
    points = make_points(hits[:, :3], hits[:, 3] / intensity_scale)
    missing = int(message.point_num) - len(values)
    lost = {MISSING: missing} if missing > 0 else {}
    return ScanPoints(points, {NO_RETURN: len(values) - len(hits)}, lost)


# Depth images and their CameraInfo -> points in the optical frame.
#
# 16UC1 (or mono16) has millimetres, 32FC1 metres (REP 118); 0, NaN and infinity are no returns. The
# depth is z, not the length of the ray. A CompressedImage of the transport compressedDepth begins
# with 12 bytes, little-endian: format (int32), depth quantisation A and B (float32). Then follows a
# PNG of 16 bits: millimetres, or for 32FC1 the inverse depth, depth = A / (value - B). Source:
# image_transport_plugins, compressed_depth_image_transport, codec and compression_common.h.

DEPTH_ENCODINGS = frozenset({'16UC1', 'mono16', '32FC1'})
NO_DEPTH = 'depth 0 or not finite'
COMPRESSED_DEPTH = 'compressedDepth'

_HEAD = struct.Struct('<iff')
_MM_PER_M = 1000.0


def is_depth(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether an image is of depth: by its encoding (not mono16) or format."""
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
        encodings = ', '.join(sorted(DEPTH_ENCODINGS))
        raise ValueError(f'a depth image of encoding {message.encoding!r}; expected {encodings}')
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


# The lasers of Velodyne's scanners: angles, offsets and the times at which they fire.
#
# Sources: the user manuals VLP-16 (63-9243), VLP-32C (63-9325) and HDL-32E (63-9277), compared with
# the calibration files VLP16db.yaml, VeloView-VLP-32C.yaml and 32db.yaml of the ROS driver. A
# HDL-64E has no common table: each scanner is measured, see parse_lasers.

HDL_64E = 'HDL-64E'

_LASER_PARTS = (
    'rot_correction',
    'vert_correction',
    'dist_correction',
    'dist_correction_x',
    'dist_correction_y',
    'vert_offset_correction',
    'horiz_offset_correction',
)
_MOST_LASERS = 128
_LARGEST = 100.0
"""Limit of an entry: radians or metres."""


@dataclass(frozen=True, eq=False)
class Lasers:
    """The calibration of the lasers of a scanner, in the order of their numbers, (L,) each.

    Attributes:
        elevation: Radians, up is positive.
        azimuth: Radians, added to the azimuth of the packet, which is clockwise from above.
        height: Metres, added to z.
        distance: Metres, added to the distance.
        distance_x, distance_y: The same for near targets on either axis of the sensor, used where
            two_point is set.
        two_point: Whether the distance correction is interpolated.
        vertical_offset: Metres, perpendicular to the ray, upwards.
        horizontal_offset: Metres, perpendicular to the ray, to the left.
        resolution_m: The unit of distances; None: that of the model.
    """

    elevation: Float64Array
    azimuth: Float64Array
    height: Float64Array
    distance: Float64Array
    distance_x: Float64Array
    distance_y: Float64Array
    two_point: Float64Array
    vertical_offset: Float64Array
    horizontal_offset: Float64Array
    resolution_m: float | None = None

    def __len__(self) -> int:
        return len(self.elevation)


@dataclass(frozen=True)
class VelodyneModel:
    """A model of scanner.

    Attributes:
        name: As the plan names it.
        product: The last byte of its packets, None where that is something else.
        lasers: Number of them.
        resolution_m: The unit of distances, metres.
        firing_us: From one firing to the next, microseconds; 0: the azimuth is not interpolated.
        at_once: Number of lasers that fire at the same time.
        sequence_us: From the first firing of all lasers to the next first one.
    """

    name: str
    product: int | None
    lasers: int
    resolution_m: float
    firing_us: float = 0.0
    at_once: int = 1
    sequence_us: float = 0.0

    def firing_times(self) -> Float64Array:
        """Return (32,) of the values of a block: microseconds after the time of its azimuth."""
        value = np.arange(32)
        sequence, laser = value // self.lasers, value % self.lasers
        return np.asarray(sequence * self.sequence_us + laser // self.at_once * self.firing_us)

    @property
    def block_us(self) -> float:
        """The time that the 32 values of a block take, microseconds."""
        return self.sequence_us * max(32 // self.lasers, 1)


MODELS = {
    model.name: model
    for model in (
        VelodyneModel('VLP-16', 0x22, 16, 0.002, 2.304, 1, 55.296),
        VelodyneModel('VLP-16-Hi-Res', 0x24, 16, 0.002, 2.304, 1, 55.296),
        VelodyneModel('VLP-32C', 0x28, 32, 0.004, 2.304, 2, 55.296),
        VelodyneModel('HDL-32E', 0x21, 32, 0.002, 1.152, 1, 46.08),
        VelodyneModel(HDL_64E, None, 64, 0.002),
    )
}

_ELEVATION_DEG = {
    'VLP-16': (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15),
    'VLP-16-Hi-Res': (
        *(-10.0, 0.67, -8.67, 2.0, -7.33, 3.33, -6.0, 4.67),
        *(-4.67, 6.0, -3.33, 7.33, -2.0, 8.67, -0.67, 10.0),
    ),
    'VLP-32C': (
        *(-25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843),
        *(-7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4.0),
        *(-4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333, -2.667),
        *(-3.0, 7.0, 4.667, -2.333, -2.0, 15.0, 10.333, -1.333),
    ),
    'HDL-32E': (
        *(-30.67, -9.33, -29.33, -8.0, -28.0, -6.67, -26.67, -5.33),
        *(-25.33, -4.0, -24.0, -2.67, -22.67, -1.33, -21.33, 0.0),
        *(-20.0, 1.33, -18.67, 2.67, -17.33, 4.0, -16.0, 5.33),
        *(-14.67, 6.67, -13.33, 8.0, -12.0, 9.33, -10.67, 10.67),
    ),
}
_AZIMUTH_DEG = {
    'VLP-32C': (
        *(1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4),
        *(1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4),
    )
}
_HEIGHT_MM = {
    'VLP-16': (
        *(11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1),
        *(5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2),
    ),
    'VLP-16-Hi-Res': (
        *(7.4, -0.9, 6.5, -1.8, 5.5, -2.7, 4.6, -3.7),
        *(3.7, -4.6, 2.7, -5.5, 1.8, -6.5, 0.9, -7.4),
    ),
}


@cache
def nominal_lasers(name: str) -> Lasers | None:
    """Return the lasers of a model as its manual has them, None for a HDL-64E."""
    if name not in _ELEVATION_DEG:
        return None
    elevation = np.radians(_ELEVATION_DEG[name])
    none = np.zeros(len(elevation))
    azimuth = np.radians(_AZIMUTH_DEG[name]) if name in _AZIMUTH_DEG else none
    height = np.array(_HEIGHT_MM[name]) / 1e3 if name in _HEIGHT_MM else none
    return Lasers(elevation, azimuth, height, none, none, none, none, none, none)


def parse_lasers(text: str, path: Path) -> Lasers:
    """Parse the calibration of a scanner: the YAML of the ROS driver (velodyne_pointcloud/params).

    It is made from its db.xml by gen_calibration.py of that driver. Radians and metres; of
    each laser the entries laser_id, rot_correction, vert_correction, dist_correction,
    dist_correction_x, dist_correction_y, vert_offset_correction, horiz_offset_correction and
    two_pt_correction_available; missing ones are 0.

    Raises:
        BadFileError: It is not such a file.
    """
    # 15 ms that other sensors do not need
    from ..model.yaml_text import YamlTextError, load_yaml  # noqa: PLC0415

    expected = 'the YAML calibration of a Velodyne unit (velodyne_pointcloud, gen_calibration.py)'
    try:
        values = load_yaml(text)
    except YamlTextError as error:
        raise BadFileError(path, f'no YAML ({error})', expected) from None
    entries = values.get('lasers') if isinstance(values, dict) else None
    if not isinstance(entries, list) or not 0 < len(entries) <= _MOST_LASERS:
        raise BadFileError(path, 'no list of lasers', expected)
    table = np.full((len(entries), len(_LASER_PARTS) + 1), np.nan)
    for index, entry in enumerate(entries):
        number = entry.get('laser_id', index) if isinstance(entry, dict) else None
        if type(number) is not int or not 0 <= number < len(entries):
            raise BadFileError(path, f'entry {index} of lasers has no valid laser_id', expected)
        row = [_number(entry.get(part, 0.0)) for part in _LASER_PARTS]
        table[number] = [*row, bool(entry.get('two_pt_correction_available'))]
    wrong = ~(np.abs(table) <= _LARGEST).all(axis=1)
    if wrong.any():
        raise BadFileError(path, f'laser {int(np.argmax(wrong))} has no valid numbers', expected)
    resolution = _number(values.get('distance_resolution', 0.002))
    if not 0 < resolution < 1:
        raise BadFileError(path, f'distance_resolution: {resolution}', expected)
    rotation, vertical, distance, near_x, near_y, up, left, two_point = table.T
    none = np.zeros(len(entries))
    return Lasers(
        vertical, -rotation, none, distance, near_x, near_y, two_point, up, left, resolution
    )


def _number(value: Any) -> float:  # noqa: ANN401 - of any YAML
    try:
        return float(value) if isinstance(value, int | float) else float('nan')
    except OverflowError:  # of a whole number
        return float('inf')


# velodyne_msgs/VelodyneScan -> points: the packets of HDL-64E, HDL-32E, VLP-16 and VLP-32C.
#
# A packet has 1206 bytes, little-endian: 12 blocks of 100 bytes, 4 bytes of time (microseconds
# after the hour), return mode, product. A block is a flag (FF EE; FF DD for the lower 32 lasers of
# a HDL-64E), the azimuth (0.01 degrees, clockwise from above, 0 is ahead) and 32 times distance (2
# bytes) and reflectivity (1 byte). A distance of 0 is no return. In mode 0x39, dual, two blocks
# have the same azimuth, one return each; a return that both have is taken once.
#
# The azimuth of a value is interpolated to the time of its firing ("precision azimuth" of the
# manuals), not for the HDL-64E, as in the ROS driver. Points are x forward, y left, z up, as the
# driver has them. Sources: the manuals of the models above; 63-HDL64ES3.

_PACKET_BYTES = 1206
_BLOCKS = 12
_VALUES = 32
_UPPER, _LOWER = 0xEEFF, 0xDDFF
_DUAL = 0x39
_TURN = 36000
_LARGEST_GAP = 300
"""Hundredths of a degree between blocks; beyond it a sector is masked, or packets are missing."""

_BLOCK = np.dtype(
    [
        ('flag', '<u2'),
        ('azimuth', '<u2'),
        ('values', [('distance', '<u2'), ('reflectivity', 'u1')], (_VALUES,)),
    ]
)
_PACKET = np.dtype([('blocks', _BLOCK, (_BLOCKS,)), ('time', '<u4'), ('mode', 'u1'), ('id', 'u1')])

_NEAR_X_M, _NEAR_Y_M, _FAR_M = 2.4, 1.93, 25.04
"""Targets at which the distances of a HDL-64E are calibrated (63-HDL64ES3, appendix)."""

NO_DISTANCE = 'distance 0'
BAD_PACKET = 'a packet that is not 1206 bytes of data with valid flags and azimuths'


def find_model(message: Any) -> VelodyneModel:  # noqa: ANN401 - of the bag's types
    """Detect the model of the scanner from its packets.

    Raises:
        ValueError: The packets name no supported model.
    """
    packets, _ = _packets(message)
    if not len(packets):
        raise ValueError('no packet that can be decoded')
    if (packets['blocks']['flag'] == _LOWER).any():
        return MODELS[HDL_64E]
    products = set(packets['id'].tolist())
    models = [model for model in MODELS.values() if model.product in products]
    if len(models) != 1 or len(products) != 1:
        named = ', '.join(f'0x{product:02X}' for product in sorted(products))
        raise ValueError(f'packets of product {named}, which names no supported model')
    return models[0]


def decode_packets(
    message: Any,  # noqa: ANN401 - of the bag's types
    model: VelodyneModel,
    lasers: Lasers,
    intensity_scale: float = 255.0,
) -> ScanPoints:
    """Decode the packets of a turn.

    Args:
        message: A VelodyneScan of the bag's own types.
        model: Model of the scanner.
        lasers: Lasers of the model, or of this scanner.
        intensity_scale: Divisor of the reflectivity.

    Raises:
        ValueError: No packet can be decoded.
    """
    packets, bad = _packets(message)
    if not len(packets):
        if not bad:
            return ScanPoints(np.empty((0, 4), np.float32), {})
        raise ValueError(f'none of {bad} packets can be decoded: expected 1206 bytes of data')
    blocks = packets['blocks']
    distance = blocks['values']['distance'].astype(np.int64)
    is_return = distance > 0
    dual = packets['mode'] == _DUAL
    # The blocks of a HDL-64E alternate between its upper and its lower lasers.
    step = 2 if model.name == HDL_64E else 1
    again = np.zeros_like(is_return)
    again[:, step:] = (
        (distance[:, step:] == distance[:, :-step])
        & (blocks['azimuth'][:, step:] == blocks['azimuth'][:, :-step])[..., None]
        & (blocks['flag'][:, step:] == blocks['flag'][:, :-step])[..., None]
    )
    is_return &= ~(again & dual[:, None, None]) if step == 1 else ~again
    azimuth = np.radians(_azimuths(blocks['azimuth'], dual, model) / 100)
    laser = _lasers_of(blocks['flag'], model)
    resolution = model.resolution_m if lasers.resolution_m is None else lasers.resolution_m
    lasers_hit = laser[is_return]
    metres = np.asarray(distance[is_return] * resolution, np.float64)
    xyz = _cartesian(metres, azimuth[is_return], lasers, lasers_hit)
    reflectivity = blocks['values']['reflectivity'][is_return] / intensity_scale
    lost = {BAD_PACKET: bad} if bad else {}
    return ScanPoints(
        make_points(xyz, reflectivity), {NO_DISTANCE: int((distance == 0).sum())}, lost
    )


def _packets(message: Any) -> tuple[npt.NDArray[np.void], int]:  # noqa: ANN401
    """Return the valid packets, (P,), and the number of the others."""
    datas = [np.asarray(packet.data, dtype=np.uint8).tobytes() for packet in message.packets]
    whole = [data for data in datas if len(data) == _PACKET_BYTES]
    packets: npt.NDArray[np.void] = np.frombuffer(b''.join(whole), _PACKET)
    flags = packets['blocks']['flag']
    valid = ((flags == _UPPER) | (flags == _LOWER)).all(axis=1)
    valid &= (packets['blocks']['azimuth'] < _TURN).all(axis=1)
    return packets[valid], len(datas) - int(valid.sum())


def _lasers_of(flags: npt.NDArray[np.uint16], model: VelodyneModel) -> npt.NDArray[np.intp]:
    """Return (P, 12, 32) the number of the laser of each value."""
    lower = (flags == _LOWER)[..., None] * _VALUES
    return np.asarray((lower + np.arange(_VALUES)) % model.lasers, dtype=np.intp)


def _azimuths(
    azimuths: npt.NDArray[np.uint16], dual: npt.NDArray[np.bool_], model: VelodyneModel
) -> Float64Array:
    """Return (P, 12, 32) the azimuth of each value, hundredths of a degree."""
    starts = azimuths.astype(np.float64)
    if not model.firing_us:
        return np.broadcast_to(starts[..., None], (*starts.shape, _VALUES))
    gaps = np.empty_like(starts)
    for is_dual, step in ((False, 1), (True, 2)):
        rows = starts[dual == is_dual]
        steps = np.empty_like(rows)
        steps[:, :-step] = (rows[:, step:] - rows[:, :-step]) % _TURN
        # The sensor turns evenly: the last block takes the gap of the one before.
        steps[:, -step:] = steps[:, -2 * step : -step]
        gaps[dual == is_dual] = steps
    usual = (gaps > 0) & (gaps <= _LARGEST_GAP)
    gaps[~usual] = np.median(gaps[usual]) if usual.any() else 0.0
    share = model.firing_times() / model.block_us
    return np.asarray(starts[..., None] + gaps[..., None] * share)


def _cartesian(
    distance: Float64Array, azimuth: Float64Array, lasers: Lasers, laser: npt.NDArray[np.intp]
) -> Float64Array:
    """Return (N, 3), metres, x forward, y left, z up.

    The sensor's own axes, which its corrections are given in, are right and forward.
    """
    angle = azimuth + lasers.azimuth[laser]
    sin_turn, cos_turn = np.sin(angle), np.cos(angle)
    sin_up, cos_up = np.sin(lasers.elevation)[laser], np.cos(lasers.elevation)[laser]
    up, left = lasers.vertical_offset[laser], lasers.horizontal_offset[laser]
    measured = distance + lasers.distance[laser]
    flat = measured * cos_up - up * sin_up
    right = flat * sin_turn - left * cos_turn
    ahead = flat * cos_turn + left * sin_turn
    height = measured * sin_up + up * cos_up
    if lasers.two_point.any():
        two_point = lasers.two_point[laser] > 0
        far = lasers.distance[laser]
        for_x = (far - lasers.distance_x[laser]) * ((np.abs(right) - _FAR_M) / (_FAR_M - _NEAR_X_M))
        for_y = (far - lasers.distance_y[laser]) * ((np.abs(ahead) - _FAR_M) / (_FAR_M - _NEAR_Y_M))
        for_x, for_y = np.where(two_point, for_x, 0.0), np.where(two_point, for_y, 0.0)
        right = right + for_x * cos_up * sin_turn
        ahead = ahead + for_y * cos_up * cos_turn
        height = height + for_y * sin_up
    return np.column_stack([ahead, -right, height + lasers.height[laser]])


_FULL_BYTE = 255.0


@dataclass(frozen=True)
class ScanNeeds:
    """The parameters of decoders besides a message.

    Attributes:
        intensity_scale: Divisor that scales intensities to 0..1.
        camera: Camera of depth images.
        rectified: Whether depth images are rectified.
        model, lasers: Scanner of packets.
    """

    intensity_scale: float = 1.0
    camera: CameraModel | None = None
    rectified: bool = False
    model: VelodyneModel | None = None
    lasers: Lasers | None = None


@dataclass(frozen=True)
class ScanSource:
    """A way to make scans.

    Attributes:
        word: Value of scan.from in a plan.
        msgtypes: The message types that it decodes.
        decode: Decodes a message.
        suits: Whether a message of these types is of this source, with points.
        scale: Estimates the divisor of intensities from some messages.
        needs_info: Whether it needs a CameraInfo.
        has_model: Whether it needs the model of the scanner, or its own calibration.
        note: A line for the user of such scans, empty for none.
    """

    word: str
    msgtypes: frozenset[str]
    decode: Callable[[Any, ScanNeeds], ScanPoints]
    suits: Callable[[Any], bool]
    scale: Callable[[Sequence[Any]], float]
    needs_info: bool = False
    has_model: bool = False
    note: str = ''


def _decode_cloud(message: Any, needs: ScanNeeds) -> ScanPoints:  # noqa: ANN401 - as the table
    return decode_returns(message, needs.intensity_scale)


def _decode_livox(message: Any, needs: ScanNeeds) -> ScanPoints:  # noqa: ANN401
    return decode_livox(message, needs.intensity_scale)


def _decode_packets(message: Any, needs: ScanNeeds) -> ScanPoints:  # noqa: ANN401
    if needs.model is None or needs.lasers is None:
        raise ValueError('packets need the model of their scanner')
    return decode_packets(message, needs.model, needs.lasers, needs.intensity_scale)


def _decode_laser_scan(message: Any, needs: ScanNeeds) -> ScanPoints:  # noqa: ANN401
    return decode_laser_scan(message, needs.intensity_scale)


def _decode_depth(message: Any, needs: ScanNeeds) -> ScanPoints:  # noqa: ANN401
    if needs.camera is None:
        raise ValueError('depth images need a CameraInfo')
    return decode_depth_points(message, needs.camera, rectified=needs.rectified)


def _has_points(message: Any) -> bool:  # noqa: ANN401
    return {'x', 'y', 'z'} <= {field.name for field in message.fields}


def _full_byte(_messages: Sequence[Any]) -> float:
    return _FULL_BYTE


def _laser_scale(messages: Sequence[Any]) -> float:
    return scale_of_peak(peak_of_scans(messages), is_float=True)


SCAN_SOURCES = (
    ScanSource(
        'cloud', frozenset({types.CLOUD}), _decode_cloud, _has_points, guess_intensity_scale
    ),
    ScanSource(
        'livox',
        types.LIVOX,
        _decode_livox,
        lambda message: len(message.points) > 0,
        _full_byte,
    ),
    ScanSource(
        'velodyne',
        frozenset({types.VELODYNE}),
        _decode_packets,
        lambda message: len(message.packets) > 0,
        _full_byte,
        has_model=True,
    ),
    ScanSource(
        'laser_scan',
        frozenset({types.LASER_SCAN}),
        _decode_laser_scan,
        lambda message: len(message.ranges) > 0,
        _laser_scale,
        note='one ring of points in a plane: detectors of cars expect many',
    ),
    ScanSource(
        'depth',
        frozenset({types.IMAGE, types.COMPRESSED}),
        _decode_depth,
        is_depth,
        lambda _messages: 1.0,
        needs_info=True,
        note='points of a depth image have no reflectance, and the field of view of its camera',
    ),
)
"""The table, best first."""

SCAN_TYPES = frozenset(
    msgtype for source in SCAN_SOURCES if source.word != 'depth' for msgtype in source.msgtypes
)
"""The types of messages that hold scans alone."""


def source_named(word: str) -> ScanSource | None:
    """Return the source of a word of scan.from, None for an unknown one."""
    return next((source for source in SCAN_SOURCES if source.word == word), None)


def source_of_type(msgtype: str) -> ScanSource | None:
    """Return the source that decodes a message type, None without one."""
    return next((source for source in SCAN_SOURCES if msgtype in source.msgtypes), None)
