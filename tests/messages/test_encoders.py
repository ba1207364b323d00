# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of each encoder, through CDR bytes; pairs of the table are in test_topics.py."""

from __future__ import annotations

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.files.image_files import decode_png, parse_png
from kitti_ros2.messages.camera_info import decode_static, encode_static
from kitti_ros2.messages.cdr import (
    deserialize,
    join,
    make_header,
    make_pose,
    restamp,
    serialize,
    stamp_ns_of,
    transform_of,
)
from kitti_ros2.messages.images import encode_compressed, encode_pixels
from kitti_ros2.messages.oxts import (
    encode_fix,
    encode_imu,
    encode_odometry,
    encode_path,
    encode_tf,
    encode_velocity,
    make_packet,
    poses_of,
)
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.messages.scan import decode_scan, encode_scan
from kitti_ros2.messages.source_texts import decode_sweep, encode_sweep
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import OxtsPacket, Pose, Scan, Trajectory

from builders import png_bytes  # isort: skip

STAMP = 1317042145951199337
STAMPS = st.integers(0, 2**31 * 10**9 - 1)
ANGLES = st.floats(-3.1, 3.1)
METRES = st.floats(-1e5, 1e5)
TRANSFORMS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(ANGLES, st.floats(-1.5, 1.5), ANGLES),
    st.tuples(METRES, METRES, METRES),
)
POINTS = arrays.arrays(
    np.float32,
    st.integers(0, 40).map(lambda n: (n, 4)),
    elements=st.floats(width=32),
)


def through_cdr(message):
    return deserialize(join(serialize(message)), message.__msgtype__)


def packet(**values: float) -> OxtsPacket:
    zeros = {field.name: 0 for field in fields(OxtsPacket) if field.name != 'source'}
    return OxtsPacket(**(zeros | values))


PACKETS = st.builds(
    packet,
    lat=st.floats(-85, 85), lon=st.floats(-180, 180), alt=METRES,
    roll=st.floats(-1, 1), pitch=st.floats(-1, 1), yaw=ANGLES,
    ve=st.floats(-50, 50), vn=st.floats(-50, 50), vu=st.floats(-5, 5),
    ax=st.floats(-20, 20), ay=st.floats(-20, 20), az=st.floats(-20, 20),
    wx=ANGLES, wy=ANGLES, wz=ANGLES, af=METRES, wf=METRES,
    pos_accuracy=st.floats(0, 100), posmode=st.integers(-1, 40),
)  # fmt: skip


@given(STAMPS)
def test_header_stamp_and_back(stamp_ns):
    assert stamp_ns_of(make_header(stamp_ns, 'x')) == stamp_ns


@given(POINTS, STAMPS)
def test_a_cloud_has_the_bytes_of_the_file(points, stamp_ns):
    message = through_cdr(encode_scan(Scan(points), stamp_ns, 'velo_link'))
    assert message.data.tobytes() == points.tobytes()
    assert message.is_dense == bool(np.isfinite(points).all())
    assert (message.height, message.width, message.point_step) == (1, len(points), 16)
    assert message.row_step == len(points) * 16
    assert stamp_ns_of(message.header) == stamp_ns


def filled(message):
    """What rosbags serialises, with zeros up to a multiple of four."""
    plain = bytes(TYPESTORE.serialize_cdr(message, message.__msgtype__))
    return plain + bytes(-len(plain) % 4)


@given(POINTS)
def test_bulk_messages_are_what_rosbags_serialises(points):
    """The fast path, which never copies the payload, against the plain one."""
    message = encode_scan(Scan(points), STAMP, 'velo_link')
    assert join(serialize(message)) == filled(message)


@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'abcd'])
def test_bulk_images_are_what_rosbags_serialises(frame):
    image = parse_png(png_bytes(7, 5), 'x')
    pixels = decode_png(image)
    for message in (encode_compressed(image, STAMP, frame), encode_pixels(pixels, STAMP, frame)):
        assert join(serialize(message)) == filled(message)


@given(STAMPS)
def test_restamp_changes_the_stamp_only(stamp_ns):
    message = encode_scan(Scan(np.ones((2, 4), np.float32)), STAMP, 'velo_link')
    expected = encode_scan(Scan(np.ones((2, 4), np.float32)), stamp_ns, 'velo_link')
    assert join(restamp(serialize(message), stamp_ns)) == join(serialize(expected))


@pytest.mark.parametrize(
    ('dtype', 'shape', 'encoding'),
    [('u1', (5, 7), 'mono8'), ('u2', (5, 7), 'mono16'), ('u1', (5, 7, 3), 'bgr8')],
)
def test_the_format_of_images(dtype, shape, encoding):
    pixels = np.arange(np.prod(shape), dtype=dtype).reshape(shape)
    raw = through_cdr(encode_pixels(pixels, STAMP, 'cam'))
    assert (raw.encoding, raw.width, raw.height, raw.is_bigendian) == (encoding, 7, 5, 0)
    assert raw.step == pixels[0].nbytes
    assert raw.data.tobytes() == pixels.tobytes()
    image = parse_png(cv2.imencode('.png', pixels)[1].tobytes(), 'x')
    compressed = through_cdr(encode_compressed(image, STAMP, 'cam'))
    assert (compressed.format, compressed.data.tobytes()) == ('png', image.data)


