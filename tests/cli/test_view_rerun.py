# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 view --rerun: exit codes, what is said, and what is left behind."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from importlib.util import find_spec

import pytest
from prediction_set import write_prediction_set

from kitti_ros2.cli import main
from kitti_ros2.cli.view import run_rerun
from kitti_ros2.model.errors import OutputError, OutputExistsError, UsageError
from kitti_ros2.model.streams import Layout

from waiting import PATIENCE_S  # isort: skip

needs_sdk = pytest.mark.skipif(find_spec('rerun') is None, reason='rerun-sdk is not installed')
RUN = 'import sys; from pathlib import Path; from kitti_ros2.cli.view import run_rerun;'


@pytest.fixture
def raw(recordings):
    return recordings[Layout.RAW]


def test_without_the_sdk_it_says_what_to_install(raw, tmp_path, monkeypatch):
    monkeypatch.setattr('kitti_ros2.cli.view.find_spec', lambda _: None)
    with pytest.raises(UsageError, match=r"pip install 'kitti_ros2\[rerun\]'") as caught:
        run_rerun(raw, {}, save=tmp_path / 'o.rrd')
    assert '\n' not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_web_and_save_exclude_each_other(raw, tmp_path):
    with pytest.raises(UsageError, match='exclude each other'):
        run_rerun(raw, {}, web=True, save=tmp_path / 'o.rrd')


@needs_sdk
def test_a_file_is_written_once_and_replaced_on_request(raw, tmp_path, capsys):
    out = tmp_path / 'new' / 'o.rrd'
    assert run_rerun(raw, {}, save=out) == 0
    assert 'messages, 5 frames' in capsys.readouterr().out
    before = out.read_bytes()
    with pytest.raises(OutputExistsError, match='exists already'):
        run_rerun(raw, {}, save=out)
    assert out.read_bytes() == before
    assert run_rerun(raw, {}, save=out, overwrite=True, quiet=True) == 0
    assert capsys.readouterr().out == ''
    assert [each.name for each in out.parent.iterdir()] == ['o.rrd']


@needs_sdk
def test_predictions_are_shown_and_what_is_missing_is_named(recordings, tmp_path, capsys):
    made = write_prediction_set(recordings[Layout.OBJECT], tmp_path)
    words = ['view', str(made.root), '--rerun', '--save', str(tmp_path / 'o.rrd')]
    assert main([*words, '--predictions', str(made.results), '--iou', '0.5', '-q']) == 1
    assert 'no result file for frames 4' in capsys.readouterr().err
    assert (tmp_path / 'o.rrd').stat().st_size


@needs_sdk
def test_overwrite_spares_what_is_no_rrd_file(raw, tmp_path):
    for name, text in (('notes.rrd', 'mine'), ('other.rrd', 'mine as well')):
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(OutputExistsError, match=r'it is no \.rrd file'):
            run_rerun(raw, {}, save=path, overwrite=True)
        assert path.read_text() == text


@needs_sdk
def test_a_selection_takes_less(raw, tmp_path):
    assert run_rerun(raw, {}, save=tmp_path / 'all.rrd') == 0
    assert run_rerun(raw, {'start': '1', 'end': '2'}, save=tmp_path / 'few.rrd') == 0
    assert run_rerun(raw, {'topics': ['/kitti/oxts/fix']}, save=tmp_path / 'fix.rrd') == 0
    every, few, fix = ((tmp_path / f'{n}.rrd').stat().st_size for n in ('all', 'few', 'fix'))
    assert fix < few < every
    with pytest.raises(UsageError, match='no topic is called'):
        run_rerun(raw, {'topics': ['/nothing']}, save=tmp_path / 'none.rrd')
    with pytest.raises(UsageError, match='no topic is called'):
        run_rerun(raw, {'exclude_topics': ['image']}, save=tmp_path / 'none.rrd')


@needs_sdk
def test_what_is_broken_or_missing_is_named_and_the_exit_code_is_1(drive, tmp_path, capsys):
    image = sorted((drive / 'image_02' / 'data').iterdir())[1]
    image.write_bytes(image.read_bytes()[:100])
    sorted((drive / 'velodyne_points' / 'data').iterdir())[2].unlink()
    assert run_rerun(drive, {}, save=tmp_path / 'o.rrd') == 1
    errors = capsys.readouterr().err
    assert 'missing: scan: ' in errors
    assert '/kitti/camera_color_left/image_rect/compressed: ' in errors
    assert 'the PNG is cut after 100 bytes' in errors
    assert 'exit code 1' in errors


@needs_sdk
def test_a_full_disk_is_one_line_and_leaves_nothing(raw, tmp_path):
    """A limit on the size of files stands for a disk with too little room."""
    limited = (
        f'{RUN} import resource, signal;'
        ' signal.signal(signal.SIGXFSZ, signal.SIG_IGN);'
        ' resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000));'
        ' run_rerun(Path(sys.argv[1]), {}, save=Path(sys.argv[2]))'
    )
    done = subprocess.run(
        [sys.executable, '-c', limited, raw, tmp_path / 'o.rrd'],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert OutputError.__name__ in done.stderr.splitlines()[-1]
    assert 'o.rrd: cannot be written (File too large)' in done.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@needs_sdk
def test_without_a_display_it_says_what_else_there_is(raw, monkeypatch):
    monkeypatch.setattr(sys, 'platform', 'linux')
    monkeypatch.delenv('DISPLAY', raising=False)
    monkeypatch.delenv('WAYLAND_DISPLAY', raising=False)
    with pytest.raises(UsageError, match=r'no display.*--web.*--save'):
        run_rerun(raw, {})


@needs_sdk
def test_a_viewer_that_ends_at_once_says_why(raw, monkeypatch):
    monkeypatch.setattr(sys, 'platform', 'linux')
    monkeypatch.setenv('DISPLAY', ':4242')
    monkeypatch.delenv('WAYLAND_DISPLAY', raising=False)
    with pytest.raises(UsageError, match=r'the viewer ended: .*--web.*--save'):
        run_rerun(raw, {})


@needs_sdk
def test_the_page_is_served_on_this_machine_alone_until_ctrl_c(raw):
    process = subprocess.Popen(
        [
            sys.executable,
            '-c',
            f'{RUN} sys.exit(run_rerun(Path(sys.argv[1]), {{}}, web=True))',
            raw,
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        url = process.stdout.readline().strip()
        assert url.startswith('http://127.0.0.1:')
        with urllib.request.urlopen(url) as page:
            assert b'rerun' in page.read().lower()
        port = int(url.split(':')[2].split('/')[0])
        assert not reached(other_address(), port)
        lines = [process.stdout.readline() for _ in range(2)]
        assert 'Ctrl-C ends it' in lines[-1]
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=PATIENCE_S) == 0
        assert not reached('127.0.0.1', port)
    finally:
        process.kill()
        process.wait()


def reached(address, port):
    try:
        with socket.create_connection((address, port), timeout=PATIENCE_S):
            return True
    except OSError:
        return False


def other_address():
    """Another address of this machine than the one that is served: all of 127/8 are its own."""
    return '127.0.0.2' if os.name == 'posix' and sys.platform == 'linux' else socket.gethostname()
