# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Ten robots, each with its bags, its exact truth, and the plan that should be guessed.

`python tests/robots/ten_robots.py OUT` writes the bags to OUT/ROBOT/.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import camera_rigs
import drive_world as drives
import foxglove_robot
import numpy as np
import robot_bags as bags
import turtlebot as rgbd
import velodyne_unit
import wanderer
from autoware_rig import autoware_rig
from drive_world import Eye, Moment, Solid
from nuscenes_car import nuscenes_car
from ouster_robot import BASE_T_SENSOR, SENSOR_T_IMU, ouster_robot
from small_rigs import LIDAR, stereo

if TYPE_CHECKING:
    from collections.abc import Callable

    Moments = tuple[Moment, ...]

Said = bags.Said
POINTS = 'sensor_msgs/msg/PointCloud2'
BOXES = 'vision_msgs/msg/Detection3DArray'
MARKERS = 'visualization_msgs/msg/MarkerArray'


@dataclass(frozen=True, eq=False)
class Truth:
    """What a data set of a robot must hold.

    Attributes:
        moments: By frame number.
        base_T_velo: (4, 4) of the frame of the written scans.
        eyes: By KITTI's number of the camera.
        ordered: Whether the written points are in the order of the truth.
        labelled: Whether there are boxes.
        greys: The value of all pixels, first and step by frame number.
        turn_deg: Of the scans from camera 2, more than the field's checks allow; 0 for less.
    """

    moments: Moments
    base_T_velo: np.ndarray
    eyes: dict[int, Eye]
    ordered: bool = True
    labelled: bool = True
    turn_deg: float = 0.0
    greys: tuple[int, int] = (20, 9)

    def grey(self, number: int) -> int:
        """The value of all pixels of a frame."""
        return self.greys[0] + number * self.greys[1]


@dataclass(frozen=True, eq=False)
class TenRobot:
    """One of the ten.

    Attributes:
        name: Its name.
        write: Writes its bags to a folder, and returns them as given to to-kitti.
        truth: Makes its truth.
        plan: The values of the plan that is guessed, by dotted key; None: the key is absent.
        told: Texts that --plan prints in its notes, by any layout.
        dropped: The line that a conversion prints of points that are no returns, '' for none.
    """

    name: str
    write: Callable[[Path], list[Path]]
    truth: Callable[[], Truth]
    plan: dict[str, object] = field(default_factory=dict)
    told: tuple[str, ...] = ()
    dropped: str = ''

    @property
    def by_values(self) -> bool:
        """Whether its scans are written by robot_bags, as messages that a test may damage."""
        return self.name not in {'foxglove', 'in_map', 'livox'}


def end_ns(moments: Moments) -> int:
    return moments[-1].stamp_ns


def points_in(moment: Moment, base_T_lidar: np.ndarray) -> np.ndarray:
    return camera_rigs.moved(np.linalg.inv(base_T_lidar), moment.points)


def scan_of(moment: Moment, topic: str, frame: str, base_T_lidar: np.ndarray) -> Said:
    rows = drives.rows_of(points_in(moment, base_T_lidar))
    return Said(topic, moment.stamp_ns, POINTS, drives.cloud(moment.stamp_ns, frame, rows))


def rig_said(robot: camera_rigs.Robot, moments: Moments) -> list[Said]:
    """The clouds, images and static transforms of a rig."""
    said = [drives.static(drives.START_NS - 10**9, robot.links)]
    for moment in moments:
        said.append(scan_of(moment, robot.lidar_topic, robot.lidar, robot.base_T_lidar))
        for camera in robot.cameras:
            info = f'{camera.folder}/{camera.info}'
            p = np.column_stack([camera.k, camera.k @ [camera.offset_m, 0, 0]])
            said += drives.seen(camera.topic, info, camera.frame, moment, k=camera.k, p=p)
    return said


def eye_of(camera: camera_rigs.Camera) -> Eye:
    return Eye(camera.base_T_camera, camera.k)


