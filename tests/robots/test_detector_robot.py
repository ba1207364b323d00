# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes of detectors become labels: 3D and 2D joined, markers of several arrays; deep pixels."""

from __future__ import annotations

from dataclasses import replace

import cv2
import detector_robot as robot
import numpy as np
import pytest
import robot_bags as bags

from kitti_ros2.bags.open_source import open_bag_source
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.box_labels import rectified_boxes
from kitti_ros2.importer.plan import format_plan, parse_plan
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.survey import group_messages, survey_bags
from kitti_ros2.kitti.label_file import parse_box
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import CameraModel
from kitti_ros2.messages.detections import ImageBox
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.recording_frames import RecordingFrames


def convert(bag, out, change=lambda plan: plan, layout=Layout.OBJECT):
    """(plan, report) of a bag."""
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    plan = change(guess([bag], survey, options).plan)
    plan = parse_plan(format_plan(plan), out.with_suffix('.yaml'))
    return plan, convert_by_plan([bag], plan, survey, out, options)


def labels(out, number):
    """The boxes of a frame, in the order of the file."""
    text = (out / 'training' / 'label_2' / f'{number:06d}.txt').read_text()
    return [parse_box(line) for line in text.splitlines()]


class Test2D:
    @pytest.mark.parametrize('container', ['mcap', 'ros1'])
    def test_boxes_are_joined_by_id_then_by_overlap_and_the_rest_is_2d_only(
        self, tmp_path, container
    ):
        bag = bags.write(tmp_path / 'bag', robot.said({'solid', 'flat'}), container)
        plan, report = convert(bag, tmp_path / 'out')
        assert (plan.labels.topic, plan.labels.boxes_2d) == ('/boxes', '/boxes_2d')
        assert report.losses == ()
        flat = [box for _, _, box in robot.flat_boxes()]
        for number in range(robot.FRAMES):
            boxes = labels(tmp_path / 'out', number)
            assert [box.class_name for box in boxes] == ['Car', 'Car', 'Pedestrian', 'Cyclist']
            true = [flat[0], flat[1], robot.projected(*robot.SOLID[2][2:]), flat[2]]
            assert np.abs(np.array([box.box_2d for box in boxes]) - true).max() < 1e-3
            alone = boxes[3]
            assert alone.size_hwl == (-1, -1, -1)
            assert alone.location == (-1000, -1000, -1000)
            assert (alone.alpha, alone.rotation_y) == (-10, -10)
            assert [box.size_hwl[0] for box in boxes[:3]] == [1.5, 1.4, 1.8]

    def test_the_offset_of_labels_is_that_of_their_2d_boxes(self, tmp_path):
        """The detectors' clock is 5 s behind; without 2D boxes labels have no Cyclist."""
        made = {'/boxes': robot.solid_message, '/boxes_2d': robot.flat_message}
        said = [
            each._replace(values=made[each.topic](each.log_ns - 5 * 10**9))
            if each.topic in made
            else each
            for each in robot.said({'solid', 'flat'})
        ]
        plan, report = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert (plan.labels.boxes_2d, plan.labels.offset_s) == ('/boxes_2d', 5.0)
        assert report.losses == ()
        for number in range(robot.FRAMES):
            found = [box.class_name for box in labels(tmp_path / 'out', number)]
            assert found == ['Car', 'Car', 'Pedestrian', 'Cyclist']

    def test_2d_boxes_alone_are_labels(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said({'flat'}))
        plan, report = convert(bag, tmp_path / 'out')
        assert (plan.labels.topic, plan.labels.boxes_2d) == ('/boxes_2d', '')
        assert report.losses == ()
        boxes = labels(tmp_path / 'out', 1)
        assert [box.class_name for box in boxes] == ['Car', 'Car', 'Cyclist']
        true = [box for _, _, box in robot.flat_boxes()]
        assert np.abs(np.array([box.box_2d for box in boxes]) - true).max() < 1e-3
        assert all(box.location == (-1000, -1000, -1000) for box in boxes)

    @pytest.mark.parametrize('kinds', [{'flat'}, {'solid', 'flat'}])
    def test_a_frame_at_the_place_of_the_camera_is_the_cameras(self, kinds, tmp_path):
        said = robot.said(kinds, flat_frame='camera_link')
        plan, report = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert '/boxes_2d' in {plan.labels.topic, plan.labels.boxes_2d}
        assert report.losses == ()
        assert not any('another camera' in note for note in report.notes)
        boxes = labels(tmp_path / 'out', 1)
        assert [box.class_name for box in boxes if box.size_hwl[0] == -1][-1] == 'Cyclist'

    @pytest.mark.parametrize(
        ('kinds', 'layout', 'frame', 'said'),
        [
            (
                {'flat'},
                Layout.OBJECT,
                'base_link',
                'is base_link; those of camera 2 have camera_link, camera_optical',
            ),
            (
                {'solid', 'flat'},
                Layout.OBJECT,
                'base_link',
                'is base_link; those of camera 2 have camera_link, camera_optical',
            ),
            ({'flat'}, Layout.RAW, 'camera_link', 'for labels of layouts object and tracking'),
        ],
    )
    def test_those_that_are_not_used_are_named_with_what_could_be_done(
        self, kinds, layout, frame, said, tmp_path
    ):
        bag = bags.write(tmp_path / 'bag', robot.said(kinds, flat_frame=frame))
        notes = guess([bag], survey_bags([bag]), ImportOptions(layout=layout)).notes
        (note,) = (line for line in notes if 'not used: /boxes_2d' in line)
        assert said in note

    def test_raw_says_that_tracklets_have_no_2d_boxes(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said({'solid', 'flat'}))
        _, report = convert(bag, tmp_path / 'out', layout=Layout.RAW)
        assert f'{robot.FRAMES} boxes without a 3D box' in ' '.join(report.notes)

    def test_those_of_another_camera_are_left_out_aloud(self, tmp_path):
        said = robot.said({'solid'})
        said += [
            bags.Said(
                '/boxes_2d',
                robot.START_NS + n * robot.PERIOD_NS,
                'vision_msgs/msg/Detection2DArray',
                robot.flat_message(robot.START_NS + n * robot.PERIOD_NS, 'other'),
            )
            for n in range(robot.FRAMES)
        ]
        bag = bags.write(tmp_path / 'bag', said)
        plan, _ = convert(bag, tmp_path / 'out')
        assert plan.labels.boxes_2d == ''
        _, report = convert(
            bag,
            tmp_path / 'out2',
            lambda plan: replace(plan, labels=replace(plan.labels, boxes_2d='/boxes_2d')),
        )
        assert '12 boxes in the pixels of another camera' in ' '.join(report.notes)

    def test_a_topic_of_another_type_is_refused(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said({'solid', 'flat'}))
        with pytest.raises(UsageError, match=r'labels\.boxes_2d: /boxes is a vision_msgs'):
            convert(
                bag,
                tmp_path / 'out',
                lambda plan: replace(plan, labels=replace(plan.labels, boxes_2d='/boxes')),
            )


