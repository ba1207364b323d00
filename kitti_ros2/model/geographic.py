# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A place on earth that local poses are put at."""

from __future__ import annotations

import math
from dataclasses import dataclass

EARTH_RADIUS_M = 6378137.0
"""Of KITTI's sphere: latlonToMercator.m of the raw devkit."""

_MAX_LAT_DEG = 85.0  # Mercator stretches without bound towards the poles
_MAX_LON_DEG = 180.0
_MAX_ALT_M = 1e4
_COUNT = 3


@dataclass(frozen=True)
class GeoOrigin:
    """The place of the origin of local coordinates.

    Attributes:
        lat, lon: Degrees north and east.
        alt: Metres.
    """

    lat: float = 0.0
    lon: float = 0.0
    alt: float = 0.0

    @classmethod
    def parse(cls, text: str) -> GeoOrigin:
        """Parse LAT,LON,ALT; the default for an empty text.

        Raises:
            ValueError: It is not three numbers of a place; the message says what is expected.
        """
        if not text.strip():
            return cls()
        try:
            numbers = [float(word) for word in text.split(',')]
        except ValueError:
            numbers = []
        limits = (_MAX_LAT_DEG, _MAX_LON_DEG, _MAX_ALT_M)
        if len(numbers) != _COUNT or not all(
            math.isfinite(number) and abs(number) <= limit
            for number, limit in zip(numbers, limits, strict=True)
        ):
            raise ValueError(
                f'{text!r}; expected LAT,LON,ALT in degrees and metres, such as 49.0,8.4,110'
                f' (latitude -{_MAX_LAT_DEG:g} to {_MAX_LAT_DEG:g}, longitude -180 to 180)'
            )
        return cls(*numbers)

    def moved(self, east: float, north: float, up: float) -> GeoOrigin:
        """Return the place that lies some metres away, on KITTI's sphere.

        Along the tangent plane: to 5e-5 m up to 10 m away and 70 degrees of latitude.
        """
        radius_m = EARTH_RADIUS_M * math.cos(math.radians(self.lat))
        return GeoOrigin(
            self.lat + math.degrees(north / EARTH_RADIUS_M),
            self.lon + math.degrees(east / radius_m),
            self.alt + up,
        )
