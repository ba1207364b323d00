# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens the ground truth and the result of an evaluation, whose kinds are detected."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..bags.locate import locate_bag, looks_like_bag
from ..messages.naming import FrameNames
from ..model.errors import BadFileError, MissingPathError, NotABagError, UsageError
from .ground_truth_poses import truth_of_file, truth_of_folder
from .rig_frames import frame_t_cam0
from .trajectories import EXPECTED, read_trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ..options.eval_odometry import OdometryOptions
    from ..options.read import ReadOptions
    from ..rig.tf_tree import Link
    from .ground_truth_poses import GroundTruth
    from .trajectories import CameraTrajectory

_EXPECTED = 'a result is a poses file, a TUM file or a bag'


def open_truth(path: Path, read: ReadOptions, options: OdometryOptions) -> GroundTruth:
    """Read a ground truth.

    Raises:
        KittiRos2Error: It cannot be read, or has no poses.
        OSError: It cannot be read.
    """
    if _is_text(path):
        _refuse_gt_topic(path, options)
        return truth_of_file(path, read)
    from ..bags.bag_files import OpenBag  # noqa: PLC0415 - for folders and bags only
    from ..bags.open_source import open_source  # noqa: PLC0415 - as above

    source = open_source(path, read)
    if not isinstance(source, OpenBag):
        _refuse_gt_topic(path, options)
        return truth_of_folder(source)
    from .bag_truth import truth_of_bag  # noqa: PLC0415 - for bags only

    with source as bag:
        return truth_of_bag(bag, options)


def _refuse_gt_topic(path: Path, options: OdometryOptions) -> None:
    if options.gt_topic is not None:
        raise UsageError(f'{path}: is no bag; --gt-topic is for a bag')


def open_result(path: Path, options: OdometryOptions, links: Sequence[Link]) -> CameraTrajectory:
    """Read a result, and convert it to camera 0.

    Args:
        path: A file or a bag.
        options: The topic, link and frame.
        links: Static transforms of the ground truth.

    Raises:
        KittiRos2Error: It cannot be read, or has no poses.
        OSError: It cannot be read.
    """
    if not path.exists():
        raise MissingPathError(path)
    if path.is_dir() and not looks_like_bag(path):
        raise UsageError(f'{path}: is a folder without a bag; {_EXPECTED}')
    if not (path.is_dir() or path.is_file()):
        raise UsageError(f'{path}: is no regular file; {_EXPECTED}')
    if _is_text(path):
        if options.topic is not None or options.tf:
            given = '--tf' if options.tf else '--topic'
            raise UsageError(f'{path}: is a file of poses; {given} is for a bag')
        found = read_trajectory(path)
        own: Sequence[Link] = ()
    else:
        found, own = _open_bag_result(path, options)
    frame = (options.frame or found.frame).lstrip('/')
    return found.moved(frame_t_cam0(frame, own, links)) if frame else found


def _open_bag_result(
    path: Path, options: OdometryOptions
) -> tuple[CameraTrajectory, Sequence[Link]]:
    """Read a result in a bag, and the static transforms of the bag."""
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - for bags only
    from .bag_trajectory import choose_result, read_poses, survey_poses  # noqa: PLC0415 - as above

    with open_bag_source(path) as bag:
        survey = survey_poses(bag)
        plan = choose_result(bag, survey, options)
        found = read_poses(bag, survey, plan)
    if plan.body or options.frame is not None:
        return found, survey.static
    frame = FrameNames().base
    note = f'{plan.topic}: does not name its frame, taken as {frame}; see --frame'
    return replace(found, frame=frame, notes=(*found.notes, note)), survey.static


def _is_text(path: Path) -> bool:
    """Whether a path is a file and no bag.

    Raises:
        BadFileError: It is empty.
        OSError: It cannot be read.
    """
    if not path.is_file():
        return False
    if not path.stat().st_size:
        raise BadFileError(path, 'is empty', f'a bag, or {EXPECTED}')
    try:
        locate_bag(path)
    except NotABagError:
        return True
    return False
