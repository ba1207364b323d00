# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a plan, applied to samples; and its changes within a recording."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.kitti_recording import rect_from_imu
from ..messages.camera_info import camera_model
from ..messages.tf_tree import differ
from ..model import bag_formats as types
from ..model.errors import KittiRos2Error, Loss, format_numbers
from ..model.geometry import NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU, Transform
from ..model.samples import NONE, rect_from_velo
from ..model.streams import Stream, format_stamp
from .bag_calibration import PlannedRig, make_calibrations, rect_in_frame, swapped_sizes
from .bag_cameras import ImageConversion
from .bag_labels import BoxConversion
from .bag_scans import ScanConversion
from .plan import TF, VelocityAxes
from .survey import topic_of
from .tf_frames import LINK_T_OPTICAL, MovingBase, child_of, frame_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ..messages.moving_tree import MovingTree
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration
    from .kitti_frames import Frames
    from .plan import Plan
    from .survey import Survey, TopicSurvey


# A plan's calibration, applied to samples: points, images, boxes and poses.

_REPORTED_LEVER_M = 0.05


class SensorRig:
    """The sensors of a plan in KITTI's frames.

    Attributes:
        calibrations: The calibrations of all frames.
        scans: Converts clouds.
        images: Converts images.
        labels: Converts boxes.
        imu_t_topic: By topic of the GPS/IMU: its frame in KITTI's imu frame.
    """

    def __init__(self, plan: Plan, survey: Survey, moving: MovingTree | None = None) -> None:
        """Make the calibration.

        Args:
            plan: The plan.
            survey: The survey of the bags.
            moving: The links over time, where clouds or boxes are in frames that move.

        Raises:
            UsageError: The plan names a missing topic.
            MissingDataError: Required frames are not connected by static transforms.
            BadFileError: A calibration file cannot be read.
        """
        rig = PlannedRig(plan, survey)
        scan_frame = '' if plan.scan is None else plan.scan.frame
        self._plan = plan = rig.plan
        self._rig = rig
        self._tree = rig.tree
        self._own_camera_0 = survey.kitti_360_camera
        self.calibrations = make_calibrations(rig)
        base = self._moving_base(survey, scan_frame, moving)
        self.scans = ScanConversion(rig, base)
        self.images = ImageConversion(plan, survey, rig.models)
        self._swapped = swapped_sizes(rig)
        self.imu_t_topic = self._imu_transforms(survey)
        self._lever_arm = list(self._lever_arm_notes(survey))
        of_boxes = None if base is None else _of_boxes(base, plan, survey, self.scans)
        self.labels = BoxConversion(rig, self.calibrations, self.images, of_boxes)

    def _moving_base(
        self, survey: Survey, scan_frame: str, moving: MovingTree | None
    ) -> MovingBase | None:
        """Return the frame that boxes are brought to: that of the scans, else that of a camera."""
        if self._plan.scan is not None:
            velo_t_frame = self._tree.transform(self._plan.scan.frame, scan_frame)
            return MovingBase(scan_frame, velo_t_frame, moving)
        if not self._rig.models:
            return None
        camera = self._plan.cameras[min(self._rig.models)]
        frame_id = frame_of(camera, survey)
        velo_t_frame = NOMINAL_CAM0_T_VELO.inverse()
        if camera.forward:
            velo_t_frame = velo_t_frame @ LINK_T_OPTICAL.inverse()
        return MovingBase(frame_id, velo_t_frame, moving)

    def _imu_transforms(self, survey: Survey) -> dict[str, Transform]:
        imu_t_topic = {}
        target = self._plan.imu_frame
        receiver = {self._plan.fix}
        if self._plan.velocity_axes is VelocityAxes.ENU:
            receiver.add(self._plan.velocity)
        for topic in {self._plan.imu, self._plan.velocity} - receiver:
            frame_id = _body_of(topic_of(survey, topic)) if topic else ''
            if frame_id and target and frame_id != target:
                imu_t_topic[topic] = self._tree.transform(target, frame_id)
        for topic in receiver:
            antenna = self._imu_t_frame(topic_of(survey, topic).frame_id if topic else '')
            if antenna is not None:
                imu_t_topic[topic] = antenna
        return imu_t_topic

    def _imu_t_frame(self, frame_id: str) -> Transform | None:
        """Return imu_T_frame, None where static transforms do not connect them."""
        target = self._plan.imu_frame
        if not (frame_id and target):
            return None
        connected = frame_id == target or {frame_id, target} <= self._tree.frames
        return self._tree.find(target, frame_id) if connected else None

    def body_t_rect(self) -> Transform:
        """Return body_T_rect: the rectified camera 0 in the body frame of the plan's poses.

        Without a camera it is at the nominal position of KITTI's camera on the scanner; without a
        scanner too, at the body's origin, looking ahead.

        Raises:
            MissingDataError: The static transforms do not connect the frames.
        """
        body = self._plan.pose.body if self._plan.pose is not None else ''
        if self._rig.models and self._plan.calibration == TF:
            frame_id, frame_t_rect = rect_in_frame(
                self._tree, self._rig.calibrated, self._rig.others
            )
            return self._tree.transform(body, frame_id) @ frame_t_rect
        if self._own_camera_0:
            return self._tree.transform(body, self._own_camera_0)
        if self._plan.scan is not None:
            velo_t_rect = NOMINAL_CAM0_T_VELO.inverse()
            if self.calibrations.first is not None:
                velo_t_rect = rect_from_velo(self.calibrations.first).inverse()
            return self._tree.transform(body, self._plan.scan.frame) @ velo_t_rect
        return Transform(NOMINAL_CAM0_T_VELO.rotation.T, np.zeros(3))

    def body_t_imu(self) -> Transform:
        """Return body_T_imu: KITTI's imu frame in the body frame of the plan's poses.

        Raises:
            MissingDataError: The static transforms do not connect the frames.
        """
        calibration, plan = self.calibrations.first, self._plan
        if calibration is not None:
            return self.body_t_rect() @ rect_from_imu(calibration)
        body = plan.pose.body if plan.pose is not None else ''
        if plan.imu_frame:
            return self._tree.transform(body, plan.imu_frame)
        if plan.scan is not None:
            return self._tree.transform(body, plan.scan.frame) @ NOMINAL_VELO_T_IMU
        return Transform.identity()

    def find(self, target: str, source: str) -> Transform | None:
        """Return target_T_source by static transforms, None where they do not connect the two."""
        return self._tree.find(target, source)

    def notes(self) -> list[str]:
        """Return notes on the samples so far."""
        first = self.calibrations.first
        nominal = first.nominal if first is not None else ()
        notes = [f'{part}: not in the bag, a nominal value is used' for part in nominal]
        notes += self._nominal_pose_notes() if first is None else ()
        notes += [*self.scans.notes(), *self.images.notes(), *self.labels.notes()]
        notes += [*self._lever_arm, *self._swapped]
        return [*notes, *self.calibrations.notes]

    def _lever_arm_notes(self, survey: Survey) -> Iterator[str]:
        """Yield a note on the position of a NavSatFix's antenna, where the imu's is known."""
        plan = self._plan
        if not (plan.fix and plan.imu_frame):
            return
        name, imu_t_antenna = topic_of(survey, plan.fix).frame_id, self.imu_t_topic.get(plan.fix)
        if imu_t_antenna is None:
            yield (
                f'{plan.fix}: no static transform joins its frame {name!r} to {plan.imu_frame}, so'
                f' its places are taken as those of {plan.imu_frame}'
            )
            return
        away_m = float(np.linalg.norm(imu_t_antenna.translation))
        if away_m > _REPORTED_LEVER_M:
            note = f'{plan.fix}: its antenna ({name}) is {away_m:.2f} m from {plan.imu_frame}; its'
            if plan.imu:
                yield f'{note} places are moved there, by the orientation of {plan.imu}'
            else:
                yield f'{note} places are written as they are, for no Imu tells the attitude'

    def _nominal_pose_notes(self) -> Iterator[str]:
        """Yield notes on the poses of a plan without calibration: see body_t_rect."""
        plan = self._plan
        if plan.pose is None:
            return
        traits, position = plan.layout.traits, 'its nominal place on the scanner'
        if Stream.POSE in traits.streams:
            if self._own_camera_0:
                return
            position = position if plan.scan is not None else f'the origin of {plan.pose.body}'
            yield f'pose: of camera 0 at {position}, since there is no calibration'
        elif Stream.OXTS in traits.streams and plan.scan and not (plan.fix or plan.imu_frame):
            yield f'oxts: of the imu at {position}, since there is no calibration'

    def losses(self) -> tuple[Loss, ...]:
        """Return the parts of samples so far that could not be converted."""
        return (*self.scans.losses(), *self.labels.losses())


