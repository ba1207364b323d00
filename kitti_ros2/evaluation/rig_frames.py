# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The rectified camera 0 in any frame of the vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..kitti.poses import rect_from_imu
from ..messages.naming import FrameNames
from ..model.errors import MissingDataError
from ..model.spelling import did_you_mean
from ..model.streams import CAMERA_NAMES
from ..rig.tf_tree import FrameTree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration
    from ..rig.tf_tree import Link

CAMERA_0 = FrameNames(cameras=CAMERA_NAMES).camera(0)
"""The name of the rectified camera 0 in TF."""


def kitti_links(calibration: Calibration, base_t_imu: Transform) -> list[Link]:
    """Return the static transforms of a recording up to camera 0, also of an unrectified one."""
    names = FrameNames()
    velo_t_cam0 = calibration.velo_T_imu @ rect_from_imu(calibration).inverse()
    return [
        (names.base, names.imu, base_t_imu),
        (names.imu, names.velo, calibration.velo_T_imu.inverse()),
        (names.velo, CAMERA_0, velo_t_cam0),
    ]


def frame_t_cam0(frame: str, own: Sequence[Link], others: Sequence[Link]) -> Float64Array:
    """Return (4, 4) camera 0 in a frame.

    Args:
        frame: The frame.
        own: Static transforms of the bag that it is from.
        others: Those of the ground truth, for frames that the bag does not have.

    Raises:
        MissingDataError: They do not connect the two.
    """
    if frame == CAMERA_0:
        return np.eye(4)
    # A bag may have an unrectified camera 0; that of the ground truth is rectified.
    known = any(link[1] == CAMERA_0 for link in others)
    kept = [link for link in own if not known or link[1].lstrip('/') != CAMERA_0]
    placed = {link[1].lstrip('/') for link in kept}
    tree = FrameTree([*kept, *(link for link in others if link[1] not in placed)])
    found = tree.find(frame, CAMERA_0)
    if found is not None:
        return found.matrix()
    if not tree.frames:
        raise MissingDataError(
            f'the frame {frame} cannot be converted to camera 0: neither the ground truth nor the'
            f' result has a calibration; give the folder of the sequence as ground truth, or poses'
            f' of camera 0'
        )
    near = did_you_mean(frame, sorted(tree.frames)) if frame not in tree.frames else ''
    raise MissingDataError(
        f'no static transform from {frame or "a frame without a name"} to camera 0; known are'
        f' {tree}; name the frame of these whose poses they are with --frame{near}'
    )
