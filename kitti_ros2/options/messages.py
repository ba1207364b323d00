# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the messages of a recording: names, frames, fields, markers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar

from ..model.autoware_labels import check_labels
from ..model.cloud_formats import FORMATS, Points
from ..model.errors import UsageError
from ..model.least_overlaps import KITTI_OVERLAPS, LeastOverlaps
from ..stacks.stack_names import StackName
from .class_parsers import parse_labels
from .declare import choice, option
from .ground_truth import GroundTruthOptions
from .markers import MarkerOptions
from .parsers import parse_choice, parse_flag
from .quantity_parsers import parse_place


class Preset(str, Enum):
    """Sets of topic and frame names."""

    DEFAULT = 'default'
    KITTI2BAG = 'kitti2bag'


class MapFrame(str, Enum):
    """Axes of the map frame: east-north-up from the first base_link, or those of KITTI's poses."""

    ENU = 'enu'
    DEVKIT = 'devkit'


class Objects(str, Enum):
    """Types of messages with 3D boxes: vision_msgs, autoware_perception_msgs, or both."""

    VISION = 'vision'
    AUTOWARE = 'autoware'
    BOTH = 'both'


class ColorEncoding(str, Enum):
    """Encodings of the pixels of colour images, by their names in sensor_msgs/Image."""

    RGB8 = 'rgb8'
    BGR8 = 'bgr8'
    MONO8 = 'mono8'


class StereoFrame(str, Enum):
    """Frames of right images in stereo pairs: their own, or that of the left ones."""

    OWN = 'own'
    LEFT = 'left'


class Images(str, Enum):
    """Form of images: the bytes of the PNG file, decoded pixels, or both."""

    COMPRESSED = 'compressed'
    RAW = 'raw'
    BOTH = 'both'


BASE_T_IMU = (-0.05, 0.32, 0.93)
KITTI2BAG_BASE_T_IMU = (-1.405, 0.32, 0.93)


def _parse_stack(_name: str, value: object) -> StackName:
    """Parse the name of a stack; errors have the word of the command line, too."""
    return parse_choice(StackName)('--for (stack)', value)


