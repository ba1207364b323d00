# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Jobs of a collection: recordings and slices of them, bags, results with ground truth."""

from __future__ import annotations

import glob
import os
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from ..bags.bag_files import explain_file, explain_no_bag
from ..bags.locate import bags_among, is_bag_name, stem_of
from ..files import remote
from ..files.remote import canonical_path, is_remote, relative_path
from ..files.staging import refuse_inside
from ..kitti.find import absolute
from ..kitti.label_file import find_frame_files
from ..kitti.names import SEQUENCE_DIGITS, TRACKING_LABELS, TXT
from ..kitti.opening import covered_folders, data_sets_at, data_sets_in, explain, open_recording
from ..model.errors import (
    KittiRos2Error,
    MissingPathError,
    NotABagError,
    UsageError,
    describe_error,
    naming,
    some_of,
)
from ..model.streams import Layout, Stream
from ..options.read import ReadOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from ..kitti.find import Candidate
    from ..kitti.opening import DataSet


# The folders of a collection: roots, globs and lists; the folders below them.

if TYPE_CHECKING:
    Visit = Callable[[Path, Sequence[str], Sequence[str]], Sequence[str]]

_LIST = '.txt'
_MOST_LEVELS = 8


def find_roots(source: Path, is_file: Callable[[Path], bool] | None = None) -> list[Path]:
    """Return the folders of a collection: a root itself, the matches of a glob, or a list's.

    A list is a text file with one path or URL per line, relative to the list; # begins a comment.

    Args:
        source: The user's path.
        is_file: Returns True for files that a glob may match; None for folders only.

    Raises:
        KittiRos2Error: The path does not exist.
        OSError: The list cannot be read.
    """
    noun = 'folder' if is_file is None else 'folder or file'
    if source.is_file() and source.suffix == _LIST:
        paths = list(_listed(source))
        if not paths:
            raise UsageError(f'{source}: names no {noun}; expected one path per line')
    elif source.exists() or not glob.has_magic(str(source)):
        return [source]
    else:
        paths = [
            path
            for path in _matches(source)
            if path.is_dir() or (is_file is not None and is_file(path))
        ]
        if not paths:
            raise UsageError(f'{source}: no {noun} matches; quote the pattern, or give a root')
    for path in paths:
        if not path.exists():
            raise MissingPathError(path)
    return list(dict.fromkeys(paths))


def find_all_roots(sources: Sequence[Path]) -> list[Path]:
    """Return the folders and bags of several collections, as find_roots."""
    roots = (root for source in sources for root in find_roots(source, is_bag_name))
    return list(dict.fromkeys(roots))


def _listed(path: Path) -> Iterator[Path]:
    try:
        with naming(path):
            lines = path.read_text('utf-8').splitlines()
    except UnicodeDecodeError:
        raise UsageError(f'{path}: not UTF-8 text; expected one path per line') from None
    for line in lines:
        text = line.partition('#')[0].strip()
        if text:
            root = remote.as_path(text)
            yield root if remote.is_remote(root) else path.parent / root


def _matches(pattern: Path) -> list[Path]:
    if remote.is_remote(pattern):
        from ..files.remote_reads import matches_of  # noqa: PLC0415 - for URLs only

        return [*matches_of(pattern)]
    matches = glob.glob(str(pattern), recursive=True)  # noqa: PTH207 - possibly absolute
    return [Path(match) for match in sorted(matches)]


def common_folder(roots: Sequence[Path]) -> Path:
    """Return the only root, or the common folder of several.

    Raises:
        UsageError: The roots are in several stores, or in a store and on this machine.
    """
    if len(roots) == 1:
        return absolute(roots[0])
    try:
        return remote.common_folder([absolute(root).parent for root in roots])
    except ValueError:
        raise UsageError(
            f'{roots[0]} and {roots[-1]} are in no common folder; run one command for each store'
        ) from None


def relative_name(path: Path, base: Path) -> str:
    """Return the name of a path below a folder, or of the folder itself."""
    return path.name if path == base else Path(remote.relative_path(path, base)).as_posix()


