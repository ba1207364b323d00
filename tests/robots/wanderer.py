# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that turns while it drives, in bags by rosbags' own writer; its truth is plain matrices.

Its odometry drifts smoothly, and its map corrects that in jumps: map -> odom -> base_link -> lidar.
Boxes stand still in the map. Scans have points within the boxes and elsewhere, none near a face.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from vision_types import DETECTIONS_3D

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MS = 1_000_000
START_NS = 1_700_000_100_013_000_007
FRAMES = 30
PERIOD_NS = 100 * MS
TURN_NS = 98 * MS
SIZE = (640, 360)
K = np.array([[300.0, 0, 320], [0, 300.0, 180], [0, 0, 1]])
RATE = 0.4  # rad/s
SPEED = 2.0  # m/s
BOX = np.array([2.0, 1.2, 1.4])

STORE = get_typestore(Stores.ROS2_HUMBLE)
for _name, _text in DETECTIONS_3D.items():
    STORE.register(get_types_from_msg(_text, _name))
T = STORE.types


def matrix(x=0.0, y=0.0, z=0.0, yaw=0.0):
    """(4, 4) of a place and a turn about z."""
    made = np.eye(4)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    made[:2, :2] = [[cosine, -sine], [sine, cosine]]
    made[:3, 3] = x, y, z
    return made


BASE_T_LIDAR = matrix(0.4, 0.1, 1.2, 0.2)
OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
BASE_T_CAMERA = matrix(0.5, 0.0, 1.0, 0.02) @ OPTICAL
BASE_T_IMU = matrix(-0.2, 0.05, 0.3, 0.0)
BASE_T_ANTENNA = matrix(-0.7, 0.3, 1.6, 0.4)
ORIGIN = (49.0, 8.4, 110.0)
EARTH_M = 6378137.0


def seconds(stamp_ns):
    return (stamp_ns - START_NS) / 1e9


def odom_t_base(stamp_ns):
    """Along a circle."""
    yaw = 0.7 + RATE * seconds(stamp_ns)
    radius = SPEED / RATE
    x, y = radius * (np.sin(yaw) - np.sin(0.7)), -radius * (np.cos(yaw) - np.cos(0.7))
    return matrix(x, y, 0.05, yaw)


def map_t_odom(stamp_ns):
    """A correction that jumps once a second, between a scan and the next."""
    step = np.floor(seconds(stamp_ns) - 0.06)
    return matrix(20 + 0.2 * step, -7 - 0.1 * step, 0.0, 0.3 + 0.02 * step)


def map_t_base(stamp_ns):
    return map_t_odom(stamp_ns) @ odom_t_base(stamp_ns)


def velocity(stamp_ns, base_t_point):
    """(3,) of a point of the robot in map."""
    map_r_base = map_t_base(stamp_ns)[:3, :3]
    turning = np.cross([0.0, 0.0, RATE], base_t_point[:3, 3])
    return map_r_base @ (np.array([SPEED, 0.0, 0.0]) + turning)


@dataclass(frozen=True)
class Frame:
    """What is true at a scan.

    Attributes:
        stamp_ns: Its stamp.
        points: (N, 3) in the lidar's frame.
        inside: (N,) the index of the box that holds each, -1 for none.
        boxes: (M, 4, 4) boxes in the map.
    """

    stamp_ns: int
    points: np.ndarray
    inside: np.ndarray
    boxes: np.ndarray


def truth() -> list[Frame]:
    rng = np.random.default_rng(11)
    frames = []
    for index in range(FRAMES):
        stamp_ns = START_NS + index * PERIOD_NS
        base = map_t_base(stamp_ns)
        ahead = [matrix(8, 1.5, 0.8, 0.4), matrix(11, -2.0, 0.8, -1.1)]
        boxes = np.array([base @ each for each in ahead])
        parts, inside = [], []
        for place, box in enumerate(boxes):
            within = rng.uniform(-0.48, 0.48, (40, 3)) * BOX
            parts.append(within @ box[:3, :3].T + box[:3, 3])
            inside += [place] * len(within)
        ground = rng.uniform([4, -9, -0.5], [16, 9, 0.05], (300, 3)) @ base[:3, :3].T + base[:3, 3]
        points = np.vstack([*parts, ground])
        inside += [-1] * len(ground)
        lidar_t_map = np.linalg.inv(base @ BASE_T_LIDAR)
        frames.append(
            Frame(
                stamp_ns,
                points @ lidar_t_map[:3, :3].T + lidar_t_map[:3, 3],
                np.array(inside),
                boxes,
            )
        )
    return frames


