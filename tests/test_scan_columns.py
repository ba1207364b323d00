# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of other columns than KITTI's: refused by every command, and read with --columns."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import kitti_ros2
from kitti_ros2 import datasets
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import guess_layout
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.clouds import read_field
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.table import make_settings

from builders import SMALL, files_of  # isort: skip

WAYMO = 'x y z intensity elongation time'
DOUBLES = 'x:f8 y:f8 z:f8 intensity:f8'


def rows(path, columns, rng):
    """The points of a file of KITTI in other columns."""
    points = np.fromfile(path, '<f4').reshape(-1, 4)
    if columns == 'x y z':
        return points[:, :3]
    if columns == DOUBLES:
        return points + rng.uniform(-1e-5, 1e-5, points.shape)
    return np.concatenate([points, rng.random((len(points), 2))], 1).astype('<f4')


def rewrite(root, columns):
    rng = np.random.default_rng(0)
    for path in root.rglob('*.bin'):
        path.write_bytes(np.ascontiguousarray(rows(path, columns, rng)).tobytes())


def copy(source, tmp_path, columns):
    """A recording whose scans have other columns."""
    root = tmp_path / 'in' / source.name
    shutil.copytree(source, root)
    if guess_layout(source) is Layout.RAW:
        for file in source.parent.glob('*.txt'):
            shutil.copy(file, root.parent)
    rewrite(root, columns)
    return root


@pytest.fixture
def waymo(recordings, tmp_path):
    return copy(recordings[Layout.OBJECT], tmp_path, WAYMO)


COMMANDS = [
    ('info',),
    ('to-bag', '{out}.mcap'),
    ('to-bag', '{out}', '--all'),
    ('stats',),
    ('stats', '--count-points'),
    ('validate',),
    ('validate', '--quick'),
    ('crop', '{out}', '--range', ':20'),
    ('view', '-o', '{out}.png', '--mode', 'bev'),
    ('report', '-o', '{out}.html'),
]


@pytest.mark.parametrize('words', COMMANDS, ids=' '.join)
def test_refused_and_read(waymo, tmp_path, capfd, words):
    words = [word.format(out=tmp_path / 'out') for word in words]
    words = [words[0], str(waymo), *words[1:]]
    assert main([*words, '-q']) in {1, 2}
    said = ''.join(capfd.readouterr())
    assert '6 float32 a point' in said
    assert "--columns 'x y z intensity - -'" in said
    assert not [each for each in tmp_path.iterdir() if each.suffix]
    shutil.rmtree(tmp_path / 'out', ignore_errors=True)
    assert main([*words, '-q', '--columns', WAYMO]) == 0


@pytest.mark.one_in(3)
@pytest.mark.parametrize('columns', [WAYMO, DOUBLES, 'x y z'])
def test_there_and_back_to_the_byte(recording_path, tmp_path, columns):
    source = copy(recording_path, tmp_path, columns)
    bag, back = tmp_path / 'o.mcap', tmp_path / 'back'
    assert main(['to-bag', str(source), str(bag), '-q', '--columns', columns]) == 0
    assert main(['to-kitti', str(bag), str(back), '-q']) == 0
    expected, found = (
        {path: data for path, data in files_of(folder).items() if path.endswith('.bin')}
        for folder in (source, back)
    )
    assert len(found) == SMALL.frames
    assert sorted(found.values()) == sorted(expected.values())


@pytest.mark.parametrize('points', ['xyzirt', 'xyzircaedt', 'ouster'])
def test_other_formats_of_clouds_restore_the_columns(waymo, tmp_path, points):
    columns = 'x y z intensity elongation stamp'
    words = ['-q', '--points', points, '--columns', columns]
    assert main(['to-bag', str(waymo), str(tmp_path / 'o.mcap'), *words]) == 0
    assert main(['to-kitti', str(tmp_path / 'o.mcap'), str(tmp_path / 'back'), '-q']) == 0
    for path in waymo.rglob('*.bin'):
        other = tmp_path / 'back' / path.relative_to(waymo)
        assert other.read_bytes() == path.read_bytes()


