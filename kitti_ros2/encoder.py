# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording's samples as serialised messages, for the converter to write or a node to publish."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from .errors import KittiRos2Error, LackingError
from .messages.png import decode_png
from .messages.topics import Moment, make_rig, make_table, select_topics, unmatched
from .samples import CAMERA_NAMES, Calibration, Description, FrameLabels, Scan, Stream

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Iterable, Sequence

    from .messages.cdr import Parts
    from .messages.pixels import Pixels
    from .messages.topics import Topic
    from .options import MessageOptions, SelectionOptions
    from .samples import Image, Loss, Recording, Sample
    from .schedule import Entry, Schedule

_KINDS = {
    Calibration: Stream.CALIBRATION,
    Description: Stream.RECORDING,
    FrameLabels: Stream.LABELS,
    Scan: Stream.SCAN,
}
_AFFECTED = {
    Stream.OXTS: (Stream.OXTS, Stream.POSE, Stream.PATH),
    Stream.POSE: (Stream.POSE, Stream.PATH),
}
"""The streams that a loss concerns, where these are more than its own; and trails are of poses."""

_CAMERA_PART = re.compile(r'P\d')


@dataclass(frozen=True)
class Message:
    """One serialised message.

    Attributes:
        topic: Index of its row in Encoder.table.
        stamp_ns: Header stamp and log time.
        parts: CDR, in buffers that follow one another.
        key: What it depends on, where one equal to the topic's last need not be sent again.
    """

    topic: int
    stamp_ns: int
    parts: Parts
    key: Hashable = None


@dataclass(frozen=True)
class Failure:
    """One message that cannot be had, and why: topics is what it costs."""

    topics: tuple[str, ...]
    error: KittiRos2Error | OSError


