# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The stamps that a plan requests, offsets of clocks that differ, and gaps between two streams."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..messages.clouds import has_unexplained_times, time_field
from ..model.errors import Loss
from ..model.samples import nearest_stamps
from ..model.streams import NS_PER_S, Stream
from .plan import BOXES_2D, INFO, OXTS_ROLES, StampSource, topic_uses

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ..model.samples import Int64Array
    from .plan import Plan, TopicUse
    from .survey import Survey, TopicSurvey


# The stamps that a plan requests: offsets, log times, the middle of a turn.

_EVEN_NS = 5_000_000
"""Turns of scanners, and their stamps, are uneven by a few milliseconds."""

LATENCY_NS = NS_PER_S
"""Drivers and video encoders take up to a second; a larger difference is one of clocks."""

_ROUNDED_NS = 2_000_000
"""Detectors and labelling tools write stamps in milliseconds, or as seconds in a float."""

_DETECTION_NS = 10 * NS_PER_S


def planned_streams(plan: Plan) -> dict[str, TopicUse]:
    """Return the streams of a plan by name, the reference first; of camera_sets those of all."""
    uses = [use for use in topic_uses(plan) if use.role not in (INFO, BOXES_2D)]
    uses.sort(key=lambda use: use.name.partition(' ')[0] != plan.reference)
    return {use.name: use for use in uses}


def with_offset(plan: Plan, stream: TopicUse, offset_s: float) -> Plan:
    """Return a plan with the offset of a stream."""
    owner, *which = stream.key.split('.')[:-1] or ['']
    if not owner:
        # mypy does not know the types of fields by name.
        return replace(plan, **{stream.offset_key: offset_s})  # type: ignore[arg-type]
    stream_plan = getattr(plan, owner)
    if which:
        stream_plan = {
            key: replace(camera, offset_s=offset_s) if str(key) in which else camera
            for key, camera in stream_plan.items()
        }
    else:
        stream_plan = replace(stream_plan, offset_s=offset_s)
    return replace(plan, **{owner: stream_plan})


def clocked(survey: Survey, plan: Plan) -> Survey:
    """Return a survey whose topics have the stamps that a plan requests: see TopicSurvey.stamps.

    Scans are stamped in the middle of their turn: those whose points have times from the start of
    the turn on, or up to its end, would be paired with other images.
    """
    topics = dict(survey.topics)
    by_log = plan.stamps is StampSource.LOG
    if by_log:
        topics = {name: replace(topic, by_log=True) for name, topic in topics.items()}
    for use in topic_uses(plan):
        if use.role is not INFO and use.topic in topics:
            offset_ns = round(use.offset_s * NS_PER_S)
            topics[use.topic] = replace(topics[use.topic], offset_ns=offset_ns)
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
    if any(image is not None and share_stamps(topic, image) for image in images):
        return None
    middles_ns: Int64Array = turns.sum(axis=1) // 2
    return middles_ns if np.abs(middles_ns).max() > _EVEN_NS else None


def _nearest_headers(scans: TopicSurvey, others: TopicSurvey) -> Int64Array:
    """Return (M,) the index of the scan with the nearest header stamp."""
    order = np.argsort(scans.header_ns, kind='stable')
    near, _ = nearest_stamps(np.array(scans.header_ns)[order], np.array(others.header_ns))
    return np.asarray(order[near], np.int64)


