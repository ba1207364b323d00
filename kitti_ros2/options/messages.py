# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the messages of a recording: names, frames, fields, markers, ground truth, --for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar

from ..model.bag_formats import FORMATS, Points
from ..model.classes import KITTI_OVERLAPS, LeastOverlaps, check_labels
from ..model.errors import UsageError
from .declare import (
    check_bounds,
    choice,
    option,
    parse_choice,
    parse_flag,
    parse_labels,
    parse_number,
    parse_position,
    parse_seconds_ns,
    parse_text,
)
from .stack_names import StackName

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from .declare import Option


# Options of the markers of labels.


class MarkerColors(str, Enum):
    """Property that determines the colour of an object's markers."""

    CLASS = 'class'
    TRACK = 'track'


@dataclass(frozen=True)
class MarkerOptions:
    """Options of the markers of labels.

    Attributes:
        colors: One colour per class, or one per track.
        alpha: Opacity of the boxes, 0..1.
        line_width: Width of edges and trails, metres.
        arrow_length: How far a heading arrow extends beyond its box, metres.
        text_height: Height of the text, metres.
        lifetime_ns: Nanoseconds after which viewers remove a marker; 0 never.
        trails: Whether tracks show their past positions.
        ego: Whether the recording car is drawn.

    Raises:
        UsageError: A size is not positive, or alpha is out of range.
    """

    group: ClassVar = 'Label markers'

    colors: MarkerColors = choice(
        MarkerColors.CLASS, 'One colour per class or per track', MarkerColors, name='marker_colors'
    )
    alpha: float = option(
        0.35,
        'Opacity of label boxes',
        parse_number,
        name='marker_alpha',
        bounds=(0.0, 1.0),
        config_only=True,
    )
    line_width: float = option(
        0.05,
        'Width of label edges and trails, metres',
        parse_number,
        name='marker_line_width',
        bounds=(0.001, 10.0),
        config_only=True,
    )
    arrow_length: float = option(
        1.0,
        'How far a heading arrow extends beyond its box, metres',
        parse_number,
        name='marker_arrow_length',
        bounds=(0.01, 100.0),
        config_only=True,
    )
    text_height: float = option(
        0.6,
        'Height of label text, metres',
        parse_number,
        name='marker_text_height',
        bounds=(0.01, 100.0),
        config_only=True,
    )
    lifetime_ns: int = option(
        300_000_000,
        'Seconds after which a label marker disappears; 0 is never',
        parse_seconds_ns,
        name='marker_lifetime',
        bounds=(0.0, 3600.0),
        config_only=True,
    )
    trails: bool = option(False, 'Label markers also show the past positions of tracks', parse_flag)
    ego: bool = option(True, 'Marker of the recording car', parse_flag, name='ego_marker')

    def __post_init__(self) -> None:
        check_bounds(self, 'marker_alpha')
        for name in ('line_width', 'arrow_length', 'text_height'):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise UsageError(
                    f'marker {name} {getattr(self, name):g} is not positive, in metres'
                )
        if self.lifetime_ns < 0:
            raise UsageError('the lifetime of markers is negative')


# Options of a TF tree of the ground truth alone.

_MAP, _BASE = 'map_gt', 'base_link_gt'


@dataclass(frozen=True)
class GroundTruthOptions:
    """Options of a TF tree of the ground truth alone.

    Attributes:
        tree: Whether the poses are on a TF tree of their own, so that a stack may own map, odom
            and base_link.
        map, base: The frames of that tree.

    Raises:
        UsageError: A frame is invalid, or given without the tree.
    """

    group: ClassVar = 'Ground truth'

    tree: bool = option(
        False,
        'Ground truth on a TF tree of its own; map, odom and base_link are left to a stack',
        parse_flag,
        name='ground_truth_tree',
    )
    map: str = option(
        _MAP,
        'With --ground-truth-tree: its fixed frame',
        parse_text,
        name='ground_truth_map',
        metavar='FRAME',
    )
    base: str = option(
        _BASE,
        'With --ground-truth-tree: its moving frame',
        parse_text,
        name='ground_truth_base',
        metavar='FRAME',
    )

    def __post_init__(self) -> None:
        frames = self.map, self.base
        if not self.tree:
            if frames != (_MAP, _BASE):
                raise UsageError(
                    'ground_truth_map and ground_truth_base are for ground_truth_tree; give it too'
                )
            return
        for name in frames:
            if not name or name.startswith('/') or any(map(str.isspace, name)):
                raise UsageError(f'{name!r} is not a TF frame: no blanks, and no / at the start')
        if frames[0] == frames[1]:
            raise UsageError(f'ground_truth_map and ground_truth_base are both {frames[0]}')


