# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How evenly a stream comes, how far a route goes, what is labelled: numbers only."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...boxes import DONT_CARE

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ...drawing.objects import LabelledObject
    from ...geometry import Float64Array
    from ...samples import Int64Array, StreamIndex

GAP_PERIODS = 1.5
"""A distance of so many periods is a gap: one sample lost makes it 2."""

_EVEN = 0.25
_MOSTLY = 0.6
_FEWEST = 3
_STEP_LIMIT_M_S = 100.0

OCCLUSIONS = ('visible', 'partly occluded', 'largely occluded', 'unknown')
"""By the number in a label file (readme.txt of the object devkit)."""


@dataclass(frozen=True)
class Gap:
    """A place where samples are lacking.

    Attributes:
        at_ns: The stamp after which it comes.
        length_ns: To the next stamp.
        lacking: How many samples would have been there at the usual period.
    """

    at_ns: int
    length_ns: int
    lacking: int


@dataclass(frozen=True, eq=False)
class Timing:
    """How evenly the samples of a stream come.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        period_ns: Median distance of neighbours, None with less than two.
        rate_hz: Samples per second between the first and the last; None where that is no time.
        jitter_ns: 95 of 100 distances differ from the median by no more, gaps left out; None with
            less than three.
        regular: Whether most distances are near the median, so that gaps mean something.
        gaps: In order of time; none unless regular.
        repeated: Stamps that equal one before them.
        backward: Samples stamped earlier than the one before them.
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
    """The timing of (N,) stamps in the order of the samples."""
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


@dataclass(frozen=True)
class Pairing:
    """How the samples of a stream lie to those of another that have the same file number.

    Attributes:
        pairs: How many have the same number.
        offset_ns: Median of the stream's stamp less the other's.
        numbers: Those nearer to a sample of the other stream with another number.
    """

    pairs: int
    offset_ns: int
    numbers: tuple[int, ...]


def pairing_of(stream: StreamIndex, reference: StreamIndex) -> Pairing | None:
    """The pairing of a stream with a reference by file number; None where no number is common.

    A sample is nearer to another frame where it is more than half a period of the reference from
    its own: files renumbered without their stamps show so.
    """
    common, mine, theirs = np.intersect1d(
        stream.numbers, reference.numbers, assume_unique=True, return_indices=True
    )
    if not len(common):
        return None
    offsets = stream.stamps_ns[mine] - reference.stamps_ns[theirs]
    period = timing_of(reference.stamps_ns).period_ns
    shifted = np.abs(offsets) > period / 2 if period else np.zeros(len(common), np.bool_)
    return Pairing(len(common), int(np.median(offsets)), tuple(common[shifted].tolist()))


@dataclass(frozen=True, eq=False)
class Route:
    """Where the vehicle went.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        positions: (N, 3) x y z in metres, in map.
        jumps: Steps that would need more than 100 m/s; not part of the length.
    """

    stamps_ns: Int64Array
    positions: Float64Array
    jumps: int = 0
    length_m: float = 0.0

    @property
    def duration_s(self) -> float:
        """Seconds from the first position to the last."""
        return float(self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9

    @property
    def net_m(self) -> float:
        """Metres from the first position straight to the last."""
        return float(np.linalg.norm(self.positions[-1] - self.positions[0]))


def route_of(stamps_ns: Sequence[int], positions: Sequence[Float64Array]) -> Route | None:
    """The route through (3,) positions in metres; None for less than two finite ones."""
    stamps = np.array(stamps_ns, dtype=np.int64)
    places = np.array(positions, dtype=np.float64).reshape(-1, 3)
    good = np.isfinite(places).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(stamps[good], kind='stable')]
    stamps, places = stamps[order], places[order]
    if len(places) < 2:
        return None
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    jumps = steps > np.maximum(np.diff(stamps) / 1e9, 1e-3) * _STEP_LIMIT_M_S
    return Route(stamps, places, int(np.count_nonzero(jumps)), float(steps[~jumps].sum()))


@dataclass(frozen=True, eq=False)
class ClassFacts:
    """The objects of one class.

    Attributes:
        kind: Class name.
        count: Boxes.
        frames: Frames that have one.
        most: Most of them in a frame.
        tracks: Different track ids; None where there are none.
        distances_m: (N,) from the scanner over the ground, of those with a 3D box.
        occlusions: How many have each of OCCLUSIONS; None where it is not told.
        truncated: How many are cut by the image; None where it is not told.
    """

    kind: str
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
        frames: Frames that were looked at.
        labelled: Those with an object.
        dont_care: Regions without labels.
    """

    classes: tuple[ClassFacts, ...]
    frames: int
    labelled: int
    dont_care: int

    @property
    def count(self) -> int:
        """All objects."""
        return sum(each.count for each in self.classes)


@dataclass
class _Tally:
    count: int = 0
    frames: int = 0
    most: int = 0
    tracks: set[int] = field(default_factory=set)
    distances_m: list[float] = field(default_factory=list)
    occlusions: Counter[int] = field(default_factory=Counter)
    truncation_told: int = 0
    truncated: int = 0

    def add(self, objects: Sequence[LabelledObject]) -> None:
        """Take those of one frame, all of this class."""
        self.count += len(objects)
        self.frames += 1
        self.most = max(self.most, len(objects))
        for each in objects:
            if each.track_id is not None:
                self.tracks.add(each.track_id)
            if each.cuboid is not None:
                x, y, _ = each.cuboid.velo_T_box.translation.tolist()
                self.distances_m.append(float(np.hypot(x, y)))
            if each.occluded is not None:
                self.occlusions[each.occluded] += 1
            if each.truncated is not None:
                self.truncation_told += 1
                self.truncated += each.truncated > 0

    def facts(self, kind: str) -> ClassFacts:
        """What was taken."""
        told = sum(self.occlusions.values())
        places = range(len(OCCLUSIONS))
        return ClassFacts(
            kind,
            self.count,
            self.frames,
            self.most,
            len(self.tracks) or None,
            np.array(self.distances_m),
            tuple(self.occlusions[place] for place in places) if told else None,
            self.truncated if self.truncation_told else None,
        )


class ClassTally:
    """Labels, frame by frame."""

    def __init__(self) -> None:
        self._tallies: dict[str, _Tally] = defaultdict(_Tally)
        self._frames = 0
        self._labelled = 0
        self._dont_care = 0

    def add(self, objects: Iterable[LabelledObject]) -> None:
        """Take a frame, also one without objects."""
        by_kind: dict[str, list[LabelledObject]] = defaultdict(list)
        for each in objects:
            by_kind[each.kind].append(each)
        self._dont_care += len(by_kind.pop(DONT_CARE, ()))
        self._frames += 1
        self._labelled += bool(by_kind)
        for kind, found in by_kind.items():
            self._tallies[kind].add(found)

    def statistics(self) -> ClassStatistics:
        """What was taken so far."""
        facts = (tally.facts(kind) for kind, tally in self._tallies.items())
        ordered = sorted(facts, key=lambda each: (-each.count, each.kind))
        return ClassStatistics(tuple(ordered), self._frames, self._labelled, self._dont_care)


def histogram(values: Float64Array, edges: Sequence[float]) -> list[int]:
    """How many values are in each bin [edge, next edge); the last one has all from its edge on."""
    counts, _ = np.histogram(values, [*edges, np.inf])
    return [int(count) for count in counts]


def spread(count: int, most: int) -> list[int]:
    """Up to most places of 0 .. count-1, evenly, the first and the last among them."""
    if not count:
        return []
    places = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    return [int(place) for place in np.unique(places)]
