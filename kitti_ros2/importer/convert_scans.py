# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 -> KITTI's scans, in the frame of the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.clouds import decode_cloud
from ..model.samples import Scan
from .frames import topic_of

if TYPE_CHECKING:
    from ..model.geometry import Transform
    from ..rig.tf_tree import FrameTree
    from .plan import ScanPlan
    from .survey import Survey


class ScanConversion:
    """Converts the messages of a plan's scans; thread-safe."""

    def __init__(self, plan: ScanPlan | None, survey: Survey, tree: FrameTree) -> None:
        """Find the frame of the messages in that of the plan.

        Raises:
            UsageError: The plan names a missing topic.
            MissingDataError: The static transforms do not connect the two frames.
        """
        self._scale = 1.0 if plan is None else plan.intensity_scale
        self._velo_t_cloud: Transform | None = None  # the messages are in KITTI's frame already
        if plan is not None:
            own = topic_of(survey, plan.topic).frame
            if own != plan.frame:
                self._velo_t_cloud = tree.transform(plan.frame, own)

    def scan(self, cloud: Any) -> tuple[Scan, int]:  # noqa: ANN401 - of the bag's types
        """Convert a PointCloud2 to a scan; also return the number of dropped points.

        Raises:
            ValueError: It cannot be read.
        """
        points, dropped = decode_cloud(cloud, self._scale)
        if self._velo_t_cloud is not None:
            places = self._velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([places, points[:, 3]]).astype(np.float32)
        return Scan(points), dropped
