# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's file numbers of the messages in a bag written by to-bag.

All commands that address the frames of a bag use these numbers. The description in the bag and its
text files map stamps to numbers. A bag recorded from a player has other log times: its messages are
identified by the stamps in their headers, and texts by the names in them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..bags.bag_files import path_of
from ..bags.reader import bag_stamps, open_messages
from ..kitti import names
from ..kitti.find import LAYOUTS
from ..kitti.tracklet_file import cuboids_by_frame, parse_tracklets
from ..messages.cdr import peek_header
from ..messages.naming import BagContext
from ..messages.topics import decoders, own_topics
from ..model.bag_formats import HEADLESS
from ..model.errors import BadFileError, Loss, UsageError
from ..model.recording import StreamIndex
from ..model.streams import FRAME_STREAMS, LABEL_STREAMS, UNNUMBERED, Clock, Stream
from ..options.read import Bound, ScanStamp
from .schedule import (
    UNKNOWN,
    frame_runs,
    frames_of,
    masks_around,
    nearest_frames,
    select_window,
)
from .source_files import Folder, find_source_files, owner_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from ..bags.bag_files import BagSource
    from ..model.boxes import Cuboid
    from ..model.samples import Int64Array, TextFile
    from ..options.read import SelectionOptions
    from .source_files import SourceFiles


# KITTI's file numbers by stamp, from the folders and text files of a recording in a bag.


class StampNumbers:
    """Maps stamps to file numbers, by stream."""

    def __init__(self, source_files: SourceFiles) -> None:
        self.source_files = source_files
        self._sorted: dict[Stream, tuple[Int64Array, Int64Array]] = {}

    def of(self, stream: Stream, stamps_ns: Int64Array) -> Int64Array:
        """Return (N,) numbers of (N,) ascending stamps; equal stamps get theirs in order."""
        sorted_ns, numbers = self.pairs(stream)
        first, after = (np.searchsorted(sorted_ns, stamps_ns, side) for side in ('left', 'right'))
        turn = np.arange(len(stamps_ns)) - np.searchsorted(stamps_ns, stamps_ns)
        matched = np.full(len(stamps_ns), UNKNOWN, dtype=np.int64)
        is_known = after > first
        matched[is_known] = numbers[np.minimum(first + turn, after - 1)[is_known]]
        return matched

    def pairs(self, stream: Stream) -> tuple[Int64Array, Int64Array]:
        """Return the stamps of a stream's messages, ascending, and the number of each."""
        if stream not in self._sorted:
            mapping = _with_folder(self.source_files, stream).numbers_by_stamp(stream) or {}
            pairs = sorted((stamp, n) for stamp, group in mapping.items() for n in group)
            table = np.array(pairs, dtype=np.int64).reshape(-1, 2)
            self._sorted[stream] = (table[:, 0], table[:, 1])
        return self._sorted[stream]


def _with_folder(source_files: SourceFiles, stream: Stream) -> SourceFiles:
    """Add a substitute for the folder of a stream stored in a common file, beside its stamps."""
    if stream in source_files.folders:
        return source_files
    traits = source_files.layout.traits
    by_packets = traits.packet_poses and Stream.OXTS in source_files.folders
    if stream is Stream.POSE and by_packets:
        folder = source_files.folders[Stream.OXTS]
    elif stream is Stream.LABELS and traits.world_boxes:
        numbers = source_files.folders[Stream.SCAN].numbers
        folder = _substitute(source_files.stamps_path(Stream.SCAN), numbers)
    elif traits.tracklets:
        folder = _substitute(_tracklet_stamps(source_files), sorted(tracklets_of(source_files)))
    else:
        stamps = LAYOUTS[source_files.layout].stamps
        path = next((path for path in source_files.texts if path.name == stamps), PurePosixPath())
        folder = _substitute(path, _lines(source_files, stream))
    return replace(source_files, folders={**source_files.folders, stream: folder})


def _substitute(stamps: PurePosixPath, numbers: Iterable[int]) -> Folder:
    """Return a folder without files of its own, in the folder of a file of stamps."""
    frames = tuple(numbers)
    return Folder(stamps, names.SIX_DIGITS, frames, frames)


