# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 crop: what it prints, mistakes, numbers that begin with a minus."""

from __future__ import annotations

import doctest
import json
import shutil

import pytest
from folder_and_bag import make_bag
from scans import files

from kitti_ros2 import datasets
from kitti_ros2.cli import main
from kitti_ros2.datasets import crop, cropping
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.datasets import make_crop_options

from builders import one_line  # isort: skip


@pytest.fixture
def source(recordings):
    return recordings[Layout.OBJECT]


def complain(words, capsys):
    """The one line that crop complains."""
    capsys.readouterr()
    assert main(['crop', *map(str, words)]) == 2
    return one_line(capsys.readouterr().err)


def test_the_summary_has_the_points_of_each_recording(source, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['crop', str(source), 'out', '--range', ':20']) == 0
    shared, scans, total = capsys.readouterr().out.splitlines()
    assert shared.startswith('note: ')
    assert shared.endswith('(hard links): who edits one changes both; --copy makes copies')
    assert scans.startswith('out/training/velodyne: 5 scans, ')
    assert scans.endswith(' %)')
    assert total.startswith('out: layout object, ')
    assert ' hard links, 0 copied files; took ' in total


def test_the_summary_as_json_is_the_report(source, tmp_path, capsys):
    words = ['crop', str(source), str(tmp_path / 'a'), '--json', '--empty-labels', 'drop']
    assert main([*words, '--box', '0', '-9', '-3', '30', '9', '2']) == 0
    found = json.loads(capsys.readouterr().out)
    options = {'box': [0, -9, -3, 30, 9, 2], 'empty_labels': 'drop'}
    report = crop(source, str(tmp_path / 'b'), **options)
    assert files(tmp_path / 'a') == files(tmp_path / 'b')
    (recording,) = found['recordings']
    assert recording['points_after'] == report.recordings[0].points_after > 0
    assert recording['labels_dropped'] == report.recordings[0].labels_dropped > 0
    assert found['losses'] == []


def test_the_example_runs(recordings, tmp_path, monkeypatch):
    date = tmp_path / '2011_09_26'
    shutil.copytree(recordings[Layout.RAW].parent, date)
    (date / recordings[Layout.RAW].name).rename(date / '2011_09_26_drive_0005_sync')
    monkeypatch.chdir(tmp_path)
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    failed, tried = doctest.testmod(cropping, optionflags=flags)
    assert (failed, tried) == (0, 2)
    assert datasets.crop is cropping.crop
    assert 'crop' in dir(datasets)


def test_an_interrupt_leaves_nothing(source, tmp_path, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr('kitti_ros2.datasets.scan_crop.kept_points', interrupted)
    assert main(['crop', str(source), str(tmp_path / 'out'), '--voxel', '1']) == 130
    assert 'interrupted' in one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_quiet_prints_nothing(source, tmp_path, capsys):
    assert main(['crop', str(source), str(tmp_path / 'a'), '-q', '--voxel', '0.5']) == 0
    assert capsys.readouterr() == ('', '')


def test_progress_counts_the_scans(source, tmp_path):
    seen = []
    crop(source, tmp_path / 'a', voxel=1, progress=lambda *done: seen.append(done))
    assert seen == [(done, 5) for done in range(1, 6)]


@pytest.mark.parametrize(
    'words',
    [
        '{src} {out} --box -1 -2 -3 4 5 6',
        '--box -1 -2 -3 4 5 6 -- {src} {out}',
        '--box -1 -2 -3 4 5 6 {src} {out}',
        '--box -1,-2,-3,4,5,6 --range :90 {src} {out}',
        '{src} {out} --box=-1,-2,-3,4,5,6',
        '{src} --box -1 -2 -.3e1 4 5 6 --height -90:90 {out}',
    ],
)
def test_numbers_of_boxes_may_be_negative(words, source, tmp_path):
    out = tmp_path / 'out'
    assert main(['crop', '-q', *words.format(src=source, out=out).split()]) == 0
    crop(source, tmp_path / 'same', box=(-1, -2, -3, 4, 5, 6))
    assert files(out) == files(tmp_path / 'same')


def test_several_boxes():
    boxes = ((0, 0, 0, 1, 1, 1), (-5, -5, -5, 5, 5, 5))
    for given in ([*boxes], [*boxes[0], *boxes[1]], '0 0 0 1 1 1 -5,-5,-5,5,5,5'):
        assert make_crop_options({'box': given}).boxes == boxes


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('--box 1 2 3 4 5', 'box takes six numbers in metres for each box'),
        ('--box 0 0 0 1 1 x', 'box takes six numbers'),
        ('--box 5 0 0 1 1 1', 'the box 5 0 0 1 1 1 is empty'),
        ('--box 0 0 0 nan 1 1', 'is empty'),
        ('--range 80:5', 'the range 80:5 is empty'),
        ('--range 80', "range takes MIN:MAX in metres, such as 0.5:80 or :80, not '80'"),
        ('--range :', 'range takes MIN:MAX'),
        ('--range 1:2:3', 'range takes MIN:MAX'),
        ('--height a:b', 'height takes MIN:MAX'),
        ('--height nan:1', 'is empty'),
        ('--lasers 20', '20 lasers; expected 32 or 16 of 64'),
        ('--voxel 0', 'a voxel of 0 m; expected at least 0.001'),
        ('--voxel inf', 'a voxel of inf m'),
        ('--voxel nan', 'a voxel of nan m'),
        ('--view front', "view takes reference or reduced, not 'front'"),
        ('--camera 2', '--camera goes with --view'),
        ('--image-size 10x10', '--image-size goes with --view'),
        ('--view reduced --image-size 10', '--image-size takes WIDTHxHEIGHT'),
        ('--view reduced --image-size 0x9', '--image-size takes WIDTHxHEIGHT'),
        ('--view reduced --camera -1', 'camera -1 is negative'),
        ('--view reduced --camera 7', 'no scan can be cut; '),
        ('--folder image_2', "the folder 'image_2' is no name for scans"),
        ('--folder ../velodyne_reduced', 'is no name for scans'),
        ('--folder velodyne/../x', 'is no name for scans'),
        ('--empty-labels no', "--empty-labels takes keep or drop, not 'no'"),
        ('--sequence testing', "no sequence 'testing'"),
        ('--layout raw', 'no raw recording'),
        ('--boxes 1', 'there is no option --boxes; did you mean --box?'),
    ],
)
def test_invalid_options(words, said, source, tmp_path, capsys):
    assert said in complain([source, tmp_path / 'out', *words.split()], capsys)
    assert not list(tmp_path.iterdir())


