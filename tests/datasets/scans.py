# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that are cut, and the files of a data set."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.options.datasets import make_crop_options


def files(root):
    """The bytes of all files below a folder, by path."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in root.rglob('*')
        if path.is_file()
    }


def whole_scan(lasers=64, columns=40):
    """A scan in the scanner's order: lasers top to bottom, each counter-clockwise from ahead."""
    elevation = np.radians(np.linspace(2.0, -24.8, lasers))[:, None]
    azimuth = (np.arange(columns) + 0.5) * 2 * np.pi / columns
    azimuth = np.where(azimuth > np.pi, azimuth - 2 * np.pi, azimuth)[None]
    flat = 20 * np.cos(elevation)
    x, y = flat * np.cos(azimuth), flat * np.sin(azimuth)
    z = np.broadcast_to(20 * np.sin(elevation), x.shape)
    reflectance = np.broadcast_to(np.arange(lasers)[:, None] / lasers, x.shape)
    return np.stack([x, y, z, reflectance], axis=-1).reshape(-1, 4).astype(np.float32)


coordinates = st.one_of(
    st.floats(-100, 100, width=32),
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -0.0, 3e38]),
)
clouds = arrays.arrays(np.float32, st.tuples(st.integers(0, 30), st.just(4)), elements=coordinates)
spans = st.tuples(st.floats(-50, 49), st.floats(0.1, 90)).map(
    lambda pair: (pair[0], pair[0] + pair[1])
)
boxes = st.lists(
    st.tuples(spans, spans, spans).map(lambda axes: [*(a[0] for a in axes), *(a[1] for a in axes)]),
    min_size=1,
    max_size=3,
)
filters = st.fixed_dictionaries(
    {},
    optional={
        'box': boxes,
        'range': spans.map(lambda span: (max(0.0, span[0]), max(0.0, span[0]) + 40)),
        'height': spans,
        'voxel': st.floats(0.01, 30),
    },
).map(make_crop_options)
"""All filters of a point or a voxel, without those that need a whole scan or a camera."""
