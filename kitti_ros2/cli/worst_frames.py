# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames with the most errors: their table, their JSON, the folder with their pictures."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from .plot_output import check_output
from .progress import step_progress
from .tables import cell, plain_table
from .text import say

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..evaluation.frame_boxes import FrameBoxes
    from ..evaluation.worst import WorstFrame
    from ..model.losses import Loss
    from ..options.eval_detection import DetectionOptions
    from ..pictures.frame import FrameSource

_PICTURE = re.compile(r'\d{2,}_\d{6,}\.png', re.ASCII)


def check_folder(
    out: Path | None, paths: Sequence[Path], *, overwrite: bool
) -> Callable[[Path], str | None]:
    """Raise now for a folder of pictures that could not be written later; return its refusal."""
    return check_output(out, paths, _keep_others, overwrite=overwrite)


def _keep_others(path: Path) -> str | None:
    """Return why --overwrite does not replace a path; None for pictures of worst frames."""
    if path.is_dir() and all(_PICTURE.fullmatch(each.name) for each in path.iterdir()):
        return None
    return 'it holds more than such pictures, so --overwrite does not touch it; choose another name'


def draw_worst(
    source: FrameSource,
    worst: Sequence[WorstFrame],
    found: FrameBoxes,
    options: DetectionOptions,
    out: Path,
    refusal: Callable[[Path], str | None],
    *,
    quiet: bool,
) -> tuple[Loss, ...]:
    """Draw frames with their errors into a new folder; return what could not be drawn."""
    from ..evaluation.worst_pictures import draw_worst_frames
    from ..files.staging import staged

    with (
        step_progress('drawing', len(worst), show=not quiet) as progress,
        staged(out, refusal) as folder,
    ):
        classes = options.limits.keys()
        return draw_worst_frames(
            source, worst, found.boxes, folder, options.overlaps, classes=classes, progress=progress
        )


def print_worst(worst: Sequence[WorstFrame]) -> None:
    """Print a table for a terminal of 80 columns."""
    from rich.console import Console

    say('')
    if not worst:
        say('no scored frame has errors')
        return
    table = plain_table('worst', ('frame', 'penalty'))
    table.add_column('errors', overflow='fold')
    for rank, each in enumerate(worst, 1):
        table.add_row(f'{rank}', f'{each.number:06d}', f'{each.penalty:.2f}', cell(each.reason))
    Console(highlight=False).print(table)
    say('penalty: 1 for each missed label, the score for each false positive')
