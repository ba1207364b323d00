# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of one recording, and of several together."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from ..files.workers import ordered_map, worker_count
from ..model.boxes import DONT_CARE
from ..model.losses import Loss
from ..model.streams import FRAME_STREAMS, Stream
from ..pictures.recording_frames import RecordingFrames
from .distribution import Distribution
from .frame_facts import read_facts
from .object_statistics import OBJECTS, ObjectStatistics, ObjectTally
from .route_statistics import RouteStatistics, RouteTrace

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

    from ..pictures.frame import FrameSource
    from .frame_facts import FrameFacts

SCAN_POINTS = tuple(range(0, 160_000, 10_000))


@dataclass
class RecordingStatistics:
    """The statistics of a drive, split, sequence or bag, or of several together.

    Attributes:
        name: Its name in the set; empty for all together.
        kind: Layout, or bag.
        frames: Number of frames.
        labelled: Number of frames with labels, also of no object.
        objects: Number of objects of all classes, without DontCare.
        samples: Number of samples by stream: scan, image_2, oxts, pose, ...
        classes: The objects by class, the most frequent first.
        objects_a_frame: Number of objects in a labelled frame, without DontCare.
        points_a_scan: Number of points of a scan, if scans were read.
        point_classes: Number of points by SemanticKITTI's class, the most frequent first.
        route: The route, None without poses.
        losses: Missing or damaged data; all else is counted.
        notes: Other remarks.
    """

    name: str
    kind: str
    frames: int = 0
    labelled: int = 0
    objects: int = 0
    samples: Counter[str] = field(default_factory=Counter)
    classes: dict[str, ObjectStatistics] = field(default_factory=dict)
    objects_a_frame: Distribution = field(default_factory=partial(Distribution, OBJECTS))
    points_a_scan: Distribution = field(default_factory=partial(Distribution, SCAN_POINTS))
    point_classes: Counter[str] = field(default_factory=Counter)
    route: RouteStatistics | None = None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def merged(parts: Sequence[RecordingStatistics]) -> RecordingStatistics:
    """Return the statistics of several recordings together."""
    whole = RecordingStatistics('', ', '.join(dict.fromkeys(part.kind for part in parts)))
    for part in parts:
        whole.frames += part.frames
        whole.labelled += part.labelled
        whole.samples.update(part.samples)
        for class_name, objects in part.classes.items():
            whole.classes.setdefault(class_name, ObjectStatistics()).merge(objects)
        whole.objects_a_frame.merge(part.objects_a_frame)
        whole.points_a_scan.merge(part.points_a_scan)
        whole.point_classes.update(part.point_classes)
        if part.route is not None:
            whole.route = whole.route or RouteStatistics()
            whole.route.merge(part.route)
        whole.losses += part.losses
        whole.notes += part.notes
    _finish(whole)
    return whole


def _finish(statistics: RecordingStatistics) -> None:
    """Put classes in order, the most frequent first, and add them up."""
    classes, points = statistics.classes.items(), statistics.point_classes.items()
    statistics.classes = dict(sorted(classes, key=lambda each: (-each[1].count, each[0])))
    statistics.point_classes = Counter(dict(sorted(points, key=lambda each: (-each[1], each[0]))))
    statistics.objects = sum(each.count for class_name, each in classes if class_name != DONT_CARE)


def count_recording(
    source: FrameSource,
    name: str,
    kind: str,
    *,
    scans: bool,
    step: Callable[[], None],
) -> RecordingStatistics:
    """Count what is in a recording, frame by frame.

    Args:
        source: Its frames.
        name: As in RecordingStatistics.
        kind: The same.
        scans: Whether to read the scans.
        step: Called after each frame.
    """
    wanted = [Stream.LABELS, Stream.POSE, *([Stream.SCAN] if scans else [])]
    found = RecordingStatistics(
        name, kind, frames=len(source.numbers), samples=_samples(source), notes=(*source.notes,)
    )
    tally, losses = ObjectTally(), _Losses()
    route = RouteTrace(source)
    empty = source.without_objects if isinstance(source, RecordingFrames) else frozenset()
    for facts in _facts(source, wanted):
        losses.add(facts)
        if facts.labels is not None or facts.number in empty:
            found.labelled += 1
            tally.add(facts.labels or (), facts.box_points)
        if facts.scan_points is not None:
            found.points_a_scan.add(facts.scan_points)
        found.point_classes.update(facts.point_classes)
        if facts.pose is not None:
            route.add(facts.number, facts.pose)
        step()
    tally.finish()
    found.classes, found.objects_a_frame = tally.classes, tally.a_frame
    found.route = route.statistics()
    found.losses = (*source.losses, *losses.losses())
    _finish(found)
    return found


def _facts(source: FrameSource, wanted: Collection[Stream]) -> Iterator[FrameFacts]:
    """Yield the facts of all frames; scans are read in parallel."""
    numbers = source.numbers.tolist()
    if Stream.SCAN in wanted:
        return ordered_map(
            lambda number: read_facts(source, number, wanted), numbers, worker_count()
        )
    return (read_facts(source, number, wanted) for number in numbers)


def _samples(source: FrameSource) -> Counter[str]:
    """Return the number of samples of the sensors; poses count if they are not made from oxts."""
    if isinstance(source, RecordingFrames):
        known = {stream.value: len(index) for stream, index in source.recording.streams.items()}
    else:
        known = {stream: len(numbers) for stream, numbers in source.streams.items()}
    absent = {Stream.LABELS} | ({Stream.POSE} if Stream.OXTS.value in known else set())
    sensors = [each.value for each in FRAME_STREAMS if each not in absent]
    return Counter({stream: known[stream] for stream in sensors if stream in known})


class _Losses:
    """Missing data of frames by stream and reason."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, str], list[int]] = {}

    def add(self, facts: FrameFacts) -> None:
        for stream, reason in facts.missing:
            self._numbers.setdefault((stream, reason), []).append(facts.number)

    def losses(self) -> Iterable[Loss]:
        for (stream, reason), numbers in self._numbers.items():
            yield Loss(stream, len(numbers), reason, tuple(numbers))