@dataclass
class FolderSearch:
    """A search of folders for jobs, with its problems.

    Attributes:
        exclude: Folders to skip, such as the output.
        problems: Unreadable folders, and paths without a counterpart, one line each.
    """

    exclude: Sequence[Path] = ()
    problems: list[str] = field(default_factory=list)

    def nothing(self) -> UsageError | None:
        """Return the error for a search without results, if folders were unreadable."""
        return UsageError(f'nothing is found; {self.problems[0]}') if self.problems else None

    def walk(self, root: Path, visit: Visit) -> None:
        """Visit a folder and the folders below it once, also if links form cycles.

        Hidden folders, and those more than eight levels below, are skipped.

        Args:
            root: The first folder.
            visit: Called with a folder, the names of its folders and of its other entries, both
                in order; returns the names of the folders to visit.

        Raises:
            OSError: The first folder cannot be read.
        """
        excluded = {remote.canonical_path(path) for path in self.exclude}
        seen: set[str] = set()
        stack = [(root, 0)]
        while stack:
            folder, level = stack.pop()
            real_path = remote.canonical_path(folder)  # for cycles of links
            if real_path in seen or real_path in excluded:
                continue
            seen.add(real_path)
            try:
                folders, others = _entries(folder)
            except OSError as error:
                if not level:
                    raise
                self.problems.append(describe_error(error))
                continue
            below = visit(folder, folders, others)
            if below and level == _MOST_LEVELS:
                self.problems.append(
                    f'{folder}: the folders in it are more than {_MOST_LEVELS} levels below {root};'
                    f' give it as a root of its own'
                )
                continue
            stack += [(folder / name, level + 1) for name in reversed(below)]


def _entries(folder: Path) -> tuple[list[str], list[str]]:
    """Return the names of the folders in a folder, and of its other visible entries."""
    folders: list[str] = []
    others: list[str] = []
    if remote.is_remote(folder):
        from ..files.remote_reads import listing_of  # noqa: PLC0415 - for URLs only

        for name, entry in listing_of(folder).items():
            if not name.startswith('.'):
                (folders if entry.is_folder else others).append(name)
        return folders, others
    with os.scandir(folder) as entries:
        for dir_entry in entries:
            if not dir_entry.name.startswith('.'):
                (folders if _is_folder(dir_entry) else others).append(dir_entry.name)
    return sorted(folders), sorted(others)


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a link to itself
        return False


# Jobs of recordings: drives, sequences, splits, or slices of an object set.

_FRAME_DIGITS = 6


@dataclass(frozen=True)
class Job:
    """A recording, a slice of one, a bag, or a result with its ground truth.

    Attributes:
        name: Path below the root of the collection, also the name of the output.
        source: The folder or file to open.
        layout: Layout; None for a bag or another file.
        sequence: The recording in the folder; None for the only one.
        first, last: File numbers of a slice, both included; None for all frames.
        result: Result to compare with the source; None without any.
    """

    name: str
    source: Path
    layout: Layout | None = None
    sequence: str | None = None
    first: int | None = None
    last: int | None = None
    result: Path | None = None

    @property
    def read(self) -> ReadOptions:
        """Options for opening the recording."""
        return ReadOptions(layout=self.layout, sequence=self.sequence)

    @cached_property
    def origin(self) -> str:
        """Its inputs as text."""
        against = '' if self.result is None else f'{self.result} with '
        return f'{against}{self.source}'


def find_jobs(
    roots: Sequence[Path],
    layout: Layout | None = None,
    slice_frames: int | None = None,
    search: FolderSearch | None = None,
) -> list[Job]:
    """Find the recordings of a collection, in the order of their names.

    Args:
        roots: Folders: a drive, a data set, or a folder of any number of them.
        layout: Only recordings of this layout; None takes all.
        slice_frames: Frames of a slice of an object set; None does not divide it.
        search: Has the folders to skip; collects unreadable ones.

    Raises:
        KittiRos2Error: There is no recording, a layout is ambiguous, or two jobs have one name.
        OSError: A root cannot be read.
    """
    base = common_folder(roots)
    search = search or FolderSearch()
    job_map: dict[tuple[Path, str | None], Job] = {}
    for root in roots:
        jobs = recordings_at(root, base, layout, search) if root.is_dir() else []
        if not jobs:
            raise search.nothing() or explain(root)
        for job in jobs:
            job_map.setdefault((job.source, job.sequence), job)
    jobs = in_order(job_map.values(), roots)
    if slice_frames is None:
        return jobs
    return [part for job in jobs for part in _slices(job, slice_frames)]


