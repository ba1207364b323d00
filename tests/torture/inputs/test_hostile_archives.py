# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile and damaged archives: refused in one line, with nothing of them extracted."""

from __future__ import annotations

import gzip
import io
import lzma
import random
import struct
import tarfile
import warnings
import zlib
from contextlib import suppress
from typing import TYPE_CHECKING
from zipfile import ZIP_DEFLATED, ZIP_LZMA, ZipFile, ZipInfo

import pytest
from archives_of import SCAN, pack, tree_of
from builders import one_line
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2 import datasets
from kitti_ros2.cli import main
from kitti_ros2.datasets import archive_formats
from kitti_ros2.datasets.archive_formats import BadArchiveError
from kitti_ros2.model.errors import KittiRos2Error

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(autouse=True)
def small_bombs(monkeypatch):
    monkeypatch.setattr(archive_formats, '_LEAST_SUSPICIOUS_BYTES', 1_000_000)


NAMES = {
    'parent': ('../training/velodyne/1.bin', 'leads out of the folder'),
    'parent inside': ('training/velodyne/../../../x', 'leads out of the folder'),
    'parent at the end': ('training/velodyne/..', 'leads out of the folder'),
    'absolute': ('/training/velodyne/1.bin', 'is an absolute path'),
    'drive letter': ('C:/training/velodyne/1.bin', 'is an absolute path'),
    'drive letter alone': ('C:x', 'is an absolute path'),
    'backslash': ('..\\training\\1.bin', 'has a backslash'),
    'line break': ('training/velodyne/1\n.bin', 'has control characters'),
    'escape': ('training/velodyne/\x1b[2J', 'has control characters'),
    'right to left': ('training/velodyne/\u202enib.1', 'has control characters'),
    'long part': (f'training/velodyne/{"x" * 300}', 'has too long a name'),
    'long name': ('training/' + 'x/' * 1500 + '1', 'has too long a name'),
}


