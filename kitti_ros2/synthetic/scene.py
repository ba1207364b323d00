# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic street: the path of the car, its rig, and the objects beside the road."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import atan, atan2, cos, degrees, exp, hypot, log, pi, radians, sin, sqrt, tan
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from ..model.errors import UsageError
from ..model.geometry import Transform, rotation_from_rpy, rotation_to_rpy
from ..model.lenses import MeiLens
from ..model.samples import Calibration, CameraCalibration, OxtsPacket

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from ..model.geometry import Float64Array


# The path of the synthetic car: a winding lane in closed form, with exact derivatives.
#
# The *street* frame lies on the ground (z = 0, z up): the ego lane is y = A sin(k x), other lanes
# are the same curve shifted in y. In the middle of a bend the car turns at A k^2 times its speed.
# The street lies on a slope: map_R_street turns it into map axes (x east, y north, z up), so that
# roll, pitch and height change along the way although the car is level on its road and every box
# upright beside it.

_Float = TypeVar('_Float', np.float32, np.float64)

GRAVITY = 9.81
EARTH_RADIUS = 6378137.0
ORIGIN = (49.0093, 8.4381, 114.7)
"""Latitude and longitude in degrees and altitude in metres of the unit in frame 0."""

MAP_R_STREET = rotation_from_rpy(0.011, -0.024, 0.57)

_ACCURACY_AND_MODES = {
    'pos_accuracy': 0.05,
    'vel_accuracy': 0.02,
    'navstat': 4,
    'numsats': 9,
    'posmode': 6,
    'velmode': 6,
    'orimode': 6,
}
_AMPLITUDE = 5.0
_SPEED_WAVE = 0.9
_SPEED_RATE = 0.55
_START_S = 6.0


@dataclass(frozen=True)
class Course:
    """The ego lane, and the car on it.

    Attributes:
        speed: Mean speed along the street, m/s.
        wave_number: k of the lane, radians a metre.
        rest: Time at which the car drives off, seconds; it reaches its speed 6 s later. None: it
            drives from the beginning.
    """

    speed: float = 8.0
    wave_number: float = 2 * pi / 150.0
    rest: float | None = None

    @classmethod
    def turning(cls, speed: float, turn_rate: float, rest: float | None = None) -> Course:
        """Return a course of a speed in m/s, with bends of a turn rate in rad/s."""
        return cls(speed, sqrt(turn_rate / (_AMPLITUDE * speed)), rest)

    def y(self, x: float) -> float:
        """Return the ego lane's y at x, street frame."""
        return _AMPLITUDE * sin(self.wave_number * x)

    def y_array(self, x: npt.NDArray[_Float]) -> npt.NDArray[_Float]:
        """Return y of an array, in its own precision."""
        number, amplitude = x.dtype.type(self.wave_number), x.dtype.type(_AMPLITUDE)
        y: npt.NDArray[_Float] = np.sin(x * number) * amplitude
        return y

    def yaw(self, x: float) -> float:
        """Return the ego lane's heading at x, street frame."""
        return atan(_AMPLITUDE * self.wave_number * cos(self.wave_number * x))

    def ego_x(self, time: float) -> float:
        """Return the car's position along the street at a time in seconds."""
        driven, _, _ = self.driven(time)
        return self.speed * driven + _SPEED_WAVE * sin(_SPEED_RATE * driven)

    def driven(self, time: float) -> tuple[float, float, float]:
        """Return the time for which the car has driven at full speed, and its derivatives."""
        if self.rest is None:
            return time, 1.0, 0.0
        part = min(max((time - self.rest) / _START_S, 0.0), 1.0)
        full = max(time - self.rest - _START_S, 0.0)
        return (
            full + _START_S * (part**3 - part**4 / 2),
            part * part * (3 - 2 * part),
            6 * part * (1 - part) / _START_S,
        )


COURSE = Course()


