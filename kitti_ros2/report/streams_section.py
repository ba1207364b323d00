# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The section of streams: times, counts, rates, jitter, gaps and sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.streams import Clock
from ..model.text import format_bytes, format_count
from .markup import Markup, breakable, element, join
from .plots import format_period, interval_plot, strip
from .tables import LONG, NAME, NUMBER, TEXT, captioned, table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .contents import Report, StreamFacts
    from .markup import Child
    from .timing import Timing

_MOST_PLOTS = 9
_FEWEST_SAMPLES = 3


def streams_section(report: Report) -> Markup | None:
    """Make the section; None without streams."""
    if not report.streams:
        return None
    nominal = report.clock is Clock.NOMINAL
    parts: list[Child] = [_table(report)]
    if any(len(each.timing) for each in report.streams):
        parts.append(_coverage(report))
    if nominal:
        words = 'The layout has no time stamps: rates, jitter and gaps in time are not known.'
        parts.insert(0, element('p', words, class_='lead'))
    else:
        parts.append(_intervals(report.streams))
    return join(parts)


def _table(report: Report) -> Markup:
    of_bag = report.overview.compression is not None
    timed = report.clock is not Clock.NOMINAL
    columns: list[tuple[tuple[str, str], Callable[[StreamFacts], Child]]] = [
        (('Topic' if of_bag else 'Stream', NAME), lambda each: breakable(each.name)),
        (('Messages' if of_bag else 'Samples', NUMBER), lambda each: f'{len(each.timing):,}'),
    ]
    if timed:
        columns += [
            (('Rate Hz', NUMBER), lambda each: _value(each.timing.rate_hz, 1)),
            (('Jitter ms', NUMBER), _jitter),
            (('Gaps', NUMBER), _gap_count),
            (('Longest s', NUMBER), lambda each: _value(_longest_gap_ns(each), 1e9)),
        ]
    if any(each.delay_ns is not None for each in report.streams):
        columns.append((('Delay ms', NUMBER), _delay))
    if not of_bag:
        columns.append((('Files', NUMBER), lambda each: f'{each.files or 0:,}'))
    columns.append((('Size', NUMBER), _size))
    columns.append((('Type' if of_bag else 'Frames', TEXT), _detail))
    columns.append((('Content', LONG), _facts))
    # Columns that are empty for all streams are removed.
    columns = [
        (heading, cell) for heading, cell in columns if any(cell(each) for each in report.streams)
    ]
    rows = [[cell(each) for _, cell in columns] for each in report.streams]
    totals = {
        columns[0][0]: 'All',
        columns[1][0]: f'{sum(len(each.timing) for each in report.streams):,}',
        ('Size', NUMBER): format_bytes(report.overview.size_bytes),
    }
    total = [totals.get(heading, '') for heading, _ in columns]
    delayed = any(heading == ('Delay ms', NUMBER) for heading, _ in columns)
    caption = _caption(of_bag=of_bag, timed=timed, delayed=delayed)
    return table(caption, [each for each, _ in columns], rows, total)


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


def _detail(stream: StreamFacts) -> Markup:
    """Return its frames, or the message type without its package, as in info."""
    return element('span', breakable(stream.detail.rsplit('/', 1)[-1]), class_='faint')


def _delay(stream: StreamFacts) -> str:
    return '' if stream.clock_offset_ns else _value(stream.delay_ns, 1e6)


def _facts(stream: StreamFacts) -> Markup | None:
    words = list(stream.facts)
    if stream.clock_offset_ns:
        words.append(
            f'stamps of another clock, {stream.clock_offset_ns / 1e9:.0f} s behind the log'
        )
    return element('span', '; '.join(words), class_='faint') if words else None


def _value(value: float | None, unit: float) -> str:
    return '' if value is None else f'{value / unit:.2f}'


def _coverage(report: Report) -> Markup:
    present = [each for each in report.streams if len(each.timing)]
    spans = [each.timing.stamps_ns[[0, -1]] + each.clock_offset_ns for each in present]
    bounds = (report.overview.start_ns, report.overview.end_ns)
    known = [bound for bound in bounds if bound is not None]
    start_ns = min([*known, *(int(span[0]) for span in spans)])
    end_ns = max([*known, *(int(span[1]) for span in spans)])
    rows = [
        element(
            'li',
            element('span', breakable(each.name), _gap_words(each.timing)),
            strip(each.timing, start_ns - each.clock_offset_ns, end_ns - each.clock_offset_ns),
        )
        for each in present
    ]
    timed = report.clock is not Clock.NOMINAL
    span = f', {(end_ns - start_ns) / 1e9:.1f} s' * timed
    words = (
        f'From the first sample of the recording to the last{span}; gaps are marked by higher bars.'
    )
    return join(
        [
            element('h3', 'When there are samples'),
            element('p', words, class_='lead'),
            element('ul', rows, class_='coverage'),
        ]
    )


def _gap_words(timing: Timing) -> Markup | None:
    if not timing.gaps:
        return None
    return element('span', f' {format_count(len(timing.gaps), "gap")}', class_='faint')


def _intervals(streams: Sequence[StreamFacts]) -> Markup | None:
    """Draw a plot for each series of stamps; streams with equal stamps share one."""
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
    median = f' median {format_period(timing.period_ns or 0)}'
    return captioned(drawn, element('b', breakable(names)), median)