def refused(path: Path, root: Path, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """The one line that refuses an archive; nothing is written."""
    before = sorted(root.parent.rglob('*'))
    assert main(['extract', str(path), str(root), *options]) == 2
    after = sorted(root.parent.rglob('*'))
    assert after == before
    line = one_line(capsys.readouterr().err)
    assert 'nothing of it was extracted' in line
    return line


@pytest.mark.parametrize('suffix', ['.zip', '.tar.gz'])
@pytest.mark.parametrize('kind', list(NAMES))
def test_names(tmp_path, capsys, kind, suffix):
    name, reason = NAMES[kind]
    path = pack(tmp_path / f'a{suffix}', {SCAN: b'sound', name: b'hostile'})
    assert reason in refused(path, tmp_path / 'out', capsys)


def test_a_name_with_nul_in_a_zip(tmp_path, capsys):
    path = pack(tmp_path / 'a.zip', {SCAN: b'1', 'training/aXb': b'1'})
    path.write_bytes(path.read_bytes().replace(b'training/aXb', b'training/a\0b'))
    assert 'has control characters' in refused(path, tmp_path / 'out', capsys)


def add_tar(kind: bytes) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        with tarfile.open(folder / 'a.tar', 'w') as made:
            info = tarfile.TarInfo(SCAN)
            made.addfile(info, io.BytesIO())
            link = tarfile.TarInfo('training/velodyne/000004.bin')
            link.type, link.linkname = kind, '/etc/passwd'
            made.addfile(link)
        return folder / 'a.tar'

    return make


def add_zip(mode: int) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        with ZipFile(folder / 'a.zip', 'w') as made:
            made.writestr(SCAN, b'1')
            info = ZipInfo('training/velodyne/000004.bin')
            info.create_system, info.external_attr = 3, (mode | 0o777) << 16
            made.writestr(info, '/etc/passwd')
        return folder / 'a.zip'

    return make


def packed(name: str, **files: bytes) -> Callable[[Path], Path]:
    return lambda folder: pack(folder / name, files)


def overlapping(folder: Path) -> Path:
    """A zip whose members all have the same bytes of the file as their content."""
    path = pack(
        folder / 'a.zip', {f'training/velodyne/{n:06d}.bin': bytes(90_000) for n in range(9)}
    )
    data = bytearray(path.read_bytes())
    at = data.index(b'PK\x01\x02')
    while (at := data.find(b'PK\x01\x02', at)) >= 0:
        data[at + 20 : at + 24] = struct.pack('<I', len(data) // 4)
        at += 1
    path.write_bytes(data)
    return path


def two_files(folder: Path) -> Path:
    with warnings.catch_warnings(), ZipFile(folder / 'a.zip', 'w') as made:
        warnings.simplefilter('ignore')
        made.writestr(SCAN, b'1')
        made.writestr(SCAN, b'2')
    return folder / 'a.zip'


def huge_header(folder: Path) -> Path:
    """A tar whose extended header declares a gigabyte, all zeros."""
    info = tarfile.TarInfo('././@PaxHeader')
    info.type, info.size = tarfile.XHDTYPE, 1 << 30
    with gzip.open(folder / 'a.tar.gz', 'wb') as file:
        file.write(info.tobuf(tarfile.USTAR_FORMAT))
        for _ in range(64):
            file.write(bytes(1 << 20))
    return folder / 'a.tar.gz'


def declared(folder: Path) -> Path:
    """A tar that declares a terabyte."""
    info = tarfile.TarInfo(SCAN)
    info.size = 1 << 40
    (folder / 'a.tar').write_bytes(info.tobuf(tarfile.GNU_FORMAT) + bytes(2048))
    return folder / 'a.tar'


def large_dictionary(folder: Path) -> Path:
    """A tar.xz of two streams, as xz joins them; the second needs a gigabyte of memory."""
    data = pack(folder / 'b.tar', {SCAN: b'1'}).read_bytes()
    filters = [{'id': lzma.FILTER_LZMA2, 'dict_size': 1 << 30}]
    second = lzma.compress(data[1024:], filters=filters)
    (folder / 'a.tar.xz').write_bytes(lzma.compress(data[:1024]) + second)
    (folder / 'b.tar').unlink()
    return folder / 'a.tar.xz'


def sparse(folder: Path) -> Path:
    info = tarfile.TarInfo(SCAN)
    info.type = tarfile.GNUTYPE_SPARSE
    data = bytearray(info.tobuf(tarfile.GNU_FORMAT))
    (folder / 'a.tar').write_bytes(bytes(data) + bytes(2048))
    return folder / 'a.tar'


ARCHIVES: dict[str, tuple[Callable[[Path], Path], str]] = {
    'symbolic link in a tar': (add_tar(tarfile.SYMTYPE), 'is a symbolic link'),
    'hard link in a tar': (add_tar(tarfile.LNKTYPE), 'is a hard link'),
    'character device in a tar': (add_tar(tarfile.CHRTYPE), 'is a device'),
    'block device in a tar': (add_tar(tarfile.BLKTYPE), 'is a device'),
    'pipe in a tar': (add_tar(tarfile.FIFOTYPE), 'is a pipe'),
    'unknown type in a tar': (add_tar(b'Z'), 'is a member of an unknown type'),
    'sparse file in a tar': (sparse, 'is a sparse file'),
    'symbolic link in a zip': (add_zip(0o120000), 'is a symbolic link'),
    'character device in a zip': (add_zip(0o020000), 'is a device'),
    'pipe in a zip': (add_zip(0o010000), 'is a pipe'),
    'socket in a zip': (add_zip(0o140000), 'is a socket'),
    'names that differ in case': (
        packed('a.zip', **{'training/velodyne/a.bin': b'', 'training/velodyne/A.bin': b''}),
        "contains both 'training/velodyne/a.bin' and 'training/velodyne/A.bin'",
    ),
    'folders that differ in case': (
        packed('a.tar', **{'training/calib/1.txt': b'', 'training/Calib/2.txt': b''}),
        "contains both 'training/calib' and 'training/Calib'",
    ),
    'names that differ in accents': (
        packed('a.zip', **{'training/calib/\u00e9': b'', 'training/calib/e\u0301': b''}),
        'contains both',
    ),
    'a file as a folder': (
        packed('a.zip', **{'training/velodyne': b'', SCAN: b''}),
        "contains 'training/velodyne' as a file and as a folder",
    ),
    'two different files of a name': (two_files, 'contains two different files'),
    'two folders that become one': (
        packed('a.zip', **{f'a/{SCAN}': b'1', f'b/{SCAN}': b'22'}), 'contains two different files'
    ),
    'members that overlap': (overlapping, 'has members that overlap'),
    'bomb in a zip': (packed('a.zip', **{SCAN: bytes(3_000_000)}), 'times its own size'),
    'bomb in a tar.bz2': (packed('a.tar.bz2', **{SCAN: bytes(3_000_000)}), 'its own size'),
    'a header of a gigabyte': (huge_header, 'a header of unreasonable size'),
    'a dictionary of a gigabyte': (large_dictionary, 'needs a dictionary of over 67.1 MB'),
    'a declared terabyte': (declared, 'declares at least 1.1 TB of content'),
    'nothing of KITTI': (packed('a.zip', **{'x/y.bin': b''}), 'contains no folder of KITTI'),
    'no files': (packed('a.zip'), 'contains no folder of KITTI in 0 files'),
}  # fmt: skip


@pytest.mark.parametrize('kind', list(ARCHIVES))
def test_archives(tmp_path, capsys, kind):
    make, reason = ARCHIVES[kind]
    assert reason in refused(make(tmp_path), tmp_path / 'out', capsys)


def test_the_number_of_entries_is_limited(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(archive_formats, '_MOST_MEMBERS', 3)
    path = pack(tmp_path / 'a.zip', {f'training/calib/{n}.txt': b'' for n in range(4)})
    assert 'has over 3 entries' in refused(path, tmp_path / 'out', capsys)


def test_limits_can_be_raised(tmp_path, capsys):
    path = pack(tmp_path / 'a.zip', {SCAN: bytes(2_000_000)})
    assert '--max-ratio' in refused(path, tmp_path / 'out', capsys)
    line = refused(path, tmp_path / 'out', capsys, '--max-ratio', '2000', '--max-size', '1MB')
    assert 'declares at least 2.0 MB of content; ' in line
    assert 'allow more with --max-size' in line
    assert main(['extract', str(path), str(tmp_path / 'out'), '--max-ratio', '2000', '-q']) == 0
    assert (tmp_path / 'out' / SCAN).stat().st_size == 2_000_000


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'', 'is empty'),
        (b'PK\x03\x04 cut', 'is a truncated or damaged zip archive'),
        (b'\x1f\x8b\x08 cut', 'is a truncated or damaged tar archive'),
        (gzip.compress(b'no tar', mtime=0), 'is a truncated or damaged tar archive'),
        (b'<!DOCTYPE html><html>login', 'is a web page, such as that of a login'),
        (b'7z\xbc\xaf\x27\x1c', 'is neither a zip nor a tar archive'),
    ],
)
def test_no_archives(tmp_path, capsys, content, reason):
    (tmp_path / 'a.zip').write_bytes(content)
    assert reason in refused(tmp_path / 'a.zip', tmp_path / 'out', capsys)


