# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a recording from a bag written by to-bag, byte for byte."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..bags.bag_files import opened, path_of
from ..bags.reader import Decoder, bag_stamps, open_messages
from ..files.image_files import JPEG_SIGNATURE
from ..files.local_files import crc32
from ..files.output_rules import refusal_of
from ..files.staging import staged
from ..files.threads import ordered_map, worker_count
from ..importer.kitti_frames import ImportReport, with_indices
from ..kitti import names
from ..kitti.names import JPEGS, PNG
from ..kitti.opening import keep_all_but_data_sets
from ..kitti.scan_file import (
    format_line_scan,
    format_point_labels,
    format_points,
    format_scan,
    format_scan_text,
)
from ..kitti.scan_grid import GridTally
from ..messages.cdr import stamp_ns_of
from ..messages.naming import FILE_CHECKS, POINTS, REST, BagContext
from ..messages.source_texts import decode_file_check
from ..messages.topics import decoders, own_topics
from ..model.errors import (
    KittiRos2Error,
    Loss,
    LossTally,
    UsageError,
    damage,
    format_numbers,
    merged,
)
from ..model.samples import Image, LineScan
from ..model.streams import Layout, PngForm, Stream
from .compact_scans import ScanRests, as_in_file
from .missing_files import make_by_plan
from .numbering import has_common_numbers, number_bag
from .reencoded_images import open_reencoded
from .schedule import frames_of
from .source_files import (
    lost_file,
    owner_of,
    shown,
    write_new,
    write_texts,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import BagSource, OpenBag
    from ..bags.reader import BagMessage, BagMessages
    from ..model.samples import Scan, ScanRest
    from ..model.streams import ScanColumns
    from .source_files import SourceFiles


# The contents of files with one sample, as KITTI has them.


def format_sample(
    decode: Callable[[], Scan | LineScan | Image],
    path: Path,
    columns: ScanColumns | None = None,
    rest: ScanRest | None = None,
    grid: GridTally | None = None,
) -> tuple[bytes | memoryview, str]:
    """Format a sample's file, and describe its difference from KITTI's; '' if there is none.

    The labels of a scan's points are written to a file of their own.

    Args:
        decode: Returns the sample.
        path: Path of the file.
        columns: Columns of scans; None are KITTI's.
        rest: What the file of a scan is besides its cloud; None of clouds that are not compact.
        grid: Rounds a scan to KITTI's grid that a codec moved off it; None leaves it.

    Raises:
        ValueError: The message cannot be decoded, or the file of labels cannot be written.
        BadFileError: The PNG in the message is damaged.
    """
    sample = decode()
    if isinstance(sample, Image):
        return sample.data, ''
    if isinstance(sample, LineScan):
        return format_line_scan(sample), ''
    difference = f'for {POINTS} is missing: {sample.difference}' if sample.difference else ''
    if rest is not None:
        sample = as_in_file(sample, rest)
        difference = sample.difference
    elif grid is not None:
        sample = grid.snapped(sample)
    if sample.labels is not None:
        labels = path.parents[1] / names.POINT_LABELS / f'{path.stem}{names.LABEL}'
        error = write_new(labels, format_point_labels(sample.labels))
        if error:
            raise ValueError(error)
    is_text = path.suffix.lower() == names.TXT
    if is_text:
        return format_scan_text(sample.points), difference
    if columns is None:
        return format_scan(sample.points), difference
    return format_points(sample, columns), difference


# The files, written in several threads.
#
# Images stored as pixels become PNG files of the same pixels; the text scans of raw extract get the
# same numbers.

_IN_COMMON_FILES = frozenset({Stream.OXTS, Stream.POSE, Stream.LABELS})
"""Streams that some layouts store as lines of one file."""
_AS_PNG = 'written as PNG, for the bag has pixels, no JPEG'
_AS_GREY = "written grey, not in KITTI's colours"


@dataclass(frozen=True)
class _File:
    """A file to be written; its content is computed by the writing thread.

    Attributes:
        change: How an image is not KITTI's own file; empty if it may be.
    """

    stream: Stream
    number: int
    path: PurePosixPath
    content: Callable[[], tuple[bytes | memoryview, str]]
    topic: str
    stamp_ns: int
    change: str = ''


@dataclass(frozen=True)
class _Written:
    """A written file, or the reason why it was not written; its difference from KITTI's file.

    Attributes:
        check: Of a PNG file made of pixels: its size and CRC-32.
    """

    file: _File
    size_bytes: int
    error: str = ''
    difference: str = ''
    check: tuple[int, int] | None = None


def _is_misnamed(message: Any, path: PurePosixPath) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether a message has a JPEG for the file of a PNG."""
    if not hasattr(message, 'format') or path.suffix.lower() != PNG:
        return False
    is_jpeg: bool = message.data[: len(JPEG_SIGNATURE)].tobytes() == JPEG_SIGNATURE
    return is_jpeg


class _Forms(NamedTuple):
    """The form of the files that are made of other values than theirs.

    Attributes:
        png: Of PNG files made of pixels; None is KITTI's.
        snap: Whether scans that a codec rounded are rounded to KITTI's grid again.
    """

    png: PngForm | None
    snap: bool


def restored_topics(present: Collection[str]) -> set[str]:
    """Return the topics to read; pixels and other clouds only without the file's own."""
    rows = (row for row in own_topics().values() if row.restores and not row.latched)
    topics = {row.topic for row in rows}.intersection(present)
    if POINTS in present:
        scans = {topic for topic in topics if own_topics()[topic].stream is Stream.SCAN}
        topics -= scans - {POINTS}
    topics = {topic for topic in topics if f'{topic}/compressed' not in present}
    checks = {f'{FILE_CHECKS}{own_topics()[topic].stream.value}' for topic in topics}
    return topics | {*checks, REST}.intersection(present)


def restore(
    recordings: Sequence[tuple[BagSource, SourceFiles]],
    out: Path,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
    *,
    png: PngForm | None = None,
    snap: bool = True,
    overwrite: bool = False,
    fsync: bool = True,
) -> list[ImportReport]:
    """Restore the recordings in bags written by to-bag, in one data set.

    Args:
        recordings: Each bag with its source files.
        out: The data set's folder, absent or empty unless it is overwritten.
        progress: Called with the files and the bytes written so far of one bag.
        png: The form of PNG files made of pixels; None is KITTI's.
        snap: Whether scans that a codec rounded are rounded to KITTI's grid again.
        overwrite: Whether a data set in the folder may be replaced.
        fsync: Whether the finished data set outlasts a power cut.

    Raises:
        BadBagError: A bag cannot be read.
        UsageError: Two bags contain the same recording, or differ in a file they share.
        OutputExistsError: The folder is not empty.
        OutputError: It cannot be written.
    """
    paths: dict[tuple[Layout, str], Path] = {}
    for bag, source_files in recordings:
        path = path_of(bag)
        other = paths.setdefault((source_files.layout, source_files.name), path)
        if other is not path:
            name = source_files.name
            raise UsageError(f'{path}: holds {name}, as {other} does; give one of them')
    refusal = refusal_of(keep_all_but_data_sets(len(recordings)), overwrite=overwrite)
    with staged(out, refusal, fsync=fsync) as stage:
        forms = _Forms(png, snap)
        return [_restore(bag, files, stage, forms, progress) for bag, files in recordings]


def _restore(
    source: BagSource,
    source_files: SourceFiles,
    stage: Path,
    forms: _Forms,
    progress: Callable[[int, int], None],
) -> ImportReport:
    texts = (*source_files.texts.items(), *source_files.calibrations.items())
    refused = write_texts(stage / source_files.root, texts, path_of(source))
    with (
        opened(source) as bag,
        open_messages(bag, restored_topics(source_files.topics), must_read=False) as messages,
    ):
        writer = _Writer(messages, source_files, stage / source_files.root, bag, forms)
        files = ordered_map(writer.write, writer.files(), worker_count())
        with closing(files):
            for done, written in enumerate(files, 1):
                writer.take(written)
                progress(done, writer.size_bytes)
        planned, notes = _write_by_plan(bag, source_files, stage)
        made = {**planned, **writer.write_parts()}
        report = writer.report()
        damaged = damage(merged(source_files.damage, messages.losses), bag.path.name)
    return replace(
        report,
        losses=(*damaged, *_losses(source_files, made), *refused, *report.losses),
        notes=(*_other_notes(messages), *report.notes, *notes),
    )


def _other_notes(messages: BagMessages) -> Iterator[str]:
    """Yield the notes on a bag but those on what is a loss of the scans that it concerns."""
    for note in messages.notes:
        if not any(note.endswith(loss) for loss in messages.earlier_losses):
            yield note


def _losses(source_files: SourceFiles, made: Mapping[PurePosixPath, str]) -> list[Loss]:
    """Return the losses of source files; those of files that are made say how."""
    replaced = {lost_file(path): lost_file(path, f'; {how}') for path, how in made.items()}
    return [replaced.get(loss, loss) for loss in source_files.losses]


def _write_by_plan(
    bag: OpenBag, source_files: SourceFiles, stage: Path
) -> tuple[dict[PurePosixPath, str], tuple[str, ...]]:
    """Write the missing text files that a plan can make; return how each is made, and notes."""
    lost = {source_files.root / path: path for path in source_files.missing}
    frames = _frames_from_zero(bag, source_files) if lost else 0
    try:
        made = make_by_plan(bag, source_files.layout, source_files.name, lost, frames)
    except KittiRos2Error as error:
        return {}, (f'no plan makes the missing text files of other messages: {error}',)
    for path, data in made.items():
        write_new(stage / path, data)
    return {
        lost[path]: "a plan makes it of other messages, not as KITTI's own" for path in made
    }, ()


def _frames_from_zero(bag: OpenBag, source_files: SourceFiles) -> int:
    """Return the number of frames in a bag if they are numbered from 0 without a gap, else 0."""
    numbered = number_bag(bag, bag_stamps(bag), source_files=source_files)
    frames = [] if numbered is None else numbered.frames.tolist()
    return len(frames) if frames == [*range(len(frames))] else 0


@dataclass
class _FilesOfPixels:
    """PNG files that were made of pixels, compared with those that to-bag read.

    Attributes:
        checks: Size and CRC-32 of these, by path.
        numbers: Stream and number of the files that are made, by path.
        made: Their size and CRC-32, by path.
        asked: Whether their form was asked for.
    """

    asked: bool

    checks: dict[PurePosixPath, tuple[int, int]] = field(default_factory=dict)
    numbers: dict[PurePosixPath, tuple[Stream, int]] = field(default_factory=dict)
    made: dict[PurePosixPath, tuple[int, int]] = field(default_factory=dict)

    def notes(self) -> Iterator[str]:
        """Yield notes on those with other bytes, and on those that could not be compared."""
        if self.asked and not self.made:
            yield 'png changes nothing: the bag has the files of images, no pixels'
        for differs, text in (
            (True, "have other bytes than KITTI's files; the bag does not tell if other pixels"),
            (False, "are made of pixels; the bag does not tell the bytes of KITTI's files"),
        ):
            frames: dict[Stream, list[int]] = {}
            for path, check in self.made.items():
                own = self.checks.get(path)
                if own != check and (own is not None) is differs:
                    stream, number = self.numbers[path]
                    frames.setdefault(stream, []).append(number)
            for stream, numbers in frames.items():
                yield f'{stream.value} of frames {format_numbers(sorted(numbers))} {text}'


class _Writer:
    def __init__(
        self,
        messages: BagMessages,
        source_files: SourceFiles,
        root: Path,
        bag: OpenBag,
        forms: _Forms,
    ) -> None:
        self._bag = bag
        self._png = forms.png or source_files.layout.traits.png
        self._grid = GridTally(enabled=forms.snap)
        self._rests = ScanRests(self._scan_names, self._lose_text)
        self._exact: set[int] = set()
        self._messages = messages
        self._reencoded = open_reencoded(bag, messages.channels)
        self._pixels = _FilesOfPixels(asked=forms.png is not None and self._reencoded is None)
        self._source_files = source_files
        self._root = root
        streams = source_files.folders.keys()
        self._numbers = {stream: source_files.numbers_by_stamp(stream) for stream in streams}
        self._written: dict[Stream, set[int]] = {stream: set() for stream in streams}
        self._lost: dict[Stream, set[int]] = {stream: set() for stream in streams}
        self._left_out = {
            stream: frozenset(folder.carried) - source_files.requested(stream)
            for stream, folder in source_files.folders.items()
        }
        self._changes: dict[str, dict[Stream, set[int]]] = {}
        self._jpegs: dict[Stream, set[int]] = {}
        self._unnumbered: Counter[Stream] = Counter()
        self._counts = Counter({Stream.CALIBRATION.value: len(source_files.calibrations)})
        self._losses = LossTally()
        self._lines: dict[PurePosixPath, int] = {}
        self._parts: dict[PurePosixPath, dict[int, tuple[str, str]]] = {}
        self._differences: dict[str, set[int]] = {}
        self.size_bytes = 0

    def files(self) -> Iterator[_File]:
        """Yield the files in the messages, in their order."""
        decode = Decoder(self._messages.typestore, lent=True)
        has_rests = any(topic == REST for topic, _ in self._messages.channels)
        messages = self._rests.joined(self._decoded(decode), are_there=has_rests)
        for message, decoded in messages:
            if isinstance(decoded, ValueError):
                self._lose(message, str(decoded))
                continue
            if message.topic.startswith(FILE_CHECKS) and not own_topics()[message.topic].restores:
                self._take_check(decoded, message)
                continue
            file = (
                self._line(decoded, message)
                if own_topics()[message.topic].is_frame_text
                else self._sample(decoded, message)
            )
            if file is not None and file.number not in self._left_out[file.stream]:
                yield file

    def _decoded(self, decode: Decoder) -> Iterator[tuple[BagMessage, Any]]:
        """Yield the messages, each decoded or with the error; images of videos as Images."""
        reencoded = self._reencoded
        videos = None if reencoded is None else reencoded.videos
        for index, message in with_indices(self._messages):
            if videos is not None and message.topic in videos:
                for _, packet, image in videos.take(index, message, decode):
                    yield packet, image
                continue
            expected = own_topics()[message.topic].msgtype
            if reencoded is not None and message.topic in reencoded:
                expected = ''
            try:
                yield message, decode(message, expected)
            except ValueError as error:
                yield message, error
        if videos is not None:
            for _, packet, image in videos.rest():
                yield packet, image

    def _lose(self, message: BagMessage, reason: str) -> None:
        """Report a message without a file; to-bag logs a sample at its own stamp."""
        self._losses.lose(message.topic, message.stamp_ns, reason)
        stream = own_topics()[message.topic].stream
        numbers = (self._numbers.get(stream) or {}).get(message.stamp_ns)
        if numbers:
            self._lost[stream].add(numbers.pop(0))
        else:
            self._unnumbered[stream] += 1

    def _lose_text(self, message: BagMessage, reason: str) -> None:
        """Report a message that is only about a file."""
        self._losses.lose(message.topic, message.stamp_ns, reason)

    def _scan_names(self, stamp_ns: int) -> list[str]:
        numbers = (self._numbers.get(Stream.SCAN) or {}).get(stamp_ns, ())
        return [self._source_files.folders[Stream.SCAN].file(number).name for number in numbers]

    def _take_check(self, decoded: Any, message: BagMessage) -> None:  # noqa: ANN401
        folder = self._source_files.folders.get(own_topics()[message.topic].stream)
        try:
            name, check = decode_file_check(decoded)
        except ValueError as error:
            self._lose_text(message, str(error))
            return
        if folder is not None:
            self._pixels.checks[folder.path / name] = check

    def _line(self, decoded: Any, message: BagMessage) -> _File | None:  # noqa: ANN401
        """Make the file of a text of one frame, unless the whole file is known."""
        stream = own_topics()[message.topic].stream
        text = decoders()[message.topic](decoded, BagContext(self._bag.path))
        path = PurePosixPath(text.name)
        if path in self._source_files.texts and stream not in self._source_files.folders:
            self._counts[stream.value] += 1
            return None
        if path in self._source_files.missing:
            self._parts.setdefault(path, {})[message.stamp_ns] = message.topic, text.text
            return None
        owner = owner_of(path, self._source_files.folders)
        if owner is None or owner[0] is not stream:
            what = f'no {stream.value} file of {self._source_files.name}'
            self._lose(message, f'names a file {shown(text.name)}, which is {what}')
            return None
        # The log times of another recorder are not the samples' stamps, and map to no number.
        expected = (self._numbers[stream] or {}).get(message.stamp_ns)
        if expected and owner[1] not in expected:
            self._lose(message, f'names {path}, which has another stamp')
            return None
        digest = hash(text.text)
        if self._lines.get(path) == digest:
            return None  # a copy, as of a topic that a tool repeats in each part of a bag
        self._lines[path] = digest
        data = text.text.encode()
        return _File(stream, owner[1], path, lambda: (data, ''), message.topic, message.stamp_ns)

    def write_parts(self) -> dict[PurePosixPath, str]:
        """Write the missing files of which the bag has the lines of frames; return how, by path.

        Packets are by line: they need one for each frame.
        """
        folders = self._source_files.folders.values()
        frames = max((len(folder.numbers) for folder in folders), default=0)
        made = {}
        for path, parts in self._parts.items():
            topic = next(topic for topic, _ in parts.values())
            stream = own_topics()[topic].stream
            if stream is Stream.OXTS and len(parts) != frames:
                for stamp_ns in parts:
                    reason = f'a part of {path}, which the bag does not hold'
                    self._losses.lose(topic, stamp_ns, reason)
                continue
            text = ''.join(text for _, text in parts.values())
            if not write_new(self._root / path, text.encode()):
                self._counts[stream.value] += len(parts)
                made[path] = f'it is joined of the lines of {topic}'
        return made

    def _sample(self, decoded: Any, message: BagMessage) -> _File | None:  # noqa: ANN401
        stream = own_topics()[message.topic].stream
        stamp_ns = stamp_ns_of(decoded.header)
        numbers = (self._numbers.get(stream) or {}).get(stamp_ns)
        if not numbers:
            repeated = numbers is not None and f'another {stream.value} message has its stamp'
            self._lose(message, repeated or self._why_unnumbered(stream))
            return None
        number = numbers.pop(0)
        path = self._source_files.folders[stream].file(number)
        sample = partial(decoders()[message.topic], decoded, BagContext(path, png=self._png))
        has_pixels, change = hasattr(decoded, 'encoding'), ''
        if self._reencoded is not None and message.topic in self._reencoded:
            image = message.topic, stamp_ns, decoded
            sample = partial(self._reencoded.file, *image, self._png)
            has_pixels, change = True, self._reencoded.change(*image)
        if has_pixels:
            if path.suffix.lower() in JPEGS:  # pixels cannot become the bytes of a JPEG again
                path, change = path.with_suffix(PNG), change or _AS_PNG
            if not change:
                self._pixels.numbers[path] = stream, number
        elif _is_misnamed(decoded, path):
            self._jpegs.setdefault(stream, set()).add(number)
        columns = self._source_files.columns
        rest = self._rests.take(path.name) if stream is Stream.SCAN else None
        if rest is not None:
            self._exact.add(number)
        # Of clouds with a loss nothing else gives the files' values again.
        has_loss = self._messages.earlier_losses or self._source_files.compact
        grid = self._grid if has_loss else None
        content = partial(format_sample, sample, self._root / path, columns, rest, grid)
        return _File(stream, number, path, content, message.topic, message.stamp_ns, change)

    def _why_unnumbered(self, stream: Stream) -> str:
        folder = self._source_files.folders.get(stream)
        if folder is not None and self._numbers[stream] is None:
            streams = (self._source_files.stamped_as(stream), stream)
            paths = [self._source_files.stamps_path(stream) for stream in streams]
            path = next((path for path in paths if path in self._source_files.missing), paths[0])
            return f'its file number is unknown, for the bag does not hold {path}'
        return f'no file of {self._source_files.name} has this stamp'

    def write(self, file: _File) -> _Written:
        """Write a file; thread-safe for different paths."""
        try:
            content, difference = file.content()
        except (ValueError, KittiRos2Error) as error:
            return _Written(file, 0, str(error))
        refusal = write_new(self._root / file.path, content)
        check = (len(content), crc32(content)) if file.path in self._pixels.numbers else None
        return _Written(file, len(content), refusal, difference, check)

    def take(self, written: _Written) -> None:
        """Count a file."""
        stream = written.file.stream
        if written.error:
            self._lost.setdefault(stream, set()).add(written.file.number)
            self._losses.lose(written.file.topic, written.file.stamp_ns, written.error)
            return
        self._counts[stream.value] += 1
        if written.check is not None:
            self._pixels.made[written.file.path] = written.check
        if written.difference:
            self._differences.setdefault(written.difference, set()).add(written.file.number)
        self._written.setdefault(stream, set()).add(written.file.number)
        changes = [written.file.change] if written.file.change else []
        if stream in self._source_files.grey and not written.file.topic.endswith('/compressed'):
            changes.append(_AS_GREY)
        for change in changes:
            frames = self._changes.setdefault(change, {}).setdefault(stream, set())
            frames.add(written.file.number)
        self.size_bytes += written.size_bytes

    def report(self) -> ImportReport:
        """Report the written files, and those missing in the bag."""
        missing, notes = [], []
        for stream, folder in self._source_files.folders.items():
            written = self._written[stream]
            if stream is Stream.CALIBRATION:
                files = self._source_files.calibrations
                written = {number for number in folder.carried if folder.file(number) in files}
            requested = self._source_files.requested(stream)
            absent = sorted(requested - written - self._lost[stream])
            if len(absent) > self._unnumbered[stream]:
                text = f'the bag does not hold {stream.value} of frames {{}}'
                missing.append(Loss(stream.value, len(absent), text, tuple(absent)))
            others = sorted({*folder.numbers} - {*folder.carried})
            if others:
                numbers = format_numbers(others)
                notes.append(f'the bag was made without {stream.value} of frames {numbers}')
        missing += self._changed_scans(self._written.get(Stream.SCAN) or ())
        for difference, changed in self._differences.items():
            text = f"scans {{}} are not KITTI's own, {difference}"
            missing.append(Loss(Stream.SCAN.value, len(changed), text, tuple(sorted(changed))))
        missing += [*self._changed_line_scans(), *self._changed_images()]
        notes += [
            f'{stream.value} of frames {format_numbers(sorted(frames))} are JPEGs in files named'
            f" {PNG}: not KITTI's own pixels if another program has encoded them"
            for stream, frames in self._jpegs.items()
        ]
        notes += [*self._pixels.notes(), *self._grid.notes(Stream.SCAN.value)]
        if self._reencoded is not None:
            notes += self._reencoded.videos.notes()
        return ImportReport(
            layout=self._source_files.layout,
            name=self._source_files.name,
            counts=dict(self._counts),
            frames=self._count_frames(),
            size_bytes=self.size_bytes,
            losses=(*self._losses.losses(), *missing),
            notes=tuple(notes),
        )

    def _changed_images(self) -> Iterator[Loss]:
        """Yield the losses of the images that are not KITTI's own files."""
        for change, by_stream in self._changes.items():
            for stream, frames in by_stream.items():
                text = f'{stream.value} of frames {{}} is {change}'
                yield Loss(stream.value, len(frames), text, tuple(sorted(frames)))

    def _changed_scans(self, scans: Collection[int]) -> list[Loss]:
        """Return what to-bag, or a program after it, has changed in all written scans."""
        deskew, columns = self._source_files.deskew, self._source_files.columns
        texts = []
        if deskew is not None:
            texts.append(f"scans {{}} are written {deskew.state}, not as in KITTI's files")
        if columns is not None and columns.skipped:
            skipped = columns.describe_skipped()
            texts.append(f'scans {{}} are written without {skipped}, which to-bag left out')
        changed = [(text, tuple(sorted(scans))) for text in texts]
        reasons = self._reasons_of(Stream.SCAN)
        if self._source_files.compact:
            reasons = [f'they are rounded to 1 mm and 0.01, and {REST} does not say from what']
        inexact = tuple(sorted({*scans} - self._exact))
        changed += [(f"scans {{}} are not KITTI's own: {reason}", inexact) for reason in reasons]
        return [
            Loss(Stream.SCAN.value, len(numbers), text, numbers)
            for text, numbers in changed
            if numbers
        ]

    def _changed_line_scans(self) -> Iterator[Loss]:
        """Yield what a program after to-bag has changed in all written line scans."""
        numbers = tuple(sorted(self._written.get(Stream.SICK) or ()))
        for reason in self._reasons_of(Stream.SICK) if numbers else ():
            text = f"scans {{}} are not KITTI's own: {reason}"
            yield Loss(Stream.SICK.value, len(numbers), text, numbers)

    def _reasons_of(self, stream: Stream) -> list[str]:
        """Return what the messages of a stream had lost before they were stored."""
        topics = [row.topic for row in own_topics().values() if row.stream is stream]
        starts = tuple(f'{topic} is ' for topic in topics)
        return [loss for loss in self._messages.earlier_losses if loss.startswith(starts)]

    def _count_frames(self) -> int:
        """Count the written frames, in files of their own or in a common one."""
        stamps = bag_stamps(self._bag)
        numbered = number_bag(self._bag, stamps, source_files=self._source_files)
        common = numbered.by_stream() if numbered is not None else {}
        written = {s: np.array([*frames]) for s, frames in self._written.items() if frames}
        numbers = {s: frames for s, frames in common.items() if s in _IN_COMMON_FILES}
        selected = self._source_files.selected
        if selected is not None:
            numbers = {
                s: frames[np.isin(frames, [*selected.get(s, ())])] for s, frames in numbers.items()
            }
        return len(frames_of(numbers | written, common=has_common_numbers(self._source_files)))
