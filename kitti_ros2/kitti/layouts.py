# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detects the layout of a folder and opens it."""

from __future__ import annotations

import os
import shlex
from typing import TYPE_CHECKING

from ..files.remote import common_folder, is_remote
from ..files.upload_marker import refuse_incomplete
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
from .listings import listings_kept
from .motion import prepare_motion
from .stereo_pairs import prepare_stereo

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.layouts import Layout
    from .find import Candidate
    from .nearby import DataSet
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
        raise _explain(path)
    return _only(path, fits)


def _only(path: Path, fits: dict[Layout, list[Candidate]]) -> tuple[Layout, list[Candidate]]:
    """Return the one layout that a path fits."""
    if len(fits) > 1:
        raise AmbiguousLayoutError(path, [layout.value for layout in fits]).with_remedies(
            *(Remedy(path, path, ('--layout', layout.value)) for layout in fits)
        )
    return next(iter(fits.items()))


@listings_kept()
def open_recording(
    path: Path, options: ReadOptions | None = None, *, scans: bool = True
) -> KittiRecording:
    """Open the recording at a path; lists folders, reads time stamps and sequence-wide files only.

    Args:
        path: The folder.
        options: How it is read.
        scans: Whether its scans are used: then the first must be of the options' columns.

    Raises:
        BadFileError: The scans have other columns.
        NotKittiError: There is no recording.
        AmbiguousLayoutError: The folder fits several layouts and the options contain none.
        AmbiguousSequenceError: It contains several recordings and the options choose none.
        UsageError: The chosen recording does not exist, or the options request labels of points
            or real time and the layout has none.
        MissingDataError: The options request compensation of motion, and the motion is not known.
    """
    options = options or ReadOptions()
    layout, candidates = find_candidates(path, options)
    if options.semantic and not layout.traits.point_labels:
        raise UsageError(
            f'{path}: semantic is for the odometry layout, which has labels of points;'
            f' this is layout {layout.value}'
        )
    if options.real_time and not layout.traits.frame_set:
        raise UsageError(
            f'{path}: real time is for the object layout, whose frames have no stamps of their own;'
            f' this is layout {layout.value}'
        )
    chosen = choose_recording(path, layout, candidates, options.sequence)
    recording = open_candidate(path, layout, chosen, options, scans=scans)
    others = [candidate.name for candidate in candidates if candidate is not chosen]
    if layout.traits.frame_set and others and options.sequence is None:
        recording.notes.append(
            f'{absolute(path)}: {", ".join(others)} left out; --sequence {others[0]} takes it'
        )
    return recording


@listings_kept()
def open_recordings(path: Path, options: ReadOptions | None = None) -> list[KittiRecording]:
    """Open all recordings at a path, or the one that the options choose.

    Raises:
        NotKittiError, AmbiguousLayoutError, UsageError: As open_recording.
    """
    options = options or ReadOptions()
    if options.sequence is not None:
        return [open_recording(path, options)]
    layout, candidates = find_candidates(path, options)
    opened = [_open(candidate, options) for candidate in candidates]
    if not any(recording.streams for recording in opened):
        raise _no_data(path, layout, opened[0])
    return opened


def open_candidate(
    path: Path, layout: Layout, candidate: Candidate, options: ReadOptions, *, scans: bool = True
) -> KittiRecording:
    """Open a recording that was found at a path.

    Raises:
        BadFileError: Its scans are used, and have other columns.
        NotKittiError: Not one of its files can be used.
    """
    recording = _open(candidate, options, scans=scans)
    if not recording.streams:
        raise _no_data(path, layout, recording)
    return recording


def _open(candidate: Candidate, options: ReadOptions, *, scans: bool = True) -> KittiRecording:
    recording = candidate.open(options)
    if scans:
        recording.prepare_columns()
    prepare_motion(recording)
    prepare_stereo(recording)
    return recording


