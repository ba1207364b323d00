# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens what is at a path, whatever its layout; else explains it from what is near the path."""

from __future__ import annotations

import os
import shlex
from collections import Counter, deque
from contextlib import suppress
from itertools import chain, islice
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

from ..files.remote import canonical_path, common_folder, is_remote, refuse_incomplete
from ..kitti import names
from ..model.errors import (
    AmbiguousLayoutError,
    AmbiguousSequenceError,
    MissingSourceError,
    NotKittiError,
    Remedy,
    UsageError,
    close_names,
    did_you_mean,
    format_count,
    runs_of,
    some_of,
)
from ..model.streams import Clock, Layout
from ..options.read import DEFAULT_EPOCH_NS, NOMINAL_PERIOD_NS, ReadOptions
from .archives import Archive, extract_command, is_archive
from .find import LAYOUTS, absolute, calibration_beside, tree_of
from .label_file import find_frame_files
from .prepare import CHANGES_NOTHING, prepare_motion, prepare_stereo
from .store import STORE, cached_listings

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
    from pathlib import PurePath

    from .find import Candidate
    from .kitti_recording import KittiRecording


# Detects the layout of a folder and opens it.


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


@cached_listings()
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


@cached_listings()
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
    recording.notes += _idle_times(recording)
    return recording


def _idle_times(recording: KittiRecording) -> Iterator[str]:
    """Yield notes on options of time that a recording with time stamps does not need."""
    options, has_stamps = recording.options, recording.clock is not Clock.NOMINAL
    nominal_turns = any(turn.nominal for turn in recording.turns.values())
    if has_stamps and options.period_ns != NOMINAL_PERIOD_NS and not nominal_turns:
        yield f'period {CHANGES_NOTHING}: the recording has time stamps'
    if recording.clock is Clock.UTC and options.epoch_ns != DEFAULT_EPOCH_NS:
        yield f'epoch {CHANGES_NOTHING}: the time stamps have dates'


def find_data_sets(path: Path, options: ReadOptions) -> list[DataSet]:
    """Find the data sets at a path and in its sub-folders; options choose one at the path.

    Raises:
        NotKittiError: There is no recording.
        AmbiguousLayoutError: The same files fit several layouts and the options contain none.
        UsageError: The chosen recording does not exist, or not all sub-folders can be searched.
    """
    data_sets = data_sets_at(path, options)
    if options.layout is None and options.sequence is None and path.is_dir():
        below, complete = data_sets_below(path, data_sets)
        if not complete:
            choice = ', or a --layout' if data_sets else ''
            raise UsageError(
                f'{path}: holds too many folders to search; give the data sets in it{choice}'
            )
        data_sets += below
    if not data_sets:
        raise _explain(path) if options.layout is None else not_of_layout(path, options.layout)
    return data_sets


@cached_listings()
def data_sets_at(path: Path, options: ReadOptions) -> list[DataSet]:
    """Find the data sets at a path itself, of the requested layout or all.

    Raises:
        AmbiguousLayoutError: The same files fit several layouts and the options contain none; or
            they choose a recording only.
        BadFileError: Its upload to a store was not completed.
        UsageError: The chosen recording does not exist.
    """
    refuse_incomplete(path)
    fits = _find_all(path)
    if options.layout is not None:
        fits = {options.layout: fits[options.layout]} if options.layout in fits else {}
    if not fits:
        return []
    if options.sequence is not None or len(_apart(fits)) < len(fits):
        layout, candidates = _only(path, fits)
        if options.sequence is not None:
            fits = {layout: [choose_recording(path, layout, candidates, options.sequence)]}
    return [DataSet(path, layout, candidates) for layout, candidates in fits.items()]


def _apart(fits: dict[Layout, list[Candidate]]) -> dict[Layout, list[Candidate]]:
    """Return the layouts without those that read the folders of an earlier one in another way."""
    apart: dict[Layout, list[Candidate]] = {}
    read: set[Path] = set()
    for layout, candidates in fits.items():
        folders = {recording.folder for recording in candidates if recording.folder is not None}
        if not folders & read:
            apart[layout] = candidates
            read |= folders
    return apart


