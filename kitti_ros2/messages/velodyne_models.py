# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The lasers of Velodyne's scanners: angles, offsets and the moments at which they fire.

Sources: the user manuals VLP-16 (63-9243), VLP-32C (63-9325) and HDL-32E (63-9277), compared with
the calibration files VLP16db.yaml, VeloView-VLP-32C.yaml and 32db.yaml of the ROS driver. A HDL-64E
has no table that holds for all: each unit is measured, see parse_lasers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.errors import BadFileError

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.geometry import Float64Array

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
"""Of an entry: radians or metres."""


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
    """Parse the calibration of a unit: the YAML of the ROS driver (velodyne_pointcloud/params).

    It is made from the unit's db.xml by gen_calibration.py of that driver. Radians and metres; of
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
    for place, entry in enumerate(entries):
        number = entry.get('laser_id', place) if isinstance(entry, dict) else None
        if type(number) is not int or not 0 <= number < len(entries):
            raise BadFileError(path, f'entry {place} of lasers has no valid laser_id', expected)
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
