# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Divides a data set into lists of frames or sequences, and checks such lists."""

from __future__ import annotations

from bisect import bisect_left
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from hashlib import sha256
from itertools import combinations
from math import floor
from typing import TYPE_CHECKING

from ..files.local_staging import Staging, refuse_link, reported
from ..files.remote import as_path
from ..kitti import names
from ..kitti import names as kitti_names
from ..kitti.find import absolute
from ..kitti.names import format_image_set, parse_image_set
from ..kitti.object_set import find_mapping
from ..kitti.opening import find_candidates
from ..kitti.store import STORE
from ..model.errors import Loss, MissingPathError, NotKittiError, UsageError, format_count, some_of
from ..options.read import NOMINAL_PERIOD_NS, ReadOptions
from ..own_bags.schedule import frames_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from os import PathLike
    from pathlib import Path

    from typing_extensions import Unpack

    from ..kitti.find import Candidate
    from ..kitti.kitti_recording import KittiRecording
    from ..kitti.object_set import ObjectMapping
    from ..model.samples import Int64Array
    from ..model.streams import Layout
    from ..options.datasets import SplitOptions
    from ..options.keywords import SplitKeywords


# Comparison of lists: common entries, and entries of the same raw drive.


@dataclass(frozen=True)
class ListPair:
    """The overlap of two lists.

    Attributes:
        first, second: Names of the lists.
        overlap: Common entries.
        contained: True if one list is a part of the other, as train of trainval.
        drives: Raw drives with entries in each list, common entries aside.
        entries: Number of entries of these drives in the first and in the second.
        nearest: The closest two entries of one drive, of the first and the second; None
            without any.
        nearest_frames: Frames between them; None without nearest.
        nearest_s: Seconds between them, at the nominal rate of KITTI's scanner.
    """

    first: str
    second: str
    overlap: tuple[str, ...] = ()
    contained: bool = False
    drives: tuple[str, ...] = ()
    entries: tuple[int, int] = (0, 0)
    nearest: tuple[str, str] | None = None
    nearest_frames: int | None = None
    nearest_s: float | None = None

    @property
    def faults(self) -> tuple[str, ...]:
        """The overlap as a line; none if one list contains the other."""
        if not self.overlap or self.contained:
            return ()
        both = f'{self.first} and {self.second}: {len(self.overlap):,} in both'
        return (f'{both}: {some_of(self.overlap)}',)

    @property
    def leaks(self) -> tuple[str, ...]:
        """The entries of the same drives as a line; none if one list contains the other."""
        if not self.drives or self.contained:
            return ()
        drives = format_count(len(self.drives), 'drive')
        first, second = self.entries
        both = f'{self.first} and {self.second}: {drives} in both'
        text = f'{both}, with {first:,} and {second:,} of their entries'
        if self.nearest is not None and self.nearest_frames is not None:
            apart = format_count(self.nearest_frames, 'frame')
            text += (
                f'; the nearest, {" and ".join(self.nearest)}, are {apart} apart'
                f' (about {self.nearest_s:.1f} s)'
            )
        return (text,)


def compare_lists(
    lists: Mapping[str, Sequence[str]], parts: Mapping[str, Part]
) -> tuple[ListPair, ...]:
    """Compare each pair of lists.

    Args:
        lists: Entries by name of the list.
        parts: Parts by entry; entries without one are compared by name only.
    """
    return tuple(_pair(*both, parts) for both in combinations(lists.items(), 2))


def _pair(
    one: tuple[str, Sequence[str]], other: tuple[str, Sequence[str]], parts: Mapping[str, Part]
) -> ListPair:
    overlap = sorted({*one[1]}.intersection(other[1]))
    both = frozenset(overlap)
    sides = [_by_drive([n for n in names if n not in both], parts) for _, names in (one, other)]
    drives = sorted(sides[0].keys() & sides[1].keys())
    nearest = _nearest([(sides[0][drive], sides[1][drive]) for drive in drives])
    frames = None if nearest is None else nearest[0]
    return ListPair(
        first=one[0],
        second=other[0],
        overlap=tuple(overlap),
        contained=bool(overlap) and len(overlap) in {len({*one[1]}), len({*other[1]})},
        drives=tuple(drives),
        entries=(
            sum(len(sides[0][drive]) for drive in drives),
            sum(len(sides[1][drive]) for drive in drives),
        ),
        nearest=None if nearest is None else nearest[1],
        nearest_frames=frames,
        nearest_s=None if frames is None else round(frames * NOMINAL_PERIOD_NS / 1e9, 3),
    )