@cached_listings()
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
    problem = '; '.join([f'no data file of {recording.name} can be used', *reasons[:1]])
    return NotKittiError(path, problem, [layout.value])


@cached_listings()
def _find_all(path: Path) -> dict[Layout, list[Candidate]]:
    """Return the recordings at a path, by each layout that it has any of."""
    folder = absolute(path)
    if not folder.is_dir():
        return {}
    by_layout = {layout: files.find(folder) for layout, files in LAYOUTS.items()}
    return {layout: candidates for layout, candidates in by_layout.items() if candidates}


def _explain(path: Path) -> NotKittiError:

    return explain(path)


def not_of_layout(path: Path, layout: Layout) -> NotKittiError:
    """Return the error for a path without a recording of the requested layout."""
    fits = _find_all(path)
    if not fits:
        return _explain(path)
    other = next(iter(fits)).value
    remedy = f'it is layout {other}, which is detected without --layout'
    return NotKittiError(path, f'no {layout.value} recording', [], remedy)


def choose_recording(
    path: Path, layout: Layout, candidates: list[Candidate], sequence: str | None
) -> Candidate:
    """Return the candidate of a name, or the only one.

    Raises:
        AmbiguousSequenceError: There are several, and no name is given.
        UsageError: None has the name, or several have.
    """
    all_names = [candidate.name for candidate in candidates]
    if sequence is not None:
        matching = [candidate for candidate in candidates if _matches(candidate.name, sequence)]
        if len(matching) > 1:
            several = some_of([candidate.name for candidate in matching])
            raise UsageError(f'{path}: sequence {sequence!r} may be {several}; give the whole name')
        if not matching:
            hint = did_you_mean(sequence, all_names) or f'; it holds {some_of(all_names, 12)}'
            raise UsageError(f'{path}: no sequence {sequence!r}{hint}')
        return matching[0]
    if len(candidates) > 1 and not layout.traits.frame_set:
        raise AmbiguousSequenceError(path, layout.traits.noun, all_names).with_remedies(
            Remedy(path, path, ('--sequence', all_names[0])), _all_of(path, candidates)
        )
    return candidates[0]


def _all_of(path: Path, candidates: list[Candidate]) -> Remedy:
    """Return the loop over all recordings: over their own folders, or else over their names."""
    folders = [recording.folder for recording in candidates if recording.folder is not None]
    if not folders:
        loop_words = ' '.join(_braces([candidate.name for candidate in candidates]))
        return Remedy(path, path, loop=loop_words, by_name=True)
    common = common_folder([folder.parent for folder in folders])
    levels = max(len(folder.parts) for folder in folders) - len(common.parts)
    shown = common if is_remote(common) else path / os.path.relpath(common, absolute(path))
    return Remedy(path, path, loop=f'{shlex.quote(str(shown))}/{"*/" * levels}')


def _braces(recording_names: list[str]) -> list[str]:
    """Abbreviate numbers in a row for a shell, such as {0000..0020}."""
    if not all(name.isdecimal() for name in recording_names):
        return recording_names
    width = len(recording_names[0])
    runs = runs_of(sorted(map(int, recording_names)))
    return [
        f'{{{first:0{width}d}..{last:0{width}d}}}' if first != last else f'{first:0{width}d}'
        for first, last in runs
    ]


def _matches(name: str, sequence: str) -> bool:
    if name == sequence:
        return True
    drive = names.RAW_DRIVE.fullmatch(name)
    short = drive[1] if drive else name
    return short.isdecimal() and sequence.isdecimal() and int(short) == int(sequence)


# The files and folders that a recording is read from.


def parts_of(source: Path, layout: Layout, sequence: str | None) -> list[Path]:
    """Return the files and folders of a recording.

    Args:
        source: Its folder.
        layout: Its layout.
        sequence: Its name among those of the folder; None for the only one.

    Raises:
        KittiRos2Error: It cannot be opened.
    """
    if layout is Layout.RAW and sequence is None:  # to open it reads stamps and tracklets: 4 ms
        return [source, *calibration_beside(source)]
    recording = open_recording(source, ReadOptions(layout=layout, sequence=sequence))
    return [path for path, _ in tree_of(recording).parts]


# Data sets that --overwrite may replace: those of one recording, without files of others.

