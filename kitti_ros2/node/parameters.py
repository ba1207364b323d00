# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters of the player, from the declared options."""

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
from ..options.table import PLAY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.node import Node

    from ..options.declare import Option

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
        any_type: Whether values of other types are accepted as well, such as 12 for '12'.
        option: The option that it sets; None for a command such as a seek.
    """

    name: str
    default: Value
    description: str
    live: bool = False
    bounds: tuple[float, float] | None = None
    any_type: bool = False
    option: Option | None = None

    def descriptor(self) -> ParameterDescriptor:
        """Return the description that ROS shows."""
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

    def convert(self, value: Any) -> Any:  # noqa: ANN401 - any value of YAML
        """Return a value from a command line or YAML in the declared type."""
        kind = type(self.default)
        if self.any_type or isinstance(value, kind):
            return value
        if self.option is not None and kind in {int, float, list}:
            parsed = self.option.parse(self.name, value)
            return kind(self.option.plain(parsed))
        return ','.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _parameter(option: Option) -> PlayerParameter:
    """Return the parameter of an option."""
    default, description = option.plain(option.default), option.meaning
    if option.unset:
        default = [''] if isinstance(default, tuple) else ''
        description += f'; empty: {option.unset}'
    return PlayerParameter(
        option.name,
        default,
        description,
        live=option.live,
        bounds=option.bounds,
        any_type=option.any_type,
        option=option,
    )


_COMMANDS = (
    PlayerParameter(
        'source', '', 'KITTI folder or bag; may be replaced by another at any time', live=True
    ),
    PlayerParameter(
        'position',
        '',
        "set it to seek: a frame (12), seconds ('3.5s') or a time stamp",
        live=True,
        any_type=True,
    ),
    PlayerParameter(
        'burst',
        0,
        'set it, while paused, to play so many messages at once',
        live=True,
        bounds=(0, 2**31),
    ),
)
PARAMETERS = (*_COMMANDS, *map(_parameter, PLAY))
COMMANDS = frozenset(each.name for each in _COMMANDS)
"""Parameters that are no setting of a playback."""


def declare(node: Node) -> dict[str, Value]:
    """Declare all parameters and return their values by name.

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
    """Return the settings among parameter values, by name; empty ones are not given."""
    return {
        name: value
        for name, value in values.items()
        if name not in COMMANDS and value not in ('', [''], [])
    }


def to_parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """Return ROS parameters of the declared types from values by name."""
    parameters = {parameter.name: parameter for parameter in PARAMETERS}
    return [
        Parameter(name, value=parameters[name].convert(value)) for name, value in values.items()
    ]
