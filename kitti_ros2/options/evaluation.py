# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the evaluations, and their values by name."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from ..model import bag_formats as types
from ..model.bag_formats import CONTAINERS
from ..model.classes import LeastOverlaps
from ..model.errors import UsageError, did_you_mean, not_one_of
from .declare import (
    check_bounds,
    choice,
    make_options,
    option,
    options_of,
    parse_class_map,
    parse_class_overlaps,
    parse_flag,
    parse_integer,
    parse_least_overlaps,
    parse_path,
    parse_seconds_ns,
    parse_text,
    parse_texts,
    parse_values,
)
from .outputs import MOST_SUBSCRIBERS
from .read import SOURCE, ReadOptions, make_with_source
from .table import PLAY, collection_options, make_play_settings

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


# Options of results that are recorded in a bag: topic, classes, stamps.


@dataclass(frozen=True)
class BagResultsOptions:
    """Options of results in a bag.

    Attributes:
        topic: Their topic; None is the only one with boxes.
        class_map: Pairs of a class of the results, or its numeric id, and KITTI's; an empty class
            leaves boxes out, and the name * stands for all other classes.
        tolerance_ns: The largest distance between the stamps of a result and of its frame,
            nanoseconds; None is half the time between frames.

    Raises:
        UsageError: The tolerance is out of range.
    """

    group: ClassVar = 'Results in a bag'

    topic: str | None = option(
        None,
        'Topic of a Detection3DArray, Detection2DArray, MarkerArray, or of objects of Autoware',
        parse_text,
        unset='the only one',
        metavar='TOPIC',
        common=True,
    )
    class_map: tuple[tuple[str, str], ...] = option(
        (),
        "KITTI's class of each of your classes: car=Car 3=Pedestrian; NAME= leaves a class out,"
        " '*=' all others",
        parse_class_map,
        unset='the same name in any case',
        metavar='NAME=CLASS...',
        common=True,
    )
    tolerance_ns: int | None = option(
        None,
        'Largest distance in seconds between the stamps of a result and of its frame',
        parse_seconds_ns,
        name='tolerance',
        unset='half the time between frames',
        bounds=(0.0, 60.0),
    )

    def __post_init__(self) -> None:
        if self.tolerance_ns is not None:
            check_bounds(self, 'tolerance')


# Options of scoring detections.

BENCHMARK_CLASSES = {'car': 0.7, 'pedestrian': 0.5, 'cyclist': 0.5}
"""Overlap above which a detection matches, by class of the object benchmark (MIN_OVERLAP)."""


