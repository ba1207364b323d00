# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms of a bag as links: which stay as they are, and which move."""

from __future__ import annotations

from collections import Counter, defaultdict
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.header import stamp_ns_of
from ..messages.ros_types import TFMessage
from ..messages.transforms import decode_static
from .heading import FIXED_FRAMES
from .tf_tree import differ, plain

if TYPE_CHECKING:
    from ..model.geometry import Transform
    from .tf_tree import Link

_STILL_M = 1e-6
_JITTER_M = 5e-4
"""Of what a rig's own transforms may differ by on /tf, computed anew for each message, say from
float32; less than a calibration is known to. A robot's slow way is none."""


class LinkTally:
    """Transforms by (parent, child): the first of each, and whether it moved."""

    def __init__(self) -> None:
        self._first: dict[tuple[str, str], Transform] = {}
        self._seen: dict[tuple[str, str], int] = defaultdict(int)
        self._moving: set[tuple[str, str]] = set()
        self._static: set[tuple[str, str]] = set()
        self._values: dict[tuple[str, str], list[tuple[int, int, Transform]]] = defaultdict(list)
        self._invalid: Counter[tuple[str, str]] = Counter()
        self._topics: dict[tuple[str, str], str] = {}
        self.clashes: dict[tuple[str, str], tuple[str, str]] = {}
        """Links that topics of two namespaces have otherwise, with these: see add."""

    def add(self, message: Any, *, still: bool, topic: str = '', log_ns: int = 0) -> None:  # noqa: ANN401
        """Add the transforms of a TFMessage of the bag's types.

        Args:
            message: The message.
            still: Whether it is of /tf_static.
            log_ns: When it was recorded, nanoseconds.
            topic: Its topic. Those of robots with the same names of frames differ by a namespace.
        """
        for stamped in message.transforms:
            key = (plain(stamped.header.frame_id), plain(stamped.child_frame_id))
            if key in self._moving and not still:
                self._check_robot(key, topic)
                continue  # known to move
            ((_, _, transform),) = decode_static(TFMessage([stamped]))
            if not still and not _is_finite(transform):
                self._invalid[key] += 1
                self._first.setdefault(key, transform)
                continue
            first = self._first.setdefault(key, transform)
            if not still and not self._seen[key]:  # those before were invalid
                self._first[key] = first = transform
            self._seen[key] += 1
            self._topics.setdefault(key, topic)
            if still:
                # The last value of a static link is valid, as for late subscribers.
                changed = first is not transform and differ(first, transform, _STILL_M)
                if changed or key not in self._values:
                    entry = stamp_ns_of(stamped.header), log_ns, transform
                    self._values[key].append(entry)
                if changed:
                    self._check_robot(key, topic)
                self._first[key] = transform
                self._static.add(key)
            elif key not in self._moving and differ(first, transform, _still(key[0])):
                self._moving.add(key)
                self._check_robot(key, topic)

    def _check_robot(self, key: tuple[str, str], topic: str) -> None:
        known = self._topics[key]
        if known != topic and known.rpartition('/')[0] != topic.rpartition('/')[0]:
            self.clashes.setdefault(key, (known, topic))

    def invalid(self) -> dict[tuple[str, str], int]:
        """Return the links on /tf without a valid transform, each with the number of the others."""
        return {key: count for key, count in sorted(self._invalid.items()) if not self._seen[key]}

    def sorted(self) -> tuple[list[Link], list[tuple[str, str]], list[tuple[str, str]]]:
        """Return static, moving and changing static links; one seen only once on /tf is moving."""
        moving = {key for key in self._moving if key not in self._static}
        moving |= {key for key, n in self._seen.items() if n == 1 and key not in self._static}
        still = [(*key, pose) for key, pose in self._first.items() if key not in moving]
        return still, sorted(moving), sorted(self.changes())

    def changes(self) -> dict[tuple[str, str], list[tuple[int, Transform]]]:
        """Return the values of static links that change, each with the stamp it is valid from.

        Log times count where the stamps do not ascend.
        """
        found = {}
        for key, values in sorted(self._values.items()):
            if len(values) > 1:
                headers = [header_ns for header_ns, _, _ in values]
                ascend = headers[0] > 0 and all(a < b for a, b in pairwise(headers))
                found[key] = [(own if ascend else log, pose) for own, log, pose in values]
        return found


def _still(parent: str) -> float:
    """Return by how much the transforms of a link on /tf may differ that does not move."""
    return _STILL_M if parent.rpartition('/')[2] in FIXED_FRAMES else _JITTER_M


def _is_finite(transform: Transform) -> bool:
    """Whether no number is NaN or infinite; a quaternion of zeros has become NaN."""
    return bool(np.isfinite(transform.matrix()).all())
