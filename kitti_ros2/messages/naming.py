# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of frames and topics, by preset."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.streams import CAMERA_COUNT, CAMERA_NAMES
from ..options.messages import BASE_T_IMU, KITTI2BAG_BASE_T_IMU, Preset

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.layouts import Layout
    from ..options.messages import MessageOptions


@dataclass(frozen=True)
class FrameNames:
    """Frame names.

    Attributes:
        map: Fixed to the world; its origin is the first position of base (see map_frame.py).
        base: On the ground below the middle of the rear axle.
        truth: The same place, as the ground truth poses name it: base, unless these have a TF tree
            of their own.
        imu: The GPS/IMU unit (x forward, y left, z up).
        velo: The laser scanner (x forward, y left, z up).
        camera_pattern: Optical frames (x right, y down, z forward), {} the camera's name.
        cameras: Camera index to its name.
    """

    map: str = 'map'
    base: str = 'base_link'
    imu: str = 'imu_link'
    velo: str = 'velo_link'
    camera_pattern: str = 'camera_{}_optical_frame'
    truth: str = 'base_link'
    cameras: Mapping[int, str] = field(default_factory=dict)

    def camera(self, index: int) -> str:
        """Return the optical frame of a camera."""
        return self.camera_pattern.format(self.cameras.get(index, str(index)))


RENAMED_TOPICS = {
    Preset.DEFAULT: {},
    Preset.KITTI2BAG: {
        '/kitti/velo/points': '/kitti/velo/pointcloud',
        '/kitti/oxts/fix': '/kitti/oxts/gps/fix',
        '/kitti/oxts/vel_with_covariance': '/kitti/oxts/gps/vel_with_covariance',
        '/kitti/oxts/vel': '/kitti/oxts/gps/vel',
    },
}


def rename_topic(topic: str, preset: Preset) -> str:
    """Return a topic's name under a preset."""
    for default, renamed in RENAMED_TOPICS[preset].items():
        topic = topic.replace(default, renamed)
    return topic


IMAGE_TOPICS = ('image_rect', 'image_raw', 'image')
"""The possible names of images. Other versions of kitti2bag write "image"."""


def image_topic(layout: Layout, own: str, preset: Preset) -> str:
    """Return the last part of an image topic's name.

    Args:
        layout: Of the recording.
        own: image_rect, or image_raw where the images are not rectified.
        preset: kitti2bag 1.5 calls the images of raw drives image_raw although they are rectified,
            and those of odometry image_rect (save_camera_data).
    """
    return 'image_raw' if preset is Preset.KITTI2BAG and layout.traits.extracts else own


def make_frames(preset: Preset, cameras: Mapping[int, str]) -> FrameNames:
    """Return the frame names of a preset, for a rig whose cameras have names."""
    named = {**CAMERA_NAMES, **cameras}
    if preset is Preset.KITTI2BAG:
        return FrameNames(map='world', camera_pattern='camera_{}', cameras=named)
    return FrameNames(cameras=named)


def with_ground_truth_tree(frames: FrameNames, options: MessageOptions) -> FrameNames:
    """Return the frame names with the ground truth's own ones, if the options request them.

    Raises:
        UsageError: One of these is a frame of the sensors, which would join both trees.
    """
    if not options.ground_truth_tree:
        return frames
    own = options.ground_truth_map, options.ground_truth_base
    cameras = (frames.camera(index) for index in range(CAMERA_COUNT))
    sensors = {frames.base, frames.imu, frames.velo, *cameras}
    for name in own:
        if name in sensors:
            raise UsageError(f'{name} is a frame of the sensors; ground_truth_tree needs another')
    return replace(frames, map=own[0], truth=own[1])


def base_t_imu(options: MessageOptions) -> Transform:
    """Return base_T_imu: from the options, else from the preset."""
    of_preset = KITTI2BAG_BASE_T_IMU if options.preset is Preset.KITTI2BAG else BASE_T_IMU
    return Transform.from_translation(options.base_to_imu or of_preset)
