# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Results of a bag against the labels that they were made of."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from kitti_ros2.evaluation import read_bag_results
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import encode_static
from kitti_ros2.messages.cdr import deserialize, join
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.messages.markers import encode_markers
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.model.bag_formats import CLOCK, MARKERS, TF
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.classes import class_of, label_of
from kitti_ros2.model.errors import BadBagError, UsageError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import cuboids_of, rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MarkerOptions

from builders import convert_recording  # isort: skip
from folder_and_bag import make_holes  # isort: skip
from recorded import serialized_clock  # isort: skip
from result_bag import (  # isort: skip
    TOPIC,
    Published,
    answers,
    answers_2d,
    answers_of_autoware,
    detected,
    labels_of,
    stamps_of,
    write_bag,
)

SENSOR_T_VELO = Transform(rotation_from_rpy(0.02, -0.1, 2.0), np.array([0.3, -0.2, 1.1]))
MS = 1_000_000


@pytest.fixture(params=[Layout.TRACKING, Layout.OBJECT])
def truth(request, recordings, tmp_path):
    """A recording with labels whose numbers have holes."""
    return open_recording(make_holes(recordings[request.param], request.param, tmp_path / 'holes'))


@pytest.fixture
def tracking(recordings):
    return open_recording(recordings[Layout.TRACKING])


def read(path, truth, topic=TOPIC, class_map=(), **options):
    return read_bag_results(path, topic, truth, dict(class_map), **options)


def assert_same_objects(results, truth, numbers=None):
    """The boxes are the labels within view, as result files have them."""
    frames = stamps_of(truth) if numbers is None else numbers
    assert list(results.boxes) == list(frames)
    assert any(results.boxes.values())
    for number in frames:
        by_track = {box.track_id: box for box in results.boxes[number]}
        assert len(by_track) == len(results.boxes[number])
        for place, label in enumerate(labels_of(truth, number)):
            box = by_track.pop(place if label.track_id is None else label.track_id, None)
            if box is None:  # out of view
                continue
            assert (box.class_name, box.score, box.frame) == (label.class_name, 0.5, number)
            assert (box.truncated, box.occluded) == (-1, -1)
            np.testing.assert_allclose(box.location, label.location, atol=1e-4)
            np.testing.assert_allclose(box.size_hwl, label.size_hwl, atol=1e-9)
            turn = (box.rotation_y - label.rotation_y + pi) % (2 * pi) - pi
            assert turn == pytest.approx(0, abs=1e-4)
            alpha = box.rotation_y - np.arctan2(box.location[0], box.location[2])
            assert np.cos(alpha - box.alpha) == pytest.approx(1)
        assert not by_track


def test_boxes_are_the_labels_they_were_made_of(truth, tmp_path):
    results = read(write_bag(tmp_path / 'bag.mcap', answers(truth)), truth)
    assert_same_objects(results, truth)
    assert not results.unanswered
    assert not results.losses


@pytest.mark.parametrize('tracked', [False, True])
def test_objects_of_autoware_are_the_labels_they_were_made_of(tracked, tracking, tmp_path):
    """In base_link, with the classes that Autoware has."""
    path = write_bag(tmp_path / 'bag.mcap', answers_of_autoware(tracking, tracked=tracked))
    results = read(path, tracking)
    assert not results.losses
    compared = 0
    for number, boxes in results.boxes.items():
        labels = {tuple(np.round(own.location, 2)): own for own in labels_of(tracking, number)}
        for box in boxes:
            label = labels[tuple(np.round(box.location, 2))]
            assert box.class_name == class_of(label_of(label.class_name, {}))
            assert (box.score, not tracked or box.track_id == label.track_id) == (0.5, True)
            compared += 1
    assert compared > 10


def test_2d_boxes_are_the_labels_in_the_image(truth, tmp_path):
    results = read(write_bag(tmp_path / 'bag.mcap', answers(truth)), truth)
    for number, boxes in results.boxes.items():
        for box in boxes:
            left, top, right, bottom = box.box_2d
            assert 0 <= left < right <= 309
            assert 0 <= top < bottom <= 93
        near = [box for box in labels_of(truth, number) if box.truncated == 0]
        by_place = {tuple(np.round(box.location, 3)): box for box in boxes}
        for label in near:
            box = by_place.get(tuple(np.round(label.location, 3)))
            if box is not None:
                np.testing.assert_allclose(box.box_2d, label.box_2d, atol=0.3)