def test_imu_takes_the_body_axes_not_the_levelled_ones():
    made = packet(ax=1.0, ay=2.0, az=9.8, af=-1.0, al=-2.0, au=-9.8, wx=0.1, wf=-0.1)
    imu = encode_imu(made, STAMP, 'imu_link')
    assert (imu.linear_acceleration.x, imu.linear_acceleration.z) == (1.0, 9.8)
    assert imu.angular_velocity.x == 0.1


def test_velocity_is_turned_into_the_body():
    """Driving north up a slope (nose up is negative pitch), a levelled climb is straight ahead."""
    made = packet(vn=10 * np.cos(0.1), vu=10 * np.sin(0.1), pitch=-0.1, yaw=np.pi / 2)
    linear = encode_velocity(made, STAMP, 'imu_link').twist.linear
    np.testing.assert_allclose((linear.x, linear.y, linear.z), (10, 0, 0), atol=1e-12)


def test_velocity_to_the_left_is_positive_whatever_vl_says():
    """Drifting west while heading north; KITTI's vl has the other sign."""
    made = packet(vn=10.0, ve=-1.0, vf=10.0, vl=-1.0, yaw=np.pi / 2)
    linear = encode_velocity(made, STAMP, 'imu_link').twist.linear
    np.testing.assert_allclose((linear.x, linear.y, linear.z), (10, 1, 0), atol=1e-12)


@pytest.mark.parametrize(
    ('mode', 'status'),
    [(-1, -1), (0, -1), (2, -1), (3, 0), (4, 2), (5, 2), (6, 2), (7, 1), (10, -1), (13, 0), (16, 2),
     (19, -1), (21, 0), (24, 2), (99, -1)],
)  # fmt: skip
def test_fix_status_by_position_mode(mode, status):
    assert encode_fix(packet(posmode=mode), STAMP, 'imu_link').status.status == status


def test_fix_covariance_is_the_square_of_the_accuracy():
    fix = encode_fix(packet(pos_accuracy=0.5, posmode=6), STAMP, 'imu_link')
    assert fix.position_covariance[0] == 0.25
    assert fix.position_covariance_type == 1
    assert fix.status.status == 2
    assert encode_fix(packet(pos_accuracy=0.0), STAMP, 'imu_link').position_covariance_type == 0


@given(PACKETS)
def test_a_fix_stays_one_on_the_way_back(source):
    fix = through_cdr(encode_fix(source, STAMP, 'imu_link'))
    again = make_packet(None, fix, None)
    assert (again is None) == (fix.status.status < 0)
    if again is not None:
        assert encode_fix(again, STAMP, 'imu_link').status.status == fix.status.status


@given(TRANSFORMS)
def test_pose_and_back(transform):
    again = transform_of(make_pose(transform))
    np.testing.assert_allclose(again.matrix(), transform.matrix(), atol=1e-9)


def test_odometry_accounts_for_the_lever_arm():
    """Turning in place about base_link: the imu ahead of it moves sideways, base_link does not."""
    base_t_imu = Transform.from_translation((1.0, 0.0, 0.0))
    pose = Pose(Transform.identity(), np.array([0.0, 0.5, 0.0]), np.array([0.0, 0.0, 0.5]))
    linear = encode_odometry(pose, base_t_imu, STAMP, ('map', 'base_link')).twist.twist.linear
    np.testing.assert_allclose((linear.x, linear.y, linear.z), 0, atol=1e-12)


def test_tf_is_of_base_link():
    base_t_imu = Transform.from_translation((-0.05, 0.32, 0.93))
    pose = Pose(Transform.from_translation((10.0, 0.0, 0.0)))
    [transform] = encode_tf(pose, base_t_imu, STAMP, ('map', 'base_link')).transforms
    place = transform.transform.translation
    assert (transform.header.frame_id, transform.child_frame_id) == ('map', 'base_link')
    np.testing.assert_allclose((place.x, place.y, place.z), (10.05, -0.32, -0.93))


@given(st.lists(st.tuples(STAMPS, TRANSFORMS), max_size=4), TRANSFORMS)
def test_path_and_back(poses, base_t_imu):
    stamps = np.array([stamp for stamp, _ in poses], dtype=np.int64)
    trajectory = Trajectory(stamps, [transform for _, transform in poses])
    again = poses_of(through_cdr(encode_path(trajectory, base_t_imu, STAMP, 'map')))
    assert [stamp_ns for stamp_ns, _ in again] == stamps.tolist()
    for (_, base), other in zip(again, trajectory.world_T_imu, strict=True):
        np.testing.assert_allclose((base @ base_t_imu).matrix(), other.matrix(), atol=1e-6)


@given(st.lists(TRANSFORMS, max_size=4))
def test_static_transforms_and_back(transforms):
    links = [('a', f'b{i}', transform) for i, transform in enumerate(transforms)]
    again = decode_static(through_cdr(encode_static(links, STAMP)))
    for (parent, child, one), (other_parent, other_child, other) in zip(again, links, strict=True):
        assert (parent, child) == (other_parent, other_child)
        np.testing.assert_allclose(one.matrix(), other.matrix(), atol=1e-9)


@given(st.none() | STAMPS, st.none() | STAMPS)
def test_sweep_and_back(start, end):
    message = encode_sweep(Scan(np.empty((0, 4), np.float32), start, end))
    if message is None:
        assert start is None
        assert end is None
    else:
        assert decode_sweep(through_cdr(message)) == (start, end)


def test_a_cloud_of_other_fields_is_refused():
    message = encode_scan(Scan(np.ones((1, 4), np.float32)), STAMP, 'velo_link')
    with pytest.raises(ValueError, match='fields'):
        decode_scan(replace(message, fields=message.fields[:3]))
