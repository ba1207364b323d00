# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics as plain values, for JSON, and as rows, for CSV."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..model.losses import Loss
from .distribution import Distribution
from .object_statistics import ObjectStatistics
from .recording_statistics import RecordingStatistics
from .route_statistics import RouteStatistics
from .set_statistics import SetStatistics

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

_NAMED = ('samples', 'classes', 'point_classes')
"""Fields of a recording that are tables by name; the others are single values."""


_PLAIN = ('frames', 'labelled', 'objects', 'objects_a_frame', 'points_a_scan')
_MOMENTS = ('count', 'mean', 'deviation', 'least', 'greatest')

T = TypeVar('T', RecordingStatistics, ObjectStatistics, RouteStatistics)


class StatisticsRow(NamedTuple):
    """One figure of a set; the fields are the columns of the CSV file.

    Attributes:
        set: The path.
        recording: Its name in the set; empty for all together.
        group: Kind of the figure: recording, samples, classes, point_classes, route, ...
        name: A stream or a class; empty for other figures.
        quantity: What it is, such as count, difficulty easy, distance_m mean, distance_m 10-15.
        value: The figure.
    """

    set: str
    recording: str
    group: str
    name: str
    quantity: str
    value: object


def plain_values(found: SetStatistics) -> dict[str, Any]:
    """Return the statistics of a set as values of JSON."""
    return {
        'path': str(found.path),
        'total': _plain(found.total),
        'recordings': [_plain(each) for each in found.recordings],
    }


def _plain(value: Any) -> Any:  # noqa: ANN401 - any part of the statistics
    """Return a part of the statistics as values of JSON; a distribution without values is None."""
    if isinstance(value, Distribution):
        return _plain_distribution(value)
    if isinstance(value, Loss):
        return {'stream': value.stream, 'count': value.count, 'message': value.text()}
    if is_dataclass(value):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _plain_distribution(found: Distribution) -> dict[str, Any] | None:
    if not found.count:
        return None
    bins = dict(zip(found.names, found.counts, strict=True))
    return {name: getattr(found, name) for name in _MOMENTS} | {'bins': bins}


def read_values(values: Mapping[str, Any]) -> SetStatistics:
    """Return the statistics of a set from values of JSON; the inverse of plain_values.

    The standard deviation of a distribution may differ in its last digits.

    Raises:
        KeyError: A value is missing.
    """
    return SetStatistics(
        Path(values['path']),
        tuple(_read_recording(each) for each in values['recordings']),
    )


def _read_recording(values: Mapping[str, Any]) -> RecordingStatistics:
    found = RecordingStatistics(values['name'], values['kind'])
    _fill(found, {key: values[key] for key in _PLAIN})
    found.samples.update(values['samples'])
    found.point_classes.update(values['point_classes'])
    for name, each in values['classes'].items():
        found.classes[name] = _fill(ObjectStatistics(), each)
    if values['route'] is not None:
        found.route = _fill(RouteStatistics(), values['route'])
    found.losses = tuple(
        Loss(each['stream'], each['count'], each['message']) for each in values['losses']
    )
    found.notes = tuple(values['notes'])
    return found


def _fill(into: T, values: Mapping[str, Any]) -> T:
    """Set the fields of statistics to values of JSON."""
    for name, value in values.items():
        known = getattr(into, name)
        if isinstance(known, Distribution):
            if value is not None:
                known.restore(value['bins'].values(), **{key: value[key] for key in _MOMENTS})
        elif isinstance(known, Counter):
            known.update(value)
        else:
            setattr(into, name, value)
    return into


def rows_of(found: SetStatistics) -> Iterator[StatisticsRow]:
    """Yield the rows of a set: all recordings together, then each of several."""
    parts = [found.total, *(found.recordings if len(found.recordings) > 1 else ())]
    for part in parts:
        for group, name, quantity, value in _figures(part):
            yield StatisticsRow(str(found.path), part.name, group, name, quantity, value)


def _figures(part: RecordingStatistics) -> Iterator[tuple[str, str, str, object]]:
    for key, value in _plain(part).items():
        if key in {'name', 'losses', 'notes'}:
            continue
        if key in _NAMED:
            for name, each in value.items():
                for quantity, figure in _flat(each):
                    yield key, name, quantity or 'count', figure
        else:
            for quantity, figure in _flat(value):
                group = key if quantity else 'recording'
                yield group, '', quantity or key, figure


def _flat(value: Any, *names: str) -> Iterator[tuple[str, object]]:  # noqa: ANN401 - as above
    """Yield the figures of nested values, each with its names joined; those of bins alone."""
    if isinstance(value, dict):
        for name, each in value.items():
            yield from _flat(each, *names, *([] if name == 'bins' else [name]))
    elif value is not None:
        yield ' '.join(names), value


def write_csv(path: Path, sets: Iterable[SetStatistics]) -> None:
    """Write the rows of sets with a heading; names that are no text are escaped.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open('w', encoding='utf-8', errors='backslashreplace', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(StatisticsRow._fields)
        for each in sets:
            writer.writerows(rows_of(each))
