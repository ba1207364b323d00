# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overview of a KITTI folder or a bag: series, gaps, sizes, calibration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ..bags.reader import bag_stamps, summarize_bag
from ..bags.summary import TopicSummary, summarize_topic
from ..exporter.schedule import frames_of
from ..model.losses import format_numbers
from ..model.streams import Clock
from ..model.text import format_count
from ..own_bags.numbering import number_bag
from ..own_bags.recorded_layout import read_blueprint
from ..own_bags.stamp_numbers import absent_frames
from .glances import bag_calibration, calibration_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..kitti.recording import KittiRecording
    from ..model.losses import Loss
    from ..model.recording import FrameOrigin
    from ..own_bags.blueprint import Blueprint
    from ..own_bags.numbering import NumberedBag
    from .glances import CameraGlance, LinkGlance

MOST_SERIES = 200
"""Streams or topics that are shown: nobody reads more, and a bag may have tens of thousands."""

_SAMPLES = {'stream': 'sample', 'topic': 'message'}


@dataclass(frozen=True)
class Overview:
    """The overview of a recording or a bag, as shown by info.

    Attributes:
        path: The folder or the bag.
        kind: KITTI layout, or bag container.
        name: Drive, split or sequence; files of a bag.
        series: Streams or topics; unknown times are None.
        frames: Number of frames; None in a bag not written by to-bag.
        clock: The meaning of the stamps.
        start_ns, end_ns: First and last stamp, None without any or if the date is assumed.
        duration_ns: From the first to the last; None if no time is known.
        size_bytes: Total size of its files.
        compression: Compression of a bag; None for a folder.
        cameras, links: Calibration.
        losses: Missing or unusable data.
        notes: Remarks.
        complete: False for a truncated or damaged bag.
        origins: By number the raw drive's frame of an object set in real time.
    """

    path: Path
    kind: str
    name: str
    series: tuple[TopicSummary, ...]
    frames: int | None
    clock: Clock
    start_ns: int | None
    end_ns: int | None
    duration_ns: int | None
    size_bytes: int
    compression: str | None
    cameras: tuple[CameraGlance, ...]
    links: tuple[LinkGlance, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]
    complete: bool = True
    origins: Mapping[int, FrameOrigin] = field(default_factory=dict)


def describe_rest(counts: Sequence[int], kind: str) -> str:
    """Describe what is not shown, such as ... and 3 more topics with 6 messages.

    Args:
        counts: Samples of each.
        kind: stream or topic.
    """
    more = format_count(len(counts), f'more {kind}')
    return f'... and {more} with {format_count(sum(counts), _SAMPLES[kind])}'


def inspect_recording(recording: KittiRecording, path: Path) -> Overview:
    """Inspect a KITTI recording; its data files are listed and not read."""
    series = tuple(
        summarize_topic(stream.value, format_numbers(index.numbers.tolist(), 2), index.stamps_ns)
        for stream, index in recording.streams.items()
    )
    cameras, links, notes = calibration_of(recording)
    numbers = {stream: index.numbers for stream, index in recording.streams.items()}
    start_ns, end_ns, duration_ns = _times(series, recording.clock)
    return Overview(
        path=path,
        kind=recording.layout.value,
        name=recording.name,
        series=tuple(_known(each, recording.clock) for each in series),
        frames=len(frames_of(numbers, common=recording.common_numbers)),
        clock=recording.clock,
        start_ns=start_ns,
        end_ns=end_ns,
        duration_ns=duration_ns,
        size_bytes=_size_bytes(recording),
        compression=None,
        cameras=cameras,
        links=links,
        losses=(*recording.losses, *recording.late_losses),
        notes=tuple(recording.notes) + notes,
        origins=recording.origins,
    )


def inspect_bag(bag: OpenBag) -> tuple[Overview, Blueprint | None]:
    """Inspect a bag: its index, description, and the first camera_info and static transforms.

    Returns:
        The overview, and the layout of the recording where to-bag wrote the bag.

    Raises:
        BadBagError: The bag is unreadable.
    """
    summary = summarize_bag(bag)
    counts = {topic.name: topic.count for topic in summary.topics}
    blueprint, losses = read_blueprint(bag, counts)
    numbered = None
    if blueprint is not None:
        losses += absent_frames(blueprint)
        numbered = number_bag(bag, bag_stamps(bag), blueprint=blueprint, by_header=False)
    cameras, links, notes = bag_calibration(bag, summary)
    clock = Clock.UTC if numbered is None else numbered.clock
    start_ns, end_ns, duration_ns = _times(summary.topics, clock)
    incomplete = 'parts of the bag are missing or damaged; whole messages are counted'
    cut = () if summary.complete else (incomplete,)
    deskew = None if blueprint is None else blueprint.deskew
    moved = () if deskew is None else (f'scans are {deskew.state}',)
    overview = Overview(
        path=bag.path,
        kind=summary.container,
        name=', '.join(file.name for file in summary.files[:3])
        + (' ...' if len(summary.files) > 3 else ''),
        series=tuple(_known(topic, clock) for topic in summary.topics),
        frames=None if numbered is None else len(numbered.frames),
        clock=clock,
        start_ns=start_ns,
        end_ns=end_ns,
        duration_ns=duration_ns,
        size_bytes=summary.size_bytes,
        compression=summary.compression,
        cameras=cameras,
        links=links,
        losses=losses,
        notes=(*cut, *moved, *summary.findings, *notes),
        complete=summary.complete,
        origins={} if numbered is None else _origins(numbered),
    )
    return overview, blueprint


def _origins(bag: NumberedBag) -> Mapping[int, FrameOrigin]:
    """Return the raw drives' frames of the frames in a bag."""
    times = bag.blueprint.times
    origins = {} if times is None else times.origins
    return {n: origins[n] for n in bag.frames.tolist() if n in origins}


def _times(
    series: Iterable[TopicSummary], clock: Clock
) -> tuple[int | None, int | None, int | None]:
    """Return start, end and duration of all series, None for those unknown to the layout."""
    starts = [each.start_ns for each in series if each.start_ns is not None]
    ends = [each.end_ns for each in series if each.end_ns is not None]
    if not starts or clock is Clock.NOMINAL:
        return None, None, None
    start_ns, end_ns = min(starts), max(ends)
    if clock is Clock.RELATIVE:
        return None, None, end_ns - start_ns
    return start_ns, end_ns, end_ns - start_ns


def _known(series: TopicSummary, clock: Clock) -> TopicSummary:
    """Return a series without the dates or times that its clock does not provide."""
    if clock is Clock.NOMINAL:
        return TopicSummary(series.name, series.msgtype, series.count)
    if clock is Clock.RELATIVE:
        return replace(series, start_ns=None, end_ns=None, largest_gap_at_ns=None)
    return series


def _size_bytes(recording: KittiRecording) -> int:
    """Return the size of the data files; a file of several streams counts once."""
    paths = {
        recording.path(stream, number)
        for stream, index in recording.streams.items()
        for number in index.numbers.tolist()
    }
    return sum(path.stat().st_size for path in paths if path.is_file())
