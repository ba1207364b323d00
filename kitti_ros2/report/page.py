# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML page: its templates, filled with what a report contains; no external resources."""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.ext import Extension
from jinja2.lexer import Token

from .. import __version__
from ..model.containers import CONTAINERS
from ..model.layouts import Layout
from ..model.stamps import format_stamp
from ..model.streams import Clock
from ..model.text import format_bytes, format_count, format_duration
from .contents import Severity
from .plots import class_colour
from .scores_section import scores_section
from .sections import calibration_section, frames_section, objects_section, route_section
from .streams_section import streams_section

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jinja2.lexer import TokenStream

    from .contents import Report
    from .overview import Overview

_BREAKS = re.compile(r'(?<=[/_.-])(?=\w)|(?<=[a-z])(?=[A-Z])')
_LINES = re.compile(r'\s*\n\s*')
_KINDS = {
    **{layout.value: layout.traits.title for layout in Layout},
    **{
        name: f'{each.title} bag' if each.in_file else f'{each.title} bag of rosbag2'
        for name, each in CONTAINERS.items()
    },
    **{f'rosbag2 {name}': f'rosbag2 bag, {each.title}' for name, each in CONTAINERS.items()},
}


def make_page(report: Report) -> str:
    """Make the HTML document of a report."""
    overview = report.overview
    sections = (
        ('findings', 'Findings', _findings_section(report)),
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
    """Return the templates, which escape every value that they do not mark as safe."""
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
        'pieces': _BREAKS.split,
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
    found = []
    if report.frames is not None:
        found.append(('frames', f'{report.frames:,}'))
    else:
        total = sum(series.count for series in overview.series)
        found.append(('samples' if overview.compression is None else 'messages', f'{total:,}'))
    if overview.duration_ns is not None:
        found.append(('duration', format_duration(overview.duration_ns)))
    if report.route is not None:
        found.append(('driven', metres(report.route.length_m)))
    if report.classes is not None:
        found.append(('labelled objects', f'{report.classes.count:,}'))
    noun = 'streams' if overview.compression is None else 'topics'
    found.append((noun, f'{len(overview.series)}'))
    found.append(('size', format_bytes(overview.size_bytes)))
    return found


def metres(length: float) -> str:
    """Format a distance, such as 107.0 m or 3.72 km."""
    return f'{length:.1f} m' if length < 1000 else f'{length / 1000:.2f} km'


def _findings_section(report: Report) -> dict[str, object]:
    """Return the verdict and the findings, without the path of the folder: the footer has it."""
    folder = str(report.overview.path.absolute())
    findings = [
        replace(each, text=each.text.replace(f'{folder}/', '').removeprefix(f'{folder}: '))
        for each in report.findings
    ]
    return {
        'verdict': f'{report.verdict[:1].upper()}{report.verdict[1:]}.',
        'serious': [each for each in findings if each.severity is not Severity.NOTE],
        'notes': [each for each in findings if each.severity is Severity.NOTE],
    }
