# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command line as a user meets it: exit codes, one line for each error, help."""

from __future__ import annotations

import errno
import json
import os
import shlex
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2
import foreign
import numpy as np
import pytest
from broken_lock import break_a_lock
from folder_and_bag import make_holes

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.cli.command import load_config
from kitti_ros2.files.local_staging import Staging
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.errors import one_line as as_shown
from kitti_ros2.model.streams import Clock, Layout
from kitti_ros2.options.declare import parse_bytes
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.table import TO_BAG_OPTIONS, make_settings

from builders import SMALL, one_line  # isort: skip
from waiting import PATIENCE_S, UNTIL_A_SIGNAL, wait_until  # isort: skip

ROOT = Path(__file__).resolve().parents[2]
RUN = [sys.executable, '-m', 'kitti_ros2']


def test_to_bag_says_what_it_guessed_and_did(recording_path, tmp_path, capsys):
    out = tmp_path / 'out.mcap'
    assert main(['to-bag', str(recording_path), str(out)]) == 0
    said = capsys.readouterr()
    assert f'layout {open_recording(recording_path).layout.value}' in said.out
    assert f'{out}: ' in said.out
    assert f'{SMALL.frames} frames' in said.out
    assert '--images raw' in said.out
    assert not said.err
    assert out.is_file()


def test_quiet_says_nothing_when_all_is_well(recordings, tmp_path, capsys):
    assert main(['to-bag', str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), '-q']) == 0
    assert capsys.readouterr() == ('', '')


def test_losses_are_named_and_the_exit_code_says_so(drive, tmp_path, capsys):
    (drive / 'velodyne_points' / 'data' / '0000000001.bin').write_bytes(b'short')
    assert main(['to-bag', str(drive), str(tmp_path / 'o.mcap'), '-q']) == 1
    said = capsys.readouterr().err
    assert '0000000001.bin: 5 bytes, cut inside a point; expected a multiple of 16 bytes' in said
    assert '2 skipped in all, listed above; exit code 1' in said
    assert (tmp_path / 'o.mcap').is_file()


def test_strict_leaves_nothing(drive, tmp_path, capsys):
    (drive / 'velodyne_points' / 'data' / '0000000001.bin').write_bytes(b'short')
    (tmp_path / 'to').mkdir()
    assert main(['to-bag', str(drive), str(tmp_path / 'to' / 'o.mcap'), '-q', '--strict']) == 2
    assert '0000000001.bin' in one_line(capsys.readouterr().err)
    assert not list((tmp_path / 'to').iterdir())


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['to-bag'], 'usage: kitti-ros2 to-bag SRC OUT'),
        (['to-bag', 'x'], 'OUT is missing (the bag: '),
        (['to-bag', '{tmp}/absent', '{tmp}/o.mcap'], '{tmp}/absent: no such file or folder'),
        (['to-bag', '{tmp}', '{tmp}/o.mcap'], 'the folder is empty'),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--bogus'], 'there is no option --bogus'),
        (
            ['to-bag', '{raw}', '{tmp}/o.mcap', '--images', 'jpeg'],
            "compressed, raw or both, not 'jpeg'",
        ),
        (
            ['to-bag', '{raw}', '{tmp}/o.mcap', '--layout', 'nuscenes'],
            'raw, object, odometry, tracking or kitti360',
        ),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--storage', 'sqlite3'], '.mcap means storage mcap'),
        (['to-bag', '{raw}', '{tmp}/o.bag', '--compression', 'zstd'], 'none, lz4 or bz2'),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--start', 'noon'], "invalid start or end 'noon'"),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--start', '900'], 'takes no sample'),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--split-size', 'much'], 'a size such as 2GB'),
        (
            ['to-bag', '{raw}', '{tmp}/o', '--split-size', '2'],
            'split_size 2 is less than 1MB; give a size with its unit',
        ),
        (['to-bag', '{raw}', '{tmp}/o', '--split-size', '999kB'], '999kB is less than 1MB'),
        (
            ['to-bag', '{raw}', '{tmp}/o.mcap', '--start', '3.5s', '--end', '2s'],
            'the end (2s) is before the start (3.5s)',
        ),
        (
            ['to-bag', '{raw}', '{tmp}/o.mcap', '--start', '3', '--end', '2'],
            'the end (frame 2) is before the start (frame 3)',
        ),
        (
            ['play', '{raw}', '--start', '2012-01-01 00:00:00.5', '--end', '2012-01-01 00:00:00'],
            'the end (2012-01-01 00:00:00.000000000) is before the start (2012-01-01 00:00:00.5',
        ),
        (
            ['view', '{raw}', '-o', '{tmp}/x.mp4', '--frames', '3:2'],
            'last frame is before the first',
        ),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--semantic'], 'semantic is for the odometry layout'),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--config', '{tmp}/no.yaml'], 'no.yaml: No such file'),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--base-to-imu', '1,2'], 'three finite numbers'),
        (['to-bag', '{raw}', '{tmp}/o.mcap', '--epoch', 'today'], 'UTC time'),
        (['to-bag', '{raw}', '{raw}/o.mcap'], 'inside the recording'),
        (['info', '{tmp}/absent'], 'no such file or folder'),
        (['info', '{tmp}'], 'the folder is empty'),
        (['nonsense'], 'there is no command nonsense'),
        (['demo', '{tmp}/d', '--count', '0'], 'expected 1 to'),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(recordings, tmp_path, capsys, words, said):
    places = {'tmp': tmp_path, 'raw': recordings[Layout.RAW]}
    assert main([word.format(**places) for word in words]) == 2
    captured = capsys.readouterr()
    assert said.format(**places) in one_line(captured.err)
    assert not list(tmp_path.iterdir())


