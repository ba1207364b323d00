# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: what the commands that score read, and archives."""

from __future__ import annotations

import struct
import tarfile
import zipfile
import zlib
from contextlib import suppress
from io import BytesIO

from kitti_ros2.evaluation.class_map import ClassMap
from kitti_ros2.evaluation.detection_inputs import read_frames
from kitti_ros2.evaluation.track_boxes import read_tracks, read_truth
from kitti_ros2.evaluation.trajectories import read_trajectory
from kitti_ros2.fetch.checksums import read_checksums
from kitti_ros2.fetch.errors import BadMemberError
from kitti_ros2.fetch.extract import extract_all
from kitti_ros2.fetch.members import Limits, checked
from kitti_ros2.fetch.open_archive import open_archive
from kitti_ros2.model.layouts import Layout
from kitti_ros2.options.bag_results import BagResultsOptions
from kitti_ros2.options.fetching import ExtractOptions
from kitti_ros2.options.read import ReadOptions

from .inputs import SEPARATOR, files, joined, parted, samples
from .target import Target, place, stored

_FILES = ('oxts/data/0000000000.txt', 'velodyne_points/data/0000000000.bin')
_DRIVE = '2011_09_26/2011_09_26_drive_0001_sync/'


def _trajectory(data: bytes) -> None:
    read_trajectory(stored('poses.txt', data))


def _tracker(data: bytes) -> None:
    path = stored('0000.txt', data)
    classes = ClassMap({})
    read_tracks(path, 100, classes)
    classes.losses('tracks')
    read_truth(path, 100)


def _detections(data: bytes) -> None:
    truth, results = place('truth/000000.txt').parent, place('results/000000.txt').parent
    for folder, text in zip((truth, results), parted(data, 2), strict=True):
        (folder / '000000.txt').write_bytes(text)
    read_frames(truth, results, ReadOptions(), BagResultsOptions())


def _checksums(data: bytes) -> None:
    read_checksums(stored('SHA256SUMS', data))


def _archive(data: bytes) -> None:
    path = stored('archive.zip', data)
    with open_archive(path) as packed:
        wanted = [each for each in checked(packed, Limits(200.0, 10**9)) if not each.is_folder]
        for _, pieces in packed.contents([each for each in wanted if not each.locked]):
            with suppress(BadMemberError):
                for _ in pieces:
                    pass


def _extract(data: bytes) -> None:
    path = stored('archive.zip', data)
    root = place('extracted/file').parent
    extract_all([path], root, ExtractOptions(overwrite=True), lambda *_: None)


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


def _archives() -> list[bytes]:
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    modes = ('w:', 'w:gz', 'w:bz2', 'w:xz')
    return [*map(_zip, methods), *map(_tar, modes)]


def _summed(data: bytes) -> bytes:
    """Correct the checksum of the first header of a tar."""
    if data[257:262] != b'ustar':
        return data
    head = data[:148] + b' ' * 8 + data[156:512]
    return head[:148] + b'%06o\0 ' % sum(head) + head[156:] + data[512:]


def _result_texts() -> list[bytes]:
    labels = files('label_2/*.txt', Layout.OBJECT)
    results = [b''.join(line + b' 0.9\n' for line in each.splitlines()) for each in labels]
    return [joined(pair) for pair in zip(labels, results, strict=True)]


def _trajectories() -> list[bytes]:
    poses = files('poses/*.txt', Layout.ODOMETRY)
    tum = b'0.0 1 2 3 0 0 0 1\n0.1 1 2 3 0 0 0 1\n'
    return [
        *poses,
        tum,
        b'# timestamp tx ty tz qx qy qz qw\n' + tum,
        b'0 1 0 0 0 0 1 0 0 0 0 1 0\n',
    ]


_TRACKS = ('evaluation/track_boxes.py', 'evaluation/class_map.py')
_WORDS = (
    *(b'../', b'/etc/passwd', b'\\', b'C:', b'ustar', b'PK\1\2', b'PK\5\6', b'PK\6\6', b'PK\3\4'),
    *(struct.pack('<H', each) for each in (0, 8, 12, 14, 1, 9, 99)),
    *(b'\x1f\x8b', b'BZh9', b'\xfd7zXZ', zlib.compress(bytes(1000))),
)

TARGETS = (
    Target('trajectory', _trajectory, _trajectories, ('evaluation/trajectories.py',),
           (b'#', b',', b'0 0 0 0'), is_text=True, long=100_000),
    Target('tracker', _tracker,
           lambda: [*files('label_02/*.txt'), *samples('kitti/tracking/*/label_02/*.txt')],
           _TRACKS, (b'DontCare', b'Cyclist'), is_text=True, long=100_000),
    Target('detections', _detections, _result_texts,
           ('evaluation/detection_inputs.py', 'evaluation/frame_boxes.py',
            'kitti/result_files.py'),
           (SEPARATOR, b'DontCare'), is_text=True, short=100, long=100_000),
    Target('checksums', _checksums, lambda: [b'a' * 64 + b'  a.zip\n# b\n' + b'0' * 64 + b' *b\n'],
           ('fetch/checksums.py',), is_text=True, long=100_000),
    Target('archive', _archive, _archives,
           ('fetch/open_archive.py', 'fetch/members.py', 'fetch/zip_archive.py',
            'fetch/tar_archive.py'), _WORDS, mend=_summed, short=150),
    Target('extract', _extract, _archives,
           ('fetch/extract.py', 'fetch/placement.py', 'fetch/tree.py'), _WORDS, mend=_summed,
           short=50),
)  # fmt: skip
"""All of them."""
