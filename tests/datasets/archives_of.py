# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives for tests: zip and tar, of any members, sound or hostile."""

from __future__ import annotations

import io
import tarfile
from typing import TYPE_CHECKING
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

SUFFIXES = ('.zip', '.tar', '.tar.gz', '.tar.bz2', '.tar.xz')
SCAN = 'training/velodyne/000003.bin'


def pack(path: Path, files: Mapping[str, bytes]) -> Path:
    """Write an archive of the kind that its name says."""
    if path.name.endswith('.zip'):
        with ZipFile(path, 'w', ZIP_DEFLATED) as archive:
            for name, content in files.items():
                archive.writestr(ZipInfo(name), content, ZIP_DEFLATED)
        return path
    ending = path.name.rpartition('.')[2]
    with tarfile.open(path, 'w' if ending == 'tar' else f'w:{ending}') as archive:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


def pack_folder(path: Path, folder: Path, top: str = '') -> Path:
    """Write an archive of a folder, below a top folder of any name."""
    files = sorted(each for each in folder.rglob('*') if each.is_file())
    return pack(path, {f'{top}{each.relative_to(folder)}': each.read_bytes() for each in files})


def tree_of(folder: Path) -> dict[str, bytes]:
    """The files below a folder, with their content."""
    return {
        str(each.relative_to(folder)): each.read_bytes()
        for each in folder.rglob('*')
        if each.is_file()
    }
