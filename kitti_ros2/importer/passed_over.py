# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a bag that a plan does not use, and what could be done with each."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ..messages.source import RECORDING
from ..messages.topics import own_topics
from ..model import msgtypes as types
from ..model.errors import UsageError
from ..model.text import one_line, some_of
from .guess_cameras import main_camera
from .guess_labels import has_cubes
from .pixel_frames import PixelFrames
from .plan import NONE
from .pose_ends import link_topics
from .survey_types import SOLID

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey

_PACKETS = 'raw packets: play them through the driver, and record its PointCloud2'
_RADAR = 'KITTI has no radar'
_OBJECTS = (
    '3D boxes: for labels of the layouts object, raw and tracking: name the topic in labels.topic'
)
_BOXES_2D = '2D boxes: labels need a Detection2DArray'
_LABELS_2D = '2D boxes: for labels of layouts object and tracking: name the topic in labels.topic'
_JOINED_2D = '2D boxes: name the topic in labels.boxes_2d'
_POSES = 'poses: for the layouts odometry, raw and tracking: name the topic in pose.topic'
_UNIT = 'for oxts of the layouts raw and tracking: name the topic in imu, fix or velocity'
_VIDEO = 'video: record Image or CompressedImage, or decode it to them'
_LIVOX = 'scans: name the topic in scan.topic, with scan.from: livox'
_MARKERS = 'drawings: cubes of a MarkerArray are boxes, if labels.topic names it'
_NO_CUBES = 'drawings, without a cube that could be a box'
_NO_CALIBRATION = 'boxes: labels need a calibration, which --calib gives'
_NO_CAMERA = 'boxes: labels are of a camera with a camera_info, which the plan has not'
_MAP = 'KITTI has no maps'
_STATE = 'KITTI has no place for it'

