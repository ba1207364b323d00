# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's streams and layouts, their stamps and columns, and the geographic origin of poses."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from enum import Enum
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from .errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np


# The streams of a recording, and the meaning of its stamps.
#
# A *stream* is one sensor's series. A *sample* is what one file (or one line) of it holds. A
# sample's *number* is its KITTI file number: streams are paired by number, never by position in a
# listing. OXTS_EXTRACT, the packets of the unsynchronised drive beside a synchronised one, has
# numbers of its own, and is paired by time; so has SICK, the line scanner of KITTI-360.

CAMERA_COUNT = 5
CAMERA_NAMES = {0: 'gray_left', 1: 'gray_right', 2: 'color_left', 3: 'color_right'}
"""KITTI's cameras by index, as in topics and frames."""

GREY_CAMERAS = frozenset({0, 1})
"""Those whose files have one channel."""


class Stream(str, Enum):
    """The series of a recording; the order is the order of publishing at equal stamps."""

    RECORDING = 'recording'
    CALIBRATION = 'calibration'
    PATH = 'path'
    POSE = 'pose'
    OXTS = 'oxts'
    OXTS_EXTRACT = 'oxts_extract'
    SCAN = 'scan'
    SICK = 'sick'
    IMAGE_0 = 'image_0'
    IMAGE_1 = 'image_1'
    IMAGE_2 = 'image_2'
    IMAGE_3 = 'image_3'
    IMAGE_4 = 'image_4'
    SEMANTIC_0 = 'semantic_0'
    SEMANTIC_1 = 'semantic_1'
    SEMANTIC_RGB_0 = 'semantic_rgb_0'
    SEMANTIC_RGB_1 = 'semantic_rgb_1'
    INSTANCE_0 = 'instance_0'
    INSTANCE_1 = 'instance_1'
    CONFIDENCE_0 = 'confidence_0'
    CONFIDENCE_1 = 'confidence_1'
    LABELS = 'labels'
    PREDICTIONS = 'predictions'

    @property
    def camera(self) -> int | None:
        """The KITTI camera index of an image stream, None for the others."""
        return int(self.value[-1]) if self.value.startswith('image_') else None

    @property
    def label_image(self) -> tuple[str, int] | None:
        """The kind of a stream of label images and its camera, None for the others."""
        kind, _, camera = self.value.rpartition('_')
        return (kind, int(camera)) if kind in LABEL_IMAGES else None

    @property
    def viewer(self) -> int:
        """The camera of an image or a label image, 0 for the others."""
        return self.label_image[1] if self.label_image else self.camera or 0


LABEL_IMAGES = {'semantic': (1, 8), 'semantic_rgb': (3, 8), 'instance': (1, 16), 'confidence': None}
"""KITTI-360's folders of images of the labels of pixels: channels and bits, if it tells them."""
LABEL_STREAMS: tuple[Stream, ...] = tuple(stream for stream in Stream if stream.label_image)

IMAGE_STREAMS: tuple[Stream, ...] = tuple(Stream(f'image_{i}') for i in range(CAMERA_COUNT))
FRAME_STREAMS = (
    Stream.SCAN,
    Stream.IMAGE_2,
    Stream.IMAGE_0,
    Stream.IMAGE_3,
    Stream.IMAGE_1,
    Stream.IMAGE_4,
    Stream.LABELS,
    Stream.OXTS,
    Stream.POSE,
)
"""The streams whose samples make frames.

If a file number is the same time in all streams, every number of any of them is a frame.
Otherwise (a raw extract) the samples of the first stream that has any are the frames.
"""


UNNUMBERED = frozenset({Stream.OXTS_EXTRACT, Stream.SICK})
"""Streams whose file numbers are no frames: they are selected by time alone."""

STREAM_ALIASES = {
    'velodyne': Stream.SCAN,
    'velodyne_points': Stream.SCAN,
    'lidar': Stream.SCAN,
    'points': Stream.SCAN,
    'sick_points': Stream.SICK,
    'imu': Stream.OXTS,
    'gps': Stream.OXTS,
    'calib': Stream.CALIBRATION,
    'tracklets': Stream.LABELS,
    'boxes': Stream.LABELS,
    'results': Stream.PREDICTIONS,
}
"""Streams by other names that users may try."""


class Clock(str, Enum):
    """The meaning of a recording's stamps.

    UTC has date and time; RELATIVE has seconds from the start, at an assumed date; NOMINAL has no
    time at all, only the order of frames at an assumed rate.
    """

    UTC = 'utc'
    RELATIVE = 'relative'
    NOMINAL = 'nominal'