def test_boxes_in_pixels_of_the_lens_move_with_the_rectified_image():
    """The box around the rectified sides: compared with sides of a thousand points."""
    d = np.array([-0.3, 0.1, 0.001, -0.002, 0.0])
    p = np.array([[450.0, 0, 310, 0], [0, 450, 175, 0], [0, 0, 1, 0]])
    camera = CameraModel('c', robot.SIZE, robot.K, d, np.eye(3), p)
    box = ImageBox('Car', '', (20.0, 30.0, 200.0, 330.0), None, 'c')
    (moved,) = rectified_boxes([box], camera)
    share = np.linspace(0, 1, 1000)
    x, y = 20 + 180 * share, 30 + 300 * share
    sides = [(x, 30 + 0 * x), (x, 330 + 0 * x), (20 + 0 * y, y), (200 + 0 * y, y)]
    pixels = np.vstack([np.column_stack(side) for side in sides])
    true = cv2.undistortPoints(pixels[:, None], robot.K, d, P=p[:, :3])[:, 0]
    assert moved.box_2d == pytest.approx([*true.min(axis=0), *true.max(axis=0)], abs=0.5)


@pytest.mark.parametrize('container', ['mcap', 'ros1'])
def test_marker_arrays_of_one_stamp_are_joined(tmp_path, container):
    bag = bags.write(tmp_path / 'bag', robot.said({'markers'}), container)
    _, report = convert(bag, tmp_path / 'out')
    assert report.losses == ()
    assert report.frames == robot.FRAMES
    for number in range(robot.FRAMES):
        found = sorted(labels(tmp_path / 'out', number), key=lambda box: box.location[2])
        assert [box.class_name for box in found] == ['Pedestrian', 'Car', 'Car']
        assert [box.size_hwl[0] for box in found] == [1.8, 1.5, 1.4]


