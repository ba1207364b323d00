# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Data sets that crop writes: layouts, links, labels, damaged files."""

from __future__ import annotations

import errno
import os
import shutil
import warnings
from fnmatch import fnmatch

import numpy as np
import pytest
from folder_and_bag import make_holes
from hypothesis import HealthCheck, given, settings
from moving_scanner import Bend, write_bend
from scans import files, spans

import kitti_ros2
from kitti_ros2.cli import main
from kitti_ros2.datasets import crop
from kitti_ros2.kitti.names import RAW_SCANS, parse_drive
from kitti_ros2.kitti.opening import open_recording, open_recordings
from kitti_ros2.kitti.scan_grid import compensated, on_grid
from kitti_ros2.model.boxes import DONT_CARE
from kitti_ros2.model.errors import UnreadableFileError, UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.read import ReadOptions

from builders import SMALL  # isort: skip

SCAN = {
    Layout.RAW: '2011_09_26/2011_09_26_drive_0001_sync/velodyne_points/data/{:010d}.bin',
    Layout.OBJECT: 'training/velodyne/{:06d}.bin',
    Layout.ODOMETRY: 'sequences/00/velodyne/{:06d}.bin',
    Layout.TRACKING: 'training/velodyne/0000/{:06d}.bin',
    Layout.KITTI_360: 'data_3d_raw/2013_05_28_drive_0000_sync/velodyne_points/data/{:010d}.bin',
}
"""By layout the file of a scan below the root."""
AHEAD = [0, -5, -3, 30, 5, 2]


@pytest.fixture(params=list(Layout), ids=[layout.value for layout in Layout])
def layout(request):
    return request.param


@pytest.fixture
def holed(layout, recordings, tmp_path):
    """A recording with holes in its numbers."""
    return make_holes(recordings[layout], layout, tmp_path / 'holed')


def root_of(source, layout):
    return source.parents[1] if layout is Layout.RAW else source


def cut(*args, **options):
    """Crop, with its losses instead of warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', kitti_ros2.KittiRos2Warning)
        return crop(*args, **options)


def points_in(data):
    return np.frombuffer(data, '<f4').reshape(-1, 4)


def test_without_a_filter_nothing_is_written(recordings, tmp_path):
    for options in ({}, {'copy': True}, {'folder': 'velodyne_same'}):
        with pytest.raises(UsageError, match='without a filter would write all scans unchanged'):
            crop(recordings[Layout.OBJECT], tmp_path / 'out', **options)
    assert not list(tmp_path.iterdir())


def test_with_all_points_left_the_tree_is_the_same(holed, layout, tmp_path):
    report = cut(holed, tmp_path / 'out', range=':1000')
    source = files(root_of(holed, layout))
    assert files(tmp_path / 'out') == source
    (result,) = report.recordings
    assert (result.linked, result.copied, result.size_bytes) == (len(source), 0, 0)
    assert result.points_before == result.points_after > 0
    shared = f'{len(source)} unchanged files shared with {holed} (hard links): who edits one'
    assert shared in ' '.join(report.notes)
    for path in (tmp_path / 'out').rglob('*.*'):
        assert path.is_symlink() is False
        if path.is_file():
            assert path.samefile(root_of(holed, layout) / path.relative_to(tmp_path / 'out'))


def test_a_cut_changes_the_scans_and_nothing_else(holed, layout, tmp_path):
    report = cut(holed, tmp_path / 'out', box=AHEAD)
    source, made = files(root_of(holed, layout)), files(tmp_path / 'out')
    assert made.keys() == source.keys()
    scans = {name for name in source if name.endswith('.bin')}
    assert {name for name in source if made[name] != source[name]} == scans
    low, high = np.array(AHEAD[:3]), np.array(AHEAD[3:])
    for name in scans:
        points = points_in(source[name])
        inside = ((points[:, :3] >= low) & (points[:, :3] <= high)).all(axis=1)
        assert 0 < inside.sum() < len(points)
        assert made[name] == points[inside].tobytes()
    (result,) = report.recordings
    assert result.scans == len(scans)
    assert result.points_after == sum(len(made[name]) for name in scans) // 16
    assert result.size_bytes == sum(len(made[name]) for name in scans)


@pytest.mark.parametrize('rule', ['reference', 'reduced'])
def test_a_view_is_that_of_the_frame(rule, recordings, layout, tmp_path):
    source = recordings[layout]
    camera = layout.traits.main_camera + (rule == 'reference')
    cut(source, tmp_path / 'out', view=rule, camera=camera)
    recording = open_recording(source)
    for number in recording.streams[Stream.SCAN].numbers.tolist():
        u, v, depth = project(recording, number, camera)
        width, height = SMALL.image_size
        points = recording.read(Stream.SCAN, number).points
        if rule == 'reduced':
            seen = (depth > 0.001) & (depth < 100)
        else:
            u, v, seen = np.round(u), np.round(v), (points[:, 3] > 0) & (depth >= 0)
        seen &= (u > 0) & (u < width) & (v > 0) & (v < height)
        assert 0 < seen.sum() < len(points)
        made = (tmp_path / 'out' / SCAN[layout].format(number)).read_bytes()
        assert made == points[seen].tobytes()


def project(recording, number, camera):
    """u, v and depth of a scan's points, as the devkits compute them."""
    found = recording.calibration(number)
    points = recording.read(Stream.SCAN, number).points[:, :3].astype(np.float64)
    rect = found.cam0_T_velo.apply(points) @ found.r0_rect.T
    seen = np.column_stack([rect, np.ones(len(rect))]) @ found.cameras[camera].p_rect.T
    with np.errstate(divide='ignore', invalid='ignore'):
        return seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2], seen[:, 2]