def test_output_that_exists_and_overwrite(recordings, tmp_path, capsys):
    words = ['to-bag', str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), '-q']
    assert main(words) == 0
    assert main(words) == 2
    assert 'exists already; ' in one_line(capsys.readouterr().err)
    assert main([*words, '--overwrite']) == 0


def test_debug_shows_the_traceback(tmp_path):
    with pytest.raises(Exception, match='no such file or folder'):
        main(['--debug', 'to-bag', str(tmp_path / 'absent'), str(tmp_path / 'o')])


def test_an_unforeseen_error_is_one_line_too(recordings, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('kitti_ros2.own_bags.to_bag.convert', lambda *_, **__: 1 / 0)
    assert main(['to-bag', str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), '-q']) == 2
    assert 'internal error, ZeroDivisionError' in one_line(capsys.readouterr().err)


@pytest.mark.parametrize('lock', [threading.Lock, threading.RLock], ids=['Lock', 'RLock'])
def test_an_interruption_that_breaks_a_lock_is_no_error(lock, tmp_path, capsys, monkeypatch):
    words = ['to-bag', str(tmp_path), str(tmp_path / 'o.mcap')]
    monkeypatch.setattr('kitti_ros2.cli.app.run', lambda _: break_a_lock(lock, KeyboardInterrupt))
    assert main(words) == 130
    assert 'interrupted; ' in one_line(capsys.readouterr().err)
    monkeypatch.setattr('kitti_ros2.cli.app.run', lambda _: break_a_lock(lock, SystemExit(143)))
    with pytest.raises(SystemExit, match='143'):
        main(words)
    monkeypatch.setattr('kitti_ros2.cli.app.run', lambda _: break_a_lock(lock, ValueError))
    assert main(words) == 2
    assert 'internal error, RuntimeError' in one_line(capsys.readouterr().err)


