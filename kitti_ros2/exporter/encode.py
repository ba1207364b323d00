# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording's samples as serialised messages, for the converter to write or a node to publish."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from ..files.image_files import decode_image
from ..messages.cdr import Message
from ..messages.map_frame import has_no_gravity
from ..messages.moment import Moment, make_rig
from ..messages.mounts import with_nominal_mounts
from ..messages.naming import naming_of
from ..messages.selected_topics import select_topics, unmatched
from ..messages.source import POINTS
from ..messages.topics import make_table
from ..model.cloud_formats import FORMATS
from ..model.errors import KittiRos2Error, RemoteError, UsageError, describe_error
from ..model.labels import has_complete_labels
from ..model.losses import Loss
from ..model.msgtypes import IMAGE
from ..model.samples import Calibration, Description, FrameLabels, Scan
from ..model.streams import CAMERA_NAMES, Stream
from ..options.messages import ColorEncoding
from .description import describe
from .remarks import Remarks
from .turn_notes import turn_notes

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    from ..messages.pixels import Pixels
    from ..messages.topics import Topic
    from ..model.recording import ReadableRecording
    from ..model.samples import Image, Sample
    from ..options.messages import MessageOptions
    from ..options.selection import SelectionOptions
    from .schedule import Entry, Schedule

_IN_MAP = (Stream.POSE, Stream.PATH)
_AFFECTED = {
    Stream.OXTS: (Stream.OXTS, Stream.POSE, Stream.PATH),
    Stream.POSE: (Stream.POSE, Stream.PATH),
}
"""The streams affected by a loss, if not only its own; trails need poses too."""

_CAMERA_PART = re.compile(r'P\d')

_NO_ANNOTATIONS = (
    'no annotations can be made: the recording has neither labels nor predictions of its frames'
)


