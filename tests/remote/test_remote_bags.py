# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags at URLs: the same as from a disk, by few requests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('fsspec', reason='URLs need fsspec')

from builders import convert_recording
from counted_store import CountedStore, put

import kitti_ros2
from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


@pytest.fixture
def bag(recordings: Mapping[Layout, Path], tmp_path: Path) -> Path:
    out = tmp_path / 'bag' / 'drive.mcap'
    convert_recording(recordings[Layout.RAW], out)
    return out


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


def test_to_kitti_restores_the_same_files(bag: Path, tmp_path: Path):
    url = put(bag)
    assert main(['to-kitti', '-q', str(bag), str(tmp_path / 'local')]) == 0
    assert main(['to-kitti', '-q', str(url), str(tmp_path / 'remote')]) == 0
    assert content(tmp_path / 'remote') == content(tmp_path / 'local')


def test_a_bag_without_index_is_read(bag: Path, tmp_path: Path, capsys):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(bag.read_bytes()[: bag.stat().st_size * 2 // 3])
    url = put(cut)
    codes = [main(['info', '--json', str(path)]) for path in (cut, url)]
    assert codes[0] == codes[1]
    local, remote = capsys.readouterr().out.split('\n{', 1)
    assert ('{' + remote).replace(str(url), str(cut)).strip() == local.strip()


def test_damage_costs_the_same(bag: Path, tmp_path: Path):
    data = bytearray(bag.read_bytes())
    data[len(data) // 2] ^= 255
    broken = tmp_path / 'broken.mcap'
    broken.write_bytes(data)
    url = put(broken)
    codes = [
        main(['to-kitti', '-q', str(path), str(tmp_path / name)])
        for path, name in ((broken, 'local'), (url, 'remote'))
    ]
    assert codes == [1, 1]
    assert content(tmp_path / 'remote') == content(tmp_path / 'local')


@pytest.mark.parametrize(('name', 'storage'), [('folder', 'mcap'), ('drive.bag', 'ros1')])
def test_other_bags(name: str, storage: str, recordings: Mapping[Layout, Path], tmp_path: Path):
    out = tmp_path / name
    convert_recording(recordings[Layout.OBJECT], out, storage=storage)
    url = put(out)
    assert main(['to-kitti', '-q', str(out), str(tmp_path / 'local')]) == 0
    assert main(['to-kitti', '-q', str(url), str(tmp_path / 'remote')]) == 0
    assert content(tmp_path / 'remote') == content(tmp_path / 'local')


def test_sqlite3_is_refused_in_one_line(recordings: Mapping[Layout, Path], tmp_path: Path, capsys):
    out = tmp_path / 'drive'
    convert_recording(recordings[Layout.OBJECT], out, storage='sqlite3')
    url = put(out)
    assert main(['info', str(url)]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert 'is a sqlite3 bag' in error
    assert str(url) in error


def test_a_summary_takes_few_requests(bag: Path):
    url = put(bag)
    with OpenBag(url) as found:
        assert found.index.total
    assert CountedStore.requests['info'] <= 2  # of the bag, and of the mark of an upload
    assert CountedStore.requests['ls'] <= 1
    assert CountedStore.requests['cat'] <= 8
    assert sum(length for _, length in CountedStore.read) <= bag.stat().st_size


def test_ranges_are_read_once(bag: Path, tmp_path: Path):
    url = put(bag)
    assert main(['to-kitti', '-q', str(url), str(tmp_path / 'out')]) == 0
    assert sum(length for _, length in CountedStore.read) <= bag.stat().st_size


def test_the_python_library_opens_urls(bag: Path, recordings: Mapping[Layout, Path]):
    for source in (bag, recordings[Layout.RAW]):
        url = put(source.parent) / source.name
        local, remote = kitti_ros2.open(source), kitti_ros2.open(str(url))
        assert len(remote) == len(local)
        assert (remote[3].points == local[3].points).all()
        assert (remote[4].image(2) == local[4].image(2)).all()
