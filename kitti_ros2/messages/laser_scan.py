# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/LaserScan -> points: one ring in the plane z = 0 of its frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .scan_points import ScanPoints, make_points

if TYPE_CHECKING:
    from collections.abc import Iterable

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
    turned = abs(step) * max(len(ranges) - 1, 0)
    if not (np.isfinite(start) and np.isfinite(step)):
        raise ValueError(f'a LaserScan with angle_min {start}, angle_increment {step}')
    if len(ranges) > 1 and not 0 < turned < _MOST_TURNS * 2 * np.pi:
        raise ValueError(
            f'a LaserScan of {len(ranges)} ranges with angle_increment {step}; expected less than'
            f' {_MOST_TURNS} turns, and not 0'
        )
    nearest, farthest = float(message.range_min), float(message.range_max)
    with np.errstate(invalid='ignore'):
        is_return = np.isfinite(ranges) & (ranges > 0) & (ranges >= nearest)
        is_return &= ranges <= farthest
    angles = (start + step * np.arange(len(ranges)))[is_return]
    kept = ranges[is_return]
    xyz = np.column_stack([kept * np.cos(angles), kept * np.sin(angles), np.zeros(len(kept))])
    shine = np.asarray(message.intensities, dtype=np.float64)
    shine = shine[is_return] / intensity_scale if len(shine) == len(ranges) else np.zeros(len(kept))
    return ScanPoints(make_points(xyz, shine), {OUT_OF_RANGE: len(ranges) - len(kept)})


def peak_of_scans(messages: Iterable[Any]) -> float:
    """Return the largest finite intensity of some scans, 0 without one."""
    peaks = [0.0]
    for message in messages:
        values = np.asarray(message.intensities, dtype=np.float64)
        peaks += values[np.isfinite(values)].max(initial=0.0, keepdims=True).tolist()
    return max(peaks)
