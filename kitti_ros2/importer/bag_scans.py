# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The scans of a bag: their topic, their decoder's needs, and their conversion to KITTI's."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.labelled_objects import SEMANTIC_NAMES
from ..files.remote import as_path
from ..kitti.store import STORE
from ..messages.camera_info import camera_model
from ..messages.cdr import stamp_ns_of
from ..messages.clouds import INTENSITIES, intensity_field, label_fields, unit_doubt
from ..messages.naming import POINTS
from ..messages.rectified_cameras import Rectifier
from ..messages.scan_sources import (
    COMPRESSED_DEPTH,
    MODELS,
    SCAN_SOURCES,
    ScanNeeds,
    find_model,
    is_depth,
    nominal_lasers,
    parse_lasers,
    source_named,
    source_of_type,
)
from ..model import bag_formats as types
from ..model.bag_formats import CLOUD
from ..model.errors import KittiRos2Error, Loss, UsageError, some_of
from ..model.samples import Scan
from .bag_cameras import camera_of, choose_cameras, find_heading, main_camera, make_camera_rig
from .bag_poses import guess_pose, vehicle_frame
from .plan import ScanPlan
from .survey import topic_of, unchosen_notes
from .tf_frames import BoxTimes, FramesAt, NamedFrames, is_fixed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from ..messages.camera_info import CameraModel
    from ..messages.scan_sources import Lasers, ScanSource, VelodyneModel
    from ..model.geometry import Transform
    from ..model.samples import Int64Array
    from .bag_calibration import PlannedRig
    from .bag_cameras import RigCamera
    from .plan import Plan
    from .survey import Survey, TopicSurvey
    from .tf_frames import MovingBase


# Needs of the decoder of a plan's scans: a CameraInfo, a model of scanner, a calibration.


def source_of_plan(plan: ScanPlan, survey: Survey) -> ScanSource:
    """Return the way in which a plan makes scans.

    Raises:
        UsageError: Its topic has no message, or scans are not made of its type.
    """
    topic = topic_of(survey, plan.topic)
    source = source_named(plan.from_) if plan.from_ else source_of_type(topic.msgtype)
    if source is not None and topic.msgtype in source.msgtypes:
        return source
    expected = source.msgtypes if source is not None else _every_type()
    need = f'scan.from: {plan.from_} expects' if plan.from_ else 'scans are made of'
    raise UsageError(
        f'scan.topic: {plan.topic} is a {topic.msgtype}; {need} {", ".join(sorted(expected))}'
    )


def needs_of_plan(plan: ScanPlan, source: ScanSource, survey: Survey) -> ScanNeeds:
    """Return the needs of the messages of a plan's scans.

    Raises:
        UsageError: The plan does not name it, or what it names is missing.
        BadFileError: The calibration file of a scanner cannot be read.
    """
    for key, needed in (('info', source.needs_info), ('model', source.has_model)):
        if getattr(plan, key) and not needed:
            raise UsageError(f'scan.{key} is not for scans of {source.word}: take it out')
    if plan.calibration and not source.has_model:
        raise UsageError(f'scan.calibration is not for scans of {source.word}: take it out')
    if source.needs_info:
        camera = _camera_of(plan, survey)
        return ScanNeeds(plan.intensity_scale, camera, 'rect' in plan.topic.lower())
    if source.has_model:
        model, lasers = _lasers_of(plan, topic_of(survey, plan.topic))
        return ScanNeeds(plan.intensity_scale, model=model, lasers=lasers)
    return ScanNeeds(plan.intensity_scale)


def without_unreadable_scans(plan: Plan, survey: Survey) -> Plan:
    """Return the plan without scans that cannot be decoded, if it has images."""
    if plan.scan is None or not plan.cameras:
        return plan
    try:
        needs_of_plan(plan.scan, source_of_plan(plan.scan, survey), survey)
    except KittiRos2Error:
        reference = f'image_{main_camera(dict(plan.cameras))}'
        return replace(plan, scan=None, reference=reference)
    return plan


def missing_calibration(topic: TopicSurvey) -> str:
    """Return the part that a plan for a topic of packets must name, empty for none."""
    try:
        _lasers_of(None, topic)
    except UsageError as error:
        return str(error)
    return ''


