# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of a bag: the best image topic of each, and its CameraInfo."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..model import msgtypes as types
from .optical_frames import optical_name

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Float64Array
    from .survey import Survey
    from .topic_survey import TopicSurvey

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
        of_info = self.info.frame if self.info is not None else ''
        return self.own_frame or of_info or self.topic.frame

    @cached_property
    def r(self) -> Float64Array:
        """(3, 3) optical to rectified frame; the identity where the CameraInfo has no rotation."""
        found = self._matrix('r', (3, 3))
        if found is None or not np.abs(found @ found.T - np.eye(3)).max() < _ROTATION:
            return np.eye(3)
        return found

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
        look = self.info.looks[0] if self.info is not None and self.info.looks else None
        return int(getattr(look, 'width', 0)), int(getattr(look, 'height', 0))

    @property
    def is_grey(self) -> bool:
        """Whether its images have one channel, by their encoding or their name."""
        looks = self.topic.looks
        encoding = str(getattr(looks[0], 'encoding', '') or getattr(looks[0], 'format', ''))
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
        """Whether the names are those of a pair: the same but for left and right."""
        swapped = _LEFT.sub(r'\1right\2', self.name.lower())
        return bool(_LEFT.search(self.name)) and swapped == other.name.lower()

    def _matrix(self, field: str, shape: tuple[int, int]) -> Float64Array | None:
        """Return a matrix of the CameraInfo, None where it is absent, all zero or not finite."""
        look = self.info.looks[0] if self.info is not None and self.info.looks else None
        numbers = np.asarray(getattr(look, field, ()), np.float64).ravel()
        if numbers.size != shape[0] * shape[1] or not numbers.any():
            return None
        return numbers.reshape(shape) if np.isfinite(numbers).all() else None


def find_cameras(survey: Survey) -> list[RigCamera]:
    """Return the cameras of a bag, by name."""
    groups: dict[str, list[TopicSurvey]] = {}
    for topic in survey.of_type(types.IMAGE, types.COMPRESSED):
        if topic.looks and not _is_depth(topic):
            groups.setdefault(_base(topic.name).rpartition('/')[0], []).append(topic)
    infos = {each.name: each for each in survey.of_type(types.CAMERA_INFO)}
    found = [
        (name, min(own, key=_image_rank))
        for folder, topics in sorted(groups.items())
        for name, own in _apart(folder, topics).items()
    ]
    owners = {name: _own_info(infos, name, topic) for name, topic in found}
    taken = {info.name for info in owners.values() if info is not None}
    for name, topic in sorted(found, key=lambda each: (_image_rank(each[1]), each[0])):
        # Nodes that draw on images publish them with the frame of the camera.
        info = owners[name] or _info_of_frame(infos, topic)
        if owners[name] is None and info is not None:
            owners[name] = None if info.name in taken else info
            taken.add(info.name)
    return [RigCamera(name, topic, owners[name]) for name, topic in found]


def leaf(topic: str) -> str:
    """Return the last part of an image topic, without that of a transport."""
    return _base(topic).rpartition('/')[2]


def _apart(folder: str, topics: list[TopicSurvey]) -> dict[str, list[TopicSurvey]]:
    """Divide the topics of a folder by their frames: several are of as many cameras."""
    frames = {topic.frame for topic in topics if topic.frame}
    if len(frames) <= 1:
        return {folder: topics}
    found: dict[str, list[TopicSurvey]] = {}
    names: dict[str, str] = {}
    for topic in topics:
        if topic.frame:
            name = names.setdefault(topic.frame, _base(topic.name))
            found.setdefault(name, []).append(topic)
    return found


def _own_info(
    infos: Mapping[str, TopicSurvey], name: str, topic: TopicSurvey
) -> TopicSurvey | None:
    """Return the CameraInfo beside an image (image_transport/camera_common.h)."""
    names = f'{name}/camera_info', f'{_base(topic.name)}/camera_info'
    return next((infos[each] for each in names if each in infos), None)


def _info_of_frame(infos: Mapping[str, TopicSurvey], topic: TopicSurvey) -> TopicSurvey | None:
    """Return the only CameraInfo of an image's frame."""
    same = [each for each in infos.values() if topic.frame and each.frame == topic.frame]
    return same[0] if len(same) == 1 else None


def _is_depth(topic: TopicSurvey) -> bool:
    first = topic.looks[0]
    if topic.msgtype == types.IMAGE:
        return first.encoding in _DEPTH_ENCODINGS or bool(_DEPTH.search(topic.name))
    return 'compressedDepth' in first.format or bool(_DEPTH.search(topic.name))


def _image_rank(topic: TopicSurvey) -> tuple[int, int]:
    """Rank: rectified and coloured first; of one image, PNG files before pixels before JPEG."""
    name = leaf(topic.name)
    known = _IMAGE_NAMES.index(name) if name in _IMAGE_NAMES else len(_IMAGE_NAMES)
    if topic.msgtype == types.IMAGE:
        return known, 1
    return known, 0 if 'png' in topic.looks[0].format else 2


def _base(topic: str) -> str:
    return topic.removesuffix('/compressed')
