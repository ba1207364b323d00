# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The stamps that a plan asks for: offsets, log times, the middle of a turn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..messages.point_spans import tells_another_time, time_field
from ..model.nearest import nearest_stamps
from ..model.stamps import NS_PER_S
from .plan import StampSource

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.samples import Int64Array
    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey

_EVEN_NS = 5_000_000
"""Turns of scanners, and their stamps, are uneven by a few milliseconds."""

LATENCY_NS = NS_PER_S
"""Drivers and video encoders take up to a second; a larger difference is one of clocks."""

_ROUNDED_NS = 2_000_000
"""Detectors and labelling tools write stamps in milliseconds, or as seconds in a float."""

_DETECTION_NS = 10 * NS_PER_S

_ROLES = ('imu', 'fix', 'velocity')
_OF_SET = 'image_2 of '
"""Begins the names of streams of camera_sets: the camera is camera 2 of its set."""


@dataclass(frozen=True)
class PlannedStream:
    """A stream of a plan with stamps.

    Attributes:
        name: In texts: scan, image_2 (of a camera set: image_2 of NAME), pose, labels, imu.
        key: Of its offset in the plan: scan.offset_s.
        topic: Its topic.
        offset_s: Of the plan, seconds.
    """

    name: str
    key: str
    topic: str
    offset_s: float

    def __str__(self) -> str:
        return f'{self.name} ({self.topic})'


def planned_streams(plan: Plan) -> dict[str, PlannedStream]:
    """Return the streams of a plan by name, the reference first; of camera_sets those of all."""
    found = [
        PlannedStream(name, f'{name}.offset_s', part.topic, part.offset_s)
        for name, part in (('scan', plan.scan), ('pose', plan.pose), ('labels', plan.labels))
        if part is not None
    ]
    found += [
        PlannedStream(f'image_{index}', f'cameras.{index}.offset_s', camera.topic, camera.offset_s)
        for index, camera in plan.cameras.items()
    ]
    found += [
        PlannedStream(
            f'{_OF_SET}{name}', f'camera_sets.{name}.offset_s', camera.topic, camera.offset_s
        )
        for name, camera in plan.camera_sets.items()
    ]
    unit = (
        (plan.imu, plan.imu_offset_s),
        (plan.fix, plan.fix_offset_s),
        (plan.velocity, plan.velocity_offset_s),
    )
    found += [
        PlannedStream(name, f'{name}_offset_s', topic, offset_s)
        for name, (topic, offset_s) in zip(_ROLES, unit, strict=True)
        if topic
    ]
    found.sort(key=lambda each: each.name.partition(' ')[0] != plan.reference)
    return {each.name: each for each in found}


def with_offset(plan: Plan, name: str, offset_s: float) -> Plan:
    """Return a plan with the offset of a stream, by the name of planned_streams."""
    if name.startswith(_OF_SET):
        own = name.removeprefix(_OF_SET)
        camera = replace(plan.camera_sets[own], offset_s=offset_s)
        return replace(plan, camera_sets={**plan.camera_sets, own: camera})
    if name.startswith('image_'):
        index = int(name.removeprefix('image_'))
        camera = replace(plan.cameras[index], offset_s=offset_s)
        return replace(plan, cameras={**plan.cameras, index: camera})
    if name in _ROLES:
        # mypy does not know the types of fields by name.
        return replace(plan, **{f'{name}_offset_s': offset_s})  # type: ignore[arg-type]
    part = {'scan': plan.scan, 'pose': plan.pose, 'labels': plan.labels}[name]
    moved = None if part is None else replace(part, offset_s=offset_s)
    return replace(plan, **{name: moved})  # type: ignore[arg-type]


def clocked(survey: Survey, plan: Plan) -> Survey:
    """Return a survey whose topics have the stamps that a plan asks for: see TopicSurvey.stamps.

    Scans are stamped in the middle of their turn: those whose points have times from the start of
    the turn on, or up to its end, would be paired with the images of another moment.
    """
    topics = dict(survey.topics)
    by_log = plan.stamps is StampSource.LOG
    if by_log:
        topics = {name: replace(topic, by_log=True) for name, topic in topics.items()}
    for stream in planned_streams(plan).values():
        if stream.topic in topics:
            offset_ns = round(stream.offset_s * NS_PER_S)
            topics[stream.topic] = replace(topics[stream.topic], offset_ns=offset_ns)
    if plan.labels is not None and plan.labels.boxes_2d in topics:
        offset_ns = round(plan.labels.offset_s * NS_PER_S)
        flat = topics[plan.labels.boxes_2d]
        topics[flat.name] = replace(flat, offset_ns=offset_ns)
    middles_ns = None if by_log else scan_middles_ns(survey, plan)
    if plan.scan is not None and middles_ns is not None:
        scans = topics[plan.scan.topic]
        topics[scans.name] = replace(scans, middles_ns=middles_ns)
        if plan.labels is not None and plan.labels.topic in topics:
            labels = topics[plan.labels.topic]
            if share_stamps(scans, labels, _ROUNDED_NS):
                near = _nearest_headers(scans, labels)
                topics[labels.name] = replace(labels, middles_ns=middles_ns[near])
    return replace(survey, topics=topics)


