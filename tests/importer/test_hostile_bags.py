# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is wrong in a bag costs its own message, is named, and spoils nothing else."""

from __future__ import annotations

from dataclasses import replace

import foreign
import numpy as np
import pytest

from kitti_ros2.errors import KittiRos2Error, LackingError, UsageError
from kitti_ros2.importer.planned import convert_by_plan, guess, look
from kitti_ros2.kitti.layouts import open_recording
from kitti_ros2.messages.cdr import join, serialize
from kitti_ros2.messages.header import make_header
from kitti_ros2.messages.ros_types import TFMessage
from kitti_ros2.messages.transforms import make_transform
from kitti_ros2.options import ImportOptions
from kitti_ros2.samples import Layout, Stream

TRUTH = foreign.make_truth()
POINTS = '/sensors/ouster/points'
LEFT = '/cam/left/image_raw'
BOXES = '/perception/objects'


def convert(path, out, layout=Layout.OBJECT, change=lambda plan: plan):
    options = ImportOptions(layout=layout)
    survey = look([path])
    plan = change(guess([path], survey, options).plan)
    return convert_by_plan([path], plan, survey, out, options)


def hostile(tmp_path, topic, place, changed, storage='mcap'):
    """The bag with one message of a topic changed (every one where place is None)."""

    def change(name, index, message):
        wanted = name == topic and place in (None, index)
        return changed(message) if wanted else message

    return foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, storage, change=change)


def cut(message):
    return (join(message if isinstance(message, tuple) else serialize(message))[:60],)


@pytest.mark.parametrize(
    ('topic', 'stream'), [(POINTS, 'scan'), (LEFT, 'image_2'), (BOXES, 'labels')]
)
def test_a_message_that_cannot_be_decoded_costs_itself(topic, stream, tmp_path):
    path = hostile(tmp_path, topic, 6, cut)
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert (loss.stream, loss.count) == (topic, 1)
    assert 'cannot be decoded' in loss.text()
    assert '\n' not in loss.text()
    assert report.counts[stream] == foreign.FRAMES - 1
    assert report.counts['calibration'] == foreign.FRAMES


def test_a_frame_that_is_not_whole_is_in_no_list(tmp_path):
    path = hostile(tmp_path, POINTS, 4, cut)
    convert(path, tmp_path / 'out')
    listed = (tmp_path / 'out/ImageSets/trainval.txt').read_text().split()
    assert listed == [f'{number:06d}' for number in range(foreign.FRAMES) if number != 4]


def test_an_image_of_another_size_is_left_out_and_named(tmp_path):
    def shrink(message):
        grey = np.zeros((100, 200), np.uint8)
        data = np.repeat(grey, 3, axis=1).ravel()
        return replace(message, height=100, width=200, step=600, data=data)

    path = hostile(tmp_path, LEFT, 6, shrink)
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert 'the image is 200x100; expected 640x360' in loss.text()
    assert report.counts['image_2'] == foreign.FRAMES - 1


@pytest.mark.parametrize('stamp_ns', [0, 10**9])
def test_stamps_of_0_or_out_of_order_give_way_to_log_time(stamp_ns, tmp_path):
    def restamp(message):
        return replace(message, header=make_header(stamp_ns, message.header.frame_id))

    path = hostile(tmp_path, POINTS, 3, restamp)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    said = '1 of 12 header stamps is ' + ('0' if stamp_ns == 0 else 'earlier')
    assert any(said in note and 'log time is used' in note for note in report.notes)
    stamps = open_recording(tmp_path / 'out').streams[Stream.SCAN].stamps_ns
    off = stamps - np.array([frame.stamp_ns for frame in TRUTH])
    assert ((off >= 0) & (off < 2_000_000)).all()


def test_an_unknown_encoding_is_named_with_the_known_ones(tmp_path):
    path = hostile(tmp_path, LEFT, None, lambda message: replace(message, encoding='hsv8'))
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert loss.count == foreign.FRAMES
    assert 'hsv8' in loss.text()
    assert 'mono8' in loss.text()


def test_a_camera_that_was_never_calibrated_is_said_so(tmp_path):
    def forget(message):
        return replace(message, k=np.zeros(9), p=np.zeros(12), r=np.zeros(9), d=np.zeros(0))

    path = hostile(tmp_path, '/cam/left/camera_info', None, forget)
    with pytest.raises(KittiRos2Error, match='not calibrated'):
        convert(path, tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_a_lens_that_raw_has_no_place_for_is_rectified(tmp_path):
    def fisheye(message):
        return replace(message, distortion_model='equidistant', d=np.zeros(4) + 0.01)

    path = hostile(tmp_path, '/cam/left/camera_info', None, fisheye)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    assert report.name.endswith('_sync')
    assert report.losses == ()


def test_a_link_that_moves_does_not_calibrate(tmp_path):
    path = tmp_path / 'bag.mcap'
    links = foreign.links()

    def change(topic, _place, message):
        if topic != '/tf_static':
            return message
        joined = [link for link in links if link[1] != 'os_sensor']
        return TFMessage([make_transform(pose, 1, parent, child) for parent, child, pose in joined])

    foreign.write_foreign(path, TRUTH, change=change)
    with pytest.raises(LackingError, match='os_sensor') as caught:
        convert(path, tmp_path / 'out')
    assert 'base_link -> ' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_box_in_an_unknown_frame_costs_its_frames_labels(tmp_path):
    path = tmp_path / 'bag.mcap'

    def change(topic, place, message):
        if topic != BOXES or place != 2:
            return message
        return (join(message).replace(b'os_sensor', b'nowhere_1'),)

    foreign.write_foreign(path, TRUTH, change=change)
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert "'nowhere_1'" in loss.text()
    assert report.counts['labels'] == foreign.FRAMES - 1


def test_positions_without_a_fix_leave_their_frames_without_a_packet(tmp_path):
    def lose(message):
        return replace(message, status=replace(message.status, status=-1))

    path = hostile(tmp_path, '/gps/fix', None, lose)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    assert 'oxts' not in report.counts
    assert any('no fix' in note for note in report.notes)
    tracking = convert(path, tmp_path / 'tracking', Layout.TRACKING)
    assert any('oxts' in note for note in tracking.notes)


def test_tracking_ends_its_packets_where_one_is_lacking(tmp_path):
    """Line n is frame n: none may be left out in between."""

    def lose(message):
        return replace(message, status=replace(message.status, status=-1))

    path = tmp_path / 'bag.mcap'

    def change(topic, place, message):
        return lose(message) if topic == '/gps/fix' and place >= 4 else message

    foreign.write_foreign(path, TRUTH, change=change)
    report = convert(path, tmp_path / 'out', Layout.TRACKING)
    lines = (tmp_path / 'out/training/oxts/0000.txt').read_text().splitlines()
    assert 0 < len(lines) < foreign.FRAMES
    assert any(f'oxts ends before frame {len(lines)}' in note for note in report.notes)


def test_a_plan_that_names_the_wrong_topic_says_which_there_are(tmp_path):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH)

    def wrong(plan):
        return replace(plan, scan=replace(plan.scan, topic='/velodyne'))

    with pytest.raises(UsageError, match=r'/velodyne.*/sensors/ouster/points'):
        convert(path, tmp_path / 'out', change=wrong)