_ENDINGS = (names.BIN, names.TXT, names.LABEL, '.xml', '.yaml')


def keep_all_but_data_sets(recordings: int) -> Callable[[Path], str | None]:
    """Return a refusal for Staging that lets only a data set of KITTI be replaced.

    Args:
        recordings: Number of recordings that replace it: a data set of more is kept.
    """

    def refusal(path: Path) -> str | None:
        if path.is_dir() and not is_remote(path) and not any(path.iterdir()):
            return None
        count = max(len(files.find(path)) for files in LAYOUTS.values()) if path.is_dir() else 0
        if not count or not _is_plain(path):
            return 'it is no KITTI data set, so --overwrite does not touch it; choose another name'
        if count > recordings:
            return (
                f'it holds {format_count(count, "recording")}, and --overwrite would remove all of'
                f' them; choose another name'
            )
        return None

    return refusal


def keep_all_but_camera_sets(folders: Collection[str]) -> Callable[[Path], str | None]:
    """Return a refusal for Staging that lets the sets of --all-cameras be replaced.

    Args:
        folders: The folders of the sets that replace them; a data set of one recording may be
            replaced, too.
    """
    keep = keep_all_but_data_sets(1)

    def refusal(path: Path) -> str | None:
        if not path.is_dir() or not _is_plain(path):
            return keep(path)
        entries = {entry.name for entry in path.iterdir()} - {names.IMAGE_SETS}
        if not entries or not entries <= set(folders):
            return keep(path)
        return next(filter(None, (keep(path / name) for name in sorted(entries))), None)

    return refusal


def _is_plain(folder: Path) -> bool:
    """Return whether a folder holds files of KITTI's endings at their paths only, and no links."""
    if is_remote(folder):
        from ..files.remote_requests import objects_at  # noqa: PLC0415 - for URLs only

        return all(map(_is_of_data_set, map(PurePosixPath, objects_at(folder))))
    for root, folders, files in os.walk(folder):
        if not all(_is_of_data_set(Path(root, name).relative_to(folder)) for name in files):
            return False
        if any(Path(root, name).is_symlink() for name in (*folders, *files)):
            return False
    return True


def _is_of_data_set(path: PurePath) -> bool:
    """Return whether a data set has such a file, by its path in the folder."""
    suffix = path.suffix.lower()
    if suffix in names.IMAGE_SUFFIXES:
        return any(part.startswith('image_') for part in path.parts[:-1])
    return suffix in _ENDINGS


# Explains why a path is no recording, from what is near it.
#
# The data set around a folder or file, those below a folder, an archive, a name of similar
# spelling. Nothing here runs for a path that can be opened; searches are limited, as the folder may
# be anyone's home directory.

_MOST_LEVELS = 4
_MOST_FOLDERS = 300
_MOST_ENTRIES = 1000
"""Limit for one folder."""
_MOST_ARCHIVES = 20
"""Opened, and in a command."""

_FOLDERS = frozenset({
    *names.SPLITS, *names.RAW_IMAGES, *names.OBJECT_IMAGES, names.RAW_SCANS, names.SCANS,
    names.OXTS, names.CALIB, *names.LABEL_FOLDERS, names.TRACKING_LABELS, names.SEQUENCES,
    names.DATASET, names.POSES, names.POINT_LABELS, names.IMAGE_SETS, *names.KITTI_360_PARTS,
    names.KITTI_360_CALIBRATION, *(data for _, data in names.KITTI_360_IMAGES),
})  # fmt: skip
_FILES = ('.png', '.bin', '.txt', '.xml', '.label', '.jpg', '.jpeg')


class DataSet(NamedTuple):
    """A folder that can be given as a source, with the recordings in it."""

    folder: Path
    layout: Layout
    recordings: list[Candidate]

    def __str__(self) -> str:
        """Return the folder with the layout and the number of recordings."""
        count = len(self.recordings)
        kind = self.layout.traits.noun
        of = '' if count == 1 else f', {format_count(count, kind)}'
        return f'{self.folder} ({self.layout.value}{of})'


