# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The jobs of roots, globs and lists, in every layout; fingerprints of their files."""

from __future__ import annotations

import os
import shutil

import pytest

from kitti_ros2.batch.collection import _files_of, fingerprint
from kitti_ros2.batch.jobs import find_jobs, find_roots
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import write_synthetic

from builders import SMALL  # isort: skip


def names(*roots, **options):
    return [job.name for job in find_jobs(roots, **options)]


@pytest.fixture
def collection(tmp_path, recordings):
    """A root with two drives, and a data set of each other layout."""
    root = tmp_path / 'root'
    drive = recordings[Layout.RAW]
    shutil.copytree(drive.parent, root / drive.parent.name)
    shutil.copytree(drive, root / drive.parent.name / drive.name.replace('0001', '0007'))
    for layout in (Layout.OBJECT, Layout.ODOMETRY, Layout.TRACKING):
        shutil.copytree(recordings[layout], root / layout.value)
    (root / 'papers').mkdir()
    return root


def test_all_layouts_below_one_root_are_found(collection, recordings):
    drive = recordings[Layout.RAW]
    found = names(collection)
    assert f'{drive.parent.name}/{drive.name}' in found
    assert f'{drive.parent.name}/{drive.name.replace("0001", "0007")}' in found
    assert {name.partition('/')[0] for name in found} == {
        drive.parent.name, 'object', 'odometry', 'tracking',
    }  # fmt: skip
    assert found == sorted(found)


def test_each_unit_opens_as_the_recording_that_it_names(collection):
    for job in find_jobs([collection]):
        recording = open_recording(job.source, job.read)
        assert recording.layout is job.layout
        assert job.name.endswith(recording.name)


def test_a_layout_leaves_the_others_out(collection):
    jobs = find_jobs([collection], Layout.TRACKING)
    assert jobs
    assert {job.layout for job in jobs} == {Layout.TRACKING}


def test_a_recording_alone_has_its_own_name(recording_path):
    (name,) = {each.split('/')[-1] for each in names(recording_path)}
    assert name


def test_a_glob_and_a_list_name_units_below_their_common_folder(collection, recordings):
    date = recordings[Layout.RAW].parent.name
    drives = sorted(path.name for path in (collection / date).iterdir() if path.is_dir())
    roots = find_roots(collection / date / '*_sync')
    assert names(*roots) == drives
    listed = collection / 'some.txt'
    listed.write_text(f'# two drives\n{date}/{drives[0]}\n\n{date}/{drives[1]}  # the other\n')
    assert find_roots(listed) == roots
    assert names(*find_roots(listed)) == drives


@pytest.mark.parametrize('text', ['', '# nothing\n', 'absent\n'])
def test_a_list_without_folders_is_one_line(text, tmp_path):
    path = tmp_path / 'list.txt'
    path.write_text(text)
    with pytest.raises(KittiRos2Error) as caught:
        find_roots(path)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize('name', ['absent', 'nothing*here', 'papers'])
def test_a_root_without_recordings_is_one_line(name, collection):
    with pytest.raises(KittiRos2Error):
        find_jobs(find_roots(collection / name))


def test_the_same_folder_twice_is_one_unit(drive):
    assert names(drive, drive, drive.parent / '.' / drive.name) == [drive.name]


def test_slices_hold_so_many_present_frames(tmp_path):
    root = tmp_path / 'object'
    write_synthetic(root, Layout.OBJECT, SMALL)
    split = root / 'training'
    present = sorted({int(path.stem) for path in (split / 'calib').glob('*.txt')})
    for path in split.glob(f'*/{present[1]:06d}.*'):
        path.unlink()
    rest = [present[0], *present[2:]]
    parts = [rest[start : start + 2] for start in range(0, len(rest), 2)]
    found = find_jobs([root], slice_frames=2)
    assert [(job.first, job.last) for job in found] == [(part[0], part[-1]) for part in parts]
    assert found[0].name == f'training/{rest[0]:06d}-{rest[1]:06d}'
    before = [fingerprint(job) for job in found]
    _files_of.cache_clear()
    os.utime(split / 'calib' / f'{rest[0]:06d}.txt', ns=(5, 5))
    after = [fingerprint(job) for job in found]
    assert [old == new for old, new in zip(before, after, strict=True)] == [False, True]


def test_a_fingerprint_does_not_depend_on_the_root(drive):
    (job,) = find_jobs([drive])
    (other,) = find_jobs([drive.parent])
    assert fingerprint(job) == fingerprint(other)


@pytest.mark.parametrize('change', ['size', 'time', 'name', 'calibration', 'new'])
def test_a_change_of_input_is_seen(change, drive):
    (job,) = find_jobs([drive])
    before = fingerprint(job)
    _files_of.cache_clear()
    assert fingerprint(job) == before
    _files_of.cache_clear()
    scan = next((drive / 'velodyne_points' / 'data').iterdir())
    match change:
        case 'size':
            scan.write_bytes(scan.read_bytes()[:-16])
        case 'time':
            os.utime(scan, ns=(5, 5))
        case 'name':
            scan.rename(scan.with_name('0000000099.bin'))
        case 'calibration':
            os.utime(next(drive.parent.glob('calib_*.txt')), ns=(5, 5))
        case 'new':
            (drive / 'image_02' / 'data' / '0000000099.png').touch()
    assert fingerprint(job) != before
