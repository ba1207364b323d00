# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The original layout of a recording, from /kitti/source/* of bags written by to-bag.

It maps every sample to its file: the text files of a layout map stamps to file numbers, and the
description maps streams to folders. The description also lists the files in the bag, so that a lost
message is detected.
"""

from __future__ import annotations

import errno
from bisect import bisect_left
from dataclasses import dataclass, field, fields, replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from ..bags.bag_files import opened, path_of
from ..bags.reader import Decoder, open_messages
from ..kitti import names
from ..kitti.find import LAYOUTS
from ..kitti.names import split_name
from ..kitti.object_set import ENDS, REAL_TIME, STARTS, parse_times_of
from ..kitti.prepare import LEFT_STREAM_OF, pair_stamps
from ..kitti.recording_index import find_turns, scan_stamps
from ..kitti.store import STORE
from ..kitti.text_file import parse_times, parse_timestamps
from ..messages.naming import CALIBRATION, COMPACT, FILES, GREY, RECORDING, SWEEP, BagContext
from ..messages.topics import decoders, own_topics
from ..model.bag_formats import STRING
from ..model.errors import BadBagError, Loss, LossTally, UsageError, damage
from ..model.recording import Deskew
from ..model.streams import Clock, Layout, ScanColumns, Stream
from ..options.read import ScanStamp, is_period
from .missing_files import text_of_stamps, texts_of_turns

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import BagSource, OpenBag
    from ..bags.reader import BagMessages
    from ..kitti.names import FileNames
    from ..kitti.object_set import RealTimes
    from ..model.samples import TextFile, Turn


# Folders of numbered files, and validation of the paths in a bag.

_SHOWN = 80


@dataclass(frozen=True)
class Folder:
    """The folder of a stream's numbered files.

    Attributes:
        path: Relative to the recording's root.
        names: Their naming scheme.
        numbers: File numbers of the recording, ascending.
        carried: File numbers that were written to the bag, ascending.
    """

    path: PurePosixPath
    names: FileNames
    numbers: tuple[int, ...]
    carried: tuple[int, ...]

    def file(self, number: int) -> PurePosixPath:
        """Return the path of the file with a number."""
        return self.path / self.names.name(number)

    def has(self, number: int) -> bool:
        """Return whether the recording has a file of this number."""
        index = bisect_left(self.numbers, number)
        return self.numbers[index : index + 1] == (number,)


def owner_of(path: PurePosixPath, folders: Mapping[Stream, Folder]) -> tuple[Stream, int] | None:
    """Return the stream and number of a numbered file; None if it is not in the recording."""
    for stream, folder in folders.items():
        if path.parent != folder.path:
            continue
        number = folder.names.number(split_name(path.name)[0])
        if number is not None and folder.has(number) and path == folder.file(number):
            return stream, number
    return None


def inside(name: str, bag: Path) -> PurePosixPath:
    """Validate a relative path in a bag.

    Raises:
        BadBagError: It would be outside of the output.
    """
    if not is_inside(name):
        text = f'names a file {shown(name)}, which would lie outside of the output'
        raise BadBagError(bag, text, 'paths within the recording')
    return PurePosixPath(name)


def shown(name: str) -> str:
    """Format a name for errors."""
    return repr(name if len(name) <= _SHOWN else f'{name[:_SHOWN]}...')


def is_inside(name: str) -> bool:
    """Return whether a name is a relative path that stays below its root."""
    path = PurePosixPath(name)
    return not (path.is_absolute() or '..' in path.parts or not path.parts or '\0' in name)


# The description in a bag written by to-bag: layout, folders, and the files the bag contains.
#
# It is untrusted: a bag may be damaged or forged.

_MOST_FILES = 1_000_000  # of all streams: a day of frames; every one takes its memory
_EARLIER_PERIOD_NS = 100_000_000  # of bags whose description has no period
_ERRORS = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)


class UndescribedError(BadBagError):
    """The description in a bag written by to-bag is missing, invalid or too old."""

    def __init__(self, path: Path, reason: str) -> None:
        expected = 'the description of a recording; --layout or --plan-file goes by a plan instead'
        super().__init__(path, reason, expected)


class EarlierVersionError(UndescribedError):
    """The description in a bag written by an earlier to-bag has no file numbers."""

    def __init__(self, path: Path) -> None:
        BadBagError.__init__(
            self,
            path,
            'was made by an earlier version of to-bag, whose description has no file numbers',
            'a bag of this version: make it again with to-bag, or give --layout for a plan',
        )


@dataclass(frozen=True, kw_only=True)
class DescribedRecording:
    """The description of one recording, apart from its text files.

    Attributes:
        layout: One of the four.
        name: Drive, sequence or split.
        epoch_ns: The time of the first frame in layouts without absolute time.
        period_ns: Distance of the frames in layouts without time.
        scan_stamp: The time of a scan used as its stamp.
        folders: By stream.
        times: The true stamps of an object set in real time; None for others.
        deskew: The change that to-bag made to the scans; None: they are those of the files.
        stereo: Whether right images have the stamps of their left ones.
        grey: Streams of colour images whose raw images are grey.
        columns: Columns of .bin scans; None are KITTI's.
        compact: Whether clouds of scans that are a grid are rounded to it.
    """

    layout: Layout
    name: str
    epoch_ns: int
    period_ns: int
    scan_stamp: ScanStamp
    folders: Mapping[Stream, Folder]
    times: RealTimes | None = None
    deskew: Deskew | None = None
    stereo: bool = False
    grey: frozenset[Stream] = frozenset()
    columns: ScanColumns | None = None
    compact: bool = False


@dataclass(frozen=True, kw_only=True)
class RecordingDescription(DescribedRecording):
    """A validated description.

    Attributes:
        texts: The text files in the bag, calibration apart; None if the description does not list
            them.
        calibrations: The calibration files in the bag, if these are not numbered.
    """

    texts: tuple[PurePosixPath, ...] | None
    calibrations: tuple[PurePosixPath, ...]


def parse_description(message: Any, path: Path) -> RecordingDescription:  # noqa: ANN401
    """Parse the description in a String.

    Raises:
        EarlierVersionError: It has no file numbers.
        UndescribedError: It is invalid.
        BadBagError: It names folders outside of its root.
    """
    try:
        values: Mapping[str, Any] = decoders()[RECORDING](message, BagContext(path)).values
        entries = values['files']
        if any('numbers' not in entry for entry in entries.values()):
            raise EarlierVersionError(path)
        for key in ('numbers', 'carried'):
            if sum(_count(entry.get(key, ())) for entry in entries.values()) > _MOST_FILES:
                raise ValueError(f'more than {_MOST_FILES} files')
        stems = tuple(map(str, values.get(names.FRAME_NAMES, ())))
        if len(stems) > _MOST_FILES:
            raise ValueError(f'more than {_MOST_FILES} names')
        folders = {Stream(name): _folder(entry, stems, path) for name, entry in entries.items()}
        patterns = {(folder.path, folder.names.suffix.lower()) for folder in folders.values()}
        if len(patterns) < len(folders):
            raise ValueError('two streams in one folder')
        return RecordingDescription(
            layout=Layout(values['layout']),
            name=str(values['name']),
            epoch_ns=int(values['epoch_ns']),
            period_ns=_period(values),
            scan_stamp=ScanStamp(values.get('scan_stamp', ScanStamp.FORWARD.value)),
            folders=folders,
            texts=tuple(map(PurePosixPath, values['texts'])) if 'texts' in values else None,
            calibrations=tuple(map(PurePosixPath, values.get('calibrations', ()))),
            times=parse_times_of(values[REAL_TIME]) if REAL_TIME in values else None,
            deskew=Deskew(values['deskew']) if 'deskew' in values else None,
            stereo=bool(values.get('stereo', False)),
            grey=frozenset(map(Stream, values.get(GREY, ()))),
            columns=_columns(values),
            compact=bool(values.get(COMPACT, False)),
        )
    except _ERRORS as error:
        reason = f'{RECORDING} is not what kitti-ros2 writes ({type(error).__name__}: {error})'
        raise UndescribedError(path, reason) from error


def joined(first: RecordingDescription, other: RecordingDescription) -> RecordingDescription:
    """Return the description of two parts of a recording: the files that either has."""
    folders = {**other.folders, **first.folders}
    for stream, folder in first.folders.items():
        more = set(other.folders[stream].carried) if stream in other.folders else set[int]()
        carried = more.intersection(folder.numbers).union(folder.carried)
        folders[stream] = replace(folder, carried=tuple(sorted(carried)))
    texts = first.texts
    if texts is not None:
        texts = tuple(dict.fromkeys((*texts, *(other.texts or ()))))
    calibrations = tuple(dict.fromkeys((*first.calibrations, *other.calibrations)))
    return replace(first, folders=folders, texts=texts, calibrations=calibrations)


def _period(values: Mapping[str, Any]) -> int:
    period_ns = int(values.get('period_ns', _EARLIER_PERIOD_NS))
    if not is_period(period_ns):
        raise ValueError(f'a period of {period_ns} ns')
    return period_ns


def _columns(values: Mapping[str, Any]) -> ScanColumns | None:
    try:
        return ScanColumns.parse(str(values['columns'])) if 'columns' in values else None
    except UsageError as error:
        raise ValueError(str(error)) from None


def _folder(entry: Mapping[str, Any], stems: tuple[str, ...], path: Path) -> Folder:
    file_names = names.parse_names(entry, stems)
    limit = len(stems) or 10**names.MOST_DIGITS
    numbers = tuple(_numbers(entry['numbers'], limit))
    carried = numbers
    if 'carried' in entry:
        carried = tuple(_numbers(entry['carried'], limit))
        if not set(numbers).issuperset(carried):
            raise ValueError('files that the recording does not have')
    return Folder(inside(entry['folder'], path), file_names, numbers, carried)


def _count(spans: Iterable[tuple[int, int]]) -> int:
    """Return how many numbers there are in spans, before any of them is made."""
    return sum(max(int(last) - int(first) + 1, 0) for first, last in spans)


def _numbers(spans: Iterable[tuple[int, int]], limit: int) -> Iterable[int]:
    least = 0
    for first, last in spans:
        if not least <= int(first) <= int(last) < limit:
            raise ValueError(f'file numbers {first} to {last}')
        yield from range(int(first), int(last) + 1)
        least = int(last) + 1


# The source files of one recording in a bag written by to-bag, by stamps of messages.


@dataclass(frozen=True, kw_only=True)
class SourceFiles(DescribedRecording):
    """The source files of one recording.

    Attributes:
        texts: Whole text files by path relative to the recording's root, calibration apart.
        calibrations: Calibration files, in the order of their frames.
        topics: Topics of the bag.
        missing: Text files missing in the bag.
        selected: File numbers of the requested part, by stream; None is all.
        losses: Missing files, and texts that are unreadable or invalid.
        damage: Damage that the bag's reader found so far, and the number of messages lost by each;
            None: unknown.
    """

    texts: Mapping[PurePosixPath, str]
    calibrations: Mapping[PurePosixPath, str]
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
        numbers: dict[int, list[int]] = {}
        for number in self.folders[stream].carried:
            if number in stamps:
                numbers.setdefault(stamps[number], []).append(number)
        return numbers

    def stamps_path(self, stream: Stream) -> PurePosixPath:
        """Return the text file with a stream's stamps, in layouts that have one.

        It is beside the folder, or in another of the same name (label images), or else the first.
        """
        name = LAYOUTS[self.layout].stamps
        own = self.folders[stream].path.parent / name
        if own in self.texts or own in self.missing:
            return own
        others = [path for path in self.texts if path.name == name]
        same = [path for path in others if path.parent.name == own.parent.name]
        return next(iter(same if stream.label_image and same else others), own)

    def _stamps(self, stream: Stream) -> Mapping[int, int] | None:
        """Map file numbers to stamps of messages; numbers without a valid stamp are skipped."""
        stamps = self.file_stamps(stream)
        left_stream = self.stamped_as(stream)
        if left_stream is not stream:
            return self._paired_stamps(left_stream, stream)
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
        left_stream = LEFT_STREAM_OF.get(stream, stream)
        is_paired = self.stereo and stream.camera in self.layout.traits.right_cameras
        return left_stream if is_paired and left_stream in self.folders else stream

    def _paired_stamps(self, *pair: Stream) -> dict[int, int] | None:
        """Map the numbers of right images to stamps of messages; see kitti/prepare.py."""
        pair_ns = []
        for stream in pair:
            stamps = self.file_stamps(stream)
            if stamps is None:
                return None
            numbers = self.folders[stream].numbers
            pair_ns.append({number: stamps[number] for number in numbers if number in stamps})
        left_ns, right_ns = pair_ns
        return pair_stamps(left_ns, right_ns, common=not self.layout.traits.is_extract(self.name))

    @property
    def _compensated(self) -> bool:
        """True if the scans in the bag are compensated for motion."""
        of_layout = self.layout.traits.compensated_scans
        return self.deskew is Deskew.ON or (of_layout and self.deskew is None)

    def turns(self) -> Mapping[int, Turn] | None:
        """Return the turn of each scan, by file number; None if a file of stamps is missing.

        Scans compensated for motion have none.
        """
        if self._compensated or Stream.SCAN not in self.folders:
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
            count = max((counts.get(row.topic, 0) for row in rows), default=0)
            absent = len(folder.carried) - count
            if absent > 0:
                text = f'the bag holds {count} of {len(folder.carried)} {stream.value} messages'
                losses.append(Loss(stream.value, absent, text))
        return tuple(losses)


# Descriptions that do not list the files of their bag: these follow from its topics.
#
# A stream without any topic in the bag was not selected. A text file is expected where the bag has
# a topic that to-bag makes from that file alone.


def without_absent_streams(
    description: RecordingDescription, topics: Collection[str]
) -> RecordingDescription:
    """Remove the files of streams without a topic in the bag from a description."""
    present = _streams(topics)
    folders = {
        stream: folder if stream in present else replace(folder, carried=())
        for stream, folder in description.folders.items()
    }
    return replace(description, folders=folders)


def implied_texts(
    description: RecordingDescription, topics: Collection[str], paths: Collection[PurePosixPath]
) -> tuple[PurePosixPath, ...]:
    """Return the text files of a recording that follow from the topics of its bag.

    Args:
        description: That of the recording.
        topics: Topics of the bag.
        paths: The text files in the bag.
    """
    rules = {
        Layout.RAW: _of_raw,
        Layout.ODOMETRY: _of_odometry,
        Layout.TRACKING: _of_tracking,
    }
    rule = rules.get(description.layout)
    return () if rule is None else tuple(rule(description, topics, paths))


def _streams(topics: Collection[str]) -> set[Stream]:
    return {row.stream for name, row in own_topics().items() if name in topics}


def _of_raw(
    description: RecordingDescription, topics: Collection[str], paths: Collection[PurePosixPath]
) -> list[PurePosixPath]:
    drive, streams = PurePosixPath(description.name), _streams(topics)
    carrying = [folder for folder in description.folders.values() if folder.carried]
    expected = [folder.path.parent / names.TIMESTAMPS for folder in carrying]
    if SWEEP in topics:
        scans = drive / names.RAW_SCANS
        expected += [scans / names.TIMESTAMPS_START, scans / names.TIMESTAMPS_END]
    elif not set(expected).intersection(paths):
        expected.clear()  # a drive without time stamps
    if Stream.LABELS in streams:
        expected.append(drive / names.RAW_TRACKLETS)
    if Stream.CALIBRATION in streams:
        files = names.RAW_CALIB
        first = next((path for path in paths if path.name in files), PurePosixPath(files[0]))
        expected += [first.parent / file for file in files]
    return expected


def _of_odometry(
    description: RecordingDescription, topics: Collection[str], paths: Collection[PurePosixPath]
) -> list[PurePosixPath]:
    streams = _streams(topics)
    expected = []
    sequence = next((folder.path.parent for folder in description.folders.values()), None)
    if sequence is not None and Stream.CALIBRATION in streams:
        expected.append(sequence / names.ODOMETRY_CALIB)
    if Stream.POSE in streams:
        common = PurePosixPath(names.POSES) / f'{description.name}{names.TXT}'
        beside = f'{names.POSES}{names.TXT}'
        expected.append(next((path for path in paths if path.name == beside), common))
    return expected


def _of_tracking(
    description: RecordingDescription,
    topics: Collection[str],
    paths: Collection[PurePosixPath],  # noqa: ARG001 - one form for all
) -> list[PurePosixPath]:
    split = next((folder.path.parents[1] for folder in description.folders.values()), None)
    if split is None or Stream.CALIBRATION not in _streams(topics):
        return []
    return [split / names.CALIB / f'{description.name}{names.TXT}']


# The text files in a bag, validated and written: none may overwrite another file.

TEXT_FILE = 'text file'
"""The name of such a file in losses."""

_MOST_PART_BYTES = 255  # NAME_MAX of Linux file systems
_MOST_PATH_BYTES = 1024  # leaves room within PATH_MAX for the folder of the output
_OF_NAME = (errno.EEXIST, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.EINVAL)
"""Errors that a file's own name causes, not the disk."""


