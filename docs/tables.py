# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the reference, made from the declarations in the code.

A page asks for one with a comment on a line of its own, `<!-- generated: NAME ARGUMENT -->`;
`python docs/tables.py` writes it below, up to `<!-- end -->`, in all pages.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from api_tables import api
from command_tables import command, exit_codes
from markdown_tables import attributes, code, table
from message_tables import cloud_fields, clouds, frames, renamed_topics, topics

from kitti_ros2.importer import plan
from kitti_ros2.model.bag_formats import CONTAINERS
from kitti_ros2.options.stack_catalogue import STACKS
from kitti_ros2.validation.validate import FOLDER_RULES, rules_by_id

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[1]
_MARKER = re.compile(
    r'^(<!-- generated: (\S+) ?([^\n]*?) -->)$(?:(?:(?!^<!-- generated).)*?^<!-- end -->$)?',
    re.MULTILINE | re.DOTALL,
)


def fill(markdown: str) -> str:
    """Write each table below the comment that asks for it, in place of the one that is there."""

    def filled(found: re.Match[str]) -> str:
        made = TABLES[found[2]](*found[3].split())
        return f'{found[1]}\n\n{made}\n\n<!-- end -->'

    return _MARKER.sub(filled, markdown)


def main() -> None:
    """Write the tables of all pages; the player's need rclpy."""
    for page in sorted((ROOT / 'docs').rglob('*.md')):
        text = page.read_text('utf-8')
        page.write_text(fill(text), 'utf-8')


def parameters() -> str:
    """Return the ROS parameters of the player."""
    from kitti_ros2.player.node import PARAMETERS  # noqa: PLC0415 - needs rclpy

    rows = [
        (
            code(each.name),
            type(each.default).__name__,
            code(repr(each.default)),
            f'{each.bounds[0]:g} to {each.bounds[1]:g}' if each.bounds else '',
            'yes' if each.live else '',
            each.meaning,
        )
        for each in PARAMETERS
    ]
    return table(('parameter', 'type', 'default', 'range', 'may change', 'meaning'), rows)


def services() -> str:
    """Return the services of the player, with and without rosbag2_interfaces."""
    from kitti_ros2.player.node import plain_services, rosbag2_services  # noqa: PLC0415

    player: Any = None  # for handlers that are not called
    types: Any = _Names('rosbag2_interfaces')
    plain = plain_services(player)
    rows = [
        (code(f'~/{name}'), code(kind), code('std_srvs/Trigger') if name in plain else '')
        for name, (kind, _) in rosbag2_services(player, types).items()
    ]
    return table(('service', 'type', 'without rosbag2_interfaces'), rows)


class _Names:
    """A package whose types are their names."""

    def __init__(self, package: str) -> None:
        self._package = package

    def __getattr__(self, name: str) -> str:
        return f'{self._package}/{name}'


def policies() -> str:
    """Return the policies of a file with QoS overrides."""
    from kitti_ros2.player.outlets import POLICIES  # noqa: PLC0415 - needs rclpy

    return table(
        ('policy', 'values'), ((code(name), _accepted(each)) for name, each in POLICIES.items())
    )


def _accepted(parse: Callable[[object], object]) -> str:
    """Return what a parser accepts, in the words of its error."""
    try:
        parse(object())
    except ValueError as expected:
        return str(expected)
    raise AssertionError('a policy that accepts anything')


def plan_keys() -> str:
    """Return the keys of a plan file."""
    parts = []
    for kind, key in (
        (plan.Plan, ''),
        (plan.ScanPlan, 'scan'),
        (plan.CameraPlan, 'cameras: N'),
        (plan.PosePlan, 'pose'),
        (plan.LabelPlan, 'labels'),
    ):
        parts += [f'## `{key}`' if key else '## Top level', _fields(kind)]
    return '\n\n'.join(parts)


