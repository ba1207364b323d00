# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/CameraInfo -> a pinhole for each of its images.

P, after R, projects points of header.frame_id, and a pinhole has neither a rotation nor an offset:
if there is one, the pinhole gets a frame of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from ..messages.camera_info import camera_model
from ..model.geometry import Transform
from ..rig.rectify import has_lens_of_larger_image
from .entities import Converter, EntityUpdate, entity_path, image_frame

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator

    from ..messages.camera_info import CameraModel
    from ..messages.ros_types import CameraInfo
    from ..model.geometry import Float64Array
    from ..rig.stereo import Viewpoint
    from .entities import Context

_IMAGE_PLANE_M = 3.0
_SAME = 1e-9


class PinholeConverter(Converter):
    """The pinholes of a CameraInfo topic, updated when its content changes."""

    def __init__(self, topic: str, context: Context) -> None:
        super().__init__(topic, context)
        self._images = context.survey.images_of(topic)
        self._last: Hashable = None

    def convert(self, message: CameraInfo) -> Iterator[EntityUpdate]:
        """Yield nothing if nothing changed, or if the camera is not calibrated."""
        matrices = (message.k, message.d, message.r, message.p)
        key = (*(each.tobytes() for each in matrices), str(message.roi), message.header.frame_id)
        if key == self._last:
            return
        self._last = key
        try:
            model = camera_model(message)
        except ValueError as error:
            self.context.note(f'{self.topic}: {error}; its images are shown without a pose')
            return
        view = self.context.rig.place(self.topic, model)
        for image in self._images:
            yield from _pinhole(image, model, view)


def _pinhole(image: str, model: CameraModel, view: Viewpoint) -> Iterator[EntityUpdate]:
    k, pinhole_t_frame = projection_of(model, view, rectified=is_rectified(image, model))
    frame = view.frame
    if np.abs(pinhole_t_frame.matrix() - np.eye(4)).max() > _SAME:
        frame_t_pinhole = pinhole_t_frame.inverse()
        frame = f'{image.strip("/")}/pinhole'
        yield EntityUpdate(
            entity_path(image, 'pinhole'),
            [
                rr.Transform3D(
                    translation=frame_t_pinhole.translation,
                    quaternion=rr.Quaternion(xyzw=frame_t_pinhole.quaternion()),
                    parent_frame=view.frame,
                    child_frame=frame,
                )
            ],
        )
    yield EntityUpdate(
        entity_path(image),
        [
            rr.Pinhole(
                image_from_camera=k,
                resolution=model.size,
                parent_frame=frame,
                child_frame=image_frame(image),
                image_plane_distance=_IMAGE_PLANE_M,
            )
        ],
        image_frame(image),
    )


def is_rectified(image: str, model: CameraModel) -> bool:
    """Whether an image is rectified (the target of P after R): by its name or its calibration.

    image_proc names such images image_rect and image_rect_color.
    """
    name = image.removesuffix('/compressed').rpartition('/')[2]
    turned = np.abs(model.r - np.eye(3)).max() > _SAME
    plain = model.is_as_rectified or not (model.d.any() or turned)
    return 'rect' in name or plain or has_lens_of_larger_image(model)


def projection_of(
    model: CameraModel, view: Viewpoint, *, rectified: bool
) -> tuple[Float64Array, Transform]:
    """Return K (3, 3), and pinhole_T_frame, which maps the view's frame to the pinhole.

    A distorted image is not rectified here; it is shown with K as if it had no distortion.
    """
    if not rectified:
        return model.k, view.cam_T_frame
    k = view.p[:, :3]
    offset = np.asarray(np.linalg.solve(k, view.p[:, 3]), np.float64)
    return k, Transform(model.r, offset) @ view.cam_T_frame