# KITTI's layouts and their traits: what other rooms ask instead of which layout it is.


class PngForm(str, Enum):
    """The forms of PNG files of equal pixels: that of KITTI's camera images, and others."""

    KITTI = 'kitti'
    KITTI_360 = 'kitti360'
    FAST = 'fast'


@dataclass(frozen=True)
class LayoutTraits:
    """The differences between layouts, apart from their files (see kitti.opening).

    Attributes:
        title: Title of a recording of the layout in reports.
        noun: The same in one word.
        default_name: The name of a new recording; {date} (YYYY_MM_DD) and {kind} (sync or extract)
            are filled in.
        streams: The streams of the layout.
        cameras: The cameras of the main download; other folders of images may be absent.
        main_camera: The camera of 2D labels, or else of views.
        camera_names: Camera index to its name in topics and frames.
        raw_cameras: Cameras whose images are never rectified.
        png: The form of the files of images.
        right_cameras: The right cameras of stereo pairs of rectified images; see samples.LEFT_OF.
        clock: The meaning of the stamps, NOMINAL for a layout without time.
        stamps_per_stream: Whether each stream has its own stamps, so that any of them may have
            gaps; else a frame has one stamp.
        line_streams: Streams whose samples are lines of one text file for the whole recording.
        numbered_lines: Those whose lines begin with the number of their frame; else line n is frame
            n.
        calibration_per_frame: Whether each frame has its own calibration and image sizes, because
            the frames are of different days.
        frame_set: Whether a recording is a split (training or testing) of a set of independent
            frames, which can be continued, instead of one drive or sequence.
        dated: Whether a recording lies in the folder of its date, which holds the calibration of
            that date in three files.
        extracts: Whether there are recordings named *_extract: their images are not rectified, and
            their streams have file numbers of their own.
        tracklets: Whether labels are tracklets of the whole recording, not lines of text.
        world_boxes: Whether they are boxes in the world, of which a frame has those that its scan
            has points of.
        camera_poses: Whether files of poses are those of camera 0, not of the GPS/IMU.
        compensated_scans: Whether KITTI has compensated the scans for motion.
        scans_on_grid: Whether scans as measured have whole millimetres and hundredths of
            reflectance; else any coordinates, and 256ths.
        point_labels: Whether the points of scans can have semantic labels.
        from_others: Whether sets of the layout are made of bags of others.
    """

    title: str
    noun: str
    default_name: str
    streams: frozenset[Stream]
    cameras: tuple[int, ...] = (0, 1, 2, 3)
    main_camera: int = 2
    camera_names: Mapping[int, str] = field(default_factory=lambda: CAMERA_NAMES)
    raw_cameras: tuple[int, ...] = ()
    png: PngForm = PngForm.KITTI
    right_cameras: tuple[int, ...] = (1, 3)
    clock: Clock = Clock.NOMINAL
    stamps_per_stream: bool = False
    line_streams: frozenset[Stream] = frozenset()
    numbered_lines: frozenset[Stream] = frozenset()
    calibration_per_frame: bool = False
    frame_set: bool = False
    dated: bool = False
    extracts: bool = False
    tracklets: bool = False
    world_boxes: bool = False
    camera_poses: bool = False
    compensated_scans: bool = False
    scans_on_grid: bool = True
    point_labels: bool = False
    from_others: bool = True

    @property
    def common_labels(self) -> bool:
        """True if one file has the labels of all frames: a frame without any has no object."""
        return self.tracklets or Stream.LABELS in self.line_streams

    @property
    def tracked_labels(self) -> bool:
        """True if labels are known by track."""
        return self.common_labels or self.world_boxes

    def is_grey(self, camera: int) -> bool:
        """Return whether the images of a camera have no colour."""
        return self.camera_names.get(camera, '').startswith('gray')

    @property
    def packet_poses(self) -> bool:
        """True if poses are those of oxts packets, with a velocity, and no files of their own."""
        return Stream.POSE not in self.streams

    def is_extract(self, name: str) -> bool:
        """Return whether a recording of this name is unrectified, numbered by stream."""
        return self.extracts and name.endswith('_extract')


class Layout(str, Enum):
    """KITTI's layouts: the ways in which its files are arranged in folders."""

    RAW = 'raw'
    OBJECT = 'object'
    ODOMETRY = 'odometry'
    TRACKING = 'tracking'
    KITTI_360 = 'kitti360'

    @property
    def traits(self) -> LayoutTraits:
        """The differences from other layouts."""
        return _TRAITS[self]