def _of_boxes(base: MovingBase, plan: Plan, survey: Survey, scans: ScanConversion) -> MovingBase:
    """Return the base of boxes, with the frame of the clouds that the vehicle moves in."""
    if plan.labels is None or plan.scan is None or not scans.move:
        return base
    return replace(base, world=topic_of(survey, plan.scan.topic).frame_id)


def _body_of(topic: TopicSurvey) -> str:
    """Return the frame that a topic's rates and velocities are along."""
    return child_of(topic) if topic.msgtype == types.ODOMETRY else topic.frame_id


# The sensors of a recording whose CameraInfo or static transforms change: one for each state.
#
# Valid at a frame are the last CameraInfo of each camera and the last static transforms up
# to its images; before the first, the first. Layouts with a calibration a frame are written so; the
# others store one calibration, that of the first frame.

_LATE_NS = 5_000_000
"""A CameraInfo may be stamped so much later than its image."""
_SAME = 1e-6
_CACHE_SIZE = 32
"""Rigs: those that rectify have maps of the size of an image."""
_State = tuple[int, ...]


class SensorRigs:
    """The rig of each frame; thread-safe.

    Args:
        plan: The plan.
        survey: The survey of the bags.
        frames: Their frames.
        moving: As of SensorRig.

    Raises:
        KittiRos2Error: As SensorRig, for the first frame.
    """

    def __init__(
        self, plan: Plan, survey: Survey, frames: Frames, moving: MovingTree | None = None
    ) -> None:
        self._plan = plan
        self._survey = survey
        self._moving = moving
        self._series = [
            *(_contents(plan, survey, name) for name in _info_topics(plan, survey)),
            *survey.changes.values(),
        ]
        self._stamps_ns = [[stamp for stamp, _ in series] for series in self._series]
        self._firsts = [_first_indices([value for _, value in series]) for series in self._series]
        self._frames_ns = frames.stamps_ns
        self._images_ns = _latest_images_ns(plan, frames) + _LATE_NS
        self._cache: dict[_State, SensorRig] = {}
        self._notes: dict[str, None] = {}
        self._lost: Counter[tuple[str, str]] = Counter()
        self._states: set[_State] = set()
        self._lock = Lock()
        self.first = self._sensors(self._state(0))

    def of(self, frame: int) -> SensorRig:
        """Return the rig of a frame, by its position.

        Raises:
            ValueError: Its calibration is invalid.
        """
        if not self._plan.layout.traits.calibration_per_frame:
            return self.first
        with self._lock:
            try:
                return self._sensors(self._state(frame))
            except KittiRos2Error as error:
                raise ValueError(str(error)) from None

    def _state(self, frame: int) -> _State:
        """Return the first index of the valid value in each series."""
        if not len(self._images_ns):
            return tuple(0 for _ in self._series)
        latest_ns = int(self._images_ns[frame])
        valid = (max(bisect_right(stamps, latest_ns) - 1, 0) for stamps in self._stamps_ns)
        return tuple(firsts[index] for firsts, index in zip(self._firsts, valid, strict=True))

    def _sensors(self, state: _State) -> SensorRig:
        sensors = self._cache.pop(state, None)
        if sensors is None:
            sensors = SensorRig(self._plan, self._survey_of(state), self._moving)
            self._states.add(state)
        if len(self._cache) >= _CACHE_SIZE:
            self._account(self._cache.pop(next(iter(self._cache))))
        self._cache[state] = sensors
        return sensors

    def _survey_of(self, state: _State) -> Survey:
        """Return the survey as if nothing changed."""
        if not self._series:
            return self._survey
        topics = dict(self._survey.topics)
        static = {(parent, child): pose for parent, child, pose in self._survey.static}
        values = [series[index][1] for index, series in zip(state, self._series, strict=True)]
        infos = _info_topics(self._plan, self._survey)
        for name, info in zip(infos, values, strict=False):
            topics[name] = replace(topics[name], samples=[] if info is None else [info])
        static.update(zip(self._survey.changes, values[len(infos) :], strict=True))
        return replace(
            self._survey, topics=topics, static=[(*link, pose) for link, pose in static.items()]
        )

    def _account(self, sensors: SensorRig) -> None:
        """Take the notes and losses of a rig that is not kept."""
        if sensors is not self.first:
            self._notes.update(dict.fromkeys(sensors.notes()))
            self._count(sensors, self._lost)

    def _count(self, sensors: SensorRig, counts: Counter[tuple[str, str]]) -> None:
        for loss in sensors.losses():
            counts[loss.stream, loss.message] += loss.count

    @property
    def _rigs(self) -> list[SensorRig]:
        return [self.first, *(other for other in self._cache.values() if other is not self.first)]

    def notes(self) -> list[str]:
        """Return the notes of all rigs, each once."""
        notes = [note for sensors in self._rigs for note in sensors.notes()]
        return [*dict.fromkeys([*notes, *self._notes]), *self._on_changes()]

    def _on_changes(self) -> Iterator[str]:
        if self._plan.layout.traits.calibration_per_frame and len(self._states) > 1:
            yield (
                f'CameraInfo or static transforms change within the bag: {len(self._states)}'
                f' calibrations, each frame has the one valid at its stamp'
            )

    def losses(self) -> tuple[Loss, ...]:
        """Return the losses of all rigs, and the frames whose calibration is not stored."""
        counts = self._lost.copy()
        for sensors in self._rigs:
            self._count(sensors, counts)
        losses = [Loss(stream, count, message) for (stream, message), count in counts.items()]
        return (*losses, *self._unwritten_losses())

    def _unwritten_losses(self) -> Iterator[Loss]:
        plan, calibration = self._plan, self.first.calibrations.first
        if plan.layout.traits.calibration_per_frame or plan.calibration != TF or not self._series:
            return
        same: dict[_State, bool] = {}
        others = []
        for frame in range(len(self._frames_ns)):
            state = self._state(frame)
            if state not in same:
                same[state] = self._is_same(state, calibration)
            if not same[state]:
                others.append(frame)
        if others:
            valid = [frame for frame in range(len(self._frames_ns)) if frame not in {*others}]
            since, until = (format_stamp(int(self._frames_ns[valid[at]])) for at in (0, -1))
            yield Loss(
                Stream.CALIBRATION.value,
                len(others),
                f'CameraInfo or static transforms change within the bag: the calibration that is'
                f' written holds for frames {format_numbers(valid)}, {since} to {until} UTC; layout'
                f' {plan.layout.value} has a place for one (--layout object has one a frame;'
                f' --start and --end select)',
                tuple(others),
            )

    def _is_same(self, state: _State, calibration: Calibration | None) -> bool:
        try:
            other = self._sensors(state).calibrations.first
        except KittiRos2Error:
            return False
        if calibration is None or other is None:
            return calibration is other
        return all(
            np.allclose(first, second, rtol=_SAME, atol=_SAME)
            for first, second in zip(_numbers(calibration), _numbers(other), strict=True)
        )


