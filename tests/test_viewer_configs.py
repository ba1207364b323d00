# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The layouts and displays of config/ name topics that there are, of the right types."""

import json
import re
from pathlib import Path

import fisheye_drive
import pytest
import yaml
from prediction_set import write_results
from rosbags.interfaces import Nodetype

from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.messages.topics import make_table
from kitti_ros2.model.bag_formats import ANNOTATIONS, DIAGNOSTICS
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Fisheye, Images, MessageOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program, reserved_by_node

CONFIG = Path(__file__).resolve().parents[1] / 'config'
STATE = '/kitti_player/state'

CLOUD = 'sensor_msgs/msg/PointCloud2'
IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
MARKERS = 'visualization_msgs/msg/MarkerArray'
PATH = 'nav_msgs/msg/Path'

OF_MARKERS = {'/kitti/labels/markers', '/kitti/predictions/markers'}

RVIZ_SHOWS = {
    'PointCloud2': CLOUD,
    'MarkerArray': MARKERS,
    'Path': PATH,
    'Image': IMAGE,
    'Camera': IMAGE,
}
FILES = {
    Layout.RAW: ('foxglove.json', 'kitti.rviz'),
    Layout.KITTI_360: ('foxglove_kitti360.json', 'kitti360.rviz'),
}
WITHOUT_OFFSET = ('camera_color_left', 'camera_gray_left', 'camera_0', 'camera_2/pinhole')
"""Cameras with a fourth column of P that is zero."""
ON_REQUEST = '--fisheye pinhole'


@pytest.fixture(scope='module', params=FILES, ids=lambda layout: layout.value)
def kitti(request):
    """The layout of KITTI that is shown."""
    return request.param


@pytest.fixture(scope='module')
def rows(kitti):
    """The topics with all cameras and kinds of images."""
    options = MessageOptions(images=Images.BOTH, annotations=True, fisheye=Fisheye.PINHOLE)
    traits = kitti.traits
    return make_table(traits.camera_names, 'image_rect', options, traits=traits)


@pytest.fixture(scope='module')
def types(rows):
    """By topic its type."""
    return {row.topic: row.msgtype for row in rows} | {STATE: DIAGNOSTICS}


