# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of one recording, and of several together."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from dataclasses import dataclass, field, fields
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.labelled_objects import SEMANTIC_NAMES
from ..files.threads import ordered_map, worker_count
from ..kitti.kitti_recording import no_calibration, rect_from_imu
from ..model.boxes import (
    DONT_CARE,
    LIMITS,
    OCCLUSIONS,
    Box,
    Difficulty,
    count_points,
    difficulty_of,
    has_cuboid,
    is_absurd,
)
from ..model.errors import KittiRos2Error, Loss, describe_error
from ..model.geometry import Transform
from ..model.recording import route_of
from ..model.samples import FrameLabels, Pose, Scan, cuboids_of
from ..model.streams import FRAME_STREAMS, Clock, Stream
from ..pictures.recording_frames import RecordingFrames

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

    import numpy.typing as npt

    from ..model.boxes import Cuboid
    from ..model.samples import Sample
    from ..pictures.recording_frames import RecordingFrames


# A histogram with mean, standard deviation and extremes, computed without storing the values.


@dataclass
class Distribution:
    """The distribution of the values added so far.

    Attributes:
        edges: Lower edges of the bins, ascending. A bin is [edge, next edge); the last is open, and
            the first also holds lower values.
        counts: Number of values in each bin.
        count: Number of all values.
        mean, deviation: Mean and standard deviation (of the population); NaN without values.
        least, greatest: Extremes; NaN without values.
    """

    edges: tuple[float, ...]
    counts: list[int] = field(init=False)
    count: int = field(default=0, init=False)
    mean: float = field(default=math.nan, init=False)
    least: float = field(default=math.nan, init=False)
    greatest: float = field(default=math.nan, init=False)
    _squares: float = field(default=0.0, init=False, repr=False)  # of deviations from the mean

    def __post_init__(self) -> None:
        self.counts = [0] * len(self.edges)

    @property
    def deviation(self) -> float:
        """The standard deviation; NaN without values."""
        return math.sqrt(self._squares / self.count) if self.count else math.nan

    @property
    def names(self) -> list[str]:
        """Names of the bins, such as 0-10 and 80+."""
        bounded = [f'{low:g}-{high:g}' for low, high in pairwise(self.edges)]
        return [*bounded, f'{self.edges[-1]:g}+']

    def add(self, value: float) -> None:
        """Add a value; skip one that is not finite."""
        if not math.isfinite(value):
            return
        self.counts[max(bisect_right(self.edges, value) - 1, 0)] += 1
        self._include(1, value, 0.0, value, value)

    def restore(
        self,
        counts: Iterable[int],
        *,
        count: int,
        mean: float,
        deviation: float,
        least: float,
        greatest: float,
    ) -> None:
        """Set the counts and moments of an equal distribution."""
        self.counts = list(counts)
        self.count, self.mean, self.least, self.greatest = count, mean, least, greatest
        self._squares = deviation * deviation * count

    def merge(self, other: Distribution) -> None:
        """Add all values of another distribution with the same bins."""
        self.counts = [one + two for one, two in zip(self.counts, other.counts, strict=True)]
        if other.count:
            values = other.count, other.mean, other._squares
            self._include(*values, other.least, other.greatest)

    def _include(
        self, count: int, mean: float, squares: float, least: float, greatest: float
    ) -> None:
        """Update the moments (Chan, Golub, LeVeque, "Updating Formulae ...", 1979)."""
        if not self.count:
            self.mean, self.least, self.greatest = mean, least, greatest
        apart = mean - self.mean
        before, self.count = self.count, self.count + count
        self.mean += apart * count / self.count
        self._squares += squares + apart * apart * before * count / self.count
        self.least, self.greatest = min(self.least, least), max(self.greatest, greatest)


# Statistics of labelled objects: counts by class, and their distributions.

