# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options: frozen objects with their defaults and their validation, whoever fills them in."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from .errors import UsageError
from .stamps import NS_PER_S, format_stamp, parse_seconds, parse_stamp

if TYPE_CHECKING:
    from pathlib import Path

    from .samples import Layout

# Which compressions a storage knows, and the levels of each (None: it has no level to choose).
COMPRESSIONS: dict[str, dict[str, range | None]] = {
    'mcap': {'none': None, 'lz4': range(17), 'zstd': range(1, 23)},
    'sqlite3': {'none': None, 'zstd': range(1, 23)},
    'ros1': {'none': None, 'lz4': None, 'bz2': None},
}


@dataclass(frozen=True)
class BagOptions:
    """How a bag is written.

    Attributes:
        storage: mcap, sqlite3 or ros1.
        compression: none, lz4 (mcap, ros1), zstd (mcap, sqlite3) or bz2 (ros1).
        compression_level: lz4 0..16, zstd 1..22; None is the compressor's own default.
        split_size: Bytes of messages, before compression, after which a new file begins.
        split_duration_ns: Nanoseconds of recording after which a new file begins.
        overwrite: Whether an existing bag at the output may be replaced.

    Raises:
        UsageError: A value is unknown or does not go with the others.
    """

    storage: str = 'mcap'
    compression: str = 'none'
    compression_level: int | None = None
    split_size: int | None = None
    split_duration_ns: int | None = None
    overwrite: bool = False

    def __post_init__(self) -> None:
        if self.storage not in COMPRESSIONS:
            raise UsageError(
                f'there is no storage {self.storage!r}; choose one of {", ".join(COMPRESSIONS)}'
            )
        known = COMPRESSIONS[self.storage]
        if self.compression not in known:
            raise UsageError(
                f'storage {self.storage} takes compression {" or ".join(known)},'
                f' not {self.compression!r}'
            )
        self._check_level(known[self.compression])
        for name, value in (('size', self.split_size), ('duration', self.split_duration_ns)):
            if value is not None and value <= 0:
                raise UsageError(f'a split {name} of {value} is not positive')

    def _check_level(self, levels: range | None) -> None:
        level = self.compression_level
        if level is None:
            return
        if levels is None:
            raise UsageError(
                f'compression {self.compression} of storage {self.storage} has no level to choose'
            )
        if level not in levels:
            raise UsageError(
                f'compression level {level} is out of range;'
                f' {self.compression} takes {levels[0]} to {levels[-1]}'
            )

    @property
    def split(self) -> bool:
        """Whether the bag may become several files."""
        return self.split_size is not None or self.split_duration_ns is not None


DEFAULT_EPOCH_NS = 1_316_995_200_000_000_000
"""2011-09-26 00:00:00 UTC, the first day of KITTI's recordings."""


NOMINAL_PERIOD_NS = 103_600_000
"""One turn of KITTI's scanner, for recordings without time stamps: 0.1036 s.

Sources: times.txt of odometry 00 begins 0, 0.103736, 0.207338, 0.311075 s; in tracking 0000 the yaw
changes by 0.10360 s times the yaw rate. Raw stamps of 0001 and 0005 are 0.1031 and 0.1033 s apart.
"""
_PERIODS_NS = (1_000_000, 60 * NS_PER_S)


class ScanStamp(str, Enum):
    """The moment of a scan that is its stamp: the start of the turn, or facing forward."""

    START = 'start'
    FORWARD = 'forward'


@dataclass(frozen=True)
class ReadOptions:
    """How a KITTI folder is read.

    Attributes:
        layout: raw, object, odometry or tracking; None to find out.
        sequence: Which drive, split or sequence, where the folder holds several.
        epoch_ns: When recordings without absolute time begin, nanoseconds since 1970.
        semantic: Whether scans are read with SemanticKITTI's labels.
        period_ns: Distance of the frames of recordings without time stamps, and length of a turn
            of the scanner whose start and end are not known; 1 ms to 60 s.
        scan_stamp: The moment of a scan that is its stamp. Scans that KITTI has compensated for
            motion (odometry) keep theirs.

    Raises:
        UsageError: The epoch is not after 1970, or the period is out of range.
    """

    layout: Layout | None = None
    sequence: str | None = None
    epoch_ns: int = DEFAULT_EPOCH_NS
    semantic: bool = False
    period_ns: int = NOMINAL_PERIOD_NS
    scan_stamp: ScanStamp = ScanStamp.FORWARD

    def __post_init__(self) -> None:
        if self.epoch_ns <= 0:
            raise UsageError(f'the epoch {self.epoch_ns} is not after 1970; players refuse stamp 0')
        if not is_period(self.period_ns):
            least, most = (f'{period / NS_PER_S:g}' for period in _PERIODS_NS)
            raise UsageError(
                f'the period {self.period_ns / NS_PER_S:g} is not within {least} to {most} seconds'
            )