class Encoder:
    """Encodes schedule entries as messages; thread-safe.

    Attributes:
        table: The rows with messages, in the order of Message.topic.
        remarks: On the samples encoded so far.
    """

    def __init__(
        self,
        recording: ReadableRecording,
        schedule: Schedule,
        options: MessageOptions,
        selection: SelectionOptions,
    ) -> None:
        images = naming_of(options).image_topic(recording.layout, recording.image_topic)
        table = make_table(recording.cameras, images, options, _packets_of(recording))
        selected = select_topics(table, selection)
        self._selected = _selected_streams(recording, options, selection)
        self._schedule = schedule
        self._unmatched = unmatched([row.topic for row in table], selection)
        due = {stream for stream in Stream if schedule.count(stream)}
        self._recording = recording
        boxed = bool(self._labelled or self._predicted)
        self._unmade = [] if boxed or not options.annotations else [_NO_ANNOTATIONS]
        if self._unmade and options.stack is None:
            raise UsageError(f'{recording.name}: {_NO_ANNOTATIONS}')
        self.table: list[Topic] = [
            row for row in selected if row.stream in due and self._has_needs(row)
        ]
        self._images = images
        self._rows: dict[Stream, list[tuple[int, Topic]]] = {stream: [] for stream in Stream}
        for index, row in enumerate(self.table):
            self._rows[row.stream].append((index, row))
        self._rig = make_rig(recording, options)
        self._pose_numbers = schedule.numbers_of(Stream.POSE)
        self.remarks = Remarks()

    def encode(
        self, entry: Entry, wanted: Collection[int] | None = None
    ) -> tuple[list[Message], list[Loss]]:
        """Encode the messages of one sample; also return the losses, one for each topic.

        Args:
            entry: The sample.
            wanted: Indices of the rows with a subscriber; other rows on demand are skipped. None:
                all.
        """
        rows = self._rows[entry.stream]
        if wanted is not None:
            rows = [(index, row) for index, row in rows if index in wanted or not row.on_demand]
        if not rows:
            return [], []
        path = self._recording.path(entry.stream, entry.number)
        try:
            sample = self._read(entry)
        except RemoteError:
            raise
        except (KittiRos2Error, OSError) as error:
            return [], [Loss(row.topic, 1, describe_error(error)) for _, row in rows]
        if isinstance(sample, Calibration):
            mounted = with_nominal_mounts(
                sample, self._rig.cameras, own=self._rig.options.own_frames
            )
            self.remarks.add_calibration(mounted)
        moment = Moment(
            self._rig,
            entry.stamp_ns,
            path,
            lambda: self._recording.calibration(entry.number),
            lambda: self._recording.trails(entry.number),
            entry.stream.camera or 0,
            _once(decode_image),
            lambda: self._labels_of(entry.number),
            lambda: self._predictions_of(entry.number),
            lambda text: self.remarks.add_estimated(text, entry.number),
        )
        messages, losses = self._serialize(rows, sample, moment)
        return messages, losses + _missing_parts(sample, entry.stream)

    def left_out(self, stream: Stream, wanted: Collection[int]) -> list[int]:
        """Return the rows of a stream that encode skips: on demand, and not wanted."""
        return [index for index, row in self._rows[stream] if row.on_demand and index not in wanted]

    def concerned(self, losses: Iterable[Loss]) -> list[Loss]:
        """Return the losses of a recording that are within the selection."""
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
        """Return non-fatal remarks on the samples encoded so far."""
        notes = self.remarks.on_calibration()
        options, in_map = self._rig.options, any(self._rows[stream] for stream in _IN_MAP)
        if in_map and has_no_gravity(self._recording.start, options.map):
            notes.append(
                f'{self._rig.frames.map} is base_link at the first pose, not east-north-up: the'
                f' layout has no gravity'
            )
        raw = [row for row in self.table if row.msgtype == IMAGE]
        if options.color_encoding is not ColorEncoding.BGR8 and not raw:
            notes.append(
                f'color_encoding {options.color_encoding.value} changes nothing: images are'
                f" compressed, the files' own bytes; --images raw or both has pixels"
            )
        if self._rows[Stream.SCAN]:
            scans = {e.number: e.stamp_ns for e in self._schedule if e.stream is Stream.SCAN}
            notes += turn_notes(scans, self._recording.turns, FORMATS[options.cloud])
            notes += self._missing_source()
        notes += self.remarks.on_scans()
        if options.stack is not None:
            from .stack_notes import stack_notes  # noqa: PLC0415 - for --for only

            notes += stack_notes(options, self.table, self._images, self._schedule) + self._unmade
        return (*notes, *self._unmatched)

    def _missing_source(self) -> list[str]:
        """Return a note if clouds have a loss and the points of the files are not selected."""
        topics = {row.topic for row in self.table if row.stream is Stream.SCAN and row.restores}
        loss = FORMATS[self._rig.options.cloud].loss
        if not loss or not topics or POINTS in topics:
            return []
        return [f'{POINTS} is left out, so in the scans that to-kitti restores, {loss}']

    def _labels_of(self, number: int) -> FrameLabels | None:
        """Read the labels of a frame; None if it is not labelled."""
        if number not in self._labelled:
            recording = self._recording
            known = has_complete_labels(recording.layout, recording.losses)
            return FrameLabels() if self._labelled and known else None
        labels = self._recording.read(Stream.LABELS, number)
        return labels if isinstance(labels, FrameLabels) else FrameLabels()

    def _predictions_of(self, number: int) -> FrameLabels | None:
        """Read the predictions of a frame; None without any."""
        if number not in self._predicted:
            return None
        found = self._recording.read(Stream.PREDICTIONS, number)
        return found if isinstance(found, FrameLabels) else FrameLabels()

    @cached_property
    def _labelled(self) -> frozenset[int]:
        """The numbers of the frames with labels."""
        return self._numbers_with(Stream.LABELS)

    @cached_property
    def _predicted(self) -> frozenset[int]:
        """The numbers of the frames with predictions."""
        return self._numbers_with(Stream.PREDICTIONS)

    def _numbers_with(self, stream: Stream) -> frozenset[int]:
        """Return the file numbers of a stream; empty without common numbers."""
        index = self._recording.streams.get(stream)
        if index is None or not self._recording.common_numbers:
            return frozenset()
        return frozenset(index.numbers.tolist())

    def _has_needs(self, row: Topic) -> bool:
        return row.needs is None or bool(self._numbers_with(row.needs))

    @staticmethod
    def _serialize(
        rows: Sequence[tuple[int, Topic]], sample: Sample, moment: Moment
    ) -> tuple[list[Message], list[Loss]]:
        messages: list[Message] = []
        losses: list[Loss] = []
        for index, row in rows:
            try:
                serialized = row.serialize(sample, moment)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:  # of the sample, or of the calibration
                losses.append(Loss(row.topic, 1, describe_error(error)))
                continue
            key = row.change_key(sample) if row.change_key else None
            messages += [Message(index, moment.stamp_ns, parts, key) for parts in serialized]
        return messages, losses

    def _read(self, entry: Entry) -> Sample:
        if entry.stream is Stream.RECORDING:
            return describe(self._recording, self._schedule, self.table, self._rig.options)
        if entry.stream is Stream.PATH:
            return self._recording.trajectory(self._pose_numbers)
        return self._recording.read(entry.stream, entry.number)


def _selected_streams(
    recording: ReadableRecording, options: MessageOptions, selection: SelectionOptions
) -> set[Stream]:
    """Return the streams selected by topics, including cameras that are lost completely."""
    if not selection.topics and not selection.exclude_topics:
        return set(Stream)
    lost = {Stream(loss.stream).camera for loss in recording.losses}
    cameras = {index: CAMERA_NAMES.get(index, str(index)) for index in lost if index is not None}
    images = naming_of(options).image_topic(recording.layout, recording.image_topic)
    table = make_table({**cameras, **recording.cameras}, images, options, _packets_of(recording))
    return {row.stream for row in select_topics(table, selection)}


def _packets_of(recording: ReadableRecording) -> Stream:
    """Return the stream whose packets become Imu, fix and velocity: the faster one."""
    fast = Stream.OXTS_EXTRACT
    return fast if fast in recording.streams else Stream.OXTS


def _once(decode: Callable[[Image], Pixels]) -> Callable[[Image], Pixels]:
    """Wrap a decoder to decode an image once for several messages."""
    made: list[Pixels] = []

    def decoded(image: Image) -> Pixels:
        if not made:
            made.append(decode(image))
        return made[0]

    return decoded


def _missing_parts(sample: Sample, stream: Stream) -> list[Loss]:
    """Return the missing parts of a sample of a stream as losses.

    A camera's own part is counted with its camera_info.
    """
    if not isinstance(sample, (Calibration, Description, FrameLabels, Scan)):
        return []
    return [
        Loss(stream.value, 1, reason)
        for part, reason in sample.missing.items()
        if not _CAMERA_PART.fullmatch(part)
    ]
