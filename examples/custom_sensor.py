# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Write the data of a sensor of your own as a KITTI set.

python examples/custom_sensor.py OUT

Writes the object layout, which OpenPCDet, mmdetection3d and this package read, from arrays: two
frames of a made-up scanner and camera with one car.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import kitti_ros2

WIDTH, HEIGHT, FOCAL = 640, 480, 500.0
# The camera looks along x of the scanner, 10 cm below and 20 cm in front of it.
RECT_T_VELO = np.array([[0, -1, 0, 0], [0, 0, -1, -0.1], [1, 0, 0, -0.2], [0, 0, 0, 1.0]])
P2 = np.array([[FOCAL, 0, WIDTH / 2, 0], [0, FOCAL, HEIGHT / 2, 0], [0, 0, 1, 0]])


def main(out: str) -> None:
    """Write the set, and read it again."""
    root = Path(out)
    split = root / 'training'
    rig = kitti_ros2.CalibratedRig.from_matrices({2: P2}, RECT_T_VELO)
    rng = np.random.default_rng(0)
    for number in range(2):
        name = f'{number:06d}'
        # Middle x y z, length, width, height, yaw, in the scanner's frame.
        car = np.array([12.0 + number, 1.5, -0.9, 4.2, 1.7, 1.5, 0.3])
        inside = car[:3] + rng.uniform(-0.5, 0.5, (500, 3)) * car[3:6]
        ground = np.column_stack([rng.uniform([2, -20], [40, 20], (5000, 2)), np.full(5000, -1.65)])
        points = np.vstack([inside, ground])
        image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        kitti_ros2.write_scan(
            split / f'velodyne/{name}.bin', np.column_stack([points, np.full(len(points), 0.5)])
        )
        kitti_ros2.write_image(split / f'image_2/{name}.png', image)
        kitti_ros2.write_calibration(split / f'calib/{name}.txt', rig, 'object')
        label = rig.label('Car', car, (WIDTH, HEIGHT), occluded=0)
        kitti_ros2.write_labels(split / f'label_2/{name}.txt', [label])
    (root / 'ImageSets').mkdir()
    (root / 'ImageSets/train.txt').write_text('000000\n000001\n')
    for frame in kitti_ros2.open(root):
        print(frame.number, frame.objects, frame.objects[0].box.round(2))


if __name__ == '__main__':
    main(sys.argv[1])
