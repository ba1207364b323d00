# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the converter from words: the command line and the YAML file fill the same objects."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import UsageError
from ..options import (
    BagOptions,
    Bound,
    Images,
    MarkerColors,
    MarkerOptions,
    MessageOptions,
    Preset,
    ReadOptions,
    SelectionOptions,
)
from ..samples import Layout
from ..stamps import parse_seconds, parse_stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import yaml

E = TypeVar('E', bound=Enum)

_SIZE = re.compile(r'(\d+(?:\.\d+)?)\s*([kMGT]?)(i?)B?', re.ASCII)
_KEPT_AS_TEXT = {'int', 'timestamp'}
_POWERS = {'': 0, 'k': 1, 'M': 2, 'G': 3, 'T': 4}


@dataclass(frozen=True)
class Settings:
    """Everything to-bag can be told.

    Attributes:
        read, messages, selection, bag: The options objects of each part.
        storage: As asked for; None leaves it to the output's name.
        strict: Whether to stop at the first loss.
    """

    read: ReadOptions
    messages: MessageOptions
    selection: SelectionOptions
    bag: Callable[[str], BagOptions]
    storage: str | None
    strict: bool


def make_settings(values: Mapping[str, object]) -> Settings:
    """Settings from values by name; None and absent ones take their default.

    Raises:
        UsageError: A name is unknown, or a value cannot be meant.
    """
    unknown = sorted(set(values) - set(_PARSERS))
    if unknown:
        raise UsageError(f'there is no option {unknown[0]!r}; known are {", ".join(_PARSERS)}')
    parsed = {
        name: _PARSERS[name](name, value) for name, value in values.items() if value is not None
    }

    def pick(**fields: str) -> dict[str, Any]:
        return {field: parsed[name] for field, name in fields.items() if name in parsed}

    bag = pick(
        compression='compression',
        compression_level='compression_level',
        split_size='split_size',
        split_duration_ns='split_duration',
        overwrite='overwrite',
    )
    markers = pick(
        colors='marker_colors',
        alpha='marker_alpha',
        line_width='marker_line_width',
        arrow_length='marker_arrow_length',
        text_height='marker_text_height',
        lifetime_ns='marker_lifetime',
        trails='trails',
        ego='ego_marker',
    )
    read = pick(layout='layout', sequence='sequence', epoch_ns='epoch', semantic='semantic')
    return Settings(
        read=ReadOptions(**read),
        messages=MessageOptions(
            **pick(
                images='images',
                preset='preset',
                publish_tf='tf',
                ring_and_time='ring_time',
                base_to_imu='base_to_imu',
                semantic='semantic',
            ),
            markers=MarkerOptions(**markers),
        ),
        selection=SelectionOptions(
            **pick(streams='streams', topics='topics', start='start', end='end')
        ),
        bag=lambda storage: BagOptions(storage=storage, **bag),
        storage=parsed.get('storage'),
        strict=parsed.get('strict', False),
    )


def load_config(path: Path) -> dict[str, object]:
    """The options of a YAML file, a mapping of names to values.

    Raises:
        UsageError: The file is not there, no YAML, or no mapping.
    """
    import yaml

    try:
        values = yaml.load(path.read_text('utf-8'), _text_loader())  # noqa: S506 - a safe loader
    except OSError as error:
        raise UsageError(f'{path}: {error.strerror}; --config takes a YAML file') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'{path}:{mark.line + 1}' if mark is not None else str(path)
        problem = getattr(error, 'problem', None) or 'no text'
        raise UsageError(
            f'{where}: no YAML, {problem}; expected lines like "images: raw"'
        ) from None
    if values is None:
        return {}
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise UsageError(f'{path}: no mapping; expected lines like "images: raw"')
    unknown = sorted(set(values) - set(_PARSERS))
    if unknown:
        raise UsageError(f'{path}: unknown option {unknown[0]!r}; known are {", ".join(_PARSERS)}')
    return values


