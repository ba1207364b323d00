# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A plan's calibration, applied to samples: points, images and boxes."""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.png.encode import encode_png
from ..files.png.header import parse_image
from ..messages.clouds import decode_cloud
from ..messages.detections import ABSURD, has_scores
from ..messages.pixels import pixels_of, png_of, size_of
from ..messages.solid_boxes import cuboids_in
from ..messages.source import LABEL_LINES, decode_text
from ..model import msgtypes as types
from ..model.errors import BadFileError, UsageError
from ..model.geometry import Transform
from ..model.labels import rect_from_velo
from ..model.losses import Loss
from ..model.nominal import NOMINAL_CAM0_T_VELO
from ..model.samples import Scan
from ..rig.rectify import Rectifier
from ..rig.tf_tree import FrameTree
from .calibration import rect_in_frame
from .calibration_source import camera_models, make_calibrations
from .frames import topic_of
from .labels import OUT_OF_VIEW, TrackIds, boxes_of_lines, make_boxes, max_tilt
from .plan import TF, UNKNOWN_OCCLUSION
from .report import undecoded

if TYPE_CHECKING:
    from ..messages.camera_info import CameraModel
    from ..messages.pixels import Pixels
    from ..model.boxes import Box, Cuboid
    from .plan import CameraPlan, Plan
    from .survey import Survey

_REPORTED_TILT_RAD = np.radians(10)


