# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the commands: aligned in 80 columns, folded in fewer, and no text cut off."""

from __future__ import annotations

import os
import pty
import sys
from collections import Counter

import pytest

from kitti_ros2.cli.output import Table, say

from terminals import read_to_the_end  # isort: skip

NAMES = ['car', '/a:car:/[bold]', '汽车', 'é' * 3, 'cafe\u0301', 'a b ' * 20, 'x' * 70, '']


def show(names, width):
    table = Table('name', ('count',))
    table.add_column('type', folds=True)
    for name in names:
        table.add_row(name, f'{len(name)}', f'kind {name}')
    table.add_row('only a name')
    table.show(width)


@pytest.mark.parametrize('width', [20, 40, 80, 1000])
def test_all_of_each_cell_is_shown_in_the_width(width, capsys):
    show(NAMES, width)
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= max(width, 8 + 1 + 5 + 1 + 8)
    assert Counter(''.join(NAMES * 2).replace(' ', '')) - Counter(text) == Counter()


def test_columns_are_aligned_also_below_wide_and_combined_characters(capsys):
    show(NAMES[:5], 80)
    assert capsys.readouterr().out.splitlines() == [
        'name           count type',
        'car                3 kind car',
        '/a:car:/[bold]    14 kind /a:car:/[bold]',
        '汽车               2 kind 汽车',
        'ééé                3 kind ééé',
        'cafe\u0301               5 kind cafe\u0301',
        'only a name',
    ]


def test_names_fold_between_words_and_numbers_do_not(capsys):
    table = Table('name', ('a wide heading',))
    table.add_row('one two three', '1')
    table.add_row('  indented', '2')
    table.add_row('0123456789', '3')
    table.show(23)
    assert capsys.readouterr().out.splitlines() == [
        'name     a wide heading',
        'one two               1',
        'three',
        '  indent              2',
        'ed',
        '01234567              3',
        '89',
    ]


@pytest.mark.parametrize(
    ('setting', 'shown'),
    [
        ({}, b'\x1b[1;31mbad\x1b[0m\r\n'),
        ({'NO_COLOR': '1'}, b'\x1b[1mbad\x1b[0m\r\n'),
        ({'TERM': 'dumb'}, b'bad\r\n'),
    ],
)
def test_a_terminal_shows_styles(setting, shown, monkeypatch):
    monkeypatch.setenv('TERM', 'xterm')
    monkeypatch.delenv('NO_COLOR', raising=False)
    for name, value in setting.items():
        monkeypatch.setenv(name, value)
    master, slave = pty.openpty()
    with os.fdopen(slave, 'w') as terminal:
        monkeypatch.setattr(sys, 'stdout', terminal)
        say('bad', style='bold red')
    assert read_to_the_end(master) == shown
