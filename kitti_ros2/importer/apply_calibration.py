# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A plan's calibration, applied to samples: points, images, boxes and poses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.poses import rect_from_imu
from ..model import msgtypes as types
from ..model.geometry import Transform
from ..model.labels import rect_from_velo
from ..model.nominal import NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU
from ..model.streams import Stream
from .calibration import rect_in_frame
from .calibration_source import camera_models, make_calibrations, swapped_sizes
from .convert_boxes import BoxConversion
from .convert_images import ImageConversion
from .convert_scans import ScanConversion
from .frames_at import MovingBase
from .named_frames import child_of
from .optical_frames import LINK_T_OPTICAL, frame_of, made_optical_frames
from .plan import TF, VelocityAxes
from .planned_topics import topic_of
from .report import undecoded
from .rig_cameras import other_cameras
from .scan_frame import made_frame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.losses import Loss
    from ..rig.moving_tree import MovingTree
    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey


_REPORTED_LEVER_M = 0.05


class Rigging:
    """The sensors of a plan in KITTI's frames.

    Attributes:
        calibrations: Of all frames.
        scans: Converts clouds.
        images: Converts images.
        labels: Converts boxes.
        imu_t_topic: By topic of the GPS/IMU unit: its frame in KITTI's imu frame.
    """

    def __init__(self, plan: Plan, survey: Survey, moving: MovingTree | None = None) -> None:
        """Make the calibration.

        Args:
            plan: The plan.
            survey: Of its bags.
            moving: The links over time, where clouds or boxes are in frames that move.

        Raises:
            UsageError: The plan names a missing topic.
            MissingDataError: Required frames are not connected by static transforms.
            BadFileError: A calibration file cannot be read.
        """
        lost = next((undecoded(each).text() for each in survey.unreadable(*types.TF_TYPES)), '')
        scan_frame = '' if plan.scan is None else plan.scan.frame
        self._models = camera_models(plan, survey)
        self._others, links = other_cameras(plan, survey)
        optical = [*links, *made_optical_frames(plan, survey)]
        tree = survey.tree_with(optical, lost)
        plan, made = made_frame(plan, tree, self._models, self._others)
        if made:
            tree = survey.tree_with([*optical, *made], lost)
        self._tree = tree
        self._plan = plan
        self.calibrations = make_calibrations(plan, survey, self._tree, self._models, self._others)
        base = self._moving_base(survey, scan_frame, moving)
        point_labels = plan.layout.traits.point_labels
        self.scans = ScanConversion(plan.scan, survey, self._tree, base, point_labels=point_labels)
        self.images = ImageConversion(plan, survey, self._models)
        self._swapped = swapped_sizes(plan, survey, self._models)
        self.imu_t_topic = self._unit_transforms(survey)
        self._lever_arm = list(self._lever_arm_notes(survey))
        self.labels = BoxConversion(
            plan,
            survey,
            self._tree,
            self.calibrations,
            self.images,
            None if base is None else _of_boxes(base, plan, survey, self.scans),
        )

    def _moving_base(
        self, survey: Survey, scan_frame: str, moving: MovingTree | None
    ) -> MovingBase | None:
        """Return the frame that boxes are brought to: that of the scans, else that of a camera."""
        if self._plan.scan is not None:
            velo_t_frame = self._tree.transform(self._plan.scan.frame, scan_frame)
            return MovingBase(scan_frame, velo_t_frame, moving)
        if not self._models:
            return None
        camera = self._plan.cameras[min(self._models)]
        frame = frame_of(camera, survey)
        velo_t_frame = NOMINAL_CAM0_T_VELO.inverse()
        if camera.forward:
            velo_t_frame = velo_t_frame @ LINK_T_OPTICAL.inverse()
        return MovingBase(frame, velo_t_frame, moving)

    def _unit_transforms(self, survey: Survey) -> dict[str, Transform]:
        found = {}
        target = self._plan.imu_frame
        receiver = {self._plan.fix}
        if self._plan.velocity_axes is VelocityAxes.ENU:
            receiver.add(self._plan.velocity)
        for topic in {self._plan.imu, self._plan.velocity} - receiver:
            frame = _body_of(topic_of(survey, topic)) if topic else ''
            if frame and target and frame != target:
                found[topic] = self._tree.transform(target, frame)
        for topic in receiver:
            antenna = self._place_of(topic_of(survey, topic).frame if topic else '')
            if antenna is not None:
                found[topic] = antenna
        return found

    def _place_of(self, frame: str) -> Transform | None:
        """Return imu_T_frame, None where static transforms do not connect them."""
        target = self._plan.imu_frame
        if not (frame and target):
            return None
        known = frame == target or {frame, target} <= self._tree.frames
        return self._tree.find(target, frame) if known else None

    def body_t_rect(self) -> Transform:
        """Return body_T_rect: the rectified camera 0 in the body frame of the plan's poses.

        Without a camera it is at the nominal place of KITTI's camera on the scanner; without a
        scanner too, at the body's origin, looking ahead.

        Raises:
            MissingDataError: The static transforms do not connect the frames.
        """
        body = self._plan.pose.body if self._plan.pose is not None else ''
        if self._models and self._plan.calibration == TF:
            frame, frame_t_rect = rect_in_frame(self._tree, self._models, self._others)
            return self._tree.transform(body, frame) @ frame_t_rect
        if self._plan.scan is not None:
            velo_t_rect = NOMINAL_CAM0_T_VELO.inverse()
            if self.calibrations.first is not None:
                velo_t_rect = rect_from_velo(self.calibrations.first).inverse()
            return self._tree.transform(body, self._plan.scan.frame) @ velo_t_rect
        return Transform(NOMINAL_CAM0_T_VELO.rotation.T, np.zeros(3))

    def body_t_unit(self) -> Transform:
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
        """Return non-fatal remarks on the samples so far."""
        first = self.calibrations.first
        nominal = first.nominal if first is not None else ()
        found = [f'{part}: not in the bag, a nominal value is used' for part in nominal]
        found += self._nominal_places() if first is None else ()
        found += [*self.scans.notes(), *self.images.notes(), *self.labels.notes()]
        found += [*self._lever_arm, *self._swapped]
        return [*found, *self.calibrations.notes]

    def _lever_arm_notes(self, survey: Survey) -> Iterator[str]:
        """Yield a note on the place of a NavSatFix's antenna, where the imu's is known."""
        plan = self._plan
        if not (plan.fix and plan.imu_frame):
            return
        frame, place = topic_of(survey, plan.fix).frame, self.imu_t_topic.get(plan.fix)
        if place is None:
            yield (
                f'{plan.fix}: no static transform joins its frame {frame!r} to {plan.imu_frame}, so'
                f' its places are taken as those of {plan.imu_frame}'
            )
            return
        away_m = float(np.linalg.norm(place.translation))
        if away_m > _REPORTED_LEVER_M:
            told = f'{plan.fix}: its antenna ({frame}) is {away_m:.2f} m from {plan.imu_frame}; its'
            if plan.imu:
                yield f'{told} places are moved there, by the orientation of {plan.imu}'
            else:
                yield f'{told} places are written as they are, for no Imu tells the attitude'

    def _nominal_places(self) -> Iterator[str]:
        """Yield notes on what the poses are of, where no calibration tells: see body_t_rect."""
        plan = self._plan
        if plan.pose is None:
            return
        traits, place = plan.layout.traits, 'its nominal place on the scanner'
        if Stream.POSE in traits.streams:
            place = place if plan.scan is not None else f'the origin of {plan.pose.body}'
            yield f'pose: of camera 0 at {place}, since there is no calibration'
        elif Stream.OXTS in traits.streams and plan.scan and not (plan.fix or plan.imu_frame):
            yield f'oxts: of the imu at {place}, since there is no calibration'

    def losses(self) -> tuple[Loss, ...]:
        """Return the parts of samples so far that could not be converted."""
        return (*self.scans.losses(), *self.labels.losses())


def _of_boxes(base: MovingBase, plan: Plan, survey: Survey, scans: ScanConversion) -> MovingBase:
    """Return the base of boxes, with the frame of the clouds that the vehicle moves in."""
    if plan.labels is None or plan.scan is None or not scans.move:
        return base
    return replace(base, world=topic_of(survey, plan.scan.topic).frame)


def _body_of(topic: TopicSurvey) -> str:
    """Return the frame that a topic's rates and velocities are along."""
    return child_of(topic) if topic.msgtype == types.ODOMETRY else topic.frame
