# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""--all of to-kitti, validate, stats, report and eval: units, findings, what is run again."""

from __future__ import annotations

import json
import os
import shutil

import pytest

from kitti_ros2.batch.manifest import MANIFEST, read_manifest
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import files_of  # isort: skip

BAD = 'bad'


@pytest.fixture(scope='module')
def source(tmp_path_factory, recordings):
    """Drives and bags, of which one is no bag; trajectories and detections, of which one is bad."""
    root = tmp_path_factory.mktemp('source')
    drive = recordings[Layout.RAW]
    date = root / 'data' / drive.parent.name
    date.mkdir(parents=True)
    shutil.copytree(drive / 'oxts', date / drive.name / 'oxts')
    for path in drive.parent.glob('calib_*.txt'):
        shutil.copy(path, date)
    bags = root / 'data' / 'bags'
    assert main(['to-bag', str(date / drive.name), str(bags / 'one.mcap'), '-q']) == 0
    words = ['--storage', 'sqlite3', '-q']
    assert main(['to-bag', str(date / drive.name), str(bags / 'more' / 'two'), *words]) == 0
    (bags / f'{BAD}.mcap').write_text('no bag\n')

    shutil.copytree(recordings[Layout.ODOMETRY] / 'poses', root / 'odometry' / 'poses')
    poses = (root / 'odometry' / 'poses' / '00.txt').read_text()
    (root / 'odometry' / 'poses' / '01.txt').write_text(poses)
    results = root / 'trajectories'
    for name in ('mine/00', 'mine/01', 'other/00'):
        (results / name).parent.mkdir(parents=True, exist_ok=True)
        (results / f'{name}.txt').write_text(poses)
    (results / BAD).mkdir()
    (results / BAD / '01.txt').write_text('no poses\n')

    labels = recordings[Layout.OBJECT] / 'training' / 'label_2'
    shutil.copytree(labels, root / 'object' / 'training' / 'label_2')
    calib = recordings[Layout.OBJECT] / 'training' / 'calib'
    shutil.copytree(calib, root / 'object' / 'training' / 'calib')
    for name in ('epoch_1', 'epoch_2/data', BAD):
        folder = root / 'detections' / name
        folder.mkdir(parents=True)
        for path in labels.iterdir():
            lines = path.read_text().splitlines()
            scored = ''.join(f'{line} 0.9\n' for line in lines)
            number = '000099.txt' if name == BAD else path.name  # a frame without labels
            (folder / number).write_text(scored)
    return root


def words_of(command, root, out):
    data = str(root / 'data')
    return {
        'to-kitti': ['to-kitti', f'{data}/bags', str(out)],
        'validate': ['validate', data, '-o', str(out)],
        'stats': ['stats', data, '-o', str(out)],
        'report': ['report', data, '-o', str(out)],
        'eval odometry': [
            'eval', 'odometry', f'{root}/odometry/poses', f'{root}/trajectories', '-o', str(out),
        ],
        'eval detection': [
            'eval', 'detection', f'{root}/object', f'{root}/detections', '-o', str(out),
        ],
    }[command]  # fmt: skip


UNITS = {
    'to-kitti': {'one', 'more/two', BAD},
    'validate': {'bags/one.mcap', 'bags/more/two', f'bags/{BAD}.mcap', '{drive}'},
    'stats': {'bags/one.mcap', 'bags/more/two', f'bags/{BAD}.mcap', '{drive}'},
    'report': {'bags/one.mcap', 'bags/more/two', f'bags/{BAD}.mcap', '{drive}'},
    'eval odometry': {'mine/00', 'mine/01', 'other/00', f'{BAD}/01'},
    'eval detection': {'epoch_1', 'epoch_2', BAD},
}
CHANGED = {
    'eval odometry': ('trajectories/other/00.txt', 'other/00'),
    'eval detection': ('detections/epoch_2/data/000000.txt', 'epoch_2'),
    'to-kitti': ('data/bags/one.mcap', 'one'),
}
DEFAULT_CHANGED = ('data/bags/one.mcap', 'bags/one.mcap')
GOOD = {
    'eval odometry': ('trajectories/mine/00.txt', f'trajectories/{BAD}/01.txt'),
    'eval detection': ('detections/epoch_1', f'detections/{BAD}'),
}
DEFAULT_GOOD = ('data/bags/one.mcap', f'data/bags/{BAD}.mcap')


def units_of(command, source):
    date = next((source / 'data').glob('20*'))
    drive = f'{date.name}/{next(each.name for each in date.iterdir() if each.is_dir())}'
    return {name.format(drive=drive) for name in UNITS[command]}


def records(out):
    return {each.name: each for each in read_manifest(out)[0]}


def ended(out):
    return {name: each.ended for name, each in records(out).items()}


def changed(before, after):
    return {name for name in after if before[name] != after[name]}


@pytest.fixture(params=sorted(UNITS))
def command(request):
    if request.param == 'eval odometry':
        pytest.importorskip('evo', reason='trajectories are scored by evo')
    return request.param


