# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Selected part of a recording or a bag: topics, streams, start and end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..model.errors import UsageError
from ..model.stamps import NS_PER_S, format_stamp, parse_seconds, parse_stamp
from .declare import option
from .parsers import parse_text, parse_texts


@dataclass(frozen=True)
class Bound:
    """One end of a selection: exactly one of a frame number, an offset, or a stamp.

    Attributes:
        frame: File number.
        offset_ns: Nanoseconds from the recording's first stamp.
        stamp_ns: Nanoseconds since 1970, UTC.
    """

    frame: int | None = None
    offset_ns: int | None = None
    stamp_ns: int | None = None

    @classmethod
    def parse(cls, text: str) -> Bound:
        """Parse `12` (frame), `3.5s` (from the start), or a KITTI time stamp.

        Raises:
            UsageError: The text is none of these.
        """
        text = text.strip()
        try:
            if text.isdecimal():
                return cls(frame=int(text))
            if text.endswith('s'):
                return cls(offset_ns=parse_seconds(text[:-1]))
            return cls(stamp_ns=parse_stamp(text))
        except ValueError:
            raise UsageError(
                f'invalid start or end {text!r}; write a frame (12), seconds from the start (3.5s)'
                f" or a time stamp ('2011-09-26 13:02:25.9')"
            ) from None

    def __str__(self) -> str:
        """Return readable text: frame 12, 3.5s, or a time stamp."""
        if self.frame is not None:
            return f'frame {self.frame}'
        if self.offset_ns is not None:
            return f'{self.offset_ns / NS_PER_S:.9f}'.rstrip('0').rstrip('.') + 's'
        return format_stamp(self.stamp_ns or 0)

    def is_before(self, other: Bound) -> bool:
        """Whether it is before another bound of the same kind; False for a different kind."""
        pairs = (
            (self.frame, other.frame),
            (self.offset_ns, other.offset_ns),
            (self.stamp_ns, other.stamp_ns),
        )
        return any(ours is not None and other is not None and ours < other for ours, other in pairs)


def parse_bound(name: str, value: object) -> Bound:
    """Parse the start or end of a selection."""
    return Bound.parse(parse_text(name, value))


@dataclass(frozen=True)
class SelectionOptions:
    """Selected part of a recording.

    Attributes:
        streams: Names of streams; image selects all cameras; empty selects all.
        topics: Names of topics, wildcards allowed; empty selects all.
        exclude_topics: Names of topics to leave out of those, wildcards allowed.
        start, end: First and last moment, both included; None is unlimited.

    Raises:
        UsageError: The end is before the start.
    """

    group: ClassVar = 'Selection'

    streams: tuple[str, ...] = option(
        (),
        'Only these: scan, image, image_0..4, oxts, pose, path, labels, predictions, calibration',
        parse_texts,
        unset='all',
    )
    topics: tuple[str, ...] = option(
        (),
        "Only these topics; * matches, such as '/kitti/oxts/*'",
        parse_texts,
        unset='all',
    )
    exclude_topics: tuple[str, ...] = option(
        (), "All but these topics; * matches, such as '*image*'", parse_texts, unset='none'
    )
    start: Bound | None = option(
        None,
        "First frame (12), seconds from the start (3.5s) or time ('2011-09-26 13:02:26')",
        parse_bound,
        unset='the first',
        any_type=True,
        metavar='WHEN',
    )
    end: Bound | None = option(
        None,
        'Last one, included; written as start',
        parse_bound,
        unset='the last',
        any_type=True,
        metavar='WHEN',
    )

    def __post_init__(self) -> None:
        if self.start is not None and self.end is not None and self.end.is_before(self.start):
            raise self.reversed_error()

    @property
    def is_whole(self) -> bool:
        """Whether neither start nor end limit it."""
        return self.start is None and self.end is None

    def __str__(self) -> str:
        """Return readable text: the selection from frame 3 to 3.5s."""
        first = f' from {self.start}' if self.start is not None else ''
        last = f' to {self.end}' if self.end is not None else ''
        return f'the selection{first}{last}'

    def reversed_error(self) -> UsageError:
        """Return the error for an end before the start."""
        return UsageError(f'the end ({self.end}) is before the start ({self.start})')
