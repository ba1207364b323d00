# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a terminal shows of a player: whole lines of the log, and a line that is gone at the end."""

import os
import pty
import re
import subprocess
import sys

import pytest

from kitti_ros2.model.streams import Layout

from terminals import read_to_the_end  # isort: skip

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

LOG = re.compile(r'\[(INFO|WARN|ERROR)\] \[\d+\.\d+\] \[kitti_player\]: .+')
STATUS = r'\r\x1b\[K(playing|paused), frame \d of 0-4, \d\.\d\d s, rate 2\.00, dropped \d\r'


def play_in_a_terminal(*words):
    """The exit code, and all that was written to the terminal."""
    master, slave = pty.openpty()
    environment = {**os.environ, 'RCUTILS_COLORIZED_OUTPUT': '0', 'TERM': 'xterm'}
    command = [sys.executable, '-m', 'kitti_ros2', 'play', *map(str, words), '--no-keyboard']
    # The first terminal that the leader of a session opens is its controlling terminal.
    shell = ['sh', '-c', 'tty=$(tty); exec "$@" <$tty >$tty 2>&1', 'sh']
    process = subprocess.Popen(
        [*shell, *command], stdin=slave, env=environment, start_new_session=True
    )
    os.close(slave)
    written = read_to_the_end(master)
    return process.wait(), written.decode().replace('\r\n', '\n')


def test_the_status_is_one_line_and_the_log_is_whole(drive):
    (drive / 'oxts' / 'data' / '0000000003.txt').write_text('nonsense')
    code, written = play_in_a_terminal(drive, '--rate', '2', '--delay', '1')
    assert code == 1
    assert re.search(STATUS, written)
    shown = re.sub(r'\r\x1b\[K[^\r\n]*\r(?=\r\x1b\[K)', '', written).replace('\r\x1b[K', '')
    lines = [line for line in shown.splitlines() if line]
    assert [line for line in lines if not LOG.fullmatch(line)] == []
    assert re.search(r'played 5 frames, \d+ messages in \d\.\d s; \d dropped: .*0000000003', shown)


def test_quiet_writes_nothing(recordings):
    assert play_in_a_terminal(recordings[Layout.RAW], '--rate', '10', '-q') == (0, '')
