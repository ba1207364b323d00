# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of to-bag, the player and view: the options objects of each part, and their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..model.containers import CONTAINERS
from ..model.errors import UsageError
from .declare import check_bounds, choice, option
from .parsers import parse_flag, parse_integer, parse_number, parse_path, parse_text
from .playback import Stamps

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .bag import BagOptions
    from .imu import ImuOptions
    from .messages import MessageOptions
    from .pictures import PictureOptions
    from .playback import PlaybackOptions
    from .predictions import PredictionOptions
    from .read import ReadOptions
    from .selection import SelectionOptions

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
        mode: What is drawn.
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
    )
    frame: int | None = option(None, 'Frame number of a picture', parse_integer, unset='the first')
    frames: str | None = option(
        None,
        'FIRST:LAST[:STEP] of a film or folder, both included',
        parse_text,
        unset='all',
        metavar='FRAMES',
    )
    rate_hz: float | None = option(
        None,
        'Of a film: pictures per second',
        parse_number,
        name='fps',
        unset="the recording's",
    )
    overwrite: bool = option(False, 'Replace an existing file', parse_flag)

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
