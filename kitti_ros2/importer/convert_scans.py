# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 -> KITTI's scans, in the frame of the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.clouds import decode_returns
from ..model.samples import Scan
from .frames import topic_of

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Mapping

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
        self._minimum_m = 0.0 if plan is None else plan.minimum_range_m
        self._too_near = f'nearer than {self._minimum_m:g} m'
        self._scale = 1.0 if plan is None else plan.intensity_scale
        self._velo_t_cloud: Transform | None = None  # the messages are in KITTI's frame already
        if plan is not None:
            own = topic_of(survey, plan.topic).frame
            if own != plan.frame:
                self._velo_t_cloud = tree.transform(plan.frame, own)

    def scan(self, cloud: Any) -> tuple[Scan, Counter[str]]:  # noqa: ANN401 - of the bag's types
        """Convert a PointCloud2 to a scan; also return the number of dropped points, by reason.

        Raises:
            ValueError: It cannot be read.
        """
        points, dropped = decode_returns(cloud, self._scale)
        if self._velo_t_cloud is not None:
            places = self._velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([places, points[:, 3]]).astype(np.float32)
        if self._minimum_m:
            far = np.linalg.norm(points[:, :3].astype(np.float64), axis=1) >= self._minimum_m
            dropped[self._too_near] = len(points) - int(np.count_nonzero(far))
            points = points[far]
        return Scan(points), dropped


def dropped_notes(topic: str, dropped: Mapping[str, int]) -> list[str]:
    """Return a note on the points of all scans that were dropped, by reason."""
    reasons = ', '.join(f'{reason} ({count})' for reason, count in dropped.items() if count)
    total = sum(dropped.values())
    return [f'{topic}: {total} points without a return were dropped: {reasons}'] if total else []
