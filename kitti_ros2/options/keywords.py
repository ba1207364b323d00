# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Types of the library's keyword options: the command line's, with underscores.

Written by tests/api/keyword_types.py from the declarations of the options. For meanings and
defaults see `kitti-ros2 COMMAND --help-all`, or the reference of the commands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    AnyPath = str | os.PathLike[str]
    OneOrMore = str | Sequence[str]


class FolderKeywords(TypedDict, total=False):
    """Options of the folder, which many commands have."""

    layout: str | None
    sequence: str | None
    columns: OneOrMore | None


class ReadKeywords(FolderKeywords, total=False):
    """Options of reading a KITTI folder."""

    epoch: str
    semantic: bool
    period: float | str
    scan_stamp: str
    real_time: bool
    mapping: AnyPath | None
    raw: AnyPath | None
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
    base_to_imu: str | Sequence[float] | None
    objects: str
    autoware_labels: OneOrMore | Mapping[str, str]
    annotations: bool
    covariances: bool | None
    points: str | None
    clouds: str
    fisheye: str
    stereo_frame: str
    color_encoding: str
    stack: str | None
    ground_truth_tree: bool
    ground_truth_map: str
    ground_truth_base: str
    marker_colors: str
    marker_alpha: float
    marker_line_width: float
    marker_arrow_length: float
    marker_text_height: float
    marker_lifetime: float | str
    trails: bool
    ego_marker: bool
    predictions: AnyPath | None
    iou: float | str | Sequence[str] | None
    imu_from: AnyPath | None
    imu_stamps: str
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
    calib: AnyPath | None
    origin: str | Sequence[float] | None
    split: float
    all_cameras: bool
    png: str | None
    snap: bool
    append: bool
    overwrite: bool
    fsync: bool
    start: int | str | None
    end: int | str | None


class DrawKeywords(TypedDict, total=False):
    """Options of view that concern a picture."""

    camera: int | None
    color_by: str | None
    color_map: str
    point_size: int
    classes: OneOrMore
    range: str | Sequence[float]
    resolution: float


class ExtractKeywords(TypedDict, total=False):
    """Options of extract."""

    overwrite: bool
    remove_archives: bool
    max_ratio: float
    max_size: int | str
    fsync: bool


class DownloadKeywords(TypedDict, total=False):
    """Options of download."""

    category: OneOrMore
    sync: bool
    extract: bool
    tracklets: bool
    accept_license: bool
    base_url: str | None
    checksums: AnyPath | None
    verify: bool
    keep_archives: bool
    archives_only: bool
    jobs: int
    retries: int
    timeout: float | str
    overwrite: bool
    max_ratio: float
    max_size: int | str
    fsync: bool


class ValidateKeywords(FolderKeywords, total=False):
    """Options of validate."""

    quick: bool
    decode: bool


class StatisticsKeywords(FolderKeywords, total=False):
    """Options of stats."""

    points: bool


class CropKeywords(FolderKeywords, total=False):
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
    deskew: bool
    undo_deskew: bool


class SplitKeywords(TypedDict, total=False):
    """Options of split."""

    ratio: str | Sequence[float | str]
    names: OneOrMore
    seed: int | None
    by_drive: bool
    lists: AnyPath | Sequence[AnyPath]
    check: bool
    mapping: AnyPath | None
    out: AnyPath | None
    overwrite: bool
    layout: str | None


class DetectionKeywords(FolderKeywords, total=False):
    """Options of eval detection."""

    classes: OneOrMore | Mapping[str, float | None]
    iou: float | str | Sequence[str] | None
    frames: AnyPath | None
    loose: bool
    worst: int | None
    topic: str | None
    class_map: OneOrMore | Mapping[str, str]
    tolerance: float | str | None


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
    tolerance: float | str | None
    sequence: str | None
    epoch: str
    period: float | str


class LiveKeywords(FolderKeywords, total=False):
    """Options of eval live."""

    topic: str
    node: str | None
    type: str | None
    task: str | None
    align: str
    start_timeout: float | str
    timeout: float | str
    wait_for: int
    out: AnyPath | None
    overwrite: bool
    deskew: bool
    undo_deskew: bool
    stereo: bool
    start: int | str | None
    end: int | str | None
    images: str
    preset: str
    map: str
    tf: bool
    ring_time: bool
    covariances: bool | None
    points: str | None
    stereo_frame: str
    color_encoding: str
    stack: str | None
    ground_truth_tree: bool
    ground_truth_map: str
    ground_truth_base: str
    imu_from: AnyPath | None
    imu_stamps: str
