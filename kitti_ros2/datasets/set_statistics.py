# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a data set: its recordings, and their total."""

from __future__ import annotations

import csv
from collections import Counter
from contextlib import closing
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..api.arguments import by_name, warn
from ..bags.locate import looks_like_bag
from ..bags.open_source import explained
from ..files.remote import as_path
from ..kitti import names
from ..kitti.opening import find_data_sets, open_candidate
from ..model.errors import KittiRos2Error, Loss, NotKittiError, describe_error
from ..model.streams import Stream
from ..options.datasets import STATS, make_statistics_options
from ..pictures.recording_frames import RecordingFrames, open_frames
from .recording_statistics import (
    Distribution,
    ObjectStatistics,
    RecordingStatistics,
    RouteStatistics,
    count_recording,
    merged,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from typing_extensions import Unpack

    from ..kitti.find import Candidate
    from ..kitti.opening import DataSet
    from ..options.datasets import StatisticsOptions
    from ..options.keywords import StatisticsKeywords
    from ..options.read import ReadOptions


if TYPE_CHECKING:
    Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class SetStatistics:
    """The statistics of a data set.

    Attributes:
        path: The folder or the bag.
        recordings: Statistics of each drive, split, sequence or bag.
    """

    path: Path
    recordings: Sequence[RecordingStatistics]

    @cached_property
    def total(self) -> RecordingStatistics:
        """All recordings together."""
        return merged(self.recordings)


def statistics(
    path: str | os.PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Unpack[StatisticsKeywords],
) -> SetStatistics:
    """Count and describe the contents of a data set, as `kitti-ros2 stats` does.

    Args:
        path: A KITTI folder with any number of drives, splits and sequences, or a bag.
        progress: Called with the frames done and the number of frames found so far.
        options: Options of `kitti-ros2 stats --help-all`, with the same defaults: points=True,
            layout='raw', sequence='0005'.

    Returns:
        The statistics of each recording, and their total. Each loss is also a
        KittiRos2Warning.

    Raises:
        KittiRos2Error: The path cannot be read, or an option is invalid.

    Examples:
        >>> from kitti_ros2 import datasets
        >>> found = datasets.statistics('2011_09_26/2011_09_26_drive_0005_sync')
        >>> found.total.frames, found.total.route.length_m
        (..., ...)
        >>> [(name, each.count) for name, each in found.total.classes.items()]
        [...]
    """
    read, statistics_options = make_statistics_options(by_name(options, STATS))
    show = progress or (lambda _done, _total: None)
    counts = count_set(as_path(path), find_sources(as_path(path), read), statistics_options, show)
    for loss in counts.total.losses:
        warn(loss.text())
    return counts


def count_set(
    path: Path, sources: Sequence[SetSource], options: StatisticsOptions, progress: Progress
) -> SetStatistics:
    """Count the contents of the recordings at a path, one after the other.

    A recording that cannot be opened is a loss, unless it is the only one.

    Raises:
        KittiRos2Error: The only recording cannot be opened.
    """
    frames = _FrameCount(progress)
    recordings = []
    for name, kind, semantic, open_source in sources:
        try:
            source = open_source()
        except (KittiRos2Error, OSError) as error:
            if len(sources) == 1:
                raise
            loss = Loss(Stream.RECORDING.value, 1, describe_error(error))
            recordings.append(RecordingStatistics(name, kind, losses=(loss,)))
            continue
        with closing(source):
            frames.total += len(source.numbers)
            scans = options.points or semantic
            recordings.append(count_recording(source, name, kind, scans=scans, step=frames.step))
    return SetStatistics(path, tuple(recordings))


class _FrameCount:
    """Counts frames for the progress display."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._done = 0
        self.total = 0

    def step(self) -> None:
        self._done += 1
        self._progress(self._done, self.total)


class SetSource(NamedTuple):
    """A recording of a set.

    Attributes:
        name: Name in the set.
        kind: Layout, or bag.
        semantic: True if it has files of point labels.
        open: Opens its frames.
    """

    name: str
    kind: str
    semantic: bool
    open: Callable[[], RecordingFrames]


def find_sources(path: Path, read: ReadOptions) -> list[SetSource]:
    """Find the recordings at a path: in the data sets in it or below it, or the bags in it.

    Raises:
        KittiRos2Error: None exists.
    """
    if read.layout is None and looks_like_bag(path):
        return [_bag(path, read)]
    try:
        with explained(path, read):
            data_sets = find_data_sets(path, read)
    except NotKittiError:
        inside = sorted(path.iterdir()) if path.is_dir() and read.layout is None else []
        bags = [entry for entry in inside if entry.is_dir() and looks_like_bag(entry)]
        if not bags:
            raise
        return [_bag(bag, read) for bag in bags]
    return [
        _source(path, data_set, candidate, read)
        for data_set in data_sets
        for candidate in data_set.recordings
    ]


def _bag(path: Path, read: ReadOptions) -> SetSource:
    return SetSource(path.name, 'bag', semantic=False, open=partial(open_frames, path, read))


def _source(path: Path, data_set: DataSet, candidate: Candidate, read: ReadOptions) -> SetSource:
    layout = data_set.layout
    folder = candidate.folder if layout.traits.point_labels else None
    semantic = folder is not None and (folder / names.POINT_LABELS).is_dir()
    options = replace(read, semantic=semantic)

    def open_folder() -> RecordingFrames:
        return RecordingFrames(open_candidate(data_set.folder, layout, candidate, options))

    parts = data_set.folder.relative_to(path).parts
    if parts[-1:] != (candidate.name,):
        parts = (*parts, candidate.name)
    return SetSource('/'.join(parts), layout.value, semantic, open_folder)


# Statistics as plain values, for JSON, and as rows, for CSV.

_NAMED = ('samples', 'classes', 'point_classes')
"""Fields of a recording that are tables by name, not single values."""


_PLAIN = ('frames', 'labelled', 'objects', 'objects_a_frame', 'points_a_scan')
_MOMENTS = ('count', 'mean', 'deviation', 'least', 'greatest')

T = TypeVar('T', RecordingStatistics, ObjectStatistics, RouteStatistics)


class StatisticsRow(NamedTuple):
    """One figure of a set; the fields are the columns of the CSV file.

    Attributes:
        set: The path.
        recording: Name in the set; empty for the total.
        group: Kind of the figure: recording, samples, classes, point_classes, route, ...
        name: A stream or a class; empty for other figures.
        quantity: Name of the figure, such as count, difficulty easy, distance_m mean.
        value: The figure.
    """

    set: str
    recording: str
    group: str
    name: str
    quantity: str
    value: object


def plain_values(counts: SetStatistics) -> dict[str, Any]:
    """Return the statistics of a set as values of JSON."""
    return {
        'path': str(counts.path),
        'total': _plain(counts.total),
        'recordings': [_plain(recording) for recording in counts.recordings],
    }


def _plain(value: Any) -> Any:  # noqa: ANN401 - any part of the statistics
    """Return a part of the statistics as values of JSON; None for an empty distribution."""
    if isinstance(value, Distribution):
        return _plain_distribution(value)
    if isinstance(value, Loss):
        return {'stream': value.stream, 'count': value.count, 'message': value.text()}
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {key: _plain(child) for key, child in value.items()}
    return [_plain(child) for child in value] if isinstance(value, tuple) else value


def _plain_distribution(distribution: Distribution) -> dict[str, Any] | None:
    if not distribution.count:
        return None
    bins = dict(zip(distribution.names, distribution.counts, strict=True))
    return {name: getattr(distribution, name) for name in _MOMENTS} | {'bins': bins}


def read_values(values: Mapping[str, Any]) -> SetStatistics:
    """Return the statistics of a set from values of JSON; the inverse of plain_values.

    The standard deviation of a distribution may differ in its last digits.

    Raises:
        KeyError: A value is missing.
    """
    return SetStatistics(
        Path(values['path']),
        tuple(_read_recording(recording) for recording in values['recordings']),
    )


def _read_recording(values: Mapping[str, Any]) -> RecordingStatistics:
    recording = RecordingStatistics(values['name'], values['kind'])
    _fill(recording, {key: values[key] for key in _PLAIN})
    recording.samples.update(values['samples'])
    recording.point_classes.update(values['point_classes'])
    for name, fields_of_class in values['classes'].items():
        recording.classes[name] = _fill(ObjectStatistics(), fields_of_class)
    if values['route'] is not None:
        recording.route = _fill(RouteStatistics(), values['route'])
    recording.losses = tuple(
        Loss(loss['stream'], loss['count'], loss['message']) for loss in values['losses']
    )
    recording.notes = tuple(values['notes'])
    return recording


def _fill(into: T, values: Mapping[str, Any]) -> T:
    """Set the fields of statistics to values of JSON."""
    for name, value in values.items():
        current = getattr(into, name)
        if isinstance(current, Distribution):
            if value is not None:
                current.restore(value['bins'].values(), **{key: value[key] for key in _MOMENTS})
        elif isinstance(current, Counter):
            current.update(value)
        else:
            setattr(into, name, value)
    return into


def rows_of(counts: SetStatistics) -> Iterator[StatisticsRow]:
    """Yield the rows of a set: the total, then each of several recordings."""
    parts = [counts.total, *(counts.recordings if len(counts.recordings) > 1 else ())]
    for part in parts:
        for group, name, quantity, value in _figures(part):
            yield StatisticsRow(str(counts.path), part.name, group, name, quantity, value)


def _figures(part: RecordingStatistics) -> Iterator[tuple[str, str, str, object]]:
    for key, value in _plain(part).items():
        if key in {'name', 'losses', 'notes'}:
            continue
        if key in _NAMED:
            for name, figures in value.items():
                for quantity, figure in _flat(figures):
                    yield key, name, quantity or 'count', figure
        else:
            for quantity, figure in _flat(value):
                group = key if quantity else 'recording'
                yield group, '', quantity or key, figure


def _flat(value: Any, *names: str) -> Iterator[tuple[str, object]]:  # noqa: ANN401 - as above
    """Yield the figures of nested values, each with its names joined, without `bins`."""
    if isinstance(value, dict):
        for name, child in value.items():
            yield from _flat(child, *names, *([] if name == 'bins' else [name]))
    elif value is not None:
        yield ' '.join(names), value


def write_csv(path: Path, sets: Iterable[SetStatistics]) -> None:
    """Write the rows of sets with a heading; names that are not UTF-8 are escaped.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open('w', encoding='utf-8', errors='backslashreplace', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(StatisticsRow._fields)
        for counts in sets:
            writer.writerows(rows_of(counts))
