# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of a bag written by to-bag back to KITTI, byte for byte.

Images stored as pixels become PNG files of the same pixels; the text scans of raw extract get the
same numbers.
"""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.decoding import Decoder
from ..bags.reader import bag_stamps, open_messages, opened, path_of
from ..exporter.schedule import frames_of
from ..files.staging import staged
from ..files.workers import ordered_map, worker_count
from ..importer.report import ImportReport, LossTally, damage, merged
from ..kitti.names import JPEGS, PNG
from ..kitti.replacing import keep_all_but_data_sets
from ..messages.header import stamp_ns_of
from ..messages.moment import Origin
from ..messages.source import POINTS
from ..messages.topics import decoders, own_topics
from ..model.errors import KittiRos2Error, UsageError
from ..model.losses import Loss, format_numbers
from ..model.streams import Stream
from .file_contents import format_sample
from .folders import owner_of, shown
from .numbering import has_common_numbers, number_bag
from .source_texts import write_new, write_texts

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence
    from pathlib import Path

    from ..bags.reader import BagMessage, BagMessages, BagSource, OpenBag
    from ..model.layouts import Layout
    from .blueprint import Blueprint

_IN_COMMON_FILES = frozenset({Stream.OXTS, Stream.POSE, Stream.LABELS})
"""Streams that some layouts store as lines of one file."""


@dataclass(frozen=True)
class _File:
    """A file to be written; its content is computed by the writing thread."""

    stream: Stream
    number: int
    path: PurePosixPath
    content: Callable[[], tuple[bytes | memoryview, str]]
    topic: str
    stamp_ns: int


@dataclass(frozen=True)
class _Written:
    """A written file, or the reason why it was not written; its difference from KITTI's file."""

    file: _File
    size_bytes: int
    error: str = ''
    difference: str = ''


def _topics(present: Collection[str]) -> set[str]:
    """Return the topics to read; pixels and other clouds only without the file's own."""
    rows = (row for row in own_topics().values() if row.restores and not row.latched)
    wanted = {row.topic for row in rows}.intersection(present)
    if POINTS in present:
        scans = {topic for topic in wanted if own_topics()[topic].stream is Stream.SCAN}
        wanted -= scans - {POINTS}
    return {topic for topic in wanted if f'{topic}/compressed' not in present}


def restore(
    recordings: Sequence[tuple[BagSource, Blueprint]],
    out: Path,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
    *,
    overwrite: bool = False,
    fsync: bool = True,
) -> list[ImportReport]:
    """Restore the recordings in bags written by to-bag, in one data set.

    Args:
        recordings: Each bag with the layout of its recording.
        out: The data set's folder, absent or empty unless it is overwritten.
        progress: Called with the files and the bytes written so far of one bag.
        overwrite: Whether a data set in the folder may be replaced.
        fsync: Whether the finished data set outlasts a power cut.

    Raises:
        BadBagError: A bag cannot be read.
        UsageError: Two bags contain the same recording, or differ in a file they share.
        OutputExistsError: The folder is not empty.
        OutputError: It cannot be written.
    """
    known: dict[tuple[Layout, str], Path] = {}
    for bag, blueprint in recordings:
        path = path_of(bag)
        other = known.setdefault((blueprint.layout, blueprint.name), path)
        if other is not path:
            raise UsageError(f'{path}: holds {blueprint.name}, as {other} does; give one of them')
    refusal = keep_all_but_data_sets(len(recordings)) if overwrite else None
    with staged(out, refusal, fsync=fsync) as stage:
        return [_restore(bag, blueprint, stage, progress) for bag, blueprint in recordings]


def _restore(
    source: BagSource, blueprint: Blueprint, stage: Path, progress: Callable[[int, int], None]
) -> ImportReport:
    texts = (*blueprint.texts.items(), *blueprint.calibrations.items())
    refused = write_texts(stage / blueprint.root, texts, path_of(source))
    with (
        opened(source) as bag,
        open_messages(bag, _topics(blueprint.topics), must_read=False) as messages,
    ):
        writer = _Writer(messages, blueprint, stage / blueprint.root, bag)
        files = ordered_map(writer.write, writer.files(), worker_count())
        with closing(files):
            for done, written in enumerate(files, 1):
                writer.take(written)
                progress(done, writer.size_bytes)
        report = writer.report()
        damaged = damage(merged(blueprint.damage, messages.losses), bag.path.name)
    return replace(report, losses=(*damaged, *blueprint.losses, *refused, *report.losses))