_ADVICE = {
    'sensor_msgs/Image': 'images: name the topic in cameras',
    'sensor_msgs/CompressedImage': 'images: name the topic in cameras',
    'sensor_msgs/CameraInfo': 'calibration of images that are not used',
    'sensor_msgs/PointCloud2': 'scans: name the topic in scan.topic',
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
    'vision_msgs/Detection3DArray': _OBJECTS,
    'vision_msgs/Detection3D': 'one 3D box: labels need a Detection3DArray',
    'vision_msgs/Detection2D': _BOXES_2D,
    'autoware_perception_msgs/DetectedObjects': _OBJECTS,
    'autoware_perception_msgs/TrackedObjects': _OBJECTS,
    'autoware_perception_msgs/PredictedObjects': '3D boxes: record TrackedObjects for labels',
    'autoware_auto_perception_msgs/DetectedObjects': '3D boxes of an old type of Autoware',
    'autoware_auto_perception_msgs/TrackedObjects': '3D boxes of an old type of Autoware',
    'visualization_msgs/MarkerArray': _MARKERS,
    'visualization_msgs/Marker': 'a drawing: labels need the cubes of a MarkerArray',
    'geometry_msgs/PoseArray': 'poses without sizes: labels need boxes',
    'nav_msgs/Odometry': _POSES,
    'nav_msgs/Path': _POSES,
    'geometry_msgs/PoseStamped': _POSES,
    'geometry_msgs/PoseWithCovarianceStamped': 'poses: record Odometry or PoseStamped of them',
    'sensor_msgs/Imu': _UNIT,
    'sensor_msgs/NavSatFix': _UNIT,
    'geometry_msgs/TwistStamped': _UNIT,
    'geometry_msgs/TwistWithCovarianceStamped': 'velocities: record a TwistStamped of them',
    'gps_msgs/GPSFix': 'positions: record a NavSatFix of them',
    'gps_common/GPSFix': 'positions: record a NavSatFix of them',
    'nmea_msgs/Sentence': 'positions: record a NavSatFix of them',
    'theora_image_transport/Packet': _VIDEO,
    'ffmpeg_image_transport_msgs/FFMPEGPacket': _VIDEO,
    'foxglove_msgs/CompressedVideo': _VIDEO,
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
"""What can be done with messages of a type that a plan does not use."""

_DEPTH_ADVICE = 'depth images: name the topic in scan.topic, with scan.from: depth'
_ANY_ADVICE = 'no stream of KITTI is made of this type'

_NOT_READ = 'its messages cannot be read, for the reason in another note'
"""Advice where the survey notes the reason."""

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

_BOXES = SOLID | {types.DETECTIONS_2D}
_DEPTHS = frozenset({'16UC1', '32FC1'})
_DEPTH_NAME = re.compile(r'depth|disparity', re.IGNORECASE)
_MOST_TOPICS = 6
_NAMED = re.compile(r'/[\w/~.-]+')


@dataclass(frozen=True)
class Unused:
    """Topics of one type that a plan does not use.

    Attributes:
        msgtype: Their type, such as sensor_msgs/LaserScan; of topics with one advice their types.
        counts: Number of messages by topic.
        advice: What can be done with them; empty for what nodes publish about themselves.
    """

    msgtype: str
    counts: tuple[tuple[str, int], ...]
    advice: str

    def note(self) -> str:
        """Return one line."""
        topics = some_of([f'{one_line(name)} ({count})' for name, count in self.counts], _MOST_TOPICS)
        return f'not used: {topics}, {one_line(self.msgtype)}; {self.advice}'


def unused_topics(survey: Survey, plan: Plan, named: Iterable[str] = ()) -> list[Unused]:
    """Return the topics with messages that a plan does not use, by advice and type.

    Args:
        survey: Of the bags.
        plan: Every topic that it names is used, and so are transforms, and Odometry that is a link
            between frames.
        named: Topics to leave out.
    """
    left_out = set(named) | set(_texts(asdict(plan))) | _planned_links(survey, plan)
    if RECORDING in survey.topics:
        left_out |= set(own_topics()) | {name for name in survey.topics if _is_source(name)}
    pixels = _pixel_frames(survey, plan)
    groups: dict[tuple[str, str], list[tuple[str, int]]] = defaultdict(list)
    for topic in sorted(survey.topics.values(), key=lambda each: each.name):
        if topic.count and topic.name not in left_out and topic.msgtype not in types.TF_TYPES:
            advice = _advice(topic, survey, plan, pixels)
            groups[_short(topic.msgtype), advice].append((topic.name, topic.count))
    for channel, loss in survey.left_out:
        if loss.count and channel.topic not in left_out:
            kind = _short(channel.msgtype)
            advice = _ADVICE.get(kind, _NOT_READ)
            groups[kind, advice].append((channel.topic, loss.count))
    return [Unused(kind, tuple(counts), advice) for (kind, advice), counts in groups.items()]


def passed_over(survey: Survey, plan: Plan, notes: Sequence[str] = ()) -> list[str]:
    """Return notes on the topics that a plan does not use.

    Args:
        survey: Of the bags.
        plan: The plan.
        notes: Earlier notes; the topics that one of these says are passed over are left out.
    """
    named = [
        name for note in notes if note.startswith('passed over') for name in _NAMED.findall(note)
    ]
    found = unused_topics(survey, plan, named)
    background = [each for group in found if not group.advice for each in group.counts]
    told = [group.note() for group in _by_advice(found) if group.advice]
    if background:
        topics = some_of([f'{one_line(name)} ({count})' for name, count in background], _MOST_TOPICS)
        told.append(f'not used: {topics}, which nodes publish about themselves')
    return told


def _by_advice(found: Iterable[Unused]) -> list[Unused]:
    """Join topics with one advice, for which their types are listed."""
    groups: dict[str, list[Unused]] = defaultdict(list)
    for each in found:
        groups[each.advice].append(each)
    return [
        Unused(
            ', '.join(each.msgtype for each in same),
            tuple(count for each in same for count in each.counts),
            advice,
        )
        for advice, same in groups.items()
    ]


def _planned_links(survey: Survey, plan: Plan) -> set[str]:
    try:
        return link_topics(plan, survey)
    except UsageError:  # it stops the conversion, which reports it
        return set()


def _texts(value: Any) -> Iterator[str]:  # noqa: ANN401 - of dataclasses
    """Yield all texts within a value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, (list, tuple)):
        for each in value:
            yield from _texts(each)


def _advice(topic: TopicSurvey, survey: Survey, plan: Plan, pixels: PixelFrames | None) -> str:
    kind = _short(topic.msgtype)
    if kind in _BACKGROUND:
        return ''
    if topic.msgtype in _BOXES and not (plan.cameras or plan.camera_sets):
        return _NO_CAMERA
    if topic.msgtype in _BOXES and plan.calibration == NONE:
        return _NO_CALIBRATION
    if topic.msgtype == types.DETECTIONS_2D:
        return _advice_2d(topic, survey, plan, pixels)
    if topic.msgtype == types.MARKERS and not has_cubes(topic):
        return _NO_CUBES
    return _DEPTH_ADVICE if _is_depth(topic) else _ADVICE.get(kind, _ANY_ADVICE)


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


def _advice_2d(topic: TopicSurvey, survey: Survey, plan: Plan, pixels: PixelFrames | None) -> str:
    labels = plan.labels
    if pixels is not None and topic.frame not in pixels:
        return (
            f'2D boxes whose frame is {one_line(topic.frame) or "empty"}; those of camera'
            f' {_label_camera(plan)} have {some_of(pixels.every, _MOST_TOPICS)}'
        )
    labelled = None if labels is None else survey.topics.get(labels.topic)
    solid = labelled is not None and labelled.msgtype != types.DETECTIONS_2D
    return _JOINED_2D if solid else _LABELS_2D


def _is_depth(topic: TopicSurvey) -> bool:
    if topic.msgtype == types.IMAGE:
        encodings = {getattr(look, 'encoding', '') for look in topic.looks}
        return bool(encodings & _DEPTHS) or bool(_DEPTH_NAME.search(topic.name))
    return topic.msgtype == types.COMPRESSED and bool(_DEPTH_NAME.search(topic.name))


def _short(msgtype: str) -> str:
    return msgtype.replace('/msg/', '/')


def _is_source(name: str) -> bool:
    return name.startswith(RECORDING.rpartition('/')[0] + '/')
