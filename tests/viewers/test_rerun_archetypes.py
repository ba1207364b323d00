# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each type of the table comes out of an .rrd file with its values, at its time."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

pytest.importorskip('rerun', reason='rerun-sdk is not installed')

import foreign
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.drawing.labelled_objects import color_of
from kitti_ros2.messages.camera_info import encode_static
from kitti_ros2.messages.cdr import join, make_header, make_pose, make_vector3, serialize
from kitti_ros2.messages.detections import encode_boxes_2d, encode_detections
from kitti_ros2.messages.ros_types import (
    TYPESTORE,
    CompressedImage,
    ImageMsg,
    Path,
    PointCloud2,
    PointField,
    PoseStamped,
    String,
    Twist,
    TwistStamped,
)
from kitti_ros2.model.bag_formats import COMPRESSED_VIDEO
from kitti_ros2.model.boxes import Box, Cuboid
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.recording import BY_POSITION
from kitti_ros2.options.messages import MarkerColors

T0 = 1_700_000_000_123_456_789
STEP = 100_000_001
POSE = Transform(rotation_from_rpy(0.1, -0.2, 0.3), np.array([1.0, -2.0, 0.5]))
CAR = Cuboid('Car', '7', POSE, (4.0, 2.0, 1.5), None, 7)


def close(values, expected):
    np.testing.assert_allclose(np.squeeze(values), expected, rtol=1e-6, atol=1e-6)


def xyz_cloud(points, frame='lidar'):
    points = np.asarray(points, '<f4')
    fields = [PointField(name, 4 * place, 7, 1) for place, name in enumerate('xyz')]
    return PointCloud2(
        make_header(T0, frame), 1, len(points), fields, False, 12, 12 * len(points),
        points.view(np.uint8).ravel(), True,
    )  # fmt: skip


def detections(*cuboids, frame='lidar'):
    return 'vision_msgs/msg/Detection3DArray', join(encode_detections(cuboids, T0, frame))


def boxes_2d(frame, *boxes):
    found = [
        (str(place), Box(kind, 0, 0, 0, bounds, (1, 1, 1), (0, 0, 0), 0))
        for place, (kind, bounds) in enumerate(boxes)
    ]
    return 'vision_msgs/msg/Detection2DArray', join(encode_boxes_2d(found, T0, frame))


def grey(frame='camera', size=(4, 3)):
    width, height = size
    data = np.arange(width * height, dtype=np.uint8)
    return ImageMsg(make_header(T0, frame), height, width, 'mono8', 0, width, data)


def test_a_cloud_keeps_its_points_and_is_coloured_by_height(show_messages):
    points = np.array([[1, 2, -2.5], [math.nan, 0, 0], [3, 4, 2.5]], np.float32)
    rrd, report = show_messages(('/points', T0, xyz_cloud(points, '/lidar')))
    ((stamp, positions),) = rrd.having('/points', 'Points3D:positions')
    assert stamp == T0
    np.testing.assert_array_equal(positions.reshape(-1, 3), points[[0, 2]])
    dark, bright = rrd.one('/points', 'Points3D:colors').tolist()
    assert (dark, bright) == (0x440154FF, 0xFDE725FF)
    assert rrd.one('/points', 'CoordinateFrame:frame') == ['lidar']
    assert (report.messages, dict(report.losses), report.notes) == (1, {}, (BY_POSITION,))


def test_a_cloud_of_another_driver_is_coloured_by_its_intensity(show_messages):
    truth = foreign.make_truth()[0]
    rrd, _ = show_messages(('/points', T0, foreign.cloud(truth, T0)))
    positions = rrd.one('/points', 'Points3D:positions').reshape(-1, 3)
    np.testing.assert_array_equal(positions, truth.points[:, :3].astype(np.float32))
    colors = rrd.one('/points', 'Points3D:colors')
    green = (colors >> 16 & 0xFF)[np.argsort(truth.points[:, 3])]
    assert (np.diff(green.astype(int)) >= 0).all()  # viridis rises in green
    assert green[0] < 10 < 225 < green[-1]


def test_pixels_and_files_of_images_are_untouched(show_messages):
    file = cv2.imencode('.jpg', np.zeros((5, 7, 3), np.uint8))[1].ravel()
    jpeg = CompressedImage(make_header(T0, 'camera'), 'bgr8; jpeg compressed bgr8', file)
    rrd, report = show_messages(('/a/image_raw', T0, grey()), ('/b/image/compressed', T0, jpeg))
    assert rrd.one('/a/image_raw', 'Image:buffer').tolist() == list(range(12))
    (form,) = rrd.one('/a/image_raw', 'Image:format')
    assert (form['width'], form['height']) == (4, 3)
    assert rrd.one('/b/image/compressed', 'EncodedImage:blob').tobytes() == file.tobytes()
    assert rrd.one('/b/image/compressed', 'EncodedImage:media_type') == ['image/jpeg']
    assert not report.losses