def _tracklet_stamps(source_files: SourceFiles) -> PurePosixPath:
    """Return the file whose stamps tracklets use: see RawRecording."""
    scans = source_files.folders.get(Stream.SCAN)
    if scans is not None and scans.numbers:
        return source_files.stamps_path(Stream.SCAN)
    drives = (path.parent for path in source_files.texts if path.name == names.RAW_TRACKLETS)
    return next(drives, PurePosixPath()) / names.RAW_LABEL_STAMPS


def tracklets_of(source_files: SourceFiles) -> dict[int, list[Cuboid]]:
    """Return the boxes of a raw drive by frame, from the tracklets in its bag; {} if invalid."""
    for path, text in source_files.texts.items():
        if path.name == names.RAW_TRACKLETS:
            try:
                return cuboids_by_frame(parse_tracklets(text.encode(), Path(path)))
            except BadFileError:
                break  # to-bag has reported it, and made no labels of it
    return {}


def tracklets_by_stamp(recordings: Iterable[SourceFiles]) -> dict[int, dict[int, Cuboid]]:
    """Return the boxes of raw drives by the stamp of their frame's message, and by track."""
    by_stamp: dict[int, dict[int, Cuboid]] = {}
    for source_files in recordings:
        boxes = tracklets_of(source_files)
        if boxes:
            stamps, numbers = StampNumbers(source_files).pairs(Stream.LABELS)
            for stamp_ns, number in zip(stamps.tolist(), numbers.tolist(), strict=True):
                by_stamp[stamp_ns] = {
                    box.track_id: box for box in boxes[number] if box.track_id is not None
                }
    return by_stamp


def absent_frames(source_files: SourceFiles) -> tuple[Loss, ...]:
    """Return the frames that the recording has no file of, as its folder reports them.

    They are those that the stream's file of stamps lists, or without one those that other streams
    have. Of a bag of a part of the recording they are those within that part.
    """
    own = source_files.folders.keys() & UNNUMBERED
    groups = [source_files.folders.keys() - own, *({stream} for stream in own)]
    return tuple(loss for streams in groups for loss in _absent_of(source_files, streams))


def _absent_of(source_files: SourceFiles, streams: Collection[Stream]) -> Iterator[Loss]:
    """Yield the frames that streams with common numbers have no file of, a loss a stream."""
    indexed = {*streams} - {*LABEL_STREAMS}  # of labels no file lists the frames
    folders = {s: folder for s, folder in source_files.folders.items() if s in indexed}
    carried = [number for folder in folders.values() for number in folder.carried]
    if source_files.times is not None or not carried:
        return
    partial = any(folder.carried != folder.numbers for folder in folders.values())
    span = {*range(min(carried), max(carried) + 1)} if partial else None
    lines = source_files.layout.traits.line_streams - {Stream.LABELS}
    lines = frozenset() if UNNUMBERED.issuperset(streams) else lines
    common = {n for stream in lines for n in _lines(source_files, stream)}
    common.update(*(folder.numbers for folder in folders.values()))
    for stream, folder in folders.items():
        listed = _listed(source_files, stream)
        gaps = sorted((common if listed is None else listed).difference(folder.numbers))
        absent = tuple(gaps if span is None else (number for number in gaps if number in span))
        # A stream that has files here, and none in the bag, was not selected.
        has_no_file = listed is not None and not (span or listed).intersection(folder.numbers)
        if absent and (folder.carried or has_no_file):
            text = f'{folder.path}: no {stream.value} for frames {{}}, which other streams have'
            if listed is not None:
                name = source_files.stamps_path(stream).name
                text = f'{folder.path}: no file for frames {{}}, which {name} lists'
            yield Loss(stream.value, len(absent), text, absent)


def _listed(source_files: SourceFiles, stream: Stream) -> set[int] | None:
    """Return the numbers that a stream's file of stamps lists; None without the file."""
    path = source_files.stamps_path(stream)
    if source_files.layout.traits.clock is Clock.NOMINAL or path not in source_files.texts:
        return None
    folder = source_files.folders[stream]
    if path.parent != folder.path.parent:
        return set()  # of another stream, which lists its own files
    first = LAYOUTS[source_files.layout].first_file(source_files.name)
    least = min([first, *folder.numbers[:1]])
    first = folder.numbers[0] if first and folder.numbers and stream in UNNUMBERED else least
    return {number for number in source_files.file_stamps(stream) or () if number >= first}


