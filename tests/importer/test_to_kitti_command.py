# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti as a user meets it: exit codes, what it says, one line for each error."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace

import foreign
import pytest
from builders import one_line
from waiting import PATIENCE_S, UNTIL_A_SIGNAL, wait_until

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

RUN = [sys.executable, '-m', 'kitti_ros2']


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('foreign')
    return str(foreign.write_foreign(folder / 'bag.mcap', foreign.make_truth()))


@pytest.fixture(scope='module')
def own(recordings, tmp_path_factory):
    path = str(tmp_path_factory.mktemp('own') / 'own.mcap')
    assert main(['to-bag', str(recordings[Layout.OBJECT]), path, '-q']) == 0
    return path


def test_a_bag_of_our_own_needs_no_option(own, recordings, tmp_path, capsys):
    out = tmp_path / 'out'
    assert main(['to-kitti', own, str(out)]) == 0
    said = capsys.readouterr()
    assert f'{out}: layout object, training, 5 frames' in said.out
    assert not said.err
    made = out / 'training/velodyne/000003.bin'
    assert made.read_bytes() == (recordings[Layout.OBJECT] / made.relative_to(out)).read_bytes()


@pytest.fixture
def go_by(bag, tmp_path, capsys):
    """Print the plan of the bag, change a word of it, and go by that; returns what was said."""

    def go(before: str, after: str) -> tuple[str, str]:
        assert main(['to-kitti', bag, '--layout', 'object', '--plan']) == 0
        printed = capsys.readouterr().out
        assert before in printed
        plan = tmp_path / 'plan.yaml'
        plan.write_text(printed.replace(before, after))
        assert main(['to-kitti', bag, str(tmp_path / 'out'), '--plan-file', str(plan)]) == 0
        return printed, capsys.readouterr().out

    return go


def test_a_plan_can_be_printed_edited_and_gone_by(go_by, tmp_path):
    printed, said = go_by('name: training', 'name: testing')
    assert 'topic: /sensors/ouster/points' in printed
    assert 'image_2 (/cam/left/image_raw): 12 of 12 frames' in said
    assert (tmp_path / 'out/testing/velodyne/000000.bin').is_file()
    assert (tmp_path / 'out/ImageSets/test.txt').read_text().count('\n') == foreign.FRAMES


@pytest.mark.parametrize('occluded', [0, 1, 3])
def test_labels_have_the_occlusion_of_the_plan(occluded, go_by, tmp_path):
    printed, said = go_by('occluded: 0', f'occluded: {occluded}')
    assert 'has no occlusion, so labels contain 0, visible, and evaluations count' in printed
    lines = [
        line
        for path in (tmp_path / 'out/training/label_2').iterdir()
        for line in path.read_text().splitlines()
    ]
    assert lines
    assert {line.split()[2] for line in lines} == {f'{occluded}'}
    left_out = f'{len(lines)} labels contain occlusion 3, unknown, as labels.occluded of the plan'
    assert (left_out in said) == (occluded == 3)


def test_label_lines_tell_their_own_occlusion(own, tmp_path, capsys):
    assert main(['to-kitti', own, '--layout', 'object', '--plan']) == 0
    plan = tmp_path / 'plan.yaml'
    plan.write_text(capsys.readouterr().out.replace('occluded: 0', 'occluded: 1'))
    assert main(['to-kitti', own, str(tmp_path / 'out'), '--plan-file', str(plan)]) == 2
    assert 'labels.occluded is for boxes' in one_line(capsys.readouterr().err)


def test_a_set_without_labels_is_better_named_testing(tmp_path, capsys):
    path = foreign.write_foreign(
        tmp_path / 'bag.mcap', foreign.make_truth(), 'mcap', '/perception/objects'
    )
    words = ['to-kitti', str(path), '--layout', 'object', '--plan']
    assert main(words) == 0
    assert '--name testing' in capsys.readouterr().out
    assert main([*words, '--name', 'testing']) == 0
    assert '--name testing' not in capsys.readouterr().out


def test_the_plan_of_our_own_bag_says_that_none_is_needed(own, capsys):
    assert main(['to-kitti', own, '--plan']) == 0
    text = capsys.readouterr().out
    assert 'every file of training comes back as it was' in text
    assert 'calibration: source' in text


def test_what_is_lost_is_named_and_the_exit_code_says_so(tmp_path, capsys):
    def change(topic, place, message):
        wanted = topic == '/cam/left/image_raw' and place == 0
        return replace(message, encoding='hsv8') if wanted else message

    path = foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth(), change=change)
    out = tmp_path / 'out'
    assert main(['to-kitti', str(path), str(out), '--layout', 'object', '-q']) == 1
    said = capsys.readouterr()
    assert said.out == ''
    assert 'skipped /cam/left/image_raw (1): /cam/left/image_raw at' in said.err
    assert '1 skipped in all, listed above; exit code 1' in said.err


