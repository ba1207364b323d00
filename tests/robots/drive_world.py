# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A drive with exact truth, and its messages as plain values, for robots of any rig.

The truth is in the robot's body frame: x forward, y left, z up, metres. Points and boxes of every
moment differ, so that a sample that is paired with another moment is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
import robot_bags as bags
import wanderer
from camera_rigs import K, moved, turned, xyzw

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

START_NS = wanderer.START_NS
PERIOD_NS = 100_000_000
SIZE = (320, 240)
CLEAR_M = 0.02
"""No point is nearer to a face of a box."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A box: KITTI's class, track, place in the body (4, 4) of its centre, size l w h."""

    name: str
    track: int
    place: np.ndarray
    size: tuple[float, float, float]

    def holds(self, points: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """(N,) bool: whether points of the body are within."""
        local = moved(np.linalg.inv(self.place), points)
        return (np.abs(local) <= np.array(self.size) / 2 + margin).all(axis=1)


@dataclass(frozen=True, eq=False)
class Moment:
    """What is true at a scan.

    Attributes:
        stamp_ns: Its stamp, by the clock of the computer.
        points: (N, 3) all returns, in the body, in the order of the message.
        solids: Boxes around the robot.
        world_T_body: (4, 4) of the body in the fixed frame.
    """

    stamp_ns: int
    points: np.ndarray
    solids: tuple[Solid, ...]
    world_T_body: np.ndarray


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera that a data set has: its rectified truth.

    Attributes:
        base_T_camera: (4, 4) of the optical frame.
        k: (3, 3) of the rectified images.
        size: Width and height.
    """

    base_T_camera: np.ndarray
    k: np.ndarray = field(default_factory=K.copy)
    size: tuple[int, int] = SIZE

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) of points of the body, NaN where they are not seen."""
        seen = moved(np.linalg.inv(self.base_T_camera), points)
        with np.errstate(invalid='ignore', divide='ignore'):
            pixels = (seen @ self.k.T)[:, :2] / seen[:, 2:]
        inside = (pixels >= 0).all(axis=1) & (pixels <= np.array(self.size) - 1).all(axis=1)
        return np.where((inside & (seen[:, 2] > 0.5))[:, None], pixels, np.nan)

    def sees(self, solid: Solid) -> bool:
        """Whether the centre of a box is in the image."""
        return bool(np.isfinite(self.pixels(solid.place[None, :3, 3])).all())


def pose_at(x: float, y: float, z: float, yaw_deg: float) -> np.ndarray:
    return bags.place(x, y, z, turned(yaw_deg))


def solids_at(number: int) -> tuple[Solid, ...]:
    """A car and a pedestrian ahead, whole in a front camera's view; a car behind."""
    way = 0.15 * number
    return (
        Solid('Car', 1, pose_at(10.0 + way, 1.2, 0.1, 17.0), (3.9, 1.6, 1.5)),
        Solid('Pedestrian', 2, pose_at(8.0, -2.0 + way / 3, 0.3, -40.0), (0.8, 0.6, 1.8)),
        Solid('Car', 3, pose_at(-9.5 - way, -0.7, 0.1, 100.0), (4.2, 1.7, 1.6)),
    )


@cache
def drive(frames: int = 8) -> tuple[Moment, ...]:
    """Moments of a drive on a circle, in a map that is corrected in jumps (wanderer)."""
    return tuple(_moment(number) for number in range(frames))


def _moment(number: int) -> Moment:
    rng = np.random.default_rng(100 + number)
    solids = solids_at(number)
    everywhere = rng.uniform([-20, -20, -1.5], [20, 20, 3], (900, 3))
    parts = [everywhere[np.linalg.norm(everywhere[:, :2], axis=1) > 3]]
    parts += [moved(each.place, rng.uniform(-0.5, 0.5, (50, 3)) * each.size) for each in solids]
    points = np.vstack(parts)
    clear = np.ones(len(points), dtype=bool)
    for solid in solids:
        clear &= solid.holds(points, CLEAR_M) == solid.holds(points, -CLEAR_M)
    stamp_ns = START_NS + number * PERIOD_NS
    return Moment(stamp_ns, points[clear], solids, wanderer.map_t_base(stamp_ns))


def around(moments: Iterable[Moment], pose: Callable[[int], np.ndarray]) -> tuple[Moment, ...]:
    """The moments with the poses of another fixed frame."""
    return tuple(replace(moment, world_T_body=pose(moment.stamp_ns)) for moment in moments)


# Messages as plain values.


def quaternion(rotation: np.ndarray) -> dict:
    return dict(zip('xyzw', xyzw(rotation), strict=True))


def vector(xyz: Iterable[float]) -> dict:
    return dict(zip('xyz', map(float, xyz), strict=True))


def pose(matrix: np.ndarray) -> dict:
    """A geometry_msgs/Pose of a (4, 4)."""
    return {'position': vector(matrix[:3, 3]), 'orientation': quaternion(matrix[:3, :3])}


def transforms(stamp_ns: int, *links: tuple[str, str, np.ndarray]) -> dict:
    """A TFMessage of (parent, child, parent_T_child)."""
    return {
        'transforms': [
            {
                'header': bags.header(stamp_ns, parent),
                'child_frame_id': child,
                'transform': {
                    'translation': vector(place[:3, 3]),
                    'rotation': quaternion(place[:3, :3]),
                },
            }
            for parent, child, place in links
        ]
    }


def static(stamp_ns: int, links: Iterable[tuple[str, str, np.ndarray]]) -> bags.Said:
    message = transforms(stamp_ns, *links)
    return bags.Said(bags.TF_STATIC, stamp_ns, 'tf2_msgs/msg/TFMessage', message)


def moving(
    end_ns: int, link: Callable[[int], tuple[str, str, np.ndarray]], step_ns: int = 10_000_000
) -> list[bags.Said]:
    """/tf of a link, from before the first moment to after the last."""
    stamps = range(START_NS - 203_000_000, end_ns + 200_000_000, step_ns)
    return [
        bags.Said('/tf', stamp, 'tf2_msgs/msg/TFMessage', transforms(stamp, link(stamp)))
        for stamp in stamps
    ]


def odometry(
    end_ns: int, topic: str, frames: tuple[str, str], at: Callable[[int], np.ndarray]
) -> list[bags.Said]:
    """Odometry of child in parent, 100 Hz."""
    parent, child = frames
    return [
        bags.Said(
            topic,
            stamp,
            'nav_msgs/msg/Odometry',
            {
                'header': bags.header(stamp, parent),
                'child_frame_id': child,
                'pose': {'pose': pose(at(stamp))},
                'twist': {
                    'twist': {
                        'linear': vector((wanderer.SPEED, 0, 0)),
                        'angular': vector((0, 0, wanderer.RATE)),
                    }
                },
            },
        )
        for stamp in range(START_NS - 203_000_000, end_ns + 200_000_000, 10_000_000)
    ]


_TYPES = {'f4': 7, 'f8': 8, 'u4': 6, 'u2': 4, 'u1': 2}


def cloud(stamp_ns: int, frame: str, rows: np.ndarray, height: int = 1) -> dict:
    """A PointCloud2 of a structured array."""
    names = rows.dtype.names
    offsets = rows.dtype.fields
    return {
        'header': bags.header(stamp_ns, frame),
        'height': height,
        'width': len(rows) // height,
        'fields': [
            {
                'name': name,
                'offset': offsets[name][1],
                'datatype': _TYPES[offsets[name][0].str[1:]],
                'count': 1,
            }
            for name in names
        ],
        'point_step': rows.dtype.itemsize,
        'row_step': rows.dtype.itemsize * (len(rows) // height),
        'data': np.frombuffer(rows.tobytes(), np.uint8),
        'is_dense': True,
    }


def rows_of(points: np.ndarray, *more: tuple[str, str]) -> np.ndarray:
    """A structured array x y z intensity of points, with more fields of zeros."""
    fields = [*((name, '<f4') for name in ('x', 'y', 'z', 'intensity')), *more]
    rows = np.zeros(len(points), fields)
    for name, column in zip('xyz', points.T, strict=True):
        rows[name] = column
    rows['intensity'] = 0.5
    return rows


def picture(number: int, size: tuple[int, int]) -> np.ndarray:
    """All pixels of a moment have the value 20 + 9 number."""
    return np.full((size[1], size[0], 3), 20 + 9 * number, np.uint8)


def image(topic: str, log_ns: int, stamp_ns: int, frame: str, pixels: np.ndarray) -> bags.Said:
    """An Image, or a CompressedImage (JPEG) on a topic that says so."""
    if 'compressed' in topic:
        data = cv2.imencode('.jpg', pixels)[1].ravel()
        values = {'header': bags.header(stamp_ns, frame), 'format': 'jpeg', 'data': data}
        return bags.Said(topic, log_ns, 'sensor_msgs/msg/CompressedImage', values)
    values = bags.image(stamp_ns, frame, pixels, 'bgr8')
    return bags.Said(topic, log_ns, 'sensor_msgs/msg/Image', values)


def seen(topic: str, info: str, frame: str, moment: Moment, **camera) -> list[bags.Said]:
    """The image of a moment, and its CameraInfo; camera: k, d, p, size, late_ns, number."""
    size, k = camera.get('size', SIZE), camera.get('k', K)
    number = (moment.stamp_ns - START_NS) // PERIOD_NS
    log_ns = moment.stamp_ns + camera.get('log_late_ns', 0)
    stamp_ns = moment.stamp_ns + camera.get('ahead_ns', 0)
    values = bags.camera_info(stamp_ns, frame, size, k, camera.get('d', ()))
    if 'p' in camera:
        values['p'] = np.ravel(camera['p'])
    return [
        image(topic, log_ns, stamp_ns, frame, picture(number, size)),
        bags.Said(info, log_ns, 'sensor_msgs/msg/CameraInfo', values),
    ]


def detections(moment: Moment, frame: str, frame_T_body: np.ndarray, names: dict) -> dict:
    """A Detection3DArray of the boxes, by names of the detector."""
    found = []
    for solid in moment.solids:
        centre = pose(frame_T_body @ solid.place)
        hypothesis = {'class_id': names.get(solid.name, solid.name), 'score': 1.0}
        found.append(
            {
                'header': bags.header(moment.stamp_ns, frame),
                'results': [{'hypothesis': hypothesis, 'pose': {'pose': centre}}],
                'bbox': {'center': centre, 'size': vector(solid.size)},
                'id': str(solid.track),
            }
        )
    return {'header': bags.header(moment.stamp_ns, frame), 'detections': found}


def markers(moment: Moment, frame: str, frame_T_body: np.ndarray) -> dict:
    """A MarkerArray of cubes; the namespace is the class."""
    return {
        'markers': [
            {
                'header': bags.header(moment.stamp_ns, frame),
                'ns': solid.name,
                'id': solid.track,
                'type': 1,
                'pose': pose(frame_T_body @ solid.place),
                'scale': vector(solid.size),
                'color': {'r': 1.0, 'a': 1.0},
            }
            for solid in moment.solids
        ]
    }


def tracked(moment: Moment, frame: str, frame_T_body: np.ndarray) -> dict:
    """Autoware's TrackedObjects."""
    label = {'Car': 1, 'Pedestrian': 7}
    objects = [
        {
            'object_id': {'uuid': np.full(16, solid.track, np.uint8)},
            'existence_probability': 1.0,
            'classification': [{'label': label[solid.name], 'probability': 1.0}],
            'kinematics': {'pose_with_covariance': {'pose': pose(frame_T_body @ solid.place)}},
            'shape': {'type': 0, 'dimensions': vector(solid.size)},
        }
        for solid in moment.solids
    ]
    return {'header': bags.header(moment.stamp_ns, frame), 'objects': objects}