def _camera_of(plan: ScanPlan, survey: Survey) -> CameraModel:
    if not plan.info:
        raise UsageError(f'scan.info: {plan.topic} needs the CameraInfo of its depth images')
    try:
        camera = camera_of(survey, plan.info)
        if camera.d.any():
            Rectifier(camera)  # checks the lens
    except ValueError as error:
        raise UsageError(f'scan.info: {plan.info}: {error}') from None
    return camera


def _lasers_of(plan: ScanPlan | None, topic: TopicSurvey) -> tuple[VelodyneModel, Lasers]:
    """Return the model of a scanner and its lasers; without a plan those that the packets name."""
    model = (
        _planned_model(plan.model, topic) if plan is not None and plan.model else _model_of(topic)
    )
    if plan is not None and plan.calibration:
        path = as_path(plan.calibration)
        if not path.is_file():
            raise UsageError(
                f'scan.calibration: {path}: no such file; expected the YAML file of a scanner'
            )
        lasers: Lasers | None = parse_lasers(STORE.read_text(path), path)
    else:
        lasers = nominal_lasers(model.name)
    if lasers is None:
        raise UsageError(
            f'{topic.name}: a {model.name}, of which each unit has a calibration of its own: set'
            f' scan.calibration of the plan to its YAML file (from db.xml by gen_calibration.py of'
            f' the ROS driver)'
        )
    if len(lasers) < model.lasers:
        named = '' if plan is None else plan.calibration
        raise UsageError(f'{named}: {len(lasers)} lasers; a {model.name} has {model.lasers}')
    return model, lasers


def _planned_model(name: str, topic: TopicSurvey) -> VelodyneModel:
    """Return a model by name, unless packets name one with another number of lasers.

    Raises:
        UsageError: They do: their points would be wrong.
    """
    model = MODELS[name]
    try:
        own = _model_of(topic)
    except UsageError:
        return model
    if own.lasers != model.lasers:
        raise UsageError(
            f'scan.model: {name}, but the packets of {topic.name} are of a {own.name}, with'
            f' {own.lasers} lasers: take scan.model out'
        )
    return model


def _model_of(topic: TopicSurvey) -> VelodyneModel:
    reason = topic.failure or 'no message with packets'
    for message in topic.samples:
        try:
            return find_model(message)
        except ValueError as error:
            reason = str(error)
    models = ', '.join(MODELS)
    raise UsageError(f'{topic.name}: {reason}; set scan.model of the plan to one of {models}')


def _every_type() -> set[str]:
    return {msgtype for source in SCAN_SOURCES for msgtype in source.msgtypes}


