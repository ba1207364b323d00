# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The statistics of several sets side by side, a column for each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..datasets.object_statistics import DIFFICULTIES
from ..datasets.recording_statistics import merged
from ..model.boxes import DONT_CARE, OCCLUSIONS
from .stats_tables import number, spread
from .tables import cell, plain_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from rich.table import Table

    from ..datasets.object_statistics import ObjectStatistics
    from ..datasets.recording_statistics import RecordingStatistics
    from ..datasets.route_statistics import RouteStatistics
    from ..datasets.set_statistics import SetStatistics

_SETS_A_TABLE = 4
_TITLE = 20

Section = tuple[str, list[tuple[str, list[str]]]]
"""A heading, and rows of a name with a cell for each set."""


def comparisons(sets: Sequence[SetStatistics]) -> Iterator[Table]:
    """Yield tables with a column for each set, four sets in each."""
    titles = titles_of([each.path for each in sets])
    for first in range(0, len(sets), _SETS_A_TABLE):
        chosen = slice(first, first + _SETS_A_TABLE)
        yield _comparison(titles[chosen], [each.total for each in sets[chosen]], sets[chosen])


def titles_of(paths: Sequence[Path]) -> list[str]:
    """Return the last names of paths, as many as make them differ."""
    absolute = [path.absolute() for path in paths]
    for count in range(1, max(len(path.parts) for path in absolute)):
        titles = ['/'.join(path.parts[-count:]) for path in absolute]
        if len(set(titles)) == len(set(absolute)):
            break
    return titles


def _comparison(
    titles: Sequence[str], totals: Sequence[RecordingStatistics], sets: Sequence[SetStatistics]
) -> Table:
    table = plain_table('', [])
    for title in titles:
        table.add_column(cell(title), justify='right', overflow='fold', max_width=_TITLE)
    rows = [('recordings', [f'{len(each.recordings)}' for each in sets])]
    for title, section in (('', rows + _recording_rows(totals)), *_sections(totals)):
        filled = [(name, cells) for name, cells in section if any(cells)]
        if filled and title:
            table.add_row('')
            table.add_row(title, style='bold')
        for name, cells in filled:
            table.add_row(cell(name), *cells)
    return table


def _recording_rows(totals: Sequence[RecordingStatistics]) -> list[tuple[str, list[str]]]:
    figures: list[tuple[str, Callable[[RecordingStatistics], str]]] = [
        ('layout', lambda each: each.kind),
        ('frames', lambda each: f'{each.frames}'),
        ('frames with labels', lambda each: f'{each.labelled or ""}'),
        ('objects', lambda each: f'{each.objects or ""}'),
        ('objects a frame', lambda each: number(each.objects_a_frame.mean)),
        ('points a scan', lambda each: number(each.points_a_scan.mean).split('.')[0]),
    ]
    return [(name, [figure(each) for each in totals]) for name, figure in figures]


def _sections(totals: Sequence[RecordingStatistics]) -> Iterator[Section]:
    streams = dict.fromkeys(name for each in totals for name in each.samples)
    yield (
        'samples',
        [(name, [f'{each.samples[name] or ""}' for each in totals]) for name in streams],
    )
    names = [*merged(totals).classes]
    yield _class_section('objects', names, totals, lambda each: f'{each.count}')
    names = [name for name in names if name != DONT_CARE]
    for title, figure in _CLASS_FIGURES:
        yield _class_section(title, names, totals, figure)
    routes = [each.route for each in totals]
    yield (
        'route',
        [
            (name, ['' if route is None else figure(route) for route in routes])
            for name, figure in _ROUTE_FIGURES
        ],
    )
    found = dict.fromkeys(name for each in totals for name in each.point_classes)
    shares = [_point_shares(each) for each in totals]
    yield 'points of class, %', [(name, [each.get(name, '') for each in shares]) for name in found]


def _class_section(
    title: str,
    names: Sequence[str],
    totals: Sequence[RecordingStatistics],
    figure: Callable[[ObjectStatistics], str],
) -> Section:
    def of(each: RecordingStatistics, name: str) -> str:
        return figure(each.classes[name]) if name in each.classes else ''

    return title, [(name, [of(each, name) for each in totals]) for name in names]


def _point_shares(part: RecordingStatistics) -> dict[str, str]:
    every = sum(part.point_classes.values())
    return {name: f'{100 * count / every:.2f}' for name, count in part.point_classes.items()}


def _shares(counts: Mapping[str, int], names: Sequence[str]) -> str:
    """Format the shares of several counts in per cent."""
    every = sum(counts.values())
    return ' '.join(f'{counts[name] / every:.0%}'.rstrip('%') for name in names) if every else ''


def _size(each: ObjectStatistics) -> str:
    sizes = (each.length_m, each.width_m, each.height_m)
    return ' '.join(f'{size.mean:.2f}' for size in sizes) if sizes[0].count else ''


def _track_lengths(each: ObjectStatistics) -> str:
    return f'{each.tracks.count} of {each.tracks.mean:.1f}' if each.tracks.count else ''


_CLASS_FIGURES: list[tuple[str, Callable[[ObjectStatistics], str]]] = [
    (f'{" ".join(DIFFICULTIES)}, %', lambda each: _shares(each.difficulty, DIFFICULTIES)),
    ('visible partly largely unknown, %', lambda each: _shares(each.occlusion, OCCLUSIONS)),
    ('distance, m', lambda each: spread(each.distance_m)),
    ('length width height, m', _size),
    ('points a box', lambda each: number(each.points.mean)),
    ('tracks of frames', _track_lengths),
]

_ROUTE_FIGURES: list[tuple[str, Callable[[RouteStatistics], str]]] = [
    ('length, m', lambda each: f'{each.length_m:.2f}'),
    ('duration, s', lambda each: f'{each.duration_s:.1f}' if each.duration_s else ''),
    ('speed, m/s', lambda each: spread(each.speed_m_s)),
    ('turn rate, deg/s', lambda each: spread(each.turn_rate_deg_s)),
]