def body_axes(base_T_lidar: np.ndarray) -> np.ndarray:
    """The scanner's place with the axes of the body."""
    return bags.place(*base_T_lidar[:3, 3])


# 1. Autoware: six cameras, tracked objects in map, Odometry of the localisation.


def autoware_truth() -> Truth:
    robot = autoware_rig()
    return Truth(drives.drive(), body_axes(robot.base_T_lidar), {2: eye_of(robot.cameras[0])})


def write_autoware(folder: Path) -> list[Path]:
    robot, moments = autoware_rig(), drives.drive()
    said = rig_said(robot, moments)
    frames = ('map', 'base_link')
    said += drives.odometry(
        end_ns(moments), '/localization/kinematic_state', frames, wanderer.map_t_base
    )
    said += drives.moving(end_ns(moments), lambda at: (*frames, wanderer.map_t_base(at)))
    for moment in moments:
        message = drives.tracked(moment, 'map', moment.world_T_body)
        kind = 'autoware_perception_msgs/msg/TrackedObjects'
        said.append(Said('/perception/objects', moment.stamp_ns, kind, message))
    return [bags.write(folder / 'autoware', said)]


# 2. The names of nuScenes: detections by its categories in map, /tf map -> base_link.


def nuscenes_truth() -> Truth:
    robot = nuscenes_car()
    front = robot.camera('/CAM_FRONT')
    return Truth(drives.drive(), body_axes(robot.base_T_lidar), {2: eye_of(front)})


def write_nuscenes(folder: Path) -> list[Path]:
    robot, moments = nuscenes_car(), drives.drive()
    said = rig_said(robot, moments)
    link = ('map', 'base_link')
    said += drives.moving(end_ns(moments), lambda at: (*link, wanderer.map_t_base(at)))
    names = {'Car': 'vehicle.car', 'Pedestrian': 'human.pedestrian.adult'}
    for moment in moments:
        boxes = drives.detections(moment, 'map', moment.world_T_body, names)
        said.append(Said('/annotations', moment.stamp_ns, BOXES, boxes))
        radar = drives.cloud(
            moment.stamp_ns, 'RADAR_FRONT', drives.rows_of(np.ones((5, 3)), ('rcs', '<f4'))
        )
        said.append(Said('/RADAR_FRONT', moment.stamp_ns, POINTS, radar))
    return [bags.write(folder / 'nuscenes', said, 'sqlite3')]


# 3. A TurtleBot with a RGB-D camera: map -> odom -> base_footprint in /tf, no scanner.


@cache
def turtlebot_truth() -> Truth:
    base_T_optical = bags.place(0, 0, 0.01) @ rgbd.BASE_T_CAMERA @ rgbd.CAMERA_T_OPTICAL
    moments = []
    for number, moment in enumerate(drives.drive()):
        metres = rgbd.millimetres(rgbd.depth_m(number)) / 1000
        metres[metres == 0] = np.nan
        points = camera_rigs.moved(base_T_optical, rgbd.optical_points(metres))
        moments.append(replace(moment, points=points, solids=()))
    eye = Eye(base_T_optical, rgbd.K, rgbd.SIZE)
    base_T_velo = bags.place(0, 0, 0.01) @ rgbd.BASE_T_CAMERA
    return Truth(tuple(moments), base_T_velo, {2: eye}, labelled=False)


