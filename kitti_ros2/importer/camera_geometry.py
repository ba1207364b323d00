# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of KITTI's cameras by the directions they look in.

Camera 2 is the one that looks most along the robot's forward. A pair (2 and 3, 0 and 1) is two
cameras that look the same way, the right one a baseline along x away from the left one: by static
transforms, or by the P of the right one (sensor_msgs/CameraInfo.msg).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from ..rig.heading import (
    AXES,
    Heading,
    find_body,
    is_optical,
    known_heading,
    nearest_axis,
    root_heading,
)
from ..rig.stereo import angle_of
from .optical_frames import X_FORWARD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from ..rig.tf_tree import FrameTree
    from .camera_topics import RigCamera

_ALIKE_RAD = np.radians(5)
_SIDEWAYS = 0.2
_NO_BASELINE_M = 1e-3
_BASELINE_M = (0.01, 3.0)
_SAME_FOCAL = 0.1
_STEEP = np.sin(np.radians(75))
_MOST_COMPARED = 64  # two by two; rigs have some ten
_OWN_DIRECTION_RANK = 3  # of names that say nothing, or front


@dataclass(frozen=True)
class Choice:
    """The cameras taken.

    Attributes:
        cameras: By KITTI's numbers.
        by_name: Whether camera 2 was chosen by its name alone.
    """

    cameras: dict[int, RigCamera]
    by_name: bool = False


def with_frames(
    rig: Sequence[RigCamera], tree: FrameTree, heading: Heading | None, notes: list[str]
) -> list[RigCamera]:
    """Return the cameras with frames of the tree that are optical ones, and note changes."""
    return [_with_optical(_with_known(each, tree, notes), tree, heading, notes) for each in rig]


def _with_known(camera: RigCamera, tree: FrameTree, notes: list[str]) -> RigCamera:
    """Take the frame of the images where the tree has not that of the CameraInfo."""
    named = '' if camera.info is None else camera.info.frame
    if not named or named in tree.frames or camera.topic.frame not in tree.frames:
        return camera
    notes.append(
        f'{camera.topic.name}: no transform names {named}, the frame of its camera_info; that of'
        f' its images, {camera.topic.frame}, is taken'
    )
    return replace(camera, own_frame=camera.topic.frame)


def _with_optical(
    camera: RigCamera, tree: FrameTree, heading: Heading | None, notes: list[str]
) -> RigCamera:
    """Take a frame with z up, unless it is named optical, as one with x forward.

    A camera that looks up in such a frame is not told apart.
    """
    frame = camera.bag_frame
    axes = None if heading is None else heading.axes_of(tree, frame)
    if camera.info is None or is_optical(frame) or axes is None or axes[2, 2] < _STEEP:
        return camera
    notes.append(
        f'{camera.topic.name}: z of {frame} is up, so it is taken as a frame with x forward, in'
        f' which the optical one is made (forward of the camera)'
    )
    return replace(camera, forward=X_FORWARD)


def find_heading(
    tree: FrameTree, scan_frame: str | None, cameras: Sequence[RigCamera]
) -> Heading | None:
    """Return the robot's forward: of its body, its scanner, its cameras, or its scans' x."""
    sensors = [scan_frame or '', *(camera.frame for camera in cameras)]
    heading = find_body(tree, sensors)
    if heading is not None or scan_frame is None:
        return heading
    joined = [each for each in cameras if tree.joins(scan_frame, each.frame)]
    return (
        known_heading(tree, scan_frame)
        or _camera_heading(tree, scan_frame, [each for each in joined if each.name_rank == 0])
        or root_heading(tree, sensors)
        or _camera_heading(tree, scan_frame, joined)
        or Heading(scan_frame, AXES['x'], f'x of {scan_frame}', assumed=True)
    )


def direction_of(
    tree: FrameTree, heading: Heading | None, camera: RigCamera
) -> Float64Array | None:
    """Return (3,) the direction a camera looks in, in forward, left, up; None if not joined."""
    axes = None if heading is None else heading.axes_of(tree, camera.frame)
    return None if axes is None else (axes @ camera.r.T)[:, 2]


