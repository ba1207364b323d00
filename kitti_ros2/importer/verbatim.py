# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of our own back to KITTI: every file as it was, to the byte.

Images that a bag holds as pixels become PNG files of the same pixels; the text scans of raw extract
get the same numbers.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.reader import bag_stamps, open_messages
from ..errors import UsageError
from ..kitti import names
from ..kitti.scan_file import format_scan, format_scan_text
from ..kitti.semantic_file import format_point_labels
from ..kitti.store import STORE
from ..messages.header import stamp_ns_of
from ..messages.image import decode_compressed
from ..messages.scan import decode_points, decode_scan
from ..messages.source import decode_text
from ..ordered_map import ordered_map
from ..samples import Stream, format_numbers
from ..schedule import frames_of
from .blueprint import inside
from .decoding import Decoder
from .numbering import has_common_numbers, number_bag, own_topics
from .output import staged
from .report import ImportReport, LossTally, damage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from ..bags.reader import BagMessage, BagMessages
    from ..samples import Layout
    from .blueprint import Blueprint

LINES = {'/kitti/source/oxts': Stream.OXTS, '/kitti/source/labels': Stream.LABELS}
_IN_COMMON_FILES = frozenset({Stream.OXTS, Stream.POSE, Stream.LABELS})
"""Streams that some layouts have as lines of one file."""

_MOST_WORKERS = 8


@dataclass(frozen=True)
class _File:
    """A file to be written: what it holds is worked out where it is written."""

    stream: Stream
    number: int
    path: PurePosixPath
    content: Callable[[], bytes | memoryview]
    topic: str
    stamp_ns: int


@dataclass(frozen=True)
class _Written:
    """A file that was written, or why it was not."""

    file: _File
    size_bytes: int
    error: str = ''


def sample_topics() -> dict[str, Stream]:
    """The topics of scans and images under every preset, with their streams."""
    return {row.name: row.stream for row in own_topics() if row.on_demand}


def _topics(channels: Iterable[tuple[str, str]]) -> set[str]:
    """The topics of a bag to read; a camera's pixels only where the bag lacks its PNG files."""
    present = {topic for topic, _ in channels}
    wanted = (set(sample_topics()) | set(LINES)) & present
    return {topic for topic in wanted if f'{topic}/compressed' not in present}


