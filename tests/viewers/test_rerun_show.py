# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A whole recording in an .rrd file: points, images and boxes at the recording's own times."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest

pytest.importorskip('rerun', reason='rerun-sdk is not installed')

import foreign
from prediction_set import write_prediction_set
from read_rrd import show_in

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.drawing.labelled_objects import PREDICTION_COLOR
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.naming import POINTS as SOURCE_POINTS
from kitti_ros2.model.bag_formats import Points
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.read import Bound, SelectionOptions
from kitti_ros2.options.table import make_settings
from kitti_ros2.player.bag_program import BagProgram, open_program
from kitti_ros2.player.program import RecordingProgram
from kitti_ros2.viewers.rerun_series import make_survey
from kitti_ros2.viewers.rerun_show import _space, chosen_cameras

from builders import convert_recording  # isort: skip

ALL = SelectionOptions()
POINTS = '/kitti/velo/points'


def program_of(path, selection=ALL):
    return RecordingProgram(open_recording(path), MessageOptions(), selection, 2)


@pytest.fixture
def bag(recording_path, tmp_path):
    path = tmp_path / 'o.mcap'
    convert_recording(recording_path, path)
    return path


def messages_of(bag):
    """Topic to (stamp, message), decoded."""
    found = defaultdict(list)
    with open_messages(bag) as messages:
        for each in messages:
            found[each.topic].append((each.stamp_ns, deserialize(each.data, each.msgtype)))
    return found


def test_points_images_and_boxes_are_those_of_the_bag_at_its_times(recording_path, bag, tmp_path):
    messages = messages_of(bag)
    rrd, report = show_in(tmp_path / 'o.rrd', program_of(recording_path))
    assert rrd.timelines == {'time', 'frame'}
    assert len(rrd.blueprints) == 1
    assert report.messages == sum(map(len, messages.values()))
    assert (dict(report.losses), report.missing) == ({}, ())

    found = rrd.having(POINTS, 'Points3D:positions')
    assert len(found) == len(messages[POINTS]) > 0
    for (stamp, positions), (stamp_ns, cloud) in zip(found, messages[POINTS], strict=True):
        assert stamp == stamp_ns
        points = cloud.data.view('<f4').reshape(-1, 4)
        np.testing.assert_array_equal(positions.reshape(-1, 3), points[:, :3])

    images = [topic for topic in messages if topic.endswith('/compressed')]
    assert images
    for topic in images:
        found = rrd.having(topic, 'EncodedImage:blob')
        sent = [(stamp_ns, image.data.tobytes()) for stamp_ns, image in messages[topic]]
        assert [(stamp, blob.tobytes()) for stamp, blob in found] == sent

    found = rrd.having('/kitti/labels/detections', 'Boxes3D:centers')
    assert len(found) == len(messages['/kitti/labels/detections'])
    for (stamp, centers), (stamp_ns, array) in zip(
        found, messages['/kitti/labels/detections'], strict=True
    ):
        assert stamp == stamp_ns
        places = [each.bbox.center.position for each in array.detections]
        expected = np.array([(p.x, p.y, p.z) for p in places]).reshape(-1, 3)
        np.testing.assert_allclose(np.reshape(centers, (-1, 3)), expected, rtol=1e-6)


def test_frames_are_numbered_as_the_files(recording_path, tmp_path):
    recording = open_recording(recording_path)
    rrd, _ = show_in(tmp_path / 'o.rrd', program_of(recording_path))
    scans = recording.streams[Stream.SCAN]
    shown = [row for row in rrd.rows[POINTS] if 'Points3D:positions' in row.components]
    assert [row.frame for row in shown] == scans.numbers.tolist()


def test_a_bag_shows_what_its_folder_shows(recording_path, bag, tmp_path):
    folder, _ = show_in(tmp_path / 'folder.rrd', program_of(recording_path))
    other, _ = show_in(tmp_path / 'bag.rrd', BagProgram(bag, ALL))
    assert set(folder.rows) == set(other.rows)
    for entity, rows in folder.rows.items():
        if entity.startswith('/__'):
            continue
        stamps = [(row.stamp_ns, sorted(row.components)) for row in rows]
        assert stamps == [(row.stamp_ns, sorted(row.components)) for row in other.rows[entity]]


