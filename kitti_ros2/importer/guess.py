# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of the KITTI stream of each topic: by type, name, frame and neighbours."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..messages.clouds import guess_intensity_scale
from ..messages.source import LABEL_LINES, POINTS
from ..messages.topics import own_topics, prediction_topics
from ..model import msgtypes as types
from ..model.errors import MissingDataError, UsageError
from ..model.stamps import NS_PER_S, format_stamp
from ..model.streams import Stream
from ..rig.tf_tree import FrameTree
from .guess_cameras import guess_cameras, keeps_distortion
from .plan import NONE, SOURCE, TF, CameraPlan, Incomplete, LabelPlan, Plan, PosePlan, ScanPlan
from .report import undecoded
from .sync import default_tolerance_ns

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ..model.layouts import Layout
    from ..model.losses import Loss
    from .survey import Survey, TopicSurvey

_LIDAR = re.compile(r'velo|lidar|laser|ouster|hesai|rslidar|livox|points_raw', re.IGNORECASE)
_TRUTH = re.compile(r'ground_truth|groundtruth|\bgt\b', re.IGNORECASE)
_BODIES = ('base_link', 'base_footprint')
_DEFAULT_TOLERANCE_S = 0.05
_SHOWN = 8


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


def guess_plan(survey: Survey, layout: Layout, path: Path) -> Guess:
    """Make the most complete plan for a bag.

    Raises:
        MissingDataError: It contains no data that the layout requires.
    """
    guesser, traits = _Guesser(survey), layout.traits
    scan, cameras = guesser.scan(), guess_cameras(survey, layout, guesser.notes)
    pose = guesser.pose() if Stream.POSE in traits.streams else None
    if scan is None and not cameras and pose is None:
        raise MissingDataError(f'{path}: {_nothing(survey, layout)}')
    reference, topic = _reference(scan, cameras, pose)
    stamps, _ = survey.topics[topic].stamps()
    tolerance = default_tolerance_ns(stamps) / NS_PER_S if len(stamps) > 1 else _DEFAULT_TOLERANCE_S
    ego = guesser.ego() if Stream.OXTS in traits.streams else {}
    imu_frame = guesser.imu_frame(scan)
    plan = Plan(
        layout=layout,
        name=_name(layout, int(stamps[0]), extract=keeps_distortion(survey, cameras)),
        reference=reference,
        tolerance_s=tolerance,
        incomplete=Incomplete.KEEP if traits.stamps_per_stream else Incomplete.DROP,
        scan=scan,
        cameras=cameras,
        pose=pose,
        labels=guesser.labels(cameras) if Stream.LABELS in traits.streams else None,
        imu_frame=imu_frame,
        calibration=guesser.calibration(cameras),
        **ego,
    )
    return Guess(plan, tuple(guesser.notes), _unreadable(survey, layout))


def guess_pose(survey: Survey) -> PosePlan | None:
    """Choose poses: Odometry, PoseStamped, Path, then a moving link; ground truth first."""
    return _Guesser(survey).pose()