@dataclass(frozen=True)
class Robot:
    """What a bag of the robot holds.

    Attributes:
        map_tf, odom_tf: Whether /tf has map -> odom, and odom -> base_link.
        odometry: Frames of Odometry on /odom, None for none.
        twist: Whether it has a twist.
        posed: Whether /pose tells where base_link is in map.
        boxes: Frame of the detections: map, odom or base_link, None for none.
        markers: Whether they are markers, instead of a Detection3DArray.
        cloud: Frame of the clouds.
        timed: Whether points have times, from the stamp on; images are of the middle then.
        boxes_after_ns: How long after the scan the boxes are stamped, and seen.
        imu: Whether there is an Imu.
        base_t_imu: (4, 4) its place.
        imu_frame: Its frame.
        receiver: Frame of /fix, of an antenna, and of /vel along east and north; empty for none.
        velocity_frame: Of /vel where it is another.
        with_velocity: Whether /vel is there.
        indoors: Whether /fix never has a fix.
        bare_imu: Whether there is another Imu, of a camera, without an orientation.
        leader: Whether /a_leader/odom tells the poses of another robot, more often.
        static: Whether the sensors are joined to base_link.
        broken: How many messages of /tf or /odom have a quaternion of zeros.
        keep: Which transforms and Odometry are written, by (child, stamp).
        inverted: Whether odom is a child of base_link, as Spot has it.
        stamped: Whether transforms have stamps, not 0.
        tf_ahead_ns: How far their clock is ahead of the sensors'.
        log: When messages are recorded, by (topic, stamp).
    """

    map_tf: bool = True
    odom_tf: bool = True
    odometry: tuple[str, str] | None = None
    twist: bool = True
    posed: bool = False
    boxes: str | None = 'map'
    markers: bool = False
    cloud: str = 'lidar'
    timed: bool = False
    boxes_after_ns: int = 0
    imu: bool = False
    base_t_imu: np.ndarray = field(default_factory=BASE_T_IMU.copy)
    imu_frame: str = 'imu'
    receiver: str = ''
    velocity_frame: str = ''
    with_velocity: bool = True
    indoors: bool = False
    leader: bool = False
    bare_imu: bool = False
    camera: bool = True
    static: bool = True
    broken: int = 0
    keep: Callable[[str, int], bool] = field(default=lambda _child, _stamp: True)
    inverted: bool = False
    stamped: bool = True
    tf_ahead_ns: int = 0
    log: Callable[[str, int], int] = field(default=lambda _topic, stamp_ns: stamp_ns + MS)

    def tf_stamp(self, moment_ns: int) -> int:
        """Return what a transform of a moment is stamped."""
        return (moment_ns + self.tf_ahead_ns) * self.stamped


def header(stamp_ns, frame):
    sec, nanosec = divmod(int(stamp_ns), 10**9)
    return T['std_msgs/msg/Header'](T['builtin_interfaces/msg/Time'](sec, nanosec), frame)


def quaternion(pose):
    half = np.arctan2(pose[1, 0], pose[0, 0]) / 2
    return T['geometry_msgs/msg/Quaternion'](0.0, 0.0, float(np.sin(half)), float(np.cos(half)))


def full_quaternion(pose):
    """The main axis of Bar-Itzhack's matrix, which has no special cases."""
    r = pose[:3, :3]
    skew = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    k = np.zeros((4, 4))
    k[:3, :3] = r + r.T - np.trace(r) * np.eye(3)
    k[3, :3] = k[:3, 3] = skew
    k[3, 3] = np.trace(r)
    return T['geometry_msgs/msg/Quaternion'](*np.linalg.eigh(k)[1][:, -1].tolist())


