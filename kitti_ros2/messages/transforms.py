# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration -> tf2_msgs/TFMessage: the static tree in one message."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.cameras import rectified_offset
from ..model.geometry import Transform
from .header import make_header, make_quaternion, make_vector3, vector_of
from .ros_types import TFMessage, TransformMsg, TransformStamped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.samples import Calibration
    from .naming import FrameNames


def static_links(
    calibration: Calibration, base_t_imu: Transform, frames: FrameNames
) -> list[tuple[str, str, Transform]]:
    """Return (parent, child, parent_T_child) of the static tree; unknown links are skipped.

    base_link -> imu_link -> velo_link -> camera 0 -> the other cameras, where camera 0 is the
    rectified one, or the unrectified where the images are. On a rig whose cameras have extrinsics
    of their own, each is a child of velo_link.
    """
    links = [
        (frames.base, frames.imu, base_t_imu),
        (frames.imu, frames.velo, calibration.velo_T_imu.inverse()),
    ]
    if calibration.independent_cameras:
        return links + [
            (frames.velo, frames.camera(index), camera.cam_T_velo.inverse())
            for index, camera in sorted(calibration.cameras.items())
            if camera.cam_T_velo is not None
        ]
    first = frames.camera(0)
    cam0_t_velo = _camera0_t_velo(calibration)
    if cam0_t_velo is not None:
        links.append((frames.velo, first, cam0_t_velo.inverse()))
    for index, camera in sorted(calibration.cameras.items()):
        if index == 0:
            continue
        if calibration.rectified:
            offset = Transform.from_translation(-rectified_offset(camera))
            links.append((first, frames.camera(index), offset))
        elif camera.cam_T_cam0 is not None:
            links.append((first, frames.camera(index), camera.cam_T_cam0.inverse()))
    return links


def _camera0_t_velo(calibration: Calibration) -> Transform | None:
    """Return cam0_T_velo of the frame of camera 0's images."""
    if calibration.cam0_T_velo is None:
        return None
    if not calibration.rectified:
        return calibration.cam0_T_velo
    if calibration.r0_rect is None:
        return None
    return Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo


def encode_static(links: Sequence[tuple[str, str, Transform]], stamp_ns: int) -> TFMessage:
    """Make a message of all static transforms."""
    return TFMessage(
        [make_transform(transform, stamp_ns, parent, child) for parent, child, transform in links]
    )


def decode_static(message: TFMessage) -> list[tuple[str, str, Transform]]:
    """Decode static transforms: the inverse of encode_static."""
    links = []
    for stamped in message.transforms:
        q = stamped.transform.rotation
        translation = vector_of(stamped.transform.translation)
        transform = Transform.from_quaternion((q.x, q.y, q.z, q.w), translation)
        links.append((stamped.header.frame_id, stamped.child_frame_id, transform))
    return links


def make_transform(
    transform: Transform, stamp_ns: int, parent: str, child: str
) -> TransformStamped:
    """Make a TransformStamped of parent_T_child."""
    return TransformStamped(
        make_header(stamp_ns, parent),
        child,
        TransformMsg(make_vector3(transform.translation), make_quaternion(transform.quaternion())),
    )
