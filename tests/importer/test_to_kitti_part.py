# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-kitti --start and --end, and --overwrite."""

from __future__ import annotations

import json

import foreign
import pytest
from builders import one_line
from folder_and_bag import OBJECT_NUMBERS, make_holes

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

SPANS = [
    ('--start', '2'),
    ('--end', '2'),
    ('--start', '1', '--end', '3'),
    ('--start', '0.1s', '--end', '0.35s'),
    ('--start', '0.1s', '--end', '3'),
]


def files_of(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


@pytest.fixture(scope='module')
def foreign_bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('foreign')
    return str(foreign.write_foreign(folder / 'bag.mcap', foreign.make_truth()))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('span', SPANS, ids=' '.join)
@pytest.mark.parametrize('layout', list(Layout))
def test_a_part_is_what_a_bag_of_that_part_gives(recordings, layout, span, tmp_path, capsys):
    source = make_holes(recordings[layout], layout, tmp_path)
    if layout is Layout.OBJECT:
        span = [str(OBJECT_NUMBERS[int(word)]) if word.isdecimal() else word for word in span]
    whole, part = str(tmp_path / 'whole.mcap'), str(tmp_path / 'part.mcap')
    assert main(['to-bag', str(source), whole, '-q']) in {0, 1}
    assert main(['to-bag', str(source), part, '-q', *span]) in {0, 1}
    wanted, made = tmp_path / 'wanted', tmp_path / 'made'
    capsys.readouterr()
    codes, reports = [], []
    for words in ([part, str(wanted)], [whole, str(made), *span]):
        codes.append(main(['to-kitti', *words, '--json']))
        reports.append(json.loads(capsys.readouterr().out)['recordings'][0])
    assert codes[0] == codes[1]
    assert files_of(made) == files_of(wanted)
    assert reports[0]['frames'] == reports[1]['frames'] > 0


@pytest.mark.parametrize(
    ('span', 'frames'),
    [
        (('--start', '2', '--end', '4'), [2, 3, 4]),
        (('--start', '0.15s', '--end', '0.35s'), [2, 3]),
        (('--end', '0'), [0]),
    ],
)
def test_frames_of_other_bags_are_those_of_the_whole_conversion(
    foreign_bag, tmp_path, span, frames
):
    whole, part = tmp_path / 'whole', tmp_path / 'part'
    words = ['to-kitti', foreign_bag, '--layout', 'object', '-q']
    assert main([*words, str(whole)]) == 0
    assert main([*words, str(part), *span]) == 0
    scans = sorted((part / 'training' / 'velodyne').iterdir())
    assert [path.name for path in scans] == [f'{n:06d}.bin' for n in range(len(frames))]
    for path, number in zip(scans, frames, strict=True):
        same = whole / 'training' / 'velodyne' / f'{number:06d}.bin'
        assert path.read_bytes() == same.read_bytes()


def test_a_plan_takes_kittis_numbers_of_an_own_bag(recordings, tmp_path):
    source = make_holes(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path)
    frame = str(OBJECT_NUMBERS[2])
    bag, out = str(tmp_path / 'bag.mcap'), tmp_path / 'out'
    assert main(['to-bag', str(source), bag, '-q']) in {0, 1}
    words = ['to-kitti', bag, str(out), '--layout', 'object', '--name', 'testing', '-q']
    assert main([*words, '--start', frame, '--end', frame]) in {0, 1}
    (made,) = (out / 'testing' / 'velodyne').iterdir()
    assert made.name == '000000.bin'
    scans = source / 'training' / 'velodyne'
    assert made.read_bytes() == (scans / f'{OBJECT_NUMBERS[2]:06d}.bin').read_bytes()


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--start', '40'], 'the selection takes no frame; '),
        (['--start', '99s'], 'the selection takes no frame; '),
        (['--start', '3', '--end', '1'], 'the end (frame 1) is before the start (frame 3)'),
        (['--append', '--overwrite'], '--append and --overwrite exclude each other'),
    ],
)
@pytest.mark.parametrize('own', [True, False])
def test_what_cannot_be_is_one_line(recordings, foreign_bag, tmp_path, capsys, own, words, said):
    bag = foreign_bag
    if own:
        bag = str(tmp_path / 'own.mcap')
        assert main(['to-bag', str(recordings[Layout.OBJECT]), bag, '-q']) == 0
    layout = [] if own else ['--layout', 'object']
    assert main(['to-kitti', bag, str(tmp_path / 'out'), '-q', *layout, *words]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert not (tmp_path / 'out').exists()


def test_a_plan_is_of_all_frames(foreign_bag, capsys):
    words = ['to-kitti', foreign_bag, '--layout', 'object', '--plan', '--start', '2']
    assert main(words) == 2
    assert '--plan prints the plan of all frames' in one_line(capsys.readouterr().err)


@pytest.fixture
def bag(recordings, tmp_path):
    path = str(tmp_path / 'bag.mcap')
    assert main(['to-bag', str(recordings[Layout.RAW]), path, '-q']) == 0
    return path


def test_overwrite_replaces_a_data_set(bag, tmp_path, capsys):
    out = tmp_path / 'out'
    assert main(['to-kitti', bag, str(out), '-q']) == 0
    whole = files_of(out)
    assert main(['to-kitti', bag, str(out), '-q', '--end', '1']) == 2
    assert 'pass --overwrite' in one_line(capsys.readouterr().err)
    assert files_of(out) == whole
    assert main(['to-kitti', bag, str(out), '-q', '--end', '1', '--overwrite']) == 0
    assert len(files_of(out)) < len(whole)
    assert main(['to-kitti', bag, str(out), '-q', '--overwrite']) == 0
    assert files_of(out) == whole
    assert not list(tmp_path.glob('.*'))


def test_overwrite_replaces_nothing_when_it_fails(bag, tmp_path):
    out = tmp_path / 'out'
    assert main(['to-kitti', bag, str(out), '-q']) == 0
    whole = files_of(out)
    assert main(['to-kitti', bag, str(out), '-q', '--overwrite', '--start', '50']) == 2
    assert files_of(out) == whole


def test_overwrite_by_a_plan(foreign_bag, tmp_path):
    out = tmp_path / 'out'
    words = ['to-kitti', foreign_bag, str(out), '--layout', 'object', '-q']
    assert main(words) == 0
    whole = files_of(out)
    assert main([*words, '--end', '1', '--overwrite']) == 0
    assert len(list((out / 'training' / 'velodyne').iterdir())) == 2
    assert main([*words, '--overwrite']) == 0
    assert files_of(out) == whole


@pytest.mark.parametrize('what', ['notes', 'photos', 'one more file', 'a link', 'two drives'])
def test_overwrite_keeps_what_it_would_not_write_again(bag, tmp_path, capsys, what):
    out = tmp_path / 'out'
    if what in {'notes', 'photos'}:
        out.mkdir()
        (out / ('notes.txt' if what == 'notes' else 'photo.png')).write_text('mine')
    else:
        assert main(['to-kitti', bag, str(out), '-q']) == 0
    if what == 'one more file':
        (out / 'results.csv').write_text('mine')
    if what == 'a link':
        (out / 'velodyne').symlink_to(tmp_path)
    if what == 'two drives':
        drive = next(out.glob('*/*_sync'))
        drive.rename(drive.with_name(drive.name.replace('_0001_', '_0002_')))
        (out / drive.parent.name / drive.name).mkdir()
        (out / drive.parent.name / drive.name / 'oxts' / 'data').mkdir(parents=True)
    before = files_of(out)
    assert main(['to-kitti', bag, str(out), '-q', '--overwrite']) == 2
    said = one_line(capsys.readouterr().err)
    assert ('holds 2 recordings' if what == 'two drives' else 'no KITTI data set') in said
    assert files_of(out) == before