def _text_loader() -> type[yaml.SafeLoader]:
    """A safe loader that leaves whole numbers and times as they are written.

    YAML would read 0010 as 8 and cut a stamp to microseconds.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        yaml_implicit_resolvers = {  # noqa: RUF012 - as the base class has it
            first: [item for item in items if item[0].rsplit(':', 1)[-1] not in _KEPT_AS_TEXT]
            for first, items in yaml.SafeLoader.yaml_implicit_resolvers.items()
        }

    return Loader


def parse_bytes(text: str) -> int:
    """Bytes from a size such as 2GB, 500 MB or 1GiB.

    Raises:
        ValueError: The text is no size.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    return int(float(match[1]) * (1024 if match[3] else 1000) ** _POWERS[match[2]])


def _text(name: str, value: object) -> str:
    if isinstance(value, (str, int)) and not isinstance(value, bool):
        return str(value)
    raise UsageError(f'{name} takes a word, not {value!r}')


def _texts(name: str, value: object) -> tuple[str, ...]:
    items = value if isinstance(value, (list, tuple)) else [value]
    return tuple(word for item in items for word in _text(name, item).replace(',', ' ').split())


def _flag(name: str, value: object) -> bool:
    if isinstance(value, bool):
        return value
    raise UsageError(f'{name} takes true or false, not {value!r}')


def _integer(name: str, value: object) -> int:
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, str) and value.removeprefix('-').isdecimal():
        return int(value)
    raise UsageError(f'{name} takes a whole number, not {value!r}')


def _number(name: str, value: object) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str) and value.removeprefix('-').isdecimal():
        return float(value)
    raise UsageError(f'{name} takes a number, not {value!r}')


def _choice(kind: type[E]) -> Callable[[str, object], E]:
    def parse(name: str, value: object) -> E:
        known = [item.value for item in kind]
        if value not in known:
            raise UsageError(f'{name} takes {" or ".join(known)}, not {value!r}')
        return kind(value)

    return parse


def _bound(name: str, value: object) -> Bound:
    return Bound.parse(_text(name, value))


def _size(name: str, value: object) -> int:
    try:
        return parse_bytes(_text(name, value))
    except ValueError:
        raise UsageError(f'{name} takes a size such as 2GB, not {value!r}') from None


def _seconds_ns(name: str, value: object) -> int:
    try:
        return parse_seconds(str(value).removesuffix('s'))
    except ValueError:
        raise UsageError(f'{name} takes seconds such as 60s, not {value!r}') from None


def _epoch(name: str, value: object) -> int:
    try:
        return parse_stamp(str(value).removesuffix('+00:00'))
    except ValueError:
        raise UsageError(
            f"{name} takes a UTC time such as '2011-09-26 00:00:00', not {value!r}"
        ) from None


def _place(name: str, value: object) -> tuple[float, ...]:
    items = value if isinstance(value, (list, tuple)) else str(value).replace(',', ' ').split()
    try:
        return tuple(float(item) for item in items)
    except (TypeError, ValueError):
        raise UsageError(f'{name} takes three numbers x,y,z in metres, not {value!r}') from None


_PARSERS: dict[str, Callable[[str, object], Any]] = {
    'layout': _choice(Layout),
    'sequence': _text,
    'epoch': _epoch,
    'images': _choice(Images),
    'preset': _choice(Preset),
    'tf': _flag,
    'ring_time': _flag,
    'base_to_imu': _place,
    'semantic': _flag,
    'marker_colors': _choice(MarkerColors),
    'trails': _flag,
    'ego_marker': _flag,
    'marker_alpha': _number,
    'marker_line_width': _number,
    'marker_arrow_length': _number,
    'marker_text_height': _number,
    'marker_lifetime': _seconds_ns,
    'streams': _texts,
    'topics': _texts,
    'start': _bound,
    'end': _bound,
    'storage': _text,
    'compression': _text,
    'compression_level': _integer,
    'split_size': _size,
    'split_duration': _seconds_ns,
    'strict': _flag,
    'overwrite': _flag,
}