def vector(xyz):
    return T['geometry_msgs/msg/Vector3'](*(float(each) for each in xyz))


def ros_pose(pose):
    point = T['geometry_msgs/msg/Point'](*(float(each) for each in pose[:3, 3]))
    return T['geometry_msgs/msg/Pose'](point, quaternion(pose))


def transform(stamp_ns, parent, child, pose, turn=quaternion):
    moved = T['geometry_msgs/msg/Transform'](vector(pose[:3, 3]), turn(pose))
    return T['geometry_msgs/msg/TransformStamped'](header(stamp_ns, parent), child, moved)


def tf(*links):
    return T['tf2_msgs/msg/TFMessage'](list(links))


def cloud(stamp_ns, frame, points, turn_ns=0):
    """With the time of each point after the stamp, where a turn takes a time."""
    names = ('x', 'y', 'z', 'intensity', *(('t',) if turn_ns else ()))
    rows = np.zeros(len(points), [(name, '<u4' if name == 't' else '<f4') for name in names])
    rows['x'], rows['y'], rows['z'] = points.astype(np.float32).T
    rows['intensity'] = 0.5
    if turn_ns:
        rows['t'] = np.linspace(0, turn_ns, len(points)).astype(np.uint32)
    fields = [
        T['sensor_msgs/msg/PointField'](name, 4 * place, 6 if name == 't' else 7, 1)
        for place, name in enumerate(names)
    ]
    step, data = rows.itemsize, np.frombuffer(rows.tobytes(), np.uint8)
    return T['sensor_msgs/msg/PointCloud2'](
        header(stamp_ns, frame), 1, len(rows), fields, False, step, step * len(rows), data, True
    )


def odometry(stamp_ns, frames, pose, twist):
    nothing = np.zeros(36)
    linear, angular = ((SPEED, 0, 0), (0, 0, RATE)) if twist else ((0, 0, 0), (0, 0, 0))
    motion = T['geometry_msgs/msg/Twist'](vector(linear), vector(angular))
    return T['nav_msgs/msg/Odometry'](
        header(stamp_ns, frames[0]),
        frames[1],
        T['geometry_msgs/msg/PoseWithCovariance'](ros_pose(pose), nothing),
        T['geometry_msgs/msg/TwistWithCovariance'](motion, nothing),
    )


def fix(stamp_ns, frame, status_code):
    east, north, up = (map_t_base(stamp_ns) @ BASE_T_ANTENNA)[:3, 3]
    lat, lon, alt = ORIGIN
    radius = EARTH_M * np.cos(np.radians(lat))
    place = lat + np.degrees(north / EARTH_M), lon + np.degrees(east / radius), alt + up
    status = T['sensor_msgs/msg/NavSatStatus'](status_code, 1)
    covariance = np.diag([0.01] * 3).ravel()
    return T['sensor_msgs/msg/NavSatFix'](header(stamp_ns, frame), status, *place, covariance, 2)


def twist(stamp_ns, frame):
    moved = vector(velocity(stamp_ns, BASE_T_ANTENNA))
    said = T['geometry_msgs/msg/Twist'](moved, vector((0.0, 0.0, 0.0)))
    return T['geometry_msgs/msg/TwistStamped'](header(stamp_ns, frame), said)


def imu(stamp_ns, base_t_imu):
    unknown = np.zeros(9)
    turned = base_t_imu[:3, :3].T
    rate, sensed = vector(turned @ (0.0, 0.0, RATE)), vector(turned @ (0.1, SPEED * RATE, 9.81))
    turn = full_quaternion(map_t_base(stamp_ns) @ base_t_imu)
    return T['sensor_msgs/msg/Imu'](
        header(stamp_ns, 'imu'), turn, unknown, rate, unknown, sensed, unknown
    )


