# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 report as a user meets it: exit codes, what is written, what is said."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pytest
from builders import one_line
from html_page import Page

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import BagOptions


def test_a_page_is_made(recording_path, tmp_path, capsys):
    out = tmp_path / 'new' / 'report.html'
    assert main(['report', str(recording_path), '-o', str(out)]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f'{out}: ')
    assert said.err == f'note: the folder {out.parent} was not there; it is made for OUT\n'
    assert Page.of(out).faults == []
    assert [path.name for path in out.parent.iterdir()] == ['report.html']


def test_the_command_says_what_the_page_says(recordings, drive, tmp_path, capsys):
    """Of a sound recording and of one that lacks an image; notes are neither loss nor warning."""
    out = tmp_path / 'r.html'
    (drive / 'image_02' / 'data' / '0000000001.png').unlink()
    sound = 'nothing is missing, damaged or out of order'
    for source, verdict in (recordings[Layout.OBJECT], sound), (drive, '1 loss and 1 warning'):
        main(['report', str(source), '-o', str(out), '--overwrite'])
        assert capsys.readouterr().out.startswith(f'{out}: {verdict}')
        words = [each.lower() for each in (*Page.of(out).words('p'), *Page.of(out).words('span'))]
        assert f'{verdict}.' in words


def test_results_of_a_detector_are_a_section(recordings, tmp_path, capsys):
    split, out = recordings[Layout.OBJECT] / 'training', tmp_path / 'r.html'
    results = shutil.copytree(split / 'label_2', tmp_path / 'results')
    words = ['report', str(split), '--predictions', str(results), '-o', str(out), '--overwrite']
    assert main(words) == 0
    page = Page.of(out)
    assert page.faults == []
    assert 'Scores' in page.words('h2')
    capsys.readouterr()
    (results / '000000.txt').unlink()
    assert main(words) == 1
    assert f'results: {results}: no file for frames 0,' in capsys.readouterr().err


def test_the_page_is_called_report_html(recordings, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['report', str(recordings[Layout.RAW]), '-q']) == 0
    assert capsys.readouterr() == ('', '')
    assert (tmp_path / 'report.html').is_file()


def test_losses_are_said_and_exit_code_1(drive, tmp_path, capsys):
    (drive / 'velodyne_points' / 'data' / '0000000001.bin').unlink()
    out = tmp_path / 'r.html'
    assert main(['report', str(drive), '-o', str(out), '-q']) == 1
    said = capsys.readouterr().err
    assert 'no file for frames 1' in said
    assert 'exit code 1' in said
    assert 'Lost or damaged.' in Page.of(out).words('strong')


def test_a_damaged_bag_is_a_page_and_exit_code_1(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q']) == 0
    whole = bag.read_bytes()
    bag.write_bytes(whole[: len(whole) * 2 // 3])
    assert main(['report', str(bag), '-o', str(tmp_path / 'r.html'), '-q']) == 1
    assert 'parts of the bag are missing or damaged' in capsys.readouterr().err
    page = Page.of(tmp_path / 'r.html')
    assert page.faults == []
    assert 'Lost or damaged.' in page.words('strong')


def test_pages_are_replaced_on_demand_and_nothing_else_ever(recordings, tmp_path, capsys):
    out = tmp_path / 'r.html'
    words = ['report', str(recordings[Layout.OBJECT]), '-o', str(out), '-q']
    assert main(words) == 0
    first = out.stat().st_ino
    assert main(words) == 2
    assert 'exists already; choose another name, or pass --overwrite' in one_line(
        capsys.readouterr().err
    )
    assert main([*words, '--overwrite']) == 0
    assert out.stat().st_ino != first
    out.write_text('my notes')
    assert main([*words, '--overwrite']) == 2
    assert 'it is no HTML page' in one_line(capsys.readouterr().err)
    assert out.read_text() == 'my notes'
    assert [path.name for path in tmp_path.iterdir()] == ['r.html']


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['report'], 'usage: kitti-ros2 report SRC'),
        (['report', '{tmp}/absent'], 'no such file or folder'),
        (['report', '{tmp}'], 'the folder is empty'),
        (
            ['report', '{raw}', '--layout', 'nuscenes'],
            'raw, object, odometry, tracking or kitti360',
        ),
        (['report', '{raw}', '--sequence', '77'], "no sequence '77'"),
    ],
)
def test_wrong_usage_is_one_line_and_leaves_nothing(
    recordings, tmp_path, capsys, monkeypatch, words, said
):
    monkeypatch.chdir(tmp_path)
    places = {'tmp': tmp_path, 'raw': recordings[Layout.RAW]}
    assert main([word.format(**places) for word in words]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_one_line_and_leaves_nothing(recordings, tmp_path, capsys, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, 'write_bytes', full)
    assert main(['report', str(recordings[Layout.OBJECT]), '-o', str(tmp_path / 'r.html')]) == 2
    assert 'the disk is full' in one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_help_fits_80_columns(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    assert main(['report', '--help']) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


def test_a_bag_without_messages_is_told(tmp_path, capsys):
    bag, out = tmp_path / 'empty.mcap', tmp_path / 'report.html'
    with open_bag(bag, BagOptions(), TYPESTORE):
        pass
    assert main(['report', str(bag), '-o', str(out)]) == 0
    assert '1 warning' in capsys.readouterr().out
    page = out.read_text()
    assert 'the bag holds no messages' in page
    assert 'Nothing is missing' not in page


@pytest.mark.parametrize('found', [True, False])
def test_open_shows_the_page_or_says_where_it_is(recordings, tmp_path, capsys, monkeypatch, found):
    shown = []
    monkeypatch.setattr('webbrowser.open', lambda address: shown.append(address) or found)
    out = tmp_path / 'r.html'
    assert main(['report', str(recordings[Layout.OBJECT]), '-o', str(out), '-q', '--open']) == 0
    assert shown == [out.as_uri()]
    said = capsys.readouterr().err
    assert said == ('' if found else f'no browser is found; open {out.as_uri()}\n')
