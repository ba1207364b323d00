# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of reading a KITTI folder: layout, sequence, time of recordings without stamps."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, ClassVar, TypeVar

from ..model.errors import UsageError
from ..model.layouts import Layout
from ..model.stamps import NS_PER_S
from .declare import check_bounds, choice, make_options, option, parse_values
from .parsers import parse_columns, parse_flag, parse_path, parse_text
from .quantity_parsers import parse_epoch, parse_seconds_ns

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.scan_columns import ScanColumns
    from .declare import Option

T = TypeVar('T')

DEFAULT_EPOCH_NS = 1_316_995_200_000_000_000
"""2011-09-26 00:00:00 UTC, the first day of KITTI's recordings."""
NOMINAL_PERIOD_NS = 103_600_000
"""One turn of KITTI's scanner, for recordings without time stamps: 0.1036 s.

Sources: times.txt of odometry 00 begins 0, 0.103736, 0.207338, 0.311075 s; in tracking 0000 the yaw
changes by 0.10360 s times the yaw rate. Raw stamps of 0001 and 0005 are 0.1031 and 0.1033 s apart.
"""
_PERIODS_S = (0.001, 60.0)


class ScanStamp(str, Enum):
    """Moment of a scan that its stamp marks: the start of the turn, or facing forward."""

    START = 'start'
    FORWARD = 'forward'


@dataclass(frozen=True)
class ReadOptions:
    """Options of reading a KITTI folder.

    Attributes:
        layout: One of KITTI's; None detects it.
        sequence: Which drive, split or sequence, where the folder holds several.
        epoch_ns: When recordings without absolute time begin, nanoseconds since 1970.
        semantic: Whether scans are read with SemanticKITTI's labels.
        period_ns: Time between frames of recordings without time stamps, and length of a turn
            of the scanner whose start and end are not known; 1 ms to 60 s.
        scan_stamp: Moment of a scan that its stamp marks. Scans that KITTI has compensated for
            motion (odometry) keep their stamps.
        real_time: Whether frames of an object set have the stamps of their raw drives.
        mapping: The folder of the object devkit's mapping; None searches beside the set.
        raw: The folder of the raw drives; None searches beside the set.
        deskew: Whether scans are compensated for motion, to the moment of facing forward. Those of
            odometry already are.
        undo_deskew: Whether scans that KITTI has compensated (odometry) are read as measured.
        columns: Those of .bin scans; None are KITTI's, and scans of others are refused.
        stereo: Whether right images have the stamps of their left ones; see kitti/stereo_pairs.py.

    Raises:
        UsageError: The epoch is not after 1970, the period is out of range, options exclude each
            other, or a mapping or raw drives are given without real_time.
    """

    group: ClassVar = 'Source'

    layout: Layout | None = choice(
        None, 'Layout of the KITTI folder', Layout, unset='detected', live=True
    )
    sequence: str | None = option(
        None,
        'Which drive, split or sequence of the source, such as 00',
        parse_text,
        unset='the only one',
        live=True,
        any_type=True,
        metavar='NAME',
    )
    epoch_ns: int = option(
        DEFAULT_EPOCH_NS,
        'UTC start of recordings without absolute time',
        parse_epoch,
        name='epoch',
        metavar='TIME',
        unset='2011-09-26 00:00:00',
    )
    semantic: bool = option(
        False, "Points also have SemanticKITTI's label, instance and rgb", parse_flag
    )
    period_ns: int = option(
        NOMINAL_PERIOD_NS,
        'Seconds between frames of recordings without time stamps',
        parse_seconds_ns,
        name='period',
        bounds=_PERIODS_S,
    )
    scan_stamp: ScanStamp = choice(
        ScanStamp.FORWARD,
        'Stamp of a scan: the start of its turn, or when it faces forward',
        ScanStamp,
        unset='start if points have times, else forward',
    )
    real_time: bool = option(
        False, 'Object frames have the stamps of their raw drives, by the devkit', parse_flag
    )
    mapping: Path | None = option(
        None,
        "With --real-time: folder of the devkit's train_mapping.txt",
        parse_path,
        unset='beside the set',
        metavar='DIR',
    )
    raw: Path | None = option(
        None,
        'With --real-time: folder of the raw drives',
        parse_path,
        unset='beside the set',
        metavar='DIR',
    )
    deskew: bool = option(
        False,
        'Compensate scans for motion: all points at the moment of facing forward',
        parse_flag,
    )
    undo_deskew: bool = option(
        False, "Undo KITTI's compensation of odometry scans: points as measured", parse_flag
    )
    stereo: bool = option(
        False,
        'Stereo pairs: one stamp a pair, and CameraInfo as stereo nodes expect it',
        parse_flag,
    )

    columns: ScanColumns | None = option(
        None,
        "Columns of .bin scans that are not KITTI's, such as 'x y z intensity ring': - skips one,"
        ' :f8 is float64',
        parse_columns,
        unset='x y z intensity, and others are refused',
        metavar="'NAME...'",
    )

    def __post_init__(self) -> None:
        if self.epoch_ns <= 0:
            raise UsageError(f'the epoch {self.epoch_ns} is not after 1970; players refuse stamp 0')
        check_bounds(self, 'period')
        if not self.real_time and (self.mapping is not None or self.raw is not None):
            given = '--raw' if self.mapping is None else '--mapping'
            raise UsageError(f'{given} is for --real-time; give both')
        if self.deskew and self.undo_deskew:
            raise UsageError('deskew and undo_deskew exclude each other')
        if self.deskew and self.scan_stamp is ScanStamp.START:
            raise UsageError(
                'deskew moves points to the moment of facing forward, which is the stamp then;'
                ' scan_stamp start does not go with it'
            )


def is_period(period_ns: int) -> bool:
    """Whether a period of frames is within the allowed range."""
    return _PERIODS_S[0] <= period_ns / NS_PER_S <= _PERIODS_S[1]


def make_with_source(
    table: tuple[Option, ...], kind: type[T], values: Mapping[str, object]
) -> tuple[ReadOptions, T]:
    """Make the options of a KITTI folder and those of a command; None is the default.

    Args:
        table: All options of the command.
        kind: The dataclass of its own.
        values: By name of option.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, table)
    return make_options(ReadOptions, parsed), make_options(kind, parsed)
