# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Several values after one option, and topics that are left out."""

from __future__ import annotations

import json
import re

import pytest
from builders import one_line

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

POINTS, IMU, FIX = '/kitti/velo/points', '/kitti/oxts/imu', '/kitti/oxts/fix'


def topics_of(path):
    with OpenBag(path) as bag:
        return {topic for topic, _ in bag.index.stamps}


@pytest.mark.parametrize(
    'words',
    [
        'SRC OUT --topics A B',
        'SRC OUT --topics A --topics B',
        'SRC OUT --topics A,B',
        '--topics A B -- SRC OUT',
        '--topics A B SRC OUT',
        '--topics A B SRC OUT -q',
        '--topics=A --topics B -- SRC OUT',
        '--topics A --topics=B SRC OUT',
        '-q --topics A B --layout raw SRC OUT',
        'SRC --topics A B -- OUT',
        'SRC OUT --topics A B --streams scan oxts',
        '--streams scan,oxts --topics A B SRC OUT',
    ],
)
def test_a_list_ends_at_the_next_option(recordings, tmp_path, words):
    out = tmp_path / 'out.mcap'
    places = {'SRC': str(recordings[Layout.RAW]), 'OUT': str(out)}
    given = [places.get(w, w.replace('A', POINTS).replace('B', IMU)) for w in words.split()]
    assert main(['to-bag', *given]) == 0
    assert topics_of(out) == {POINTS, IMU}


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('SRC --topics A OUT', '--topics takes A OUT; give SRC OUT before it, or after --'),
        ('SRC --topics A B', '--topics takes A B; give SRC OUT before it, or after --'),
        ('--topics A SRC', '--topics takes A SRC; give SRC OUT before it, or after --'),
        ('--topics A B --streams scan SRC OUT', '--topics takes A B; give'),
        ('--topics A', 'SRC is missing'),
        ('SRC OUT --topics', "'--topics' requires an argument"),
        ('SRC OUT --topics -q', "'--topics' requires an argument"),
    ],
)
def test_an_argument_is_never_taken_as_a_value_silently(tmp_path, capsys, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    assert main(['to-bag', *words.split()]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_the_classes_of_view_are_a_list(recordings, tmp_path, capsys):
    out = tmp_path / 'out.png'
    source = str(recordings[Layout.OBJECT])
    assert main(['view', '-o', str(out), '--classes', 'Car', 'Tram', '--', source]) == 0
    assert 'Tram' in capsys.readouterr().out
    assert out.is_file()


@pytest.mark.parametrize(
    ('words', 'pattern'),
    [
        (['--exclude-topics', '*image*'], '.*image.*'),
        (['--exclude-topics', '/kitti/oxts/*', '/tf'], '/kitti/oxts/.*|/tf'),
        (['--topics', '/kitti/oxts/*', '--exclude-topics', IMU, FIX], '(?!/kitti/oxts/vel$).*'),
    ],
)
def test_excluded_topics_are_left_out(recordings, tmp_path, words, pattern):
    whole, part = tmp_path / 'whole.mcap', tmp_path / 'part.mcap'
    source = str(recordings[Layout.RAW])
    assert main(['to-bag', source, str(whole), '-q']) == 0
    assert main(['to-bag', source, str(part), '-q', *words]) == 0
    kept = {topic for topic in topics_of(whole) if not re.fullmatch(pattern, topic)}
    assert topics_of(part) == kept != set()


def test_a_bag_without_a_topic_comes_back_without_its_files(recordings, tmp_path):
    bag, out = str(tmp_path / 'bag.mcap'), tmp_path / 'out'
    source = str(recordings[Layout.RAW])
    assert main(['to-bag', source, bag, '-q', '--exclude-topics', '*image*']) == 0
    assert main(['to-kitti', bag, str(out), '-q']) == 0
    assert {path.suffix for path in out.rglob('*') if path.is_file()} == {'.bin', '.txt', '.xml'}


def test_nothing_left_or_nothing_matched_is_said(recordings, tmp_path, capsys):
    source, out = str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap')
    assert main(['to-bag', source, out, '--exclude-topics', '*']) == 2
    assert 'no topic is left without *' in one_line(capsys.readouterr().err)
    assert main(['to-bag', source, out, '--exclude-topics', '/kiti/*', '/tf']) == 0
    assert 'note: no topic is called /kiti/*' in capsys.readouterr().out


NO_TOPIC = 'no topic is called image; there are '


@pytest.mark.parametrize('container', ['', '.mcap', '.bag'])
def test_an_exclusion_of_nothing_is_an_error(recordings, tmp_path, capsys, container):
    source, out = recordings[Layout.RAW], tmp_path / 'o.mcap'
    if container:
        source = tmp_path / f'source{container}'
        assert main(['to-bag', str(recordings[Layout.RAW]), str(source), '-q']) == 0
    assert main(['to-bag', str(source), str(out), '-q', '--exclude-topics', 'image']) == 2
    assert NO_TOPIC in one_line(capsys.readouterr().err)
    assert not out.exists()


def test_json_is_one_document_and_nothing_else(recordings, tmp_path, capsys):
    source, bag, repaired = recordings[Layout.RAW], tmp_path / 'bag.mcap', tmp_path / 'again.mcap'
    assert main(['to-bag', str(source), str(bag), '--json']) == 0
    made = json.loads(capsys.readouterr().out)
    assert made['path'] == str(bag)
    assert (made['layout'], made['name']) == ('raw', source.name)
    assert made['counts'][POINTS] == made['frames'] == 5
    assert made['losses'] == []
    assert main(['recover', str(bag), str(repaired), '--json']) == 0
    again = json.loads(capsys.readouterr().out)
    assert again['counts'] == {t: count for t, count in made['counts'].items() if count}
    assert (again['lost'], again['lost_exactly']) == (0, True)
    assert main(['to-kitti', str(bag), str(tmp_path / 'back'), '--json']) == 0
    back = json.loads(capsys.readouterr().out)
    assert back['path'] == str(tmp_path / 'back')
    assert [each['name'] for each in back['recordings']] == [source.name]
    assert back['recordings'][0]['counts']['scan'] == 5


def test_json_has_the_losses_and_the_exit_code_is_1(drive, tmp_path, capsys):
    (drive / 'velodyne_points' / 'data' / '0000000001.bin').write_bytes(b'short')
    assert main(['to-bag', str(drive), str(tmp_path / 'o.mcap'), '--json']) == 1
    said = capsys.readouterr()
    losses = json.loads(said.out)['losses']
    assert sum(each['count'] for each in losses) == 2
    assert any('0000000001.bin' in each['message'] for each in losses)
    assert '2 skipped in all' in said.err


def test_info_is_quiet_about_what_is_sound(recordings, drive, capsys):
    assert main(['info', str(recordings[Layout.RAW]), '-q']) == 0
    assert capsys.readouterr() == ('', '')
    (drive / 'oxts' / 'timestamps.txt').unlink()
    assert main(['info', str(drive), '-q']) == 1
    said = capsys.readouterr()
    assert not said.out
    assert 'timestamps.txt' in said.err
