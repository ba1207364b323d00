# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of reading: layout and sequence of a KITTI folder, the selected part."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, ClassVar, TypeVar

from ..model.classes import KITTI_OVERLAPS, LeastOverlaps
from ..model.errors import UsageError
from ..model.streams import NS_PER_S, Layout, format_stamp, parse_seconds, parse_stamp
from .declare import (
    accepts,
    check_bounds,
    choice,
    make_options,
    option,
    options_of,
    parse_columns,
    parse_epoch,
    parse_flag,
    parse_least_overlaps,
    parse_path,
    parse_seconds_ns,
    parse_text,
    parse_texts,
    parse_values,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.streams import ScanColumns
    from .declare import Option


# Options of reading a KITTI folder: layout, sequence, time of recordings without stamps.

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
    """Time of a scan that its stamp marks: the start of the turn, or facing forward."""

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
        scan_stamp: Time of a scan that its stamp marks. Scans that KITTI has compensated for
            motion (odometry) keep their stamps.
        real_time: Whether frames of an object set have the stamps of their raw drives.
        mapping: The folder of the object devkit's mapping; None searches beside the set.
        raw: The folder of the raw drives; None searches beside the set.
        deskew: Whether scans are compensated for motion, to the moment of facing forward. Those of
            odometry already are.
        undo_deskew: Whether scans that KITTI has compensated (odometry) are read as measured.
        columns: Those of .bin scans; None are KITTI's, and scans of others are refused.
        stereo: Whether right images have the stamps of their left ones; see kitti/prepare.py.

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
        common=True,
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
        flags=('--raw-drives',),
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
            flag = '--raw-drives' if self.mapping is None else '--mapping'
            raise UsageError(f'{flag} is for --real-time; give both')
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


_SOURCE = {'layout', 'sequence', 'columns', 'real_time', 'mapping', 'raw'}
SOURCE = tuple(opt for opt in options_of(ReadOptions) if opt.name in _SOURCE)
"""Options of every command that reads a KITTI folder."""
MOTION = tuple(opt for opt in options_of(ReadOptions) if opt.name in {'deskew', 'undo_deskew'})
"""Options of commands that use the points of scans."""


def make_source_options(values: Mapping[str, object]) -> ReadOptions:
    """Make the options of a KITTI folder from values of SOURCE by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    return make_options(ReadOptions, parse_values(values, SOURCE))


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


# Selected part of a recording or a bag: topics, streams, start and end.


@dataclass(frozen=True)
class Bound:
    """One end of a selection: exactly one of a frame number, an offset, or a stamp.

    Attributes:
        frame: File number.
        offset_ns: Nanoseconds from the recording's first stamp.
        stamp_ns: Nanoseconds since 1970, UTC.
    """

    frame: int | None = None
    offset_ns: int | None = None
    stamp_ns: int | None = None

    @classmethod
    def parse(cls, text: str) -> Bound:
        """Parse `12` (frame), `3.5s` (from the start), or a KITTI time stamp.

        Raises:
            UsageError: The text is none of these.
        """
        text = text.strip()
        try:
            if text.isdecimal():
                return cls(frame=int(text))
            if text.endswith('s'):
                return cls(offset_ns=parse_seconds(text[:-1]))
            return cls(stamp_ns=parse_stamp(text))
        except ValueError:
            raise UsageError(
                f'invalid start or end {text!r}; write a frame (12), seconds from the start (3.5s)'
                f" or a time stamp ('2011-09-26 13:02:25.9')"
            ) from None

    def __str__(self) -> str:
        """Return readable text: frame 12, 3.5s, or a time stamp."""
        if self.frame is not None:
            return f'frame {self.frame}'
        if self.offset_ns is not None:
            return f'{self.offset_ns / NS_PER_S:.9f}'.rstrip('0').rstrip('.') + 's'
        return format_stamp(self.stamp_ns or 0)

    def is_before(self, other: Bound) -> bool:
        """Whether it is before another bound of the same kind; False for a different kind."""
        pairs = (
            (self.frame, other.frame),
            (self.offset_ns, other.offset_ns),
            (self.stamp_ns, other.stamp_ns),
        )
        return any(ours is not None and other is not None and ours < other for ours, other in pairs)


@accepts(keyword='int | str')
def parse_bound(name: str, value: object) -> Bound:
    """Parse the start or end of a selection."""
    return Bound.parse(parse_text(name, value))


@dataclass(frozen=True)
class SelectionOptions:
    """Selected part of a recording.

    Attributes:
        streams: Names of streams; image selects all cameras; empty selects all.
        topics: Names of topics, wildcards allowed; empty selects all.
        exclude_topics: Names of topics to leave out of those, wildcards allowed.
        start, end: First and last frame, offset or stamp, both included; None is unlimited.

    Raises:
        UsageError: The end is before the start.
    """

    group: ClassVar = 'Selection'

    streams: tuple[str, ...] = option(
        (),
        'Only these: scan, image, image_0..4, oxts, pose, path, labels, predictions, calibration',
        parse_texts,
        unset='all',
    )
    topics: tuple[str, ...] = option(
        (),
        "Only these topics; * matches, such as '/kitti/oxts/*'",
        parse_texts,
        unset='all',
        common=True,
    )
    exclude_topics: tuple[str, ...] = option(
        (),
        "All but these topics; * matches, such as '*image*'",
        parse_texts,
        unset='none',
        common=True,
    )
    start: Bound | None = option(
        None,
        "First frame (12), seconds from the start (3.5s) or time ('2011-09-26 13:02:26')",
        parse_bound,
        unset='the first',
        any_type=True,
        metavar='WHEN',
        common=True,
    )
    end: Bound | None = option(
        None,
        'Last one, included; written as start',
        parse_bound,
        unset='the last',
        any_type=True,
        metavar='WHEN',
        common=True,
    )

    def __post_init__(self) -> None:
        if self.start is not None and self.end is not None and self.end.is_before(self.start):
            raise self.reversed_error()

    @property
    def is_whole(self) -> bool:
        """Whether neither start nor end limit it."""
        return self.start is None and self.end is None

    def __str__(self) -> str:
        """Return readable text: the selection from frame 3 to 3.5s."""
        first = f' from {self.start}' if self.start is not None else ''
        last = f' to {self.end}' if self.end is not None else ''
        return f'the selection{first}{last}'

    def reversed_error(self) -> UsageError:
        """Return the error for an end before the start."""
        return UsageError(f'the end ({self.end}) is before the start ({self.start})')


# Options of a validation: how much of the files is read.


@dataclass(frozen=True)
class ValidateOptions:
    """Options of a validation.

    Attributes:
        quick: Whether only names and sizes of files are checked; of bags only their index.
        decode: Whether the pixels of images are decoded, too.

    Raises:
        UsageError: Both are requested.
    """

    group: ClassVar = 'Checks'

    quick: bool = option(
        False,
        'Check names and sizes only; of bags the index',
        parse_flag,
        flags=('--quick',),
        common=True,
    )
    decode: bool = option(
        False,
        'Decode the pixels of images, too',
        parse_flag,
        flags=('--decode',),
        common=True,
    )

    def __post_init__(self) -> None:
        if self.quick and self.decode:
            raise UsageError('--quick reads no images: leave --decode out')


# Options of the 100 Hz packets of an unsynchronised drive.


class ImuStamps(str, Enum):
    """Stamps of the packets: those of the files, or a line fitted to them."""

    ORIGINAL = 'original'
    REGULAR = 'regular'


@dataclass(frozen=True)
class ImuOptions:
    """Options of the 100 Hz packets of an unsynchronised drive.

    Attributes:
        path: The extract of the drive; None takes the synchronised packets.
        stamps: Stamps of its packets.

    Raises:
        UsageError: Regular stamps are requested without an extract.
    """

    group: ClassVar = 'IMU'

    path: Path | None = option(
        None,
        '100 Hz Imu, fix and velocity of the unsynchronised drive, DRIVE_extract',
        parse_path,
        name='imu_from',
        unset="the drive's own, 10 Hz",
        live=True,
        metavar='DIR',
    )
    stamps: ImuStamps = choice(
        ImuStamps.ORIGINAL,
        'With --imu-from: stamps of the files, or evenly spaced ones fitted to them',
        ImuStamps,
        name='imu_stamps',
        live=True,
    )

    def __post_init__(self) -> None:
        if self.path is None and self.stamps is not ImuStamps.ORIGINAL:
            raise UsageError('--imu-stamps is for --imu-from; give both')


# Options of predictions and their comparison with labels.


@dataclass(frozen=True)
class PredictionOptions:
    """Options of predictions and their comparison with labels.

    Attributes:
        path: Label files of a detector (a folder) or of a tracker (a file); None is none.
        iou: The IoU above which a prediction is a true positive; None is that of KITTI.

    Raises:
        UsageError: An IoU is given without predictions.
    """

    group: ClassVar = 'Predictions'

    path: Path | None = option(
        None,
        'Result files of a detector (a folder) or of a tracker (a file)',
        parse_path,
        name='predictions',
        unset='none',
        live=True,
        common=True,
    )
    iou: LeastOverlaps | None = option(
        None,
        'True positives have a greater IoU with a label: 0.5 for all classes, Car=0.5 for one',
        parse_least_overlaps,
        unset='0.7 for vehicles, 0.5 for others',
        live=True,
        any_type=True,
        metavar='IOU...',
    )

    def __post_init__(self) -> None:
        if self.path is None and self.iou is not None:
            raise UsageError('--iou is for --predictions; give both')

    @property
    def overlaps(self) -> LeastOverlaps:
        """The IoU above which a prediction is a true positive, by class."""
        return KITTI_OVERLAPS if self.iou is None else self.iou
