# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of cutting the scans of a data set."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar, TypeAlias

from ..model.errors import UsageError
from .declare import choice, option
from .disk import fsync_option
from .parsers import parse_flag, parse_integer, parse_number, parse_text
from .quantity_parsers import parse_boxes, parse_image_size, parse_span
from .read import ReadOptions

Span: TypeAlias = tuple[float, float]
"""Lowest and highest value, both included; an open end is infinite."""

LASERS = 64
"""Of KITTI's scanner, a Velodyne HDL-64E."""
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
    )
    camera: int | None = option(
        None, "KITTI's number of the camera of --view", parse_integer, unset='2'
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
    )
    range_m: Span | None = option(
        None,
        'Only points so many metres from the scanner: 0.5:80, :80 or 5:',
        parse_span,
        name='range',
        unset='no limit',
        metavar='MIN:MAX',
    )
    height_m: Span | None = option(
        None,
        'Only points with z between, metres in velo_link, such as -1.5:2',
        parse_span,
        name='height',
        unset='no limit',
        metavar='MIN:MAX',
    )
    lasers: int | None = option(
        None,
        f'Number of lasers to keep of {LASERS}, evenly spaced',
        parse_integer,
        unset='all',
        choices=tuple(map(str, _FEWER_LASERS)),
    )
    voxel_m: float | None = option(
        None,
        'Only the first point of the file in each cube of so many metres',
        parse_number,
        name='voxel',
        unset='all points',
    )
    folder: str | None = option(
        None,
        'Write cut scans to this folder, such as velodyne_reduced, beside the unchanged ones',
        parse_text,
        unset='cut scans replace the scans',
        group=_DATA_SET,
        metavar='NAME',
    )
    empty_labels: EmptyLabels = choice(
        EmptyLabels.KEEP,
        'Labels without a point of the cut scan in their 3D box',
        EmptyLabels,
        group=_DATA_SET,
    )
    copy: bool = option(
        False, 'Copy unchanged files instead of linking them', parse_flag, group=_DATA_SET
    )
    overwrite: bool = option(False, 'Replace the data set in OUT', parse_flag, group=_DATA_SET)
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
            given = '--camera' if self.camera is not None else '--image-size'
            raise UsageError(f'{given} goes with --view reference or --view reduced')
        if self.camera is not None and self.camera < 0:
            raise UsageError(f'camera {self.camera} is negative; KITTI counts them from 0')

    @property
    def cuts(self) -> bool:
        """Whether any option selects points."""
        limits = (self.view, self.range_m, self.height_m, self.lasers, self.voxel_m)
        return bool(self.boxes) or any(each is not None for each in limits)
