# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A car with a scanner, a camera and detectors: boxes in 3D, in the image, and as markers."""

from __future__ import annotations

import cv2
import numpy as np
import robot_bags as bags

START_NS = 1_690_000_000_000_000_000
FRAMES = 4
PERIOD_NS = 100_000_000
SIZE = (640, 360)
K = np.array([[500.0, 0, 320.0], [0, 500.0, 180.0], [0, 0, 1]])
LIDAR_T_CAMERA = bags.place(0.3, 0.0, -0.2, bags.OPTICAL)

SOLID = (
    ('Car', 'a', (12.0, 2.0, -0.9), (4.0, 1.8, 1.5)),
    ('Car', '', (20.0, -3.0, -0.9), (4.2, 1.7, 1.4)),
    ('Pedestrian', 'c', (9.0, -2.0, -0.8), (0.6, 0.7, 1.8)),
)
"""Class, id, place and size of the boxes, in the frame of the scanner, heading ahead."""


def projected(place, size) -> np.ndarray:
    """left, top, right, bottom of a box in the image, unclipped."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T / 2
    corners = np.array(place) + signs * size
    camera_t_lidar = np.linalg.inv(LIDAR_T_CAMERA)
    seen = (corners @ camera_t_lidar[:3, :3].T + camera_t_lidar[:3, 3]) @ K.T
    pixels = seen[:, :2] / seen[:, 2:]
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def flat_boxes() -> list[tuple[str, str, np.ndarray]]:
    """Class, id and box of the 2D detector: by id far off, by overlap, and one that is alone."""
    return [
        ('Car', 'a', projected(*SOLID[0][2:]) + np.array([40, 30, 45, 35])),
        ('Car', '77', projected(*SOLID[1][2:]) + np.array([1, -1, 2, 1.5])),
        ('Cyclist', '', np.array([50.0, 60, 90, 120])),
    ]


def points() -> np.ndarray:
    return np.random.default_rng(2).uniform([5, -8, -2], [40, 8, 2], (300, 3)).astype(np.float32)


def cloud(stamp_ns: int) -> dict:
    names = ('x', 'y', 'z')
    return {
        'header': bags.header(stamp_ns, 'lidar'),
        'height': 1,
        'width': 300,
        'fields': [
            {'name': name, 'offset': 4 * n, 'datatype': 7, 'count': 1}
            for n, name in enumerate(names)
        ],
        'point_step': 12,
        'row_step': 3600,
        'data': points().reshape(-1).view(np.uint8),
    }


def solid_message(stamp_ns: int) -> dict:
    return {
        'header': bags.header(stamp_ns, 'lidar'),
        'detections': [
            {
                'header': bags.header(stamp_ns, 'lidar'),
                'results': [{'hypothesis': {'class_id': kind, 'score': 1.0}}],
                'bbox': {
                    'center': bags.pose(bags.place(*place)),
                    'size': dict(zip('xyz', size, strict=True)),
                },
                'id': identity,
            }
            for kind, identity, place, size in SOLID
        ],
    }


def flat_message(stamp_ns: int, frame: str = 'camera_optical') -> dict:
    return {
        'header': bags.header(stamp_ns, frame),
        'detections': [
            {
                'header': bags.header(stamp_ns, frame),
                'results': [{'hypothesis': {'class_id': kind, 'score': 1.0}}],
                'bbox': {
                    'center': {
                        'position': {'x': (box[0] + box[2]) / 2, 'y': (box[1] + box[3]) / 2}
                    },
                    'size_x': box[2] - box[0],
                    'size_y': box[3] - box[1],
                },
                'id': identity,
            }
            for kind, identity, box in flat_boxes()
        ],
    }


def autoware_message(stamp_ns: int, *, tracked: bool) -> dict:
    """DetectedObjects or TrackedObjects of the boxes: labels of Autoware, tracks by UUID."""
    label = {'Car': 1, 'Pedestrian': 7}
    objects = []
    for n, (kind, _, place, size) in enumerate(SOLID):
        found = {
            'existence_probability': 1.0,
            'classification': [{'label': label[kind], 'probability': 1.0}],
            'kinematics': {'pose_with_covariance': {'pose': bags.pose(bags.place(*place))}},
            'shape': {'type': 0, 'dimensions': dict(zip('xyz', size, strict=True))},
        }
        if tracked:
            found['object_id'] = {'uuid': np.full(16, n + 1, np.uint8)}
        objects.append(found)
    return {'header': bags.header(stamp_ns, 'lidar'), 'objects': objects}


def marker_messages(stamp_ns: int) -> list[dict]:
    """An array a class; one without a marker."""
    found = []
    for kind in ('Car', 'Cyclist', 'Pedestrian'):
        cubes = [
            {
                'header': bags.header(stamp_ns, 'lidar'),
                'ns': kind,
                'id': n,
                'type': 1,
                'pose': bags.pose(bags.place(*place)),
                'scale': dict(zip('xyz', size, strict=True)),
                'color': {'r': 1.0, 'a': 1.0},
            }
            for n, (own, _, place, size) in enumerate(SOLID)
            if own == kind
        ]
        found.append({'markers': cubes})
    return found


def picture(frame: int, encoding: str) -> np.ndarray:
    """Pixels of an encoding: a ramp with all its bits, or a colour."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    ramp = (u * 90 + v * 17 + 300 * frame).astype(np.uint16)
    if encoding == 'mono16' or encoding.startswith('bayer'):
        return ramp
    return np.stack([ramp, ramp[::-1], ramp[:, ::-1]], -1)


