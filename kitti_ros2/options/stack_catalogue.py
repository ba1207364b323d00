# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The stacks of --for: their demands on messages, and how a recording meets them.

A stack is a file, stacks/NAME.yaml; its names of topics and frames are in stack_names.py. The
classes below are the schema of the files. A stack's own files are described in its own words; the
names of topics on our side are those of the preset default.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias, get_args, get_origin, get_type_hints

from ..model.yaml_text import load_yaml
from .stack_names import FRAMES, TOPICS, StackName

_FOLDER = Path(__file__).with_name('stacks')
_SLACK = 0.8
"""Share of a rate that is close enough."""

Value: TypeAlias = str | bool


@dataclass(frozen=True)
class Demand:
    """One demand of a stack.

    Attributes:
        key: Short name; unique within the stack.
        text: What messages must be, in one sentence.
        source: Where the stack says so: OWNER/NAME@COMMIT FILE:LINE, or a symbol where the line is
            not known; pages have no commit.
        of_option: The option that meets it, where only the user can give its value.
    """

    key: str
    text: str
    source: str
    of_option: str = ''


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
    executable: str = ''
    name: str = ''
    remappings: Mapping[str, str] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()
    parameters: bool = True
    values: Mapping[str, str] = field(default_factory=dict)
    component: str = ''


@dataclass(frozen=True)
class LaunchFile:
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
    """Results that a stack publishes.

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
        name: Name on the command line.
        title: Name and publisher.
        what: Its purpose, a few words.
        version: Version of the source that was read.
        demands: Its demands on messages.
        points: Point fields that it reads, a few words; '' for none.
        imu: Whether it reads an Imu, a few words; '' for no.
        settings: Options of messages that it needs: their names, and the values that meet its
            demands, of which the first is set.
        inputs: Topics that it reads, by their names in the preset default.
        imu_hz: Least rate of the Imu; 0 if it reads none.
        moving: Frames of the transforms that it publishes, (parent, child).
        publishes: Its topics, for the reader.
        result: What to record and to score.
        launch: What a launch file starts.
        start: The stack's own command, for its defaults.
        parameter_files: Values of its parameter files by name; $NAME is a fact of the drive, an
            attribute of RigFacts in api/.
        opencv: Whether these are files of OpenCV's FileStorage.
        notes: What else a user must know.
    """

    name: str
    title: str
    what: str
    version: str
    demands: tuple[Demand, ...]
    points: str = ''
    imu: str = ''
    settings: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()
    imu_hz: float = 0.0
    moving: tuple[tuple[str, str], ...] = ()
    publishes: tuple[str, ...] = ()
    result: Result = field(default_factory=Result)
    launch: tuple[Node | LaunchFile, ...] = ()
    start: str = ''
    parameter_files: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    opencv: bool = False
    notes: tuple[str, ...] = ()

    @property
    def topics(self) -> Mapping[str, str]:
        """Names of topics that it expects, by their names in the preset default."""
        return TOPICS.get(StackName(self.name), {})

    @property
    def frames(self) -> Mapping[str, str]:
        """Names of frames that it expects, by field of FrameNames."""
        return FRAMES.get(StackName(self.name), {})

    def imu_notes(self, topic: str, rate_hz: float) -> list[str]:
        """Return a note if the rate of the Imu on a topic is too low."""
        if rate_hz >= _SLACK * self.imu_hz:
            return []
        has = f'{self.name} needs {topic} at {self.imu_hz:g} Hz, it has {rate_hz:.0f} Hz'
        return [f'{has}: give the packets of the unsynchronised drive, --imu-from DRIVE_extract']


class _Stacks(Mapping[str, Stack]):
    """Mapping that reads the file of a stack at first access."""

    def __getitem__(self, name: str) -> Stack:
        if name not in [*self]:
            raise KeyError(name)
        return _read(name)

    def __iter__(self) -> Iterator[str]:
        return (name.value for name in StackName)

    def __len__(self) -> int:
        return len(StackName)


STACKS = _Stacks()
"""All stacks by name, in the order of StackName."""


@cache
def _read(name: str) -> Stack:
    values = load_yaml((_FOLDER / f'{name}.yaml').read_text('utf-8'))
    stack: Stack = make_typed(Stack, {'name': name, **values})
    return stack


def make_typed(kind: Any, value: Any) -> Any:  # noqa: ANN401 - a type and its value
    """Return a value of a YAML file as a type: a dataclass, a tuple, a mapping, a plain value.

    Raises:
        TypeError: It is of another type, or a field of a dataclass is unknown or missing.
    """
    if isinstance(value, dict) and is_dataclass(kind):
        hints = get_type_hints(kind)
        make: Any = kind
        return make(
            **{name: make_typed(hints.get(name, Any), part) for name, part in value.items()}
        )
    origin, kinds = get_origin(kind), get_args(kind)
    if origin is tuple and isinstance(value, list):
        return tuple(make_typed(kinds[0], part) for part in value)
    if origin is Mapping and isinstance(value, dict):
        return {
            make_typed(kinds[0], name): make_typed(kinds[1], part) for name, part in value.items()
        }
    for option in filter(is_dataclass, kinds):
        if value.keys() <= {attribute.name for attribute in fields(option)}:
            return make_typed(option, value)
    if kind is Any or isinstance(value, kind):
        return value
    raise TypeError(f'{value!r} is no {kind}')
