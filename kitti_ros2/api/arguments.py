# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments of the library: options as keywords, and the source that is opened."""

from __future__ import annotations

import os
import warnings
from keyword import iskeyword
from typing import TYPE_CHECKING, Any, TypedDict

from ..model.errors import MissingPathError
from ..options.declare import make_options, options_of, parse_values
from ..options.read import ReadOptions
from ..pictures.bag_frames import open_frames

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from ..model.errors import Loss
    from ..options.declare import Option
    from ..pictures.recording_frames import FrameSource


# Types of the keyword options: the command line's, with underscores; a test compares them.
#
# For meanings and defaults see `kitti-ros2 COMMAND --help`, or the reference of the commands.


if TYPE_CHECKING:
    OneOrMore = str | Sequence[str]


class ReadKeywords(TypedDict, total=False):
    """Options of reading a KITTI folder."""

    layout: str | None
    sequence: str | None
    columns: OneOrMore | None
    epoch: str
    semantic: bool
    period: float
    scan_stamp: str
    real_time: bool
    mapping: str | os.PathLike[str] | None
    raw: str | os.PathLike[str] | None
    deskew: bool
    undo_deskew: bool
    stereo: bool


class ToBagKeywords(ReadKeywords, total=False):
    """Options of to-bag."""

    streams: OneOrMore
    topics: OneOrMore
    exclude_topics: OneOrMore
    start: int | str | None
    end: int | str | None
    images: str
    preset: str
    map: str
    tf: bool
    ring_time: bool
    points: str | None
    base_to_imu: str | Sequence[float] | None
    marker_colors: str
    marker_alpha: float
    marker_line_width: float
    marker_arrow_length: float
    marker_text_height: float
    marker_lifetime: float
    trails: bool
    ego_marker: bool
    objects: str
    autoware_labels: Mapping[str, str] | OneOrMore
    annotations: bool
    predictions: str | os.PathLike[str] | None
    iou: float | str | Sequence[str] | None
    imu_from: str | os.PathLike[str] | None
    imu_stamps: str
    covariances: bool | None
    ground_truth_tree: bool
    ground_truth_map: str
    ground_truth_base: str
    stereo_frame: str
    color_encoding: str
    stack: str | None
    storage: str | None
    strict: bool
    compression: str
    compression_level: int | None
    split_size: int | str | None
    split_duration: float | str | None
    overwrite: bool
    fsync: bool
    keep_partial: bool


class ToKittiKeywords(TypedDict, total=False):
    """Options of to-kitti."""

    layout: str | None
    name: str | None
    calib: str | os.PathLike[str] | None
    origin: str | Sequence[float] | None
    split: float
    all_cameras: bool
    append: bool
    overwrite: bool
    fsync: bool
    start: int | str | None
    end: int | str | None


class CropKeywords(TypedDict, total=False):
    """Options of crop."""

    view: str | None
    camera: int | None
    image_size: str | Sequence[int] | None
    box: str | Sequence[float] | Sequence[Sequence[float]]
    range: str | Sequence[float | None] | None
    height: str | Sequence[float | None] | None
    lasers: int | None
    voxel: float | None
    folder: str | None
    empty_labels: str
    copy: bool
    overwrite: bool
    fsync: bool
    layout: str | None
    sequence: str | None
    columns: OneOrMore | None
    deskew: bool
    undo_deskew: bool


class SplitKeywords(TypedDict, total=False):
    """Options of split."""

    ratio: str | Sequence[float | str]
    names: OneOrMore
    seed: int
    by_drive: bool
    lists: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
    check: bool
    mapping: str | os.PathLike[str] | None
    out: str | os.PathLike[str] | None
    overwrite: bool
    layout: str | None


class DrawKeywords(TypedDict, total=False):
    """Options of view that concern a picture."""

    camera: int | None
    color_by: str
    color_map: str
    point_size: int
    range: str | Sequence[float]
    resolution: float
    classes: OneOrMore


