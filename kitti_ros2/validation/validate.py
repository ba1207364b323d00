# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Validation of data sets and bags: everything at some paths, by the table of rules."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from ..files.remote import as_path
from ..model.errors import UsageError
from ..options.dataset_tables import make_validation_options
from .recording_checks import check_recording
from .results import FindingTally
from .rule import find_breaches
from .rule_table import rules_by_id
from .set_rules import SET_RULES, SplitLists
from .source_rules import SOURCE_RULES, Unopened
from .sources import find_sources

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path
    from typing import TypedDict

    from typing_extensions import Unpack

    from ..kitti.names import FileNames
    from ..kitti.nearby import DataSet
    from ..options.read import ReadOptions
    from ..options.validating import ValidateOptions
    from .results import CheckedSource, ValidationReport

    AnyPath = str | os.PathLike[str]
    Progress = Callable[[int, int], None]

    class ValidateKeywords(TypedDict, total=False):
        """Options of validate."""

        layout: str | None
        sequence: str | None
        columns: str | Sequence[str] | None
        quick: bool
        decode: bool


def validate(
    path: AnyPath | Iterable[AnyPath],
    *,
    progress: Progress | None = None,
    **options: Unpack[ValidateKeywords],
) -> ValidationReport:
    """Check KITTI folders and bags, as `kitti-ros2 validate` does.

    Every recording at a path is checked, and every file of it: sizes, contents, and whether they
    agree. Memory does not grow with the number of files.

    Args:
        path: A KITTI folder, a folder of several, a bag, or several of these.
        progress: Called with the frames or messages done, and the number of all, of the recording
            or bag that is being checked.
        options: Those of `kitti-ros2 validate --help`: layout, sequence, columns, quick,
            decode.

    Returns:
        The findings by rule with severity, file, line and remedy; ok without errors.

    Raises:
        KittiRos2Error: There is nothing to check at a path, or an option is invalid.

    Examples:
        >>> from kitti_ros2.datasets import validate
        >>> validate('object').ok
        True
    """
    read, chosen = make_validation_options({**options})
    paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
    if not paths:
        raise UsageError('no path; expected at least one')
    found = [find_sources(each, read) for each in dict.fromkeys(map(as_path, paths))]
    tally = FindingTally(rules_by_id(bags=any(each.bags for each in found)))
    show = progress or (lambda _done, _total: None)
    sources: list[CheckedSource] = []
    for place, each in zip(map(as_path, paths), found, strict=False):
        for data_set in each.data_sets:
            sources += _check_data_set(data_set, read, chosen, tally, show)
        sources += _check_bags(each.bags, chosen, tally, show)
        if not each.complete:
            tally.add(find_breaches(SOURCE_RULES, Unopened(place)))
    return tally.report(sources)


def _check_bags(
    bags: Sequence[Path], options: ValidateOptions, tally: FindingTally, progress: Progress
) -> Iterator[CheckedSource]:
    if bags:
        from .bag_checks import check_bag  # noqa: PLC0415 - readers of bags take 0.2 s

        for bag in bags:
            yield check_bag(bag, options, tally, progress)


def _check_data_set(
    data_set: DataSet,
    read: ReadOptions,
    options: ValidateOptions,
    tally: FindingTally,
    progress: Progress,
) -> Iterator[CheckedSource]:
    """Check all recordings of a data set, and its lists of frames."""
    frames: dict[str, frozenset[int]] = {}
    known: dict[str, FileNames] = {}
    for candidate in data_set.recordings:
        source, numbers, known[candidate.name] = check_recording(
            candidate,
            data_set.layout,
            read,
            data_set.folder,
            options,
            tally,
            progress,
        )
        if data_set.layout.traits.frame_set:
            frames[candidate.name] = frozenset(numbers)
        yield source
    if frames:
        folders = [each.folder for each in data_set.recordings if each.folder is not None]
        splits = SplitLists.read(folders[0].parent, frames, known)
        tally.add(find_breaches(SET_RULES, splits))