_COMMON_STREAMS = frozenset({Stream.CALIBRATION, Stream.SCAN, *IMAGE_STREAMS[:4]})
_TRAITS = {
    Layout.RAW: LayoutTraits(
        title='KITTI raw drive',
        noun='drive',
        default_name='{date}_drive_0001_{kind}',
        streams=_COMMON_STREAMS | {Stream.OXTS, Stream.LABELS},
        clock=Clock.UTC,
        stamps_per_stream=True,
        dated=True,
        extracts=True,
        tracklets=True,
    ),
    Layout.OBJECT: LayoutTraits(
        title='KITTI object detection set',
        noun='split',
        default_name='training',
        streams=_COMMON_STREAMS | {Stream.IMAGE_4, Stream.LABELS},
        cameras=(2, 3),
        calibration_per_frame=True,
        frame_set=True,
    ),
    Layout.ODOMETRY: LayoutTraits(
        title='KITTI odometry sequence',
        noun='sequence',
        default_name='00',
        streams=_COMMON_STREAMS | {Stream.POSE},
        clock=Clock.RELATIVE,
        line_streams=frozenset({Stream.POSE}),
        camera_poses=True,
        compensated_scans=True,
        point_labels=True,
    ),
    Layout.TRACKING: LayoutTraits(
        title='KITTI tracking sequence',
        noun='sequence',
        default_name='0000',
        streams=_COMMON_STREAMS | {Stream.OXTS, Stream.LABELS},
        cameras=(2, 3),
        line_streams=frozenset({Stream.OXTS, Stream.POSE, Stream.LABELS}),
        numbered_lines=frozenset({Stream.LABELS}),
    ),
    Layout.KITTI_360: LayoutTraits(
        title='KITTI-360 drive',
        noun='drive',
        default_name='2013_05_28_drive_0000_sync',
        streams=_COMMON_STREAMS
        | {Stream.SICK, Stream.OXTS, Stream.POSE, Stream.LABELS, *LABEL_STREAMS},
        cameras=(0, 1),
        main_camera=0,
        camera_names={index: str(index) for index in range(4)},
        raw_cameras=(2, 3),
        png=PngForm.KITTI_360,
        right_cameras=(1,),
        clock=Clock.UTC,
        stamps_per_stream=True,
        line_streams=frozenset({Stream.POSE}),
        numbered_lines=frozenset({Stream.POSE}),
        world_boxes=True,
        scans_on_grid=False,
        from_others=False,
    ),
}


# Time stamps as integer nanoseconds since 1970-01-01 UTC, and their text forms.
#
# KITTI writes ``2011-09-26 13:02:25.951199337`` (raw, nine digits, read as UTC) and relative
# seconds such as ``1.037359e-01`` (odometry). Nothing here passes through float or datetime
# microseconds: float64 resolves 2011 only to 238 ns.

NS_PER_S = 1_000_000_000
LAST_NS = 2**31 * NS_PER_S - 1
"""The latest value of builtin_interfaces/Time, in 2038: its seconds are an int32."""

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_SECOND = re.compile(r'(\d{4})-(\d{2})-(\d{2})[ T](\d{2}):(\d{2}):(\d{2})', re.ASCII)
_DIGITS = 9


def parse_stamp(text: str) -> int:
    """Parse a KITTI time stamp into nanoseconds, ``YYYY-MM-DD HH:MM:SS[.fraction]``, taken as UTC.

    Raises:
        ValueError: The text is no such stamp, the date does not exist, or ROS 2 cannot represent it
            (before 1970 or after January 2038).
    """
    whole, point, fraction = text.rstrip(' \t\r\n\v\f').partition('.')
    if point and not (fraction.isascii() and fraction.isdecimal() and len(fraction) <= _DIGITS):
        raise ValueError(f'{text.strip()!r} is no time stamp')
    stamp_ns = _second_ns(whole) + int(fraction.ljust(_DIGITS, '0'))
    if not 0 <= stamp_ns <= LAST_NS:
        raise ValueError(f'{text.strip()!r} is not within 1970 to 2038, all that ROS 2 can hold')
    return stamp_ns


@lru_cache(maxsize=16)  # stamps are in order, ten a second in each stream
def _second_ns(text: str) -> int:
    """Return the nanoseconds of a whole second."""
    match = _SECOND.fullmatch(text)
    if match is None:
        raise ValueError(f'{text.strip()!r} is no time stamp')
    year, month, day, hour, minute, second = map(int, match.groups())
    utc = datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc)
    return (utc - _EPOCH) // timedelta(seconds=1) * NS_PER_S


