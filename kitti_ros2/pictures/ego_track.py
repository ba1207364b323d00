# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a bag not written by to-bag, as the odometry layout would be made from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..importer.guess_pose import guess_pose
from ..importer.poses import read_track
from ..importer.report import LossTally
from ..model.errors import KittiRos2Error
from ..model.samples import Trajectory

if TYPE_CHECKING:
    from ..bags.reader import BagSource
    from ..importer.survey import Survey
    from ..model.geometry import Transform
    from ..rig.pose_track import Track


class EgoTrack(NamedTuple):
    """Poses, and the frame that they are of."""

    track: Track
    body: str

    def trajectory(self, body_T_imu: Transform) -> Trajectory:
        """Return all poses, of the unit instead of the body."""
        stamps_ns = self.track.stamps_ns
        poses = [pose @ body_T_imu for pose in self.track.at(stamps_ns) if pose is not None]
        return Trajectory(stamps_ns, poses)


def ego_track(bag: BagSource, survey: Survey, notes: list[str]) -> EgoTrack | None:
    """Read the poses that the odometry layout would be made from, if any."""
    pose, losses = guess_pose(survey, []), LossTally()
    if pose is None:
        return None
    try:
        track = read_track([bag], pose, survey, losses)
    except KittiRos2Error as error:
        notes.append(str(error))
        return None
    notes.extend(f'{loss.stream}: {loss.text()}' for loss in losses.losses())
    return EgoTrack(track, pose.body)
