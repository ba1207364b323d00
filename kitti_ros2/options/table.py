# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of each command, and their objects from values by name.

Command lines, YAML files and ROS parameters all fill the same objects.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from ..model.bag_formats import CONTAINERS, FORMATS
from ..model.errors import UsageError
from .declare import (
    check_bounds,
    choice,
    make_options,
    option,
    options_of,
    parse_flag,
    parse_integer,
    parse_number,
    parse_path,
    parse_text,
    parse_values,
    values_for,
)
from .messages import Clouds, GroundTruthOptions, Images, MarkerOptions, MessageOptions, with_stack
from .outputs import (
    BagOptions,
    BirdOptions,
    ColorBy,
    ImportOptions,
    PictureOptions,
    PlaybackOptions,
    Stamps,
)
from .read import (
    MOTION,
    SOURCE,
    ImuOptions,
    PredictionOptions,
    ReadOptions,
    ScanStamp,
    SelectionOptions,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from .declare import Option


# Settings of to-bag, the player and view: the options objects of each part, and their own.

FPS = (0.1, 240.0)


@dataclass(frozen=True)
class Settings:
    """Settings of to-bag.

    Attributes:
        read, messages, selection, predictions, imu: The options objects of each part.
        bag: Returns the options of the bag for a storage.
        storage: As requested; None is chosen by the output's name.
        strict: Whether to stop at the first loss.
    """

    group: ClassVar = 'Bag'

    read: ReadOptions
    messages: MessageOptions
    selection: SelectionOptions
    predictions: PredictionOptions
    imu: ImuOptions
    bag: Callable[[str], BagOptions]
    storage: str | None = option(
        None,
        'Container of the bag',
        parse_text,
        unset="by OUT's ending, else mcap",
        choices=tuple(CONTAINERS),
    )
    strict: bool = option(False, 'Stop at the first bad file and leave nothing behind', parse_flag)


@dataclass(frozen=True)
class PlaySettings:
    """Settings of the player.

    Attributes:
        read, messages, selection, playback, predictions, imu: The options objects of each part.
        stamps: Stamps of the messages.
        read_ahead: Frames to fetch ahead.
        qos_overrides_path: A rosbag2 QoS override file, or None.

    Raises:
        UsageError: read_ahead is out of range.
    """

    group: ClassVar = 'Playback'

    read: ReadOptions
    messages: MessageOptions
    selection: SelectionOptions
    playback: PlaybackOptions
    predictions: PredictionOptions
    imu: ImuOptions
    stamps: Stamps = choice(
        Stamps.ORIGINAL, 'Stamps of the recording, or the current time without /clock', Stamps
    )
    read_ahead: int = option(8, 'Frames to read ahead', parse_integer, bounds=(1, 1000))
    qos_overrides_path: Path | None = option(
        None,
        'QoS by topic, a file as ros2 bag play takes it',
        parse_path,
        unset='reliable, 10',
        flags=('--qos-overrides-path', '--qos-profile-overrides-path'),
    )

    def __post_init__(self) -> None:
        check_bounds(self, 'read_ahead')


@dataclass(frozen=True)
class ViewSettings:
    """Settings of drawing.

    Attributes:
        read, pictures, predictions: The options objects of each part.
        selection: First and last frame of a film or folder; the first is that of a picture.
        mode: Name of the drawing.
        frame: The frame of a picture; None is the first.
        frames: Frames of a film or folder, FIRST:LAST[:STEP]; None is all.
        rate_hz: Pictures per second of a film; None is the rate of the recording.
        overwrite: Whether an existing file may be replaced.

    Raises:
        UsageError: A value is out of range, or excludes another.
    """

    group: ClassVar = 'Pictures'

    read: ReadOptions
    pictures: PictureOptions
    selection: SelectionOptions
    predictions: PredictionOptions
    mode: str = option(
        'panel',
        'Kind of picture, see above',
        parse_text,
        choices=('camera', 'boxes', 'lidar', 'bev', 'perspective', 'panel'),
        common=True,
    )
    frame: int | None = option(
        None, 'Frame number of a picture', parse_integer, unset='the first', common=True
    )
    frames: str | None = option(
        None,
        'FIRST:LAST[:STEP] of a film or folder, both included',
        parse_text,
        unset='all',
        metavar='FRAMES',
        common=True,
    )
    rate_hz: float | None = option(
        None,
        'Of a film: pictures per second',
        parse_number,
        name='fps',
        unset="the recording's",
    )
    overwrite: bool = option(False, 'Replace an existing file', parse_flag, common=True)

    def __post_init__(self) -> None:
        if self.frame is not None and self.frames is not None:
            raise UsageError('--frame and --frames exclude each other')
        named = '--frames' if self.frame is None else '--frame'
        chosen = self.frame if self.frames is None else self.frames
        if chosen is not None and (self.selection.start or self.selection.end):
            raise UsageError(f'{named} does not go with --start and --end; give one or the other')
        low, high = FPS
        if self.rate_hz is not None and not low <= self.rate_hz <= high:
            raise UsageError(f'{self.rate_hz:g} pictures a second; expected {low:g} to {high:g}')


_PREDICTIONS = options_of(PredictionOptions)
_IMU = options_of(ImuOptions)
_MESSAGES = (
    *options_of(MessageOptions),
    *options_of(GroundTruthOptions),
    *options_of(MarkerOptions),
)
_PLAY_DEFAULTS = {'images': Images.BOTH}

REPORT = (*SOURCE, *MOTION)
STACK_DRIVE = (
    *(opt for opt in SOURCE if opt.name in {'layout', 'sequence', 'columns'}),
    *_IMU,
)
"""Options of the drive that a stack is set up for."""
TO_BAG = (
    *options_of(ReadOptions),
    *options_of(SelectionOptions),
    *(opt for opt in _MESSAGES if opt.name != 'annotated'),
    *_PREDICTIONS,
    *_IMU,
    *options_of(Settings),
    *options_of(BagOptions),
)
PLAY = tuple(
    replace(opt, default=_PLAY_DEFAULTS.get(opt.name, opt.default))
    for opt in (
        *options_of(ReadOptions),
        *options_of(SelectionOptions),
        *options_of(PlaybackOptions),
        *options_of(PlaySettings),
        *(opt for opt in _MESSAGES if opt.name != 'clouds'),
        *_PREDICTIONS,
        *_IMU,
    )
)
_SPAN = tuple(opt for opt in options_of(SelectionOptions) if opt.name in {'start', 'end'})
TO_KITTI = (*options_of(ImportOptions), *_SPAN)
VIEW = (
    *options_of(ViewSettings),
    *options_of(PictureOptions),
    *options_of(BirdOptions),
    *_PREDICTIONS,
    *SOURCE,
    *MOTION,
    *(replace(opt, common=False) for opt in _SPAN),
    *(
        replace(opt, meaning=f'With --rerun: {opt.meaning}', common=False)
        for opt in (*options_of(SelectionOptions), *_MESSAGES)
        if opt.name in {'topics', 'exclude_topics', 'fisheye'}
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
    if read.columns is not None and read.columns.extra and messages.clouds is Clouds.COMPACT:
        raise UsageError(
            f'clouds compact have x y z and reflectance alone; give - for {read.columns.extra[0]}'
            f' in columns, or take clouds plain'
        )


TO_BAG_OPTIONS = tuple(opt.name for opt in TO_BAG)
PLAY_OPTIONS = tuple(opt.name for opt in PLAY)
"""Names that make_settings and make_play_settings accept."""


# Options of commands that take whole collections.

LOCAL = 'local'
"""The value of `scheduler` that starts a cluster on this machine."""
_MOST_JOBS = 256
_MOST_FRAMES = 1_000_000
_ADDRESS = re.compile(r'[a-z]+://[^/\s]+:\d{1,5}/?', re.ASCII)


def parse_scheduler(name: str, value: object) -> str:
    """Parse the address of a Dask scheduler, or `local`.

    Raises:
        UsageError: It is neither.
    """
    text = parse_text(name, value)
    if text == LOCAL or _ADDRESS.fullmatch(text):
        return text
    raise UsageError(f'--{name} {text} is no address; expected tcp://HOST:PORT, or {LOCAL}')


@dataclass(frozen=True)
class BatchOptions:
    """Options of a collection.

    Attributes:
        whole: Whether SRC is a collection and OUT a folder of outputs.
        jobs: Number of worker processes. Without `whole` they encode one recording, and None is no
            process but this one; else they convert jobs, and None is one for each CPU, at most 8.
        slice_frames: Frames of a job of an object set; None takes a split whole.
        retry: Whether failed jobs are run again.
        scheduler: Dask scheduler that runs the jobs: its address, or `local` to start one; None
            runs them on processes of this program.

    Raises:
        UsageError: A number is out of range, or an option is given without `all`.
    """

    group: ClassVar = 'Collections'

    whole: bool = option(
        False,
        'SRC is a collection (a root, a quoted glob, or a .txt list of folders), OUT a folder',
        parse_flag,
        name='all',
        flags=('--all',),
        common=True,
    )
    jobs: int | None = option(
        None,
        'Worker processes, 1 to 256: with --all for units, without it for frames',
        parse_integer,
        unset='with --all one per CPU, at most 8',
    )
    slice_frames: int | None = option(
        None,
        'With --all: divide object sets into units of so many frames',
        parse_integer,
        unset='one unit',
    )
    retry: bool = option(
        False,
        'With --all: run units again that failed or skipped data',
        parse_flag,
        flags=('--retry',),
    )
    scheduler: str | None = option(
        None,
        'With --all: run on a Dask cluster, tcp://HOST:PORT, or start one here: local',
        parse_scheduler,
        unset='processes',
    )

    def __post_init__(self) -> None:
        self._check('jobs', self.jobs, _MOST_JOBS)
        self._check('slice-frames', self.slice_frames, _MOST_FRAMES)
        given = {
            'slice-frames': self.slice_frames is not None,
            'retry': self.retry,
            'scheduler': self.scheduler is not None,
        }
        alone = [name for name, is_given in given.items() if is_given and not self.whole]
        if alone:
            raise UsageError(f'--{alone[0]} is for whole collections; give --all too')
        if self.jobs is not None and self.scheduler not in {None, LOCAL}:
            raise UsageError(
                f'--jobs is for workers on this machine, and the cluster at {self.scheduler} has'
                ' workers of its own; leave --jobs out'
            )

    @staticmethod
    def _check(name: str, value: int | None, most: int) -> None:
        if value is not None and not 1 <= value <= most:
            raise UsageError(f'--{name} {value} is out of range; expected 1 to {most}')


BATCH = options_of(BatchOptions)
"""Options of a collection, on the command line only."""
_SLICED = 'slice_frames'


def collection_options(meaning: str, *, sliced: bool = False) -> tuple[Option, ...]:
    """Return the options of a collection for a command.

    Args:
        meaning: Help of --all.
        sliced: Whether jobs may be slices of an object set.
    """
    return tuple(
        replace(opt, meaning=meaning) if opt.name == 'all' else opt
        for opt in BATCH
        if sliced or opt.name != _SLICED
    )


TO_BAG_ALL = (
    *TO_BAG,
    *collection_options(
        'SRC is a collection (a root, a quoted glob, or a .txt list of folders), OUT a folder',
        sliced=True,
    ),
)
TO_KITTI_ALL = (
    *TO_KITTI,
    *collection_options(
        'BAG is a collection (a root, a quoted glob, or a .txt list of bags), OUT a folder of'
        ' a data set for each'
    ),
)
REPORT_ALL = (
    *REPORT,
    *collection_options(
        'SRC is a collection (a root, a quoted glob, or a .txt list), OUT a folder of pages'
    ),
)
"""Options of commands that take a collection."""


def split_batch_options(
    values: Mapping[str, object], *, jobs_alone: bool = False
) -> tuple[BatchOptions, dict[str, object]]:
    """Return the options of the collection, and the values of the others, by name.

    Args:
        values: Of all options, by name.
        jobs_alone: Whether the command has worker processes for a single recording, too.

    Raises:
        UsageError: A value is invalid.
    """
    names = {opt.name for opt in BATCH}
    own = {name: value for name, value in values.items() if name in names}
    rest = {name: value for name, value in values.items() if name not in names}
    batch = make_options(BatchOptions, parse_values(own, BATCH))
    if batch.jobs is not None and not (batch.whole or jobs_alone):
        raise UsageError('--jobs is for whole collections; give --all too')
    return batch, rest
