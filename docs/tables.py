# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the reference, made from the declarations in the code.

A page asks for one with a comment on a line of its own, `<!-- generated: NAME ARGUMENT -->`.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
from enum import Enum
from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING, Any, get_type_hints

from kitti_ros2.cli.app import find_command
from kitti_ros2.importer import plan
from kitti_ros2.messages.naming import PRESETS, FrameNames, base_t_imu, make_frames
from kitti_ros2.messages.topics import EVERY_MESSAGE, make_table
from kitti_ros2.messages.transforms import static_links
from kitti_ros2.model.cloud_formats import FORMATS, VALUES, Order
from kitti_ros2.model.containers import CONTAINERS
from kitti_ros2.options.messages import MessageOptions, Preset
from kitti_ros2.stacks.catalogue import STACKS
from kitti_ros2.synthetic.rig import make_calibration
from kitti_ros2.validation.rule_table import FOLDER_RULES, rules_by_id

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from kitti_ros2.model.cloud_formats import CloudField

ROOT = Path(__file__).resolve().parents[1]
CAMERAS = '{gray,color}_{left,right}'
_MARKER = re.compile(r'^<!-- generated: (\S+) ?(.*?) -->$', re.MULTILINE)
_DEFAULT = re.compile(r'\s*\[default: (.*)\]$')


def fill(markdown: str) -> str:
    """Replace each comment that asks for a table by the table."""
    return _MARKER.sub(lambda found: TABLES[found[1]](*found[2].split()), markdown)


def command(*words: str) -> str:
    """Return the description, the arguments and the options of a command."""
    name, found = find_command([*words])
    arguments = [each for each in found.params if each.param_type_name == 'argument']
    options = [each for each in found.params if each.param_type_name == 'option']
    names = ' '.join(each.metavar or each.name.upper() for each in arguments)
    usage = f'```text\nkitti-ros2 {name} {names} [OPTIONS]\n```'
    about = table(
        ('argument', 'meaning'),
        ((_code(each.metavar or each.name.upper()), each.help) for each in arguments),
    )
    parts = [inspect.cleandoc(found.help), usage, about]
    panels: dict[str, list[Any]] = {'': []}
    for each in options:
        panels.setdefault(getattr(each, 'rich_help_panel', None) or '', []).append(each)
    for title, members in panels.items():
        rows = [_option_row(each) for each in members]
        parts += [f'**{title}**'] if title else []
        parts += [table(('option', 'value', 'meaning', 'default'), rows)] if rows else []
    examples = inspect.cleandoc(found.callback.__doc__ or '').partition('Examples:\n')[2]
    parts += [f'```text\n{dedent(examples).strip()}\n```'] if examples else []
    return '\n\n'.join(parts)


def _option_row(option: Any) -> tuple[str, ...]:  # noqa: ANN401 - of typer's own copy of click
    spellings = [*option.opts, *option.secondary_opts]
    text = option.help or ''
    declared = _DEFAULT.search(text)
    default = declared[1] if declared else _plain_default(option)
    value = '' if option.is_flag else option.metavar or _kind(option.type)
    if value.startswith('['):
        value = value.strip('[]').replace('|', ', ')
    return ', '.join(map(_code, spellings)), value, _DEFAULT.sub('', text), default


def _plain_default(option: Any) -> str:  # noqa: ANN401
    if isinstance(option.default, bool):
        return 'on' if option.default else 'off'
    if option.is_flag:
        return 'off'
    return '' if option.default is None or callable(option.default) else str(option.default)


def _kind(kind: Any) -> str:  # noqa: ANN401
    choices = getattr(kind, 'choices', None)
    names = {'str': 'text', 'int': 'number', 'float': 'number'}
    return ', '.join(map(str, choices)) if choices else names.get(kind.name, str(kind.name))


def exit_codes() -> str:
    """Return the exit codes, from the constants and the texts below them."""
    tree = ast.parse((ROOT / 'kitti_ros2/cli/exit_codes.py').read_text('utf-8'))
    rows = [
        (str(number.value.value), str(text.value.value))
        for number, text in zip(tree.body[1:], tree.body[2:], strict=False)
        if isinstance(number, ast.Assign)
        and isinstance(number.value, ast.Constant)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    ]
    return table(('exit code', 'meaning'), rows)


def topics() -> str:
    """Return the table of topics, with streams, QoS and the names of the preset kitti2bag."""
    options = dataclasses.replace(EVERY_MESSAGE, annotated=True)
    rows = [
        (
            _code(row.topic),
            _code(row.msgtype.replace('/msg/', '/')),
            'image' if row.stream.camera is not None else row.stream.value,
            f'latched, depth {row.depth}' if row.latched else f'depth {row.depth}',
        )
        for row in make_table({0: CAMERAS}, 'image_rect', options)
    ]
    return table(('topic', 'type', 'stream', 'QoS'), rows)


def clouds() -> str:
    """Return the formats of clouds."""
    rows = [
        (
            _code(name.value),
            each.follows,
            ', '.join(f'{_code(field.name)} {_field_type(field)}' for field in each.fields),
            str(each.point_step),
            '64 x N, NaN without a return' if each.order is Order.GRID else '1 x N',
            each.order.value,
            'start of the turn' if each.is_timed else 'facing forward',
        )
        for name, each in FORMATS.items()
    ]
    head = ('--points', 'as', 'fields, with offset', 'bytes', 'size', 'order', 'stamp of a scan')
    return table(head, rows)


