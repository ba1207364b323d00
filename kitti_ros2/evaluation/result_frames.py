# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The coordinate frames of results: velo_T_frame at a frame of the recording.

The recording's own sensors are where its calibration has them. Other frames are joined to these by
the bag's transforms, static ones and those that move at the stamp of the result. If the bag lacks a
part of the tree that the player publishes, it is made from the calibration.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..bags.decoding import Decoder
from ..bags.reader import open_messages
from ..importer.guess_names import is_fixed
from ..importer.motion import LinkTracks
from ..messages.naming import FrameNames, base_t_imu, every_naming
from ..messages.transforms import static_links
from ..model.errors import MissingDataError
from ..model.geometry import Transform
from ..model.msgtypes import TF_TYPES
from ..options.messages import MessageOptions
from ..rig.link_tally import LinkTally
from ..rig.tf_tree import FrameTree

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from ..bags.reader import BagMessages, BagSource
    from ..importer.report import LossTally
    from ..model.samples import Calibration
    from ..rig.pose_track import PoseTrack
    from ..rig.tf_tree import Link

_VELO = FrameNames().velo


class ResultFrames:
    """Finds velo_T_frame of the frames of results.

    Args:
        bag: The bag of the results.
        topics: Type by topic of the bag.
        cameras: Names of the recording's cameras, by index.
        limit_ns: How far before the first or after the last transform of a moving link it is used.
        losses: Transforms that cannot be decoded are entered there.

    Attributes:
        completed: The frames for which the recording's own tree was needed.
        damage: Of the transforms, with the number of messages lost; None: unknown.
    """

    def __init__(
        self,
        bag: BagSource,
        topics: Mapping[str, str],
        cameras: Mapping[int, str],
        limit_ns: int,
        losses: LossTally,
    ) -> None:
        self._bag = bag
        self._topics = {name for name, msgtype in topics.items() if msgtype in TF_TYPES}
        self._names = [names.frames_of(cameras) for names in every_naming()]
        self._limit_ns = limit_ns
        self._losses = losses
        self._own: tuple[Calibration, list[Link], Mapping[str, Transform]] | None = None
        self.completed: set[str] = set()
        self.damage: Mapping[str, int | None] = {}

    def camera_of(self, frame: str) -> int | None:
        """Return the camera whose optical frame has a name, None if no camera's has."""
        return next(
            (
                index
                for names in self._names
                for index in names.cameras
                if names.camera(index) == frame
            ),
            None,
        )

    def velo_t(
        self, frame: str, calibration: Calibration, stamp_ns: int, scan_ns: int
    ) -> Transform:
        """Return velo_T_frame.

        Args:
            frame: Name without a leading slash.
            calibration: That of the recording at the frame.
            stamp_ns: The stamp of the result, at which a frame that moves is placed.
            scan_ns: That of the scan, at which one that stands in the world is.

        Raises:
            MissingDataError: Nothing joins the frame to the scanner.
        """
        if frame == _VELO:
            return Transform.identity()
        links, sensors = self._own_tree(calibration)
        if frame in sensors:
            return sensors[frame]
        static, tracks = self._transforms
        at_ns = scan_ns if is_fixed(frame) or _stands(frame, static, tracks) else stamp_ns
        poses = {link: _pose_at(track, at_ns, self._limit_ns) for link, track in tracks.items()}
        moved = [(*link, pose) for link, pose in poses.items() if pose is not None]
        lost = [link for link, pose in poses.items() if pose is None]
        of_bag = FrameTree([*static, *moved], lost)
        for name, velo_t_sensor in sensors.items():
            sensor_t_frame = of_bag.find(name, frame)
            if sensor_t_frame is not None:
                return velo_t_sensor @ sensor_t_frame
        placed = {link[1] for link in (*static, *moved, *lost)}
        added = [link for link in links if link[1] not in placed]
        found = FrameTree([*static, *moved, *added], lost).find(_VELO, frame)
        if found is None:
            raise MissingDataError(
                f'no transform at its stamp joins frame {frame!r} to {_VELO}; the bag has {of_bag}'
            )
        self.completed.add(frame)
        return found

    def _own_tree(self, calibration: Calibration) -> tuple[list[Link], Mapping[str, Transform]]:
        """Return the links that the player publishes, and velo_T_sensor by frame."""
        if self._own is None or self._own[0] is not calibration:
            base_t_unit = base_t_imu(MessageOptions())
            links = [static_links(calibration, base_t_unit, names) for names in self._names]
            tree = FrameTree(link for several in links for link in several)
            cameras = (names.camera(index) for names in self._names for index in names.cameras)
            found = {name: tree.find(_VELO, name) for name in (_VELO, *cameras)}
            sensors = {
                name: transform for name, transform in found.items() if transform is not None
            }
            self._own = calibration, links[0], sensors
        return self._own[1:]

    @cached_property
    def _transforms(self) -> tuple[list[Link], Mapping[tuple[str, str], PoseTrack]]:
        """The static links of the bag, and the poses over time of the others."""
        if not self._topics:
            return [], {}
        with open_messages(self._bag, self._topics) as messages:
            found = self._read_transforms(messages)
            self.damage = messages.losses
            return found

    def _read_transforms(
        self, messages: BagMessages
    ) -> tuple[list[Link], Mapping[tuple[str, str], PoseTrack]]:
        tally, links = LinkTally(), LinkTracks()
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message)
            except ValueError as error:
                self._losses.lose(message.topic, message.stamp_ns, str(error))
                continue
            still = 'static' in message.topic
            tally.add(decoded, still=still)
            if still:
                continue
            try:
                links.add(message.data, message.stamp_ns)
            except ValueError as error:
                self._losses.lose(message.topic, message.stamp_ns, str(error))
        static, moving, _ = tally.sorted()
        tracks = links.tracks()
        return static, {link: tracks[link] for link in moving if link in tracks}


def _stands(frame: str, static: Sequence[Link], moving: Collection[tuple[str, str]]) -> bool:
    """Whether no link above a frame moves."""
    above = {child: parent for parent, child, _ in static}
    moved = {child for _, child in moving}
    line = [frame]
    while line[-1] in above and above[line[-1]] not in line:
        line.append(above[line[-1]])
    return not moved.intersection(line)


def _pose_at(track: PoseTrack, stamp_ns: int, limit_ns: int) -> Transform | None:
    """Return the pose at a stamp; just before the first and after the last it is that one."""
    nearest = np.clip([stamp_ns], track.stamps_ns[0], track.stamps_ns[-1])
    if abs(int(nearest[0]) - stamp_ns) > limit_ns:
        return None
    return track.at(nearest)[0]
