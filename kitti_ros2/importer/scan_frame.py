# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's velodyne frame: the scanner's origin, x forward, y left, z up.

A plan names a frame of the tree, or has one made: `scan.forward` is a frame whose orientation the
scans get, the axis of `scan.frame` that looks forward, or camera: the direction of camera 2 on the
ground. A made frame is one more static link, so that points, calibration, labels and poses agree.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import UsageError
from ..model.geometry import Transform
from ..rig.heading import (
    AXES,
    Heading,
    describe_direction,
    find_body,
    is_optical,
    known_heading,
    nearest_axis,
)
from .calibration import rect_in_frame
from .plan import TF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..messages.camera_info import CameraModel
    from ..model.geometry import Float64Array
    from ..rig.tf_tree import FrameTree, Link
    from .plan import Plan, ScanPlan

CAMERA = 'camera'
"""The value of scan.forward that turns the scans to camera 2."""

_FORWARD = np.cos(np.radians(30))
_LEVEL = np.cos(np.radians(3))
_SAME_ORIGIN_M = 0.1
LEVEL = np.sin(np.radians(15))
"""Cameras that look up or down more steeply than its complement have no direction on the ground."""


def made_frame(
    plan: Plan,
    tree: FrameTree,
    models: Mapping[int, CameraModel],
    others: Sequence[CameraModel],
) -> tuple[Plan, Sequence[Link]]:
    """Return the plan with the made frame as scan.frame, and the link to it; neither if none is.

    Args:
        plan: The plan.
        tree: The static transforms.
        models: Of the cameras with a CameraInfo, by KITTI index.
        others: Of the other cameras of the bag, as viewpoints.

    Raises:
        UsageError: scan.forward is neither camera nor an axis nor a frame that is joined to
            scan.frame; or it is camera, and the camera has no direction on the ground.
        MissingDataError: It is camera, and no static transform joins the camera to scan.frame.
    """
    scan = plan.scan
    if scan is None or not scan.forward:
        return plan, ()
    rotation = AXES.get(scan.forward)
    if scan.forward == CAMERA:
        if plan.calibration != TF or not models:
            raise UsageError(
                f'scan: forward: {CAMERA}; expected calibration: {TF} and a camera with a'
                f' CameraInfo'
            )
        rotation = _turned_to(optical_axis(tree, scan.frame, models, others), tree, scan)
    if rotation is None:
        place = tree.find(scan.frame, scan.forward)
        if place is None:
            raise UsageError(
                f'scan: forward: {scan.forward}; expected {", ".join(AXES)}, {CAMERA}, or a frame'
                f' that static transforms join to {scan.frame}; the bag has {tree}'
            )
        rotation = place.rotation
    name = f'{scan.frame} with {scan.forward} forward'
    link = (scan.frame, name, Transform(rotation.copy(), np.zeros(3)))
    return replace(plan, scan=replace(scan, frame=name, forward='')), (link,)


def optical_axis(
    tree: FrameTree,
    frame: str,
    models: Mapping[int, CameraModel],
    others: Sequence[CameraModel],
) -> Float64Array:
    """Return (3,) the optical axis of KITTI's rectified camera 0 in a frame.

    Camera 2 has the same: both are rectified to one plane.

    Raises:
        MissingDataError: No static transform joins the two.
    """
    own, frame_t_rect = rect_in_frame(tree, models, others)
    axis = tree.transform(frame, own).rotation @ frame_t_rect.rotation[:, 2]
    return np.asarray(axis, np.float64)


def _turned_to(axis: Float64Array, tree: FrameTree, scan: ScanPlan) -> Float64Array:
    """Return (3, 3) forward, left, up in the frame of the scans, forward along an optical axis."""
    up = _vertical(tree, scan.frame)
    ahead = axis - up * (up @ axis)
    if np.linalg.norm(ahead) < LEVEL:
        side = 'up' if up @ axis > 0 else 'down'
        raise UsageError(
            f'scan: forward: {CAMERA}; the camera looks {side} in {scan.frame}: expected one that'
            f' looks to a side, or another forward'
        )
    ahead /= np.linalg.norm(ahead)
    return np.column_stack([ahead, np.cross(up, ahead), up])


def _vertical(tree: FrameTree, frame: str) -> Float64Array:
    """Return (3,) up in a frame: its z, or the robot's where z is not up."""
    heading = find_body(tree, [frame]) or known_heading(tree, frame)
    axes = None if heading is None else heading.axes_of(tree, frame)
    return np.array([0.0, 0, 1]) if axes is None or _is_up(axes) else axes[2]


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
    if heading is None or axes is None or (is_forward(axes) and not _leans(axes, heading)):
        return scan
    looks = f'{scan.topic} is in {scan.frame}, '
    if is_optical(scan.frame):
        looks += 'z forward'
    elif is_forward(axes):
        lean = np.degrees(np.arccos(np.clip(axes[2, 2], -1, 1)))
        looks += f'whose z leans by {lean:.0f} degrees (up is z of {heading.frame})'
    else:
        looks += describe_axes(axes, heading)
    looks += '; KITTI has x forward and z up'
    near = near_frame(scan.frame, tree, heading)
    if near:
        notes.append(f'{looks}: scan.frame is {near}')
        return replace(scan, frame=near)
    forward = heading.frame if heading.body else nearest_axis(axes.T)
    if forward == 'x':
        return scan
    of = f'x of {forward}' if heading.body else f'{forward} of {scan.frame}'
    notes.append(f'{looks}: the scans are turned so that x is {of} (scan.forward)')
    return replace(scan, forward=forward)


def describe_axes(axes: Float64Array, heading: Heading) -> str:
    """Describe the axes of a frame, as columns in forward, left, up, that is not forward."""
    up = '' if _is_up(axes) else ' and z not up'
    return f'whose x looks {describe_direction(axes[:, 0])}{up} (forward is {heading.source})'


def is_forward(axes: Float64Array) -> bool:
    """Whether the axes of a frame, as columns in forward, left, up, are about these."""
    return bool(axes[0, 0] >= _FORWARD and _is_up(axes))


def _leans(axes: Float64Array, heading: Heading) -> bool:
    """Whether boxes that are upright on the ground are not in the scans: see TrackletPose."""
    return heading.body and bool(axes[2, 2] < _LEVEL)


def _is_up(axes: Float64Array) -> bool:
    return bool(axes[2, 2] >= _FORWARD)


def forward_frame(frame: str, tree: FrameTree, heading: Heading) -> str:
    """Return the body's frame, or the one next to a frame, that has x forward; '' without one."""
    found = []
    for other in tree.frames:
        place, axes = tree.find(frame, other), heading.axes_of(tree, other)
        if place is None or axes is None or not is_forward(axes) or _leans(axes, heading):
            continue
        if other == heading.frame and heading.body:
            return other
        found.append((float(np.linalg.norm(place.translation)), other))
    return min(found)[1] if found else ''


def near_frame(frame: str, tree: FrameTree, heading: Heading) -> str:
    """Return a parent or child of a frame with its origin and x forward, '' without one."""
    found = []
    for other in tree.neighbours(frame):
        place, axes = tree.find(frame, other), heading.axes_of(tree, other)
        if place is None or axes is None or not is_forward(axes) or _leans(axes, heading):
            continue
        distance = float(np.linalg.norm(place.translation))
        if distance <= _SAME_ORIGIN_M:
            found.append((distance, other))
    return min(found)[1] if found else ''
