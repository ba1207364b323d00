# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is checked: all recordings and bags at several paths, by real and synthetic data."""

from __future__ import annotations

import json
import shutil

import pytest
from folder_and_bag import make_bag, make_holes

from kitti_ros2.cli import main
from kitti_ros2.datasets import validate
from kitti_ros2.model.errors import KittiRos2Error, MissingSourceError, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.validation import rule
from kitti_ros2.validation import validate as checked
from kitti_ros2.validation.rule import FindingTally
from kitti_ros2.validation.validate import rules_by_id

from builders import one_line  # isort: skip


@pytest.fixture(scope='module')
def root(recordings, tmp_path_factory):
    """Two drives of a date, two sequences, two splits, and a bag."""
    root = tmp_path_factory.mktemp('root')
    for layout, path in recordings.items():
        whole = path.parent if layout is Layout.RAW else path
        below = whole.name if layout is Layout.RAW else ''
        shutil.copytree(whole, root / layout.value / below)
    drive = root / 'raw' / recordings[Layout.RAW].parent.name / recordings[Layout.RAW].name
    shutil.copytree(drive, drive.with_name('2011_09_26_drive_0002_sync'))
    odometry = root / 'odometry'
    shutil.copytree(odometry / 'sequences/00', odometry / 'sequences/01')
    shutil.copy(odometry / 'poses/00.txt', odometry / 'poses/01.txt')
    split = root / 'object' / 'training'
    shutil.copytree(split, split.with_name('testing'))
    make_bag(drive, root / 'bags', 'mcap')
    return root


def names(report):
    return sorted(each.name for each in report.sources)


def test_everything_below_a_folder_is_checked(root):
    report = validate(root)
    assert report.ok
    drives = ['2011_09_26_drive_0001_sync', '2011_09_26_drive_0002_sync']
    drives.append('2013_05_28_drive_0000_sync')
    assert names(report) == ['00', '0000', '01', *drives, 'bag.mcap', 'testing', 'training']
    assert names(validate(root / 'bags')) == ['bag.mcap']


def test_all_layouts_of_a_folder_and_those_below_are_checked(recordings, tmp_path, capsys):
    """Dates of raw drives beside the parts of KITTI-360, an object set in a folder of its own."""
    for path in (recordings[Layout.RAW].parent, *recordings[Layout.KITTI_360].iterdir()):
        shutil.copytree(path, tmp_path / 'both' / path.name)
    shutil.copytree(recordings[Layout.OBJECT], tmp_path / 'both' / 'object')
    raw, kitti360 = '2011_09_26_drive_0001_sync', '2013_05_28_drive_0000_sync'
    for path in (tmp_path / 'both', tmp_path):
        assert names(validate(path)) == [raw, kitti360, 'training']
    assert names(validate(tmp_path / 'both', layout='kitti360')) == [kitti360]
    assert names(validate(tmp_path / 'both' / 'data_2d_raw')) == [kitti360]
    main(['validate', str(tmp_path / 'both'), '--quick'])
    said = capsys.readouterr().out
    assert f'both kitti360 {kitti360}: ' in said
    assert f'{raw} raw: ' in said


def test_several_paths_are_checked_once_each(root):
    report = validate([root / 'odometry', root / 'bags', root / 'odometry'])
    assert names(report) == ['00', '01', 'bag.mcap']


def test_a_sequence_can_be_chosen(root):
    assert names(validate(root / 'odometry', sequence='1')) == ['01']
    assert names(validate(root / 'raw', layout='raw')) == [
        '2011_09_26_drive_0001_sync',
        '2011_09_26_drive_0002_sync',
    ]


def test_bags_in_a_folder_are_checked_each_for_itself(root, tmp_path):
    for name in ('a.mcap', 'b.mcap'):
        shutil.copy(root / 'bags/bag.mcap', tmp_path / name)
    make_bag(root / 'tracking', tmp_path, 'sqlite3')
    assert names(validate(tmp_path)) == ['a.mcap', 'b.mcap', 'bag']


def test_parts_of_a_bag_without_metadata_are_one_bag(root, tmp_path):
    folder = tmp_path / 'run'
    folder.mkdir()
    shutil.copy(root / 'bags/bag.mcap', folder / 'run_0.mcap')
    report = validate(folder)
    assert names(report) == ['run']
    assert {each.rule for each in report.findings} == {'bag-folder'}