def _by_drive(entries: Iterable[str], parts: Mapping[str, Part]) -> dict[str, list[Part]]:
    parts_by_drive: dict[str, list[Part]] = {}
    for name in entries:
        part = parts.get(name)
        if part is not None and part.drive is not None:
            parts_by_drive.setdefault(part.drive, []).append(part)
    return parts_by_drive


def _nearest(
    sides: Iterable[tuple[Sequence[Part], Sequence[Part]]],
) -> tuple[int, tuple[str, str]] | None:
    """Return the least distance in frames of parts of one drive in both, and their names."""
    best: tuple[int, tuple[str, str]] | None = None
    for first, second in sides:
        numbered = sorted((part.number, part.name) for part in second if part.number is not None)
        for part in first:
            if part.number is None or not numbered:
                continue
            index = bisect_left(numbered, (part.number, ''))
            for number, name in numbered[max(0, index - 1) : index + 1]:
                candidate = abs(number - part.number), (part.name, name)
                best = candidate if best is None else min(best, candidate)
    return best


# Random division of parts of different sizes by shares and a seed, equal on every machine.
#
# The random order is that of the SHA-256 of the text `SEED NAME` (UTF-8) of each part, such as `0
# 000123`: no random generator, and the same relative order when parts are added or removed. Each
# list takes parts in this order, and skips those with which it could not get as close to its share
# as the parts allow: single frames are taken one by one.


def seeded_order(names: Sequence[str], seed: int) -> list[str]:
    """Return names in the random order of a seed."""
    return sorted(names, key=lambda name: (sha256(f'{seed} {name}'.encode()).digest(), name))


def divide(
    sizes: Mapping[str, int], shares: Sequence[Fraction], seed: int
) -> list[list[str]] | None:
    """Divide parts into lists whose sizes are as close to the shares as whole parts allow.

    Args:
        sizes: Parts with their sizes, 1 or more.
        shares: Share of each list; they add up to 1.
        seed: Seed of the random order.

    Returns:
        The parts of each list, at least one, in their random order; None for too few parts.
    """
    rest = seeded_order([*sizes], seed)
    total, done, cumulated = sum(sizes.values()), 0, Fraction(0)
    lists = []
    for index, share in enumerate(shares[:-1]):
        cumulated += share
        target = floor(total * cumulated + Fraction(1, 2)) - done
        part_names = _take(rest, sizes, target, leave=len(shares) - index - 1)
        if part_names is None:
            return None
        chosen = frozenset(part_names)
        lists.append(part_names)
        rest = [name for name in rest if name not in chosen]
        done += sum(sizes[name] for name in part_names)
    return [*lists, rest] if rest else None


def _take(
    order: Sequence[str], sizes: Mapping[str, int], target: int, leave: int
) -> list[str] | None:
    """Return the first parts whose sizes add up as close to a target as possible.

    Args:
        order: The parts.
        sizes: Their sizes.
        target: The size to reach.
        leave: Least number of parts to leave.
    """
    if len(order) <= leave:
        return None
    if all(sizes[name] == 1 for name in order):
        return [*order[: min(max(target, 1), len(order) - leave)]]
    # Bit s of sums[i]: whether parts from i on can add up to s.
    sums = [1]
    for name in reversed(order):
        sums.append(sums[-1] | sums[-1] << sizes[name])
    sums.reverse()
    total = sum(sizes[name] for name in order)
    for list_size in sorted(range(1, total), key=lambda size: (abs(size - target), size)):
        if sums[0] >> list_size & 1:
            part_names = _first_that_add_up(order, sizes, sums, list_size)
            if len(order) - len(part_names) >= leave:
                return part_names
    return None


def _first_that_add_up(
    order: Sequence[str], sizes: Mapping[str, int], sums: Sequence[int], size: int
) -> list[str]:
    """Return parts that add up to a size, each taken if later ones can make the rest."""
    part_names = []
    for index, name in enumerate(order):
        rest = size - sizes[name]
        if rest >= 0 and sums[index + 1] >> rest & 1:
            part_names.append(name)
            size = rest
    return part_names


