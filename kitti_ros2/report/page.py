# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML page: head, summary, findings and sections, without external resources."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from .. import __version__
from ..model.containers import CONTAINERS
from ..model.layouts import Layout
from ..model.stamps import format_stamp
from ..model.streams import Clock
from ..model.text import format_bytes, format_count, format_duration
from .contents import Severity
from .markup import Markup, breakable, element, join
from .sections import calibration_section, objects_section, route_section, scenes_section
from .streams_section import streams_section
from .style import STYLE

if TYPE_CHECKING:
    from pathlib import Path

    from .contents import Finding, Report
    from .overview import Overview

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""For browsers: load nothing, run nothing."""

_ICONS = {
    Severity.LOSS: 'M11 2 21 20H1zM11 8v5M11 15.6v1.4',
    Severity.WARNING: 'M11 2 21 20H1zM11 8v5M11 15.6v1.4',
    Severity.NOTE: 'M11 2a9 9 0 1 0 .01 0zM11 10v5.4M11 6.4v1.2',
}
_WELL = 'M11 2a9 9 0 1 0 .01 0zM6.8 11.4l3 3 5.4-6'
_KINDS = {
    **{layout.value: layout.traits.title for layout in Layout},
    **{
        name: f'{each.title} bag' if each.in_file else f'{each.title} bag of rosbag2'
        for name, each in CONTAINERS.items()
    },
    **{f'rosbag2 {name}': f'rosbag2 bag, {each.title}' for name, each in CONTAINERS.items()},
}


def make_page(report: Report) -> Markup:
    """Make the HTML document of a report."""
    overview = report.overview
    sections = [
        ('findings', 'Findings', _findings(report)),
        ('frames', 'Frames', scenes_section(report)),
        ('streams', 'Streams', streams_section(report)),
        ('route', 'Route', route_section(report)),
        ('objects', 'Objects', objects_section(report)),
        ('calibration', 'Calibration', calibration_section(report)),
    ]
    present = [(key, title, body) for key, title, body in sections if body]
    head = element(
        'head',
        element('meta', charset='utf-8'),
        element('meta', name='viewport', content='width=device-width, initial-scale=1'),
        element('meta', http_equiv='Content-Security-Policy', content=_POLICY),
        element('meta', name='generator', content=f'kitti_ros2 {__version__}'),
        element('title', f'{_name(overview)}: report'),
        element('link', rel='icon', href='data:,'),
        element('style', Markup(STYLE)),
    )
    contents = element(
        'nav',
        element(
            'ul', [element('li', element('a', title, href=f'#{key}')) for key, title, _ in present]
        ),
        aria_label='Contents',
    )
    body = element(
        'body',
        element('a', 'Skip to the findings', class_='skip', href='#main'),
        element(
            'div',
            element('header', _summary(report), contents),
            element('main', [_section(*part) for part in present], id='main', tabindex='-1'),
            element('footer', f'Made by kitti_ros2 {__version__} from {overview.path}.'),
            class_='column',
        ),
    )
    return Markup('<!DOCTYPE html>\n' + element('html', head, body, lang='en') + '\n')


def _section(key: str, title: str, body: Markup) -> Markup:
    heading = element('h2', title, id=f'{key}-heading')
    return element('section', heading, body, id=key, aria_labelledby=f'{key}-heading')


def _summary(report: Report) -> Markup:
    overview = report.overview
    kind = _KINDS.get(overview.kind, f'Bag, {overview.kind}')
    return join(
        [
            element('p', kind, class_='eyebrow'),
            element('h1', breakable(_name(overview))),
            element('p', _sentence(report), class_='summary'),
            element(
                'dl',
                [
                    element('div', element('dt', name), element('dd', value))
                    for name, value in _figures(report)
                ],
                class_='figures',
            ),
        ]
    )


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


def _findings(report: Report) -> Markup:
    findings = [_shortened(each, report.overview.path) for each in report.findings]
    serious = [each for each in findings if each.severity is not Severity.NOTE]
    notes = [each for each in findings if each.severity is Severity.NOTE]
    verdict = f'{report.verdict[:1].upper()}{report.verdict[1:]}.'
    if serious:
        top = join(
            [
                element('p', verdict, class_='lead'),
                element('ul', [_finding(each) for each in serious], class_='findings'),
            ]
        )
    else:
        well = element(
            'li',
            _icon(_WELL),
            element('span', verdict),
            class_='well',
        )
        top = element('ul', well, class_='findings')
    if not notes:
        return top
    listed = element('ul', [_finding(each) for each in notes], class_='findings')
    if not serious and len(notes) <= 3:
        return join([top, listed])
    folded = element('summary', format_count(len(notes), 'note'))
    return join([top, element('details', folded, listed)])


def _shortened(finding: Finding, path: Path) -> Finding:
    """Remove the path of the folder from a finding: the footer contains it."""
    return replace(finding, text=finding.text.replace(f'{path.absolute()}/', ''))


def _finding(finding: Finding) -> Markup:
    where = (element('span', finding.where, class_='where'), ': ') if finding.where else None
    severity = finding.severity
    words = element('span', element('strong', f'{severity.value}.'), ' ', where, finding.text)
    return element('li', _icon(_ICONS[severity]), words, class_=severity.name.lower())


def _icon(path: str) -> Markup:
    drawn = element(
        'path',
        d=path,
        fill='none',
        stroke='currentColor',
        stroke_width='2',
        stroke_linecap='round',
        stroke_linejoin='round',
    )
    return element('svg', drawn, viewBox='0 0 22 22', class_='icon', aria_hidden='true')
