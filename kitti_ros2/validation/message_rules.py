# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about single messages of a bag: CameraInfo, PointCloud2, Image, transforms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.camera_info import camera_model
from ..messages.clouds import read_points
from ..messages.pixels import picture_kind, pixels_of
from ..model.msgtypes import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    FIX,
    IMAGE,
    IMU,
    LASER_SCAN,
    LIVOX,
    MARKERS,
    ODOMETRY,
    PATH,
    POSE,
    STRING,
    TF_TYPES,
    TRACKED_OBJECTS,
    TWIST,
    VELODYNE,
)
from ..rig.stereo import angle_of
from .rule import Breach, Rule, RuleScope, RuleSeverity

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HEADED_TYPES = frozenset({CLOUD, IMAGE, COMPRESSED, CAMERA_INFO, IMU, FIX, TWIST, ODOMETRY, POSE})
"""Types of sensors and poses, which begin with a header."""
_READ_TYPES = frozenset(
    {DETECTED_OBJECTS, DETECTIONS_2D, DETECTIONS_3D, LASER_SCAN, MARKERS, PATH, TRACKED_OBJECTS}
)
CHECKED_TYPES = HEADED_TYPES | TF_TYPES | {STRING, VELODYNE} | LIVOX | _READ_TYPES
"""Types of messages that are decoded: all that `to-kitti` and the evaluations read."""
_COEFFICIENTS = {
    'plumb_bob': {0, 4, 5},
    'rational_polynomial': {0, 8, 12, 14},
    'equidistant': {0, 4},
    'fisheye': {0, 4},
}
"""Numbers of D by distortion model (sensor_msgs/distortion_models.hpp, and OpenCV)."""
_PARALLEL_RAD = 1e-5
_NORM_OFF = 0.01  # tf2 refuses quaternions whose squared norm is off by 1 %


@dataclass(frozen=True, eq=False)
class CheckedMessage:
    """A message of a bag.

    Attributes:
        bag: The bag.
        topic, msgtype: Of the message.
        stamp_ns: Log time.
        value: The decoded message; None if it cannot be decoded.
        error: Why it cannot be decoded.
        decode: Whether the pixels of images are decoded.
    """

    bag: Path
    topic: str
    msgtype: str
    stamp_ns: int
    value: Any
    error: str = ''
    decode: bool = False

    def breach(self, text: str) -> Breach:
        """Return a breach of the message."""
        return Breach(f'{self.topic} at {self.stamp_ns}: {text}', self.bag)


def _find_undecodable(message: CheckedMessage) -> Iterator[Breach]:
    if message.error:
        yield message.breach(message.error)


