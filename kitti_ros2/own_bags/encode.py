# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording's samples as serialised messages, for the converter to write or a node to publish."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np

from ..files.image_files import decode_image
from ..kitti import compact_scan
from ..messages.camera_info import with_nominal_mounts
from ..messages.cdr import Message
from ..messages.naming import (
    COMPACT,
    GREY,
    POINTS,
    REST,
    EncodeContext,
    has_no_gravity,
    make_rig,
    naming_of,
)
from ..messages.source_texts import promise
from ..messages.topics import (
    make_table,
    select_topics,
    unmatched,
    view_topics,
    without_latched_calibrations,
)
from ..model.bag_formats import FORMATS, IMAGE
from ..model.errors import (
    KittiRos2Error,
    Loss,
    RemoteError,
    UsageError,
    describe_error,
    format_numbers,
)
from ..model.samples import Calibration, Description, FrameLabels, Scan, has_complete_labels
from ..model.streams import IMAGE_STREAMS, NS_PER_S, Stream
from ..options.declare import options_of
from ..options.messages import Clouds, ColorEncoding, Fisheye, MarkerOptions
from ..options.stack_names import IMU, StackName

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from ..messages.topics import Topic
    from ..model.bag_formats import CloudFormat
    from ..model.recording import ReadableRecording
    from ..model.samples import Image, Sample, Turn
    from ..options.messages import MessageOptions
    from ..options.read import SelectionOptions
    from .schedule import Entry, Schedule


Given = TypeVar('Given')
Result = TypeVar('Result')


# The description of a recording in its bag: which of its files are in the messages.


def describe(
    recording: ReadableRecording,
    schedule: Schedule,
    table: Sequence[Topic],
    options: MessageOptions,
) -> Description:
    """Describe the recording, and which of its files are in the messages.

    Unreadable samples are included, since the description is sent first.

    Args:
        recording: The recording.
        schedule: The selected samples.
        table: The rows that have messages.
        options: Message options.
    """
    carried = {row.stream: schedule.numbers_of(row.stream) for row in table if row.restores}
    numbered = Stream.CALIBRATION in recording.streams
    calibrations: list[str] = []
    if Stream.CALIBRATION in carried and not numbered:
        calibrations = [file.name for file in recording.calibration(0).files]
    described = promise(recording.describe(), carried, calibrations)
    grey: list[str] = []
    if options.color_encoding is ColorEncoding.MONO8:
        raw = {row.stream for row in table if row.msgtype == IMAGE and row.restores}
        grey = sorted(stream.value for stream in raw if _is_colour(recording, schedule, stream))
    compact = options.clouds is Clouds.COMPACT and Stream.SCAN in carried
    more = {**({GREY: grey} if grey else {}), **({COMPACT: True} if compact else {})}
    return replace(described, values={**described.values, **more})


def _is_colour(recording: ReadableRecording, schedule: Schedule, stream: Stream) -> bool:
    """Return whether the first readable image of a stream has colours."""
    for number in schedule.numbers_of(stream):
        try:
            image = cast('Image', recording.read(stream, number))
        except RemoteError:
            raise
        except (KittiRos2Error, OSError):
            continue
        return image.channels > 1
    return False


_OF_BOXES = (Stream.LABELS, Stream.PREDICTIONS)
_STREAMS_OF = {
    **{opt.name: _OF_BOXES for opt in options_of(MarkerOptions)},
    **dict.fromkeys(('objects', 'autoware_labels', 'annotations'), _OF_BOXES),
    **dict.fromkeys(('map', 'tf', 'ground_truth_tree'), (Stream.POSE,)),
    'covariances': (Stream.OXTS, Stream.OXTS_EXTRACT),
    **dict.fromkeys(('clouds', 'points'), (Stream.SCAN,)),
    'images': IMAGE_STREAMS,
}
"""By option of messages: the streams, of which it needs one."""


# Notes on samples, collected while they are encoded.


@dataclass(frozen=True)
class SampleNotes:
    """Notes on the samples encoded so far.

    Attributes:
        nominal: Parts of the calibration for which a nominal value is used.
        calibration: Notes on calibration files.
        estimated: Scan numbers by the text of their note.
    """

    nominal: set[str] = field(default_factory=set)
    calibration: set[str] = field(default_factory=set)
    estimated: dict[str, set[int]] = field(default_factory=dict)

    def add_calibration(self, calibration: Calibration) -> None:
        """Add the notes on a calibration, and its parts for which a nominal value is used."""
        self.nominal.update(calibration.nominal)
        self.calibration.update(calibration.notes)

    def add_estimated(self, text: str, number: int) -> None:
        """Add a note on a scan."""
        self.estimated.setdefault(text, set()).add(number)

    def add(self, other: SampleNotes) -> None:
        """Add the notes on other samples."""
        self.nominal.update(other.nominal)
        self.calibration.update(other.calibration)
        for text, numbers in other.estimated.items():
            self.estimated.setdefault(text, set()).update(numbers)

    def on_calibration(self) -> list[str]:
        """Return the notes on calibration files and nominal values."""
        return sorted(self.calibration) + [
            f'{part}: not in the calibration, a nominal value is used'
            for part in sorted(self.nominal)
        ]

    def on_scans(self) -> list[str]:
        """Return the notes on scans."""
        return [
            f'{text}: scans {format_numbers(sorted(numbers))}'
            for text, numbers in sorted(self.estimated.items())
        ]


