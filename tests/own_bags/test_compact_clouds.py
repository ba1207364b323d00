# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of --clouds compact: the files come back to the byte, readers get them within 0.5 mm."""

from __future__ import annotations

import json
import shutil
import zlib
from base64 import b64encode

import numpy as np
import pytest
from folder_and_bag import rerecord
from moved_scans import TWISTS, moved, street

from kitti_ros2 import open as open_any
from kitti_ros2.bags.reader import Decoder, open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.kitti.scan_grid import on_grid
from kitti_ros2.messages.clouds import read_points
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import CLOUD, Channel
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.player.bag_program import BagProgram

from builders import files_of  # isort: skip

CONTAINERS = ('bag.mcap', 'bag.bag', 'bag')
POINTS, REST = '/kitti/velo/points', '/kitti/source/rest'
STRING = 'std_msgs/msg/String'
HALF_MM = 0.000504


def on_kittis_grid(path, layout, folder):
    """A copy of a recording whose scans are KITTI's: on the grid, or moved from it."""
    whole = path.parent if layout is Layout.RAW else path
    copy = folder / whole.name
    shutil.copytree(whole, copy)
    for file in sorted(copy.rglob('*.bin')):
        points = np.fromfile(file, '<f4').reshape(-1, 4)
        points[:, :3] = on_grid(points[:, :3])
        points[:, 3] = (np.rint(points[:, 3] * 100) / 100).astype(np.float32)
        points[::50, 1] = -0.0
        if layout is Layout.ODOMETRY:
            xyz = moved(street(int(file.stem)), TWISTS['left bend'])
            points = np.column_stack([xyz, np.resize(points[:, 3], len(xyz))]).astype('<f4')
        file.write_bytes(points.tobytes())
    return copy / path.name if layout is Layout.RAW else copy


@pytest.fixture(scope='module')
def sources(recordings, tmp_path_factory):
    folder = tmp_path_factory.mktemp('grid')
    return {
        layout: on_kittis_grid(recordings[layout], layout, folder / layout.value)
        for layout in Layout
    }


@pytest.fixture(scope='module')
def drive_bag(sources, tmp_path_factory):
    """The compact bag of a raw drive, and its files."""
    bag = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    source = sources[Layout.RAW]
    assert main(['to-bag', str(source), str(bag), '--clouds', 'compact']) == 0
    return bag, files_of(source.parent.parent)


def scans_of(files):
    return {name: data for name, data in sorted(files.items()) if name.endswith('.bin')}


def back(bag, out):
    code = main(['to-kitti', str(bag), str(out)])
    return code, files_of(out)


@pytest.mark.parametrize('bag', CONTAINERS)
@pytest.mark.parametrize('layout', list(Layout), ids=[layout.value for layout in Layout])
def test_files_come_back_to_the_byte(sources, tmp_path, capsys, layout, bag):
    bag = tmp_path / bag
    assert main(['to-bag', str(sources[layout]), str(bag), '--clouds', 'compact']) == 0
    code, made = back(bag, tmp_path / 'out')
    root = sources[layout].parent.parent if layout is Layout.RAW else sources[layout]
    assert scans_of(made)
    assert scans_of(made) == scans_of(files_of(root))
    assert code == 0
    said = ''.join(capsys.readouterr())
    assert 'with loss' not in said
    assert 'not on KITTI' not in said


def clouds_of(bag):
    with open_messages(bag, {POINTS}) as messages:
        decode = Decoder(messages.typestore)
        return [read_points(decode(message), None) for message in messages]


def test_readers_get_points_within_half_a_millimetre(drive_bag):
    bag, files = drive_bag
    stored = [np.frombuffer(data, '<f4').reshape(-1, 4) for data in scans_of(files).values()]
    for cloud, points in zip(clouds_of(bag), stored, strict=True):
        assert np.abs(cloud - points)[:, :3].max() < HALF_MM
        assert np.abs(cloud - points)[:, 3].max() < 1e-6


