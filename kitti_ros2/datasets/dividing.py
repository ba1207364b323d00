# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Division of units of different sizes by shares: random by a seed, the same on every machine.

The random order is that of the SHA-256 of the text `SEED NAME` (UTF-8) of each unit, such as
`0 000123`; so it depends on no random generator, and a unit keeps its place among the others when
some are added or removed. Each list takes the units in this order, and passes over those with which
it could not get as close to its share as the units allow: single frames are taken one by one.
"""

from __future__ import annotations

from fractions import Fraction
from hashlib import sha256
from math import floor
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


def seeded_order(names: Sequence[str], seed: int) -> list[str]:
    """Return names in the random order of a seed."""
    return sorted(names, key=lambda name: (sha256(f'{seed} {name}'.encode()).digest(), name))


def divide(
    sizes: Mapping[str, int], shares: Sequence[Fraction], seed: int
) -> list[list[str]] | None:
    """Divide units into lists whose sizes are as close to the shares as whole units allow.

    Args:
        sizes: Units with their sizes, 1 or more.
        shares: Of each list; they add up to 1.
        seed: Of the random order.

    Returns:
        The units of each list, one at least, in their random order; None if there are too few.
    """
    rest = seeded_order([*sizes], seed)
    total, done, cumulated = sum(sizes.values()), 0, Fraction(0)
    lists = []
    for place, share in enumerate(shares[:-1]):
        cumulated += share
        target = floor(total * cumulated + Fraction(1, 2)) - done
        taken = _take(rest, sizes, target, leave=len(shares) - place - 1)
        if taken is None:
            return None
        chosen = frozenset(taken)
        lists.append(taken)
        rest = [name for name in rest if name not in chosen]
        done += sum(sizes[name] for name in taken)
    return [*lists, rest] if rest else None


def _take(
    order: Sequence[str], sizes: Mapping[str, int], target: int, leave: int
) -> list[str] | None:
    """Return units whose sizes add up as close to a target as possible, the first that do.

    Args:
        order: The units.
        sizes: Their sizes.
        target: The size to reach.
        leave: Number of units to leave at least.
    """
    if len(order) <= leave:
        return None
    if all(sizes[name] == 1 for name in order):
        return [*order[: min(max(target, 1), len(order) - leave)]]
    # Bit s of sums[i]: whether units from i on can add up to s.
    sums = [1]
    for name in reversed(order):
        sums.append(sums[-1] | sums[-1] << sizes[name])
    sums.reverse()
    total = sum(sizes[name] for name in order)
    for wanted in sorted(range(1, total), key=lambda size: (abs(size - target), size)):
        if sums[0] >> wanted & 1:
            taken = _first_that_add_up(order, sizes, sums, wanted)
            if len(order) - len(taken) >= leave:
                return taken
    return None


def _first_that_add_up(
    order: Sequence[str], sizes: Mapping[str, int], sums: Sequence[int], size: int
) -> list[str]:
    """Return the units that add up to a size, each taken if the ones after it can do the rest."""
    taken = []
    for place, name in enumerate(order):
        rest = size - sizes[name]
        if rest >= 0 and sums[place + 1] >> rest & 1:
            taken.append(name)
            size = rest
    return taken
