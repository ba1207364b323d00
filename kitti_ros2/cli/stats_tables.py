# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The statistics of one set as tables."""

from __future__ import annotations

from itertools import pairwise
from math import inf, isfinite
from typing import TYPE_CHECKING

from ..datasets.object_statistics import DIFFICULTIES, TRUNCATIONS
from ..model.boxes import DONT_CARE, OCCLUSIONS
from ..model.text import one_line
from .tables import cell, plain_table
from .text import format_count

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.table import Table

    from ..datasets.distribution import Distribution
    from ..datasets.object_statistics import ObjectStatistics
    from ..datasets.recording_statistics import RecordingStatistics
    from ..datasets.set_statistics import SetStatistics

MOST_RECORDINGS = 40
_DISTANCES_M = (0, 10, 20, 30, 40, 50, 60, 70, inf)
_ABSURD = 1e6
_TRUNCATIONS = ('uncut', '<=15%', '<=30%', '<=50%', '>50%')
_OCCLUSIONS = tuple(name.split()[0] for name in OCCLUSIONS)


def describe(found: SetStatistics) -> str:
    """Describe a set in one line: layout, recordings, frames, objects."""
    total = found.total
    parts = [
        total.kind,
        format_count(len(found.recordings), 'recording'),
        format_count(total.frames, 'frame'),
    ]
    if total.labelled:
        a_frame = f'{total.objects_a_frame.mean:.1f} a frame'
        parts.append(f'{format_count(total.objects, "object")} in {total.labelled:,} ({a_frame})')
    return one_line(f'{found.path}: {", ".join(parts)}')


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


def tables_of(found: SetStatistics) -> Iterator[Table]:
    """Yield the tables of a set, each if there are data for it."""
    if len(found.recordings) > 1:
        yield _recordings(found)
    total = found.total
    classes = {name: each for name, each in total.classes.items() if name != DONT_CARE}
    if total.classes:
        yield _classes(total)
    if any(each.occlusion.total() or each.truncation.total() for each in classes.values()):
        yield _visibility(classes)
    if any(each.distance_m.count for each in classes.values()):
        yield _distances(classes)
        yield _boxes(classes)
    if any(each.tracks.count for each in classes.values()):
        yield _tracks(classes)
    if total.point_classes:
        yield _point_classes(total)


def _recordings(found: SetStatistics) -> Table:
    moving = found.total.route is not None
    head = ('m', 's', 'm/s', 'deg/s') if moving else ()
    table = plain_table('recording', ('frames', 'objects', *head))
    shown = found.recordings[:MOST_RECORDINGS]
    for each in (*shown, found.total):
        name = cell(each.name) or 'all'
        if each is found.total and len(shown) < len(found.recordings):
            rest = f'... and {len(found.recordings) - len(shown)} more, see --csv and --json'
            table.add_row(rest)
        objects = f'{each.objects}' if each.labelled else ''
        table.add_row(name, f'{each.frames}', objects, *(_route_cells(each) if moving else ()))
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
    rated = any(each.difficulty.total() for each in total.classes.values())
    levels = DIFFICULTIES if rated else ()
    table = plain_table('class', ('objects', 'share', 'frames', 'most', *levels))
    for name, each in total.classes.items():
        share = '' if name == DONT_CARE else f'{each.count / total.objects:.1%}'
        counts = _counts(each.difficulty, levels)
        table.add_row(cell(name), f'{each.count}', share, f'{each.frames}', f'{each.most}', *counts)
    return table


def _visibility(classes: Mapping[str, ObjectStatistics]) -> Table:
    table = plain_table('occlusion', (*_OCCLUSIONS, *_TRUNCATIONS))
    for name, each in classes.items():
        counts = _counts(each.occlusion, OCCLUSIONS) + _counts(each.truncation, TRUNCATIONS)
        table.add_row(cell(name), *counts)
    return table


def _counts(counts: Mapping[str, int], names: Sequence[str]) -> list[str]:
    """Return the cells of counts by name; empty if none is known."""
    known = any(counts.values())
    return [f'{counts[name]}' if known else '' for name in names]


def _distances(classes: Mapping[str, ObjectStatistics]) -> Table:
    bins = [
        f'{low:g}-{high:g}' if high < inf else f'{low:g}+' for low, high in pairwise(_DISTANCES_M)
    ]
    table = plain_table('distance m', ('mean', 'max', *bins))
    for name, each in classes.items():
        found = each.distance_m
        inside = [f'{_within(found, *pair)}' for pair in pairwise(_DISTANCES_M)]
        cells = [number(found.mean), number(found.greatest), *inside]
        table.add_row(cell(name), *(cells if found.count else ()))
    return table


def _within(found: Distribution, low: float, high: float) -> int:
    """Return the number of values between two edges."""
    return sum(
        count for edge, count in zip(found.edges, found.counts, strict=True) if low <= edge < high
    )


def _boxes(classes: Mapping[str, ObjectStatistics]) -> Table:
    counted = any(each.points.count for each in classes.values())
    points = ('points', 'most', 'no point') if counted else ()
    table = plain_table('box m', ('length', 'width', 'height', *points))
    for name, each in classes.items():
        sizes = [spread(found) for found in (each.length_m, each.width_m, each.height_m)]
        inside = each.points
        cells = ['', '', '']
        if inside.count:
            cells = [f'{inside.mean:.0f}', f'{inside.greatest:.0f}', f'{inside.counts[0]}']
        table.add_row(cell(name), *sizes, *(cells if counted else ()))
    return table


def _tracks(classes: Mapping[str, ObjectStatistics]) -> Table:
    table = plain_table('track frames', ('tracks', 'mean', 'least', 'most'))
    for name, each in classes.items():
        found = each.tracks
        if found.count:
            extremes = f'{found.least:.0f}', f'{found.greatest:.0f}'
            table.add_row(cell(name), f'{found.count}', number(found.mean), *extremes)
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


def spread(found: Distribution) -> str:
    """Format mean and standard deviation; empty without values."""
    if not found.count:
        return ''
    return f'{_fixed(found.mean, 2)} ± {_fixed(found.deviation, 2)}'


def _fixed(value: float, decimals: int) -> str:
    """Format with decimals; absurd values, which labels may hold, in the shortest form."""
    return f'{value:.{decimals}f}' if abs(value) < _ABSURD else f'{value:.1e}'