@pytest.mark.parametrize('kind', ['tracked', 'detected'])
def test_objects_of_autoware_become_labels(tmp_path, kind):
    bag = bags.write(tmp_path / 'bag', robot.said({kind, 'flat'}))
    plan, report = convert(bag, tmp_path / 'out')
    assert (plan.labels.topic, plan.labels.boxes_2d) == ('/objects', '/boxes_2d')
    assert report.losses == ()
    boxes = labels(tmp_path / 'out', 2)
    assert [box.class_name for box in boxes[:3]] == ['Car', 'Car', 'Pedestrian']
    assert [box.size_hwl[0] for box in boxes[:3]] == pytest.approx([1.5, 1.4, 1.8])
    second = robot.flat_boxes()[1][2]
    assert np.abs(np.array(boxes[1].box_2d) - second).max() < 1e-3


def divided(said, *topics, second_frame='', again=False):
    """The messages of topics in two of one stamp each; the boxes of the second perhaps again."""
    found = []
    for each in said:
        if each.topic not in topics:
            found.append(each)
            continue
        key = 'objects' if 'objects' in each.values else 'detections'
        boxes = each.values[key]
        rest = dict(each.values)
        if second_frame:
            rest['header'] = {**rest['header'], 'frame_id': second_frame}
            boxes = [{**box, 'header': rest['header']} for box in boxes]
        later = each._replace(log_ns=each.log_ns + 2_000_000)
        found.append(each._replace(values={**each.values, key: each.values[key][:1]}))
        found.append(later._replace(values={**rest, key: boxes[1:]}))
        if again:
            found.append(later._replace(values={**rest, key: nudged(boxes[1:])}))
    return found


def nudged(value):
    """Values with all positions a little further on."""
    if isinstance(value, list):
        return [nudged(each) for each in value]
    if not isinstance(value, dict):
        return value
    found = {key: nudged(each) for key, each in value.items()}
    if 'position' in found:
        found['position'] = {**found['position'], 'x': found['position']['x'] + 0.05}
    return found


class TestArraysOfOneStamp:
    """Of several detectors on one topic."""

    @pytest.mark.one_in(3)
    @pytest.mark.parametrize('again', [False, True])
    @pytest.mark.parametrize(
        ('kinds', 'topics', 'each'),
        [
            ({'solid'}, ('/boxes',), 2),
            ({'tracked'}, ('/objects',), 2),
            ({'detected'}, ('/objects',), 2),
            ({'flat'}, ('/boxes_2d',), 2),
            ({'solid', 'flat'}, ('/boxes_2d',), 2),
            ({'solid', 'flat'}, ('/boxes', '/boxes_2d'), 4),
        ],
    )
    @pytest.mark.parametrize('container', ['mcap', 'ros1'])
    def test_are_joined(self, tmp_path, kinds, topics, each, again, container):
        if container == 'ros1' and not kinds <= {'solid', 'flat'}:
            pytest.skip('Autoware has no messages of ROS 1')
        whole = bags.write(tmp_path / 'whole', robot.said(kinds), container)
        parts = divided(robot.said(kinds), *topics, again=again)
        bag = bags.write(tmp_path / 'bag', parts, container)
        convert(whole, tmp_path / 'true')
        _, report = convert(bag, tmp_path / 'out')
        assert report.losses == ()
        for number in range(robot.FRAMES):
            assert labels(tmp_path / 'out', number) == labels(tmp_path / 'true', number)
        notes = [note for note in report.notes if 'another message of their stamp has' in note]
        assert [note.split()[0] for note in notes] == [str(each * robot.FRAMES)] * again
        assert not any('each is a sample of its own' in note for note in report.notes)

    def test_one_in_a_frame_that_nothing_joins_costs_its_boxes(self, tmp_path):
        said = divided(robot.said({'solid'}), '/boxes', second_frame='elsewhere')
        _, report = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        (loss,) = report.losses
        assert (loss.stream, loss.count) == ('/boxes', 2 * robot.FRAMES)
        assert [len(labels(tmp_path / 'out', number)) for number in range(robot.FRAMES)] == [1] * 4

    def test_a_recording_in_which_all_is_twice_has_all_frames_twice(self, tmp_path):
        said = [each for each in robot.said({'solid', 'flat'}) for _ in range(2)]
        _, report = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert report.losses == ()
        found = [len(labels(tmp_path / 'out', number)) for number in range(2 * robot.FRAMES)]
        assert found == [4] * 2 * robot.FRAMES

    @pytest.mark.parametrize(
        ('kinds', 'topic'), [({'solid'}, '/boxes'), ({'tracked'}, '/objects'), ({'markers'}, '')]
    )
    def test_are_one_frame_of_the_viewer(self, tmp_path, kinds, topic):
        said = divided(robot.said(kinds), topic, again=True)
        bag = open_bag_source(bags.write(tmp_path / 'bag', said))
        frames = RecordingFrames(PlannedRecording(bag, survey_bags([bag])))
        for number in range(robot.FRAMES):
            found = frames.read(Stream.LABELS, number).cuboids
            assert sorted(each.size_lwh[2] for each in found) == [1.4, 1.5, 1.8]
        frames.close()

    def test_near_boxes_of_one_message_stay(self, tmp_path):
        said = robot.said({'solid'})
        for each in said:
            if each.topic == '/boxes':
                each.values['detections'] += each.values['detections'][:1]
        _, report = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert report.losses == ()
        assert len(labels(tmp_path / 'out', 0)) == 4