def is_period(period_ns: int) -> bool:
    """Whether a distance of frames is within the allowed range."""
    return _PERIODS_NS[0] <= period_ns <= _PERIODS_NS[1]


class Preset(str, Enum):
    """Sets of topic and frame names."""

    DEFAULT = 'default'
    KITTI2BAG = 'kitti2bag'


class MapFrame(str, Enum):
    """What the map frame is: east-north-up from the first base_link, or KITTI's own."""

    ENU = 'enu'
    DEVKIT = 'devkit'


class Images(str, Enum):
    """How images are written: the PNG's own bytes, decoded pixels, or both."""

    COMPRESSED = 'compressed'
    RAW = 'raw'
    BOTH = 'both'


BASE_T_IMU = (-0.05, 0.32, 0.93)
KITTI2BAG_BASE_T_IMU = (-1.405, 0.32, 0.93)


class MarkerColors(str, Enum):
    """What the colour of an object's markers tells."""

    CLASS = 'class'
    TRACK = 'track'


@dataclass(frozen=True)
class MarkerOptions:
    """How labels are drawn.

    Attributes:
        colors: One colour a class, or one a track.
        alpha: Opacity of the boxes, 0..1.
        line_width: Of edges and trails, metres.
        arrow_length: How far a heading reaches out of its box, metres.
        text_height: Metres.
        lifetime_ns: After which a marker goes by itself, nanoseconds; 0 never.
        trails: Whether tracks draw where they were.
        ego: Whether the recording car is drawn.

    Raises:
        UsageError: A size is not positive, or alpha is out of range.
    """

    colors: MarkerColors = MarkerColors.CLASS
    alpha: float = 0.35
    line_width: float = 0.05
    arrow_length: float = 1.0
    text_height: float = 0.6
    lifetime_ns: int = 300_000_000
    trails: bool = False
    ego: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.alpha <= 1:
            raise UsageError(f'marker alpha {self.alpha:g} is not in 0..1')
        for name in ('line_width', 'arrow_length', 'text_height'):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise UsageError(
                    f'marker {name} {getattr(self, name):g} is not positive, in metres'
                )
        if self.lifetime_ns < 0:
            raise UsageError('the lifetime of markers is negative')