# Notes on scans whose turn of the scanner is nominal, or has no length.

_WITHOUT_TIME = 'points have ring but no time'


def turn_notes(
    scans: Mapping[int, int], turns: Mapping[int, Turn], cloud_format: CloudFormat
) -> list[str]:
    """Return notes on the scans whose points have no time, or a nominal time or stamp.

    Args:
        scans: Stamps of the scans to be encoded, nanoseconds, by file number.
        turns: The turn of each scan, by file number; none for scans compensated for motion.
        cloud_format: Format of the clouds.
    """
    notes = []
    timed = cloud_format.is_timed
    if timed and not scans.keys() <= turns.keys():
        points = 'points have the time 0' if cloud_format.is_unsigned else _WITHOUT_TIME
        notes.append(
            f'{points}: the scans are compensated for motion, so all points of a scan are of one'
            f' moment'
        )
    noted = {
        number: turns[number]
        for number, stamp_ns in scans.items()
        if number in turns and (timed or stamp_ns == turns[number].start_ns)
    }
    nominal = sorted(number for number, turn in noted.items() if turn.nominal)
    if nominal:
        notes.append(
            f'start and end of the turn are missing for scans {format_numbers(nominal)}: a nominal'
            f' turn of {noted[nominal[0]].length_ns / NS_PER_S:g} s is used, facing forward at its'
            f' middle'
        )
    return notes


# Notes on inputs of a stack of --for that a recording does not have.


