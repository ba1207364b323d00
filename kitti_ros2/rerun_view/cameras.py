# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/CameraInfo -> a pinhole for each image it belongs to.

P, after R, projects points of header.frame_id, and a pinhole has neither a turn nor an offset:
where there is one, the pinhole hangs from a frame of its own, so that what is projected lands where
P puts it. Of a distorted image, which nothing straightens here, K tells, in the frame itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from ..geometry import Transform
from ..messages.camera_info import decode_camera_info
from .entry import Entry, Shower, entity_path, image_frame
from .survey import frame_name

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator

    from ..geometry import Float64Array
    from ..messages.ros_types import CameraInfo
    from .entry import Context, Moment

_IMAGE_PLANE_M = 3.0
_SAME = 1e-9


class Pinholes(Shower):
    """The pinholes of a CameraInfo topic, made anew when what it says changes."""

    def __init__(self, topic: str, context: Context) -> None:
        super().__init__(topic, context)
        self._images = context.survey.images_of(topic)
        self._last: Hashable = None

    def show(self, message: CameraInfo, moment: Moment) -> Iterator[Entry]:  # noqa: ARG002
        """Nothing where nothing changed, or where the camera is not calibrated (K[0] is 0)."""
        numbers = (
            message.k.tobytes(),
            message.d.tobytes(),
            message.r.tobytes(),
            message.p.tobytes(),
        )
        key = (*numbers, message.width, message.height, message.header.frame_id)
        if key == self._last:
            return
        self._last = key
        if not message.k[0]:
            return
        for image in self._images:
            yield from _pinhole(image, message)


def _pinhole(image: str, info: CameraInfo) -> Iterator[Entry]:
    k, frame_t_camera = projection_of(info, rectified=is_rectified(image, info))
    frame = frame_name(info.header.frame_id)
    parent = frame
    if frame_t_camera is not None:
        parent = f'{image.strip("/")}/pinhole'
        yield Entry(
            entity_path(image, 'pinhole'),
            [
                rr.Transform3D(
                    translation=frame_t_camera.translation,
                    quaternion=rr.Quaternion(xyzw=frame_t_camera.quaternion()),
                    parent_frame=frame,
                    child_frame=parent,
                )
            ],
        )
    yield Entry(
        entity_path(image),
        [
            rr.Pinhole(
                image_from_camera=k,
                resolution=[info.width, info.height],
                parent_frame=parent,
                child_frame=image_frame(image),
                image_plane_distance=_IMAGE_PLANE_M,
            )
        ],
        image_frame(image),
    )


def is_rectified(image: str, info: CameraInfo) -> bool:
    """Whether an image is what P after R projects onto: by its name, else by its calibration.

    REP 104 of the image pipeline calls them image_rect and image_rect_color.
    """
    name = image.removesuffix('/compressed').rpartition('/')[2]
    return 'rect' in name or not (info.d.any() or _turns(info.r.reshape(3, 3)))


def projection_of(info: CameraInfo, *, rectified: bool) -> tuple[Float64Array, Transform | None]:
    """K (3, 3), and frame_T_camera: where the pinhole is in header.frame_id, None where it is that.

    Args:
        info: Calibrated.
        rectified: Whether P and R hold, or K alone.
    """
    k, _, r, p = decode_camera_info(info)
    if not rectified or not p[0, 0]:
        return k, None
    rotation = r if _turns(r) else np.eye(3)
    offset = np.asarray(np.linalg.solve(p[:, :3], p[:, 3]), np.float64)
    if not _turns(r) and np.abs(offset).max() < _SAME:
        return p[:, :3], None
    return p[:, :3], Transform(rotation, offset).inverse()


def _turns(r: Float64Array) -> bool:
    """Whether R is a rotation other than none at all; zeros are what was never filled in."""
    return bool(r.any()) and bool(np.abs(r - np.eye(3)).max() > _SAME)
