# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of a bag: their topics, which of them become KITTI's, and their images."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.image_files import encode_png, is_in_kitti_form, parse_png
from ..messages.camera_info import PLUMB_BOB, camera_model, lens_model
from ..messages.images import LOSSY, as_grey, picture_kind, pixels_of, png_of, size_of
from ..messages.naming import without_transport
from ..messages.rectified_cameras import (
    Rectifier,
    angle_of,
    has_lens_of_larger_image,
    needs_rectifying,
)
from ..messages.tf_tree import (
    AXES,
    Heading,
    describe_direction,
    find_body,
    is_optical,
    known_heading,
    nearest_axis,
    root_heading,
)
from ..messages.topics import view_topics
from ..messages.videos import (
    TITLES,
    codec_of,
    picture_size,
    recorded_encoding,
    scaled_to_odd,
)
from ..model import bag_formats as types
from ..model.errors import BadFileError, MissingDataError, UsageError, format_count
from ..model.lenses import MeiLens
from ..model.streams import CAMERA_NAMES, GREY_CAMERAS, PngForm
from .plan import X_FORWARD, CameraPlan
from .survey import topic_of
from .tf_frames import optical_link, optical_name

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from ..messages.camera_info import CameraModel
    from ..messages.images import Pixels
    from ..messages.tf_tree import FrameTree, Link
    from ..model.geometry import Float64Array
    from ..model.streams import Layout
    from .plan import Plan
    from .survey import Survey, TopicSurvey


# The model of a camera, by its CameraInfo and its images.


def camera_of(survey: Survey, name: str) -> CameraModel:
    """Return the camera of the CameraInfo topic that a plan names.

    Raises:
        UsageError: The bag has no such topic, or it has no messages.
        ValueError: It is of another type, or its first message is no valid calibration.
    """
    info = topic_of(survey, name)
    if info.msgtype != types.CAMERA_INFO or not info.samples:
        reason = info.failure or f'it is a {info.msgtype}'
        raise ValueError(f'no CameraInfo ({reason})')
    return camera_model(info.samples[0])


def image_size(images: TopicSurvey) -> tuple[int, int] | None:
    """Return (width, height) of the first image of a topic whose size is known; None without."""
    find_size = size_of if images.keys is None else picture_size
    return next(filter(None, map(find_size, images.samples)), None)


def of_images(model: CameraModel, images: TopicSurvey) -> CameraModel:
    """Return a camera with the size of its images where its own has width and height swapped.

    The principal point of P shows that the size is wrong, and not that the image is turned:
    it is nearer to the middle of the images.
    """
    size = image_size(images)
    if size is None or size == model.size or size != model.size[::-1]:
        return model
    aside, aside_own = (
        float(np.linalg.norm(model.p[:2, 2] - np.array(shape) / 2)) for shape in (size, model.size)
    )
    return replace(model, size=size) if aside < aside_own else model


# The cameras of a bag: the best image topic of each, and its CameraInfo.

_DEPTH = re.compile(r'depth|disparity|confidence|mask|segment|annotated', re.IGNORECASE)
_GREY = re.compile(r'infra|mono|gr[ae]y', re.IGNORECASE)
_LEFT = re.compile(r'(^|[/_])left([/_]|$)', re.IGNORECASE)
_RIGHT = re.compile(r'(^|[/_])right([/_]|$)', re.IGNORECASE)
_FRONT = re.compile(r'front|forward', re.IGNORECASE)
_BACK = re.compile(r'back|rear', re.IGNORECASE)
_ANY_SIDE = re.compile(r'left|right', re.IGNORECASE)
_DEPTH_ENCODINGS = frozenset({'16UC1', '32FC1', '16SC1'})
_IMAGE_NAMES = ('image_rect_color', 'image_rect', 'image_color', 'image_raw', 'image', 'image_mono')
_ROTATION = 1e-3