@given(span=spans)
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_cutting_twice_is_cutting_once(recordings, tmp_path, span):
    shutil.rmtree(tmp_path / 'out', ignore_errors=True)
    options = {'height': span, 'range': (1, 40), 'voxel': 0.5, 'view': 'reduced'}
    cut(recordings[Layout.OBJECT], tmp_path / 'out/a', **options)
    cut(tmp_path / 'out/a', tmp_path / 'out/b', **options)
    assert files(tmp_path / 'out/b') == files(tmp_path / 'out/a')


def test_lasers_are_thinned_and_then_left_as_they_are(recordings, layout, tmp_path):
    once = cut(recordings[layout], tmp_path / 'a', lasers=16)
    twice = cut(
        tmp_path / 'a' / SCAN[layout].split('/')[0] if layout is Layout.RAW else tmp_path / 'a',
        tmp_path / 'b',
        lasers=16,
    )
    assert files(tmp_path / 'a') == files(tmp_path / 'b')
    assert 0.2 < once.recordings[0].points_after / once.recordings[0].points_before < 0.3
    assert twice.recordings[0].size_bytes == 0


def test_readers_read_the_result(holed, layout, tmp_path, capsys):
    out = tmp_path / 'out'
    cut(holed, out, view='reduced', image_size=SMALL.image_size, range=':60', height=(-3, 3))
    source = out / holed.relative_to(root_of(holed, layout))
    numbers = open_recording(holed).streams[Stream.SCAN].numbers.tolist()
    assert open_recording(source).streams[Stream.SCAN].numbers.tolist() == numbers
    with pytest.warns(kitti_ros2.KittiRos2Warning):
        opened = kitti_ros2.open(source)
    assert len(opened[opened.numbers.tolist().index(numbers[0])].points) > 0
    assert main(['info', str(source), '--json']) == main(['info', str(holed), '--json'])
    words = ['to-bag', str(source), str(tmp_path / 'bag.mcap'), '-q', '--exclude-topics', '*image*']
    assert main(words) == main(
        ['to-bag', str(holed), str(tmp_path / 'b.mcap'), '-q', '--exclude-topics', '*image*']
    )
    picture = tmp_path / 'picture.png'
    words = ['--frame', str(numbers[0]), '--mode', 'bev', '-q']
    assert main(['view', str(source), '-o', str(picture), *words]) == 0
    assert picture.stat().st_size > 1000
    capsys.readouterr()


def test_a_set_given_deeper_makes_the_same_tree(recordings, layout, tmp_path):
    root = root_of(recordings[layout], layout)
    cut(root, tmp_path / 'whole', box=AHEAD)
    cut(root / SCAN[layout].rsplit('/velodyne', 1)[0], tmp_path / 'deep', box=AHEAD)
    assert files(tmp_path / 'deep') == files(tmp_path / 'whole')


# Whole sets, and parts of them.


@pytest.fixture
def drives(recordings, tmp_path):
    """A folder with two drives of a date."""
    root = tmp_path / 'raw'
    shutil.copytree(recordings[Layout.RAW].parents[1], root)
    first = root / '2011_09_26' / recordings[Layout.RAW].name
    shutil.copytree(first, first.with_name('2011_09_26_drive_0002_sync'))
    return root


def test_all_drives_are_cut_or_the_chosen_one(drives, tmp_path):
    report = cut(drives, tmp_path / 'all', box=AHEAD)
    assert [parse_drive(each.name)[1] for each in report.recordings] == [1, 2]
    assert files(tmp_path / 'all').keys() == files(drives).keys()
    cut(drives, tmp_path / 'one', box=AHEAD, sequence='2')
    one, both = files(tmp_path / 'one'), files(tmp_path / 'all')
    assert one == {name: data for name, data in both.items() if 'drive_0001' not in name}


