# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 -> KITTI's scans, in the frame of the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.clouds import decode_cloud
from ..messages.header import stamp_ns_of
from ..model.geometry import Transform
from ..model.samples import Scan
from .frames import topic_of
from .frames_at import FramesAt, MovingBase

if TYPE_CHECKING:
    from ..rig.moving_tree import MovingTree
    from ..rig.tf_tree import FrameTree
    from .plan import ScanPlan
    from .survey import Survey


class ScanConversion:
    """Converts the messages of a plan's scans; thread-safe."""

    def __init__(
        self,
        plan: ScanPlan | None,
        survey: Survey,
        tree: FrameTree,
        moving: MovingTree | None = None,
    ) -> None:
        """Find the frame of the messages in that of the plan.

        Raises:
            UsageError: The plan names a missing topic.
            MissingDataError: The static transforms do not connect the two frames.
        """
        self._scale = 1.0 if plan is None else plan.intensity_scale
        self._velo_t_cloud: Transform | None = None  # the messages are in KITTI's frame already
        self._base: MovingBase | None = None  # of messages in a frame that the scanner moves in
        if plan is not None:
            own = topic_of(survey, plan.topic).frame
            if own != plan.frame and moving is not None and tree.find(plan.frame, own) is None:
                moving.moving_between(plan.frame, own)
                self._base = MovingBase(plan.frame, Transform.identity(), moving)
            elif own != plan.frame:
                self._velo_t_cloud = tree.transform(plan.frame, own)

    def scan(
        self,
        cloud: Any,  # noqa: ANN401 - of the bag's types
        stamp_ns: int | None = None,
    ) -> tuple[Scan, int]:
        """Convert a PointCloud2 to a scan; also return the number of dropped points.

        Args:
            cloud: The message.
            stamp_ns: Its stamp, at which a frame that moves is placed; None for its header's.

        Raises:
            ValueError: It cannot be read, or its frame is not known at its stamp.
        """
        velo_t_cloud = self._velo_t_cloud
        if self._base is not None:
            frame = cloud.header.frame_id.lstrip('/')
            joined = {self._base.frame: self._base.velo_T_frame}
            at_ns = stamp_ns_of(cloud.header) if stamp_ns is None else stamp_ns
            velo_t_cloud = FramesAt(joined, self._base, at_ns)[frame]
        points, dropped = decode_cloud(cloud, self._scale)
        if velo_t_cloud is not None:
            places = velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([places, points[:, 3]]).astype(np.float32)
        return Scan(points), dropped
