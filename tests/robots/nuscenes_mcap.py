# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag with the topics, schemas, frames and rates that nuscenes2mcap writes.

Source: https://github.com/foxglove/nuscenes2mcap, convert_to_mcap.py, commit 01c87d5. Its bags have
all sensors of nuScenes; the lidar's x looks to the right, boxes are in map, at 2 Hz.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import foxglove_robot as robot
import numpy as np
from mcap.writer import Writer as McapWriter

if TYPE_CHECKING:
    from pathlib import Path

    Records = list[tuple[str, int, str, dict[str, Any]]]

START_NS = 1_532_402_927_647_951_000
KEYFRAMES = 3
KEYFRAME_NS = 500_000_000
SCAN_NS = 50_000_000
SCANS_PER_KEYFRAME = KEYFRAME_NS // SCAN_NS
SIZE = (320, 180)
K = np.array([[253.2, 0, 163.25], [0, 253.2, 98.3], [0, 0, 1]])
POINT = np.dtype([(name, '<f4') for name in ('x', 'y', 'z', 'intensity', 'ring')])

BASE_T_LIDAR = robot.matrix(-np.pi / 2, (0.94, 0.0, 1.84))
"""y forward, x to the right."""

CAMERAS = {
    'cam_front': robot.matrix(0.0, (1.7, 0.0, 1.5), robot.AXES),
    'cam_front_left': robot.matrix(0.96, (1.5, 0.5, 1.5), robot.AXES),
    'cam_front_right': robot.matrix(-0.96, (1.5, -0.5, 1.5), robot.AXES),
    'cam_back': robot.matrix(3.1, (0.0, 0.0, 1.5), robot.AXES),
    'cam_back_left': robot.matrix(1.92, (1.0, 0.5, 1.5), robot.AXES),
    'cam_back_right': robot.matrix(-1.92, (1.0, -0.5, 1.5), robot.AXES),
}
"""base_T_camera, optical."""

CUBES = (
    ('vehicle.car', '31ab', (4.6, 1.9, 1.7), (12.0, 3.0, 1.0), 0.1),
    ('human.pedestrian.adult', 'e91a', (0.7, 0.7, 1.8), (9.0, -2.0, 0.9), 1.2),
    ('movable_object.trafficcone', '0c2d', (0.4, 0.4, 1.0), (7.0, 1.0, 0.5), 0.0),
)
"""Category, id, size x y z, place and yaw in map: nothing of them moves."""


@dataclass(frozen=True)
class Sweep:
    """What is true at a scan; points in the lidar's frame."""

    stamp_ns: int
    points: np.ndarray
    map_t_base: np.ndarray


def map_t_base(stamp_ns: int) -> np.ndarray:
    seconds = (stamp_ns - START_NS) / 1e9
    return robot.matrix(0.05 * seconds, (400.0 + 4.0 * seconds, 1100.0 + 0.2 * seconds, 0.0))


def cube_in_map(place: tuple[float, float, float], yaw: float) -> np.ndarray:
    return map_t_base(START_NS) @ robot.matrix(yaw, place)


def make_sweeps() -> list[Sweep]:
    rng = np.random.default_rng(23)
    sweeps = []
    for index in range((KEYFRAMES - 1) * SCANS_PER_KEYFRAME + 1):
        stamp_ns = START_NS + index * SCAN_NS
        points = np.zeros(200, POINT)
        for axis in 'xyz':
            points[axis] = rng.uniform(-1.8 if axis == 'z' else -20, 20, len(points))
        points['intensity'] = rng.integers(0, 256, len(points))
        sweeps.append(Sweep(stamp_ns, points, map_t_base(stamp_ns)))
    return sweeps


def _transform(parent: str, child: str, transform: np.ndarray, stamp_ns: int) -> dict[str, Any]:
    return {
        'timestamp': robot.time(stamp_ns),
        'parent_frame_id': parent,
        'child_frame_id': child,
        'translation': robot.vector(transform[:3, 3]),
        'rotation': robot.quaternion(transform[:3, :3]),
    }


def _ego(log_ns: int, stamp_ns: int) -> tuple[str, int, str, dict[str, Any]]:
    transform = _transform('map', 'base_link', map_t_base(stamp_ns), stamp_ns)
    return '/tf', log_ns, 'FrameTransform', transform


def _camera(name: str, log_ns: int, stamp_ns: int) -> Records:
    """An image with its calibration; P is K, no distortion."""
    image = np.full((SIZE[1], SIZE[0], 3), 60, np.uint8)
    done, data = cv2.imencode('.jpg', image)
    assert done
    head = {'timestamp': robot.time(stamp_ns), 'frame_id': name}
    projection = np.column_stack([K, np.zeros(3)]).ravel().tolist()
    size = {'width': SIZE[0], 'height': SIZE[1]}
    info = {**head, **size, 'K': K.ravel().tolist(), 'R': np.eye(3).ravel().tolist()}
    return [
        (f'/{name}/image_rect_compressed', log_ns, 'CompressedImage',
         {**head, 'format': 'jpeg', 'data': data.tobytes()}),
        (f'/{name}/camera_info', log_ns, 'CameraCalibration', {**info, 'P': projection}),
    ]  # fmt: skip


