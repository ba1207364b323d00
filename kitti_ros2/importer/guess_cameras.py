# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of cameras: KITTI's number of each, by geometry, else by names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.camera_info import PLUMB_BOB, camera_model, lens_model
from ..model.streams import CAMERA_NAMES
from ..rig.rectify import has_lens_of_larger_image, needs_rectifying
from .camera_geometry import choose_cameras
from .camera_notes import describe_others, describe_steep, joined_cameras, why_not_joined
from .camera_topics import leaf
from .plan import CameraPlan
from .planned_topics import of_images

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from ..model.layouts import Layout
    from ..rig.heading import Heading
    from ..rig.tf_tree import FrameTree
    from .camera_topics import RigCamera
    from .survey import Survey
    from .topic_survey import TopicSurvey

_NOT_IN_NAMES = re.compile(r'[^A-Za-z0-9_-]+')


def main_camera(cameras: Collection[int]) -> int:
    """Return the left colour camera, that of KITTI's labels, or else the first."""
    return 2 if 2 in cameras else min(cameras)


def guess_cameras(
    layout: Layout,
    rig: Sequence[RigCamera],
    tree: FrameTree,
    heading: Heading | None,
    scan_frame: str | None,
    notes: list[str],
) -> dict[int, CameraPlan]:
    """Choose up to four cameras by KITTI's numbers.

    Args:
        layout: Images of raw may stay distorted.
        rig: The cameras of the bag.
        tree: The static transforms.
        heading: The robot's forward; None where it is unknown.
        scan_frame: That of the scans, None without scans.
        notes: A note on each other camera is added.
    """
    if not rig:
        notes.append('missing: images (no camera)')
        return {}
    cameras = _with_info(rig, notes)
    found = _by_own_names(cameras)
    if not found and not any(each.info is not None and each.frame for each in cameras):
        # Images without frames: nothing tells directions, and nothing is projected wrongly.
        order = sorted(cameras, key=lambda each: (each.name_rank, each.name))
        found = dict(zip((2, 3, 0, 1), order, strict=False))
        notes += [f'passed over: {each.topic.name}; KITTI has four cameras' for each in order[4:]]
    elif not found:
        choice = choose_cameras(tree, heading, cameras)
        found = choice.cameras
        notes += describe_others(tree, heading, cameras, choice, scan_frame)
    notes += _describe_rectified(found.values())
    return {index: _plan(layout, camera) for index, camera in sorted(found.items())}


def guess_camera_sets(
    layout: Layout,
    rig: Sequence[RigCamera],
    tree: FrameTree,
    heading: Heading | None,
    scan_frame: str | None,
    notes: list[str],
) -> dict[str, CameraPlan]:
    """Return the plans of all cameras, by the names of their sets.

    Args:
        layout: Images of raw may stay distorted.
        rig: The cameras of the bag.
        tree: The static transforms.
        heading: The robot's forward; None where it is unknown.
        scan_frame: That of the scans, None without scans. Cameras that are not joined to it, such
            as those behind a joint that moves, have no calibration; unless none is joined.
        notes: A note on each camera without a set is added.
    """
    known = _with_info(rig, notes) if rig else []
    cameras = [each for each in known if each.focal] or known
    notes += [
        f'passed over: {each.topic.name}; its camera_info is not calibrated'
        for each in known
        if each not in cameras
    ]
    if scan_frame is not None:
        joined = joined_cameras(tree, cameras, scan_frame)
        notes += [
            f'passed over: {each.topic.name}; {why_not_joined(tree, each, scan_frame)}'
            for each in cameras
            if each not in joined
        ]
        cameras = joined
    notes += [note for each in cameras for note in describe_steep(tree, heading, each)]
    notes += _describe_rectified(cameras)
    names = _short_names([each.name for each in cameras])
    return {
        name: _plan(layout, camera)
        for name, camera in zip(names, cameras, strict=True)
        if camera.info is not None
    }