class _Writer:
    def __init__(
        self, messages: BagMessages, blueprint: Blueprint, root: Path, bag: OpenBag
    ) -> None:
        self._bag = bag
        self._messages = messages
        self._blueprint = blueprint
        self._root = root
        self._numbers = {stream: blueprint.numbers_by_stamp(stream) for stream in blueprint.folders}
        self._written: dict[Stream, set[int]] = {stream: set() for stream in blueprint.folders}
        self._lost: dict[Stream, set[int]] = {stream: set() for stream in blueprint.folders}
        self._left_out = {
            stream: frozenset(folder.carried) - blueprint.requested(stream)
            for stream, folder in blueprint.folders.items()
        }
        self._grey: dict[Stream, set[int]] = {}
        self._as_png: dict[Stream, set[int]] = {}
        self._unplaced: Counter[Stream] = Counter()
        self._counts = Counter({Stream.CALIBRATION.value: len(blueprint.calibrations)})
        self._losses = LossTally()
        self._differences: dict[str, set[int]] = {}
        self.size_bytes = 0

    def files(self) -> Iterator[_File]:
        """Yield the files in the messages, in their order."""
        decode = Decoder(self._messages.typestore, lent=True)
        for message in self._messages:
            row = own_topics()[message.topic]
            try:
                decoded = decode(message, row.msgtype)
            except ValueError as error:
                self._lose(message, str(error))
                continue
            file = (
                self._line(decoded, message)
                if row.is_frame_text
                else self._sample(decoded, message)
            )
            if file is not None and file.number not in self._left_out[file.stream]:
                yield file

    def _lose(self, message: BagMessage, reason: str) -> None:
        """Report a message without a file; to-bag logs a sample at its own stamp."""
        self._losses.lose(message.topic, message.stamp_ns, reason)
        stream = own_topics()[message.topic].stream
        found = (self._numbers.get(stream) or {}).get(message.stamp_ns)
        if found:
            self._lost[stream].add(found.pop(0))
        else:
            self._unplaced[stream] += 1

    def _line(self, decoded: Any, message: BagMessage) -> _File | None:  # noqa: ANN401
        """Make the file of a text of one frame, unless the whole file is known."""
        stream = own_topics()[message.topic].stream
        text = decoders()[message.topic](decoded, Origin(self._bag.path))
        path = PurePosixPath(text.name)
        if path in self._blueprint.texts and stream not in self._blueprint.folders:
            self._counts[stream.value] += 1
            return None
        if path in self._blueprint.missing:
            self._lose(message, f'a part of {path}, which the bag does not hold')
            return None
        owner = owner_of(path, self._blueprint.folders)
        if owner is None or owner[0] is not stream:
            what = f'no {stream.value} file of {self._blueprint.name}'
            self._lose(message, f'names a file {shown(text.name)}, which is {what}')
            return None
        # The log times of another recorder are not the samples' stamps, and map to no number.
        expected = (self._numbers[stream] or {}).get(message.stamp_ns)
        if expected and owner[1] not in expected:
            self._lose(message, f'names {path}, which has another stamp')
            return None
        data = text.text.encode()
        return _File(stream, owner[1], path, lambda: (data, ''), message.topic, message.stamp_ns)

    def _sample(self, decoded: Any, message: BagMessage) -> _File | None:  # noqa: ANN401
        stream = own_topics()[message.topic].stream
        found = (self._numbers.get(stream) or {}).get(stamp_ns_of(decoded.header))
        if not found:
            self._lose(message, self._why_unplaced(stream))
            return None
        number = found.pop(0)
        path = self._blueprint.folders[stream].file(number)
        sample = partial(decoders()[message.topic], decoded, Origin(path))
        if hasattr(decoded, 'encoding') and path.suffix.lower() in JPEGS:
            # Pixels cannot become the bytes of a JPEG again.
            path = path.with_suffix(PNG)
            self._as_png.setdefault(stream, set()).add(number)
        columns = self._blueprint.columns
        content = partial(format_sample, sample, self._root / path, columns)
        return _File(stream, number, path, content, message.topic, message.stamp_ns)

    def _why_unplaced(self, stream: Stream) -> str:
        folder = self._blueprint.folders.get(stream)
        if folder is not None and self._numbers[stream] is None:
            streams = (self._blueprint.stamped_as(stream), stream)
            paths = [self._blueprint.stamps_path(each) for each in streams]
            path = next((path for path in paths if path in self._blueprint.missing), paths[0])
            return f'its file number is unknown, for the bag does not hold {path}'
        return f'no file of {self._blueprint.name} has this stamp'

    def write(self, file: _File) -> _Written:
        """Write a file; thread-safe for different paths."""
        try:
            content, difference = file.content()
        except (ValueError, KittiRos2Error) as error:
            return _Written(file, 0, str(error))
        refusal = write_new(self._root / file.path, content)
        return _Written(file, len(content), refusal, difference)

    def take(self, written: _Written) -> None:
        """Count a file."""
        stream = written.file.stream
        if written.error:
            self._lost.setdefault(stream, set()).add(written.file.number)
            self._losses.lose(written.file.topic, written.file.stamp_ns, written.error)
            return
        self._counts[stream.value] += 1
        if written.difference:
            self._differences.setdefault(written.difference, set()).add(written.file.number)
        self._written.setdefault(stream, set()).add(written.file.number)
        if stream in self._blueprint.grey and not written.file.topic.endswith('/compressed'):
            self._grey.setdefault(stream, set()).add(written.file.number)
        self.size_bytes += written.size_bytes

    def report(self) -> ImportReport:
        """Report the written files, and those missing in the bag."""
        missing, notes = [], []
        for stream, folder in self._blueprint.folders.items():
            written = self._written[stream]
            if stream is Stream.CALIBRATION:
                found = self._blueprint.calibrations
                written = {number for number in folder.carried if folder.file(number) in found}
            requested = self._blueprint.requested(stream)
            absent = sorted(requested - written - self._lost[stream])
            if len(absent) > self._unplaced[stream]:
                text = f'the bag does not hold {stream.value} of frames {{}}'
                missing.append(Loss(stream.value, len(absent), text, tuple(absent)))
            others = sorted({*folder.numbers} - {*folder.carried})
            if others:
                numbers = format_numbers(others)
                notes.append(f'the bag was made without {stream.value} of frames {numbers}')
        scans, deskew = self._written.get(Stream.SCAN), self._blueprint.deskew
        if scans and deskew is not None:
            text = f"scans {{}} are written {deskew.state}, not as in KITTI's files"
            missing.append(Loss(Stream.SCAN.value, len(scans), text, tuple(sorted(scans))))
        missing += self._skipped_columns(scans or ())
        for difference, changed in self._differences.items():
            text = f"scans {{}} are not KITTI's own, for {POINTS} is missing: {difference}"
            missing.append(Loss(Stream.SCAN.value, len(changed), text, tuple(sorted(changed))))
        for stream, made in self._as_png.items():
            text = (
                f'{stream.value} of frames {{}} is written as PNG, for the bag has pixels, no JPEG'
            )
            missing.append(Loss(stream.value, len(made), text, tuple(sorted(made))))
        for stream, made in self._grey.items():
            text = f"{stream.value} of frames {{}} is written grey, not in KITTI's colours"
            missing.append(Loss(stream.value, len(made), text, tuple(sorted(made))))
        return ImportReport(
            layout=self._blueprint.layout,
            name=self._blueprint.name,
            counts=dict(self._counts),
            frames=self._count_frames(),
            size_bytes=self.size_bytes,
            losses=(*self._losses.losses(), *missing),
            notes=tuple(notes),
        )

    def _skipped_columns(self, scans: Collection[int]) -> list[Loss]:
        """Return the loss of the columns that to-bag was told to skip."""
        columns = self._blueprint.columns
        if columns is None or not columns.skipped or not scans:
            return []
        text = f'scans {{}} are written without {columns.describe_skipped()}, which to-bag left out'
        return [Loss(Stream.SCAN.value, len(scans), text, tuple(sorted(scans)))]

    def _count_frames(self) -> int:
        """Count the written frames, in files of their own or in a common one."""
        stamps = bag_stamps(self._bag)
        numbered = number_bag(self._bag, stamps, blueprint=self._blueprint)
        common = numbered.by_stream() if numbered is not None else {}
        written = {stream: np.array([*found]) for stream, found in self._written.items() if found}
        numbers = {stream: found for stream, found in common.items() if stream in _IN_COMMON_FILES}
        selected = self._blueprint.selected
        if selected is not None:
            numbers = {
                s: found[np.isin(found, [*selected.get(s, ())])] for s, found in numbers.items()
            }
        return len(frames_of(numbers | written, common=has_common_numbers(self._blueprint)))