def _find_uncalibrated(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype == CAMERA_INFO and _is_uncalibrated(message.value):
        yield Breach(f'{message.topic}: K and P are zeros', message.bag)


def _is_uncalibrated(info: Any) -> bool:  # noqa: ANN401 - of the bag's types
    return info is not None and not (np.any(info.k) or np.any(info.p))


def _find_bad_camera(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype != CAMERA_INFO or message.value is None or _is_uncalibrated(message.value):
        return
    try:
        camera_model(message.value)
    except ValueError as error:
        yield Breach(f'{message.topic}: {error}', message.bag)


def _find_distortion(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype != CAMERA_INFO or message.value is None:
        return
    model, count = message.value.distortion_model, len(message.value.d)
    known = _COEFFICIENTS.get(model)
    if known is None and (model or count):
        text = f'the distortion model {model!r} is not one of {", ".join(_COEFFICIENTS)}'
        yield Breach(f'{message.topic}: {text}', message.bag)
    elif known is not None and count not in known:
        text = f'D has {count} numbers; {model} has {max(known)}'
        yield Breach(f'{message.topic}: {text}', message.bag)


def _find_idle_rotation(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype != CAMERA_INFO or message.value is None:
        return
    try:
        camera = camera_model(message.value)
    except ValueError:  # camera-info
        return
    if camera.is_as_rectified and angle_of(camera.r) > _PARALLEL_RAD:
        degrees = np.degrees(angle_of(camera.r))
        text = f'D is 0 and K is that of P, but R turns by {degrees:.2g} degrees'
        yield Breach(f'{message.topic}: {text}', message.bag)


def _find_bad_cloud(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype == CLOUD and message.value is not None:
        try:
            read_points(message.value, None)
        except ValueError as error:
            yield message.breach(str(error))


def _find_bad_image(message: CheckedMessage) -> Iterator[Breach]:
    image = message.value
    if message.msgtype == IMAGE and image is not None:
        if len(image.data) < image.step * image.height or not image.width * image.height:
            text = f'{len(image.data)} bytes of {image.width}x{image.height}, step {image.step}'
            yield message.breach(text)
    elif message.msgtype == COMPRESSED and image is not None:
        try:
            picture_kind(image)
        except ValueError as error:
            yield message.breach(str(error))


def _find_bad_pixels(message: CheckedMessage) -> Iterator[Breach]:
    if not message.decode or message.value is None:
        return
    if message.msgtype in {IMAGE, COMPRESSED}:
        try:
            pixels_of(message.value)
        except ValueError as error:
            yield message.breach(str(error))


def _find_bad_transforms(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype not in TF_TYPES or message.value is None:
        return
    for each in message.value.transforms:
        q, t = each.transform.rotation, each.transform.translation
        link = f'{each.header.frame_id} -> {each.child_frame_id}'
        norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w  # ** raises where * is inf
        if not np.isfinite((t.x, t.y, t.z)).all() or not abs(norm - 1) < _NORM_OFF:
            numbers = f'{t.x:g} {t.y:g} {t.z:g}, {q.x:g} {q.y:g} {q.z:g} {q.w:g}'
            yield Breach(f'{message.topic}: {link} is {numbers}', message.bag)
        if not each.header.frame_id or not each.child_frame_id:
            yield Breach(f'{message.topic}: {link} has a frame without a name', message.bag)


_BAG = RuleScope.BAG
_ERROR = RuleSeverity.ERROR
_WARNING = RuleSeverity.WARNING

MESSAGE_RULES: tuple[Rule[CheckedMessage], ...] = (
    Rule(
        'message-decode',
        _ERROR,
        _BAG,
        'Messages can be decoded by the definition of their type',
        'kitti-ros2 recover copies the readable messages',
        _find_undecodable,
    ),
    Rule(
        'camera-uncalibrated',
        _WARNING,
        _BAG,
        'CameraInfo has K or P',
        'calibrate the camera; to-kitti --calib takes a calibration from elsewhere',
        _find_uncalibrated,
    ),
    Rule(
        'camera-info',
        _ERROR,
        _BAG,
        'CameraInfo has a size, positive focal lengths, a rotation R, a region inside the image',
        'correct the calibration of the driver',
        _find_bad_camera,
    ),
    Rule(
        'camera-distortion',
        _ERROR,
        _BAG,
        'D has as many numbers as its distortion model',
        'set distortion_model to that of the calibration: plumb_bob has 5 numbers',
        _find_distortion,
    ),
    Rule(
        'camera-rotation',
        _WARNING,
        _BAG,
        'R of CameraInfo is the identity where D is 0 and K is that of P',
        'programs that rectify turn such images once more: write R = I; to-kitti turns none',
        _find_idle_rotation,
    ),
    Rule(
        'cloud-layout',
        _ERROR,
        _BAG,
        'PointCloud2 has x, y, z within point_step, and data for width x height points',
        'correct point_step, row_step and fields in the driver',
        _find_bad_cloud,
    ),
    Rule(
        'image-layout',
        _ERROR,
        _BAG,
        'Images have data for all rows; compressed ones are whole',
        'correct step, width and height in the driver',
        _find_bad_image,
    ),
    Rule(
        'image-decode',
        _ERROR,
        _BAG,
        'Pixels of images can be decoded (with --decode)',
        'record the topic again',
        _find_bad_pixels,
    ),
    Rule(
        'tf-transform',
        _ERROR,
        _BAG,
        'Transforms have finite numbers, quaternions of length 1, and names of both frames',
        'correct the publisher: tf2 refuses such transforms',
        _find_bad_transforms,
    ),
)