def recordings_at(root: Path, base: Path, layout: Layout | None, search: FolderSearch) -> list[Job]:
    """Return the recordings at a folder and below it, except within the recordings of another.

    Args:
        root: The folder.
        base: Folder that names are relative to.
        layout: Only recordings of this layout; None takes all.
        search: Search as of find_jobs.
    """
    top = absolute(root)
    jobs: list[Job] = []

    def visit(folder: Path, folders: Sequence[str], _: Sequence[str]) -> Sequence[str]:
        data_sets = data_sets_in(folder) if folder != top else _data_sets_at(top, layout)
        for data_set in data_sets:
            if layout in {None, data_set.layout}:
                jobs.extend(_job(base, data_set, recording) for recording in data_set.recordings)
        covered = covered_folders(folder, folders, data_sets)
        return [name for name in folders if name not in covered]

    search.walk(top, visit)
    return jobs


def in_order(jobs: Iterable[Job], roots: Sequence[Path]) -> list[Job]:
    """Return jobs in the order of their names.

    Raises:
        UsageError: Two have one name.
    """
    ordered = sorted(jobs, key=lambda job: job.name)
    counts = Counter(job.name for job in ordered)
    repeated = [name for name, count in counts.items() if count > 1]
    if repeated:
        origins = [job.origin for job in ordered if job.name == repeated[0]]
        raise UsageError(
            f'{roots[0]}: several units have the name {some_of(repeated)}, such as'
            f' {some_of(origins)}; choose among them with a glob or a list'
        )
    return ordered


def refuse_within(jobs: Iterable[Job], out: Path) -> None:
    """Refuse an output folder inside an input; it may lie between inputs of a root.

    Raises:
        UsageError: The output lies inside an input.
    """
    target = out.resolve() if is_remote(out) else Path(canonical_path(out))
    around = {str(folder) for folder in (target, *target.parents)}
    for job in jobs:
        for source in filter(None, (job.source, job.result)):
            if canonical_path(source) in around:
                refuse_inside(source, out)


def _job(base: Path, data_set: DataSet, candidate: Candidate) -> Job:
    if candidate.folder is None:  # its folders are shared, and it has a name in the data set
        folder = absolute(data_set.folder)
        path = Path(relative_path(folder, base), candidate.name)
        return Job(path.as_posix(), folder, data_set.layout, candidate.name)
    folder = absolute(candidate.folder)
    return Job(relative_name(folder, base), folder, data_set.layout)


def _data_sets_at(root: Path, layout: Layout | None) -> list[DataSet]:
    try:
        return data_sets_at(root, ReadOptions(layout=layout))
    except PermissionError:  # for one of its recordings; the others are found in their folders
        return []


def _slices(job: Job, frames: int) -> Iterator[Job]:
    """Divide an object split into slices of existing frames; keep other jobs whole."""
    if job.layout is None or not job.layout.traits.frame_set:
        yield job
        return
    recording = open_recording(job.source, job.read, scans=False)
    present = [index.numbers for index in recording.streams.values()]
    numbers = np.unique(np.concatenate(present)).tolist()
    for start in range(0, len(numbers), frames):
        part = numbers[start : start + frames]
        name = f'{job.name}/{part[0]:0{_FRAME_DIGITS}d}-{part[-1]:0{_FRAME_DIGITS}d}'
        yield replace(job, name=name, first=part[0], last=part[-1])


# The jobs of a collection of bags, or of recordings and bags.


def find_bag_jobs(roots: Sequence[Path], search: FolderSearch) -> list[Job]:
    """Find the bags of a collection; names of jobs have no suffixes.

    Args:
        roots: Bags, and folders of any number of them.
        search: Has the folders to skip; collects unreadable ones.

    Raises:
        KittiRos2Error: There is no bag, or two have the same output.
        OSError: A root cannot be read.
    """
    base = common_folder(roots)
    job_map: dict[Path, Job] = {}
    for root in roots:
        bags = list(bags_at(root, search)) if root.exists() else []
        if not bags:
            found_none = (
                'has no bag, nor has a folder below it'
                if root.exists()
                else 'there is no such file or directory'
            )
            raise search.nothing() or explain_no_bag(root, NotABagError(root, found_none))
        for bag in bags:
            name = stem_of(bag) if bag.is_file() else bag.name
            path = Path(relative_name(bag, base)).with_name(name)
            job_map.setdefault(bag, Job(path.as_posix(), bag))
    jobs = in_order(job_map.values(), roots)
    _refuse_nested(jobs)
    return jobs


def _refuse_nested(jobs: Iterable[Job]) -> None:
    """Refuse two outputs of which one lies inside the other."""
    bags = {job.name: job.source for job in jobs}
    for name, bag in bags.items():
        for parent in Path(name).parents:
            other = bags.get(parent.as_posix())
            if other is not None:
                raise UsageError(
                    f'{bag}: its data set would lie inside that of {other}; choose among them with'
                    f' a glob or a list'
                )


