# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes on the cameras of a bag: why each was passed over, and which look up or down."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.errors import MissingDataError
from ..rig.heading import describe_direction
from .camera_geometry import direction_of, is_steep

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..rig.heading import Heading
    from ..rig.tf_tree import FrameTree
    from .camera_geometry import Choice
    from .camera_topics import RigCamera


def joined_cameras(
    tree: FrameTree, cameras: Sequence[RigCamera], scan_frame: str | None
) -> list[RigCamera]:
    """Return the cameras that static transforms join to the scans; all if none is, or no scans."""
    if scan_frame is None:
        return list(cameras)
    joined = [each for each in cameras if tree.joins(scan_frame, each.frame)]
    return joined or list(cameras)


def why_not_joined(tree: FrameTree, camera: RigCamera, scan_frame: str) -> str:
    """Describe why a camera has no calibration: which link moves, or that there is none."""
    try:
        lines = tree.steps(scan_frame, camera.frame)
    except MissingDataError:
        lines = ([], [])
    moving = [f'{above} -> {below}' for line in lines for above, below, fixed in line if not fixed]
    if not moving:
        return f'no static transform joins {camera.frame} to {scan_frame}'
    links = ', '.join(moving)
    return f'{camera.frame} moves against {scan_frame} ({links}), so it has no fixed calibration'


def describe_others(
    tree: FrameTree,
    heading: Heading | None,
    cameras: Sequence[RigCamera],
    choice: Choice,
    scan_frame: str | None,
) -> list[str]:
    """Return a note on each camera that was not taken, and on a choice by name.

    Args:
        tree: The static transforms.
        heading: The robot's forward; None where it is unknown.
        cameras: All of them.
        choice: Those that were taken.
        scan_frame: That of the scans, None without scans.
    """
    joined = joined_cameras(tree, cameras, scan_frame)
    taken = {each.name for each in choice.cameras.values()}
    others = [each for each in cameras if each.name not in taken]
    notes = []
    if choice.by_name:
        main = choice.cameras[2].topic.name
        notes.append(
            f'camera 2 is {main} by its name: no static transform tells where the cameras look'
        )
    notes += describe_steep(tree, heading, choice.cameras[2])
    for each in others:
        direction = direction_of(tree, heading, each)
        looks = 'no static transform tells where it looks'
        if scan_frame is not None and each not in joined:
            looks = why_not_joined(tree, each, scan_frame)
        elif direction is not None and heading is not None:
            looks = f'it looks {describe_direction(direction)} (forward is {heading.source})'
        notes.append(f'passed over: {each.topic.name}; {looks}')
    if any(each in joined for each in others):
        notes.append('cameras of the plan takes other cameras; --all-cameras writes a set for each')
    return notes


def describe_steep(tree: FrameTree, heading: Heading | None, camera: RigCamera) -> list[str]:
    """Return a note on a camera that looks up or down: its frame may be no optical one."""
    direction = direction_of(tree, heading, camera)
    if direction is None or not is_steep(direction):
        return []
    note = (
        f'{camera.topic.name}: z of {camera.frame}, the direction the camera looks in, is'
        f' {describe_direction(direction)}; if it is no optical frame, name one as frame of the'
        f' camera in the plan'
    )
    return [note]