def _lines(source_files: SourceFiles, stream: Stream) -> Iterable[int]:
    """Return the frames with lines in the common file of a stream, ascending."""
    folder = LAYOUTS[source_files.layout].line_folders.get(stream)
    for path, text in source_files.texts.items():
        if folder in {path.parent.name, path.stem}:
            lines = text.splitlines()
            numbered = stream in source_files.layout.traits.numbered_lines
            return sorted({*row_frames(lines)}) if numbered else range(len(lines))
    return ()


def row_frames(lines: Iterable[str]) -> Iterator[int]:
    """Yield the frame at the beginning of each row, such as of a tracking label file."""
    for line in lines:
        word = line.split(maxsplit=1)[0] if line.strip() else ''
        if word.isdecimal() and len(word) <= names.FRAME_DIGITS:
            yield int(word)


class NumberedTopic(NamedTuple):
    """A topic whose messages are samples.

    Attributes:
        stream: Their stream.
        log_ns: (N,) log times, nanoseconds, ascending.
        stamps_ns: (N,) the samples' own stamps.
        numbers: (N,) KITTI's file numbers, UNKNOWN for a message with an unknown stamp.
    """

    stream: Stream
    log_ns: Int64Array
    stamps_ns: Int64Array
    numbers: Int64Array

    @property
    def is_numbered(self) -> bool:
        """True if any number is known."""
        return bool((self.numbers != UNKNOWN).any())


class NumberedBag(NamedTuple):
    """The messages of a bag written by to-bag with KITTI's numbers.

    Attributes:
        source_files: The source files of the recording.
        topics: By name; topics of the recording as a whole are absent.
    """

    source_files: SourceFiles
    topics: Mapping[str, NumberedTopic]

    @property
    def frames(self) -> Int64Array:
        """(N,) the numbers of its frames, ascending; see samples.FRAME_STREAMS."""
        return frames_of(self.by_stream(), common=self.common)

    @property
    def common(self) -> bool:
        """True if a number is the same time in all streams; not in a raw extract."""
        return has_common_numbers(self.source_files)

    @property
    def clock(self) -> Clock:
        """The meaning of its stamps."""
        return clock_of(self.source_files)

    def frames_at(self, stamps_ns: Int64Array, topics: Collection[str]) -> Int64Array:
        """Return (N,) the frame of each of (N,) messages.

        Args:
            stamps_ns: (N,) log times of the messages of some topics, ascending; those in the index
                of a damaged bag may differ from those of its messages.
            topics: Their names.
        """
        if not self.common:
            return nearest_frames(stamps_ns, *self._reference())
        framed = {name: t for name, t in self.topics.items() if t.stream not in UNNUMBERED}
        log_ns = np.concatenate([topic.log_ns for topic in framed.values()])
        numbers = np.concatenate([topic.numbers for topic in framed.values()])
        order = np.lexsort((numbers, log_ns))
        last = np.searchsorted(log_ns[order], stamps_ns, 'right') - 1
        frames = frame_runs(numbers[order])[np.maximum(last, 0)]
        for topic in (framed[name] for name in topics if name in framed):
            is_known = (topic.numbers != UNKNOWN) & np.isin(topic.log_ns, stamps_ns)
            frames[np.searchsorted(stamps_ns, topic.log_ns[is_known])] = topic.numbers[is_known]
        return frames

    def _reference(self) -> tuple[Int64Array, Int64Array]:
        """Return log times and numbers of the stream that defines frames without common numbers."""
        present = self.by_stream()
        stream = next(stream for stream in FRAME_STREAMS if len(present.get(stream, ())))
        topic = next(t for t in self.topics.values() if t.stream is stream and t.is_numbered)
        is_known = topic.numbers != UNKNOWN
        log_ns = topic.log_ns[is_known]
        if stream is Stream.SCAN and self.source_files.scan_stamp is ScanStamp.START:
            # Images come after facing forward: between both is the middle of a frame.
            log_ns = log_ns + self.source_files.period_ns // 4
        return log_ns, frame_runs(topic.numbers[is_known])

    def by_stream(self) -> dict[Stream, Int64Array]:
        """Return by stream (N,) the file numbers of its topics, ascending."""
        numbers: dict[Stream, list[Int64Array]] = {}
        for topic in self.topics.values():
            numbers.setdefault(topic.stream, []).append(topic.numbers[topic.numbers != UNKNOWN])
        # Not np.unique, whose import of numpy.ma takes longer than sorting a million numbers.
        return {
            stream: np.array(sorted({*np.concatenate(parts).tolist()}), np.int64)
            for stream, parts in numbers.items()
        }


