# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The labels and results that are compared, from files, folders and bags."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from ..options.bag_results import BagResultsOptions
from ..options.declare import options_of
from .frame_boxes import FrameBoxes, read_boxes
from .ground_truth_labels import holds_bag, open_truth_bag, read_ground_truth, recording_of

if TYPE_CHECKING:
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from ..options.read import ReadOptions
    from ..own_bags.recording import BagRecording
    from .frame_boxes import Progress


def no_progress() -> None:
    """Show no progress."""


def read_frames(
    ground_truth: Path,
    results: Path,
    read: ReadOptions,
    recorded: BagResultsOptions,
    progress: Progress = no_progress,
) -> tuple[FrameBoxes, FrameBoxes]:
    """Read labels and results by frame.

    Args:
        ground_truth: The labels.
        results: Result files, or a bag.
        read: Layout and sequence of the ground truth.
        recorded: Options of a bag.
        progress: Called for each file that is read.

    Raises:
        KittiRos2Error: A path cannot be read.
    """
    in_bag = holds_bag(results)
    if not in_bag:
        _refuse_bag_options(results, recorded)
    truth = read_ground_truth(ground_truth, read, progress)
    if in_bag:
        found = _read_bag(results, ground_truth, read, recorded)
    else:
        found = read_boxes(results, 'results', progress, truth.frames)
    labelled, detected = _scores(truth), _scores(found)
    if labelled and None not in labelled and {*detected} == {None}:
        raise UsageError(
            f'{ground_truth}: all labels have scores, and {results} has none; give GROUND_TRUTH'
            f' first, then RESULTS'
        )
    return truth, found


def _refuse_bag_options(results: Path, recorded: BagResultsOptions) -> None:
    for each in options_of(BagResultsOptions):
        if results.exists() and getattr(recorded, each.field) != each.default:
            name = each.name.replace('_', '-')
            raise UsageError(f'{results}: is no bag; --{name} is for results in a bag')


def _scores(frames: FrameBoxes) -> list[float | None]:
    return [box.score for boxes in frames.boxes.values() for box in boxes]


def _read_bag(
    path: Path, ground_truth: Path, read: ReadOptions, options: BagResultsOptions
) -> FrameBoxes:
    """Read the results in a bag; the ground truth has the stamps and calibrations of the frames."""
    from ..bags.open_folder import open_folder  # noqa: PLC0415 - readers of bags take 0.2 s
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - as above
    from .bag_results import read_bag_results  # noqa: PLC0415 - as above

    with ExitStack() as stack:
        recording: KittiRecording | BagRecording
        if holds_bag(ground_truth):
            recording = stack.enter_context(open_truth_bag(ground_truth))
        else:
            recording = open_folder(*recording_of(ground_truth, read))
        found = read_bag_results(
            stack.enter_context(open_bag_source(path)),
            options.topic,
            recording,
            dict(options.class_map),
            tolerance_ns=options.tolerance_ns,
        )
    return FrameBoxes(path, found.boxes, losses=found.losses, notes=found.notes)
