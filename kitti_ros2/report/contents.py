# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The contents of a report as plain values; page.py lays them out."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import DONT_CARE, OCCLUSIONS
from ..model.errors import format_count

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..drawing.labelled_objects import LabelledObject
    from ..evaluation.detection import DetectionScores
    from ..model.geometry import Float64Array
    from ..model.recording import Route, StreamIndex
    from ..model.samples import Int64Array
    from ..model.streams import Clock
    from .overview import Overview


_ONE_CLOCK_NS = 60_000_000_000
"""Maximum plausible delay from stamp to log time; a simulation's clock begins at 0."""


class Severity(Enum):
    """Severity of an issue, worst first."""

    LOSS = 'Lost or damaged'
    WARNING = 'Warning'
    NOTE = 'Note'


@dataclass(frozen=True)
class Issue:
    """A loss, a warning or a note about the recording.

    Attributes:
        severity: Severity.
        where: Stream, topic or part; empty for the whole recording.
        text: One line.
    """

    severity: Severity
    where: str
    text: str

    @property
    def is_loss(self) -> bool:
        """True if data is lost or damaged."""
        return self.severity is Severity.LOSS


@dataclass(frozen=True, eq=False)
class StreamFacts:
    """One stream of a recording, or topic of a bag.

    Attributes:
        name: Stream or topic.
        detail: Its frames, or its message type.
        timing: Its rate, jitter and gaps.
        files: Number of its files; None in a bag.
        size_bytes: Total size of its samples; None if unknown.
        facts: Other facts, such as image sizes; a few words each.
        delay_ns: Median time from a message's stamp to its log time; None if timing is of log
            times, or in a folder.
    """

    name: str
    detail: str
    timing: Timing
    files: int | None = None
    size_bytes: int | None = None
    facts: tuple[str, ...] = ()
    delay_ns: int | None = None

    @property
    def clock_offset_ns(self) -> int:
        """The offset from its stamps to log times: 0, unless stamps are of another clock."""
        delay_ns = self.delay_ns or 0
        return delay_ns if abs(delay_ns) > _ONE_CLOCK_NS else 0


@dataclass(frozen=True)
class ReportPicture:
    """An encoded image.

    Attributes:
        data: JPEG.
        width, height: Pixels.
        alt: Alternative text.
        caption: Text below it.
    """

    data: bytes
    width: int
    height: int
    alt: str
    caption: str


@dataclass(frozen=True)
class Scene:
    """The pictures of one frame.

    Attributes:
        number: Frame number.
        stamp_ns: Nanoseconds since 1970.
        words: Its contents, a few words each.
        camera: The image of a camera, with the boxes of its objects.
        points: The scan over the same image.
        above: Scan and boxes from above.
    """

    number: int
    stamp_ns: int
    words: tuple[str, ...]
    camera: ReportPicture | None
    points: ReportPicture | None
    above: ReportPicture | None


NUMBER = 'num'
TEXT = ''
LONG = 'wide'
NAME = 'name'


_MOST_ROWS = 200


class Table(NamedTuple):
    """A table of the page; the first cell of a row names it.

    The page has the first rows only and counts the others: a bag may have thousands of frames.

    Attributes:
        caption: Its caption.
        columns: Heading and kind (NUMBER, TEXT, LONG or NAME) of each.
        rows: The cells; the section's template formats those that are not text.
        total: A last row with totals.
    """

    caption: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[object]]
    total: Sequence[str] = ()

    @property
    def shown(self) -> Sequence[Sequence[object]]:
        """The rows that the page has."""
        return self.rows[:_MOST_ROWS]

    @property
    def rest(self) -> str:
        """The number of the others in words, empty if there are none."""
        more = len(self.rows) - len(self.shown)
        return f'... and {more:,} more' if more else ''