@dataclass(frozen=True, eq=False)
class RigCamera:
    """A camera of a bag.

    Attributes:
        name: The common part of its topics, such as /CAM_FRONT.
        topic: Its best image topic.
        info: Its CameraInfo, None without one.
        own_frame: Its frame where it is not that of the CameraInfo.
        forward: As in CameraPlan.
    """

    name: str
    topic: TopicSurvey
    info: TopicSurvey | None = None
    own_frame: str = ''
    forward: str = ''

    @property
    def frame(self) -> str:
        """Its optical frame, which may be made."""
        return optical_name(self.bag_frame, self.forward)

    @property
    def bag_frame(self) -> str:
        """Its frame in the bag."""
        of_info = self.info.frame_id if self.info is not None else ''
        return self.own_frame or of_info or self.topic.frame_id

    @cached_property
    def r(self) -> Float64Array:
        """(3, 3) optical to rectified frame; the identity where the CameraInfo has no rotation."""
        rotation = self._matrix('r', (3, 3))
        if rotation is None or not np.abs(rotation @ rotation.T - np.eye(3)).max() < _ROTATION:
            return np.eye(3)
        return rotation

    @cached_property
    def offset(self) -> Float64Array:
        """(3,) metres that P's fourth column adds to points of the rectified frame."""
        p = self._matrix('p', (3, 4))
        if p is None or not abs(np.linalg.det(p[:, :3])) > 0:
            return np.zeros(3)
        return np.asarray(np.linalg.solve(p[:, :3], p[:, 3]), np.float64)

    @cached_property
    def focal(self) -> float:
        """Focal length of the rectified image, pixels; 0 where the camera is not calibrated."""
        p, k = self._matrix('p', (3, 4)), self._matrix('k', (3, 3))
        return next((float(m[0, 0]) for m in (p, k) if m is not None and m[0, 0] > 0), 0.0)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height by the CameraInfo, 0 where unknown."""
        message = self.info.samples[0] if self.info is not None and self.info.samples else None
        return int(getattr(message, 'width', 0)), int(getattr(message, 'height', 0))

    @property
    def is_grey(self) -> bool:
        """Return whether its images have one channel, by their encoding or their name."""
        first = self.topic.samples[0]
        encoding = str(
            recorded_encoding(first)
            or getattr(first, 'encoding', '')
            or getattr(first, 'format', '')
        )
        return encoding.startswith(('mono', '8UC1', '16UC1')) or bool(_GREY.search(self.name))

    @property
    def name_rank(self) -> int:
        """Rank by name: front, front left, left, others, right, back."""
        if _BACK.search(self.name):
            return 5
        if _RIGHT.search(self.name):
            return 4
        if _FRONT.search(self.name):
            return 1 if _ANY_SIDE.search(self.name) else 0
        return 2 if _LEFT.search(self.name) else 3

    def is_left_of(self, other: RigCamera) -> bool:
        """Return whether the names are those of a pair: the same but for left and right."""
        swapped = _LEFT.sub(r'\1right\2', self.name.lower())
        return bool(_LEFT.search(self.name)) and swapped == other.name.lower()

    def _matrix(self, field: str, shape: tuple[int, int]) -> Float64Array | None:
        """Return a matrix of the CameraInfo, None where it is absent, all zero or not finite."""
        message = self.info.samples[0] if self.info is not None and self.info.samples else None
        numbers = np.asarray(getattr(message, field, ()), np.float64).ravel()
        if numbers.size != shape[0] * shape[1] or not numbers.any():
            return None
        return numbers.reshape(shape) if np.isfinite(numbers).all() else None


def find_cameras(survey: Survey) -> list[RigCamera]:
    """Return the cameras of a bag, by name."""
    groups: dict[str, list[TopicSurvey]] = {}
    for topic in survey.of_type(types.IMAGE, types.COMPRESSED, *types.VIDEOS):
        if topic.samples and not _is_depth(topic):
            groups.setdefault(without_transport(topic.name).rpartition('/')[0], []).append(topic)
    infos = {info_topic.name: info_topic for info_topic in survey.of_type(types.CAMERA_INFO)}
    image_topics = [
        (name, min(own, key=_image_rank))
        for folder, topics in sorted(groups.items())
        for name, own in _apart(folder, topics).items()
    ]
    owners = {name: _own_info(infos, name, topic) for name, topic in image_topics}
    taken_infos = {info.name for info in owners.values() if info is not None}
    for name, topic in sorted(image_topics, key=lambda camera: (_image_rank(camera[1]), camera[0])):
        # Nodes that draw on images publish them with the frame of the camera.
        info = owners[name] or _info_of_frame(infos, topic)
        if owners[name] is None and info is not None:
            owners[name] = None if info.name in taken_infos else info
            taken_infos.add(info.name)
    return [RigCamera(name, topic, owners[name]) for name, topic in image_topics]


def leaf(topic: str) -> str:
    """Return the last part of an image topic, without that of a transport."""
    return without_transport(topic).rpartition('/')[2]


def _apart(folder: str, topics: list[TopicSurvey]) -> dict[str, list[TopicSurvey]]:
    """Divide the topics of a folder by their frames: several are of as many cameras."""
    frame_ids = {topic.frame_id for topic in topics if topic.frame_id}
    if len(frame_ids) <= 1:
        return {folder: topics}
    topics_by_camera: dict[str, list[TopicSurvey]] = {}
    names: dict[str, str] = {}
    for topic in topics:
        if topic.frame_id:
            name = names.setdefault(topic.frame_id, without_transport(topic.name))
            topics_by_camera.setdefault(name, []).append(topic)
    return topics_by_camera


def _own_info(
    infos: Mapping[str, TopicSurvey], name: str, topic: TopicSurvey
) -> TopicSurvey | None:
    """Return the CameraInfo beside an image (image_transport/camera_common.h)."""
    names = f'{name}/camera_info', f'{without_transport(topic.name)}/camera_info'
    return next((infos[info_name] for info_name in names if info_name in infos), None)


def _info_of_frame(infos: Mapping[str, TopicSurvey], topic: TopicSurvey) -> TopicSurvey | None:
    """Return the only CameraInfo of an image's frame."""
    same = [info for info in infos.values() if topic.frame_id and info.frame_id == topic.frame_id]
    return same[0] if len(same) == 1 else None


