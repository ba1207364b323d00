# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overlap that a true positive needs, by class."""

from __future__ import annotations

from dataclasses import dataclass

_VEHICLES = frozenset({'car', 'van', 'truck', 'tram'})
_VEHICLE_OVERLAP, _OTHER_OVERLAP = 0.7, 0.5


@dataclass(frozen=True)
class LeastOverlaps:
    """The intersection over union (IoU) above which a prediction finds a label.

    Attributes:
        by_class: Pairs of a class, in lower case, and its IoU.
        others: IoU of all other classes; None is that of KITTI's devkit.
    """

    by_class: tuple[tuple[str, float], ...] = ()
    others: float | None = None

    def of(self, class_name: str) -> float:
        """Return the IoU of a class, whose case does not matter."""
        name = class_name.lower()
        of_kitti = _VEHICLE_OVERLAP if name in _VEHICLES else _OTHER_OVERLAP
        return dict(self.by_class).get(name, of_kitti if self.others is None else self.others)


KITTI_OVERLAPS = LeastOverlaps()
"""Those of evaluate_object.cpp of the object devkit; other vehicles are as cars."""