def _numbers(calibration: Calibration) -> list[Float64Array]:
    """Return the matrices of a calibration that projections and mounts are made of."""
    matrices = [calibration.velo_T_imu.matrix()]
    if calibration.cam0_T_velo is not None:
        matrices.append(calibration.cam0_T_velo.matrix())
    if calibration.r0_rect is not None:
        matrices.append(calibration.r0_rect)
    for _, camera in sorted(calibration.cameras.items()):
        matrices += [camera.p_rect, np.zeros(1) if camera.d is None else camera.d]
    return matrices


def _first_indices(values: Sequence[Any]) -> list[int]:
    """Return for each value of a series the first index of the same one."""
    distinct: list[int] = []
    first_indices = []
    for index, value in enumerate(values):
        equal = (other for other in distinct[-_CACHE_SIZE:] if _is_equal(values[other], value))
        first = next(equal, index)
        if first == index:
            distinct.append(index)
        first_indices.append(first)
    return first_indices


def _is_equal(first: Any, second: Any) -> bool:  # noqa: ANN401 - contents of CameraInfo or transforms
    if isinstance(first, Transform) and isinstance(second, Transform):
        return not differ(first, second, _SAME)
    return first is second


def _info_topics(plan: Plan, survey: Survey) -> list[str]:
    """Return the CameraInfo topics of a plan, and the others that change."""
    planned = {camera.info for camera in plan.cameras.values() if camera.info in survey.topics}
    return sorted(planned | {name for name, topic in survey.topics.items() if topic.contents[1:]})