def detections(stamp_ns, frame, boxes):
    made = []
    for place, box in enumerate(boxes):
        kind = T['vision_msgs/msg/ObjectHypothesis']('Car', 1.0)
        guess = T['geometry_msgs/msg/PoseWithCovariance'](ros_pose(box), np.zeros(36))
        result = T['vision_msgs/msg/ObjectHypothesisWithPose'](kind, guess)
        bounds = T['vision_msgs/msg/BoundingBox3D'](ros_pose(box), vector(BOX))
        made.append(
            T['vision_msgs/msg/Detection3D'](header(stamp_ns, frame), [result], bounds, f'{place}')
        )
    return T['vision_msgs/msg/Detection3DArray'](header(stamp_ns, frame), made)


def markers(stamp_ns, frame, boxes):
    kind = T['visualization_msgs/msg/Marker']
    none = T['builtin_interfaces/msg/Duration'](0, 0)
    color = T['std_msgs/msg/ColorRGBA'](1.0, 0.0, 0.0, 1.0)
    empty = T['sensor_msgs/msg/CompressedImage'](header(0, ''), '', np.zeros(0, np.uint8))
    made = [
        kind(
            header(stamp_ns, frame), 'Car', place, 1, 0, ros_pose(box), vector(BOX), color, none,
            False, [], [], '', empty, [], '', '',
            T['visualization_msgs/msg/MeshFile']('', np.zeros(0, np.uint8)), False,
        )
        for place, box in enumerate(boxes)
    ]  # fmt: skip
    return T['visualization_msgs/msg/MarkerArray'](made)


def image(stamp_ns):
    data = np.full(SIZE[0] * SIZE[1] * 3, 90, np.uint8)
    return T['sensor_msgs/msg/Image'](
        header(stamp_ns, 'camera'), SIZE[1], SIZE[0], 'rgb8', 0, SIZE[0] * 3, data
    )


