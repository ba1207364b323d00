# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the commands for whole data sets, and their values by name."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, ClassVar, TypeAlias

from ..model.errors import UsageError
from .declare import (
    accepts,
    check_bounds,
    choice,
    fsync_option,
    make_options,
    option,
    options_of,
    parse_boxes,
    parse_flag,
    parse_image_size,
    parse_integer,
    parse_number,
    parse_path,
    parse_paths,
    parse_seconds_ns,
    parse_shares,
    parse_size,
    parse_span,
    parse_text,
    parse_texts,
    parse_values,
)
from .read import MOTION, SOURCE, ReadOptions, ValidateOptions, make_with_source
from .table import collection_options

if TYPE_CHECKING:
    from collections.abc import Mapping
    from fractions import Fraction
    from pathlib import Path

    from ..model.streams import Layout


# Options of cutting the scans of a data set.

Span: TypeAlias = tuple[float, float]
"""Lowest and highest value, both included; an open end is infinite."""

LASERS = 64
"""Lasers of KITTI's scanner, a Velodyne HDL-64E."""
_FEWER_LASERS = (32, 16)
_LEAST_VOXEL_M = 0.001
_FOLDER = re.compile(r'velodyne[\w.-]*', re.ASCII)
_DATA_SET = 'Data set'


class View(str, Enum):
    """Rules for the points that a camera sees."""

    REFERENCE = 'reference'
    REDUCED = 'reduced'


class EmptyLabels(str, Enum):
    """Treatment of labels without a point in their 3D box."""

    KEEP = 'keep'
    DROP = 'drop'


