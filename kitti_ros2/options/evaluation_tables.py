# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The options of the evaluations, and their values by name."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from .bag_results import BagResultsOptions
from .batch import collection_options
from .declare import make_options, options_of, parse_values
from .eval_detection import DetectionOptions
from .eval_live import LiveOptions
from .eval_odometry import OdometryOptions
from .read import ReadOptions, make_with_source
from .table import PLAY, SOURCE, make_play_settings

if TYPE_CHECKING:
    from collections.abc import Mapping

DETECTION = (
    *options_of(DetectionOptions),
    *options_of(BagResultsOptions),
    *(each for each in SOURCE if each.name in {'layout', 'sequence', 'columns'}),
)
_OF_PLAYER = {
    *('layout', 'sequence', 'columns', 'deskew', 'undo_deskew', 'stereo', 'imu_from', 'imu_stamps'),
    *('start', 'end', 'preset', 'map', 'tf', 'ring_time', 'points', 'stack', 'images'),
    *('ground_truth_tree', 'ground_truth_map', 'ground_truth_base'),
    *('covariances', 'stereo_frame', 'color_encoding'),
}
_PLAYED = tuple(each for each in PLAY if each.name in _OF_PLAYER)
LIVE = (*options_of(LiveOptions), *_PLAYED)
_OF_FOLDERS = {'layout', 'sequence', 'epoch'}
ODOMETRY = (
    *options_of(OdometryOptions),
    *(each for each in options_of(ReadOptions) if each.name in _OF_FOLDERS),
)
TRACKING = (
    *options_of(BagResultsOptions),
    *(
        replace(each, unset='all') if each.name == 'sequence' else each
        for each in options_of(ReadOptions)
        if each.name in {'sequence', 'epoch', 'period'}
    ),
)
"""Ground truth has the epoch and the period that it was played with."""
_COLLECTION = collection_options(
    'Ground truth and results are collections (a root, a quoted glob, or a .txt list): each result'
    ' is a unit; with -o OUT, a folder'
)
DETECTION_ALL = (*DETECTION, *_COLLECTION)
TRACKING_ALL = (*TRACKING, *_COLLECTION)
ODOMETRY_ALL = (*ODOMETRY, *_COLLECTION)

make_odometry_options = partial(make_with_source, ODOMETRY, OdometryOptions)
make_tracking_options = partial(make_with_source, TRACKING, BagResultsOptions)
"""Take values by name, and return the options of the source and those of the command."""


def make_detection_options(
    values: Mapping[str, object],
) -> tuple[ReadOptions, DetectionOptions, BagResultsOptions]:
    """Make the options of eval detection from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, DETECTION)
    return (
        make_options(ReadOptions, parsed),
        make_options(DetectionOptions, parsed),
        make_options(BagResultsOptions, parsed),
    )


def make_live_options(values: Mapping[str, object]) -> tuple[LiveOptions, dict[str, object]]:
    """Make the options of eval live from values by name, and those of its player by name.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    options = make_options(LiveOptions, parse_values(values, LIVE))
    played = {name: value for name, value in values.items() if name in _OF_PLAYER}
    make_play_settings(played)
    return options, played
