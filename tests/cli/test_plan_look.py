# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A look before a conversion: the table of the plan in a terminal, its JSON, and the preview."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import shlex
import struct
import subprocess
import sys
import termios

import cv2
import foreign
import pytest
from builders import OF_OTHERS, files_of, one_line

from kitti_ros2.cli import main
from kitti_ros2.cli.app import find_command
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from terminals import read_to_the_end  # isort: skip

CAMERAS = (
    '/cam/left/image_raw',
    '/cam/left/camera_info',
    '/cam/right/image_rect/compressed',
    '/cam/right/camera_info',
)
MISSING = 'OUT is missing (the folder to create); usage: kitti-ros2 to-kitti BAG... OUT'


@pytest.fixture(scope='module')
def write(tmp_path_factory):
    """Write the bag without some topics."""
    folder = tmp_path_factory.mktemp('foreign')

    def made(name: str, *leave_out: str) -> str:
        path = folder / f'{name}.mcap'
        if not path.exists():
            foreign.write_foreign(path, foreign.make_truth(), 'mcap', *leave_out)
        return str(path)

    return made


@pytest.fixture
def bag(write):
    return write('bag')


@pytest.fixture
def on_terminal(monkeypatch, capsys):
    """Run a command that takes its output for a terminal; returns exit code, output, errors."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys.stdout, 'isatty', lambda: True)
        code = main(['to-kitti', *map(str, words)])
        said = capsys.readouterr()
        return code, re.sub(r'\x1b\[[0-9;]*m', '', said.out), said.err

    monkeypatch.setenv('COLUMNS', '100')
    return run


def terminal_of(columns: int, *words: str) -> tuple[int, list[str]]:
    """The exit code, and the lines that a terminal of a width shows."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack('HHHH', 40, columns, 0, 0))
    environment = {name: each for name, each in os.environ.items() if name != 'COLUMNS'}
    command = [sys.executable, '-m', 'kitti_ros2', 'to-kitti', *words]
    with subprocess.Popen(command, stdout=slave, stdin=slave, env=environment) as process:
        os.close(slave)
        shown = read_to_the_end(master).decode()
    return process.returncode, re.sub(r'\x1b\[[0-9;]*m', '', shown).split('\r\n')


def rows_of(text: str) -> dict[str, list[str]]:
    """The words of the table's rows, by topic."""
    lines = text.splitlines()
    first = next(place for place, line in enumerate(lines) if line.startswith('stream '))
    found = {}
    for line in lines[first + 1 :]:
        words = line.split()
        if len(words) < 2 or not words[1].startswith('/'):
            break
        found[words[1]] = [words[0], *words[2:]]
    return found


@pytest.mark.parametrize(
    ('columns', 'left_out'), [(100, []), (80, ['frame']), (60, ['frame', 'Hz', 'type'])]
)
def test_a_terminal_shows_the_plan_within_its_width_and_no_broken_name(columns, left_out, bag):
    code, lines = terminal_of(columns, bag)
    assert code == 0
    table = lines[lines.index(next(line for line in lines if line.startswith('stream '))) :]
    table = table[: table.index('-: passed over in this layout')]
    assert max(map(len, table)) <= columns
    shown = [name for name in ('topic', 'type', 'count', 'Hz', 'frame') if name not in left_out]
    assert table[0].split() == ['stream', *shown]
    assert (f'not shown at this width: {", ".join(left_out)}; all with --json' in lines) == bool(
        left_out
    )
    streams = [line.split()[0] for line in table]
    assert streams[1:] == ['scan', 'image_2', 'image_3', 'labels', *['calib'] * 3, *['-'] * 4]


def test_the_table_names_topic_type_count_rate_and_frame(bag, on_terminal):
    code, out, err = on_terminal(bag)
    assert (code, err) == (0, '')
    assert 'layout object (the bag has 3D boxes), training, 12 frames, one for each scan' in out
    rows = rows_of(out)
    assert rows['/sensors/ouster/points'] == ['scan', 'PointCloud2', '12', '10.0', 'os_sensor']
    assert rows['/cam/right/camera_info'][:3] == ['calib', 'CameraInfo', '24']
    assert rows['/odom'] == ['-', 'Odometry', '65', '50.0', 'odom']
    assert rows['/tf_static'] == ['calib', 'TFMessage', '1']
    assert len(rows) == 11
    assert 'note: /perception/objects: has no occlusion' in out