@dataclass(frozen=True, eq=False)
class Motion:
    """The GPS/IMU unit at one moment; vectors in map axes, from its position at time 0.

    Attributes:
        street_T_car: The car in the street frame.
        map_T_imu: Pose of the unit.
        velocity: (3,) m/s.
        acceleration: (3,) m/s^2, without gravity.
        angular_velocity: (3,) rad/s.
    """

    street_T_car: Transform
    map_T_imu: Transform
    velocity: Float64Array
    acceleration: Float64Array
    angular_velocity: Float64Array


def motion_at(time: float, car_T_imu: Transform, course: Course = COURSE) -> Motion:
    """Return the motion of the unit, mounted at car_T_imu, at a time in seconds."""
    street_t_car, velocity, acceleration, yaw_rate, yaw_acceleration = _car_motion(time, course)
    street_t_imu = street_t_car @ car_T_imu
    first_t_car = _car_motion(0.0, course)[0]
    arm = street_t_imu.translation - street_t_car.translation
    across = np.array([-arm[1], arm[0], 0.0])
    inward = np.array([-arm[0], -arm[1], 0.0])
    moved = street_t_imu.translation - (first_t_car @ car_T_imu).translation
    return Motion(
        street_T_car=street_t_car,
        map_T_imu=Transform(MAP_R_STREET @ street_t_imu.rotation, MAP_R_STREET @ moved),
        velocity=MAP_R_STREET @ (velocity + yaw_rate * across),
        acceleration=MAP_R_STREET
        @ (acceleration + yaw_acceleration * across + yaw_rate**2 * inward),
        angular_velocity=MAP_R_STREET @ np.array([0.0, 0.0, yaw_rate]),
    )


def _car_motion(
    time: float, course: Course
) -> tuple[Transform, Float64Array, Float64Array, float, float]:
    """Return street_T_car, velocity, acceleration, yaw rate and acceleration, street frame."""
    x, wave_number = course.ego_x(time), course.wave_number
    driven, rate, change = course.driven(time)
    speed = course.speed + _SPEED_WAVE * _SPEED_RATE * cos(_SPEED_RATE * driven)
    dx = speed * rate
    ddx = -_SPEED_WAVE * _SPEED_RATE**2 * sin(_SPEED_RATE * driven) * rate**2 + speed * change
    y1 = _AMPLITUDE * wave_number * cos(wave_number * x)
    y2 = -(wave_number**2) * course.y(x)
    y3 = -(wave_number**2) * y1
    steep = 1 + y1 * y1
    yaw_rate = y2 * dx / steep
    yaw_acceleration = (y3 * dx * dx + y2 * ddx) / steep - 2 * y1 * (y2 * dx / steep) ** 2
    pose = Transform(rotation_from_rpy(0.0, 0.0, atan(y1)), np.array([x, course.y(x), 0.0]))
    velocity = np.array([dx, y1 * dx, 0.0])
    acceleration = np.array([ddx, y1 * ddx + y2 * dx * dx, 0.0])
    return pose, velocity, acceleration, yaw_rate, yaw_acceleration


def packet_of(motion: Motion) -> OxtsPacket:
    """Return the unit's packet; the position inverts the devkit's Mercator with frame 0's scale."""
    rotation = motion.map_T_imu.rotation
    roll, pitch, yaw = rotation_to_rpy(rotation)
    level = rotation_from_rpy(0.0, 0.0, yaw).T
    felt = motion.acceleration + np.array([0.0, 0.0, GRAVITY])
    latitude, longitude, altitude = _geodetic(motion.map_T_imu.translation)
    forward, left, up = level @ motion.velocity
    values = [latitude, longitude, altitude, roll, pitch, yaw]
    # vl is positive to the right, as in the real data; see samples.OxtsPacket.
    values += [motion.velocity[1], motion.velocity[0], forward, -left, up]
    values += [*(rotation.T @ felt), *(level @ felt)]
    values += [*(rotation.T @ motion.angular_velocity), *(level @ motion.angular_velocity)]
    return OxtsPacket(
        *(float(value) for value in values),  # type: ignore[arg-type]
        **_ACCURACY_AND_MODES,  # type: ignore[arg-type]
    )


