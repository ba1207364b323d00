# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files with the topics, schemas, frames and rates that foxglove-av2 writes for a log.

Source: https://github.com/Daniel-Alp/foxglove-av2, annotations.py, camera.py, lidar.py and pose.py,
commits 114606c, 078ebb0. Scans have no intensity and are in base_link; there is no calibration.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import foxglove_robot as robot
import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

START_NS = 315_967_376_859_506_000
FRAMES = 4
SIZE = (155, 205)
K = np.array([[168.0, 0, 77.5], [0, 168.0, 102.3], [0, 0, 1]])
BASE_T_CAMERA = robot.matrix(0.01, (1.6, 0.0, 1.4), robot.AXES)
CUBES = (
    ('REGULAR_VEHICLE', '0a7d9c1e-0000-4000-8000-1f2e3d4c5b6a', (4.5, 1.9, 1.6), (14.0, 1.5, 0.8)),
    ('PEDESTRIAN', 'c1d2e3f4-0000-4000-8000-a6b5c4d3e2f1', (0.6, 0.7, 1.7), (8.0, -1.0, 0.9)),
)
"""Category, track, size, place in base_link."""


def stamps() -> list[int]:
    return [START_NS + 100_000_000 * index for index in range(FRAMES)]


def points_of(index: int) -> np.ndarray:
    """(N, 3) in base_link."""
    rng = np.random.default_rng(index)
    return rng.uniform([-30, -30, 0], [30, 30, 4], (250, 3)).astype('<f4')


def map_t_base(stamp_ns: int) -> np.ndarray:
    share = (stamp_ns - START_NS) / 1e8
    return robot.matrix(0.01 * share, (5000.0 + 0.7 * share, -800.0 + 0.1 * share, 12.0))


def write(folder: Path) -> list[Path]:
    """The files of annotations, cameras, scans and poses."""
    fields = [{'name': name, 'offset': 4 * at, 'type': 7} for at, name in enumerate('xyz')]
    nothing = {'position': robot.vector((0, 0, 0)), 'orientation': dict.fromkeys('xyzw', 0.0)}
    scans, images, boxes, poses = [], [], [], []
    for index, stamp_ns in enumerate(stamps()):
        head = {'timestamp': robot.time(stamp_ns), 'frame_id': 'base_link'}
        data = points_of(index).tobytes()
        cloud = {**head, 'pose': nothing, 'point_stride': 12, 'fields': fields, 'data': data}
        scans.append(('/LIDAR_TOP', stamp_ns, 'PointCloud', cloud))
        entities = [
            {
                **head,
                'id': track,
                'frame_locked': True,
                'metadata': [{'key': 'category', 'value': category}],
                'cubes': [
                    {
                        'pose': robot.pose(robot.matrix(0.0, place)),
                        'size': robot.vector(size),
                        'color': {'r': 1.0, 'g': 0.65, 'b': 0.0, 'a': 0.6},
                    }
                ],
            }
            for category, track, size, place in CUBES
        ]
        deletions = [{'timestamp': robot.time(stamp_ns), 'type': 0, 'id': 'gone'}]
        scene = {'deletions': deletions, 'entities': entities}
        boxes.append(('/markers/annotations', stamp_ns, 'SceneUpdate', scene))
    for number in range(2 * FRAMES):
        stamp_ns = START_NS - 9_000_000 + 50_000_000 * number
        done, data = cv2.imencode('.jpg', np.full((SIZE[1], SIZE[0], 3), 80, np.uint8))
        assert done
        for name in ('ring_front_center', 'ring_rear_left'):  # a topic without a slash
            head = {'timestamp': robot.time(stamp_ns), 'frame_id': name}
            image = {**head, 'format': 'jpeg', 'data': data.tobytes()}
            images.append((name, stamp_ns, 'CompressedImage', image))
        for at in (stamp_ns, stamp_ns + 9_000_000):
            transform = map_t_base(at)
            link = {
                'timestamp': robot.time(at),
                'parent_frame_id': 'map',
                'child_frame_id': 'base_link',
                'translation': robot.vector(transform[:3, 3]),
                'rotation': robot.quaternion(transform[:3, :3]),
            }
            poses.append(('tf', at, 'FrameTransform', link))
    found = {'annotations': boxes, 'camera': images, 'lidar': scans, 'pose': poses}
    return [
        robot.write_protobuf(folder / f'log-{name}.mcap', records)
        for name, records in found.items()
    ]


def write_calibration(path: Path) -> Path:
    """KITTI's calibration of an object frame, as the page says to write it."""
    k = np.column_stack([K, np.zeros(3)])
    camera_t_base = np.linalg.inv(BASE_T_CAMERA)[:3]
    rows = {f'P{index}': k for index in range(4)}
    rows |= {'R0_rect': np.eye(3), 'Tr_velo_to_cam': camera_t_base, 'Tr_imu_to_velo': np.eye(4)[:3]}
    lines = [
        f'{name}: {" ".join(f"{value:.12e}" for value in each.ravel())}'
        for name, each in rows.items()
    ]
    path.write_text('\n'.join(lines) + '\n')
    return path