class TextFiles:
    """The text files of a recording: paths are unique and do not collide with numbered files.

    Args:
        folders: The folders of the numbered files, by stream.
        listed: By topic the allowed files, besides numbered calibrations; None: any.
    """

    def __init__(
        self,
        folders: Mapping[Stream, Folder],
        listed: Mapping[str, Collection[PurePosixPath] | None],
    ) -> None:
        self._folders = folders
        self._listed = listed
        self._found: dict[PurePosixPath, tuple[str, str]] = {}
        self._doubtful: set[PurePosixPath] = set()
        self._taken = {
            path for folder in folders.values() for path in (folder.path, *folder.path.parents)
        }

    def add(self, topic: str, file: TextFile) -> None:
        """Add a file; one repeated with the same text counts once.

        Raises:
            ValueError: The name is invalid, or belongs to another file or to a folder.
        """
        path = _valid_path(file.name)
        self._refuse_unlisted(topic, path)
        if path not in self._found:
            self._refuse_taken(topic, path)
            self._found[path] = topic, file.text
            self._taken.update(path.parents)
        elif self._found[path][1] != file.text:
            self._doubtful.add(path)  # one of the two has a damaged name, or a damaged text
            raise ValueError(f'a second {path} with another text; neither is written')

    def of(self, topic: str) -> dict[PurePosixPath, str]:
        """Return the texts of a topic by path, in the order added."""
        return {
            path: text
            for path, (origin, text) in self._found.items()
            if origin == topic and path not in self._doubtful
        }

    def _refuse_taken(self, topic: str, path: PurePosixPath) -> None:
        if path in self._taken:
            raise ValueError(f'a text named {path}, which is a folder')
        for prefix in (path, *path.parents):
            stream, number = owner_of(prefix, self._folders) or (None, 0)
            if stream is Stream.CALIBRATION and topic == CALIBRATION and prefix == path:
                return
            if stream is not None:
                raise ValueError(f'a text named {path}, which is {stream.value} {number}')
            if prefix in self._found:
                raise ValueError(f'a text named {path}, though {prefix} is a file')

    def _refuse_unlisted(self, topic: str, path: PurePosixPath) -> None:
        listed = self._listed.get(topic)
        stream, _ = owner_of(path, self._folders) or (None, 0)
        if listed is not None and path not in listed and stream is None:
            raise ValueError(
                f'a text named {shown(str(path))}, which the description does not list'
            )


