# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Explains why a path is no recording, from what is near it.

The data set around a folder or file, those below a folder, an archive, a name of similar spelling.
Nothing here runs for a path that can be opened; searches are limited, as the folder may be anyone's
home directory.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..files.remote import is_remote, real_place
from ..model.errors import MissingSourceError, NotKittiError, Remedy
from ..model.layouts import Layout
from ..model.spelling import close_names
from ..model.text import format_count, some_of
from . import names
from .archives import Archive, extract_command, is_archive
from .find import absolute
from .layout_files import LAYOUTS
from .result_files import find_frame_files
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .find import Candidate

_MOST_LEVELS = 4
_MOST_FOLDERS = 300
_MOST_ENTRIES = 1000
"""Of one folder."""
_MOST_ARCHIVES = 20
"""Opened, and in a command."""

_FOLDERS = frozenset({
    *names.SPLITS, *names.RAW_IMAGES, *names.OBJECT_IMAGES, names.RAW_SCANS, names.SCANS,
    names.OXTS, names.CALIB, *names.LABEL_FOLDERS, names.TRACKING_LABELS, names.SEQUENCES,
    names.DATASET, names.POSES, names.POINT_LABELS, names.IMAGE_SETS,
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
    found, complete = data_sets_below(path)
    if found:
        return _explain_below(path, found, complete=complete)
    return (
        _explain_around(path)
        or _explain_archives(path, entries)
        or _explain_files(path, entries)
        or _not_kitti(path, _listed(entries, complete=complete))
    )


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
    wanted, below = rest[0], rest[1:]
    close = [folder / name for name in close_names(wanted, _entries(folder))]
    meant = [each.joinpath(*below) for each in close if each.joinpath(*below).exists()]
    advice = 'give a KITTI folder or a bag'
    error = MissingSourceError(
        path,
        'no such file or folder',
        [],
        f'did you mean {" or ".join(map(str, meant))}?' if meant else advice,
    )
    return error.with_remedies(*(Remedy(path, each) for each in meant[:1]))


def _not_kitti(path: Path, found: str, advice: str = '') -> NotKittiError:
    return NotKittiError(path, found, [layout.value for layout in Layout], advice)


# The data set around a path.


def _explain_around(path: Path) -> NotKittiError | None:
    place = absolute(path)
    found = _around(place)
    if found is None:
        return None
    folder = found.folder if path.is_absolute() else Path(os.path.relpath(found.folder))
    below = place.relative_to(found.folder)
    stems = {Path(part).stem for part in below.parts}
    chosen = [each.name for each in found.recordings if each.name in stems]
    options = ('--sequence', chosen[0]) if chosen and len(found.recordings) > 1 else ()
    is_file = not path.is_dir()
    frame = int(path.stem) if is_file and _is_frame(path.stem) else None
    part = 'a file of' if is_file else 'a folder of'
    part += f' frame {frame} of' if frame is not None else ''
    sequence = f' (sequence {chosen[0]})' if options else ''
    error = _not_kitti(
        path,
        f'is {part} a KITTI {found.layout.value} data set',
        f'give {folder}{sequence}',
    )
    return error.with_remedies(Remedy(path, folder, options, frame))


def _around(path: Path) -> DataSet | None:
    """Return the data set that a folder or file is a part of."""
    for folder in path.parents[:_MOST_LEVELS]:
        part = path.relative_to(folder).parts[0]
        if is_inside(part):
            found = data_set_in(folder)
            if found is not None:
                return found
    return None


def is_inside(name: str) -> bool:
    """Whether a name is one of those in a data set, also of data that others add to KITTI's."""
    return (
        name in _FOLDERS
        or name.startswith(('image_', 'velodyne_', 'label_'))
        or Path(name).suffix.lower() in _FILES
    )


def _is_frame(stem: str) -> bool:
    return names.number_of(stem) is not None and len(stem) > names.SEQUENCE_DIGITS


# The data sets below a folder.


def _explain_below(path: Path, found: list[DataSet], *, complete: bool) -> NotKittiError:
    count = f'{"" if complete else "at least "}{format_count(len(found), "data set")}'
    shown = some_of([str(each) for each in found])
    error = _not_kitti(path, f'holds {count}, {shown}', 'give one of these folders')
    return error.with_remedies(Remedy(path, found[0].folder))


def data_sets_below(path: Path) -> tuple[list[DataSet], bool]:
    """Return the data sets below a folder, and whether all of it was searched."""
    found: list[DataSet] = []
    seen: set[str] = set()
    queue = deque([(path, 0)])
    while queue and len(seen) < _MOST_FOLDERS:
        folder, level = queue.popleft()
        place = real_place(folder)  # links may lead back
        if place in seen:
            continue
        seen.add(place)
        data_set = data_set_in(folder) if level else None
        if data_set is not None:
            found.append(data_set)
        elif level < _MOST_LEVELS:
            queue.extend((each, level + 1) for each in _subfolders(folder))
    return found, not queue


def data_set_in(folder: Path) -> DataSet | None:
    """Return the data set in a folder, if names in it are KITTI's."""
    if not any(map(_is_kitti_name, _entries(folder))):
        return None
    for layout, files in LAYOUTS.items():
        try:
            recordings = files.find(folder)
        except OSError:
            continue
        if recordings:
            return DataSet(folder, layout, recordings)
    return None


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
    count = sum(by_suffix[each] for each in names.IMAGE_SUFFIXES)
    kinds = (('scan', by_suffix[names.BIN], names.SCANS), ('image', count, names.OBJECT_IMAGES[2]))
    for noun, found, folder in kinds:
        if found:
            advice = (
                f'move them to a folder {folder} in a folder of their own, and give that with'
                f' --layout object, or odometry if they follow each other'
            )
            return NotKittiError(path, f'holds {format_count(found, noun)}', [], advice)
    return _explain_formats(path)


def _explain_formats(path: Path) -> NotKittiError | None:
    """Return which files in the folders of a data set have a format that is not read."""
    inside = {names.SCANS: names.BIN} | dict.fromkeys(names.OBJECT_IMAGES, names.PNG)
    for folder in (path, *(path / split for split in names.SPLITS)):
        for name, suffix in inside.items():
            found = [each for each in _entries(folder / name) if not each.startswith('.')]
            if found:
                other = f'{folder / name} holds {some_of(found)}'
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
        f'holds {format_count(len(packed), "archive")}, {some_of([each.name for each in packed])}',
        'extract them' if len(packed) > 1 else 'extract it',
    )
    if is_remote(path):
        return error
    opened = [(each, Archive.open(each)) for each in packed[:_MOST_ARCHIVES]]
    usable = [(each, archive) for each, archive in opened if archive and archive.folder]
    folders = {archive.folder for _, archive in usable if archive.folder}
    if not folders:
        return error
    folder = folders.pop() if len(folders) == 1 else path
    command = extract_command([each for each, _ in usable], path)
    return error.with_remedies(Remedy(path, folder, before=command))


# Listing.


def _entries(folder: Path) -> list[str]:
    """List some names in a folder, sorted; none if it cannot be read."""
    if is_remote(folder):
        return STORE.names(folder)[:_MOST_ENTRIES]
    return sorted(entry.name for entry in _scan(folder))


def _subfolders(folder: Path) -> list[Path]:
    if is_remote(folder):
        inside = (folder / name for name in _entries(folder) if not name.startswith('.'))
        return [each for each in inside if each.is_dir()]
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