class _Guesser:
    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self.notes: list[str] = []

    def scan(self) -> ScanPlan | None:
        """Choose the lidar: KITTI's own points, by name, with intensity, with most points."""
        clouds = [each for each in self._survey.of_type(types.CLOUD) if _with_points(each)]
        if not clouds:
            self.notes.append('missing: scans (no PointCloud2 with x, y and z)')
            return None
        best = max(clouds, key=_lidar_rank)
        self._pass_over('scans', best, clouds)
        if best.frame.endswith('optical_frame'):
            self.notes.append(
                f'{best.name} is in {best.frame}, z forward; KITTI has x forward: set scan.frame'
                f' to such a frame of the static tree'
            )
        return ScanPlan(best.name, best.frame, guess_intensity_scale(best.looks))

    def ego(self) -> dict[str, str]:
        """Choose the topics of the GPS/IMU unit."""
        found: dict[str, str] = {}
        for key, msgtype, avoid in (
            ('imu', types.IMU, 'raw'),
            ('fix', types.FIX, 'raw'),
            ('velocity', types.TWIST, 'cmd'),
        ):
            topics = self._survey.of_type(msgtype)
            plain = [each for each in topics if avoid not in each.name] or topics
            if plain:
                best = max(plain, key=lambda each: each.count)
                self._pass_over(key, best, topics)
                found[key] = best.name
        if 'fix' not in found:
            self.notes.append('missing: fix (NavSatFix), so oxts is left out')
            return {}
        for key, msgtype in (('imu', 'Imu'), ('velocity', 'TwistStamped')):
            if key not in found:
                self.notes.append(f'missing: {key} ({msgtype}); its columns of oxts are 0')
        return found

    def imu_frame(self, scan: ScanPlan | None) -> str:
        """Return the frame of the Imu if static transforms connect it to the scans'."""
        frames = [each.frame for each in self._survey.of_type(types.IMU)]
        if not frames or scan is None:
            return ''
        tree = FrameTree(self._survey.static, self._survey.moving)
        for frame in frames:
            if tree.find(scan.frame, frame) is not None:
                return frame
        self.notes.append(
            f'missing: a static transform from {frames[0]} to {scan.frame}; the imu frame is'
            f' nominal until imu_frame names a frame that is joined'
        )
        return ''

    def pose(self) -> PosePlan | None:
        """See guess_pose."""
        for msgtype in (types.ODOMETRY, types.POSE, types.PATH):
            topics = self._survey.of_type(msgtype)
            if topics:
                best = max(topics, key=lambda each: (bool(_TRUTH.search(each.name)), each.count))
                self._pass_over('poses', best, topics)
                look = best.looks[0] if best.looks else None
                body = str(getattr(look, 'child_frame_id', '')).lstrip('/')
                if best.name in own_topics():  # of base_link, also if its tree names it otherwise
                    body = ''
                return PosePlan(best.name, body or self._body(), best.frame)
        tf = [each for each in self._survey.of_type(*types.TF_TYPES) if 'static' not in each.name]
        links = [link for link in self._survey.moving if link[1] in _BODIES]
        if tf and links:
            return PosePlan(tf[0].name, links[0][1], links[0][0])
        self.notes.append('missing: poses (no Odometry, PoseStamped, Path or moving base_link)')
        return None

    def _body(self) -> str:
        known = {name for parent, child, _ in self._survey.static for name in (parent, child)}
        return next((name for name in _BODIES if name in known), _BODIES[0])

    def labels(self, cameras: dict[int, CameraPlan]) -> LabelPlan | None:
        """Choose labels: detections, objects of Autoware, then markers.

        In a bag written by to-bag, markers have the classes of KITTI, and objects have not.
        """
        own = self._survey.topics.get(LABEL_LINES)
        if own is not None and own.count and self._survey.calibrations:
            return LabelPlan(own.name, _main(cameras)) if cameras else None
        detections = self._of_labels(types.DETECTIONS_3D)
        objects = self._of_labels(types.TRACKED_OBJECTS) or self._of_labels(types.DETECTED_OBJECTS)
        markers = [each for each in self._of_labels(types.MARKERS) if _has_cubes(each)]
        topics = detections or (markers if self._survey.calibrations else objects)
        topics = topics or objects or markers
        if not topics or not cameras:
            self.notes.append(
                'missing: labels (no Detection3DArray, TrackedObjects or DetectedObjects, no cubes'
                ' in a MarkerArray)'
            )
            return None
        best = max(topics, key=lambda each: (bool(_TRUTH.search(each.name)), each.count))
        self._pass_over('labels', best, topics)
        return LabelPlan(best.name, _main(cameras))

    def _of_labels(self, msgtype: str) -> list[TopicSurvey]:
        """Return the topics of a type without those of predictions by to-bag."""
        found = self._survey.of_type(msgtype)
        return [each for each in found if each.name not in prediction_topics()]

    def calibration(self, cameras: dict[int, CameraPlan]) -> str:
        """Choose the calibration: the files in a bag written by to-bag, else the CameraInfos."""
        if self._survey.calibrations and cameras:
            return SOURCE
        if any(plan.info for plan in cameras.values()):
            return TF
        lacking = 'camera_info' if cameras else 'camera'
        self.notes.append(f'missing: calibration (no {lacking}); --calib FILE gives it')
        return NONE

    def _pass_over(self, what: str, best: TopicSurvey, topics: Sequence[TopicSurvey]) -> None:
        others = ', '.join(each.name for each in topics if each is not best)
        if others:
            self.notes.append(f'passed over for {what}: {others}')