def _contents(plan: Plan, survey: Survey, name: str) -> list[tuple[int, Any]]:
    """Return the contents of a CameraInfo topic, each with the stamp from which it is valid."""
    topic = survey.topics[name]
    images = [camera.topic for camera in plan.cameras.values() if camera.info == name]
    stamps = topic.stamps()[0] + (topic_of(survey, images[0]).offset_ns if images else 0)
    contents = [(int(stamps[index]), info) for index, info in topic.contents if _is_valid(info)]
    contents.sort(key=lambda stamped_info: stamped_info[0])
    return contents or [(0, topic.samples[0] if topic.samples else None)]


def _is_valid(info: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether a CameraInfo is calibrated: drivers begin with zeros."""
    try:
        camera_model(info)
    except (ValueError, AttributeError):
        return False
    return True


def _latest_images_ns(plan: Plan, frames: Frames) -> Any:  # noqa: ANN401 - Int64Array
    """Return (N,) the stamps of the latest image of each frame; its own without any."""
    latest = np.full(len(frames), np.iinfo(np.int64).min)
    for index, camera in plan.cameras.items():
        indices = frames.samples.get(Stream(f'image_{index}'))
        stamps = frames.stamps.get(camera.topic)
        if indices is not None and stamps is not None and len(stamps):
            present = indices != NONE
            latest[present] = np.maximum(latest[present], stamps[indices[present]])
    return np.where(latest > np.iinfo(np.int64).min, latest, frames.stamps_ns)
