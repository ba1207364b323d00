# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of a plan, with the sample of each stream in each; and the report of a conversion."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.prepare import within
from ..messages.moving_tree import MAX_GAP_NS
from ..messages.naming import LABEL_LINES
from ..model.bag_formats import TF_TYPES
from ..model.errors import Loss, UnsynchronisedError, UsageError
from ..model.samples import NONE, match_frames
from ..model.streams import NS_PER_S, Stream
from .bag_videos import needed_for
from .clocks import clock_notes, clocked, describe_gap
from .plan import IMAGES, LABELS, OXTS_ROLES, Incomplete, topic_uses
from .survey import topic_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from ..bags.reader import BagMessage, BagMessages
    from ..messages.moving_tree import Track
    from ..model.samples import Int64Array, StreamMatch
    from ..model.streams import Layout
    from ..options.read import SelectionOptions
    from .plan import Plan
    from .survey import Survey


# The frames that a selection takes.


def span_of(
    stamps_ns: Int64Array, mask: npt.NDArray[np.bool_], selection: SelectionOptions
) -> npt.NDArray[np.bool_]:
    """Return which frames a selection takes.

    Raises:
        UsageError: None of those that are kept.
    """
    numbers = np.cumsum(mask) - 1
    chosen = within(selection, numbers, stamps_ns)
    if not (chosen & mask).any():
        seconds = (int(stamps_ns[mask].max()) - int(stamps_ns.min())) / NS_PER_S
        raise UsageError(
            f'the selection takes no frame; there are frames 0 to {numbers[-1]},'
            f' seconds 0s to {seconds:.3f}s'
        )
    return chosen


# Check of the message types of the topics that a plan names.

_CHECKED = (IMAGES, LABELS, *OXTS_ROLES)


def check_types(plan: Plan, survey: Survey) -> None:
    """Check that messages of a plan's topics can be decoded as what the plan uses them for.

    Topics without messages, scans, poses and CameraInfos are checked where they are used.

    Raises:
        UsageError: The type of one is another; the error names the key.
    """
    for use in sorted(topic_uses(plan), key=lambda use: use.role is not IMAGES):
        topic = survey.topics.get(use.topic)
        if use.role not in _CHECKED or use.topic == LABEL_LINES or topic is None:
            continue
        if topic.count and topic.msgtype not in use.role.every_type:
            expected = ', '.join(use.role.every_type)
            key = f'{use.key}: {use.topic}'
            raise UsageError(f'{key} is of type {topic.msgtype}; expected {expected}')


# The frames of a plan, and the sample of each stream in each.

_MS = 1e6
NO_FRAME, NO_PACKET = 'no frame is written here', 'no oxts is written here'
_NO_POSE = f'no poses before and after it are at most {MAX_GAP_NS / NS_PER_S:g} s apart'


