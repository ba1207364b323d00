# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics as tables: of one set, and of several side by side."""

from __future__ import annotations

from itertools import pairwise
from math import inf, isfinite
from typing import TYPE_CHECKING

from ..datasets.recording_statistics import DIFFICULTIES, TRUNCATIONS, merged
from ..datasets.set_statistics import StatisticsRow
from ..files.output_rules import keep_all_but_files
from ..model.boxes import DONT_CARE, OCCLUSIONS
from ..model.errors import format_count, one_line
from .output import cell, console, plain_table, say

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from rich.table import Table

    from ..datasets.recording_statistics import (
        Distribution,
        ObjectStatistics,
        RecordingStatistics,
        RouteStatistics,
    )
    from ..datasets.set_statistics import SetStatistics


# The statistics of one set as tables.

MOST_RECORDINGS = 40
_DISTANCES_M = (0, 10, 20, 30, 40, 50, 60, 70, inf)
_ABSURD = 1e6
_TRUNCATIONS = ('uncut', '<=15%', '<=30%', '<=50%', '>50%')
_OCCLUSIONS = tuple(name.split()[0] for name in OCCLUSIONS)


def describe(statistics: SetStatistics) -> str:
    """Describe a set in one line: layout, recordings, frames, objects."""
    total = statistics.total
    parts = [
        total.kind,
        format_count(len(statistics.recordings), 'recording'),
        format_count(total.frames, 'frame'),
    ]
    if total.labelled:
        a_frame = f'{total.objects_a_frame.mean:.1f} a frame'
        parts.append(f'{format_count(total.objects, "object")} in {total.labelled:,} ({a_frame})')
    return one_line(f'{statistics.path}: {", ".join(parts)}')


def describe_sensors(total: RecordingStatistics) -> str:
    """Describe the number of samples of each sensor; empty without any."""
    samples = [f'{name} {count:,}' for name, count in total.samples.items()]
    if total.points_a_scan.count:
        samples.append(f'{total.points_a_scan.mean:,.0f} points a scan')
    return f'sensors: {", ".join(samples)}' if samples else ''


def describe_route(total: RecordingStatistics) -> str:
    """Describe length, speed and turn rate of the route; empty without one."""
    route = total.route
    if route is None:
        return ''
    time = f' in {route.duration_s:.1f} s' if route.duration_s else ''
    parts = [f'route: {route.length_m:.2f} m{time}']
    for name, values, unit in (
        ('speed', route.speed_m_s, 'm/s'),
        ('turn rate', route.turn_rate_deg_s, 'deg/s'),
    ):
        if values.count:
            parts.append(f'{name} {values.mean:.1f}, at most {values.greatest:.1f} {unit}')
    if route.jumps:
        parts.append(f'{format_count(route.jumps, "step")} faster than 100 m/s left out')
    return '; '.join(parts)


def tables_of(statistics: SetStatistics) -> Iterator[Table]:
    """Yield the tables of a set, each if there are data for it."""
    if len(statistics.recordings) > 1:
        yield _recordings(statistics)
    total = statistics.total
    classes = {name: objects for name, objects in total.classes.items() if name != DONT_CARE}
    if total.classes:
        yield _classes(total)
    if any(objects.occlusion.total() or objects.truncation.total() for objects in classes.values()):
        yield _visibility(classes)
    if any(objects.distance_m.count for objects in classes.values()):
        yield _distances(classes)
        yield _boxes(classes)
    if any(objects.tracks.count for objects in classes.values()):
        yield _tracks(classes)
    if total.point_classes:
        yield _point_classes(total)


def _recordings(statistics: SetStatistics) -> Table:
    moving = statistics.total.route is not None
    head = ('m', 's', 'm/s', 'deg/s') if moving else ()
    table = plain_table('recording', ('frames', 'objects', *head))
    shown = statistics.recordings[:MOST_RECORDINGS]
    for part in (*shown, statistics.total):
        name = cell(part.name) or 'all'
        if part is statistics.total and len(shown) < len(statistics.recordings):
            rest = f'... and {len(statistics.recordings) - len(shown)} more, see --csv and --json'
            table.add_row(rest)
        objects = f'{part.objects}' if part.labelled else ''
        table.add_row(name, f'{part.frames}', objects, *(_route_cells(part) if moving else ()))
    return table


def _route_cells(part: RecordingStatistics) -> tuple[str, ...]:
    route = part.route
    if route is None:
        return ('',) * 4
    return (
        f'{route.length_m:.2f}',
        f'{route.duration_s:.1f}' if route.duration_s else '',
        number(route.speed_m_s.mean),
        number(route.turn_rate_deg_s.mean),
    )