@dataclass(frozen=True)
class DetectionOptions:
    """Options of scoring detections.

    Attributes:
        classes: Names with the overlap above which a detection matches, None for that of iou;
            empty for the benchmark's classes.
        iou: The overlaps of classes that have none; None for those of the benchmark.
        frames: A list of the frames to score; None for all that have results.
        loose: Whether to score with the loose overlaps, too.
        worst: Number of the frames with the most errors to list; None for none.

    Raises:
        UsageError: A class has no overlap, or an impossible one, or no frame is to be listed.
    """

    group: ClassVar = 'Benchmark'

    classes: tuple[tuple[str, float | None], ...] = option(
        (),
        'Classes to score; others than these three need an --iou',
        parse_class_overlaps,
        unset='car, pedestrian, cyclist',
        metavar='NAME...',
        common=True,
    )
    iou: LeastOverlaps | None = option(
        None,
        'Overlap above which a detection counts: 0.5 for all classes, truck=0.5 for one',
        parse_least_overlaps,
        unset='0.7 for car, 0.5 for pedestrian and cyclist',
        metavar='IOU...',
        common=True,
    )
    frames: Path | None = option(
        None,
        'Score only the frames of a list such as ImageSets/val.txt',
        parse_path,
        unset='all with a result file',
        flags=('--frame-list',),
        metavar='FILE',
        common=True,
    )
    loose: bool = option(
        False,
        'Also score BEV and 3D with an overlap of 0.5 for cars, 0.25 for pedestrians and cyclists',
        parse_flag,
        flags=('--loose',),
        common=True,
    )
    worst: int | None = option(
        None,
        'List the N frames with the most errors; with -o FOLDER they are drawn',
        parse_integer,
        unset='none',
        common=True,
    )

    def __post_init__(self) -> None:
        if self.worst is not None and self.worst < 1:
            raise UsageError(f'worst {self.worst} lists no frame; give a number from 1, such as 20')
        for name in dict(self.iou.by_class) if self.iou else ():
            if name not in self.limits:
                raise UsageError(
                    f'--iou is given for {name}, which is not scored; give --classes'
                    f' {" ".join(self.limits)} {name}'
                )
        for name, overlap in self.limits.items():
            if dict(self.classes).get(name) is None and math.isnan(overlap):
                raise UsageError(
                    f'the class {name} needs an overlap, such as --iou {name}=0.5; the'
                    f' benchmark has one for {", ".join(BENCHMARK_CLASSES)} only'
                    f'{did_you_mean(name, BENCHMARK_CLASSES)}'
                )
            if not 0 <= overlap < 1:
                raise UsageError(
                    f'the overlap {overlap:g} of {name} is not within 0 to 1; give one such as 0.5'
                )

    @property
    def overlaps(self) -> LeastOverlaps:
        """The same for the comparison of single frames."""
        return LeastOverlaps(tuple(self.limits.items()))

    @property
    def limits(self) -> Mapping[str, float]:
        """The overlap above which a detection matches, by class in lower case."""
        chosen = self.classes or tuple((name, None) for name in BENCHMARK_CLASSES)
        return {
            name: self._overlap(name) if overlap is None else overlap for name, overlap in chosen
        }

    def _overlap(self, name: str) -> float:
        given = self.iou or LeastOverlaps()
        of_benchmark = BENCHMARK_CLASSES.get(name, math.nan)
        others = of_benchmark if given.others is None else given.others
        return dict(given.by_class).get(name, others)


# Options of scoring a trajectory.


class Alignment(str, Enum):
    """Alignment of a result with the ground truth before errors are computed."""

    NONE = 'none'
    FIRST = 'first'
    SE3 = 'se3'
    SIM3 = 'sim3'
    SCALE = 'scale'

    @property
    def has_scale(self) -> bool:
        """Whether it scales the result, for KITTI's segments too."""
        return self in {Alignment.SIM3, Alignment.SCALE}


@dataclass(frozen=True)
class OdometryOptions:
    """Options of scoring a trajectory.

    Attributes:
        topic: The topic of a result in a bag; None is the only one with poses.
        tf: Parent and child of the link whose transforms are the result; empty for a topic.
        gt_topic: The topic of a ground truth in a bag that to-bag did not write; None is chosen.
        frame: The frame whose poses the result has; None is that of the messages, in files the
            rectified camera 0.
        align: How the result is aligned for APE and RPE; a scale is also that of the segments.
        tolerance_ns: Largest accepted difference of the stamps of a pose and its frame; None is
            half the period of the ground truth.

    Raises:
        UsageError: A value is invalid, or excludes another.
    """

    group: ClassVar = 'Evaluation'

    topic: str | None = option(
        None,
        'Topic of RESULT, a bag; Odometry, PoseStamped, Path',
        parse_text,
        unset='the only one',
        metavar='TOPIC',
        common=True,
    )
    tf: tuple[str, ...] = option(
        (),
        'Instead of a topic: the link on /tf that is RESULT',
        parse_texts,
        unset='none',
        metavar='PARENT CHILD',
        common=True,
    )
    gt_topic: str | None = option(
        None,
        'Topic of GT, a bag that to-bag did not write',
        parse_text,
        unset='chosen by name and type',
        metavar='TOPIC',
    )
    frame: str | None = option(
        None,
        'Frame whose poses RESULT has, such as velo_link',
        parse_text,
        unset='that of the messages, in files camera 0',
        metavar='FRAME',
        common=True,
    )
    align: Alignment = choice(
        Alignment.FIRST,
        'Alignment: the first pose, or all positions; sim3, scale: segments are scaled, too',
        Alignment,
        common=True,
    )
    tolerance_ns: int | None = option(
        None,
        'Largest difference of the stamps of a pose and its frame',
        parse_seconds_ns,
        name='tolerance',
        unset="half of GT's period",
    )

    def __post_init__(self) -> None:
        if self.tf and self.topic is not None:
            raise UsageError('--topic and --tf exclude each other; give one of them')
        if self.tf and len(self.tf) != 2:
            raise UsageError(
                f'--tf takes the parent and the child of a link, such as odom base_link, not'
                f' {" ".join(self.tf)!r}'
            )


