# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""velodyne_msgs/VelodyneScan -> points: the packets of HDL-64E, HDL-32E, VLP-16 and VLP-32C.

A packet has 1206 bytes, little-endian: 12 blocks of 100 bytes, 4 bytes of time (microseconds after
the hour), return mode, product. A block is a flag (FF EE; FF DD for the lower 32 lasers of a
HDL-64E), the azimuth (0.01 degrees, clockwise from above, 0 is ahead) and 32 times distance
(2 bytes) and reflectivity (1 byte). A distance of 0 is no return. In mode 0x39, dual, two blocks
have the same azimuth, one return each; a return that both have is taken once.

The azimuth of a value is interpolated to the moment of its firing ("precision azimuth" of the
manuals), not for the HDL-64E, as in the ROS driver. Points are x forward, y left, z up, as the
driver has them. Sources: the manuals named in velodyne_models; 63-HDL64ES3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .scan_points import ScanPoints, make_points
from .velodyne_models import HDL_64E, MODELS, VelodyneModel

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from .velodyne_models import Lasers

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
"""Of the targets at which the distances of a HDL-64E are calibrated (63-HDL64ES3, appendix)."""

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
    found = [each for each in MODELS.values() if each.product in products]
    if len(found) != 1 or len(products) != 1:
        named = ', '.join(f'0x{each:02X}' for each in sorted(products))
        raise ValueError(f'packets of product {named}, which names no supported model')
    return found[0]


def decode_packets(
    message: Any,  # noqa: ANN401 - of the bag's types
    model: VelodyneModel,
    lasers: Lasers,
    intensity_scale: float = 255.0,
) -> ScanPoints:
    """Decode the packets of a turn.

    Args:
        message: A VelodyneScan of the bag's own types.
        model: Of the scanner.
        lasers: Of the model, or of the unit.
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
    chosen = laser[is_return]
    metres = np.asarray(distance[is_return] * resolution, np.float64)
    xyz = _cartesian(metres, azimuth[is_return], lasers, chosen)
    reflectivity = blocks['values']['reflectivity'][is_return] / intensity_scale
    lost = {BAD_PACKET: bad} if bad else {}
    return ScanPoints(
        make_points(xyz, reflectivity), {NO_DISTANCE: int((distance == 0).sum())}, lost
    )


def _packets(message: Any) -> tuple[npt.NDArray[np.void], int]:  # noqa: ANN401
    """Return the valid packets, (P,), and the number of the others."""
    datas = [np.asarray(each.data, dtype=np.uint8).tobytes() for each in message.packets]
    whole = [each for each in datas if len(each) == _PACKET_BYTES]
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
        turned = np.empty_like(rows)
        turned[:, :-step] = (rows[:, step:] - rows[:, :-step]) % _TURN
        # The sensor turns evenly: the last block takes the gap of the one before.
        turned[:, -step:] = turned[:, -2 * step : -step]
        gaps[dual == is_dual] = turned
    usual = (gaps > 0) & (gaps <= _LARGEST_GAP)
    gaps[~usual] = np.median(gaps[usual]) if usual.any() else 0.0
    share = model.firing_times() / model.block_us
    return np.asarray(starts[..., None] + gaps[..., None] * share)


def _cartesian(
    distance: Float64Array, azimuth: Float64Array, lasers: Lasers, laser: npt.NDArray[np.intp]
) -> Float64Array:
    """Return (N, 3), metres, x forward, y left, z up.

    The sensor's own axes, which the corrections of a unit are given in, are right and forward.
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
