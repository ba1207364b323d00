# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A histogram with mean, standard deviation and extremes, computed without keeping the values."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


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
        """See the class."""
        return math.sqrt(self._squares / self.count) if self.count else math.nan

    @property
    def names(self) -> list[str]:
        """Names of the bins, such as 0-10 and 80+."""
        bounded = [f'{low:g}-{high:g}' for low, high in pairwise(self.edges)]
        return [*bounded, f'{self.edges[-1]:g}+']

    def add(self, value: float) -> None:
        """Add a value; one that is not finite is unknown, and left out."""
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
        """Set counts and moments, as they were read from an equal distribution."""
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