@dataclass(frozen=True)
class CropOptions:
    """Options of cutting scans; metres in velo_link.

    Attributes:
        view: Only points in the image of a camera; None keeps all.
        camera: KITTI index of that camera; None is camera 2.
        image_size: (width, height) of its images; None reads it from the calibration or an image.
        boxes: Only points in any of these: xmin, ymin, zmin, xmax, ymax, zmax; empty is no limit.
        range_m: Only points at this distance from the scanner.
        height_m: Only points with z between these.
        lasers: Number of lasers to keep of 64, evenly spaced; None keeps all.
        voxel_m: Edge of cubes of which each keeps its first point in the file; None keeps all.
        folder: Folder for the cut scans, beside the unchanged ones; None replaces those.
        empty_labels: Whether labels without a point in their 3D box are kept.
        copy: Whether unchanged files are copied instead of hard-linked.
        overwrite: Whether an existing data set may be replaced.
        fsync: Whether the finished data set outlasts a power cut.
        read: Layout and sequence of the source.

    Raises:
        UsageError: A value is out of range, or does not go with the others.
    """

    group: ClassVar = 'Points'

    view: View | None = choice(
        None,
        'Only what a camera sees: reference (reflectance above 0, rounded pixels) or reduced'
        ' (as velodyne_reduced)',
        View,
        unset='all points',
        common=True,
    )
    camera: int | None = option(
        None,
        "KITTI's number of the camera of --view",
        parse_integer,
        unset='2',
        common=True,
    )
    image_size: tuple[int, int] | None = option(
        None,
        'Pixels of its images, such as 1242x375, for a set without images',
        parse_image_size,
        unset="the images'",
        metavar='WxH',
    )
    boxes: tuple[tuple[float, ...], ...] = option(
        (),
        'Only points in the box xmin ymin zmin xmax ymax zmax, or in any of several',
        parse_boxes,
        name='box',
        unset='no limit',
        metavar='NUMBER...',
        common=True,
    )
    range_m: Span | None = option(
        None,
        'Only points so many metres from the scanner: 0.5:80, :80 or 5:',
        parse_span,
        name='range',
        unset='no limit',
        metavar='MIN:MAX',
        common=True,
    )
    height_m: Span | None = option(
        None,
        'Only points with z between, metres in velo_link, such as -1.5:2',
        parse_span,
        name='height',
        unset='no limit',
        metavar='MIN:MAX',
        common=True,
    )
    lasers: int | None = option(
        None,
        f'Number of lasers to keep of {LASERS}, evenly spaced',
        parse_integer,
        unset='all',
        choices=tuple(map(str, _FEWER_LASERS)),
        common=True,
    )
    voxel_m: float | None = option(
        None,
        'Only the first point of the file in each cube of so many metres',
        parse_number,
        name='voxel',
        unset='all points',
        common=True,
    )
    folder: str | None = option(
        None,
        'Write cut scans to this folder, such as velodyne_reduced, beside the unchanged ones',
        parse_text,
        unset='cut scans replace the scans',
        group=_DATA_SET,
        metavar='NAME',
        common=True,
    )
    empty_labels: EmptyLabels = choice(
        EmptyLabels.KEEP,
        'Labels without a point of the cut scan in their 3D box',
        EmptyLabels,
        group=_DATA_SET,
    )
    copy: bool = option(
        False,
        'Copy unchanged files instead of linking them',
        parse_flag,
        group=_DATA_SET,
        common=True,
    )
    overwrite: bool = option(
        False, 'Replace the data set in OUT', parse_flag, group=_DATA_SET, common=True
    )
    fsync: bool = fsync_option(group=_DATA_SET)
    read: ReadOptions = field(default_factory=ReadOptions)

    def __post_init__(self) -> None:
        self._check_view()
        for box in self.boxes:
            if not all(low < high for low, high in zip(box[:3], box[3:], strict=True)):
                shown = ' '.join(f'{value:g}' for value in box)
                raise UsageError(
                    f'the box {shown} is empty; expected xmin ymin zmin xmax ymax zmax, each'
                    f' minimum below its maximum'
                )
        for name, span in (('range', self.range_m), ('height', self.height_m)):
            if span is not None and not span[0] < span[1]:
                raise UsageError(f'the {name} {span[0]:g}:{span[1]:g} is empty; expected MIN:MAX')
        if self.lasers not in (None, *_FEWER_LASERS):
            raise UsageError(f'{self.lasers} lasers; expected {_FEWER_LASERS[0]} or 16 of {LASERS}')
        if self.voxel_m is not None and not _LEAST_VOXEL_M <= self.voxel_m < math.inf:
            raise UsageError(
                f'a voxel of {self.voxel_m:g} m; expected at least {_LEAST_VOXEL_M:g}, such as 0.1'
            )
        if self.folder is not None and not _FOLDER.fullmatch(self.folder):
            raise UsageError(
                f'the folder {self.folder!r} is no name for scans; expected a name such as'
                f' velodyne_reduced'
            )

    def _check_view(self) -> None:
        if self.view is None and (self.camera, self.image_size) != (None, None):
            flag = '--camera' if self.camera is not None else '--image-size'
            raise UsageError(f'{flag} goes with --view reference or --view reduced')
        if self.camera is not None and self.camera < 0:
            raise UsageError(f'camera {self.camera} is negative; KITTI counts them from 0')

    @property
    def cuts(self) -> bool:
        """Whether any option selects points."""
        limits = (self.view, self.range_m, self.height_m, self.lasers, self.voxel_m)
        return bool(self.boxes) or any(limit is not None for limit in limits)

    @property
    def changes(self) -> bool:
        """Whether any option asks for other scans or labels than those of the source."""
        moves = self.read.deskew or self.read.undo_deskew
        return self.cuts or moves or self.empty_labels is EmptyLabels.DROP


# Options of dividing a data set into lists of frames or sequences.

_NAME = re.compile(r'[A-Za-z0-9_][A-Za-z0-9_.-]*', re.ASCII)
_NAMES = ('train', 'val')
_ROUNDING = 1e-9
"""Tolerance of the sum of the shares, which is 1."""


