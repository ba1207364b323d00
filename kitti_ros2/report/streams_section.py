# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The values of the section of streams: times, counts, rates, jitter, gaps and sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.streams import Clock
from ..model.text import format_bytes
from .contents import LONG, NAME, NUMBER, TEXT, Table
from .overview import MOST_SERIES, describe_rest
from .plots import format_period, interval_plot, strip

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .contents import Report, StreamFacts

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
            each.name,
            len(each.timing.gaps),
            strip(each.timing, start_ns - each.clock_offset_ns, end_ns - each.clock_offset_ns),
        )
        for each in shown
        if len(each.timing)
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
    """Return what is said of the streams that are not on the page; empty if all are."""
    if not left_out:
        return ''
    kind = 'stream' if report.overview.compression is None else 'topic'
    rest = describe_rest([len(each.timing) for each in left_out], kind)
    return f'{rest}; kitti-ros2 info --json lists all.'


def _streams_table(report: Report, shown: Sequence[StreamFacts]) -> Table:
    of_bag = report.overview.compression is not None
    timed = report.clock is not Clock.NOMINAL
    columns: list[tuple[tuple[str, str], Callable[[StreamFacts], str]]] = [
        (('Topic' if of_bag else 'Stream', NAME), lambda each: each.name),
        (('Messages' if of_bag else 'Samples', NUMBER), lambda each: f'{len(each.timing):,}'),
    ]
    if timed:
        columns += [
            (('Rate Hz', NUMBER), lambda each: _value(each.timing.rate_hz, 1)),
            (('Jitter ms', NUMBER), _jitter),
            (('Gaps', NUMBER), _gap_count),
            (('Longest s', NUMBER), lambda each: _value(_longest_gap_ns(each), 1e9)),
        ]
    if any(each.delay_ns is not None for each in shown):
        columns.append((('Delay ms', NUMBER), _delay))
    if not of_bag:
        columns.append((('Files', NUMBER), lambda each: f'{each.files or 0:,}'))
    columns.append((('Size', NUMBER), _size))
    # Of a message type, without its package, as in info.
    detail = ('Type' if of_bag else 'Frames', TEXT)
    columns.append((detail, lambda each: each.detail.rsplit('/', 1)[-1]))
    columns.append((('Content', LONG), _facts))
    # Columns that are empty for all streams are removed.
    columns = [(heading, cell) for heading, cell in columns if any(cell(each) for each in shown)]
    rows = [[cell(each) for _, cell in columns] for each in shown]
    totals = {
        columns[0][0]: 'All',
        columns[1][0]: f'{sum(len(each.timing) for each in report.streams):,}',
        ('Size', NUMBER): format_bytes(report.overview.size_bytes),
    }
    total = [totals.get(heading, '') for heading, _ in columns]
    delayed = any(heading == ('Delay ms', NUMBER) for heading, _ in columns)
    caption = _caption(of_bag=of_bag, timed=timed, delayed=delayed)
    return Table(caption, [each for each, _ in columns], rows, total)


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


def _value(value: float | None, unit: float) -> str:
    return '' if value is None else f'{value / unit:.2f}'


def _extent(report: Report) -> tuple[int, int]:
    """Return the first and the last time of all samples, 0 without any."""
    spans = [
        each.timing.stamps_ns[[0, -1]] + each.clock_offset_ns
        for each in report.streams
        if len(each.timing)
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
    for each in streams:
        if len(each.timing) > _FEWEST_SAMPLES and each.timing.period_ns:
            alike.setdefault(each.timing.stamps_ns.tobytes(), []).append(each)
    found = []
    for place, group in enumerate(sorted(alike.values(), key=lambda some: not some[0].timing.gaps)):
        names, timing = ', '.join(each.name for each in group), group[0].timing
        plot = interval_plot(f'interval-{place}', names, timing)
        found.append((names, format_period(timing.period_ns or 0), plot))
    return found
