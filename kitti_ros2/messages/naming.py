# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of frames and topics, by preset, and for the stacks of --for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.image_files import decode_image
from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.streams import CAMERA_COUNT, CAMERA_NAMES, PngForm, Stream
from ..options.messages import BASE_T_IMU, KITTI2BAG_BASE_T_IMU, MapFrame, Preset
from ..options.stack_names import FRAMES, TOPICS, StackName

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path, PurePath

    from ..model.geometry import Float64Array
    from ..model.recording import ReadableRecording, Start
    from ..model.samples import (
        Calibration,
        CompactScan,
        Float32Array,
        FrameLabels,
        Image,
        Pose,
        Trajectory,
    )
    from ..model.streams import Layout
    from ..options.messages import MessageOptions
    from .images import Pixels


@dataclass(frozen=True)
class FrameNames:
    """Frame names.

    Attributes:
        map: Fixed to the world; its origin is the first position of base.
        base: On the ground below the middle of the rear axle.
        truth: The same frame, as the ground truth poses name it: base, unless these have a TF tree
            of their own.
        imu: The GPS/IMU (x forward, y left, z up).
        velo: The laser scanner (x forward, y left, z up).
        sick: KITTI-360's line scanner; it scans in y and z.
        camera_pattern: Optical frames (x right, y down, z forward), {} the camera's name.
        cameras: Camera index to its name.
    """

    map: str = 'map'
    base: str = 'base_link'
    imu: str = 'imu_link'
    velo: str = 'velo_link'
    sick: str = 'sick_link'
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
            layout: Layout of the recording.
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
"""Names by stack; stacks that are absent take those of the preset."""

IMAGE_TOPICS = ('image_rect', 'image_raw', 'image')
"""The possible names of images. Other versions of kitti2bag write "image"."""


_TRANSPORTS = ('compressed', 'ffmpeg', 'foxglove')


def without_transport(topic: str) -> str:
    """Return an image topic without the name of its transport (image_transport, its plugins)."""
    name, _, transport = topic.rpartition('/')
    return name if name and transport in _TRANSPORTS else topic


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
    sensors = {frames.base, frames.imu, frames.velo, frames.sick, *cameras}
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


# The frame map: the fixed frame of the poses in messages.
#
# - enu (REP-103, REP-105): x east, y north, z up, the origin at the first base_link position. A
#   layout without gravity (odometry) has no such axes: there map is base_link at the first pose.
# - devkit: KITTI's own poses, relative to the first one: imu_link at the first packet is map, so
#   the axes are tilted by its roll and pitch (convertOxtsToPose.m).
#
# The first pose is that of the whole recording, so every part of it has the same map.


def map_from_world(start: Start | None, base_t_imu: Transform, kind: MapFrame) -> Transform:
    """Return map_T_world: a reader's fixed frame in map.

    Args:
        start: The first pose, None for a recording without poses.
        base_t_imu: imu_link in base_link.
        kind: The kind of map.
    """
    if start is None:
        return Transform.identity()
    if kind is MapFrame.DEVKIT:
        return start.world_T_imu.inverse() if start.level else Transform.identity()
    imu_t_base = base_t_imu.inverse()
    level = np.eye(3) if start.level else (start.world_T_imu @ imu_t_base).rotation.T
    # Composed in the same way as the other poses, so that the first position is exactly 0.
    first = Transform(level, np.zeros(3)) @ start.world_T_imu @ imu_t_base
    return Transform(level, -first.translation)


def has_no_gravity(start: Start | None, kind: MapFrame) -> bool:
    """Return whether map is requested to be east-north-up and cannot be."""
    return start is not None and not start.level and kind is MapFrame.ENU


def pose_in_map(pose: Pose, map_t_world: Transform) -> Pose:
    """Transform a reader's pose to map."""
    return replace(pose, world_T_imu=map_t_world @ pose.world_T_imu)


def trajectory_in_map(trajectory: Trajectory, map_t_world: Transform) -> Trajectory:
    """Transform a reader's trajectory to map."""
    return replace(trajectory, world_T_imu=[map_t_world @ pose for pose in trajectory.world_T_imu])


# The context of a conversion between a sample and its messages.

