# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Facts and findings of the streams of a recording and the topics of a bag."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.image_size import read_image_header
from ..model.errors import KittiRos2Error, describe_error
from ..model.losses import format_numbers
from ..model.scan_columns import KITTI_COLUMNS
from ..model.streams import Clock, Stream
from ..model.text import format_count
from .contents import Finding, Severity, StreamFacts
from .timing import shifted_numbers, timing_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..bags.summary import TopicSummary
    from ..importer.survey import Survey
    from ..importer.topic_survey import TopicSurvey
    from ..kitti.recording import KittiRecording
    from ..model.samples import Int64Array
    from .timing import Timing

_BIN = '.bin'
_DIAGNOSED_MOST = 5


def recording_streams(
    recording: KittiRecording, findings: list[Finding], step: Callable[[], None]
) -> list[StreamFacts]:
    """Return the streams of a KITTI recording; reads the ends of every image and scan file.

    Args:
        recording: Open for reading.
        findings: Findings are appended here.
        step: Called after each stream.
    """
    found = []
    for stream, index in recording.streams.items():
        timing = timing_of(index.stamps_ns)
        if recording.clock is not Clock.NOMINAL and not recording.layout.traits.frame_set:
            findings += _uneven(stream.value, timing)
            findings += _shifted(stream, recording)
        paths = dict.fromkeys(recording.path(stream, number) for number in index.numbers.tolist())
        sizes = {path: size for path in paths if (size := _size(path)) is not None}
        facts: tuple[str, ...] = ()
        if stream.camera is not None:
            varying = recording.layout.traits.calibration_per_frame
            facts = _image_facts(stream, list(sizes), findings, varying=varying)
        elif stream is Stream.SCAN:
            columns = recording.options.columns or KITTI_COLUMNS
            facts = _scan_facts(sizes, columns.point_bytes, findings)
        found.append(
            StreamFacts(
                stream.value,
                format_numbers(index.numbers.tolist(), 2),
                timing,
                len(sizes),
                sum(sizes.values()),
                facts,
            )
        )
        step()
    return found


def bag_streams(
    topics: Sequence[TopicSummary],
    stamps: Mapping[str, Int64Array],
    survey: Survey,
    clock: Clock,
    findings: list[Finding],
    *,
    independent: bool = False,
) -> list[StreamFacts]:
    """Return the topics of a bag, with the stamps of their headers if usable.

    Args:
        topics: Topics of the bag's index.
        stamps: Log times by topic, (N,) nanoseconds, ascending.
        survey: The survey of the bag.
        clock: The meaning of its stamps.
        findings: Findings are appended here.
        independent: Whether the frames are independent, and may be any time apart.
    """
    found = []
    for topic in topics:
        seen = survey.topics.get(topic.name)
        used = stamps.get(topic.name, np.zeros(0, np.int64))
        delay_ns = None
        if seen is not None and seen.msgtype == topic.msgtype and seen.count:
            used, reason = seen.stamps()
            delay_ns = _delay(seen, used)
            if reason is not None:
                findings.append(Finding(Severity.WARNING, topic.name, reason))
            if seen.failure:
                text = f'messages that do not decode as {seen.msgtype}: {seen.failure}'
                findings.append(Finding(Severity.LOSS, topic.name, text))
        timing = timing_of(used)
        if clock is Clock.NOMINAL or independent:
            pass  # nominal times have no gaps; independent frames have any
        elif seen is not None and seen.header_ns:
            findings += _uneven(topic.name, timing)
        elif timing.gaps and sum(gap.lacking for gap in timing.gaps) < len(timing) / 2:
            findings.append(_gaps(topic.name, timing))  # else it is an occasional topic
        size = None if seen is None else seen.size_bytes
        found.append(
            StreamFacts(topic.name, topic.msgtype, timing, size_bytes=size, delay_ns=delay_ns)
        )
    return found