def stack_notes(
    options: MessageOptions, table: Sequence[Topic], images: str, schedule: Schedule
) -> list[str]:
    """Return notes on inputs of the stack that will be missing.

    Args:
        options: Message options, with a stack.
        table: The rows that have messages.
        images: The last part of the names of image topics.
        schedule: The selected samples.
    """
    from ..options.stack_catalogue import STACKS  # noqa: PLC0415 - for --for only

    stack, names = STACKS[StackName(options.stack).value], naming_of(options)
    rows = {row.topic: row for row in table}
    read = {
        own: names.topic(own if own in names.topics else own.replace('/image_rect', f'/{images}'))
        for own in stack.inputs
    }
    notes = [f'{stack.name} reads {topic}: no messages' for topic in read.values()
             if topic not in rows]  # fmt: skip
    imu = rows.get(read.get(IMU, ''))
    if imu is not None and stack.imu_hz:
        stamps = [entry.stamp_ns for entry in schedule if entry.stream is imu.stream]
        rate = 1e9 / float(np.median(np.diff(stamps))) if len(set(stamps)) > 1 else np.inf
        notes += stack.imu_notes(imu.topic, rate)
    return notes


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
        sample_notes: Notes on the samples encoded so far.
    """

    def __init__(
        self,
        recording: ReadableRecording,
        schedule: Schedule,
        options: MessageOptions,
        selection: SelectionOptions,
    ) -> None:
        images = naming_of(options).image_topic(recording.layout, recording.image_topic)
        traits, packets = recording.layout.traits, _packets_of(recording)
        table = make_table(recording.cameras, images, options, packets, traits)
        if Stream.CALIBRATION in recording.streams:
            table = without_latched_calibrations(table)
        selected = select_topics(table, selection)
        possible = _possible_table(recording, options, images)
        self._unmatched = unmatched([row.topic for row in possible], selection)
        self._selected = set(Stream)
        if selection.topics or selection.exclude_topics:
            self._selected = {row.stream for row in select_topics(possible, selection)}
        self._schedule = schedule
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
        self.sample_notes = SampleNotes()

    def encode(
        self, entry: Entry, active: Collection[int] | None = None
    ) -> tuple[list[Message], list[Loss]]:
        """Encode the messages of one sample; also return the losses, one for each topic.

        Args:
            entry: The sample.
            active: Indices of the rows with a subscriber; other rows on demand are skipped. None:
                all.
        """
        rows = self._rows[entry.stream]
        if active is not None:
            rows = [(index, row) for index, row in rows if index in active or not row.on_demand]
        if not rows:
            return [], []
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
            self.sample_notes.add_calibration(mounted)
        if isinstance(sample, Scan) and sample.note:
            self.sample_notes.add_estimated(sample.note, entry.number)
        context = EncodeContext(
            self._rig,
            entry.stamp_ns,
            lambda: self._recording.path(entry.stream, entry.number),
            lambda: self._recording.calibration(entry.number),
            lambda: self._recording.trails(entry.number),
            entry.stream.viewer,
            _once(decode_image),
            lambda: self._labels_of(entry.number),
            lambda: self._predictions_of(entry.number),
            lambda text: self.sample_notes.add_estimated(text, entry.number),
            _once(compact_scan.compact),
        )
        messages, losses = self._serialize(rows, sample, context)
        return messages, losses + _missing_parts(sample, entry.stream)

    def left_out(self, stream: Stream, active: Collection[int]) -> list[int]:
        """Return the rows of a stream that encode skips: on demand, and not active."""
        return [index for index, row in self._rows[stream] if row.on_demand and index not in active]

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
        """Return the notes on the samples encoded so far."""
        notes = self.sample_notes.on_calibration()
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
        notes += self.sample_notes.on_scans()
        notes += self._idle_options() if options.stack is None else []
        if options.stack is not None:
            notes += stack_notes(options, self.table, self._images, self._schedule) + self._unmade
        return (*notes, *self._unmatched)

    def _idle_options(self) -> list[str]:
        """Return notes on options of messages that the recording, or the selection, has none of."""
        options = self._rig.options
        lacking: dict[str, list[str]] = {}
        for holder in (options, options.markers, options.ground_truth):
            for opt in options_of(type(holder)):
                streams = _STREAMS_OF.get(opt.name, ())
                if getattr(holder, opt.field) == opt.default or not streams:
                    continue
                if not any(self._rows[stream] for stream in streams):
                    images = streams == IMAGE_STREAMS
                    what = 'image' if images else ' or '.join(stream.value for stream in streams)
                    lacking.setdefault(f'no {what} is written', []).append(opt.name)
        if options.fisheye is Fisheye.PINHOLE and not any(
            row.topic in view_topics() for row in self.table
        ):
            lacking['no fisheye is written'] = ['fisheye']
        if options.markers.trails and not self._rig.tracked and self._rows[Stream.LABELS]:
            lacking['its labels have no tracks'] = ['trails']
        return [
            f'{self._recording.name}: {reason}; without effect: {", ".join(names)}'
            for reason, names in lacking.items()
        ]

    def _missing_source(self) -> list[str]:
        """Return a note if clouds have a loss and what restores the files is not selected."""
        topics = {row.topic for row in self.table if row.stream is Stream.SCAN and row.restores}
        if self._rig.options.clouds is Clouds.COMPACT and topics:
            left_out = all(row.topic != REST for row in self.table)
            text = f'{REST} is left out, so the scans that to-kitti restores are rounded'
            return [f'{text} to 1 mm and 0.01'] if left_out else []
        loss = FORMATS[self._rig.options.cloud].loss
        if not loss or not topics or POINTS in topics:
            return []
        return [f'{POINTS} is left out, so in the scans that to-kitti restores, {loss}']

    def _labels_of(self, number: int) -> FrameLabels | None:
        """Read the labels of a frame; None if it is not labelled."""
        if number not in self._labelled:
            recording = self._recording
            complete = has_complete_labels(recording.layout, recording.losses)
            return FrameLabels() if self._labelled and complete else None
        labels = self._recording.read(Stream.LABELS, number)
        return labels if isinstance(labels, FrameLabels) else FrameLabels()

    def _predictions_of(self, number: int) -> FrameLabels | None:
        """Read the predictions of a frame; None without any."""
        if number not in self._predicted:
            return None
        predictions = self._recording.read(Stream.PREDICTIONS, number)
        return predictions if isinstance(predictions, FrameLabels) else FrameLabels()

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
        return not row.needs or any(map(self._numbers_with, row.needs))

    @staticmethod
    def _serialize(
        rows: Sequence[tuple[int, Topic]], sample: Sample, context: EncodeContext
    ) -> tuple[list[Message], list[Loss]]:
        messages: list[Message] = []
        losses: list[Loss] = []
        for index, row in rows:
            try:
                parts = row.serialize(sample, context)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:  # of the sample, or of the calibration
                losses.append(Loss(row.topic, 1, describe_error(error)))
                continue
            key = row.change_key(sample) if row.change_key else None
            if parts is not None:
                messages.append(Message(index, context.stamp_ns, parts, key))
        return messages, losses

    def _read(self, entry: Entry) -> Sample:
        if entry.stream is Stream.RECORDING:
            return describe(self._recording, self._schedule, self.table, self._rig.options)
        if entry.stream is Stream.PATH:
            return self._recording.trajectory(self._pose_numbers)
        return self._recording.read(entry.stream, entry.number)


def _possible_table(
    recording: ReadableRecording, options: MessageOptions, images: str
) -> list[Topic]:
    """Return the rows of a recording with those of cameras that are lost completely."""
    lost = {Stream(loss.stream).camera for loss in recording.losses}
    traits = recording.layout.traits
    names = {i: traits.camera_names.get(i, str(i)) for i in lost if i is not None}
    cameras, packets = {**names, **recording.cameras}, _packets_of(recording)
    return make_table(cameras, images, options, packets, traits)


def _packets_of(recording: ReadableRecording) -> Stream:
    """Return the stream whose packets become Imu, fix and velocity: the faster one."""
    fast = Stream.OXTS_EXTRACT
    return fast if fast in recording.streams else Stream.OXTS


def _once(compute: Callable[[Given], Result]) -> Callable[[Given], Result]:
    """Wrap a function to compute the result for a sample once for several messages."""
    results: list[Result] = []

    def computed(given: Given) -> Result:
        if not results:
            results.append(compute(given))
        return results[0]

    return computed


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