@pytest.mark.parametrize(
    'frame',
    ['camera_gray_left_optical_frame', 'camera_color_left_optical_frame', 'camera_gray_left'],
)
def test_boxes_in_a_camera_need_no_transform(frame, truth, tmp_path):
    number = next(iter(stamps_of(truth)))
    calibration = truth.calibration(number)
    rect_t_velo = rect_from_velo(calibration)
    offset = np.zeros(3)
    if 'color' in frame:
        p = calibration.cameras[2].p_rect
        offset = np.linalg.solve(p[:, :3], p[:, 3])
    cam_t_velo = Transform.from_translation(offset) @ rect_t_velo
    path = write_bag(tmp_path / 'bag.mcap', answers(truth, frame, cam_t_velo))
    results = read(path, truth)
    assert_same_objects(results, truth)
    assert not results.losses


def test_boxes_in_a_frame_of_the_stack_are_joined_by_its_transforms(truth, tmp_path):
    static = encode_static([('velo_link', 'sensor', SENSOR_T_VELO.inverse())], 1)
    path = write_bag(
        tmp_path / 'bag.mcap',
        [*answers(truth, '/sensor', SENSOR_T_VELO), Published('/tf_static', 1, static, TF)],
    )
    results = read(path, truth)
    assert_same_objects(results, truth)
    assert not any('velo_link' in note for note in results.notes)


def map_t_velo(stamp_ns: int) -> Transform:
    seconds = stamp_ns % 10**12 / 1e9
    return Transform(rotation_from_rpy(0, 0, 0.1 * seconds), np.array([10 * seconds, 0, 0]))


@pytest.mark.parametrize('late_ms', [0, 30, 45, -20])
@pytest.mark.parametrize('frame', ['map', 'world/map'])
def test_boxes_in_map_stand_whatever_their_stamp(frame, late_ms, tracking, tmp_path):
    """The boxes stand in the map, and are told some time after the scan that they were seen in."""
    stamps = stamps_of(tracking)
    first = min(stamps.values())
    moving = []
    for millisecond in range(-80, 560, 1):
        stamp = first + millisecond * MS
        links = [(frame, 'base', map_t_velo(stamp) @ SENSOR_T_VELO.inverse())]
        moving.append(Published('/tf', stamp, encode_static(links, stamp), TF))
    static = encode_static([('base', 'velo_link', SENSOR_T_VELO)], 1)
    published = []
    for number, stamp in stamps.items():
        late_ns = stamp + late_ms * MS
        made = detected(tracking, number, frame, map_t_velo(stamp), late_ns)
        published.append(Published(TOPIC, late_ns, made))
    path = write_bag(
        tmp_path / 'bag.mcap', [*published, *moving, Published('/tf_static', 1, static, TF)]
    )
    results = read(path, tracking)
    assert results.boxes.keys() == stamps.keys()
    for number in stamps:
        for box in results.boxes[number]:
            places = [label.location for label in labels_of(tracking, number)]
            assert np.abs(np.array(places) - box.location).max(axis=1).min() < 1e-3


def test_boxes_in_map_are_where_the_car_was_at_their_stamp(tracking, tmp_path):
    stamps = stamps_of(tracking)
    first = min(stamps.values())
    moving = []
    for millisecond in range(-50, 520, 1):
        stamp = first + millisecond * MS
        links = [('map', 'base', map_t_velo(stamp) @ SENSOR_T_VELO.inverse())]
        moving.append(Published('/tf', stamp, encode_static(links, stamp), TF))
    static = encode_static([('base', 'velo_link', SENSOR_T_VELO)], 1)
    published = [
        Published(TOPIC, stamp, detected(tracking, number, 'map', map_t_velo(stamp)))
        for number, stamp in stamps.items()
    ]
    path = write_bag(
        tmp_path / 'bag.mcap', [*published, *moving, Published('/tf_static', 1, static, TF)]
    )
    results = read(path, tracking)
    for number in stamps:
        for box in results.boxes[number]:
            places = [label.location for label in labels_of(tracking, number)]
            assert np.abs(np.array(places) - box.location).max(axis=1).min() < 1e-3
    assert not results.losses


def test_without_transforms_base_link_is_the_player_s_and_that_is_noted(tracking, tmp_path):
    calibration = tracking.calibration(0)
    base_t_imu = Transform.from_translation((-0.05, 0.32, 0.93))
    base_t_velo = base_t_imu @ calibration.velo_T_imu.inverse()
    path = write_bag(tmp_path / 'bag.mcap', answers(tracking, 'base_link', base_t_velo))
    results = read(path, tracking)
    assert_same_objects(results, tracking)
    assert any('base_link' in note for note in results.notes)