def test_an_append_says_what_it_did_about_one_that_was_interrupted(bag, tmp_path, capsys):
    words = ['to-kitti', bag, str(tmp_path / 'out'), '--layout', 'object', '--append']
    assert main([*words, '-q']) == 0
    staged = tmp_path / 'out/.to-kitti-append/content/training/velodyne/000012.bin'
    staged.parent.mkdir(parents=True)
    staged.touch()
    assert main(['info', str(tmp_path / 'out')]) == 0
    assert 'an append is running or was interrupted' in capsys.readouterr().out
    assert main(words) == 0
    said = capsys.readouterr().out
    assert 'an append that was interrupted had not added a frame yet' in said
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['ImageSets', 'training']
    listed = (tmp_path / 'out/ImageSets/train.txt').read_text().split()
    assert listed == [f'{number:06d}' for number in range(2 * foreign.FRAMES)]


def test_an_append_behind_a_link_is_refused(bag, tmp_path, capsys):
    words = ['to-kitti', bag, str(tmp_path / 'out'), '--layout', 'object', '-q']
    assert main(words) == 0
    (tmp_path / 'out/training/velodyne').rename(tmp_path / 'elsewhere')
    (tmp_path / 'out/training/velodyne').symlink_to(tmp_path / 'elsewhere')
    before = sorted(tmp_path.rglob('*'))
    assert main([*words, '--append']) == 2
    assert 'out/training/velodyne: is a symbolic link' in one_line(capsys.readouterr().err)
    assert sorted(tmp_path.rglob('*')) == before


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['{bag}'], 'OUT is missing'),
        (['{bag}', '{out}'], 'which layout is wanted? give --layout raw, object'),
        (['{bag}', '{out}', '--layout', 'nuscenes'], "not 'nuscenes'"),
        (['{bag}', '{out}', '--layout', 'object', '--split', '80'], 'a split of 80'),
        (['{bag}', '{out}', '--layout', 'raw', '--append'], '--append continues an object set'),
        (['{bag}', '{out}', '--layout', 'raw', '--name', '../x'], '../x is no drive'),
        (['{bag}', '{out}', '--layout', 'object', '--name', '../x'], "no split '../x'"),
        (['{bag}', '{out}', '--layout', 'object', '--calib', '{none}'], 'no such file or folder'),
        (['{bag}', '{out}', '--plan-file', '{none}'], '--plan-file takes one that exists'),
        (['{none}', '{out}', '--layout', 'object'], 'there is no such file'),
        (['{circle}', '{out}', '--layout', 'object'], 'there is no such file'),
        (['{bag}', '{circle}', '--layout', 'object'], 'it is a symbolic link'),
        (['{bag}', '{circle}/x', '--layout', 'object'], 'cannot be written'),
        (['{bag}', '{full}', '--layout', 'object'], 'exists already'),
        (['{bag}', '{bag}', '--layout', 'object'], 'lies inside the recording'),
        (['{bag}', '{bag}/out', '--layout', 'object'], 'lies inside the recording'),
        (['{bag}', '{full}/kept', '--layout', 'object', '--append'], 'it is no folder'),
        (['{bag}', '{out}', '--layout', 'odometry', '--name', '٣'], 'is no sequence'),
        (['{bag}', '{full}', '--layout', 'object', '--append'], 'no object set to append to'),
    ],
)
def test_wrong_usage_is_one_line_and_leaves_nothing(bag, words, said, tmp_path, capsys):
    full = tmp_path / 'full'
    full.mkdir()
    (full / 'kept').touch()
    circle = tmp_path / 'circle'
    circle.symlink_to(circle)
    places = {
        'bag': bag,
        'circle': circle,
        'out': tmp_path / 'out',
        'none': tmp_path / 'none',
        'full': full,
    }
    assert main(['to-kitti', *(word.format(**places) for word in words)]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['circle', 'full']


def test_a_plan_of_topics_that_are_not_there_is_one_line(bag, tmp_path, capsys):
    main(['to-kitti', bag, '--layout', 'object', '--plan'])
    plan = tmp_path / 'plan.yaml'
    plan.write_text(capsys.readouterr().out.replace('/sensors/ouster/points', '/velodyne'))
    assert main(['to-kitti', bag, str(tmp_path / 'out'), '--plan-file', str(plan)]) == 2
    assert 'the plan names /velodyne' in one_line(capsys.readouterr().err)


def test_an_interrupted_run_leaves_nothing(recordings, tmp_path):
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q', '--images', 'raw']) == 0
    out = tmp_path / 'to' / 'out'
    waiting = f"""{UNTIL_A_SIGNAL}
from kitti_ros2.kitti.store import STORE; put = STORE.write
STORE.__class__.write = lambda _, *words, **more: (put(*words, **more), signalled.wait())
from kitti_ros2.cli import main; sys.exit(main())
"""
    process = subprocess.Popen(
        [sys.executable, '-c', waiting, 'to-kitti', str(bag), str(out)],
        stderr=subprocess.PIPE,
    )
    wait_until(lambda: any(tmp_path.glob('to/.out.partial/content*/*')))
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, said
    assert b'Traceback' not in said
    assert not list((tmp_path / 'to').glob('*')) if (tmp_path / 'to').exists() else True
