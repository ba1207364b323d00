# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds, packets, ranges or depth images -> KITTI's scans, in the frame of the plan."""

from __future__ import annotations

from collections import Counter
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.semantic import SEMANTIC_NAMES
from ..messages.clouds import label_fields, unit_doubt
from ..messages.header import stamp_ns_of
from ..model.losses import Loss
from ..model.msgtypes import CLOUD
from ..model.samples import Scan
from ..model.text import some_of
from .frames_at import BoxTimes, FramesAt
from .guess_names import is_fixed
from .planned_topics import topic_of
from .scan_needs import needs_of_plan, source_of_plan

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from ..model.geometry import Transform
    from ..model.samples import Int64Array
    from ..rig.tf_tree import FrameTree
    from .frames_at import MovingBase
    from .plan import ScanPlan
    from .survey import Survey
    from .topic_survey import TopicSurvey

_SHOWN = 8


class ScanConversion:
    """Converts the messages of a plan's scans; thread-safe."""

    def __init__(
        self,
        plan: ScanPlan | None,
        survey: Survey,
        tree: FrameTree,
        base: MovingBase | None = None,
        *,
        point_labels: bool = False,
    ) -> None:
        """Find the frame of the messages in that of the plan, and what their decoder needs.

        Args:
            plan: Names the topic and KITTI's frame; None without scans.
            survey: Of the bag.
            tree: The static transforms.
            base: The links over time, where clouds may be in frames that the vehicle moves in.
            point_labels: Whether the layout has files for labels of points.

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
        self._point_labels = point_labels
        self._unplaced = 0  # scans whose labels have no file
        self._unlabelled = 0  # scans without labels
        self._classes = np.zeros(1 << 16, np.bool_)  # of points, those seen
        self._notes: list[str] = []
        self._turns: Int64Array | None = None  # (N, 2) of each message, from its stamp
        self._base: MovingBase | None = None  # of messages in a frame that the scanner moves in
        if plan is not None:
            self._source = source_of_plan(plan, survey)
            self._needs = needs_of_plan(plan, self._source, survey)
            topic = topic_of(survey, plan.topic)
            self._notes = cloud_notes(plan, topic, point_labels=point_labels)
            turns = topic.turns_ns()
            self._turns = None if turns is None else turns - topic.moved_ns()[:, None]
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
        place: int | None = None,
    ) -> tuple[Scan, Counter[str]]:
        """Convert a message to a scan; also return the number of dropped points, by reason.

        Args:
            message: Of a type of the plan's source.
            stamp_ns: Its stamp, at which a frame that moves is placed; None for its header's.
            place: Its place in its topic, by which its turn is known; None for a scan without.

        Raises:
            ValueError: It cannot be read, or its frame is not known at its stamp.
        """
        velo_t_cloud = self._velo_t_cloud
        if self._base is not None:
            frame = message.header.frame_id.lstrip('/')
            joined = {self._base.frame: self._base.velo_T_frame}
            at_ns = stamp_ns_of(message.header) if stamp_ns is None else stamp_ns
            velo_t_cloud = FramesAt(joined, self._base, BoxTimes(at_ns))[frame]
        found = self._source.decode(message, self._needs)
        if found.lost:
            with self._lock:
                self._lost.update(found.lost)
        points, dropped = found.points, Counter(found.dropped)
        labels = self._labels(found.labels, len(points))
        if self._plan is not None and self._plan.unit_m != 1:
            points = points * np.array([*[self._plan.unit_m] * 3, 1], np.float32)
        if velo_t_cloud is not None:
            places = velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([places, points[:, 3]]).astype(np.float32)
        if self._minimum_m:
            far = np.linalg.norm(points[:, :3].astype(np.float64), axis=1) >= self._minimum_m
            dropped[self._too_near] = len(points) - int(np.count_nonzero(far))
            points = points[far]
            labels = None if labels is None else labels[far]
        if stamp_ns is None or place is None or self._turns is None:
            return Scan(points, labels=labels), dropped
        start_ns, end_ns = self._turns[place].tolist()
        return Scan(points, stamp_ns + start_ns, stamp_ns + end_ns, labels), dropped

    def _labels(
        self, labels: npt.NDArray[np.uint32] | None, count: int
    ) -> npt.NDArray[np.uint32] | None:
        """Return the labels that are written of those of a message, and count the others."""
        if labels is None:
            with self._lock:
                self._unlabelled += count > 0
            return None
        seen = np.bincount(labels & np.uint32(0xFFFF), minlength=len(self._classes)) > 0
        with self._lock:
            if self._point_labels:
                self._classes |= seen
                return labels
            self._unplaced += bool(labels.any())
        return None

    @property
    def are_depth(self) -> bool:
        """Whether the scans are made from depth images."""
        return self._plan is not None and self._source.needs_info

    def notes(self) -> list[str]:
        """Return what should be known of the scans."""
        if self._plan is None:
            return []
        topic, advice = self._plan.topic, self._source.advice
        others = set(np.flatnonzero(self._classes).tolist()) - SEMANTIC_NAMES.keys()
        notes = [*self._notes, *([f'{topic}: {advice}'] if advice else [])]
        if others:
            shown = some_of([str(each) for each in sorted(others)], _SHOWN)
            notes.append(
                f'{topic}: classes of points that SemanticKITTI does not have, written as they are:'
                f' {shown}'
            )
        return notes

    def losses(self) -> tuple[Loss, ...]:
        """Return the parts of messages so far that could not be decoded, or have no file."""
        topic = '' if self._plan is None else self._plan.topic
        lost = dict(self._lost)
        if self._unplaced:
            lost['labels of points, for which layout odometry alone has files'] = self._unplaced
        if self._unlabelled and self._classes.any():
            lost['no labels of points, which other clouds have'] = self._unlabelled
        return tuple(Loss(topic, count, f'{topic}: {reason}') for reason, count in lost.items())


def cloud_notes(plan: ScanPlan, topic: TopicSurvey, *, point_labels: bool) -> list[str]:
    """Return notes on what the fields of a plan's clouds hold; none for other messages.

    Args:
        plan: Of the scans.
        topic: The survey of their topic.
        point_labels: Whether the layout has files for labels of points.
    """
    if topic.msgtype != CLOUD:
        return []
    notes, names = [], labelled_fields(topic)
    if names:
        fields = f'{topic.name}: labels of points ({" and ".join(names)})'
        notes.append(
            f'{fields} become labels/*.label, as SemanticKITTI has them'
            if point_labels
            else f'{fields} are left out: layout odometry alone has files for them'
        )
    doubt = unit_doubt(topic.looks) if plan.unit_m == 1 and not is_fixed(topic.frame) else ''
    if doubt:
        notes.append(
            f'{topic.name}: {doubt}; are they millimetres? scan.unit_m: 0.001 of the plan makes'
            f' metres of them'
        )
    return notes


def labelled_fields(topic: TopicSurvey) -> tuple[str, ...]:
    """Return the fields of a topic's clouds with labels of points, empty without."""
    if topic.msgtype != CLOUD:
        return ()
    return next((names for look in topic.looks if (names := label_fields(look))), ())


def dropped_notes(topic: str, dropped: Mapping[str, int]) -> list[str]:
    """Return a note on the points of all scans that were dropped, by reason."""
    reasons = ', '.join(f'{reason} ({count})' for reason, count in dropped.items() if count)
    total = sum(dropped.values())
    return [f'{topic}: {total} points without a return were dropped: {reasons}'] if total else []
