# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Survey of one topic: its stamps, frames, and a few of its messages."""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .label_groups import group_messages
from .survey_types import BOXES
from .sync import late_ns, unset_stamps, usable_stamps

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array


@dataclass(slots=True)
class TopicSurvey:
    """One topic.

    Attributes:
        name, msgtype: As the bag has them.
        log_ns: Log times in the order of reading, nanoseconds.
        header_ns: Header stamps of the same messages; empty where the type has no header.
        frames: Header frames, with the number of messages of each.
        looks: A few decoded messages, at doubling distances.
        failures: Number of messages that failed to decode.
        failure: The reason of the first failure, empty without one.
        headless: Indices of the messages without a readable header.
        contents: Of CameraInfo: its content where that differs from the message before, each with
            the index of its message.
        size_bytes: Of its messages as CDR.
        links_ns: Of TFMessages: stamps of the first transforms, log times where they are 0.
        places: Of NavSatFix: latitude, longitude and altitude of each, NaN without a fix.
        moves: Of messages with a twist: whether one has a velocity that is not 0.
        markers_ns: Of MarkerArrays: stamps of the first markers, 0 without one.
        copies: Of topics with boxes: indices of messages that are the same as an earlier one.
        forward_ns: Header stamp to the stamp of the frame, where they differ: see forward_stamps.
        classes: Of topics with boxes: number of boxes of each class in the messages decoded.
        has_tracks: Of topics with boxes: whether one of these names its track.
        spans_ns: Of scans with a time for each point: when the first and the last point of each
            message were measured, nanoseconds from the stamp; None where it does not say.
        by_log: Whether log times are used, not stamps.
        offset_ns: Added to the stamps, nanoseconds.
        middles_ns: (N,) added to header stamps, nanoseconds: the way to the middle of each turn.
    """

    name: str
    msgtype: str
    log_ns: array[int] = field(default_factory=lambda: array('q'))
    header_ns: array[int] = field(default_factory=lambda: array('q'))
    frames: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    looks: list[Any] = field(default_factory=list)
    failures: int = 0
    failure: str = ''
    headless: list[int] = field(default_factory=list)
    contents: list[tuple[int, Any]] = field(default_factory=list)
    size_bytes: int = 0
    links_ns: list[int] = field(default_factory=list)
    places: array[float] | None = None
    moves: bool = False
    markers_ns: list[int] = field(default_factory=list)
    copies: list[int] = field(default_factory=list)
    forward_ns: Mapping[int, int] = field(default_factory=dict)
    classes: Counter[str] = field(default_factory=Counter)
    has_tracks: bool = False
    spans_ns: list[tuple[int, int] | None] | None = None
    by_log: bool = False
    offset_ns: int = 0
    middles_ns: Int64Array | None = None

    def fail(self, error: ValueError) -> None:
        """Count a message that failed to decode."""
        self.failures += 1
        self.failure = self.failure or str(error)

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self.log_ns)

    @property
    def fixes(self) -> Float64Array:
        """Latitude, longitude (degrees) and altitude of each NavSatFix, (N, 3).

        The altitude is NaN where it is not known, and all three without a fix.
        """
        return np.array(self.places or (), np.float64).reshape(-1, 3)

    @property
    def has_fix(self) -> bool:
        """Whether a NavSatFix has a fix."""
        return bool(np.isfinite(self.fixes[:, 0]).any())

    @property
    def is_readable(self) -> bool:
        """Whether a message can be decoded, or was not tried."""
        return self.count > self.failures

    @property
    def frame(self) -> str:
        """The frame of most messages, without a leading slash."""
        return max(self.frames, key=lambda name: self.frames[name]) if self.frames else ''

    @property
    def has_own_stamps(self) -> bool:
        """Whether stamps of the messages are used, not log times."""
        if self.by_log:
            return False
        return bool(self.links_ns) or (bool(self.header_ns) and self._stamps()[1] is None)

    @property
    def turn_ns(self) -> tuple[int, int] | None:
        """When the first and the last point were measured, nanoseconds from the stamp: medians."""
        known = [span for span in self.spans_ns or () if span is not None]
        if not known:
            return None
        start, end = (int(each) for each in np.median(np.array(known), axis=0))
        return start, end

    def turns_ns(self) -> Int64Array | None:
        """Return (N, 2) the same of each message, the medians of those that do not say."""
        usual = self.turn_ns
        if usual is None or self.spans_ns is None or len(self.spans_ns) != self.count:
            return None
        return np.array([usual if span is None else span for span in self.spans_ns], np.int64)

    def moved_ns(self) -> Int64Array:
        """Return (N,) the nanoseconds that are added to header stamps for the middle of turns."""
        if self.middles_ns is None or self._stamps()[1] is not None:
            return np.zeros(self.count, np.int64)
        return self.middles_ns

    def clock_ns(self) -> Int64Array:
        """Return (N,) stamps by which clocks are compared: also of TFMessages, without a header."""
        if self.by_log or not self.links_ns:
            return self.stamps()[0]
        return np.array(self.links_ns, dtype=np.int64) + self.offset_ns

    def stamps(self) -> tuple[Int64Array, str | None]:
        """Select the stamps to use, (N,) nanoseconds in the order of reading.

        Header stamps of 0 or out of order are invalid; log times are used instead, and the reason
        is returned. The offset is added.
        """
        used, reason = self._stamps()
        if self.middles_ns is not None and reason is None:
            used = used + self.middles_ns
        return (used + self.offset_ns if self.offset_ns else used), reason

    def groups(self) -> list[list[int]] | None:
        """Return the places of messages with boxes that belong together; None if each is alone.

        Copies are alone: where a recorder writes all messages twice, scans are copied, too.
        """
        stamps_ns: Sequence[int] = self.markers_ns
        if self.msgtype in BOXES:
            alone = {*self.copies, *self.headless}
            stamps_ns = [
                -1 if place in alone else stamp or -1 for place, stamp in enumerate(self.header_ns)
            ]
        if len(stamps_ns) != self.count:
            return None
        groups = group_messages(stamps_ns, self.log_ns)
        return groups if len(groups) < self.count else None

    def oddities(self) -> Iterator[str]:
        """Yield notes where header stamps are not used, and where they repeat."""
        _, reason = self.stamps()
        if reason is not None:
            yield f'{self.name}: {reason}'
        if self.by_log or len(self.header_ns) != self.count:
            return
        header = np.array(self.header_ns, dtype=np.int64)
        if reason is None:
            yield from self._mended(header)
        again = np.flatnonzero(np.diff(header) == 0) + 1
        again = again[header[again] != 0]
        if self.groups() is not None:  # messages with one stamp are one sample: see label_groups
            again = again[np.isin(again, self.copies)]
        if len(again):
            yield (
                f'{self.name}: {len(again)} of {len(header)} messages have the stamp of the one'
                f' before (the first is message {again[0] + 1}); each is a sample of its own'
            )

    def _mended(self, header_ns: Int64Array) -> Iterator[str]:
        """Yield notes on header stamps that are used, and are 0 or out of order."""
        unset = np.flatnonzero(unset_stamps(header_ns))
        if len(unset):
            yield (
                f'{self.name}: header stamps that are 0: {len(unset)} of {len(header_ns)} (the'
                f' first that of message {unset[0] + 1}); they get the log time, moved by the'
                f' distance of the others'
            )
        late = late_ns(np.delete(header_ns, unset))
        if late.any():
            yield (
                f'{self.name}: messages whose stamps are before that of an earlier one:'
                f' {np.count_nonzero(late)} of {len(header_ns)}, by {late.max() / 1e6:.1f} ms at'
                f' most; they are taken in the order of their stamps'
            )

    def _stamps(self) -> tuple[Int64Array, str | None]:
        log = np.array(self.log_ns, dtype=np.int64)
        if self.by_log or len(self.header_ns) != len(self.log_ns) or len(self.headless) == len(log):
            return log, None
        header = np.array(self.header_ns, dtype=np.int64)
        if self.headless:
            # A damaged one gets the distance to its neighbour in the log.
            headed = np.setdiff1d(np.arange(len(log)), self.headless)
            nearest = headed[np.maximum(np.searchsorted(headed, self.headless) - 1, 0)]
            header[self.headless] = log[self.headless] + header[nearest] - log[nearest]
        used, reason = usable_stamps(header, log)
        if reason is None and self.forward_ns:
            used = np.array([self.forward_ns.get(stamp, stamp) for stamp in used.tolist()])
        return used, reason
