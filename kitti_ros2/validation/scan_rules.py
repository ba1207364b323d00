# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the values of a scan.

Limits, from KITTI's scans (object 000000..2, raw 0052, odometry 00, semantickitti): coordinates are
within 80 m, reflectances 0..0.99, no point is at the origin. Scanners of others reach 250 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.scan_check import HEAD_BYTES, find_mismatch
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..model.samples import Float32Array

_FARTHEST_POINT_M = 250.0
_NOT_METRES = 10_000.0
_COLUMNS = 4
_LOOKED_AT = HEAD_BYTES // 16
_FOLDED = 4096
"""Values that are reduced side by side: numpy reduces columns of four ten times slower."""


@dataclass(frozen=True, eq=False)
class ScanFile:
    """A parsed scan.

    Attributes:
        path: The file.
        points: (N, 4) float32, at least one.
        missing: Why labels of points are missing.
    """

    path: Path
    points: Float32Array
    missing: str = ''

    @cached_property
    def bounds(self) -> tuple[list[float], list[float]]:
        """The least and the greatest x, y, z and reflectance; NaN if a value of the column is."""
        flat = self.points.reshape(-1)
        return _reduce(np.minimum, flat), _reduce(np.maximum, flat)

    @cached_property
    def reach(self) -> float:
        """The greatest absolute coordinate, metres; NaN or infinite if any is."""
        low, high = self.bounds
        ends = [*low[:3], *high[:3]]
        return math.nan if any(map(math.isnan, ends)) else max(map(abs, ends))


def _reduce(ufunc: np.ufunc, flat: Float32Array) -> list[float]:
    """Return the least or greatest value of each column of points in a row."""
    if len(flat) > _FOLDED:
        rows = flat[: len(flat) // _FOLDED * _FOLDED].reshape(-1, _FOLDED)
        flat = ufunc(ufunc.reduce(rows), flat[-_FOLDED:])  # values may be seen twice
    columns: list[float] = ufunc.reduce(flat.reshape(-1, _COLUMNS).T.copy(), axis=1).tolist()
    return columns


def _find_nonsense(scan: ScanFile) -> Iterator[Breach]:
    low, high = scan.bounds
    if not (scan.reach < _NOT_METRES and math.isfinite(low[3]) and math.isfinite(high[3])):
        wrong = np.logical_not((np.abs(scan.points) < _NOT_METRES).all(axis=1))
        first = int(np.argmax(wrong))
        values = ' '.join(f'{value:g}' for value in scan.points[first])
        text = f'{int(wrong.sum())} of {len(wrong)} points, the first is {first}: {values}'
        yield Breach(text, scan.path)


def _find_far(scan: ScanFile) -> Iterator[Breach]:
    if _FARTHEST_POINT_M < scan.reach < _NOT_METRES:
        yield Breach(f'coordinates up to {scan.reach:.0f} m', scan.path)


def _find_constant(scan: ScanFile) -> Iterator[Breach]:
    low, high = scan.bounds
    if len(scan.points) > 1 and low[:3] == high[:3]:
        place = ' '.join(f'{value:g}' for value in low[:3])
        yield Breach(f'all {len(scan.points)} points are at {place}', scan.path)


def _find_reflectance(scan: ScanFile) -> Iterator[Breach]:
    low, high = (ends[3] for ends in scan.bounds)
    if low < 0 or 1 < high < _NOT_METRES:
        found = find_mismatch([(scan.points[:_LOOKED_AT].tobytes(), scan.points.nbytes)])
        text = found.found if found else f'reflectances from {low:g} to {high:g}'
        yield Breach(text, scan.path)


def _find_point_labels(scan: ScanFile) -> Iterator[Breach]:
    if scan.missing:
        yield breach_in(scan.missing.partition('; its points')[0], scan.path.parent.parent)


_FILE = RuleScope.FILE

SCAN_RULES: tuple[Rule[ScanFile], ...] = (
    Rule(
        'scan-finite',
        RuleSeverity.ERROR,
        _FILE,
        'Coordinates and reflectances are finite numbers, below 10 km',
        'copy the file again; check that it has float32 x y z reflectance',
        _find_nonsense,
    ),
    Rule(
        'scan-constant',
        RuleSeverity.ERROR,
        _FILE,
        'Points of a scan are at different places',
        'copy the file again: an interrupted download leaves zeros',
        _find_constant,
    ),
    Rule(
        'scan-range',
        RuleSeverity.WARNING,
        _FILE,
        'Points are within 250 m',
        'check the unit (metres) and the four columns',
        _find_far,
    ),
    Rule(
        'scan-reflectance',
        RuleSeverity.WARNING,
        _FILE,
        'Reflectances are 0 to 1',
        'divide intensities by their full scale, such as 255; check the columns of the scan',
        _find_reflectance,
    ),
    Rule(
        'scan-labels',
        RuleSeverity.ERROR,
        _FILE,
        'Labels of points (SemanticKITTI) exist for each scan, one for each point',
        'copy the .label file again; labels and scans must be of one sequence',
        _find_point_labels,
    ),
)
