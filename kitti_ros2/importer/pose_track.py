# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The vehicle's pose at each frame: a track of poses -> KITTI's camera poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

MAX_GAP_NS = NS_PER_S + NS_PER_S // 2
"""Poses once a second, unevenly, still make a track. Further apart they say little of what was
between: in a bend of 0.2 rad/s at 10 m/s the straight line of these 1.5 s is 0.6 m off."""


class PoseTrack:
    """Poses of one frame in another over time, interpolated.

    Between two poses the translation is linear and the rotation is spherical linear (slerp).
    Nothing is extrapolated.
    """

    def __init__(
        self,
        stamps_ns: npt.ArrayLike,
        transforms: Sequence[Transform],
        max_gap_ns: int = MAX_GAP_NS,
    ) -> None:
        """Take poses in any order; of several with one stamp the first is used.

        Args:
            stamps_ns: (N,) nanoseconds.
            transforms: N of them.
            max_gap_ns: Between two poses further apart no pose is known.

        Raises:
            ValueError: The numbers of stamps and transforms differ.
        """
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        if stamps.shape != (len(transforms),):
            raise ValueError(f'{len(transforms)} poses with stamps of shape {stamps.shape}')
        self.stamps_ns, first = np.unique(stamps, return_index=True)
        self._transforms = [transforms[index] for index in first]
        self._max_gap_ns = max_gap_ns

    def __len__(self) -> int:
        return len(self._transforms)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose at each of (M,) stamps; None before, after, and in too large a gap."""
        if not self._transforms:
            return [None] * len(stamps_ns)
        wanted = np.asarray(stamps_ns, dtype=np.int64)
        after = np.searchsorted(self.stamps_ns, wanted)
        known = after < len(self)
        after[~known] = 0
        exact = known & (self.stamps_ns[after] == wanted)
        before = np.maximum(after - 1, 0)
        gaps = self.stamps_ns[after] - self.stamps_ns[before]
        between = known & (after > 0) & (gaps <= self._max_gap_ns) & ~exact
        share = (wanted - self.stamps_ns[before]) / np.maximum(gaps, 1)
        poses: list[Transform | None] = [None] * len(wanted)
        for index in np.flatnonzero(exact).tolist():
            poses[index] = self._transforms[after[index]]
        for index in np.flatnonzero(between).tolist():
            pair = self._transforms[before[index]], self._transforms[after[index]]
            poses[index] = interpolate(*pair, float(share[index]))
        return poses


def interpolate(start: Transform, end: Transform, share: float) -> Transform:
    """Interpolate between start (share 0) and end (share 1): linear, and slerp."""
    q_start, q_end = start.quaternion(), end.quaternion()
    if q_start @ q_end < 0:
        q_end = -q_end
    # Not the arc cosine of the product: it is precise to 1e-8 only for small angles.
    angle = 2 * np.arctan2(np.linalg.norm(q_end - q_start), np.linalg.norm(q_end + q_start))
    quaternion = _sine_share(1 - share, angle) * q_start + _sine_share(share, angle) * q_end
    step = end.translation - start.translation
    return Transform.from_quaternion(quaternion, start.translation + share * step)


def _sine_share(share: float, angle: float) -> float:
    """Return sin(share * angle) / sin(angle), also for an angle of 0."""
    return float(share * np.sinc(share * angle / np.pi) / np.sinc(angle / np.pi))


def camera_poses(
    track: PoseTrack, frames_ns: Int64Array, body_t_cam0: Transform
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