@pytest.mark.parametrize('suffix', ['.zip', '.tar', '.tar.gz', '.tar.bz2', '.tar.xz'])
def test_truncated_archives(tmp_path, capsys, suffix):
    whole = pack(tmp_path / f'whole{suffix}', {SCAN: bytes(range(256)) * 20, 'training/a/b': b'1'})
    data = whole.read_bytes()
    data = data.rstrip(b'\0') if suffix == '.tar' else data
    path = tmp_path / f'a{suffix}'
    for size in {len(data) - 1, len(data) // 2, len(data) // 8} | (
        {512, 1024, 512 + 5120, 512 * 12} if suffix == '.tar' else set()
    ):
        path.write_bytes(data[:size])
        assert (
            f'is a truncated or damaged {"zip" if suffix == ".zip" else "tar"} archive'
            in refused(path, tmp_path / 'out', capsys)
        )


def test_a_damaged_header_within_a_tar_is_not_its_end(tmp_path, capsys):
    path = pack(tmp_path / 'a.tar', {SCAN: b'1', 'training/velodyne/000004.bin': b'2'})
    data = bytearray(path.read_bytes())
    data[1024 + 150] ^= 0xFF  # the checksum of the second header
    path.write_bytes(data)
    assert 'its end is missing' in refused(path, tmp_path / 'out', capsys)


OTHER = 'training/velodyne/000009.bin'


def damaged_zip(path: Path, at: int, value: bytes) -> Path:
    """Change bytes of the record of the first member in the directory, and of its local header."""
    data = bytearray(path.read_bytes())
    central = data.index(b'PK\x01\x02')
    data[central + at : central + at + len(value)] = value
    if at >= 6:
        data[at - 2 : at - 2 + len(value)] = value
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ('at', 'value', 'reason'),
    [
        (8, b'\x01\x00', 'encrypted; extract it with another program and its password'),
        (10, b'\x09\x00', 'unsupported compression method 9; extract it with 7z'),
        (16, b'\x00\x00\x00\x00', 'damaged: Bad CRC-32'),
        (24, struct.pack('<I', 10), 'damaged: '),
        (24, struct.pack('<I', 5000), 'damaged: its content has less than the 5,000 bytes'),
        (46, b'T', 'damaged: File name in directory'),
    ],
)
def test_a_bad_file_in_a_zip_costs_itself_only(tmp_path, at, value, reason):
    path = pack(tmp_path / 'a.zip', {SCAN: bytes(range(256)) * 8, OTHER: b'sound'})
    if at == 46:  # a name that differs from the local one
        data = bytearray(path.read_bytes())
        data[data.rindex(SCAN.encode()) + 18] = ord('9')
        path.write_bytes(data)
    else:
        damaged_zip(path, at, value)
    report = datasets.extract(path, tmp_path / 'out', remove_archives=True)
    [loss] = report.losses
    assert reason in loss.text()
    assert tree_of(tmp_path / 'out') == {OTHER: b'sound'}
    assert path.exists()