def why_unposed(plan: Plan) -> str:
    """Return why a frame has no pose."""
    return _NO_POSE if plan.interpolates else 'it has no pose of its own'


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a data set.

    Attributes:
        stamps_ns: (N,) of the reference stream.
        samples: By stream, (N,) index of the sample in its topic's order of reading, NONE without.
        stamps: By topic the stamps used, in the order of reading.
        notes: How well the streams matched, and what was dropped; a line each.
        losses: Streams of which no sample has a frame.
        unsynchronised: Why no two streams were matched, empty if some were.
        label_indices: For each frame the indices of its messages with boxes; see label_groups.
        indices_2d: For each frame the indices of its messages with boxes in the image.
        unposed_ns: Stamps of the frames that were dropped because of a gap in the poses.
        moved_ns: By topic what was added to its stamps for the middle of turns.
    """

    stamps_ns: Int64Array
    samples: Mapping[Stream, Int64Array]
    stamps: Mapping[str, Int64Array]
    notes: tuple[str, ...]
    losses: tuple[Loss, ...] = ()
    unsynchronised: str = ''
    label_indices: tuple[tuple[int, ...], ...] = ()
    indices_2d: tuple[tuple[int, ...], ...] = ()
    unposed_ns: Int64Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    moved_ns: Mapping[str, Int64Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stamps_ns)


def frame_topics(plan: Plan) -> dict[Stream, str]:
    """Return the topics whose samples make up a frame, by stream."""
    topics = {Stream(f'image_{index}'): camera.topic for index, camera in plan.cameras.items()}
    if plan.scan is not None:
        topics[Stream.SCAN] = plan.scan.topic
    if plan.labels is not None:
        topics[Stream.LABELS] = plan.labels.topic
    return topics


def choose_frames(
    plan: Plan,
    survey: Survey,
    track: Track | None,
    selection: SelectionOptions | None = None,
) -> Frames:
    """Choose the frames of a plan.

    Args:
        plan: Names the reference stream, the clocks and the treatment of incomplete frames.
        survey: The stamps of all topics.
        track: The poses, where each frame needs one: frames without a pose are dropped.
        selection: First and last of these frames, by their positions from 0, seconds from the
            first, or stamps; None is all.

    Raises:
        UsageError: The plan names a missing topic, or no frame is left.
        UnsynchronisedError: No frame is left, for a stream has no sample near any.
    """
    check_types(plan, survey)
    survey = clocked(survey, plan)
    frames, apart = _every_frame(plan, survey, track)
    mask, lost, dropped = _complete(plan, frames, track)
    if not mask.any():
        if apart:
            raise UnsynchronisedError(f'no frame is whole: {"; ".join(apart)}')
        raise UsageError(
            f'no frame is whole: {"; ".join(dropped) or "no sample at all"}; widen tolerance_s of'
            f' the plan, set incomplete: keep, or remove the missing stream from the plan'
        )
    if selection is not None and not selection.is_whole:
        chosen = span_of(frames.stamps_ns, mask, selection)
        mask, lost = mask & chosen, lost & chosen
    return replace(
        pick_frames(frames, mask),
        notes=(*frames.notes, *dropped),
        unposed_ns=within_gaps(frames.stamps_ns, lost, track),
    )


def _every_frame(plan: Plan, survey: Survey, track: Track | None) -> tuple[Frames, tuple[str, ...]]:
    """Return a frame for each sample of the reference, and why streams have no sample in any."""
    notes = list(clock_notes(survey, plan))
    topics = frame_topics(plan)
    stamps = {name: topic_of(survey, name).stamps()[0] for name in topics.values()}
    groups = _label_groups(topics, survey)
    series = {
        stream: by_group(stamps[name], groups) if stream is Stream.LABELS else stamps[name]
        for stream, name in topics.items()
    }
    reference = _reference(plan, series, track)
    order = np.argsort(reference, kind='stable')
    reference = reference[order]
    others = {stream: times for stream, times in series.items() if stream.value != plan.reference}
    indices_2d, lost_2d = _match_2d(plan, survey, reference, notes)
    matches = match_frames(reference, others, round(plan.tolerance_s * NS_PER_S))
    notes += [_matching(stream, topics[stream], match) for stream, match in matches.items()]
    apart = {
        stream: describe_gap(survey, plan, stream.value, reference, stamps[topics[stream]])
        for stream, match in matches.items()
        if not match.matched
    }
    losses = [
        Loss(topics[stream], matches[stream].dropped, f'{topics[stream]}: {text}')
        for stream, text in apart.items()
    ]
    samples = dict.fromkeys(topics, order)
    samples |= {stream: match.indices for stream, match in matches.items()}
    labelled = samples.get(Stream.LABELS, np.empty(0, np.int64))
    if Stream.LABELS in samples:
        samples[Stream.LABELS] = first_indices(groups, labelled)
    reasons = tuple(apart.values())
    frames = Frames(
        stamps_ns=reference,
        samples=samples,
        stamps=stamps,
        moved_ns={name: topic_of(survey, name).moved_ns() for name in stamps},
        notes=tuple(notes),
        losses=(*losses, *lost_2d),
        unsynchronised='; '.join(reasons) if len(apart) == len(matches) else '',
        label_indices=message_indices(labelled, groups),
        indices_2d=indices_2d,
    )
    return frames, reasons


def _complete(
    plan: Plan, frames: Frames, track: Track | None
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_], list[str]]:
    """Return which frames have all samples and a pose, if the plan drops the others.

    Also which of those with all samples have no pose, and notes on what was dropped.
    """
    notes: list[str] = []
    mask = np.ones(len(frames), dtype=np.bool_)
    if plan.incomplete is Incomplete.DROP:
        for stream, indices in frames.samples.items():
            mask &= _without(indices == NONE, f'{stream.value} within tolerance', notes)
    lost = np.zeros(len(frames), dtype=np.bool_)
    if track is not None:
        unknown = ~track.covers(frames.stamps_ns)
        lost = mask & unknown
        gap = 'between poses too far apart' if plan.interpolates else 'between others'
        where = _where_unposed(frames.stamps_ns[unknown], track, gap)
        mask &= _without(unknown, f'pose around them{where}', notes)
    return mask, lost, notes


def _label_groups(topics: Mapping[Stream, str], survey: Survey) -> list[list[int]] | None:
    """Return the groups of the labels' messages, None where each is alone."""
    if Stream.LABELS not in topics:
        return None
    return topic_of(survey, topics[Stream.LABELS]).groups()


