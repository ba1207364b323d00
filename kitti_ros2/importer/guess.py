# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of the KITTI stream of each topic: by type, name, frame and neighbours.

Also hints on the topics that the plan does not use.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from ..messages.cdr import vector_of
from ..messages.naming import RECORDING
from ..messages.oxts import has_orientation
from ..messages.tf_tree import find_body
from ..messages.topics import own_topics
from ..model import bag_formats as types
from ..model.errors import MissingDataError, UsageError, one_line, some_of
from ..model.samples import default_tolerance_ns
from ..model.streams import NS_PER_S, Stream, format_stamp
from .bag_cameras import (
    find_cameras,
    find_heading,
    guess_camera_sets,
    guess_cameras,
    keeps_distortion,
    main_camera,
    make_camera_rig,
)
from .bag_labels import PixelFrames, guess_labels, has_cubes
from .bag_poses import guess_pose, link_topics, moving_pairs
from .bag_scans import cloud_notes, guess_scan
from .clocks import clocked, estimate_offsets
from .plan import (
    FIX,
    IMU,
    LABELS,
    NONE,
    ROLES,
    SCAN,
    SOURCE,
    TF,
    VELOCITY,
    Incomplete,
    Plan,
    VelocityAxes,
    topic_uses,
)
from .survey import unchosen_notes
from .tf_frames import (
    NamedFrames,
    child_of,
    describe_axes,
    face_forward,
    forward_frame,
    is_fixed,
    is_forward,
    near_frame,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from ..messages.tf_tree import FrameTree, Heading
    from ..model.errors import Loss
    from ..model.samples import Int64Array
    from ..model.streams import Layout
    from .plan import CameraPlan, PosePlan, ScanPlan
    from .survey import Survey, TopicSurvey


# Choice of the topics and the frame of the GPS/IMU.


def has_vehicle_fix(survey: Survey, scan: ScanPlan | None) -> bool:
    """Return whether a receiver of the vehicle has a fix."""
    return any(topic.has_fix for topic in _of_vehicle(survey, types.FIX, scan))


def guess_oxts_topics(
    survey: Survey, scan: ScanPlan | None, notes: list[str], pose: PosePlan | None = None
) -> dict[str, str]:
    """Choose the topics of the GPS/IMU, by their keys in the plan.

    Args:
        survey: The survey of the bags.
        scan: The scans, whose vehicle it is of.
        notes: Notes on what is missing are added.
        pose: The plan's poses, which replace a fix.
    """
    oxts = _best_topics(survey, scan, pose, notes)
    if 'fix' not in oxts and pose is None and 'imu' not in oxts:
        notes.append('missing: fix (NavSatFix), imu and poses, so oxts is left out')
        return {}
    if 'fix' not in oxts:
        if pose is not None:
            oxts |= _odometry(survey, pose)
        origin = 'origin of the plan' if pose is None else 'the poses, from origin of the plan on'
        notes.append(f'missing: fix (NavSatFix); the position in oxts is that of {origin}')
    elif 'imu' in oxts and not ('velocity' in oxts and survey.topics[oxts['velocity']].moves):
        oxts |= _odometry_of(survey, survey.topics[oxts['imu']].frame_id)
    placed = 'fix' in oxts or pose is not None
    derived = 'in oxts it is derived from the places'
    for key, msgtype in (('imu', 'Imu'), ('velocity', 'TwistStamped')):
        rest = derived if key == 'velocity' and placed else 'its columns of oxts are 0'
        if key not in oxts:
            notes.append(f'missing: {key} ({msgtype}); {rest}')
    return oxts


def _best_topics(
    survey: Survey, scan: ScanPlan | None, pose: PosePlan | None, notes: list[str]
) -> dict[str, str]:
    """Return the topics of the GPS/IMU by their keys, and note the unused ones."""
    oxts: dict[str, str] = {}
    joined = _joined_frames(survey, scan)
    for role, rank in (
        (IMU, partial(_imu_rank, joined=joined)),
        (FIX, _fix_rank),
        (VELOCITY, _velocity_rank),
    ):
        key, (msgtype,) = role.key, role.msgtypes
        topics = _of_vehicle(survey, msgtype, scan)
        if key == 'velocity':
            topics = _in_known_axes(topics, survey, joined, pose, oxts)
        notes += [
            f'passed over for {key}: {topic.name} ({topic.count}); no transform joins its frame,'
            f' {topic.frame_id}, to that of the scans'
            for topic in survey.of_type(msgtype)
            if topic not in topics
        ]
        if not topics:
            continue
        best = max(topics, key=rank)
        notes += unchosen_notes(key, best, topics)
        if key == 'fix' and not best.has_fix:
            notes.append(f'passed over for fix: {best.name} ({best.count}); it never has a fix')
        else:
            oxts[key] = best.name
    return oxts


def _joined_frames(survey: Survey, scan: ScanPlan | None) -> frozenset[str]:
    """Return the frames that static transforms join to the scans'."""
    if scan is None:
        return frozenset()
    tree = survey.tree
    frame_ids = {*tree.frames, scan.frame}
    return frozenset(frame_id for frame_id in frame_ids if tree.joins(scan.frame, frame_id))


def _in_known_axes(
    topics: list[TopicSurvey],
    survey: Survey,
    joined: Collection[str],
    pose: PosePlan | None,
    oxts: Mapping[str, str],
) -> list[TopicSurvey]:
    """Return the velocities that can be turned into the axes of the imu, if its frame is joined."""
    imu, fix = (survey.topics[oxts[key]].frame_id if key in oxts else '' for key in ('imu', 'fix'))
    is_joined = imu in joined if 'imu' in oxts else pose is not None and pose.body in joined
    if not is_joined:
        return topics
    known_frames = {'', fix, *joined}
    return [topic for topic in topics if topic.frame_id in known_frames or is_fixed(topic.frame_id)]


def _of_vehicle(survey: Survey, msgtype: str, scan: ScanPlan | None) -> list[TopicSurvey]:
    """Return the topics of a type but those of another robot.

    Its frames have another prefix (robot2/base_link), and no transform joins them to the scans'.
    """
    tree, own = survey.tree, '' if scan is None else scan.frame
    vehicle_topics = []
    for topic in survey.of_type(msgtype):
        in_tree = {own, topic.frame_id} <= tree.frames
        prefixes = own.rpartition('/')[0], topic.frame_id.rpartition('/')[0]
        apart = in_tree and all(prefixes) and prefixes[0] != prefixes[1]
        if not apart or tree.root_of(own) == tree.root_of(topic.frame_id):
            vehicle_topics.append(topic)
    return vehicle_topics


def _imu_rank(topic: TopicSurvey, joined: Collection[str]) -> tuple[bool, bool, bool, bool, int]:
    """Rank an Imu: in a joined frame, with an orientation, not raw, with values, of most."""
    oriented = any(map(has_orientation, topic.samples))
    rates = (message.angular_velocity for message in topic.samples)
    forces = (message.linear_acceleration for message in topic.samples)
    measured = any(vector_of(vector).any() for vector in (*rates, *forces))
    return topic.frame_id in joined, oriented, 'raw' not in topic.name, measured, topic.count


def _fix_rank(topic: TopicSurvey) -> tuple[bool, bool, int]:
    """Rank a NavSatFix: with a fix, not raw, of most messages."""
    return topic.has_fix, 'raw' not in topic.name, topic.count


def _velocity_rank(topic: TopicSurvey) -> tuple[bool, bool, int]:
    return 'cmd' not in topic.name, topic.moves, topic.count


def _odometry(survey: Survey, pose: PosePlan) -> dict[str, str]:
    """Return the Odometry whose twist is the velocity: that of the poses, or of the same body."""
    tree = survey.tree
    topics = [
        topic
        for topic in survey.of_type(types.ODOMETRY)
        if topic.name == pose.topic
        or child_of(topic) == pose.body
        or tree.joins(pose.body, child_of(topic))
    ]
    if not topics:
        return {}
    return {'velocity': max(topics, key=lambda topic: (topic.name == pose.topic, topic.count)).name}


def _odometry_of(survey: Survey, frame_id: str) -> dict[str, str]:
    """Return the Odometry with a twist whose body static transforms join to a frame."""
    tree = survey.tree
    topics = [
        topic
        for topic in survey.of_type(types.ODOMETRY)
        if child_of(topic) in tree.frames and tree.joins(frame_id, child_of(topic)) and topic.moves
    ]
    return {'velocity': max(topics, key=lambda topic: topic.count).name} if topics else {}


def guess_velocity_axes(survey: Survey, oxts: Mapping[str, str], notes: list[str]) -> VelocityAxes:
    """Choose the axes of a TwistStamped by its frame.

    Receivers with one antenna have no heading: the velocity of nmea_navsat_driver and
    others, in the frame of their NavSatFix, is along east and north. That in a fixed frame (mavros'
    velocity_local, in map) is along its axes, which REP 103 has as east, north, up.
    """
    topic = survey.topics.get(oxts.get('velocity', ''))
    if topic is None or topic.msgtype != types.TWIST or not topic.frame_id:
        return VelocityAxes.FRAME
    fixed = is_fixed(topic.frame_id)
    fix, imu = (survey.topics[oxts[key]].frame_id if key in oxts else '' for key in ('fix', 'imu'))
    if not fixed and (topic.frame_id != fix or topic.frame_id == imu):
        return VelocityAxes.FRAME
    why = 'which does not move' if fixed else f'that of {oxts["fix"]}'
    notes.append(
        f'{topic.name}: its frame is {topic.frame_id}, {why}, so it is taken as along east, north'
        f' and up (velocity_axes)'
    )
    return VelocityAxes.ENU


def guess_imu_frame(
    survey: Survey, imu: str, scan: ScanPlan | None, heading: Heading | None, notes: list[str]
) -> str:
    """Return the frame of the Imu if static transforms connect it to the scans'.

    It is one with x forward, y left and z up, as KITTI's.

    Args:
        survey: The survey of the bags.
        imu: The topic of the plan, empty for none.
        scan: The scans.
        heading: The robot's forward; None where it is unknown.
        notes: A note is added.
    """
    topics = _of_vehicle(survey, types.IMU, scan)
    if not topics or scan is None:
        return ''
    joined = _joined_frames(survey, scan)
    chosen = max(topics, key=lambda topic: (topic.name == imu, _imu_rank(topic, joined)))
    if chosen.frame_id in joined:
        tree = survey.tree
        heading = find_body(tree, [chosen.frame_id]) or heading
        return _forward_frame(chosen.frame_id, tree, heading, notes)
    notes.append(
        f'missing: a static transform from {chosen.frame_id} to {scan.frame}; the imu frame is'
        f' nominal until imu_frame names a frame that is joined'
    )
    return ''


def _forward_frame(name: str, tree: FrameTree, heading: Heading | None, notes: list[str]) -> str:
    """Return the frame of the Imu, or one near it or the body's where its x is not forward."""
    axes = None if heading is None else heading.axes_of(tree, name)
    if heading is None or axes is None or is_forward(axes):
        return name
    note = f'the Imu is in {name}, {describe_axes(axes, heading)}; KITTI has x forward'
    forward = near_frame(name, tree, heading) or forward_frame(name, tree, heading)
    if forward:
        notes.append(f'{note}: imu_frame is {forward}, and oxts is turned to it')
        return forward
    notes.append(f'{note}, and so has no frame of the bag: oxts is along the axes of {name}')
    return name


def pose_body_frame(survey: Survey, scan: ScanPlan | None, pose: PosePlan) -> str:
    """Return the frame whose poses become oxts if static transforms connect it to the scans'."""
    tree = survey.tree
    joined = scan is not None and tree.joins(scan.frame, pose.body)
    return pose.body if joined else ''


# Detection of the KITTI stream of each topic: by type, name, frame and neighbours.

_DEFAULT_TOLERANCE_S = 0.05
_MOST_SHOWN = 8


@dataclass(frozen=True)
class Guess:
    """A plan with notes.

    Attributes:
        plan: The plan.
        notes: Missing and skipped topics; a line each.
        losses: Topics that the plan would name if any of their messages could be decoded.
    """

    plan: Plan
    notes: tuple[str, ...]
    losses: tuple[Loss, ...] = ()


def guess_plan(
    survey: Survey,
    layout: Layout,
    path: Path,
    *,
    all_cameras: bool = False,
    with_calibration: bool = False,
) -> Guess:
    """Make the most complete plan for a bag.

    Args:
        survey: The survey of the bag.
        layout: The layout to write.
        path: The path of the bag, for errors.
        all_cameras: Whether each camera gets a data set of its own.
        with_calibration: Whether one is given: it is for scans in the frame of their messages, so
            that they stay in it, also where its x is not forward.

    Raises:
        MissingDataError: It contains no data that the layout requires.
    """
    traits, notes = layout.traits, list[str]()
    sensors = _find_sensors(
        survey, layout, notes, all_cameras=all_cameras, with_calibration=with_calibration
    )
    if not any(sensors[:-1]):
        raise MissingDataError(f'{path}: {_describe_contents(survey, layout)}')
    scan, cameras, sets, pose, _ = sensors
    viewed = cameras or dict(zip((2,), sets.values(), strict=False))
    reference, topic = _reference(scan, viewed, pose)
    stamps, _ = survey.topics[topic].stamps()
    oxts = guess_oxts_topics(survey, scan, notes, pose) if Stream.OXTS in traits.streams else {}
    imu_frame = _imu_frame(survey, layout, sensors, oxts, notes)
    labels = None
    if Stream.LABELS in traits.streams:
        tree = survey.tree
        labels = guess_labels(survey, tree, viewed, notes, layout)
    extract = keeps_distortion(survey, (sets or cameras).values())
    plan = Plan(
        layout=layout,
        name=_name(layout, int(stamps[0]), extract=extract),
        reference=reference,
        tolerance_s=_tolerance_s(stamps),
        incomplete=Incomplete.KEEP if traits.stamps_per_stream else Incomplete.DROP,
        scan=scan,
        cameras=cameras,
        pose=pose,
        labels=labels,
        imu_frame=imu_frame,
        calibration=_calibration(survey, viewed, [] if with_calibration else notes),
        imu=oxts.get('imu', ''),
        fix=oxts.get('fix', ''),
        velocity=oxts.get('velocity', ''),
        velocity_axes=guess_velocity_axes(survey, oxts, notes),
        camera_sets=sets,
    )
    if scan is not None:
        notes += cloud_notes(scan, survey.topics[scan.topic], point_labels=traits.point_labels)
    plan, offsets = _with_offsets(survey, plan)
    if offsets:
        stamps, _ = clocked(survey, plan).topics[topic].stamps()
        plan = replace(plan, name=_name(layout, int(stamps[0]), extract=extract))
        notes += offsets
    return Guess(plan, tuple(notes), _unreadable(survey, layout, scans=plan.scan is None))


def _with_offsets(survey: Survey, plan: Plan) -> tuple[Plan, list[str]]:
    """Set the offsets of clocks; scans and boxes in frames that move need that of the links, too.

    It is the offset of the plan's poses, which a plan may have for this alone.
    """
    links, alone = (None, False) if plan.pose is not None else _links(survey, plan)
    timed, notes = estimate_offsets(survey, replace(plan, pose=plan.pose or links))
    if links is not None and alone:
        notes.insert(0, f'poses: {links.topic}, which alone joins {links.world} to {links.body}')
    needs_links = timed.pose is not None and timed.pose.offset_s
    return (timed if needs_links or alone or links is None else replace(timed, pose=None)), notes


def _links(survey: Survey, plan: Plan) -> tuple[PosePlan | None, bool]:
    """Return the poses by which scans and boxes in frames that move are placed, None without such.

    Also whether they are needed: transforms and Odometry are links by themselves, a PoseStamped is
    one where a plan names it.
    """
    links = guess_pose(survey, [])
    joined, more = (
        len(moving_pairs(plan, survey, NamedFrames(survey, pose))) for pose in (None, links)
    )
    return (links if more else None), more > joined


class _Sensors(NamedTuple):
    """The parts of a plan that can be its reference; a plan has one of them at least."""

    scan: ScanPlan | None
    cameras: dict[int, CameraPlan]
    camera_sets: dict[str, CameraPlan]
    pose: PosePlan | None
    heading: Heading | None


def _find_sensors(
    survey: Survey, layout: Layout, notes: list[str], *, all_cameras: bool, with_calibration: bool
) -> _Sensors:
    """Return the sensors of a bag that a layout stores; see guess_plan."""
    cameras_of_bag = find_cameras(survey)
    scan = guess_scan(survey, cameras_of_bag, notes)
    heading = find_heading(survey.tree, None if scan is None else scan.frame, cameras_of_bag)
    if scan is not None and not survey.calibrations and not with_calibration:
        scan = face_forward(scan, survey.tree, heading, notes)
    rig = make_camera_rig(survey, cameras_of_bag, heading, notes)
    scan_frame = None if scan is None else scan.frame
    sets = guess_camera_sets(layout, rig, scan_frame, notes) if all_cameras else {}
    cameras = guess_cameras(layout, rig, scan_frame, notes) if not sets else {}
    streams = layout.traits.streams
    # Poses replace a missing fix.
    placed = Stream.OXTS in streams and not has_vehicle_fix(survey, scan)
    pose = guess_pose(survey, notes) if Stream.POSE in streams or placed else None
    return _Sensors(scan, cameras, sets, pose, heading)


def _imu_frame(
    survey: Survey, layout: Layout, sensors: _Sensors, oxts: Mapping[str, str], notes: list[str]
) -> str:
    """Return the frame of the GPS/IMU, else that of the poses; empty without."""
    name = guess_imu_frame(survey, oxts.get('imu', ''), sensors.scan, sensors.heading, notes)
    if name or oxts.get('imu') or sensors.pose is None or Stream.OXTS not in layout.traits.streams:
        return name
    return pose_body_frame(survey, sensors.scan, sensors.pose)


def _tolerance_s(stamps_ns: Int64Array) -> float:
    """Return how far samples may be from the frames of a reference, (N,) nanoseconds."""
    if len(stamps_ns) > 1:
        return default_tolerance_ns(stamps_ns) / NS_PER_S
    return _DEFAULT_TOLERANCE_S


def _calibration(survey: Survey, cameras: dict[int, CameraPlan], notes: list[str]) -> str:
    """Choose the calibration: the files in a bag written by to-bag, else the CameraInfos."""
    if survey.calibrations and cameras:
        return SOURCE
    if any(plan.info for plan in cameras.values()):
        return TF
    missing = 'camera_info' if cameras else 'camera'
    notes.append(f'missing: calibration (no {missing}); --calib FILE gives it')
    return NONE


def _describe_contents(survey: Survey, layout: Layout) -> str:
    """Describe the content of a bag that has no data that a layout requires."""
    names = [f'{topic.name} ({topic.msgtype})' for topic in survey.topics.values() if topic.count]
    reasons = [loss.text() for loss in _unreadable(survey, layout, scans=True)]
    reasons += [*survey.losses, *survey.notes]
    reason = f' ({reasons[0]})' if reasons else ''
    if not names:
        return f'the bag has no message{reason}'
    needed = 'no point cloud and no image'
    if Stream.POSE in layout.traits.streams:
        needed += ', and no poses either'
    more = f' and {len(names) - _MOST_SHOWN} more' if len(names) > _MOST_SHOWN else ''
    return f'the bag has {needed}; it has {", ".join(names[:_MOST_SHOWN])}{more}{reason}'


def _unreadable(survey: Survey, layout: Layout, *, scans: bool) -> tuple[Loss, ...]:
    """Return the topics of types that a layout supports of which no message can be read.

    Those that scans are made from in place of clouds are included if scans are missing.
    """
    used = [role for role in ROLES if role.stream in layout.traits.streams]
    msgtypes = {msgtype for role in used for msgtype in role.msgtypes}
    msgtypes |= set(SCAN.more_types) if scans else set()
    left_out = (
        loss for channel, loss in survey.left_out if channel.msgtype in msgtypes and loss.count
    )
    return (
        *(topic.undecoded() for topic in survey.unreadable(*msgtypes)),
        *left_out,
    )


def _reference(
    scan: ScanPlan | None, cameras: dict[int, CameraPlan], pose: PosePlan | None
) -> tuple[str, str]:
    if scan is not None:
        return Stream.SCAN.value, scan.topic
    if cameras:
        return f'image_{main_camera(cameras)}', cameras[main_camera(cameras)].topic
    if pose is None:
        raise UsageError('a plan needs a scan, a camera or poses')
    return Stream.POSE.value, pose.topic


def _name(layout: Layout, first_ns: int, *, extract: bool) -> str:
    date = format_stamp(first_ns)[: len('2011-09-26')].replace('-', '_')
    return layout.traits.default_name.format(date=date, kind='extract' if extract else 'sync')


# The topics of a bag that a plan does not use, each with a hint.

_PACKETS = 'raw packets: play them through the driver, and record its PointCloud2'
_RADAR = 'KITTI has no radar'
_BOXES_2D = '2D boxes: labels need a Detection2DArray'
_LABELS_2D = '2D boxes: for labels of layouts object and tracking: name the topic in labels.topic'
_JOINED_2D = '2D boxes: name the topic in labels.boxes_2d'
_VIDEO = 'video of an old codec: record Image or CompressedImage, or decode it to them'
_LIVOX = 'scans: name the topic in scan.topic, with scan.from: livox'
_MARKERS = 'drawings: cubes of a MarkerArray are boxes, if labels.topic names it'
_NO_CUBES = 'drawings, without a cube that could be a box'
_NO_CALIBRATION = 'boxes: labels need a calibration, which --calib gives'
_NO_CAMERA = 'boxes: labels are of a camera with a camera_info, which the plan has not'
_MAP = 'KITTI has no maps'
_STATE = 'KITTI has no place for it'

_HINTS = {
    **{msgtype.replace('/msg/', '/'): role.hint for role in ROLES for msgtype in role.msgtypes},
    'sensor_msgs/PointCloud': 'scans of an old type: convert them to PointCloud2',
    'sensor_msgs/LaserScan': 'one ring: name the topic in scan.topic, with scan.from: laser_scan',
    'sensor_msgs/MultiEchoLaserScan': 'one ring: record a LaserScan of it',
    'sensor_msgs/Range': 'distances without a direction',
    'livox_ros_driver/CustomMsg': _LIVOX,
    'livox_ros_driver2/CustomMsg': _LIVOX,
    'livox_interfaces/CustomMsg': _LIVOX,
    'velodyne_msgs/VelodyneScan': ('scans: name the topic in scan.topic, with scan.from: velodyne'),
    'ouster_msgs/PacketMsg': _PACKETS,
    'ouster_ros/PacketMsg': _PACKETS,
    'ouster_sensor_msgs/PacketMsg': _PACKETS,
    'hesai_ros_driver/UdpFrame': _PACKETS,
    'pandar_msgs/PandarScan': _PACKETS,
    'nebula_msgs/NebulaPackets': _PACKETS,
    'rslidar_msg/RslidarPacket': _PACKETS,
    'rslidar_msgs/rslidarScan': _PACKETS,
    'radar_msgs/RadarScan': _RADAR,
    'radar_msgs/RadarTracks': _RADAR,
    'radar_msgs/RadarReturn': _RADAR,
    'ars40x_msgs/ObjectList': _RADAR,
    'vision_msgs/Detection3D': 'one 3D box: labels need a Detection3DArray',
    'vision_msgs/Detection2D': _BOXES_2D,
    'autoware_perception_msgs/PredictedObjects': '3D boxes: record TrackedObjects for labels',
    'autoware_auto_perception_msgs/DetectedObjects': '3D boxes of an old type of Autoware',
    'autoware_auto_perception_msgs/TrackedObjects': '3D boxes of an old type of Autoware',
    'visualization_msgs/MarkerArray': _MARKERS,
    'visualization_msgs/Marker': 'a drawing: labels need the cubes of a MarkerArray',
    'geometry_msgs/PoseArray': 'poses without sizes: labels need boxes',
    'geometry_msgs/PoseWithCovarianceStamped': 'poses: record Odometry or PoseStamped of them',
    'geometry_msgs/TwistWithCovarianceStamped': 'velocities: record a TwistStamped of them',
    'gps_msgs/GPSFix': 'positions: record a NavSatFix of them',
    'gps_common/GPSFix': 'positions: record a NavSatFix of them',
    'nmea_msgs/Sentence': 'positions: record a NavSatFix of them',
    'theora_image_transport/Packet': _VIDEO,
    'nav_msgs/OccupancyGrid': _MAP,
    'nav_msgs/GridCells': _MAP,
    'grid_map_msgs/GridMap': _MAP,
    'octomap_msgs/Octomap': _MAP,
    'sensor_msgs/JointState': _STATE,
    'sensor_msgs/Joy': _STATE,
    'sensor_msgs/BatteryState': _STATE,
    'sensor_msgs/MagneticField': _STATE,
    'sensor_msgs/FluidPressure': _STATE,
    'sensor_msgs/Temperature': _STATE,
    'sensor_msgs/TimeReference': _STATE,
    'geometry_msgs/Twist': _STATE,
    'ackermann_msgs/AckermannDriveStamped': _STATE,
    'std_msgs/String': _STATE,
}
"""By type: how to use messages that a plan does not use."""

_DEPTH_HINT = 'depth images: name the topic in scan.topic, with scan.from: depth'
_ANY_HINT = 'no stream of KITTI is made of this type'

_NOT_READ = 'its messages cannot be read, for the reason in another note'
"""The hint where the survey notes the reason."""

_BACKGROUND = frozenset(
    {
        'rcl_interfaces/Log',
        'rosgraph_msgs/Log',
        'rcl_interfaces/ParameterEvent',
        'diagnostic_msgs/DiagnosticArray',
        'diagnostic_msgs/DiagnosticStatus',
        'rosgraph_msgs/Clock',
        'statistics_msgs/MetricsMessage',
        'bond/Status',
        'dynamic_reconfigure/Config',
        'dynamic_reconfigure/ConfigDescription',
        'lifecycle_msgs/TransitionEvent',
        'rosbag2_interfaces/WriteSplitEvent',
        'rosbag2_interfaces/MessagesLostEvent',
    }
)
"""Types that nodes publish about themselves."""

_DEPTHS = frozenset({'16UC1', '32FC1'})
_DEPTH_NAME = re.compile(r'depth|disparity', re.IGNORECASE)
_MOST_TOPICS = 6
_NAMED = re.compile(r'/[\w/~.-]+')


@dataclass(frozen=True)
class Unused:
    """Topics of one type that a plan does not use.

    Attributes:
        msgtype: Their type, such as sensor_msgs/LaserScan; of topics with one hint their types.
        counts: Number of messages by topic.
        hint: How to use them; empty for what nodes publish about themselves.
    """

    msgtype: str
    counts: tuple[tuple[str, int], ...]
    hint: str

    def note(self) -> str:
        """Return one line."""
        topics = some_of(
            [f'{one_line(name)} ({count})' for name, count in self.counts], _MOST_TOPICS
        )
        return f'not used: {topics}, {one_line(self.msgtype)}; {self.hint}'


def unused_topics(survey: Survey, plan: Plan, named: Iterable[str] = ()) -> list[Unused]:
    """Return the topics with messages that a plan does not use, by hint and type.

    Args:
        survey: The survey of the bags.
        plan: Every topic that it names is used, and so are transforms, and Odometry that is a link
            between frames.
        named: Topics to leave out.
    """
    left_out = {*named, *(use.topic for use in topic_uses(plan))} | _planned_links(survey, plan)
    if RECORDING in survey.topics:
        left_out |= set(own_topics()) | {name for name in survey.topics if _is_source(name)}
    pixels = _pixel_frames(survey, plan)
    groups: dict[tuple[str, str], list[tuple[str, int]]] = defaultdict(list)
    for topic in sorted(survey.topics.values(), key=lambda surveyed: surveyed.name):
        if topic.count and topic.name not in left_out and topic.msgtype not in types.TF_TYPES:
            hint = _hint(topic, survey, plan, pixels)
            groups[_short(topic.msgtype), hint].append((topic.name, topic.count))
    for channel, loss in survey.left_out:
        if loss.count and channel.topic not in left_out:
            kind = _short(channel.msgtype)
            hint = _HINTS.get(kind, _NOT_READ)
            groups[kind, hint].append((channel.topic, loss.count))
    return [Unused(kind, tuple(counts), hint) for (kind, hint), counts in groups.items()]


def unused_notes(survey: Survey, plan: Plan, notes: Sequence[str] = ()) -> list[str]:
    """Return notes on the topics that a plan does not use.

    Args:
        survey: The survey of the bags.
        plan: The plan.
        notes: Earlier notes; topics that these name as passed over are left out.
    """
    named = [
        name for note in notes if note.startswith('passed over') for name in _NAMED.findall(note)
    ]
    groups = unused_topics(survey, plan, named)
    background = [pair for group in groups if not group.hint for pair in group.counts]
    lines = [group.note() for group in _by_hint(groups) if group.hint]
    if background:
        topics = some_of(
            [f'{one_line(name)} ({count})' for name, count in background], _MOST_TOPICS
        )
        lines.append(f'not used: {topics}, which nodes publish about themselves')
    return lines


def _by_hint(unused: Iterable[Unused]) -> list[Unused]:
    """Join topics with one hint, for which their types are listed."""
    groups: dict[str, list[Unused]] = defaultdict(list)
    for group in unused:
        groups[group.hint].append(group)
    return [
        Unused(
            ', '.join(group.msgtype for group in same),
            tuple(count for group in same for count in group.counts),
            hint,
        )
        for hint, same in groups.items()
    ]


def lost_description(survey: Survey) -> list[str]:
    """Return a note on a bag of to-bag that no longer has the description of its recording."""
    sources = sorted(filter(_is_source, survey.topics))
    if RECORDING in survey.topics or not sources:
        return []
    note = (
        f'{some_of(sources)}, but no {RECORDING}: names and numbers of the files are unknown, and'
        f' frames are numbered from 0'
    )
    return [note]


def _planned_links(survey: Survey, plan: Plan) -> set[str]:
    try:
        return link_topics(plan, survey)
    except UsageError:  # it stops the conversion, which reports it
        return set()


def _hint(topic: TopicSurvey, survey: Survey, plan: Plan, pixels: PixelFrames | None) -> str:
    kind = _short(topic.msgtype)
    if kind in _BACKGROUND:
        return ''
    if topic.msgtype in LABELS.every_type and not (plan.cameras or plan.camera_sets):
        return _NO_CAMERA
    if topic.msgtype in LABELS.every_type and plan.calibration == NONE:
        return _NO_CALIBRATION
    if topic.msgtype == types.DETECTIONS_2D:
        return _hint_2d(topic, survey, plan, pixels)
    if topic.msgtype == types.MARKERS and not has_cubes(topic):
        return _NO_CUBES
    return _DEPTH_HINT if _is_depth(topic) else _HINTS.get(kind, _ANY_HINT)


def _label_camera(plan: Plan) -> int:
    """Return the number of the labels' camera, or of the main one."""
    if plan.labels is not None:
        return plan.labels.camera
    return main_camera(plan.cameras) if plan.cameras else -1


def _pixel_frames(survey: Survey, plan: Plan) -> PixelFrames | None:
    """Return the frames of the labels' camera, None where it is not planned."""
    camera = plan.cameras.get(_label_camera(plan))
    try:
        return None if camera is None else PixelFrames(survey, survey.tree, camera)
    except UsageError:  # as in _links
        return None


def _hint_2d(topic: TopicSurvey, survey: Survey, plan: Plan, pixels: PixelFrames | None) -> str:
    labels = plan.labels
    if pixels is not None and topic.frame_id not in pixels:
        return (
            f'2D boxes whose frame is {one_line(topic.frame_id) or "empty"}; those of camera'
            f' {_label_camera(plan)} have {some_of(pixels.every, _MOST_TOPICS)}'
        )
    labelled = None if labels is None else survey.topics.get(labels.topic)
    solid = labelled is not None and labelled.msgtype != types.DETECTIONS_2D
    return _JOINED_2D if solid else _LABELS_2D


def _is_depth(topic: TopicSurvey) -> bool:
    if topic.msgtype == types.IMAGE:
        encodings = {getattr(message, 'encoding', '') for message in topic.samples}
        return bool(encodings & _DEPTHS) or bool(_DEPTH_NAME.search(topic.name))
    return topic.msgtype == types.COMPRESSED and bool(_DEPTH_NAME.search(topic.name))


def _short(msgtype: str) -> str:
    return msgtype.replace('/msg/', '/')


def _is_source(name: str) -> bool:
    return name.startswith(RECORDING.rpartition('/')[0] + '/')