# Choice of the scans' topic; scan_frame chooses the frame that becomes KITTI's.

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
        survey: The survey of the bag.
        rig: The cameras of the bag.
        notes: Notes on the choice are added.
    """
    for rank, source in enumerate(SCAN_SOURCES):
        topics = _topics_of(source, survey)
        if not topics:
            continue
        scan_plan = _scan_of(source, topics, survey, rig, notes)
        if rank:
            notes += _other_sources(SCAN_SOURCES[rank + 1 :], survey)
        return scan_plan
    notes += _without_info(survey)
    notes.append('missing: scans (no PointCloud2 with x, y and z)')
    return None


def _topics_of(source: ScanSource, survey: Survey) -> list[TopicSurvey]:
    """Return the topics that a source can make scans from."""
    topics = [
        topic
        for topic in survey.of_type(*source.msgtypes)
        if any(source.suits(message) for message in topic.samples)
    ]
    if not source.needs_info:
        return topics
    return [topic for topic in topics if info_of_depth(survey, topic)]


def _other_sources(sources: Sequence[ScanSource], survey: Survey) -> list[str]:
    """Return notes on the topics of sources that scans could be made from as well."""
    return [
        f'passed over for scans: {topic.name}; scan.topic of the plan chooses it'
        + (f', with scan.info: {info_of_depth(survey, topic)}' if source.needs_info else '')
        for source in sources
        for topic in _topics_of(source, survey)
    ]


def _without_info(survey: Survey) -> list[str]:
    """Return notes on depth images without a CameraInfo."""
    return [
        f'passed over for scans: {topic.name}; a depth image without a camera_info'
        for topic in survey.of_type(types.IMAGE, types.COMPRESSED)
        if any(is_depth(message) for message in topic.samples) and not info_of_depth(survey, topic)
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
        first = max(_kind_rank(vehicle, topic) for topic in topics)
        lidars = [topic for topic in topics if _kind_rank(vehicle, topic) == first]
        best = max(_in_view(source, lidars, survey, rig, notes), key=_size_rank)
    elif source.needs_info:
        best = max(topics, key=lambda topic: _depth_rank(survey, topic))
    else:
        best = max(_in_view(source, topics, survey, rig, notes), key=lambda topic: topic.count)
    notes += unchosen_notes('scans', best, topics)
    frame_id = vehicle.frame_for(best.frame_id)
    if frame_id != best.frame_id:
        notes.append(
            f'{best.name} is in {best.frame_id}, in which the vehicle moves; its points are brought'
            f' to {frame_id} by the poses at their stamps'
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
    return ScanPlan(best.name, frame_id, source.scale(best.samples), from_=word, info=info)


def info_of_depth(survey: Survey, topic: TopicSurvey) -> str:
    """Return the CameraInfo of depth images: beside them, or the only one of their frame, or ''."""
    namespace = topic.name.removesuffix(f'/{COMPRESSED_DEPTH}').rpartition('/')[0]
    infos = survey.of_type(types.CAMERA_INFO)
    if any(info.name == f'{namespace}/camera_info' for info in infos):
        return f'{namespace}/camera_info'
    same = [info.name for info in infos if topic.frame_id and info.frame_id == topic.frame_id]
    return same[0] if len(same) == 1 else ''


def _depth_rank(survey: Survey, topic: TopicSurvey) -> tuple[bool, bool, int]:
    """Rank depth images: in a colour camera's frame, then pixels before PNG."""
    pictures = {
        image_topic.frame_id
        for image_topic in survey.of_type(types.IMAGE, types.COMPRESSED)
        if image_topic.samples and not is_depth(image_topic.samples[0])
    }
    return topic.frame_id in pictures, topic.msgtype == types.IMAGE, topic.count


class _Vehicle:
    """The frames of scans on a vehicle that moves."""

    def __init__(self, survey: Survey) -> None:
        self._names = NamedFrames(survey, guess_pose(survey, []))
        self._body = vehicle_frame(survey, self._names)
        self._above = self._names.line_above(self._body) if self._body else []

    def frame_for(self, frame_id: str) -> str:
        """Return the frame for scans: their own, or one of the vehicle if theirs is map or odom.

        A lidar's frame that looks ahead is preferred, then the vehicle's.
        """
        if frame_id not in self._above or not self._names.moving_between(frame_id, self._body):
            return frame_id
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
    for message in topic.samples:
        if {'x', 'y', 'z'} <= {field.name for field in message.fields}:
            return message
    return None