# Options of the evaluation of a running stack.

_TOPIC = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)
_BOXES = ('detection', 'tracking')
_POSES = ('odometry',)
TASKS = {
    types.DETECTIONS_3D: _BOXES,
    types.DETECTIONS_2D: _BOXES,
    types.DETECTED_OBJECTS: _BOXES,
    types.TRACKED_OBJECTS: _BOXES[::-1],
    types.MARKERS: _BOXES,
    types.ODOMETRY: _POSES,
    types.POSE: _POSES,
    types.PATH: _POSES,
}
"""Evaluations of results by message type, the usual one first."""


@dataclass(frozen=True)
class LiveOptions:
    """Options of the evaluation of a running stack.

    Attributes:
        topic: The topic with its results.
        node: The command that starts it; None if it is started otherwise.
        msgtype: The type of the topic; None takes that of its publisher.
        task: The evaluation; None is the usual one for the type.
        align: How poses are aligned before they are scored.
        start_timeout_ns: Nanoseconds within which the node must publish the topic and subscribe.
        timeout_ns: Nanoseconds without an answer after which the run ends.
        wait_for: Nodes that must subscribe before it begins.
        out: The bag of the results; None keeps none.
        overwrite: Whether existing files may be replaced.

    Raises:
        UsageError: The topic is missing, or a value is invalid.
    """

    group: ClassVar = 'Live'

    topic: str = option(
        '',
        'Topic with the results of the node',
        parse_text,
        unset='required',
        metavar='TOPIC',
        common=True,
    )
    node: str | None = option(
        None,
        'Command that starts the node, in quotes',
        parse_text,
        unset='none: it is started otherwise',
        metavar='COMMAND',
        common=True,
    )
    msgtype: str | None = option(
        None,
        'Type of the topic, such as vision_msgs/msg/Detection3DArray',
        parse_text,
        name='type',
        unset='that of its publisher',
        metavar='TYPE',
        common=True,
    )
    task: str | None = option(
        None,
        'What is scored',
        parse_text,
        unset="by the topic's type",
        choices=(*_BOXES, *_POSES),
        common=True,
    )
    align: Alignment = choice(
        Alignment.FIRST, 'Alignment of poses; sim3, scale: segments are scaled, too', Alignment
    )
    start_timeout_ns: int = option(
        60_000_000_000,
        'Seconds until the topic must have a publisher, and the player its subscribers',
        parse_seconds_ns,
        name='start_timeout',
        bounds=(1.0, 3600.0),
    )
    timeout_ns: int = option(
        30_000_000_000,
        'Seconds without an answer that end the run',
        parse_seconds_ns,
        name='timeout',
        bounds=(1.0, 3600.0),
    )
    wait_for: int = option(
        1,
        'Wait until so many nodes subscribe, and 1 s more without a new subscription',
        parse_integer,
    )
    out: Path | None = option(
        None,
        'Bag of the results to write, with the transforms',
        parse_path,
        unset='none',
        flags=('--out', '-o'),
        metavar='OUT',
        common=True,
    )
    overwrite: bool = option(False, 'Replace existing files', parse_flag, common=True)

    def __post_init__(self) -> None:
        if not self.topic:
            raise UsageError('--topic is missing, the topic with the results of the node')
        if not _TOPIC.fullmatch(self.topic):
            raise UsageError(f'{self.topic!r} is no full name of a topic, such as /my/detections')
        if self.task not in {None, *_BOXES, *_POSES}:
            raise not_one_of('task', self.task, (*_BOXES, *_POSES))
        if self.msgtype is not None:
            self.task_of(self.msgtype)
        self._check_out()
        check_bounds(self, 'start_timeout', 'timeout')
        if not 1 <= self.wait_for <= MOST_SUBSCRIBERS:
            raise UsageError(f'wait_for {self.wait_for} is not within 1 to {MOST_SUBSCRIBERS}')

    def _check_out(self) -> None:
        """Refuse names of files that only a rosbag2 directory contains."""
        inner = {container.suffix for container in CONTAINERS.values() if not container.in_file}
        if self.out is not None and self.out.suffix in inner:
            raise UsageError(
                f'{self.out}: results are written as MCAP or ROS 1; give'
                f' {self.out.with_suffix(CONTAINERS["mcap"].suffix)}'
            )

    def known_task(self) -> str | None:
        """Return the evaluation if the options name it or the type; None if the topic decides."""
        return self.task if self.msgtype is None else self.task_of(self.msgtype)

    def task_of(self, msgtype: str) -> str:
        """Return the evaluation of results of a type.

        Raises:
            UsageError: Such messages are no results, or not those of the requested evaluation.
        """
        tasks = TASKS.get(msgtype)
        if tasks is None:
            raise UsageError(
                f'{self.topic} is {msgtype}, which cannot be scored; expected one of'
                f' {", ".join(TASKS)}'
            )
        if self.task is not None and self.task not in tasks:
            raise UsageError(
                f'{self.topic} is {msgtype}, which cannot be scored as {self.task}; expected'
                f' --task {" or ".join(tasks)}'
            )
        task = self.task or tasks[0]
        if self.align is not Alignment.FIRST and task not in _POSES:
            raise UsageError(f'--align is for poses; {self.topic} is scored as {task}')
        return task


