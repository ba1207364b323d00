# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options from words: command lines, YAML files and ROS parameters fill the same objects."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from .errors import UsageError
from .options import (
    AtEnd,
    BagOptions,
    BirdOptions,
    Bound,
    ColorBy,
    ColorMap,
    Images,
    ImportOptions,
    MarkerColors,
    MarkerOptions,
    MessageOptions,
    PictureOptions,
    PlaybackOptions,
    Preset,
    ReadOptions,
    SelectionOptions,
    Stamps,
)
from .samples import Layout
from .stamps import parse_seconds, parse_stamp

if TYPE_CHECKING:
    from collections.abc import Mapping

E = TypeVar('E', bound=Enum)
_Parser: TypeAlias = Callable[[str, object], Any]

DEFAULT_READ_AHEAD = 8
MOST_READ_AHEAD = 1000
FPS = (0.1, 240.0)

_SIZE = re.compile(r'(\d+(?:\.\d+)?)\s*([kMGT]?)(i?)B?', re.ASCII)
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


@dataclass(frozen=True)
class PlaySettings:
    """Everything the player can be told.

    Attributes:
        read, messages, selection, playback: The options objects of each part.
        stamps: Which stamps messages carry.
        read_ahead: Frames to fetch ahead.
        qos_overrides_path: A rosbag2 QoS override file, or None.
    """

    read: ReadOptions
    messages: MessageOptions
    selection: SelectionOptions
    playback: PlaybackOptions
    stamps: Stamps
    read_ahead: int
    qos_overrides_path: Path | None


@dataclass(frozen=True)
class ViewSettings:
    """Everything that drawing can be told.

    Attributes:
        read, pictures: The options objects of each part.
        mode: What is drawn.
        frame: The frame of a picture; None is the first.
        frames: Those of a film or folder, FIRST:LAST[:STEP]; None is all.
        predictions: Label files of a detector or tracker.
        rate_hz: Pictures a second of a film; None is that of the recording.
        overwrite: Whether an existing file may be replaced.
    """

    read: ReadOptions
    pictures: PictureOptions
    mode: str
    frame: int | None
    frames: str | None
    predictions: Path | None
    rate_hz: float | None
    overwrite: bool


def make_settings(values: Mapping[str, object]) -> Settings:
    """Settings of to-bag from values by name; None and absent ones take their default.

    Raises:
        UsageError: A name is unknown, or a value cannot be meant.
    """
    parsed = _parse(values, _TO_BAG)
    bag = _pick(
        parsed,
        compression='compression',
        compression_level='compression_level',
        split_size='split_size',
        split_duration_ns='split_duration',
        overwrite='overwrite',
    )
    return Settings(
        read=_read_options(parsed),
        messages=_message_options(parsed),
        selection=_selection_options(parsed),
        bag=lambda storage: BagOptions(storage=storage, **bag),
        storage=parsed.get('storage'),
        strict=parsed.get('strict', False),
    )


def make_play_settings(values: Mapping[str, object]) -> PlaySettings:
    """Settings of the player from values by name; None and absent ones take their default.

    Raises:
        UsageError: A name is unknown, or a value cannot be meant.
    """
    parsed = {'images': Images.BOTH, **_parse(values, _PLAY)}
    playback = _pick(
        parsed,
        rate='rate',
        loop='loop',
        start_paused='start_paused',
        delay_ns='delay',
        clock_hz='clock',
        step='step',
        lossless='lossless',
        at_end='at_end',
    )
    read_ahead = parsed.get('read_ahead', DEFAULT_READ_AHEAD)
    if not 1 <= read_ahead <= MOST_READ_AHEAD:
        raise UsageError(f'read_ahead {read_ahead} is not within 1 to {MOST_READ_AHEAD} frames')
    return PlaySettings(
        read=_read_options(parsed),
        messages=_message_options(parsed),
        selection=_selection_options(parsed),
        playback=PlaybackOptions(**playback),
        stamps=parsed.get('stamps', Stamps.ORIGINAL),
        read_ahead=read_ahead,
        qos_overrides_path=parsed.get('qos_overrides_path'),
    )


def make_import_options(values: Mapping[str, object]) -> ImportOptions:
    """Options of to-kitti from values by name; None and absent ones take their default.

    Raises:
        UsageError: A name is unknown, or a value cannot be meant.
    """
    return ImportOptions(**_parse(values, _TO_KITTI))


