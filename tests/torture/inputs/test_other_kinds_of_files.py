# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text files with more invalid lines than any of KITTI's: one line is said, and little is used."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import pytest

from kitti_ros2.cli import main
from kitti_ros2.kitti.label_file import TrackFile, parse_labels
from kitti_ros2.kitti.store import STORE
from kitti_ros2.kitti.text_file import parse_lines, parse_poses, parse_times, parse_timestamps
from kitti_ros2.model.errors import BadFileError
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import write_synthetic

from builders import SMALL  # isort: skip

SAID = 'this and 1000 more lines, maybe all, are invalid; the file is not read'
FILES = [
    (Layout.RAW, 'velodyne_points/timestamps.txt'),
    (Layout.RAW, 'velodyne_points/timestamps_start.txt'),
    (Layout.RAW, 'oxts/timestamps.txt'),
    (Layout.ODOMETRY, 'times.txt'),
    (Layout.ODOMETRY, 'poses/*.txt'),
    (Layout.TRACKING, 'label_02/*.txt'),
    (Layout.TRACKING, 'oxts/*.txt'),
    (Layout.OBJECT, 'label_2/000003.txt'),
    (Layout.KITTI_360, 'image_00/timestamps.txt'),
    (Layout.KITTI_360, 'poses.txt'),
]


@pytest.fixture(params=FILES, ids=lambda each: f'{each[0].value} {each[1]}')
def damaged(request, tmp_path):
    """The source of a recording, and a file of it that has 3000 invalid lines behind the first."""
    layout, pattern = request.param
    source = write_synthetic(tmp_path / layout.value, layout, SMALL)
    (path, *_) = sorted((tmp_path / layout.value).rglob(pattern))
    first = path.read_text().splitlines()[0]
    path.write_text('\n'.join([first, *['x'] * 3000, '']))
    return source, path


def test_the_file_is_named_once_and_the_rest_is_converted(damaged, tmp_path, capsys):
    source, path = damaged
    nothing_is_left = path.name == 'times.txt'
    code = main(['to-bag', str(source), str(tmp_path / 'out.mcap'), '-q'])
    assert code == (2 if nothing_is_left else 1)
    said = capsys.readouterr().err
    assert f'{path}:2: {SAID}' in said
    assert len(said.splitlines()) < 12
    assert (tmp_path / 'out.mcap').exists() is not nothing_is_left


def test_a_check_names_it_as_well(damaged, capsys):
    source, path = damaged
    assert main(['validate', str(source)]) == 1
    said = capsys.readouterr().out
    assert f'{path.name}:2: {SAID}' in said
    assert len(said.splitlines()) < 30


def test_tracks_of_another_kind_are_refused_before_they_are_parsed(tmp_path):
    text = ''.join(f'{frame} 1 Car\n' for frame in range(2000))
    with pytest.raises(BadFileError, match=f'a.txt:1: {SAID}; expected 17 or 18 columns'):
        TrackFile(text, tmp_path / 'a.txt')


def test_blank_lines_between_labels_are_no_matter(tmp_path):
    line = '{} 1 Car 0 0 1.5 10 20 30 40 1.5 1.6 4.0 1.0 1.7 20.0 0.3\n\n'
    tracks = TrackFile(''.join(map(line.format, range(2000))), tmp_path / 'a.txt')
    boxes, errors = tracks.boxes(1999)
    assert (len(boxes), errors, len(tracks.rows)) == (1, [], 2000)


@pytest.mark.parametrize('count', [1000, 1001])
def test_the_limit_is_a_thousand(count):
    def read():
        return parse_lines('x\n' * count + '1\n', 'a.txt', 'a number', int)

    if count == 1000:
        assert len(read().errors) == count
        return
    with pytest.raises(BadFileError, match=f'a.txt:1: {SAID}; expected a number'):
        read()


@pytest.mark.parametrize(
    'parse', [parse_labels, parse_poses, parse_times, parse_timestamps, TrackFile]
)
@pytest.mark.parametrize('text', ['\n' * 200_000 + 'x', 'x\n' * 100_000], ids=['blank', 'words'])
def test_megabytes_of_other_lines_cost_little(parse, text):
    tracemalloc.start()
    try:
        if parse is TrackFile and text.startswith('\n'):
            assert not parse(text, 'a.txt').rows  # blank lines are no labels
        else:
            with pytest.raises(BadFileError, match='1000 more lines'):
                parse(text, 'a.txt')
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 20 * 10**6


@pytest.mark.parametrize(
    'name',
    ['velodyne_points/data/*1.bin', 'image_02/data/*1.png', 'velodyne_points/timestamps.txt'],
)
def test_a_file_that_would_fill_the_memory_is_named(drive, name, tmp_path, capsys):
    (path,) = drive.glob(name)
    os.truncate(path, 300 * 10**9)
    assert main(['to-bag', str(drive), str(tmp_path / 'out.mcap'), '-q']) == 1
    said = capsys.readouterr().err
    assert f'{path}: 300.0 GB, which is not read; expected a file of at most 268.4 MB' in said
    assert main(['validate', str(drive)]) == 1
    assert path.name in capsys.readouterr().out


def test_stamps_in_a_pipe_are_not_said_to_be_absent(drive, tmp_path, capsys):
    path = drive / 'velodyne_points' / 'timestamps.txt'
    path.unlink()
    os.mkfifo(path)
    assert main(['to-bag', str(drive), str(tmp_path / 'out.mcap'), '-q']) == 1
    said = capsys.readouterr().err
    assert f'{path}: is no regular file' in said
    assert 'no such file' not in said


def test_a_report_names_images_that_are_no_regular_files(drive, tmp_path, capsys):
    first, second, third = sorted((drive / 'image_02' / 'data').iterdir())[:3]
    for path in (first, second, third):
        path.unlink()
    os.mkfifo(first)
    second.symlink_to('/dev/zero')
    os.mkfifo(third)
    assert main(['report', str(drive), '-o', str(tmp_path / 'out.html')]) == 1
    assert f'{first}: is no regular file; expected a file; and 2 more' in capsys.readouterr().err


def test_a_file_of_the_system_is_not_read_without_end(monkeypatch):
    monkeypatch.setattr('kitti_ros2.kitti.store.MOST_BYTES', 100)
    path = Path('/proc/self/smaps')
    with pytest.raises(BadFileError, match='which is not read; expected a file of at most 100'):
        STORE.read(path)