@dataclass(frozen=True)
class SplitOptions:
    """Options of dividing a data set.

    Attributes:
        ratio: The share of each list; empty is equal shares.
        names: The name of each list; empty is train and val.
        seed: Chooses one of the random orders; None is 0.
        by_drive: Whether frames of one raw drive of an object set stay together.
        lists: Files of fixed lists to check and copy, in place of random ones.
        check: Whether the existing lists, or those of lists, are compared and nothing is written.
        mapping: The folder of the object devkit's mapping; None searches beside the set.
        out: The folder of the lists; None is ImageSets of the set.
        overwrite: Whether existing lists may be replaced.

    Raises:
        UsageError: A value is invalid, or excludes another.
    """

    group: ClassVar = 'Split'

    ratio: tuple[Fraction, ...] = option(
        (),
        'Share of each list, such as 0.8 0.2',
        parse_shares,
        unset='equal shares',
        metavar='SHARE...',
    )
    names: tuple[str, ...] = option((), 'Name of each list', parse_texts, unset='train val')
    seed: int | None = option(
        None, 'Number of the random order', parse_integer, unset='0', metavar='N'
    )
    by_drive: bool = option(
        False, "Keep frames of one raw drive together, by the devkit's mapping", parse_flag
    )
    lists: tuple[Path, ...] = option(
        (),
        'Check and copy these lists instead; with --check only check them',
        parse_paths,
        unset='none',
        flags=('--lists', '--from'),
        metavar='FILE...',
    )
    check: bool = option(
        False, 'Write nothing; compare the lists of the set, each with each', parse_flag
    )
    mapping: Path | None = option(
        None,
        "Folder of the devkit's train_mapping.txt",
        parse_path,
        unset='beside the set',
        metavar='DIR',
    )
    out: Path | None = option(
        None,
        'Folder of the lists',
        parse_path,
        unset='ImageSets in SRC',
        flags=('--out', '-o'),
        metavar='OUT',
    )
    overwrite: bool = option(False, 'Replace existing lists', parse_flag)

    def __post_init__(self) -> None:
        self._check_combination()
        for name in self.names:
            if not _NAME.fullmatch(name):
                raise UsageError(f'{name!r} is no name of a list; expected letters and digits')
        if len(set(self.names)) < len(self.names):
            raise UsageError(f'the lists {" ".join(self.names)} have not different names')
        if self.ratio and len(self.ratio) != len(self.list_names):
            raise UsageError(
                f'{len(self.ratio)} shares for the lists {" ".join(self.list_names)};'
                f' give a share and a name to each, with --ratio and --names'
            )
        if self.ratio and abs(float(sum(self.ratio)) - 1) > _ROUNDING:
            shares = ' '.join(f'{float(share):g}' for share in self.ratio)
            raise UsageError(f'the shares {shares} add up to {float(sum(self.ratio)):g}, not to 1')

    def _check_combination(self) -> None:
        random = {
            '--ratio': self.ratio,
            '--names': self.names,
            '--seed': self.seed is not None,
            '--by-drive': self.by_drive,
        }
        flags = [flag for flag, value in random.items() if value]
        other = '--check' if self.check else '--lists' if self.lists else ''
        if flags and other:
            raise UsageError(f'{flags[0]} is for new random lists, not for {other}')
        if self.check and self.overwrite:
            raise UsageError('--check writes nothing, so it does not go with --overwrite')

    @property
    def list_names(self) -> tuple[str, ...]:
        """The names of new lists."""
        return self.names or _NAMES

    @property
    def shares(self) -> tuple[Fraction, ...]:
        """The share of each new list."""
        from fractions import Fraction  # noqa: PLC0415 - for one command

        count = len(self.list_names)
        return self.ratio or (Fraction(1, count),) * count


# Options of extracting and downloading archives.


@dataclass(frozen=True)
class ExtractOptions:
    """Options of extracting archives.

    Attributes:
        overwrite: Whether existing files with other content are replaced.
        remove_archives: Whether an archive is removed when all of it is extracted.
        max_ratio: Bytes of content for each byte of an archive, above which it is refused.
        max_size: Bytes of content of one archive, above which it is refused.
        fsync: Whether finished files outlast a power cut.

    Raises:
        UsageError: The ratio is out of range.
    """

    group: ClassVar = 'Extraction'

    overwrite: bool = option(False, 'Replace existing files that differ', parse_flag, common=True)
    remove_archives: bool = option(
        False, 'Remove each archive of which everything was extracted', parse_flag
    )
    max_ratio: float = option(
        200.0,
        'Refuse archives that grow to more than so many times their size',
        parse_number,
        bounds=(1.0, 2000.0),
    )
    max_size: int = option(
        500_000_000_000,
        'Refuse archives of more content, such as 2TB',
        parse_size,
        unset='500GB',
        metavar='SIZE',
    )
    fsync: bool = fsync_option()

    def __post_init__(self) -> None:
        check_bounds(self, 'max_ratio')


