# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""`kitti-ros2 play --foxglove` as a user meets it, on a machine that has no rclpy."""

import json
import signal
import socket
import sys

import pytest

from kitti_ros2.cli import main
from kitti_ros2.cli.play import complete_port
from kitti_ros2.model.streams import Layout

pytest.importorskip('foxglove', reason='needs foxglove-sdk (pip install kitti_ros2[test])')
pytest.importorskip('websockets', reason='needs websockets (pip install kitti_ros2[test])')

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from viewer import Player, Viewer  # isort: skip

pytestmark = pytest.mark.programs

OXTS = '/kitti/oxts/imu'
PROTOCOL = 'foxglove.sdk.v1'
FRAMES = 5  # of the small synthetic recordings


@pytest.fixture
def play(recordings):
    """Starts players, and sees to it that none is left."""
    started = []

    def start(*options, src=recordings[Layout.RAW], **more):
        started.append(Player(src, *options, **more))
        return started[-1]

    yield start
    for player in started:
        if player.process.poll() is None:
            player.process.kill()
            player.process.communicate()


@pytest.mark.parametrize(
    ('words', 'completed'),
    [
        ('play d --foxglove', 'play d --foxglove=8765'),
        ('play d --foxglove 9000', 'play d --foxglove=9000'),
        ('play --foxglove 0 d', 'play --foxglove=0 d'),
        ('play --foxglove d', 'play --foxglove=8765 d'),
        ('play d --foxglove=9000 7', 'play d --foxglove=9000 7'),
        ('play d --foxglove --rate 2', 'play d --foxglove=8765 --rate 2'),
        ('play --foxglove -- 7', 'play --foxglove=8765 -- 7'),
        ('play -- --foxglove 7', 'play -- --foxglove 7'),
    ],
)
def test_the_port_may_be_left_out(words, completed):
    assert complete_port(words.split()) == completed.split()


def test_it_says_what_it_plays_and_where(play):
    player = play()
    what, where = player.said
    assert what.startswith('raw 2011_09_26_drive_0001_sync: frames 0 to 4, ')
    assert f'Open connection: {player.url}; ' in where
    assert 'https://app.foxglove.dev?ds=foxglove-websocket' in where
    assert where.endswith(f'ws%3A%2F%2F127.0.0.1%3A{player.port}\n')


def test_it_ends_by_itself_when_asked_to(play):
    player = play('--at-end', 'exit', '--rate', '4')
    with Viewer(player.url) as viewer:
        viewer.subscribe(OXTS)
        viewer.listen_to_the_end()
        assert len(viewer.of(OXTS)) == FRAMES
    assert player.end() == (0, '')


def test_what_is_lost_is_named_and_the_exit_code_says_so(play, drive):
    (drive / 'velodyne_points' / 'data' / '0000000003.bin').write_bytes(b'1234567')
    player = play('--at-end', 'exit', '--rate', '4', src=drive)
    with Viewer(player.url) as viewer:
        viewer.subscribe()
        viewer.listen_to_the_end()
    code, complaints = player.end()
    assert code == 1
    assert complaints.count('0000000003.bin') == 1


def test_pages_connect_if_they_are_allowed(play):
    """The header is what a browser would send for a page of that address."""
    player = play('--allow-origin', 'https://a.example', 'https://b.example')
    for origin in ('https://a.example', 'https://b.example', 'http://localhost:8080', None):
        with connect(player.url, origin=origin, subprotocols=[PROTOCOL]) as viewer:
            assert json.loads(viewer.recv())['op'] == 'serverInfo'
    for _ in range(2):
        with pytest.raises(InvalidStatus) as refused:
            connect(player.url, origin='https://c.example', subprotocols=[PROTOCOL])
        assert refused.value.response.status_code == 403
        assert b'--allow-origin https://c.example' in refused.value.response.body
    code, complaints = player.end(signal.SIGINT)
    assert code == 0
    assert complaints.count('c.example') == 2  # one line names it and the option
    assert len(complaints.splitlines()) == 1


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('watched', [False, True])
def test_a_signal_ends_it_cleanly(play, number, watched):
    player = play('--loop')
    if watched:
        with Viewer(player.url) as viewer:
            viewer.subscribe()
            viewer.until(lambda: len(viewer.of(OXTS)) == FRAMES)
            player.process.send_signal(number)
            viewer.listen_to_the_end()
    assert player.end(None if watched else number) == (0, '')


def test_a_port_that_is_taken(play):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        code, complaints = play(port=port).end()
    assert code == 2
    assert len(complaints.splitlines()) == 1
    assert f'port {port} is not available (Address already in use' in complaints


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['play', '--foxglove'], 'SRC is missing'),
        (['play', '/nowhere', '--foxglove'], '/nowhere: no such file or folder'),
        (['play', '{raw}', '--foxglove', '65536'], 'invalid port 65536'),
        (['play', '{raw}', '--foxglove=-1'], 'invalid port -1'),
        (['play', '{raw}', '--foxglove', '--rate', '101'], 'rate 101 is not within'),
        (['play', '{raw}', '--foxglove', '--stamps', 'now'], '--stamps now does not go with'),
        (['play', '{raw}', '--foxglove', '--lossless'], '--lossless does not go with'),
        (['play', '{raw}', '--foxglove', '--wait-for', '2'], '--wait-for does not go with'),
        (['play', '{raw}', '--foxglove', '--delay', '3'], '--delay does not go with'),
        (
            ['play', '{raw}', '--foxglove', '--qos-profile-overrides-path', 'q.yaml'],
            '--qos-profile-overrides-path does not go with',
        ),
        (['play', '{raw}', '--foxglove', '--ros-args', '-p', 'a:=1'], '--ros-args does not go'),
        (['play', '{raw}', '--bind', '127.0.0.1'], '--bind and --allow-origin are for viewers'),
        (['play', '{raw}', '--allow-origin', 'http://a'], '--allow-origin are for viewers'),
        (['play', '{raw}', '--foxglove', '--allow-origin', 'a.example'], 'takes scheme://host'),
        (
            ['play', '{raw}', '--foxglove', '--bind', '203.0.113.7'],
            '203.0.113.7 is not an address of this machine',
        ),
    ],
)
def test_wrong_usage_is_one_line(recordings, capsys, words, said):
    assert main([word.format(raw=recordings[Layout.RAW]) for word in words]) == 2
    complaints = capsys.readouterr().err.splitlines()
    assert len(complaints) == 1
    assert said in complaints[0]


def test_without_the_sdk_it_says_what_to_install(recordings, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'foxglove', None)
    for name in list(sys.modules):
        if name.startswith(('foxglove.', 'kitti_ros2.viewers.')):
            monkeypatch.delitem(sys.modules, name)
    assert main(['play', str(recordings[Layout.RAW]), '--foxglove']) == 2
    complaint = capsys.readouterr().err
    assert len(complaint.splitlines()) == 1
    assert "pip install 'kitti_ros2[foxglove]'" in complaint


def test_a_viewer_cannot_fill_the_terminal(play):
    player = play()
    with Viewer(player.url) as viewer:
        for count in range(1, 101):
            viewer.socket.send('')
            # Each is answered: a client that sends without reading is disconnected by the SDK.
            viewer.until(lambda count=count: len(viewer.statuses) == count)
    code, said = player.end(signal.SIGINT)
    assert code == 0
    lines = said.splitlines()
    assert all(line.startswith('foxglove-sdk: Invalid message from') for line in lines[:3])
    assert lines[3:] == [
        'foxglove-sdk: more lines about viewers are not shown; FOXGLOVE_LOG_LEVEL=warn shows all'
    ]
