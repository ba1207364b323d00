# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A plan as YAML: formatted, and parsed with the key of each error."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, get_type_hints

from ..messages.scan_sources import SCAN_SOURCES
from ..messages.velodyne_models import MODELS
from ..model.boxes import UNKNOWN_OCCLUSION
from ..model.errors import UsageError
from ..model.geographic import GeoOrigin
from ..model.layouts import Layout
from ..model.spelling import did_you_mean
from ..model.text import one_line, shown
from .optical_frames import X_FORWARD
from .plan import (
    QUIET,
    CameraPlan,
    Incomplete,
    LabelPlan,
    Plan,
    PosePlan,
    ScanPlan,
    StampSource,
    VelocityAxes,
)
from .plan_classes import check_classes
from .plan_numbers import as_number, check_numbers

if TYPE_CHECKING:
    from pathlib import Path

_SET_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_-]{0,99}')


def format_plan(plan: Plan, notes: tuple[str, ...] = ()) -> str:
    """Format the plan as YAML, with notes as comments above; the inverse of parse_plan."""
    import yaml  # noqa: PLC0415 - 15 ms that a report of a folder does not need

    values = _values(plan)
    values['cameras'] = dict(sorted(values['cameras'].items()))
    kept = {name: value for name, value in values.items() if value not in (None, '', {})}
    comments = ''.join(f'# {one_line(note)}\n' for note in notes)
    return comments + yaml.safe_dump(kept, sort_keys=False, width=100)


def _values(part: Any) -> Any:  # noqa: ANN401 - a plan, or a part of it
    """Return a part of a plan as YAML has it, without quiet fields at their default."""
    if isinstance(part, Enum):
        return part.value
    if isinstance(part, dict):
        return {name: _values(value) for name, value in part.items()}
    if not is_dataclass(part):
        return part
    values = {each: getattr(part, each.name) for each in fields(part)}
    return {
        _key(each.name): _values(value)
        for each, value in values.items()
        if not (QUIET in each.metadata and value in (each.default, {}))
    }


def _key(name: str) -> str:
    """Return the key of a field: from of from_, which is a word of Python."""
    return name.rstrip('_')


def parse_plan(text: str, path: Path) -> Plan:
    """Parse a plan from YAML.

    Raises:
        UsageError: It is not a valid plan; the error names the key.
    """
    from ..model.yaml_text import YamlTextError, load_yaml  # noqa: PLC0415 - as above

    try:
        values = load_yaml(text)
    except YamlTextError as error:
        raise UsageError(f'{path}: is not valid YAML ({error})') from None
    if not isinstance(values, dict):
        raise UsageError(f'{path}: is not a plan; expected the output of to-kitti --plan')
    made = dict(values)
    made['cameras'] = cameras = _parse_cameras(made.pop('cameras', None) or {}, path)
    made['camera_sets'] = _parse_sets(made.pop('camera_sets', None) or {}, path)
    if made['camera_sets'] and cameras:
        raise UsageError(f'{path}: camera_sets: each has its own camera; expected no cameras')
    for name, kind in (('scan', ScanPlan), ('pose', PosePlan), ('labels', LabelPlan)):
        if made.get(name) is not None:
            made[name] = _make(kind, made[name], path, name)
    _check_parts(made, path)
    for name, choice in _CHOICES.items():
        if name in made:
            made[name] = _choose(choice, made[name], f'{path}: {name}')
    plan: Plan = _make(Plan, made, path, '')
    _check_origin(plan.origin, path)
    return plan


def _check_origin(text: str, path: Path) -> None:
    try:
        GeoOrigin.parse(text)
    except ValueError as error:
        raise UsageError(f'{path}: origin: {error}') from None


def _parse_cameras(cameras: object, path: Path) -> dict[int, CameraPlan]:
    if not isinstance(cameras, dict) or not all(
        type(key) is int and key in range(5) for key in cameras
    ):
        raise UsageError(
            f'{path}: cameras: expected KITTI camera numbers 0 to 4, found {shown(cameras)}'
        )
    return {key: _camera(value, path, f'cameras: {key}') for key, value in cameras.items()}