def explain(path: Path) -> NotKittiError:
    """Return the error for a path that holds no recording of any layout."""
    if not path.exists():
        return _absent(path)
    if not path.is_dir():
        return _explain_archive(path) or _explain_around(path) or _not_kitti(path, 'is a file')
    entries = _entries(path)
    data_sets, complete = data_sets_below(path)
    if data_sets:
        return _explain_below(path, data_sets, complete=complete)
    return (
        _explain_test_slam(path)
        or _explain_around(path)
        or _explain_archives(path, entries)
        or _explain_files(path, entries)
        or _explain_drives(path)
        or _not_kitti(path, _listed(entries, complete=complete))
    )


def _explain_drives(path: Path) -> NotKittiError | None:
    """Return the error for folders of KITTI-360 whose drives are named differently."""
    for folder in (path.parent, path, *(path / part for part in names.KITTI_360_PARTS)):
        if folder.name in names.KITTI_360_PARTS and (entries := _entries(folder)):
            example = Layout.KITTI_360.traits.default_name
            return _not_kitti(
                folder, _listed(entries, complete=True), f'name drives like {example}'
            )
    return None


def _explain_test_slam(path: Path) -> NotKittiError | None:
    """Return the error for a folder of KITTI-360's SLAM benchmark, and those around it."""
    inside = (*absolute(path).parts, *_entries(path))
    folder = next((name for name in inside if name in names.KITTI_360_TEST_SLAM), '')
    if not folder:
        return None
    stamps, part = names.TIMESTAMPS, folder.replace('test_slam', 'raw')
    which = f"{folder} is of KITTI-360's SLAM benchmark: which stamp is of which file is not known"
    example = f'{part}/{Layout.KITTI_360.traits.default_name}'
    return _not_kitti(path, which, f'put a drive of it at {example}, without {stamps}')


def _listed(entries: list[str], *, complete: bool) -> str:
    """Describe the content of a folder without data sets."""
    if not entries:
        return 'the folder is empty'
    shown = (
        some_of(entries, 4) if len(entries) < _MOST_ENTRIES else f'{", ".join(entries[:4])}, ...'
    )
    searched = '' if complete else f' ({_MOST_FOLDERS} folders below it were searched)'
    return f'holds {shown}{searched}'


def _absent(path: Path) -> NotKittiError:
    """Return the error for a path that does not exist, with names like it beside."""
    rest: list[str] = []
    folder = path
    while not folder.exists() and folder.name:
        rest.insert(0, folder.name)
        folder = folder.parent
    missing_name, below = rest[0], rest[1:]
    entries = _entries(folder)
    stem = Path(missing_name).stem
    close = [
        folder / name
        for name in close_names(missing_name, entries)
        or [name for name in entries if Path(name).stem == stem]
    ]
    matches = [sibling.joinpath(*below) for sibling in close if sibling.joinpath(*below).exists()]
    remedy = 'give a KITTI folder or a bag'
    if str(path).startswith('~'):
        remedy = 'the shell takes ~ for your home outside of quotes only'
    error = MissingSourceError(
        path,
        'no such file or folder',
        [],
        f'did you mean {" or ".join(map(str, matches))}?' if matches else remedy,
    )
    return error.with_remedies(*(Remedy(path, sibling) for sibling in matches[:1]))


def _not_kitti(path: Path, problem: str, remedy: str = '') -> NotKittiError:
    return NotKittiError(path, problem, [layout.value for layout in Layout], remedy)


# The data set around a path.


def _explain_around(path: Path) -> NotKittiError | None:
    absolute_path = absolute(path)
    data_set = _around(absolute_path)
    if data_set is None:
        return None
    folder = data_set.folder if path.is_absolute() else Path(os.path.relpath(data_set.folder))
    below = absolute_path.relative_to(data_set.folder)
    stems = {Path(part).stem for part in below.parts}
    sequences = [recording.name for recording in data_set.recordings if recording.name in stems]
    options = ('--sequence', sequences[0]) if sequences and len(data_set.recordings) > 1 else ()
    is_file = not path.is_dir()
    frame = int(path.stem) if is_file and _is_frame(path.stem) else None
    part = 'a file of' if is_file else 'a folder of'
    part += f' frame {frame} of' if frame is not None else ''
    sequence = f' (sequence {sequences[0]})' if options else ''
    error = _not_kitti(
        path,
        f'is {part} a KITTI {data_set.layout.value} data set',
        f'give {folder}{sequence}',
    )
    return error.with_remedies(Remedy(path, folder, options, frame))


