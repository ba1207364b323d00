# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An output that exists: --overwrite is advised where it replaces it, and nowhere else."""

from __future__ import annotations

import shutil

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

COMMANDS = {
    'to-bag {raw} {out}': 'out.mcap',
    'to-bag {raw} {out}/.': 'bag',
    'to-kitti {bag} {out}': 'set',
    'crop {raw} {out} --range :40': 'cut',
    'view {raw} -o {out}': 'a.png',
    'report {raw} -o {out}': 'a.html',
    'stats {raw} --csv {out}': 'a.csv',
    'stats {raw} -o {out}': 'a.png',
    'demo {out} --count 2': 'street',
}


@pytest.fixture(scope='module')
def sources(recordings, tmp_path_factory):
    """A raw drive and its bag."""
    bag = tmp_path_factory.mktemp('bags') / 'drive.mcap'
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q']) == 0
    return {'raw': recordings[Layout.RAW], 'bag': bag}


def run(command, sources, out, capsys, *options):
    """Return the exit code and the errors of a command."""
    words = command.format(out=out, **sources).split()
    code = main([*words, '-q', *options])
    return code, capsys.readouterr().err


@pytest.mark.parametrize('command', list(COMMANDS))
def test_advice_to_overwrite_is_true(sources, command, tmp_path, capsys):
    out = tmp_path / COMMANDS[command]
    assert run(command, sources, out, capsys) == (0, '')
    code, said = run(command, sources, out, capsys)
    assert code == 2
    assert 'pass --overwrite' in said
    assert run(command, sources, out, capsys, '--overwrite') == (0, '')


@pytest.mark.parametrize('kind', ['notes', 'others'])
@pytest.mark.parametrize('command', list(COMMANDS))
def test_what_overwrite_does_not_touch_is_told_at_once(sources, command, kind, tmp_path, capsys):
    out = tmp_path / COMMANDS[command]
    taken = out / 'kitti' if command.startswith('demo') else out
    if kind == 'notes':
        taken.parent.mkdir(exist_ok=True)
        taken.write_text('by hand')
    else:
        shutil.copytree(sources['raw'], taken / 'a')
        (taken / 'a' / 'notes.doc').write_text('by hand')
    for options in ((), ('--overwrite',)):
        code, said = run(command, sources, out, capsys, *options)
        assert code == 2
        assert 'choose another name' in said
        assert 'pass --overwrite' not in said
    kept = taken if kind == 'notes' else taken / 'a' / 'notes.doc'
    assert kept.read_text() == 'by hand'
