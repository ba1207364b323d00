# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The description in a bag written by to-bag: layout, folders, and the files the bag contains.

It is untrusted: a bag may be damaged or forged.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from ..kitti import names
from ..kitti.real_time import REAL_TIME, parse_times_of
from ..messages.moment import Origin
from ..messages.source import GREY, RECORDING
from ..messages.topics import decoders
from ..model.errors import BadBagError, UsageError
from ..model.layouts import Layout
from ..model.motion import Deskew
from ..model.scan_columns import ScanColumns
from ..model.streams import Stream
from ..options.read import ScanStamp, is_period
from .folders import Folder, inside

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from ..kitti.real_time import RealTimes

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
    """What a description says of one recording, beside its files of text.

    Attributes:
        layout: Which of the four.
        name: Drive, sequence or split.
        epoch_ns: The time of the first frame in layouts without absolute time.
        period_ns: Distance of the frames in layouts without time.
        scan_stamp: The moment of a scan used as its stamp.
        folders: By stream.
        times: The true stamps of an object set in real time; None for others.
        deskew: What to-bag did to the scans; None: they are those of the files.
        stereo: Whether right images have the stamps of their left ones.
        grey: Streams of colour images whose raw images are grey.
        columns: Those of .bin scans; None are KITTI's.
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
        values: Mapping[str, Any] = decoders()[RECORDING](message, Origin(path)).values
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
        places = {(folder.path, folder.names.suffix.lower()) for folder in folders.values()}
        if len(places) < len(folders):
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
        )
    except _ERRORS as error:
        reason = f'{RECORDING} is not what kitti-ros2 writes ({type(error).__name__}: {error})'
        raise UndescribedError(path, reason) from error


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
    found = names.parse_names(entry, stems)
    limit = len(stems) or 10**names.MOST_DIGITS
    numbers = tuple(_numbers(entry['numbers'], limit))
    carried = numbers
    if 'carried' in entry:
        carried = tuple(_numbers(entry['carried'], limit))
        if not set(numbers).issuperset(carried):
            raise ValueError('files that the recording does not have')
    return Folder(inside(entry['folder'], path), found, numbers, carried)


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
