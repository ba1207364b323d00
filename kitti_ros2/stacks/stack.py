# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The description of a stack: what it demands, and how a recording meets it.

A stack's own files are described in its own words; the names of topics and frames on our side are
those of the preset default.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .stack_names import FRAMES, TOPICS, StackName

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import numpy.typing as npt

    from ..model.geometry import Transform


# What parameter files need to know of a drive: transforms, cameras, rates, the scanner.


@dataclass(frozen=True)
class CameraFacts:
    """A rectified camera.

    Attributes:
        fx, fy, cx, cy: Pixels.
        baseline: Metres between it and the camera left of it; 0 for a left camera.
        width, height: Pixels; 0 if there is no image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    width: int
    height: int


@dataclass(frozen=True)
class RigFacts:
    """The rig of a drive, in the convention of the package: a_T_b maps points of b to a.

    Attributes:
        base_T_imu: imu_link in base_link.
        imu_T_velo: velo_link in imu_link.
        cameras: By KITTI's index.
        imu_hz: Rate of the Imu.
        scan_hz: Rate of the scans.
        rings: Lasers of the scanner.
        lowest_deg, highest_deg: Elevations of the lasers, or of points beyond them.
        columns: Firings of a laser in a turn.
        most_range: Range of the scanner, metres.
        deskew: Whether points have times; scans of odometry sequences are compensated.
    """

    base_T_imu: Transform
    imu_T_velo: Transform
    cameras: Mapping[int, CameraFacts] = field(default_factory=dict)
    imu_hz: float = 10.0
    scan_hz: float = 10.0
    rings: int = 64
    lowest_deg: float = -24.8
    highest_deg: float = 2.0
    columns: int = 2083
    most_range: float = 120.0
    deskew: bool = True

    @property
    def velo_T_imu(self) -> Transform:
        """imu_link in velo_link."""
        return self.imu_T_velo.inverse()

    @property
    def base_T_velo(self) -> Transform:
        """velo_link in base_link."""
        return self.base_T_imu @ self.imu_T_velo


if TYPE_CHECKING:
    SettingsMaker: TypeAlias = Callable[[RigFacts], Mapping[str, str]]

Value: TypeAlias = 'str | bool'
_SLACK = 0.8
"""The share of a rate that is near enough."""


@dataclass(frozen=True)
class Citation:
    """A place in the text of a stack.

    Attributes:
        repository: OWNER/NAME on GitHub, or the address of a page.
        commit: First digits of the commit that was read; '' for a page.
        file: Path within the repository.
        line: Line of the demand in that version; 0 stands for the symbol or the whole file.
        symbol: Function, class or parameter, where the line is not known.
    """

    repository: str
    commit: str
    file: str
    line: int = 0
    symbol: str = ''

    def __str__(self) -> str:
        place = f':{self.line}' if self.line else f' {self.symbol}' if self.symbol else ''
        commit = f'@{self.commit}' if self.commit else ''
        return f'{self.repository}{commit} {self.file}{place}'.strip()


@dataclass(frozen=True)
class Demand:
    """One demand of a stack.

    Attributes:
        key: Short name; unique within the stack.
        text: What messages must be, in one sentence.
        source: Where the stack says so.
        of_option: The option that meets it, where only the user can give its value.
    """

    key: str
    text: str
    source: Citation
    of_option: str = ''


@dataclass(frozen=True)
class Setting:
    """An option of messages, and the value that a stack needs.

    Attributes:
        name: Of the option.
        value: As in a YAML file.
        others: Further values that meet the demands; a user may choose them.
    """

    name: str
    value: Value
    others: tuple[Value, ...] = ()


@dataclass(frozen=True)
class Node:
    """A node of a launch file.

    Attributes:
        package, executable, name: As in launch_ros.
        remappings: Topics of the node to others.
        arguments: Words of its command line; {dir} is the folder of its parameters.
        parameters: Whether it reads the file of parameters.
        values: Further parameters; {dir} as above.
        component: The class of a composable node, instead of an executable.
    """

    package: str
    executable: str
    name: str = ''
    remappings: Mapping[str, str] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()
    parameters: bool = True
    values: Mapping[str, str] = field(default_factory=dict)
    component: str = ''


@dataclass(frozen=True)
class Included:
    """A launch file of the stack itself.

    Attributes:
        package: Package that installs it.
        file: Path below its share folder.
        arguments: Launch arguments; {dir} is the folder of the parameters.
        environment: Environment variables that it reads.
    """

    package: str
    file: str
    arguments: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """What a stack publishes that is worth keeping.

    Attributes:
        topics: Recorded, besides /tf and /tf_static.
        odometry: The topic that `eval odometry` scores; '' if there is none.
        file: A trajectory file that the stack writes, instead of a topic.
        frame: The frame of the poses, where the messages do not name one of the drive's.
        tf: The link on /tf that `eval odometry` scores, instead of a topic.
    """

    topics: tuple[str, ...] = ()
    odometry: str = ''
    file: str = ''
    frame: str = ''
    tf: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stack:
    """One program and its demands.

    Attributes:
        name: As users write it.
        title: Name and publisher.
        what: What it does, a few words.
        points: Point fields that it reads, a few words; '' for none.
        imu: Whether it reads an Imu, a few words; '' for no.
        version: What was read.
        demands: What it asks of messages.
        settings: Options of messages that it needs.
        inputs: Topics that it reads, by their names in the preset default.
        imu_hz: Least rate of the Imu; 0 if it reads none.
        moving: Frames of the transforms that it publishes, (parent, child).
        publishes: Its topics, for the reader.
        result: What to record and to score.
        launch: What a launch file starts.
        start: The stack's own command, for its defaults.
        settings_files: Returns the texts of its parameter files, by name.
        notes: What else a user must know.
    """

    name: str
    title: str
    what: str
    version: str
    demands: tuple[Demand, ...]
    points: str = ''
    imu: str = ''
    settings: tuple[Setting, ...] = ()
    inputs: tuple[str, ...] = ()
    imu_hz: float = 0.0
    moving: tuple[tuple[str, str], ...] = ()
    publishes: tuple[str, ...] = ()
    result: Result = field(default_factory=Result)
    launch: tuple[Node | Included, ...] = ()
    start: str = ''
    settings_files: SettingsMaker | None = None
    notes: tuple[str, ...] = ()

    @property
    def topics(self) -> Mapping[str, str]:
        """Topics by their names in the preset default, to the names that it expects."""
        return TOPICS.get(StackName(self.name), {})

    @property
    def frames(self) -> Mapping[str, str]:
        """Fields of FrameNames with the names that it expects."""
        return FRAMES.get(StackName(self.name), {})

    def notes_of_imu(self, topic: str, rate_hz: float) -> list[str]:
        """Return a note if the rate of the Imu on a topic is too low."""
        if rate_hz >= _SLACK * self.imu_hz:
            return []
        has = f'{self.name} needs {topic} at {self.imu_hz:g} Hz, it has {rate_hz:.0f} Hz'
        return [f'{has}: give the packets of the unsynchronised drive, --imu-from DRIVE_extract']


DEFAULT_NAMES = Setting('preset', 'default')
TIMED = Setting('points', 'xyzirt')
"""ring (uint16) and time (float32, seconds from the stamp), which is the start of the turn."""
OWN_TREE = Setting('ground_truth_tree', value=True)
"""The ground truth is apart from the tree, in which the stack moves the car."""
PIXELS = Setting('images', 'both', ('raw',))
"""Decoded images; the PNG files restore the recording."""


# Texts of parameter files, in the formats that stacks read.


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
