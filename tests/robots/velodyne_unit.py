# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot with a Velodyne scanner whose driver recorded packets; and the packets of each model.

An encoder: from the points of the world to the bytes of the packets, as the manuals lay them out.
Each ray starts at its laser, at the azimuth of the moment of its firing, at an even turn rate.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import robot_bags as bags

if TYPE_CHECKING:
    from pathlib import Path

START_NS = 1_650_000_000_000_000_000
FRAMES = 4
TURN_S = 0.1
PUCK = np.array([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15.0])
PUCK_HEIGHT_MM = np.array(
    [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1, 5.1, -6.6, 3.7, -8.1, 2.2, -9.7, 0.7, -11.2]
)
HDL_32 = np.round(np.ravel(np.column_stack([np.arange(16) - 23, np.arange(16) - 7]) * 4 / 3), 2)
ULTRA = np.array([
    -25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843,
    -7.254, 0.333, -0.333, -6.148, -5.333, 1.333, 0.667, -4,
    -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667,
    -3, 7, 4.667, -2.333, -2, 15, 10.333, -1.333,
])  # fmt: skip
ULTRA_COLUMN = np.array([
    1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4,
    1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
    1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4,
    1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4,
])  # fmt: skip


@dataclass
class Unit:
    """A scanner: elevation and azimuth offset (degrees), times of firing (us), bytes of packets."""

    product: int
    elevation: np.ndarray
    column: np.ndarray
    height: np.ndarray
    firing_us: np.ndarray
    sequence_us: float
    unit_m: float
    per_block: int = 1
    file: dict = field(default_factory=dict)

    @property
    def lasers(self):
        return len(self.elevation)


UNITS = {
    'VLP-16': Unit(
        *(0x22, PUCK, np.zeros(16), PUCK_HEIGHT_MM / 1000, np.arange(16) * 2.304),
        *(55.296, 0.002, 2),
    ),
    'HDL-32E': Unit(0x21, HDL_32, np.zeros(32), np.zeros(32), np.arange(32) * 1.152, 46.08, 0.002),
    'VLP-32C': Unit(
        *(0x28, ULTRA, ULTRA_COLUMN, np.zeros(32), np.repeat(np.arange(16), 2) * 2.304),
        *(55.296, 0.004),
    ),
}


def wall_distance(azimuth, elevation):
    """Metres along a ray to a smooth wall all around; 0, no return, in one sector."""
    found = 9 + 3 * np.sin(2 * azimuth) + 4 * np.cos(elevation * 3)
    return np.where((azimuth % (2 * np.pi) > 1.0) & (azimuth % (2 * np.pi) < 1.2), 0.0, found)


