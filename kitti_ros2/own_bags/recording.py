# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag written by to-bag, read sample by sample by KITTI's file numbers, as its folder was.

Text files of the folder are read from the texts in the bag, so they are identical to the last
digit. Poses are those of imu_link, as everywhere in the package, from the odometry topic.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from ..bags.bag_files import path_of
from ..bags.reader import Decoder, open_messages
from ..bags.single_messages import MessagePosition, MessagesByPosition, positions_of
from ..importer.bag_videos import open_video
from ..kitti import names
from ..kitti.calib_file import parse_calibration
from ..kitti.find import LAYOUTS
from ..kitti.label_file import labels_of_text
from ..kitti.text_file import parse_packet
from ..kitti.tracklet_file import labels_of_tracklets
from ..messages.cdr import stamp_ns_of
from ..messages.detections import boxes_in
from ..messages.naming import REST, BagContext, base_t_imu, every_naming
from ..messages.topics import decoders, own_topics
from ..model.bag_formats import DETECTIONS_3D
from ..model.errors import BadFileError, KittiRos2Error, damage, describe_error
from ..model.geometry import NOMINAL_VELO_T_IMU
from ..model.recording import StreamIndex
from ..model.samples import Calibration, FrameLabels, Scan
from ..model.streams import CAMERA_NAMES, Stream
from ..options.messages import MessageOptions
from ..options.read import ScanStamp
from .compact_scans import as_in_file, read_rests
from .numbering import absent_frames, number_bag, tracklets_of
from .schedule import UNKNOWN

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import PurePosixPath

    from ..bags.bag_files import BagSource, OpenBag
    from ..bags.reader import BagMessage
    from ..importer.survey import Survey
    from ..kitti.kitti_recording import KittiRecording
    from ..model.boxes import Cuboid
    from ..model.errors import Loss
    from ..model.geometry import Transform
    from ..model.recording import FrameOrigin, Start
    from ..model.samples import Image, Pose, Sample, ScanRest, Turn
    from ..model.streams import Clock
    from .numbering import NumberedBag, NumberedTopic
    from .source_files import SourceFiles


