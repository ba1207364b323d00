# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML page: templates, filled with the contents of a report; no external resources."""

from __future__ import annotations

import os
import re
from base64 import b64encode
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.ext import Extension
from jinja2.lexer import Token

from .. import __version__
from ..model.bag_formats import CONTAINERS
from ..model.boxes import OCCLUSIONS, Difficulty
from ..model.errors import format_bytes, format_count, format_duration
from ..model.streams import Clock, Layout, format_stamp
from .contents import LONG, NAME, NUMBER, TEXT, Severity, Table, histogram
from .overview import MOST_SERIES, describe_rest
from .plots import (
    MOST_FRAMES,
    class_colour,
    course_plot,
    curves_plot,
    format_period,
    histogram_plot,
    interval_plot,
    mounts_of,
    rig_plot,
    route_plot,
    shares_bar,
    strip,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from jinja2.lexer import TokenStream

    from ..evaluation.detection import DetectionScores
    from ..evaluation.object_benchmark import Curve
    from ..model.recording import Route
    from .contents import ClassFacts, ClassStatistics, Report, StreamFacts
    from .overview import CameraSummary, Overview
    from .plots import Mount


# The values of the section of a detector's scores; None without results.

_ROWS = {'2d': '2D', 'aos': 'Orientation', 'bev': "Bird's-eye view", '3d': '3D'}
_PLOTTED = '3d'
_NONE = '\N{EN DASH}'


def scores_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of scores."""
    scores = report.scores
    if scores is None:
        return None
    words = (
        f'Average precision by the rules of the object benchmark over'
        f' {format_count(scores.frames, "frame")}, percent: at 40 values of recall, and at 11 in'
        f' brackets.'
    )
    plots = {name: _curves_plot(name, metrics[_PLOTTED]) for name, metrics in scores.scores.items()}
    return {
        'words': words,
        'tables': [_scores_table(class_name, scores) for class_name in scores.scores],
        'plots': [(class_name, plot) for class_name, plot in plots.items() if plot],
    }


def _scores_table(class_name: str, scores: DetectionScores) -> Table:
    columns = [('Metric', TEXT), *((level.value, NUMBER) for level in Difficulty)]
    rows = [
        [title, *(_format_curve(scores.scores[class_name][name][level]) for level in Difficulty)]
        for name, title in _ROWS.items()
    ]
    return Table(f'{class_name}, IoU above {scores.limits[class_name]:g}', columns, rows)


def _format_curve(curve: Curve | None) -> str:
    if curve is None or not curve.objects:
        return _NONE
    return f'{curve.r40:.2f} ({curve.r11:.2f})'


def _curves_plot(class_name: str, curves: Mapping[Difficulty, Curve | None]) -> str:
    """Draw the curves of a class; empty without any."""
    precisions = {
        level.value: 100 * curve.values
        for level, curve in curves.items()
        if curve is not None and curve.objects
    }
    if not precisions:
        return ''
    recall = np.linspace(0, 100, len(next(iter(precisions.values()))))
    key = ''.join(letter if letter.isalnum() else '-' for letter in class_name)
    return curves_plot(f'curves-{key}', f'Precision of {class_name} in 3D', recall, precisions)


# The values of the sections of frames, route, objects and calibration; None without data.

_EDGES_M = tuple(range(0, 100, 10))
_MOST_HISTOGRAMS = 9


def frames_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section with pictures of a few frames."""
    if not report.scenes:
        return None
    frames = report.frames or len(report.scenes)
    timed = report.clock is Clock.UTC
    return {'scenes': report.scenes, 'frames': f'{frames:,}', 'timed': timed}


def route_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of the route."""
    route = report.route
    if route is None:
        return None
    speed = ''
    if report.clock is not Clock.NOMINAL and route.duration_s > 0:
        speed = f', {route.length_m / route.duration_s:.1f} m/s in the mean'
    climb = float(np.ptp(route.positions[:, 2]))
    words = (
        f'{route.length_m:.1f} m along {len(route.positions):,} poses{speed};'
        f' {route.net_m:.1f} m from start to end, {climb:.1f} m between the lowest and the highest.'
    )
    plot = route_plot('route-plot', route.positions[:, :2], words)
    return {
        'words': words,
        'jumps': route.jumps,
        'timed': report.clock is not Clock.NOMINAL,
        'plot': plot,
        'courses': list(_time_plots(route)),
    }


def _time_plots(route: Route) -> Iterator[tuple[str, str, str]]:
    """Yield name, extent and plot of speed, altitude and yaw over time."""
    times = (route.stamps_ns - route.stamps_ns[0]) / 1e9
    heights, origin, axis = route.positions[:, 2] - route.positions[0, 2], 'the start', 'the x axis'
    if route.altitude_m is not None:
        heights, origin, axis = route.positions[:, 2] + route.altitude_m, 'sea level', 'east'
    courses = (
        ('Speed', 'm/s', route.speeds_m_s, ''),
        ('Altitude', 'm', heights, f'above {origin}'),
        ('Yaw', 'deg', np.degrees(route.yaws_rad), f'counter-clockwise from {axis}'),
    )
    for name, unit, values, note in courses:
        finite = np.isfinite(values)
        if finite.sum() > 1:
            plot = course_plot(f'course-{name.lower()}', name, times[finite], values[finite], unit)
            extent = f'{np.nanmin(values):.1f} to {np.nanmax(values):.1f} {unit}'
            yield name, f'{extent} {note}', plot


def objects_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of labelled objects."""
    classes = report.classes
    if classes is None:
        return None
    words = (
        f'{classes.count:,} objects in {classes.labelled:,} of {classes.frames:,} frames'
        f' ({classes.count / max(classes.frames, 1):.1f} a frame).'
    )
    if classes.dont_care:
        words += f' {classes.dont_care:,} regions are without labels (DontCare).'
    distances = [
        (
            facts.class_name,
            f'{np.median(facts.distances_m):.1f} m',
            histogram_plot(
                f'distance-{index}',
                f'Distances of {facts.class_name}',
                _EDGES_M,
                histogram(facts.distances_m, _EDGES_M),
                'metres from the scanner',
                class_colour(facts.class_name),
            ),
        )
        for index, facts in enumerate(classes.classes[:_MOST_HISTOGRAMS])
        if len(facts.distances_m)
    ]
    return {'words': words, 'table': _class_table(classes), 'distances': distances}


def _class_table(classes: ClassStatistics) -> Table:
    facts_by_class = classes.classes
    occluded = any(facts.occlusions is not None for facts in facts_by_class)
    tracked = any(facts.tracks is not None for facts in facts_by_class)
    cut = any(facts.truncated is not None for facts in facts_by_class)
    columns = [('Class', TEXT), ('Objects', NUMBER), ('Frames', NUMBER), ('A frame', NUMBER)]
    columns += [('Most', NUMBER)] + [('Tracks', NUMBER)] * tracked
    columns += [(name.capitalize(), NUMBER) for name in OCCLUSIONS if occluded]
    columns += [('Occlusion', TEXT)] * occluded + [('Truncated', NUMBER)] * cut
    rows = [
        [
            facts.class_name,
            f'{facts.count:,}',
            f'{facts.frames:,}',
            f'{facts.count / max(classes.frames, 1):.2f}',
            f'{facts.most:,}',
            *([_count(facts.tracks)] if tracked else []),
            *(_occlusions(facts) if occluded else []),
            *([_count(facts.truncated)] if cut else []),
        ]
        for facts in facts_by_class
    ]
    return Table('Labelled objects by class', columns, rows)


def _count(count: int | None) -> str:
    return '' if count is None else f'{count:,}'


def _occlusions(facts: ClassFacts) -> list[str]:
    if facts.occlusions is None:
        return [''] * (len(OCCLUSIONS) + 1)
    return [*(f'{count:,}' for count in facts.occlusions), shares_bar(facts.occlusions)]


def calibration_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of sensor poses and camera intrinsics."""
    mounts = mounts_of(report.overview.links)
    cameras = report.overview.cameras
    if not (report.projections or len(mounts) > 1 or cameras):
        return None
    values: dict[str, object] = {
        'projections': report.projections,
        'mounts': None,
        'cameras': _camera_table(cameras) if cameras else None,
    }
    if len(mounts) > 1:
        drawn = mounts[:MOST_FRAMES]
        values |= {
            'mounts': _mount_table(mounts),
            'not_drawn': len(mounts) - len(drawn),
            'above': rig_plot('rig-top', drawn, side=False),
            'beside': rig_plot('rig-side', drawn, side=True),
        }
    return values


def _mount_table(mounts: Sequence[Mount]) -> Table:
    order = {mount.name: str(index + 1) for index, mount in enumerate(mounts)}
    columns = [('Frame', TEXT), ('On', NUMBER), ('Distance m', NUMBER)]
    columns += [(f'{axis} m', NUMBER) for axis in 'xyz']
    columns += [(f'{angle} \N{DEGREE SIGN}', NUMBER) for angle in ('Roll', 'Pitch', 'Yaw')]
    rows = [
        [
            {'order': order[mount.name], 'name': mount.name},
            order[mount.parent] if mount.parent else '',
            f'{mount.distance_m:.3f}' if mount.parent else '',
            *([f'{value + 0.0:.3f}' for value in mount.xyz_m] or [''] * 3),
            *([f'{value + 0.0:.2f}' for value in mount.rpy_deg] or [''] * 3),
        ]
        for mount in mounts
    ]
    return Table('Where each frame is in the axes of the one that it is on', columns, rows)


def _camera_table(cameras: Sequence[CameraSummary]) -> Table:
    columns = [('Camera', TEXT), ('Size', NUMBER)]
    columns += [(name, NUMBER) for name in ('fx', 'fy', 'cx', 'cy', 'Field of view', 'Baseline m')]
    rows = []
    for camera in cameras:
        name, *pixels, baseline = camera.cells()
        size = (
            f'{camera.width} \N{MULTIPLICATION SIGN} {camera.height}'
            if camera.width
            else 'by image'
        )
        rows.append([name, size, *pixels, _field_of_view(camera), baseline])
    return Table('Intrinsics of the rectified cameras, in pixels', columns, rows)


def _field_of_view(camera: CameraSummary) -> str:
    if not camera.width or camera.fisheye or camera.fx is None or camera.fx <= 0:
        return ''
    angle = 2 * np.degrees(np.arctan(camera.width / 2 / camera.fx))
    return f'{angle:.1f}\N{DEGREE SIGN}'


# The values of the section of streams: times, counts, rates, jitter, gaps and sizes.

_MOST_PLOTS = 9
_FEWEST_SAMPLES = 3


def streams_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section; None without streams."""
    if not report.streams:
        return None
    timed = report.clock is not Clock.NOMINAL
    shown, left_out = report.streams[:MOST_SERIES], report.streams[MOST_SERIES:]
    start_ns, end_ns = _extent(report)
    coverage = [
        (
            facts.name,
            len(facts.timing.gaps),
            strip(facts.timing, start_ns - facts.clock_offset_ns, end_ns - facts.clock_offset_ns),
        )
        for facts in shown
        if len(facts.timing)
    ]
    return {
        'timed': timed,
        'table': _streams_table(report, shown),
        'rest': _rest(report, left_out),
        'span': f', {(end_ns - start_ns) / 1e9:.1f} s' if timed else '',
        'coverage': coverage,
        'intervals': _intervals(shown) if timed else (),
        'most': _MOST_PLOTS,
    }


def _rest(report: Report, left_out: Sequence[StreamFacts]) -> str:
    """Describe the streams that are not on the page; empty if all are."""
    if not left_out:
        return ''
    kind = 'stream' if report.overview.compression is None else 'topic'
    rest = describe_rest([len(stream.timing) for stream in left_out], kind)
    return f'{rest}; kitti-ros2 info --json lists all.'


def _streams_table(report: Report, shown: Sequence[StreamFacts]) -> Table:
    of_bag = report.overview.compression is not None
    timed = report.clock is not Clock.NOMINAL
    columns: list[tuple[tuple[str, str], Callable[[StreamFacts], str]]] = [
        (('Topic' if of_bag else 'Stream', NAME), lambda facts: facts.name),
        (('Messages' if of_bag else 'Samples', NUMBER), lambda facts: f'{len(facts.timing):,}'),
    ]
    if timed:
        columns += [
            (('Rate Hz', NUMBER), lambda facts: _value(facts.timing.rate_hz, 1)),
            (('Jitter ms', NUMBER), _jitter),
            (('Gaps', NUMBER), _gap_count),
            (('Longest s', NUMBER), lambda facts: _value(_longest_gap_ns(facts), 1e9)),
        ]
    if any(facts.delay_ns is not None for facts in shown):
        columns.append((('Delay ms', NUMBER), _delay))
    if not of_bag:
        columns.append((('Files', NUMBER), lambda facts: f'{facts.files or 0:,}'))
    columns.append((('Size', NUMBER), _size))
    # Of a message type, without its package, as in info.
    detail = ('Type' if of_bag else 'Frames', TEXT)
    columns.append((detail, lambda facts: facts.detail.rsplit('/', 1)[-1]))
    columns.append((('Content', LONG), _facts))
    # Columns that are empty for all streams are removed.
    columns = [(heading, cell) for heading, cell in columns if any(cell(facts) for facts in shown)]
    rows = [[cell(facts) for _, cell in columns] for facts in shown]
    totals = {
        columns[0][0]: 'All',
        columns[1][0]: f'{sum(len(stream.timing) for stream in report.streams):,}',
        ('Size', NUMBER): format_bytes(report.overview.size_bytes),
    }
    total = [totals.get(heading, '') for heading, _ in columns]
    delayed = any(heading == ('Delay ms', NUMBER) for heading, _ in columns)
    caption = _caption(of_bag=of_bag, timed=timed, delayed=delayed)
    return Table(caption, [heading for heading, _ in columns], rows, total)


def _caption(*, of_bag: bool, timed: bool, delayed: bool) -> str:
    jitter = ' Jitter: 95 of 100 intervals differ from the median by no more.' if timed else ''
    delay = ' Delay: from the stamp in a message to its log time, median.' if delayed else ''
    if of_bag:
        sizes = 'Sizes are of messages uncompressed, in the last line of the bag.'
        return f'Topics.{jitter}{delay} {sizes}'
    return f'Streams.{jitter} Some share files.'


def _jitter(stream: StreamFacts) -> str:
    return _value(stream.timing.jitter_ns, 1e6) if stream.timing.period_ns else ''


def _gap_count(stream: StreamFacts) -> str:
    return f'{len(stream.timing.gaps):,}' if stream.timing.regular else ''


def _longest_gap_ns(stream: StreamFacts) -> int | None:
    return max((gap.length_ns for gap in stream.timing.gaps), default=None)


def _size(stream: StreamFacts) -> str:
    return '' if stream.size_bytes is None else format_bytes(stream.size_bytes)


def _delay(stream: StreamFacts) -> str:
    return '' if stream.clock_offset_ns else _value(stream.delay_ns, 1e6)


def _facts(stream: StreamFacts) -> str:
    words = list(stream.facts)
    if stream.clock_offset_ns:
        words.append(
            f'stamps of another clock, {stream.clock_offset_ns / 1e9:.0f} s behind the log'
        )
    return '; '.join(words)


def _value(value: float | None, scale: float) -> str:
    return '' if value is None else f'{value / scale:.2f}'


def _extent(report: Report) -> tuple[int, int]:
    """Return the first and the last time of all samples, 0 without any."""
    spans = [
        stream.timing.stamps_ns[[0, -1]] + stream.clock_offset_ns
        for stream in report.streams
        if len(stream.timing)
    ]
    bounds = (report.overview.start_ns, report.overview.end_ns)
    times = [bound for bound in bounds if bound is not None]
    times += [int(time) for span in spans for time in span]
    return min(times, default=0), max(times, default=0)


def _intervals(streams: Sequence[StreamFacts]) -> list[tuple[str, str, str]]:
    """Return names, median and plot of each series of stamps; streams with equal stamps share one.

    Series with gaps come first.
    """
    alike: dict[bytes, list[StreamFacts]] = {}
    for stream in streams:
        if len(stream.timing) > _FEWEST_SAMPLES and stream.timing.period_ns:
            alike.setdefault(stream.timing.stamps_ns.tobytes(), []).append(stream)
    plots = []
    for index, group in enumerate(sorted(alike.values(), key=lambda some: not some[0].timing.gaps)):
        names, timing = ', '.join(facts.name for facts in group), group[0].timing
        plot = interval_plot(f'interval-{index}', names, timing)
        plots.append((names, format_period(timing.period_ns or 0), plot))
    return plots


_BREAKS = re.compile(r'(?<=[/_.-])(?=\w)|(?<=[a-z])(?=[A-Z])')
_LINES = re.compile(r'\s*\n\s*')
_KINDS = {
    **{layout.value: layout.traits.title for layout in Layout},
    **{
        name: f'{kind.title} bag' if kind.in_file else f'{kind.title} bag of rosbag2'
        for name, kind in CONTAINERS.items()
    },
    **{f'rosbag2 {name}': f'rosbag2 bag, {kind.title}' for name, kind in CONTAINERS.items()},
}


def make_page(report: Report) -> str:
    """Make the HTML document of a report."""
    overview = report.overview
    sections = (
        ('findings', 'Findings', _issues_section(report)),
        ('frames', 'Frames', frames_section(report)),
        ('streams', 'Streams', streams_section(report)),
        ('route', 'Route', route_section(report)),
        ('objects', 'Objects', objects_section(report)),
        ('scores', 'Scores', scores_section(report)),
        ('calibration', 'Calibration', calibration_section(report)),
    )
    page = environment().get_template('page.html')
    return printable(
        page.render(
            version=__version__,
            path=overview.path,
            name=_name(overview),
            kind=_KINDS.get(overview.kind, f'Bag, {overview.kind}'),
            sentence=_sentence(report),
            figures=_figures(report),
            sections=[section for section in sections if section[2] is not None],
        )
    )


class _JoinedLines(Extension):
    """Removes line breaks and indentation of HTML templates from the page."""

    def filter_stream(self, stream: TokenStream) -> Iterator[Token]:
        """Yield the tokens of a template, its text without line breaks."""
        for token in stream:
            if token.type == 'data' and (stream.name or '').endswith('.html'):
                yield Token(token.lineno, token.type, _LINES.sub('', token.value))
            else:
                yield token


@cache
def environment() -> Environment:
    """Return the templates; values are escaped unless marked as safe."""
    environment = Environment(
        loader=PackageLoader('kitti_ros2.report'),
        extensions=[_JoinedLines],
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        'base64': lambda data: b64encode(data).decode('ascii'),
        'colour': class_colour,
        'counted': format_count,
        'parts': _BREAKS.split,
        'time_of_day': lambda stamp_ns: format_stamp(stamp_ns)[11:-6],
    }
    return environment


def printable(page: str) -> str:
    """Replace characters that are invalid in HTML: control characters and lone surrogates."""
    # Pages are megabytes of pictures; this is 20 times faster than a search for each character.
    if page.replace('\n', '').replace('\t', '').isprintable():
        return page
    invalid = {character for character in set(page) - {'\n', '\t'} if not character.isprintable()}
    return page.translate(dict.fromkeys(map(ord, invalid), '\N{REPLACEMENT CHARACTER}'))


def _name(overview: Overview) -> str:
    """Return the name; for a bag that of its path, also for a directory with several files."""
    return overview.name if overview.compression is None else overview.path.absolute().name


def _sentence(report: Report) -> str:
    overview = report.overview
    if not any(series.count for series in overview.series):
        return 'There is nothing in it.'
    if report.clock is Clock.NOMINAL:
        when = 'Its layout has no time stamps.'
    elif overview.start_ns is None or overview.end_ns is None:
        when = 'It has times from its start, and no date.'
    else:
        start, end = format_stamp(overview.start_ns), format_stamp(overview.end_ns)
        day = start[:10] if start[:10] != end[:10] else ''
        when = (
            f'Recorded {start[:-6]} to {end[:-6]} UTC.'
            if day
            else f'Recorded on {start[:10]} from {start[11:-6]} to {end[11:-6]} UTC.'
        )
    compression = overview.compression
    packed = '' if compression in {None, 'none'} else f' Compressed by {compression}.'
    return when + packed


def _figures(report: Report) -> list[tuple[str, str]]:
    overview = report.overview
    figures = []
    if report.frames is not None:
        figures.append(('frames', f'{report.frames:,}'))
    else:
        total = sum(series.count for series in overview.series)
        figures.append(('samples' if overview.compression is None else 'messages', f'{total:,}'))
    if overview.duration_ns is not None:
        figures.append(('duration', format_duration(overview.duration_ns)))
    if report.route is not None:
        figures.append(('driven', metres(report.route.length_m)))
    if report.classes is not None:
        figures.append(('labelled objects', f'{report.classes.count:,}'))
    noun = 'streams' if overview.compression is None else 'topics'
    figures.append((noun, f'{len(overview.series)}'))
    figures.append(('size', format_bytes(overview.size_bytes)))
    return figures


def metres(length: float) -> str:
    """Format a distance, such as 107.0 m or 3.72 km."""
    return f'{length:.1f} m' if length < 1000 else f'{length / 1000:.2f} km'


def _issues_section(report: Report) -> dict[str, object]:
    """Return the verdict and the issues, without the path of the folder: the footer has it."""
    folder = str(report.overview.path.absolute())
    issues = [
        replace(issue, text=issue.text.replace(f'{folder}/', '').removeprefix(f'{folder}: '))
        for issue in report.issues
    ]
    return {
        'verdict': f'{report.verdict[:1].upper()}{report.verdict[1:]}.',
        'serious': [issue for issue in issues if issue.severity is not Severity.NOTE],
        'notes': [issue for issue in issues if issue.severity is Severity.NOTE],
    }


# The HTML page that lists the reports of a collection.


@dataclass(frozen=True)
class IndexEntry:
    """The report of a recording or bag.

    Attributes:
        name: Name of the recording or bag in the collection.
        page: Its report, relative to the index.
        frames: Number of frames.
        losses: Number of issues that are losses.
    """

    name: str
    page: Path
    frames: int
    losses: int

    @property
    def address(self) -> str:
        """The link to the report."""
        return f'./{quote(os.fsencode(self.page))}'


def make_index(name: str, entries: Sequence[IndexEntry]) -> str:
    """Make the HTML document that lists reports.

    Args:
        name: Name of the collection.
        entries: The reports, in their order.
    """
    page = environment().get_template('index.html')
    return printable(page.render(version=__version__, name=name, entries=entries))