def test_damaged_deflate_in_a_zip(tmp_path):
    content = zlib.compress(bytes(range(256)) * 200)
    path = pack(tmp_path / 'a.zip', {SCAN: content, OTHER: b'sound'})
    data = bytearray(path.read_bytes())
    start = 30 + len(SCAN)
    data[start : start + 20] = b'\xff' * 20
    path.write_bytes(data)
    [loss] = datasets.extract(path, tmp_path / 'out').losses
    assert 'damaged' in loss.text()
    assert tree_of(tmp_path / 'out') == {OTHER: b'sound'}


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_damage_is_an_error_of_ours_and_leaves_no_part(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp('damage')
    suffix = data.draw(st.sampled_from(['.zip', '.tar', '.tar.gz']))
    files = {SCAN: bytes(range(256)) * 4, OTHER: b'other' * 50}
    path = pack(folder / f'a{suffix}', files)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with suppress(KittiRos2Error):
        datasets.extract(path, folder / 'out')
    found = tree_of(folder / 'out')
    assert not [name for name in found if name.endswith('.part')]
    if suffix != '.tar':  # a tar has no checksum of contents
        assert all(content in files.values() for content in found.values())
    assert sorted(each.name for each in folder.iterdir() if each.name != 'out') == [path.name]


def test_a_zip_with_a_deflated_bomb_below_its_declared_size(tmp_path):
    """The content has more bytes than both headers declare."""
    with ZipFile(tmp_path / 'a.zip', 'w', ZIP_DEFLATED) as made:
        made.writestr(SCAN, bytes(1_000_000))
        made.writestr(OTHER, b'sound')
    damaged_zip(tmp_path / 'a.zip', 24, struct.pack('<I', 100))
    [loss] = datasets.extract(tmp_path / 'a.zip', tmp_path / 'out').losses
    assert 'damaged' in loss.text()
    assert tree_of(tmp_path / 'out') == {OTHER: b'sound'}


def test_a_large_dictionary_in_a_zip_costs_its_member_only(tmp_path):
    with ZipFile(tmp_path / 'a.zip', 'w') as made:
        made.writestr(SCAN, b'1' * 1000, ZIP_LZMA)
        made.writestr(OTHER, b'sound', ZIP_LZMA)
    data = bytearray((tmp_path / 'a.zip').read_bytes())
    at = 30 + len(SCAN) + 5
    data[at : at + 4] = struct.pack('<I', 0xFD800000)
    (tmp_path / 'a.zip').write_bytes(data)
    [loss] = datasets.extract(tmp_path / 'a.zip', tmp_path / 'out').losses
    assert 'needs a dictionary of 4.3 GB; extract it with 7z' in loss.text()
    assert tree_of(tmp_path / 'out') == {OTHER: b'sound'}


def test_a_zip_whose_directory_points_behind_its_end(tmp_path):
    with ZipFile(tmp_path / 'a.zip', 'w') as made:
        made.writestr(SCAN, b'1', ZIP_LZMA)
        made.writestr(OTHER, b'sound', ZIP_LZMA)
    data = bytearray((tmp_path / 'a.zip').read_bytes())
    at = data.index(b'PK\x01\x02') + 42
    data[at : at + 4] = struct.pack('<I', 2 * len(data))
    (tmp_path / 'a.zip').write_bytes(data)
    [loss] = datasets.extract(tmp_path / 'a.zip', tmp_path / 'out').losses
    assert 'damaged: ends in its header' in loss.text()
    assert tree_of(tmp_path / 'out') == {OTHER: b'sound'}


def test_xz_of_several_streams_with_padding(tmp_path):
    scan = random.Random(7).randbytes(1_000_000)
    data = pack(tmp_path / 'b.tar', {SCAN: scan, OTHER: b'2'}).read_bytes()
    streams = [lzma.compress(data[at : at + 300_000]) for at in range(0, len(data), 300_000)]
    (tmp_path / 'a.tar.xz').write_bytes(bytes(8).join(streams) + bytes(4))
    assert not datasets.extract(tmp_path / 'a.tar.xz', tmp_path / 'out').losses
    assert tree_of(tmp_path / 'out') == {SCAN: scan, OTHER: b'2'}


def test_the_only_archive_that_is_refused_is_an_error_of_the_library(tmp_path):
    with pytest.raises(BadArchiveError) as raised:
        datasets.extract(pack(tmp_path / 'a.zip', {'../x': b''}), tmp_path / 'out')
    assert raised.value.path == str(tmp_path / 'a.zip')