def test_columns_become_fields(waymo, tmp_path):
    main(['to-bag', str(waymo), str(tmp_path / 'o.mcap'), '-q', '--columns', WAYMO])
    with open_messages(tmp_path / 'o.mcap', ['/kitti/velo/points']) as messages:
        cloud = next(deserialize(item.data, item.msgtype) for item in messages)
    assert [field.name for field in cloud.fields] == WAYMO.split()
    file = np.fromfile(min(waymo.rglob('*.bin')), '<f4').reshape(-1, 6)
    for index, name in enumerate(WAYMO.split()):
        np.testing.assert_array_equal(read_field(cloud, name), file[:, index])


def test_skipped_columns_are_a_note_and_then_a_loss(waymo, tmp_path, capfd):
    words = ['--columns', 'x y z intensity - -']
    assert main(['to-bag', str(waymo), str(tmp_path / 'o.mcap'), *words]) == 0
    assert 'columns 5, 6 of 6 left out (-)' in ''.join(capfd.readouterr())
    assert main(['to-kitti', str(tmp_path / 'o.mcap'), str(tmp_path / 'back'), '-q']) == 1
    assert 'are written without columns 5, 6 of 6' in ''.join(capfd.readouterr())
    before = np.fromfile(min(waymo.rglob('*.bin')), '<f4').reshape(-1, 6)
    after = np.fromfile(min((tmp_path / 'back').rglob('*.bin')), '<f4').reshape(-1, 4)
    np.testing.assert_array_equal(after, before[:, :4])


def test_crop_writes_the_columns_that_it_read(waymo, tmp_path):
    datasets.crop(waymo, tmp_path / 'cut', range=':20', columns=WAYMO)
    for path in waymo.rglob('*.bin'):
        points = np.fromfile(path, '<f4').reshape(-1, 6)
        kept = points[np.linalg.norm(points[:, :3].astype(np.float64), axis=1) <= 20]
        cut = (tmp_path / 'cut' / path.relative_to(waymo)).read_bytes()
        assert cut == kept.tobytes()


def test_library(waymo, tmp_path):
    with pytest.raises(KittiRos2Error, match='6 float32 a point'):
        kitti_ros2.open(waymo)
    path = min(waymo.rglob('*.bin'))
    expected = np.fromfile(path, '<f4').reshape(-1, 6)
    frame = kitti_ros2.open(waymo, columns=WAYMO)[0]
    np.testing.assert_array_equal(frame.points, expected[:, :4])
    np.testing.assert_array_equal(frame.extra['time'], expected[:, 5])
    with pytest.raises(KittiRos2Error, match='6 float32 a point'):
        kitti_ros2.read_scan(path)
    np.testing.assert_array_equal(kitti_ros2.read_scan(path, columns=WAYMO), expected)
    kitti_ros2.to_bag(waymo, tmp_path / 'o.mcap', columns=WAYMO)
    frame = kitti_ros2.open(tmp_path / 'o.mcap')[0]
    np.testing.assert_array_equal(frame.points, expected[:, :4])
    np.testing.assert_array_equal(frame.extra['elongation'], expected[:, 4])


def test_labels_are_read_without_the_scans(waymo, tmp_path):
    """Ground truth needs no scan."""
    results = tmp_path / 'results'
    shutil.copytree(waymo / 'training' / 'label_2', results)
    for path in results.iterdir():
        lines = path.read_text().splitlines()
        path.write_text(''.join(f'{line} 0.5\n' for line in lines if 'DontCare' not in line))
    assert main(['eval', 'detection', str(waymo), str(results), '-q']) in {0, 1}


def test_a_cut_scan_is_measured_by_its_columns(waymo, tmp_path, capfd):
    path = min(waymo.rglob('*.bin'))
    path.write_bytes(path.read_bytes()[:-8])
    assert main(['to-bag', str(waymo), str(tmp_path / 'o.mcap'), '-q', '--columns', WAYMO]) == 1
    assert 'expected a multiple of 24 bytes' in ''.join(capfd.readouterr())
    assert main(['validate', str(waymo), '-q', '--columns', WAYMO]) == 1
    assert 'no multiple of 24' in ''.join(capfd.readouterr())