@pytest.mark.one_in(3)
def test_a_collection_with_a_bad_unit_is_done_once_and_then_what_changed(
    command, source, tmp_path, capsys
):
    root, out = tmp_path / 'root', tmp_path / 'out'
    shutil.copytree(source, root)
    words = [*words_of(command, root, out), '--all', '--jobs', '1', '-q']
    assert main(words) == 1
    complaint = capsys.readouterr()
    assert not complaint.out
    assert BAD in complaint.err
    assert 'Traceback' not in complaint.err
    assert 'internal error' not in complaint.err
    found = records(out)
    assert set(found) == units_of(command, source)
    bad = {name for name, each in found.items() if each.state == 'failed' or each.bad}
    assert {name for name in found if BAD in name} == bad
    first, files = ended(out), files_of(out)

    assert main(words) == 1, 'findings and failures of the first run are still there'
    assert capsys.readouterr().err == complaint.err
    assert ended(out) == first
    assert files_of(out).keys() == files.keys()
    assert main(['status', str(out)]) == 1
    shown = capsys.readouterr()
    assert f'{len(found) - (command != "validate")} done' in shown.out
    assert BAD in shown.err

    path, name = CHANGED.get(command, DEFAULT_CHANGED)
    os.utime(root / path, ns=(1, 1))
    assert main(words) == 1
    assert changed(first, ended(out)) == {name}

    second = ended(out)
    assert main([*words, '--retry']) == 1
    assert changed(second, ended(out)) == bad

    good, broken = (root / each for each in GOOD.get(command, DEFAULT_GOOD))
    shutil.rmtree(broken) if broken.is_dir() else broken.unlink()
    (shutil.copytree if good.is_dir() else shutil.copy)(good, broken)
    third = ended(out)
    assert main(words) == 0
    assert changed(third, ended(out)) == bad
    assert main(['status', str(out), '-q']) == 0


def test_outputs_are_those_of_the_plain_command(source, tmp_path, capsys):
    out = tmp_path / 'out'
    main([*words_of('validate', source, out), '--all', '--jobs', '2', '-q'])
    capsys.readouterr()
    bag = source / 'data' / 'bags' / 'one.mcap'
    main(['validate', str(bag), '--json'])
    plain = json.loads(capsys.readouterr().out)
    del plain['seconds']
    assert json.loads((out / 'bags' / 'one.mcap.json').read_text()) == plain

    assert main(['to-kitti', str(bag), str(tmp_path / 'plain'), '-q']) == 0
    glob = str(source / 'data' / '**' / 'on*.mcap')
    assert main(['to-kitti', glob, str(tmp_path / 'kitti'), '--all', '-q']) == 0
    assert files_of(tmp_path / 'kitti' / 'one') == files_of(tmp_path / 'plain')


def test_statistics_of_all_units_are_those_of_the_whole_root(source, tmp_path, capsys):
    out = tmp_path / 'out'
    main([*words_of('stats', source, out), '--all', '--jobs', '1', '--layout', 'raw', '--json'])
    together = json.loads(capsys.readouterr().out)
    assert main(['stats', str(source / 'data'), '--layout', 'raw', '--json']) == 0
    (plain,) = json.loads(capsys.readouterr().out)['sets']
    total = together['total']
    assert total['route'].pop('speed_m_s')['bins'] == plain['total']['route']['speed_m_s']['bins']
    assert total['route']['length_m'] == plain['total']['route']['length_m']
    assert total['samples'] == plain['total']['samples']
    assert len(together['units']) == 1, 'bags have no layout'
    lines = (out / 'statistics.csv').read_text().splitlines()
    assert f'{source}/data,,recording,,frames,{plain["total"]["frames"]}' in lines


