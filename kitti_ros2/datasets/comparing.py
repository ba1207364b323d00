# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of lists: entries in both, and entries of the same raw drive on both sides."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from ..model.text import format_count, some_of
from ..options.read import NOMINAL_PERIOD_NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from .units import Unit


@dataclass(frozen=True)
class ListPair:
    """What two lists share.

    Attributes:
        first, second: Names of the lists.
        overlap: Entries of both.
        contained: Whether all of one are in the other, as train is in trainval.
        drives: Raw drives with entries of each, of those that are not in both.
        entries: Number of entries of these drives in the first and in the second.
        nearest: Two entries of one drive that are closest, of the first and of the second; None
            without any.
        nearest_frames: Frames of the drive between them, None without nearest.
        nearest_s: The same in seconds, at the nominal rate of KITTI's scanner.
    """

    first: str
    second: str
    overlap: tuple[str, ...] = ()
    contained: bool = False
    drives: tuple[str, ...] = ()
    entries: tuple[int, int] = (0, 0)
    nearest: tuple[str, str] | None = None
    nearest_frames: int | None = None
    nearest_s: float | None = None

    @property
    def faults(self) -> tuple[str, ...]:
        """Overlap as one line; none if one list contains the other."""
        if not self.overlap or self.contained:
            return ()
        both = f'{self.first} and {self.second}: {len(self.overlap):,} in both'
        return (f'{both}: {some_of(self.overlap)}',)

    @property
    def leaks(self) -> tuple[str, ...]:
        """Entries of the same drives as one line; none if one list contains the other."""
        if not self.drives or self.contained:
            return ()
        drives = format_count(len(self.drives), 'drive')
        first, second = self.entries
        both = f'{self.first} and {self.second}: {drives} in both'
        text = f'{both}, with {first:,} and {second:,} of their entries'
        if self.nearest is not None and self.nearest_frames is not None:
            apart = format_count(self.nearest_frames, 'frame')
            text += (
                f'; the nearest, {" and ".join(self.nearest)}, are {apart} apart'
                f' (about {self.nearest_s:.1f} s)'
            )
        return (text,)


def compare_lists(
    lists: Mapping[str, Sequence[str]], units: Mapping[str, Unit]
) -> tuple[ListPair, ...]:
    """Compare each list with each.

    Args:
        lists: Entries by name of the list.
        units: By entry; entries without one are compared by name only.
    """
    return tuple(_pair(*both, units) for both in combinations(lists.items(), 2))


def _pair(
    one: tuple[str, Sequence[str]], other: tuple[str, Sequence[str]], units: Mapping[str, Unit]
) -> ListPair:
    overlap = sorted({*one[1]}.intersection(other[1]))
    both = frozenset(overlap)
    sides = [_by_drive([n for n in names if n not in both], units) for _, names in (one, other)]
    drives = sorted(sides[0].keys() & sides[1].keys())
    nearest = _nearest([(sides[0][drive], sides[1][drive]) for drive in drives])
    frames = None if nearest is None else nearest[0]
    return ListPair(
        first=one[0],
        second=other[0],
        overlap=tuple(overlap),
        contained=bool(overlap) and len(overlap) in {len({*one[1]}), len({*other[1]})},
        drives=tuple(drives),
        entries=(
            sum(len(sides[0][drive]) for drive in drives),
            sum(len(sides[1][drive]) for drive in drives),
        ),
        nearest=None if nearest is None else nearest[1],
        nearest_frames=frames,
        nearest_s=None if frames is None else round(frames * NOMINAL_PERIOD_NS / 1e9, 3),
    )


def _by_drive(entries: Iterable[str], units: Mapping[str, Unit]) -> dict[str, list[Unit]]:
    found: dict[str, list[Unit]] = {}
    for name in entries:
        unit = units.get(name)
        if unit is not None and unit.drive is not None:
            found.setdefault(unit.drive, []).append(unit)
    return found


def _nearest(
    sides: Iterable[tuple[Sequence[Unit], Sequence[Unit]]],
) -> tuple[int, tuple[str, str]] | None:
    """Return the least distance in frames of units of one drive on both sides, and their names."""
    best: tuple[int, tuple[str, str]] | None = None
    for first, second in sides:
        known = sorted((unit.number, unit.name) for unit in second if unit.number is not None)
        for unit in first:
            if unit.number is None or not known:
                continue
            place = bisect_left(known, (unit.number, ''))
            for number, name in known[max(0, place - 1) : place + 1]:
                found = abs(number - unit.number), (unit.name, name)
                best = found if best is None else min(best, found)
    return best