def _around(path: Path) -> DataSet | None:
    """Return the data set that a folder or file is a part of."""
    for folder in path.parents[:_MOST_LEVELS]:
        part = path.relative_to(folder).parts[0]
        if is_inside(part):
            data_sets = data_sets_in(folder)
            if data_sets:
                return data_sets[0]
    return None


def is_inside(name: str) -> bool:
    """Return whether a name is one of a data set, also of data that others add to KITTI's."""
    return (
        name in _FOLDERS
        or name.startswith(('image_', 'velodyne_', 'label_', 'data_2d_', 'data_3d_'))
        or Path(name).suffix.lower() in _FILES
    )


def _is_frame(stem: str) -> bool:
    return names.number_of(stem) is not None and len(stem) > names.SEQUENCE_DIGITS


# The data sets below a folder.


def _explain_below(path: Path, data_sets: list[DataSet], *, complete: bool) -> NotKittiError:
    count = f'{"" if complete else "at least "}{format_count(len(data_sets), "data set")}'
    shown = some_of([str(data_set) for data_set in data_sets])
    error = _not_kitti(path, f'holds {count}, {shown}', 'give one of these folders')
    return error.with_remedies(Remedy(path, data_sets[0].folder))


def data_sets_below(
    path: Path, at_path: Sequence[DataSet] = (), visit: Callable[[Path], None] = lambda _: None
) -> tuple[list[DataSet], bool]:
    """Return the data sets below a folder, and whether all of it was searched.

    Args:
        path: The folder.
        at_path: The data sets at the folder itself; what belongs to them is not searched.
        visit: Called with each folder that is searched.
    """
    data_sets: list[DataSet] = []
    seen: set[str] = set()
    queue = deque([(path, 0)])
    while queue and len(seen) < _MOST_FOLDERS:
        folder, level = queue.popleft()
        real_path = canonical_path(folder)  # links may lead back
        if real_path in seen:
            continue
        seen.add(real_path)
        here = at_path
        if level:
            visit(folder)
            here = data_sets_in(folder)
            data_sets += here
        if level < _MOST_LEVELS:
            queue.extend((subfolder, level + 1) for subfolder in _subfolders(folder, here))
    return data_sets, not queue


def describe_below(path: Path, options: ReadOptions) -> list[str]:
    """Return a note on the data sets in sub-folders that do not belong to the one at a path."""
    if options.layout is not None or options.sequence is not None:
        return []
    below, complete = data_sets_below(path, data_sets_at(path, options))
    if not below:
        return []
    count = f'{"" if complete else "at least "}{format_count(len(below), "other data set")}'
    return [f'{path}: holds {count}, {some_of([*map(str, below)])}; give one to show it']


def data_sets_in(folder: Path) -> list[DataSet]:
    """Return the data sets in a folder, if names in it are KITTI's."""
    if not any(map(_is_kitti_name, _entries(folder))):
        return []
    fits = {}
    for layout, files in LAYOUTS.items():
        with suppress(OSError):
            fits[layout] = files.find(folder)
    return [DataSet(folder, *fit) for fit in _apart(fits).items() if fit[1]]


def covered_folders(
    folder: Path, subfolders: Iterable[str], data_sets: Iterable[DataSet]
) -> set[str]:
    """Return the names of the sub-folders of a folder that belong to data sets in it."""
    covered = set()
    for recording in chain.from_iterable(data_set.recordings for data_set in data_sets):
        inside = recording.folder
        base = absolute(folder) if inside is None or inside.is_absolute() else folder
        if inside is None or inside == base:
            covered |= {name for name in subfolders if is_inside(name) or name == recording.name}
        else:
            covered |= {inside.relative_to(base).parts[0], names.POSES, names.IMAGE_SETS}
    return covered


def _is_kitti_name(name: str) -> bool:
    if name in _FOLDERS or name in {names.ODOMETRY_CALIB, names.TIMES}:
        return True
    return bool(names.RAW_DRIVE.fullmatch(name) or names.RAW_DATE.fullmatch(name))


