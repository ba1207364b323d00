# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player's parameters: one table, from which they are declared and understood."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
)
from rclpy.parameter import Parameter

from ..model.errors import UsageError
from ..model.streams import LAYOUT_NAMES
from ..options.playback import MOST_STEP, RATES
from ..options.table import DEFAULT_READ_AHEAD, MOST_READ_AHEAD

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.node import Node

Value: TypeAlias = 'str | float | bool | list[str]'


@dataclass(frozen=True)
class PlayerParameter:
    """One parameter.

    Attributes:
        name: As users write it.
        default: '' and [''] stand for "not given".
        description: A line for `ros2 param describe`.
        live: Whether it may change while the node runs.
        bounds: Lowest and highest value.
        any_type: Whether values of other types are taken as well, such as 12 for '12'.
    """

    name: str
    default: Value
    description: str
    live: bool = False
    bounds: tuple[float, float] | None = None
    any_type: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """What ROS tells about it."""
        descriptor = ParameterDescriptor(
            name=self.name,
            description=self.description,
            read_only=not self.live,
            dynamic_typing=self.any_type,
        )
        if self.bounds and isinstance(self.default, float):
            low, high = self.bounds
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif self.bounds:
            low, high = map(int, self.bounds)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        return descriptor


_P = PlayerParameter

PARAMETERS = (
    _P('source', '', 'KITTI folder or bag; another one may be given at any time', live=True),
    _P('layout', '', f'{LAYOUT_NAMES}; empty guesses', live=True),
    _P('sequence', '', 'drive, split or sequence of the source', live=True, any_type=True),
    _P('rate', 1.0, 'seconds of recording a second', live=True, bounds=RATES),
    _P('loop', 1, 'rounds to play; 0 or true is without end', live=True, any_type=True),
    _P('step', 1, 'frames that one play_next plays; 0 is a single sample', live=True,
       bounds=(0, MOST_STEP)),
    _P('position', '', "set it to seek: a frame (12), seconds ('3.5s') or a time stamp",
       live=True, any_type=True),
    _P('burst', 0, 'set it, while paused, to play so many messages at once', live=True,
       bounds=(0, 2**31)),
    _P('start_paused', False, 'wait for a resume'),
    _P('delay', 0.0, 'seconds before the first message', bounds=(0.0, 3600.0)),
    _P('clock', 100.0, '/clock messages a second; 0 is none', bounds=(0.0, 1000.0)),
    _P('lossless', False, 'go as fast as subscribers take it; no message is dropped'),
    _P('wait_for', '', 'nodes to wait for that subscribe; empty is 1 with lossless, else 0',
       any_type=True),
    _P('at_end', 'exit', 'exit or pause'),
    _P('stamps', 'original', "original: the recording's; now: those of the moment, no /clock"),
    _P('read_ahead', DEFAULT_READ_AHEAD, 'frames to read ahead', bounds=(1, MOST_READ_AHEAD)),
    _P('qos_overrides_path', '', 'file of QoS by topic, as ros2 bag play takes it'),
    _P('start', '', 'first frame, seconds from the start (3.5s) or time stamp', any_type=True),
    _P('end', '', 'last one, included', any_type=True),
    _P('topics', [''], 'topic names, * matches; empty is all'),
    _P('streams', [''], 'scan, image, image_0..4, oxts, pose, path, labels, calibration'),
    _P('images', 'both', 'compressed, raw or both; each is made only while subscribed'),
    _P('annotated', False, 'images with the labels drawn on; made only while subscribed'),
    _P('preset', 'default', 'names of topics and frames: default or kitti2bag'),
    _P('map', 'enu', "enu: east-north-up at the first base_link; devkit: KITTI's own poses"),
    _P('tf', True, 'map -> base_link on /tf; false where a SLAM stack owns it'),
    _P('ring_time', False, 'points also have ring and time, in order of time'),
    _P('scan_stamp', '', 'start or forward; empty is start with ring_time, else forward'),
    _P('semantic', False, "points also have SemanticKITTI's label, instance and rgb"),
    _P('base_to_imu', '', "x,y,z of imu_link in base_link, metres; empty is the preset's"),
    _P('epoch', '', 'UTC begin of recordings without absolute time'),
    _P('period', 0.1036, 'seconds a frame of recordings without time', bounds=(0.001, 60.0)),
    _P('marker_colors', 'class', 'class or track'),
    _P('trails', False, 'markers of where tracks were'),
    _P('ego_marker', True, 'a marker of the recording car'),
    _P('marker_alpha', 0.35, 'opacity of the boxes', bounds=(0.0, 1.0)),
    _P('marker_line_width', 0.05, 'metres', bounds=(0.001, 10.0)),
    _P('marker_arrow_length', 1.0, 'metres that a heading stands out', bounds=(0.01, 100.0)),
    _P('marker_text_height', 0.6, 'metres', bounds=(0.01, 100.0)),
    _P('marker_lifetime', 0.3, 'seconds that a marker stays; 0 is for ever', bounds=(0.0, 3600.0)),
)  # fmt: skip

COMMANDS = frozenset({'source', 'position', 'burst'})
"""What is no setting of a playback."""


def declare(node: Node) -> dict[str, Value]:
    """Declare all parameters; returns their values by name.

    Raises:
        UsageError: A value that was given has another type, or is out of range.
    """
    values = {}
    for parameter in PARAMETERS:
        try:
            declared = node.declare_parameter(
                parameter.name, parameter.default, parameter.descriptor()
            )
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise UsageError(f'parameter {parameter.name}: {error}') from None
        values[parameter.name] = declared.value
    return values


def given(values: dict[str, Value]) -> dict[str, object]:
    """The settings among parameter values, by name; what is empty is not given."""
    return {
        name: value
        for name, value in values.items()
        if name not in COMMANDS and value not in ('', [''], [])
    }


def to_parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """ROS parameters from values by name, of the types that are declared."""
    defaults = {parameter.name: parameter for parameter in PARAMETERS}
    made = []
    for name, value in values.items():
        kind = type(defaults[name].default)
        fits = isinstance(value, kind) or defaults[name].any_type
        made.append(Parameter(name, value=value if fits else kind(value)))
    return made