DISTANCES_M = tuple(range(0, 85, 5))
SIZES_M = tuple(value / 4 for value in range(81))
POINTS = (0, 1, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
OBJECTS = tuple(range(31))
TRACK_FRAMES = (1, 2, 5, 10, 20, 50, 100, 200, 500)

DIFFICULTIES = (*(level.value for level in Difficulty), 'beyond')
"""The levels of the benchmark, and labels beyond them."""

_CUTS = (0.0, *(limits.truncated for limits in LIMITS.values()))
TRUNCATIONS = ('none', *(f'to {cut:.2f}' for cut in _CUTS[1:]), f'over {_CUTS[-1]:.2f}')
"""Truncation, by the limits of the levels of difficulty."""


def _zeros(names: Iterable[str]) -> Counter[str]:
    return Counter(dict.fromkeys(names, 0))


def _add_fields(own: ObjectStatistics | RouteStatistics, other: object) -> None:
    """Add the numbers, counts and distributions of a dataclass to those of another."""
    for own_field in fields(own):
        mine, theirs = getattr(own, own_field.name), getattr(other, own_field.name)
        if isinstance(mine, Counter):
            mine.update(theirs)
        elif isinstance(mine, Distribution):
            mine.merge(theirs)
        else:
            setattr(own, own_field.name, mine + theirs)


@dataclass
class ObjectStatistics:
    """The objects of one class; of DontCare regions only count, frames and most.

    Attributes:
        count: Number of labels.
        frames: Number of frames with one.
        most: Largest number in a frame.
        difficulty: Number by DIFFICULTIES, of labels with a 2D box, each at its easiest level.
        occlusion: Number by OCCLUSIONS, of labels with a value.
        truncation: Number by TRUNCATIONS, of labels with a value. Tracking has levels 0, 1 and 2
            instead of a fraction: 0 is none.
        distance_m: Horizontal distance of the box's middle from the sensor of the labels:
            camera 0 for label files, the scanner for tracklets and other boxes.
        length_m, width_m, height_m: Sizes of 3D boxes.
        points: Points of the scan inside a 3D box, if counted.
        tracks: Number of labelled frames of each track.
    """

    count: int = 0
    frames: int = 0
    most: int = 0
    difficulty: Counter[str] = field(default_factory=lambda: _zeros(DIFFICULTIES))
    occlusion: Counter[str] = field(default_factory=lambda: _zeros(OCCLUSIONS))
    truncation: Counter[str] = field(default_factory=lambda: _zeros(TRUNCATIONS))
    distance_m: Distribution = field(default_factory=partial(Distribution, DISTANCES_M))
    length_m: Distribution = field(default_factory=partial(Distribution, SIZES_M))
    width_m: Distribution = field(default_factory=partial(Distribution, SIZES_M))
    height_m: Distribution = field(default_factory=partial(Distribution, SIZES_M))
    points: Distribution = field(default_factory=partial(Distribution, POINTS))
    tracks: Distribution = field(default_factory=partial(Distribution, TRACK_FRAMES))

    def add_frame(self, labels: Sequence[Box | Cuboid]) -> None:
        """Add the labels of this class in one frame."""
        self.count += len(labels)
        self.frames += 1
        self.most = max(self.most, len(labels))
        for label in labels:
            if label.class_name == DONT_CARE:
                continue
            if isinstance(label, Box):
                self._add_box(label)
            else:
                self._add_solid(label.velo_T_box.translation[:2].tolist(), label.size_lwh)

    def _add_box(self, box: Box) -> None:
        left, top, right, bottom = box.box_2d
        if right > left and bottom > top:
            level = difficulty_of(box)
            self.difficulty[DIFFICULTIES[-1] if level is None else level.value] += 1
        if 0 <= box.occluded < len(OCCLUSIONS):
            self.occlusion[OCCLUSIONS[box.occluded]] += 1
        if box.truncated >= 0:
            self.truncation[TRUNCATIONS[bisect_left(_CUTS, box.truncated)]] += 1
        if has_cuboid(box) and not is_absurd(box):
            height, width, length = box.size_hwl
            self._add_solid((box.location[0], box.location[2]), (length, width, height))

    def _add_solid(self, position: Iterable[float], size_lwh: tuple[float, float, float]) -> None:
        self.distance_m.add(math.hypot(*position))
        sizes = (self.length_m, self.width_m, self.height_m)
        for distribution, size in zip(sizes, size_lwh, strict=True):
            distribution.add(size)

    def merge(self, other: ObjectStatistics) -> None:
        """Add the objects of another recording."""
        most = max(self.most, other.most)
        _add_fields(self, other)
        self.most = most


class ObjectTally:
    """Counts the labels of a recording by frame.

    Attributes:
        classes: Statistics by class name.
        a_frame: Number of objects in a labelled frame, without DontCare.
    """

    def __init__(self) -> None:
        self.classes: dict[str, ObjectStatistics] = defaultdict(ObjectStatistics)
        self.a_frame = Distribution(OBJECTS)
        self._tracks: Counter[tuple[str, int]] = Counter()

    def add(
        self, labels: Iterable[Box | Cuboid], box_points: Iterable[tuple[str, int]] = ()
    ) -> None:
        """Add the labels of a frame, possibly none, and the points inside each 3D box."""
        by_class: dict[str, list[Box | Cuboid]] = defaultdict(list)
        for label in labels:
            by_class[label.class_name].append(label)
            if label.track_id is not None and label.track_id >= 0:
                self._tracks[label.class_name, label.track_id] += 1
        for class_name, boxes in by_class.items():
            self.classes[class_name].add_frame(boxes)
        self.a_frame.add(
            sum(len(boxes) for class_name, boxes in by_class.items() if class_name != DONT_CARE)
        )
        for class_name, count in box_points:
            self.classes[class_name].points.add(count)

    def finish(self) -> None:
        """Add the tracks, after the last frame."""
        for (class_name, _), frames in self._tracks.items():
            self.classes[class_name].tracks.add(frames)


# Statistics of the route of the vehicle: length, speed, turn rate.

SPEEDS_M_S = tuple(range(41))
TURN_RATES_DEG_S = tuple(range(61))


@dataclass
class RouteStatistics:
    """The route of the vehicle; several recordings are added, not joined.

    Attributes:
        poses: Number of poses.
        length_m: Length without jumps. With oxts over the ground, of the GPS/IMU; with files of
            poses in space, of what their poses are of: each as KITTI's own tools compute it.
        duration_s: Time from the first pose to the last; 0 without time stamps.
        jumps: Number of steps faster than 100 m/s, left out of the route.
        speed_m_s: Speed at each pose; empty without speeds and times.
        turn_rate_deg_s: Turn rate at each pose, to the left or right; empty as speed_m_s.
    """

    poses: int = 0
    length_m: float = 0.0
    duration_s: float = 0.0
    jumps: int = 0
    speed_m_s: Distribution = field(default_factory=partial(Distribution, SPEEDS_M_S))
    turn_rate_deg_s: Distribution = field(default_factory=partial(Distribution, TURN_RATES_DEG_S))

    def merge(self, other: RouteStatistics) -> None:
        """Add the route of another recording."""
        _add_fields(self, other)


class RouteTrace:
    """The poses of a recording, collected frame by frame."""

    def __init__(self, source: RecordingFrames) -> None:
        self._stamp_of = dict(zip(source.numbers.tolist(), source.stamps_ns.tolist(), strict=True))
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        recording = source.recording
        self._clock, self._on_ground = recording.clock, False
        self._imu_t_sensor = Transform.identity()
        if recording.layout is not None:
            self._on_ground = recording.layout.traits.packet_poses
            if recording.layout.traits.camera_poses:
                self._imu_t_sensor = rect_from_imu(recording.calibration(0)).inverse()

    def add(self, number: int, pose: Pose) -> None:
        """Add the pose of a frame."""
        position = (pose.world_T_imu @ self._imu_t_sensor).translation
        world_T_sensor = Transform(pose.world_T_imu.rotation, position)
        self._stamps.append(self._stamp_of[number])
        self._poses.append(Pose(world_T_sensor, pose.velocity, pose.angular_velocity))

    def statistics(self) -> RouteStatistics | None:
        """Return the statistics of the route; None for less than two poses."""
        route = route_of(self._stamps, self._poses)
        if route is None:
            return None
        length_m = route.ground_m if self._on_ground else route.length_m
        statistics = RouteStatistics(len(route.positions), length_m, jumps=route.jumps)
        timed = self._clock is not Clock.NOMINAL
        if timed:
            statistics.duration_s = route.duration_s
        if timed or route.measured:
            for speed in route.speeds_m_s.tolist():
                statistics.speed_m_s.add(speed)
            for rate in np.degrees(np.abs(route.turn_rates_rad_s)).tolist():
                statistics.turn_rate_deg_s.add(rate)
        return statistics


# The facts of one frame for statistics: labels, pose, counts of points.


@dataclass
class FrameFacts:
    """The facts of one frame, without its scan.

    Attributes:
        number: The frame.
        labels: Labels; None if missing or unreadable.
        pose: Pose of the vehicle, if any.
        scan_points: Number of points of the scan, if read.
        box_points: Class and number of points inside each 3D box, if the scan is read.
        point_classes: Number of points of a labelled scan by SemanticKITTI's name.
        missing: Missing or unreadable data: stream and reason, one line.
    """

    number: int
    labels: Sequence[Box | Cuboid] | None = None
    pose: Pose | None = None
    scan_points: int | None = None
    box_points: list[tuple[str, int]] = field(default_factory=list)
    point_classes: Counter[str] = field(default_factory=Counter)
    missing: list[tuple[str, str]] = field(default_factory=list)


def read_facts(source: RecordingFrames, number: int, streams: Collection[Stream]) -> FrameFacts:
    """Read some streams of a frame: labels, poses, scans."""
    facts = FrameFacts(number)
    samples: dict[Stream, Sample | None] = {}
    for stream in streams:
        try:
            samples[stream] = source.read(stream, number)
        except (KittiRos2Error, OSError) as error:
            facts.missing.append((stream.value, describe_error(error)))
    labels, pose, scan = (samples.get(kind) for kind in (Stream.LABELS, Stream.POSE, Stream.SCAN))
    if isinstance(labels, FrameLabels):
        facts.labels = [*labels.cuboids, *(box for box in labels.boxes if box is not None)]
        facts.missing += [(Stream.LABELS.value, reason) for reason in labels.missing.values()]
    if isinstance(pose, Pose):
        facts.pose = pose
    if isinstance(scan, Scan):
        facts.scan_points = len(scan.points)
        facts.missing += [(Stream.SCAN.value, reason) for reason in scan.missing.values()]
        if scan.labels is not None and not scan.missing:
            facts.point_classes = _count_classes(scan.labels)
        if isinstance(labels, FrameLabels):
            _count_in_boxes(source, labels, scan, facts)
    return facts


def _count_classes(labels: npt.NDArray[np.uint32]) -> Counter[str]:
    counts = np.bincount(labels & 0xFFFF)
    class_ids = np.flatnonzero(counts).tolist()
    class_names = [SEMANTIC_NAMES.get(number, f'class {number}') for number in class_ids]
    return Counter(dict(zip(class_names, counts[class_ids].tolist(), strict=True)))


def _count_in_boxes(
    source: RecordingFrames, labels: FrameLabels, scan: Scan, facts: FrameFacts
) -> None:
    """Count the points inside the 3D boxes of a frame."""
    calibration = source.calibration(facts.number) or no_calibration('')
    try:
        cuboids = cuboids_of(labels, calibration)
    except ValueError as error:
        reasons = source.frame(facts.number, frozenset()).missing.values()
        reason = f'{next(iter(reasons), error)}; points in boxes are not counted'
        facts.missing.append((Stream.CALIBRATION.value, reason))
        return
    counts = count_points(cuboids, scan.points)
    facts.box_points = [
        (cuboid.class_name, count) for cuboid, count in zip(cuboids, counts, strict=True)
    ]


SCAN_POINTS = tuple(range(0, 160_000, 10_000))


@dataclass
class RecordingStatistics:
    """The statistics of a drive, split, sequence or bag, or of several together.

    Attributes:
        name: Name in the set; empty for all together.
        kind: Layout, or bag.
        frames: Number of frames.
        labelled: Number of frames with labels, also empty ones.
        objects: Number of objects of all classes, without DontCare.
        samples: Number of samples by stream: scan, image_2, oxts, pose, ...
        classes: The objects by class, the most frequent first.
        objects_a_frame: Number of objects in a labelled frame, without DontCare.
        points_a_scan: Number of points of a scan, if scans are read.
        point_classes: Number of points by SemanticKITTI's class, the most frequent first.
        route: The route, None without poses.
        losses: Missing or damaged data; all else is counted.
        notes: Lines that cost no data.
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
    """Sort the classes, the most frequent first, and add them up."""
    classes, points = statistics.classes.items(), statistics.point_classes.items()
    statistics.classes = dict(sorted(classes, key=lambda pair: (-pair[1].count, pair[0])))
    statistics.point_classes = Counter(dict(sorted(points, key=lambda pair: (-pair[1], pair[0]))))
    statistics.objects = sum(objects.count for name, objects in classes if name != DONT_CARE)


def count_recording(
    source: RecordingFrames,
    name: str,
    kind: str,
    *,
    scans: bool,
    step: Callable[[], None],
) -> RecordingStatistics:
    """Count the contents of a recording by frame.

    Args:
        source: Frames of the recording.
        name: Name as in RecordingStatistics.
        kind: Kind as in RecordingStatistics.
        scans: True reads the scans.
        step: Called after each frame.
    """
    streams = [Stream.LABELS, Stream.POSE, *([Stream.SCAN] if scans else [])]
    statistics = RecordingStatistics(
        name, kind, frames=len(source.numbers), samples=_samples(source), notes=(*source.notes,)
    )
    tally, losses = ObjectTally(), _Losses()
    route = RouteTrace(source)
    for facts in _facts(source, streams):
        losses.add(facts)
        if facts.labels is not None or facts.number in source.without_objects:
            statistics.labelled += 1
            tally.add(facts.labels or (), facts.box_points)
        if facts.scan_points is not None:
            statistics.points_a_scan.add(facts.scan_points)
        statistics.point_classes.update(facts.point_classes)
        if facts.pose is not None:
            route.add(facts.number, facts.pose)
        step()
    tally.finish()
    statistics.classes, statistics.objects_a_frame = tally.classes, tally.a_frame
    statistics.route = route.statistics()
    statistics.losses = (*source.losses, *losses.losses())
    _finish(statistics)
    return statistics


def _facts(source: RecordingFrames, streams: Collection[Stream]) -> Iterator[FrameFacts]:
    """Yield the facts of all frames; scans are read in parallel."""
    numbers = source.numbers.tolist()
    if Stream.SCAN in streams:
        return ordered_map(
            lambda number: read_facts(source, number, streams), numbers, worker_count()
        )
    return (read_facts(source, number, streams) for number in numbers)


def _samples(source: RecordingFrames) -> Counter[str]:
    """Return the number of samples by sensor; poses that oxts give do not count."""
    counts = {stream.value: len(index) for stream, index in source.recording.streams.items()}
    absent = {Stream.LABELS} | ({Stream.POSE} if Stream.OXTS.value in counts else set())
    sensors = [stream.value for stream in FRAME_STREAMS if stream not in absent]
    return Counter({stream: counts[stream] for stream in sensors if stream in counts})


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
