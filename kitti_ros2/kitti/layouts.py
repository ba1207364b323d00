# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detects the layout of a folder and opens it."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.errors import (
    AmbiguousLayoutError,
    AmbiguousSequenceError,
    NotKittiError,
    Remedy,
    UsageError,
)
from ..model.losses import runs_of
from ..model.spelling import did_you_mean
from ..model.text import some_of
from ..options.read import ReadOptions
from . import names
from .find import absolute
from .layout_files import LAYOUTS
from .motion import prepare_motion
from .nearby import explain

if TYPE_CHECKING:
    from ..model.layouts import Layout
    from .find import Candidate
    from .recording import KittiRecording


def guess_layout(path: Path) -> Layout:
    """Detect the layout of a folder.

    Raises:
        NotKittiError: There is no such folder, or it fits no layout.
        AmbiguousLayoutError: It fits several.
    """
    return _guess(path)[0]


def _guess(path: Path) -> tuple[Layout, list[Candidate]]:
    fits = _find_all(path)
    if not fits:
        raise explain(path)
    if len(fits) > 1:
        raise AmbiguousLayoutError(path, [layout.value for layout in fits]).with_remedies(
            *(Remedy(path, path, ('--layout', layout.value)) for layout in fits)
        )
    return next(iter(fits.items()))


def open_recording(path: Path, options: ReadOptions | None = None) -> KittiRecording:
    """Open the recording at a path; lists folders, reads time stamps and sequence-wide files only.

    Raises:
        NotKittiError: There is no recording.
        AmbiguousLayoutError: The folder fits several layouts and the options contain none.
        AmbiguousSequenceError: It contains several recordings and the options choose none.
        UsageError: The chosen recording does not exist, or the options request labels of points
            and the layout has none.
        MissingDataError: The options request compensation of motion, and the motion is not known.
    """
    options = options or ReadOptions()
    folder = absolute(path)
    if options.layout is None:
        layout, candidates = _guess(path)
    else:
        layout = options.layout
        candidates = LAYOUTS[layout].find(folder) if folder.is_dir() else []
    if options.semantic and not layout.traits.point_labels:
        raise UsageError(
            f'{path}: semantic is for the odometry layout, which has labels of points;'
            f' this is layout {layout.value}'
        )
    if not candidates:
        raise _not_of_layout(path, layout)
    chosen = _choose(path, layout, candidates, options.sequence)
    recording = chosen.open(options)
    prepare_motion(recording)
    if not recording.streams:
        reasons = [loss.message for loss in recording.losses]
        found = '; '.join([f'no data file of {chosen.name} can be used', *reasons[:1]])
        raise NotKittiError(path, found, [layout.value])
    others = [candidate.name for candidate in candidates if candidate is not chosen]
    if layout.traits.frame_set and others and options.sequence is None:
        recording.notes.append(
            f'{folder}: {", ".join(others)} left out; --sequence {others[0]} takes it'
        )
    return recording


def _find_all(path: Path) -> dict[Layout, list[Candidate]]:
    """Return the recordings at a path, by each layout that it has any of."""
    folder = absolute(path)
    if not folder.is_dir():
        return {}
    found = {layout: files.find(folder) for layout, files in LAYOUTS.items()}
    return {layout: candidates for layout, candidates in found.items() if candidates}


def _not_of_layout(path: Path, layout: Layout) -> NotKittiError:
    """Return the error for a path without a recording of the requested layout."""
    fits = _find_all(path)
    if not fits:
        return explain(path)
    other = next(iter(fits)).value
    advice = f'it is layout {other}, which is detected without --layout'
    return NotKittiError(path, f'no {layout.value} recording', [], advice)


def _choose(
    path: Path, layout: Layout, candidates: list[Candidate], asked: str | None
) -> Candidate:
    known = [candidate.name for candidate in candidates]
    if asked is not None:
        matching = [candidate for candidate in candidates if _matches(candidate.name, asked)]
        if len(matching) > 1:
            several = some_of([candidate.name for candidate in matching])
            raise UsageError(f'{path}: sequence {asked!r} may be {several}; give the whole name')
        if not matching:
            hint = did_you_mean(asked, known) or f'; it holds {some_of(known, 12)}'
            raise UsageError(f'{path}: no sequence {asked!r}{hint}')
        return matching[0]
    if len(candidates) > 1 and not layout.traits.frame_set:
        raise AmbiguousSequenceError(path, layout.traits.noun, known).with_remedies(
            Remedy(path, path, ('--sequence', known[0])), _all_of(path, candidates)
        )
    return candidates[0]


def _all_of(path: Path, candidates: list[Candidate]) -> Remedy:
    """Return the loop over all recordings: over their own folders, or else over their names."""
    folders = [each.folder for each in candidates if each.folder is not None]
    if not folders:
        each = ' '.join(_braces([candidate.name for candidate in candidates]))
        return Remedy(path, path, each=each, by_name=True)
    common = os.path.commonpath([folder.parent for folder in folders])
    levels = max(len(folder.parts) for folder in folders) - len(Path(common).parts)
    shown = path / os.path.relpath(common, absolute(path))
    return Remedy(path, path, each=f'{shlex.quote(str(shown))}/{"*/" * levels}')


def _braces(known: list[str]) -> list[str]:
    """Abbreviate numbers in a row for a shell, such as {0000..0020}."""
    if not all(name.isdecimal() for name in known):
        return known
    width = len(known[0])
    runs = runs_of(sorted(map(int, known)))
    return [
        f'{{{first:0{width}d}..{last:0{width}d}}}' if first != last else f'{first:0{width}d}'
        for first, last in runs
    ]


def _matches(name: str, asked: str) -> bool:
    if name == asked:
        return True
    drive = names.RAW_DRIVE.fullmatch(name)
    short = drive[1] if drive else name
    return short.isdecimal() and asked.isdecimal() and int(short) == int(asked)
