# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The units of evaluations: results, each with the ground truth that it is compared with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..bags.search import bags_among, is_bag_name, stem_of
from ..kitti.find import absolute
from ..kitti.layouts import open_recording
from ..kitti.names import SEQUENCE_DIGITS, TRACKING_LABELS, TXT
from ..kitti.nearby import explain
from ..kitti.result_files import find_frame_files
from ..model.errors import KittiRos2Error, MissingPathError, UsageError
from ..model.layouts import Layout
from ..model.streams import Stream
from ..model.text import some_of
from .folders import common_folder, find_roots, relative_name
from .source_units import bags_at
from .units import WorkUnit, in_order, recordings_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from .folders import FolderSearch

_DATA = 'data'
"""Folder of a tracker's files, below the name of the tracker."""
_TRAJECTORIES = (TXT, '.tum')


@dataclass(frozen=True)
class PairKind:
    """What an evaluation compares.

    Attributes:
        stream: What the ground truth has, of a recording.
        layout: The only layout of the ground truth; None for any, and bags.
        frames: Whether a folder of files named by frame is a result.
        texts: Whether a text file of any name is a result, or only one named by sequence.
    """

    stream: Stream
    layout: Layout | None = None
    frames: bool = False
    texts: bool = False


DETECTION = PairKind(Stream.LABELS, frames=True)
TRACKING = PairKind(Stream.LABELS, Layout.TRACKING)
ODOMETRY = PairKind(Stream.POSE, texts=True)


def find_pairs(
    truth: Path,
    results: Path,
    kind: PairKind,
    layout: Layout | None,
    search: FolderSearch,
) -> list[WorkUnit]:
    """Find the results of an evaluation, each with its ground truth.

    If there is one ground truth, all results are compared with it. Otherwise a result is compared
    with the ground truth whose last name it has, or most of whose last names.

    Args:
        truth: A root, a glob or a list of recordings or bags; of trajectories also of poses files.
        results: A root, a glob or a list of result files, folders of them, or bags.
        kind: Of the evaluation.
        layout: Only recordings of this layout; None takes all.
        search: Knows which folders are left out; gets the paths that have no counterpart.

    Raises:
        KittiRos2Error: There is no ground truth, no result, or no pair of both.
        OSError: A root cannot be read.
    """
    found = dict(_results(results, kind, search))
    if not found:
        raise UsageError(f'{results}: has no result; see kitti-ros2 eval ... --help for its files')
    known = list(_truths(truth, kind, layout, replace(search, exclude=[*search.exclude, results])))
    units = []
    for name, path in found.items():
        chosen = known if len(known) == 1 else _closest(name, known)
        if len(chosen) == 1:
            units.append(replace(chosen[0], name=name, result=path))
        else:
            several = some_of([each.name for each in chosen])
            why = f'fits {several} in {truth}' if chosen else f'has no ground truth in {truth}'
            search.problems.append(f'{path}: {why}; not scored')
    if not units:
        names = f'{some_of([*found])} and {some_of([each.name for each in known])}'
        raise UsageError(f'{results}: no result has the name of a ground truth: {names}')
    compared = {(unit.source, unit.sequence) for unit in units}
    absent = [each.name for each in known if (each.source, each.sequence) not in compared]
    if absent:
        search.problems.append(f'{results}: no result for {some_of(absent, 6)}; not scored')
    return in_order(units, [results])


def _closest(name: str, known: Iterable[WorkUnit]) -> list[WorkUnit]:
    """Return the ground truths that share most last names with a result, at least one."""
    lengths = [(_common_tail(name, each), each) for each in known]
    longest = max(length for length, _ in lengths)
    return [each for length, each in lengths if length == longest] if longest else []


def _common_tail(name: str, truth: WorkUnit) -> int:
    """Return how many last names a result shares with a ground truth."""
    path = PurePosixPath(truth.name)
    own = (*path.parent.parts, stem_of(Path(path.name)) if truth.layout is None else path.name)
    pairs = zip(reversed(PurePosixPath(name).parts), reversed(own), strict=False)
    count = 0
    for one, other in pairs:
        if one != other:
            break
        count += 1
    return count


