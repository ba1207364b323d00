# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The options of the commands for whole data sets, and their values by name."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from .batch import collection_options
from .crop import CropOptions
from .declare import make_options, options_of, parse_values
from .fetching import DownloadOptions, ExtractOptions
from .read import ReadOptions, make_with_source
from .split import SplitOptions
from .statistics import StatisticsOptions
from .table import MOTION, SOURCE
from .validating import ValidateOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.layouts import Layout

EXTRACT = options_of(ExtractOptions)
DOWNLOAD = (
    *options_of(DownloadOptions),
    *(each for each in EXTRACT if each.name != 'remove_archives'),
)
_SOURCES = tuple(
    replace(each, unset='all') if each.name == 'sequence' else each
    for each in SOURCE
    if each.name in {'layout', 'sequence', 'columns'}
)
VALIDATE = (*_SOURCES, *options_of(ValidateOptions))
STATS = (*options_of(StatisticsOptions), *_SOURCES)
VALIDATE_ALL = (
    *VALIDATE,
    *collection_options(
        'PATH is a collection (a root, a quoted glob, or a .txt list): each recording and bag is a'
        ' unit; with -o OUT'
    ),
)
STATS_ALL = (
    *STATS,
    *collection_options(
        'PATH is a collection (a root, a quoted glob, or a .txt list): each recording and bag is a'
        ' unit; with -o OUT, a folder'
    ),
)
CROP = (*options_of(CropOptions), *_SOURCES, *MOTION)
SPLIT = (
    *options_of(SplitOptions),
    *(each for each in SOURCE if each.name == 'layout'),
)


def make_extract_options(values: Mapping[str, object]) -> ExtractOptions:
    """Make the options of extract from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    return make_options(ExtractOptions, parse_values(values, EXTRACT))


def make_download_options(
    values: Mapping[str, object],
) -> tuple[DownloadOptions, ExtractOptions]:
    """Make the options of download from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, DOWNLOAD)
    options = make_options(DownloadOptions, parsed)
    removes = not options.keep_archives
    return options, make_options(ExtractOptions, parsed, remove_archives=removes)


make_statistics_options = partial(make_with_source, STATS, StatisticsOptions)
make_validation_options = partial(make_with_source, VALIDATE, ValidateOptions)
"""Take values by name, and return the options of the source and those of the command."""


def make_crop_options(values: Mapping[str, object]) -> CropOptions:
    """Make the options of crop from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, CROP)
    return make_options(CropOptions, parsed, read=make_options(ReadOptions, parsed))


def make_split_options(values: Mapping[str, object]) -> tuple[SplitOptions, Layout | None]:
    """Make the options of split from values by name, and the layout; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, SPLIT)
    return make_options(SplitOptions, parsed), parsed.get('layout')
