# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each rule about KITTI folders finds the fault that is planted; whole folders have no findings."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import kitti360_faults
import object_faults
import pytest
import sequence_faults

from kitti_ros2.datasets import validate
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import write_synthetic
from kitti_ros2.validation import recording_checks
from kitti_ros2.validation.validate import FOLDER_RULES

from builders import SMALL  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

FAULTS = (*object_faults.FAULTS, *sequence_faults.FAULTS, *kitti360_faults.FAULTS)
FEW = replace(SMALL, frames=8, image_size=(62, 19), lidar_columns=24)
FIRST = 3
FOLDERS = {
    'velodyne': '.bin',
    'image_2': '.png',
    'image_3': '.png',
    'label_2': '.txt',
    'calib': '.txt',
}
_ALSO_FOUND = {'source-open', 'source-large', 'scan-columns'}
"""Rules whose faults are planted in test_checked_sources.py and test_scan_columns.py."""


def write(folder: Path, layout: Layout, options) -> Path:
    """A data set; returns the folder that all of it is in."""
    path = write_synthetic(folder / layout.value, layout, options)
    return path.parent.parent if layout is Layout.RAW else path


@pytest.fixture(scope='module')
def few(tmp_path_factory):
    root = tmp_path_factory.mktemp('few')
    return {layout: write(root, layout, FEW) for layout in Layout}


def places(report, rule):
    return {each.path for each in report.findings if each.rule == rule}


def test_whole_folders_have_no_findings_but_notes(few):
    for path in few.values():
        report = validate(path, decode=True)
        assert [each.place for each in report.findings if each.severity != 'note'] == []
        assert report.ok
        assert {each.rule for each in report.findings} <= {'label-points', 'stream-missing'}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('fault', FAULTS, ids=lambda each: f'{each.layout.value}: {each.name}')
def test_a_fault_is_found_in_its_file(fault, few, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(few[fault.layout], root)
    path = fault.plant(root, FIRST)
    report = validate(root, **dict.fromkeys(fault.options, True))
    assert path in places(report, fault.rule), [each.place for each in report.findings]
    rules = {each.id: each for each in FOLDER_RULES}
    for each in report.findings:
        assert each.severity == rules[each.rule].severity.value
        assert each.message
        assert each.remedy
    assert report.ok is not any(each.severity == 'error' for each in report.findings)


def plant(faults, root):
    """Plant faults, each in a frame of its own; returns those that are not found."""
    planted = [(fault, fault.plant(root, FIRST + n)) for n, fault in enumerate(faults)]
    report = validate(root, decode=True)
    return [fault.name for fault, path in planted if path not in places(report, fault.rule)]


def test_sixty_faults_of_an_object_set_are_found_at_once(few, tmp_path):
    faults = [each for each in object_faults.FAULTS if not each.alone]
    root = tmp_path / 'set'
    for number in range(len(faults) + FIRST):
        for folder, suffix in FOLDERS.items():
            target = root / 'training' / folder / f'{number:06d}{suffix}'
            target.parent.mkdir(parents=True, exist_ok=True)
            source = few[Layout.OBJECT] / 'training' / folder
            shutil.copy(source / f'{number % FEW.frames:06d}{suffix}', target)
    shutil.copytree(few[Layout.OBJECT] / 'ImageSets', root / 'ImageSets')
    assert len(faults) >= 59
    assert plant(faults, root) == []


@pytest.mark.parametrize('layout', [each for each in Layout if each is not Layout.OBJECT])
def test_several_faults_of_a_sequence_are_found_at_once(layout, few, tmp_path):
    faults = [each for each in FAULTS if each.layout is layout and not each.alone]
    most = FEW.frames - FIRST
    for at in range(0, len(faults), most):
        root = tmp_path / f'{at}'
        shutil.copytree(few[layout], root)
        assert plant(faults[at : at + most], root) == []


@pytest.mark.parametrize('layout', Layout)
def test_processes_find_what_threads_find(layout, few, tmp_path, monkeypatch):
    root = tmp_path / 'set'
    shutil.copytree(few[layout], root)
    faults = [each for each in FAULTS if each.layout is layout and not each.alone]
    for number, fault in enumerate(faults[: FEW.frames - FIRST]):
        fault.plant(root, FIRST + number)
    monkeypatch.setattr(recording_checks, '_BATCH', 2)
    monkeypatch.setattr(recording_checks, '_LEAST_FORKED', 2)
    monkeypatch.setattr(recording_checks, 'worker_count', lambda: 2)
    reports, forks = {}, []
    fork = recording_checks.forked_map
    monkeypatch.setattr(
        recording_checks, 'forked_map', lambda *given: (forks.append(given), fork(*given))[1]
    )
    for forked in (True, False):
        monkeypatch.setattr(recording_checks, 'can_fork', lambda forked=forked: forked)
        report = validate(root, decode=True)
        reports[forked] = (report.sources, report.findings)
    assert reports[True] == reports[False]
    assert len(forks) == 1


def test_sixty_kinds_of_faults_are_planted_and_every_rule_finds_one():
    assert len(FAULTS) >= 60
    assert len({(each.layout, each.name) for each in FAULTS}) == len(FAULTS)
    planted = {each.rule for each in FAULTS} | _ALSO_FOUND
    assert {each.id for each in FOLDER_RULES} - planted == set()
    assert planted - {each.id for each in FOLDER_RULES} == set()


def test_findings_of_text_files_have_their_line(few, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(few[Layout.OBJECT], root)
    path = root / 'training/label_2/000002.txt'
    path.write_text(f'{object_faults.CAR}\n{object_faults.CAR.rpartition(" ")[0]}\n')
    (found,) = (each for each in validate(root).findings if each.rule == 'label-line')
    assert (found.path, found.line) == (path, 2)
    assert found.message.startswith('14 columns')
    assert found.place == f'{path}:2'


def test_quick_reads_names_and_sizes_only(few, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(few[Layout.OBJECT], root)
    object_faults.image(root, 1).write_bytes(b'no image')
    object_faults.scan(root, 2).write_bytes(b'')
    object_faults.scan(root, 3).write_bytes(bytes(15))
    report = validate(root, quick=True)
    assert {each.rule for each in report.findings if each.severity == 'error'} == {
        'file-empty',
        'scan-size',
    }