def _geodetic(position: Float64Array) -> tuple[float, float, float]:
    """Return latitude, longitude (degrees) and altitude of a point in map."""
    latitude, longitude, altitude = ORIGIN
    metres = EARTH_RADIUS * cos(radians(latitude))
    northing = log(tan(pi / 4 + radians(latitude) / 2)) + position[1] / metres
    return (
        degrees(2 * atan2(exp(northing), 1.0) - pi / 2),
        longitude + degrees(position[0] / metres),
        altitude + float(position[2]),
    )


# Options of the synthetic recording.

MAX_FRAMES = 10_000
FULL_SIZE = (1242, 375)


@dataclass(frozen=True)
class SyntheticOptions:
    """Options of the synthetic recording: the same options give the same bytes.

    Attributes:
        frames: Number of frames, at 10 Hz.
        seed: Of the street: objects, places and colours.
        image_size: (width, height) in pixels; the projections scale with it.
        lidar_columns: Firings per turn; each is 64 rays.
        range_noise_m: Standard deviation of the ranges; 0 puts points exactly on the surfaces.
        speed: Mean speed of the car, m/s.
        turn_rate: Of the car in the middle of bends, degrees a second; None is a gentle one that
            grows with the speed, 4 at 8 m/s.
        rest: Seconds for which the car stands before it drives off; it reaches its speed 6 s later.
            None: it drives from the beginning.
        swept: Whether points are measured while the scanner turns, as by KITTI's; else a scan is a
            snapshot.
        extract: Whether the raw layout also has the 100 Hz packets of the unsynchronised drive; the
            packets of the synchronised drive are then some of them.
    """

    frames: int = 20
    seed: int = 0
    image_size: tuple[int, int] = FULL_SIZE
    lidar_columns: int = 2000
    range_noise_m: float = 0.0
    speed: float = COURSE.speed
    turn_rate: float | None = None
    rest: float | None = None
    swept: bool = False
    extract: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MAX_FRAMES:
            raise UsageError(f'frames is {self.frames}; expected 1 to {MAX_FRAMES}')
        if self.seed < 0:
            raise UsageError(f'seed is {self.seed}; expected 0 or more')
        width, height = self.image_size
        if not (16 <= width <= 8192 and 16 <= height <= 8192):
            raise UsageError(f'image_size is {width}x{height}; expected 16 to 8192 pixels a side')
        if not 16 <= self.lidar_columns <= 20_000:
            raise UsageError(f'lidar_columns is {self.lidar_columns}; expected 16 to 20000')
        if not 0.0 <= self.range_noise_m <= 1.0:
            raise UsageError(f'range_noise_m is {self.range_noise_m}; expected 0 to 1')
        if not 1.0 <= self.speed <= 50.0:
            raise UsageError(f'speed is {self.speed}; expected 1 to 50 m/s')
        if self.turn_rate is not None and not 0.0 < self.turn_rate <= 60.0:
            raise UsageError(f'turn_rate is {self.turn_rate}; expected above 0, to 60 degrees/s')
        if self.rest is not None and not 0.0 <= self.rest <= 1000.0:
            raise UsageError(f'rest is {self.rest}; expected 0 to 1000 s')

    @property
    def course(self) -> Course:
        """The lane and the car on it."""
        if self.turn_rate is None:
            return Course(self.speed, rest=self.rest)
        return Course.turning(self.speed, radians(self.turn_rate), self.rest)


# The synthetic car: four cameras, a scanner and a GPS/IMU unit, mounted as on KITTI's car.
#
# The numbers are invented, of KITTI's magnitude. The scanner is exactly upright on the car, and the
# rectified cameras' y axis is exactly parallel to the scanner's z: so upright boxes are exact as
# labels (yaw about the camera's y) and as tracklets (yaw about the scanner's z). The unrectified
# camera 0 and the unit are tilted, so no part of the chain is an identity.

SCANNER_HEIGHT = 1.73
"""Height of the scanner above the ground, metres."""

CAR_T_VELO = Transform.from_translation((0.76, 0.0, SCANNER_HEIGHT))
"""velo_link in the car: on the ground below the middle of the rear axle, x forward, z up."""

