# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Print what is in the first frames of a recording: KITTI in 20 lines.

python examples/kitti_in_20_lines.py RECORDING

RECORDING is a KITTI folder or any bag.
"""

import sys

import kitti_ros2

recording = kitti_ros2.open(sys.argv[1])
print(recording)
for frame in recording[:3]:
    print(f'frame {frame.number} at {frame.stamp_ns / 1e9:.3f} s: {len(frame.points)} points')
    for each in frame.objects:
        if each.has_box:
            x, y, z, length, width, height, yaw = each.box
            print(
                f'  {each.class_name}: {x:.1f} m ahead, {y:.1f} m to the left, {length:.1f} m long'
            )
    if frame.calibration is not None and 'image_2' in frame.streams:
        uv, depth = frame.calibration.project(frame.points, camera=2)
        height, width, _ = frame.image(2).shape
        seen = (depth > 0) & (uv >= 0).all(axis=1) & (uv < (width, height)).all(axis=1)
        print(f'  {seen.sum()} points are in the image of camera 2')
    if frame.pose is not None:
        print(f'  the car is at {frame.pose[:3, 3].round(2)} in map')
