# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The oxts packets of a plan: from the messages of the GPS/IMU, or from poses."""

from __future__ import annotations

import math
from dataclasses import replace
from operator import itemgetter
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.kitti_recording import MercatorWorld, geographic_positions
from ..messages.cdr import vector_of
from ..messages.moving_tree import MAX_GAP_NS, interpolate
from ..messages.oxts import ImuPose, Mounting, has_fix, has_orientation, make_packet, position_of
from ..model import bag_formats as types
from ..model.errors import Loss, MissingDataError, format_numbers
from ..model.geometry import Transform
from ..model.samples import nearest_stamps
from ..model.streams import NS_PER_S, GeoOrigin, Stream
from .bag_poses import SLOWEST_FIX_M_S, SLOWEST_POSE_M_S, DerivedVelocities, metres_of
from .kitti_frames import within_gaps
from .plan import VelocityAxes
from .survey import topic_of
from .tf_frames import child_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import TypeAlias

    import numpy.typing as npt

    from ..kitti.writers import LayoutWriter
    from ..messages.moving_tree import Track
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array, OxtsPacket
    from .bag_poses import PlannedMotion
    from .kitti_frames import Frames
    from .plan import Plan
    from .sensor_rig import SensorRig
    from .survey import Survey, TopicSurvey


# The GPS/IMU between two of its messages.
#
# Each function returns a message like the nearer one. Fields that one of the two does not set are
# those of the nearer; an orientation, or an altitude, that one alone has is taken. Positions are
# linear in degrees: in metres that is the straight line, to 1 mm in 200 m.

_TURN_DEG, _HALF_TURN_DEG = 360.0, 180.0
_NOWHERE = np.zeros(3)


