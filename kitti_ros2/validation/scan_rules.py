# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the values of a scan.

Limits, from KITTI's scans (object 000000..2, raw 0052, odometry 00, semantickitti): coordinates are
within 80 m, reflectances 0..0.99, no point is at the origin. Scanners of others reach 250 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..model.samples import Float32Array

_FARTHEST_M = 250.0
_NOT_METRES = 10_000.0
_COLUMNS = 4
_FOLDED = 1024
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
    def bounds(self) -> Float32Array:
        """(2, 4) least and greatest of x, y, z and reflectance; NaN if any value is NaN."""
        flat = self.points.reshape(-1)
        whole = len(flat) - len(flat) % _FOLDED
        rest = self.points[whole // _COLUMNS :]
        parts = [flat[:whole].reshape(-1, _FOLDED)] if whole else []
        low = [each.min(axis=0).reshape(-1, _COLUMNS) for each in parts]
        high = [each.max(axis=0).reshape(-1, _COLUMNS) for each in parts]
        return np.stack(
            [np.concatenate([*low, rest]).min(axis=0), np.concatenate([*high, rest]).max(axis=0)]
        )

    @cached_property
    def reach(self) -> float:
        """The greatest absolute coordinate, metres; NaN or infinite if any is."""
        return float(np.abs(self.bounds[:, :3]).max())


def _find_nonsense(scan: ScanFile) -> Iterator[Breach]:
    if not (scan.reach < _NOT_METRES and np.isfinite(scan.bounds).all()):
        wrong = np.logical_not((np.abs(scan.points) < _NOT_METRES).all(axis=1))
        first = int(np.argmax(wrong))
        values = ' '.join(f'{value:g}' for value in scan.points[first])
        text = f'{int(wrong.sum())} of {len(wrong)} points, the first is {first}: {values}'
        yield Breach(text, scan.path)


def _find_far(scan: ScanFile) -> Iterator[Breach]:
    if _FARTHEST_M < scan.reach < _NOT_METRES:
        yield Breach(f'coordinates up to {scan.reach:.0f} m', scan.path)


def _find_constant(scan: ScanFile) -> Iterator[Breach]:
    low, high = scan.bounds[:, :3]
    if len(scan.points) > 1 and (low == high).all():
        place = ' '.join(f'{value:g}' for value in low)
        yield Breach(f'all {len(scan.points)} points are at {place}', scan.path)


def _find_reflectance(scan: ScanFile) -> Iterator[Breach]:
    low, high = (float(value) for value in scan.bounds[:, 3])
    if low < 0 or 1 < high < _NOT_METRES:
        yield Breach(f'reflectances from {low:g} to {high:g}', scan.path)


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
        'divide intensities by their full scale, such as 255',
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