def scan_middles_ns(survey: Survey, plan: Plan) -> Int64Array | None:
    """Return (N,) the nanoseconds from the stamp of each scan to the middle of its turn.

    None if points have no times, if all stamps are in the middle, or if images have the very stamps
    of the scans: then the recorder has paired them.
    """
    topic = None if plan.scan is None else survey.topics.get(plan.scan.topic)
    turns = None if topic is None else topic.turns_ns()
    if topic is None or turns is None:
        return None
    cameras = (*plan.cameras.values(), *plan.camera_sets.values())
    images = (survey.topics.get(camera.topic) for camera in cameras)
    if any(each is not None and share_stamps(topic, each) for each in images):
        return None
    middles_ns: Int64Array = turns.sum(axis=1) // 2
    return middles_ns if np.abs(middles_ns).max() > _EVEN_NS else None


def _nearest_headers(scans: TopicSurvey, others: TopicSurvey) -> Int64Array:
    """Return (M,) the index of the scan with the nearest header stamp."""
    order = np.argsort(scans.header_ns, kind='stable')
    near, _ = nearest_stamps(np.array(scans.header_ns)[order], np.array(others.header_ns))
    return np.asarray(order[near], np.int64)


def share_stamps(first: TopicSurvey, second: TopicSurvey, rounded_ns: int = 0) -> bool:
    """Whether most header stamps of the smaller topic are also those of the other.

    Messages of one stamp are also recorded within moments, where detectors take up to ten seconds:
    clocks that differ by a whole number of periods have the same stamps at other times.

    Args:
        first: A topic.
        second: Another one.
        rounded_ns: How far apart two stamps are taken for one.
    """
    least = min(len(set(first.header_ns)), len(set(second.header_ns)))
    if not least or len(first.header_ns) != first.count or len(second.header_ns) != second.count:
        return False
    within_ns = _DETECTION_NS if first.classes or second.classes else LATENCY_NS
    stamps, logs = (np.asarray(each) for each in (second.header_ns, second.log_ns))
    order = np.argsort(first.header_ns, kind='stable')
    others, logs_of_others = (np.asarray(each)[order] for each in (first.header_ns, first.log_ns))
    near, later_ns = nearest_stamps(others, stamps)
    same = (stamps != 0) & (np.abs(later_ns) <= rounded_ns)
    same &= np.abs(logs_of_others[near] - logs) <= within_ns
    return 2 * len(set(stamps[same].tolist())) > least


def clock_notes(survey: Survey, plan: Plan) -> Iterator[str]:
    """Yield notes on the stamps of a plan's streams: faults, and middles of turns.

    Args:
        survey: The result of clocked.
        plan: Names the streams.
    """
    seen = set()
    for stream in planned_streams(plan).values():
        topic = survey.topics.get(stream.topic)
        if topic is None or topic.name in seen:
            continue
        seen.add(topic.name)
        yield from topic.oddities()
    scan = None if plan.scan is None else survey.topics.get(plan.scan.topic)
    turns = None if scan is None else scan.turns_ns()
    if scan is not None and not scan.turn_ns and any(map(tells_another_time, scan.looks)):
        yield (
            f'{scan.name}: the times of its points ({time_field(scan.looks[0])}) are not used, for'
            f' they are not those of a turn around the stamp; are they of another clock?'
        )
    if scan is not None and scan.turn_ns and turns is not None and scan.moved_ns().any():
        start, end = scan.turn_ns
        text = (
            f'{scan.name}: its points were measured from {start / 1e6:.1f} to {end / 1e6:.1f} ms'
            f' after the stamp; scans are paired and stamped in the middle,'
            f' {(start + end) / 2e6:.1f} ms from it'
        )
        apart = np.abs(turns - (start, end)).max(axis=1) > _EVEN_NS
        if apart.any():
            least, most = (int(each) / 1e6 for each in (turns[:, 0].min(), turns[:, 1].max()))
            text += (
                f' (medians; {np.count_nonzero(apart)} of {len(turns)} differ by more than'
                f' {_EVEN_NS / 1e6:.0f} ms, from {least:.1f} to {most:.1f} ms at most: each is'
                f' stamped in the middle of its own)'
            )
        yield text
