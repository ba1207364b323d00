# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of cameras: the best image topic of each, its CameraInfo, and KITTI's number."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from ..model import msgtypes as types
from ..model.streams import CAMERA_NAMES
from ..rig.rectify import needs_rectifying
from .plan import CameraPlan

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..model.layouts import Layout
    from .survey import Survey
    from .topic_survey import TopicSurvey

_DEPTH = re.compile(r'depth|disparity|confidence|mask|segment|annotated', re.IGNORECASE)
_LEFT = re.compile(r'(^|[/_])left([/_]|$)', re.IGNORECASE)
_RIGHT = re.compile(r'(^|[/_])right([/_]|$)', re.IGNORECASE)
_DEPTH_ENCODINGS = frozenset({'16UC1', '32FC1', '16SC1'})
_IMAGE_NAMES = ('image_rect_color', 'image_rect', 'image_color', 'image_raw', 'image', 'image_mono')
_PLUMB_BOB = frozenset({'plumb_bob', ''})


def guess_cameras(survey: Survey, layout: Layout, notes: list[str]) -> dict[int, CameraPlan]:
    """Choose up to four cameras, the best image topic of each, by KITTI's numbers."""
    rigs = _image_topics(survey)
    names = _numbered(rigs)
    others = sorted(set(rigs) - set(names.values()))
    notes += [f'passed over: {rigs[name].name}; KITTI has four cameras' for name in others]
    plans = {}
    for index, name in sorted(names.items()):
        topic, info = rigs[name].name, _info_of(survey, name, rigs[name])
        plans[index] = CameraPlan(topic, info, _rectify(survey, layout, topic, info))
    if any(plan.info for plan in plans.values()):
        for index in [index for index, plan in plans.items() if not plan.info]:
            topic = plans.pop(index).topic
            notes.append(f'passed over: {topic}; it has no camera_info')
    if not plans:
        notes.append('missing: images (no camera)')
    return plans


def keeps_distortion(survey: Survey, cameras: dict[int, CameraPlan]) -> bool:
    """Whether raw images stay distorted, so that the drive is an extract."""
    for plan in cameras.values():
        looks = survey.topics[plan.info].looks if plan.info else []
        if looks and not plan.rectify and 'rect' not in _leaf(plan.topic) and np.any(looks[0].d):
            return True
    return False


def main_camera(cameras: dict[int, CameraPlan]) -> int:
    """Return the left colour camera, that of KITTI's labels, or else the first."""
    return 2 if 2 in cameras else min(cameras)


def _info_of(survey: Survey, name: str, topic: TopicSurvey) -> str:
    infos = {each.name: each for each in survey.of_type(types.CAMERA_INFO)}
    for candidate in (f'{name}/camera_info', f'{_base(topic.name)}/camera_info'):
        if candidate in infos:
            return candidate
    same = [each for each in infos.values() if topic.frame and each.frame == topic.frame]
    return same[0].name if len(same) == 1 else ''


def _rectify(survey: Survey, layout: Layout, topic: str, info: str) -> bool:
    """Whether to rectify: distorted images, except in raw where K and D describe them."""
    looks = survey.topics[info].looks if info else []
    if not looks or 'rect' in _leaf(topic):
        return False
    message = looks[0]
    if not needs_rectifying(message.k, message.d, message.r, message.p):
        return False
    plain = message.distortion_model in _PLUMB_BOB and len(message.d) <= 5
    return not (layout.traits.extracts and plain)


def _image_topics(survey: Survey) -> dict[str, TopicSurvey]:
    """Return the best image topic of each camera, by its name (the topics' common part)."""
    cameras: dict[str, list[TopicSurvey]] = {}
    for topic in survey.of_type(types.IMAGE, types.COMPRESSED):
        if topic.looks and not _is_depth(topic):
            cameras.setdefault(_base(topic.name).rpartition('/')[0], []).append(topic)
    return {name: min(topics, key=_image_rank) for name, topics in cameras.items()}


def _is_depth(topic: TopicSurvey) -> bool:
    first = topic.looks[0]
    if topic.msgtype == types.IMAGE:
        return first.encoding in _DEPTH_ENCODINGS or bool(_DEPTH.search(topic.name))
    return 'compressedDepth' in first.format or bool(_DEPTH.search(topic.name))


def _image_rank(topic: TopicSurvey) -> tuple[int, int]:
    """Rank: rectified and coloured first; of one image, PNG files before pixels before JPEG."""
    name = _leaf(topic.name)
    known = _IMAGE_NAMES.index(name) if name in _IMAGE_NAMES else len(_IMAGE_NAMES)
    if topic.msgtype == types.IMAGE:
        return known, 1
    return known, 0 if 'png' in topic.looks[0].format else 2


def _base(topic: str) -> str:
    return topic.removesuffix('/compressed')


def _leaf(topic: str) -> str:
    return _base(topic).rpartition('/')[2]


def _numbered(cameras: Iterable[str]) -> dict[int, str]:
    """Map KITTI's numbers to cameras: left colour is 2, right colour 3, then the grey pair."""
    names = sorted(cameras, key=lambda name: (bool(_RIGHT.search(name)), 'front' not in name, name))
    found = {
        index: name
        for index, own in CAMERA_NAMES.items()
        for name in names
        if name.endswith(f'camera_{own}')
    }
    if len(found) == len(names):
        return found
    left = [name for name in names if _LEFT.search(name)]
    if left and names[0] not in left:
        names.remove(left[0])
        names.insert(0, left[0])
    return dict(zip((2, 3, 0, 1), names, strict=False))