def imu_between(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - of the bag's types
    """Interpolate two Imu: linear, and slerp; share is 0 at the first."""
    near = _nearer(first, last, share)
    changes: dict[str, Any] = {}
    oriented = [imu for imu in (first, last) if has_orientation(imu)]
    if len(oriented) == 1:
        names = 'orientation', 'orientation_covariance'
        changes |= {name: getattr(oriented[0], name) for name in names}
    elif oriented:
        turn = interpolate(_turn(first), _turn(last), share).quaternion()
        changes['orientation'] = replace(
            near.orientation, **dict(zip('xyzw', turn.tolist(), strict=True))
        )
    for name in ('angular_velocity', 'linear_acceleration'):
        covariances = {getattr(imu, f'{name}_covariance')[0] for imu in (first, last)}
        if len(covariances) == 1:
            changes[name] = _vector(getattr(first, name), getattr(last, name), share)
    return replace(near, **changes)


def velocity_between(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - of the bag's types
    """Interpolate two messages with a Twist, twist, linearly: see as_velocity."""
    near = _nearer(first, last, share)
    vectors = {
        name: _vector(getattr(first.twist, name), getattr(last.twist, name), share)
        for name in ('linear', 'angular')
    }
    return SimpleNamespace(header=near.header, twist=SimpleNamespace(**vectors))


def fix_between(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - as above
    """Interpolate two NavSatFix linearly; one without a fix is skipped."""
    if not has_fix(last):
        return first
    if not has_fix(first):
        return last
    eastward = math.remainder(last.longitude - first.longitude, _TURN_DEG)
    longitude = first.longitude + share * eastward
    if max(abs(first.longitude), abs(last.longitude)) <= _HALF_TURN_DEG < abs(longitude):
        longitude = math.remainder(longitude, _TURN_DEG)
    return replace(
        _nearer(first, last, share),
        latitude=_number(first.latitude, last.latitude, share),
        longitude=longitude,
        altitude=_number(first.altitude, last.altitude, share),
    )


def _nearer(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - of the bag's types
    return last if share > 0.5 else first


def _number(first: float, last: float, share: float) -> float:
    """Return the number between two; one of them where the other is NaN."""
    mixed = first + share * (last - first)
    return mixed if math.isfinite(mixed) else last if math.isfinite(last) else first


def _turn(imu: Any) -> Transform:  # noqa: ANN401 - as above
    q = imu.orientation
    return Transform.from_quaternion([q.x, q.y, q.z, q.w], _NOWHERE)


def _vector(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - as above
    near = _nearer(first, last, share)
    with np.errstate(invalid='ignore', over='ignore'):
        mixed = vector_of(first) + share * (vector_of(last) - vector_of(first))
    if not np.isfinite(mixed).all():
        return near
    return replace(near, **dict(zip('xyz', mixed.tolist(), strict=True)))


# Checks of oxts packets against each other: notes on drivers with other axes.
#
# KITTI's axes are those of REP 103 and REP 145: the orientation is in east-north-up, accelerations
# contain gravity, upwards at rest. Drivers with a north-east-down world, a yaw from the start of
# the drive, or velocities along other axes name them nowhere. Nor do those that give accelerations
# in g, such as Livox'.

_GRAVITY = 9.81
_NO_GRAVITY = 3.0
_STANDARD_GRAVITY = 9.80665
_OF_ONE_G = 0.9, 1.1
_OFF_RAD = np.radians(30)
_LEAST_SPEED = 2.0  # m/s; slower, positions and their directions are noise
_LEAST_STEPS = 5
_LONGEST_STEP_S = 1.5
_OFF_SHARE = 0.5


def acceleration_scale(imu: TopicSurvey) -> float:
    """Return the m/s^2 of the unit of a topic's accelerations: g for Livox' drivers."""
    if 'livox' not in f'{imu.name} {imu.frame_id}'.lower() or not imu.samples:
        return 1.0
    norms = [float(np.linalg.norm(vector_of(sample.linear_acceleration))) for sample in imu.samples]
    least, most = _OF_ONE_G
    return _STANDARD_GRAVITY if least <= np.median(norms) <= most else 1.0


def scaled_accelerations(imu: Any, scale: float) -> Any:  # noqa: ANN401 - of the bag's types
    """Return an Imu with accelerations in m/s^2, by the m/s^2 of its unit."""
    force = imu.linear_acceleration
    scaled = replace(force, x=force.x * scale, y=force.y * scale, z=force.z * scale)
    return replace(imu, linear_acceleration=scaled)


class OxtsChecks:
    """Compares accelerations with gravity, and velocities and headings with the way driven."""

    def __init__(self) -> None:
        self._sensed: list[tuple[float, float, float]] = []
        self._moved: list[tuple[float, ...]] = []
        self._last: tuple[int, OxtsPacket] | None = None
        self._world: MercatorWorld | None = None

    def take(self, stamp_ns: int, packet: OxtsPacket) -> None:
        """Enter the next packet."""
        if packet.ax or packet.ay or packet.az:
            self._sensed.append((packet.af, packet.al, packet.au))
        self._world = self._world or MercatorWorld.at(packet)
        if self._last is not None:
            self._compare(*self._last, stamp_ns, packet)
        self._last = stamp_ns, packet

    def _compare(self, start_ns: int, start: OxtsPacket, end_ns: int, end: OxtsPacket) -> None:
        seconds = (end_ns - start_ns) / NS_PER_S
        if self._world is None or not 0 < seconds <= _LONGEST_STEP_S:
            return
        way = self._world.pose(end).translation - self._world.pose(start).translation
        said = (start.ve + end.ve) / 2, (start.vn + end.vn) / 2
        yaw = np.arctan2(np.sin(start.yaw) + np.sin(end.yaw), np.cos(start.yaw) + np.cos(end.yaw))
        self._moved.append((*(way[:2] / seconds), *said, float(yaw)))

    def notes(self, imu: str, velocity: str, attitude: str) -> Iterator[str]:
        """Yield a note on each that differs.

        Args:
            imu: Topic of the accelerations, empty for none.
            velocity: Topic of the velocities.
            attitude: Topic of the orientation, if it is that of the accelerations.
        """
        if imu and self._sensed:
            yield from self._gravity(imu, attitude)
        moved = np.array(self._moved).reshape(-1, 5)
        fast = moved[np.hypot(moved[:, 0], moved[:, 1]) >= _LEAST_SPEED]
        if len(fast) < _LEAST_STEPS:
            return
        driven, said = fast[:, :2], fast[:, 2:4]
        off = float(np.median(np.hypot(*(driven - said).T)))
        speed = float(np.median(np.hypot(*driven.T)))
        if velocity and off > _OFF_SHARE * speed:
            yield (
                f'{velocity}: its velocities are off by {off:.1f} m/s in the median from the way'
                f' between the places, at {speed:.1f} m/s: are its axes others? (velocity_axes of'
                f' the plan)'
            )
        if attitude:
            yield from self._heading(attitude, fast)

    def _gravity(self, imu: str, attitude: str) -> Iterator[str]:
        forward, left, up = np.mean(self._sensed, axis=0)
        size = float(np.linalg.norm([forward, left, up]))
        least, most = _OF_ONE_G
        if least <= size <= most and abs(up) > size * np.cos(_OFF_RAD):
            yield (
                f'{imu}: its accelerations look like g ({up:.2f} up in the mean, where REP 145 has'
                f' {_GRAVITY} m/s^2), and are written as they are: let the driver give m/s^2, or'
                f' multiply ax to au of oxts by {_STANDARD_GRAVITY}'
            )
        elif not attitude:
            return
        elif size < _NO_GRAVITY:
            yield (
                f'{imu}: its accelerations are without gravity ({size:.1f} m/s^2 in the mean);'
                f" KITTI's contain it (REP 145)"
            )
        elif np.arccos(np.clip(up / size, -1, 1)) > _OFF_RAD:
            yield (
                f'{imu}: by its orientation gravity is {up:.1f} m/s^2 up in the mean, where REP 145'
                f' has {_GRAVITY}: are its axes north-east-down, or those of another frame? KITTI'
                f' has x forward, y left, z up, in east-north-up'
            )

    def _heading(self, imu: str, fast: Float64Array) -> Iterator[str]:
        """Compare the heading with the direction of the way, backwards as well."""
        course = np.arctan2(fast[:, 1], fast[:, 0])
        # Twice the angle: a vehicle drives along its x axis, in either direction.
        off = float(np.median(np.abs(np.angle(np.exp(2j * (course - fast[:, 4])))))) / 2
        if off > _OFF_RAD:
            yield (
                f'{imu}: its heading is {np.degrees(off):.0f} degrees in the median from the'
                f' direction of the way: KITTI has yaw 0 to the east, counted to the left (REP 103)'
            )


# Positions and attitudes of the GPS/IMU from a plan's poses, where the bag has no NavSatFix.
#
# The plan's world frame is taken as x east, y north, z up (REP 103) with its origin at the plan's
# origin on earth. Readers that bring oxts back to metres by KITTI's Mercator projection (pykitti,
# the raw devkit) get the poses of the world frame, apart from their start.

_THINNED_NS = 20_000_000  # of poses at hundreds of hertz some are enough for a velocity
_FARTHEST_M = 200_000.0
"""Maps in UTM or MGRS coordinates are far from their origin: their first pose is put there."""


class ImuPoses:
    """The poses of the imu at a plan's frames.

    Attributes:
        poses: The pose of each frame, None where the track has none; None without poses for oxts.
        location: The position of all packets, where the bag has an Imu alone; None otherwise.
        moving: Its velocities in the world frame by its positions; None without poses for oxts, and
            where messages have velocities.
        velocity: The Odometry whose twist is the imu's velocity, empty for none.
        imu_T_velocity: Its child frame in KITTI's imu frame.
        notes: Notes.
        lost_ns: Stamps of the frames without a packet because of a gap in the poses.
    """

    def __init__(
        self, plan: Plan, survey: Survey, frames: Frames, sensors: SensorRig, motion: PlannedMotion
    ) -> None:
        """Find the poses.

        Args:
            plan: Names the poses and the origin.
            survey: The survey of the bags.
            frames: The frames.
            sensors: The mounting of the imu on the vehicle.
            motion: The poses.
        """
        self.poses: list[ImuPose | None] | None = None
        self.moving: DerivedVelocities | None = None
        self.location: GeoOrigin | None = None
        self.lost_ns: Int64Array = np.zeros(0, dtype=np.int64)
        self.velocity = ''
        self.imu_T_velocity = Transform.identity()
        self.notes: list[str] = list(motion.notes)
        if Stream.OXTS not in plan.layout.traits.streams or plan.fix:
            if plan.origin:
                self.notes.append('origin: not used, for it is where poses become oxts without fix')
            return
        origin = GeoOrigin.parse(plan.origin)
        where = f'{origin.lat:g},{origin.lon:g},{origin.alt:g}'
        if plan.pose is not None and motion.track is None and not plan.imu:
            self.poses = [None] * len(frames)
            return
        if plan.pose is None or motion.track is None:
            if plan.imu or plan.velocity:
                self.location = origin
                self.notes.append(
                    f'oxts: no NavSatFix and no poses, so all packets are at {where} (origin of the'
                    f' plan, LAT,LON,ALT); columns without a source are 0'
                )
            return
        try:
            body_t_imu = sensors.body_t_imu()
        except MissingDataError as error:
            body_t_imu = Transform.identity()
            self.notes.append(f'the unit of oxts is taken as at {plan.pose.body}: {error}')
        poses = motion.track.at(frames.stamps_ns)
        missing = np.array([pose is None for pose in poses], dtype=np.bool_)
        self.lost_ns = within_gaps(frames.stamps_ns, missing, motion.track)
        self.poses = _to_imu_poses(poses, body_t_imu, origin, self.notes)
        world = plan.pose.world or 'the first pose'
        self.notes.append(
            f'oxts: no NavSatFix; place and attitude are those of {plan.pose.topic}, x east, y'
            f' north, with {world} at {where} (origin of the plan, LAT,LON,ALT);'
            f' columns without a source are 0'
        )
        self._find_velocity(plan, survey, sensors, body_t_imu)
        velocity = plan.velocity or self.velocity
        if not velocity or not topic_of(survey, velocity).moves:
            self.moving = _moving(motion.track, body_t_imu)

    def _find_velocity(
        self, plan: Plan, survey: Survey, sensors: SensorRig, body_t_imu: Transform
    ) -> None:
        if plan.pose is None:
            return
        topic = topic_of(survey, plan.velocity or plan.pose.topic)
        if topic.msgtype != types.ODOMETRY:
            return
        child = child_of(topic) or plan.pose.body
        body_t_child = sensors.find(plan.pose.body, child)
        self.velocity = topic.name
        self.imu_T_velocity = body_t_imu.inverse() @ (body_t_child or Transform.identity())


def _to_imu_poses(
    poses: list[Transform | None], body_t_imu: Transform, origin: GeoOrigin, notes: list[str]
) -> list[ImuPose | None]:
    imu_poses = [None if pose is None else pose @ body_t_imu for pose in poses]
    known_poses = [pose for pose in imu_poses if pose is not None]
    if not known_poses:
        return [None] * len(imu_poses)
    positions = np.array([pose.translation for pose in known_poses])
    if np.abs(positions[0]).max() > _FARTHEST_M:
        notes.append('oxts: the poses are far from their origin, so the first one is put there')
        positions = positions - positions[0]
    coords = iter(geographic_positions(positions, origin).tolist())
    return [None if pose is None else ImuPose(pose.rotation, *next(coords)) for pose in imu_poses]


def _moving(track: Track, body_t_imu: Transform) -> DerivedVelocities:
    """Return the velocities of the imu on a track."""
    _, first = np.unique(track.stamps_ns // _THINNED_NS, return_index=True)
    poses = zip(track.stamps_ns[first].tolist(), track.at(track.stamps_ns[first]), strict=True)
    path = [(at_ns, (pose @ body_t_imu).translation) for at_ns, pose in poses if pose is not None]
    times = np.array([at_ns for at_ns, _ in path], dtype=np.int64)
    positions = np.array([position for _, position in path]).reshape(-1, 3)
    return DerivedVelocities(times, positions, MAX_GAP_NS, SLOWEST_POSE_M_S)


def as_velocity(message: Any) -> Any:  # noqa: ANN401 - of the bag's types
    """Return an Odometry in the form of a TwistStamped; other messages as they are."""
    if hasattr(message, 'child_frame_id'):
        return SimpleNamespace(header=message.header, twist=message.twist.twist)
    return message


# The oxts packets of a plan: one a frame, from the Imu, fix and velocity around its stamp.

if TYPE_CHECKING:
    _Between: TypeAlias = Callable[[Any, Any, float], Any]

_MAX_FIX_GAP_NS = 2 * NS_PER_S + NS_PER_S // 2
"""Receivers send their position once a second or more often; one lost fix is bridged."""

_BRIDGED_PERIODS = 2.5
"""The same of the other messages: one that is lost is bridged."""

_USUAL_PERIODS = 1.5
"""Fixes farther apart have one between them that is lost."""

_OR_UNREADABLE = ', or messages that cannot be decoded,'
_IDENTITY = Transform.identity()
_BETWEEN: tuple[_Between, ...] = (imu_between, fix_between, velocity_between)


class PacketMaker:
    """Makes packets while a bag is read; keeps only a few frames of messages in memory.

    Imu, position and velocity are interpolated between the messages before and after the frame's
    stamp; of positions between those with a fix. Where all have the same stamps, as often as
    frames, and the layout has those of packets, they are taken whole. Where one of these is
    missing, the nearest counts, within the plan's tolerance or its period. Without a velocity it is
    derived from the positions.

    Attributes:
        losses: Frames without a packet, where the layout has a line for each.
        lost_ns: Stamps of the frames without a packet because of a gap in the poses.
    """

    def __init__(
        self,
        plan: Plan,
        survey: Survey,
        frames: Frames,
        sensors: SensorRig,
        motion: PlannedMotion,
    ) -> None:
        """Select the required messages.

        Args:
            plan: Names the topics.
            survey: Their stamps.
            frames: The frames.
            sensors: The mounting of the sensors.
            motion: Poses that replace the fix.

        Raises:
            UsageError: A topic is missing.
        """
        self._poses = imu_poses = ImuPoses(plan, survey, frames, sensors, motion)
        self.lost_ns = imu_poses.lost_ns
        self._notes: list[str] = [*imu_poses.notes]
        self._missing = 0
        self.losses: tuple[Loss, ...] = ()
        self._frames_ns = frames.stamps_ns
        self._topics = {
            'imu': plan.imu,
            'fix': plan.fix,
            'velocity': plan.velocity or imu_poses.velocity,
        }
        self._mounting = self._mounted(plan, sensors.imu_t_topic)
        named = {role: topic for role, topic in self._topics.items() if topic}
        self._acceleration_scale = self._find_acceleration_scale(plan.imu, survey)
        self._stamps = {topic: topic_of(survey, topic).stamps()[0] for topic in named.values()}
        self._tolerance_ns = round(plan.tolerance_s * NS_PER_S)
        if plan.layout.traits.stamps_per_stream and imu_poses.poses is None:
            self._frames_ns = self._own_stamps(frames.stamps_ns)
        self._far: dict[str, list[int]] = {}
        gaps = np.diff(np.sort(self._stamps[plan.fix])) if plan.fix else np.zeros(0)
        self._usual_gap_ns = _USUAL_PERIODS * float(np.median(gaps)) if len(gaps) else 0.0
        self._moved_m: list[float] = []
        self._bridged: list[tuple[int, float]] = []
        fixed = np.isfinite(topic_of(survey, plan.fix).fixes[:, 0]) if plan.fix else None
        self._velocities = self._find_velocities(survey, fixed)
        velocity = self._topics['velocity']
        self._velocity_of = velocity if velocity and topic_of(survey, velocity).moves else ''
        self._derived = 0
        messages_by_role = {
            role: self._around(topic, _MAX_FIX_GAP_NS, fixed)
            if role == 'fix'
            else self._around(topic, 0)
            for role, topic in named.items()
        }
        self._keys = self._parts_of_frames(messages_by_role)
        self._without_fix = [keys is None for keys in messages_by_role.get('fix', ())]
        self._gapless = Stream.OXTS in plan.layout.traits.line_streams
        self._forbid_gaps()
        self._pending: dict[int, dict[tuple[str, int], Any]] = {}
        self._frames_of: dict[tuple[str, int], list[int]] = {}
        for frame, keys in enumerate(self._keys):
            for key in keys or ():
                self._frames_of.setdefault(key, []).append(frame)
        self._ready: dict[int, OxtsPacket | None] = {}
        self._next = 0
        self._unoriented: list[int] = []
        self._checks = OxtsChecks()

    def _mounted(self, plan: Plan, turns: Mapping[str, Transform]) -> Mounting:
        """Return how the sensors of the topics are mounted in KITTI's imu frame."""
        poses, velocity = self._poses, self._topics['velocity']
        placed = {**turns, poses.velocity: poses.imu_T_velocity} if poses.velocity else turns
        return Mounting(
            placed.get(plan.imu, _IDENTITY),
            placed.get(velocity, _IDENTITY),
            placed.get(plan.fix, _IDENTITY),
            plan.velocity_axes is VelocityAxes.ENU,
        )

    def _own_stamps(self, frames_ns: Int64Array) -> Int64Array:
        """Return the stamps of whole packets, one a frame, as KITTI's are; else those of frames.

        A packet is whole if Imu, fix and velocity are of three topics with the same stamps,
        as in bags of kitti2bag: its numbers then come back, not some between two of them. Units
        that are faster than the frames are interpolated.
        """
        if len(self._stamps) < len(self._topics):
            return frames_ns
        packets_ns, *others = (np.sort(stamps) for stamps in self._stamps.values())
        alike = all(np.array_equal(packets_ns, other) for other in others)
        if not alike or len(packets_ns) < len(frames_ns):
            return frames_ns
        nearest, later_ns = nearest_stamps(packets_ns, frames_ns)
        one_each = len(np.unique(packets_ns[nearest])) == len(frames_ns)
        as_often = len(frames_ns) > 1 and float(np.median(np.diff(nearest))) == 1
        near = bool((np.abs(later_ns) <= self._tolerance_ns).all())
        return packets_ns[nearest] if one_each and as_often and near else frames_ns

    def _find_acceleration_scale(self, imu: str, survey: Survey) -> float:
        """Return the m/s^2 of the unit of a topic's accelerations, and note one that is not 1."""
        scale = acceleration_scale(topic_of(survey, imu)) if imu else 1.0
        if scale != 1:
            self._notes.append(
                f"{imu}: its accelerations are in g, as Livox' drivers give them; they are"
                f' multiplied by {scale}'
            )
        return scale

    def _find_velocities(
        self, survey: Survey, fixed: npt.NDArray[np.bool_] | None
    ) -> DerivedVelocities | None:
        """Return the velocities by the poses or by the fixes, None without either."""
        fix = self._topics['fix']
        if self._poses.moving is not None or fixed is None:
            return self._poses.moving
        stamps, first = np.unique(self._stamps[fix][fixed], return_index=True)
        positions = metres_of(topic_of(survey, fix).fixes[fixed][first])
        return DerivedVelocities(stamps, positions, _MAX_FIX_GAP_NS, SLOWEST_FIX_M_S)

    def _moving(self, frame: int) -> Float64Array | None:
        """Return the velocity of a frame by the positions, None where unknown."""
        velocities = self._velocities
        return None if velocities is None else velocities.at(int(self._frames_ns[frame]))

    def _parts_of_frames(
        self, by_role: Mapping[str, Sequence[set[tuple[str, int]] | None]]
    ) -> list[set[tuple[str, int]] | None]:
        """Return the messages of each frame's packet, None without one.

        With poses a packet needs no message: columns of those that are not near are 0.
        """
        if 'velocity' in by_role:
            optional = [
                set() if keys is None and self._moving(frame) is not None else keys
                for frame, keys in enumerate(by_role['velocity'])
            ]
            by_role = {**by_role, 'velocity': optional}
        poses, by_frame = self._poses.poses, list(by_role.values())
        if poses is None:
            return [
                None if None in sets else {key for keys in sets for key in keys or ()}
                for sets in zip(*by_frame, strict=True)
            ]
        self._notes += [
            f'oxts: no message of {self._topics[role]} near {sets.count(None)} frames; its columns'
            f' are 0 there'
            for role, sets in by_role.items()
            if None in sets
        ]
        return [
            None if pose is None else {key for keys in by_frame for key in keys[frame] or ()}
            for frame, pose in enumerate(poses)
        ]

    @property
    def topics(self) -> set[str]:
        """The topics to read."""
        return {topic for topic, _ in self._frames_of}

    def notes(self) -> list[str]:
        """Return notes on the packets so far."""
        notes = [
            f'oxts: {topic} has no message within the tolerance of {len(away)} frames, which take'
            f' the nearest: up to {max(away) / NS_PER_S:.2f} s away{self._metres(topic)}'
            for topic, away in self._far.items()
        ]
        if self._bridged:
            longest, farthest = (max(column) for column in zip(*self._bridged, strict=True))
            notes.append(
                f'oxts: {self._topics["fix"]} has no fix beside {len(self._bridged)} frames, whose'
                f' places lie between fixes that are up to {longest / NS_PER_S:.2f} s and'
                f' {farthest:.2f} m apart'
            )
        if self._derived:
            velocity, fix = self._topics['velocity'], self._topics['fix']
            why = f', for {velocity} has none (all are 0)' if velocity != self._velocity_of else ''
            source = fix if self._poses.poses is None else 'the poses'
            notes.append(
                f'oxts: the velocities of {self._derived} packets are derived from the places of'
                f' {source}{why}'
            )
        if self._missing and not self._gapless:
            notes.append(f'{self._missing} frames have no fix{_OR_UNREADABLE} and get no packet')
        if self._unoriented:
            notes.append(self._without_orientation())
        attitude = self._topics['imu'] if self._poses.poses is None and not self._unoriented else ''
        notes += self._checks.notes(self._topics['imu'], self._velocity_of, attitude)
        return [*self._notes, *notes]

    def _without_orientation(self) -> str:
        """Return the note on packets whose Imu has no orientation, by frames unless all are."""
        packets = sum(keys is not None for keys in self._keys)
        some = len(self._unoriented) < packets
        where = f' near frames {format_numbers(sorted(self._unoriented))}, where' if some else ';'
        fix = self._topics['fix']
        also = f', and the places those of {fix}' if fix else ''
        return f'{self._topics["imu"]}: no orientation{where} roll, pitch and yaw are 0{also}'

    def _metres(self, topic: str) -> str:
        """Return how far fixes were extrapolated."""
        if topic != self._topics['fix'] or not self._moved_m:
            return ''
        return f', and are carried on by up to {max(self._moved_m):.2f} m, by the velocity there'

    def wants(self, topic: str, index: int) -> bool:
        """Return whether a message, by its index in its topic, is part of a packet."""
        return (topic, index) in self._frames_of

    def take(self, topic: str, index: int, message: Any) -> None:  # noqa: ANN401 - of the bag
        """Take a required message; None where it cannot be decoded."""
        key = (topic, index)
        for frame in self._frames_of.pop(key):
            messages = self._pending.setdefault(frame, {})
            messages[key] = message if message is None else self._prepared(topic, message)
            if messages.keys() == self._keys[frame]:
                self._ready[frame] = self._make(frame, self._pending.pop(frame))

    def _prepared(self, topic: str, message: Any) -> Any:  # noqa: ANN401 - of the bag
        if topic == self._topics['imu'] and self._acceleration_scale != 1:
            return scaled_accelerations(message, self._acceleration_scale)
        return as_velocity(message)

    def write(self, writer: LayoutWriter, first: int) -> int:
        """Write the packets that are ready, in order; returns how many."""
        count = 0
        while self._next < len(self._keys):
            keys = self._keys[self._next]
            if keys is not None and not keys:
                self._ready[self._next] = self._make(self._next, {})
            if keys is not None and self._next not in self._ready:
                break
            packet = self._ready.pop(self._next, None)
            if packet is not None:
                stamp_ns = int(self._frames_ns[self._next])
                writer.write_oxts(first + self._next, stamp_ns, packet)
                self._checks.take(stamp_ns, packet)
                count += 1
            elif self._keys[self._next] is not None:
                self._count_missing()
            self._next += 1
        return count

    def _count_missing(self) -> None:
        """Count a frame whose messages have no fix, or cannot be decoded."""
        self._missing += 1
        if self._gapless:
            self._lose(
                f'oxts ends before frame {self._next}, which has no fix{_OR_UNREADABLE}',
                len(self._keys) - self._next,
            )
            self._keys.clear()
            self._frames_of.clear()

    def _lose(self, reason: str, frames: int) -> None:
        """Enter the frames that go without a packet although others near them have one."""
        topic = next(filter(None, self._topics.values()), Stream.OXTS.value)
        rest = f'{reason}: line n is frame n, so {frames} frames go without'
        self.losses = (Loss(topic, frames, rest),)

    def _around(
        self, topic: str, most_ns: int, usable: npt.NDArray[np.bool_] | None = None
    ) -> list[set[tuple[str, int]] | None]:
        """Return the messages of a topic that each frame needs: two, one, or None for none near.

        Args:
            topic: Its name.
            most_ns: The longest gap that is bridged, if it is longer than some periods.
            usable: (N,) which messages count; None for all.
        """
        used = np.arange(len(self._stamps[topic])) if usable is None else np.flatnonzero(usable)
        stamps = self._stamps[topic][used]
        if not len(stamps):
            return [None] * len(self._frames_ns)
        topic_stamps = np.sort(self._stamps[topic])
        period = int(np.median(np.diff(topic_stamps))) if len(topic_stamps) > 1 else 0
        most_ns = max(most_ns, round(_BRIDGED_PERIODS * period))
        order = np.argsort(stamps, kind='stable')
        ranked = stamps[order]
        nearest, later_ns = nearest_stamps(ranked, self._frames_ns)
        away = np.abs(later_ns)
        far = away > max(self._tolerance_ns, period)
        after = np.searchsorted(ranked, self._frames_ns)
        messages: list[set[tuple[str, int]] | None] = []
        for frame, later in enumerate(after.tolist()):
            between = away[frame] > 0 and 0 < later < len(stamps)
            if between and ranked[later] - ranked[later - 1] <= most_ns:
                messages.append({(topic, int(used[at])) for at in order[later - 1 : later + 1]})
            else:
                messages.append(None if far[frame] else {(topic, int(used[order[nearest[frame]]]))})
        return messages

    def _forbid_gaps(self) -> None:
        """Require packets of all frames in the tracking layout, where line n is frame n."""
        missing = [frame for frame, keys in enumerate(self._keys) if keys is None]
        if not missing:
            return
        source = 'imu, fix or velocity near' if self._poses.poses is None else 'poses around'
        if self._without_fix and all(self._without_fix[frame] for frame in missing):
            source = 'fix near'
        which = f'no {source} frames {format_numbers(missing)}'
        first = missing[0]
        if self._gapless and first and source == 'fix near':
            text = f'oxts ends before frame {first}, which has no fix near'
            self._lose(text, len(self._keys) - first)
            del self._keys[first:]
        elif self._gapless:
            self._lose(f'{which}, so {Stream.OXTS.value} is left out', len(self._keys))
            self._keys = []
        else:
            self._notes.append(which)

    def _make(self, frame: int, messages: Mapping[tuple[str, int], Any]) -> OxtsPacket | None:
        by_topic: dict[str, list[tuple[int, Any]]] = {topic: [] for topic, _ in messages}
        for (topic, index), message in messages.items():
            if message is not None:
                by_topic[topic].append((index, message))
        if not all(by_topic.values()):
            return None
        imu, fix, velocity = (
            self._at(frame, topic, by_topic[topic], between) if topic in by_topic else None
            for topic, between in zip(self._topics.values(), _BETWEEN, strict=True)
        )
        pose = None if self._poses.poses is None else self._poses.poses[frame]
        if imu is not None and pose is None and not has_orientation(imu):
            self._unoriented.append(frame)
        packet = make_packet(
            imu,
            fix,
            velocity,
            mounting=self._mounting,
            pose=pose,
            moving=self._derive(frame, velocity),
        )
        still = self._poses.location
        if packet is None or still is None:
            return packet
        return replace(packet, lat=still.lat, lon=still.lon, alt=still.alt)

    def _derive(self, frame: int, velocity: Any) -> Float64Array | None:  # noqa: ANN401 - as _at
        """Return the velocity of a frame by its positions, None if a message has it or unknown."""
        has_one = self._velocity_of and velocity is not None
        moving = None if has_one else self._moving(frame)
        self._derived += moving is not None and bool(moving.any())
        return moving

    def _at(
        self, frame: int, topic: str, messages: list[tuple[int, Any]], between: _Between
    ) -> Any:  # noqa: ANN401 - of the bag
        """Interpolate the two messages around a frame, or return the only one."""
        stamps = self._stamps[topic]
        by_stamp = sorted(
            ((int(stamps[message[0]]), message[1]) for message in messages), key=itemgetter(0)
        )
        frame_ns = int(self._frames_ns[frame])
        (first_ns, first), (end_ns, last) = by_stamp[0], by_stamp[-1]
        if first_ns != end_ns:
            mixed = between(first, last, (frame_ns - first_ns) / (end_ns - first_ns))
            if mixed is not first and mixed is not last:
                if topic == self._topics['fix'] and end_ns - first_ns > self._usual_gap_ns:
                    way = metres_of(np.array([position_of(first), position_of(last)]))[1]
                    self._bridged.append((end_ns - first_ns, float(np.linalg.norm(way))))
                return mixed
            first_ns, first = (first_ns, first) if mixed is first else (end_ns, last)
        if abs(frame_ns - first_ns) > self._tolerance_ns:
            self._far.setdefault(topic, []).append(abs(frame_ns - first_ns))
        if topic == self._topics['fix']:
            return self._extrapolated(first, frame, frame_ns - first_ns)
        return first

    def _extrapolated(self, fix: Any, frame: int, later_ns: int) -> Any:  # noqa: ANN401 - of the bag
        """Return a fix before or after a frame, extrapolated by the velocity of the positions."""
        moving = self._moving(frame) if later_ns else None
        if moving is None or not moving.any():
            return fix
        way = moving * (later_ns / NS_PER_S)
        self._moved_m.append(float(np.linalg.norm(way)))
        position = GeoOrigin(fix.latitude, fix.longitude, fix.altitude).moved(*way.tolist())
        return replace(fix, latitude=position.lat, longitude=position.lon, altitude=position.alt)