@dataclass(frozen=True, eq=False)
class Report:
    """The contents of a report.

    Attributes:
        overview: Kind, name, extent, calibration; shown by info, too.
        streams: Streams or topics.
        issues: Worst first.
        frames: Number of frames; None if there is no reference to count them.
        route: None without poses.
        classes: None without labels.
        projections: Points of the scanner over images.
        scenes: A few frames spread over the recording.
        scores: Scores of a detector's results, if given.
    """

    overview: Overview
    streams: Sequence[StreamFacts]
    issues: Sequence[Issue] = ()
    frames: int | None = None
    route: Route | None = None
    classes: ClassStatistics | None = None
    projections: Sequence[ReportPicture] = ()
    scenes: Sequence[Scene] = ()
    scores: DetectionScores | None = None

    @property
    def clock(self) -> Clock:
        """The meaning of the stamps."""
        return self.overview.clock

    @property
    def verdict(self) -> str:
        """The number of losses and warnings in words."""
        losses, warnings = self._count(Severity.LOSS), self._count(Severity.WARNING)
        counts = [f'{losses} loss{"" if losses == 1 else "es"}'] if losses else []
        counts += [format_count(warnings, 'warning')] if warnings else []
        return ' and '.join(counts) or 'nothing is missing, damaged or out of order'

    @property
    def notes(self) -> int:
        """The number of issues that are notes."""
        return self._count(Severity.NOTE)

    @property
    def sound(self) -> bool:
        """True if no data is lost or damaged."""
        return not self._count(Severity.LOSS)

    def _count(self, severity: Severity) -> int:
        return sum(issue.severity is severity for issue in self.issues)


# Statistics of labels.


@dataclass(frozen=True, eq=False)
class ClassFacts:
    """The objects of one class.

    Attributes:
        class_name: Class, such as Car.
        count: Number of boxes.
        frames: Number of frames with one.
        most: Maximum number in a frame.
        tracks: Number of track ids; None without any.
        distances_m: (N,) horizontal distance from the scanner, of those with a 3D box.
        occlusions: Number for each of OCCLUSIONS; None if unknown.
        truncated: Number truncated by the image edge; None if unknown.
    """

    class_name: str
    count: int
    frames: int
    most: int
    tracks: int | None
    distances_m: Float64Array
    occlusions: tuple[int, ...] | None
    truncated: int | None


@dataclass(frozen=True, eq=False)
class ClassStatistics:
    """The labels of all frames.

    Attributes:
        classes: Most frequent first.
        frames: Number of frames.
        labelled: Number of frames with an object.
        dont_care: Number of regions without labels.
    """

    classes: tuple[ClassFacts, ...]
    frames: int
    labelled: int
    dont_care: int

    @property
    def count(self) -> int:
        """Number of all objects."""
        return sum(facts.count for facts in self.classes)


@dataclass
class _ClassCounts:
    count: int = 0
    frames: int = 0
    most: int = 0
    tracks: set[int] = field(default_factory=set)
    distances_m: list[float] = field(default_factory=list)
    occlusions: Counter[int] = field(default_factory=Counter)
    truncation_known: int = 0
    truncated: int = 0

    def add(self, objects: Sequence[LabelledObject]) -> None:
        """Add the objects of this class in one frame."""
        self.count += len(objects)
        self.frames += 1
        self.most = max(self.most, len(objects))
        for label in objects:
            if label.track_id is not None:
                self.tracks.add(label.track_id)
            if label.cuboid is not None:
                x, y, _ = label.cuboid.velo_T_box.translation.tolist()
                self.distances_m.append(float(np.hypot(x, y)))
            if label.occluded is not None:
                self.occlusions[label.occluded] += 1
            if label.truncated is not None:
                self.truncation_known += 1
                self.truncated += label.truncated > 0

    def facts(self, class_name: str) -> ClassFacts:
        """Return the facts of the objects so far."""
        labelled = sum(self.occlusions.values())
        levels = range(len(OCCLUSIONS))
        return ClassFacts(
            class_name,
            self.count,
            self.frames,
            self.most,
            len(self.tracks) or None,
            np.array(self.distances_m),
            tuple(self.occlusions[level] for level in levels) if labelled else None,
            self.truncated if self.truncation_known else None,
        )


class ClassTally:
    """Counts labels frame by frame."""

    def __init__(self) -> None:
        self._counts: dict[str, _ClassCounts] = defaultdict(_ClassCounts)
        self._frames = 0
        self._labelled = 0
        self._dont_care = 0

    def add(self, objects: Iterable[LabelledObject]) -> None:
        """Add a frame, also one without objects."""
        by_class: dict[str, list[LabelledObject]] = defaultdict(list)
        for label in objects:
            by_class[label.class_name].append(label)
        self._dont_care += len(by_class.pop(DONT_CARE, ()))
        self._frames += 1
        self._labelled += bool(by_class)
        for class_name, labels in by_class.items():
            self._counts[class_name].add(labels)

    def statistics(self) -> ClassStatistics:
        """Return the statistics of the frames so far."""
        facts = (tally.facts(class_name) for class_name, tally in self._counts.items())
        ordered = sorted(facts, key=lambda of_class: (-of_class.count, of_class.class_name))
        return ClassStatistics(tuple(ordered), self._frames, self._labelled, self._dont_care)


