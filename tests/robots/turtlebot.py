# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An indoor robot: a colour and a depth camera, a scanner with one ring, map -> odom -> base.

The world is a wall that is not parallel to the image, seen by plain rays.
"""

from __future__ import annotations

import cv2
import numpy as np
import robot_bags as bags

START_NS = 1_700_000_100_000_000_000
FRAMES = 6
PERIOD_NS = 100_000_000
SIZE = (160, 120)
K = np.array([[130.0, 0, 79.0], [0, 131.0, 60.5], [0, 0, 1]])
D = (0.1, -0.2, 0.001, -0.0005, 0.03)
BASE_T_CAMERA = bags.place(0.08, 0.01, 0.25, bags.about_z(0.05))
CAMERA_T_OPTICAL = bags.place(0, 0, 0, bags.OPTICAL)
BASE_T_RING = bags.place(-0.03, 0.0, 0.18, bags.about_z(np.pi / 2))
NORMAL = np.array([0.2, -0.1, 1.0])
WALL_M = 2.5
RAYS = 360


def depth_m(frame: int) -> np.ndarray:
    """(H, W) z of the wall along the ray of each pixel, NaN in a corner: float64 metres."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(K).T
    found = (WALL_M + 0.05 * frame) / (rays @ NORMAL)
    found[:10, :20] = np.nan
    return found


def optical_points(metres: np.ndarray) -> np.ndarray:
    """(N, 3) of a depth image without distortion, in the order of its pixels."""
    v, u = np.nonzero(np.isfinite(metres))
    z = metres[v, u]
    return np.column_stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z])


def millimetres(metres: np.ndarray) -> np.ndarray:
    return np.round(np.nan_to_num(metres) * 1000).astype(np.uint16)


def compressed_millimetres(metres: np.ndarray) -> np.ndarray:
    """As compressed_depth_image_transport: 12 bytes (format 0), then a PNG."""
    png = cv2.imencode('.png', millimetres(metres))[1].tobytes()
    return np.frombuffer(bytes(12) + png, np.uint8)


def compressed_inverse(metres: np.ndarray, a: float = 800.0, b: float = 20.0) -> np.ndarray:
    """The same of 32FC1: the quantised inverse depth, value = a / depth + b."""
    values = np.nan_to_num(np.round(a / metres + b)).astype(np.uint16)
    head = (0).to_bytes(4, 'little') + np.array([a, b], '<f4').tobytes()
    return np.frombuffer(head + cv2.imencode('.png', values)[1].tobytes(), np.uint8)


def ring() -> tuple[np.ndarray, np.ndarray]:
    """(ranges, points): some NaN, infinite, too near or too far; in the ring's frame."""
    angles = -np.pi + np.arange(RAYS) * (2 * np.pi / RAYS)
    ranges = 3 + np.sin(3 * angles)
    ranges[5], ranges[6], ranges[7], ranges[8], ranges[9] = np.nan, np.inf, 0.0, 0.05, 31.0
    kept = np.setdiff1d(np.arange(RAYS), [5, 6, 7, 8, 9])
    seen = ranges[kept, None] * np.column_stack([np.cos(angles), np.sin(angles)])[kept]
    return ranges, np.column_stack([seen, np.zeros(len(seen))])


def laser_scan(stamp_ns: int, **changed) -> dict:
    ranges, _ = ring()
    return {
        'header': bags.header(stamp_ns, 'base_scan'),
        'angle_min': -np.pi,
        'angle_max': np.pi,
        'angle_increment': 2 * np.pi / RAYS,
        'range_min': 0.12,
        'range_max': 30.0,
        'ranges': ranges,
        'intensities': np.arange(RAYS) / 2.0,
        **changed,
    }


def odom_T_base(frame: int) -> np.ndarray:
    return bags.place(0.1 * frame, 0.02 * frame, 0, bags.about_z(0.03 * frame))


def said(
    depth: str = '16UC1',
    *,
    scans: bool = True,
    lens: bool | tuple[float, ...] = False,
    odometry: bool = True,
) -> list[bags.Said]:
    """The messages: depth is 16UC1, 32FC1, mm (compressedDepth) or inverse (the same of 32FC1)."""
    found = [
        bags.Said(bags.TF_STATIC, START_NS - 1, 'tf2_msgs/msg/TFMessage', {'transforms': _links()})
    ]
    d = lens if isinstance(lens, tuple) else D if lens else ()
    for frame in range(FRAMES):
        stamp = START_NS + frame * PERIOD_NS
        rgb = np.full((SIZE[1], SIZE[0], 3), 40 + 30 * frame, np.uint8)
        info = bags.camera_info(stamp, 'camera_optical_frame', SIZE, K, d)
        for topic, kind, values in (
            ('color/image_raw', 'Image', bags.image(stamp, 'camera_optical_frame', rgb, 'rgb8')),
            ('color/camera_info', 'CameraInfo', info),
            ('depth/camera_info', 'CameraInfo', info),
        ):
            found.append(bags.Said(f'/camera/{topic}', stamp, f'sensor_msgs/msg/{kind}', values))
        found.append(_depth(stamp, depth_m(frame), depth))
        if scans:
            found.append(bags.Said('/scan', stamp, 'sensor_msgs/msg/LaserScan', laser_scan(stamp)))
        if odometry:
            moved = bags.transform('odom', 'base_footprint', odom_T_base(frame), stamp)
            found.append(bags.Said('/tf', stamp, 'tf2_msgs/msg/TFMessage', {'transforms': [moved]}))
    return found


def _links() -> list[dict]:
    return [
        bags.transform('base_footprint', 'base_link', bags.place(0, 0, 0.01)),
        bags.transform('base_link', 'camera_link', BASE_T_CAMERA),
        bags.transform('camera_link', 'camera_optical_frame', CAMERA_T_OPTICAL),
        bags.transform('base_link', 'base_scan', BASE_T_RING),
    ]


def _depth(stamp: int, metres: np.ndarray, kind: str) -> bags.Said:
    frame = 'camera_optical_frame'
    if kind in {'mm', 'inverse'}:
        data = compressed_millimetres(metres) if kind == 'mm' else compressed_inverse(metres)
        form = f'{"16UC1" if kind == "mm" else "32FC1"}; compressedDepth png'
        values = {'header': bags.header(stamp, frame), 'format': form, 'data': data}
        topic = '/camera/depth/image_raw/compressedDepth'
        return bags.Said(topic, stamp, 'sensor_msgs/msg/CompressedImage', values)
    pixels = millimetres(metres) if kind == '16UC1' else metres.astype(np.float32)
    values = bags.image(stamp, frame, pixels, kind)
    return bags.Said('/camera/depth/image_raw', stamp, 'sensor_msgs/msg/Image', values)
