# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds, packets, ranges or depth images -> KITTI's scans, in the frame of the plan."""

from __future__ import annotations

from collections import Counter
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.header import stamp_ns_of
from ..model.losses import Loss
from ..model.samples import Scan
from .frames_at import FramesAt
from .planned_topics import topic_of
from .scan_needs import needs_of_plan, source_of_plan

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Transform
    from ..rig.tf_tree import FrameTree
    from .frames_at import MovingBase
    from .plan import ScanPlan
    from .survey import Survey


class ScanConversion:
    """Converts the messages of a plan's scans; thread-safe."""

    def __init__(
        self,
        plan: ScanPlan | None,
        survey: Survey,
        tree: FrameTree,
        base: MovingBase | None = None,
    ) -> None:
        """Find the frame of the messages in that of the plan, and what their decoder needs.

        Args:
            plan: Names the topic and KITTI's frame; None without scans.
            survey: Of the bag.
            tree: The static transforms.
            base: The links over time, where clouds may be in frames that the vehicle moves in.

        Raises:
            UsageError: The plan names a missing topic, or not what its messages need.
            BadFileError: The calibration file of a unit cannot be read.
            MissingDataError: The static transforms do not connect the two frames.
        """
        self._plan = plan
        self._minimum_m = 0.0 if plan is None else plan.minimum_range_m
        self._too_near = f'nearer than {self._minimum_m:g} m'
        self._velo_t_cloud: Transform | None = None  # the messages are in KITTI's frame already
        self._lost: Counter[str] = Counter()
        self._lock = Lock()
        self._span_ns = (0, 0)  # of a turn, from its stamp
        self._base: MovingBase | None = None  # of messages in a frame that the scanner moves in
        if plan is not None:
            self._source = source_of_plan(plan, survey)
            self._needs = needs_of_plan(plan, self._source, survey)
            topic = topic_of(survey, plan.topic)
            if topic.turn_ns is not None:
                start_ns, end_ns = topic.turn_ns
                self._span_ns = start_ns - topic.middle_ns, end_ns - topic.middle_ns
            own = topic.frame
            if (
                base is not None
                and base.tree is not None
                and own != plan.frame
                and not tree.joins(plan.frame, own)
            ):
                base.tree.moving_between(base.frame, own)
                self._base = base
            elif own != plan.frame:
                self._velo_t_cloud = tree.transform(plan.frame, own)

    @property
    def move(self) -> bool:
        """Whether the messages are in a frame that the vehicle moves in."""
        return self._base is not None

    def scan(
        self,
        message: Any,  # noqa: ANN401 - of the bag's types
        stamp_ns: int | None = None,
    ) -> tuple[Scan, Counter[str]]:
        """Convert a message to a scan; also return the number of dropped points, by reason.

        Args:
            message: Of a type of the plan's source.
            stamp_ns: Its stamp, at which a frame that moves is placed; None for its header's.

        Raises:
            ValueError: It cannot be read, or its frame is not known at its stamp.
        """
        velo_t_cloud = self._velo_t_cloud
        if self._base is not None:
            frame = message.header.frame_id.lstrip('/')
            joined = {self._base.frame: self._base.velo_T_frame}
            at_ns = stamp_ns_of(message.header) if stamp_ns is None else stamp_ns
            velo_t_cloud = FramesAt(joined, self._base, at_ns)[frame]
        found = self._source.decode(message, self._needs)
        if found.lost:
            with self._lock:
                self._lost.update(found.lost)
        points, dropped = found.points, Counter(found.dropped)
        if velo_t_cloud is not None:
            places = velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([places, points[:, 3]]).astype(np.float32)
        if self._minimum_m:
            far = np.linalg.norm(points[:, :3].astype(np.float64), axis=1) >= self._minimum_m
            dropped[self._too_near] = len(points) - int(np.count_nonzero(far))
            points = points[far]
        start_ns, end_ns = self._span_ns
        if stamp_ns is None or start_ns == end_ns:
            return Scan(points), dropped
        return Scan(points, stamp_ns + start_ns, stamp_ns + end_ns), dropped

    @property
    def are_depth(self) -> bool:
        """Whether the scans are made from depth images."""
        return self._plan is not None and self._source.needs_info

    def notes(self) -> list[str]:
        """Return what should be known of the scans."""
        if self._plan is None or not self._source.advice:
            return []
        return [f'{self._plan.topic}: {self._source.advice}']

    def losses(self) -> tuple[Loss, ...]:
        """Return the parts of messages so far that could not be decoded."""
        topic = '' if self._plan is None else self._plan.topic
        return tuple(
            Loss(topic, count, f'{topic}: {reason}') for reason, count in self._lost.items()
        )


def dropped_notes(topic: str, dropped: Mapping[str, int]) -> list[str]:
    """Return a note on the points of all scans that were dropped, by reason."""
    reasons = ', '.join(f'{reason} ({count})' for reason, count in dropped.items() if count)
    total = sum(dropped.values())
    return [f'{topic}: {total} points without a return were dropped: {reasons}'] if total else []
