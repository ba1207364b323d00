# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of output files before the work for them begins."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from ..files.replacing import keep_all, keep_all_but_files
from ..model.errors import UsageError
from ..model.text import either

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

PLOTS = ('.png', '.pdf', '.svg')
_OTHER_PICTURES = ('.jpg', '.jpeg', '.webp')
_KEEP_ALL_BUT_PLOTS = keep_all_but_files('picture', (b'\x89PNG', b'%PDF', b'<?xml'))


def is_picture(out: Path) -> bool:
    """Whether an output is a file by its name, not a folder: a plot or another picture."""
    return out.suffix.lower() in {*PLOTS, *_OTHER_PICTURES}


def check_output(
    out: Path | None,
    paths: Sequence[Path],
    replaceable: Callable[[Path], str | None],
    *,
    overwrite: bool,
) -> Callable[[Path], str | None]:
    """Raise now for an output that could not be written later; return its refusal."""
    from ..files.staging import Staging, refuse_inside

    refusal = replaceable if overwrite else keep_all
    if out is not None:
        for path in paths:
            refuse_inside(path, out)
        Staging(out, refusal).discard()
    return refusal


def check_plot(
    out: Path | None, paths: Sequence[Path], *, overwrite: bool
) -> Callable[[Path], str | None]:
    """Raise now for a plot that could not be drawn later; return its refusal."""
    refusal = check_output(out, paths, _KEEP_ALL_BUT_PLOTS, overwrite=overwrite)
    if out is None:
        return refusal
    if out.suffix.lower() not in PLOTS:
        raise UsageError(f'{out}: a plot ends in {either(PLOTS)}')
    if find_spec('matplotlib') is None:
        raise UsageError(
            "-o needs matplotlib, which is not installed; run pip install 'kitti_ros2[plot]'"
        )
    return refusal