def encode(unit: Unit, *, second: bool = False, sequences: int = 1440, first_azimuth=0.0):
    """(packets, points): bytes of 1206, and the (N, 4) points they stand for.

    Azimuths count clockwise from ahead. second: dual return, with another return for some rays.
    """
    rate = 2 * np.pi / (TURN_S * 1e6)
    blocks, points = [], []
    for number in range(0, sequences, unit.per_block):
        starts = [(number + k) * unit.sequence_us for k in range(unit.per_block)]
        head = np.round(np.degrees(first_azimuth + rate * starts[0]) * 100)
        both = ([], [])
        for start in starts:
            # The encoder of the motor is read at the head; the rest is even turning.
            azimuth = np.radians(head / 100) + rate * (start - starts[0] + unit.firing_us)
            azimuth = azimuth + np.radians(unit.column)
            elevation = np.radians(unit.elevation)
            last = np.round(wall_distance(azimuth, elevation) / unit.unit_m).astype(int)
            extra = np.where(np.arange(unit.lasers) % 3 == 0, last * 3 // 4, last)
            shine = np.arange(unit.lasers) * 7 % 256
            for counts, into in ((last, both[0]), (extra, both[1])):
                into += list(zip(counts, shine, strict=True))
            for counts in (last, extra) if second else (last,):
                new = counts > 0 if counts is last else (counts > 0) & (counts != last)
                metres = (counts * unit.unit_m)[new]
                flat = metres * np.cos(elevation[new])
                points.append(
                    np.column_stack(
                        [
                            flat * np.cos(azimuth[new]),
                            -flat * np.sin(azimuth[new]),
                            metres * np.sin(elevation[new]) + unit.height[new],
                            shine[new] / 255,
                        ]
                    )
                )
        shown = both if second else both[:1]
        blocks += [(0xEEFF, int(head) % 36000, values) for values in shown]
    return packed(blocks, 0x39 if second else 0x37, unit.product), np.vstack(points)


def packed(blocks, mode, product):
    """Packets of 12 blocks (flag, azimuth, 32 times distance and reflectivity), little-endian."""
    packets = []
    for first in range(0, len(blocks) - len(blocks) % 12, 12):
        data = b''
        for flag, azimuth, values in blocks[first : first + 12]:
            data += flag.to_bytes(2, 'little') + azimuth.to_bytes(2, 'little')
            for distance, shine in values:
                data += int(distance).to_bytes(2, 'little') + bytes([int(shine)])
        packets.append(data + (123456).to_bytes(4, 'little') + bytes([mode, product]))
    assert all(len(packet) == 1206 for packet in packets)
    return packets


def hdl_64_file(rng):
    """The calibration of a unit as the driver's YAML has it: a list of 64 lasers."""
    lasers = []
    for number in range(64):
        upper = number < 32
        near = 1.3 + rng.uniform(-0.1, 0.1)
        lasers.append(
            {
                'laser_id': number,
                'rot_correction': float(rng.uniform(-0.1, 0.1)),
                'vert_correction': float(np.radians(2 - number / 3 if upper else 0 - number / 2.7)),
                'dist_correction': float(near),
                'dist_correction_x': float(near + rng.uniform(-0.04, 0.04)),
                'dist_correction_y': float(near + rng.uniform(-0.04, 0.04)),
                'two_pt_correction_available': True,
                'vert_offset_correction': 0.21 if upper else 0.15,
                'horiz_offset_correction': 0.026 if number % 2 else -0.026,
                'focal_distance': 10.0,
                'focal_slope': 1.0,
            }
        )
    return {'lasers': lasers, 'num_lasers': 64, 'distance_resolution': 0.002}


def encode_hdl_64(file, firings=600, *, twice=False):
    """(packets, points) of a HDL-64E, by the formulas of its manual, one value after the other.

    twice: dual return where both returns are the same.
    """
    blocks, points = [], []
    for number in range(firings):
        azimuth = number * 36000 // firings
        for flag, first in ((0xEEFF, 0), (0xDDFF, 32)):
            values = []
            for laser in file['lasers'][first : first + 32]:
                raw = 0 if number % 50 == 0 else 4000 + number + 10 * (laser['laser_id'] % 7)
                values.append((raw, laser['laser_id']))
                if raw:
                    points.append([*_hdl_64_point(raw, azimuth, laser), laser['laser_id'] / 255])
            blocks.append((flag, azimuth, values))
        blocks += blocks[-2:] if twice else []
    return packed(blocks, 0x41, 0x22), np.array(points)


def _hdl_64_point(raw, azimuth, laser):
    """Manual 63-HDL64ES3, appendix: x to the right, y ahead; then ROS axes."""
    far_m, near_x_m, near_y_m = 25.04, 2.4, 1.93
    turn = np.radians(azimuth / 100) - laser['rot_correction']
    tilt, up = laser['vert_correction'], laser['vert_offset_correction']
    aside, far = laser['horiz_offset_correction'], laser['dist_correction']
    metres = raw * 0.002 + far
    flat = metres * np.cos(tilt) - up * np.sin(tilt)
    guess_x = abs(flat * np.sin(turn) - aside * np.cos(turn))
    guess_y = abs(flat * np.cos(turn) + aside * np.sin(turn))
    near_x, near_y = laser['dist_correction_x'], laser['dist_correction_y']
    fix_x = near_x + (far - near_x) * (guess_x - near_x_m) / (far_m - near_x_m)
    fix_y = near_y + (far - near_y) * (guess_y - near_y_m) / (far_m - near_y_m)
    metres_x, metres_y = raw * 0.002 + fix_x, raw * 0.002 + fix_y
    flat_x = metres_x * np.cos(tilt) - up * np.sin(tilt)
    flat_y = metres_y * np.cos(tilt) - up * np.sin(tilt)
    x = flat_x * np.sin(turn) - aside * np.cos(turn)
    y = flat_y * np.cos(turn) + aside * np.sin(turn)
    return y, -x, metres_y * np.sin(tilt) + up * np.cos(tilt)


def scan_message(packets, stamp_ns, packets_ns=None):
    """A velodyne_msgs/VelodyneScan of packets, which have its stamp or their own."""
    stamps = packets_ns or [stamp_ns] * len(packets)
    return {
        'header': bags.header(stamp_ns, 'velodyne'),
        'packets': [
            {'stamp': bags.header(stamp, '')['stamp'], 'data': np.frombuffer(packet, np.uint8)}
            for packet, stamp in zip(packets, stamps, strict=True)
        ],
    }


def write(path: Path, packets, container='mcap', **kwargs) -> Path:
    """A bag of the same turn a few times, with a camera for a calibration."""
    said = [
        bags.Said(
            '/velodyne_packets',
            START_NS + 100_000_000 * frame,
            'velodyne_msgs/msg/VelodyneScan',
            scan_message(packets, START_NS + 100_000_000 * frame),
        )
        for frame in range(FRAMES)
    ]
    return bags.write(path, said, container, **kwargs)