def test_every_layout_is_listed_with_its_streams(bag, on_terminal):
    _, out, _ = on_terminal(bag)
    listed = dict(
        re.findall(r'^(raw|object|odometry|tracking)(?: \(shown\))? +(\w.*)$', out, re.MULTILINE)
    )
    assert listed['odometry'].split() == ['calibration', 'pose', 'scan', 'image_2', 'image_3']
    assert 'oxts' in listed['raw']
    assert {*listed} == {layout.value for layout in OF_OTHERS}


@pytest.mark.parametrize(
    ('leave_out', 'layout', 'reason'),
    [
        (('/perception/objects',), 'raw', 'the bag has GPS'),
        (('/perception/objects', '/gps/fix'), 'odometry', 'the bag has poses'),
        (('/perception/objects', '/gps/fix', '/odom'), 'object', 'the bag has neither 3D boxes'),
        ((*CAMERAS, '/sensors/ouster/points'), 'odometry', 'the bag has poses'),
    ],
    ids=['gps', 'poses', 'neither', 'poses only'],
)
def test_a_layout_is_chosen_by_the_content(leave_out, layout, reason, write, on_terminal):
    path = write(f'{len(leave_out)}{layout}', *leave_out)
    code, out, _ = on_terminal(path)
    assert code == 0
    assert f': layout {layout} ({reason}' in out


def test_the_next_commands_can_be_typed(bag, on_terminal, tmp_path, monkeypatch):
    _, out, _ = on_terminal(bag, '--name', 'testing', '--split', '0.5')
    lines = out.partition('Next:\n')[2].splitlines()
    commands = [line.strip() for line in lines if not line.startswith('  #')]
    assert len(commands) == 3
    for command in commands:
        program, *words = shlex.split(command.partition(' > ')[0])
        assert program == 'kitti-ros2'
        name, found = find_command(words)
        found.make_context(name, words[1:])
    monkeypatch.chdir(tmp_path)
    preview, _, convert = (shlex.split(each)[1:] for each in commands)
    assert main(preview) == 0
    assert main(convert) == 0
    assert (tmp_path / 'preview.png').is_file()
    assert (tmp_path / 'OUT/testing/velodyne/000011.bin').is_file()


def test_a_plan_file_is_shown_as_it_is(bag, on_terminal, tmp_path, capsys):
    assert main(['to-kitti', bag, '--layout', 'object', '--plan']) == 0
    plan = tmp_path / 'plan.yaml'
    text = capsys.readouterr().out
    plan.write_text(text.replace('/cam/left/image_raw', '/cam/left/image'))
    code, out, _ = on_terminal(bag, '--plan-file', plan)
    assert code == 0
    assert rows_of(out)['/cam/left/image_raw'][0] == '-'
    assert 'cannot be converted: the plan names /cam/left/image, of which the bag has no' in out
    assert 'OUT' not in out.partition('Next:')[2]


def test_what_is_missing_is_told_and_how_a_conversion_would_fail(write, on_terminal):
    path = write('no_tf', '/tf_static', '/perception/objects')
    code, out, _ = on_terminal(path, '--layout', 'object')
    assert code == 0
    assert 'note: missing: labels' in out
    assert 'cannot be converted: no static transform from os_sensor to cam_left_optical' in out


def test_a_bag_of_our_own_comes_back_as_it_was(recordings, on_terminal, tmp_path):
    own = tmp_path / 'own.mcap'
    assert main(['to-bag', str(recordings[Layout.OBJECT]), str(own), '-q']) == 0
    code, out, _ = on_terminal(own)
    assert code == 0
    assert 'made by to-bag: without a plan every file of training comes back as it was' in out
    code, out, _ = on_terminal(own, tmp_path / 'out', '--preview', tmp_path / 'own.png')
    assert code == 0
    assert 'stream ' not in out
    assert f'{tmp_path / "own.png"}: preview, layout object, frames 0, 2, 4,' in out
    assert cv2.imread(str(tmp_path / 'own.png')).shape[0] > 300
    back = tmp_path / 'out/training/velodyne/000003.bin'
    assert (
        back.read_bytes()
        == (recordings[Layout.OBJECT] / back.relative_to(tmp_path / 'out')).read_bytes()
    )


