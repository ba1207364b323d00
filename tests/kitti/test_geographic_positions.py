# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Places on earth of local positions: the devkit's projection brings the positions back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.kitti_recording import geographic_positions
from kitti_ros2.model.streams import GeoOrigin

METRES = st.floats(-2e4, 2e4)
POSITIONS = st.lists(st.tuples(METRES, METRES, st.floats(-500, 500)), min_size=1, max_size=5)
ORIGINS = st.builds(GeoOrigin, st.floats(-80, 80), st.floats(-180, 180), st.floats(-100, 4000))


def devkit(places):
    """convertOxtsToPose.m and latlonToMercator.m: metres from the first place."""
    er = 6378137.0
    scale = np.cos(places[0][0] * np.pi / 180)
    metres = [
        (
            scale * lon * np.pi * er / 180,
            scale * er * np.log(np.tan((90 + lat) * np.pi / 360)),
            alt,
        )
        for lat, lon, alt in places
    ]
    return np.array(metres) - metres[0]


@given(POSITIONS, ORIGINS)
def test_distances_come_back(positions, origin):
    values = np.array(positions)
    rows = geographic_positions(values, origin)
    written = [[float(f'{degrees:.14g}') for degrees in row] for row in rows]
    assert np.abs(devkit(written) - (values - values[0])).max() < 1e-5


def test_the_origin_is_where_it_is_given():
    (place,) = geographic_positions(np.zeros((1, 3)), GeoOrigin(49.0, 8.4, 110.0))
    assert place == pytest.approx([49.0, 8.4, 110.0], abs=1e-12)


@pytest.mark.parametrize('text', ['', ' '])
def test_no_text_is_the_default(text):
    assert GeoOrigin.parse(text) == GeoOrigin(0, 0, 0)


@pytest.mark.parametrize('text', ['1', '1,2', 'a,b,c', '90,0,0', '0,181,0', 'inf,0,0', '1,2,3,4'])
def test_what_is_no_place_is_refused(text):
    with pytest.raises(ValueError, match='expected LAT,LON,ALT'):
        GeoOrigin.parse(text)