def said(
    kinds: set[str], encoding: str = 'rgb8', flat_frame: str = 'camera_optical'
) -> list[bags.Said]:
    """Messages; kinds of boxes: solid, flat, markers. encoding may be webp.

    camera_link is the camera's frame with x forward, and base_link another place.
    """
    links = [
        bags.transform('base_link', 'lidar', bags.place(0.0, 0.0, 1.7)),
        bags.transform('lidar', 'camera_link', bags.place(0.3, 0.0, -0.2)),
        bags.transform('camera_link', 'camera_optical', bags.place(0.0, 0.0, 0.0, bags.OPTICAL)),
    ]
    found = [
        bags.Said(bags.TF_STATIC, START_NS - 1, 'tf2_msgs/msg/TFMessage', {'transforms': links})
    ]
    for frame in range(FRAMES):
        stamp = START_NS + frame * PERIOD_NS
        found += [
            bags.Said('/points', stamp, 'sensor_msgs/msg/PointCloud2', cloud(stamp)),
            _image(stamp, frame, encoding),
            bags.Said(
                '/camera/camera_info',
                stamp,
                'sensor_msgs/msg/CameraInfo',
                bags.camera_info(stamp, 'camera_optical', SIZE, K),
            ),
        ]
        if 'solid' in kinds:
            message = solid_message(stamp)
            found.append(bags.Said('/boxes', stamp, 'vision_msgs/msg/Detection3DArray', message))
        if 'flat' in kinds:
            message = flat_message(stamp, flat_frame)
            found.append(bags.Said('/boxes_2d', stamp, 'vision_msgs/msg/Detection2DArray', message))
        for word, name in (('tracked', 'TrackedObjects'), ('detected', 'DetectedObjects')):
            if word in kinds:
                message = autoware_message(stamp, tracked=word == 'tracked')
                msgtype = f'autoware_perception_msgs/msg/{name}'
                found.append(bags.Said('/objects', stamp, msgtype, message))
        if 'markers' in kinds:
            found += [
                bags.Said(
                    '/markers',
                    stamp + 30_000_000 * n,
                    'visualization_msgs/msg/MarkerArray',
                    message,
                )
                for n, message in enumerate(marker_messages(stamp))
            ]
    return found


def _image(stamp: int, frame: int, encoding: str) -> bags.Said:
    if encoding == 'webp':
        pixels = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        pixels[100:200, 50:300] = (20, 200, 90)
        data = cv2.imencode('.webp', pixels, [cv2.IMWRITE_WEBP_QUALITY, 101])[1].ravel()
        values = {'header': bags.header(stamp, 'camera_optical'), 'format': 'webp', 'data': data}
        topic = '/camera/image/compressed'
        return bags.Said(topic, stamp, 'sensor_msgs/msg/CompressedImage', values)
    pixels = picture(frame, encoding)
    if '16' not in encoding:
        pixels = (pixels >> 8).astype(np.uint8)
    values = bags.image(stamp, 'camera_optical', pixels, encoding)
    return bags.Said('/camera/image', stamp, 'sensor_msgs/msg/Image', values)
