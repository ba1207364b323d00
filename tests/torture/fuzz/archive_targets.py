# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: archives of any origin, listed and extracted."""

from __future__ import annotations

import struct
import tarfile
import warnings
import zipfile
import zlib
from contextlib import suppress
from io import BytesIO
from shutil import rmtree

from kitti_ros2.datasets.archive_formats import BadMemberError, Limits, checked, open_archive
from kitti_ros2.datasets.extracting import extract, extract_all
from kitti_ros2.options.datasets import ExtractOptions

from .target import Target, place, stored

_FILES = ('oxts/data/0000000000.txt', 'velodyne_points/data/0000000000.bin')
_DRIVE = '2011_09_26/2011_09_26_drive_0001_sync/'


def _archive(data: bytes) -> None:
    path = stored('archive.zip', data)
    with open_archive(path) as packed:
        wanted = [each for each in checked(packed, Limits(200.0, 10**9)) if not each.is_folder]
        for _, pieces in packed.contents([each for each in wanted if not each.locked]):
            with suppress(BadMemberError):
                for _ in pieces:
                    pass


def _extract(data: bytes) -> None:
    """Extract beside files of other content, and a second time into what was written."""
    path = stored('archive.zip', data)
    root = place('extracted')
    rmtree(root, ignore_errors=True)
    sequence = root / 'dataset/sequences/00'
    sequence.mkdir(parents=True)
    (sequence / 'calib.txt').write_text('P0: 1\nTr: 1\n')
    (sequence / 'times.txt').write_text('other')
    (sequence / 'velodyne').symlink_to(root.parent)
    (sequence / 'image_2').symlink_to(sequence)
    (sequence / 'image_3').write_text('a file')
    (sequence / 'poses.txt').mkdir()
    for overwrite in (False, True):
        options = ExtractOptions(overwrite=overwrite, fsync=False)
        extract_all([path], root, options, lambda *_: None)
    extract(path, root, remove_archives=True, fsync=False)


def _zip(method: int) -> bytes:
    target = BytesIO()
    with zipfile.ZipFile(target, 'w', method) as archive:
        for name in _FILES:
            archive.writestr(zipfile.ZipInfo(_DRIVE + name), b'1 2 3 4\n' * 20, method)
    return target.getvalue()


def _tar(mode: str) -> bytes:
    target = BytesIO()
    with tarfile.open(fileobj=target, mode=mode) as archive:
        for name in _FILES:
            info = tarfile.TarInfo(_DRIVE + name)
            info.size = 160
            archive.addfile(info, BytesIO(b'1 2 3 4\n' * 20))
    return target.getvalue()


def _of_odometry(calibration: bytes) -> bytes:
    """Files at places that are taken, see _extract, and what desktop programs leave."""
    target = BytesIO()
    names = ('velodyne/000000.bin', 'image_2/000000.png', 'image_3/000000.png', 'poses.txt',
             'times.txt')  # fmt: skip
    with zipfile.ZipFile(target, 'w') as archive:
        for name in names:
            archive.writestr(zipfile.ZipInfo(f'dataset/sequences/00/{name}'), b'1 2 3 4\n')
        archive.writestr(zipfile.ZipInfo('dataset/sequences/00/calib.txt'), calibration)
        archive.writestr(zipfile.ZipInfo('dataset/.DS_Store'), b'')
    return target.getvalue()


def _named(*names: str) -> bytes:
    """Small files of some names, each with its own content."""
    target = BytesIO()
    with zipfile.ZipFile(target, 'w') as archive, warnings.catch_warnings():
        warnings.simplefilter('ignore')  # names that are there twice
        for number, name in enumerate(names):
            archive.writestr(zipfile.ZipInfo(name), b'%d\n' % number)
    return target.getvalue()


def _bomb() -> bytes:
    target = BytesIO()
    with zipfile.ZipFile(target, 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(_DRIVE + _FILES[0], bytes(101_000_000))
    return target.getvalue()


def _odd_archives() -> list[bytes]:
    """Archives that are refused, each for its own reason, and what is no archive."""
    file = _DRIVE + _FILES[0]
    return [
        *(b'', b'<!DOCTYPE html><html>', b'neither'),
        *(
            _named('a.txt'),
            _named(file, file.upper()),
            _named(file, file),
            _named(file, f'{file}/a'),
        ),
        *(_bomb(), _tar('w:')[:700], _tar('w:')[:2100], _tar('w:gz')[:-40], _tar('w:bz2')[:60]),
        _tar('w:').rstrip(b'\0'),
    ]


def _archives() -> list[bytes]:
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    modes = ('w:', 'w:gz', 'w:bz2', 'w:xz')
    odometry = [_of_odometry(text) for text in (b'P0: 1\n', b'P0: 2\nTr: 1\n')]
    return [*map(_zip, methods), *map(_tar, modes), *odometry, *_odd_archives()]


def _summed(data: bytes) -> bytes:
    """Correct the checksum of the first header of a tar."""
    if data[257:262] != b'ustar':
        return data
    head = data[:148] + b' ' * 8 + data[156:512]
    return head[:148] + b'%06o\0 ' % sum(head) + head[156:] + data[512:]


_WORDS = (
    *(b'../', b'/etc/passwd', b'\\', b'C:', b'ustar', b'PK\1\2', b'PK\5\6', b'PK\6\6', b'PK\3\4'),
    *(struct.pack('<H', each) for each in (0, 8, 12, 14, 1, 9, 99)),
    *(b'\x1f\x8b', b'BZh9', b'\xfd7zXZ', zlib.compress(bytes(1000))),
)

TARGETS = (
    Target('archive', _archive, _archives,
           ('datasets/archive_formats.py',), _WORDS, mend=_summed, short=150),
    Target('extract', _extract, _archives,
           ('datasets/extracting.py', 'datasets/archive_formats.py'), _WORDS, mend=_summed,
           short=50),
)  # fmt: skip
"""All of them."""