def make_view_settings(values: Mapping[str, object]) -> ViewSettings:
    """Settings of view from values by name; None and absent ones take their default.

    Raises:
        UsageError: A name is unknown, or a value cannot be meant.
    """
    parsed = _parse(values, _VIEW)
    bird = _pick(parsed, pixels_per_metre='resolution')
    if 'range' in parsed:
        back, front, right, left = parsed['range']
        bird |= {'x_range': (back, front), 'y_range': (right, left)}
    fields = ('camera', 'color_by', 'color_map', 'point_size', 'classes')
    pictures = PictureOptions(
        **{name: parsed[name] for name in fields if name in parsed}, bird=BirdOptions(**bird)
    )
    if parsed.get('frame') is not None and parsed.get('frames') is not None:
        raise UsageError('--frame and --frames exclude each other')
    if not FPS[0] <= parsed.get('fps', 1) <= FPS[1]:
        raise UsageError(f'{parsed["fps"]:g} pictures a second; expected {FPS[0]:g} to {FPS[1]:g}')
    return ViewSettings(
        read=_read_options(parsed),
        pictures=pictures,
        mode=parsed.get('mode', 'panel'),
        frame=parsed.get('frame'),
        frames=parsed.get('frames'),
        predictions=parsed.get('predictions'),
        rate_hz=parsed.get('fps'),
        overwrite=parsed.get('overwrite', False),
    )


def _parse(values: Mapping[str, object], parsers: Mapping[str, _Parser]) -> dict[str, Any]:
    unknown = sorted(set(values) - set(parsers))
    if unknown:
        raise UsageError(f'there is no option {unknown[0]!r}; known are {", ".join(parsers)}')
    return {name: parsers[name](name, value) for name, value in values.items() if value is not None}


def _pick(parsed: Mapping[str, Any], **fields: str) -> dict[str, Any]:
    """The fields of an options object, each by the name of its option, where it is given."""
    return {field: parsed[name] for field, name in fields.items() if name in parsed}


def _read_options(parsed: Mapping[str, Any]) -> ReadOptions:
    return ReadOptions(
        **_pick(parsed, layout='layout', sequence='sequence', epoch_ns='epoch', semantic='semantic')
    )


def _message_options(parsed: Mapping[str, Any]) -> MessageOptions:
    markers = _pick(
        parsed,
        colors='marker_colors',
        alpha='marker_alpha',
        line_width='marker_line_width',
        arrow_length='marker_arrow_length',
        text_height='marker_text_height',
        lifetime_ns='marker_lifetime',
        trails='trails',
        ego='ego_marker',
    )
    fields = _pick(
        parsed,
        images='images',
        preset='preset',
        publish_tf='tf',
        ring_and_time='ring_time',
        base_to_imu='base_to_imu',
        semantic='semantic',
        annotated='annotated',
    )
    return MessageOptions(**fields, markers=MarkerOptions(**markers))


def _selection_options(parsed: Mapping[str, Any]) -> SelectionOptions:
    return SelectionOptions(
        **_pick(parsed, streams='streams', topics='topics', start='start', end='end')
    )


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


def _rounds(name: str, value: object) -> int:
    """A number of rounds; true is without end, false once."""
    if isinstance(value, bool):
        return 0 if value else 1
    return _integer(name, value)


def _path(name: str, value: object) -> Path:
    return Path(_text(name, value))


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


def _four_numbers(name: str, value: object) -> tuple[float, ...]:
    try:
        back, front, right, left = (float(word) for word in str(value).split(','))
    except ValueError:
        raise UsageError(
            f'{name} takes four numbers in metres, from and to forward, from and to the left, such'
            f" as '-10,60,-25,25', not {value!r}"
        ) from None
    return back, front, right, left


_RECORDING: dict[str, _Parser] = {
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
}

_TO_BAG: dict[str, _Parser] = {
    **_RECORDING,
    'storage': _text,
    'compression': _text,
    'compression_level': _integer,
    'split_size': _size,
    'split_duration': _seconds_ns,
    'strict': _flag,
    'overwrite': _flag,
}

_PLAY: dict[str, _Parser] = {
    **_RECORDING,
    'annotated': _flag,
    'rate': _number,
    'loop': _rounds,
    'start_paused': _flag,
    'delay': _seconds_ns,
    'clock': _number,
    'step': _integer,
    'lossless': _flag,
    'at_end': _choice(AtEnd),
    'stamps': _choice(Stamps),
    'read_ahead': _integer,
    'qos_overrides_path': _path,
}

_TO_KITTI: dict[str, _Parser] = {
    'layout': _choice(Layout),
    'name': _text,
    'calib': _path,
    'train_fraction': _number,
    'append': _flag,
}

_VIEW: dict[str, _Parser] = {
    'layout': _choice(Layout),
    'sequence': _text,
    'mode': _text,
    'frame': _integer,
    'frames': _text,
    'predictions': _path,
    'fps': _number,
    'overwrite': _flag,
    'camera': _integer,
    'color_by': _choice(ColorBy),
    'color_map': _choice(ColorMap),
    'point_size': _integer,
    'classes': _texts,
    'range': _four_numbers,
    'resolution': _number,
}

TO_BAG_OPTIONS = tuple(_TO_BAG)
PLAY_OPTIONS = tuple(_PLAY)
"""The names that make_settings and make_play_settings know."""
