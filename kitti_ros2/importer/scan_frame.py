# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's velodyne frame: the scanner's origin, x forward, y left, z up.

A plan names a frame of the tree, or has one made: `scan.forward` is a frame whose orientation the
scans get, or the axis of `scan.frame` that looks forward. A made frame is one more static link, so
that points, calibration, labels and poses agree.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import UsageError
from ..model.geometry import Transform
from ..rig.heading import AXES, Heading, describe_direction, is_optical, nearest_axis

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from ..rig.tf_tree import FrameTree, Link
    from .plan import Plan, ScanPlan

_FORWARD = np.cos(np.radians(30))
_SAME_ORIGIN_M = 0.1


def made_frame(plan: Plan, tree: FrameTree) -> tuple[Plan, Sequence[Link]]:
    """Return the plan with the made frame as scan.frame, and the link to it; neither if none is.

    Raises:
        UsageError: scan.forward is neither an axis nor a frame that is joined to scan.frame.
    """
    scan = plan.scan
    if scan is None or not scan.forward:
        return plan, ()
    rotation = AXES.get(scan.forward)
    if rotation is None:
        place = tree.find(scan.frame, scan.forward)
        if place is None:
            raise UsageError(
                f'scan: forward: {scan.forward}; expected {", ".join(AXES)}, or a frame that static'
                f' transforms join to {scan.frame}; the bag has {tree}'
            )
        rotation = place.rotation
    name = f'{scan.frame} with {scan.forward} forward'
    link = (scan.frame, name, Transform(rotation.copy(), np.zeros(3)))
    return replace(plan, scan=replace(scan, frame=name, forward='')), (link,)


def face_forward(
    scan: ScanPlan, tree: FrameTree, heading: Heading | None, notes: list[str]
) -> ScanPlan:
    """Return the plan of the scans with x forward, and note a change.

    Args:
        scan: With the frame of the messages.
        tree: The static transforms.
        heading: The robot's forward; None where it is unknown.
        notes: A note is added.
    """
    if heading is not None and heading.assumed:
        notes.append(
            f'x of {scan.frame} is taken as forward: no static transform joins it to base_link or a'
            f' front camera; scan.forward of the plan corrects it'
        )
        return scan
    axes = None if heading is None else heading.axes_of(tree, scan.frame)
    if heading is None or axes is None or _is_forward(axes):
        return scan
    looks = f'{scan.topic} is in {scan.frame}, '
    if is_optical(scan.frame):
        looks += 'z forward'
    else:
        looks += f'whose x looks {describe_direction(axes[:, 0])}'
        looks += '' if _is_up(axes) else ' and z not up'
        looks += f' (forward is {heading.source})'
    looks += '; KITTI has x forward'
    near = _near_frame(scan.frame, tree, heading)
    if near:
        notes.append(f'{looks}: scan.frame is {near}')
        return replace(scan, frame=near)
    forward = heading.frame if heading.body else nearest_axis(axes.T)
    if forward == 'x':
        return scan
    of = f'x of {forward}' if heading.body else f'{forward} of {scan.frame}'
    notes.append(f'{looks}: the scans are turned so that x is {of} (scan.forward)')
    return replace(scan, forward=forward)


def _is_forward(axes: Float64Array) -> bool:
    return bool(axes[0, 0] >= _FORWARD and _is_up(axes))


def _is_up(axes: Float64Array) -> bool:
    return bool(axes[2, 2] >= _FORWARD)


def _near_frame(frame: str, tree: FrameTree, heading: Heading) -> str:
    """Return a parent or child of a frame with its origin and x forward, '' without one."""
    found = []
    for other in tree.neighbours(frame):
        place, axes = tree.find(frame, other), heading.axes_of(tree, other)
        if place is None or axes is None or not _is_forward(axes):
            continue
        distance = float(np.linalg.norm(place.translation))
        if distance <= _SAME_ORIGIN_M:
            found.append((distance, other))
    return min(found)[1] if found else ''
