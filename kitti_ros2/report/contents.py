# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The contents of a report as plain values; page.py lays them out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from ..model.text import format_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..evaluation.detection import DetectionScores
    from ..model.route import Route
    from ..model.streams import Clock
    from .overview import Overview
    from .statistics import ClassStatistics
    from .timing import Timing


_ONE_CLOCK_NS = 60_000_000_000
"""Maximum plausible delay from stamp to log time; a simulation's clock begins at 0."""


class Severity(Enum):
    """The severity of a finding, worst first."""

    LOSS = 'Lost or damaged'
    WARNING = 'Warning'
    NOTE = 'Note'


@dataclass(frozen=True)
class Finding:
    """A loss, a warning or a note about the recording.

    Attributes:
        severity: Whether data is lost.
        where: Stream, topic or part; empty for the whole recording.
        text: One line.
    """

    severity: Severity
    where: str
    text: str

    @property
    def is_loss(self) -> bool:
        """Whether data is lost or damaged."""
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
    """One frame in pictures.

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
        rows: The cells; the section's template writes those that are more than text.
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
    def left(self) -> str:
        """What the page says of the others, empty if there are none."""
        more = len(self.rows) - len(self.shown)
        return f'... and {more:,} more' if more else ''


@dataclass(frozen=True, eq=False)
class Report:
    """The contents of a report.

    Attributes:
        overview: Kind, name, extent, calibration; shown by info, too.
        streams: Streams or topics.
        findings: Worst first.
        frames: Number of frames; None if there is no reference to count them.
        route: None without poses.
        classes: None without labels.
        projections: Points of the scanner over images.
        scenes: A few frames spread over the recording.
        scores: Those of a detector's results, if given.
    """

    overview: Overview
    streams: Sequence[StreamFacts]
    findings: Sequence[Finding] = ()
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
        """The number of findings that are notes."""
        return self._count(Severity.NOTE)

    @property
    def sound(self) -> bool:
        """Whether no data is lost or damaged."""
        return not self._count(Severity.LOSS)

    def _count(self, severity: Severity) -> int:
        return sum(finding.severity is severity for finding in self.findings)
