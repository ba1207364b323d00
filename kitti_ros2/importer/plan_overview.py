# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a plan makes of the topics of a bag: by stream, and those that it passes over."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.source import CALIBRATION
from ..model.errors import KittiRos2Error
from ..model.msgtypes import TF_TYPES
from ..model.stamps import NS_PER_S
from ..model.streams import Stream
from .apply_calibration import Rigging
from .camera_sets import frames_of_sets, plans_of
from .clocks import clocked
from .plan import SOURCE, TF
from .poses import PlannedMotion, read_motion
from .report import LossTally

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from ..bags.reader import BagSource
    from ..options.selection import SelectionOptions
    from .frames import Frames
    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey

_UNIT = ('imu', 'fix', 'velocity')
_STREAMS = {
    'scan': Stream.SCAN,
    'pose': Stream.POSE,
    'labels': Stream.LABELS,
    **dict.fromkeys(_UNIT, Stream.OXTS),
}
"""By key of a plan the stream whose topics are named there."""

_ORDER = (
    Stream.SCAN,
    Stream.IMAGE_0,
    Stream.IMAGE_1,
    Stream.IMAGE_2,
    Stream.IMAGE_3,
    Stream.IMAGE_4,
    Stream.LABELS,
    Stream.POSE,
    Stream.OXTS,
    Stream.CALIBRATION,
)
_FRAMES = frozenset({'frame', 'body', 'world'})
"""Keys of coordinate frames, whose names may be those of topics."""


@dataclass(frozen=True)
class PlannedTopic:
    """A topic of a bag in a plan.

    Attributes:
        streams: KITTI's streams that are made of it; empty for a topic that is passed over.
        topic, msgtype: As the bag has them.
        count: Number of messages.
        rate_hz: Mean rate by the stamps that a conversion uses; None for fewer than two.
        frame: The coordinate frame of most messages; empty without one.
    """

    streams: tuple[str, ...]
    topic: str
    msgtype: str
    count: int
    rate_hz: float | None
    frame: str


@dataclass(frozen=True)
class PlanOverview:
    """What a plan makes of a bag.

    Attributes:
        plan: The plan.
        used: The topics that become KITTI's streams, by stream.
        passed_over: The others that have messages, by name.
        frames: Number of frames of the conversion, None if it would fail.
        faults: Why it would fail, a line each.
        notes: Non-fatal remarks about the frames, a line each.
    """

    plan: Plan
    used: tuple[PlannedTopic, ...]
    passed_over: tuple[PlannedTopic, ...]
    frames: int | None
    faults: tuple[str, ...]
    notes: tuple[str, ...]


def overlook_plan(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, selection: SelectionOptions
) -> PlanOverview:
    """Return what a plan makes of bags; of their messages the poses alone are read.

    Args:
        bags: Those of one recording.
        plan: The rules of the conversion.
        survey: The content of the bags.
        selection: Of the frames.
    """
    streams = streams_of_topics(plan, survey)
    order = {stream.value: place for place, stream in enumerate(_ORDER)}
    topics = [_planned(each, streams.get(each.name, ())) for each in _with_messages(survey)]
    used = [each for each in topics if each.streams]
    used.sort(key=lambda each: (min(order[name] for name in each.streams), each.topic))
    survey = clocked(survey, plan)
    motion, faults = PlannedMotion(), list[str]()
    sets: list[Frames] = []
    plans: Mapping[str, Plan] = {}
    try:
        plans = plans_of(plan)
        motion = read_motion(bags, next(iter(plans.values())), survey, LossTally())
        sets = list(frames_of_sets(plans, survey, motion.of_frames, selection).values())
        faults += [
            f'no two streams have a frame in common: {each.unsynchronised}'
            for each in sets
            if each.unsynchronised
        ]
    except KittiRos2Error as error:
        faults.append(str(error))
    for each in plans.values():
        try:
            Rigging(each, survey, motion.tree)
        except KittiRos2Error as error:
            faults.append(str(error))
    notes = [note for each in sets for note in each.notes]
    notes += [loss.text() for each in sets for loss in each.losses]
    return PlanOverview(
        plan,
        tuple(used),
        tuple(each for each in topics if not each.streams),
        None if faults else len(sets[0]),
        tuple(dict.fromkeys(faults)),
        tuple(dict.fromkeys(notes)),
    )


def streams_of_topics(plan: Plan, survey: Survey) -> dict[str, tuple[str, ...]]:
    """Return by topic of a bag the streams that a plan makes of it, of topics with messages."""
    present = {each.name for each in _with_messages(survey)}
    found: dict[str, dict[str, None]] = {}
    for stream, text in _texts(asdict(plan)):
        if text in present:
            found.setdefault(text, {})[stream.value] = None
    for topic in _with_messages(survey):
        if topic.msgtype in TF_TYPES and plan.calibration == TF and topic.name not in found:
            found[topic.name] = {Stream.CALIBRATION.value: None}
    if plan.calibration == SOURCE and CALIBRATION in present:
        found[CALIBRATION] = {Stream.CALIBRATION.value: None}
    return {topic: tuple(streams) for topic, streams in found.items()}


def _texts(values: Mapping[str, Any]) -> Iterator[tuple[Stream, str]]:
    """Yield the texts of a plan that may name topics, each with the stream of its key."""
    for key, value in values.items():
        if key in _STREAMS:
            yield from _texts_below(value, _STREAMS[key])
    for camera in values['camera_sets'].values():
        yield from _texts_below(camera, Stream.IMAGE_2)
    for number, camera in values['cameras'].items():
        yield from _texts_below(camera, Stream(f'image_{number}'))


def _texts_below(value: Any, stream: Stream) -> Iterator[tuple[Stream, str]]:  # noqa: ANN401
    if isinstance(value, str):
        yield stream, value
    elif isinstance(value, dict):
        for key, each in value.items():
            if key not in _FRAMES:
                yield from _texts_below(each, Stream.CALIBRATION if key == 'info' else stream)
    elif isinstance(value, (list, tuple)):
        for each in value:
            yield from _texts_below(each, stream)


def _with_messages(survey: Survey) -> list[TopicSurvey]:
    found = [topic for topic in survey.topics.values() if topic.count]
    return sorted(found, key=lambda topic: topic.name)


def _planned(topic: TopicSurvey, streams: tuple[str, ...]) -> PlannedTopic:
    stamps, _ = topic.stamps()
    span_ns = int(np.ptp(stamps)) if len(stamps) > 1 else 0
    rate = (len(stamps) - 1) * NS_PER_S / span_ns if span_ns else None
    return PlannedTopic(streams, topic.name, topic.msgtype, topic.count, rate, topic.frame)
