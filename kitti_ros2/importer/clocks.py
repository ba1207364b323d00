# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clocks of sensors that differ: the offset of each stream, estimated from the times of recording.

A message is recorded within moments of its stamp. Messages that are recorded at the same time have
the same stamps if the clocks agree; otherwise their difference is the offset of the clocks, up to
the latencies of the drivers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.stamps import NS_PER_S
from .plan import Stamps

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ..model.samples import Int64Array
    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey

_LATENCY_NS = NS_PER_S
"""Detectors and video encoders take up to a second; a larger difference is one of clocks."""

_EXACT_NS = 25_000_000
_HOUR_NS = 3600 * NS_PER_S
_MOST_HOURS = 14
_TIME_SCALES = {
    37: 'TAI, as of PTP without its UTC offset',
    18: 'GPS time',
}
"""Seconds that time scales are ahead of UTC since 2017 (IERS Bulletin C 52)."""

_ROLES = ('imu', 'fix', 'velocity')
_LEAST_RATE, _MOST_RATE = 0.2, 5.0


@dataclass(frozen=True)
class PlannedStream:
    """A stream of a plan with stamps.

    Attributes:
        name: In texts: scan, image_2, pose, labels, imu.
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
    """Return the streams of a plan by name, the reference first."""
    found = [
        PlannedStream(name, f'{name}.offset_s', part.topic, part.offset_s)
        for name, part in (('scan', plan.scan), ('pose', plan.pose), ('labels', plan.labels))
        if part is not None
    ]
    found += [
        PlannedStream(f'image_{index}', f'cameras.{index}.offset_s', camera.topic, camera.offset_s)
        for index, camera in plan.cameras.items()
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
    found.sort(key=lambda each: each.name != plan.reference)
    return {each.name: each for each in found}


def with_offset(plan: Plan, name: str, offset_s: float) -> Plan:
    """Return a plan with the offset of a stream, by the name of planned_streams."""
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
    by_log = plan.stamps is Stamps.LOG
    if by_log:
        topics = {name: replace(topic, by_log=True) for name, topic in topics.items()}
    for stream in planned_streams(plan).values():
        if stream.topic in topics:
            offset_ns = round(stream.offset_s * NS_PER_S)
            topics[stream.topic] = replace(topics[stream.topic], offset_ns=offset_ns)
    middle_ns = 0 if by_log else scan_middle_ns(survey, plan)
    if plan.scan is not None and middle_ns:
        names = {plan.scan.topic}
        if plan.labels is not None and plan.labels.topic in topics:
            labels = topics[plan.labels.topic]
            if share_stamps(topics[plan.scan.topic], labels):
                names.add(labels.name)
        for name in names:
            topics[name] = replace(topics[name], middle_ns=middle_ns)
    return replace(survey, topics=topics)


def scan_middle_ns(survey: Survey, plan: Plan) -> int:
    """Return the nanoseconds from the stamps of scans to the middle of their turns.

    0 if points have no times, or if images have the very stamps of the scans: then the recorder
    has paired them.
    """
    topic = None if plan.scan is None else survey.topics.get(plan.scan.topic)
    if topic is None or not topic.turn_ns:
        return 0
    images = (survey.topics.get(camera.topic) for camera in plan.cameras.values())
    if any(each is not None and share_stamps(topic, each) for each in images):
        return 0
    start, end = topic.turn_ns
    return (start + end) // 2


def share_stamps(first: TopicSurvey, second: TopicSurvey) -> bool:
    """Whether most header stamps of the smaller topic are also those of the other."""
    ours, theirs = set(first.header_ns), set(second.header_ns)
    least = min(len(ours), len(theirs))
    return 2 * len((ours & theirs) - {0}) > least > 0


def estimate_offsets(survey: Survey, plan: Plan) -> tuple[Plan, list[str]]:
    """Set the offsets of streams whose clocks differ from that of the reference.

    The clock of the reference counts; if it differs from that of the recording computer, and the
    clock of another stream does not, that of the computer. Offsets below a second are not
    distinguished from latencies.

    Returns:
        The plan with offsets, and a note on each.
    """
    streams = planned_streams(plan)
    corrections = find_corrections(clocked(survey, plan), streams, plan.reference)
    notes = []
    for name, offset_ns in corrections.items():
        stream = streams[name]
        offset_s = stream.offset_s + offset_ns / NS_PER_S
        plan = with_offset(plan, name, offset_s)
        side = 'ahead of' if offset_ns < 0 else 'behind'
        notes.append(
            f'{stream}: its clock is {_seconds(offset_ns)} {side} the others by the times of'
            f' recording{_scale(offset_ns)}; {stream.key} {offset_s!r} corrects it'
        )
    return plan, notes


def find_corrections(
    survey: Survey, streams: Mapping[str, PlannedStream], reference: str
) -> dict[str, int]:
    """Return the nanoseconds to add to the stamps of each stream whose clock differs."""
    topics = {
        name: survey.topics[each.topic]
        for name, each in streams.items()
        if each.topic in survey.topics and survey.topics[each.topic].count
    }
    if reference not in topics:
        return {}
    ahead = {name: _ahead_of(topics[reference], topic) for name, topic in topics.items()}
    known = {name: value for name, value in ahead.items() if value is not None}
    base = 0
    if abs(_lead_ns(topics[reference])) > _LATENCY_NS:
        right = [
            name
            for name in known
            if topics[name].has_own_stamps and abs(_lead_ns(topics[name])) <= _LATENCY_NS
        ]
        if right:
            base = known[max(right, key=lambda name: topics[name].count)]
    return {
        name: _rounded(base - value)
        for name, value in known.items()
        if abs(base - value) > _LATENCY_NS
    }


def _ahead_of(reference: TopicSurvey, stream: TopicSurvey) -> int | None:
    """Return the nanoseconds that the stamps of a stream are ahead of those of the reference.

    None if they were not recorded together.
    """
    if stream.name == reference.name or share_stamps(reference, stream):
        return stream.offset_ns - reference.offset_ns
    known = np.array(reference.log_ns, dtype=np.int64)
    stamps = reference.stamps()[0] - reference.middle_ns
    logs = np.array(stream.log_ns, dtype=np.int64)
    order = np.argsort(known, kind='stable')
    known, stamps = known[order], stamps[order]
    if not _is_steady(stamps, known):
        return None
    period = int(np.median(np.diff(known)))
    inside = (logs >= known[0] - period) & (logs <= known[-1] + period)
    if 2 * np.count_nonzero(inside) < min(len(logs), len(known)) or not inside.any():
        return None
    own = (stream.stamps()[0] - stream.middle_ns)[inside]
    start_log, start = int(known[0]), int(stamps[0])
    elapsed = np.interp(logs[inside] - start_log, known - start_log, (stamps - start).astype(float))
    return int(np.median(own - start - np.round(elapsed).astype(np.int64)))


def _is_steady(stamps: Int64Array, logs: Int64Array) -> bool:
    """Whether log times and stamps advance alike: not if a bag was written in one go."""
    if len(logs) < 2 or logs[-1] == logs[0]:
        return False
    rate = float(stamps[-1] - stamps[0]) / float(logs[-1] - logs[0])
    return _LEAST_RATE < rate < _MOST_RATE


def _lead_ns(topic: TopicSurvey) -> int:
    """Return the median nanoseconds that stamps are ahead of log times."""
    leads = topic.stamps()[0] - np.array(topic.log_ns, dtype=np.int64)
    return int(np.sort(leads)[len(leads) // 2])


def _rounded(offset_ns: int) -> int:
    """Return the offset of a time scale or time zone if it is as near as latencies, else to us."""
    scales = [seconds * NS_PER_S for seconds in _TIME_SCALES]
    scales += [hour * _HOUR_NS for hour in range(1, _MOST_HOURS + 1)]
    sign = 1 if offset_ns > 0 else -1
    for exact in scales:
        if abs(abs(offset_ns) - exact) <= _EXACT_NS:
            return sign * exact
    return round(offset_ns / 1000) * 1000


def _scale(offset_ns: int) -> str:
    seconds, rest = divmod(-offset_ns, NS_PER_S)
    known = '' if rest else _TIME_SCALES.get(seconds, '')
    return f' (that is {known})' if known else ''


def _seconds(nanoseconds: int) -> str:
    return f'{abs(nanoseconds) / NS_PER_S:.3f} s'


def clock_notes(survey: Survey, plan: Plan) -> Iterator[str]:
    """Yield notes on the stamps of a plan's streams: where they repeat, and middles of turns.

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
    if scan is not None and scan.middle_ns and scan.turn_ns:
        start, end = (f'{each / 1e6:.1f}' for each in scan.turn_ns)
        yield (
            f'{scan.name}: its points were measured from {start} to {end} ms after the stamp;'
            f' scans are paired and stamped in the middle, {scan.middle_ns / 1e6:.1f} ms from it'
        )