def test_drives_that_share_a_folder_of_calibration_are_cut(recordings, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(recordings[Layout.KITTI_360], root)
    for drive in sorted(root.glob('data_*/*drive*')):
        shutil.copytree(drive, drive.with_name('2013_05_28_drive_0007_sync'))
    report = cut(root, tmp_path / 'all', box=AHEAD)
    assert [parse_drive(each.name)[1] for each in report.recordings] == [0, 7]
    assert files(tmp_path / 'all').keys() == files(root).keys()


def test_both_splits_are_cut_and_lists_are_kept(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    shutil.copytree(root / 'training', root / 'testing')
    shutil.rmtree(root / 'testing' / 'label_2')
    report = cut(root, tmp_path / 'out', box=AHEAD)
    assert sorted(each.name for each in report.recordings) == ['testing', 'training']
    assert files(tmp_path / 'out').keys() == files(root).keys()
    cut(root, tmp_path / 'one', box=AHEAD, sequence='testing')
    assert not (tmp_path / 'one' / 'training').exists()
    assert files(tmp_path / 'one' / 'ImageSets') == files(root / 'ImageSets')


def test_files_of_no_recording_are_left_out_and_noted(recordings, layout, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(root_of(recordings[layout], layout), root)
    assert not [note for note in cut(root, tmp_path / 'a', box=AHEAD).notes if 'left out' in note]
    inner = SCAN[layout].split('/')[0]
    for name in ('infos.pkl', 'devkit/readme.txt', '.hidden', f'{inner}/notes.txt'):
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text('')
    report = cut(root, tmp_path / 'out', box=AHEAD)
    shown = 'devkit, infos.pkl'
    if layout is not Layout.OBJECT:  # there the split is the recording
        shown = ', '.join(sorted(['devkit', 'infos.pkl', f'{inner}/notes.txt']))
    assert [note for note in report.notes if 'left out' in note] == [
        f'{root}: {shown} left out, as part of no recording'
    ]
    made = files(tmp_path / 'out').keys()
    assert made - files(tmp_path / 'a').keys() == (
        {f'{inner}/notes.txt'} if layout is Layout.OBJECT else set()
    )


def test_a_split_without_scans_is_linked_and_noted(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    shutil.copytree(root / 'training/image_2', root / 'testing/image_2')
    report = cut(root, tmp_path / 'out', box=AHEAD)
    assert files(tmp_path / 'out').keys() == files(root).keys()
    assert not (tmp_path / 'out/testing/velodyne').exists()
    assert f'{root}/testing/velodyne: no scans; the other files are unchanged' in report.notes


def test_a_sequence_of_tracking_has_its_files_alone(recordings, tmp_path):
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    for path in sorted((root / 'training').glob('*/0000*')):
        copy = path.with_name(path.name.replace('0000', '0011'))
        shutil.copytree(path, copy) if path.is_dir() else shutil.copy(path, copy)
    report = cut(root, tmp_path / 'out', box=AHEAD, sequence='11')
    assert [each.folder for each in report.recordings] == ['training/velodyne/0011']
    made = files(tmp_path / 'out')
    assert made
    assert made.keys() == {name for name in files(root) if '0011' in name}


def test_sequences_of_tracking_with_cut_scans_beside(recordings, tmp_path):
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    shutil.copytree(root / 'training/velodyne/0000', root / 'training/velodyne/0001')
    cut(root, tmp_path / 'out', box=AHEAD, folder='velodyne_ahead')
    cut(root, tmp_path / 'other', box=AHEAD)
    made, other = files(tmp_path / 'out/training'), files(tmp_path / 'other/training/velodyne')
    assert {f'velodyne_ahead/{name}': data for name, data in other.items()} == {
        name: data for name, data in made.items() if name.startswith('velodyne_ahead')
    }
    assert {name for name in made if 'velodyne_ahead' not in name} == files(
        root / 'training'
    ).keys()


def test_a_split_of_another_name_stays_readable(recordings, tmp_path):
    shutil.copytree(recordings[Layout.OBJECT] / 'training', tmp_path / 'mine')
    cut(tmp_path / 'mine', tmp_path / 'out', box=AHEAD)
    assert files(tmp_path / 'out').keys() == files(tmp_path / 'mine').keys()
    assert len(open_recordings(tmp_path / 'out')) == 1


# Hard links, copies, and folders beside.


def test_copies_are_independent(recordings, layout, tmp_path):
    report = cut(recordings[layout], tmp_path / 'out', range=':20', copy=True)
    assert report.recordings[0].linked == 0
    assert report.recordings[0].copied > 0
    made = [path for path in (tmp_path / 'out').rglob('*') if path.is_file()]
    assert {path.stat().st_nlink for path in made} == {1}


def test_where_links_are_impossible_files_are_copied_and_that_is_said(
    recordings, tmp_path, monkeypatch
):
    def refuse(*_):
        raise OSError(18, 'Invalid cross-device link')

    monkeypatch.setattr(os, 'link', refuse)
    report = cut(recordings[Layout.OBJECT], tmp_path / 'out', range=':1000')
    assert files(tmp_path / 'out') == files(recordings[Layout.OBJECT])
    count = report.recordings[0].copied
    assert f'{count} files copied, not hard-linked: they are on another file system' in report.notes


def test_links_to_folders_and_files_become_files(recordings, tmp_path):
    root = tmp_path / 'object'
    (root / 'training').mkdir(parents=True)
    for folder in (recordings[Layout.OBJECT] / 'training').iterdir():
        if folder.name == 'calib':
            (root / 'training' / 'calib').mkdir()
            for path in folder.iterdir():
                (root / 'training' / 'calib' / path.name).symlink_to(path)
        else:
            (root / 'training' / folder.name).symlink_to(folder)
    cut(root, tmp_path / 'out', range=':20')
    training = recordings[Layout.OBJECT] / 'training'
    assert files(tmp_path / 'out/training').keys() == files(training).keys()
    assert not any(path.is_symlink() for path in (tmp_path / 'out').rglob('*'))


def test_scans_beside_the_unchanged_ones(holed, layout, tmp_path):
    report = cut(holed, tmp_path / 'out', view='reduced', folder='velodyne_reduced')
    cut(holed, tmp_path / 'other', view='reduced')
    source, made, other = (
        files(each) for each in (root_of(holed, layout), tmp_path / 'out', tmp_path / 'other')
    )
    assert source.items() <= made.items()
    own = 'velodyne_points' if f'/{RAW_SCANS}/' in SCAN[layout] else 'velodyne'
    beside = {name: data for name, data in other.items() if f'/{own}/' in name}
    assert {name: made[name] for name in made.keys() - source.keys()} == {
        name.replace(own, 'velodyne_reduced'): data for name, data in beside.items()
    }
    assert '/velodyne_reduced' in f'/{report.recordings[0].folder}'


def test_an_older_folder_beside_is_replaced(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    older = root / 'training' / 'velodyne_reduced'
    older.mkdir()
    for name in ('000000.bin', '000077.bin'):
        (older / name).write_bytes(b'older' * 16)
    report = cut(root, tmp_path / 'out', range=':20', folder='velodyne_reduced')
    made = files(tmp_path / 'out' / 'training' / 'velodyne_reduced')
    assert sorted(made) == [f'{number:06d}.bin' for number in range(5)]
    assert b'older' not in made['000000.bin']
    assert (older / '000000.bin').read_bytes() == b'older' * 16
    assert not [note for note in report.notes if 'velodyne_reduced' in note]
    report = cut(root, tmp_path / 'more', range=':20')
    assert [note for note in report.notes if 'velodyne_reduced: unchanged' in note]


def test_an_older_folder_of_a_sequence_is_replaced(recordings, tmp_path):
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    older = root / 'training/velodyne_near'
    shutil.copytree(root / 'training/velodyne', older)
    cut(root, tmp_path / 'out', range=':20', folder='velodyne_near')
    cut(root, tmp_path / 'other', range=':20')
    assert files(tmp_path / 'out/training/velodyne_near') == files(
        tmp_path / 'other/training/velodyne'
    )


# Labels of points.


@pytest.fixture
def sequence(recordings, tmp_path):
    """An odometry set with labels of points, and predictions for two scans."""
    root = tmp_path / 'odometry'
    shutil.copytree(recordings[Layout.ODOMETRY], root)
    folder = root / 'sequences' / '00'
    for name in ('labels', 'predictions'):
        (folder / name).mkdir()
    for scan in sorted((folder / 'velodyne').iterdir()):
        count = scan.stat().st_size // 16
        (folder / 'labels' / f'{scan.stem}.label').write_bytes(np.arange(count, dtype='<u4'))
    for number in range(2):
        shutil.copy(folder / f'labels/{number:06d}.label', folder / 'predictions')
    return root


def test_labels_of_points_are_cut_in_step(sequence, tmp_path):
    cut(sequence, tmp_path / 'out', box=AHEAD, voxel=1)
    for folder, count in (('labels', 5), ('predictions', 2)):
        made = sorted((tmp_path / 'out/sequences/00' / folder).iterdir())
        assert len(made) == count
        for path in made:
            rows = np.frombuffer(path.read_bytes(), '<u4')
            before, after = (
                points_in((root / f'sequences/00/velodyne/{path.stem}.bin').read_bytes())
                for root in (sequence, tmp_path / 'out')
            )
            assert before[rows].tobytes() == after.tobytes()
    assert main(['info', str(tmp_path / 'out'), '-q']) == 0


def test_labels_of_another_length_are_left_out_and_named(sequence, tmp_path):
    path = sequence / 'sequences/00/labels/000002.label'
    path.write_bytes(path.read_bytes()[:-4])
    report = cut(sequence, tmp_path / 'out', box=AHEAD)
    (loss,) = report.losses
    assert loss.stream == 'labels'
    assert str(path) in loss.text()
    assert not (tmp_path / 'out/sequences/00/labels/000002.label').exists()
    assert (tmp_path / 'out/sequences/00/velodyne/000002.bin').exists()


def test_labels_of_a_scan_that_is_left_out_are_named(sequence, tmp_path):
    path = sequence / 'sequences/00/velodyne/000003.bin'
    path.write_bytes(path.read_bytes()[:-1])
    report = cut(sequence, tmp_path / 'out', box=AHEAD)
    (loss,) = report.losses
    assert loss.text().endswith('the labels of its points are left out, too')
    assert not list((tmp_path / 'out').rglob('000003.label'))


def test_labels_of_points_stay_with_the_unchanged_scans(sequence, tmp_path):
    report = cut(sequence, tmp_path / 'out', box=AHEAD, folder='velodyne_ahead')
    source, made = files(sequence), files(tmp_path / 'out')
    assert source.items() <= made.items()
    assert any('labels, predictions unchanged' in note for note in report.notes)


# Labels of objects.

LINES = (
    'Car 0.00 0 0.00 1.00 1.00 9.00 9.00 2.00 2.00 4.00 {x} 1.00 {z} 0.00',
    'DontCare -1 -1 -10 1.00 1.00 9.00 9.00 -1 -1 -1 -1000 -1000 -1000 -10',
    'Van 0 0 0 1 1 9 9 -1 -1 -1 -1000 -1000 -1000 -10',
    'no label',
    'Truck   0.00 0 0.00 1.00 1.00 9.00 9.00 2.00 2.00 4.00 0.00 1.00 -90.00 0.00',
)  # fmt: skip


def label_text(recording, number, ending):
    """Labels of a frame: a car around points ahead, lines without a box, a truck far behind."""
    points = recording.read(Stream.SCAN, number).points[:, :3]
    ahead = points[(points[:, 0] > 8) & (points[:, 0] < 20) & (np.abs(points[:, 1]) < 3)]
    found = recording.calibration(number)
    x, _, z = (found.cam0_T_velo.apply(ahead[:1]) @ found.r0_rect.T)[0]
    return ending.join([*LINES, '']).format(x=x, z=z)


@pytest.fixture
def labelled(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    recording = open_recording(root)
    for number in range(4):
        path = root / f'training/label_2/{number:06d}.txt'
        path.write_bytes(label_text(recording, number, '\r\n' if number else '\n').encode())
    (root / 'training/label_2/000003.txt').unlink()
    (root / 'training/velodyne/000002.bin').unlink()
    return root


@pytest.mark.parametrize('options', [{}, {'empty_labels': 'keep'}])
def test_labels_are_kept_unless_they_are_to_be_dropped(labelled, tmp_path, options):
    cut(labelled, tmp_path / 'out', height=(50, 60), **options)
    source, made = (files(root / 'training/label_2') for root in (labelled, tmp_path / 'out'))
    assert made == source


def test_labels_without_points_are_dropped(labelled, tmp_path):
    report = cut(labelled, tmp_path / 'out', range=':40', empty_labels='drop')
    source, made = (files(root / 'training/label_2') for root in (labelled, tmp_path / 'out'))
    assert made.keys() == source.keys()
    for name in ('000000.txt', '000001.txt'):
        assert made[name].splitlines(keepends=True) == source[name].splitlines(keepends=True)[:4]
    assert made['000002.txt'] == source['000002.txt']  # it has no scan
    again = cut(labelled, tmp_path / 'none', range='200:', empty_labels='drop')
    text = (tmp_path / 'none/training/label_2/000000.txt').read_bytes()
    assert text == b''.join(source['000000.txt'].splitlines(keepends=True)[1:4])
    assert DONT_CARE.encode() in text
    assert again.recordings[0].labels_dropped > report.recordings[0].labels_dropped >= 2
    (note,) = (note for note in again.notes if 'no point is left' in note)
    assert 'frames 0-1, 3-4' in note


def test_points_without_coordinates_are_in_no_box(labelled, tmp_path):
    path = labelled / 'training/velodyne/000000.bin'
    points = points_in(path.read_bytes()).copy()
    points[:, 0], points[::2, 1] = np.inf, np.nan
    path.write_bytes(points.tobytes())
    with warnings.catch_warnings():
        warnings.simplefilter('error', RuntimeWarning)
        cut(labelled, tmp_path / 'out', empty_labels='drop')
    assert (tmp_path / 'out/training/velodyne/000000.bin').samefile(path)
    made = (tmp_path / 'out/training/label_2/000000.txt').read_text().splitlines()
    assert [line.split()[0] for line in made] == ['DontCare', 'Van', 'no']


def test_labels_without_points_are_dropped_beside_too(labelled, tmp_path):
    options = {'range': ':40', 'empty_labels': 'drop'}
    cut(labelled, tmp_path / 'a', **options)
    cut(labelled, tmp_path / 'b', **options, folder='velodyne_near')
    assert files(tmp_path / 'a/training/label_2') == files(tmp_path / 'b/training/label_2')


def test_labels_are_kept_where_the_calibration_is_missing(labelled, tmp_path):
    (labelled / 'training/calib/000001.txt').unlink()
    report = cut(labelled, tmp_path / 'out', range=':40', empty_labels='drop')
    source, made = (files(root / 'training/label_2') for root in (labelled, tmp_path / 'out'))
    assert made['000001.txt'] == source['000001.txt']
    assert made['000000.txt'] != source['000000.txt']
    (text,) = {loss.text() for loss in report.losses if loss.stream == 'labels'}
    assert 'calib/000001.txt' in text
    assert text.endswith('all labels are kept')


def test_rows_of_tracks_are_dropped(recordings, tmp_path):
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    path = root / 'training/label_02/0000.txt'
    lines = path.read_text().splitlines(keepends=True)
    far = '{} 99 Car 0 0 0.0 1.0 1.0 9.0 9.0 2.0 2.0 4.0 0.0 1.0 -95.0 0.0\r\n'
    care = '{} -1 DontCare -1 -1 -10 1.0 1.0 9.0 9.0 -1 -1 -1 -1000 -1000 -1000 -10\n'
    more = [far.format(3), care.format(3), 'no label\n', far.format(0), far.format(77)]
    path.write_text(''.join([*lines, *more]), newline='')
    report = cut(root, tmp_path / 'out', range=':100', empty_labels='drop')
    made = (tmp_path / 'out/training/label_02/0000.txt').read_bytes().decode()
    kept = made.splitlines(keepends=True)
    assert kept[-3:] == [care.format(3), 'no label\n', far.format(77)]  # frame 77 has no scan
    assert set(kept) < {*lines, *more}
    before = len(lines) + len(more)
    assert report.recordings[0].labels_dropped == before - len(kept) >= 2
    cut(root, tmp_path / 'all', range=':100')
    assert (tmp_path / 'all/training/label_02/0000.txt').samefile(path)


def test_label_files_that_are_no_text_are_kept_and_named(recordings, tmp_path):
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    path = root / 'training/label_02/0000.txt'
    path.write_bytes(b'\xff' * 9)
    report = cut(root, tmp_path / 'out', range=':30', empty_labels='drop')
    assert [loss.stream for loss in report.losses] == ['labels']
    assert str(path) in report.losses[0].text()
    assert (tmp_path / 'out/training/label_02/0000.txt').samefile(path)


def test_tracklets_are_kept_and_dropping_them_is_refused(recordings, tmp_path):
    drive = recordings[Layout.RAW]
    with pytest.raises(kitti_ros2.KittiRos2Error, match=r'tracklet_labels\.xml: --empty'):
        cut(drive, tmp_path / 'out', range=':40', empty_labels='drop')
    assert not list(tmp_path.iterdir())
    cut(drive, tmp_path / 'out', range=':40')
    (made,) = (tmp_path / 'out').rglob('tracklet_labels.xml')
    assert made.samefile(drive / 'tracklet_labels.xml')


# Files that are damaged or missing.


def scan_path(source, layout, number):
    return root_of(source, layout) / SCAN[layout].format(number)


@pytest.fixture
def copied(recordings, layout, tmp_path):
    root = tmp_path / 'copied'
    shutil.copytree(root_of(recordings[layout], layout), root)
    return root / recordings[layout].relative_to(root_of(recordings[layout], layout))


def test_bad_scans_are_named_and_the_rest_is_done(copied, layout, tmp_path, capsys):
    truncated, empty, unreadable, gone = (scan_path(copied, layout, number) for number in range(4))
    truncated.write_bytes(truncated.read_bytes()[:-3])
    empty.write_bytes(b'')
    unreadable.unlink()
    unreadable.mkdir()
    gone.unlink()
    report = cut(copied, tmp_path / 'out', range=':30')
    texts = [loss.text() for loss in report.losses]
    for path, reason in (
        (truncated, 'cut inside a point'),
        (empty, 'the file is empty, and stays so'),
        (unreadable, 'directory'),
    ):
        assert [text for text in texts if str(path) in text and reason in text], texts
    assert any('no file for frames 3' in text or 'no scan for frames 3' in text for text in texts)
    made = sorted((tmp_path / 'out' / SCAN[layout]).parent.iterdir())
    assert [int(path.stem) for path in made] == [1, 4]
    assert made[0].read_bytes() == b''
    assert report.recordings[0].scans == 2
    words = ['crop', str(copied), str(tmp_path / 'more'), '--range', ':30', '-q']
    assert main(words) == 1
    said = capsys.readouterr().err
    assert str(truncated) in said
    assert said.splitlines()[-1].endswith('exit code 1')


def test_points_without_coordinates_are_cut(copied, layout, tmp_path):
    path = scan_path(copied, layout, 2)
    points = points_in(path.read_bytes()).copy()
    points[::3, 0] = np.nan
    points[1::3, 2] = np.inf
    path.write_bytes(points.tobytes())
    cut(copied, tmp_path / 'out', range=':1000')
    made = tmp_path / 'out' / SCAN[layout].format(2)
    assert made.read_bytes() == points[2::3].tobytes()


def test_a_frame_without_its_calibration_or_image_is_left_out(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    (root / 'training/calib/000001.txt').write_text('P2: 1 2 3\n')
    (root / 'training/image_2/000003.png').write_bytes(b'no PNG')
    report = cut(root, tmp_path / 'out', view='reduced')
    assert sorted(files(tmp_path / 'out/training/velodyne')) == [
        f'{number:06d}.bin' for number in (0, 2, 4)
    ]
    texts = [loss.text() for loss in report.losses]
    assert len(texts) == 2
    assert 'calib/000001.txt' in texts[0]
    assert 'image_2/000003.png' in texts[1]
    cut(root, tmp_path / 'sized', view='reduced', image_size='310x94')
    assert (tmp_path / 'sized/training/velodyne/000003.bin').exists()


def test_scans_that_lasers_cannot_be_counted_in_are_left_out(copied, layout, tmp_path):
    path = scan_path(copied, layout, 1)
    points = points_in(path.read_bytes())
    path.write_bytes(points[points[:, 0] > 0][: len(points) // 3].tobytes())
    report = cut(copied, tmp_path / 'out', lasers=32)
    (loss,) = report.losses
    assert str(path) in loss.text()
    assert 'lasers are found instead of 64' in loss.text()
    assert report.recordings[0].scans == 4


@pytest.mark.parametrize(
    'layout', [each for each in Layout if not each.traits.calibration_per_frame], indirect=True
)
def test_what_every_scan_lacks_is_said_once(copied, layout, tmp_path):
    root = root_of(copied, layout)
    for path in [*root.rglob('calib*.txt'), *root.rglob('calib/*.txt')]:
        path.unlink()
    with pytest.raises(kitti_ros2.KittiRos2Error, match=r'no scan can be cut; .*calib.*frames 0-4'):
        cut(copied, tmp_path / 'out', view='reduced')
    assert not (tmp_path / 'out').exists()


def test_a_text_scan_keeps_its_lines(recordings, tmp_path):
    date = tmp_path / '2011_09_26'
    shutil.copytree(recordings[Layout.RAW].parent, date)
    drive = date / '2011_09_26_drive_0001_extract'
    (date / recordings[Layout.RAW].name).rename(drive)
    folder = drive / 'velodyne_points' / 'data'
    lines = [f'{x}.5 0.000   1e-1 0.{x}\n' for x in range(1, 9)]
    for path in list(folder.iterdir()):
        path.with_suffix('.txt').write_text(''.join(lines))
        path.unlink()
    cut(drive, tmp_path / 'out', range='3:6')
    made = tmp_path / 'out' / folder.relative_to(tmp_path)
    assert len(list(made.iterdir())) == 5
    assert all(path.read_text() == ''.join(lines[2:5]) for path in made.iterdir())


def test_pipes_broken_links_and_hidden_files(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    os.mkfifo(root / 'training/image_2/pipe')
    (root / 'training/calib/broken.txt').symlink_to('nowhere')
    (root / 'training/.hidden').write_text('')
    (root / 'training/loop').symlink_to(root / 'training')
    report = cut(root, tmp_path / 'out', range=':30')
    texts = sorted(loss.text() for loss in report.losses)
    assert ['broken.txt' in texts[0], 'pipe: is no regular file' in texts[1]] == [True, True]
    assert len(texts) == 2
    assert files(tmp_path / 'out').keys() == files(recordings[Layout.OBJECT]).keys()


def test_a_file_that_cannot_be_copied_is_left_out(recordings, tmp_path, monkeypatch):
    def refuse(source, _):
        raise UnreadableFileError(source, OSError(errno.EIO, 'Input/output error'))

    monkeypatch.setattr('kitti_ros2.files.local_files._copy', refuse)
    root = recordings[Layout.OBJECT]
    report = cut(root, tmp_path / 'out', range=':30', copy=True)
    texts = {loss.text() for loss in report.losses}
    path = root / 'training/image_2/000003.png'
    assert f'{path}: Input/output error; it is left out' in texts
    assert {path.suffix for path in (tmp_path / 'out').rglob('*.*')} == {'.bin'}


def test_labels_that_vanish_are_left_out(recordings, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EIO, 'Input/output error', 'labels')

    monkeypatch.setattr('kitti_ros2.datasets.scan_crop.without_rows', refuse)
    report = cut(recordings[Layout.OBJECT], tmp_path / 'out', range=':1', empty_labels='drop')
    (text,) = {loss.text() for loss in report.losses}
    assert 'labels: Input/output error; it is left out' in text
    assert not list((tmp_path / 'out').rglob('label_2/*'))


def test_nothing_is_left_of_a_failed_run(recordings, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('kitti_ros2.kitti.store.write_uncached', full)
    with pytest.raises(kitti_ros2.KittiRos2Error, match='the disk is full') as raised:
        cut(recordings[Layout.OBJECT], tmp_path / 'out', range=':30')
    assert not isinstance(raised.value, OSError)
    assert not list(tmp_path.iterdir())


def test_the_source_is_not_changed(copied, layout, tmp_path):
    before = files(root_of(copied, layout))
    names = {name for name in before if fnmatch(name, '*.bin')}
    common = layout.traits.tracklets or layout.traits.world_boxes
    cut(copied, tmp_path / 'out', voxel=1, empty_labels='keep' if common else 'drop')
    cut(copied, tmp_path / 'out', range=':9', overwrite=True)
    assert names
    assert files(root_of(copied, layout)) == before


@pytest.mark.parametrize('cuts', [{}, {'range': (3, 30)}], ids=['whole', 'cut'])
@pytest.mark.parametrize(
    ('layout', 'option'),
    [(Layout.RAW, 'deskew'), (Layout.TRACKING, 'deskew'), (Layout.ODOMETRY, 'undo_deskew')],
)
def test_scans_are_moved_as_they_are_read(layout, option, cuts, tmp_path):
    folder, _, _ = write_bend(tmp_path / 'bend', layout, Bend())
    report = cut(folder, tmp_path / 'out', **{option: True}, **cuts)
    assert any('not as in KITTI' in note for note in report.notes)
    moved = open_recording(folder, ReadOptions(**{option: True}))
    made = sorted((tmp_path / 'out').rglob('*.bin'))
    assert len(made) == 4
    for number, path in enumerate(made):
        points = moved.read(Stream.SCAN, number).points
        distance = np.linalg.norm(points[:, :3].astype(float), axis=1)
        kept = points[(distance >= 3) & (distance <= 30)] if cuts else points
        assert len(kept) > 0
        assert path.read_bytes() == kept.tobytes()


def test_scans_that_do_not_come_back_to_the_grid_are_named(tmp_path):
    folder, _, _ = write_bend(tmp_path / 'bend', Layout.ODOMETRY, Bend())
    by_poses = "points do not come to lie on KITTI's grid of 1 mm"
    report = cut(folder, tmp_path / 'all', undo_deskew=True)
    assert [note for note in report.notes if by_poses in note and note.startswith('undo_deskew')]
    xyz = on_grid(np.random.default_rng(0).uniform((-50, -50, -2), (50, 50, 1), (20_000, 3)))
    scan = np.zeros((len(xyz), 4), np.float32)
    scan[:, :3] = compensated(xyz, np.array([1.5, 0, 0, 0, 0, np.radians(3)]))
    first, *_ = sorted(folder.rglob('*.bin'))
    first.write_bytes(scan.tobytes())
    report = cut(folder, tmp_path / 'some', undo_deskew=True)
    (note,) = [note for note in report.notes if by_poses in note]
    assert note.endswith('scans 1-3')
    made, *_ = sorted((tmp_path / 'some').rglob('*.bin'))
    assert (np.fromfile(made, np.float32).reshape(-1, 4)[:, :3] == xyz).all(axis=1).mean() > 0.99