def restore(
    recordings: Sequence[tuple[Path, Blueprint]],
    out: Path,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> list[ImportReport]:
    """Lay the recordings in bags of our own out again, in one data set.

    Args:
        recordings: Each bag, and what it tells of the layout.
        out: The data set's folder, absent or empty.
        progress: Called with the files and the bytes written so far of one bag.

    Raises:
        BadBagError: A bag cannot be read.
        UsageError: Two bags hold the same recording, or disagree about a file they share.
        OutputExistsError: The folder holds something.
        OutputError: It cannot be written.
    """
    known: dict[tuple[Layout, str], Path] = {}
    for path, blueprint in recordings:
        other = known.setdefault((blueprint.layout, blueprint.name), path)
        if other is not path:
            raise UsageError(f'{path}: holds {blueprint.name}, as {other} does; give one of them')
    with staged(out) as stage:
        reports = [_restore(path, blueprint, stage, progress) for path, blueprint in recordings]
    return [replace(report, path=out) for report in reports]


def _restore(
    path: Path, blueprint: Blueprint, stage: Path, progress: Callable[[int, int], None]
) -> ImportReport:
    with open_messages(path) as messages:
        wanted = _topics(messages.channels)
    _write_shared(stage / blueprint.root, blueprint, path)
    with open_messages(path, wanted) as messages:
        report = _write(path, messages, blueprint, stage, progress)
        return replace(report, losses=report.losses + damage(messages.losses, path.name))


def _write_shared(root: Path, blueprint: Blueprint, bag: Path) -> None:
    """The text files, some of which several recordings of a data set share."""
    for path, text in (*blueprint.texts.items(), *blueprint.calibrations.items()):
        target = root / path
        if STORE.is_file(target) and STORE.read_text(target) != text:
            raise UsageError(f'{bag}: its {path} differs from that of another bag')
        STORE.write_text(target, text)


def _write(
    bag: Path,
    messages: BagMessages,
    blueprint: Blueprint,
    stage: Path,
    progress: Callable[[int, int], None],
) -> ImportReport:
    writer = _Writer(messages, blueprint, stage / blueprint.root, bag)
    workers = min(_MOST_WORKERS, len(os.sched_getaffinity(0)))
    for done, written in enumerate(ordered_map(writer.write, writer.files(), workers), 1):
        writer.take(written)
        progress(done, writer.size_bytes)
    writer.write_calibrations()
    return writer.report(stage)


class _Writer:
    def __init__(self, messages: BagMessages, blueprint: Blueprint, root: Path, bag: Path) -> None:
        self._bag = bag
        self._messages = messages
        self._blueprint = blueprint
        self._root = root
        self._streams = sample_topics()
        self._numbers = {stream: blueprint.numbers_by_stamp(stream) for stream in blueprint.folders}
        self._written: dict[Stream, set[int]] = {stream: set() for stream in blueprint.folders}
        self._counts: Counter[str] = Counter()
        self._losses = LossTally()
        self.size_bytes = 0

    def files(self) -> Iterator[_File]:
        """What the messages hold, in their order."""
        decode = Decoder(self._messages.typestore)
        for message in self._messages:
            try:
                decoded = decode(message)
            except ValueError as error:
                self._losses.lose(message.topic, message.stamp_ns, str(error))
                continue
            file = (
                self._line(decoded, message)
                if message.topic in LINES
                else self._sample(decoded, message)
            )
            if file is not None:
                yield file

    def _line(self, decoded: Any, message: BagMessage) -> _File | None:  # noqa: ANN401
        """A text of one frame, unless the whole file is known."""
        text = decode_text(decoded)
        path = inside(text.name, self._bag)
        if path in self._blueprint.texts:
            self._counts[LINES[message.topic].value] += 1
            return None
        stem = PurePosixPath(path).stem
        number = int(stem) if stem.isdecimal() else -1
        data = text.text.encode()
        return _File(LINES[message.topic], number, path, lambda: data, *_origin(message))

    def _sample(self, decoded: Any, message: BagMessage) -> _File | None:  # noqa: ANN401
        stream = self._streams[message.topic]
        numbers = self._numbers.get(stream)
        stamp_ns = stamp_ns_of(decoded.header)
        if not numbers or not numbers.get(stamp_ns):
            self._losses.lose(
                message.topic, message.stamp_ns, f'no file of {self._blueprint.name} has this stamp'
            )
            return None
        number = numbers[stamp_ns].pop(0)
        folder = self._blueprint.folders[stream]
        content: Callable[[], bytes | memoryview]
        if stream is Stream.SCAN:
            content = partial(self._scan, decoded, number, folder.suffix)
        elif message.topic.endswith('/compressed'):
            content = partial(decode_compressed, decoded)
        else:
            content = partial(_png, decoded)
        return _File(stream, number, folder.file(number), content, *_origin(message))

    def _scan(self, cloud: Any, number: int, suffix: str) -> bytes | memoryview:  # noqa: ANN401
        """A scan's file; the labels of its points go to a file of their own."""
        points = decode_points(cloud)
        if 'label' in (points.dtype.names or ()):
            labels = points['label'].astype(np.uint32)
            labels |= points['instance'].astype(np.uint32) << np.uint32(16)
            folder = self._blueprint.folders[Stream.SCAN].path.parent / names.POINT_LABELS
            path = folder / names.file_name(number, names.FRAME_DIGITS, names.LABEL)
            STORE.write(self._root / path, format_point_labels(labels))
        scan = decode_scan(cloud)
        return format_scan_text(scan.points) if suffix == names.TXT else format_scan(scan.points)

    def write(self, file: _File) -> _Written:
        """Write a file; safe to call from several threads, a path by one of them."""
        try:
            content = file.content()
        except ValueError as error:
            return _Written(file, 0, str(error))
        STORE.write(self._root / file.path, content)
        return _Written(file, len(content))

    def take(self, written: _Written) -> None:
        """Count a file."""
        stream = written.file.stream
        if written.error:
            self._losses.lose(written.file.topic, written.file.stamp_ns, written.error)
            return
        self._counts[stream.value] += 1
        self._written.setdefault(stream, set()).add(written.file.number)
        self.size_bytes += written.size_bytes

    def write_calibrations(self) -> None:
        """The calibration files of frames without one of their own: that of the frame before."""
        self._counts[Stream.CALIBRATION.value] = len(self._blueprint.calibrations)
        folder = self._blueprint.folders.get(Stream.CALIBRATION)
        if folder is None:
            return
        last = max((max(found) for found in self._written.values() if found), default=-1)
        last_text: str | None = None
        for number in folder.numbers:
            path = folder.file(number)
            last_text = self._blueprint.calibrations.get(path, last_text)
            if last_text is None or (path not in self._blueprint.calibrations and number > last):
                continue
            if path not in self._blueprint.calibrations:
                STORE.write_text(self._root / path, last_text)
                self._counts[Stream.CALIBRATION.value] += 1
            self._written.setdefault(Stream.CALIBRATION, set()).add(number)

    def report(self, path: Path) -> ImportReport:
        """What was written, and what the recording had that the bag does not hold."""
        absent = []
        for stream, folder in self._blueprint.folders.items():
            lacking = sorted(set(folder.numbers) - self._written.get(stream, set()))
            if lacking:
                absent.append(
                    f'the bag holds no {stream.value} of frames {format_numbers(lacking)}'
                )
        return ImportReport(
            path=path,
            layout=self._blueprint.layout,
            name=self._blueprint.name,
            counts=dict(self._counts),
            frames=self._count_frames(),
            size_bytes=self.size_bytes,
            losses=self._losses.losses(),
            notes=tuple(absent),
        )

    def _count_frames(self) -> int:
        """How many frames were written, in files of their own or in a common one."""
        numbered = number_bag(self._bag, bag_stamps(self._bag))
        common = numbered.by_stream() if numbered is not None else {}
        written = {stream: np.array([*found]) for stream, found in self._written.items() if found}
        numbers = {stream: found for stream, found in common.items() if stream in _IN_COMMON_FILES}
        return len(frames_of(numbers | written, common=has_common_numbers(self._blueprint)))


def _png(image: Any) -> bytes:  # noqa: ANN401 - of the bag's types
    from ..messages.pixels import decode_pixels  # noqa: PLC0415 - OpenCV, which PNGs do without
    from ..messages.png_writer import encode_png  # noqa: PLC0415

    return encode_png(decode_pixels(image))


def _origin(message: BagMessage) -> tuple[str, int]:
    return message.topic, message.stamp_ns