def find_source_jobs(
    roots: Sequence[Path], layout: Layout | None, search: FolderSearch
) -> list[Job]:
    """Find the recordings and the bags of a collection; names of bags have their suffixes.

    Args:
        roots: Recordings, data sets, bags, and folders of any number of them.
        layout: Only recordings of this layout, and no bags; None takes all.
        search: Has the folders to skip; collects unreadable ones.

    Raises:
        KittiRos2Error: A root has none, a layout is ambiguous, or two jobs have one name.
        OSError: A root cannot be read.
    """
    base = common_folder(roots)
    job_map: dict[tuple[Path, str | None], Job] = {}
    for root in roots:
        jobs = recordings_at(root, base, layout, search) if root.is_dir() else []
        if layout is None and root.exists():
            jobs += [Job(relative_name(bag, base), bag) for bag in bags_at(root, search)]
        if not jobs:
            raise search.nothing() or (explain_file(root) if root.is_file() else explain(root))
        for job in jobs:
            job_map.setdefault((job.source, job.sequence), job)
    return in_order(job_map.values(), roots)


def bags_at(root: Path, search: FolderSearch) -> Iterator[Path]:
    """Yield the bags at a path and below it, except within the folder of another.

    Args:
        root: A folder, or a file of any name, which is a bag.
        search: Search as of find_bag_jobs.

    Raises:
        OSError: The root cannot be read.
    """
    top = absolute(root)
    if top.is_file():
        yield top
        return
    bag_paths: list[Path] = []

    def visit(folder: Path, folders: Sequence[str], others: Sequence[str]) -> Sequence[str]:
        bags = bags_among(folder, others)
        bag_paths.extend(bags)
        return () if bags == [folder] else folders

    search.walk(top, visit)
    yield from bag_paths


# The jobs of evaluations: results, each with its ground truth.

_DATA = 'data'
"""Folder of a tracker's files, below the name of the tracker."""
_TRAJECTORIES = (TXT, '.tum')