def _valid_path(name: str) -> PurePosixPath:
    if not is_inside(name):
        raise ValueError(f'names a file {shown(name)}, which would lie outside of the output')
    path = PurePosixPath(name)
    longest = max(len(part.encode()) for part in path.parts)
    if longest > _MOST_PART_BYTES or len(name.encode()) > _MOST_PATH_BYTES:
        raise ValueError(f'names a file {shown(name)}, which is too long for a file name')
    return path


def write_texts(
    root: Path, texts: Iterable[tuple[PurePosixPath, str]], bag: Path
) -> tuple[Loss, ...]:
    """Write text files; recordings of a data set may share some.

    Raises:
        UsageError: Another bag has a file of the same name with another text.
        OSError: One cannot be written.
    """
    losses = []
    for path, text in texts:
        target = root / path
        if target.is_file() and STORE.read_text(target) != text:
            raise UsageError(f'{bag}: its {path} differs from that of another bag')
        error = '' if target.is_file() else write_new(target, text.encode())
        if error:
            losses.append(Loss(TEXT_FILE, 1, error))
    return tuple(losses)


def write_new(target: Path, content: bytes | memoryview) -> str:
    """Write a new file; returns the reason if its name is invalid or exists.

    Raises:
        OSError: It cannot be written.
    """
    try:
        STORE.write(target, content, new=True)
    except OSError as error:
        if error.errno not in _OF_NAME:
            raise
        return f'{target.name}: {error.strerror}; the file of that name is kept'
    return ''