class Encoder:
    """Turns schedule entries into messages; safe to call from several threads at once.

    Attributes:
        table: The rows that are made, in the order of Message.topic.
    """

    def __init__(
        self,
        recording: Recording,
        schedule: Schedule,
        options: MessageOptions,
        selection: SelectionOptions,
    ) -> None:
        table = make_table(recording.cameras, recording.image_topic, options)
        selected = select_topics(table, selection.topics)
        self._selected = _selected_streams(recording, options, selection)
        self._schedule = schedule
        self._unmatched = unmatched(table, selection.topics)
        due = {stream for stream in Stream if schedule.count(stream)}
        self.table: list[Topic] = [row for row in selected if row.stream in due]
        self._rows: dict[Stream, list[tuple[int, Topic]]] = {stream: [] for stream in Stream}
        for index, row in enumerate(self.table):
            self._rows[row.stream].append((index, row))
        self._recording = recording
        self._rig = make_rig(recording.cameras, options)
        self._pose_numbers = schedule.numbers_of(Stream.POSE)
        self._nominal: set[str] = set()
        self._timeless = False

    def encode(
        self, entry: Entry, wanted: Collection[int] | None = None
    ) -> tuple[list[Message], list[Failure]]:
        """The messages of one sample, and what could not be made of it.

        Args:
            entry: Which sample.
            wanted: Indices of the rows with a subscriber; rows on demand are left out where they
                are not among them. None makes all.
        """
        rows = self._rows[entry.stream]
        if wanted is not None:
            rows = [(index, row) for index, row in rows if index in wanted or not row.on_demand]
        if not rows:
            return [], []
        path = self._recording.path(entry.stream, entry.number)
        try:
            sample = self._read(entry)
        except (KittiRos2Error, OSError) as error:
            return [], [Failure(tuple(row.name for _, row in rows), error)]
        if isinstance(sample, Calibration):
            self._nominal.update(sample.nominal)
        if isinstance(sample, Scan) and sample.start_ns is None:
            self._timeless = True
        moment = Moment(
            self._rig,
            entry.stamp_ns,
            path,
            lambda: self._recording.calibration(entry.number),
            lambda: self._recording.trails(entry.number),
            entry.stream.camera or 0,
            _once(decode_png),
            lambda: self._labels_of(entry.number),
        )
        return self._serialize(rows, sample, moment)

    def concerned(self, losses: Iterable[Loss]) -> list[Loss]:
        """The losses among a recording's that a selection would have wanted."""
        parts = map(self._concerned, losses)
        return [part for part in parts if part is not None]

    def _concerned(self, loss: Loss) -> Loss | None:
        own = Stream(loss.stream)
        trails = (Stream.LABELS,) if self._rig.options.markers.trails else ()
        for stream in (*_AFFECTED[own], *trails) if own in _AFFECTED else (own,):
            part = self._schedule.concerned(replace(loss, stream=stream.value))
            if stream in self._selected and part is not None:
                return part
        return None

    def notes(self) -> tuple[str, ...]:
        """What is worth a word of the samples encoded so far."""
        nominal = [
            f'{part}: not in the calibration, a nominal value is used'
            for part in sorted(self._nominal)
        ]
        if self._timeless and self._rig.options.ring_and_time:
            nominal.append('points have time 0: their sweeps have no start and end')
        return (*nominal, *(f'no topic is called {pattern}' for pattern in self._unmatched))

    def _labels_of(self, number: int) -> FrameLabels:
        """The labels of an image's frame; none where the frame has none."""
        if number not in self._labelled:
            return FrameLabels()
        labels = self._recording.read(Stream.LABELS, number)
        return labels if isinstance(labels, FrameLabels) else FrameLabels()

    @cached_property
    def _labelled(self) -> frozenset[int]:
        """The numbers of the frames with labels; without common numbers none is an image's."""
        index = self._recording.streams.get(Stream.LABELS)
        if index is None or not self._recording.common_numbers:
            return frozenset()
        return frozenset(index.numbers.tolist())

    @staticmethod
    def _serialize(
        rows: Sequence[tuple[int, Topic]], sample: Sample, moment: Moment
    ) -> tuple[list[Message], list[Failure]]:
        messages: list[Message] = []
        failures: list[Failure] = []
        for index, row in rows:
            try:
                serialized = row.serialize(sample, moment)
            except (KittiRos2Error, OSError) as error:  # of its own, or of what it also reads
                failures.append(Failure((row.name,), error))
                continue
            key = row.change_key(sample) if row.change_key else None
            messages += [Message(index, moment.stamp_ns, parts, key) for parts in serialized]
        return messages, failures + _lacking(sample)

    def _read(self, entry: Entry) -> Sample:
        if entry.stream is Stream.RECORDING:
            return self._recording.describe()
        if entry.stream is Stream.PATH:
            return self._recording.trajectory(self._pose_numbers)
        return self._recording.read(entry.stream, entry.number)


def _selected_streams(
    recording: Recording, options: MessageOptions, selection: SelectionOptions
) -> set[Stream]:
    """The streams that a selection by topics takes; a camera that is lost as a whole is one."""
    if not selection.topics:
        return set(Stream)
    lost = {Stream(loss.stream).camera for loss in recording.losses}
    cameras = {index: CAMERA_NAMES.get(index, str(index)) for index in lost if index is not None}
    table = make_table({**cameras, **recording.cameras}, recording.image_topic, options)
    return {row.stream for row in select_topics(table, selection.topics)}


def _once(decode: Callable[[Image], Pixels]) -> Callable[[Image], Pixels]:
    """A decoder for one image, which several messages are made of."""
    made: list[Pixels] = []

    def decoded(image: Image) -> Pixels:
        if not made:
            made.append(decode(image))
        return made[0]

    return decoded


def _lacking(sample: Sample) -> list[Failure]:
    """What a calibration or description should hold and does not.

    A camera's own part is counted with its camera_info.
    """
    if not isinstance(sample, (Calibration, Description, FrameLabels, Scan)):
        return []
    return [
        Failure((_KINDS[type(sample)].value,), LackingError(reason))
        for part, reason in sample.lacks.items()
        if not _CAMERA_PART.fullmatch(part)
    ]
