# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of frames and topics, by preset, and for the stacks of --for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.streams import CAMERA_COUNT, CAMERA_NAMES
from ..options.messages import BASE_T_IMU, KITTI2BAG_BASE_T_IMU, Preset
from ..stacks.stack_names import FRAMES, TOPICS, StackName

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


@dataclass(frozen=True)
class Naming:
    """One set of names.

    Attributes:
        topics: Topics of the preset default to their names, where they differ.
        frames: Frame names; cameras are numbered.
        raw_images: Whether images of layouts with extracts are called image_raw.
    """

    topics: Mapping[str, str] = field(default_factory=dict)
    frames: FrameNames = field(default_factory=FrameNames)
    raw_images: bool = False

    def topic(self, own: str) -> str:
        """Return the name of a topic of the preset default; its transports follow it."""
        for default, renamed in self.topics.items():
            if own.startswith(default) and own[len(default) :][:1] in {'', '/'}:
                return renamed + own[len(default) :]
        return own

    def image_topic(self, layout: Layout, own: str) -> str:
        """Return the last part of an image topic's name in the preset default.

        Args:
            layout: Of the recording.
            own: image_rect, or image_raw where the images are not rectified.
        """
        return 'image_raw' if self.raw_images and layout.traits.extracts else own

    def frames_of(self, cameras: Mapping[int, str]) -> FrameNames:
        """Return the frame names for a rig whose cameras have names."""
        return replace(self.frames, cameras={**CAMERA_NAMES, **cameras})


PRESETS = {
    Preset.DEFAULT: Naming(),
    # Version 1.5 calls the images of raw drives image_raw although they are rectified, and those of
    # odometry image_rect (save_camera_data).
    Preset.KITTI2BAG: Naming(
        {
            '/kitti/velo/points': '/kitti/velo/pointcloud',
            '/kitti/oxts/fix': '/kitti/oxts/gps/fix',
            '/kitti/oxts/vel': '/kitti/oxts/gps/vel',
            '/kitti/oxts/vel_with_covariance': '/kitti/oxts/gps/vel_with_covariance',
        },
        FrameNames(map='world', camera_pattern='camera_{}'),
        raw_images=True,
    ),
}


def _naming_for(stack: StackName) -> Naming:
    frames: dict[str, Any] = dict(FRAMES.get(stack, {}))
    return Naming(TOPICS.get(stack, {}), FrameNames(**frames))


STACK_NAMINGS: Mapping[StackName | None, Naming] = {
    stack: _naming_for(stack) for stack in StackName if stack in TOPICS or stack in FRAMES
}
"""Of the stacks that have names of their own; the others take those of the preset."""

IMAGE_TOPICS = ('image_rect', 'image_raw', 'image')
"""The possible names of images. Other versions of kitti2bag write "image"."""


def naming_of(options: MessageOptions) -> Naming:
    """Return the names for a stack that has names of its own, else those of the preset."""
    return STACK_NAMINGS.get(options.stack, PRESETS[options.preset])


def every_naming() -> list[Naming]:
    """Return the names of all presets and stacks: those that a bag of to-bag may have."""
    return [*PRESETS.values(), *STACK_NAMINGS.values()]


def make_frames(preset: Preset, cameras: Mapping[int, str]) -> FrameNames:
    """Return the frame names of a preset, for a rig whose cameras have names."""
    return PRESETS[preset].frames_of(cameras)


_OF_STACKS = {'map', 'odom'}  # REP 105


def with_ground_truth_tree(frames: FrameNames, options: MessageOptions) -> FrameNames:
    """Return the frame names with the ground truth's own ones, if the options request them.

    Raises:
        UsageError: One of these is a frame of the sensors, which would join both trees, or the
            moving one is a stack's, which would have two parents.
    """
    if not options.ground_truth.tree:
        return frames
    own = options.ground_truth.map, options.ground_truth.base
    cameras = (frames.camera(index) for index in range(CAMERA_COUNT))
    sensors = {frames.base, frames.imu, frames.velo, *cameras}
    for name in own:
        if name in sensors:
            raise UsageError(f'{name} is a frame of the sensors; ground_truth_tree needs another')
    if own[1] in {frames.map, *_OF_STACKS}:
        raise UsageError(f'{own[1]} is left to a stack; ground_truth_base needs another name')
    return replace(frames, map=own[0], truth=own[1])


def base_t_imu(options: MessageOptions) -> Transform:
    """Return base_T_imu: from the options, else from the preset."""
    of_preset = KITTI2BAG_BASE_T_IMU if options.preset is Preset.KITTI2BAG else BASE_T_IMU
    return Transform.from_translation(options.base_to_imu or of_preset)