_FOCAL = 719.25
_CENTRE = (611.4375, 174.1875)
_OFFSETS = (
    (0.0, 0.0, 0.0),
    (-0.5372, 0.0, 0.0),
    (0.0604, -0.00036, 0.00268),
    (-0.4721, 0.00241, 0.00275),
)
"""Minus the position of each camera's centre in the rectified camera 0, metres."""

_RAW_FOCALS = ((981.5, 978.25), (986.75, 985.0), (961.25, 958.5), (905.5, 903.75))
_RAW_CENTRES = ((691.5, 235.25), (700.25, 246.5), (694.75, 223.5), (696.5, 225.75))
_DISTORTIONS = (
    (-0.3712, 0.2011, 0.0021, 0.0013, -0.0703),
    (-0.3651, 0.1803, 0.0012, -0.0006, -0.0542),
    (-0.3684, 0.1952, 0.0013, 0.0005, -0.0661),
    (-0.3627, 0.1795, 0.0007, -0.0004, -0.0553),
)
_RAW_TILTS = (
    (0.0, 0.0, 0.0),
    (0.0081, -0.0305, -0.0192),
    (0.0033, -0.0044, 0.0051),
    (0.0019, -0.0247, -0.0166),
)
_RECTIFYING_RPY = (0.0043, -0.0079, -0.0096)
_SCANNER_YAW_IN_CAMERA = 0.0067
_CAMERA_FROM_SCANNER_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_CAM0_P_VELO = (-0.0052, -0.0747, -0.2751)
_UNIT_RPY = (-0.0139, -0.0023, 0.0011)
_VELO_P_UNIT = (-0.8104, 0.3203, -0.8012)


def make_calibration(image_size: tuple[int, int] = FULL_SIZE, digits: int = 7) -> Calibration:
    """Return the rig, its numbers rounded to digits, of which KITTI's files have seven."""
    rounded = partial(_rounded, digits=digits)
    r0_rect = rounded(rotation_from_rpy(*_RECTIFYING_RPY))
    rect_r_velo = _CAMERA_FROM_SCANNER_AXES @ rotation_from_rpy(0.0, 0.0, _SCANNER_YAW_IN_CAMERA)
    return Calibration(
        cameras={
            index: _camera(index, image_size, r0_rect, rounded) for index in range(len(_OFFSETS))
        },
        r0_rect=r0_rect,
        cam0_T_velo=Transform(rounded(r0_rect.T @ rect_r_velo), np.array(_CAM0_P_VELO)),
        velo_T_imu=Transform(rounded(rotation_from_rpy(*_UNIT_RPY)), np.array(_VELO_P_UNIT)),
    )


def _camera(
    index: int,
    image_size: tuple[int, int],
    r0_rect: Float64Array,
    rounded: Callable[[Float64Array], Float64Array],
) -> CameraCalibration:
    scale = np.array(image_size) / np.array(FULL_SIZE)
    # Pixel (0, 0) is the first pixel's centre, half a pixel from the image's corner.
    (cx, cy) = (np.array(_CENTRE) + 0.5) * scale - 0.5
    k_rect = np.array([[_FOCAL * scale[0], 0, cx], [0, _FOCAL * scale[1], cy], [0, 0, 1]])
    offset = np.array(_OFFSETS[index])
    cam_r_cam0 = rotation_from_rpy(*_RAW_TILTS[index])
    r_rect = r0_rect @ cam_r_cam0.T
    (fx, fy), (raw_cx, raw_cy) = _RAW_FOCALS[index], _RAW_CENTRES[index]
    return CameraCalibration(
        p_rect=rounded(np.column_stack([k_rect, k_rect @ offset])),
        size=image_size,
        k=np.array([[fx, 0, raw_cx], [0, fy, raw_cy], [0, 0, 1]]),
        d=np.array(_DISTORTIONS[index]),
        r_rect=rounded(r_rect),
        cam_T_cam0=Transform(rounded(cam_r_cam0), rounded(r_rect.T @ offset)),
    )