def _classes(total: RecordingStatistics) -> Table:
    rated = any(objects.difficulty.total() for objects in total.classes.values())
    levels = DIFFICULTIES if rated else ()
    table = plain_table('class', ('objects', 'share', 'frames', 'most', *levels))
    for name, objects in total.classes.items():
        share = '' if name == DONT_CARE else f'{objects.count / total.objects:.1%}'
        counts = _counts(objects.difficulty, levels)
        figures = f'{objects.count}', share, f'{objects.frames}', f'{objects.most}'
        table.add_row(cell(name), *figures, *counts)
    return table


def _visibility(classes: Mapping[str, ObjectStatistics]) -> Table:
    table = plain_table('occlusion', (*_OCCLUSIONS, *_TRUNCATIONS))
    for name, objects in classes.items():
        counts = _counts(objects.occlusion, OCCLUSIONS) + _counts(objects.truncation, TRUNCATIONS)
        table.add_row(cell(name), *counts)
    return table


def _counts(counts: Mapping[str, int], names: Sequence[str]) -> list[str]:
    """Return the cells of counts by name; empty if none is known."""
    counted = any(counts.values())
    return [f'{counts[name]}' if counted else '' for name in names]


def _distances(classes: Mapping[str, ObjectStatistics]) -> Table:
    bins = [
        f'{low:g}-{high:g}' if high < inf else f'{low:g}+' for low, high in pairwise(_DISTANCES_M)
    ]
    table = plain_table('distance m', ('mean', 'max', *bins))
    for name, objects in classes.items():
        distances_m = objects.distance_m
        inside = [f'{_within(distances_m, *pair)}' for pair in pairwise(_DISTANCES_M)]
        cells = [number(distances_m.mean), number(distances_m.greatest), *inside]
        table.add_row(cell(name), *(cells if distances_m.count else ()))
    return table


def _within(values: Distribution, low: float, high: float) -> int:
    """Return the number of values between two edges."""
    return sum(
        count for edge, count in zip(values.edges, values.counts, strict=True) if low <= edge < high
    )


def _boxes(classes: Mapping[str, ObjectStatistics]) -> Table:
    counted = any(objects.points.count for objects in classes.values())
    points = ('points', 'most', 'no point') if counted else ()
    table = plain_table('box m', ('length', 'width', 'height', *points))
    for name, objects in classes.items():
        sizes = [spread(size_m) for size_m in (objects.length_m, objects.width_m, objects.height_m)]
        inside = objects.points
        cells = ['', '', '']
        if inside.count:
            cells = [f'{inside.mean:.0f}', f'{inside.greatest:.0f}', f'{inside.counts[0]}']
        table.add_row(cell(name), *sizes, *(cells if counted else ()))
    return table


def _tracks(classes: Mapping[str, ObjectStatistics]) -> Table:
    table = plain_table('track frames', ('tracks', 'mean', 'least', 'most'))
    for name, objects in classes.items():
        tracks = objects.tracks
        if tracks.count:
            extremes = f'{tracks.least:.0f}', f'{tracks.greatest:.0f}'
            table.add_row(cell(name), f'{tracks.count}', number(tracks.mean), *extremes)
    return table


def _point_classes(total: RecordingStatistics) -> Table:
    table = plain_table('points of class', ('points', 'share'))
    every = sum(total.point_classes.values())
    for name, count in total.point_classes.items():
        table.add_row(cell(name), f'{count}', f'{count / every:.2%}')
    return table


def number(value: float) -> str:
    """Format a figure with a decimal; empty if it is unknown."""
    return _fixed(value, 1) if isfinite(value) else ''


def spread(values: Distribution) -> str:
    """Format mean and standard deviation; empty without values."""
    if not values.count:
        return ''
    return f'{_fixed(values.mean, 2)} ± {_fixed(values.deviation, 2)}'


def _fixed(value: float, decimals: int) -> str:
    """Format with decimals; absurd values, which labels may hold, in the shortest form."""
    return f'{value:.{decimals}f}' if abs(value) < _ABSURD else f'{value:.1e}'


# The statistics of several sets side by side, a column for each.

_SETS_A_TABLE = 4
_TITLE = 20

Section = tuple[str, list[tuple[str, list[str]]]]
"""A heading, and rows of a name with a cell for each set."""


def comparisons(sets: Sequence[SetStatistics]) -> Iterator[Table]:
    """Yield tables with a column for each set, four sets in each."""
    titles = titles_of([data_set.path for data_set in sets])
    for first in range(0, len(sets), _SETS_A_TABLE):
        chosen = slice(first, first + _SETS_A_TABLE)
        totals = [data_set.total for data_set in sets[chosen]]
        yield _comparison(titles[chosen], totals, sets[chosen])


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
    rows = [('recordings', [f'{len(data_set.recordings)}' for data_set in sets])]
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
        ('layout', lambda total: total.kind),
        ('frames', lambda total: f'{total.frames}'),
        ('frames with labels', lambda total: f'{total.labelled or ""}'),
        ('objects', lambda total: f'{total.objects or ""}'),
        ('objects a frame', lambda total: number(total.objects_a_frame.mean)),
        ('points a scan', lambda total: number(total.points_a_scan.mean).split('.')[0]),
    ]
    return [(name, [figure(total) for total in totals]) for name, figure in figures]