def choose_cameras(
    tree: FrameTree, heading: Heading | None, cameras: Sequence[RigCamera]
) -> Choice:
    """Choose camera 2, and the pairs beside it; of many, among those that look most ahead.

    Args:
        tree: The static transforms.
        heading: The robot's forward; None where it is unknown.
        cameras: At least one, those with a CameraInfo.
    """
    directions = {each.name: direction_of(tree, heading, each) for each in cameras}
    if len(cameras) > _MOST_COMPARED:
        cameras = sorted(cameras, key=lambda each: _angle(directions[each.name]))[:_MOST_COMPARED]
    rights = {
        right.name
        for left, right in permutations(cameras, 2)
        if left.is_grey == right.is_grey and is_pair(tree, left, right)
    }
    joined = [each for each in cameras if directions[each.name] is not None]
    angles = {each.name: _angle(directions[each.name]) for each in joined}
    nearest = min(angles.values(), default=0.0)
    ahead = [each for each in joined if angles[each.name] <= nearest + _ALIKE_RAD] or cameras
    if joined and all(is_steep(directions[each.name]) for each in joined):
        ahead = joined  # their frames are no optical ones: names tell more than a lean
    main = min(
        ahead, key=lambda each: (each.name in rights, each.is_grey, each.name_rank, each.name)
    )
    chosen = {2: main}
    mates = [each for each in cameras if is_pair(tree, main, each)]
    mates = [each for each in mates if not _is_of_another(tree, main, each, cameras)]
    if not mates and not joined:
        mates = [each for each in cameras if main.is_left_of(each) and each.frame == main.frame]
    if mates:
        chosen[3] = min(mates, key=partial(_mate_rank, main))
    taken = {each.name for each in chosen.values()}
    rest = [each for each in cameras if each.name not in taken and _looks_as(tree, main, each)]
    grey = [pair for pair in permutations(rest, 2) if is_pair(tree, *pair)]
    if grey:
        chosen[0], chosen[1] = grey[0]
    return Choice(chosen, by_name=not joined and len(cameras) > len(chosen))


def _is_of_another(
    tree: FrameTree, left: RigCamera, right: RigCamera, cameras: Sequence[RigCamera]
) -> bool:
    """Whether a camera that no transform joins to a left one is by its name of another left one."""
    if tree.joins(left.frame, right.frame) or left.is_left_of(right):
        return False
    return any(each.is_left_of(right) for each in cameras)


def _mate_rank(left: RigCamera, right: RigCamera) -> tuple[bool, bool, str]:
    return left.is_grey != right.is_grey, not left.is_left_of(right), right.name


def is_pair(tree: FrameTree, left: RigCamera, right: RigCamera) -> bool:
    """Whether two cameras are a stereo pair, in this order."""
    shortest, longest = sorted((left.focal, right.focal))
    if left.size != right.size or 0 < shortest < (1 - _SAME_FOCAL) * longest:
        return False
    baseline = _baseline(tree, left, right)
    if baseline is None:
        return False
    least, most = _BASELINE_M
    x, aside = float(baseline[0]), float(np.linalg.norm(baseline[1:]))
    return least <= x <= most and aside <= _SIDEWAYS * x


def _baseline(tree: FrameTree, left: RigCamera, right: RigCamera) -> Float64Array | None:
    """Return (3,) the right camera in the rectified left one, metres; None if they look apart.

    Where both name one frame, or no transform joins them, the baseline is that of the right P.
    """
    place = tree.find(left.frame, right.frame)
    if place is None:
        return -right.offset if not _has_baseline(left) and _has_baseline(right) else None
    if np.linalg.norm(place.translation) < _NO_BASELINE_M:
        return left.offset - right.offset if angle_of(place.rotation) < _ALIKE_RAD else None
    if angle_of(left.r @ place.rotation @ right.r.T) > _ALIKE_RAD:
        return None
    return np.asarray(left.r @ place.translation, np.float64)


def _has_baseline(camera: RigCamera) -> bool:
    return bool(np.linalg.norm(camera.offset) >= _NO_BASELINE_M)


def _looks_as(tree: FrameTree, main: RigCamera, other: RigCamera) -> bool:
    place = tree.find(main.frame, other.frame)
    return place is not None and angle_of(main.r @ place.rotation @ other.r.T) <= _ALIKE_RAD


def _angle(direction: Float64Array | None) -> float:
    return np.pi if direction is None else float(np.arccos(np.clip(direction[0], -1, 1)))


def is_steep(direction: Float64Array | None) -> bool:
    """Whether a direction is up or down; not where it is unknown."""
    return direction is not None and bool(abs(direction[2]) >= _STEEP)


def _camera_heading(
    tree: FrameTree, scan_frame: str, cameras: Sequence[RigCamera]
) -> Heading | None:
    """Return the direction of cameras, if all look the same way, as a scanner's axis.

    A camera whose name says another side than front is no front camera.
    """
    turns = [
        tree.transform(scan_frame, each.frame).rotation @ each.r.T @ AXES['z'] for each in cameras
    ]
    if not turns or any(angle_of(turns[0].T @ turn) > np.radians(30) for turn in turns):
        return None
    if len(cameras) == 1 and cameras[0].name_rank > _OWN_DIRECTION_RANK:
        return None
    return Heading(scan_frame, AXES[nearest_axis(turns[0])], f'where {cameras[0].topic.name} looks')