# Two fisheyes on its sides, of the magnitude of KITTI-360's: they see 98 and 99 degrees off their
# axes. Beside FULL_SIZE, images are 0.4 times as large as those, which are drawn as fast.

FISHEYES = {2: 1.0, 3: -1.0}
"""By camera the side that it looks to, 1 is left."""

_FISHEYE_SIZE = 1400
_FISHEYE_SCALE = 0.4
_FISHEYE_FOCALS = ((1320.4, 1319.7), (1450.6, 1450.1))
_FISHEYE_CENTRES = ((712.5, 704.25), (697.75, 701.5))
_FISHEYE_LENSES = (
    MeiLens(2.19, np.array([0.021, 1.63, 3.1e-4, -4.4e-4])),
    MeiLens(2.48, np.array([0.045, 3.8, -2.2e-4, 5.3e-4])),
)
_FISHEYE_TILTS = ((0.012, -0.021, 0.017), (-0.009, 0.015, 0.024))
_VELO_P_FISHEYES = ((-0.0512, 0.4437, 0.2315), (-0.0674, -0.4509, 0.2388))


def make_fisheyes(image_size: tuple[int, int]) -> dict[int, CameraCalibration]:
    """Return the fisheyes beside rectified images of a size."""
    side = max(16, round(_FISHEYE_SIZE * _FISHEYE_SCALE * image_size[0] / FULL_SIZE[0]))
    scale = side / _FISHEYE_SIZE
    cameras = {}
    for index, (camera, left) in enumerate(FISHEYES.items()):
        (fx, fy), (cx, cy) = _FISHEYE_FOCALS[index], _FISHEYE_CENTRES[index]
        k = np.array([
            [fx * scale, 0, (cx + 0.5) * scale - 0.5, 0],
            [0, fy * scale, (cy + 0.5) * scale - 0.5, 0],
            [0, 0, 1, 0],
        ])  # fmt: skip
        axes = np.array([[left, 0, 0], [0, 0, left], [0, -1, 0]])
        tilt = rotation_from_rpy(*_FISHEYE_TILTS[index])
        velo_t_cam = Transform(axes @ tilt, np.array(_VELO_P_FISHEYES[index]))
        cameras[camera] = CameraCalibration(
            k, size=(side, side), cam_T_velo=velo_t_cam.inverse(), lens=_FISHEYE_LENSES[index]
        )
    return cameras


def _rounded(values: Float64Array, digits: int) -> Float64Array:
    return np.array([float(f'{value:.{digits - 1}e}') for value in values.ravel()]).reshape(
        values.shape
    )


# The objects of the synthetic street: upright boxes in lanes beside the ego lane.
#
# A lane is the ego lane shifted in y: negative to the right. Objects of one lane have the same
# speed, so they never collide.

ROAD_CENTRE = 1.75
ROAD_RIGHT, ROAD_LEFT = -4.5, 7.6
REACH = 125.0
"""Greatest distance of a visible box's centre from the scanner, metres."""

_BEHIND, _AHEAD = 130.0, 160.0
_ONCOMING_SPEED = 9.0
_WALKING, _CYCLING = 1.3, 4.4


class Look(NamedTuple):
    """The appearance of a box: a style of texture, a variant of it, and a reflectance."""

    style: str
    variant: int
    reflectance: float


@dataclass(frozen=True)
class Solid:
    """An upright box and how it moves along its lane.

    Attributes:
        look: Its appearance.
        size: Length, width, height, metres.
        x: Along the street at time 0; for a leader, ahead of the ego car.
        lane: Shift of its lane in y, metres.
        height: Of its bottom above the ground, metres.
        turn: Heading against the street's, radians.
        speed: Along the street, m/s.
        leads: Whether it keeps ahead of the ego car instead.
        class_name: Class of its label, None for an unlabelled object.
        track_id: Its identity, -1 for an unlabelled object.
    """

    look: Look
    size: tuple[float, float, float]
    x: float
    lane: float
    height: float = 0.0
    turn: float = 0.0
    speed: float = 0.0
    leads: bool = False
    class_name: str | None = None
    track_id: int = -1

    def along(self, time: float, course: Course) -> float:
        """Return its position along the street at a time, street frame x, metres."""
        if self.leads:
            return course.ego_x(time) + self.x + 1.5 * sin(0.4 * time)
        return self.x + self.speed * time

    def pose(self, time: float, course: Course) -> Transform:
        """Return street_T_solid: its bottom face's centre, x along its length."""
        x = self.along(time, course)
        rotation = rotation_from_rpy(0.0, 0.0, course.yaw(x) + self.turn)
        return Transform(rotation, np.array([x, course.y(x) + self.lane, self.height]))