@pytest.mark.parametrize('layout', list(Layout))
def test_holes_are_warnings_with_their_numbers(recordings, layout, tmp_path):
    report = validate(make_holes(recordings[layout], layout, tmp_path))
    found = [each for each in report.findings if each.rule == 'frames-missing']
    assert found
    assert all('frames ' in each.message for each in found)
    if layout is not Layout.OBJECT:  # its lists are of the frames before
        assert report.ok


def test_a_recording_that_cannot_be_opened_is_an_error(root, tmp_path):
    copy = tmp_path / 'odometry'
    shutil.copytree(root / 'odometry', copy)
    shutil.rmtree(copy / 'sequences/01/velodyne')
    (copy / 'sequences/01/velodyne').symlink_to('velodyne')
    report = validate(copy)
    (found,) = (each for each in report.findings if each.rule == 'source-open')
    assert copy / 'sequences/01' in (found.path, *found.path.parents)
    assert '00' in names(report)


def test_a_search_that_ends_early_is_a_warning(root, monkeypatch):
    found = checked.data_sets_below(root)[0]
    monkeypatch.setattr(checked, 'data_sets_below', lambda *_: (found, False))
    assert 'source-large' in {each.rule for each in validate(root).findings}


def test_errors_of_usage(root, tmp_path):
    with pytest.raises(MissingSourceError, match='no such file or folder'):
        validate(tmp_path / 'absent')
    with pytest.raises(KittiRos2Error, match='the folder is empty'):
        validate(tmp_path)
    with pytest.raises(UsageError, match='no path'):
        validate([])
    with pytest.raises(UsageError, match='leave --decode out'):
        validate(root, quick=True, decode=True)
    with pytest.raises(UsageError, match="unknown option 'quik'; did you mean quick"):
        validate(root, quik=True)
    (tmp_path / 'a.txt').write_text('x')
    with pytest.raises(KittiRos2Error, match='is a file of another kind'):
        validate(tmp_path / 'a.txt')


def test_a_part_of_a_data_set_names_the_whole(root):
    with pytest.raises(KittiRos2Error, match='is a folder of a KITTI object data set'):
        validate(root / 'object/training/image_2')


def test_findings_are_counted_beyond_those_that_are_kept(monkeypatch, tmp_path):
    monkeypatch.setattr('kitti_ros2.validation.rule.MOST_FINDINGS', 10)
    tally = FindingTally(rules_by_id(bags=False))
    tally.add(('scan-size', rule.Breach(f'{number}', tmp_path)) for number in range(25))
    tally.add([('scan-size', rule.Breach('3', tmp_path))])
    report = tally.report([])
    assert (report.errors, len(report.findings)) == (25, 10)


def run(capsys, *words):
    code = main(['validate', *map(str, words)])
    return code, *capsys.readouterr()


def test_the_command_prints_findings_by_rule(root, tmp_path, capsys):
    copy = tmp_path / 'object'
    shutil.copytree(root / 'object', copy)
    (copy / 'training/velodyne/000001.bin').write_bytes(b'')
    code, out, err = run(capsys, copy)
    assert code == 1
    assert 'error file-empty (1): Files are not empty\n' in out
    assert f'  {copy}/training/velodyne/000001.bin: the file is empty\n' in out
    assert '  -> copy or download the file again\n' in out
    assert one_line(err).startswith('kitti-ros2: 1 error, 0 warnings, ')
    assert err.endswith('; exit code 1\n')
    code, out, err = run(capsys, copy, '-q')
    assert (code, out) == (1, '')
    assert err.splitlines()[0].startswith(f'error file-empty: {copy}/training/velodyne/000001.bin')
    code, out, _ = run(capsys, copy, '--json')
    values = json.loads(out)
    assert (code, values['ok'], values['errors']) == (1, False, 1)
    (found,) = values['rules'][0]['findings']
    assert (found['rule'], found['severity'], found['line']) == ('file-empty', 'error', None)


def test_the_command_succeeds_without_errors(root, capsys):
    code, out, err = run(capsys, root / 'raw', root / 'bags/bag.mcap')
    assert (code, err) == (0, '')
    assert out.splitlines()[-1].startswith('0 errors, 0 warnings, ')
    assert run(capsys, root / 'raw', '-q') == (0, '', '')


def test_real_samples_have_no_errors(real_kitti):
    for folder in ('object', 'raw', 'odometry', 'tracking', 'semantickitti'):
        report = validate(real_kitti / folder, decode=True)
        assert report.ok, [each.place for each in report.findings if each.severity == 'error']
        warnings = {each.rule for each in report.findings if each.severity == 'warning'}
        assert warnings <= {'frames-missing', 'calib-missing'}


def test_real_bags_have_no_errors(real_kitti):
    assert validate(real_kitti / 'bags').ok
