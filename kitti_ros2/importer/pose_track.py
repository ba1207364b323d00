# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The vehicle's pose at each frame: a track of poses -> KITTI's camera poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.geometry import Transform

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from ..rig.pose_track import Track


def camera_poses(
    track: Track, frames_ns: Int64Array, body_t_cam0: Transform
) -> list[Float64Array | None]:
    """Convert the poses of a data set's frames to those of KITTI odometry.

    Args:
        track: Poses of the body in a fixed frame.
        frames_ns: (N,) stamps, nanoseconds.
        body_t_cam0: The rectified camera 0 in the body frame.

    Returns:
        For each frame (3, 4) float64: the rectified camera 0 in that of the first frame with a
        pose, metres; None without a pose.
    """
    poses = track.at(frames_ns)
    start = next((pose for pose in poses if pose is not None), None)
    if start is None:
        return [None] * len(poses)
    # Maps may be far from their origin (UTM); subtracting first keeps all digits.
    near = Transform.from_translation(-start.translation)
    first_cam0_t_near = (near @ start @ body_t_cam0).inverse()
    return [
        None if pose is None else (first_cam0_t_near @ (near @ pose @ body_t_cam0)).matrix()[:3]
        for pose in poses
    ]