# The options of the evaluations, and their values by name.

DETECTION = (
    *options_of(DetectionOptions),
    *options_of(BagResultsOptions),
    *(opt for opt in SOURCE if opt.name in {'layout', 'sequence', 'columns'}),
)
_OF_PLAYER = {
    *('layout', 'sequence', 'columns', 'deskew', 'undo_deskew', 'stereo', 'imu_from', 'imu_stamps'),
    *('start', 'end', 'preset', 'map', 'tf', 'ring_time', 'points', 'stack', 'images'),
    *('ground_truth_tree', 'ground_truth_map', 'ground_truth_base'),
    *('covariances', 'stereo_frame', 'color_encoding'),
}
_PLAYED = tuple(opt for opt in PLAY if opt.name in _OF_PLAYER)
LIVE = (*options_of(LiveOptions), *_PLAYED)
_OF_FOLDERS = {'layout', 'sequence', 'epoch'}
ODOMETRY = (
    *options_of(OdometryOptions),
    *(opt for opt in options_of(ReadOptions) if opt.name in _OF_FOLDERS),
)
TRACKING = (
    *options_of(BagResultsOptions),
    *(
        replace(opt, unset='all') if opt.name == 'sequence' else opt
        for opt in options_of(ReadOptions)
        if opt.name in {'sequence', 'epoch', 'period'}
    ),
)
"""Ground truth has the epoch and the period that it was played with."""
_COLLECTION = collection_options(
    'Ground truth and results are collections (a root, a quoted glob, or a .txt list): each result'
    ' is a unit; with -o OUT, a folder'
)
DETECTION_ALL = (*DETECTION, *_COLLECTION)
TRACKING_ALL = (*TRACKING, *_COLLECTION)
ODOMETRY_ALL = (*ODOMETRY, *_COLLECTION)

make_odometry_options = partial(make_with_source, ODOMETRY, OdometryOptions)
make_tracking_options = partial(make_with_source, TRACKING, BagResultsOptions)
"""Take values by name, and return the options of the source and those of the command."""


def make_detection_options(
    values: Mapping[str, object],
) -> tuple[ReadOptions, DetectionOptions, BagResultsOptions]:
    """Make the options of eval detection from values by name; None is the default.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsed = parse_values(values, DETECTION)
    return (
        make_options(ReadOptions, parsed),
        make_options(DetectionOptions, parsed),
        make_options(BagResultsOptions, parsed),
    )


def make_live_options(values: Mapping[str, object]) -> tuple[LiveOptions, dict[str, object]]:
    """Make the options of eval live from values by name, and those of its player by name.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    options = make_options(LiveOptions, parse_values(values, LIVE))
    played = {name: value for name, value in values.items() if name in _OF_PLAYER}
    make_play_settings(played)
    return options, played
