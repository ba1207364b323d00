# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from math import cos, log, pi, radians, tan
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.streams import NS_PER_S
from kitti_ros2.synthetic.scene import (
    CAR_T_VELO,
    COURSE,
    GRAVITY,
    Course,
    make_calibration,
    motion_at,
)

if TYPE_CHECKING:
    from kitti_ros2.model.geometry import Float64Array
    from kitti_ros2.model.samples import OxtsPacket
    from kitti_ros2.synthetic import SyntheticDrive

CALIBRATION = make_calibration()
assert CALIBRATION.velo_T_imu is not None
CAR_T_IMU = CAR_T_VELO @ CALIBRATION.velo_T_imu
TIMES = (0.0, 0.7, 3.3, 11.0, 40.0)


def mercator(packet: OxtsPacket, scale: float) -> Float64Array:
    """The devkit's position of a packet, metres."""
    radius = 6378137.0
    return np.array(
        [
            scale * radius * radians(packet.lon),
            scale * radius * log(tan(pi / 4 + radians(packet.lat) / 2)),
            packet.alt,
        ]
    )


def differences(
    time: float, step: float = 1e-4, course: Course = COURSE
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Velocity, acceleration and angular velocity by differences of poses, map axes."""
    before, now, after = (
        motion_at(time + shift, CAR_T_IMU, course).map_T_imu for shift in (-step, 0.0, step)
    )
    velocity = (after.translation - before.translation) / (2 * step)
    bend = after.translation - 2 * now.translation + before.translation
    turn = (after.rotation - before.rotation) @ now.rotation.T / (2 * step)
    return velocity, bend / step**2, np.array([turn[2, 1], turn[0, 2], turn[1, 0]])


@pytest.mark.parametrize('time', TIMES)
def test_motion_is_the_derivative_of_the_pose(time: float) -> None:
    motion = motion_at(time, CAR_T_IMU)
    velocity, acceleration, angular_velocity = differences(time)
    np.testing.assert_allclose(motion.velocity, velocity, atol=1e-6)
    np.testing.assert_allclose(motion.acceleration, acceleration, atol=1e-4)
    np.testing.assert_allclose(motion.angular_velocity, angular_velocity, atol=1e-6)


@pytest.mark.parametrize('time', [-0.3, 0.0, 0.9, 1.5, 4.2, 6.9, 7.5, 20.0])
def test_motion_is_the_derivative_from_a_standing_start(time: float) -> None:
    course = Course.turning(15.0, radians(30.0), rest=1.0)
    motion = motion_at(time, CAR_T_IMU, course)
    velocity, acceleration, angular_velocity = differences(time, course=course)
    np.testing.assert_allclose(motion.velocity, velocity, atol=1e-5)
    np.testing.assert_allclose(motion.acceleration, acceleration, atol=1e-3)
    np.testing.assert_allclose(motion.angular_velocity, angular_velocity, atol=1e-5)
    assert bool(np.linalg.norm(motion.velocity) < 1e-9) == (time <= 1.0)


def test_drive_is_smooth_and_about_eight_metres_a_second() -> None:
    for time in np.arange(0, 60, 0.5):
        motion = motion_at(float(time), CAR_T_IMU)
        assert 7 < np.linalg.norm(motion.velocity) < 9.5
        assert np.linalg.norm(motion.acceleration) < 1.5
        assert np.linalg.norm(motion.angular_velocity) < 0.12


def test_packets_hold_the_truth(drive: SyntheticDrive) -> None:
    first = drive.packet(0)
    scale = cos(radians(first.lat))
    start = mercator(first, scale)
    for frame in range(len(drive)):
        packet, truth = drive.packet(frame), drive.motion(frame)
        pose = Transform(
            rotation_from_rpy(packet.roll, packet.pitch, packet.yaw),
            mercator(packet, scale) - start,
        )
        np.testing.assert_allclose(pose.matrix(), truth.map_T_imu.matrix(), atol=1e-6)
        levelled = rotation_from_rpy(0, 0, packet.yaw)
        for columns, vector in (
            ((packet.vf, -packet.vl, packet.vu), truth.velocity),
            ((packet.af, packet.al, packet.au), truth.acceleration + np.array([0, 0, GRAVITY])),
            ((packet.wf, packet.wl, packet.wu), truth.angular_velocity),
        ):
            np.testing.assert_allclose(levelled @ columns, vector, atol=1e-12)
        for columns, vector in (
            ((packet.ax, packet.ay, packet.az), truth.acceleration + np.array([0, 0, GRAVITY])),
            ((packet.wx, packet.wy, packet.wz), truth.angular_velocity),
        ):
            np.testing.assert_allclose(pose.rotation @ columns, vector, atol=1e-6)
        np.testing.assert_allclose((packet.ve, packet.vn), truth.velocity[:2], atol=1e-12)


def test_body_and_levelled_columns_differ(drive: SyntheticDrive) -> None:
    packet = drive.packet(0)
    assert abs(packet.ay - packet.al) > 0.05
    assert abs(packet.roll) > 1e-3
    assert abs(packet.pitch) > 1e-3
    assert packet.vu > 0.01


def test_velocity_integrates_to_the_way(drive: SyntheticDrive) -> None:
    times = np.array([drive.stamps(frame).oxts for frame in range(len(drive))]) / NS_PER_S
    velocities = np.array([drive.motion(frame).velocity for frame in range(len(drive))])
    places = np.array([drive.motion(frame).map_T_imu.translation for frame in range(len(drive))])
    means = (velocities[1:] + velocities[:-1]) / 2 * np.diff(times)[:, None]
    np.testing.assert_allclose(np.diff(places, axis=0), means, atol=1e-3)


def test_camera_poses_follow_the_unit(drive: SyntheticDrive) -> None:
    np.testing.assert_allclose(drive.pose(0).matrix(), np.eye(4), atol=1e-6)
    step = drive.pose(5).translation
    assert step[2] == pytest.approx(4.2, abs=0.3), 'the camera looks along +z'
    assert abs(step[1]) < 0.02, 'the street is flat'


def test_standing_things_stand_still(drive: SyntheticDrive) -> None:
    """A parked car seen from frame 0 and frame 5, brought together by the camera poses."""
    first, last = ({box.track_id: box for box in drive.boxes(frame)} for frame in (0, 5))
    speeds = {one.solid.track_id: one.solid for one in drive.placed(0)}
    parked = [
        track
        for track in first.keys() & last.keys()
        if track is not None and not speeds[track].speed and not speeds[track].leads
    ]
    assert parked
    for track in parked:
        (moved,) = drive.pose(5).apply([last[track].location])
        np.testing.assert_allclose(moved, first[track].location, atol=1e-3)


def test_stamps_are_as_kittis(drive: SyntheticDrive) -> None:
    for frame in range(len(drive)):
        stamps = drive.stamps(frame)
        assert stamps.scan_start + stamps.scan_end == 2 * stamps.scan
        assert all(9_900_000 < image - stamps.scan < 10_700_000 for image in stamps.images)
        assert len({*stamps.images, stamps.oxts, stamps.scan}) == 6
    scans = np.array([drive.stamps(frame).scan for frame in range(len(drive))])
    assert np.abs(np.diff(scans) - 100_000_000).max() < 1_000_000
    assert len({scan % 1000 for scan in scans.tolist()}) > 1


def test_calibration_has_no_identity_and_boxes_are_exact() -> None:
    assert CALIBRATION.r0_rect is not None
    assert CALIBRATION.cam0_T_velo is not None
    down = CALIBRATION.r0_rect @ CALIBRATION.cam0_T_velo.rotation @ (0, 0, -1)
    np.testing.assert_allclose(down, (0, 1, 0), atol=1e-6)
    assert np.abs(CALIBRATION.r0_rect - np.eye(3)).max() > 1e-3
    for camera in CALIBRATION.cameras.values():
        assert camera.r_rect is not None
        assert camera.cam_T_cam0 is not None
        np.testing.assert_allclose(
            camera.r_rect @ camera.cam_T_cam0.rotation, CALIBRATION.r0_rect, atol=1e-5
        )
        offset = np.linalg.inv(camera.p_rect[:, :3]) @ camera.p_rect[:, 3]
        np.testing.assert_allclose(camera.r_rect @ camera.cam_T_cam0.translation, offset, atol=1e-5)