class TestGroups:
    def test_messages_without_a_stamp_stay_alone(self):
        stamps = [100, -1, 100, -1, 200]
        assert group_messages(stamps, [0, 1, 2, 3, 10]) == [[0, 2], [1], [3], [4]]

    def test_arrays_of_one_stamp_belong_together(self):
        stamps = [100, 100, 200, 200, 200]
        assert group_messages(stamps, [0, 1, 10, 11, 12]) == [[0, 1], [2, 3, 4]]

    def test_an_empty_array_belongs_to_the_nearest(self):
        stamps = [100, 0, 100, 200, 0, 200, 0]
        logs = [0, 1, 2, 100, 101, 102, 160]
        assert group_messages(stamps, logs) == [[0, 1, 2], [3, 4, 5], [6]]

    @pytest.mark.parametrize('stamps', [[0, 0, 0], [7, 7, 7, 7], [1, 2, 3], [5], []])
    def test_others_stay_alone(self, stamps):
        logs = [10 * place for place in range(len(stamps))]
        assert group_messages(stamps, logs) == [[place] for place in range(len(stamps))]


class TestPixels:
    def read(self, out, number=1):
        (path,) = out.glob(f'training/image_2/{number:06d}.png')
        return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)

    @pytest.mark.parametrize('encoding', ['mono16', 'rgb16', 'bgr16'])
    def test_16_bits_stay_and_are_told(self, tmp_path, encoding):
        bag = bags.write(tmp_path / 'bag', robot.said(set(), encoding))
        _, report = convert(bag, tmp_path / 'out')
        assert report.losses == ()
        true = robot.picture(1, encoding)
        if encoding == 'rgb16':
            true = true[..., ::-1]
        found = self.read(tmp_path / 'out')
        assert found.dtype == np.uint16
        assert np.array_equal(found, true)
        assert any('16 bits' in note and '/camera/image' in note for note in report.notes)
        recording = open_recording(tmp_path / 'out', ReadOptions(layout=Layout.OBJECT))
        assert recording.read(Stream.IMAGE_2, 1).width == robot.SIZE[0]

    def test_a_mosaic_of_16_bits(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said(set(), 'bayer_rggb16'))
        _, report = convert(bag, tmp_path / 'out')
        true = cv2.cvtColor(robot.picture(1, 'bayer_rggb16'), cv2.COLOR_BayerRGGB2BGR)
        assert np.array_equal(self.read(tmp_path / 'out'), true)
        assert report.losses == ()

    def test_8_bits_are_not_told(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said(set(), 'rgb8'))
        _, report = convert(bag, tmp_path / 'out')
        assert not any('16 bits' in note for note in report.notes)

    def test_webp(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said(set(), 'webp'))
        _, report = convert(bag, tmp_path / 'out')
        assert report.losses == ()
        found = self.read(tmp_path / 'out')
        assert np.array_equal(found[150, 100], (20, 200, 90))
        assert not found[:90].any()

    @pytest.mark.parametrize('cut', [0, 11, 20, 40, -1])
    def test_a_truncated_webp_is_a_loss(self, tmp_path, cut):
        said = robot.said(set(), 'webp')
        places = [n for n, each in enumerate(said) if each.topic == '/camera/image/compressed']
        values = dict(said[places[2]].values)
        values['data'] = values['data'][:cut]
        said[places[2]] = said[places[2]]._replace(values=values)
        _, report = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert [loss.count for loss in report.losses] == [1]
