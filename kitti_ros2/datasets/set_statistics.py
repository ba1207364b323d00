# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a data set: all recordings at a path, each and together."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

from ..api.keywords import by_name
from ..api.source import warn
from ..bags.locate import looks_like_bag
from ..bags.open_folder import explained
from ..files.remote import as_path
from ..kitti import names
from ..kitti.layouts import find_data_sets, open_candidate
from ..model.errors import KittiRos2Error, NotKittiError, describe_error
from ..model.losses import Loss
from ..model.streams import Stream
from ..options.dataset_tables import STATS, make_statistics_options
from ..pictures.recording_frames import RecordingFrames
from ..pictures.sources import open_frames
from .recording_statistics import RecordingStatistics, count_recording, merged

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from typing_extensions import Unpack

    from ..api.keywords import StatisticsKeywords
    from ..kitti.find import Candidate
    from ..kitti.nearby import DataSet
    from ..options.read import ReadOptions
    from ..options.statistics import StatisticsOptions
    from ..pictures.frame import FrameSource

    Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class SetStatistics:
    """The statistics of a data set.

    Attributes:
        path: The folder or the bag.
        recordings: Those of each drive, split, sequence or bag.
    """

    path: Path
    recordings: Sequence[RecordingStatistics]

    @cached_property
    def total(self) -> RecordingStatistics:
        """All recordings together."""
        return merged(self.recordings)


def statistics(
    path: str | os.PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Unpack[StatisticsKeywords],
) -> SetStatistics:
    """Count and describe what is in a data set, as `kitti-ros2 stats` does.

    Args:
        path: A KITTI folder with any number of drives, splits and sequences, or a bag.
        progress: Called with the frames done and the number of all that are known so far.
        options: Those of `kitti-ros2 stats --help`, with the same defaults: points=True,
            layout='raw', sequence='0005'.

    Returns:
        The statistics of each recording and, as total, of all together. Each loss is also a
        KittiRos2Warning.

    Raises:
        KittiRos2Error: The path cannot be read, or an option is invalid.

    Examples:
        >>> from kitti_ros2 import datasets
        >>> found = datasets.statistics('2011_09_26/2011_09_26_drive_0005_sync')
        >>> found.total.frames, found.total.route.length_m
        (..., ...)
        >>> [(name, each.count) for name, each in found.total.classes.items()]
        [...]
    """
    read, chosen = make_statistics_options(by_name(options, STATS))
    show = progress or (lambda _done, _total: None)
    found = count_set(as_path(path), find_sources(as_path(path), read), chosen, show)
    for loss in found.total.losses:
        warn(loss.text())
    return found


def count_set(
    path: Path, sources: Sequence[SetSource], options: StatisticsOptions, progress: Progress
) -> SetStatistics:
    """Count what is in the recordings of a path, one after the other.

    A recording that cannot be opened is a loss, unless it is the only one.

    Raises:
        KittiRos2Error: The only recording cannot be opened.
    """
    frames = _FrameCount(progress)
    found = []
    for each in sources:
        try:
            source = each.open()
        except (KittiRos2Error, OSError) as error:
            if len(sources) == 1:
                raise
            loss = Loss(Stream.RECORDING.value, 1, describe_error(error))
            found.append(RecordingStatistics(each.name, each.kind, losses=(loss,)))
            continue
        with closing(source):
            frames.total += len(source.numbers)
            scans = options.points or each.semantic
            found.append(
                count_recording(source, each.name, each.kind, scans=scans, step=frames.step)
            )
    return SetStatistics(path, tuple(found))


class _FrameCount:
    """Counts frames for the progress display."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._done = 0
        self.total = 0

    def step(self) -> None:
        self._done += 1
        self._progress(self._done, self.total)


class SetSource(NamedTuple):
    """A recording of a set.

    Attributes:
        name: Its name in the set.
        kind: Layout, or bag.
        semantic: Whether its points have labels in files.
        open: Opens its frames.
    """

    name: str
    kind: str
    semantic: bool
    open: Callable[[], FrameSource]


def find_sources(path: Path, read: ReadOptions) -> list[SetSource]:
    """Find the recordings at a path: in the data sets in it or below it, or the bags in it.

    Raises:
        KittiRos2Error: There is none.
    """
    if read.layout is None and looks_like_bag(path):
        return [_bag(path, read)]
    try:
        with explained(path, read):
            data_sets = find_data_sets(path, read)
    except NotKittiError:
        inside = sorted(path.iterdir()) if path.is_dir() and read.layout is None else []
        bags = [each for each in inside if each.is_dir() and looks_like_bag(each)]
        if not bags:
            raise
        return [_bag(bag, read) for bag in bags]
    return [
        _source(path, data_set, candidate, read)
        for data_set in data_sets
        for candidate in data_set.recordings
    ]


def _bag(path: Path, read: ReadOptions) -> SetSource:
    return SetSource(path.name, 'bag', semantic=False, open=partial(open_frames, path, read))


def _source(path: Path, data_set: DataSet, candidate: Candidate, read: ReadOptions) -> SetSource:
    layout = data_set.layout
    folder = candidate.folder if layout.traits.point_labels else None
    semantic = folder is not None and (folder / names.POINT_LABELS).is_dir()
    options = replace(read, semantic=semantic)

    def open_folder() -> FrameSource:
        return RecordingFrames(open_candidate(data_set.folder, layout, candidate, options))

    parts = data_set.folder.relative_to(path).parts
    if parts[-1:] != (candidate.name,):
        parts = (*parts, candidate.name)
    return SetSource('/'.join(parts), layout.value, semantic, open_folder)