def test_a_camera_that_is_missing_is_said_with_those_that_are_there(source, tmp_path, capsys):
    line = complain([source, tmp_path / 'out', '--view', 'reduced', '--camera', '7'], capsys)
    assert 'no calibration of camera 7 (there is: 0, 1, 2, 3)' in line


def test_sources_that_are_none(source, tmp_path, capsys):
    out = tmp_path / 'out'
    assert 'no such file or folder' in complain([tmp_path / 'none', out], capsys)
    (tmp_path / 'empty').mkdir()
    assert 'the folder is empty' in complain([tmp_path / 'empty', out], capsys)
    line = complain([source / 'training/velodyne', out, '--range', ':9'], capsys)
    assert f'give {source}/training: kitti-ros2 crop {source}/training {out}' in line
    line = complain([source / 'training/velodyne/000000.bin', out], capsys)
    assert 'is a file of frame 0 of a KITTI object data set' in line
    assert 'OUT is missing' in complain([source], capsys)
    assert not out.exists()


def test_a_bag_is_refused_with_the_way_to_kitti(recordings, tmp_path, capsys):
    bag = make_bag(recordings[Layout.RAW], tmp_path / 'bags')
    line = complain([bag, tmp_path / 'out', '--range', ':9'], capsys)
    assert f'{bag}: is a bag (mcap), not a KITTI folder' in line
    assert f'kitti-ros2 to-kitti {bag} {tmp_path}/out' in line


def test_a_set_without_scans(source, tmp_path, capsys):
    root = tmp_path / 'object'
    shutil.copytree(source, root)
    shutil.rmtree(root / 'training' / 'velodyne')
    assert f'{root}: no scans' in complain([root, tmp_path / 'out', '--range', ':9'], capsys)


def test_outputs_that_exist_or_lie_in_the_source(source, tmp_path, capsys):
    root = tmp_path / 'data' / 'object'
    shutil.copytree(source, root)
    before = files(tmp_path)
    assert 'lies inside the recording' in complain([root, root / 'training/out'], capsys)
    assert 'lies inside the recording' in complain([root, root], capsys)
    line = complain([root / 'training', tmp_path / 'data', '--overwrite'], capsys)
    assert f'{tmp_path}/data: contains the source' in line
    other = tmp_path / 'other'
    other.mkdir()
    (other / 'file').write_text('mine')
    before[f'{other.name}/file'] = b'mine'
    words = [root, other, '--range', ':9']
    refusal = 'exists already; it is no KITTI data set, so --overwrite does not touch it; choose'
    assert refusal in complain(words, capsys)
    assert refusal in complain([*words, '--overwrite'], capsys)
    assert files(tmp_path) == before


def test_overwriting_replaces_the_set(source, tmp_path):
    out = tmp_path / 'out'
    assert main(['crop', str(source), str(out), '-q', '--range', ':9']) == 0
    assert main(['crop', str(source), str(out), '-q', '--range', ':20']) == 2
    assert main(['crop', str(source), str(out), '-q', '--range', ':20', '--overwrite']) == 0
    crop(source, tmp_path / 'same', range=':20')
    assert files(out) == files(tmp_path / 'same')
