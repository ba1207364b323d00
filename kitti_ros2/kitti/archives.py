# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives as KITTI is downloaded: what unpacks one, and the folder that this gives."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

from . import names

_ZIP = '.zip'
_TAR = ('.tar', '.tgz', '.tbz2', '.txz', '.tar.gz', '.tar.bz2', '.tar.xz')


def is_archive(name: str) -> bool:
    """Whether a file's name is that of an archive."""
    return name.lower().endswith((_ZIP, *_TAR))


class Archive(NamedTuple):
    """An archive, as it is best unpacked.

    Attributes:
        command: The shell command that unpacks it: beside itself, as the archives of a data set
            have common folders; into a new folder if it contains loose files.
        folder: The folder to give then.
    """

    command: str
    folder: Path

    @classmethod
    def open(cls, path: Path) -> Archive | None:
        """Read the names in an archive; None if it is damaged or incomplete."""
        is_zip = path.name.lower().endswith(_ZIP)
        try:
            tops = _tops_of_zip(path) if is_zip else _tops_of_tar(path)
        except Exception:  # noqa: BLE001 - decompressors raise errors of their own
            return None
        target = path.parent
        folder = target / next(iter(tops), '')
        if not tops or not tops <= {*names.SPLITS, folder.name}:
            target = folder = path.with_name(path.name.split('.')[0])
        elif len(tops) > 1:
            folder = target
        return cls(_unpacking(path, target, is_zip=is_zip), folder)


def _unpacking(path: Path, target: Path, *, is_zip: bool) -> str:
    file, folder = shlex.quote(str(path)), shlex.quote(str(target))
    if target == Path():
        return f'unzip {file}' if is_zip else f'tar -xf {file}'
    if is_zip:
        return f'unzip {file} -d {folder}'
    made = '' if target == path.parent else f'mkdir {folder} && '
    return f'{made}tar -xf {file} -C {folder}'


def _tops_of_zip(path: Path) -> set[str]:
    """Return the folders at the top; none if there are loose files."""
    from zipfile import ZipFile  # noqa: PLC0415 - for errors only

    with ZipFile(path) as archive:
        return _tops(archive.namelist())


def _tops_of_tar(path: Path) -> set[str]:
    """Return the folder of the first entry: others would have to be decompressed."""
    import tarfile  # noqa: PLC0415 - for errors only

    with tarfile.open(path) as archive:
        first = archive.next()
        if first is None:
            return set()
        return _tops([f'{first.name}/' if first.isdir() else first.name])


def _tops(entries: list[str]) -> set[str]:
    parts = [Path(entry).parts for entry in entries]
    loose = any(
        (len(each) < 2 and not entry.endswith('/')) or '..' in each
        for each, entry in zip(parts, entries, strict=True)
    )
    return set() if loose else {each[0] for each in parts if each and each[0] != '/'}
