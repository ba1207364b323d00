# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag with the topics, schemas and frames that waymo2mcap writes of a segment.

Source: https://github.com/scflow/waymo2mcap, waymo_to_mcap.py and converter/, commit ddcff23. The
axes of its frames of cameras are Waymo's, x forward; a page of the documentation says how to change
them to optical ones, which CameraInfo is for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import foxglove_robot as robot
import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

START_NS = 1_550_083_467_346_370_000
FRAMES = 4
SIZE = (480, 320)
K = np.array([[515.0, 0, 238.5], [0, 516.0, 160.75], [0, 0, 1]])
D = (0.02, -0.08, 0.0005, -0.0003, 0.0)
CAMERAS = {
    'FRONT': robot.matrix(0.01, (1.54, 0.0, 2.1)),
    'FRONT_LEFT': robot.matrix(0.8, (1.5, 0.1, 2.1)),
    'SIDE_RIGHT': robot.matrix(-1.57, (1.4, -0.1, 2.1)),
}
"""base_T_camera with x forward, y left, z up."""

CUBES = (
    ('Car', 'nA7', (4.6, 2.0, 1.7), (16.0, 2.0, 0.9), 0.3),
    ('Ped', 'qB2', (0.8, 0.8, 1.75), (10.0, -1.5, 0.9), 0.0),
)
"""Text, label id, size, place in base_link, heading."""

DOTS = np.array(
    [[9.0, y, 0.8] for y in (-1.5, 0.2, 2.0)] + [[13.0, y, 2.9] for y in (-2.0, 1.0, 3.0)]
)
"""White dots in base_link."""


def stamps() -> list[int]:
    return [START_NS + 100_000_000 * index for index in range(FRAMES)]


def points_of(index: int) -> np.ndarray:
    """(N, 5) x, y, z in base_link, intensity, elongation."""
    rng = np.random.default_rng(index + 50)
    points = rng.uniform(-30, 30, (300, 5))
    points[:, 3] = rng.uniform(0, 1, len(points))
    return points.astype('<f4')


def world_t_base(stamp_ns: int) -> np.ndarray:
    share = (stamp_ns - START_NS) / 1e8
    return robot.matrix(0.02 * share, (-2000.0 + 0.9 * share, 300.0, 20.0))


def base_t_optical(name: str) -> np.ndarray:
    axes = np.eye(4)
    axes[:3, :3] = robot.AXES
    return CAMERAS[name] @ axes


def pixels_of(points: np.ndarray) -> np.ndarray:
    """(N, 2) where FRONT would see points of base_link without its lens's distortion."""
    homogeneous = np.column_stack([points, np.ones(len(points))])
    seen = (np.linalg.inv(base_t_optical('FRONT')) @ homogeneous.T)[:3].T @ K.T
    return seen[:, :2] / seen[:, 2:]


def _jpeg(name: str) -> bytes:
    image = np.full((SIZE[1], SIZE[0], 3), 20, np.uint8)
    if name == 'FRONT':
        homogeneous = np.column_stack([DOTS, np.ones(len(DOTS))])
        seen = (np.linalg.inv(base_t_optical(name)) @ homogeneous.T)[:3].T
        pixels, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, np.array(D))
        for u, v in pixels[:, 0]:
            cv2.circle(image, (round(u * 16), round(v * 16)), 64, (255,) * 3, -1, cv2.LINE_AA, 4)
    done, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 97])
    assert done
    return data.tobytes()


def records(*, optical: bool) -> list[tuple[str, int, str, dict[str, Any]]]:
    """All messages.

    Args:
        optical: Whether the frames of cameras were changed to optical ones.
    """
    found: list[tuple[str, int, str, dict[str, Any]]] = []
    images = {name: _jpeg(name) for name in CAMERAS}
    names = ('x', 'y', 'z', 'intensity', 'elongation')
    fields = [{'name': name, 'offset': 4 * at, 'type': 7} for at, name in enumerate(names)]
    for index, stamp_ns in enumerate(stamps()):
        stamp = {'timestamp': robot.time(stamp_ns)}
        moved = world_t_base(stamp_ns)
        links = [('world', 'base_link', moved)]
        links += [
            ('base_link', f'camera_{name}', base_t_optical(name) if optical else link)
            for name, link in CAMERAS.items()
        ]
        links.append(('base_link', 'laser_TOP', robot.matrix(2.6, (1.43, 0.0, 2.18))))
        transforms = [
            {
                **stamp,
                'parent_frame_id': parent,
                'child_frame_id': child,
                'translation': robot.vector(link[:3, 3]),
                'rotation': robot.quaternion(link[:3, :3]),
            }
            for parent, child, link in links
        ]
        world = {**stamp, 'frame_id': 'world'}
        place = {'pose': robot.pose(moved)}
        body = {**stamp, 'frame_id': 'base_link'}
        car = {
            'size': robot.vector((5, 2, 1.8)),
            'pose': robot.pose(robot.matrix(0, (1.4, 0, 0.9))),
        }
        entities = [
            {
                **body,
                'id': f'box3d_{label}_{number}',
                'cubes': [{'size': robot.vector(size), 'pose': robot.pose(robot.matrix(turn, at))}],
                'lines': [{'type': 2, 'points': [robot.vector(at), robot.vector(at)]}],
                'texts': [{'text': text, 'billboard': True}],
            }
            for number, (text, label, size, at, turn) in enumerate(CUBES)
        ]
        boxes = {'deletions': [{**stamp, 'type': 1}], 'entities': entities}
        cloud = {'point_stride': 20, 'fields': fields, 'data': points_of(index).tobytes()}
        messages: list[tuple[str, str, dict[str, Any]]] = [
            ('/tf', 'FrameTransforms', {'transforms': transforms}),
            ('/ego_pose', 'PoseInFrame', {**world, **place}),
            ('/odometry', 'Odometry', {**world, 'body_frame_id': 'base_link', **place}),
            ('/perception/ego_vehicle', 'SceneUpdate',
             {'entities': [{**body, 'id': 'ego_vehicle_body', 'cubes': [car]}]}),
            ('/ego_path', 'PosesInFrame', {**world, 'poses': [place['pose']]}),
            ('/lidar/points', 'PointCloud', {**body, **cloud}),
            ('/perception/boxes_3d', 'SceneUpdate', boxes),
        ]  # fmt: skip
        projection = np.column_stack([K, np.zeros(3)])
        for name, data in images.items():
            head = {**stamp, 'frame_id': f'camera_{name}'}
            calibration = {
                **head,
                'width': SIZE[0],
                'height': SIZE[1],
                'distortion_model': 'plumb_bob',
                'D': list(D),
                'K': K.ravel().tolist(),
                'R': np.eye(3).ravel().tolist(),
                'P': projection.ravel().tolist(),
            }
            image = {**head, 'format': 'jpeg', 'data': data}
            messages.append((f'/camera/{name}/compressed', 'CompressedImage', image))
            messages.append((f'/camera/{name}/calibration', 'CameraCalibration', calibration))
            messages.append((f'/camera/{name}/annotations', 'ImageAnnotations', {}))
        found += [(topic, stamp_ns, schema, message) for topic, schema, message in messages]
    return found


def write(path: Path, *, optical: bool = True) -> Path:
    return robot.write_protobuf(path, records(optical=optical))