def _kind_rank(vehicle: _Vehicle, topic: TopicSurvey) -> tuple[bool, ...]:
    """Rank clouds by their kind: scans of a lidar before what is made of them, or of images."""
    return (
        topic.name == POINTS,
        not _MAP.search(topic.name),
        topic.count > 1,
        not is_fixed(topic.frame_id) and vehicle.frame_for(topic.frame_id) == topic.frame_id,
        bool(_LIDAR.search(topic.name) or _LIDAR.search(topic.frame_id)),
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
        survey: The survey of the bag.
        rig: The cameras of the bag.
        notes: Notes are added.
    """
    if len(lidars) < 2:
        return lidars
    seen = _points_seen(source, lidars, survey, rig)
    most = max(seen.values(), default=0)
    in_view = (
        [lidar for lidar in lidars if seen.get(lidar.name, 0) > _SHARED * most] if most else lidars
    )
    others = [lidar for lidar in lidars if lidar not in in_view]
    if others:
        names = ', '.join(other.name for other in others)
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
    return in_view


def _points_seen(
    source: ScanSource, lidars: list[TopicSurvey], survey: Survey, rig: Sequence[RigCamera]
) -> dict[str, int]:
    """Return the points of each lidar in the image of camera 2, by topic; only of those joined."""
    heading = find_heading(survey.tree, None, rig)
    placed = make_camera_rig(survey, rig, heading, [])
    cameras = [rig_camera for rig_camera in placed.cameras if rig_camera.focal]
    if not cameras:
        return {}
    camera = choose_cameras(replace(placed, cameras=cameras)).cameras[2]
    seen = {}
    for topic in lidars:
        camera_t_lidar = placed.tree.find(camera.frame, topic.frame_id)
        # Errors are reported later; forks have fewer fields, or others.
        with suppress(AttributeError, TypeError, ValueError, KittiRos2Error):
            if camera_t_lidar is not None and camera.info is not None:
                needs = needs_of_plan(ScanPlan(topic.name, topic.frame_id), source, survey)
                message = next(sample for sample in topic.samples if source.suits(sample))
                points = source.decode(message, needs).points[:, :3].astype(np.float64)
                inside = camera_model(camera.info.samples[0]).sees(camera_t_lidar.apply(points))
                seen[topic.name] = int(np.count_nonzero(inside))
    return seen


# Clouds, packets, ranges or depth images -> KITTI's scans, in the frame of the plan.

_SHOWN = 8


class ScanConversion:
    """Converts the messages of a plan's scans; thread-safe."""

    def __init__(self, rig: PlannedRig, base: MovingBase | None = None) -> None:
        """Find the frame of the messages in that of the plan, and what their decoder needs.

        Args:
            rig: The rig of the plan, which may have no scans.
            base: The links over time, where clouds may be in frames that the vehicle moves in.

        Raises:
            UsageError: The plan names a missing topic, or not what its messages need.
            BadFileError: The calibration file of a scanner cannot be read.
            MissingDataError: The static transforms do not connect the two frames.
        """
        self._plan = plan = rig.plan.scan
        self._minimum_m = 0.0 if plan is None else plan.minimum_range_m
        self._too_near = f'nearer than {self._minimum_m:g} m'
        self._velo_t_cloud: Transform | None = None  # the messages are in KITTI's frame already
        self._lost: Counter[str] = Counter()
        self._lock = Lock()
        self._point_labels = rig.plan.layout.traits.point_labels
        self._unplaced = 0  # scans whose labels have no file
        self._unlabelled = 0  # scans without labels
        self._classes = np.zeros(1 << 16, np.bool_)  # of points, those seen
        self._notes: list[str] = []
        self._turns: Int64Array | None = None  # (N, 2) of each message, from its stamp
        self._base: MovingBase | None = None  # of messages in a frame that the scanner moves in
        if plan is not None:
            self._source = source_of_plan(plan, rig.survey)
            self._needs = needs_of_plan(plan, self._source, rig.survey)
            topic = topic_of(rig.survey, plan.topic)
            self._notes = cloud_notes(plan, topic, point_labels=self._point_labels)
            turns = topic.turns_ns()
            self._turns = None if turns is None else turns - topic.moved_ns()[:, None]
            own = topic.frame_id
            if (
                base is not None
                and base.tree is not None
                and own != plan.frame
                and not rig.tree.joins(plan.frame, own)
            ):
                base.tree.moving_between(base.frame, own)
                self._base = base
            elif own != plan.frame:
                self._velo_t_cloud = rig.tree.transform(plan.frame, own)

    @property
    def move(self) -> bool:
        """Return whether the messages are in a frame that the vehicle moves in."""
        return self._base is not None

    def scan(
        self,
        message: Any,  # noqa: ANN401 - of the bag's types
        stamp_ns: int | None = None,
        index: int | None = None,
    ) -> tuple[Scan, Counter[str]]:
        """Convert a message to a scan; also return the number of dropped points, by reason.

        Args:
            message: A message of the plan's source.
            stamp_ns: Its stamp, at which a frame that moves is placed; None for its header's.
            index: Its index in its topic, which gives its turn; None for a scan without.

        Raises:
            ValueError: It cannot be read, or its frame is not known at its stamp.
        """
        velo_t_cloud = self._velo_t_cloud
        if self._base is not None:
            frame_id = message.header.frame_id.lstrip('/')
            joined = {self._base.frame: self._base.velo_T_frame}
            at_ns = stamp_ns_of(message.header) if stamp_ns is None else stamp_ns
            velo_t_cloud = FramesAt(joined, self._base, BoxTimes(at_ns))[frame_id]
        decoded = self._source.decode(message, self._needs)
        if decoded.lost:
            with self._lock:
                self._lost.update(decoded.lost)
        points, dropped = decoded.points, Counter(decoded.dropped)
        labels = self._labels(decoded.labels, len(points))
        if self._plan is not None and self._plan.unit_m != 1:
            points = points * np.array([*[self._plan.unit_m] * 3, 1], np.float32)
        if velo_t_cloud is not None:
            positions = velo_t_cloud.apply(points[:, :3].astype(np.float64))
            points = np.column_stack([positions, points[:, 3]]).astype(np.float32)
        if self._minimum_m:
            far = np.linalg.norm(points[:, :3].astype(np.float64), axis=1) >= self._minimum_m
            dropped[self._too_near] = len(points) - int(np.count_nonzero(far))
            points = points[far]
            labels = None if labels is None else labels[far]
        if stamp_ns is None or index is None or self._turns is None:
            return Scan(points, labels=labels), dropped
        start_ns, end_ns = self._turns[index].tolist()
        return Scan(points, stamp_ns + start_ns, stamp_ns + end_ns, labels), dropped

    def _labels(
        self, labels: npt.NDArray[np.uint32] | None, count: int
    ) -> npt.NDArray[np.uint32] | None:
        """Return the labels that are written of those of a message, and count the others."""
        if labels is None:
            with self._lock:
                self._unlabelled += count > 0
            return None
        seen = np.bincount(labels & np.uint32(0xFFFF), minlength=len(self._classes)) > 0
        with self._lock:
            if self._point_labels:
                self._classes |= seen
                return labels
            self._unplaced += bool(labels.any())
        return None

    @property
    def are_depth(self) -> bool:
        """Return whether the scans are made from depth images."""
        return self._plan is not None and self._source.needs_info

    def notes(self) -> list[str]:
        """Return notes on the scans."""
        if self._plan is None:
            return []
        topic, source_note = self._plan.topic, self._source.note
        others = set(np.flatnonzero(self._classes).tolist()) - SEMANTIC_NAMES.keys()
        notes = [*self._notes, *([f'{topic}: {source_note}'] if source_note else [])]
        if others:
            shown = some_of([str(other) for other in sorted(others)], _SHOWN)
            notes.append(
                f'{topic}: classes of points that SemanticKITTI does not have, written as they are:'
                f' {shown}'
            )
        return notes

    def losses(self) -> tuple[Loss, ...]:
        """Return the parts of messages so far that could not be decoded, or have no file."""
        topic = '' if self._plan is None else self._plan.topic
        lost = dict(self._lost)
        if self._unplaced:
            lost['labels of points, for which layout odometry alone has files'] = self._unplaced
        if self._unlabelled and self._classes.any():
            lost['no labels of points, which other clouds have'] = self._unlabelled
        return tuple(Loss(topic, count, f'{topic}: {reason}') for reason, count in lost.items())


def cloud_notes(plan: ScanPlan, topic: TopicSurvey, *, point_labels: bool) -> list[str]:
    """Return notes on what the fields of a plan's clouds hold; none for other messages.

    Args:
        plan: The plan of the scans.
        topic: The survey of their topic.
        point_labels: Whether the layout has files for labels of points.
    """
    if topic.msgtype != CLOUD:
        return []
    notes, names = [], labelled_fields(topic)
    if names:
        fields = f'{topic.name}: labels of points ({" and ".join(names)})'
        notes.append(
            f'{fields} become labels/*.label, as SemanticKITTI has them'
            if point_labels
            else f'{fields} are left out: layout odometry alone has files for them'
        )
    doubt = unit_doubt(topic.samples) if plan.unit_m == 1 and not is_fixed(topic.frame_id) else ''
    if doubt:
        notes.append(
            f'{topic.name}: {doubt}; are they millimetres? scan.unit_m: 0.001 of the plan makes'
            f' metres of them'
        )
    return notes


def labelled_fields(topic: TopicSurvey) -> tuple[str, ...]:
    """Return the fields of a topic's clouds with labels of points, empty without."""
    if topic.msgtype != CLOUD:
        return ()
    return next((names for message in topic.samples if (names := label_fields(message))), ())


def dropped_notes(topic: str, dropped: Mapping[str, int]) -> list[str]:
    """Return a note on the points of all scans that were dropped, by reason."""
    reasons = ', '.join(f'{reason} ({count})' for reason, count in dropped.items() if count)
    total = sum(dropped.values())
    return [f'{topic}: {total} points without a return were dropped: {reasons}'] if total else []
