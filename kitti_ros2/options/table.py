# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of each command, and their objects from values by name.

Command lines, YAML files and ROS parameters all fill the same objects.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..model.cloud_formats import FORMATS
from ..model.errors import UsageError
from .bag import BagOptions
from .declare import make_options, options_of, parse_values, values_for
from .for_stack import with_stack
from .ground_truth import GroundTruthOptions
from .importing import ImportOptions
from .imu import ImuOptions
from .markers import MarkerOptions
from .messages import Images, MessageOptions
from .pictures import BirdOptions, ColorBy, PictureOptions
from .playback import PlaybackOptions
from .predictions import PredictionOptions
from .read import ReadOptions, ScanStamp
from .selection import SelectionOptions
from .settings import PlaySettings, Settings, ViewSettings

if TYPE_CHECKING:
    from collections.abc import Mapping

_PREDICTIONS = options_of(PredictionOptions)
_IMU = options_of(ImuOptions)
_MESSAGES = (
    *options_of(MessageOptions),
    *options_of(GroundTruthOptions),
    *options_of(MarkerOptions),
)
_PLAY_DEFAULTS = {'images': Images.BOTH}

_SOURCE = {'layout', 'sequence', 'columns', 'real_time', 'mapping', 'raw'}
SOURCE = tuple(each for each in options_of(ReadOptions) if each.name in _SOURCE)
"""Options of every command that reads a KITTI folder."""
MOTION = tuple(each for each in options_of(ReadOptions) if each.name in {'deskew', 'undo_deskew'})
"""Options of commands that use the points of scans."""
REPORT = (*SOURCE, *MOTION)
STACK_DRIVE = (
    *(each for each in SOURCE if each.name in {'layout', 'sequence', 'columns'}),
    *_IMU,
)
"""Options of the drive that a stack is set up for."""
TO_BAG = (
    *options_of(ReadOptions),
    *options_of(SelectionOptions),
    *(each for each in _MESSAGES if each.name != 'annotated'),
    *_PREDICTIONS,
    *_IMU,
    *options_of(Settings),
    *options_of(BagOptions),
)
PLAY = tuple(
    replace(each, default=_PLAY_DEFAULTS.get(each.name, each.default))
    for each in (
        *options_of(ReadOptions),
        *options_of(SelectionOptions),
        *options_of(PlaybackOptions),
        *options_of(PlaySettings),
        *_MESSAGES,
        *_PREDICTIONS,
        *_IMU,
    )
)
_SPAN = tuple(each for each in options_of(SelectionOptions) if each.name in {'start', 'end'})
TO_KITTI = (*options_of(ImportOptions), *_SPAN)
VIEW = (
    *options_of(ViewSettings),
    *options_of(PictureOptions),
    *options_of(BirdOptions),
    *_PREDICTIONS,
    *SOURCE,
    *MOTION,
    *_SPAN,
    *(
        replace(each, meaning=f'With --rerun: {each.meaning}')
        for each in options_of(SelectionOptions)
        if each.name in {'topics', 'exclude_topics'}
    ),
)


def make_settings(values: Mapping[str, object]) -> Settings:
    """Make the settings of to-bag from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = with_stack(parse_values(values, TO_BAG), TO_BAG)
    return make_options(
        Settings,
        parsed,
        **_recording(parsed),
        bag=lambda storage: make_options(BagOptions, parsed, storage=storage),
    )


def make_play_settings(values: Mapping[str, object]) -> PlaySettings:
    """Make the settings of the player from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = {**_PLAY_DEFAULTS, **with_stack(parse_values(values, PLAY), PLAY)}
    return make_options(
        PlaySettings,
        parsed,
        **_recording(parsed),
        playback=make_options(PlaybackOptions, parsed),
    )


def make_import_options(values: Mapping[str, object]) -> ImportOptions:
    """Make the options of to-kitti from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, TO_KITTI)
    selection = make_options(SelectionOptions, parsed)
    return make_options(ImportOptions, parsed, selection=selection)


def make_view_settings(values: Mapping[str, object]) -> ViewSettings:
    """Make the settings of view from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, VIEW)
    bird = values_for(BirdOptions, parsed)
    if 'x_range' in bird:
        back, front, right, left = bird['x_range']
        bird |= {'x_range': (back, front), 'y_range': (right, left)}
    pictures = make_options(PictureOptions, parsed, bird=BirdOptions(**bird))
    semantic = pictures.color_by is ColorBy.SEMANTIC
    return make_options(
        ViewSettings,
        parsed,
        read=make_options(ReadOptions, parsed, semantic=semantic),
        pictures=pictures,
        selection=make_options(SelectionOptions, parsed),
        predictions=make_options(PredictionOptions, parsed),
    )


def _recording(parsed: dict[str, Any]) -> dict[str, Any]:
    """Return the options objects that to-bag and the player share."""
    if parsed.get('imu_from'):
        parsed.setdefault('covariances', True)
    predictions = make_options(PredictionOptions, parsed)
    messages = make_options(
        MessageOptions,
        parsed,
        semantic=parsed.get('semantic', False),
        stereo=parsed.get('stereo', False),
        overlaps=predictions.overlaps,
        markers=make_options(MarkerOptions, parsed),
        ground_truth=make_options(GroundTruthOptions, parsed),
    )
    cloud_format = FORMATS[messages.cloud]
    if cloud_format.is_timed and not parsed.get('deskew'):
        parsed.setdefault('scan_stamp', ScanStamp.START)
    read = make_options(ReadOptions, parsed)
    _check_columns(read, messages)
    if cloud_format.is_unsigned and read.scan_stamp is ScanStamp.FORWARD and not read.deskew:
        raise UsageError(
            f'points {messages.cloud.value} has unsigned times since the stamp, so the stamp is the'
            f' start of the turn; scan_stamp forward does not go with it'
        )
    return {
        'read': read,
        'messages': messages,
        'selection': make_options(SelectionOptions, parsed),
        'predictions': predictions,
        'imu': make_options(ImuOptions, parsed),
    }


def _check_columns(read: ReadOptions, messages: MessageOptions) -> None:
    fields = {field.name for field in FORMATS[messages.cloud].fields}
    common = () if read.columns is None else sorted(fields.intersection(read.columns.extra))
    if common and FORMATS[messages.cloud].extensible:
        raise UsageError(
            f'points {messages.cloud.value} has a field {common[0]} of its own; give the column'
            f' another name'
        )


TO_BAG_OPTIONS = tuple(each.name for each in TO_BAG)
PLAY_OPTIONS = tuple(each.name for each in PLAY)
"""Names that make_settings and make_play_settings accept."""
