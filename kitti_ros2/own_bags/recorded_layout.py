# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The original layout of a recording, from /kitti/source/* of bags written by to-bag.

It maps every sample to its file: the text files of a layout map stamps to file numbers, and the
description maps streams to folders. The description also lists the files in the bag, so that a lost
message is detected.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..bags.decoding import Decoder
from ..bags.reader import open_messages, opened, path_of
from ..importer.report import LossTally, damage
from ..kitti import names
from ..kitti.layout_files import LAYOUTS
from ..kitti.real_time import ENDS, STARTS
from ..kitti.stamps_file import parse_times, parse_timestamps
from ..kitti.stereo_pairs import LEFT_STREAM_OF, pair_stamps
from ..kitti.turns import find_turns, scan_stamps
from ..messages.moment import Origin
from ..messages.source import CALIBRATION, FILES, RECORDING
from ..messages.topics import decoders, own_topics
from ..model.errors import BadBagError
from ..model.losses import Loss
from ..model.motion import Deskew
from ..model.msgtypes import STRING
from ..model.streams import Clock, Stream
from ..options.read import ScanStamp
from .description import EarlierVersionError, UndescribedError, parse_description
from .earlier_descriptions import implied_texts, without_absent_streams
from .source_texts import TEXT_FILE, TextFiles

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..bags.reader import BagMessages, BagSource
    from ..kitti.real_time import RealTimes
    from ..model.layouts import Layout
    from ..model.samples import TextFile, Turn
    from .description import RecordingDescription
    from .folders import Folder

__all__ = [
    'Blueprint',
    'EarlierVersionError',
    'UndescribedError',
    'find_blueprint',
    'read_blueprint',
]


