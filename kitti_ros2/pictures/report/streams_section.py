# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The section of streams: when each has samples, how many, how evenly, how large."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...quantities import format_bytes
from .contents import Clock
from .markup import Markup, element, join
from .plots import interval_plot, strip
from .tables import LONG, NUMBER, TEXT, captioned, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .contents import Report, StreamFacts
    from .markup import Child
    from .statistics import Timing

_MOST_PLOTS = 9
_FEWEST_SAMPLES = 3


def streams_section(report: Report) -> Markup | None:
    """All of it; None where there is no stream."""
    if not report.streams:
        return None
    nominal = report.clock is Clock.NOMINAL
    parts: list[Child] = [_table(report)]
    if report.overview.start_ns is not None and report.overview.end_ns is not None:
        parts.append(_coverage(report.streams, report.overview.start_ns, report.overview.end_ns))
    if nominal:
        words = 'The layout tells no times: rates, jitter and gaps in time cannot be told.'
        parts.insert(0, element('p', words, class_='lead'))
    else:
        parts.append(_intervals(report.streams))
    return join(parts)


def _table(report: Report) -> Markup:
    of_bag = report.overview.compression is not None
    noun = 'Topic' if of_bag else 'Stream'
    columns = [
        (noun, TEXT),
        ('Messages' if of_bag else 'Samples', NUMBER),
        ('Rate Hz', NUMBER),
        ('Jitter ms', NUMBER),
        ('Gaps', NUMBER),
        ('Longest gap s', NUMBER),
        *([] if of_bag else [('Files', NUMBER)]),
        ('Size', NUMBER),
        ('Type' if of_bag else 'Frames', TEXT),
        ('Content', LONG),
    ]
    nominal = report.clock is Clock.NOMINAL
    rows = [_row(each, nominal=nominal, files=not of_bag) for each in report.streams]
    count = sum(len(each.timing) for each in report.streams)
    total = ['All', f'{count:,}', '', '', '', '', *([] if of_bag else [''])]
    total += [format_bytes(report.overview.size_bytes), '', '']
    caption = (
        'Topics. Jitter: 95 of 100 intervals differ from the median by no more. Sizes of messages'
        ' before compression; the last line has the size of the bag.'
        if of_bag
        else 'Streams. Jitter: 95 of 100 intervals differ from the median by no more. Streams may'
        ' share files.'
    )
    return table(caption, columns, rows, total)


def _row(stream: StreamFacts, *, nominal: bool, files: bool) -> list[Child]:
    timing = stream.timing
    longest = max((gap.length_ns for gap in timing.gaps), default=None)
    return [
        stream.name,
        f'{len(timing):,}',
        '' if nominal else _told(timing.rate_hz, 1, 2),
        '' if nominal else _told(timing.jitter_ns, 1e6, 2),
        str(len(timing.gaps)) if timing.regular and not nominal else '',
        '' if nominal else _told(longest, 1e9, 2),
        *([f'{stream.files:,}' if stream.files is not None else ''] if files else []),
        '' if stream.size_bytes is None else format_bytes(stream.size_bytes),
        element('span', stream.detail, class_='faint'),
        element('span', '; '.join(stream.facts), class_='faint'),
    ]


def _told(value: float | None, unit: float, digits: int) -> str:
    return '' if value is None else f'{value / unit:.{digits}f}'


def _coverage(streams: Sequence[StreamFacts], start_ns: int, end_ns: int) -> Markup:
    start_ns = min([start_ns, *(int(s.timing.stamps_ns[0]) for s in streams if len(s.timing))])
    end_ns = max([end_ns, *(int(s.timing.stamps_ns[-1]) for s in streams if len(s.timing))])
    rows = [
        element(
            'li',
            element(
                'span', each.name, ' ', element('span', _gap_words(each.timing), class_='faint')
            ),
            strip(each.timing, start_ns, end_ns),
        )
        for each in streams
        if len(each.timing)
    ]
    seconds = (end_ns - start_ns) / 1e9
    return join(
        [
            element('h3', 'When there are samples'),
            element(
                'p',
                f'From the first sample of the recording to the last, {seconds:.1f} s; gaps are'
                ' marked by higher bars.',
                class_='lead',
            ),
            element('ul', rows, class_='coverage'),
        ]
    )


def _gap_words(timing: Timing) -> str:
    return f'({len(timing.gaps)} gap{"" if len(timing.gaps) == 1 else "s"})' if timing.gaps else ''


def _intervals(streams: Sequence[StreamFacts]) -> Markup | None:
    """A plot for each series of stamps; streams with the same ones share theirs."""
    alike: dict[bytes, list[StreamFacts]] = {}
    for each in streams:
        if len(each.timing) > _FEWEST_SAMPLES and each.timing.period_ns:
            alike.setdefault(each.timing.stamps_ns.tobytes(), []).append(each)
    if not alike:
        return None
    ordered = sorted(alike.values(), key=lambda group: not group[0].timing.gaps)
    plots = [_interval_figure(place, group) for place, group in enumerate(ordered)]
    shown = element('div', plots[:_MOST_PLOTS], class_='grid')
    more = plots[_MOST_PLOTS:]
    rest = (
        element(
            'details',
            element('summary', f'{len(more)} more'),
            element('div', more, class_='grid'),
        )
        if more
        else None
    )
    words = (
        'Distance of each sample to the next over the time of the stream. The dashed line is the'
        ' median; triangles mark gaps, longer than 1.5 times the median.'
    )
    return join([element('h3', 'Intervals'), element('p', words, class_='lead'), shown, rest])


def _interval_figure(place: int, group: Sequence[StreamFacts]) -> Markup:
    names = ', '.join(each.name for each in group)
    timing = group[0].timing
    drawn = interval_plot(f'interval-{place}', names, timing)
    return captioned(drawn, element('b', names), f' median {(timing.period_ns or 0) / 1e6:.2f} ms')
