# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Texts of parameter files, in the formats that stacks read."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import numpy.typing as npt

    from ..model.geometry import Transform

_DIGITS = 9


def numbers(values: npt.ArrayLike) -> list[float]:
    """Return the values of an array, row by row, as numbers of a text file."""
    return [round(float(each), _DIGITS) + 0.0 for each in np.asarray(values, np.float64).ravel()]


def place_and_quaternion(a_t_b: Transform) -> list[float]:
    """Return x y z qx qy qz qw."""
    return numbers([*a_t_b.translation, *a_t_b.quaternion()])


def quaternion_and_place(a_t_b: Transform) -> list[float]:
    """Return qx qy qz qw x y z."""
    return numbers([*a_t_b.quaternion(), *a_t_b.translation])


def ros_parameters(values: Mapping[str, Any], node: str = '/**') -> str:
    """Return a file of ROS parameters of a node; /** is any."""
    return plain_yaml({node: {'ros__parameters': {'use_sim_time': True, **values}}})


def plain_yaml(values: Mapping[str, Any]) -> str:
    """Return a YAML file: a line for each value, lists on one line."""
    return ''.join(f'{line}\n' for line in _lines(values))


def _lines(values: Mapping[str, Any]) -> Iterator[str]:
    import yaml  # noqa: PLC0415 - for one command

    for name, value in values.items():
        if isinstance(value, dict):
            yield f'{name}:'
            yield from (f'  {line}' for line in _lines(value))
        else:
            text = yaml.safe_dump(value, default_flow_style=True, width=float('inf'))
            yield f'{name}: {text.splitlines()[0]}'


def opencv_yaml(values: Mapping[str, str | float | int]) -> str:
    """Return a file of OpenCV's FileStorage: flat, with texts in quotes."""
    lines = (
        f'{name}: "{value}"' if isinstance(value, str) else f'{name}: {value}'
        for name, value in values.items()
    )
    return '\n'.join(['%YAML:1.0', '---', *lines, ''])


def json_text(values: Mapping[str, Any]) -> str:
    """Return a JSON file."""
    return json.dumps(values, indent=2) + '\n'