def test_images_of_our_own_of_any_size_are_drawn(tmp_path, capsys):
    """Frames of an object set are of several days, and so of several sizes."""
    folder = tmp_path / 'set/training'
    options = SyntheticOptions(frames=3, image_size=(414, 125), lidar_columns=300)
    write_synthetic(tmp_path / 'set', Layout.OBJECT, options)
    image = folder / 'image_2/000001.png'
    cv2.imwrite(str(image), cv2.imread(str(image))[:100])
    own, picture = str(tmp_path / 'own.mcap'), tmp_path / 'own.png'
    assert main(['to-bag', str(folder), own, '-q']) == 0
    assert main(['to-kitti', own, '--preview', str(picture)]) == 0
    said = capsys.readouterr()
    assert (said.err, 'frames 0, 1, 2' in said.out) == ('', True)
    assert cv2.imread(str(picture)).shape[1] == 2 * 414 + 6


@pytest.mark.parametrize('words', [[], ['-q'], ['--layout', 'object']])
def test_a_script_without_an_output_is_refused_as_ever(words, bag, capsys):
    assert main(['to-kitti', bag, *words]) == 2
    said = capsys.readouterr()
    assert said.out == ''
    assert MISSING in one_line(said.err)


def test_quiet_is_refused_without_an_output_in_a_terminal_too(bag, on_terminal):
    code, out, err = on_terminal(bag, '-q')
    assert (code, out) == (2, '')
    assert MISSING in err


def test_the_plan_as_json(bag, capsys):
    assert main(['to-kitti', bag, '--json']) == 0
    values = json.loads(capsys.readouterr().out)
    assert values['layout'] == 'object'
    assert values['frames'] == foreign.FRAMES
    assert values['faults'] == []
    topics = {each['topic']: each for each in values['topics']}
    scan = topics['/sensors/ouster/points']
    assert scan['streams'] == ['scan']
    assert (scan['count'], scan['frame']) == (12, 'os_sensor')
    assert scan['rate_hz'] == pytest.approx(10, abs=0.1)
    assert topics['/tf_static']['rate_hz'] is None
    assert '/odom' in [each['topic'] for each in values['passed_over']]
    assert values['plan']['cameras']['2']['topic'] == '/cam/left/image_raw'
    assert set(values['layouts']) == {layout.value for layout in OF_OTHERS}


def test_an_output_gets_the_table_first_in_a_terminal_alone(bag, on_terminal, tmp_path, capsys):
    assert main(['to-kitti', bag, str(tmp_path / 'piped'), '--layout', 'object']) == 0
    piped = capsys.readouterr().out
    code, out, err = on_terminal(bag, tmp_path / 'shown', '--layout', 'object')
    assert (code, err) == (0, '')
    assert 'stream ' not in piped
    lines = out.splitlines()
    rest = lines[lines.index('-: passed over in this layout') + 1 :]
    assert rest[:-1] == piped.splitlines()[:-1]
    assert len(rows_of(out)) == 11
    assert files_of(tmp_path / 'shown') == files_of(tmp_path / 'piped')


@pytest.mark.parametrize('words', [['-q'], ['--json']])
def test_an_output_gets_no_table_where_it_is_not_wanted(words, bag, on_terminal, tmp_path):
    code, out, _ = on_terminal(bag, tmp_path / 'out', '--layout', 'object', *words)
    assert code == 0
    assert 'stream ' not in out


def test_an_output_still_needs_a_layout(bag, on_terminal, tmp_path):
    code, out, err = on_terminal(bag, tmp_path / 'out')
    assert (code, out) == (2, '')
    assert 'which layout is wanted? give --layout raw, object' in one_line(err)


def test_bags_alone_are_one_recording(write, bag, on_terminal, tmp_path):
    other = write('scans', *CAMERAS, '/perception/objects', '/tf_static', '/imu/data')
    code, out, _ = on_terminal(bag, other)
    assert code == 0
    assert rows_of(out)['/sensors/ouster/points'][2] == '24'
    assert rows_of(out)['/imu/data'][2] == '130'
    picture = tmp_path / 'both.png'
    assert main(['to-kitti', bag, other, '--preview', str(picture), '-q']) == 0
    assert picture.is_file()


