# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Facts and findings of the streams of a recording and the topics of a bag."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from ..files.png.header import TRAILING_BYTES, parse_image
from ..kitti.scan_file import POINT_BYTES
from ..kitti.store import STORE
from ..model.errors import KittiRos2Error
from ..model.losses import format_numbers
from ..model.streams import Clock, Stream
from ..model.text import format_count
from .contents import Finding, Severity, StreamFacts
from .timing import pairing_of, timing_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..bags.summary import TopicSummary
    from ..importer.survey import Survey, TopicSurvey
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
        if recording.clock is not Clock.NOMINAL:
            findings += _uneven(stream.value, timing)
            findings += _shifted(stream, recording)
        paths = dict.fromkeys(recording.path(stream, number) for number in index.numbers.tolist())
        sizes = {path: size for path in paths if (size := _size(path)) is not None}
        facts = _Facts(stream, recording, findings)
        found.append(
            StreamFacts(
                stream.value,
                format_numbers(index.numbers.tolist(), 2),
                timing,
                len(sizes),
                sum(sizes.values()),
                facts.of(sizes),
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
) -> list[StreamFacts]:
    """Return the topics of a bag, with the stamps of their headers if usable.

    Args:
        topics: Topics of the bag's index.
        stamps: Log times by topic, (N,) nanoseconds, ascending.
        survey: The survey of the bag.
        clock: The meaning of its stamps.
        findings: Findings are appended here.
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
                findings.append(Finding(Severity.LOSS, topic.name, _undecoded(seen)))
        timing = timing_of(used)
        if clock is Clock.NOMINAL:
            pass  # nominal times have no gaps
        elif seen is not None and seen.header_ns:
            findings += _uneven(topic.name, timing)
        elif timing.gaps and sum(gap.lacking for gap in timing.gaps) < len(timing) / 2:
            findings.append(_gaps(topic.name, timing))  # else it is an occasional topic
        size = None if seen is None else seen.size_bytes
        found.append(
            StreamFacts(topic.name, topic.msgtype, timing, size_bytes=size, delay_ns=delay_ns)
        )
    return found


def _undecoded(topic: TopicSurvey) -> str:
    return f'messages that do not decode as {topic.msgtype}: {topic.failure}'


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
    pairing = pairing_of(recording.streams[stream], reference)
    if pairing is None or not pairing.numbers:
        return []
    text = (
        f'{len(pairing.numbers)} of {pairing.pairs} are nearer to the scan of another frame than to'
        f' that of their own number: frames {format_numbers(pairing.numbers)}; they may be'
        f' shifted'
    )
    return [Finding(Severity.WARNING, stream.value, text)]


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None


class _Facts:
    """Facts of the files of a stream, from their sizes and ends."""

    def __init__(self, stream: Stream, recording: KittiRecording, findings: list[Finding]) -> None:
        self._stream = stream
        self._varying = recording.layout.traits.calibration_per_frame
        self._findings = findings

    def of(self, sizes: Mapping[Path, int]) -> tuple[str, ...]:
        """Return image sizes, or points per scan."""
        if self._stream.camera is not None:
            return self._images(list(sizes))
        if self._stream is Stream.SCAN:
            return self._scans({p: size for p, size in sizes.items() if p.suffix == _BIN})
        return ()

    def _images(self, paths: Sequence[Path]) -> tuple[str, ...]:
        by_size: dict[tuple[int, int], list[Path]] = defaultdict(list)
        bad = []
        for path in paths:
            try:
                image = parse_image(*_ends(path))
            except (KittiRos2Error, OSError) as error:
                bad.append(str(error))
                continue
            by_size[image.width, image.height].append(path)
        self._lose(bad, 'image')
        ordered = sorted(by_size, key=lambda size: -len(by_size[size]))
        if len(ordered) > 1 and not self._varying:
            for size in ordered[1:]:
                self._lose([_other_size(path, size, ordered[0]) for path in by_size[size]], 'image')
        return tuple(
            f'{width} \N{MULTIPLICATION SIGN} {height}'
            + (f' ({len(by_size[width, height])})' if len(ordered) > 1 else '')
            for width, height in ordered[:_DIAGNOSED_MOST]
        )

    def _scans(self, sizes: Mapping[Path, int]) -> tuple[str, ...]:
        cut = {path: size for path, size in sizes.items() if not size or size % POINT_BYTES}
        self._lose([_cut_scan(path, size) for path, size in cut.items()], 'scan')
        points = [size // POINT_BYTES for path, size in sizes.items() if path not in cut]
        if not points:
            return ()
        low, middle, high = min(points), int(np.median(points)), max(points)
        return (f'{middle:,} points' + (f' ({low:,} to {high:,})' if low != high else ''),)

    def _lose(self, reasons: Sequence[str], noun: str) -> None:
        if reasons:
            more = f'; and {format_count(len(reasons) - 1, f"more {noun}")}' * (len(reasons) > 1)
            self._findings.append(Finding(Severity.LOSS, self._stream.value, reasons[0] + more))


def _ends(path: Path) -> tuple[bytes, Path, int]:
    data, size = STORE.read_ends(path, TRAILING_BYTES)
    return data, path, size


def _other_size(path: Path, size: tuple[int, int], usual: tuple[int, int]) -> str:
    return f'{path}: the image is {size[0]}x{size[1]}; the others are {usual[0]}x{usual[1]}'


def _cut_scan(path: Path, size: int) -> str:
    if not size:
        return f'{path}: the file is empty'
    return f'{path}: {size} bytes, cut inside a point; expected a multiple of {POINT_BYTES} bytes'
