# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A synthetic recording: a short street, exact to the millimetre, in all layouts.

Points lie on the boxes' surfaces, boxes project onto the pixels that show them, and the GPS/IMU
packets are the derivatives of the path. It is the data of the demo and of tests.
"""

from .drive import FrameStamps, SyntheticDrive, write_synthetic
from .scene import SyntheticOptions

__all__ = ['FrameStamps', 'SyntheticDrive', 'SyntheticOptions', 'write_synthetic']