def _camera(value: object, path: Path, place: str) -> CameraPlan:
    camera: CameraPlan = _make(CameraPlan, value, path, place)
    if camera.forward not in {'', X_FORWARD}:
        raise UsageError(
            f'{path}: {place}: forward: {camera.forward}; expected {X_FORWARD}, or nothing for an'
            f' optical frame'
        )
    return camera


def _parse_sets(sets: object, path: Path) -> dict[str, CameraPlan]:
    place = f'{path}: camera_sets'
    if not isinstance(sets, dict):
        raise UsageError(f'{place}: {shown(sets)}; expected names of sets, each with a camera')
    for name in sets:
        if not isinstance(name, str) or not _SET_NAME.fullmatch(name):
            raise UsageError(
                f'{place}: {name!r}; expected a name of letters, digits, - and _, such as CAM_BACK'
            )
    if len({name.lower() for name in sets}) < len(sets):
        raise UsageError(f'{place}: names of sets must differ by more than case')
    return {name: _camera(value, path, f'camera_sets: {name}') for name, value in sets.items()}


def _check_parts(made: dict[str, Any], path: Path) -> None:
    """Check the values of scan and labels; classes get KITTI's spelling."""
    scan, labels = made.get('scan'), made.get('labels')
    _check_words(scan, path)
    if labels is None:
        return
    if labels.occluded not in range(UNKNOWN_OCCLUSION + 1):
        raise UsageError(f'{path}: labels: occluded: {labels.occluded}; expected 0 to 3')
    where = f'{path}: labels: classes'
    classes = check_classes(labels.classes, where, any_word=labels.keep_classes)
    made['labels'] = replace(labels, classes=classes)


def _check_words(scan: ScanPlan | None, path: Path) -> None:
    words = {'from': [each.word for each in SCAN_SOURCES], 'model': list(MODELS)}
    for key, known in words.items():
        value = '' if scan is None else getattr(scan, 'from_' if key == 'from' else key)
        if value and value not in known:
            hint = did_you_mean(value, known)
            expected = ', '.join(known)
            raise UsageError(
                f'{path}: scan: {key}: {shown(value)}; expected one of {expected}{hint}'
            )


def _choose(kind: type[Enum], value: object, where: str) -> Enum:
    try:
        # The error of an Enum has the whole value.
        return kind(value if isinstance(value, str) else None)
    except ValueError:
        known = [str(each.value) for each in kind]
        hint = did_you_mean(value if isinstance(value, str) else '', known)
        raise UsageError(f'{where}: {shown(value)}; expected {" or ".join(known)}{hint}') from None


def _make(kind: Any, values: object, path: Path, where: str) -> Any:  # noqa: ANN401 - of that kind
    """Make a dataclass from a mapping, its values checked against the types of the fields."""
    place = f'{path}: {where}: ' if where else f'{path}: '
    if not isinstance(values, dict):
        raise UsageError(f'{place}expected {", ".join(_key(f.name) for f in fields(kind))}')
    known = {_key(each.name): each for each in fields(kind)}
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        hint = did_you_mean(unknown[0], known)
        keys = ', '.join(known)
        raise UsageError(f'{place}unknown key {unknown[0]!r}; valid keys are {keys}{hint}')
    hints = get_type_hints(kind, localns={'Mapping': dict})
    checked = {}
    for key, value in values.items():
        name = known[key].name
        wanted = hints[name]
        if wanted is float and type(value) in (int, float):
            checked[name] = as_number(value, f'{place}{key}')
        elif wanted in _WORDS and type(value) is not wanted:
            raise UsageError(f'{place}{key}: {shown(value)}; expected {_WORDS[wanted]}')
        else:
            checked[name] = value
    check_numbers(checked, place)
    try:
        return kind(**checked)
    except TypeError:
        needed = (n for n, each in known.items() if each.default is each.default_factory)  # MISSING
        missing = [name for name in needed if known[name].name not in checked]
        raise UsageError(f'{place}missing {", ".join(missing)}') from None


_CHOICES: dict[str, type[Enum]] = {
    'layout': Layout,
    'incomplete': Incomplete,
    'stamps': StampSource,
    'velocity_axes': VelocityAxes,
}
_WORDS = {str: 'a text (quote numbers)', bool: 'true or false', float: 'a number', int: 'a number'}