def test_packets_of_a_video_are_untouched(show_messages):
    data = np.frombuffer(b'\0\0\0\1g packet', np.uint8)
    video = TYPESTORE.types[COMPRESSED_VIDEO](make_header(T0, '').stamp, 'camera', data, 'h264')
    isaac = CompressedImage(make_header(T0, 'camera'), 'h265', data)
    rrd, report = show_messages(('/a/image/foxglove', T0, video), ('/b/image', T0, isaac))
    for topic, codec in (('/a/image/foxglove', 'avc1'), ('/b/image', 'hev1')):
        assert rrd.one(topic, 'VideoStream:sample').tobytes() == data.tobytes()
        assert rrd.one(topic, 'VideoStream:codec') == [int.from_bytes(codec.encode(), 'big')]
    assert not report.losses


def test_transforms_link_named_frames_one_entity_a_frame(show_messages):
    moving = encode_static([('map', 'base_link', POSE)], T0)
    fixed = encode_static([('base_link', '/lidar', POSE.inverse())], T0)
    rrd, _ = show_messages(('/tf', T0, moving), ('/tf_static', T0 + STEP, fixed, True))
    for entity, parent, link in (
        ('base_link', 'map', POSE),
        ('lidar', 'base_link', POSE.inverse()),
    ):
        path = f'/transforms/{entity}'
        close(rrd.one(path, 'Transform3D:translation'), link.translation)
        close(rrd.one(path, 'Transform3D:quaternion'), link.quaternion())
        assert rrd.one(path, 'Transform3D:parent_frame') == [parent]
        assert rrd.one(path, 'Transform3D:child_frame') == [entity]
    # A static link holds from the start, whenever it was recorded.
    assert [row.stamp_ns for row in rrd.rows['/transforms/lidar']] == [T0]


def test_a_static_link_that_changes_holds_from_its_change(show_messages):
    links = [encode_static([('a', 'b', Transform.from_translation((x, 0, 0)))], T0) for x in (1, 2)]
    rrd, _ = show_messages(
        ('/tf_static', T0, links[0], True), ('/tf_static', T0 + STEP, links[1], True)
    )
    found = rrd.having('/transforms/b', 'Transform3D:translation')
    assert [(stamp, value[0][0]) for stamp, value in found] == [(T0, 1), (T0 + STEP, 2)]


def test_odometry_links_a_frame_only_where_no_transform_does(show_messages):
    odometry = ('/odom', T0, foreign.odometry(T0, POSE))
    rrd, _ = show_messages(odometry)
    assert rrd.one('/odom', 'Transform3D:parent_frame') == ['odom']
    assert rrd.one('/odom', 'Transform3D:child_frame') == ['base_link']
    close(rrd.one('/odom', 'Transform3D:translation'), POSE.translation)
    rrd, _ = show_messages(odometry, ('/tf', T0, encode_static([('map', 'base_link', POSE)], T0)))
    assert rrd.having('/odom', 'Transform3D:child_frame') == []
    close(rrd.one('/odom', 'Transform3D:quaternion'), POSE.quaternion())


def test_poses_and_paths(show_messages):
    stamped = [
        PoseStamped(make_header(T0, 'map'), make_pose(Transform.from_translation(place)))
        for place in ((0, 0, 0), (1, 2, 3))
    ]
    rrd, _ = show_messages(
        ('/pose', T0, stamped[1]), ('/path', T0, Path(make_header(T0, 'map'), stamped))
    )
    close(rrd.one('/pose', 'Transform3D:translation'), (1, 2, 3))
    close(rrd.one('/path', 'LineStrips3D:strips'), [(0, 0, 0), (1, 2, 3)])
    assert rrd.one('/path', 'CoordinateFrame:frame') == ['map']


def test_boxes_in_space_have_class_id_and_colour_and_go(show_messages):
    rrd, _ = show_messages(('/objects', T0, detections(CAR)), ('/objects', T0 + 1, detections()))
    (_, centers), (later, none) = rrd.having('/objects', 'Boxes3D:centers')
    close(centers, POSE.translation)
    assert (later, none) == (T0 + 1, [])
    close(rrd.having('/objects', 'Boxes3D:half_sizes')[0][1], (2.0, 1.0, 0.75))
    close(rrd.having('/objects', 'Boxes3D:quaternions')[0][1], POSE.quaternion())
    assert rrd.having('/objects', 'Boxes3D:labels')[0][1] == ['Car 7']
    color = int(rrd.having('/objects', 'Boxes3D:colors')[0][1][0])
    expected = color_of('Car', 0, MarkerColors.CLASS)
    close([color >> shift & 0xFF for shift in (24, 16, 8)], [round(255 * c) for c in expected])
    assert rrd.one('/objects', 'CoordinateFrame:frame') == ['lidar']


