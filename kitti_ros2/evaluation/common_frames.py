# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames that have both labels and results; all others are named."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti.image_set import parse_image_set
from ..kitti.store import STORE
from ..model.errors import UsageError
from ..model.losses import Loss, describe_frames

if TYPE_CHECKING:
    from pathlib import Path

    from .frame_boxes import FrameBoxes


def common_frames(
    truth: FrameBoxes, found: FrameBoxes, listed: Path | None
) -> tuple[list[int], list[Loss]]:
    """Return the frames to score, and all losses: also the frames that cannot be scored.

    Args:
        truth: The labels.
        found: The results.
        listed: A list of the frames to score; None for all with labels and results.

    Raises:
        UsageError: There is none to score.
    """
    labelled, answered = ({*each.boxes, *_unread(each)} for each in (truth, found))
    wanted, losses = (labelled | answered, []) if listed is None else _read_list(listed, truth)
    losses += [loss for each in (truth, found) for loss in each.losses if _concerns(loss, wanted)]
    labelled |= wanted if truth.complete else set()
    answered |= labelled if found.complete else set()
    absent = sorted((wanted & labelled) - answered)
    if absent:
        message = (
            f'{found.source}: no file for frames {{}}, which are not scored (give an empty file for'
            f' a frame without detections, or --frames with a list of the frames to score)'
        )
        losses.append(Loss('results', len(absent), message, tuple(absent)))
    extra = sorted(wanted - labelled)
    if extra:
        message = f'{truth.source}: no labels for frames {{}}, which are not scored'
        losses.append(Loss('ground truth', len(extra), message, tuple(extra)))
    unread = {*_unread(truth), *_unread(found)}
    numbers = sorted((wanted & labelled & answered) - unread)
    if not numbers:
        raise _no_frames(truth, found, listed)
    return numbers, losses


def _concerns(loss: Loss, numbers: set[int]) -> bool:
    return not loss.numbers or not numbers.isdisjoint(loss.numbers)


def _unread(frames: FrameBoxes) -> set[int]:
    """Return the frames whose file could not be read."""
    return {number for loss in frames.losses for number in loss.numbers} - frames.boxes.keys()


def _read_list(path: Path, truth: FrameBoxes) -> tuple[set[int], list[Loss]]:
    """Read the numbers of a list of frames; its invalid lines are losses."""
    known = truth.frames
    found = parse_image_set(STORE.read_text(path), path, frames=True, known=known)
    losses = [Loss('frames', 1, reason) for reason in found.invalid]
    numbers = (known.number(name) for name in found.entries)
    return {number for number in numbers if number is not None}, losses


def _no_frames(truth: FrameBoxes, found: FrameBoxes, listed: Path | None) -> UsageError:
    for each in (found, truth):
        if each.losses and not each.boxes:
            return UsageError(f'{each.source}: no frame can be scored: {each.losses[0].text()}')
    described = [
        f'{each.source} has {describe_frames(sorted(each.boxes)) if each.boxes else "no frames"}'
        for each in (found, truth)
    ]
    among = f' among those of {listed}' if listed is not None else ''
    lost = [loss for each in (found, truth) if not each.boxes for loss in each.losses]
    reason = f' ({max(lost, key=lambda loss: loss.count).text()})' if lost else ''
    return UsageError(
        f'no frame{among} has both results and labels: {", ".join(described)}{reason};'
        f' give the results of these frames, or their labels'
    )
