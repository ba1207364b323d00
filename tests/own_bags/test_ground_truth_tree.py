# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth on a TF tree of its own, in bags and back."""

from __future__ import annotations

from importlib.util import find_spec

import pytest
from mcap_ros2.reader import read_ros2_messages

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.naming import naming_of, with_ground_truth_tree
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import CAMERA_NAMES, Layout
from kitti_ros2.options.messages import GroundTruthOptions, MarkerOptions, MessageOptions, Preset
from kitti_ros2.options.stack_names import StackName

from builders import convert_recording, files_of, one_line  # isort: skip

ODOMETRY = '/kitti/ground_truth/odometry'
POSED = (Layout.RAW, Layout.ODOMETRY, Layout.TRACKING, Layout.KITTI_360)
TREE = GroundTruthOptions(tree=True)
OF_TRUTH = {'/tf', ODOMETRY, '/kitti/ground_truth/path'}


def write(source, out, **options):
    messages = MessageOptions(markers=MarkerOptions(trails=True), **options)
    convert_recording(source, out, messages)
    return out


def contents(bag):
    """By topic the bytes of its messages."""
    found = {}
    with open_messages(bag) as messages:
        for message in messages:
            found.setdefault(message.topic, []).append(bytes(message.data))
    return found


def links_of(bag, topic):
    return {
        (link.header.frame_id, link.child_frame_id)
        for item in read_ros2_messages(str(bag), topics=[topic])
        for link in item.ros_msg.transforms
    }


@pytest.mark.parametrize('preset', list(Preset))
@pytest.mark.parametrize('layout', POSED)
def test_only_the_frames_of_the_ground_truth_change(recordings, tmp_path, layout, preset):
    source = recordings[layout]
    plain = write(source, tmp_path / 'plain.mcap', preset=preset)
    apart = write(source, tmp_path / 'apart.mcap', preset=preset, ground_truth=TREE)
    assert links_of(apart, '/tf') == {('map_gt', 'base_link_gt')}
    before, after = contents(plain), contents(apart)
    changed = {topic for topic in before if before[topic] != after[topic]}
    assert before.keys() == after.keys()
    assert changed - {'/kitti/labels/markers'} == OF_TRUTH
    for topic, kind in ((ODOMETRY, 'Odometry'), ('/kitti/ground_truth/path', 'Path')):
        msgtype = f'nav_msgs/msg/{kind}'
        old, new = (deserialize(each[topic][-1], msgtype) for each in (before, after))
        assert new.header.frame_id == 'map_gt'
        old.header.frame_id = 'map_gt'
        if kind == 'Odometry':
            assert new.child_frame_id == 'base_link_gt'
            old.child_frame_id = 'base_link_gt'
            assert repr(old) == repr(new)
        else:
            assert {each.header.frame_id for each in new.poses} == {'map_gt'}
            assert len(old.poses) == len(new.poses)


def test_trails_are_in_the_map_that_they_were_computed_in(recordings, tmp_path):
    bag = write(recordings[Layout.TRACKING], tmp_path / 'o.mcap', ground_truth=TREE)
    frames = {
        marker.header.frame_id
        for item in read_ros2_messages(str(bag), topics=['/kitti/labels/markers'])
        for marker in item.ros_msg.markers
        if marker.type == 4  # LINE_STRIP
    }
    assert frames == {'map_gt'}


def test_the_names_can_be_chosen(recordings, tmp_path):
    names = GroundTruthOptions(tree=True, map='map', base='truth/base')
    bag = write(recordings[Layout.RAW], tmp_path / 'o.mcap', ground_truth=names)
    assert links_of(bag, '/tf') == {('map', 'truth/base')}


def test_without_tf_only_the_topics_have_the_frames(recordings, tmp_path):
    bag = write(recordings[Layout.RAW], tmp_path / 'o.mcap', ground_truth=TREE, publish_tf=False)
    assert '/tf' not in contents(bag)
    assert deserialize(contents(bag)[ODOMETRY][0], 'nav_msgs/msg/Odometry').child_frame_id == (
        'base_link_gt'
    )