def write_turtlebot(folder: Path) -> list[Path]:
    moments = turtlebot_truth().moments
    links = [
        ('base_footprint', 'base_link', bags.place(0, 0, 0.01)),
        ('base_link', 'camera_link', rgbd.BASE_T_CAMERA),
        ('camera_link', 'camera_optical_frame', rgbd.CAMERA_T_OPTICAL),
    ]
    said = [drives.static(drives.START_NS - 10**9, links)]
    odom = ('odom', 'base_footprint')
    said += drives.moving(end_ns(moments), lambda at: (*odom, wanderer.odom_t_base(at)))
    said += drives.moving(
        end_ns(moments), lambda at: ('map', 'odom', wanderer.map_t_odom(at)), 20_000_000
    )
    said += drives.odometry(end_ns(moments), '/odom', odom, wanderer.odom_t_base)
    frame, camera = 'camera_optical_frame', {'k': rgbd.K, 'size': rgbd.SIZE}
    for number, moment in enumerate(moments):
        color = '/camera/color/image_raw', '/camera/color/camera_info'
        said += drives.seen(*color, frame, moment, **camera)
        depth = rgbd.millimetres(rgbd.depth_m(number))
        values = bags.image(moment.stamp_ns, frame, depth, '16UC1')
        image = '/camera/depth/image_raw'
        said.append(Said(image, moment.stamp_ns, 'sensor_msgs/msg/Image', values))
        info = bags.camera_info(moment.stamp_ns, frame, rgbd.SIZE, rgbd.K)
        kind = 'sensor_msgs/msg/CameraInfo'
        said.append(Said('/camera/depth/camera_info', moment.stamp_ns, kind, info))
    return [bags.write(folder / 'turtlebot', said)]


# 4. An Ouster: the lidar in one bag, all else in another.


def ouster_truth() -> Truth:
    robot = ouster_robot()
    moments = drives.around(drives.drive(), wanderer.odom_t_base)
    return Truth(moments, BASE_T_SENSOR, {2: eye_of(robot.cameras[0])})


OUSTER_ROWS = 16