@dataclass(frozen=True)
class PlacedSolid:
    """A solid at one moment, in the scanner's frame.

    Attributes:
        solid: The box.
        centre: Bottom face's centre in velo_link, metres.
        yaw: Its heading about velo_link's z, radians.
    """

    solid: Solid
    centre: tuple[float, float, float]
    yaw: float

    @property
    def distance(self) -> float:
        """Return the distance from the scanner to its centre on the ground, metres."""
        return hypot(self.centre[0], self.centre[1])

    def footprint(self) -> tuple[tuple[float, float], ...]:
        """Return the four corners (x, y) in velo_link, counter-clockwise."""
        length, width, _ = self.solid.size
        c, s = cos(self.yaw), sin(self.yaw)
        corners = ((length, width), (-length, width), (-length, -width), (length, -width))
        return tuple(
            (
                self.centre[0] + (c * dx - s * dy) / 2,
                self.centre[1] + (s * dx + c * dy) / 2,
            )
            for dx, dy in corners
        )


def place_solids(
    solids: tuple[Solid, ...], time: float, street_T_car: Transform, course: Course = COURSE
) -> list[PlacedSolid]:
    """Return the solids within range of the scanner at a time, nearest first."""
    velo_t_street = (street_T_car @ CAR_T_VELO).inverse()
    ego = street_T_car.translation[0]
    placed = []
    for solid in solids:
        if abs(solid.along(time, course) - ego) > REACH:
            continue
        pose = velo_t_street @ solid.pose(time, course)
        x, y, z = (float(value) for value in pose.translation)
        yaw = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        placed.append(PlacedSolid(solid, (x, y, z), yaw))
    return sorted(placed, key=lambda one: one.distance)


def build_street(seed: int, duration: float, speed: float = COURSE.speed) -> tuple[Solid, ...]:
    """Return all objects of a drive of a duration in seconds; track ids count from 0."""
    rng = np.random.default_rng([seed, 1])
    end = speed * duration + _AHEAD
    solids = [*_traffic(rng, end, duration), *_parked(rng, end), *_people(rng, end, duration)]
    labelled = [replace(solid, track_id=track_id) for track_id, solid in enumerate(solids)]
    return (*labelled, *_buildings(rng, end), *_furniture(rng, end))


def _every(
    rng: np.random.Generator, start: float, end: float, gap: float, chance: float
) -> Iterator[float]:
    """Yield positions from about start to end, gap apart, each with a probability."""
    for x in np.arange(start + rng.uniform(0.0, gap), end, gap):
        if rng.random() < chance:
            yield float(x)


def _vehicle(rng: np.random.Generator, class_name: str) -> tuple[Look, tuple[float, float, float]]:
    length, width, height = {'Car': (4.1, 1.72, 1.5), 'Van': (4.9, 1.9, 2.0)}.get(
        class_name, (7.2, 2.4, 3.0)
    )
    stretch = rng.uniform(0.94, 1.06)
    look = Look(class_name, int(rng.integers(8)), float(rng.uniform(0.08, 0.6)))
    return look, (length * stretch, width * rng.uniform(0.97, 1.03), height)


