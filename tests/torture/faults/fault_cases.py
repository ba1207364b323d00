# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The commands that meet faults, each on a recording of a frame or two, and the faults."""

from __future__ import annotations

import errno
import shutil
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TINY = SyntheticOptions(frames=1, image_size=(62, 20), lidar_columns=20)
MEMORY_BYTES = 1 << 15
"""Smaller requests do not fail: the system kills a process that lacks so little."""
DRIVE = '2011_09_26_drive_0048'


@dataclass(frozen=True)
class Case:
    """A command, with its source.

    Attributes:
        words: Its arguments; {source}, {out} and {root} (the folder of sources) are paths.
        prepare: Makes the source in a folder that exists, and returns its path.
        before: Arguments of a command that makes what is there before, if anything.
        gradual: Whether each file of the output appears by itself: a collection, a download.
        retry: Options for running again after a failure.
    """

    words: tuple[str, ...]
    prepare: Callable[[Path], Path]
    before: tuple[str, ...] = ()
    gradual: bool = False
    retry: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fault:
    """What goes wrong, as the variables of the library.

    Attributes:
        do: FAULT_DO.
        code: FAULT_CODE.
        calls: FAULT_CALLS.
        is_of_sources: Whether it changes the source, and so strikes calls on the source only.
    """

    do: str
    code: int = 0
    calls: str = 'change'
    is_of_sources: bool = False

    @property
    def hits_removing(self) -> bool:
        """Whether files cannot be removed either."""
        return self.do in {'error', 'errors'} and self.code in {errno.EIO, errno.EACCES}

    def variables(self, work: Path, at: int) -> dict[str, Any]:
        """Return the variables of the library for the k-th call."""
        path = work / 'source' if self.is_of_sources else work
        return {
            'path': f'{path}/', 'calls': self.calls, 'at': at, 'do': self.do, 'code': self.code,
            'size': MEMORY_BYTES,
        }  # fmt: skip


FAULTS = {
    'full disk': Fault('errors', errno.ENOSPC),
    'EIO once': Fault('error', errno.EIO),
    'EIO from then on': Fault('errors', errno.EIO),
    'EACCES': Fault('errors', errno.EACCES),
    'EINTR': Fault('error', errno.EINTR),
    'short writes': Fault('short'),
    'SIGTERM': Fault('term'),
    'SIGTERM three times': Fault('terms'),
    'SIGKILL': Fault('self'),
    'EIO of a read': Fault('error', errno.EIO, 'read'),
    'EACCES of a read': Fault('errors', errno.EACCES, 'read'),
    'EINTR of a read': Fault('error', errno.EINTR, 'read'),
    'short reads': Fault('short', 0, 'read'),
    'SIGTERM at a read': Fault('term', 0, 'read'),
    'vanishing file': Fault('vanish', 0, 'read', is_of_sources=True),
    'growing file': Fault('grow', 0, 'read', is_of_sources=True),
    'no memory': Fault('error', errno.ENOMEM, 'memory'),
}


def _drive(folder: Path, options: SyntheticOptions = TINY) -> Path:
    return write_synthetic(folder, Layout.RAW, options)


def _bag(name: str, *words: str, frames: int = 1) -> Callable[[Path], Path]:
    """A bag of the drive."""

    def prepare(folder: Path) -> Path:
        drive = _drive(folder.with_name('drive'), replace(TINY, frames=frames))
        assert main(['to-bag', str(drive), str(folder / name), '-q', *words]) == 0
        shutil.rmtree(folder.with_name('drive'))
        return folder / name

    return prepare


def _cut(name: str, *words: str, keep: float = 0.5) -> Callable[[Path], Path]:
    """A bag whose end is missing."""

    def prepare(folder: Path) -> Path:
        path = _bag(name, *words)(folder)
        for file in [path] if path.is_file() else list(path.iterdir()):
            if file.suffix in {'.mcap', '.bag', '.db3'}:
                with file.open('r+b') as opened:
                    opened.truncate(int(file.stat().st_size * keep))
        return path

    return prepare