def _is_depth(topic: TopicSurvey) -> bool:
    first = topic.samples[0]
    if topic.msgtype == types.IMAGE:
        return first.encoding in _DEPTH_ENCODINGS or bool(_DEPTH.search(topic.name))
    return 'compressedDepth' in getattr(first, 'format', '') or bool(_DEPTH.search(topic.name))


def _image_rank(topic: TopicSurvey) -> tuple[int, int]:
    """Rank: rectified and coloured first; of one image PNG files, pixels, JPEG, video."""
    name = leaf(topic.name)
    name_rank = _IMAGE_NAMES.index(name) if name in _IMAGE_NAMES else len(_IMAGE_NAMES)
    if topic.msgtype == types.IMAGE:
        return name_rank, 1
    if topic.keys is not None:
        return name_rank, 3
    return name_rank, 0 if 'png' in topic.samples[0].format else 2


# Choice of KITTI's cameras by the directions they look in.
#
# Camera 2 is the one that looks most along the robot's forward. A pair (2 and 3, 0 and 1) is two
# cameras that look the same way, the right one a baseline along x away from the left one: by static
# transforms, or by the P of the right one (sensor_msgs/CameraInfo.msg).

_ALIKE_RAD = np.radians(5)
_SIDEWAYS = 0.2
_NO_BASELINE_M = 1e-3
_BASELINE_M = (0.01, 3.0)
_SAME_FOCAL = 0.1
_STEEP = np.sin(np.radians(75))
_MOST_COMPARED = 64  # two by two; rigs have some ten
_OWN_DIRECTION_RANK = 3  # of names that say nothing, or front


@dataclass(frozen=True)
class CameraChoice:
    """The chosen cameras.

    Attributes:
        cameras: By KITTI's numbers.
        by_name: Whether camera 2 was chosen by its name alone.
    """

    cameras: dict[int, RigCamera]
    by_name: bool = False


@dataclass(frozen=True)
class CameraRig:
    """Cameras of a bag, with the frames that give their directions.

    Attributes:
        cameras: With frames of the tree that are optical ones.
        tree: The static transforms, also to frames that are made.
        heading: The robot's forward; None where it is unknown.
    """

    cameras: Sequence[RigCamera]
    tree: FrameTree
    heading: Heading | None


def make_camera_rig(
    survey: Survey, cameras: Sequence[RigCamera], heading: Heading | None, notes: list[str]
) -> CameraRig:
    """Return cameras with frames of the bag's tree that are optical ones, and note changes."""
    tree = survey.tree
    placed = [
        _with_optical(_with_frame(camera, tree, notes), tree, heading, notes) for camera in cameras
    ]
    links = [optical_link(camera.bag_frame, camera.forward) for camera in placed if camera.forward]
    return CameraRig(placed, survey.tree_with(links), heading)


def _with_frame(camera: RigCamera, tree: FrameTree, notes: list[str]) -> RigCamera:
    """Take the frame of the images where the tree has not that of the CameraInfo."""
    named = '' if camera.info is None else camera.info.frame_id
    if not named or named in tree.frames or camera.topic.frame_id not in tree.frames:
        return camera
    notes.append(
        f'{camera.topic.name}: no transform names {named}, the frame of its camera_info; that of'
        f' its images, {camera.topic.frame_id}, is taken'
    )
    return replace(camera, own_frame=camera.topic.frame_id)