__all__ = [
    'EarlierVersionError',
    'UndescribedError',
    'find_source_files',
    'read_source_files',
]


def find_source_files(source: BagSource) -> SourceFiles | None:
    """Read the source files of the recording in a bag; None unless to-bag wrote the bag.

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
        return _completed(bag, texts.make(topics, damaged), unread)


def _completed(bag: OpenBag, source_files: SourceFiles, unread: Sequence[Loss]) -> SourceFiles:
    """Add the missing files of stamps that the messages have; these and the others are losses."""
    made = _missing_stamps(bag, source_files) if source_files.missing else {}
    losses = list(source_files.losses)
    for path in sorted(source_files.missing):
        how = f'; it is made of the stamps of {made[path][1]}' if path in made else ''
        losses.append(lost_file(path, how))
    return replace(
        source_files,
        texts={**source_files.texts, **{path: text for path, (text, _) in made.items()}},
        missing=source_files.missing - made.keys(),
        losses=(*unread, *losses),
    )


def lost_file(path: PurePosixPath, how: str = '') -> Loss:
    """Return the loss of a text file, and how one is made in its place."""
    return Loss(TEXT_FILE, 1, f'the bag does not hold {path}{how}')


def _missing_stamps(
    bag: OpenBag, source_files: SourceFiles
) -> dict[PurePosixPath, tuple[str, str]]:
    """Make the missing files of stamps: by path the text, and the topic that it is made of."""
    made: dict[PurePosixPath, tuple[str, str]] = {}
    missing, clock = source_files.missing, source_files.layout.traits.clock
    is_forward = source_files.scan_stamp is ScanStamp.FORWARD
    epoch_ns = source_files.epoch_ns if clock is Clock.RELATIVE else None
    for stream, folder in source_files.folders.items():
        path = source_files.stamps_path(stream)
        own_stamps = source_files.stamped_as(stream) is stream
        if path not in missing - made.keys() or not own_stamps or clock is Clock.NOMINAL:
            continue
        if stream is not Stream.SCAN or is_forward:
            text = text_of_stamps(bag, stream, folder.carried, epoch_ns)
            made.update({path: text} if text else {})
    scans = source_files.folders.get(Stream.SCAN)
    if scans is not None and SWEEP in source_files.topics:
        turns = names.TIMESTAMPS_START, names.TIMESTAMPS_END
        paths = [scans.path.parent / name for name in turns]
        texts = () if missing.isdisjoint(paths) else texts_of_turns(bag, scans.carried)
        made.update(
            {p: (text, SWEEP) for p, text in zip(paths, texts, strict=False) if p in missing}
        )
    return made


def read_source_files(
    bag: BagSource, counts: Mapping[str, int]
) -> tuple[SourceFiles | None, tuple[Loss, ...]]:
    """Read the source files of the recording in a bag, as find_source_files, and its missing data.

    An unusable description is a loss, and not an error; one of an earlier version is neither.

    Args:
        bag: A bag that can be read; without a readable description, it has no source files.
        counts: Its messages by topic.
    """
    if RECORDING not in counts:
        return None, ()
    try:
        source_files = find_source_files(bag)
    except EarlierVersionError:
        return None, ()
    except BadBagError as error:
        return None, (Loss(RECORDING, 1, str(error)),)
    if source_files is None:
        return None, ()
    damaged = damage(source_files.damage, path_of(bag).name)
    return source_files, (*damaged, *source_files.losses, *source_files.shortfall(counts))


class _Source:
    """The content of /kitti/source/{recording,files,calibration}, from a pass over them."""

    def __init__(self, messages: BagMessages, path: Path) -> None:
        self._path = path
        self._tally = LossTally()
        self._description: RecordingDescription | None = None
        self._found: list[tuple[str, int, TextFile]] = []
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message, STRING)
                if message.topic == RECORDING:
                    self._describe(parse_description(decoded, path), message.stamp_ns)
                    continue
                files = decoders()[message.topic](decoded, BagContext(path))
            except ValueError as error:
                self._tally.lose(message.topic, message.stamp_ns, str(error))
                continue
            self._found += [(message.topic, message.stamp_ns, file) for file in files]

    def _describe(self, other: RecordingDescription, stamp_ns: int) -> None:
        """Take a description; a bag that was merged of parts of a recording has one a part."""
        first = self._description or other
        if (other.layout, other.name) == (first.layout, first.name):
            self._description = joined(first, other)
        else:
            reason = f'describes {other.name}; the bag is read as that of {first.name}, its first'
            self._tally.lose(RECORDING, stamp_ns, reason)

    def make(self, topics: frozenset[str], damaged: Mapping[str, int | None]) -> SourceFiles:
        """Make the source files; invalid or missing texts are losses."""
        description = self._description
        if description is None:
            reasons = [*(loss.text() for loss in self._tally.losses()), *damaged]
            because = f' ({reasons[0]})' if reasons else ''
            raise UndescribedError(self._path, f'has no readable {RECORDING}{because}')
        files = self._files(description)
        texts, calibrations = files.of(FILES), files.of(CALIBRATION)
        present = dict.fromkeys((*texts, *calibrations))
        if description.texts is None:
            description = without_absent_streams(description, topics)
            listed = implied_texts(description, topics, present)
        else:
            listed = (*description.texts, *description.calibrations)
        missing = [path for path in dict.fromkeys(listed) if path not in present]
        return SourceFiles(
            texts=texts,
            calibrations=calibrations,
            topics=topics,
            missing=frozenset(missing),
            losses=self._tally.losses(),
            damage=damaged,
            **{attr.name: getattr(description, attr.name) for attr in fields(DescribedRecording)},
        )

    def _files(self, description: RecordingDescription) -> TextFiles:
        """Collect the valid text files; the others are losses."""
        listed = {FILES: description.texts, CALIBRATION: description.calibrations}
        files = TextFiles(description.folders, {} if description.texts is None else listed)
        for topic, stamp_ns, file in self._found:
            try:
                files.add(topic, file)
            except ValueError as error:
                self._tally.lose(topic, stamp_ns, str(error))
        return files