def _truths(
    source: Path, kind: PairKind, layout: Layout | None, search: FolderSearch
) -> Iterator[WorkUnit]:
    """Yield the ground truths: recordings that have it, bags, files of poses."""
    roots = find_roots(source, lambda path: is_bag_name(path) or (kind.texts and _is_text(path)))
    base = common_folder(roots)
    for root in roots:
        if not root.exists():
            raise explain(root)
        found = list(_truths_at(root, base, kind, layout, search))
        if not found:
            raise search.nothing() or explain(root)
        having = [each for each in found if _has(each, kind.stream)]
        if not having:
            raise UsageError(
                f'{root}: {some_of([each.name for each in found])}: no {kind.stream.value} to'
                f' compare with; KITTI publishes none of its test data'
            )
        yield from having


def _truths_at(
    root: Path, base: Path, kind: PairKind, layout: Layout | None, search: FolderSearch
) -> Iterator[WorkUnit]:
    wanted = kind.layout or layout
    place = absolute(root)
    if place.is_dir():
        split = place.parent if kind.layout and place.name == TRACKING_LABELS else place
        found = recordings_at(split, base, wanted, search)
        yield from found
        if wanted is None and not found:
            if kind.frames and find_frame_files(place) is not None:
                yield WorkUnit(relative_name(place, base), place)
            for path in sorted(place.iterdir()) if kind.texts else ():
                if _is_text(path):
                    yield WorkUnit(_result_name(path, base), path)
    if wanted is None:
        for bag in bags_at(root, search):
            yield WorkUnit(_result_name(bag, base), bag)


def _has(unit: WorkUnit, stream: Stream) -> bool:
    """Whether a recording has a stream; one that cannot be opened fails with its reason later."""
    if unit.layout is None:
        return True
    try:
        return stream in open_recording(unit.source, unit.read, scans=False).streams
    except (KittiRos2Error, OSError):
        return True


def _results(source: Path, kind: PairKind, search: FolderSearch) -> Iterator[tuple[str, Path]]:
    """Yield the results with their names.

    Raises:
        UsageError: Two have one name.
    """
    roots = find_roots(source, Path.is_file)
    base = common_folder(roots)
    found: dict[str, Path] = {}
    for root in roots:
        if not root.exists():
            raise MissingPathError(root)
        for path in [absolute(root)] if root.is_file() else _results_below(root, kind, search):
            name = _result_name(path, base)
            if found.setdefault(name, path) != path:
                raise UsageError(
                    f'{source}: {found[name]} and {path} have one name, {name}; choose among them'
                    f' with a glob or a list'
                )
    yield from found.items()


def _results_below(root: Path, kind: PairKind, search: FolderSearch) -> list[Path]:
    found: list[Path] = []

    def visit(folder: Path, folders: Sequence[str], others: Sequence[str]) -> Sequence[str]:
        bags = bags_among(folder, others)
        found.extend(bags)
        if bags == [folder]:
            return ()
        if kind.frames and find_frame_files(folder) is not None:
            found.append(folder)
            return ()
        texts = [folder / name for name in others if _is_text(folder / name)]
        found.extend(each for each in texts if kind.texts or _is_sequence(each))
        return folders

    search.walk(absolute(root), visit)
    return found


def _is_text(path: Path) -> bool:
    return path.suffix in _TRAJECTORIES and path.is_file()


def _is_sequence(path: Path) -> bool:
    return path.suffix == TXT and len(path.stem) == SEQUENCE_DIGITS and path.stem.isdecimal()


def _result_name(path: Path, base: Path) -> str:
    """Return the name of a result or ground truth: without ending, and folders named data."""
    last = path.name
    if path.is_file():
        last = path.stem if path.suffix in _TRAJECTORIES else stem_of(path)
    *above, _ = PurePosixPath(relative_name(path, base)).parts
    return PurePosixPath(*(name for name in above if name != _DATA), last).as_posix()
