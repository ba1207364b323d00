# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Places and attitudes of the GPS/IMU unit from a plan's poses, where the bag has no NavSatFix.

The plan's world frame is taken as x east, y north, z up (REP 103) with its origin at the plan's
origin on earth. Readers that bring oxts back to metres by KITTI's Mercator projection (pykitti, the
raw devkit) get the poses of the world frame, apart from their start.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.poses import geographic_places
from ..messages.oxts import UnitPose
from ..model import msgtypes as types
from ..model.errors import MissingDataError
from ..model.geographic import GeoOrigin
from ..model.geometry import Transform
from ..model.streams import Stream
from ..rig.pose_track import MAX_GAP_NS
from .derived_velocity import SLOWEST_POSE_M_S, DerivedVelocities
from .frames import within_gaps
from .named_frames import child_of
from .planned_topics import topic_of

if TYPE_CHECKING:
    from ..model.samples import Int64Array
    from ..rig.pose_track import Track
    from .apply_calibration import Rigging
    from .frames import Frames
    from .plan import Plan
    from .poses import PlannedMotion
    from .survey import Survey

_THINNED_NS = 20_000_000  # of poses at hundreds of hertz some are enough for a velocity
_FARTHEST_M = 200_000.0
"""Maps in UTM or MGRS coordinates are far from their origin: their first pose is put there."""


class UnitPoses:
    """The poses of the unit at a plan's frames.

    Attributes:
        poses: Of each frame, None where the track has none; None without poses for oxts.
        place: Of all packets, where the bag has an Imu alone; None otherwise.
        moving: Its velocities in the world frame by its places; None without poses for oxts, and
            where messages have velocities.
        velocity: The Odometry whose twist is the unit's velocity, empty for none.
        imu_T_velocity: Its child frame in KITTI's imu frame.
        notes: Non-fatal remarks.
        lost_ns: Stamps of the frames without a packet because of a gap in the poses.
    """

    def __init__(
        self, plan: Plan, survey: Survey, frames: Frames, rigging: Rigging, motion: PlannedMotion
    ) -> None:
        """Place the unit.

        Args:
            plan: Names the poses and the origin.
            survey: Of its bags.
            frames: The frames.
            rigging: Where the unit is on the vehicle.
            motion: The poses.
        """
        self.poses: list[UnitPose | None] | None = None
        self.moving: DerivedVelocities | None = None
        self.place: GeoOrigin | None = None
        self.lost_ns: Int64Array = np.zeros(0, dtype=np.int64)
        self.velocity = ''
        self.imu_T_velocity = Transform.identity()
        self.notes: list[str] = list(motion.notes)
        if Stream.OXTS not in plan.layout.traits.streams or plan.fix:
            if plan.origin:
                self.notes.append('origin: not used, for it is where poses become oxts without fix')
            return
        origin = GeoOrigin.parse(plan.origin)
        place = f'{origin.lat:g},{origin.lon:g},{origin.alt:g}'
        if plan.pose is not None and motion.track is None and not plan.imu:
            self.poses = [None] * len(frames)
            return
        if plan.pose is None or motion.track is None:
            if plan.imu or plan.velocity:
                self.place = origin
                self.notes.append(
                    f'oxts: no NavSatFix and no poses, so all packets are at {place} (origin of the'
                    f' plan, LAT,LON,ALT); columns without a source are 0'
                )
            return
        try:
            body_t_imu = rigging.body_t_unit()
        except MissingDataError as error:
            body_t_imu = Transform.identity()
            self.notes.append(f'the unit of oxts is taken as at {plan.pose.body}: {error}')
        found = motion.track.at(frames.stamps_ns)
        missing = np.array([pose is None for pose in found], dtype=np.bool_)
        self.lost_ns = within_gaps(frames.stamps_ns, missing, motion.track)
        self.poses = _unit_poses(found, body_t_imu, origin, self.notes)
        world = plan.pose.world or 'the first pose'
        self.notes.append(
            f'oxts: no NavSatFix; place and attitude are those of {plan.pose.topic}, x east, y'
            f' north, with {world} at {place} (origin of the plan, LAT,LON,ALT);'
            f' columns without a source are 0'
        )
        self._find_velocity(plan, survey, rigging, body_t_imu)
        velocity = plan.velocity or self.velocity
        if not velocity or not topic_of(survey, velocity).moves:
            self.moving = _moving(motion.track, body_t_imu)

    def _find_velocity(
        self, plan: Plan, survey: Survey, rigging: Rigging, body_t_imu: Transform
    ) -> None:
        if plan.pose is None:
            return
        topic = topic_of(survey, plan.velocity or plan.pose.topic)
        if topic.msgtype != types.ODOMETRY:
            return
        child = child_of(topic) or plan.pose.body
        body_t_child = rigging.find(plan.pose.body, child)
        self.velocity = topic.name
        self.imu_T_velocity = body_t_imu.inverse() @ (body_t_child or Transform.identity())


def _unit_poses(
    found: list[Transform | None], body_t_imu: Transform, origin: GeoOrigin, notes: list[str]
) -> list[UnitPose | None]:
    units = [None if pose is None else pose @ body_t_imu for pose in found]
    known = [unit for unit in units if unit is not None]
    if not known:
        return [None] * len(units)
    positions = np.array([unit.translation for unit in known])
    if np.abs(positions[0]).max() > _FARTHEST_M:
        notes.append('oxts: the poses are far from their origin, so the first one is put there')
        positions = positions - positions[0]
    places = iter(geographic_places(positions, origin).tolist())
    return [None if unit is None else UnitPose(unit.rotation, *next(places)) for unit in units]


def _moving(track: Track, body_t_imu: Transform) -> DerivedVelocities:
    """Return the velocities of the unit on a track."""
    _, first = np.unique(track.stamps_ns // _THINNED_NS, return_index=True)
    found = zip(track.stamps_ns[first].tolist(), track.at(track.stamps_ns[first]), strict=True)
    known = [(at_ns, (pose @ body_t_imu).translation) for at_ns, pose in found if pose is not None]
    times = np.array([at_ns for at_ns, _ in known], dtype=np.int64)
    places = np.array([place for _, place in known]).reshape(-1, 3)
    return DerivedVelocities(times, places, MAX_GAP_NS, SLOWEST_POSE_M_S)


def as_velocity(message: Any) -> Any:  # noqa: ANN401 - of the bag's types
    """Return an Odometry in the form of a TwistStamped; other messages as they are."""
    if hasattr(message, 'child_frame_id'):
        return SimpleNamespace(header=message.header, twist=message.twist.twist)
    return message
