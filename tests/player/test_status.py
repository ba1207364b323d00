# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The status line of a player, in a terminal of its own, and the summary."""

from __future__ import annotations

import os
import pty
import re
import sys
import threading
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.player import terminal as player_terminal
from kitti_ros2.player.playback import PlaybackState
from kitti_ros2.player.session import Counts
from kitti_ros2.player.terminal import StatusLine, describe_now, describe_result

from waiting import PATIENCE_S  # isort: skip

ERASE = '\r\x1b[K'


class Screen:
    """A terminal of a few columns: what is written to it, and what a line of it shows."""

    def __init__(self):
        self._master, slave = pty.openpty()
        os.set_blocking(self._master, False)
        self.stream = os.fdopen(slave, 'w')

    def written(self):
        self.stream.flush()
        found = b''
        with suppress(BlockingIOError):
            while True:
                found += os.read(self._master, 1 << 16)
        return found.decode()

    def close(self):
        self.stream.close()
        os.close(self._master)


@pytest.fixture
def screen(monkeypatch):
    monkeypatch.setattr(player_terminal, 'in_foreground', lambda _: True)
    found = Screen()
    yield found
    found.close()


@pytest.fixture
def by_hand(monkeypatch):
    """Lines are drawn when the test draws them."""
    monkeypatch.setattr(player_terminal, '_REFRESH_S', threading.TIMEOUT_MAX)


def shown(text):
    """What a terminal shows of a text, line by line."""
    lines = ['']
    place = 0
    for part in re.split(r'(\r|\n|\x1b\[K)', text):
        if part == '\r':
            place = 0
        elif part == '\n':
            lines.append('')
            place = 0
        elif part == '\x1b[K':
            lines[-1] = lines[-1][:place]
        else:
            lines[-1] = lines[-1][:place] + part + lines[-1][place + len(part) :]
            place += len(part)
    return lines


@pytest.mark.usefixtures('by_hand')
def test_a_line_is_written_in_its_place_and_leaves_nothing(screen):
    texts = iter(['a long text', 'short', 'short', 'more'])
    line = StatusLine(screen.stream)
    with line.follow(lambda: next(texts)):
        line.draw()
        assert shown(screen.written()) == ['a long text']
        line.draw()
        assert screen.written() == f'{ERASE}short\r'
        line.draw()
        assert not screen.written()
        line.hide()
        screen.stream.write('[INFO] a line of the log\n')
        line.draw()
        assert shown(f'short\r{screen.written()}') == ['[INFO] a line of the log', 'more']
    assert shown(f'more\r{screen.written()}') == ['']


@pytest.mark.usefixtures('by_hand')
def test_a_line_is_cut_to_the_width_of_the_terminal(screen, monkeypatch):
    monkeypatch.setattr(os, 'get_terminal_size', lambda _: os.terminal_size((10, 24)))
    line = StatusLine(screen.stream)
    with line.follow(lambda: 'frame 1234567890'):
        line.draw()
    assert screen.written().startswith(f'{ERASE}frame 123\r')


@pytest.mark.usefixtures('by_hand')
def test_a_line_without_a_session_stays_as_it_is(screen):
    texts = iter(['first', None, 'second'])

    def text():
        found = next(texts)
        if found is None:
            raise UsageError('no session is running')
        return found

    line = StatusLine(screen.stream)
    with line.follow(text):
        for expected in (f'{ERASE}first\r', '', f'{ERASE}second\r'):
            line.draw()
            assert screen.written() == expected


def test_it_is_refreshed_by_itself(screen):
    drawn = threading.Event()

    def text():
        drawn.set()
        return 'here'

    with StatusLine(screen.stream).follow(text):
        assert drawn.wait(PATIENCE_S)


@pytest.mark.parametrize('reason', ['quiet', 'no terminal', 'background'])
def test_no_line_is_drawn_without_a_terminal_or_when_quiet(screen, monkeypatch, reason, tmp_path):
    if reason == 'background':
        monkeypatch.setattr(player_terminal, 'in_foreground', lambda _: False)
    stream = screen.stream if reason != 'no terminal' else (tmp_path / 'log').open('w')
    line = StatusLine(stream, show=reason != 'quiet')
    with line.follow(lambda: 'text'):
        line.draw()
    if reason == 'no terminal':
        stream.close()
        assert not (tmp_path / 'log').read_text()
    assert not screen.written()


def session(counts, **state):
    playing = PlaybackState(5, 0, 520_000_000, 1.5, **{'paused': False, **state}, round=1)
    return SimpleNamespace(
        playback=SimpleNamespace(state=lambda: playing),
        program=SimpleNamespace(frames=np.array([3, 5, 9])),
        counts=counts,
    )


def test_the_line_has_frame_time_rate_and_what_was_dropped():
    playing = describe_now(session(Counts(failures=2), finished=False))
    assert playing == 'playing, frame 5 of 3-9, 0.52 s, rate 1.50, dropped 2'
    assert describe_now(session(Counts(), finished=False, paused=True)).startswith('paused, ')


def test_the_summary_names_what_was_dropped():
    sound = session(Counts(messages=10, frames=3), finished=True)
    assert describe_result(sound, 1.23, ended=True) == (
        'played 3 frames, 10 messages in 1.2 s; none dropped'
    )
    assert describe_result(sound, 1.23, ended=False).startswith('stopped at frame 5, after 3 fr')
    counts = Counts(messages=10, failures=12, frames=3)
    counts.dropped.update({'a.bin: cut': 7, 'note': 0, 'b.png: gone': 2, 'c': 1, 'd': 1, 'e': 1})
    text = describe_result(session(counts, finished=True), 1, ended=True)
    assert text.endswith(
        '; 12 dropped: a.bin: cut (7); b.png: gone (2); c (1); and 2 more reasons, listed above'
    )


def test_the_stream_is_standard_error(monkeypatch, screen):
    monkeypatch.setattr(sys, 'stderr', screen.stream)
    assert StatusLine().shown
    assert not StatusLine(show=False).shown
