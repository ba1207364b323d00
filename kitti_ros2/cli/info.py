# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 info."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..files.processes import freeze_imports
from ..model.errors import format_bytes, format_count, format_duration, one_line
from ..model.streams import Clock, format_stamp
from ..options.read import make_source_options
from .command import JsonOption, QuietOption, argument, takes
from .exits import EXIT_LOSSES, EXIT_OK
from .output import cell, console, plain_table, print_json, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table

    from ..bags.container_file import TopicSummary
    from ..model.recording import FrameOrigin
    from ..options.read import ReadOptions
    from ..report.overview import LinkSummary, Overview


_MOST_FRAMES = 24


def inspect_source(path: Path, options: ReadOptions) -> Overview:
    """Return the overview of a bag, or of a KITTI folder."""
    from ..bags.bag_files import OpenBag
    from ..bags.open_source import open_source
    from ..kitti.opening import describe_below
    from ..kitti.store import cached_listings
    from ..report.overview import inspect_bag, inspect_recording

    freeze_imports()
    with cached_listings():
        source = open_source(path, options)
        if not isinstance(source, OpenBag):
            overview = inspect_recording(source, path)
            return replace(overview, notes=(*overview.notes, *describe_below(path, options)))
    with source as bag:
        return inspect_bag(bag)[0]


def _values(overview: Overview) -> dict[str, object]:
    """Return the overview for JSON; times in nanoseconds, sizes in bytes."""
    values = asdict(overview)
    if overview.compression is None:
        for series in values['series']:
            series['frames'] = series.pop('msgtype')
    return values


def print_overview(overview: Overview) -> None:
    """Print the overview as tables for a terminal of 80 columns."""
    from ..report.overview import MOST_SERIES, describe_rest

    screen = console(soft_wrap=True)
    compression = f', compression {overview.compression}' if overview.compression else ''
    head = f'{overview.path}  {overview.kind}: {overview.name}{compression}'
    screen.print(one_line(head), style='bold', markup=False)
    screen.print(_extent(overview), markup=False)
    kind = 'stream' if overview.compression is None else 'topic'
    timed = overview.clock is not Clock.NOMINAL
    table = plain_table(kind, ('count', 'Hz', 'gap') if timed else ('count',))
    table.add_column('frames' if kind == 'stream' else 'type', overflow='fold')
    for series in overview.series[:MOST_SERIES]:
        kind_of = cell(_short_type(series.msgtype))
        rates = _rates(series) if timed else ()
        table.add_row(cell(series.name), f'{series.count}', *rates, kind_of)
    screen.print(table, soft_wrap=False)
    if len(overview.series) > MOST_SERIES:
        rest = describe_rest([series.count for series in overview.series[MOST_SERIES:]], kind)
        screen.print(f'{rest}; all with --json', markup=False)
    if overview.cameras:
        screen.print(_camera_table(overview), soft_wrap=False)
        if len(overview.cameras) > MOST_SERIES:
            screen.print(f'... and {len(overview.cameras) - MOST_SERIES:,} more; all with --json')
    if overview.links:
        screen.print(_link_table(overview), soft_wrap=False)
    if overview.origins:
        screen.print(_origin_table(overview.origins), soft_wrap=False)
    for note in overview.notes:
        screen.print(one_line(f'note: {note}'), markup=False)


def _extent(overview: Overview) -> str:
    total = sum(series.count for series in overview.series)
    noun = 'sample' if overview.compression is None else 'message'
    parts = [format_count(total, noun)]
    if overview.frames is not None:
        parts.append(format_count(overview.frames, 'frame'))
    parts.append(format_bytes(overview.size_bytes))
    if overview.duration_ns is not None:
        parts.append(format_duration(overview.duration_ns))
    if overview.start_ns is not None:
        parts.append(f'from {format_stamp(overview.start_ns)} UTC')
    if total and overview.clock is not Clock.UTC:
        parts.append('no time stamps' if overview.clock is Clock.NOMINAL else 'no date')
    return ', '.join(parts)


def _rates(series: TopicSummary) -> tuple[str, str]:
    rate = '' if series.mean_rate_hz is None else f'{series.mean_rate_hz:.1f}'
    gap = '' if series.largest_gap_ns is None else f'{series.largest_gap_ns / 1e9:.2f}'
    return rate, gap


def _short_type(msgtype: str) -> str:
    return msgtype.rsplit('/', 1)[-1]


def _camera_table(overview: Overview) -> Table:
    from ..report.overview import MOST_SERIES

    table = plain_table('camera', ('size', 'fx', 'fy', 'cx', 'cy', 'baseline m'))
    for camera in overview.cameras[:MOST_SERIES]:
        size = f'{camera.width}x{camera.height}' if camera.width else 'by image'
        name, *numbers = camera.cells()
        table.add_row(cell(name), size, *numbers)
    return table


def _origin_table(origins: Mapping[int, FrameOrigin]) -> Table:
    """Return a table of the raw drives' frames, in order of time."""
    table = plain_table('frame')
    for heading in ('drive', 'number', 'stamp UTC'):
        table.add_column(heading, no_wrap=True, justify='right' if heading == 'number' else 'left')
    rows = sorted(origins.items(), key=lambda row: (row[1].stamp_ns, row[0]))
    for number, origin in rows[:_MOST_FRAMES]:
        stamp = format_stamp(origin.stamp_ns)
        table.add_row(f'{number}', origin.drive, f'{origin.number}', stamp)
    if len(rows) > _MOST_FRAMES:
        table.add_row('...', f'{len(rows) - _MOST_FRAMES} more; all with --json', '', '')
    return table


def _link_table(overview: Overview) -> Table:
    """Return a table of the static tree, each frame indented below its parent."""
    table = plain_table('frame', ('x y z m', 'roll pitch yaw deg'))
    children: dict[str, list[LinkSummary]] = {}
    for link in overview.links:
        children.setdefault(link.parent, []).append(link)
    placed = {link.child for link in overview.links}

    def add(frame: str, depth: int, link: LinkSummary | None) -> None:
        if table.row_count == _MOST_FRAMES:
            table.add_row(f'... and {len(overview.links) + 1 - _MOST_FRAMES} more', '', '')
        if table.row_count > _MOST_FRAMES:
            return
        xyz = '' if link is None else ' '.join(f'{value + 0.0:.2f}' for value in link.xyz_m)
        rpy = '' if link is None else ' '.join(f'{value + 0.0:.1f}' for value in link.rpy_deg)
        table.add_row('  ' * depth + cell(frame), xyz, rpy)
        for child in children.pop(frame, []):
            add(child.child, depth + 1, child)

    for root in [parent for parent in children if parent not in placed]:
        add(root, 0, None)
    return table


@takes('SOURCE', of='read')
def info(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or any bag')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Summarize a KITTI folder or a bag.

    Layout or container, streams with counts, rates and gaps, calibration.

    Examples:
      kitti-ros2 info 2011_09_26/2011_09_26_drive_0005_sync
      kitti-ros2 info drive_0005.mcap --json
    """
    overview = inspect_source(src, make_source_options(given))
    if json:
        print_json(_values(overview))
    else:
        if not quiet:
            print_overview(overview)
        show_losses(overview.losses)
    return EXIT_LOSSES if overview.losses or not overview.complete else EXIT_OK
