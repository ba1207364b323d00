# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording of any layout: its own text files, its frames, and all of them together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..files.processes import can_fork, forked_map
from ..files.workers import ordered_map, worker_count
from ..kitti import names
from ..model.errors import KittiRos2Error
from .frame_checks import FrameChecks
from .recording_rules import RECORDING_RULES, RecordingFacts
from .results import CheckedSource
from .rule import find_breaches
from .sequence_checks import SequenceChecks
from .source_rules import SOURCE_RULES, Unopened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from ..kitti.find import Candidate
    from ..kitti.recording import KittiRecording
    from ..model.layouts import Layout
    from ..options.read import ReadOptions
    from ..options.validating import ValidateOptions
    from .frame_checks import FrameResult
    from .results import FindingTally

_BATCH = 50
"""Frames that are checked at a time."""
_LEAST_FORKED = 4
"""Batches from which on starting processes, 10 ms, is worth it."""


def check_recording(
    candidate: Candidate,
    layout: Layout,
    read: ReadOptions,
    root: Path,
    options: ValidateOptions,
    tally: FindingTally,
    progress: Callable[[int, int], None],
) -> tuple[CheckedSource, list[int], names.FileNames]:
    """Check a recording.

    Args:
        candidate: The recording.
        layout: Its layout.
        read: The columns of scans.
        root: The folder that it was found in, for one that cannot be opened.
        options: How much is read.
        tally: Breaches are entered there.
        progress: Called with the frames done, and the number of all.

    Returns:
        What was checked, the numbers of its frames, and how these are named.
    """
    place = candidate.folder or root
    # Labels of points are checked where there are any.
    semantic = layout.traits.point_labels and (place / names.POINT_LABELS).is_dir()
    try:
        recording = candidate.open(replace(read, layout=layout, semantic=semantic))
    except (KittiRos2Error, OSError) as error:
        tally.add(find_breaches(SOURCE_RULES, Unopened(place, error)))
        unopened = CheckedSource(place, layout.value, candidate.name, 0, 0, 0)
        return unopened, [], names.SIX_DIGITS
    return *_Check(recording, place, options, tally).run(progress), recording.file_names


class _Check:
    """The check of an open recording."""

    def __init__(
        self, recording: KittiRecording, place: Path, options: ValidateOptions, tally: FindingTally
    ) -> None:
        self._recording = recording
        self._place = place
        self._options = options
        self._tally = tally
        self._facts = RecordingFacts(recording)
        self._files = 0
        self._size_bytes = 0

    def run(self, progress: Callable[[int, int], None]) -> tuple[CheckedSource, list[int]]:
        """Check everything once."""
        sequence = SequenceChecks(self._facts)
        with np.errstate(all='ignore'):  # files may hold any numbers
            sequence.run(quick=self._options.quick)
        path = sequence.calibration_path
        frames = FrameChecks(self._recording, self._options, path, sequence.labels)
        numbers = frames.numbers
        batches = [numbers[at : at + _BATCH] for at in range(0, len(numbers), _BATCH)]
        done = 0
        for results in _map(frames, batches):
            for result in results:
                self._enter(result)
                if result.packet is not None:
                    sequence.packets[result.number] = result.packet
            done += len(results)
            progress(done, len(numbers))
        with np.errstate(all='ignore'):
            if not self._options.quick:
                sequence.check_packets()
        self._tally.add(sequence.found)
        self._tally.add(find_breaches(RECORDING_RULES, self._facts))
        source = CheckedSource(
            self._place,
            self._recording.layout.value,
            self._recording.name,
            len(numbers),
            self._files + sequence.files,
            self._size_bytes + sequence.size_bytes,
        )
        return source, numbers

    def _enter(self, result: FrameResult) -> None:
        self._tally.add(result.found)
        self._files += result.files
        self._size_bytes += result.size_bytes
        if result.points is not None:
            self._facts.enter_scan(result.number, result.points)
        self._facts.occlusions.update(result.occlusions)
        for stream, shape in result.images.items():
            self._facts.enter_image(stream, result.number, shape)


def _map(check: FrameChecks, batches: Sequence[Sequence[int]]) -> Iterator[list[FrameResult]]:
    """Check batches of frames at once: half of the time is Python's own, so threads gain less."""
    workers = worker_count()
    if workers > 1 and len(batches) >= _LEAST_FORKED and can_fork():
        return forked_map(check, batches, workers)
    return ordered_map(check, batches, workers)