@dataclass(frozen=True)
class MessageOptions:
    """Which messages are made, and how.

    Attributes:
        images: compressed, raw or both.
        preset: Names of topics and frames.
        map: Axes and origin of the map frame; see messages/map_frame.py.
        publish_tf: Whether map -> base_link is on /tf; off where a SLAM stack owns it.
        ring_and_time: Whether points also have ring and time.
        base_to_imu: x, y, z of imu_link in base_link, metres; None as the preset has it.
        semantic: Whether points also have SemanticKITTI's label, instance and rgb.
        markers: How labels are drawn.
        annotated: Whether there are images with the labels drawn on them.

    Raises:
        UsageError: base_to_imu is not three finite numbers.
    """

    images: Images = Images.COMPRESSED
    preset: Preset = Preset.DEFAULT
    map: MapFrame = MapFrame.ENU
    publish_tf: bool = True
    ring_and_time: bool = False
    base_to_imu: tuple[float, ...] | None = None
    semantic: bool = False
    markers: MarkerOptions = field(default_factory=MarkerOptions)
    annotated: bool = False

    def __post_init__(self) -> None:
        place = self.base_to_imu or BASE_T_IMU
        if len(place) != 3 or not all(math.isfinite(value) for value in place):
            raise UsageError(f'base_to_imu {place} is not three finite numbers, metres')


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
        """A bound from its text: `12` (frame), `3.5s` (from the start), or a KITTI time stamp.

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
                f'{text!r} is no start or end; write a frame (12), seconds from the start (3.5s)'
                f" or a time stamp ('2011-09-26 13:02:25.9')"
            ) from None

    def __str__(self) -> str:
        """For people: frame 12, 3.5s, or a time stamp."""
        if self.frame is not None:
            return f'frame {self.frame}'
        if self.offset_ns is not None:
            return f'{self.offset_ns / NS_PER_S:.9f}'.rstrip('0').rstrip('.') + 's'
        return format_stamp(self.stamp_ns or 0)

    def is_before(self, other: Bound) -> bool:
        """Whether it is before another one of the same kind; False for another kind."""
        pairs = (
            (self.frame, other.frame),
            (self.offset_ns, other.offset_ns),
            (self.stamp_ns, other.stamp_ns),
        )
        return any(ours is not None and other is not None and ours < other for ours, other in pairs)


@dataclass(frozen=True)
class SelectionOptions:
    """Which part of a recording is taken.

    Attributes:
        streams: Names of streams; image stands for all cameras; empty takes all.
        topics: Names of topics, wildcards allowed; empty takes all.
        start, end: First and last moment, both included; None takes all.

    Raises:
        UsageError: The end is before the start.
    """

    streams: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    start: Bound | None = None
    end: Bound | None = None

    def __post_init__(self) -> None:
        if self.start is not None and self.end is not None and self.end.is_before(self.start):
            raise self.reversed_error()

    def reversed_error(self) -> UsageError:
        """The error for an end before the start."""
        return UsageError(f'the end ({self.end}) is before the start ({self.start})')


class AtEnd(str, Enum):
    """What a player does when everything is played."""

    EXIT = 'exit'
    PAUSE = 'pause'


class Stamps(str, Enum):
    """Which stamps a player's messages carry: the recording's, or those of the moment."""

    ORIGINAL = 'original'
    NOW = 'now'


RATES = (0.01, 100.0)
MOST_STEP = 10_000
MOST_SUBSCRIBERS = 1000


@dataclass(frozen=True)
class PlaybackOptions:
    """How something is played.

    Attributes:
        rate: Seconds of recording a second, 0.01 to 100.
        loop: How many times it is played; 0 without end.
        start_paused: Whether it waits for a resume.
        delay_ns: Nanoseconds before the first message, from when the subscribers are there.
        clock_hz: How often the recording's time is told; 0 never.
        step: Frames that one play_next plays; 0 is a single sample.
        lossless: Whether it goes as fast as subscribers take it, not by time.
        wait_for: Subscribers to wait for before it begins; None is 1 with lossless, else 0.
        at_end: What happens when everything is played.

    Raises:
        UsageError: A value is out of range.
    """

    rate: float = 1.0
    loop: int = 1
    start_paused: bool = False
    delay_ns: int = 0
    clock_hz: float = 100.0
    step: int = 1
    lossless: bool = False
    wait_for: int | None = None
    at_end: AtEnd = AtEnd.EXIT

    def __post_init__(self) -> None:
        if not RATES[0] <= self.rate <= RATES[1]:
            raise UsageError(f'rate {self.rate:g} is not within {RATES[0]:g} to {RATES[1]:g}')
        if self.loop < 0:
            raise UsageError(f'loop {self.loop} is negative; it is a number of rounds, 0 no end')
        if self.delay_ns < 0:
            raise UsageError(f'delay {self.delay_ns / 1e9:g} is negative, seconds')
        if not 0 <= self.clock_hz <= 1000:
            raise UsageError(f'clock {self.clock_hz:g} is not within 0 to 1000, times a second')
        if not 0 <= self.step <= MOST_STEP:
            raise UsageError(f'step {self.step} is not within 0 to {MOST_STEP} frames')
        if not 0 <= self.subscribers <= MOST_SUBSCRIBERS:
            raise UsageError(f'wait_for {self.wait_for} is not within 0 to {MOST_SUBSCRIBERS}')

    @property
    def subscribers(self) -> int:
        """How many subscribers it waits for before it begins."""
        return int(self.lossless) if self.wait_for is None else self.wait_for


@dataclass(frozen=True)
class ImportOptions:
    """How bags become KITTI.

    Attributes:
        layout: raw, object, odometry or tracking; None for a bag of our own, which has one.
        name: Drive, split or sequence, None for the plan's.
        calib: A KITTI calibration file or folder instead of the bag's own calibration.
        train_fraction: The part of an object set's frames that trains, 0 to 1.
        append: Whether an object set is continued instead of begun.

    Raises:
        UsageError: A value is out of range, or does not go with the others.
    """

    layout: Layout | None = None
    name: str | None = None
    calib: Path | None = None
    train_fraction: float = 1.0
    append: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.train_fraction <= 1:
            raise UsageError(f'a split of {self.train_fraction:g}; expected 0 to 1, such as 0.8')

    def keeps(self, layout: Layout) -> bool:
        """Whether a recording of a layout is to be laid out as it was."""
        as_it_was = self.layout in (None, layout) and self.name is None and self.calib is None
        return as_it_was and not self.append
