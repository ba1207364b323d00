# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of what is written or shown: bags, data sets of bags, playing, pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, ClassVar

from ..model.bag_formats import CONTAINERS
from ..model.errors import UsageError, not_one_of
from ..model.streams import GeoOrigin, Layout, PngForm
from .declare import (
    accepts,
    check_bounds,
    choice,
    fsync_option,
    option,
    parse_flag,
    parse_four_numbers,
    parse_integer,
    parse_number,
    parse_path,
    parse_rounds,
    parse_seconds_ns,
    parse_split_size,
    parse_text,
    parse_texts,
)
from .read import SelectionOptions

if TYPE_CHECKING:
    from pathlib import Path


# Options of a written bag: storage, compression, splitting.

_COMPRESSIONS = tuple(
    dict.fromkeys(name for container in CONTAINERS.values() for name in container.compressions)
)


@dataclass(frozen=True)
class BagOptions:
    """Options of a written bag.

    Attributes:
        storage: The container, one of model.bag_formats.
        compression: One of the container's.
        compression_level: One of the compression's; None is the compressor's default.
        split_size: Bytes of messages, before compression, after which a new file is started.
        split_duration_ns: Nanoseconds of recording after which a new file is started.
        overwrite: Whether an existing bag at the output may be replaced.
        fsync: Whether the finished bag outlasts a power cut.
        keep_partial: Whether what was written of an interrupted bag is kept beside the output.

    Raises:
        UsageError: A value is unknown or does not match the others.
    """

    group: ClassVar = 'Bag'

    storage: str = 'mcap'
    compression: str = option(
        'none',
        'mcap: lz4, zstd; sqlite3: zstd; ros1: lz4, bz2',
        parse_text,
        choices=_COMPRESSIONS,
        common=True,
    )
    compression_level: int | None = option(
        None, 'lz4 0 to 16, zstd 1 to 22', parse_integer, unset="the compressor's default"
    )
    split_size: int | None = option(
        None,
        'Start a new file after so many bytes, such as 2GB (at least 1MB)',
        parse_split_size,
        unset='never',
        metavar='SIZE',
    )
    split_duration_ns: int | None = option(
        None,
        'Start a new file after so many seconds, such as 60s',
        parse_seconds_ns,
        name='split_duration',
        unset='never',
    )
    overwrite: bool = option(False, 'Replace an existing bag', parse_flag, common=True)
    fsync: bool = fsync_option()
    keep_partial: bool = option(
        False, 'Keep what was written before an interruption, as OUT.partial', parse_flag
    )

    def __post_init__(self) -> None:
        if self.storage not in CONTAINERS:
            raise not_one_of('storage', self.storage, list(CONTAINERS))
        compressions = CONTAINERS[self.storage].compressions
        if self.compression not in compressions:
            raise not_one_of(
                f'compression of storage {self.storage}', self.compression, list(compressions)
            )
        self._check_level(compressions[self.compression])
        for name, value in (('size', self.split_size), ('duration', self.split_duration_ns)):
            if value is not None and value <= 0:
                raise UsageError(f'a split {name} of {value} is not positive')

    def _check_level(self, levels: range | None) -> None:
        level = self.compression_level
        if level is None:
            return
        if levels is None:
            raise UsageError(
                f'compression {self.compression} of storage {self.storage} has no levels'
            )
        if level not in levels:
            raise UsageError(
                f'compression level {level} is out of range;'
                f' {self.compression} supports {levels[0]} to {levels[-1]}'
            )

    @property
    def split(self) -> bool:
        """Whether the bag may be split into several files."""
        return self.split_size is not None or self.split_duration_ns is not None


# Options of the conversion from bags to a KITTI data set.


@accepts(keyword='str | Sequence[float]')
def parse_origin(name: str, value: object) -> str:
    """Parse LAT,LON,ALT, degrees and metres."""
    text = ','.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
    try:
        GeoOrigin.parse(text)
    except ValueError as error:
        raise UsageError(f'{name} is {error}') from None
    return text