def _sections(totals: Sequence[RecordingStatistics]) -> Iterator[Section]:
    streams = dict.fromkeys(name for total in totals for name in total.samples)
    yield (
        'samples',
        [(name, [f'{total.samples[name] or ""}' for total in totals]) for name in streams],
    )
    names = [*merged(totals).classes]
    yield _class_section('objects', names, totals, lambda objects: f'{objects.count}')
    names = [name for name in names if name != DONT_CARE]
    for title, figure in _CLASS_FIGURES:
        yield _class_section(title, names, totals, figure)
    routes = [total.route for total in totals]
    yield (
        'route',
        [
            (name, ['' if route is None else figure(route) for route in routes])
            for name, figure in _ROUTE_FIGURES
        ],
    )
    class_names = dict.fromkeys(name for total in totals for name in total.point_classes)
    shares = [_point_shares(total) for total in totals]
    yield (
        'points of class, %',
        [(name, [share.get(name, '') for share in shares]) for name in class_names],
    )


def _class_section(
    title: str,
    names: Sequence[str],
    totals: Sequence[RecordingStatistics],
    figure: Callable[[ObjectStatistics], str],
) -> Section:
    def of(total: RecordingStatistics, name: str) -> str:
        return figure(total.classes[name]) if name in total.classes else ''

    return title, [(name, [of(total, name) for total in totals]) for name in names]


def _point_shares(part: RecordingStatistics) -> dict[str, str]:
    every = sum(part.point_classes.values())
    return {name: f'{100 * count / every:.2f}' for name, count in part.point_classes.items()}


def _shares(counts: Mapping[str, int], names: Sequence[str]) -> str:
    """Format the shares of several counts in per cent."""
    every = sum(counts.values())
    return ' '.join(f'{counts[name] / every:.0%}'.rstrip('%') for name in names) if every else ''


def _size(objects: ObjectStatistics) -> str:
    sizes = (objects.length_m, objects.width_m, objects.height_m)
    return ' '.join(f'{size.mean:.2f}' for size in sizes) if sizes[0].count else ''


def _track_lengths(objects: ObjectStatistics) -> str:
    return f'{objects.tracks.count} of {objects.tracks.mean:.1f}' if objects.tracks.count else ''


_CLASS_FIGURES: list[tuple[str, Callable[[ObjectStatistics], str]]] = [
    (f'{" ".join(DIFFICULTIES)}, %', lambda objects: _shares(objects.difficulty, DIFFICULTIES)),
    ('visible partly largely unknown, %', lambda objects: _shares(objects.occlusion, OCCLUSIONS)),
    ('distance, m', lambda objects: spread(objects.distance_m)),
    ('length width height, m', _size),
    ('points a box', lambda objects: number(objects.points.mean)),
    ('tracks of frames', _track_lengths),
]

_ROUTE_FIGURES: list[tuple[str, Callable[[RouteStatistics], str]]] = [
    ('length, m', lambda route: f'{route.length_m:.2f}'),
    ('duration, s', lambda route: f'{route.duration_s:.1f}' if route.duration_s else ''),
    ('speed, m/s', lambda route: spread(route.speed_m_s)),
    ('turn rate, deg/s', lambda route: spread(route.turn_rate_deg_s)),
]


# Statistics as tables on a terminal, and the file of their table.

TABLE = 'statistics.csv'
"""Name of the table of a collection."""
KEEP_ALL_BUT_TABLES = keep_all_but_files(
    'table of statistics', (','.join(StatisticsRow._fields).encode(),)
)


def print_sets(sets: Sequence[SetStatistics], *, points: bool) -> None:
    """Print tables for a terminal of 80 columns."""
    screen = console(soft_wrap=True)
    if len(sets) == 1:
        (statistics,) = sets
        screen.print(describe(statistics), style='bold', markup=False)
        for line in (describe_sensors(statistics.total), describe_route(statistics.total)):
            if line:
                screen.print(line, markup=False, soft_wrap=False)
        shown = tables_of(statistics)
    else:
        shown = comparisons(sets)
    for index, table in enumerate(shown):
        if index or len(sets) == 1:
            screen.print()
        screen.print(table, soft_wrap=False)
    for data_set in sets:
        if points and not data_set.total.points_a_scan.count:
            say(f'note: {data_set.path}: no scans, so no points are counted')