def camera_info(stamp_ns):
    p = np.column_stack([K, np.zeros(3)]).ravel()
    region = T['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
    return T['sensor_msgs/msg/CameraInfo'](
        header(stamp_ns, 'camera'), SIZE[1], SIZE[0], 'plumb_bob', np.zeros(5), K.ravel(),
        np.eye(3).ravel(), p, 0, 0, region,
    )  # fmt: skip


def messages(robot: Robot, frames: list[Frame]):
    """(topic, stamp, message) in order of stamps."""
    found = [*still(robot), *moving(robot), *unit(robot)]
    found += [*(leading() if robot.leader else ()), *(posed() if robot.posed else ())]
    for frame in frames:
        found += sensed(robot, frame)
    return sorted(found, key=lambda each: each[1])


def still(robot: Robot):
    """The static transforms."""
    if robot.static:
        links = [
            transform(0, 'base_link', 'lidar', BASE_T_LIDAR),
            transform(0, 'base_link', 'camera', BASE_T_CAMERA, full_quaternion),
            transform(0, 'base_link', 'antenna', BASE_T_ANTENNA),
            transform(0, 'base_link', 'imu', robot.base_t_imu, full_quaternion),
        ]
        yield '/tf_static', START_NS - 10**9, tf(*links)


def sensed(robot: Robot, frame: Frame):
    """What the sensors see at a frame."""
    stamp_ns, points = frame.stamp_ns, frame.points
    if robot.cloud != 'lidar':
        world = map_t_base if robot.cloud == 'map' else odom_t_base
        world_t_lidar = world(stamp_ns) @ BASE_T_LIDAR
        points = points @ world_t_lidar[:3, :3].T + world_t_lidar[:3, 3]
    yield '/points', stamp_ns, cloud(stamp_ns, robot.cloud, points, robot.timed * TURN_NS)
    if robot.camera:
        image_ns = stamp_ns + robot.timed * TURN_NS // 2
        yield '/camera/image_rect', image_ns, image(image_ns)
        yield '/camera/camera_info', image_ns, camera_info(image_ns)
    if robot.boxes is not None:
        seen_ns = stamp_ns + robot.boxes_after_ns
        frame_t_map = np.eye(4) if robot.boxes == 'map' else np.linalg.inv(map_t_odom(stamp_ns))
        if robot.boxes == 'base_link':
            frame_t_map = np.linalg.inv(odom_t_base(seen_ns)) @ frame_t_map
        make = markers if robot.markers else detections
        yield '/objects', seen_ns, make(seen_ns, robot.boxes, frame_t_map @ frame.boxes)


def moving(robot: Robot):
    """Transforms and Odometry."""
    end_ns = START_NS + FRAMES * PERIOD_NS
    broken = robot.broken
    for stamp_ns in range(START_NS - 203 * MS, end_ns + 200 * MS, 10 * MS):
        pose = odom_t_base(stamp_ns)
        if robot.odom_tf and robot.keep('base_link', stamp_ns):
            link = transform(robot.tf_stamp(stamp_ns), 'odom', 'base_link', pose)
            if robot.inverted:
                way = np.linalg.inv(pose)
                link = transform(robot.tf_stamp(stamp_ns), 'base_link', 'odom', way)
            if broken > 0:
                link.transform.rotation.w = link.transform.rotation.z = 0.0
            yield '/tf', stamp_ns, tf(link)
            broken -= 1
        if robot.odometry is not None and robot.keep('odometry', stamp_ns):
            message = odometry(stamp_ns, robot.odometry, pose, robot.twist)
            if broken > 0:
                message.pose.pose.orientation.w = message.pose.pose.orientation.z = 0.0
            yield '/odom', stamp_ns, message
            broken -= 1
    for stamp_ns in range(START_NS - 190 * MS, end_ns + 200 * MS, 20 * MS):
        if robot.map_tf and robot.keep('odom', stamp_ns):
            at = robot.tf_stamp(stamp_ns)
            yield '/tf', stamp_ns, tf(transform(at, 'map', 'odom', map_t_odom(stamp_ns)))


def posed():
    """Where base_link is in map."""
    for stamp_ns in range(START_NS - 200 * MS, START_NS + FRAMES * PERIOD_NS + 200 * MS, 10 * MS):
        there = ros_pose(map_t_base(stamp_ns))
        yield '/pose', stamp_ns, T['geometry_msgs/msg/PoseStamped'](header(stamp_ns, 'map'), there)


def leading():
    """The Odometry of another robot."""
    for stamp_ns in range(START_NS, START_NS + FRAMES * PERIOD_NS, 5 * MS):
        frames = 'odom', 'leader/base_link'
        yield '/a_leader/odom', stamp_ns, odometry(stamp_ns, frames, odom_t_base(stamp_ns), False)


def unit(robot: Robot):
    """Imu, fix and velocity."""
    end_ns = START_NS + FRAMES * PERIOD_NS
    for stamp_ns in range(START_NS - 203 * MS, end_ns + 200 * MS, 10 * MS):
        if robot.imu:
            sensed_there = imu(stamp_ns, robot.base_t_imu)
            sensed_there.header.frame_id = robot.imu_frame
            yield '/imu', stamp_ns, sensed_there
        if robot.bare_imu:
            bare = imu(stamp_ns, BASE_T_CAMERA)
            bare.orientation.w = bare.orientation.x = 0.0
            bare.orientation.y = bare.orientation.z = 0.0
            bare.header.frame_id = 'camera'
            yield '/camera/imu', stamp_ns, bare
            yield '/camera/imu', stamp_ns + MS, bare
        if robot.receiver:
            yield '/fix', stamp_ns, fix(stamp_ns, robot.receiver, -1 if robot.indoors else 0)
            moving_in = robot.velocity_frame or robot.receiver
            if robot.with_velocity:
                yield '/vel', stamp_ns, twist(stamp_ns, moving_in)


def write(path: Path, robot: Robot) -> list[Frame]:
    """Write a bag, and return what is true."""
    frames = truth()
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, stamp_ns, message in messages(robot, frames):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = STORE.serialize_cdr(message, kind)
            writer.write(connections[topic], robot.log(topic, stamp_ns), data)
    return frames
