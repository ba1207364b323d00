# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options from words: command lines, YAML files and ROS parameters fill the same objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from ..model.errors import UsageError
from ..model.streams import Layout
from .bag import BagOptions
from .importing import ImportOptions
from .messages import Images, MapFrame, MarkerColors, MarkerOptions, MessageOptions, Preset
from .parsers import (
    parse_bound,
    parse_choice,
    parse_epoch,
    parse_flag,
    parse_four_numbers,
    parse_integer,
    parse_number,
    parse_path,
    parse_place,
    parse_rounds,
    parse_seconds_ns,
    parse_split_size,
    parse_text,
    parse_texts,
)
from .pictures import BirdOptions, ColorBy, ColorMap, PictureOptions
from .playback import AtEnd, PlaybackOptions, Stamps
from .read import ReadOptions, ScanStamp
from .selection import SelectionOptions

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_Parser: TypeAlias = Callable[[str, object], Any]

DEFAULT_READ_AHEAD = 8
MOST_READ_AHEAD = 1000
FPS = (0.1, 240.0)


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
        wait_for='wait_for',
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
    fields = _pick(
        parsed,
        layout='layout',
        sequence='sequence',
        epoch_ns='epoch',
        semantic='semantic',
        period_ns='period',
        scan_stamp='scan_stamp',
    )
    if parsed.get('ring_time'):
        fields.setdefault('scan_stamp', ScanStamp.START)
    return ReadOptions(**fields)


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
        map='map',
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


_RECORDING: dict[str, _Parser] = {
    'layout': parse_choice(Layout),
    'sequence': parse_text,
    'epoch': parse_epoch,
    'period': parse_seconds_ns,
    'images': parse_choice(Images),
    'preset': parse_choice(Preset),
    'map': parse_choice(MapFrame),
    'tf': parse_flag,
    'ring_time': parse_flag,
    'scan_stamp': parse_choice(ScanStamp),
    'base_to_imu': parse_place,
    'semantic': parse_flag,
    'marker_colors': parse_choice(MarkerColors),
    'trails': parse_flag,
    'ego_marker': parse_flag,
    'marker_alpha': parse_number,
    'marker_line_width': parse_number,
    'marker_arrow_length': parse_number,
    'marker_text_height': parse_number,
    'marker_lifetime': parse_seconds_ns,
    'streams': parse_texts,
    'topics': parse_texts,
    'start': parse_bound,
    'end': parse_bound,
}

_TO_BAG: dict[str, _Parser] = {
    **_RECORDING,
    'storage': parse_text,
    'compression': parse_text,
    'compression_level': parse_integer,
    'split_size': parse_split_size,
    'split_duration': parse_seconds_ns,
    'strict': parse_flag,
    'overwrite': parse_flag,
}

_PLAY: dict[str, _Parser] = {
    **_RECORDING,
    'annotated': parse_flag,
    'rate': parse_number,
    'loop': parse_rounds,
    'start_paused': parse_flag,
    'delay': parse_seconds_ns,
    'clock': parse_number,
    'step': parse_integer,
    'lossless': parse_flag,
    'wait_for': parse_integer,
    'at_end': parse_choice(AtEnd),
    'stamps': parse_choice(Stamps),
    'read_ahead': parse_integer,
    'qos_overrides_path': parse_path,
}

_TO_KITTI: dict[str, _Parser] = {
    'layout': parse_choice(Layout),
    'name': parse_text,
    'calib': parse_path,
    'train_fraction': parse_number,
    'append': parse_flag,
}

_VIEW: dict[str, _Parser] = {
    'layout': parse_choice(Layout),
    'sequence': parse_text,
    'mode': parse_text,
    'frame': parse_integer,
    'frames': parse_text,
    'predictions': parse_path,
    'fps': parse_number,
    'overwrite': parse_flag,
    'camera': parse_integer,
    'color_by': parse_choice(ColorBy),
    'color_map': parse_choice(ColorMap),
    'point_size': parse_integer,
    'classes': parse_texts,
    'range': parse_four_numbers,
    'resolution': parse_number,
}

TO_BAG_OPTIONS = tuple(_TO_BAG)
PLAY_OPTIONS = tuple(_PLAY)
"""The names that make_settings and make_play_settings know."""