def _delay(topic: TopicSurvey, used: Int64Array) -> int | None:
    """Return the median time from stamp to log time, if stamps are used."""
    log = np.array(topic.log_ns, dtype=np.int64)
    if len(topic.header_ns) != len(log) or not np.array_equal(used, topic.header_ns):
        return None
    # Not np.median: float64 has a resolution of 256 ns only for clocks of different epochs.
    return int(np.sort(log - used)[len(log) // 2])


def _uneven(name: str, timing: Timing) -> list[Finding]:
    found = []
    if timing.gaps:
        found.append(_gaps(name, timing))
    if timing.backward:
        text = f'{format_count(timing.backward, "sample")} stamped earlier than the one before'
        found.append(Finding(Severity.WARNING, name, text))
    if timing.repeated:
        text = f'{format_count(timing.repeated, "stamp")} the same as the one before'
        found.append(Finding(Severity.WARNING, name, text))
    return found


def _gaps(name: str, timing: Timing) -> Finding:
    widest = max(timing.gaps, key=lambda gap: gap.length_ns)
    after = (widest.at_ns - int(timing.stamps_ns[0])) / 1e9
    lacking = sum(gap.lacking for gap in timing.gaps)
    return Finding(
        Severity.WARNING,
        name,
        f'{format_count(len(timing.gaps), "gap")}, in which about'
        f' {format_count(lacking, "sample")} {"is" if lacking == 1 else "are"} lacking; the longest'
        f' is {widest.length_ns / 1e9:.2f} s, {after:.1f} s after the first sample',
    )


def _shifted(stream: Stream, recording: KittiRecording) -> list[Finding]:
    """Return a warning if files with the same number belong to different times."""
    reference = recording.streams.get(Stream.SCAN)
    if reference is None or stream is Stream.SCAN or not recording.common_numbers:
        return []
    numbers, pairs = shifted_numbers(recording.streams[stream], reference)
    if not numbers:
        return []
    text = (
        f'{len(numbers)} of {pairs} are nearer to the scan of another frame than to that of their'
        f' own number: frames {format_numbers(numbers)}; they may be shifted'
    )
    return [Finding(Severity.WARNING, stream.value, text)]


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None


def _image_facts(
    stream: Stream, paths: Sequence[Path], findings: list[Finding], *, varying: bool
) -> tuple[str, ...]:
    """Return the sizes of images, most frequent first, from the ends of their files.

    Args:
        stream: Their stream.
        paths: Their files.
        findings: Damaged images are appended here, and those of another size unless sizes vary.
        varying: Whether images of a recording may be of several sizes.
    """
    by_size: dict[tuple[int, int], list[Path]] = defaultdict(list)
    bad = []
    for path in paths:
        try:
            image = read_image_header(path)
        except (KittiRos2Error, OSError) as error:
            bad.append(describe_error(error))
            continue
        by_size[image.width, image.height].append(path)
    findings += _lost(stream, bad, 'image')
    ordered = sorted(by_size, key=lambda size: -len(by_size[size]))
    for width, height in [] if varying else ordered[1:]:
        usual = '{}x{}'.format(*ordered[0])
        text = f'the image is {width}x{height}; the others are {usual}'
        others = [f'{path}: {text}' for path in by_size[width, height]]
        findings += _lost(stream, others, 'image')
    return tuple(
        f'{width} \N{MULTIPLICATION SIGN} {height}'
        + (f' ({len(by_size[width, height])})' if len(ordered) > 1 else '')
        for width, height in ordered[:_DIAGNOSED_MOST]
    )


def _scan_facts(
    sizes: Mapping[Path, int], point_bytes: int, findings: list[Finding]
) -> tuple[str, ...]:
    """Return the points per scan, from the sizes of files; truncated ones are findings."""
    sizes = {path: size for path, size in sizes.items() if path.suffix == _BIN}
    cut = {path: size for path, size in sizes.items() if not size or size % point_bytes}
    findings += _lost(
        Stream.SCAN, [_cut_scan(path, size, point_bytes) for path, size in cut.items()], 'scan'
    )
    points = [size // point_bytes for path, size in sizes.items() if path not in cut]
    if not points:
        return ()
    low, middle, high = min(points), int(np.median(points)), max(points)
    return (f'{middle:,} points' + (f' ({low:,} to {high:,})' if low != high else ''),)


def _lost(stream: Stream, reasons: Sequence[str], noun: str) -> list[Finding]:
    """Return a finding with the first reason and the number of others; none without reasons."""
    more = f'; and {format_count(len(reasons) - 1, f"more {noun}")}' * (len(reasons) > 1)
    return [Finding(Severity.LOSS, stream.value, reasons[0] + more)] if reasons else []


def _cut_scan(path: Path, size: int, point_bytes: int) -> str:
    if not size:
        return f'{path}: the file is empty'
    return f'{path}: {size} bytes, cut inside a point; expected a multiple of {point_bytes} bytes'