def _fields(kind: type) -> str:
    meaning = attributes(kind)
    hints = get_type_hints(kind, localns={'Mapping': dict})
    rows = [
        (
            code(each.name.rstrip('_')),  # from of from_, which is a word of Python
            _type_name(hints[each.name]),
            _default(each),
            meaning[each.name],
        )
        for each in dataclasses.fields(kind)
    ]
    return table(('key', 'type', 'default', 'meaning'), rows)


def _type_name(kind: Any) -> str:  # noqa: ANN401 - a type or an annotation
    names = {str: 'text', float: 'number', int: 'number', bool: 'true or false'}
    if inspect.isclass(kind) and issubclass(kind, Enum):
        return ' or '.join(str(each.value) for each in kind)
    if kind == dict[str, str]:
        return 'names with classes'
    return names.get(kind, 'keys, see below')


def _default(field: dataclasses.Field[Any]) -> str:
    if field.default is dataclasses.MISSING:
        return '' if field.default_factory is not dataclasses.MISSING else 'required'
    value = getattr(field.default, 'value', field.default)
    return '' if value in (None, '') else code(str(value).lower())


def containers() -> str:
    """Return the containers of bags."""
    rows = [
        (
            code(name),
            each.title,
            code(each.suffix),
            ', '.join(map(_level, each.compressions, each.compressions.values())),
            'file or folder' if each.in_file and each.in_rosbag2 else
            'file' if each.in_file else 'folder',
        )
        for name, each in CONTAINERS.items()
    ]  # fmt: skip
    return table(('storage', 'name', 'ending', 'compression (levels)', 'OUT is a'), rows)


def _level(name: str, levels: range | None) -> str:
    return name if levels is None else f'{name} ({levels[0]} to {levels[-1]})'


def rules(kind: str) -> str:
    """Return the rules of validate, about folders or bags."""
    of_folders = {each.id for each in FOLDER_RULES}
    rows = [
        (code(each.id), each.severity.value, each.scope.value, each.checks, each.remedy)
        for each in rules_by_id(bags=True).values()
        if (each.id in of_folders) is (kind == 'folders')
    ]
    return table(('rule', 'severity', 'scope', 'holds in valid data', 'otherwise'), rows)


def stacks() -> str:
    """Return the stacks of --for, with the options and names that it sets."""
    rows = [
        (
            code(each.name),
            each.what,
            each.points,
            each.imu,
            ', '.join(
                code(f'{name}: {_plain(values[0])}') for name, values in each.settings.items()
            ),
            ', '.join(f'{code(own)} to {code(name)}' for own, name in each.topics.items()),
        )
        for each in STACKS.values()
    ]
    return table(('stack', 'does', 'points', 'Imu', 'options', 'topics'), rows)


def _plain(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def demands() -> str:
    """Return what each stack asks of messages, with the places in its source."""
    parts = []
    for each in STACKS.values():
        rows = [(demand.text, code(demand.source)) for demand in each.demands]
        notes = '\n'.join(f'- {note}' for note in each.notes)
        parts += [f'### {each.name}', each.title + '.', table(('asks for', 'source'), rows), notes]
    return '\n\n'.join(part for part in parts if part)


def source_file(name: str) -> str:
    """Return a file of the repository as a block, without its licence header."""
    text = (ROOT / name).read_text('utf-8')
    body = text.split('Apache-2.0\n', 1)[1].lstrip('\n')
    language = {'.py': 'python', '.yaml': 'yaml'}[Path(name).suffix]
    return f'```{language} title="{name}"\n{body.rstrip()}\n```'


TABLES: dict[str, Callable[..., str]] = {
    'api': api,
    'cloud-fields': cloud_fields,
    'clouds': clouds,
    'command': command,
    'containers': containers,
    'demands': demands,
    'exit-codes': exit_codes,
    'file': source_file,
    'frames': frames,
    'parameters': parameters,
    'plan': plan_keys,
    'policies': policies,
    'renamed-topics': renamed_topics,
    'rules': rules,
    'services': services,
    'stacks': stacks,
    'topics': topics,
}

if __name__ == '__main__':
    main()