class LiveKeywords(TypedDict, total=False):
    """Options of eval live."""

    topic: str
    node: str | None
    type: str | None
    task: str | None
    align: str
    start_timeout: float | str
    timeout: float | str
    wait_for: int
    out: str | os.PathLike[str] | None
    overwrite: bool
    layout: str | None
    sequence: str | None
    columns: OneOrMore | None
    deskew: bool
    undo_deskew: bool
    start: int | str | None
    end: int | str | None
    preset: str
    map: str
    tf: bool
    ring_time: bool
    points: str | None
    stack: str | None
    images: str
    ground_truth_tree: bool
    ground_truth_map: str
    ground_truth_base: str
    stereo: bool
    stereo_frame: str
    color_encoding: str
    imu_from: str | os.PathLike[str] | None
    imu_stamps: str
    covariances: bool | None


class StatisticsKeywords(TypedDict, total=False):
    """Options of stats."""

    points: bool
    layout: str | None
    sequence: str | None
    columns: OneOrMore | None


class DetectionKeywords(TypedDict, total=False):
    """Options of eval detection."""

    classes: OneOrMore | Mapping[str, float | None]
    frames: str | os.PathLike[str] | None
    loose: bool
    worst: int | None
    topic: str | None
    class_map: OneOrMore | Mapping[str, str]
    tolerance: float | None
    layout: str | None
    sequence: str | None
    columns: OneOrMore | None


class OdometryKeywords(TypedDict, total=False):
    """Options of eval odometry."""

    topic: str | None
    tf: OneOrMore
    gt_topic: str | None
    frame: str | None
    align: str
    tolerance: float | str | None
    layout: str | None
    sequence: str | None
    epoch: str


class TrackingKeywords(TypedDict, total=False):
    """Options of eval tracking."""

    topic: str | None
    class_map: OneOrMore | Mapping[str, str]
    tolerance: float | None
    sequence: str | None
    epoch: str
    period: float


def keyword_of(option: Option) -> str:
    """Return the keyword of an option: its long flag with underscores, if Python allows it."""
    long = [flag for flag in option.flags if flag.startswith('--')]
    word = (long[0] if long else option.name).lstrip('-').replace('-', '_')
    return option.name if iskeyword(word) else word


def by_name(keywords: Mapping[str, object], options: Sequence[Option]) -> dict[str, object]:
    """Return the values by name of option; unknown keywords are kept, and refused later."""
    names = {keyword_of(option): option.name for option in options}
    return {names.get(keyword, keyword): value for keyword, value in keywords.items()}


# The open files of a recording, shared by its frames.


_OPTIONS = options_of(ReadOptions)


class OpenSource:
    """The open files of a recording, opened again in a process that was forked or unpickled."""

    def __init__(self, path: Path, options: Mapping[str, Any]) -> None:
        self.path = path
        self.options = dict(options)
        self._process = 0
        self._frames: FrameSource | None = None

    @property
    def frames(self) -> FrameSource:
        """The frames; file positions of a bag are not shared between processes."""
        if self._frames is None or self._process != os.getpid():
            read = make_options(ReadOptions, parse_values(self.options, _OPTIONS))
            self._frames = open_frames(self.path, read)
            self._process = os.getpid()
        return self._frames

    def close(self) -> None:
        """Close the files."""
        if self._frames is not None and self._process == os.getpid():
            self._frames.close()
        self._frames = None

    def __getstate__(self) -> dict[str, Any]:
        return {'path': self.path, 'options': self.options, '_process': 0, '_frames': None}


class KittiRos2Warning(UserWarning):
    """Data was skipped because it is missing or damaged; the text contains the path and line."""


def require(path: Path) -> Path:
    """Return a path that exists.

    Raises:
        MissingPathError: It does not.
    """
    if not path.exists():
        raise MissingPathError(path)
    return path


def warn(text: str) -> None:
    """Warn of skipped data, at the line that called the caller."""
    warnings.warn(text, KittiRos2Warning, stacklevel=3)


def warn_of(losses: Iterable[Loss]) -> None:
    """Warn of each loss, at the line that called the caller."""
    for loss in losses:
        warnings.warn(loss.text(), KittiRos2Warning, stacklevel=3)