@dataclass(frozen=True)
class Blueprint:
    """The layout of one recording.

    Attributes:
        layout: Which of the four.
        name: Drive, sequence or split.
        epoch_ns: The time of the first frame in layouts without absolute time.
        period_ns: Distance of the frames in layouts without time.
        scan_stamp: The moment of a scan used as its stamp.
        folders: By stream.
        texts: Whole text files by path relative to the recording's root, calibration apart.
        calibrations: Calibration files, in the order of their frames.
        times: The true stamps of an object set in real time; None for others.
        deskew: What to-bag did to the scans; None: they are those of the files.
        stereo: Whether right images have the stamps of their left ones.
        grey: Streams of colour images whose raw images are grey.
        topics: Topics of the bag.
        missing: Text files missing in the bag.
        selected: File numbers of the requested part, by stream; None is all.
        losses: Those files, and texts that are unreadable or invalid.
        damage: Damage that the bag's reader found so far, and the number of messages lost by each;
            None: unknown.
    """

    layout: Layout
    name: str
    epoch_ns: int
    period_ns: int
    scan_stamp: ScanStamp
    folders: Mapping[Stream, Folder]
    texts: Mapping[PurePosixPath, str]
    calibrations: Mapping[PurePosixPath, str]
    times: RealTimes | None = None
    deskew: Deskew | None = None
    stereo: bool = False
    grey: frozenset[Stream] = frozenset()
    topics: frozenset[str] = frozenset()
    missing: frozenset[PurePosixPath] = frozenset()
    selected: Mapping[Stream, frozenset[int]] | None = None
    losses: tuple[Loss, ...] = ()
    damage: Mapping[str, int | None] = field(default_factory=dict)

    @property
    def root(self) -> PurePosixPath:
        """The recording's root in a data set: raw drives are in the folder of their date.

        Source: readme.txt of the raw devkit; pykitti expects this.
        """
        drive = self.layout.traits.dated and names.RAW_DRIVE.fullmatch(self.name)
        return PurePosixPath(self.name[: len('2011_09_26')] if drive else '')

    @property
    def files(self) -> int:
        """Number of requested numbered files."""
        return sum(len(self.requested(stream)) for stream in self.folders)

    def requested(self, stream: Stream) -> frozenset[int]:
        """Return the numbers of a stream's files to restore, of those written to the bag."""
        carried = frozenset(self.folders[stream].carried)
        return carried if self.selected is None else carried & self.selected.get(stream, carried)

    def numbers_by_stamp(self, stream: Stream) -> dict[int, list[int]] | None:
        """Map stamps to the file numbers of a stream; None if the file of the stamps is missing."""
        stamps = self._stamps(stream)
        if stamps is None:
            return None
        found: dict[int, list[int]] = {}
        for number in self.folders[stream].carried:
            if number in stamps:
                found.setdefault(stamps[number], []).append(number)
        return found

    def stamps_path(self, stream: Stream) -> PurePosixPath:
        """Return the text file with a stream's stamps, in layouts that have one."""
        return self.folders[stream].path.parent / LAYOUTS[self.layout].stamps

    def _stamps(self, stream: Stream) -> Mapping[int, int] | None:
        """Map file numbers to stamps of messages; numbers without a valid stamp are skipped."""
        stamps = self.file_stamps(stream)
        left = self.stamped_as(stream)
        if left is not stream:
            return self._paired_stamps(left, stream)
        if (
            stream is not Stream.SCAN
            or stamps is None
            or self.scan_stamp is ScanStamp.FORWARD
            or self._compensated
        ):
            return stamps
        turns = self.turns()
        return None if turns is None else scan_stamps(stamps, turns, self.scan_stamp)

    def stamped_as(self, stream: Stream) -> Stream:
        """Return the stream whose stamps a stream's messages have: itself, or its left images."""
        left = LEFT_STREAM_OF.get(stream, stream)
        return left if self.stereo and left in self.folders else stream

    def _paired_stamps(self, *pair: Stream) -> dict[int, int] | None:
        """Map the numbers of right images to stamps of messages; see kitti/stereo_pairs.py."""
        found = []
        for stream in pair:
            stamps = self.file_stamps(stream)
            if stamps is None:
                return None
            numbers = self.folders[stream].numbers
            found.append({number: stamps[number] for number in numbers if number in stamps})
        left_ns, right_ns = found
        return pair_stamps(left_ns, right_ns, common=not self.layout.traits.is_extract(self.name))

    @property
    def _compensated(self) -> bool:
        """Whether the scans in the bag are compensated for motion."""
        of_layout = self.layout.traits.compensated_scans
        return self.deskew is Deskew.ON or (of_layout and self.deskew is None)

    def turns(self) -> Mapping[int, Turn] | None:
        """Return the turn of each scan, by file number; None if a file of stamps is missing.

        Scans compensated for motion have none.
        """
        if self._compensated:
            return {}
        stamps = self.file_stamps(Stream.SCAN)
        starts = self._turn_stamps(names.TIMESTAMPS_START, STARTS)
        ends = self._turn_stamps(names.TIMESTAMPS_END, ENDS)
        if stamps is None or starts is None or ends is None:
            return None
        return find_turns(stamps, starts, ends, self.period_ns)

    def _turn_stamps(self, name: str, column: str) -> Mapping[int, int] | None:
        """Parse the starts or ends of the scanner's turns; None if they are missing."""
        if self.times is not None:
            return self.times.turn_stamps(column)
        path = self.folders[Stream.SCAN].path.parent / name
        if path in self.missing:
            return None
        return parse_timestamps(self.texts.get(path, ''), str(path)).sound()

    def file_stamps(self, stream: Stream) -> Mapping[int, int] | None:
        """Map file numbers to stamps of files; None if their text file is missing."""
        if self.times is not None:
            return self.times.stamps(stream)
        path = self.stamps_path(stream)
        if path in self.missing:
            return None
        clock = self.layout.traits.clock
        if clock is Clock.UTC and path in self.texts:
            return parse_timestamps(self.texts[path], str(path)).sound()
        if clock is Clock.RELATIVE and path in self.texts:
            offsets = parse_times(self.texts[path], str(path)).sound()
            return {line: self.epoch_ns + offset for line, offset in offsets.items()}
        numbers = self.folders[stream].carried
        return {number: self.epoch_ns + number * self.period_ns for number in numbers}

    def shortfall(self, counts: Mapping[str, int]) -> tuple[Loss, ...]:
        """Return the streams of which a bag contains fewer messages than its description lists.

        Args:
            counts: Messages by topic.
        """
        losses = []
        for stream, folder in self.folders.items():
            rows = (row for row in own_topics().values() if row.restores and row.stream is stream)
            found = max((counts.get(row.topic, 0) for row in rows), default=0)
            absent = len(folder.carried) - found
            if absent > 0:
                text = f'the bag holds {found} of {len(folder.carried)} {stream.value} messages'
                losses.append(Loss(stream.value, absent, text))
        return tuple(losses)