def histogram(values: Float64Array, edges: Sequence[float]) -> list[int]:
    """Count values in each bin [edge, next edge); the last bin is open."""
    counts, _ = np.histogram(values, [*edges, np.inf])
    return [int(count) for count in counts]


def spread(count: int, most: int) -> list[int]:
    """Return up to most evenly spaced indices of 0 .. count-1, including first and last."""
    if not count:
        return []
    indices = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    return [int(index) for index in np.unique(indices)]


# Rate, jitter and gaps of a stream; comparison of its numbers with another stream's in time.

GAP_PERIODS = 1.5
"""A distance of more periods than this is a gap; one lost sample makes it 2."""

_EVEN = 0.25
_MOSTLY = 0.6
_FEWEST = 3


@dataclass(frozen=True)
class Gap:
    """A gap: missing samples.

    Attributes:
        at_ns: The stamp before it.
        length_ns: Distance to the next stamp.
        missing: Number of missing samples, by the usual period.
    """

    at_ns: int
    length_ns: int
    missing: int


@dataclass(frozen=True, eq=False)
class Timing:
    """The timing of the samples of a stream.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        period_ns: Median distance of neighbours, None with less than two.
        rate_hz: Samples per second between the first and the last; None if they are equal.
        jitter_ns: 95th percentile of the deviation of distances from the median, without gaps; None
            with less than three stamps.
        regular: True if most distances are near the median, so that gaps are meaningful.
        gaps: In order of time; none unless regular.
        repeated: Number of stamps equal to the one before.
        backward: Number of samples stamped earlier than the one before.
    """

    stamps_ns: Int64Array
    period_ns: int | None = None
    rate_hz: float | None = None
    jitter_ns: int | None = None
    regular: bool = False
    gaps: tuple[Gap, ...] = ()
    repeated: int = 0
    backward: int = 0

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def intervals_ns(self) -> Int64Array:
        """(N-1,) distances of neighbours, nanoseconds."""
        distances: Int64Array = np.diff(self.stamps_ns)
        return distances


def timing_of(stamps_ns: Int64Array) -> Timing:
    """Compute the timing of (N,) stamps in the order of the samples."""
    backward = int(np.count_nonzero(np.diff(stamps_ns) < 0))
    stamps = np.sort(stamps_ns)
    distances = np.diff(stamps)
    if not len(distances):
        return Timing(stamps)
    period = int(np.median(distances))
    span = int(stamps[-1] - stamps[0])
    near = np.abs(distances - period) <= _EVEN * period
    regular = len(distances) >= _FEWEST and period > 0 and bool(near.mean() >= _MOSTLY)
    wide = distances > GAP_PERIODS * period if regular else np.zeros(len(distances), np.bool_)
    return Timing(
        stamps,
        period_ns=period,
        rate_hz=len(distances) * 1e9 / span if span else None,
        jitter_ns=_jitter(distances[~wide], period),
        regular=regular,
        gaps=tuple(
            Gap(int(stamps[index]), int(distances[index]), round(distances[index] / period) - 1)
            for index in np.flatnonzero(wide).tolist()
        ),
        repeated=int(np.count_nonzero(distances == 0)),
        backward=backward,
    )


def _jitter(distances: Int64Array, period: int) -> int | None:
    if len(distances) < 2:
        return None
    return int(np.percentile(np.abs(distances - period), 95))


def shifted_numbers(stream: StreamIndex, reference: StreamIndex) -> tuple[list[int], int]:
    """Compare the samples of a stream with those of a reference with the same file number.

    Returns:
        The file numbers that are nearer to another sample of the reference, and the number of all
        common ones. A sample is nearer to another if it is more than half a period of the reference
        away from its own: this detects files renumbered without their stamps.
    """
    common, rows, reference_rows = np.intersect1d(
        stream.numbers, reference.numbers, assume_unique=True, return_indices=True
    )
    offsets = stream.stamps_ns[rows] - reference.stamps_ns[reference_rows]
    period = timing_of(reference.stamps_ns).period_ns
    shifted = common[np.abs(offsets) > period / 2] if period else []
    return [int(number) for number in shifted], len(common)