def _nothing(survey: Survey, layout: Layout) -> str:
    """Describe the content of a bag that has no data that a layout requires."""
    there = [f'{each.name} ({each.msgtype})' for each in survey.topics.values() if each.count]
    reasons = [loss.text() for loss in _unreadable(survey, layout)]
    reasons += [*survey.losses, *survey.notes]
    reason = f' ({reasons[0]})' if reasons else ''
    if not there:
        return f'the bag has no message{reason}'
    needed = 'no point cloud and no image'
    if Stream.POSE in layout.traits.streams:
        needed += ', and no poses either'
    more = f' and {len(there) - _SHOWN} more' if len(there) > _SHOWN else ''
    return f'the bag has {needed}; it has {", ".join(there[:_SHOWN])}{more}{reason}'


def _unreadable(survey: Survey, layout: Layout) -> tuple[Loss, ...]:
    """Return the topics of types that a layout supports of which no message can be read."""
    wanted = {types.CLOUD, types.IMAGE, types.COMPRESSED, types.CAMERA_INFO}
    if Stream.POSE in layout.traits.streams:
        wanted |= {types.ODOMETRY, types.POSE, types.PATH}
    if Stream.LABELS in layout.traits.streams:
        wanted |= {types.DETECTIONS_3D, types.TRACKED_OBJECTS, types.DETECTED_OBJECTS}
        wanted |= {types.MARKERS}
    if Stream.OXTS in layout.traits.streams:
        wanted |= {types.IMU, types.FIX, types.TWIST}
    left_out = (
        loss for channel, loss in survey.left_out if channel.msgtype in wanted and loss.count
    )
    return (
        *(undecoded(topic) for topic in survey.unreadable(*wanted)),
        *left_out,
    )


def _with_points(topic: TopicSurvey) -> Any:  # noqa: ANN401 - of the bag's types
    """Return the first sampled message with x, y and z, None where none has them."""
    for look in topic.looks:
        if {'x', 'y', 'z'} <= {field.name for field in look.fields}:
            return look
    return None


def _lidar_rank(topic: TopicSurvey) -> tuple[bool, bool, bool, int, int]:
    first = _with_points(topic)
    named = bool(_LIDAR.search(topic.name) or _LIDAR.search(topic.frame))
    bright = any(field.name == 'intensity' for field in first.fields)
    return topic.name == POINTS, named, bright, first.width * first.height, topic.count


def _main(cameras: dict[int, CameraPlan]) -> int:
    """Return the left colour camera, that of KITTI's labels, or else the first."""
    return 2 if 2 in cameras else min(cameras)


def _has_cubes(topic: TopicSurvey) -> bool:
    cube = 1  # visualization_msgs/Marker.CUBE
    return any(marker.type == cube for look in topic.looks for marker in look.markers)


def _reference(
    scan: ScanPlan | None, cameras: dict[int, CameraPlan], pose: PosePlan | None
) -> tuple[str, str]:
    if scan is not None:
        return Stream.SCAN.value, scan.topic
    if cameras:
        return f'image_{_main(cameras)}', cameras[_main(cameras)].topic
    if pose is None:
        raise UsageError('a plan needs a scan, a camera or poses')
    return Stream.POSE.value, pose.topic


def _name(layout: Layout, first_ns: int, *, extract: bool) -> str:
    date = format_stamp(first_ns)[: len('2011-09-26')].replace('-', '_')
    return layout.traits.default_name.format(date=date, kind='extract' if extract else 'sync')
