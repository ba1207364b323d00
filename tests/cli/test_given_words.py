# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""OUT by position and by -o, and the former names of options."""

from __future__ import annotations

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout


@pytest.mark.parametrize(
    ('words', 'name'),
    [
        ('to-bag SRC OUT', 'o.mcap'),
        ('to-bag SRC -o OUT', 'o.mcap'),
        ('to-bag -o OUT SRC', 'o.mcap'),
        ('to-bag --out=OUT SRC', 'o.mcap'),
        ('to-bag -oOUT SRC', 'o.mcap'),
        ('view SRC -oOUT --mode camera', 'o.png'),
        ('to-bag SRC --topics /tf /tf_static -o OUT', 'o.mcap'),
        ('to-bag -o OUT --topics /tf /tf_static -- SRC', 'o.mcap'),
        ('view SRC OUT --mode camera', 'o.png'),
        ('view --mode camera SRC OUT', 'o.png'),
        ('view SRC -o OUT --mode camera', 'o.png'),
        ('view --mode camera -- SRC OUT', 'o.png'),
        ('view --mode camera SRC -- OUT', 'o.png'),
        ('view SRC OUT --mode camera --classes Car Van', 'o.png'),
        ('report SRC OUT', 'o.html'),
        ('crop SRC -o OUT --range :20', 'o'),
        ('split SRC OUT', 'o'),
        ('split SRC -o OUT', 'o'),
        ('demo -o OUT --count 1', 'o'),
    ],
)
def test_out_is_the_last_argument_or_that_of_o(recordings, tmp_path, capsys, words, name):
    out = tmp_path / name
    given = words.replace('SRC', str(recordings[Layout.OBJECT])).replace('OUT', str(out))
    assert main(given.split()) == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'former', 'today'),
    [
        ('report x --results y', '--results', '--predictions'),
        ('eval detection x y --frames=z', '--frames', '--frame-list'),
        ('demo x --frames 0', '--frames', '--count'),
        ('stats x --points', '--points', '--count-points'),
        ('view x y.png --range=0,1,0,1', '--range', '--extent'),
        ('stacks --config x', '--config', '--drive'),
        ('info x --raw y', '--raw', '--raw-drives'),
        ('play x --foxglove 0 --raw y', '--raw', '--raw-drives'),
    ],
)
def test_a_former_name_is_taken_with_a_note(tmp_path, capsys, monkeypatch, words, former, today):
    monkeypatch.chdir(tmp_path)
    said = []
    for name in (former, today):
        assert main(words.replace(former, name).split()) == 2
        said.append(capsys.readouterr().err.splitlines())
    note = f'note: {former} is {today} now; the next release does not take {former}'
    assert said[0] == [note, *said[1]]


def test_a_name_that_others_have_keeps_its_meaning(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in ('to-bag x y --points xyzi', 'view x y --frames 0:1', 'crop x y --range :9'):
        assert main(words.split()) == 2
        assert 'note' not in capsys.readouterr().err


@pytest.mark.parametrize(
    'words', ['info x --layout --raw', 'report x --predictions --results', 'info -- --raw']
)
def test_the_value_of_an_option_is_no_name(tmp_path, capsys, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    said = capsys.readouterr().err
    assert 'note' not in said
    assert '--raw-drives' not in said


def test_what_belongs_into_a_file_is_taken_with_a_note(recordings, tmp_path, capsys):
    words = ['to-bag', str(recordings[Layout.OBJECT]), str(tmp_path / 'o.mcap')]
    assert main([*words, '--marker-alpha', '0.5']) == 0
    note = 'note: --marker-alpha has its place in the file of --config, as marker_alpha; '
    assert capsys.readouterr().err.startswith(note)


@pytest.mark.parametrize('words', ['to-bag SRC a/b/o.mcap', 'view SRC -o a/o.png', 'split SRC a/o'])
def test_a_folder_that_is_made_for_out_is_named_once(
    words, recordings, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    given = words.replace('SRC', str(recordings[Layout.OBJECT])).split()
    assert main(given) == 0
    assert capsys.readouterr().err == 'note: the folder a was not there; it is made for OUT\n'
    assert main([*given, '--overwrite']) == 0
    assert not capsys.readouterr().err


def test_a_folder_is_not_made_for_what_fails(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['to-bag', 'x', 'a/o.mcap']) == 2
    assert 'note' not in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
