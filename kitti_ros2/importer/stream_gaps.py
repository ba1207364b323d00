# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How far apart the stamps of two streams are, and what to set in the plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.losses import Loss
from ..model.stamps import NS_PER_S
from .clock_offsets import find_corrections
from .clocks import planned_streams

if TYPE_CHECKING:
    from ..model.samples import Int64Array
    from .plan import Plan
    from .survey import Survey

_MAX_UNIT_GAP_NS = 2 * NS_PER_S + NS_PER_S // 2
_ROLES = ('imu', 'fix', 'velocity')


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
    """Describe how far a stream is from the frames, and the remedy; one line.

    Args:
        survey: The result of clocked.
        plan: Of the streams.
        name: Of the stream, as in planned_streams.
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
        f'{stream} has no sample within {plan.tolerance_s * 1000:.0f} ms of {_of(plan)}: the'
        f' nearest is {_distance(gap)} {side} it, and the first stamps are'
        f' {_distance(starts)} apart'
    )
    found = find_corrections(survey, streams, plan.reference)
    if found:
        keys = ', '.join(
            f'{streams[each].key}: {streams[each].offset_s + offset / NS_PER_S!r}'
            for each, offset in found.items()
        )
        return f'{text}; by the times of recording, set {keys} in the plan, or stamps: log'
    return (
        f'{text}; set {stream.key}, stamps: log, or a larger tolerance_s in the plan, or remove the'
        f' stream from it'
    )


def unit_losses(survey: Survey, plan: Plan, frames_ns: Int64Array) -> tuple[Loss, ...]:
    """Return the topics of the GPS/IMU unit that have no message near any frame.

    Args:
        survey: The result of clocked.
        plan: Names them.
        frames_ns: (N,) stamps of the frames.
    """
    losses = []
    for name, stream in planned_streams(plan).items():
        topic = survey.topics.get(stream.topic) if name in _ROLES else None
        if topic is None or not topic.count or not len(frames_ns):
            continue
        stamps = topic.stamps()[0]
        if abs(nearest_gap_ns(frames_ns, stamps)) > _MAX_UNIT_GAP_NS:
            text = describe_gap(survey, plan, name, frames_ns, stamps)
            losses.append(Loss(topic.name, topic.count, f'{topic.name}: {text}'))
    return tuple(losses)


def _of(plan: Plan) -> str:
    stream = planned_streams(plan).get(plan.reference)
    return plan.reference if stream is None else str(stream)


def _distance(gap_ns: int) -> str:
    return f'{abs(gap_ns) / 1e6:.1f} ms' if abs(gap_ns) < NS_PER_S else f'{abs(gap_ns) / 1e9:.3f} s'
