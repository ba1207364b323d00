# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the decoder of a plan's scans needs: a CameraInfo, a model of scanner, a calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..files.remote import as_path
from ..kitti.store import STORE
from ..messages.scan_sources import SCAN_SOURCES, ScanNeeds, source_named, source_of_type
from ..messages.velodyne_models import MODELS, nominal_lasers, parse_lasers
from ..messages.velodyne_packets import find_model
from ..model.errors import KittiRos2Error, UsageError
from ..rig.rectify import Rectifier
from .guess_cameras import main_camera
from .planned_topics import camera_of, topic_of

if TYPE_CHECKING:
    from ..messages.camera_info import CameraModel
    from ..messages.scan_sources import ScanSource
    from ..messages.velodyne_models import Lasers, VelodyneModel
    from .plan import Plan, ScanPlan
    from .survey import Survey
    from .topic_survey import TopicSurvey


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
    what = f'scan.from: {plan.from_} expects' if plan.from_ else 'scans are made of'
    raise UsageError(
        f'scan.topic: {plan.topic} is a {topic.msgtype}; {what} {", ".join(sorted(expected))}'
    )


def needs_of_plan(plan: ScanPlan, source: ScanSource, survey: Survey) -> ScanNeeds:
    """Return what the messages of a plan's scans need.

    Raises:
        UsageError: The plan does not name it, or what it names is missing.
        BadFileError: The calibration file of a unit cannot be read.
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
    """Return the plan without scans whose decoder lacks something, if it has images to look at."""
    if plan.scan is None or not plan.cameras:
        return plan
    try:
        needs_of_plan(plan.scan, source_of_plan(plan.scan, survey), survey)
    except KittiRos2Error:
        reference = f'image_{main_camera(dict(plan.cameras))}'
        return replace(plan, scan=None, reference=reference)
    return plan


def missing_calibration(topic: TopicSurvey) -> str:
    """Return what a plan for a topic of packets must name, empty for nothing."""
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
    for look in topic.looks:
        try:
            return find_model(look)
        except ValueError as error:
            reason = str(error)
    known = ', '.join(MODELS)
    raise UsageError(f'{topic.name}: {reason}; set scan.model of the plan to one of {known}')


def _every_type() -> set[str]:
    return {msgtype for source in SCAN_SOURCES for msgtype in source.msgtypes}
