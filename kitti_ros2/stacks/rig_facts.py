# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What parameter files need to know of a drive: transforms, cameras, rates, the scanner."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Transform


@dataclass(frozen=True)
class CameraFacts:
    """A rectified camera.

    Attributes:
        fx, fy, cx, cy: Pixels.
        baseline: Metres between it and the camera left of it; 0 for a left camera.
        width, height: Pixels; 0 if there is no image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    width: int
    height: int


@dataclass(frozen=True)
class RigFacts:
    """The rig of a drive, in the convention of the package: a_T_b maps points of b to a.

    Attributes:
        base_T_imu: imu_link in base_link.
        imu_T_velo: velo_link in imu_link.
        cameras: By KITTI's index.
        imu_hz: Rate of the Imu.
        scan_hz: Rate of the scans.
        rings: Lasers of the scanner.
        lowest_deg, highest_deg: Elevations of the lasers, or of points beyond them.
        columns: Firings of a laser in a turn.
        most_range: Range of the scanner, metres.
        deskew: Whether points have times; scans of odometry sequences are compensated.
    """

    base_T_imu: Transform
    imu_T_velo: Transform
    cameras: Mapping[int, CameraFacts] = field(default_factory=dict)
    imu_hz: float = 10.0
    scan_hz: float = 10.0
    rings: int = 64
    lowest_deg: float = -24.8
    highest_deg: float = 2.0
    columns: int = 2083
    most_range: float = 120.0
    deskew: bool = True

    @property
    def velo_T_imu(self) -> Transform:
        """imu_link in velo_link."""
        return self.imu_T_velo.inverse()

    @property
    def base_T_velo(self) -> Transform:
        """velo_link in base_link."""
        return self.base_T_imu @ self.imu_T_velo