def format_stamp(stamp_ns: int) -> str:
    """Format a stamp as KITTI does, with all nine digits; the inverse of parse_stamp."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    utc = _EPOCH + timedelta(seconds=seconds)
    return f'{utc:%Y-%m-%d %H:%M:%S}.{nanoseconds:09d}'


def parse_seconds(text: str) -> int:
    """Parse decimal seconds (odometry's times.txt) into nanoseconds, rounded to the nearest.

    Raises:
        ValueError: The text is no finite number.
    """
    from decimal import Decimal, InvalidOperation  # noqa: PLC0415 - 3 ms of any start

    try:
        seconds = Decimal(text.strip())
    except InvalidOperation:
        raise ValueError(f'{text.strip()!r} is no number of seconds') from None
    if not seconds.is_finite():
        raise ValueError(f'{text.strip()!r} is no finite number of seconds')
    if not 0 <= seconds <= LAST_NS // NS_PER_S:
        raise ValueError(f'{text.strip()!r} is no number of seconds that ROS 2 can hold')
    return int((seconds * NS_PER_S).to_integral_value())


def format_seconds(offset_ns: int) -> str:
    """Format an offset as in odometry's times.txt: seconds, six decimals of mantissa."""
    return f'{offset_ns / NS_PER_S:.6e}'


def to_sec_nanosec(stamp_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec) of builtin_interfaces/Time; 0 <= nanosec < 1e9 for every stamp."""
    return divmod(stamp_ns, NS_PER_S)


def from_sec_nanosec(sec: int, nanosec: int) -> int:
    """Return nanoseconds; the inverse of to_sec_nanosec."""
    return sec * NS_PER_S + nanosec


# The columns of a point in .bin scans: four in KITTI's files, others in those of other data sets.
#
# Written as in `--columns 'x y z intensity - ring time:f8'`: names in the order of the file, - for
# a column that is skipped, :f8 for float64 instead of float32; all little-endian.

_COLUMN = re.compile(r'(-|[A-Za-z]\w{0,30})(?::(f[48]))?', re.ASCII)
_MOST = 64
_XYZ = ('x', 'y', 'z')
_REFLECTANCES = ('intensity', 'reflectance')
_OWN = frozenset({'label', 'instance', 'rgb', 'file_index'})
"""Fields that to-bag adds to clouds."""
REST = '_rest'
"""Ends the name of a field with what float32 cannot hold of a float64 column."""
SKIPPED = '-'


@dataclass(frozen=True)
class ScanColumns:
    """The columns of a point.

    Attributes:
        names: In the order of the file; - is skipped.
        kinds: Type of each, f4 or f8.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> ScanColumns:
        """Parse the notation, with blanks or commas between columns.

        Raises:
            UsageError: A column is invalid or repeated, or x, y or z is missing.
        """
        words = text.replace(',', ' ').split()
        matches = [_COLUMN.fullmatch(word) for word in words]
        wrong = [word for word, match in zip(words, matches, strict=True) if match is None]
        if wrong or len(words) > _MOST:
            reason = f'{wrong[0]!r} is no column' if wrong else f'{len(words)} columns'
            raise UsageError(
                f'columns {text!r}: {reason}; expected up to {_MOST} names of columns such as'
                f' x y z intensity ring, - for one to skip, and :f8 behind float64'
            )
        columns = cls(
            tuple(match[1] for match in matches if match),
            tuple(match[2] or 'f4' for match in matches if match),
        )
        columns._check(text)
        return columns

    def _check(self, text: str) -> None:
        named = [_common(name) for name in self.names if name != SKIPPED]
        repeated = sorted({name for name in named if named.count(name) > 1})
        if repeated:
            raise UsageError(f'columns {text!r}: {repeated[0]} occurs twice')
        missing = [name for name in _XYZ if name not in named]
        if missing:
            raise UsageError(f'columns {text!r}: no {missing[0]}; expected x y z and others')
        own = sorted(name for name in named if name in _OWN or name.endswith(REST))
        if own:
            raise UsageError(f'columns {text!r}: to-bag has a field {own[0]}; choose another name')

    @property
    def text(self) -> str:
        """The notation."""
        pairs = zip(self.names, self.kinds, strict=True)
        return ' '.join(name + (f':{kind}' if kind != 'f4' else '') for name, kind in pairs)

    @cached_property
    def point(self) -> np.dtype[np.void]:
        """The structured type of a point; skipped columns have their number as name."""
        import numpy as np  # noqa: PLC0415 - help texts need none

        return np.dtype([
            (str(index) if name == SKIPPED else name, f'<{kind}')
            for index, (name, kind) in enumerate(zip(self.names, self.kinds, strict=True))
        ])  # fmt: skip

    @cached_property
    def kept(self) -> np.dtype[np.void]:
        """The structured type of a point without the skipped columns."""
        import numpy as np  # noqa: PLC0415 - as above

        pairs = zip(self.names, self.kinds, strict=True)
        return np.dtype([(name, f'<{kind}') for name, kind in pairs if name != SKIPPED])

    def kind_of(self, name: str) -> str:
        """Return the type of a named column: f4 or f8."""
        return self.kinds[self.names.index(name)]

    @property
    def point_bytes(self) -> int:
        """Bytes of a point in the file."""
        return sum(int(kind[1]) for kind in self.kinds)

    @property
    def is_kitti(self) -> bool:
        """True if files are KITTI's own: float32 x y z reflectance."""
        return self.names[:3] == _XYZ and self.names[3:] in _KITTI and set(self.kinds) == {'f4'}

    @property
    def reflectance(self) -> str | None:
        """The name of the column with reflectance, None without one."""
        return next((name for name in self.names if name in _REFLECTANCES), None)

    @property
    def main(self) -> tuple[str, ...]:
        """The names of x, y, z, and of the reflectance if there is one."""
        return _XYZ if self.reflectance is None else (*_XYZ, self.reflectance)

    @property
    def extra(self) -> tuple[str, ...]:
        """The names of the other columns that are read, in their order."""
        return tuple(name for name in self.names if name not in {*self.main, SKIPPED})

    @property
    def skipped(self) -> tuple[int, ...]:
        """The positions of the skipped columns, from 1."""
        return tuple(at for at, name in enumerate(self.names, 1) if name == SKIPPED)

    def describe_skipped(self) -> str:
        """Describe the skipped columns, such as columns 5, 6 of 6."""
        noun = 'column' if len(self.skipped) == 1 else 'columns'
        return f'{noun} {", ".join(map(str, self.skipped))} of {len(self.names)}'


_KITTI = tuple((name,) for name in _REFLECTANCES)
KITTI_COLUMNS = ScanColumns((*_XYZ, 'intensity'), ('f4',) * 4)
"""Columns of KITTI's files."""


def _common(name: str) -> str:
    return _REFLECTANCES[0] if name in _REFLECTANCES else name


# The geographic origin of local poses.

EARTH_RADIUS_M = 6378137.0
"""Radius of KITTI's sphere: latlonToMercator.m of the raw devkit."""

_MAX_LAT_DEG = 85.0  # Mercator stretches without bound towards the poles
_MAX_LON_DEG = 180.0
_MAX_ALT_M = 1e4
_COUNT = 3


@dataclass(frozen=True)
class GeoOrigin:
    """The geographic position of the origin of local coordinates.

    Attributes:
        lat, lon: Degrees north and east.
        alt: Metres.
    """

    lat: float = 0.0
    lon: float = 0.0
    alt: float = 0.0

    @classmethod
    def parse(cls, text: str) -> GeoOrigin:
        """Parse LAT,LON,ALT; the default for an empty text.

        Raises:
            ValueError: It is not three numbers of a position; the message names what is expected.
        """
        if not text.strip():
            return cls()
        try:
            numbers = [float(word) for word in text.split(',')]
        except ValueError:
            numbers = []
        limits = (_MAX_LAT_DEG, _MAX_LON_DEG, _MAX_ALT_M)
        if len(numbers) != _COUNT or not all(
            math.isfinite(number) and abs(number) <= limit
            for number, limit in zip(numbers, limits, strict=True)
        ):
            raise ValueError(
                f'{text!r}; expected LAT,LON,ALT in degrees and metres, such as 49.0,8.4,110'
                f' (latitude -{_MAX_LAT_DEG:g} to {_MAX_LAT_DEG:g}, longitude -180 to 180)'
            )
        return cls(*numbers)

    def moved(self, east: float, north: float, up: float) -> GeoOrigin:
        """Return the position some metres away, on KITTI's sphere.

        Along the tangent plane: to 5e-5 m up to 10 m away and 70 degrees of latitude.
        """
        radius_m = EARTH_RADIUS_M * math.cos(math.radians(self.lat))
        return GeoOrigin(
            self.lat + math.degrees(north / EARTH_RADIUS_M),
            self.lon + math.degrees(east / radius_m),
            self.alt + up,
        )