def _with_optical(
    camera: RigCamera, tree: FrameTree, heading: Heading | None, notes: list[str]
) -> RigCamera:
    """Take a frame with z up, unless it is named optical, as one with x forward.

    A camera that looks up in such a frame is not detected.
    """
    frame_id = camera.bag_frame
    axes = None if heading is None else heading.axes_of(tree, frame_id)
    if camera.info is None or is_optical(frame_id) or axes is None or axes[2, 2] < _STEEP:
        return camera
    notes.append(
        f'{camera.topic.name}: z of {frame_id} is up, so it is taken as a frame with x forward, in'
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
    joined = [camera for camera in cameras if tree.joins(scan_frame, camera.frame)]
    return (
        known_heading(tree, scan_frame)
        or _camera_heading(tree, scan_frame, [camera for camera in joined if camera.name_rank == 0])
        or root_heading(tree, sensors)
        or _camera_heading(tree, scan_frame, joined)
        or Heading(scan_frame, AXES['x'], f'x of {scan_frame}', assumed=True)
    )


def direction_of(rig: CameraRig, camera: RigCamera) -> Float64Array | None:
    """Return (3,) the direction a camera looks in, in forward, left, up; None if not joined."""
    axes = None if rig.heading is None else rig.heading.axes_of(rig.tree, camera.frame)
    return None if axes is None else (axes @ camera.r.T)[:, 2]


def choose_cameras(rig: CameraRig) -> CameraChoice:
    """Choose camera 2, and the pairs beside it; of many, among those that look most ahead.

    Args:
        rig: At least one camera, those with a CameraInfo.
    """
    tree, cameras = rig.tree, rig.cameras
    directions = {camera.name: direction_of(rig, camera) for camera in cameras}
    if len(cameras) > _MOST_COMPARED:
        cameras = sorted(cameras, key=lambda camera: _angle(directions[camera.name]))[
            :_MOST_COMPARED
        ]
    rights = {
        right.name
        for left, right in permutations(cameras, 2)
        if left.is_grey == right.is_grey and is_pair(tree, left, right)
    }
    joined = [camera for camera in cameras if directions[camera.name] is not None]
    angles = {camera.name: _angle(directions[camera.name]) for camera in joined}
    nearest = min(angles.values(), default=0.0)
    ahead = [camera for camera in joined if angles[camera.name] <= nearest + _ALIKE_RAD] or cameras
    if joined and all(is_steep(directions[camera.name]) for camera in joined):
        ahead = joined  # their frames are no optical ones: names are safer than a lean
    main = min(
        ahead,
        key=lambda camera: (camera.name in rights, camera.is_grey, camera.name_rank, camera.name),
    )
    chosen = {2: main}
    mates = [camera for camera in cameras if is_pair(tree, main, camera)]
    mates = [mate for mate in mates if not _is_of_another(tree, main, mate, cameras)]
    if not mates and not joined:
        mates = [
            camera for camera in cameras if main.is_left_of(camera) and camera.frame == main.frame
        ]
    if mates:
        chosen[3] = min(mates, key=partial(_mate_rank, main))
    names = {camera.name for camera in chosen.values()}
    rest = [
        camera for camera in cameras if camera.name not in names and _is_alike(tree, main, camera)
    ]
    grey = [pair for pair in permutations(rest, 2) if is_pair(tree, *pair)]
    if grey:
        chosen[0], chosen[1] = grey[0]
    return CameraChoice(chosen, by_name=not joined and len(cameras) > len(chosen))


def _is_of_another(
    tree: FrameTree, left: RigCamera, right: RigCamera, cameras: Sequence[RigCamera]
) -> bool:
    """Return whether a camera that no transform joins to a left one is named as of another pair."""
    if tree.joins(left.frame, right.frame) or left.is_left_of(right):
        return False
    return any(camera.is_left_of(right) for camera in cameras)


def _mate_rank(left: RigCamera, right: RigCamera) -> tuple[bool, bool, str]:
    return left.is_grey != right.is_grey, not left.is_left_of(right), right.name


def is_pair(tree: FrameTree, left: RigCamera, right: RigCamera) -> bool:
    """Return whether two cameras are a stereo pair, in this order."""
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
    pose = tree.find(left.frame, right.frame)
    if pose is None:
        return -right.offset if not _has_baseline(left) and _has_baseline(right) else None
    if np.linalg.norm(pose.translation) < _NO_BASELINE_M:
        return left.offset - right.offset if angle_of(pose.rotation) < _ALIKE_RAD else None
    if angle_of(left.r @ pose.rotation @ right.r.T) > _ALIKE_RAD:
        return None
    return np.asarray(left.r @ pose.translation, np.float64)


def _has_baseline(camera: RigCamera) -> bool:
    return bool(np.linalg.norm(camera.offset) >= _NO_BASELINE_M)


def _is_alike(tree: FrameTree, main: RigCamera, other: RigCamera) -> bool:
    pose = tree.find(main.frame, other.frame)
    return pose is not None and angle_of(main.r @ pose.rotation @ other.r.T) <= _ALIKE_RAD


def _angle(direction: Float64Array | None) -> float:
    return np.pi if direction is None else float(np.arccos(np.clip(direction[0], -1, 1)))


def is_steep(direction: Float64Array | None) -> bool:
    """Return whether a direction is up or down; not where it is unknown."""
    return direction is not None and bool(abs(direction[2]) >= _STEEP)


def _camera_heading(
    tree: FrameTree, scan_frame: str, cameras: Sequence[RigCamera]
) -> Heading | None:
    """Return the direction of cameras, if all look the same way, as a scanner's axis.

    A camera whose name says another side than front is no front camera.
    """
    turns = [
        tree.transform(scan_frame, camera.frame).rotation @ camera.r.T @ AXES['z']
        for camera in cameras
    ]
    if not turns or any(angle_of(turns[0].T @ turn) > np.radians(30) for turn in turns):
        return None
    if len(cameras) == 1 and cameras[0].name_rank > _OWN_DIRECTION_RANK:
        return None
    return Heading(scan_frame, AXES[nearest_axis(turns[0])], f'where {cameras[0].topic.name} looks')


# Notes on the cameras of a bag: why each is unused, and which look up or down.


def joined_cameras(rig: CameraRig, scan_frame: str | None) -> list[RigCamera]:
    """Return the cameras that static transforms join to the scans; all if none is, or no scans."""
    cameras = list(rig.cameras)
    if scan_frame is None:
        return cameras
    return [camera for camera in cameras if rig.tree.joins(scan_frame, camera.frame)] or cameras


def unjoined_reason(tree: FrameTree, camera: RigCamera, scan_frame: str) -> str:
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


def describe_others(rig: CameraRig, choice: CameraChoice, scan_frame: str | None) -> list[str]:
    """Return a note on each unused camera, and on a choice by name.

    Args:
        rig: All of them.
        choice: The chosen ones.
        scan_frame: The frame of the scans, None without scans.
    """
    joined = joined_cameras(rig, scan_frame)
    taken_names = {camera.name for camera in choice.cameras.values()}
    others = [camera for camera in rig.cameras if camera.name not in taken_names]
    notes = []
    if choice.by_name:
        main = choice.cameras[2].topic.name
        notes.append(
            f'camera 2 is {main} by its name: no static transform tells where the cameras look'
        )
    notes += describe_steep(rig, choice.cameras[2])
    for other in others:
        direction = direction_of(rig, other)
        reason = 'no static transform tells where it looks'
        if scan_frame is not None and other not in joined:
            reason = unjoined_reason(rig.tree, other, scan_frame)
        elif direction is not None and rig.heading is not None:
            forward = rig.heading.source
            reason = f'it looks {describe_direction(direction)} (forward is {forward})'
        notes.append(f'passed over: {other.topic.name}; {reason}')
    if any(other in joined for other in others):
        notes.append('cameras of the plan takes other cameras; --all-cameras writes a set for each')
    return notes


def describe_steep(rig: CameraRig, camera: RigCamera) -> list[str]:
    """Return a note on a camera that looks up or down: its frame may be no optical one."""
    direction = direction_of(rig, camera)
    if direction is None or not is_steep(direction):
        return []
    note = (
        f'{camera.topic.name}: z of {camera.frame}, the direction the camera looks in, is'
        f' {describe_direction(direction)}; if it is no optical frame, name one as frame of the'
        f' camera in the plan'
    )
    return [note]


# Choice of cameras: KITTI's number of each, by geometry, else by names.

_NOT_IN_NAMES = re.compile(r'[^A-Za-z0-9_-]+')


def main_camera(cameras: Collection[int]) -> int:
    """Return the left colour camera, that of KITTI's labels, or else the first."""
    return 2 if 2 in cameras else min(cameras)


def guess_cameras(
    layout: Layout, rig: CameraRig, scan_frame: str | None, notes: list[str]
) -> dict[int, CameraPlan]:
    """Choose up to four cameras by KITTI's numbers.

    Args:
        layout: Images of raw may stay distorted.
        rig: The cameras of the bag.
        scan_frame: The frame of the scans, None without scans.
        notes: A note on each other camera is added.
    """
    if not rig.cameras:
        notes.append('missing: images (no camera)')
        return {}
    cameras = _without_fisheyes(_with_info(rig.cameras, notes), notes)
    if not cameras:
        return {}
    chosen = _by_own_names(cameras)
    if not chosen and not any(camera.info is not None and camera.frame for camera in cameras):
        # Images without frames have no directions, and nothing is projected wrongly.
        order = sorted(cameras, key=lambda camera: (camera.name_rank, camera.name))
        chosen = dict(zip((2, 3, 0, 1), order, strict=False))
        notes += [
            f'passed over: {camera.topic.name}; KITTI has four cameras' for camera in order[4:]
        ]
    elif not chosen:
        rig = replace(rig, cameras=cameras)
        choice = choose_cameras(rig)
        chosen = choice.cameras
        notes += describe_others(rig, choice, scan_frame)
    notes += _describe_rectified(chosen.values())
    return {index: _plan(layout, camera) for index, camera in sorted(chosen.items())}


def guess_camera_sets(
    layout: Layout, rig: CameraRig, scan_frame: str | None, notes: list[str]
) -> dict[str, CameraPlan]:
    """Return the plans of all cameras, by the names of their sets.

    Args:
        layout: Images of raw may stay distorted.
        rig: The cameras of the bag.
        scan_frame: The frame of the scans, None without scans. Cameras that are not joined to it
            (behind a joint that moves) have no calibration; unless none is joined.
        notes: A note on each camera without a set is added.
    """
    with_info = _without_fisheyes(_with_info(rig.cameras, notes), notes)
    cameras = [camera for camera in with_info if camera.focal] or with_info
    notes += [
        f'passed over: {camera.topic.name}; its camera_info is not calibrated'
        for camera in with_info
        if camera not in cameras
    ]
    if scan_frame is not None:
        joined = joined_cameras(replace(rig, cameras=cameras), scan_frame)
        notes += [
            f'passed over: {camera.topic.name}; {unjoined_reason(rig.tree, camera, scan_frame)}'
            for camera in cameras
            if camera not in joined
        ]
        cameras = joined
    notes += [note for camera in cameras for note in describe_steep(rig, camera)]
    notes += _describe_rectified(cameras)
    names = _short_names([camera.name for camera in cameras])
    return {
        name: _plan(layout, camera)
        for name, camera in zip(names, cameras, strict=True)
        if camera.info is not None
    }


def keeps_distortion(survey: Survey, cameras: Iterable[CameraPlan]) -> bool:
    """Return whether raw images stay distorted, so that the drive is an extract."""
    for plan in cameras:
        infos = survey.topics[plan.info].samples if plan.info else []
        if not infos or plan.rectify or 'rect' in leaf(plan.topic):
            continue
        if np.any(infos[0].d) and not _is_rectified(infos[0], survey.topics[plan.topic]):
            return True
    return False


def _with_info(rig: Sequence[RigCamera], notes: list[str]) -> list[RigCamera]:
    """Return the cameras with a CameraInfo, or all where none has one."""
    with_info = [camera for camera in rig if camera.info is not None]
    if not with_info:
        return list(rig)
    notes += [
        f'passed over: {camera.topic.name}; it has no camera_info'
        for camera in rig
        if camera.info is None
    ]
    return with_info


def _without_fisheyes(cameras: Sequence[RigCamera], notes: list[str]) -> list[RigCamera]:
    """Return the cameras but those of a model that no CameraInfo of ROS describes (KITTI-360).

    Nor are their pinhole views cameras: these look to the sides, and are made of the same images.
    """
    views = [camera for camera in cameras if camera.topic.name in view_topics()]
    notes += [
        f'passed over: {camera.topic.name}; it is made of the images of a fisheye'
        for camera in views
    ]
    fisheyes = [
        camera
        for camera in cameras
        if camera.info is not None
        and camera.info.samples
        and camera.info.samples[0].distortion_model == MeiLens.model
    ]
    notes += [f'passed over: {camera.topic.name}; it is a fisheye' for camera in fisheyes]
    return [camera for camera in cameras if camera not in (*fisheyes, *views)]


def _by_own_names(cameras: Sequence[RigCamera]) -> dict[int, RigCamera]:
    """Return the cameras by KITTI's numbers if all have the names of to-bag and kitti2bag."""
    numbered = {
        index: camera
        for index, own in CAMERA_NAMES.items()
        for camera in cameras
        if camera.name.lower().endswith(f'camera_{own}')
    }
    return numbered if len(numbered) == len(cameras) else {}


def _plan(layout: Layout, camera: RigCamera) -> CameraPlan:
    if camera.info is None:
        return CameraPlan(camera.topic.name)
    frame_id = camera.own_frame or ('' if camera.info.frame_id else camera.topic.frame_id)
    rectify = _rectify(layout, camera)
    return CameraPlan(camera.topic.name, camera.info.name, rectify, frame_id, camera.forward)


def _rectify(layout: Layout, camera: RigCamera) -> bool:
    """Return whether to rectify: distorted images, except in raw where K and D describe them."""
    if camera.info is None or not _has_lens(camera):
        return False
    message = camera.info.samples[0]
    d = np.asarray(message.d, np.float64)
    plain = lens_model(message.distortion_model, d) == PLUMB_BOB and len(d) <= 5
    return not (layout.traits.extracts and plain) and not _is_rectified(message, camera.topic)


def _has_lens(camera: RigCamera) -> bool:
    """Return whether a camera is not rectified by its numbers, nor by the name of its images."""
    messages = camera.info.samples if camera.info is not None else []
    if not messages or 'rect' in leaf(camera.topic.name):
        return False
    message = messages[0]
    return needs_rectifying(message.k, message.d, message.p)


def _describe_rectified(cameras: Iterable[RigCamera]) -> list[str]:
    """Return a note on the cameras whose lens is that of other images."""
    names = [
        camera.topic.name
        for camera in cameras
        if camera.info is not None
        and _has_lens(camera)
        and _is_rectified(camera.info.samples[0], camera.topic)
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
    """Return whether the images of a CameraInfo with a distortion are rectified."""
    try:
        return has_lens_of_larger_image(of_images(camera_model(message), images))
    except ValueError:  # the conversion refuses it
        return False


def _short_names(names: Iterable[str]) -> list[str]:
    """Return names for folders: the last parts of each topic, as many as make them unique."""
    parts = [
        [_NOT_IN_NAMES.sub('_', part) for part in name.split('/') if part] or ['camera']
        for name in names
    ]
    for count in range(1, max(map(len, parts), default=0) + 1):
        short = ['_'.join(name_parts[-count:]) for name_parts in parts]
        if len({name.lower() for name in short}) == len(short):
            return short
    return [f'{"_".join(name_parts)}_{number}' for number, name_parts in enumerate(parts)]


# The cameras of a bag beside those of a plan: all of them show how frames and P are meant.
#
# A plan may take one camera of a pair, and each of camera_sets takes one camera.


def other_cameras(plan: Plan, survey: Survey) -> tuple[list[CameraModel], list[Link]]:
    """Return the models of the other cameras of a bag, and links to the frames made for them.

    They have the frames that a guessed plan gives them. Cameras that are not calibrated are left
    out.
    """
    cameras = find_cameras(survey)
    heading = find_heading(survey.tree, None if plan.scan is None else plan.scan.frame, cameras)
    taken_infos = {camera.info for camera in plan.cameras.values()}
    models: list[CameraModel] = []
    links: dict[str, Link] = {}
    for other in make_camera_rig(survey, cameras, heading, []).cameras:
        if other.info is None or other.info.name in taken_infos or not other.info.samples:
            continue
        try:
            model = camera_model(other.info.samples[0])
        except ValueError:  # of a plan's camera it is an error
            continue
        models.append(replace(model, frame=other.frame))
        if other.forward:
            links[other.frame] = optical_link(other.bag_frame, other.forward)
    return models, list(links.values())


# Image and CompressedImage -> KITTI's images, rectified where the plan requests it.

_DEPTH_BYTE = 24
"""The offset of the bits a channel in a PNG: the signature, the head of IHDR, width and height."""
_USUAL_BITS = 8
_AS_PNG = 'PNG'
_ENCODED_ANEW = "encoded anew, from PNG that are not in KITTI's form; --png fast keeps their bytes"


class ImageConversion:
    """Converts the images of a plan's cameras; thread-safe.

    Attributes:
        models: The cameras with a CameraInfo, by KITTI index.
    """

    def __init__(self, plan: Plan, survey: Survey, models: Mapping[int, CameraModel]) -> None:
        """Prepare the rectification.

        Args:
            plan: Names the cameras.
            survey: The survey of the bag.
            models: The cameras with a CameraInfo, by KITTI index.

        Raises:
            UsageError: The plan names a missing topic, or rectifies what cannot be rectified.
        """
        self.models = models
        self._rectifiers = {
            index: _rectifier(plan.cameras[index], model)
            for index, model in models.items()
            if plan.cameras[index].rectify
        }
        self._models = models
        self._topics = {index: camera.topic for index, camera in plan.cameras.items()}
        self._videos = _videos(plan, survey)
        self._video_notes = video_notes(plan, survey)
        self._deep: Counter[int] = Counter()
        self._encoded: Counter[tuple[int, str]] = Counter()
        self._scaled: Counter[int] = Counter()
        self._lock = Lock()
        self._sizes = _sizes(plan, survey) | {index: model.size for index, model in models.items()}

    def model(self, camera: int) -> CameraModel | None:
        """Return the model of a camera, None without a CameraInfo."""
        return self._models.get(camera)

    def size(self, camera: int) -> tuple[int, int] | None:
        """Return (width, height) of a camera's images, None where unknown so far."""
        return self._sizes.get(camera)

    def png(self, camera: int, message: Any, form: PngForm = PngForm.FAST) -> bytes:  # noqa: ANN401 - of the bag's types
        """Convert an Image or CompressedImage to a PNG file, rectified where the plan requests it.

        Raises:
            ValueError: It cannot be decoded, or its size differs from other images of the camera.
        """
        rectifier = self._rectifiers.get(camera)
        compressed = hasattr(message, 'format')
        own = png_of(message) if compressed and rectifier is None else None
        if own is not None and (form is not PngForm.KITTI or is_in_kitti_form(own)):
            try:
                # png_of has checked its checksums.
                image = parse_png(own, 'the message', len(own))
            except BadFileError as error:
                raise ValueError(str(error)) from None
            self._check_size(camera, (image.width, image.height))
            if own[_DEPTH_BYTE] > _USUAL_BITS:
                self._count_deep(camera)
            return own
        pixels = self.pixels(camera, message)
        if pixels.dtype.itemsize > 1:
            self._count_deep(camera)
        if form is PngForm.KITTI:
            if compressed and own is None:
                self._count_encoded(camera, picture_kind(message))
            if camera in GREY_CAMERAS:
                pixels = as_grey(pixels, most_tint=0)
        png = encode_png(pixels, form)
        if own not in (None, png):
            self._count_encoded(camera, _AS_PNG)
        return png

    def pixels(self, camera: int, message: Any) -> Pixels:  # noqa: ANN401 - of the bag's types
        """Decode an Image or CompressedImage, rectified where the plan requests it.

        Returns:
            (H, W), or (H, W, 3) BGR, uint8 or uint16.

        Raises:
            ValueError: As png.
        """
        pixels = pixels_of(message, deep=True)
        if camera in self._videos:
            pixels = self._of_camera_size(camera, pixels)
        self._check_size(camera, (pixels.shape[1], pixels.shape[0]))
        rectifier = self._rectifiers.get(camera)
        return pixels if rectifier is None else rectifier.apply(pixels)

    def notes(self) -> list[str]:
        """Return notes on the images so far."""
        notes = [
            f'{self._topics[camera]}: {count} images have 16 bits a channel, and are written so;'
            f" KITTI's have 8"
            for camera, count in sorted(self._deep.items())
        ]
        for (camera, kind), count in sorted(self._encoded.items()):
            how = f"decoded from {kind}: not KITTI's own pixels"
            how = _ENCODED_ANEW if kind == _AS_PNG else how
            notes.append(f'{self._topics[camera]}: {format_count(count, "image")} {how}')
        for camera, count in sorted(self._scaled.items()):
            width, height = self._sizes[camera]
            notes.append(
                f'{self._topics[camera]}: {count} images are scaled by a pixel to {width}x{height},'
                f' the size of the camera_info: encoders make sizes even'
            )
        return [*self._video_notes, *notes]

    def _of_camera_size(self, camera: int, pixels: Pixels) -> Pixels:
        """Scale the image of a video by a pixel where it is the size of its camera made even."""
        size = self._sizes.get(camera)
        scaled = None if size is None else scaled_to_odd(pixels, size)
        if scaled is None:
            return pixels
        with self._lock:
            self._scaled[camera] += 1
        return scaled

    def _count_encoded(self, camera: int, kind: str) -> None:
        """Count an image of KITTI's form that was a picture of another kind, or another PNG."""
        if kind in LOSSY or kind == _AS_PNG:
            with self._lock:
                self._encoded[camera, kind] += 1

    def _count_deep(self, camera: int) -> None:
        with self._lock:
            self._deep[camera] += 1

    def _check_size(self, camera: int, size: tuple[int, int]) -> None:
        expected = self._sizes.setdefault(camera, size)
        if size != expected:
            raise ValueError(
                f'the image is {size[0]}x{size[1]}; expected {expected[0]}x{expected[1]}, as the'
                f' rest of its camera: calibration holds for one size only'
            )


def _sizes(plan: Plan, survey: Survey) -> dict[int, tuple[int, int]]:
    """Return (width, height) of each camera, from the first of its images with a known size."""
    sizes = {}
    for index, camera in plan.cameras.items():
        size = image_size(topic_of(survey, camera.topic))
        if size is not None:
            sizes[index] = size
    return sizes


def _videos(plan: Plan, survey: Survey) -> dict[int, TopicSurvey]:
    """Return the topics of the cameras that are videos."""
    topics = {index: topic_of(survey, camera.topic) for index, camera in plan.cameras.items()}
    return {
        index: topic
        for index, topic in topics.items()
        if topic.keys is not None and topic.is_readable
    }


def video_notes(plan: Plan, survey: Survey) -> list[str]:
    """Return a note on the cameras of each codec."""
    names: dict[str, list[str]] = {}
    for _, topic in sorted(_videos(plan, survey).items()):
        names.setdefault(TITLES[codec_of(topic.samples[0])], []).append(topic.name)
    return [
        f'{", ".join(topics)}: images are decoded from video ({codec}), which is lossy: they are'
        f" not the camera's to the pixel"
        for codec, topics in names.items()
    ]


def _rectifier(camera: CameraPlan, model: CameraModel) -> Rectifier:
    try:
        return Rectifier(model)
    except ValueError as error:
        raise UsageError(
            f'{camera.info}: {error}; set rectify: false in the plan where the images are rectified'
        ) from None