def test_boxes_in_images_are_drawn_on_those_of_their_camera(show_messages):
    rrd, _ = show_messages(
        ('/boxes', T0, boxes_2d('camera', ('Van', (10, 20, 30, 60)))),
        ('/left/image_rect', T0 + 1, grey('camera')),
        ('/other/image_rect', T0 + 2, grey('elsewhere')),
    )
    entity = '/left/image_rect/boxes'
    close(rrd.one(entity, 'Boxes2D:centers'), (20, 40))
    close(rrd.one(entity, 'Boxes2D:half_sizes'), (10, 20))
    assert rrd.one(entity, 'Boxes2D:labels') == ['Van 0']
    frames = [rrd.one(path, 'CoordinateFrame:frame') for path in (entity, '/left/image_rect')]
    assert frames[0] == frames[1]
    assert '/boxes' not in rrd.rows
    assert '/other/image_rect/boxes' not in rrd.rows


def test_curves_keep_every_moment(show_messages):
    count = 2500
    messages = [foreign.imu(T0 + place * STEP, POSE) for place in range(count)]
    for place, message in enumerate(messages):
        message.linear_acceleration.x = float(place)
    rrd, report = show_messages(
        *(('/imu', T0 + place * STEP, message) for place, message in enumerate(messages))
    )
    found = rrd.having('/imu/linear_acceleration', 'Scalars:scalars')
    assert [(stamp, values[0]) for stamp, values in found] == [
        (T0 + place * STEP, place) for place in range(count)
    ]
    assert found[0][1][1:] == [0.2, 9.8]
    assert len(rrd.having('/imu/angular_velocity', 'Scalars:scalars')) == count
    assert rrd.one('/imu/angular_velocity', 'SeriesLines:names') == ['x', 'y', 'z']
    assert report.messages == count


def test_fixes_and_texts(show_messages):
    nowhere = foreign.fix(T0, math.nan)
    rrd, report = show_messages(
        ('/fix', T0, nowhere),
        ('/fix', T0 + 1, foreign.fix(T0, 49.25)),
        ('/fix', T0 + 2, foreign.fix(T0, 49.5)),
        ('/said', T0 + 3, String('hello\nthere')),
    )
    found = rrd.having('/fix', 'GeoPoints:positions')
    assert [(stamp, place.tolist()) for stamp, place in found] == [
        (T0 + 1, [49.25, 8.5]),
        (T0 + 2, [49.5, 8.5]),
    ]
    close(rrd.one('/fix/track', 'GeoLineStrings:line_strings'), [(49.25, 8.5), (49.5, 8.5)])
    assert rrd.having('/said', 'TextLog:text') == [(T0 + 3, ['hello\nthere'])]
    assert not report.losses


def test_what_the_table_lacks_is_named_and_what_is_broken_is_counted(show_messages):
    twist = TYPESTORE.types['geometry_msgs/msg/Twist']
    vector = TYPESTORE.types['geometry_msgs/msg/Vector3']
    cut = CompressedImage(make_header(T0, 'c'), 'png', np.frombuffer(b'\x89PNG\r\n\x1a\n', 'u1'))
    whole = join(serialize(grey()))
    rrd, report = show_messages(
        ('/cmd', T0, twist(vector(1, 2, 3), vector(0, 0, 0))),
        ('/a/image/compressed', T0 + 1, cut),
        ('/a/image/compressed', T0 + 2, cut),
        ('/b/image', T0 + 3, (ImageMsg.__msgtype__, whole[:20])),
        ('/b/image', T0 + 4, (ImageMsg.__msgtype__, whole)),
    )
    assert {*report.notes} == {BY_POSITION, '/cmd: geometry_msgs/msg/Twist is not shown'}
    png, image = report.losses.items()
    assert png == ('/a/image/compressed: the PNG is cut after 8 bytes', 2)
    assert image[0].startswith('/b/image: ')
    assert image[1] == 1
    assert [stamp for stamp, _ in rrd.having('/b/image', 'Image:buffer')] == [T0 + 4]


def test_a_pose_with_covariance_is_a_pose(show_messages):
    kind = 'geometry_msgs/msg/PoseWithCovarianceStamped'
    store = get_typestore(Stores.ROS2_JAZZY)
    pose = store.types['geometry_msgs/msg/PoseWithCovariance'](make_pose(POSE), np.zeros(36))
    message = store.types[kind](make_header(T0, 'map'), pose)
    rrd, _ = show_messages(('/amcl', T0, (kind, bytes(store.serialize_cdr(message, kind)))))
    close(rrd.one('/amcl', 'Transform3D:translation'), POSE.translation)
    assert rrd.one('/amcl', 'Transform3D:parent_frame') == ['map']


def test_a_twist_is_two_curves(show_messages):
    twist = Twist(make_vector3((5.0, 0, 1)), make_vector3((0.01, 0.02, 0.2)))
    rrd, _ = show_messages(('/vel', T0, TwistStamped(make_header(T0, 'imu'), twist)))
    assert rrd.having('/vel/linear', 'Scalars:scalars') == [(T0, [5.0, 0.0, 1.0])]
    assert rrd.having('/vel/angular', 'Scalars:scalars') == [(T0, [0.01, 0.02, 0.2])]