@dataclass(frozen=True)
class PairKind:
    """The kind of data that an evaluation compares.

    Attributes:
        stream: Stream of a recording with the ground truth.
        layout: The only layout of the ground truth; None for any, and bags.
        frames: True if a folder of files named by frame is a result.
        texts: True if a text file of any name is a result, not only one named by sequence.
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
) -> list[Job]:
    """Find the results of an evaluation, each with its ground truth.

    A single ground truth is compared with all results. Otherwise a result is compared with the
    ground truth that shares most last names with it, at least one.

    Args:
        truth: A root, a glob or a list of recordings or bags; of trajectories also of poses files.
        results: A root, a glob or a list of result files, folders of them, or bags.
        kind: Kind of the evaluation.
        layout: Only recordings of this layout; None takes all.
        search: Has the folders to skip; collects paths without a counterpart.

    Raises:
        KittiRos2Error: There is no ground truth, no result, or no pair of both.
        OSError: A root cannot be read.
    """
    result_paths = dict(_results(results, kind, search))
    if not result_paths:
        raise UsageError(f'{results}: has no result; see kitti-ros2 eval ... --help for its files')
    truths = list(_truths(truth, kind, layout, replace(search, exclude=[*search.exclude, results])))
    jobs = []
    for name, path in result_paths.items():
        matches = truths if len(truths) == 1 else _closest(name, truths)
        if len(matches) == 1:
            jobs.append(replace(matches[0], name=name, result=path))
        else:
            several = some_of([job.name for job in matches])
            why = f'fits {several} in {truth}' if matches else f'has no ground truth in {truth}'
            search.problems.append(f'{path}: {why}; not scored')
    if not jobs:
        names = f'{some_of([*result_paths])} and {some_of([job.name for job in truths])}'
        raise UsageError(f'{results}: no result has the name of a ground truth: {names}')
    compared = {(job.source, job.sequence) for job in jobs}
    absent = [job.name for job in truths if (job.source, job.sequence) not in compared]
    if absent:
        search.problems.append(f'{results}: no result for {some_of(absent, 6)}; not scored')
    return in_order(jobs, [results])


def _closest(name: str, truths: Iterable[Job]) -> list[Job]:
    """Return the ground truths that share most last names with a result, at least one."""
    lengths = [(_common_tail(name, truth), truth) for truth in truths]
    longest = max(length for length, _ in lengths)
    return [truth for length, truth in lengths if length == longest] if longest else []


def _common_tail(name: str, truth: Job) -> int:
    """Return the number of last names that a result shares with a ground truth."""
    path = PurePosixPath(truth.name)
    parts = (*path.parent.parts, stem_of(Path(path.name)) if truth.layout is None else path.name)
    pairs = zip(reversed(PurePosixPath(name).parts), reversed(parts), strict=False)
    count = 0
    for one, other in pairs:
        if one != other:
            break
        count += 1
    return count


def _truths(
    source: Path, kind: PairKind, layout: Layout | None, search: FolderSearch
) -> Iterator[Job]:
    """Yield the ground truths: recordings with the stream, bags, files of poses."""
    roots = find_roots(source, lambda path: is_bag_name(path) or (kind.texts and _is_text(path)))
    base = common_folder(roots)
    for root in roots:
        if not root.exists():
            raise explain(root)
        truths = list(_truths_at(root, base, kind, layout, search))
        if not truths:
            raise search.nothing() or explain(root)
        having = [job for job in truths if _has(job, kind.stream)]
        if not having:
            raise UsageError(
                f'{root}: {some_of([job.name for job in truths])}: no {kind.stream.value} to'
                f' compare with; KITTI publishes none of its test data'
            )
        yield from having


def _truths_at(
    root: Path, base: Path, kind: PairKind, layout: Layout | None, search: FolderSearch
) -> Iterator[Job]:
    pair_layout = kind.layout or layout
    top = absolute(root)
    if top.is_dir():
        split = top.parent if kind.layout and top.name == TRACKING_LABELS else top
        recordings = recordings_at(split, base, pair_layout, search)
        yield from recordings
        if pair_layout is None and not recordings:
            if kind.frames and find_frame_files(top) is not None:
                yield Job(relative_name(top, base), top)
            for path in sorted(top.iterdir()) if kind.texts else ():
                if _is_text(path):
                    yield Job(_result_name(path, base), path)
    if pair_layout is None:
        for bag in bags_at(root, search):
            yield Job(_result_name(bag, base), bag)


def _has(job: Job, stream: Stream) -> bool:
    """Return whether a recording has a stream; an unreadable one fails with its reason later."""
    if job.layout is None:
        return True
    try:
        return stream in open_recording(job.source, job.read, scans=False).streams
    except (KittiRos2Error, OSError):
        return True


def _results(source: Path, kind: PairKind, search: FolderSearch) -> Iterator[tuple[str, Path]]:
    """Yield the results with their names.

    Raises:
        UsageError: Two have one name.
    """
    roots = find_roots(source, Path.is_file)
    base = common_folder(roots)
    paths: dict[str, Path] = {}
    for root in roots:
        if not root.exists():
            raise MissingPathError(root)
        for path in [absolute(root)] if root.is_file() else _results_below(root, kind, search):
            name = _result_name(path, base)
            if paths.setdefault(name, path) != path:
                raise UsageError(
                    f'{source}: {paths[name]} and {path} have one name, {name}; choose among them'
                    f' with a glob or a list'
                )
    yield from paths.items()


def _results_below(root: Path, kind: PairKind, search: FolderSearch) -> list[Path]:
    paths: list[Path] = []

    def visit(folder: Path, folders: Sequence[str], others: Sequence[str]) -> Sequence[str]:
        bags = bags_among(folder, others)
        paths.extend(bags)
        if bags == [folder]:
            return ()
        if kind.frames and find_frame_files(folder) is not None:
            paths.append(folder)
            return ()
        texts = [folder / name for name in others if _is_text(folder / name)]
        paths.extend(text for text in texts if kind.texts or _is_sequence(text))
        return folders

    search.walk(absolute(root), visit)
    return paths


def _is_text(path: Path) -> bool:
    return path.suffix in _TRAJECTORIES and path.is_file()


def _is_sequence(path: Path) -> bool:
    return path.suffix == TXT and len(path.stem) == SEQUENCE_DIGITS and path.stem.isdecimal()


def _result_name(path: Path, base: Path) -> str:
    """Return the name of a result or ground truth, without suffix and folders named data."""
    last = path.name
    if path.is_file():
        last = path.stem if path.suffix in _TRAJECTORIES else stem_of(path)
    *above, _ = PurePosixPath(relative_name(path, base)).parts
    return PurePosixPath(*(name for name in above if name != _DATA), last).as_posix()
