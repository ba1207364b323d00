# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters of the player, from the declared options."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.parameter import Parameter

from ..model.errors import UsageError
from ..options.declare import option, options_of
from ..options.parsers import parse_integer, parse_text
from ..options.table import PLAY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rclpy.node import Node

    from ..options.declare import Option

Value: TypeAlias = 'str | float | bool | list[str]'


@dataclass(frozen=True)
class _Commands:
    """Parameters that are no setting of a playback."""

    source: str = option(
        '', 'KITTI folder or bag; may be replaced by another at any time', parse_text, live=True
    )
    position: str = option(
        '',
        "set it to seek: a frame (12), seconds ('3.5s') or a time stamp",
        parse_text,
        live=True,
        any_type=True,
    )
    burst: int = option(
        0,
        'set it, while paused, to play so many messages at once',
        parse_integer,
        live=True,
        bounds=(0, 2**31),
    )


def _parameter(declared: Option) -> Option:
    """Return an option as a parameter, with a default of ROS's types."""
    default, meaning = declared.plain(declared.default), declared.meaning
    if declared.choices:
        meaning += f': {" or ".join(declared.choices)}'
    if declared.unset:
        default = [''] if isinstance(default, tuple) else ''
        meaning += f'; empty: {declared.unset}'
    return replace(declared, default=default, meaning=meaning)


PARAMETERS = (*options_of(_Commands), *map(_parameter, PLAY))
"""All parameters; the defaults '' and [''] stand for "not given"."""
COMMANDS = frozenset(each.name for each in options_of(_Commands))


def descriptor(parameter: Option) -> ParameterDescriptor:
    """Return the description that ROS shows."""
    described = ParameterDescriptor(
        name=parameter.name,
        description=parameter.meaning,
        read_only=not parameter.live,
        dynamic_typing=parameter.any_type,
    )
    if parameter.bounds and isinstance(parameter.default, float):
        low, high = parameter.bounds
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif parameter.bounds:
        low, high = map(int, parameter.bounds)
        described.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return described


def declare(node: Node) -> dict[str, Value]:
    """Declare all parameters and return their values by name.

    Raises:
        UsageError: A value that was given has another type, or is out of range.
    """
    values = {}
    for parameter in PARAMETERS:
        try:
            declared = node.declare_parameter(
                parameter.name, parameter.default, descriptor(parameter)
            )
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise UsageError(f'parameter {parameter.name}: {error}') from None
        values[parameter.name] = declared.value
    return values


def given(values: dict[str, Value]) -> dict[str, object]:
    """Return the settings among parameter values, by name; defaults are not given.

    So a stack may choose them.
    """
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    return {
        name: value
        for name, value in values.items()
        if name not in COMMANDS and value not in ('', [''], [], defaults[name])
    }


def to_parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """Return ROS parameters of the declared types from values by name."""
    parameters = {parameter.name: parameter for parameter in PARAMETERS}
    return [
        Parameter(name, value=_converted(value, parameters[name])) for name, value in values.items()
    ]


def _converted(value: Any, parameter: Option) -> Any:  # noqa: ANN401 - any value of YAML
    """Return a value from a command line or YAML in the declared type."""
    kind = type(parameter.default)
    if parameter.any_type or isinstance(value, kind):
        return value
    if kind in {int, float, list}:
        return kind(parameter.plain(parameter.parse(parameter.name, value)))
    return ','.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