@pytest.mark.parametrize(
    'words', [['--help'], ['to-bag', '--help'], ['info', '-h'], ['demo', '-h']]
)
def test_help_fits_80_columns(words, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    assert main(words) == 0
    said = capsys.readouterr().out
    assert 'Usage: kitti-ros2' in said
    assert max(map(len, said.splitlines())) <= 80


def test_info_of_a_recording_fits_80_columns(recording_path, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    assert main(['info', str(recording_path)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert any(line.startswith('scan') and f' {SMALL.frames} ' in line for line in said)
    assert (
        max(len(line) for line in said if not line.startswith(('note', str(recording_path)))) <= 80
    )


@pytest.mark.parametrize('name', ['o.mcap', 'o', 'o.bag'])
def test_info_of_what_to_bag_wrote(recordings, tmp_path, capsys, name):
    assert main(['to-bag', str(recordings[Layout.RAW]), str(tmp_path / name), '-q']) == 0
    assert main(['info', str(tmp_path / name), '--json']) == 0
    seen = json.loads(capsys.readouterr().out)
    counts = {series['name']: series['count'] for series in seen['series']}
    assert counts['/kitti/velo/points'] == SMALL.frames
    assert counts['/tf_static'] == 1
    assert [camera['name'] for camera in seen['cameras']] == [
        f'/kitti/camera_{name}/camera_info'
        for name in ('color_left', 'color_right', 'gray_left', 'gray_right')
    ]
    baselines = [camera['baseline_m'] for camera in seen['cameras']]
    assert baselines[0] == pytest.approx(0, abs=1e-9)
    assert baselines[3] == pytest.approx(0.54, abs=0.01)
    assert {link['child'] for link in seen['links']} >= {'imu_link', 'velo_link'}


TIMES = ('start_ns', 'end_ns', 'duration_ns')
SERIES_TIMES = (
    'start_ns', 'end_ns', 'median_period_ns', 'largest_gap_ns', 'largest_gap_at_ns', 'mean_rate_hz'
)  # fmt: skip


def look_at(path, capsys):
    """What info says of a path, in words and as JSON."""
    main(['info', str(path)])
    said = capsys.readouterr().out
    main(['info', str(path), '--json'])
    text = capsys.readouterr().out
    assert 'NaN' not in text
    assert '-0.0,' not in text
    return said, json.loads(text)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('name', ['', 'o.mcap', 'o', 'o.bag'])
@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_info_invents_no_times(recordings, tmp_path, capsys, layout, name):
    source = recordings[layout]
    if name:
        assert main(['to-bag', str(source), str(tmp_path / name), '-q']) == 0
        source = tmp_path / name
    said, seen = look_at(source, capsys)
    assert 'no time stamps' in said
    assert not any(word in said for word in (' Hz', 'UTC', '2011-09-26', '10.0', ' s,'))
    assert [seen[name] for name in TIMES] == [None] * len(TIMES)
    assert seen['clock'] == 'nominal'
    assert seen['frames'] == SMALL.frames
    for series in seen['series']:
        assert [series[name] for name in SERIES_TIMES] == [None] * len(SERIES_TIMES)


@pytest.mark.parametrize('name', ['', 'o.mcap'])
def test_info_of_relative_times_has_no_date(recordings, tmp_path, capsys, name):
    source = recordings[Layout.ODOMETRY]
    if name:
        assert main(['to-bag', str(source), str(tmp_path / name), '-q']) == 0
        source = tmp_path / name
    said, seen = look_at(source, capsys)
    assert 'no date' in said
    assert 'UTC' not in said
    assert seen['clock'] == 'relative'
    assert seen['start_ns'] is seen['end_ns'] is None
    assert seen['duration_ns'] > 0
    rates = {series['name']: series['mean_rate_hz'] for series in seen['series']}
    assert rates['/kitti/velo/points' if name else 'scan'] == pytest.approx(10, abs=0.5)
    assert all(series['start_ns'] is None for series in seen['series'])


def test_info_of_absolute_times_has_all(recordings, capsys):
    said, seen = look_at(recordings[Layout.RAW], capsys)
    assert 'UTC' in said
    assert seen['clock'] == 'utc'
    assert seen['duration_ns'] == seen['end_ns'] - seen['start_ns'] > 0


def test_info_knows_no_size_where_only_images_have_it(recordings, capsys):
    _, seen = look_at(recordings[Layout.OBJECT], capsys)
    assert {(each['width'], each['height']) for each in seen['cameras']} == {(None, None)}
    assert seen['cameras'][0]['baseline_m'] == 0
    assert str(seen['cameras'][0]['baseline_m']) == '0.0'


def test_info_of_a_camera_that_is_not_calibrated(tmp_path, capsys):
    """Drivers without a calibration fill in zeros, and some NaN."""

    def uncalibrated(topic, _place, message):
        if topic.endswith('camera_info'):
            message.k[:] = 0 if 'left' in topic else np.nan
            message.p[:] = 0 if 'left' in topic else np.nan
            message.width = message.height = 0
        return message

    path = tmp_path / 'bag.mcap'
    foreign.write_foreign(path, foreign.make_truth(), 'mcap', change=uncalibrated)
    said, seen = look_at(path, capsys)
    assert seen['frames'] is None
    for camera in seen['cameras']:
        assert {camera[name] for name in camera if name != 'name'} == {None}
    assert 'nan' not in said


def test_info_of_an_empty_bag(tmp_path, capsys):
    with open_bag(tmp_path / 'o.mcap', BagOptions(), TYPESTORE):
        pass
    said, seen = look_at(tmp_path / 'o.mcap', capsys)
    assert '0 messages' in said
    assert [seen[name] for name in TIMES] == [None] * len(TIMES)


@pytest.mark.parametrize('layout', list(Layout))
def test_frames_are_counted_alike_by_all_commands(recordings, tmp_path, capsys, layout):
    """12 numbers are 12 frames, though 10 have a scan, or none."""
    source = make_holes(recordings[layout], layout, tmp_path / 'k')
    frames = SMALL.frames
    bag, back = tmp_path / 'o.mcap', tmp_path / 'back'
    main(['to-bag', str(source), str(bag)])
    said = capsys.readouterr().out
    assert f', {frames} frames' in said
    assert ('of recording' in said) == (layout.traits.clock is not Clock.NOMINAL)
    main(['to-kitti', str(bag), str(back)])
    assert f', {frames} frames,' in capsys.readouterr().out
    for path in (source, bag):
        said, seen = look_at(path, capsys)
        assert seen['frames'] == frames
        assert f', {frames} frames,' in said


def test_a_sequence_of_labels_alone_has_frames(real_kitti, tmp_path, capsys):
    """Tracking 0000 here has 154 frames of labels and packets, no scan and no image."""
    bag = tmp_path / 'o.mcap'
    main(['to-bag', str(real_kitti / 'tracking'), str(bag)])
    main(['to-kitti', str(bag), str(tmp_path / 'back')])
    assert capsys.readouterr().out.count(', 154 frames') == 2


def test_info_counts_what_is_missing(drive, capsys):
    (drive / 'image_02' / 'data' / '0000000001.png').unlink()
    assert main(['info', str(drive)]) == 1
    said = capsys.readouterr()
    assert 'skipped image_2 (1)' in said.err
    assert 'camera_color_right' in said.out


def test_demo_makes_converts_and_shows(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PATH', '/usr/bin')
    monkeypatch.setenv('COLUMNS', '80')
    assert main(['demo', 'd', '--count', '2']) == 0
    said = capsys.readouterr().out
    assert '/kitti/velo/points' in said
    # The longest topic beside the longest type: neither is broken over two lines.
    assert '/kitti/camera_color_right/image_rect/compressed ' in said
    assert 'Detection3DArray' in said
    next_steps = [
        shlex.split(line, comments=True) for line in said.splitlines() if line[:3] == '  k'
    ]
    assert [words[1] for words in next_steps] == [
        'view',
        'report',
        'play',
        'play',
        'info',
        'to-bag',
    ]
    for words in next_steps[:2]:
        assert main([word for word in words[1:] if word != '--open']) == 0
    assert (tmp_path / 'd' / 'bag' / 'metadata.yaml').is_file()
    assert said.endswith('\nA picture of a frame: d/panel.png\n')
    assert cv2.imread('d/panel.png').size > 1_000_000
    assert main(['demo', 'd', '--count', '2']) == 2
    assert main(['demo', 'd', '--count', '2', '--overwrite', '-q']) == 0


@pytest.mark.parametrize('place', ['', 'not on the path', 'on the path'])
def test_the_next_steps_begin_with_the_activation_of_the_environment(
    tmp_path, capsys, monkeypatch, place
):
    """Only where the command is in an environment that is not active."""
    programs = tmp_path / 'an environment/bin'
    programs.mkdir(parents=True)
    for name in ('activate', 'kitti-ros2') if place else ():
        (programs / name).touch(mode=0o755)
    monkeypatch.setattr(sys, 'prefix', str(programs.parent))
    monkeypatch.setenv('PATH', str(programs) if place == 'on the path' else '/usr/bin')
    assert main(['demo', str(tmp_path / 'd'), '--count', '1']) == 0
    steps = capsys.readouterr().out.partition('What to do next:\n')[2]
    words = shlex.split(steps.splitlines()[0])
    expected = ['.', f'{programs}/activate'] if place == 'not on the path' else ['kitti-ros2']
    assert words[: len(expected)] == expected


def test_a_demo_that_the_disk_refuses_is_named(tmp_path, capsys, monkeypatch):
    def full(*_args, **_options):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr('kitti_ros2.synthetic.write_synthetic', full)
    assert main(['demo', str(tmp_path / 'd')]) == 2
    said = capsys.readouterr().err
    assert f'{tmp_path}/d/kitti: the disk is full (No space left on device)' in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT])
def test_a_demo_replaces_its_own_recording_only(layout, tmp_path, capsys):
    words = ['demo', str(tmp_path / 'd'), '--count', '2', '--layout', layout.value, '-q']
    assert main(words) == 0
    assert main([*words, '--overwrite']) == 0
    assert sorted(path.name for path in (tmp_path / 'd').iterdir()) == ['bag', 'kitti', 'panel.png']
    (tmp_path / 'd/kitti/thesis.pdf').touch()
    assert main([*words, '--overwrite']) == 2
    assert 'it is no KITTI data set' in capsys.readouterr().err
    assert (tmp_path / 'd/kitti/thesis.pdf').exists()


def test_a_demo_waits_for_no_other_and_follows_no_link(tmp_path, capsys):
    words = ['demo', str(tmp_path / 'd'), '--count', '2', '-q']
    running = Staging(tmp_path / 'd/kitti', lambda _: None)
    assert main([*words, '--overwrite']) == 2
    running.discard()
    assert 'another run' in capsys.readouterr().err
    (tmp_path / 'link').symlink_to(tmp_path / 'd')
    assert main(['demo', str(tmp_path / 'link'), '-q']) == 2
    assert 'it is a symbolic link; give the path it points to' in capsys.readouterr().err
    (tmp_path / 'loop').symlink_to('loop')
    assert main(['demo', str(tmp_path / 'loop/d'), '-q']) == 2
    assert 'loop/d/kitti: cannot be written' in one_line(capsys.readouterr().err)


def test_config_file_gives_options_and_the_command_line_wins(recordings, tmp_path):
    config = tmp_path / 'c.yaml'
    config.write_text('streams: [scan, oxts]\nend: 1\nimages: raw\n')
    out = tmp_path / 'o.mcap'
    words = ['to-bag', str(recordings[Layout.RAW]), str(out), '-q', '--config', str(config)]
    assert main([*words, '--end', '2']) == 0
    from kitti_ros2.bags.reader import summarize_bag  # noqa: PLC0415

    counts = {topic.name: topic.count for topic in summarize_bag(out).topics}
    assert counts['/kitti/velo/points'] == 3
    assert not any('camera' in topic for topic in counts)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('imges: raw', "unknown option 'imges'"),
        ('- a\n- b', 'not a mapping'),
        ('a: [1,\nb: 2', ':2: invalid YAML'),
        ('images: 3', "compressed, raw or both, not '3'"),
        ('tf: maybe', 'true or false'),
        ('images: raw\nimages: both', ":2: .*'images' is there twice"),
        ('a: &a [*a]', 'an alias refers to what it is in'),
    ],
)
def test_bad_config_files(tmp_path, text, said):
    path = tmp_path / 'c.yaml'
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        make_settings(load_config(path, TO_BAG_OPTIONS))


def test_a_pipe_as_config_is_refused(tmp_path):
    path = tmp_path / 'c.yaml'
    os.mkfifo(path)
    with pytest.raises(UsageError, match='is no regular file'):
        load_config(path, TO_BAG_OPTIONS)


HOSTILE_VALUES = {
    'digits': '9' * 5000,
    'negative digits': f'-{"9" * 5000}',
    'a long fraction': f'{"9" * 400}.5',
    'a large number': '1e999',
    'infinite': '-.inf',
    'no number': '.nan',
    'an empty list': '[]',
    'an empty mapping': '{}',
    'an empty text': "''",
    'nested': '[[a], {b: c}]',
    'a mapping': '{a: 9e999}',
    'bytes': '!!binary aGVsbG8=',
    'a set': '!!set {a, b}',
    'a date': '2001-01-01',
    'a backslash': "'\\0'",
    'digits of another script': '٣',
    'numbers in a list': '[.nan, .inf, -.inf]',
    'true and nothing': '[true, null]',
    'a long list': f'[{", ".join("1" * 5000)}]',
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('name', TO_BAG_OPTIONS)
@pytest.mark.parametrize('kind', HOSTILE_VALUES)
def test_a_value_of_any_kind_is_valid_or_refused_in_a_short_line(tmp_path, name, kind):
    path = tmp_path / 'c.yaml'
    path.write_text(f'{name}: {HOSTILE_VALUES[kind]}')
    with suppress(UsageError), described_shortly():
        make_settings(load_config(path, TO_BAG_OPTIONS))


@contextmanager
def described_shortly():
    """Check that an error is one short line."""
    try:
        yield
    except UsageError as error:
        assert len(as_shown(str(error))) <= 2000  # noqa: PT017 - no error is right, too
        raise


def test_the_installed_config_holds_every_option_at_its_default():
    values = load_config(ROOT / 'config' / 'to_bag.yaml', TO_BAG_OPTIONS)
    defaults = make_settings({})
    settings = make_settings(values)
    for part in ('read', 'messages', 'selection', 'storage', 'strict'):
        assert getattr(settings, part) == getattr(defaults, part), part
    assert settings.bag('mcap') == defaults.bag('mcap')
    assert set(values) == set(TO_BAG_OPTIONS)


@pytest.mark.parametrize(
    ('text', 'size'),
    [('10', 10), ('2GB', 2 * 10**9), ('1.5 MB', 1_500_000), ('1GiB', 2**30), ('3k', 3000)],
)
def test_sizes(text, size):
    assert parse_bytes(text) == size


@pytest.mark.parametrize(
    ('sent', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 143)]
)
def test_an_interrupted_run_leaves_nothing_behind(recordings, tmp_path, sent, code):
    """Ended while it encodes: no bag, no left-overs, at most a line."""
    out = tmp_path / 'to' / 'o.mcap'
    out.parent.mkdir()
    waiting = f"""{UNTIL_A_SIGNAL}
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # tests may run under nohup
import kitti_ros2.own_bags.encode as e; old = e.Encoder.encode
e.Encoder.encode = lambda self, entry: signalled.wait() and old(self, entry)
from kitti_ros2.cli import main; sys.exit(main())
"""
    words = [sys.executable, '-c', waiting, 'to-bag', str(recordings[Layout.RAW]), str(out)]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    wait_until(lambda: list(out.parent.iterdir()) or process.poll() is not None)
    process.send_signal(sent)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code
    if sent == signal.SIGINT:
        assert 'interrupted' in one_line(said)
    assert not list(out.parent.iterdir())


def test_no_permission_is_one_line(recordings, tmp_path):
    if os.geteuid() == 0:
        pytest.skip('root may write anywhere')
    locked = tmp_path / 'locked'
    locked.mkdir(mode=0o555)
    done = subprocess.run(
        [*RUN, 'to-bag', str(recordings[Layout.RAW]), str(locked / 'o.mcap')],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert 'Permission denied' in done.stderr.splitlines()[-1]


@pytest.mark.one_in(3)
@pytest.mark.parametrize('closed', ['>&-', '2>&-', '>&- 2>&-', '<&-'])
@pytest.mark.parametrize(
    ('words', 'code'), [('info {path}', 0), ('info {path}/none', 2), ('--version', 0), ('info', 2)]
)
def test_streams_that_are_closed_are_done_without(recordings, closed, words, code):
    words = words.format(path=recordings[Layout.OBJECT])
    done = subprocess.run(
        ['sh', '-c', f'exec "$0" "$1" "$2" {words} {closed}', *RUN],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    assert 'internal error' not in done.stderr


@pytest.mark.parametrize('unbuffered', ['', '1'])
def test_output_that_is_refused_is_one_line(recordings, unbuffered):
    with Path('/dev/full').open('w') as full:
        done = subprocess.run(
            [*RUN, 'info', str(recordings[Layout.OBJECT])],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env=os.environ | {'PYTHONUNBUFFERED': unbuffered},
        )  # fmt: skip
    assert done.returncode == 2
    assert 'standard output: No space left on device' in one_line(done.stderr)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'name', [b'\xff\xfe', b'\x1b[31mred\x07', 'ü\u202egnp'.encode(), b'two\nlines']
)
@pytest.mark.parametrize('ending', [b'.mcap', b'.bag', b''])
def test_names_of_files_may_be_any_bytes_and_none_reaches_the_terminal(
    recordings, name, ending, tmp_path, capsys
):
    bag = os.fsdecode(os.fsencode(tmp_path) + b'/' + name + ending)
    copy = os.fsdecode(os.fsencode(tmp_path) + b'/copy' + name + ending)
    for words, code in (
        (['to-bag', str(recordings[Layout.OBJECT]), bag], 0),
        (['info', bag], 0),
        (['recover', bag, copy], 0),
        (['to-kitti', copy, f'{bag}.out'], 0),
        (['to-kitti', f'{bag}.none', f'{bag}.out'], 2),
    ):
        assert main(words) == code
        said = capsys.readouterr()
        lines = [*said.out.splitlines(), *said.err.splitlines()]
        assert lines
        assert all(line.isprintable() for line in lines)
    made, source = Path(f'{bag}.out'), recordings[Layout.OBJECT]
    assert {path.name for path in made.iterdir()} == {path.name for path in source.iterdir()}


@pytest.mark.parametrize(
    'words',
    [('info', '{drive}'), ('stats', '{drive}'), ('validate', '{drive}'), ('download', '--list')],
)
def test_a_reader_that_has_enough_is_no_failure(recordings, words):
    given = [word.format(drive=recordings[Layout.RAW]) for word in words]
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, 'wb') as unread:
        done = subprocess.run(
            [sys.executable, '-m', 'kitti_ros2', *given],
            check=False,
            stdout=unread,
            stderr=subprocess.PIPE,
        )
    assert (done.returncode, done.stderr) == (0, b'')


def test_the_exit_code_stays_where_nothing_can_be_told(tmp_path):
    words = [sys.executable, '-m', 'kitti_ros2', 'info', str(tmp_path / 'nowhere')]
    with open('/dev/full', 'wb') as full:  # noqa: PTH123 - a device
        assert subprocess.run(words, check=False, stderr=full).returncode == 2