def keeps_distortion(survey: Survey, cameras: Iterable[CameraPlan]) -> bool:
    """Whether raw images stay distorted, so that the drive is an extract."""
    for plan in cameras:
        looks = survey.topics[plan.info].looks if plan.info else []
        if not looks or plan.rectify or 'rect' in leaf(plan.topic):
            continue
        if np.any(looks[0].d) and not _is_rectified(looks[0], survey.topics[plan.topic]):
            return True
    return False


def _with_info(rig: Sequence[RigCamera], notes: list[str]) -> list[RigCamera]:
    """Return the cameras with a CameraInfo, or all where none has one."""
    known = [each for each in rig if each.info is not None]
    if not known:
        return list(rig)
    notes += [
        f'passed over: {each.topic.name}; it has no camera_info'
        for each in rig
        if each.info is None
    ]
    return known


def _by_own_names(cameras: Sequence[RigCamera]) -> dict[int, RigCamera]:
    """Return the cameras by KITTI's numbers if all have the names of to-bag and kitti2bag."""
    found = {
        index: camera
        for index, own in CAMERA_NAMES.items()
        for camera in cameras
        if camera.name.lower().endswith(f'camera_{own}')
    }
    return found if len(found) == len(cameras) else {}


def _plan(layout: Layout, camera: RigCamera) -> CameraPlan:
    if camera.info is None:
        return CameraPlan(camera.topic.name)
    frame = camera.own_frame or ('' if camera.info.frame else camera.topic.frame)
    rectify = _rectify(layout, camera)
    return CameraPlan(camera.topic.name, camera.info.name, rectify, frame, camera.forward)


def _rectify(layout: Layout, camera: RigCamera) -> bool:
    """Whether to rectify: distorted images, except in raw where K and D describe them."""
    if camera.info is None or not _has_lens(camera):
        return False
    message = camera.info.looks[0]
    d = np.asarray(message.d, np.float64)
    plain = lens_model(message.distortion_model, d) == PLUMB_BOB and len(d) <= 5
    return not (layout.traits.extracts and plain) and not _is_rectified(message, camera.topic)


def _has_lens(camera: RigCamera) -> bool:
    """Whether a camera is not rectified by its numbers, nor by the name of its images."""
    looks = camera.info.looks if camera.info is not None else []
    if not looks or 'rect' in leaf(camera.topic.name):
        return False
    message = looks[0]
    return needs_rectifying(message.k, message.d, message.p)


def _describe_rectified(cameras: Iterable[RigCamera]) -> list[str]:
    """Return a note on the cameras whose lens is that of other images."""
    names = [
        each.topic.name
        for each in cameras
        if each.info is not None
        and _has_lens(each)
        and _is_rectified(each.info.looks[0], each.topic)
    ]
    if not names:
        return []
    note = (
        f'{", ".join(names)}: taken as rectified already, for K, D and R of the camera_info are'
        f' those of a larger image, and P is that of its size, as kitti2bag writes them; otherwise'
        f' set rectify: true'
    )
    return [note]


def _is_rectified(message: Any, images: TopicSurvey) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether a CameraInfo shows that its images are rectified, though it has a distortion."""
    try:
        return has_lens_of_larger_image(of_images(camera_model(message), images))
    except ValueError:  # the conversion refuses it
        return False


def _short_names(names: Iterable[str]) -> list[str]:
    """Return names for folders: the last part of each topic, as much as tells them apart."""
    parts = [
        [_NOT_IN_NAMES.sub('_', part) for part in name.split('/') if part] or ['camera']
        for name in names
    ]
    for count in range(1, max(map(len, parts), default=0) + 1):
        short = ['_'.join(each[-count:]) for each in parts]
        if len({each.lower() for each in short}) == len(short):
            return short
    return [f'{"_".join(each)}_{number}' for number, each in enumerate(parts)]