def test_a_preview_is_made_without_an_output(bag, tmp_path, capsys):
    picture = tmp_path / 'check.png'
    assert main(['to-kitti', bag, '--preview', str(picture)]) == 0
    said = capsys.readouterr()
    assert re.fullmatch(
        rf'{picture}: preview, layout object, frames 0, 6, 11, 1286x\d+, [\d.]+ kB\n', said.out
    )
    assert said.err == ''
    assert cv2.imread(str(picture)).shape[1] == 1286
    assert [*tmp_path.iterdir()] == [picture]


def test_a_preview_is_made_before_the_output(bag, tmp_path, capsys):
    picture, out = tmp_path / 'check.jpg', tmp_path / 'out'
    words = ['to-kitti', bag, str(out), '--layout', 'object', '--preview', str(picture)]
    assert main([*words, '--json']) == 0
    values = json.loads(capsys.readouterr().out)
    assert values['preview'] == {
        'path': str(picture),
        'frames': [0, 6, 11],
        'missing': [],
        'losses': [],
    }
    assert picture.read_bytes().startswith(b'\xff\xd8\xff')
    assert (out / 'training/velodyne/000011.bin').is_file()


def test_a_picture_is_replaced_with_overwrite_only(bag, tmp_path, capsys):
    picture = tmp_path / 'check.png'
    words = ['to-kitti', bag, '--preview', str(picture), '-q']
    assert main(words) == 0
    whole = picture.read_bytes()
    assert main(words) == 2
    assert 'exists already' in one_line(capsys.readouterr().err)
    assert main([*words, '--overwrite']) == 0
    assert picture.read_bytes() == whole
    picture.write_text('a letter')
    assert main([*words, '--overwrite']) == 2
    assert 'it is no picture or film' in one_line(capsys.readouterr().err)
    assert picture.read_text() == 'a letter'


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['{bag}', '--preview', '{tmp}/check.pdf'], 'unsupported ending; expected .png, .jpg'),
        (['{bag}', '{tmp}/out', '--preview', '{tmp}/out/check.png'], 'lies inside OUT'),
        (['{bag}', '--preview', '{tmp}/check.png', '--plan'], 'and --preview without --plan'),
        (['{poses}', '--preview', '{tmp}/check.png'], 'nothing to draw for --preview: no scan'),
        (['{tmp}/none.mcap', '--preview', '{tmp}/check.png'], 'none.mcap'),
        (['{bag}', '--preview', '{tmp}/check.png', '--start', '99'], 'the selection takes no'),
    ],
    ids=['ending', 'in the output', 'with the plan', 'no picture', 'no bag', 'no frame'],
)
def test_a_wrong_preview_is_one_line_and_leaves_nothing(words, said, bag, write, tmp_path, capsys):
    poses = write('4odometry', *CAMERAS, '/sensors/ouster/points')
    filled = [word.format(bag=bag, tmp=tmp_path, poses=poses) for word in words]
    assert main(['to-kitti', *filled]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert [*tmp_path.iterdir()] == []


def test_a_plan_without_calibration_is_drawn_as_far_as_it_goes(write, tmp_path, capsys):
    path = write('no_tf', '/tf_static', '/perception/objects')
    picture = tmp_path / 'check.png'
    words = ['to-kitti', path, '--layout', 'object', '--preview', str(picture)]
    assert main(words) == 0
    assert (
        'note: no points and boxes on images: no static transform from' in capsys.readouterr().out
    )
    assert main([*words, '--overwrite', str(tmp_path / 'out')]) == 2
    assert picture.is_file()
    assert not (tmp_path / 'out').exists()


def test_many_topics_that_are_passed_over_are_counted(bag, on_terminal, monkeypatch):
    monkeypatch.setattr('kitti_ros2.cli.to_kitti._MOST_UNUSED', 1)
    _, out, _ = on_terminal(bag)
    assert len([topic for topic, row in rows_of(out).items() if row[0] == '-']) == 1
    assert '3 more; all with --json' in out
