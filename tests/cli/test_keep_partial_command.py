# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-bag --keep-partial, stopped by Ctrl-C, SIGTERM and a full disk."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from kitti_ros2.bags.reader import summarize_bag
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import one_line  # isort: skip

STOPPED = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it
from kitti_ros2.bags.mcap_writer import McapFileWriter
from kitti_ros2.cli.boundary import main

number, done = int(sys.argv.pop(1)), McapFileWriter.write
written = []

def write(self, *what):
    written.append(what)
    if len(written) == 20:
        signal.raise_signal(number)
    done(self, *what)

McapFileWriter.write = write
sys.exit(main())
"""


@pytest.mark.one_in(3)
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize('keep', [True, False])
def test_the_error_line_names_what_is_kept(recordings, tmp_path, number, keep):
    out = tmp_path / 'o.mcap'
    words = [sys.executable, '-c', STOPPED, str(int(number)), 'to-bag', str(recordings[Layout.RAW])]
    words += [str(out), '-q', *(['--keep-partial'] if keep else [])]
    run = subprocess.run(words, capture_output=True, text=True, check=False)
    assert run.returncode == (130 if number == signal.SIGINT else 143)
    if not keep:
        assert not [*tmp_path.iterdir()]
        return
    kept = tmp_path / 'o.partial.mcap'
    assert [*tmp_path.iterdir()] == [kept]
    how = 'interrupted' if number == signal.SIGINT else 'terminated'
    said = one_line(run.stderr)
    assert said == f'kitti-ros2: {how}; 20 messages written so far are kept in {kept}'
    assert summarize_bag(kept).message_count == 20


TWICE = STOPPED.replace(
    'sys.exit(main())',
    """from kitti_ros2.files.local_staging import Staging
second, discard = int(sys.argv.pop(1)), Staging.discard

def discard_stopped(self):
    signal.raise_signal(second)
    discard(self)

Staging.discard = discard_stopped
sys.exit(main())""",
)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('second', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize('first', [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_does_not_cut_the_removal_short(recordings, tmp_path, first, second):
    words = [sys.executable, '-c', TWICE, str(int(first)), str(int(second)), 'to-bag']
    words += [str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), '-q']
    run = subprocess.run(words, capture_output=True, text=True, check=False)
    assert run.returncode == (130 if first == signal.SIGINT else 143)
    assert run.stderr.count('\n') == (first == signal.SIGINT)
    assert not [*tmp_path.iterdir()]


def test_a_collection_refuses_it(recordings, tmp_path, capsys):
    root = recordings[Layout.RAW].parent.parent
    assert main(['to-bag', str(root), str(tmp_path / 'o'), '--all', '--keep-partial']) == 2
    assert 'the next run converts again what was interrupted' in one_line(capsys.readouterr().err)
    assert not (tmp_path / 'o').exists()