@dataclass(frozen=True)
class ImportOptions:
    """Options of the conversion from bags to KITTI.

    Attributes:
        layout: One of KITTI's; None keeps that of a bag written by to-bag.
        name: Drive, split or sequence, None takes the plan's.
        calib: A KITTI calibration file or folder instead of the bag's own calibration.
        origin: LAT,LON,ALT of the origin of poses that become oxts; None takes the plan's.
        train_fraction: Fraction of an object set's frames in train, 0 to 1.
        all_cameras: Whether each camera of a bag of others gets a data set of its own.
        png: The form of PNG files made of pixels, of equal pixels: KITTI's or fast; None is KITTI's
            where the bag has KITTI's images.
        snap: Whether scans that are on KITTI's grid of 1 mm but for rounding are rounded to it.
        append: Whether to continue the numbering of an existing object set.
        overwrite: Whether an existing data set may be replaced.
        fsync: Whether the finished data set outlasts a power cut.
        selection: First and last frame to convert: KITTI's file numbers in a bag written by
            to-bag, else the numbers that a conversion of the whole bag gives.

    Raises:
        UsageError: A value is out of range, or does not go with the others.
    """

    group: ClassVar = 'Data set'

    layout: Layout | None = choice(
        None,
        'Layout to write',
        Layout,
        unset='that of a bag written by to-bag',
        common=True,
    )
    name: str | None = option(
        None,
        '2011_09_26_drive_0001_sync, training or testing, sequence 00 or 0000',
        parse_text,
        unset="the plan's",
        metavar='NAME',
        common=True,
    )
    calib: Path | None = option(
        None,
        "KITTI calibration file or folder instead of the bag's calibration",
        parse_path,
        unset="the bag's",
        common=True,
    )
    origin: str | None = option(
        None,
        "Raw, tracking: LAT,LON,ALT of the poses' origin where the bag has no NavSatFix",
        parse_origin,
        unset="the plan's, or 0,0,0",
        metavar='LAT,LON,ALT',
    )
    train_fraction: float = option(
        1.0,
        'Object: fraction of the frames in train, the rest in val',
        parse_number,
        flags=('--split',),
        keyword='split',
        common=True,
    )
    all_cameras: bool = option(
        False, 'Write one data set for each camera, with scans in common', parse_flag
    )
    png: PngForm | None = choice(
        None,
        "PNG files made of pixels: in the form of KITTI's own files, or encoded fast",
        PngForm,
        unset="that of the layout for KITTI's images, else fast",
    )
    snap: bool = option(
        True, "Round scans of others to KITTI's grid of 1 mm if they are within 0.02 mm", parse_flag
    )
    append: bool = option(
        False,
        'Object: continue the numbering of the data set in OUT',
        parse_flag,
        common=True,
    )

    overwrite: bool = option(False, 'Replace the data set in OUT', parse_flag, common=True)
    fsync: bool = fsync_option()
    selection: SelectionOptions = field(default_factory=SelectionOptions)

    def __post_init__(self) -> None:
        if self.append and self.overwrite:
            raise UsageError('--append and --overwrite exclude each other')
        if not 0 <= self.train_fraction <= 1:
            raise UsageError(f'a split of {self.train_fraction:g}; expected 0 to 1, such as 0.8')

    def keeps(self, layout: Layout) -> bool:
        """Whether a recording of this layout keeps its original folders and names."""
        unchanged = self.layout in (None, layout) and self.name is None and self.calib is None
        return unchanged and not self.append and not self.all_cameras


# Options of playing a recording or a bag.


class AtEnd(str, Enum):
    """Action of a player at the end of the recording."""

    EXIT = 'exit'
    PAUSE = 'pause'


class Stamps(str, Enum):
    """Stamps of a player's messages: those of the recording, or the current time."""

    ORIGINAL = 'original'
    NOW = 'now'


RATES = (0.01, 100.0)
MOST_SUBSCRIBERS = 1000
_MOST_ROUNDS = 2**31 - 1


@dataclass(frozen=True)
class PlaybackOptions:
    """Options of playing.

    Attributes:
        rate: Seconds of recording per second, 0.01 to 100.
        loop: Number of rounds; 0 is endless.
        start_paused: Whether it waits for a resume.
        delay_ns: Nanoseconds before the first message, after the wait for subscribers.
        clock_hz: How often the recording's time is published, 0 to 1000; 0 never.
        step: Frames that one play_next plays; 0 is a single sample.
        lossless: Whether it goes as fast as subscribers keep up, instead of in real time.
        wait_for: Subscribers to wait for before it begins; None is 1 with lossless, else 0.
        at_end: What happens at the end of the recording.

    Raises:
        UsageError: A value is out of range.
    """

    group: ClassVar = 'Playback'

    rate: float = option(
        1.0,
        'Seconds of recording per second, 0.01 to 100',
        parse_number,
        bounds=RATES,
        flags=('-r',),
        live=True,
        common=True,
    )
    loop: int = option(
        1, 'Number of rounds; 0 or true is endless', parse_rounds, live=True, any_type=True
    )
    start_paused: bool = option(False, 'Wait for a resume', parse_flag, flags=('-p',))
    delay_ns: int = option(
        0,
        'Seconds before the first message, after the wait for subscribers',
        parse_seconds_ns,
        name='delay',
        bounds=(0.0, 3600.0),
        flags=('-d',),
    )
    clock_hz: float = option(
        100.0,
        '/clock messages per second; 0 is none',
        parse_number,
        name='clock',
        bounds=(0.0, 1000.0),
    )
    step: int = option(
        1,
        'Frames that one play_next plays; 0 is a single sample',
        parse_integer,
        bounds=(0, 10_000),
        live=True,
    )
    lossless: bool = option(
        False, 'As fast as subscribers keep up; no message is dropped', parse_flag
    )
    wait_for: int | None = option(
        None,
        'Wait until so many nodes subscribe to any of the topics, and 1 s more without a new'
        ' subscription',
        parse_integer,
        unset='1 with lossless, else 0',
        any_type=True,
    )
    at_end: AtEnd = choice(AtEnd.EXIT, 'Exit, or pause and wait for a seek', AtEnd)

    def __post_init__(self) -> None:
        check_bounds(self, 'rate', 'clock', 'step')
        if not 0 <= self.loop <= _MOST_ROUNDS:
            raise UsageError(
                f'loop {self.loop} is not within 0 to {_MOST_ROUNDS}; it is a number of rounds, 0'
                f' is endless'
            )
        if self.delay_ns < 0:
            raise UsageError(f'delay {self.delay_ns / 1e9:g} is negative, seconds')
        if not 0 <= self.subscribers <= MOST_SUBSCRIBERS:
            raise UsageError(f'wait_for {self.wait_for} is not within 0 to {MOST_SUBSCRIBERS}')

    @property
    def subscribers(self) -> int:
        """Number of subscribers to wait for before it begins."""
        return int(self.lossless) if self.wait_for is None else self.wait_for