LABELLED_CAMERA = 2
"""The camera of KITTI's labels: the left colour camera."""


@dataclass(frozen=True)
class Rig:
    """The parameters common to all messages of a recording.

    Attributes:
        frames: Frame names.
        cameras: Cameras whose images or labels are in messages.
        base_t_imu: imu_link in base_link.
        map_T_world: The fixed frame of the reader's poses in map.
        options: Options of the messages.
        tracked: Whether labels have tracks.
        labelled_camera: The camera of 2D boxes.
    """

    frames: FrameNames
    cameras: frozenset[int]
    base_t_imu: Transform
    map_T_world: Transform
    options: MessageOptions
    tracked: bool = False
    labelled_camera: int = LABELLED_CAMERA


@dataclass(frozen=True)
class EncodeContext:
    """The context of an encoder besides its sample.

    Attributes:
        rig: The parameters common to all messages.
        stamp_ns: The sample's own.
        path: Returns its file, for errors.
        calibration: Returns the calibration of the sample's frame.
        trails: Returns the earlier positions of the tracks in the sample's frame, in the reader's
            fixed frame.
        camera: KITTI camera index of an image.
        pixels: Decodes an image.
        labels: Returns the labels of the sample's frame; None if it is not labelled.
        predictions: Returns the predictions of the sample's frame; None without any.
        note: Called with a note on values of the messages that are estimated.
        compact: Rounds the points of a scan to KITTI's grid; for compact clouds alone.
    """

    rig: Rig
    stamp_ns: int
    path: Callable[[], Path]
    calibration: Callable[[], Calibration]
    trails: Callable[[], Mapping[int, Float64Array]]
    camera: int = 0
    pixels: Callable[[Image], Pixels] = decode_image
    labels: Callable[[], FrameLabels | None] = lambda: None
    predictions: Callable[[], FrameLabels | None] = lambda: None
    note: Callable[[str], None] = lambda _: None
    compact: Callable[[Float32Array], CompactScan] | None = None

    @property
    def at_imu(self) -> tuple[int, str]:
        """Stamp and frame of the messages of a packet."""
        return self.stamp_ns, self.rig.frames.imu


@dataclass(frozen=True)
class BagContext:
    """The context of a decoder besides its message.

    Attributes:
        path: The bag, or the file that is made of the message, for errors.
        base_t_imu: imu_link in base_link, for poses.
        png: The form of the files that are made of pixels.
    """

    path: PurePath
    base_t_imu: Transform = field(default_factory=Transform.identity)
    png: PngForm = PngForm.FAST


def make_rig(recording: ReadableRecording, options: MessageOptions) -> Rig:
    """Make the parameters common to all messages of a recording."""
    mount = base_t_imu(options)
    boxed = {Stream.LABELS, Stream.PREDICTIONS} & recording.streams.keys()
    labelled = {recording.layout.traits.main_camera} if boxed else set()
    cameras = {**recording.layout.traits.camera_names, **recording.cameras}
    return Rig(
        frames=with_ground_truth_tree(naming_of(options).frames_of(cameras), options),
        cameras=frozenset(recording.cameras) | labelled,
        base_t_imu=mount,
        map_T_world=map_from_world(recording.start, mount, options.map),
        options=options,
        tracked=recording.layout.traits.tracked_labels,
        labelled_camera=recording.layout.traits.main_camera,
    )


# Topics of the files that are restored byte for byte, and keys of the description.

RECORDING = '/kitti/source/recording'
FILES = '/kitti/source/files'
CALIBRATION = '/kitti/source/calibration'
SWEEP = '/kitti/source/sweep'
FILE_CHECKS = '/kitti/source/'
"""Followed by the stream of images that a bag has as pixels alone."""
POINTS = '/kitti/source/points'
REST = '/kitti/source/rest'
"""What the files of scans are besides clouds that are rounded to a grid."""
LABEL_LINES = '/kitti/source/labels'
OXTS_LINES = '/kitti/source/oxts'

COMPACT = 'compact'
"""Key of the description: whether clouds are rounded to KITTI's grid."""
GREY = 'grey'
"""Key of the description: the streams of colour images whose pixels are in messages as grey."""