def test_the_player_publishes_plain_clouds(drive_bag):
    bag, files = drive_bag
    program = BagProgram(bag, SelectionOptions())
    [place] = [place for place, made in enumerate(program.channels) if made.topic == POINTS]
    assert program.channels[place].msgtype == CLOUD
    due = [program.fetch(index, [place])[0] for index in range(len(program.stamps_ns))]
    clouds = [each.data for messages in due for each in messages if each.channel == place]
    assert len(clouds) == len(scans_of(files))
    cloud = read_points(TYPESTORE.deserialize_cdr(clouds[0], CLOUD), None)
    stored = np.frombuffer(next(iter(scans_of(files).values())), '<f4').reshape(-1, 4)
    assert np.abs(cloud - stored)[:, :3].max() < HALF_MM


def test_scans_that_are_no_grid_are_in_clouds_byte_for_byte(recordings, tmp_path, capsys):
    source, bag = tmp_path / 'object', tmp_path / 'bag.mcap'
    shutil.copytree(recordings[Layout.OBJECT], source)
    for file in source.rglob('*.bin'):
        points = np.fromfile(file, '<f4').reshape(-1, 4)
        (points + np.float32([3e-4, 3e-4, 3e-4, 0])).tofile(file)
    assert main(['to-bag', str(source), str(bag), '--clouds', 'compact']) == 0
    assert "not on KITTI's grid of 1 mm" in capsys.readouterr().out
    stored = scans_of(files_of(source)).values()
    assert [cloud.tobytes() for cloud in clouds_of(bag)] == [*stored]
    code, made = back(bag, tmp_path / 'out')
    assert code == 0
    assert scans_of(made) == scans_of(files_of(source))


def test_frames_of_a_bag_have_the_points_of_the_files(drive_bag):
    bag, files = drive_bag
    with open_any(bag) as recording:
        points = [frame.points.tobytes() for frame in recording]
    assert points == [*scans_of(files).values()]


@pytest.mark.parametrize('late_ns', [0, 5_000_000])
def test_recorded_clouds_come_back_too(drive_bag, tmp_path, late_ns):
    bag, files = drive_bag
    code, made = back(rerecord(bag, tmp_path / 'late.mcap', late_ns), tmp_path / 'out')
    assert code == 0
    assert scans_of(made) == scans_of(files)


def changed(bag, out, change):
    """A copy of a bag with the messages that change returns for each one, in their order."""
    with open_messages(bag) as messages, open_bag(out, BagOptions(), TYPESTORE) as writer:
        ids = {
            topic: writer.add_channel(
                Channel(topic, msgtype, latched=topic in messages.latched, depth=1)
            )
            for topic, msgtype in messages.channels
        }
        items = [(m.topic, m.stamp_ns, bytes(m.data)) for m in messages]
        for topic, stamp_ns, data in change(items):
            writer.write(ids[topic], stamp_ns, [data])
    return out


def rests_last(items):
    """Rests behind the clouds that they are of, as another recorder may store them."""
    return sorted(items, key=lambda item: (item[1], item[0] == REST))


def rests_late(items):
    return [
        (topic, stamp_ns + 150_000_000 * (topic == REST), data) for topic, stamp_ns, data in items
    ]


@pytest.mark.parametrize('order', [rests_last, rests_late])
def test_rests_may_follow_their_clouds(drive_bag, tmp_path, order):
    bag, files = drive_bag
    code, made = back(changed(bag, tmp_path / 'other.mcap', order), tmp_path / 'out')
    assert code == 0
    assert scans_of(made) == scans_of(files)


def with_rest(text):
    message = TYPESTORE.types[STRING](text)
    return bytes(TYPESTORE.serialize_cdr(message, STRING))


def other_rest(edit):
    """Change the JSON of the first rest."""

    def change(items):
        first = next(index for index, item in enumerate(items) if item[0] == REST)
        topic, stamp_ns, data = items[first]
        text = edit(TYPESTORE.deserialize_cdr(data, STRING).data)
        return [*items[:first], (topic, stamp_ns, with_rest(text)), *items[first + 1 :]]

    return change