# Options of pictures.


class ColorBy(str, Enum):
    """Quantity that the colour of a scan's point shows."""

    DEPTH = 'depth'
    HEIGHT = 'height'
    INTENSITY = 'intensity'
    SEMANTIC = 'semantic'


class ColorMap(str, Enum):
    """Colours of a scale."""

    VIRIDIS = 'viridis'
    PLASMA = 'plasma'
    INFERNO = 'inferno'
    MAGMA = 'magma'
    CIVIDIS = 'cividis'
    TURBO = 'turbo'
    JET = 'jet'


MOST_BIRD_PIXELS = 8192
MOST_POINT_SIZE = 15


@dataclass(frozen=True)
class BirdOptions:
    """Extent and resolution of a bird's-eye view; forward is up, left is left.

    Attributes:
        x_range: From and to, metres forward of the scanner.
        y_range: From and to, metres to the left of the scanner.
        pixels_per_metre: Resolution.

    Raises:
        UsageError: A range is empty, or the picture would be of no pixels or of too many.
    """

    group: ClassVar = "Bird's-eye view"

    # --extent sets both ranges; table.py takes it apart.
    x_range: tuple[float, float] = option(
        (-10.0, 60.0),
        'Metres forward from, to; metres to the left from, to',
        parse_four_numbers,
        name='range',
        unset='-10,60,-25,25',
        flags=('--extent',),
        metavar='X,X,Y,Y',
    )
    y_range: tuple[float, float] = (-25.0, 25.0)
    pixels_per_metre: float = option(14.0, 'Pixels per metre', parse_number, name='resolution')

    def __post_init__(self) -> None:
        for name, (low, high) in (('x', self.x_range), ('y', self.y_range)):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise UsageError(
                    f"the bird's-eye view is empty in {name}: {low:g} to {high:g} metres"
                )
        if not (math.isfinite(self.pixels_per_metre) and self.pixels_per_metre > 0):
            raise UsageError(
                f'a resolution of {self.pixels_per_metre:g} is not positive, in pixels per metre'
            )
        width, height = sides = self._sides()
        if not all(side < math.inf and 1 <= round(side) <= MOST_BIRD_PIXELS for side in sides):
            raise UsageError(
                f"a bird's-eye view of {width:.6g} x {height:.6g} pixels; expected 1 to"
                f' {MOST_BIRD_PIXELS} a side (change its range or resolution)'
            )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture."""
        width, height = self._sides()
        return round(width), round(height)

    def _sides(self) -> tuple[float, float]:
        """Return (width, height), not rounded; infinity where no float is so large."""
        width, height = (
            (high - low) * self.pixels_per_metre for low, high in (self.y_range, self.x_range)
        )
        return width, height


@dataclass(frozen=True)
class PictureOptions:
    """Options of pictures.

    Attributes:
        camera: KITTI camera index; None is camera 2, or the first of the recording.
        color_by: Quantity that the colour of a point shows; None is depth on an image, else
            height.
        color_map: Its colours; classes of points have their own.
        point_size: Diameter of a point on an image or in perspective, pixels.
        bird: The bird's-eye view.
        classes: Classes of the objects to draw; empty is all.
        named: Whether boxes have tags with class, track and score.

    Raises:
        UsageError: A value is out of range.
    """

    group: ClassVar = 'Pictures'

    camera: int | None = option(
        None,
        "KITTI's camera number",
        parse_integer,
        unset='2, or the first',
        common=True,
    )
    color_by: ColorBy | None = choice(
        None,
        "What the colour of a point shows; semantic: SemanticKITTI's labels",
        ColorBy,
        unset='depth on images, else height',
        common=True,
    )
    color_map: ColorMap = choice(ColorMap.VIRIDIS, 'Colours of its scale', ColorMap)
    point_size: int = option(2, 'Diameter of a point, pixels', parse_integer)
    bird: BirdOptions = field(default_factory=BirdOptions)
    classes: tuple[str, ...] = option(
        (), 'Only objects of these classes', parse_texts, unset='all', common=True
    )
    named: bool = True

    def __post_init__(self) -> None:
        if self.camera is not None and self.camera < 0:
            raise UsageError(f'camera {self.camera} is negative; KITTI counts them from 0')
        if not 1 <= self.point_size <= MOST_POINT_SIZE:
            raise UsageError(
                f'a point size of {self.point_size} is not within 1 to {MOST_POINT_SIZE} pixels'
            )
