# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions

SMALL = SyntheticOptions(frames=6, seed=2, image_size=(414, 125), lidar_columns=400)


@pytest.fixture(scope='package')
def drive() -> SyntheticDrive:
    """A small drive that the tests of this folder share."""
    return SyntheticDrive(SMALL)