def _match_2d(
    plan: Plan, survey: Survey, reference: Int64Array, notes: list[str]
) -> tuple[tuple[tuple[int, ...], ...], list[Loss]]:
    """Return for each frame the indices of its messages with boxes in the image.

    Also the loss of all, where none is near a frame.
    """
    flat = plan.labels.boxes_2d if plan.labels is not None else ''
    if not flat:
        return (), []
    topic = topic_of(survey, flat)
    groups = topic.groups()
    stamps = by_group(topic.stamps()[0], groups)
    match = match_frames(reference, {flat: stamps}, round(plan.tolerance_s * NS_PER_S))[flat]
    indices = message_indices(match.indices, groups)
    notes.append(_matching(Stream.LABELS, flat, match))
    if match.matched:
        return indices, []
    reason = (
        f'{flat}: no message within {plan.tolerance_s * 1000:.0f} ms of a frame; remove'
        f' labels.boxes_2d from the plan, or set stamps: log or a larger tolerance_s'
    )
    return indices, [Loss(flat, match.dropped, reason)]


def message_indices(
    indices: Int64Array, groups: Sequence[Sequence[int]] | None
) -> tuple[tuple[int, ...], ...]:
    """Return the indices of the messages of each frame, by the index of its group."""
    return tuple(
        () if index == NONE else (index,) if groups is None else tuple(groups[index])
        for index in indices.tolist()
    )


def first_indices(groups: Sequence[Sequence[int]] | None, indices: Int64Array) -> Int64Array:
    """Return the index of the first message of each frame's group, NONE without one."""
    if groups is None:
        return indices
    firsts = np.array([*(group[0] for group in groups), NONE], dtype=np.int64)
    return np.asarray(firsts[indices])


def by_group(stamps_ns: Int64Array, groups: Sequence[Sequence[int]] | None) -> Int64Array:
    """Return the stamp of the first message of each group."""
    return stamps_ns if groups is None else np.asarray(stamps_ns[[group[0] for group in groups]])


def pick_frames(frames: Frames, mask: npt.NDArray[np.bool_]) -> Frames:
    """Return the frames of a mask, (N,)."""
    samples = {stream: indices[mask] for stream, indices in frames.samples.items()}
    label_indices, indices_2d = (
        tuple(group for group, is_kept in zip(groups, mask.tolist(), strict=False) if is_kept)
        for groups in (frames.label_indices, frames.indices_2d)
    )
    return replace(
        frames,
        stamps_ns=frames.stamps_ns[mask],
        samples=samples,
        label_indices=label_indices,
        indices_2d=indices_2d,
    )


