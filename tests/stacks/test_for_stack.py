# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""--for sets what a stack needs, and says which of the user's options contradict it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

import kitti_ros2.options
from kitti_ros2.cli import main
from kitti_ros2.cli.command import add_config
from kitti_ros2.messages.naming import naming_of
from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import ScanStamp
from kitti_ros2.options.stack_catalogue import STACKS, Demand, make_typed
from kitti_ros2.options.stack_names import StackName
from kitti_ros2.options.table import PLAY, TO_BAG, make_play_settings, make_settings


def test_every_file_is_of_a_name():
    folder = files(kitti_ros2.options) / 'stacks'
    assert {Path(each.name).stem for each in folder.iterdir()} == {each.value for each in StackName}


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'key': 'cloud', 'text': 'PointCloud2'}, 'source'),
        ({'key': 'cloud', 'text': 'PointCloud2', 'source': 'page', 'sauce': ''}, 'sauce'),
        ({'key': 'cloud', 'text': 'PointCloud2', 'source': 7}, '7 is no '),
        (['cloud'], 'cloud'),
    ],
)
def test_a_file_that_is_not_of_its_schema_is_refused(values, message):
    with pytest.raises(TypeError, match=message):
        make_typed(Demand, values)


def test_its_options_are_those_of_to_bag():
    settings = {name for stack in STACKS.values() for name in stack.settings}
    of_users = {each.of_option for stack in STACKS.values() for each in stack.demands} - {''}
    assert settings | of_users <= {option.name for option in TO_BAG}


@pytest.mark.parametrize('name', STACKS)
def test_its_options_are_valid(name):
    settings = make_settings({'stack': name})
    played = make_play_settings({'stack': name})
    for made, declared in ((settings, TO_BAG), (played, PLAY)):
        options = {each.name: each for each in declared}
        for option_name, values in STACKS[name].settings.items():
            option = options[option_name]
            wanted = option.parse(option.name, values[0])
            groups = made.messages, made.messages.ground_truth, made.read
            (found, *_) = (each for each in groups if hasattr(each, option.field))
            assert getattr(found, option.field) == wanted
    assert settings.messages.preset == played.messages.preset


def test_a_timed_cloud_is_stamped_at_its_start():
    assert make_settings({'stack': 'lio-sam'}).read.scan_stamp is ScanStamp.START
    assert make_settings({'stack': 'octomap'}).read.scan_stamp is ScanStamp.FORWARD


def test_other_options_stay_the_users():
    settings = make_settings({'stack': 'cuvslam', 'images': 'raw', 'map': 'devkit'})
    assert settings.messages.images is Images.RAW
    assert make_settings({'stack': 'kiss-icp', 'images': 'raw'}).messages.images is Images.RAW


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'ground_truth_tree': False, 'stack': 'dlio'},
         ('dlio needs ground_truth_tree on, not off; leave out one of --for and'
          ' --ground-truth-tree')),
        ({'preset': 'kitti2bag', 'stack': 'lio-sam'},
         'lio-sam needs preset default, not kitti2bag; leave out one of --for and --preset'),
        ({'images': 'compressed', 'stack': 'orb-slam3'},
         'orb-slam3 needs images both or raw, not compressed; leave out one of --for and --images'),
    ],
)  # fmt: skip
def test_a_contradiction_is_one_line(values, message):
    for make in (make_settings, make_play_settings):
        with pytest.raises(UsageError) as raised:
            make(values)
        assert str(raised.value) == message


def test_a_misspelt_stack_is_answered_with_a_name():
    with pytest.raises(UsageError, match=r"not take 'lio_sm'; did you mean lio-sam"):
        make_settings({'stack': 'lio_sm'})


def test_the_word_of_the_command_line_in_a_file_is_answered_with_the_name(tmp_path):
    file = tmp_path / 'options.yaml'
    file.write_text('for: kiss-icp\n', 'utf-8')
    with pytest.raises(UsageError, match=r"yaml: unknown option 'for'; did you mean stack"):
        add_config(file, {}, TO_BAG)


def test_defaults_of_a_file_do_not_contradict(tmp_path):
    file = tmp_path / 'options.yaml'
    file.write_text('tf: true\nring_time: false\nimages: raw\nlayout: null\n', 'utf-8')
    merged = add_config(file, {'stack': 'kiss-icp'}, TO_BAG)
    assert merged == {'images': 'raw', 'stack': 'kiss-icp'}
    assert make_settings(merged).messages.ground_truth.tree
    assert add_config(file, {}, TO_BAG) == {'tf': True, 'ring_time': False, 'images': 'raw'}


def test_topics_and_frames_have_the_names_of_the_stack():
    names = naming_of(MessageOptions(stack=StackName.NVBLOX))
    assert names.topic('/kitti/velo/points') == '/pointcloud'
    assert names.topic('/kitti/velo/points_of_others') == '/kitti/velo/points_of_others'
    assert (names.frames.map, names.frames.base) == ('odom', 'base_link')
    names = naming_of(MessageOptions(stack=StackName.RTABMAP_STEREO))
    left = '/stereo_camera/left/image_rect_color'
    assert names.topic('/kitti/camera_color_left/image_rect/compressed') == f'{left}/compressed'


def test_an_unknown_stack_is_an_error_of_its_option(tmp_path, capsys):
    out = str(tmp_path / 'out.mcap')
    assert main(['to-bag', str(tmp_path), out, '--for', 'nope']) == 2
    assert capsys.readouterr().err.startswith('kitti-ros2: --for (stack) takes kiss-icp, ')