@dataclass(frozen=True)
class MessageOptions:
    """Options of messages: which are created, and how.

    Attributes:
        images: compressed, raw or both.
        preset: Set of topic and frame names.
        map: Axes and origin of the map frame; see messages/map_frame.py.
        publish_tf: Whether map -> base_link is on /tf; off where a SLAM stack publishes it.
        ring_and_time: Short for points xyzirt.
        base_to_imu: x, y, z of imu_link in base_link, metres; None takes the preset's.
        semantic: Whether points also have SemanticKITTI's label, instance and rgb.
        markers: Options of the markers of labels.
        overlaps: The IoU above which a prediction is a true positive.
        annotated: Whether images with the labels drawn on them are published, too.
        objects: Message types of 3D boxes: vision_msgs, autoware_perception_msgs, or both.
        autoware_labels: Pairs of a class and the name of its label in Autoware, where it differs
            from model/autoware_labels.py.
        annotations: Whether 2D boxes are published as foxglove_msgs/ImageAnnotations, too.
        covariances: Whether Imu messages have covariances, and a TwistWithCovarianceStamped is
            published, too; None is not.
        points: Format of clouds; None follows ring_and_time.
        ground_truth: Options of a TF tree of the poses alone.
        stereo: Whether cameras have the CameraInfo of a stereo pair; see messages/camera_info.py.
            The stamps of pairs are of ReadOptions.
        stereo_frame: The frame of right images in those pairs.
        color_encoding: Encoding of the pixels of colour images; grey ones are mono8 or mono16.
        stack: The stack whose names topics and frames have; None: those of preset.

    Raises:
        UsageError: base_to_imu is not three finite numbers, Autoware has no such label, or
            options exclude each other.
    """

    group: ClassVar = 'Messages'

    images: Images = choice(
        Images.COMPRESSED, "The PNG file's own bytes (compressed) or its pixels (raw)", Images
    )
    preset: Preset = choice(Preset.DEFAULT, 'Names of topics and frames', Preset)
    map: MapFrame = choice(
        MapFrame.ENU,
        "Map frame: east-north-up at the first base_link, or that of KITTI's poses",
        MapFrame,
    )
    publish_tf: bool = option(
        True, 'map -> base_link on /tf; off where a SLAM stack publishes it', parse_flag, name='tf'
    )
    ring_and_time: bool = option(
        False,
        'Short for points xyzirt: ring and time, in order of time',
        parse_flag,
        name='ring_time',
    )
    base_to_imu: tuple[float, ...] | None = option(
        None,
        'x,y,z of imu_link in base_link, metres',
        parse_place,
        unset="the preset's, -0.05,0.32,0.93",
        metavar='X,Y,Z',
    )
    semantic: bool = False
    overlaps: LeastOverlaps = KITTI_OVERLAPS
    markers: MarkerOptions = field(default_factory=MarkerOptions)
    ground_truth: GroundTruthOptions = field(default_factory=GroundTruthOptions)
    annotated: bool = option(False, 'Also images with the labels drawn on them', parse_flag)
    objects: Objects = choice(
        Objects.VISION,
        '3D boxes as vision_msgs, as autoware_perception_msgs (autoware), or both',
        Objects,
    )
    autoware_labels: tuple[tuple[str, str], ...] = option(
        (),
        "Autoware's label of a class, where another one is wanted: Van=TRUCK Tram=BUS",
        parse_labels,
        unset='the table in the documentation',
        metavar='CLASS=LABEL...',
    )
    annotations: bool = option(
        False, '2D boxes also as foxglove_msgs/ImageAnnotations, for the Image panel', parse_flag
    )
    covariances: bool | None = option(
        None,
        'Covariances in Imu, and a TwistWithCovarianceStamped',
        parse_flag,
        unset='on with 100 Hz packets, else off',
        any_type=True,
    )
    points: Points | None = choice(
        None,
        'Format of clouds: fields, types and order of points',
        Points,
        unset='xyzi; xyzirt for ring and time',
    )
    stereo: bool = False
    stereo_frame: StereoFrame = choice(
        StereoFrame.OWN,
        'With --stereo: right images in their own frame, or in that of the left ones',
        StereoFrame,
    )
    color_encoding: ColorEncoding = choice(
        ColorEncoding.BGR8, 'Encoding of raw colour images', ColorEncoding
    )
    stack: StackName | None = option(
        None,
        'Options, topics and frames that a stack expects, see kitti-ros2 stacks',
        _parse_stack,
        choices=tuple(each.value for each in StackName),
        unset='none',
        flags=('--for',),
        metavar='STACK',
    )

    @property
    def cloud(self) -> Points:
        """The format of clouds."""
        return self.points or (Points.XYZIRT if self.ring_and_time else Points.XYZI)

    @property
    def own_frames(self) -> bool:
        """Whether each right camera of a stereo pair names its own frame."""
        return self.stereo and self.stereo_frame is StereoFrame.OWN

    def __post_init__(self) -> None:
        if self.stereo_frame is not StereoFrame.OWN and not self.stereo:
            raise UsageError('stereo_frame is for stereo; give both')
        if self.ring_and_time and self.cloud is not Points.XYZIRT:
            raise UsageError(
                f'ring_time is short for points xyzirt and does not go with points'
                f' {self.cloud.value}; give one of them'
            )
        if self.semantic and not FORMATS[self.cloud].extensible:
            extensible = ' or '.join(each.value for each in Points if FORMATS[each].extensible)
            raise UsageError(
                f'semantic adds fields, but points {self.cloud.value} has a fixed set of them;'
                f' take points {extensible}'
            )
        place = self.base_to_imu or BASE_T_IMU
        if len(place) != 3 or not all(math.isfinite(value) for value in place):
            raise UsageError(f'base_to_imu {place} is not three finite numbers, metres')
        check_labels(dict(self.autoware_labels))
        if self.autoware_labels and self.objects is Objects.VISION:
            raise UsageError('autoware_labels is for objects autoware or both; give both')