def find_data_sets(path: Path, options: ReadOptions) -> list[DataSet]:
    """Find the data sets at a path, else those in its sub-folders; options choose among them.

    Raises:
        NotKittiError: There is no recording.
        AmbiguousLayoutError: The folder fits several layouts and the options contain none.
        UsageError: The chosen recording does not exist, or not all sub-folders can be searched.
    """
    from .nearby import data_sets_below  # noqa: PLC0415 - for whole sets only

    found = data_sets_at(path, options)
    if not found and options.layout is None:
        found, complete = data_sets_below(path) if path.is_dir() else ([], True)
        if not complete:
            raise UsageError(f'{path}: holds too many folders to search; give the data sets in it')
    if not found:
        raise _explain(path) if options.layout is None else not_of_layout(path, options.layout)
    return found


@listings_kept()
def data_sets_at(path: Path, options: ReadOptions) -> list[DataSet]:
    """Find the data set at a path itself, of the requested or the detected layout.

    Raises:
        AmbiguousLayoutError: The folder fits several layouts and the options contain none.
        BadFileError: Its upload to a store was not completed.
        UsageError: The chosen recording does not exist.
    """
    from .nearby import DataSet  # noqa: PLC0415 - for whole sets only

    refuse_incomplete(path)
    fits = _find_all(path)
    if options.layout is not None:
        fits = {layout: found for layout, found in fits.items() if layout is options.layout}
    if not fits:
        return []
    layout, candidates = _only(path, fits)
    if options.sequence is not None:
        candidates = [choose_recording(path, layout, candidates, options.sequence)]
    return [DataSet(path, layout, candidates)]


@listings_kept()
def find_candidates(path: Path, options: ReadOptions) -> tuple[Layout, list[Candidate]]:
    """Find the recordings at a path, of the requested or the detected layout.

    Raises:
        NotKittiError: There is none.
        AmbiguousLayoutError: The folder fits several layouts and the options contain none.
        BadFileError: Its upload to a store was not completed.
    """
    refuse_incomplete(path)
    if options.layout is None:
        return _guess(path)
    folder = absolute(path)
    candidates = LAYOUTS[options.layout].find(folder) if folder.is_dir() else []
    if not candidates:
        raise not_of_layout(path, options.layout)
    return options.layout, candidates


def _no_data(path: Path, layout: Layout, recording: KittiRecording) -> NotKittiError:
    """Return the error for a recording without any stream."""
    reasons = [loss.text() for loss in recording.losses]
    found = '; '.join([f'no data file of {recording.name} can be used', *reasons[:1]])
    return NotKittiError(path, found, [layout.value])


@listings_kept()
def _find_all(path: Path) -> dict[Layout, list[Candidate]]:
    """Return the recordings at a path, by each layout that it has any of."""
    folder = absolute(path)
    if not folder.is_dir():
        return {}
    found = {layout: files.find(folder) for layout, files in LAYOUTS.items()}
    return {layout: candidates for layout, candidates in found.items() if candidates}


def _explain(path: Path) -> NotKittiError:
    from .nearby import explain  # noqa: PLC0415 - for errors only

    return explain(path)


def not_of_layout(path: Path, layout: Layout) -> NotKittiError:
    """Return the error for a path without a recording of the requested layout."""
    fits = _find_all(path)
    if not fits:
        return _explain(path)
    other = next(iter(fits)).value
    advice = f'it is layout {other}, which is detected without --layout'
    return NotKittiError(path, f'no {layout.value} recording', [], advice)


def choose_recording(
    path: Path, layout: Layout, candidates: list[Candidate], asked: str | None
) -> Candidate:
    """Return the candidate of a name, or the only one.

    Raises:
        AmbiguousSequenceError: There are several, and no name is given.
        UsageError: None has the name, or several have.
    """
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
    common = common_folder([folder.parent for folder in folders])
    levels = max(len(folder.parts) for folder in folders) - len(common.parts)
    shown = common if is_remote(common) else path / os.path.relpath(common, absolute(path))
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