def test_a_selection_begins_with_what_is_latched(recordings, tmp_path):
    path = tmp_path / 'o.mcap'
    convert_recording(recordings[Layout.RAW], path)
    begin = BagProgram(path, SelectionOptions()).stamps_ns
    program = BagProgram(path, SelectionOptions(start=Bound.parse('2')))
    first_ns = int(program.stamps_ns[0])
    assert first_ns > begin[0]
    rrd, _ = show_in(tmp_path / 'o.rrd', program)
    links = [entity for entity in rrd.rows if entity.startswith('/transforms/')]
    stamps = {entity: rrd.rows[entity][0].stamp_ns for entity in links}
    assert stamps.pop('/transforms/base_link') >= first_ns  # moves
    assert set(stamps.values()) == {first_ns}


def test_a_damaged_bag_is_shown_as_far_as_it_goes(recordings, tmp_path):
    bag = tmp_path / 'o.mcap'
    convert_recording(recordings[Layout.RAW], bag)
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    rrd, report = show_in(tmp_path / 'o.rrd', BagProgram(bag, ALL))
    assert report.missing
    assert rrd.having(POINTS, 'Points3D:positions')


def test_views_of_kitti(recordings):
    survey = make_survey(program_of(recordings[Layout.OBJECT]))
    assert survey.vehicle() == 'base_link'
    assert survey.images_in('camera_color_left_optical_frame') == [
        '/kitti/camera_color_left/image_rect/compressed'
    ]
    assert chosen_cameras(survey)[0] == '/kitti/camera_color_left/image_rect/compressed'
    survey = make_survey(program_of(recordings[Layout.RAW]))
    assert [camera.split('/')[2] for camera in chosen_cameras(survey)] == [
        'camera_color_left',
        'camera_color_right',
    ]


def test_views_of_a_bag_of_others(tmp_path):
    bag = foreign.write_foreign(tmp_path / 'o.mcap', foreign.make_truth())
    survey = make_survey(BagProgram(bag, ALL))
    assert survey.vehicle() == 'base_link'
    assert chosen_cameras(survey) == ['/cam/left/image_raw', '/cam/right/image_rect/compressed']
    without_tf = foreign.write_foreign(
        tmp_path / 'p.mcap', foreign.make_truth(), 'mcap', '/tf_static'
    )
    assert make_survey(BagProgram(without_tf, ALL)).vehicle() == 'os_sensor'


def test_predictions_have_a_colour_of_their_own(recordings, tmp_path):
    made = write_prediction_set(recordings[Layout.OBJECT], tmp_path)
    settings = make_settings({'predictions': str(made.results), 'iou': 0.5})
    rrd, report = show_in(tmp_path / 'o.rrd', open_program(made.root, settings))
    assert any('no result file for frames 4' in text for text in report.missing)
    packed = int.from_bytes(bytes((*PREDICTION_COLOR, 255)), 'big')
    for topic, kind in (('detections', 'Boxes3D'), ('boxes_2d', 'Boxes2D')):
        entities = [name for name in rrd.rows if name.endswith(f'kitti/predictions/{topic}')]
        shown = [row for name in entities for row in rrd.having(name, f'{kind}:colors')]
        assert {int(color) for _, colors in shown for color in colors} == {packed}


def test_the_space_shows_the_markers_of_predictions(recordings, tmp_path):
    """Of the two topics with the same boxes: the classes of labels, the results of predictions."""
    made = write_prediction_set(recordings[Layout.OBJECT], tmp_path)
    settings = make_settings({'predictions': str(made.results)})
    contents = _space(make_survey(open_program(made.root, settings)), []).contents
    topics = [f'{kind}/{form}' for kind in ('labels', 'predictions') for form in (
        'detections', 'markers')]  # fmt: skip
    hidden = {each for each in topics if f'- /kitti/{each}/**' in contents}
    assert hidden == {'labels/markers', 'predictions/detections'}


def test_an_organised_cloud_is_shown_once_without_missing_returns(recordings, tmp_path):
    recording = open_recording(recordings[Layout.OBJECT])
    program = RecordingProgram(recording, MessageOptions(points=Points.OUSTER), ALL, 2)
    rrd, report = show_in(tmp_path / 'o.rrd', program)
    assert not report.losses
    assert not rrd.having(SOURCE_POINTS, 'Points3D:positions')
    found = rrd.having(POINTS, 'Points3D:positions')
    numbers = recording.streams[Stream.SCAN].numbers.tolist()
    for number, (_, positions) in zip(numbers, found, strict=True):
        expected = recording.read(Stream.SCAN, number).points[:, :3]
        assert sorted(map(bytes, positions.reshape(-1, 3))) == sorted(map(bytes, expected))