def test_a_column_named_as_a_field_of_the_cloud_is_refused():
    with pytest.raises(KittiRos2Error, match='points xyzirt has a field ring of its own'):
        make_settings({'points': 'xyzirt', 'columns': 'x y z intensity ring'})


@pytest.mark.parametrize('columns', ['x y z', 'x y z intensity', DOUBLES])
def test_columns_that_others_explain_better_are_doubted(waymo, tmp_path, columns, capfd):
    """The sizes of the files fit: each point would become two, or a part of one."""
    for path in waymo.rglob('*.bin'):
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 96 * 96])
    main(['to-bag', str(waymo), str(tmp_path / 'bag'), '--columns', columns])
    said = capfd.readouterr()
    assert 'those of 6 float32 a point, not those of --columns' in said.out + said.err
    assert not [n for n in kitti_ros2.open(waymo, columns=WAYMO).notes if '--columns' in n]


def test_columns_do_not_make_points_of_a_header(waymo):
    for path in waymo.rglob('*.bin'):
        with path.open('wb') as file:
            np.save(file, np.zeros((40, 4), '<f4'))
    notes = kitti_ros2.open(waymo, columns='x y z intensity').notes
    assert any('NumPy file (.npy) of f4 (40, 4), not those of --columns' in note for note in notes)


@pytest.fixture
def odd(recordings, tmp_path):
    """A set whose last scan has five columns."""
    root = tmp_path / 'in'
    shutil.copytree(recordings[Layout.OBJECT], root)
    path = max(root.rglob('*.bin'))
    points = np.fromfile(path, '<f4').reshape(-1, 4)
    rings = np.arange(len(points), dtype='<f4')[:, None] % 64
    return path, np.concatenate([points, rings], 1)


def test_an_odd_scan_that_looks_cut_is_named(odd, tmp_path, capfd):
    path, points = odd
    points[: len(points) // 4 * 4 - 1].tofile(path)
    assert main(['to-bag', str(tmp_path / 'in'), str(tmp_path / 'bag')]) == 1
    said = capfd.readouterr().err
    assert f'{path.name}: size and values are those of 5 float32 a point' in said
    assert 'copy the file again' not in said


def test_validate_names_an_odd_scan(odd, tmp_path, capfd):
    path, points = odd
    points[: len(points) // 4 * 4].tofile(path)
    main(['validate', str(tmp_path / 'in')])
    assert f'{path.name}: size and values are those of 5 float32 a point' in capfd.readouterr().out


def test_a_plan_names_the_columns_that_it_leaves_out(waymo, tmp_path, capfd):
    bag, said = tmp_path / 'bag', 'left out: elongation, time'
    assert main(['to-bag', str(waymo), str(bag), '--columns', WAYMO]) == 0
    main(['to-kitti', str(bag), str(tmp_path / 'same')])
    assert said not in capfd.readouterr().out
    main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'odometry'])
    assert said in capfd.readouterr().out


@pytest.mark.one_in(3)
@pytest.mark.parametrize('columns', [3, 5])
@pytest.mark.parametrize('place', [0, 1, -1])
def test_an_odd_scan_of_whole_points_is_a_loss(recordings, tmp_path, capfd, place, columns):
    root = tmp_path / 'in'
    shutil.copytree(recordings[Layout.OBJECT], root)
    path = sorted(root.rglob('*.bin'))[place]
    points = np.fromfile(path, '<f4').reshape(-1, 4)
    points = np.concatenate([points, points[:, :1] + 1], 1)[: len(points) // 4 * 4, :columns]
    np.ascontiguousarray(points).tofile(path)
    for words in (['to-bag'], ['crop', '--range', ':30']):
        assert main([*words, str(root), str(tmp_path / words[0])]) == 1
        said = capfd.readouterr().err
        assert f'{path.name}: size and values are those of {columns} float32 a point' in said