class BagRecording:
    """The recording in a bag: the part of model.recording.ReadableRecording that frames need.

    Args:
        source: The bag.
        bag: Its messages with KITTI's numbers.
        survey: Its survey.

    Raises:
        BadBagError: The bag cannot be read.
    """

    def __init__(self, source: BagSource, bag: NumberedBag, survey: Survey) -> None:
        from .reencoded_images import ReencodedImages  # noqa: PLC0415 - folders do without

        self._source = source
        self._bag = bag
        self._source_files = bag.source_files
        self.root = path_of(source)
        self.layout = bag.source_files.layout
        self.name = bag.source_files.name
        self.common_numbers = bag.common
        self.clock: Clock = bag.clock
        times = bag.source_files.times
        self.origins: Mapping[int, FrameOrigin] = {} if times is None else times.origins
        self.deskew = bag.source_files.deskew
        self.period_ns = bag.source_files.period_ns
        self.start: Start | None = None  # poses are in the bag's map as they are
        damaged = damage(survey.losses, self.root.name)
        self.losses: tuple[Loss, ...] = (*damaged, *absent_frames(bag.source_files))
        self.notes: tuple[str, ...] = tuple(survey.notes)
        self._survey = survey
        folders = [*self._source_files.folders.values()]
        self.file_names = folders[0].names if folders else names.SIX_DIGITS
        self._reencoded = ReencodedImages(survey)
        self._topics = self._choose()
        self.streams = {stream: _index(bag.topics[name]) for stream, name in self._topics.items()}
        of_boxes = {name for name in bag.topics if own_topics()[name].stream is Stream.LABELS}
        if self.layout.traits.world_boxes and of_boxes and Stream.LABELS not in self.streams:
            text = f'{self.root.name}: the labels in {", ".join(sorted(of_boxes))} are not read'
            self.notes += (f'{text}; those of {DETECTIONS_3D} are, of --objects vision or both',)
        self._face_forward()
        self._unpair()
        large = {
            stream: name for stream, name in self._topics.items() if own_topics()[name].on_demand
        }
        self.cameras = {
            stream.camera: _camera_name(name, stream.camera)
            for stream, name in large.items()
            if stream.camera is not None
        }
        self._positions = {
            stream: _positions(name, bag.topics[name]) for stream, name in large.items()
        }
        self._messages = MessagesByPosition(source, set(large.values()))
        self._videos = {
            stream: open_video(survey.topics[name], self._messages)
            for stream, name in large.items()
            if name in self._reencoded.videos
        }
        self._calibration_cached = lru_cache(maxsize=32)(self._calibration)

    def _face_forward(self) -> None:
        """Give scans that are stamped at the start of their turn the stamps of their files."""
        scans = self.streams.get(Stream.SCAN)
        if scans is None or self._source_files.scan_stamp is ScanStamp.FORWARD:
            return
        stamps = self._source_files.file_stamps(Stream.SCAN) or {}
        forward = [stamps[number] for number in scans.numbers.tolist()]
        self.streams[Stream.SCAN] = StreamIndex(scans.numbers, np.array(forward, dtype=np.int64))

    def _unpair(self) -> None:
        """Give right images that are stamped as their left ones the stamps of their files."""
        for stream, index in self.streams.items():
            if self._source_files.stamped_as(stream) is not stream:
                own = self._source_files.file_stamps(stream) or {}
                stamps = [own[number] for number in index.numbers.tolist()]
                self.streams[stream] = StreamIndex(index.numbers, np.array(stamps, dtype=np.int64))

    def close(self) -> None:
        """Close the files."""
        self._messages.close()

    def path(self, stream: Stream, number: int) -> Path:  # noqa: ARG002 - all is in one bag
        """Return the path of the bag."""
        return self.root

    def read(self, stream: Stream, number: int) -> Sample:
        """Read the sample of a stream with a file number.

        Raises:
            KittiRos2Error: Its message is missing or cannot be decoded.
        """
        try:
            if stream is Stream.LABELS and self._tracklets:
                return labels_of_tracklets(self._tracklets.get(number, []), names.RAW_TRACKLETS)
            return self._sample(stream, number)
        except BadFileError:
            raise
        except Exception as error:
            what = f'the message of frame {number}: {describe_error(error)}'
            raise KittiRos2Error(f'{self._topics[stream]}: {what}') from error

    def _sample(self, stream: Stream, number: int) -> Sample:
        if stream in self._videos:
            return self._video_image(stream, number)
        name, message = self._topics[stream], self._message(stream, number)
        if name in self._reencoded:
            return self._reencoded.file(name, stamp_ns_of(message.header), message)
        if stream is Stream.LABELS and self.layout.traits.world_boxes:
            boxes = boxes_in(message)
            return FrameLabels(cuboids=[replace(b, track_id=int(b.identity)) for b in boxes])
        decoded: Any = decoders()[name](message, BagContext(self.root, self.base_t_imu))
        if stream is Stream.OXTS:
            return parse_packet(decoded.text, decoded.name, number + 1, decoded)
        sample: Sample = labels_of_text(decoded) if stream is Stream.LABELS else decoded
        if isinstance(sample, Scan):
            name = self._source_files.folders[Stream.SCAN].file(number).name
            sample = as_in_file(sample, self._rests.get(name))
            return replace(sample, turn=self.turns.get(number))
        return sample

    @cached_property
    def _rests(self) -> Mapping[str, ScanRest]:
        return read_rests(self._source) if REST in self._survey.topics else {}

    def _video_image(self, stream: Stream, number: int) -> Image:
        name = self._topics[stream]
        image = self._videos[stream].image(_first_of(self._bag.topics[name])[number])
        return self._reencoded.file(name, stamp_ns_of(image.header), image)

    @cached_property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan, by file number; empty if its stamps are missing."""
        return self._source_files.turns() or {}

    def readable_poses(
        self,
        numbers: Iterable[int],
        needed_for: Stream,  # noqa: ARG002 - see kitti.kitti_recording
    ) -> Iterator[tuple[int, Pose]]:
        """Yield the poses of these numbers; damaged messages are left out."""
        for number in numbers:
            try:
                yield number, cast('Pose', self.read(Stream.POSE, number))
            except KittiRos2Error:
                continue

    def calibration(self, number: int) -> Calibration:
        """Return the calibration valid for a frame; missing lists its missing parts."""
        return self._calibration_cached(number if self.layout.traits.calibration_per_frame else 0)

    def _choose(self) -> dict[Stream, str]:
        """Choose the topic to read each stream from, among those with known numbers.

        The first in the table's order. Tracklets are read from their file; any topic made of them
        has their numbers. Boxes in the world are read as those of a frame.
        """
        world_boxes = self.layout.traits.world_boxes
        topics: dict[Stream, str] = {}
        for name, row in own_topics().items():
            topic = self._bag.topics.get(name)
            if topic is None or row.latched or not topic.is_numbered:
                continue
            boxed = self._tracklets or (world_boxes and row.msgtype == DETECTIONS_3D)
            is_read = row.decode is not None or (row.stream is Stream.LABELS and boxed)
            surveyed = self._survey.topics.get(name)  # None: the bag does not define its type
            if (
                is_read
                and surveyed is not None
                and (surveyed.msgtype == row.msgtype or name in self._reencoded)
            ):
                topics.setdefault(row.stream, name)
        return topics

    @cached_property
    def _tracklets(self) -> Mapping[int, list[Cuboid]]:
        return tracklets_of(self._source_files)

    @cached_property
    def _small(self) -> dict[Stream, dict[int, Any]]:
        """By stream and number the decoded small messages, or their errors."""
        topics = {
            name: stream for stream, name in self._topics.items() if stream not in self._positions
        }
        samples: dict[Stream, dict[int, Any]] = {stream: {} for stream in topics.values()}
        turns: Counter[tuple[str, int]] = Counter()
        with open_messages(self._source, set(topics)) as messages:
            decode = Decoder(messages.typestore)
            for message in messages:
                numbered = self._bag.topics[message.topic]
                index = int(np.searchsorted(numbered.log_ns, message.stamp_ns))
                index += turns[message.topic, message.stamp_ns]
                turns[message.topic, message.stamp_ns] += 1
                if index < len(numbered.numbers):
                    number = int(numbered.numbers[index])
                    samples[topics[message.topic]].setdefault(number, _decoded(decode, message))
        return samples

    def _message(self, stream: Stream, number: int) -> Any:  # noqa: ANN401 - of the bag's types
        if stream in self._positions:
            return self._messages.read(self._positions[stream][number])
        message = self._small[stream][number]
        if isinstance(message, Exception):
            raise message
        return message

    @cached_property
    def base_t_imu(self) -> Transform:
        """imu_link in base_link, as in the static transforms of the bag."""
        links = {(naming.frames.base, naming.frames.imu) for naming in every_naming()}
        for parent, child, transform in self._survey.static:
            if (parent, child) in links:
                return transform
        return base_t_imu(MessageOptions())

    def _calibration(self, number: int) -> Calibration:
        files = self._source_files.calibrations
        parse = LAYOUTS[self.layout].parse_calibration
        if parse is not None:
            texts = {path.name: text for path, text in files.items()}
            return parse(texts, self.root, self.common_numbers)
        pairs = [*files.items()]
        if self.layout.traits.calibration_per_frame:
            folder = self._source_files.folders.get(Stream.CALIBRATION)
            # A file equal to the one before it is not repeated in the bag.
            listed = folder is not None and number in folder.numbers
            pairs = [pair for pair in pairs if listed and self._number(pair[0]) <= number]
        if not pairs:
            return _no_calibration(f'{self.root}: no calibration of frame {number}')
        path, text = max(pairs, key=lambda pair: self._number(pair[0]))
        try:
            return parse_calibration(text, Path(path), str(path))
        except BadFileError as error:
            return _no_calibration(str(error))

    def _number(self, path: PurePosixPath) -> int:
        """Return the frame of a calibration file, if frames have their own."""
        folder = self._source_files.folders.get(Stream.CALIBRATION)
        number = None if folder is None else folder.names.number(names.split_name(path.name)[0])
        return UNKNOWN if number is None else number


if TYPE_CHECKING:
    NumberedRecording: TypeAlias = KittiRecording | BagRecording
    """Recordings whose frames have KITTI's numbers."""