def _traffic(rng: np.random.Generator, end: float, duration: float) -> Iterator[Solid]:
    """Make a car ahead of the ego car, and oncoming ones in the other lane."""
    look, size = _vehicle(rng, 'Car')
    yield Solid(look, size, x=19.0, lane=0.0, leads=True, class_name='Car')
    for x in _every(rng, -100.0, end + _ONCOMING_SPEED * duration, 29.0, 0.8):
        class_name = 'Van' if rng.random() < 0.2 else 'Car'
        look, size = _vehicle(rng, class_name)
        yield Solid(
            look,
            size,
            x + rng.uniform(-6, 6),
            3.5,
            turn=pi,
            speed=-_ONCOMING_SPEED,
            class_name=class_name,
        )


def _parked(rng: np.random.Generator, end: float) -> Iterator[Solid]:
    """Make rows of parked cars on both sides, trucks only on the right."""
    for lane, turn, chance in ((-3.3, 0.0, 0.55), (6.4, pi, 0.5)):
        for x in _every(rng, -_BEHIND, end, 8.4, chance):
            class_name = str(rng.choice(['Car', 'Van', 'Truck'], p=[0.84, 0.12, 0.04]))
            if class_name == 'Truck' and turn:
                class_name = 'Car'
            look, size = _vehicle(rng, class_name)
            yield Solid(
                look, size, x + rng.uniform(-0.2, 0.2), lane, turn=turn, class_name=class_name
            )


def _people(rng: np.random.Generator, end: float, duration: float) -> Iterator[Solid]:
    """Make pedestrians on four lanes of the pavements, cyclists on one."""
    spare = _CYCLING * duration
    for lane, speed in ((-7.0, _WALKING), (-7.8, -_WALKING), (9.3, _WALKING), (10.1, -_WALKING)):
        for x in _every(rng, -_BEHIND - spare, end + spare, 13.0, 0.45):
            size = (rng.uniform(0.5, 0.9), rng.uniform(0.5, 0.7), rng.uniform(1.6, 1.85))
            look = Look('Pedestrian', int(rng.integers(6)), float(rng.uniform(0.15, 0.5)))
            turn = 0.0 if speed > 0 else pi
            shift = rng.uniform(-4, 4)
            yield Solid(
                look, size, x + shift, lane, turn=turn, speed=speed, class_name='Pedestrian'
            )
    for x in _every(rng, -_BEHIND - spare, end, 31.0, 0.7):
        look = Look('Cyclist', int(rng.integers(6)), 0.3)
        yield Solid(look, (1.8, 0.62, 1.75), x, -5.3, speed=_CYCLING, class_name='Cyclist')


def _buildings(rng: np.random.Generator, end: float) -> Iterator[Solid]:
    """Make two rows of houses, some with a gap beside them; bays of 2.5 m, storeys of 3 m."""
    for face, side in ((-8.8, -1.0), (11.2, 1.0)):
        x = -_BEHIND
        while x < end:
            length = 2.5 * int(rng.integers(4, 8))
            height = 3.0 * int(rng.integers(2, 5))
            look = Look('Building', int(rng.integers(5)), float(rng.uniform(0.2, 0.4)))
            set_back = face + side * (5.0 + rng.choice([0.0, 0.0, 0.8]))
            yield Solid(look, (length, 10.0, height), x + length / 2, set_back)
            x += length + rng.choice([0.05, 0.05, 4.0])
    for x in np.arange(-_BEHIND, end, 15.0):
        for lane in (-24.0, 27.0):
            yield Solid(Look('Hedge', 0, 0.45), (14.9, 3.0, 4.5), float(x), lane)


def _furniture(rng: np.random.Generator, end: float) -> Iterator[Solid]:
    """Make trees and lamp posts between the parked cars and the pavements."""
    for lane in (-6.2, 8.3):
        for x in _every(rng, -_BEHIND, end, 11.0, 0.6):
            crown = rng.uniform(1.3, 1.6)
            yield Solid(Look('Trunk', 0, 0.25), (0.26, 0.26, 2.4), x, lane)
            yield Solid(Look('Crown', 0, 0.45), (crown, crown, rng.uniform(2, 3)), x, lane, 2.4)
        for x in np.arange(-_BEHIND, end, 33.0):
            yield Solid(Look('Post', 0, 0.6), (0.14, 0.14, 6.0), float(x), lane * 1.05)