def select_frames(frames: Frames, selection: SelectionOptions) -> Frames:
    """Return the frames between the start and the end of a selection.

    Raises:
        UsageError: It takes none.
    """
    if selection.is_whole:
        return frames
    mask = np.ones(len(frames), dtype=np.bool_)
    return pick_frames(frames, span_of(frames.stamps_ns, mask, selection))


def within_gaps(
    stamps_ns: Int64Array, missing: npt.NDArray[np.bool_], track: Track | None
) -> Int64Array:
    """Return the stamps without a pose between the first and the last pose of a track.

    Args:
        stamps_ns: (N,) nanoseconds.
        missing: (N,) which of them have no pose.
        track: The poses, None where frames need none.
    """
    if track is None or not len(track):
        return np.zeros(0, dtype=np.int64)
    first, last = int(track.stamps_ns[0]), int(track.stamps_ns[-1])
    inside: npt.NDArray[np.bool_] = missing & (stamps_ns > first) & (stamps_ns < last)
    return stamps_ns[inside]


def _where_unposed(stamps_ns: Int64Array, track: Track, gap: str) -> str:
    """Return where stamps without a pose are: before the first, after the last, or in a gap."""
    if not len(track):
        return ''
    first, last = int(track.stamps_ns[0]), int(track.stamps_ns[-1])
    early = int(np.count_nonzero(stamps_ns < first))
    late = int(np.count_nonzero(stamps_ns > last))
    between = len(stamps_ns) - early - late
    counts = (
        (early, f'{early} before the first, at {first}'),
        (late, f'{late} after the last, at {last}'),
        (between, f'{between} {gap}'),
    )
    counts_text = ', '.join(text for count, text in counts if count)
    return f' ({counts_text})' if counts_text else ''


def _reference(plan: Plan, stamps: Mapping[Stream, Int64Array], track: Track | None) -> Int64Array:
    if plan.reference == Stream.POSE.value and track is not None:
        return track.stamps_ns
    for stream, stamps_ns in stamps.items():
        if stream.value == plan.reference:
            return stamps_ns
    streams = [stream.value for stream in stamps] + ['pose'] * (track is not None)
    raise UsageError(
        f'the plan has reference {plan.reference}; it must be one of {", ".join(streams)}'
    )


def _matching(stream: Stream, topic: str, match: StreamMatch) -> str:
    return (
        f'{stream.value} ({topic}): {match.matched} of {len(match.indices)} frames,'
        f' off by {match.mean_error_ns / _MS:.1f} ms in the mean,'
        f' {match.max_error_ns / _MS:.1f} ms at most; {match.dropped} samples not used'
    )


def _without(missing: npt.NDArray[np.bool_], what: str, notes: list[str]) -> npt.NDArray[np.bool_]:
    """Return the frames where a sample is not missing; note the others."""
    count = int(np.count_nonzero(missing))
    if count:
        notes.append(f'dropped {count} of {len(missing)} frames: no {what}')
    return ~missing


# A few frames of a conversion: their choice, and the part of the bags that they are read from.

_MARGIN_NS = 100_000_000
"""Read before and after each sample: messages of one stamp are logged one after the other."""