def edited(**values):
    return lambda text: json.dumps({**json.loads(text), **values})


PACKED_STEP = b64encode(zlib.compress(bytes([5, 0, 0, 0, 1]))).decode()
WITHOUT_REST = f'rounded to 1 mm and 0.01, and {REST} does not say from what'
DAMAGES = {
    'no rest': (lambda items: [item for item in items if item[0] != REST], WITHOUT_REST),
    'no JSON': (other_rest(lambda text: text[:-5]), WITHOUT_REST),
    'nested': (other_rest(lambda _text: '[' * 100_000), WITHOUT_REST),
    'list': (other_rest(lambda _text: '[]'), WITHOUT_REST),
    'other values': (other_rest(edited(values='AAAA')), WITHOUT_REST),
    'values cut off': (
        other_rest(lambda text: edited(values=json.loads(text)['values'][:-8])(text)),
        WITHOUT_REST,
    ),
    'no values': (other_rest(edited(values='eJwDAAAAAAE=')), 'CRC-32'),
    'twist': (other_rest(edited(twist=[1, 2])), WITHOUT_REST),
    'other twist': (other_rest(edited(twist=[1, 0, 0, 0, 0, 0])), 'CRC-32'),
    'nan': (other_rest(edited(twist=[float('nan')] * 6)), WITHOUT_REST),
    'steps': (other_rest(edited(steps='AAAA')), WITHOUT_REST),
    'other steps': (
        other_rest(edited(steps=PACKED_STEP, twist=[0.8, 0, 0, 0, 0, 0.01])),
        'CRC-32',
    ),
    'other file': (other_rest(edited(crc32=5)), 'CRC-32'),
    'large': (other_rest(edited(crc32=1e400)), WITHOUT_REST),
}


@pytest.mark.parametrize('damage', DAMAGES)
def test_what_is_missing_is_said(drive_bag, tmp_path, capsys, damage):
    bag, files = drive_bag
    change, reason = DAMAGES[damage]
    code, made = back(changed(bag, tmp_path / 'other.mcap', change), tmp_path / 'out')
    assert code == 1
    said = ''.join(capsys.readouterr())
    assert "not KITTI's own" in said
    assert reason in said
    assert scans_of(made).keys() == scans_of(files).keys()
    for name, data in scans_of(made).items():
        points, own = (np.frombuffer(each, '<f4') for each in (data, scans_of(files)[name]))
        assert np.abs(points - own).max() < HALF_MM


def test_without_scans_the_form_of_clouds_is_said_to_be_idle(sources, tmp_path, capsys):
    words = ['to-bag', str(sources[Layout.RAW]), str(tmp_path / 'bag.mcap'), '--streams', 'oxts']
    assert main([*words, '--clouds', 'compact', '--images', 'raw']) == 0
    printed = capsys.readouterr().out
    assert 'no scan is written; without effect: clouds' in printed
    assert 'no image is written; without effect: images' in printed


def test_left_out_rests_are_said(sources, tmp_path, capsys):
    words = ['--clouds', 'compact', '--exclude-topics', REST]
    main(['to-bag', str(sources[Layout.OBJECT]), str(tmp_path / 'bag.mcap'), *words])
    assert f'{REST} is left out, so the scans that to-kitti restores' in capsys.readouterr().out


@pytest.mark.parametrize(
    'words', [['--points', 'ouster'], ['--ring-time'], ['--semantic']], ids=lambda words: words[0]
)
def test_other_points_than_those_of_files_are_refused(sources, tmp_path, capsys, words):
    bag = tmp_path / 'bag.mcap'
    argv = ['to-bag', str(sources[Layout.ODOMETRY]), str(bag), '--clouds', 'compact', *words]
    assert main(argv) == 2
    assert 'take points xyzi, without semantic' in capsys.readouterr().err
    assert not bag.exists()