# A user's lists, with their entries looked up in the data set.


def read_lists(files: Sequence[Path], part_set: PartSet) -> list[GivenList]:
    """Read lists.

    Raises:
        UsageError: A file does not exist, or two have one name.
        KittiRos2Error, OSError: One cannot be read.
    """
    lists: dict[str, GivenList] = {}
    for file in files:
        frame_list = GivenList(file, part_set)
        if frame_list.name in lists:
            raise UsageError(f'{lists[frame_list.name].path} and {file} have the same name')
        lists[frame_list.name] = frame_list
    return [*lists.values()]


class GivenList:
    """A list, and its entries in the set.

    Attributes:
        path: File.
        name: The name of the file, without suffix.
        entries: Entries in the set, in the order of the file.
    """

    def __init__(self, path: Path, part_set: PartSet) -> None:
        if not path.is_file():
            raise MissingPathError(path)
        self.path = path
        self.name = path.name.removesuffix(names.TXT)
        self._noun = part_set.noun
        testing = part_set.is_of_testing(self.name)
        file_names = part_set.testing_frames if testing else part_set.frames
        self._parsed = parse_image_set(
            STORE.read_text(path), path, frames=part_set.lists_frames, file_names=file_names
        )
        parts = part_set.testing if testing else part_set.parts
        self._unchecked = parts is None
        every = self._parsed.entries
        self.entries = [*every] if parts is None else [name for name in every if name in parts]
        self._unknown = [name for name in every if parts is not None and name not in parts]

    def require_entries(self) -> None:
        """Raise unless it has an entry.

        Raises:
            UsageError: It has none.
        """
        if not self.entries:
            reasons = [*self._parsed.invalid, f'{self.path}: no {self._noun} of the set']
            raise UsageError(f'{reasons[0]}; the list would be empty')

    def losses(self, *, checked: bool) -> list[Loss]:
        """Return unusable lines and, of a checked list, lines that other readers may refuse."""
        reasons = [*self._parsed.invalid, *(self._parsed.repaired if checked else ())]
        losses = [Loss(self.name, 1, reason.replace('{', '(')) for reason in reasons]
        if self._unknown:
            what = some_of(self._unknown, 5)
            text = f'{self.path}: not in the set: {what}'
            losses.append(Loss(self.name, len(self._unknown), text))
        return losses

    def notes(self, *, checked: bool) -> list[str]:
        """Return lines that cost no data."""
        notes = [] if checked else [f'{line}; corrected' for line in self._parsed.repaired]
        if self._unchecked:
            notes.append(f'{self.path}: of testing frames, which are not there to compare')
        if not self._parsed.entries and not self._parsed.invalid:
            notes.append(f'{self.path}: is empty')
        return notes


# The parts in lists of a data set: frames of an object set, else sequences or drives.

TEST = 'test'
"""Beginning of the names of lists of testing frames of an object set."""


@dataclass(frozen=True)
class Part:
    """A frame, sequence or drive of a data set: a line of a list.

    Attributes:
        name: The line.
        frames: Number of frames.
        drive: The raw drive; None if unknown.
        number: The file number of a frame in its drive; None if unknown.
    """

    name: str
    frames: int = 1
    drive: str | None = None
    number: int | None = None


@dataclass(frozen=True)
class PartSet:
    """The parts of a data set.

    Attributes:
        layout: Layout.
        folder: The folder of ImageSets.
        noun: frame, sequence or drive.
        parts: The parts by name.
        testing: Parts of the testing frames of an object set; None if they are missing, or the
            set itself.
        losses: Missing data.
        notes: Lines that cost no data.
        frames, testing_frames: File names of the frames of an object set.
    """

    layout: Layout
    folder: Path
    noun: str
    parts: dict[str, Part]
    testing: dict[str, Part] | None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    frames: names.FileNames = names.SIX_DIGITS
    testing_frames: names.FileNames = names.SIX_DIGITS

    @property
    def lists_frames(self) -> bool:
        """True if a part is a frame."""
        return self.layout.traits.frame_set

    def is_of_testing(self, name: str) -> bool:
        """Return whether a list of a name has testing frames, beside training frames."""
        return self.lists_frames and self.testing is not self.parts and name.startswith(TEST)