# Files without the folders around them.


def _explain_files(path: Path, entries: list[str]) -> NotKittiError | None:
    """Return what to do with a folder of scans, images or results."""
    by_suffix = Counter(names.split_name(name)[1].lower() for name in entries)
    if by_suffix[names.TXT] and find_frame_files(path) is not None:
        what = 'holds label or result files'
        return NotKittiError(path, what, [], 'eval detection GROUND_TRUTH RESULTS scores them')
    count = sum(by_suffix[suffix] for suffix in names.IMAGE_SUFFIXES)
    kinds = (('scan', by_suffix[names.BIN], names.SCANS), ('image', count, names.OBJECT_IMAGES[2]))
    for noun, number, folder in kinds:
        if number:
            remedy = (
                f'move them to a folder {folder} in a folder of their own, and give that with'
                f' --layout object, or odometry if they follow each other'
            )
            return NotKittiError(path, f'holds {format_count(number, noun)}', [], remedy)
    return _explain_formats(path)


def _explain_formats(path: Path) -> NotKittiError | None:
    """Return which files in the folders of a data set have a format that is not read."""
    inside = {names.SCANS: names.BIN} | dict.fromkeys(names.OBJECT_IMAGES, names.PNG)
    for folder in (path, *(path / split for split in names.SPLITS)):
        for name, suffix in inside.items():
            files = [entry for entry in _entries(folder / name) if not entry.startswith('.')]
            if files:
                other = f'{folder / name} holds {some_of(files)}'
                return NotKittiError(path, other, [], f'expected files like 000000{suffix} there')
    return None


# Archives.


def _explain_archive(path: Path) -> NotKittiError | None:
    if not is_archive(path.name) or not path.is_file():  # reading a pipe would wait
        return None
    if is_remote(path):
        return _not_kitti(path, 'is an archive', 'extract it, then give the folder')
    archive = Archive.open(path)
    if archive is None:
        return _not_kitti(path, 'is an archive that is damaged or incomplete', 'download it again')
    if archive.folder is None:
        return _not_kitti(path, "is an archive without KITTI's folders")
    error = _not_kitti(path, 'is an archive', f'extract it, then give the folder {archive.folder}')
    return error.with_remedies(
        Remedy(path, archive.folder, before=extract_command([path], archive.root))
    )


def _explain_archives(path: Path, entries: list[str]) -> NotKittiError | None:
    packed = [path / name for name in entries if is_archive(name)]
    if not packed:
        return None
    error = _not_kitti(
        path,
        f'holds {format_count(len(packed), "archive")}, {some_of([file.name for file in packed])}',
        'extract them' if len(packed) > 1 else 'extract it',
    )
    if is_remote(path):
        return error
    opened = [(file, Archive.open(file)) for file in packed[:_MOST_ARCHIVES]]
    usable = [(file, archive) for file, archive in opened if archive and archive.folder]
    folders = {archive.folder for _, archive in usable if archive.folder}
    if not folders:
        return error
    folder = folders.pop() if len(folders) == 1 else path
    command = extract_command([file for file, _ in usable], path)
    return error.with_remedies(Remedy(path, folder, before=command))


# Listing.


def _entries(folder: Path) -> list[str]:
    """List some names in a folder, sorted; none if it cannot be read."""
    if is_remote(folder):
        return STORE.names(folder)[:_MOST_ENTRIES]
    return sorted(entry.name for entry in _scan(folder))


def _subfolders(folder: Path, data_sets: Sequence[DataSet]) -> list[Path]:
    """Return the sub-folders of a folder that do not belong to data sets in it."""
    if is_remote(folder) or data_sets:  # which have listed it
        inside = STORE.names(folder)[:_MOST_ENTRIES]
        others = {*inside} - covered_folders(folder, inside, data_sets)
        paths = sorted(folder / name for name in others if not name.startswith('.'))
        return [path for path in paths if path.is_dir()]
    return sorted(folder / entry.name for entry in _scan(folder) if _is_folder(entry))


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir() and not entry.name.startswith('.')
    except OSError:
        return False


def _scan(folder: Path) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            yield from islice(entries, _MOST_ENTRIES)
    except OSError:
        return