def test_boxes_in_an_unknown_frame_are_a_loss_with_the_tree(tracking, tmp_path):
    static = encode_static([('robot', 'lidar', SENSOR_T_VELO)], 1)
    others = answers(tracking)[1:]
    lost = replace_answer(tracking, 0, 'lidar')
    path = write_bag(tmp_path / 'bag.mcap', [lost, *others, Published('/tf_static', 1, static, TF)])
    results = read(path, tracking)
    assert list(results.boxes) == [1, 2, 3, 4]
    assert not results.unanswered
    (loss,) = results.losses
    assert loss.count == 1
    assert "'lidar' to velo_link; the bag has robot -> {lidar}" in loss.text()


def replace_answer(truth, number, frame):
    return Published(TOPIC, stamps_of(truth)[number], detected(truth, number, frame))


def test_stamps_decide_and_what_fits_no_frame_is_counted(tracking, tmp_path):
    stamps = stamps_of(tracking)
    published = [
        Published(TOPIC, stamps[0] + 1, detected(tracking, 0, stamp_ns=stamps[0] + 9 * MS)),
        Published(TOPIC, stamps[0] + 2, detected(tracking, 1, stamp_ns=stamps[0] - 4 * MS)),
        Published(TOPIC, stamps[0] + 3, detected(tracking, 2, stamp_ns=stamps[2])),
        Published(TOPIC, stamps[0] + 4, detected(tracking, 3, stamp_ns=stamps[3] + 10**12)),
    ]
    results = read(write_bag(tmp_path / 'bag.mcap', published), tracking)
    assert list(results.boxes) == [0, 2]
    assert len(results.boxes[0]) <= len(labels_of(tracking, 1))
    texts = [(loss.count, loss.text()) for loss in results.losses]
    assert [count for count, _ in texts] == [1, 1, 3]
    assert 'no frame within 51.8 ms' in texts[0][1]
    assert 'several messages for frames 0;' in texts[1][1]
    assert texts[2][1] == f'{TOPIC}: no message for frames 1, 3-4'
    assert results.unanswered == (1, 3, 4)


def test_a_tolerance_can_be_given(tracking, tmp_path):
    stamp = stamps_of(tracking)[1] + 9 * MS
    path = write_bag(
        tmp_path / 'bag.mcap',
        [*answers(tracking)[:1], Published(TOPIC, stamp, detected(tracking, 1, stamp_ns=stamp))],
    )
    assert list(read(path, tracking).boxes) == [0, 1]
    assert list(read(path, tracking, tolerance_ns=8 * MS).boxes) == [0]


def clock(log_ns: int, stamp_ns: int) -> Published:
    return Published('/clock', log_ns, (serialized_clock(stamp_ns),), CLOCK)


@pytest.mark.parametrize('header_ns', [0, 1_790_000_000 * 10**9])
def test_without_stamps_of_the_recording_messages_belong_to_the_frame_of_the_clock(
    header_ns, tracking, tmp_path
):
    wall = 1_790_000_000 * 10**9
    stamps = stamps_of(tracking)
    first = min(stamps.values())
    published = [
        Published(
            TOPIC,
            wall + 2 * (stamp - first) + 80 * MS,  # half the rate, 40 ms late in its time
            detected(tracking, number, stamp_ns=header_ns),
        )
        for number, stamp in stamps.items()
    ]
    ticks = [clock(wall + 2 * n * MS, first + n * MS) for n in range(0, 600, 5)]
    results = read(write_bag(tmp_path / 'bag.mcap', [*published, *ticks]), tracking)
    assert_same_objects(results, tracking)
    assert not results.losses
    assert any('before its arrival' in note for note in results.notes)


def test_stamps_of_another_time_are_an_error_with_both(tracking, tmp_path):
    late = 10**18
    sent = [Published(TOPIC, late, detected(tracking, number, stamp_ns=late)) for number in (0, 1)]
    path = write_bag(tmp_path / 'bag.mcap', sent)
    with pytest.raises(BadBagError, match=r'begin at 2001-09-09 .*the frames at 2011-09-26') as one:
        read(path, tracking)
    assert '\n' not in str(one.value)