def find_parts(
    path: Path, layout: Layout | None, mapping: Path | None, *, by_drive: bool
) -> PartSet:
    """List the parts of a data set.

    Args:
        path: The set.
        layout: None detects it.
        mapping: The folder of the object devkit's mapping; None searches beside the set.
        by_drive: True if the drive of each frame is needed.

    Raises:
        UsageError: There is nothing to divide, or a needed mapping is missing.
        KittiRos2Error, OSError: It cannot be read.
    """
    layout, candidates = _find(path, layout)
    if layout.traits.frame_set:
        return _frames(layout, candidates, mapping, by_drive=by_drive)
    if mapping is not None or by_drive:
        flag = '--by-drive' if by_drive else '--mapping'
        noun = layout.traits.noun
        raise UsageError(f'{path}: {flag} is for object sets; here each {noun} stays whole')
    return _recordings(path, layout, candidates)


def _find(path: Path, layout: Layout | None) -> tuple[Layout, list[Candidate]]:
    try:
        return find_candidates(path, ReadOptions(layout=layout))
    except NotKittiError as error:
        from ..bags.bag_files import explain_no_folder  # noqa: PLC0415 - for errors only

        raise explain_no_folder(path, error, forced=layout is not None) from None


def _frames(
    layout: Layout, candidates: list[Candidate], mapping_folder: Path | None, *, by_drive: bool
) -> PartSet:
    """List the frames of an object set, of training if it has any."""
    recordings = {candidate.name: candidate.open(ReadOptions()) for candidate in candidates}
    chosen = recordings[candidates[0].name]
    is_testing = chosen.name == names.SPLITS[1]
    mapping: ObjectMapping | None = None
    notes: tuple[str, ...] = ()
    if not is_testing:
        mapping, notes = _mapping(chosen.root, mapping_folder, needed=by_drive)
    elif by_drive:
        raise UsageError(f'{chosen.root}: the devkit has the drives of training frames only')
    parts = _parts_of(chosen, mapping)
    losses = list(chosen.losses)
    if by_drive and mapping is not None:
        losses += _beyond(parts, mapping, chosen.file_names)
        parts = {name: part for name, part in parts.items() if part.drive is not None}
    other = recordings.get(names.SPLITS[1])
    testing = parts if is_testing else None if other is None else _parts_of(other, None)
    frames = chosen.file_names
    others = frames if other is None else other.file_names
    all_losses = tuple(losses)
    return PartSet(layout, chosen.root, 'frame', parts, testing, all_losses, notes, frames, others)


def _beyond(
    parts: Mapping[str, Part], mapping: ObjectMapping, frames: names.FileNames
) -> list[Loss]:
    """Return the frames without a drive, left out of all lists."""
    numbers = tuple(frames.number(part.name) or 0 for part in parts.values() if not part.drive)
    reason = mapping.beyond.replace('{', '(').replace('}', ')')
    text = f'{reason}; in no list: frames {{}}'
    return [Loss('frames', len(numbers), text, numbers)] if numbers else []


def _mapping(
    root: Path, mapping_folder: Path | None, *, needed: bool
) -> tuple[ObjectMapping | None, tuple[str, ...]]:
    """Read the mapping; a missing one is a note, or an error if needed."""
    try:
        return find_mapping(root, mapping_folder), ()
    except UsageError as error:
        if needed or mapping_folder is not None:
            raise
        return None, (f'drives in more than one list are not looked for: {error}',)


def _numbers(recording: KittiRecording) -> Int64Array:
    numbers = {stream: index.numbers for stream, index in recording.streams.items()}
    return frames_of(numbers, common=recording.common_numbers)


def _parts_of(recording: KittiRecording, mapping: ObjectMapping | None) -> dict[str, Part]:
    parts = {}
    for number in _numbers(recording).tolist():
        name = recording.file_names.stem(number)
        origin = None if mapping is None else mapping.get(number)
        parts[name] = Part(name) if origin is None else Part(name, 1, origin.drive, origin.number)
    return parts


