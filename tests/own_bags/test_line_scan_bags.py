# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of KITTI-360's SICK in bags: back to the byte with holes, and by the time of frames."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from folder_and_bag import rerecord
from sick_scans import AROUND_NS, PERIOD_NS, SICK, D, add_sick, sick_stamps

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import BagProgram, open_program

from builders import files_of  # isort: skip

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')

MISSING = (0, 3, 20, 21, 104)
TOPIC = '/kitti/sick/points'


@pytest.fixture(scope='module')
def root(recordings, tmp_path_factory):
    """A drive with holes in the numbers of scans of both scanners."""
    root = tmp_path_factory.mktemp('sick') / 'set'
    shutil.copytree(recordings[Layout.KITTI_360], root)
    add_sick(root, MISSING)
    (root / f'data_3d_raw/{D}/velodyne_points/data/0000000003.bin').unlink()
    return root


@pytest.fixture(scope='module')
def bag(root, tmp_path_factory):
    path = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    assert main(['to-bag', str(root), str(path), '-q']) == 1  # holes are losses
    return path


def back(bag, out, *words):
    code = main(['to-kitti', str(bag), str(out), '-q', *words])
    return code, files_of(out)


def numbers_in(files):
    return [int(name[-14:-4]) for name in sorted(files) if f'{SICK}/data/' in name]


@pytest.mark.parametrize('name', ['bag.mcap', 'bag', 'bag.bag'])
def test_every_file_comes_back_to_the_byte(root, tmp_path, name):
    main(['to-bag', str(root), str(tmp_path / name), '-q'])
    code, files = back(tmp_path / name, tmp_path / 'out')
    assert (code, files) == (0, files_of(root))


def test_a_recorder_logs_them_later(root, bag, tmp_path):
    code, files = back(rerecord(bag, tmp_path / 'late.mcap', 12_345_678), tmp_path / 'out')
    assert (code, files) == (0, files_of(root))


@pytest.mark.parametrize(
    'words',
    [('--start', '1', '--end', '2'), ('--start', '0.12s', '--end', '0.27s')],
    ids=['frames', 'seconds'],
)
def test_a_part_has_those_of_its_time(root, bag, tmp_path, words):
    """The same from a folder as of a bag of all."""
    main(['to-bag', str(root), str(tmp_path / 'part.mcap'), '-q', *words])
    code, files = back(tmp_path / 'part.mcap', tmp_path / 'out')
    assert (code, files) == back(bag, tmp_path / 'cut', *words)
    stamps, numbers = sick_stamps(root), numbers_in(files)
    assert numbers == [n for n in range(numbers[0], numbers[-1] + 1) if n not in MISSING]
    span = stamps[numbers[-1]] - stamps[numbers[0]]
    assert 0.25e9 < span < 0.45e9  # 0.1 s, or 0.15 s, with turns and a margin
    with kitti_ros2.open(tmp_path / 'part.mcap') as part:
        assert not any('sick' in loss.text() for loss in part.losses)


def test_a_whole_bag_has_also_those_before_and_after_all_frames(bag):
    with kitti_ros2.open(bag) as recording:
        stamps = [stamp for stamp, _ in recording.line_scans()]
        frames = recording.stamps_ns
    assert stamps[0] <= frames[0] - AROUND_NS + 2 * PERIOD_NS
    assert stamps[-1] >= frames[-1] + AROUND_NS - 3 * PERIOD_NS


def test_a_bag_has_the_frames_and_losses_of_its_folder(root, bag):
    folder = kitti_ros2.open(root)
    with kitti_ros2.open(bag) as other:
        assert other.numbers.tolist() == folder.numbers.tolist()
        assert other.stamps_ns.tolist() == folder.stamps_ns.tolist()
        assert [(loss.stream, loss.numbers) for loss in other.losses] == [
            (loss.stream, loss.numbers) for loss in folder.losses
        ]
        for ours, theirs in zip(folder.line_scans(), other.line_scans(), strict=True):
            assert ours[0] == theirs[0]
            np.testing.assert_array_equal(ours[1], theirs[1])


@pytest.mark.parametrize('words', [('--streams', 'sick'), ('--topics', TOPIC)])
def test_they_are_a_stream_and_a_topic(root, tmp_path, words):
    assert main(['to-bag', str(root), str(tmp_path / 'bag.mcap'), '-q', *words]) == 1
    with open_messages(tmp_path / 'bag.mcap') as messages:
        assert {message.topic for message in messages} == {TOPIC}


def test_those_alone_come_back(root, tmp_path):
    for part in (f'data_3d_raw/{D}/sick_points', 'calibration'):
        shutil.copytree(root / part, tmp_path / 'set' / part)
    main(['to-bag', str(tmp_path / 'set'), str(tmp_path / 'bag.mcap'), '-q'])
    code, files = back(tmp_path / 'bag.mcap', tmp_path / 'out')
    assert (code, files) == (0, files_of(tmp_path / 'set'))


def test_the_mount_is_in_the_tree(bag, capsys):
    main(['validate', str(bag)])
    assert '0 errors, 0 warnings' in capsys.readouterr().out
    main(['info', str(bag)])
    assert 'sick_link' in capsys.readouterr().out


def test_scans_of_a_set_are_those_of_the_velodyne(bag, tmp_path, capsys):
    """A plan knows no SICK, though it has more messages."""
    words = ['--layout', 'object', '--name', 'testing']
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), *words]) == 0
    assert f'passed over for scans: {TOPIC} (100)' in capsys.readouterr().out
    assert len(kitti_ros2.open(tmp_path / 'out')[0].points) > 100


def test_the_player_has_them_in_the_frames_of_their_time(root, bag):
    """Their numbers name no frames, neither of a folder nor of a bag."""
    programs = [
        open_program(root, make_play_settings({})),
        BagProgram(bag, SelectionOptions()),
    ]
    scans = open_recording(root).streams[Stream.SICK].stamps_ns.tolist()
    for program in programs:
        assert sorted({*program.frames.tolist()}) == [0, 1, 2, 3, 4]
        assert {*scans} <= {*program.stamps_ns.tolist()}
        channels = [channel.topic for channel in program.channels]
        position = program.stamps_ns.tolist().index(scans[50])
        messages, losses = program.fetch(position, {channels.index(TOPIC)})
        assert not losses
        (message,) = [each for each in messages if channels[each.channel] == TOPIC]
        assert message.stamp_ns == scans[50]
        program.close()
    one, other = (
        dict(zip(program.stamps_ns.tolist(), program.frames.tolist(), strict=True))
        for program in programs
    )
    assert [one[stamp] for stamp in scans] == [other[stamp] for stamp in scans]