def test_classes_by_name_number_and_default(tracking, tmp_path):
    calibration = tracking.calibration(0)
    (box, *_) = cuboids_of(tracking.read(Stream.LABELS, 0), calibration)
    names = ['car', '3', 'robot', 'robot', 'Van', 'bus']
    kinds = [
        Cuboid(name, str(place), box.velo_T_box, box.size_lwh, 0.9)
        for place, name in enumerate(names)
    ]
    message = encode_detections(kinds, stamps_of(tracking)[0], 'velo_link')
    path = write_bag(tmp_path / 'bag.mcap', [Published(TOPIC, 5, message)])

    def classes(**class_map):
        results = read(path, tracking, class_map=class_map)
        texts = [loss.text() for loss in results.losses if 'classes' in loss.text()]
        return [box.class_name for box in results.boxes[0]], texts

    class_names, (text,) = classes(**{'3': 'Cyclist'})
    assert class_names == ['Car', 'Cyclist', 'Van']
    assert "'robot' (2), 'bus' (1)" in text
    assert classes(**{'3': 'Cyclist', 'robot': '', '*': 'Misc'}) == (
        ['Car', 'Cyclist', 'Van', 'Misc'],
        [],
    )


def test_markers_have_classes_scores_and_ids(tracking, tmp_path):
    messages = []
    for number, stamp in stamps_of(tracking).items():
        boxes = cuboids_of(tracking.read(Stream.LABELS, number), tracking.calibration(number))
        parts = encode_markers(boxes, {}, stamp, FrameNames(), MarkerOptions())
        array = deserialize(join(parts), MARKERS)
        for marker in array.markers:
            if marker.type == 9:
                marker.text = f'{marker.text.split()[0]} 50%'
        messages.append(Published(TOPIC, stamp, array, MARKERS))
    results = read(write_bag(tmp_path / 'bag.mcap', messages), tracking, topic=None)
    assert_same_objects(results, tracking)
    assert not results.losses


def test_a_2d_detection_has_no_3d_box_and_is_clipped(tracking, tmp_path):
    results = read(write_bag(tmp_path / 'bag.mcap', answers_2d(tracking)), tracking)
    assert list(results.boxes) == [0, 1, 2, 3, 4]
    for number, boxes in results.boxes.items():
        labels = {label.track_id: label for label in labels_of(tracking, number)}
        assert len(boxes) == len(labels)
        for box in boxes:
            np.testing.assert_allclose(box.box_2d, labels[box.track_id].box_2d, atol=1e-9)
            assert box.size_hwl == (-1, -1, -1)
            assert box.location == (-1000, -1000, -1000)
            assert (box.rotation_y, box.alpha, box.score) == (-10, -10, 1)
    assert not results.losses


def test_2d_boxes_of_another_camera_are_not_scored(tracking, tmp_path):
    frame = FrameNames(cameras={0: 'gray_left'}).camera(0)
    results = read(write_bag(tmp_path / 'bag.mcap', answers_2d(tracking, frame)), tracking)
    assert not any(results.boxes.values())
    (loss,) = results.losses
    assert 'in pixels of camera_gray_left_optical_frame' in loss.text()


def test_a_message_that_cannot_be_decoded_is_a_loss(tracking, tmp_path):
    first, *others = answers(tracking)
    cut = first._replace(message=(join(first.message)[:20],))
    results = read(write_bag(tmp_path / 'bag.mcap', [cut, *others]), tracking)
    assert list(results.boxes) == [1, 2, 3, 4]
    assert [loss.count for loss in results.losses] == [1, 1]
    assert 'cannot be decoded' in results.losses[0].text()


@pytest.mark.parametrize(
    ('topic', 'text'),
    [
        ('/my/detection', f'did you mean {TOPIC}'),
        ('/other', 'has no topic /other; with boxes'),
        ('/tf_static', 'is a tf2_msgs/msg/TFMessage; expected a topic of Detection3DArray'),
        (None, 'several topics with boxes'),
    ],
)
def test_a_topic_that_has_no_results_is_an_error(topic, text, tracking, tmp_path):
    static = encode_static([('velo_link', 'sensor', SENSOR_T_VELO)], 1)
    second = Published('/mine', 5, detected(tracking, 0))
    path = write_bag(
        tmp_path / 'bag.mcap',
        [*answers(tracking), Published('/tf_static', 1, static, TF), second],
    )
    with pytest.raises(UsageError, match=text):
        read(path, tracking, topic)


def test_labels_of_the_recording_itself_are_not_the_results(recordings, tracking, tmp_path):
    path = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.TRACKING], path)
    with pytest.raises(UsageError, match='has no results besides the labels of the recording'):
        read(path, tracking, None)


def test_a_recording_without_calibration_is_a_loss_that_names_the_file(recordings, tmp_path):
    source = make_holes(recordings[Layout.TRACKING], Layout.TRACKING, tmp_path / 'holes')
    truth = open_recording(source)
    path = write_bag(tmp_path / 'bag.mcap', answers(truth))
    (calib,) = source.glob('*/calib/*.txt')
    calib.unlink()
    results = read(path, open_recording(source))
    assert not results.boxes
    (loss,) = results.losses
    assert str(calib) in loss.text()