def _recordings(path: Path, layout: Layout, candidates: list[Candidate]) -> PartSet:
    """List the sequences or drives of a set, without those of testing."""
    training = [candidate for candidate in candidates if '/' not in candidate.name] or candidates
    parts, losses = {}, []
    for candidate in training:
        recording = candidate.open(ReadOptions())
        name = candidate.name.rpartition('/')[2]
        losses += recording.losses
        frames = len(_numbers(recording))
        if frames:
            parts[name] = Part(name, frames, names.drive_of(name))
    folder = absolute(path)
    if folder.name in {*names.SPLITS, names.SEQUENCES}:
        folder = folder.parent
    return PartSet(layout, folder, layout.traits.noun, parts, None, tuple(losses))


if TYPE_CHECKING:
    AnyPath = str | PathLike[str]


@dataclass(frozen=True)
class SplitList:
    """One list.

    Attributes:
        name: Name, such as train.
        path: File.
        entries: The frames, sequences or drives, in the order of the file.
        frames: Number of frames.
        share: Share of the frames of the set, 0 to 1; None for absent testing frames.
        drives: Number of raw drives; None if unknown.
    """

    name: str
    path: Path
    entries: tuple[str, ...]
    frames: int
    share: float | None
    drives: int | None = None


@dataclass(frozen=True)
class SplitReport:
    """The written or checked lists.

    Attributes:
        path: The folder of the lists.
        layout: The layout of the set.
        noun: Kind of entry: frame, sequence or drive.
        lists: Lists in order of writing; checked ones by name.
        pairs: Pairs of lists.
        unlisted: Parts in no list.
        faults: Overlaps; of checked lists also entries of one drive in both.
        losses: Missing data, and unusable lines.
        notes: Lines that cost no data.
    """

    path: Path
    layout: str
    noun: str
    lists: tuple[SplitList, ...]
    pairs: tuple[ListPair, ...]
    unlisted: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def split(src: AnyPath, **options: Unpack[SplitKeywords]) -> SplitReport:
    """Divide a data set into lists, as `kitti-ros2 split` does.

    Args:
        src: An object, tracking, odometry or raw data set.
        options: Options of `kitti-ros2 split --help-all`, with underscores and the same defaults:
            ratio=(0.8, 0.2), names=['train', 'val'], seed=1, by_drive=True, lists=[...],
            check=True, mapping=..., out=..., overwrite=True, layout=...

    Returns:
        The lists, their overlaps, losses, notes. Each loss is also a
        KittiRos2Warning.

    Raises:
        KittiRos2Error: The set, an option or a list is invalid; nothing is left behind.

    Examples:
        >>> from kitti_ros2.datasets import split
        >>> report = split('object', ratio=(0.8, 0.2), out='lists')
        >>> [len(each.entries) for each in report.lists]
        [..., ...]
    """
    from ..api.arguments import by_name, warn_of  # noqa: PLC0415 - for the library only
    from ..options.datasets import SPLIT, make_split_options  # noqa: PLC0415 - as above

    report = split_set(as_path(src), *make_split_options(by_name(options, SPLIT)))
    warn_of(report.losses)
    return report


def split_set(path: Path, options: SplitOptions, layout: Layout | None = None) -> SplitReport:
    """Divide a data set, or check its lists.

    Raises:
        KittiRos2Error: The set, an option or a list is invalid; nothing is left behind.
        OSError: A file cannot be read.
    """
    part_set = find_parts(path, layout, options.mapping, by_drive=options.by_drive)
    if options.out is not None:
        refuse_link(options.out)
    folder = options.out or part_set.folder / kitti_names.IMAGE_SETS
    if not (options.lists or options.check):
        return _divided(path, part_set, folder, options)
    checked = options.check
    frame_lists = read_lists(options.lists or _existing(folder), part_set)
    entries = {frame_list.name: frame_list.entries for frame_list in frame_lists}
    paths = {frame_list.name: frame_list.path for frame_list in frame_lists}
    if not checked:
        for frame_list in frame_lists:
            frame_list.require_entries()
        paths = _write(folder, entries, overwrite=options.overwrite)
    report = _report(part_set, folder, paths, entries, checked=checked)
    losses = [loss for frame_list in frame_lists for loss in frame_list.losses(checked=checked)]
    notes = [note for frame_list in frame_lists for note in frame_list.notes(checked=checked)]
    return replace(report, losses=(*report.losses, *losses), notes=(*report.notes, *notes))