def find_blueprint(source: BagSource) -> Blueprint | None:
    """Read the layout of the recording in a bag; None unless to-bag wrote the bag.

    Raises:
        UndescribedError: to-bag wrote it, and its description is missing, invalid or too old.
        BadBagError: It is not a bag, or its description names folders outside of its root.
    """
    with opened(source) as bag:
        with open_messages(bag) as messages:
            topics = frozenset(topic for topic, _ in messages.channels)
            unread = tuple(loss for _, loss in messages.left_out if loss.stream in own_topics())
            damaged: dict[str, int | None] = dict.fromkeys(messages.losses, 0)
            is_own = (RECORDING, STRING) in messages.channels
        if not is_own:
            return None
        with open_messages(bag, {RECORDING, FILES, CALIBRATION} & topics) as messages:
            texts = _Source(messages, bag.path)
            damaged |= messages.losses
    found = texts.blueprint(topics, damaged)
    return replace(found, losses=(*unread, *found.losses))


def read_blueprint(
    bag: BagSource, counts: Mapping[str, int]
) -> tuple[Blueprint | None, tuple[Loss, ...]]:
    """Read the layout of the recording in a bag, as find_blueprint; also return its missing data.

    An unusable description is a loss, and not an error; one of an earlier version is neither.

    Args:
        bag: A bag that can be read; without a readable description, it has no layout.
        counts: Its messages by topic.
    """
    if RECORDING not in counts:
        return None, ()
    try:
        found = find_blueprint(bag)
    except EarlierVersionError:
        return None, ()
    except BadBagError as error:
        return None, (Loss(RECORDING, 1, str(error)),)
    if found is None:
        return None, ()
    damaged = damage(found.damage, path_of(bag).name)
    return found, (*damaged, *found.losses, *found.shortfall(counts))


class _Source:
    """The content of /kitti/source/{recording,files,calibration}, from a pass over them."""

    def __init__(self, messages: BagMessages, path: Path) -> None:
        self._path = path
        self._tally = LossTally()
        self._description: RecordingDescription | None = None
        self._found: list[tuple[str, int, TextFile]] = []
        decode = Decoder(messages.typestore)
        for message in messages:
            if message.msgtype != STRING:
                continue
            try:
                decoded = decode(message)
            except ValueError as error:
                self._tally.lose(message.topic, message.stamp_ns, str(error))
                continue
            if message.topic == RECORDING:
                self._description = parse_description(decoded, path)
            else:
                text = decoders()[message.topic](decoded, Origin(path))
                self._found.append((message.topic, message.stamp_ns, text))

    def blueprint(self, topics: frozenset[str], damaged: Mapping[str, int | None]) -> Blueprint:
        """Make the layout and its text files; invalid or missing ones are losses."""
        description = self._description
        if description is None:
            reasons = [*(loss.text() for loss in self._tally.losses()), *damaged]
            because = f' ({reasons[0]})' if reasons else ''
            raise UndescribedError(self._path, f'has no readable {RECORDING}{because}')
        found = self._files(description)
        texts, calibrations = found.of(FILES), found.of(CALIBRATION)
        present = dict.fromkeys((*texts, *calibrations))
        if description.texts is None:
            description = without_absent_streams(description, topics)
            listed = implied_texts(description, topics, present)
        else:
            listed = (*description.texts, *description.calibrations)
        missing = [path for path in dict.fromkeys(listed) if path not in present]
        absent = (Loss(TEXT_FILE, 1, f'the bag does not hold {path}') for path in missing)
        return Blueprint(
            layout=description.layout,
            name=description.name,
            epoch_ns=description.epoch_ns,
            period_ns=description.period_ns,
            scan_stamp=description.scan_stamp,
            folders=description.folders,
            texts=texts,
            calibrations=calibrations,
            times=description.times,
            deskew=description.deskew,
            stereo=description.stereo,
            grey=description.grey,
            topics=topics,
            missing=frozenset(missing),
            losses=(*self._tally.losses(), *absent),
            damage=damaged,
        )

    def _files(self, description: RecordingDescription) -> TextFiles:
        """Collect the valid text files; the others are losses."""
        listed = {FILES: description.texts, CALIBRATION: description.calibrations}
        found = TextFiles(description.folders, {} if description.texts is None else listed)
        for topic, stamp_ns, file in self._found:
            try:
                found.add(topic, file)
            except ValueError as error:
                self._tally.lose(topic, stamp_ns, str(error))
        return found
