# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the scans' topic; scan_frame chooses the frame that becomes KITTI's."""

from __future__ import annotations

import re
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.camera_info import camera_model
from ..messages.clouds import INTENSITIES, intensity_field
from ..messages.depth_images import COMPRESSED_DEPTH, is_depth
from ..messages.scan_sources import SCAN_SOURCES
from ..messages.source import POINTS
from ..model import msgtypes as types
from ..model.errors import KittiRos2Error
from .camera_geometry import choose_cameras, find_heading, with_frames
from .guess_names import is_fixed
from .guess_pose import guess_pose, vehicle_frame
from .named_frames import NamedFrames
from .optical_frames import optical_link
from .plan import ScanPlan
from .report import pass_over
from .scan_needs import missing_calibration, needs_of_plan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..messages.scan_sources import ScanSource
    from .camera_topics import RigCamera
    from .survey import Survey
    from .topic_survey import TopicSurvey

_LIDAR = re.compile(
    r'velo|lidar|laser|ouster|(?:^|[/_])os\d?[/_]|hesai|pandar|robosense|livox|points_raw',
    re.IGNORECASE,
)
_MAP = re.compile(r'(?:^|[/_])map(?:$|[/_])', re.IGNORECASE)
_AHEAD = 0.7  # the cosine of 45 degrees
_SHARED = 0.5  # of the most points that a lidar has in the image


def guess_scan(survey: Survey, rig: Sequence[RigCamera], notes: list[str]) -> ScanPlan | None:
    """Choose the lidar: KITTI's own points, in a sensor's frame, by name, seen by the camera.

    A cloud in a frame that the vehicle moves in may be all that a mapper has seen so far. Of
    several lidars those with points in the image of camera 2 go before others, then those with
    intensity, then the largest. Without clouds it is the first source of SCAN_SOURCES with a topic.

    Args:
        survey: Of the bag.
        rig: The cameras of the bag.
        notes: Remarks on the choice are added.
    """
    for place, source in enumerate(SCAN_SOURCES):
        topics = _topics_of(source, survey)
        if not topics:
            continue
        found = _scan_of(source, topics, survey, rig, notes)
        if place:
            notes += _other_sources(SCAN_SOURCES[place + 1 :], survey)
        return found
    notes += _without_info(survey)
    notes.append('missing: scans (no PointCloud2 with x, y and z)')
    return None


def _topics_of(source: ScanSource, survey: Survey) -> list[TopicSurvey]:
    """Return the topics that a source can make scans from."""
    found = [
        each
        for each in survey.of_type(*source.msgtypes)
        if any(source.suits(look) for look in each.looks)
    ]
    if not source.needs_info:
        return found
    return [each for each in found if info_of_depth(survey, each)]


def _other_sources(sources: Sequence[ScanSource], survey: Survey) -> list[str]:
    """Return notes on the topics of sources that scans could be made from as well."""
    return [
        f'passed over for scans: {each.name}; scan.topic of the plan chooses it'
        + (f', with scan.info: {info_of_depth(survey, each)}' if source.needs_info else '')
        for source in sources
        for each in _topics_of(source, survey)
    ]


def _without_info(survey: Survey) -> list[str]:
    """Return notes on depth images without a CameraInfo."""
    return [
        f'passed over for scans: {each.name}; a depth image without a camera_info'
        for each in survey.of_type(types.IMAGE, types.COMPRESSED)
        if any(is_depth(look) for look in each.looks) and not info_of_depth(survey, each)
    ]


def _scan_of(
    source: ScanSource,
    topics: list[TopicSurvey],
    survey: Survey,
    rig: Sequence[RigCamera],
    notes: list[str],
) -> ScanPlan:
    vehicle = _Vehicle(survey)
    if types.CLOUD in source.msgtypes:
        first = max(_kind_rank(vehicle, each) for each in topics)
        lidars = [each for each in topics if _kind_rank(vehicle, each) == first]
        best = max(_in_view(source, lidars, survey, rig, notes), key=_size_rank)
    elif source.needs_info:
        best = max(topics, key=lambda each: _depth_rank(survey, each))
    else:
        best = max(_in_view(source, topics, survey, rig, notes), key=lambda each: each.count)
    notes += pass_over('scans', best, topics)
    frame = vehicle.frame_for(best.frame)
    if frame != best.frame:
        notes.append(
            f'{best.name} is in {best.frame}, in which the vehicle moves; its points are brought'
            f' to {frame} by the poses at their stamps'
        )
    missing = missing_calibration(best) if source.has_model else ''
    notes += [missing] if missing else []
    dark = types.CLOUD in source.msgtypes and intensity_field(_with_points(best)) is None
    if dark:
        notes.append(
            f'{best.name} has no field of intensity ({", ".join(INTENSITIES)}): the reflectance of'
            f' the scans is 0'
        )
    info = info_of_depth(survey, best) if source.needs_info else ''
    word = source.word if source.needs_info else ''  # of an Image, which is an image otherwise
    return ScanPlan(best.name, frame, source.scale(best.looks), from_=word, info=info)