def _divided(path: Path, part_set: PartSet, folder: Path, options: SplitOptions) -> SplitReport:
    """Return random lists."""
    reserved = [name for name in options.list_names if part_set.is_of_testing(name)]
    if reserved:
        raise UsageError(
            f'{reserved[0]} names a list of the testing frames; choose another name,'
            f' such as holdout, or give {part_set.folder / kitti_names.SPLITS[1]}'
        )
    whole = options.by_drive or not part_set.lists_frames
    groups: dict[str, list[Part]] = {}
    for part in part_set.parts.values():
        groups.setdefault((whole and part.drive) or part.name, []).append(part)
    sizes = {name: sum(part.frames for part in parts) for name, parts in groups.items()}
    divided = divide(sizes, options.shares, options.seed or 0)
    if divided is None:
        noun = 'drive' if options.by_drive else part_set.noun
        lists = format_count(len(options.shares), 'list')
        raise UsageError(f'{path}: {format_count(len(sizes), noun)}, too few for {lists}')
    entries = {
        name: sorted(part.name for group in members for part in groups[group])
        for name, members in zip(options.list_names, divided, strict=True)
    }
    paths = _write(folder, entries, overwrite=options.overwrite)
    return _report(part_set, folder, paths, entries, checked=False)


def _existing(folder: Path) -> list[Path]:
    """Return the lists in a folder.

    Raises:
        UsageError: There is none.
    """
    files = [folder / name for name in STORE.names(folder) if name.endswith(kitti_names.TXT)]
    if not files:
        raise UsageError(f'{folder}: no lists to check; give their files with --lists')
    return files


def _write(folder: Path, lists: Mapping[str, Sequence[str]], *, overwrite: bool) -> dict[str, Path]:
    """Write lists, all or none, and return their files.

    Raises:
        OutputExistsError: A file exists, and is not to be replaced.
        OutputError: One cannot be written.
    """
    paths = {name: folder / f'{name}{kitti_names.TXT}' for name in lists}

    def refusal(path: Path) -> str | None:
        if path.is_dir():
            return 'it is a folder; choose another with --out'
        return None if overwrite else 'pass --overwrite, or choose another folder with --out'

    with ExitStack() as exit_stack:
        stagings: list[Staging] = []
        for path in paths.values():
            stagings.append(Staging(path, refusal))
            exit_stack.callback(stagings[-1].discard)
        for staging, entries in zip(stagings, lists.values(), strict=True):
            with reported(staging.path):
                staging.content.write_bytes(format_image_set(entries).encode())
        for staging in stagings:
            staging.publish()
    return paths


def _report(
    part_set: PartSet,
    folder: Path,
    paths: Mapping[str, Path],
    lists: Mapping[str, Sequence[str]],
    *,
    checked: bool,
) -> SplitReport:
    """Describe lists, and compare lists of the same frames."""
    test = {name: entries for name, entries in lists.items() if part_set.is_of_testing(name)}
    others = {name: entries for name, entries in lists.items() if name not in test}
    pairs = (*compare_lists(others, part_set.parts), *compare_lists(test, part_set.testing or {}))
    faults = [line for pair in pairs for line in pair.faults]
    leaks = [line for pair in pairs for line in pair.leaks]
    listed = {name for entries in others.values() for name in entries}
    return SplitReport(
        path=folder,
        layout=part_set.layout.value,
        noun=part_set.noun,
        lists=tuple(_describe(part_set, name, paths[name], lists[name]) for name in lists),
        pairs=pairs,
        unlisted=tuple(name for name in part_set.parts if name not in listed) if others else (),
        faults=(*faults, *leaks) if checked else tuple(faults),
        losses=part_set.losses,
        notes=part_set.notes if checked else (*part_set.notes, *leaks),
    )


def _describe(part_set: PartSet, name: str, path: Path, entries: Sequence[str]) -> SplitList:
    parts = part_set.testing if part_set.is_of_testing(name) else part_set.parts
    listed = [Part(entry) if parts is None else parts[entry] for entry in entries]
    frames = sum(part.frames for part in listed)
    drives = {part.drive for part in listed}
    total = 0 if parts is None else sum(part.frames for part in parts.values())
    return SplitList(
        name=name,
        path=path,
        entries=tuple(entries),
        frames=frames,
        share=frames / total if total else None,
        drives=None if None in drives or not drives else len(drives),
    )