def share_stamps(first: TopicSurvey, second: TopicSurvey, rounded_ns: int = 0) -> bool:
    """Return whether most header stamps of the smaller topic are also those of the other.

    Messages of one stamp are also recorded within a second; detectors take up to ten seconds:
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
    stamps, logs = (np.asarray(times) for times in (second.header_ns, second.log_ns))
    order = np.argsort(first.header_ns, kind='stable')
    others, logs_of_others = (np.asarray(times)[order] for times in (first.header_ns, first.log_ns))
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
        yield from topic.stamp_notes()
    scan = None if plan.scan is None else survey.topics.get(plan.scan.topic)
    turns = None if scan is None else scan.turns_ns()
    if scan is not None and not scan.turn_ns and any(map(has_unexplained_times, scan.samples)):
        yield (
            f'{scan.name}: the times of its points ({time_field(scan.samples[0])}) are not used,'
            f' for they are not those of a turn around the stamp; are they of another clock?'
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
            least, most = (int(edge) / 1e6 for edge in (turns[:, 0].min(), turns[:, 1].max()))
            text += (
                f' (medians; {np.count_nonzero(apart)} of {len(turns)} differ by more than'
                f' {_EVEN_NS / 1e6:.0f} ms, from {least:.1f} to {most:.1f} ms at most: each is'
                f' stamped in the middle of its own)'
            )
        yield text


# Clocks of sensors that differ: the offset of each stream, estimated from the times of recording.
#
# A message is recorded soon after its stamp. Messages that are recorded at the same time
# have the same stamps if the clocks agree; otherwise their difference is the offset of the clocks,
# up to the latencies of the drivers.

_EXACT_NS = 150_000_000
"""Latencies that the estimate of an exact offset may have in it."""

_DOUBTFUL = (0.3, 0.7)
"""Shares of the way from one scan to the next at which an image may be of either."""

_HOUR_NS = 3600 * NS_PER_S
_MOST_HOURS = 14
_TIME_SCALES = {
    37: 'TAI, as of PTP without its UTC offset',
    18: 'GPS time',
}
"""Seconds that time scales are ahead of UTC since 2017 (IERS Bulletin C 52)."""

_LEAST_RATE, _MOST_RATE = 0.2, 5.0


def estimate_offsets(survey: Survey, plan: Plan) -> tuple[Plan, list[str]]:
    """Set the offsets of streams whose clocks differ from that of the reference.

    The clock of the reference counts; if it differs from that of the recording computer, and the
    clock of another stream does not, that of the computer. Offsets below a second are not
    distinguished from latencies.

    Returns:
        The plan with offsets, and a note on each.
    """
    streams = planned_streams(plan)
    # The first of sets whose frames are their images, which the streams begin with.
    reference = plan.reference if plan.reference in streams else next(iter(streams), '')
    corrections = find_corrections(clocked(survey, plan), streams, reference)
    notes = []
    for name, offset_ns in corrections.items():
        stream = streams[name]
        offset_s = stream.offset_s + offset_ns / NS_PER_S
        plan = with_offset(plan, stream, offset_s)
        side = 'ahead of' if offset_ns < 0 else 'behind'
        notes.append(
            f'{stream}: its clock is {_seconds(offset_ns)} {side} the others by the times of'
            f' recording{_scale(offset_ns)}; {stream.offset_key} {offset_s!r} corrects it'
        )
    return plan, notes


def find_corrections(
    survey: Survey, streams: Mapping[str, TopicUse], reference: str
) -> dict[str, int]:
    """Return the nanoseconds to add to the stamps of each stream whose clock differs."""
    topics = {
        name: survey.topics[use.topic]
        for name, use in streams.items()
        if use.topic in survey.topics and survey.topics[use.topic].count
    }
    if reference not in topics:
        return {}
    ahead = {name: _ahead_of(topics[reference], topic) for name, topic in topics.items()}
    leads_ns = {name: lead_ns for name, lead_ns in ahead.items() if lead_ns is not None}
    base = 0
    if abs(_lead_ns(topics[reference])) > LATENCY_NS:
        right = [
            name
            for name in leads_ns
            if topics[name].has_own_stamps and abs(_lead_ns(topics[name])) <= LATENCY_NS
        ]
        if right:
            base = leads_ns[max(right, key=lambda name: topics[name].count)]
    shifts = {
        name: _rounded(base - lead_ns)
        for name, lead_ns in leads_ns.items()
        if abs(base - lead_ns) > LATENCY_NS
    }
    return _with_images_of_their_scans(shifts, topics, reference) if shifts else shifts


def _with_images_of_their_scans(
    shifts: dict[str, int], topics: Mapping[str, TopicSurvey], reference: str
) -> dict[str, int]:
    """Move images that may be of two scans, by their estimated stamps, to the later of these.

    A cloud is recorded after its turn, so that the images of a scan, which are exposed in the turn,
    are recorded before it. Where points have times, the end of the turn is known.
    """
    scan = topics[reference]
    if reference != Stream.SCAN.value or scan.turn_ns is not None or scan.count < 2:
        return shifts
    scan_ns = np.sort(scan.stamps()[0] + shifts.get(reference, 0))
    for name, topic in topics.items():
        moved = name in shifts
        if not name.startswith('image_') or not (moved or reference in shifts):
            continue
        wait_ns = _doubtful_wait_ns(np.sort(topic.stamps()[0] + shifts.get(name, 0)), scan_ns)
        if wait_ns and not moved:
            return {**shifts, reference: shifts[reference] - wait_ns}
        if wait_ns:
            shifts = {**shifts, name: shifts[name] + wait_ns}
    return shifts


def _doubtful_wait_ns(images_ns: Int64Array, scans_ns: Int64Array) -> int:
    """Return the median time from images to the next scan; 0 where their scan is not in doubt."""
    period = float(np.median(np.diff(scans_ns)))
    after = np.searchsorted(scans_ns, images_ns)
    inside = (after > 0) & (after < len(scans_ns))
    if not inside.any() or np.median(np.diff(images_ns)) < period / 2:
        return 0
    wait = float(np.median(scans_ns[after[inside]] - images_ns[inside]))
    return round(wait / 1000) * 1000 if _DOUBTFUL[0] < wait / period < _DOUBTFUL[1] else 0


def _ahead_of(reference: TopicSurvey, stream: TopicSurvey) -> int | None:
    """Return the nanoseconds that the stamps of a stream are ahead of those of the reference.

    None if they were not recorded together.
    """
    if stream.name == reference.name or share_stamps(reference, stream):
        return stream.offset_ns - reference.offset_ns
    times = np.array(reference.log_ns, dtype=np.int64)
    stamps = _measured_ns(reference)
    logs = np.array(stream.log_ns, dtype=np.int64)
    order = np.argsort(times, kind='stable')
    times, stamps = times[order], stamps[order]
    if not _is_steady(stamps, times):
        return None
    period = int(np.median(np.diff(times)))
    inside = (logs >= times[0] - period) & (logs <= times[-1] + period)
    if 2 * np.count_nonzero(inside) < min(len(logs), len(times)) or not inside.any():
        return None
    own = _measured_ns(stream)[inside]
    start_log, start = int(times[0]), int(stamps[0])
    elapsed = np.interp(logs[inside] - start_log, times - start_log, (stamps - start).astype(float))
    return int(np.median(own - start - np.round(elapsed).astype(np.int64)))


def _measured_ns(topic: TopicSurvey) -> Int64Array:
    """Return the stamps at which messages were complete: of clouds the end of their turns."""
    turns = topic.turns_ns() if topic.has_own_stamps else None
    return topic.clock_ns() - topic.moved_ns() + (0 if turns is None else turns[:, 1])


def _is_steady(stamps: Int64Array, logs: Int64Array) -> bool:
    """Return whether log times and stamps advance alike: not if a bag was written in one go."""
    if len(logs) < 2 or logs[-1] == logs[0]:
        return False
    rate = float(stamps[-1] - stamps[0]) / float(logs[-1] - logs[0])
    return _LEAST_RATE < rate < _MOST_RATE


def _lead_ns(topic: TopicSurvey) -> int:
    """Return the median nanoseconds that stamps are ahead of log times."""
    leads = topic.clock_ns() - np.array(topic.log_ns, dtype=np.int64)
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
    time_scale = '' if rest else _TIME_SCALES.get(seconds, '')
    return f' (that is {time_scale})' if time_scale else ''


def _seconds(nanoseconds: int) -> str:
    return f'{abs(nanoseconds) / NS_PER_S:.3f} s'


# How far apart the stamps of two streams are, and what to set in the plan.

_MAX_OXTS_GAP_NS = 2 * NS_PER_S + NS_PER_S // 2


def nearest_gap_ns(reference_ns: Int64Array, stamps_ns: Int64Array) -> int:
    """Return the least distance of two stamps, positive where the stream's is the later one.

    Args:
        reference_ns: (N,) of the frames, N > 0, in any order.
        stamps_ns: (M,) of a stream, M > 0, in any order.
    """
    stamps = np.sort(stamps_ns)
    after = np.clip(np.searchsorted(stamps, reference_ns), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    gaps = np.concatenate([stamps[after] - reference_ns, stamps[before] - reference_ns])
    return int(gaps[np.argmin(np.abs(gaps))])


def describe_gap(
    survey: Survey, plan: Plan, name: str, reference_ns: Int64Array, stamps_ns: Int64Array
) -> str:
    """Describe how far a stream is from the frames, and what to set; one line.

    Args:
        survey: The result of clocked.
        plan: The plan of the streams.
        name: The name of the stream in planned_streams.
        reference_ns: (N,) of the frames.
        stamps_ns: (M,) of the stream.
    """
    streams = planned_streams(plan)
    stream = streams[name]
    if not len(reference_ns) or not len(stamps_ns):
        return f'{stream} has no sample'
    gap = nearest_gap_ns(reference_ns, stamps_ns)
    starts = int(stamps_ns.min()) - int(reference_ns.min())
    side = 'after' if gap > 0 else 'before'
    text = (
        f'{stream} has no sample within {plan.tolerance_s * 1000:.0f} ms of {_reference(plan)}:'
        f' the nearest is {_distance(gap)} {side} it, and the first stamps are'
        f' {_distance(starts)} apart'
    )
    shifts = find_corrections(survey, streams, plan.reference)
    if shifts:
        keys = ', '.join(
            f'{streams[other].offset_key}: {streams[other].offset_s + offset / NS_PER_S!r}'
            for other, offset in shifts.items()
        )
        return f'{text}; by the times of recording, set {keys} in the plan, or stamps: log'
    return (
        f'{text}; set {stream.offset_key}, stamps: log, or a larger tolerance_s in the plan, or'
        f' remove the stream from it'
    )


def oxts_losses(survey: Survey, plan: Plan, frames_ns: Int64Array) -> tuple[Loss, ...]:
    """Return the topics of the GPS/IMU that have no message near any frame.

    Args:
        survey: The result of clocked.
        plan: Names them.
        frames_ns: (N,) stamps of the frames.
    """
    losses = []
    for name, stream in planned_streams(plan).items():
        topic = survey.topics.get(stream.topic) if stream.role in OXTS_ROLES else None
        if topic is None or not topic.count or not len(frames_ns):
            continue
        stamps = topic.stamps()[0]
        if abs(nearest_gap_ns(frames_ns, stamps)) > _MAX_OXTS_GAP_NS:
            text = describe_gap(survey, plan, name, frames_ns, stamps)
            losses.append(Loss(topic.name, topic.count, f'{topic.name}: {text}'))
    return tuple(losses)


def _reference(plan: Plan) -> str:
    stream = planned_streams(plan).get(plan.reference)
    return plan.reference if stream is None else str(stream)


def _distance(gap_ns: int) -> str:
    return f'{abs(gap_ns) / 1e6:.1f} ms' if abs(gap_ns) < NS_PER_S else f'{abs(gap_ns) / 1e9:.3f} s'