def _no_calibration(reason: str) -> Calibration:
    return Calibration({}, None, None, NOMINAL_VELO_T_IMU, missing={'file': reason})


def _decoded(decode: Decoder, message: BagMessage) -> Any:  # noqa: ANN401 - of the bag's types
    try:
        return decode(message)
    except ValueError as error:
        return error


def _first_of(topic: NumberedTopic) -> dict[int, int]:
    """Map file numbers, ascending, to the index of the first message with each."""
    numbers, indices = np.unique(topic.numbers, return_index=True)
    pairs = zip(numbers.tolist(), indices.tolist(), strict=True)
    return {number: index for number, index in pairs if number != UNKNOWN}


def _index(topic: NumberedTopic) -> StreamIndex:
    first = _first_of(topic)
    numbers = np.array([*first], dtype=np.int64)
    return StreamIndex(numbers, topic.stamps_ns[[*first.values()]])


def _positions(name: str, topic: NumberedTopic) -> dict[int, MessagePosition]:
    first = _first_of(topic)
    return dict(zip(first, positions_of(name, topic.log_ns, first.values()), strict=True))


def _camera_name(topic: str, index: int) -> str:
    """Return KITTI's name of a camera, or its number on a rig of independent ones."""
    name = CAMERA_NAMES.get(index, str(index))
    return name if f'camera_{name}/' in topic else str(index)


def open_own_recording(
    bag: OpenBag, survey: Survey, source_files: SourceFiles | None = None
) -> BagRecording | None:
    """Open the recording in a bag written by to-bag; None if frames have no KITTI numbers.

    Args:
        bag: The bag.
        survey: The survey of the bag.
        source_files: The source files of the recording, if already read.

    Raises:
        BadBagError: The bag cannot be read.
    """
    log_ns = {
        name: np.array(topic.log_ns, np.int64)
        for name, topic in survey.topics.items()
        if topic.count
    }
    numbered = number_bag(bag, log_ns, source_files=source_files)
    if numbered is None:
        return None
    recording = BagRecording(bag, numbered, survey)
    if recording.streams:
        return recording
    recording.close()
    return None
