# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clocks of sensors that differ: the offset of each stream, estimated from the times of recording.

A message is recorded within moments of its stamp. Messages that are recorded at the same time have
the same stamps if the clocks agree; otherwise their difference is the offset of the clocks, up to
the latencies of the drivers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.stamps import NS_PER_S
from ..model.streams import Stream
from .clocks import LATENCY_NS, clocked, planned_streams, share_stamps, with_offset

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.samples import Int64Array
    from .clocks import PlannedStream
    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey

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
    # Of sets whose frames are their images the first, which the streams begin with.
    reference = plan.reference if plan.reference in streams else next(iter(streams), '')
    corrections = find_corrections(clocked(survey, plan), streams, reference)
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
    if abs(_lead_ns(topics[reference])) > LATENCY_NS:
        right = [
            name
            for name in known
            if topics[name].has_own_stamps and abs(_lead_ns(topics[name])) <= LATENCY_NS
        ]
        if right:
            base = known[max(right, key=lambda name: topics[name].count)]
    found = {
        name: _rounded(base - value)
        for name, value in known.items()
        if abs(base - value) > LATENCY_NS
    }
    return _with_images_of_their_scans(found, topics, reference) if found else found


def _with_images_of_their_scans(
    found: dict[str, int], topics: Mapping[str, TopicSurvey], reference: str
) -> dict[str, int]:
    """Move images that may be of two scans, by their estimated stamps, to the later of these.

    A cloud is recorded after its turn, so that the images of a scan, which are exposed in the turn,
    are recorded before it. Where points have times, the end of the turn is known.
    """
    scan = topics[reference]
    if reference != Stream.SCAN.value or scan.turn_ns is not None or scan.count < 2:
        return found
    scan_ns = np.sort(scan.stamps()[0] + found.get(reference, 0))
    for name, topic in topics.items():
        moved = name in found
        if not name.startswith('image_') or not (moved or reference in found):
            continue
        wait_ns = _doubtful_wait_ns(np.sort(topic.stamps()[0] + found.get(name, 0)), scan_ns)
        if wait_ns and not moved:
            return {**found, reference: found[reference] - wait_ns}
        if wait_ns:
            found = {**found, name: found[name] + wait_ns}
    return found


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
    known = np.array(reference.log_ns, dtype=np.int64)
    stamps = _measured_ns(reference)
    logs = np.array(stream.log_ns, dtype=np.int64)
    order = np.argsort(known, kind='stable')
    known, stamps = known[order], stamps[order]
    if not _is_steady(stamps, known):
        return None
    period = int(np.median(np.diff(known)))
    inside = (logs >= known[0] - period) & (logs <= known[-1] + period)
    if 2 * np.count_nonzero(inside) < min(len(logs), len(known)) or not inside.any():
        return None
    own = _measured_ns(stream)[inside]
    start_log, start = int(known[0]), int(stamps[0])
    elapsed = np.interp(logs[inside] - start_log, known - start_log, (stamps - start).astype(float))
    return int(np.median(own - start - np.round(elapsed).astype(np.int64)))


def _measured_ns(topic: TopicSurvey) -> Int64Array:
    """Return the stamps at which messages were complete: of clouds the end of their turns."""
    turns = topic.turns_ns() if topic.has_own_stamps else None
    return topic.clock_ns() - topic.moved_ns() + (0 if turns is None else turns[:, 1])


def _is_steady(stamps: Int64Array, logs: Int64Array) -> bool:
    """Whether log times and stamps advance alike: not if a bag was written in one go."""
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
    known = '' if rest else _TIME_SCALES.get(seconds, '')
    return f' (that is {known})' if known else ''


def _seconds(nanoseconds: int) -> str:
    return f'{abs(nanoseconds) / NS_PER_S:.3f} s'