def has_common_numbers(source_files: SourceFiles) -> bool:
    """Return whether a file number is the same time in all streams of a recording."""
    return not source_files.layout.traits.is_extract(source_files.name)


def clock_of(source_files: SourceFiles) -> Clock:
    """Return the meaning of a recording's stamps, by the time files in its bag."""
    if source_files.times is not None:
        return Clock.UTC
    files = {path.name for path in source_files.texts}
    is_stamped = LAYOUTS[source_files.layout].stamps in files
    return source_files.layout.traits.clock if is_stamped else Clock.NOMINAL


def number_bag(
    bag: BagSource,
    log_ns: Mapping[str, Int64Array],
    *,
    source_files: SourceFiles | None = None,
    by_header: bool = True,
) -> NumberedBag | None:
    """Map the messages of a bag to KITTI's numbers.

    Args:
        bag: Any bag.
        log_ns: Log times by topic, (N,) nanoseconds, ascending.
        source_files: Its source files, if already read.
        by_header: Whether a bag with other log times is read to get the stamps in its headers.

    Returns:
        None for a bag that was not written by to-bag, or whose stamps are not those of its
        recording: its frames are numbered by position.

    Raises:
        OSError: It cannot be read.
    """
    try:
        source_files = source_files or find_source_files(bag)
        if source_files is None:
            return None
        streams = {
            row.topic: row.stream
            for row in own_topics().values()
            if row.stream in FRAME_STREAMS or row.stream in source_files.folders
        }
        mapped = StampNumbers(source_files)
        topics = _by_log(mapped, {t: (streams[t], log_ns[t]) for t in streams if t in log_ns})
        if by_header and not _is_numbered(topics):
            topics = _by_header(bag, mapped, streams)
    except OSError:
        raise
    except Exception:  # noqa: BLE001 - a description may hold anything; reading the bag names damage
        return None
    return NumberedBag(source_files, topics) if _is_numbered(topics) else None


def _is_numbered(topics: Mapping[str, NumberedTopic]) -> bool:
    return any(topic.stream in FRAME_STREAMS and topic.is_numbered for topic in topics.values())


def _by_log(
    mapped: StampNumbers, topics: Mapping[str, tuple[Stream, Int64Array]]
) -> dict[str, NumberedTopic]:
    """Number by log time, which is the sample's own stamp in a bag written by to-bag."""
    return {
        name: NumberedTopic(stream, log_ns, log_ns, mapped.of(stream, log_ns))
        for name, (stream, log_ns) in topics.items()
    }


def _by_header(
    bag: BagSource, mapped: StampNumbers, streams: Mapping[str, Stream]
) -> dict[str, NumberedTopic]:
    """Number by the stamps in headers, and by the names in texts."""
    rows_by_topic: dict[str, list[tuple[int, int, int]]] = {}
    with open_messages(bag, set(streams), must_read=False) as messages:
        for message in messages:
            stamp_ns, number = message.stamp_ns, UNKNOWN
            try:
                if own_topics()[message.topic].is_frame_text:
                    decoded = messages.typestore.deserialize_cdr(message.data, message.msgtype)
                    text = decoders()[message.topic](decoded, BagContext(path_of(bag)))
                    number = _named(text, mapped.source_files, streams[message.topic])
                elif message.msgtype not in HEADLESS:
                    stamp_ns, _ = peek_header(message.data)
                else:
                    continue
            except Exception:  # noqa: BLE001, S112 - damage is reported where the bag is read
                continue
            row = (message.stamp_ns, stamp_ns, number)
            rows_by_topic.setdefault(message.topic, []).append(row)
    topics = {}
    for name, rows in rows_by_topic.items():
        log_ns, stamps_ns, numbers = np.array(rows, dtype=np.int64).T
        if not own_topics()[name].is_frame_text:
            order = np.argsort(stamps_ns, kind='stable')
            numbers[order] = mapped.of(streams[name], stamps_ns[order])
        topics[name] = NumberedTopic(streams[name], log_ns, stamps_ns, numbers)
    return topics