class Rigging:
    """Converts single messages by a plan; thread-safe except for boxes.

    Attributes:
        calibrations: Of all frames.
        imu_t_topic: By topic of the GPS/IMU unit: its frame in KITTI's imu frame.
        boxes_left_out: Number of boxes without a label so far, by reason.
    """

    def __init__(self, plan: Plan, survey: Survey) -> None:
        """Make the calibration.

        Raises:
            UsageError: The plan names a missing topic.
            MissingDataError: Required frames are not connected by static transforms.
            BadFileError: A calibration file cannot be read.
        """
        self._plan = plan
        lost = (undecoded(topic).text() for topic in survey.unreadable(*types.TF_TYPES))
        self._tree = FrameTree(survey.static, survey.moving, next(lost, ''))
        self._models = camera_models(plan, survey)
        self.boxes_left_out: Counter[str] = Counter()
        self._max_tilt = 0.0
        self.calibrations = make_calibrations(plan, survey, self._tree, self._models)
        self._velo_t_cloud = self._scan_transform(survey)
        self._rectifiers = {
            index: _rectifier(plan.cameras[index], model)
            for index, model in self._models.items()
            if plan.cameras[index].rectify
        }
        self._changing = [
            f'{camera.info} changes within the bag; the first that can be read counts'
            for camera in plan.cameras.values()
            if camera.info and topic_of(survey, camera.info).changes
        ]
        self._sizes = _sizes(plan, survey) | {
            index: model.size for index, model in self._models.items()
        }
        self.imu_t_topic = self._unit_transforms(survey)
        self._tracks = TrackIds()
        self._scores = self._check_labels(survey)

    def _scan_transform(self, survey: Survey) -> Transform | None:
        """Return velo_T_cloud, None where the messages are in KITTI's frame already."""
        scan = self._plan.scan
        if scan is None:
            return None
        own = topic_of(survey, scan.topic).frame
        return None if own == scan.frame else self._tree.transform(scan.frame, own)

    def _unit_transforms(self, survey: Survey) -> dict[str, Transform]:
        found = {}
        for topic in (self._plan.imu, self._plan.velocity):
            frame = topic_of(survey, topic).frame if topic else ''
            target = self._plan.imu_frame
            if frame and target and frame != target:
                found[topic] = self._tree.transform(target, frame)
        return found

    def _check_labels(self, survey: Survey) -> bool:
        """Check the options of labels; return whether they have scores."""
        plan = self._plan.labels
        if plan is None:
            return False
        if self._plan.scan is None and not self._models and plan.topic != LABEL_LINES:
            raise UsageError('labels need a scan or a camera_info: their boxes are given in frames')
        if plan.topic == LABEL_LINES and plan.occluded != UNKNOWN_OCCLUSION:
            raise UsageError(
                f'labels.occluded is for boxes; the label lines of {plan.topic} have their own:'
                f' leave it at {UNKNOWN_OCCLUSION}'
            )
        calibration = self.calibrations.first
        if calibration is None:
            raise UsageError('labels need a calibration: set calibration of the plan, or --calib')
        if plan.camera not in calibration.cameras:
            raise UsageError(f'labels.camera is {plan.camera}, of which there is no calibration')
        return any(has_scores(look) for look in topic_of(survey, plan.topic).looks)

    @cached_property
    def _to_velo(self) -> dict[str, Transform]:
        """velo_T_frame of every frame connected to the scans' (or to the camera's) frame."""
        if self._plan.scan is not None:
            base, velo_t_base = self._plan.scan.frame, Transform.identity()
        else:
            base = self._models[min(self._models)].frame
            velo_t_base = NOMINAL_CAM0_T_VELO.inverse()
        joined = {base: velo_t_base}
        for frame in self._tree.frames:
            base_t_frame = self._tree.find(base, frame)
            if base_t_frame is not None:
                joined[frame] = velo_t_base @ base_t_frame
        return joined

    def scan(self, cloud: Any) -> tuple[Scan, int]:  # noqa: ANN401 - of the bag's types
        """Convert a PointCloud2 to a scan; also return the number of dropped points.

        Raises:
            ValueError: It cannot be read.
        """
        plan = self._plan.scan
        points, dropped = decode_cloud(cloud, 1.0 if plan is None else plan.intensity_scale)
        if self._velo_t_cloud is not None:
            places = self._velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([places, points[:, 3]]).astype(np.float32)
        return Scan(points), dropped

    def png(self, camera: int, message: Any) -> bytes:  # noqa: ANN401 - of the bag's types
        """Convert an Image or CompressedImage to a PNG file, rectified where the plan requests it.

        Raises:
            ValueError: It cannot be decoded, or its size differs from other images of the camera.
        """
        rectifier = self._rectifiers.get(camera)
        compressed = hasattr(message, 'format')
        own = png_of(message) if compressed and rectifier is None else None
        if own is not None:
            try:
                # png_of has checked its checksums.
                image = parse_image(own, 'the message', len(own))
            except BadFileError as error:
                raise ValueError(str(error)) from None
            self._check_size(camera, (image.width, image.height))
            return own
        return encode_png(self.pixels(camera, message))

    def pixels(self, camera: int, message: Any) -> Pixels:  # noqa: ANN401 - of the bag's types
        """Decode an Image or CompressedImage, rectified where the plan requests it.

        Returns:
            (H, W) uint8 or uint16, or (H, W, 3) uint8 BGR.

        Raises:
            ValueError: As png.
        """
        pixels = pixels_of(message)
        self._check_size(camera, (pixels.shape[1], pixels.shape[0]))
        rectifier = self._rectifiers.get(camera)
        return pixels if rectifier is None else rectifier.apply(pixels)

    def _check_size(self, camera: int, size: tuple[int, int]) -> None:
        expected = self._sizes.setdefault(camera, size)
        if size != expected:
            raise ValueError(
                f'the image is {size[0]}x{size[1]}; expected {expected[0]}x{expected[1]}, as the'
                f' rest of its camera: calibration holds for one size only'
            )

    def boxes(self, message: Any, stamp_ns: int) -> list[Box]:  # noqa: ANN401 - of the bag's types
        """Make the labels of a frame.

        Raises:
            ValueError: They cannot be read.
        """
        plan, calibration = self._plan.labels, self.calibrations.at(stamp_ns)
        if plan is None or calibration is None:
            return []
        if plan.topic == LABEL_LINES:
            return boxes_of_lines(decode_text(message).text, self._tracks)
        size = self._sizes.get(plan.camera) or calibration.cameras[plan.camera].size
        if size is None:
            raise ValueError(f'the size of camera {plan.camera} is not known')
        cuboids, left_out = self.cuboids(message)
        boxes, unseen = make_boxes(
            cuboids,
            calibration,
            plan.camera,
            size,
            self._tracks,
            out_of_view=plan.out_of_view,
            occluded=plan.occluded,
        )
        self.boxes_left_out.update(left_out)
        self.boxes_left_out[OUT_OF_VIEW] += unseen
        self._max_tilt = max(self._max_tilt, max_tilt(cuboids, calibration))
        return boxes

    def cuboids(self, message: Any) -> tuple[list[Cuboid], list[str]]:  # noqa: ANN401 - as boxes
        """Decode a message with 3D boxes to boxes in velo_link; also why others were skipped.

        Raises:
            ValueError: They cannot be read.
        """
        return cuboids_in(message, self._to_velo, scores=self._scores)

    def body_t_rect(self) -> Transform:
        """Return body_T_rect: the rectified camera 0 in the body frame of the plan's poses.

        Without a camera it is at the nominal place of KITTI's camera on the scanner; without a
        scanner too, at the body's origin, looking ahead.

        Raises:
            MissingDataError: The static transforms do not connect the frames.
        """
        body = self._plan.pose.body if self._plan.pose is not None else ''
        if self._models and self._plan.calibration == TF:
            frame, frame_t_rect = rect_in_frame(self._tree, self._models)
            return self._tree.transform(body, frame) @ frame_t_rect
        if self._plan.scan is not None:
            velo_t_rect = NOMINAL_CAM0_T_VELO.inverse()
            if self.calibrations.first is not None:
                velo_t_rect = rect_from_velo(self.calibrations.first).inverse()
            return self._tree.transform(body, self._plan.scan.frame) @ velo_t_rect
        return Transform(NOMINAL_CAM0_T_VELO.rotation.T, np.zeros(3))

    def notes(self) -> list[str]:
        """Return non-fatal remarks on the samples so far."""
        first = self.calibrations.first
        nominal = first.nominal if first is not None else ()
        found = [f'{part}: not in the bag, a nominal value is used' for part in nominal]
        found += [
            f'{count} boxes {reason} were left out of the labels'
            for reason, count in self.boxes_left_out.items()
            if count and reason != ABSURD
        ]
        if self._max_tilt > _REPORTED_TILT_RAD:
            found.append(
                f"boxes lean by up to {np.degrees(self._max_tilt):.0f} degrees from the camera's y"
                f' axis, about which alone labels turn: their heading was kept'
            )
        return [*found, *self._changing, *self.calibrations.notes]

    def losses(self) -> tuple[Loss, ...]:
        """Return the boxes so far that a label cannot represent."""
        count, plan = self.boxes_left_out[ABSURD], self._plan.labels
        if not count or plan is None:
            return ()
        return (Loss(plan.topic, count, f'{plan.topic}: boxes {ABSURD} (NaN, 0 or beyond 100 km)'),)


def _sizes(plan: Plan, survey: Survey) -> dict[int, tuple[int, int]]:
    """Return (width, height) of each camera, from the first of its images with a known size."""
    found = {}
    for index, camera in plan.cameras.items():
        sizes = (size_of(look) for look in topic_of(survey, camera.topic).looks)
        size = next(filter(None, sizes), None)
        if size is not None:
            found[index] = size
    return found


def _rectifier(camera: CameraPlan, model: CameraModel) -> Rectifier:
    try:
        return Rectifier(model)
    except ValueError as error:
        raise UsageError(
            f'{camera.info}: {error}; set rectify: false in the plan where the images are rectified'
        ) from None