# Options of the messages of a recording: names, frames, fields, markers.


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


class Fisheye(str, Enum):
    """Images of fisheyes: their own alone, or a pinhole view beside each of them."""

    RAW = 'raw'
    PINHOLE = 'pinhole'


class Clouds(str, Enum):
    """Form of clouds: the bytes of their points, or compressed as Cloudini does it."""

    PLAIN = 'plain'
    COMPACT = 'compact'


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
        map: Axes and origin of the map frame; see messages/naming.py.
        publish_tf: Whether map -> base_link is on /tf; off where a SLAM stack publishes it.
        ring_and_time: Short for points xyzirt.
        base_to_imu: x, y, z of imu_link in base_link, metres; None takes the preset's.
        semantic: Whether points also have SemanticKITTI's label, instance and rgb.
        markers: Options of the markers of labels.
        overlaps: The IoU above which a prediction is a true positive.
        annotated: Whether images with the labels drawn on them are published, too.
        objects: Message types of 3D boxes: vision_msgs, autoware_perception_msgs, or both.
        autoware_labels: Pairs of a class and the name of its label in Autoware, where it differs
            from model/classes.py.
        annotations: Whether 2D boxes are published as foxglove_msgs/ImageAnnotations, too.
        covariances: Whether Imu messages have covariances, and a TwistWithCovarianceStamped is
            published, too; None is not.
        points: Format of clouds; None follows ring_and_time.
        clouds: plain or compact.
        fisheye: raw or pinhole; see messages/pinhole_view.py.
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
        Images.COMPRESSED,
        "The PNG file's own bytes (compressed) or its pixels (raw)",
        Images,
        common=True,
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
        parse_position,
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
    clouds: Clouds = choice(
        Clouds.PLAIN,
        'Clouds as they are (plain), or in a quarter of their size, within half a millimetre, with'
        " what gives the files' bytes again (compact)",
        Clouds,
    )
    fisheye: Fisheye = choice(
        Fisheye.RAW,
        'Images of fisheyes as they are (raw), or also as a rectified view of 100 degrees, which'
        ' every consumer of CameraInfo can use (pinhole)',
        Fisheye,
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
        choices=tuple(stack.value for stack in StackName),
        unset='none',
        flags=('--for',),
        metavar='STACK',
        common=True,
    )

    @property
    def cloud(self) -> Points:
        """The format of clouds."""
        return self.points or (Points.XYZIRT if self.ring_and_time else Points.XYZI)

    @property
    def decodes_images(self) -> bool:
        """Whether messages are made of the pixels of images."""
        return self.images is not Images.COMPRESSED or self.fisheye is Fisheye.PINHOLE

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
            extensible = ' or '.join(kind.value for kind in Points if FORMATS[kind].extensible)
            raise UsageError(
                f'semantic adds fields, but points {self.cloud.value} has a fixed set of them;'
                f' take points {extensible}'
            )
        if self.clouds is Clouds.COMPACT and (self.cloud is not Points.XYZI or self.semantic):
            raise UsageError(
                'clouds compact have the points of the files: take points xyzi, without semantic'
            )
        position = self.base_to_imu or BASE_T_IMU
        if len(position) != 3 or not all(math.isfinite(value) for value in position):
            raise UsageError(f'base_to_imu {position} is not three finite numbers, metres')
        check_labels(dict(self.autoware_labels))
        if self.autoware_labels and self.objects is Objects.VISION:
            raise UsageError('autoware_labels is for objects autoware or both; give both')


# Options that a stack needs, for --for.


def with_stack(parsed: Mapping[str, Any], declared: Sequence[Option]) -> dict[str, Any]:
    """Add the options that the stack of a command needs to those that are given.

    Args:
        parsed: Parsed values by name of option, without defaults.
        declared: The options of the command.

    Raises:
        UsageError: A given value does not meet the demands of the stack.
    """
    name = parsed.get('stack')
    if name is None:
        return dict(parsed)
    from .stack_catalogue import STACKS  # noqa: PLC0415 - for --for only

    completed = dict(parsed)
    options = {opt.name: opt for opt in declared}
    for option_name, values in STACKS[name.value].settings.items():
        option = options[option_name]
        accepted = [option.parse(option.name, value) for value in values]
        chosen = completed.setdefault(option.name, accepted[0])
        if chosen not in accepted:
            needed = ' or '.join(_word(value) for value in values)
            raise UsageError(
                f'{name.value} needs {option.name} {needed}, not {_word(option.plain(chosen))};'
                f' leave out one of --for and --{option.name.replace("_", "-")}'
            )
    return completed


def _word(value: object) -> str:
    return {True: 'on', False: 'off'}[value] if isinstance(value, bool) else str(value)