def _lidar(sweep: Sweep) -> tuple[str, int, str, dict[str, Any]]:
    fields = [
        {'name': name, 'offset': 4 * place, 'type': 7}
        for place, name in enumerate(POINT.names or ())
    ]
    cloud = {
        'timestamp': robot.time(sweep.stamp_ns),
        'frame_id': 'lidar_top',
        'point_stride': POINT.itemsize,
        'fields': fields,
        'data': sweep.points.tobytes(),
    }
    return '/lidar_top', sweep.stamp_ns, 'PointCloud', cloud


def _radar(log_ns: int) -> tuple[str, int, str, dict[str, Any]]:
    fields = [
        {'name': name, 'offset': 4 * place, 'type': 7}
        for place, name in enumerate(('x', 'y', 'z', 'rcs'))
    ]
    cloud = {'point_stride': 16, 'fields': fields, 'data': np.ones(80, '<f4').tobytes()}
    head = {'timestamp': robot.time(log_ns), 'frame_id': 'radar_front'}
    return '/radar_front', log_ns, 'PointCloud', {**head, **cloud}


def _keyframe(stamp_ns: int) -> Records:
    entities = [
        {
            'timestamp': robot.time(stamp_ns),
            'frame_id': 'map',
            'id': name,
            'frame_locked': True,
            'metadata': [{'key': 'category', 'value': category}],
            'cubes': [{'pose': robot.pose(cube_in_map(place, yaw)), 'size': robot.vector(size)}],
        }
        for category, name, size, place, yaw in CUBES
    ]
    links = [('lidar_top', BASE_T_LIDAR), *CAMERAS.items()]
    grid = {'frame_id': 'map', 'column_count': 2, 'row_stride': 2, 'cell_stride': 1}
    found: Records = [
        _ego(stamp_ns, stamp_ns),
        *(
            ('/tf', stamp_ns, 'FrameTransform', _transform('base_link', name, link, stamp_ns))
            for name, link in links
        ),
        *(
            record
            for place, name in enumerate(CAMERAS)  # logged with the scan, stamped when exposed
            for record in _camera(name, stamp_ns, stamp_ns - 30_000_000 + 5_000_000 * place)
        ),
        _radar(stamp_ns),
        ('/drivable_area', stamp_ns, 'Grid', grid),
        ('/pose', stamp_ns, 'PoseInFrame',
         {'timestamp': robot.time(stamp_ns), 'frame_id': 'base_link',
          'pose': robot.pose(np.eye(4))}),
        ('/gps', stamp_ns, 'LocationFix', {'latitude': 1.29, 'longitude': 103.78}),
        ('/markers/annotations', stamp_ns, 'SceneUpdate', {'entities': entities}),
        ('/markers/car', stamp_ns, 'SceneUpdate',
         {'entities': [{'frame_id': 'base_link', 'id': 'car', 'models': [{'url': 'car.glb'}]}]}),
        ('/cam_front/annotations', stamp_ns, 'ImageAnnotations', {}),
    ]  # fmt: skip
    for at in range(0, KEYFRAME_NS, 10_000_000):
        imu = {'linear_accel': robot.vector((0, 0, 9.8)), 'rotation_rate': robot.vector((0, 0, 0))}
        found.append(('/imu', stamp_ns + at, 'json IMU', imu))
    return found


def records(sweeps: list[Sweep]) -> Records:
    """All messages in time order; those of `json NAME` are JSON of another schema."""
    grid = {'frame_id': 'map', 'column_count': 1, 'row_stride': 4, 'cell_stride': 4}
    line = {'type': 0, 'points': [robot.vector((0, 0, 0)), robot.vector((1, 0, 0))]}
    lanes = {'entities': [{'frame_id': 'map', 'id': '0', 'lines': [line]}]}
    found: Records = [
        ('/map', START_NS, 'Grid', grid),
        ('/semantic_map', START_NS, 'SceneUpdate', lanes),
    ]
    for index, sweep in enumerate(sweeps):
        if index % SCANS_PER_KEYFRAME == 0:
            found += _keyframe(sweep.stamp_ns)
        else:
            found.append(_ego(sweep.stamp_ns, sweep.stamp_ns))
        found.append(_lidar(sweep))
    for number in range(1, 12):
        stamp_ns = START_NS + number * 83_333_000
        if number % 6:
            for name in CAMERAS:
                found += [_ego(stamp_ns, stamp_ns), *_camera(name, stamp_ns, stamp_ns)]
    return sorted(found, key=lambda record: record[1])


def write(path: Path, found: Records) -> Path:
    """Write protobuf channels, and JSON channels for the schemas that are not Foxglove's."""
    from mcap_protobuf.schema import build_file_descriptor_set  # noqa: PLC0415 - an extra

    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start()
        channels: dict[str, int] = {}
        for topic, log_ns, schema, fields in found:
            is_json = schema.startswith('json ')
            if is_json:
                data = json.dumps(fields).encode()
            else:
                message = robot.fill(robot.protobuf_type(schema)(), fields)
                data = message.SerializeToString()
            if topic not in channels:
                if is_json:
                    number = writer.register_schema(schema[5:], 'jsonschema', b'{}')
                else:
                    text = build_file_descriptor_set(type(message)).SerializeToString()
                    number = writer.register_schema(f'foxglove.{schema}', 'protobuf', text)
                encoding = 'json' if is_json else 'protobuf'
                channels[topic] = writer.register_channel(topic, encoding, number)
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()
    return path