@pytest.mark.one_in(3)
@pytest.mark.parametrize('ending', ['.mcap', '', '.bag'])
@pytest.mark.parametrize('layout', POSED)
def test_every_file_comes_back_to_the_byte(recordings, tmp_path, layout, ending):
    source, bag = recordings[layout], tmp_path / f'bag{ending}'
    assert main(['to-bag', str(source), str(bag), '-q', '--ground-truth-tree']) == 0
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q']) == 0
    root = source.parent.parent if layout is Layout.RAW else source
    assert files_of(tmp_path / 'out') == files_of(root)
    assert main(['validate', str(bag), '-q']) == 0


def test_by_a_plan_the_poses_are_those_of_base_link(recordings, tmp_path):
    made = []
    for name, more in (('plain', ()), ('apart', ('--ground-truth-tree',))):
        bag, out = tmp_path / f'{name}.mcap', tmp_path / name
        assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q', *more]) == 0
        assert main(['to-kitti', str(bag), str(out), '-q', '--layout', 'odometry']) == 0
        made.append(files_of(out))
    assert made[0] == made[1]
    assert any('poses' in name for name in made[0])


@pytest.mark.skipif(find_spec('evo') is None, reason='evo is not installed')
@pytest.mark.parametrize('options', [{}, {'gt_topic': ODOMETRY}], ids=['own', 'topic'])
def test_it_is_the_same_ground_truth(recordings, tmp_path, options):
    from kitti_ros2.evaluation import evaluate_odometry  # noqa: PLC0415 - skipped without evo

    plain = write(recordings[Layout.RAW], tmp_path / 'plain.mcap')
    apart = write(recordings[Layout.RAW], tmp_path / 'apart.mcap', ground_truth=TREE)
    for truth in (plain, apart):
        scores = evaluate_odometry(truth, plain, topic=ODOMETRY, **options)
        assert scores.errors.ape_m == pytest.approx(0, abs=1e-5)  # metres
        assert len(scores.numbers) == 5


@pytest.mark.parametrize(
    ('options', 'named'),
    [
        ({'map': 'world'}, 'ground_truth_tree'),
        ({'tree': True, 'base': ''}, "''"),
        ({'tree': True, 'base': '/base'}, '/base'),
        ({'tree': True, 'map': 'my map'}, 'my map'),
        ({'tree': True, 'map': 'base_link_gt'}, 'both base_link_gt'),
    ],
)
def test_invalid_frames_are_refused(options, named):
    with pytest.raises(UsageError, match=named):
        GroundTruthOptions(**options)


@pytest.mark.parametrize('frame', ['base_link', 'velo_link', 'camera_color_left_optical_frame'])
@pytest.mark.parametrize('option', ['--ground-truth-map', '--ground-truth-base'])
def test_a_frame_of_the_sensors_would_join_the_trees(recordings, tmp_path, capsys, option, frame):
    bag = tmp_path / 'o.mcap'
    words = ['to-bag', str(recordings[Layout.RAW]), str(bag), '-q', '--ground-truth-tree']
    assert main([*words, option, frame]) == 2
    assert frame in one_line(capsys.readouterr().err)
    assert not bag.exists()


@pytest.mark.parametrize('stack', [None, StackName('lio-sam')])
@pytest.mark.parametrize('base', ['map', 'odom'])
def test_frames_of_stacks_get_no_second_parent(base, stack):
    options = MessageOptions(ground_truth=GroundTruthOptions(tree=True, base=base), stack=stack)
    with pytest.raises(UsageError, match=f'{base} is left to a stack; ground_truth_base needs'):
        with_ground_truth_tree(naming_of(options).frames_of(CAMERA_NAMES), options)