def _named(text: TextFile, source_files: SourceFiles, stream: Stream) -> int:
    """Return the frame of a text, by the name of its file or by its first column."""
    if stream in source_files.layout.traits.line_streams:
        return (
            next(row_frames(text.text.splitlines()), UNKNOWN)
            if stream is Stream.LABELS
            else UNKNOWN
        )
    owner = owner_of(PurePosixPath(text.name), source_files.folders)
    return UNKNOWN if owner is None else owner[1]


# Part of the recording in a bag written by to-bag, from a first to a last frame.


def select_part(
    source: BagSource, source_files: SourceFiles, selection: SelectionOptions
) -> SourceFiles:
    """Return source files whose selected ones are those that to-bag writes for a selection.

    Raises:
        UsageError: The selection contains none of its frames.
    """
    if selection.is_whole:
        return source_files
    mapped = StampNumbers(source_files)
    streams = {}
    for stream in dict.fromkeys((*FRAME_STREAMS, *source_files.folders)):
        stamps_ns, numbers = mapped.pairs(stream)
        if len(numbers):
            streams[stream] = StreamIndex(numbers, stamps_ns)
    if not streams:
        raise nothing_selected(source, np.empty(0, np.int64))
    own = {s: index for s, index in streams.items() if s not in UNNUMBERED} or streams
    window = select_window(own, selection, common=has_common_numbers(source_files))
    masks = {stream: window.takes(index) for stream, index in own.items()}
    masks |= masks_around(streams, source_files.turns() or {}, masks, window)
    selected = {s: frozenset(streams[s].numbers[mask].tolist()) for s, mask in masks.items()}
    frames = [stream for stream in FRAME_STREAMS if stream in streams]
    if not any(selected[stream] for stream in frames):
        numbers = np.concatenate([np.empty(0, np.int64), *(streams[s].numbers for s in frames)])
        raise nothing_selected(source, numbers)
    calibrations = source_files.calibrations
    folder = source_files.folders.get(Stream.CALIBRATION)
    if folder is not None:
        paths = {folder.file(number) for number in selected.get(Stream.CALIBRATION, ())}
        calibrations = {path: text for path, text in calibrations.items() if path in paths}
    return replace(source_files, selected=selected, calibrations=calibrations)


def select_times(
    source: BagSource, source_files: SourceFiles, topic: str, selection: SelectionOptions
) -> SelectionOptions:
    """Return a selection with the stamps of a topic's samples in place of KITTI's file numbers.

    Raises:
        UsageError: The topic has no sample of these numbers.
    """
    numbered = number_bag(source, bag_stamps(source), source_files=source_files)
    samples = None if numbered is None else numbered.topics.get(topic)
    if samples is None or not samples.is_numbered:
        return selection
    bounds: list[Bound | None] = []
    for bound, compare, outer in (
        (selection.start, np.greater_equal, np.min),
        (selection.end, np.less_equal, np.max),
    ):
        if bound is not None and bound.frame is not None:
            stamps_ns = samples.stamps_ns[compare(samples.numbers, bound.frame)]
            if not len(stamps_ns):
                raise nothing_selected(source, samples.numbers)
            bounds.append(Bound(stamp_ns=int(outer(stamps_ns))))
        else:
            bounds.append(bound)
    return replace(selection, start=bounds[0], end=bounds[1])


def nothing_selected(source: BagSource, numbers: Int64Array) -> UsageError:
    """Return the error for a selection without frames."""
    span = f'frames {numbers.min()} to {numbers.max()}' if len(numbers) else 'no numbered frames'
    return UsageError(f'{path_of(source)}: the selection takes no frame; it has {span}')