def ouster_beams(moment: Moment) -> int:
    """At least 100 of them have no return."""
    return -(-(len(moment.points) + 100) // OUSTER_ROWS) * OUSTER_ROWS


OUSTER_NONE = sum(ouster_beams(each) - len(each.points) for each in drives.drive())


def ouster_cloud(moment: Moment, base_T_lidar: np.ndarray) -> dict:
    """An organised cloud: a beam without a return is (0, 0, 0) with range 0."""
    more = ('t', '<u4'), ('reflectivity', '<u2'), ('ring', '<u2'), ('range', '<u4')
    count = ouster_beams(moment)
    rows = drives.rows_of(np.zeros((count, 3)), *more)
    points = points_in(moment, base_T_lidar)
    rng = np.random.default_rng(moment.stamp_ns % 1000)
    places = np.sort(rng.choice(count, len(points), replace=False))
    rows[places] = drives.rows_of(points, *more)
    rows['range'][places] = 1000 * np.linalg.norm(points, axis=1)
    return drives.cloud(moment.stamp_ns, 'os_lidar', rows, OUSTER_ROWS)


def write_ouster(folder: Path) -> list[Path]:
    robot, moments = ouster_robot(), ouster_truth().moments
    lidar = []
    for moment in moments:
        message = ouster_cloud(moment, robot.base_T_lidar)
        lidar.append(Said('/ouster/points', moment.stamp_ns, POINTS, message))
    unit = BASE_T_SENSOR @ SENSOR_T_IMU
    for stamp in range(drives.START_NS - 50_000_000, end_ns(moments) + 50_000_000, 10_000_000):
        values = {
            'header': bags.header(stamp, 'os_imu'),
            'orientation': drives.quaternion((wanderer.odom_t_base(stamp) @ unit)[:3, :3]),
            'angular_velocity': drives.vector((0, 0, wanderer.RATE)),
            'linear_acceleration': drives.vector((0, 0.8, 9.81)),
        }
        lidar.append(Said('/ouster/imu', stamp, 'sensor_msgs/msg/Imu', values))
    rest = [each for each in rig_said(robot, moments) if each.topic != robot.lidar_topic]
    frames = ('odom', 'base_link')
    rest += drives.moving(end_ns(moments), lambda at: (*frames, wanderer.odom_t_base(at)))
    for moment in moments:
        boxes = drives.detections(moment, 'base_link', np.eye(4), {'Car': 'CAR'})
        rest.append(Said('/detections', moment.stamp_ns, BOXES, boxes))
    return [
        bags.write(folder / 'lidar', lidar),
        bags.write(folder / 'camera', rest, 'sqlite3'),
    ]


# 5. Packets of a Velodyne VLP-16, with a camera and markers.

PUCK_IN_BASE = drives.pose_at(0.3, 0.0, 1.4, 1.5)
PUCK_EYE = Eye(camera_rigs.looking(-1.0, (0.6, 0.05, 1.1)))


@cache
def packets() -> tuple[list[bytes], np.ndarray]:
    """Of 60 degrees ahead; (N, 4) points in the scanner's frame."""
    unit = velodyne_unit.UNITS['VLP-16']
    return velodyne_unit.encode(unit, sequences=240, first_azimuth=-0.5)


@cache
def velodyne_truth() -> Truth:
    points = camera_rigs.moved(PUCK_IN_BASE, packets()[1][:, :3])
    middle = points[np.abs(points[:, 1] - 0.5).argmin()]
    rng = np.random.default_rng(5)
    while True:
        centre = middle + rng.uniform(-0.3, 0.3, 3)
        size = tuple(rng.uniform([2.5, 1.2, 1.0], [4.5, 2.2, 2.0]))
        yaw = rng.uniform(-20, 20)
        solid = Solid('Car', 4, drives.pose_at(*centre, yaw), size)
        count = solid.holds(points).sum()
        if count > 50 and solid.holds(points, 0.005).sum() == solid.holds(points, -0.005).sum():
            break
    moments = drives.around(drives.drive(), wanderer.odom_t_base)
    moments = tuple(replace(moment, points=points, solids=(solid,)) for moment in moments)
    return Truth(moments, PUCK_IN_BASE, {2: PUCK_EYE}, ordered=False)


def write_velodyne(folder: Path) -> list[Path]:
    moments = velodyne_truth().moments
    links = [
        ('base_link', 'velodyne', PUCK_IN_BASE),
        ('base_link', 'camera_optical', PUCK_EYE.base_T_camera),
    ]
    said = [drives.static(drives.START_NS - 10**9, links)]
    frames = ('odom', 'base_link')
    said += drives.odometry(end_ns(moments), '/odometry', frames, wanderer.odom_t_base)
    for moment in moments:
        message = velodyne_unit.scan_message(packets()[0], moment.stamp_ns)
        kind = 'velodyne_msgs/msg/VelodyneScan'
        said.append(Said('/velodyne_packets', moment.stamp_ns, kind, message))
        said += drives.seen('/camera/image_rect', '/camera/camera_info', 'camera_optical', moment)
        boxes = drives.markers(moment, 'base_link', np.eye(4))
        said.append(Said('/boxes', moment.stamp_ns, MARKERS, boxes))
    return [bags.write(folder / 'velodyne', said)]


# 6. A Livox with the driver's own messages, and a camera with a lens.

LIVOX_IN_BASE = drives.pose_at(0.1, -0.02, 0.6, -2.0)
LENS = (-0.2, 0.05, 0.0005, -0.0002, 0.0)
LIVOX_K = np.array([[180.0, 0, 160.0], [0, 180.0, 118.0], [0, 0, 1]])
LIVOX_EYE = Eye(camera_rigs.looking(0.5, (0.2, 0.0, 0.5)), LIVOX_K)


@cache
def livox_truth() -> Truth:
    moments = drives.around(drives.drive(), wanderer.odom_t_base)
    ahead = tuple(
        replace(moment, points=moment.points[moment.points[:, 0] > 1], solids=())
        for moment in moments
    )
    return Truth(ahead, LIVOX_IN_BASE, {2: LIVOX_EYE}, labelled=False)


LIVOX_NONE = 12


def write_livox(folder: Path) -> list[Path]:
    moments = livox_truth().moments
    links = [
        ('base_link', 'livox_frame', LIVOX_IN_BASE),
        ('base_link', 'camera_optical', LIVOX_EYE.base_T_camera),
    ]
    said = [drives.static(drives.START_NS - 10**9, links)]
    frames = ('odom', 'base_link')
    said += drives.odometry(end_ns(moments), '/odom', frames, wanderer.odom_t_base)
    said += drives.moving(end_ns(moments), lambda at: (*frames, wanderer.odom_t_base(at)))
    p = np.column_stack([LIVOX_K, np.zeros(3)])
    for moment in moments:
        points = points_in(moment, LIVOX_IN_BASE)
        rows = np.insert(points, np.linspace(0, len(points), LIVOX_NONE).astype(int), 0, axis=0)
        values = {
            'header': bags.header(moment.stamp_ns, 'livox_frame'),
            'timebase': moment.stamp_ns,
            'point_num': len(rows),
            'points': [
                {'offset_time': at, 'x': x, 'y': y, 'z': z, 'reflectivity': 100, 'line': at % 4}
                for at, (x, y, z) in enumerate(rows.tolist())
            ],
        }
        kind = 'livox_ros_driver2/msg/CustomMsg'
        said.append(Said('/livox/lidar', moment.stamp_ns, kind, values))
        camera = '/camera/image_raw', '/camera/camera_info', 'camera_optical'
        said += drives.seen(*camera, moment, d=LENS, p=p)
    return [bags.write(folder / 'livox', said, 'sqlite3')]


# 7. Foxglove's schemas in protobuf.


def foxglove_truth() -> Truth:
    eye = Eye(foxglove_robot.BASE_T_CAMERA, foxglove_robot.K, foxglove_robot.SIZE)
    return Truth(drives.drive(), foxglove_robot.BASE_T_LIDAR, {2: eye}, greys=(30, 0))


def write_foxglove(folder: Path) -> list[Path]:
    world = []
    for moment in foxglove_truth().moments:
        points = np.zeros(len(moment.points), foxglove_robot.POINT)
        for axis, column in zip('xyz', points_in(moment, foxglove_robot.BASE_T_LIDAR).T):  # noqa: B905
            points[axis] = column
        boxes = tuple(
            foxglove_robot.Box(
                tuple(solid.place[:3, 3]),
                float(np.arctan2(solid.place[1, 0], solid.place[0, 0])),
                solid.size,
                solid.name.lower(),
                str(solid.track),
            )
            for solid in moment.solids
        )
        dots = np.array([[8.0, 0.3, 0.4]])
        frame = foxglove_robot.Frame(moment.stamp_ns, points, dots, boxes, moment.world_T_body)
        world.append(frame)
    # Its position never changes, other than that of the transforms.
    found = [record for record in foxglove_robot.records(world) if record[0] != '/gps']
    return [foxglove_robot.write_protobuf(folder / 'foxglove.mcap', found)]


# 8. ROS 1: a stereo pair with its baseline in P alone, and a lidar.


def ros1_rig() -> camera_rigs.Robot:
    robot = stereo()
    return replace(robot, links=robot.links[:2], lidar_topic='/velodyne_points')


def ros1_truth() -> Truth:
    left, right = ros1_rig().cameras
    moments = drives.around(drives.drive(), wanderer.odom_t_base)
    return Truth(moments, LIDAR, {2: eye_of(left), 3: eye_of(right)})


def write_ros1(folder: Path) -> list[Path]:
    robot, moments = ros1_rig(), ros1_truth().moments
    said = rig_said(robot, moments)
    frames = ('odom', 'base_link')
    said += drives.odometry(end_ns(moments), '/odom', frames, wanderer.odom_t_base)
    said += drives.moving(end_ns(moments), lambda at: (*frames, wanderer.odom_t_base(at)))
    for moment in moments:
        boxes = drives.markers(moment, 'base_link', np.eye(4))
        said.append(Said('/detected_boxes', moment.stamp_ns, MARKERS, boxes))
        ring = {
            'header': bags.header(moment.stamp_ns, 'lidar'),
            'angle_min': -1.0,
            'angle_max': 1.0,
            'angle_increment': 0.1,
            'range_min': 0.1,
            'range_max': 30.0,
            'ranges': np.full(20, 3.0),
        }
        said.append(Said('/front_scan', moment.stamp_ns, 'sensor_msgs/msg/LaserScan', ring))
    return [bags.write(folder / 'stereo', said, 'ros1')]


# 9. Detections in map, which are corrected in jumps; a lidar that is turned by 11 degrees.


@cache
def map_truth() -> Truth:
    moments = []
    for frame in wanderer.truth():
        body_T_map = np.linalg.inv(wanderer.map_t_base(frame.stamp_ns))
        solids = tuple(
            Solid('Car', place, body_T_map @ box, tuple(wanderer.BOX))
            for place, box in enumerate(frame.boxes)
        )
        points = camera_rigs.moved(wanderer.BASE_T_LIDAR, frame.points)
        moments.append(Moment(frame.stamp_ns, points, solids, wanderer.map_t_base(frame.stamp_ns)))
    eye = Eye(wanderer.BASE_T_CAMERA, wanderer.K, wanderer.SIZE)
    return Truth(tuple(moments), wanderer.BASE_T_LIDAR, {2: eye}, turn_deg=12.0, greys=(90, 0))


def write_map(folder: Path) -> list[Path]:
    robot = wanderer.Robot(odometry=('odom', 'base_link'), imu=True)
    wanderer.write(folder / 'in_map', robot)
    return [folder / 'in_map']


# 10. Clocks apart: the camera has TAI, 37 s ahead.

LEAP_NS = 37 * 10**9
CLOCK_EYE = Eye(camera_rigs.looking(1.0, (0.5, 0.0, 1.0)))
CLOCK_FRAMES = 20


def clocks_truth() -> Truth:
    moments = drives.around(drives.drive(CLOCK_FRAMES), wanderer.odom_t_base)
    return Truth(moments, LIDAR, {2: CLOCK_EYE})


def write_clocks(folder: Path) -> list[Path]:
    moments = clocks_truth().moments
    links = [
        ('base_link', 'lidar', LIDAR),
        ('base_link', 'camera_optical', CLOCK_EYE.base_T_camera),
    ]
    said = [drives.static(drives.START_NS - 10**9, links)]
    frames = ('odom', 'base_link')
    said += drives.odometry(end_ns(moments), '/odom', frames, wanderer.odom_t_base)
    rng = np.random.default_rng(37)
    for moment in moments:
        scan = scan_of(moment, '/points', 'lidar', LIDAR)
        said.append(scan._replace(log_ns=scan.log_ns + int(rng.integers(50, 54)) * 1_000_000))
        late = int(rng.integers(9, 12)) * 1_000_000
        camera = '/camera/image_rect', '/camera/camera_info', 'camera_optical'
        said += drives.seen(*camera, moment, ahead_ns=LEAP_NS + 2_000_000, log_late_ns=late)
        boxes = drives.markers(moment, 'base_link', np.eye(4))
        said.append(Said('/boxes', moment.stamp_ns + 60_000_000, MARKERS, boxes))
    return [bags.write(folder / 'clocks', said, 'sqlite3')]


ROBOTS = (
    TenRobot(
        'autoware',
        write_autoware,
        autoware_truth,
        {
            'scan.topic': '/sensing/lidar/top/pointcloud',
            'scan.frame': 'velodyne_top',
            'scan.forward': 'base_link',
            'cameras.2.topic': '/sensing/camera/camera0/image_rect_color/compressed',
            'cameras.3': None,
            'cameras.0': None,
            'labels.topic': '/perception/objects',
            'pose.world': 'map',
            'pose.body': 'base_link',
        },
        ('passed over: /sensing/camera/camera3', '59 degrees to the right'),
    ),
    TenRobot(
        'nuscenes',
        write_nuscenes,
        nuscenes_truth,
        {
            'scan.topic': '/LIDAR_TOP',
            'scan.forward': 'base_link',
            'cameras.2.topic': '/CAM_FRONT/image_rect_compressed',
            'cameras.3': None,
            'labels.topic': '/annotations',
            'pose.topic': '/tf',
            'pose.world': 'map',
        },
        ('passed over: /CAM_BACK_LEFT/image_rect_compressed', '/RADAR_FRONT'),
    ),
    TenRobot(
        'turtlebot',
        write_turtlebot,
        turtlebot_truth,
        {
            'scan.topic': '/camera/depth/image_raw',
            'scan.from': 'depth',
            'scan.info': '/camera/depth/camera_info',
            'scan.frame': 'camera_link',
            'cameras.2.topic': '/camera/color/image_raw',
            'labels': None,
            'pose.topic': '/tf',
            'pose.world': 'map',
        },
        ('/odom',),
        f'note: /camera/depth/image_raw: {8 * 200} points without a return were dropped: depth 0 or'
        f' not finite ({8 * 200})',
    ),
    TenRobot(
        'ouster',
        write_ouster,
        ouster_truth,
        {
            'scan.topic': '/ouster/points',
            'scan.frame': 'os_sensor',
            'scan.forward': None,
            'cameras.2.topic': '/front/camera/image_rect_color',
            'labels.topic': '/detections',
            'pose.topic': '/tf',
            'pose.world': 'odom',
        },
        ('os_lidar, whose x looks backward',),
        f'note: /ouster/points: {OUSTER_NONE} points without a return were dropped: x y z 0 0 0'
        f' ({OUSTER_NONE})',
    ),
    TenRobot(
        'velodyne',
        write_velodyne,
        velodyne_truth,
        {
            'scan.topic': '/velodyne_packets',
            'scan.frame': 'velodyne',
            'cameras.2.topic': '/camera/image_rect',
            'labels.topic': '/boxes',
            'pose.topic': '/odometry',
            'pose.world': 'odom',
            'pose.body': 'base_link',
        },
    ),
    TenRobot(
        'livox',
        write_livox,
        livox_truth,
        {
            'scan.topic': '/livox/lidar',
            'scan.frame': 'livox_frame',
            'cameras.2.topic': '/camera/image_raw',
            'cameras.2.rectify': True,
            'labels': None,
            'pose.world': 'odom',
        },
        dropped=(
            f'note: /livox/lidar: {8 * LIVOX_NONE} points without a return were dropped:'
            f' x y z 0 0 0, or not finite ({8 * LIVOX_NONE})'
        ),
    ),
    TenRobot(
        'foxglove',
        write_foxglove,
        foxglove_truth,
        {
            'scan.topic': '/lidar_top',
            'scan.frame': 'lidar_top',
            'cameras.2.topic': '/cam_front/image',
            'labels.topic': '/markers/annotations',
            'pose.topic': '/tf',
            'pose.world': 'map',
        },
    ),
    TenRobot(
        'ros1_stereo',
        write_ros1,
        ros1_truth,
        {
            'scan.topic': '/velodyne_points',
            'scan.frame': 'lidar',
            'cameras.2.topic': '/stereo/left/image_rect_color',
            'cameras.3.topic': '/stereo/right/image_rect_color',
            'cameras.0': None,
            'labels.topic': '/detected_boxes',
            'pose.world': 'odom',
        },
        ('/front_scan (8), sensor_msgs/LaserScan',),
    ),
    TenRobot(
        'in_map',
        write_map,
        map_truth,
        {
            'scan.topic': '/points',
            'scan.frame': 'lidar',
            'cameras.2.topic': '/camera/image_rect',
            'labels.topic': '/objects',
            'pose.topic': '/tf',
            'pose.world': 'map',
            'pose.body': 'base_link',
        },
    ),
    TenRobot(
        'clocks_apart',
        write_clocks,
        clocks_truth,
        {
            'scan.topic': '/points',
            'scan.offset_s': None,
            'cameras.2.topic': '/camera/image_rect',
            'cameras.2.offset_s': -37.0,
            'labels.topic': '/boxes',
            'pose.topic': '/odom',
        },
        ('its clock is 37.000 s ahead',),
    ),
)


def main(out: Path) -> None:
    """Write the bags of all robots."""
    for robot in ROBOTS:
        folder = out / robot.name
        folder.mkdir(parents=True)
        print(robot.name, *robot.write(folder))


if __name__ == '__main__':
    if len(sys.argv) != 2:
        raise SystemExit('usage: ten_robots.py OUT')
    main(Path(sys.argv[1]))