class Excerpt:
    """The first and the last frame of a conversion, and those at even distances between them.

    Frames with a sample of every stream are preferred.

    Args:
        frame_count: Number of frames.

    Attributes:
        numbers: (K,) those that were chosen, by position in the conversion; K <= frame_count.
        stamps_ns: (K,) of these frames.
        total: Number of frames of the conversion.
    """

    def __init__(self, frame_count: int) -> None:
        self._most = frame_count
        self.numbers: Int64Array = np.zeros(0, np.int64)
        self.stamps_ns: Int64Array = np.zeros(0, np.int64)
        self.total = 0

    def of(self, frames: Frames) -> Frames:
        """Return the chosen frames of a conversion."""
        self.total = len(frames)
        present = np.zeros(len(frames), np.int64)
        for indices in frames.samples.values():
            present += indices != NONE
        self.numbers = spread(present, self._most)
        self.stamps_ns = frames.stamps_ns[self.numbers]
        return pick_frames(frames, np.isin(np.arange(self.total), self.numbers))

    def read(
        self,
        messages: BagMessages,
        survey: Survey,
        frames: Frames,
        topics: Mapping[Stream, str],
    ) -> Iterator[tuple[int, BagMessage]]:
        """Yield messages around the samples of frames, each with its index in its topic.

        Args:
            messages: The bags.
            survey: The log times of all their messages.
            frames: The chosen ones.
            topics: By stream of the frames its topic.
        """
        log_ns = {topic: survey.topics[topic].log_ns for topic, _ in messages.channels}
        samples_log_ns = [
            log_ns[topics[stream]][needed]
            for stream, indices in frames.samples.items()
            for index in indices.tolist()
            if index != NONE and topics[stream] in log_ns
            for needed in needed_for(survey.topics[topics[stream]], index)
        ]
        for start_ns, end_ns in _spans(sorted(samples_log_ns)):
            seen = {topic: bisect_left(stamps, start_ns) for topic, stamps in log_ns.items()}
            for message in messages.since(start_ns):
                if message.stamp_ns > end_ns:
                    break
                yield seen[message.topic], message
                seen[message.topic] += 1


def spread(present: Int64Array, frame_count: int) -> Int64Array:
    """Return the positions of the first and the last frame, and of those evenly between them.

    Args:
        present: (N,) number of streams that have a sample in each frame; only frames with the most
            are taken.
        frame_count: Number of frames.
    """
    best = np.flatnonzero(present == present.max())
    steps = np.linspace(0, len(best) - 1, min(frame_count, len(best)))
    return np.asarray(best[np.rint(steps).astype(np.int64)], np.int64)


def with_indices(messages: Iterable[BagMessage]) -> Iterator[tuple[int, BagMessage]]:
    """Yield all messages of bags, each with its index in its topic."""
    seen: Counter[str] = Counter()
    for message in messages:
        yield seen[message.topic], message
        seen[message.topic] += 1


def _spans(log_stamps_ns: Sequence[int]) -> list[tuple[int, int]]:
    """Return the parts of the time to read, from and to, ascending and apart."""
    spans: list[tuple[int, int]] = []
    for log_ns in log_stamps_ns:
        start_ns, end_ns = log_ns - _MARGIN_NS, log_ns + _MARGIN_NS
        if spans and start_ns <= spans[-1][1]:
            start_ns = spans.pop()[0]
        spans.append((start_ns, end_ns))
    return spans


# The results and losses of a conversion from a bag to KITTI.


@dataclass(frozen=True)
class ImportReport:
    """The result of a conversion.

    Attributes:
        layout: Which of the four.
        name: Drive, sequence or split.
        counts: Files, or lines of a common file, by stream.
        frames: Number of frames written.
        size_bytes: Size of all files with samples.
        losses: Skipped data.
        notes: Notes.
    """

    layout: Layout
    name: str
    counts: Mapping[str, int]
    frames: int
    size_bytes: int
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def undecoded_losses(survey: Survey, plan: Plan, named: Collection[str]) -> tuple[Loss, ...]:
    """Return the messages of a plan's topics that the first pass could not decode.

    Args:
        survey: The result of that pass.
        plan: Names the topics; those of transforms are always included.
        named: Topics whose messages are reported one by one already.
    """
    planned_topics = {use.topic for use in topic_uses(plan)}
    return tuple(
        topic.undecoded()
        for topic in survey.topics.values()
        if (topic.failures or topic.headless)
        and topic.name not in named
        and (topic.name in planned_topics or topic.msgtype in TF_TYPES)
    )