def _collection(folder: Path) -> Path:
    drive = _drive(folder)
    shutil.copytree(drive, drive.with_name(drive.name.replace('0001', '0002')))
    return folder


def _bags(folder: Path) -> Path:
    drive = _drive(folder.with_name('drive'))
    for name in ('one.mcap', 'two.mcap'):
        assert main(['to-bag', str(drive), str(folder / name), '-q']) == 0
    shutil.rmtree(folder.with_name('drive'))
    return folder


def _mirror(folder: Path) -> Path:
    """The archives of a drive, as KITTI's server has them."""
    drive = _drive(folder.with_name('drive'))
    archives = folder / 'raw_data'
    (archives / DRIVE).mkdir(parents=True)
    with ZipFile(archives / '2011_09_26_calib.zip', 'w') as packed:
        for path in sorted(drive.parent.glob('*.txt')):
            packed.write(path, f'2011_09_26/{path.name}')
    top = f'2011_09_26/{DRIVE}_sync'
    with (
        ZipFile(archives / DRIVE / f'{DRIVE}_sync.zip', 'w') as packed,
        ZipFile(archives / DRIVE / f'{DRIVE}_tracklets.zip', 'w') as labels,
    ):
        for path in sorted(each for each in drive.rglob('*') if each.is_file()):
            to = labels if path.name == 'tracklet_labels.xml' else packed
            to.write(path, f'{top}/{path.relative_to(drive)}')
    shutil.rmtree(folder.with_name('drive'))
    return folder


def _to_kitti(layout: str, frames: int = 1) -> Case:
    given = ('to-kitti', '{source}', '{out}', '-q', *(['--layout', layout] if layout else []))
    return Case(given, _bag('bag.mcap', frames=frames))


_APPEND = ('to-kitti', '{source}', '{out}', '-q', '--layout', 'object', '--append')

CASES = {
    'to-bag mcap': Case(('to-bag', '{source}', '{out}.mcap', '-q'), _drive),
    'to-bag sqlite3': Case(('to-bag', '{source}', '{out}', '--storage', 'sqlite3', '-q'), _drive),
    'to-bag ros1': Case(('to-bag', '{source}', '{out}.bag', '-q'), _drive),
    'to-bag --overwrite': Case(
        ('to-bag', '{source}', '{out}', '-q', '--overwrite'),
        _drive,
        before=('to-bag', '{source}', '{out}', '-q', '--topics', '/kitti/velo/*'),
    ),
    'to-kitti restored': _to_kitti(''),
    'to-kitti object': _to_kitti('object'),
    'to-kitti odometry': _to_kitti('odometry', 2),  # a frame needs a pose before and one after it
    'to-kitti tracking': _to_kitti('tracking'),
    'to-kitti --append': Case(_APPEND, _bag('bag.mcap'), before=_APPEND),
    'recover mcap': Case(('recover', '{source}', '{out}.mcap', '-q'), _cut('bag.mcap')),
    'recover sqlite3': Case(
        ('recover', '{source}', '{out}', '-q'), _cut('bag', '--storage', 'sqlite3', keep=0.8)
    ),
    'recover ros1': Case(('recover', '{source}', '{out}.bag', '-q'), _cut('bag.bag')),
    'download': Case(
        ('download', 'raw', DRIVE, '{out}', '--base-url', 'file://{source}', '--accept-license',
         '-q', '--jobs', '1'),
        _mirror,
        gradual=True,
    ),
    'to-bag --all': Case(
        ('to-bag', '{source}', '{out}', '--all', '--jobs', '1', '-q'),
        _collection,
        gradual=True,
        retry=('--retry',),
    ),
    'to-kitti --all': Case(
        ('to-kitti', '{source}', '{out}', '--all', '--jobs', '1', '-q'),
        _bags,
        gradual=True,
        retry=('--retry',),
    ),
    'crop': Case(('crop', '{source}', '{out}', '-q', '--range', ':20'), _drive),
    'crop --copy': Case(('crop', '{source}', '{out}', '-q', '--copy', '--range', ':1000'), _drive),
}  # fmt: skip
