# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of message types that scans are made from: decoder, and what each needs.

A message type is one row. The rows are in the order of preference: a cloud of points has all that
the others have, and is decoded by the sensor's own driver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..model import msgtypes as types
from .clouds import decode_returns, guess_intensity_scale, scale_of_peak
from .depth_images import decode_depth_points, is_depth
from .laser_scan import decode_laser_scan, peak_of_scans
from .livox_points import decode_livox
from .velodyne_packets import decode_packets

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .camera_info import CameraModel
    from .scan_points import ScanPoints
    from .velodyne_models import Lasers, VelodyneModel

_FULL_BYTE = 255.0


@dataclass(frozen=True)
class ScanNeeds:
    """What decoders need besides a message.

    Attributes:
        intensity_scale: Divisor that scales intensities to 0..1.
        camera: Of depth images.
        rectified: Whether depth images are rectified.
        model, lasers: Of packets.
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
        word: Of scan.from in a plan.
        msgtypes: The message types that it decodes.
        decode: Decodes a message.
        suits: Whether a message of these types is of this source, with points.
        scale: Estimates the divisor of intensities from some messages.
        needs_info: Whether it needs a CameraInfo.
        has_model: Whether it needs the model of the scanner, or the calibration of a unit.
        advice: What should be known of such scans, empty for nothing.
    """

    word: str
    msgtypes: frozenset[str]
    decode: Callable[[Any, ScanNeeds], ScanPoints]
    suits: Callable[[Any], bool]
    scale: Callable[[Sequence[Any]], float]
    needs_info: bool = False
    has_model: bool = False
    advice: str = ''


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
        advice='one ring of points in a plane: detectors of cars expect many',
    ),
    ScanSource(
        'depth',
        frozenset({types.IMAGE, types.COMPRESSED}),
        _decode_depth,
        is_depth,
        lambda _messages: 1.0,
        needs_info=True,
        advice='points of a depth image have no reflectance, and the field of view of its camera',
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
