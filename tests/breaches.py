# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Breaches of the demands of programs that read KITTI, as tests collect them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@dataclass
class Breaches:
    """Collects what a program does not accept."""

    lines: list[str] = field(default_factory=list)

    def demand(self, kept: object, where: Path | str, what: str, source: str) -> bool:
        """Enter a breach unless the demand is kept; return whether it is."""
        if not kept:
            self.lines.append(f'{where}: {what} ({source})')
        return bool(kept)

    def attempt(self, work: Callable[[], object], where: Path, what: str, source: str):
        """Return what a reader makes of a file; None, and a breach, where it raises."""
        try:
            return work()
        except (ValueError, IndexError, OSError, KeyError, np.linalg.LinAlgError) as error:
            self.lines.append(f'{where}: {what}: {error} ({source})')
            return None


def read_points(breaches: Breaches, path: Path, source: str) -> np.ndarray | None:
    read = breaches.attempt(
        lambda: np.fromfile(path, dtype=np.float32).reshape(-1, 4), path, 'is no scan', source
    )
    if read is not None:
        breaches.demand(np.isfinite(read).all(), path, 'has points that are not finite', source)
    return read