def info_of_depth(survey: Survey, topic: TopicSurvey) -> str:
    """Return the CameraInfo of depth images: beside them, or the only one of their frame, or ''."""
    place = topic.name.removesuffix(f'/{COMPRESSED_DEPTH}').rpartition('/')[0]
    infos = survey.of_type(types.CAMERA_INFO)
    if any(each.name == f'{place}/camera_info' for each in infos):
        return f'{place}/camera_info'
    same = [each.name for each in infos if topic.frame and each.frame == topic.frame]
    return same[0] if len(same) == 1 else ''


def _depth_rank(survey: Survey, topic: TopicSurvey) -> tuple[bool, bool, int]:
    """Rank depth images: in a colour camera's frame, then pixels before PNG."""
    pictures = {
        each.frame
        for each in survey.of_type(types.IMAGE, types.COMPRESSED)
        if each.looks and not is_depth(each.looks[0])
    }
    return topic.frame in pictures, topic.msgtype == types.IMAGE, topic.count


class _Vehicle:
    """The frames of scans on a vehicle that moves."""

    def __init__(self, survey: Survey) -> None:
        self._names = NamedFrames(survey, guess_pose(survey, []))
        self._body = vehicle_frame(survey, self._names)
        self._above = self._names.line_above(self._body) if self._body else []

    def frame_for(self, frame: str) -> str:
        """Return the frame for scans: their own, or one of the vehicle if theirs is map or odom.

        A lidar's frame that looks ahead is preferred, then the vehicle's.
        """
        if frame not in self._above or not self._names.moving_between(frame, self._body):
            return frame
        return self._lidar or self._body

    @cached_property
    def _lidar(self) -> str:
        tree = self._names.tree
        for other in sorted(filter(_LIDAR.search, tree.frames)):
            body_t_other = tree.find(self._body, other)
            if body_t_other is not None:
                forward, _, up = body_t_other.rotation.T
                if forward[0] > _AHEAD and up[2] > _AHEAD:
                    return other
        return ''


def _with_points(topic: TopicSurvey) -> Any:  # noqa: ANN401 - of the bag's types
    """Return the first sampled message with x, y and z, None where none has them."""
    for look in topic.looks:
        if {'x', 'y', 'z'} <= {field.name for field in look.fields}:
            return look
    return None


def _kind_rank(vehicle: _Vehicle, topic: TopicSurvey) -> tuple[bool, ...]:
    """Rank clouds by their kind: scans of a lidar before what is made of them, or of images."""
    return (
        topic.name == POINTS,
        not _MAP.search(topic.name),
        topic.count > 1,
        not is_fixed(topic.frame) and vehicle.frame_for(topic.frame) == topic.frame,
        bool(_LIDAR.search(topic.name) or _LIDAR.search(topic.frame)),
    )


def _size_rank(topic: TopicSurvey) -> tuple[bool, int, int]:
    first = _with_points(topic)
    return intensity_field(first) is not None, first.width * first.height, topic.count


def _in_view(
    source: ScanSource,
    lidars: list[TopicSurvey],
    survey: Survey,
    rig: Sequence[RigCamera],
    notes: list[str],
) -> list[TopicSurvey]:
    """Return the lidars with half of the most points in the image of camera 2; all if none has any.

    Args:
        source: Decodes their messages.
        lidars: Topics of one kind.
        survey: Of the bag.
        rig: The cameras of the bag.
        notes: Notes are added.
    """
    if len(lidars) < 2:
        return lidars
    seen = _points_seen(source, lidars, survey, rig)
    most = max(seen.values(), default=0)
    found = [each for each in lidars if seen.get(each.name, 0) > _SHARED * most] if most else lidars
    others = [each for each in lidars if each not in found]
    if others:
        names = ', '.join(each.name for each in others)
        notes.append(
            f'scans: the camera sees less than half as many points of {names} as of others'
        )
    elif not most and rig:
        why = (
            'the camera sees points of none' if seen else 'no transforms tell what the camera sees'
        )
        notes.append(
            f'scans: the largest of {len(lidars)} lidars is taken, for {why}; scan.topic of the'
            f' plan chooses another'
        )
    return found


def _points_seen(
    source: ScanSource, lidars: list[TopicSurvey], survey: Survey, rig: Sequence[RigCamera]
) -> dict[str, int]:
    """Return the points of each lidar in the image of camera 2, by topic; only of those joined."""
    heading = find_heading(survey.tree, None, rig)
    cameras = with_frames(rig, survey.tree, heading, [])
    tree = survey.tree_with([optical_link(c.bag_frame, c.forward) for c in cameras if c.forward])
    cameras = [each for each in cameras if each.focal]
    if not cameras:
        return {}
    camera = choose_cameras(tree, heading, cameras).cameras[2]
    seen = {}
    for topic in lidars:
        camera_t_lidar = tree.find(camera.frame, topic.frame)
        # What cannot be decoded is reported later; forks define fields without, or otherwise.
        with suppress(AttributeError, TypeError, ValueError, KittiRos2Error):
            if camera_t_lidar is not None and camera.info is not None:
                needs = needs_of_plan(ScanPlan(topic.name, topic.frame), source, survey)
                look = next(each for each in topic.looks if source.suits(each))
                points = source.decode(look, needs).points[:, :3].astype(np.float64)
                inside = camera_model(camera.info.looks[0]).sees(camera_t_lidar.apply(points))
                seen[topic.name] = int(np.count_nonzero(inside))
    return seen