@accepts(keyword='OneOrMore')
def parse_categories(name: str, value: object) -> tuple[str, ...]:
    """Parse categories of raw drives, separated by commas."""
    return parse_texts(name, value)


@dataclass(frozen=True)
class DownloadOptions:
    """Options of downloading archives.

    Attributes:
        categories: Only raw drives of these categories; empty selects all.
        sync, extract, tracklets: Which archives of raw drives; none selects sync and tracklets.
        base_url: Where the archives are.
        checksums: A file of SHA-256 checksums as sha256sum writes it, or None.
        verify: Whether known checksums are compared.
        keep_archives: Whether archives are kept after they are extracted.
        archives_only: Whether archives are not extracted at all.
        jobs: Number of archives to download at a time.
        retries: Attempts without any progress after which an archive is skipped.
        timeout_ns: Time without any data after which a transfer is broken off.
        accept_license: Whether the terms of KITTI are accepted.

    Raises:
        UsageError: A value is out of range.
    """

    group: ClassVar = 'Download'

    categories: tuple[str, ...] = option(
        (),
        'Raw: only drives of these, such as city,road',
        parse_categories,
        name='category',
        unset='all',
        metavar='NAMES',
        common=True,
    )
    sync: bool = option(
        False,
        'Raw: rectified, paired by number (default)',
        parse_flag,
        flags=('--sync',),
        common=True,
    )
    extract: bool = option(
        False,
        'Raw: unrectified, before synchronization',
        parse_flag,
        flags=('--extract',),
        common=True,
    )
    tracklets: bool = option(
        False,
        'Raw: 3D labels (default, too, where they exist)',
        parse_flag,
        flags=('--tracklets',),
        common=True,
    )
    accept_license: bool = option(
        False,
        "Accept KITTI's terms (asked for once): CC BY-NC-SA 3.0",
        parse_flag,
        flags=('--accept-license',),
        common=True,
    )
    base_url: str | None = option(
        None,
        'A mirror: http(s)://... or file:///...',
        parse_text,
        unset="KITTI's own",
        metavar='URL',
        common=True,
    )
    checksums: Path | None = option(
        None,
        'SHA-256 checksums to compare, a file as sha256sum writes it',
        parse_path,
        unset='the public ones',
    )
    verify: bool = option(True, 'Compare known SHA-256 checksums', parse_flag)
    keep_archives: bool = option(
        False,
        'Keep archives after extracting them',
        parse_flag,
        flags=('--keep-archives',),
        common=True,
    )
    archives_only: bool = option(
        False,
        'Do not extract the archives',
        parse_flag,
        flags=('--archives-only',),
        common=True,
    )
    jobs: int = option(
        3, 'Archives to download at a time', parse_integer, bounds=(1, 16), common=True
    )
    retries: int = option(
        6, 'Attempts without progress before giving up', parse_integer, bounds=(0, 100)
    )
    timeout_ns: int = option(
        30_000_000_000,
        'Seconds without data before another attempt',
        parse_seconds_ns,
        name='timeout',
        bounds=(0.1, 3600.0),
    )

    def __post_init__(self) -> None:
        check_bounds(self, 'jobs', 'retries', 'timeout')


# Options of statistics.


@dataclass(frozen=True)
class StatisticsOptions:
    """Options of statistics.

    Attributes:
        points: Whether scans are read, to count the points inside 3D boxes.
    """

    group: ClassVar = 'Statistics'

    points: bool = option(
        False,
        'Also count points in boxes; reads all scans',
        parse_flag,
        flags=('--count-points',),
        common=True,
    )


# The options of the commands for whole data sets, and their values by name.

EXTRACT = options_of(ExtractOptions)
DOWNLOAD = (
    *options_of(DownloadOptions),
    *(opt for opt in EXTRACT if opt.name != 'remove_archives'),
)
_SOURCES = tuple(
    replace(opt, unset='all') if opt.name == 'sequence' else opt
    for opt in SOURCE
    if opt.name in {'layout', 'sequence', 'columns'}
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
    *(opt for opt in SOURCE if opt.name == 'layout'),
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