def test_errors_of_several_trajectories_are_those_of_their_frames_together(
    source, tmp_path, capsys
):
    pytest.importorskip('evo', reason='trajectories are scored by evo')
    out = tmp_path / 'out'
    results = source / 'trajectories' / 'mine'
    words = ['eval', 'odometry', str(source / 'odometry' / 'poses'), str(results)]
    assert main([*words, '-o', str(out), '--all', '--jobs', '1', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['scores'].keys() == {'00', '01'}
    assert found['combined']['odometry']['all']['ape_m'] == pytest.approx(0, abs=1e-9)
    assert main([*words, '-o', str(out), '--all']) == 0
    assert 'all ' in capsys.readouterr().out


def test_results_and_ground_truth_without_a_counterpart_are_named(source, tmp_path, capsys):
    pytest.importorskip('evo', reason='trajectories are scored by evo')
    results = tmp_path / 'results'
    results.mkdir()
    for name in ('00', '77'):
        shutil.copy(source / 'trajectories' / 'mine' / '00.txt', results / f'{name}.txt')
    words = ['eval', 'odometry', str(source / 'odometry' / 'poses'), str(results)]
    assert main([*words, '-o', str(tmp_path / 'out'), '--all', '-q']) == 1
    complaint = capsys.readouterr().err
    assert '77.txt: has no ground truth' in complaint
    assert 'no result for 01' in complaint
    assert set(records(tmp_path / 'out')) == {'00'}


def test_an_output_inside_the_root_is_no_unit(source, tmp_path):
    root = tmp_path / 'root'
    shutil.copytree(source / 'data', root)
    (root / 'bags' / f'{BAD}.mcap').unlink()
    out = root / 'kitti'
    words = ['to-kitti', str(root), str(out), '--all', '--jobs', '1', '-q']
    assert main(words) == 0
    assert main(words) == 0
    assert set(records(out)) == {'bags/one', 'bags/more/two'}
    assert main(['validate', str(root), '-o', str(out), '--all', '-q']) == 2, 'another command'


@pytest.mark.parametrize(
    ('names', 'complaint'),
    [
        (('run.mcap', 'run.bag'), 'have the name run'),
        (('run.mcap', 'run/part.mcap'), 'would lie inside'),
    ],
)
def test_bags_whose_outputs_would_clash_are_one_line(names, complaint, source, tmp_path, capsys):
    for name in names:
        (tmp_path / 'bags' / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source / 'data' / 'bags' / 'one.mcap', tmp_path / 'bags' / name)
    assert main(['to-kitti', str(tmp_path / 'bags'), str(tmp_path / 'out'), '--all']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert complaint in line
    assert not (tmp_path / 'out').exists()


def test_a_bag_in_parts_is_one_unit(source, tmp_path):
    folder = tmp_path / 'bags' / 'run'
    folder.mkdir(parents=True)
    for number in (0, 1):
        shutil.copy(source / 'data' / 'bags' / 'one.mcap', folder / f'run_{number}.mcap')
    main(['validate', str(tmp_path / 'bags'), '-o', str(tmp_path / 'out'), '--all', '-q'])
    assert set(records(tmp_path / 'out')) == {'run'}


def test_lists_name_bags_and_recordings(source, tmp_path):
    listed = tmp_path / 'list.txt'
    bags = source / 'data' / 'bags'
    listed.write_text(f'{bags}/one.mcap  # a file\n{bags}/more/two\n')
    assert main(['stats', str(listed), '-o', str(tmp_path / 'out'), '--all', '-q']) == 0
    assert set(records(tmp_path / 'out')) == {'one.mcap', 'more/two'}


def test_a_folder_that_cannot_be_read_is_named(source, tmp_path, capsys, monkeypatch):
    closed = str(source / 'data' / 'bags' / 'more')
    scan = os.scandir

    def refuse(path='.'):
        if str(path) == closed:
            raise PermissionError(13, 'Permission denied', closed)
        return scan(path)

    monkeypatch.setattr(os, 'scandir', refuse)
    words = ['to-kitti', str(source / 'data' / 'bags'), str(tmp_path / 'out'), '--all', '-q']
    assert main([*words, '--jobs', '1']) == 1
    assert f'{closed}: Permission denied' in capsys.readouterr().err
    assert set(records(tmp_path / 'out')) == {'one', BAD}


@pytest.mark.parametrize('command', ['to-kitti', 'validate', 'stats', 'report'])
def test_a_root_without_units_is_one_line(command, tmp_path, capsys):
    (tmp_path / 'data' / 'bags').mkdir(parents=True)
    words = words_of(command, tmp_path, tmp_path / 'out')
    assert main([*words, '--all']) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['validate', 'x', '--all'], '-o OUT'),
        (['validate', 'x', '-o', 'y'], 'give --all too'),
        (['stats', 'x', '--all'], '-o OUT'),
        (['stats', 'x', '--all', '-o', 'y.png'], 'OUT is a folder'),
        (['stats', 'x', '--all', '-o', 'y', '--csv', 'z'], 'leave --csv out'),
        (['stats', 'x', '--all', '-o', 'y', '--sequence', '1'], 'give one of them'),
        (['report', 'x', '--all'], 'OUT is a folder'),
        (['report', 'x', '--all', '-o', 'y', '--predictions', 'z'], 'leave out --all'),
        (['report', 'x', '--jobs', '2'], 'give --all too'),
        (['to-kitti', 'x', '--all'], 'OUT is missing'),
        (['to-kitti', 'x', 'y', '--all', '--append'], '--append continues one'),
        (['to-kitti', 'x', 'y', '--all', '--plan'], 'leave out --all'),
        (['eval', 'detection', 'x', 'y', '--all'], '-o OUT'),
        (['eval', 'detection', 'x', 'y', '--retry'], 'give --all too'),
        (['eval', 'tracking', 'x', 'y', '-o', 'z'], 'give --all too'),
    ],
)
def test_options_that_do_not_go_together_are_one_line(words, complaint, capsys):
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert complaint in line


def test_an_index_links_all_pages(source, tmp_path):
    out = tmp_path / 'out'
    words = words_of('report', source, out)
    assert main([*words, '--all', '--layout', 'raw', '-q', '--jobs', '1']) == 0
    pages = {path.relative_to(out).as_posix() for path in out.rglob('*.html')} - {'index.html'}
    text = (out / 'index.html').read_text()
    assert pages
    assert all(f'href="./{page}"' in text for page in pages)
    assert MANIFEST not in text