def cloud_fields() -> str:
    """Return the fields of clouds with their values."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for name, each in FORMATS.items():
        for field in each.fields_of(timed=True, labelled=each.extensible):
            kind = _field_type(field).partition(' ')[0]
            is_label = field.value.startswith('label')
            of = '--semantic' if is_label else name.value
            known = rows.setdefault((field.name, kind, VALUES[field.value]), [])
            known += [of] if of not in known else []
    return table(
        ('field', 'type', 'value', 'in'),
        ((_code(name), kind, value, ', '.join(map(_code, of)))
         for (name, kind, value), of in rows.items()),
    )  # fmt: skip


def _field_type(field: CloudField) -> str:
    names = {'f': 'float', 'u': 'uint'}
    return f'{names[field.kind[1]]}{8 * int(field.kind[2])} at {field.offset}'


def renamed_topics() -> str:
    """Return the topics that the preset kitti2bag renames."""
    rows = [
        (_code(own), _code(renamed)) for own, renamed in PRESETS[Preset.KITTI2BAG].topics.items()
    ]
    return table(('default', 'kitti2bag'), rows)


def frames() -> str:
    """Return the frames of a rectified recording, with parents and names by preset."""
    meaning = attributes(FrameNames)
    kinds = {'map': '', 'base': '', 'imu': '', 'velo': ''}
    ours, theirs = (make_frames(preset, {}) for preset in Preset)
    links = static_links(make_calibration(), base_t_imu(MessageOptions()), ours)
    parents = {child: parent for parent, child, _ in links} | {ours.base: ours.map}
    names = [(getattr(ours, kind), getattr(theirs, kind), meaning[kind]) for kind in kinds]
    names += [
        (ours.camera(index), theirs.camera(index), f'Optical frame of camera {index}')
        for index in range(4)
    ]
    rows = [
        (_code(name), _code(parents[name]) if name in parents else '', _code(renamed), text)
        for name, renamed, text in names
    ]
    return table(('frame', 'parent', 'preset kitti2bag', 'is'), rows)


def parameters() -> str:
    """Return the ROS parameters of the player."""
    from kitti_ros2.node.parameters import PARAMETERS  # noqa: PLC0415 - needs rclpy

    rows = [
        (
            _code(each.name),
            type(each.default).__name__,
            _code(repr(each.default)),
            f'{each.bounds[0]:g} to {each.bounds[1]:g}' if each.bounds else '',
            'yes' if each.live else '',
            each.meaning,
        )
        for each in PARAMETERS
    ]
    return table(('parameter', 'type', 'default', 'range', 'may change', 'meaning'), rows)


def services() -> str:
    """Return the services of the player, with and without rosbag2_interfaces."""
    from kitti_ros2.node import controls  # noqa: PLC0415 - needs rclpy

    player: Any = None  # for handlers that are not called
    types: Any = _Names('rosbag2_interfaces')
    plain = controls.plain_services(player)
    rows = [
        (_code(f'~/{name}'), _code(kind), _code('std_srvs/Trigger') if name in plain else '')
        for name, (kind, _) in controls.rosbag2_services(player, types).items()
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
    from kitti_ros2.node.qos import POLICIES  # noqa: PLC0415 - needs rclpy

    return table(
        ('policy', 'values'), ((_code(name), _accepted(each)) for name, each in POLICIES.items())
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
            _code(each.name.rstrip('_')),  # from of from_, which is a word of Python
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
    return '' if value in (None, '') else _code(str(value).lower())


def containers() -> str:
    """Return the containers of bags."""
    rows = [
        (
            _code(name),
            each.title,
            _code(each.suffix),
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
        (_code(each.id), each.severity.value, each.scope.value, each.checks, each.remedy)
        for each in rules_by_id(bags=True).values()
        if (each.id in of_folders) is (kind == 'folders')
    ]
    return table(('rule', 'severity', 'scope', 'holds in valid data', 'otherwise'), rows)


def stacks() -> str:
    """Return the stacks of --for, with the options and names that it sets."""
    rows = [
        (
            _code(each.name),
            each.what,
            each.points,
            each.imu,
            ', '.join(
                _code(f'{setting.name}: {_plain(setting.value)}') for setting in each.settings
            ),
            ', '.join(f'{_code(own)} to {_code(name)}' for own, name in each.topics.items()),
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
        rows = [(demand.text, _code(str(demand.source))) for demand in each.demands]
        notes = '\n'.join(f'- {note}' for note in each.notes)
        parts += [f'### {each.name}', each.title + '.', table(('asks for', 'source'), rows), notes]
    return '\n\n'.join(part for part in parts if part)


def source_file(name: str) -> str:
    """Return a file of the repository as a block, without its licence header."""
    text = (ROOT / name).read_text('utf-8')
    body = text.split('Apache-2.0\n', 1)[1].lstrip('\n')
    language = {'.py': 'python', '.yaml': 'yaml'}[Path(name).suffix]
    return f'```{language} title="{name}"\n{body.rstrip()}\n```'


def attributes(kind: type) -> dict[str, str]:
    """Return the descriptions of fields, from the section Attributes of a class's docstring."""
    section = inspect.getdoc(kind) or ''
    section = section.partition('Attributes:\n')[2].split('\n\n')[0]
    found: dict[str, str] = {}
    for names, text in re.findall(
        r'^ {4}([\w, ]+): ((?:.*\n?)(?: {8}.*\n?)*)', section, re.MULTILINE
    ):
        found |= dict.fromkeys(names.split(', '), ' '.join(text.split()))
    return found


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; bars in cells are escaped."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join(
        '| ' + ' | '.join(' '.join(cell.split()).replace('|', '\\|') for cell in line) + ' |'
        for line in lines
    )


def _code(text: str) -> str:
    return f'`{text}`'


TABLES: dict[str, Callable[..., str]] = {
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