@pytest.fixture(scope='module')
def layout(kitti):
    return json.loads((CONFIG / FILES[kitti][0]).read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def rviz(kitti):
    return yaml.safe_load((CONFIG / FILES[kitti][1]).read_text(encoding='utf-8'))


def panels(layout, kind):
    found = [each for name, each in layout['configById'].items() if name.split('!')[0] == kind]
    assert found, kind
    return found


def leaves(node):
    """The panels of a tree of splits."""
    if isinstance(node, str):
        return [node]
    assert set(node) == {'direction', 'first', 'second', 'splitPercentage'}
    assert node['direction'] in {'row', 'column'}
    assert 0 < node['splitPercentage'] < 100
    return leaves(node['first']) + leaves(node['second'])


def field_type(types, path):
    """What a message path such as /topic.field[0].field leads to."""
    topic, *fields = path.split('.')
    description = (Nodetype.NAME, types[topic])
    for field in fields:
        assert description[0] is Nodetype.NAME
        members = dict(TYPESTORE.fielddefs[description[1]][1])
        name, index, _ = field.partition('[')
        description = members[name]
        if index:
            assert description[0] is Nodetype.SEQUENCE
            description = description[1][0]
    return description


def test_the_layout_is_as_foxglove_exports_it(layout):
    """Each panel that is configured has one place, and each place its panel."""
    assert set(layout) == {
        'configById', 'globalVariables', 'layout', 'playbackConfig', 'userNodes'
    }  # fmt: skip
    assert sorted(leaves(layout['layout'])) == sorted(layout['configById'])


def test_the_scene_has_points_by_intensity_markers_and_the_path(layout, types):
    (scene,) = panels(layout, '3D')
    shown = {types[topic]: each for topic, each in scene['topics'].items() if each['visible']}
    assert set(shown) == {CLOUD, MARKERS, PATH}
    assert {topic for topic in scene['topics'] if types[topic] == MARKERS} == OF_MARKERS
    assert shown[CLOUD]['colorField'] == 'intensity'


def test_both_cameras_have_overlays_in_their_own_frames(layout, types):
    """A viewer projects by the left 3x3 of P: right for cameras whose fourth column is zero."""
    cameras = panels(layout, 'Image')
    assert len(cameras) == 2
    for camera in cameras:
        image, info = (camera['imageMode'][f'{name}Topic'] for name in ('image', 'calibration'))
        assert (types[image], types[info]) == (COMPRESSED, 'sensor_msgs/msg/CameraInfo')
        assert image.startswith(info.removesuffix('camera_info'))
        assert image.startswith(tuple(f'/kitti/{name}/image' for name in WITHOUT_OFFSET))
        assert ('pinhole' in image) == (ON_REQUEST in camera['foxglovePanelTitle'])
        visible = {types[topic] for topic, each in camera['topics'].items() if each['visible']}
        assert visible == {MARKERS}
        assert all(topic in types for topic in camera['topics'])
        for topic, each in camera['imageMode']['annotations'].items():
            assert topic.startswith(info.removesuffix('camera_info'))
            assert (types[topic], each['visible']) == (ANNOTATIONS, True)


def test_map_plots_and_state(layout, types):
    (chart,) = panels(layout, 'map')
    topics = {chart['followTopic'], *chart['topicColors'], *chart['topicConfig']}
    assert {types[topic] for topic in topics} == {'sensor_msgs/msg/NavSatFix'}
    for plot in panels(layout, 'Plot'):
        for path in plot['paths']:
            assert path['enabled']
            assert types[path['value'].split('.')[0]] == 'sensor_msgs/msg/Imu'
            assert field_type(types, path['value']) == (Nodetype.BASE, ('float64', 0))
    (summary,) = panels(layout, 'DiagnosticSummary')
    assert types[summary['topicToRender']] == DIAGNOSTICS
    (table,) = panels(layout, 'Table')
    assert field_type(types, table['topicPath'])[0] is Nodetype.SEQUENCE


def test_rviz_shows_what_there_is(rviz, types):
    displays = rviz['Visualization Manager']['Displays']
    kinds = {display['Class'].split('/')[1] for display in displays}
    assert kinds | {'Camera'} == {'Grid', 'TF', *RVIZ_SHOWS}
    for display in displays:
        assert display['Enabled'] == (ON_REQUEST not in display['Name'])
        kind = display['Class'].split('/')[1]
        if kind in RVIZ_SHOWS:
            assert types[display['Topic']['Value']] == RVIZ_SHOWS[kind]
    marked = {each['Topic']['Value'] for each in displays if each['Class'].endswith('MarkerArray')}
    assert marked == OF_MARKERS
    cloud = next(each for each in displays if each['Class'].endswith('PointCloud2'))
    assert cloud['Channel Name'] == 'intensity'


def test_cameras_of_rviz_have_a_camera_info_that_it_can_use(rviz, types):
    """RViz takes camera_info beside the image, and projects by P of any model."""
    for display in rviz['Visualization Manager']['Displays']:
        if display['Class'].endswith('Camera'):
            image = display['Topic']['Value']
            camera, _, name = image.rpartition('/')
            assert types[f'{camera}/camera_info'] == 'sensor_msgs/msg/CameraInfo'
            assert name == 'image_rect'
            assert ('pinhole' in image) == (ON_REQUEST in display['Name'])


def test_rviz_asks_for_what_is_latched(rviz, rows):
    """A path that is sent once comes to whom asks for transient local, and to nobody else."""
    asked = {
        display['Topic']['Value']: display['Topic']['Durability Policy']
        for display in rviz['Visualization Manager']['Displays']
        if 'Topic' in display
    }
    latched = {row.topic for row in rows if row.latched}
    for topic, durability in asked.items():
        assert durability == ('Transient Local' if topic in latched else 'Volatile')


@pytest.fixture(params=['a folder', 'a bag of to-bag'])
def published(request, kitti, rows, recordings, tmp_path):
    """By topic its type, of a drive with predictions, and of the bag that to-bag makes of it.

    Topics of packets and labels are taken as published where the synthetic drive has none.
    """
    source, given = recordings[kitti], {}
    if kitti.traits.raw_cameras:
        source = fisheye_drive.add_fisheyes(source, tmp_path / 'set')
        given = {'fisheye': 'pinhole'}
    streams = {Stream.OXTS, Stream.LABELS} - {*open_recording(source).streams}
    results = str(write_results(tmp_path / 'results', {number: [] for number in range(5)}))
    if request.param == 'a folder':
        given |= {'predictions': results}
    else:
        words = ['to-bag', str(source), str(tmp_path / 'drive_0005'), '--predictions', results]
        words += [word for name, value in given.items() for word in (f'--{name}', value)]
        assert main([*words, '-q']) == 0
        source = tmp_path / 'drive_0005'
    values = yaml.safe_load((CONFIG / 'player.yaml').read_text('utf-8'))
    values = values['kitti_player']['ros__parameters']
    of_file = {
        name: value
        for name, value in values.items()
        if name not in ('source', 'position', 'burst') and value not in ('', [''])
    }
    settings = make_play_settings(of_file | given)
    program = open_program(source, settings, reserved_by_node('/kitti_player', settings))
    lacking = {row.topic: row.msgtype for row in rows if row.stream in streams}
    return lacking | {each.topic: each.msgtype for each in program.channels} | {STATE: DIAGNOSTICS}


def test_what_rviz_shows_is_published(rviz, published):
    shown = {
        display['Topic']['Value']: display['Class'].split('/')[1]
        for display in rviz['Visualization Manager']['Displays']
        if 'Topic' in display
    }
    assert 'Image' in shown.values()
    assert {topic: published[topic] for topic in shown} == {
        topic: RVIZ_SHOWS[kind] for topic, kind in shown.items()
    }


def test_what_foxglove_shows_is_published(kitti, published):
    text = (CONFIG / FILES[kitti][0]).read_text('utf-8')
    shown = set(re.findall(r'"(/kitti[\w/]*)', text))
    on_request = {topic for topic in shown if topic.endswith('annotations')}
    assert len(shown - on_request) >= 8
    assert sorted(shown - set(published) - on_request) == []
