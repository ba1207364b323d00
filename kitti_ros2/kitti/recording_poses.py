# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a recording, and what follows from them: its start, trajectories, trails."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..model.errors import KittiRos2Error, MissingFileError, RemoteError, describe_error
from ..model.labels import Trails, cuboids_of
from ..model.recording import Start
from ..model.samples import Trajectory
from ..model.streams import Stream
from .poses import MercatorWorld, pose_from_packet
from .recording_index import RecordingIndex

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration, FrameLabels, OxtsPacket, Pose
    from ..options.read import ReadOptions

T = TypeVar('T')

_KEPT_PACKETS = 8192  # of 2 kB; the path needs all before the first is due


class RecordingPoses(RecordingIndex):
    """A recording with poses, of its oxts packets unless a layout has them in a file."""

    level_poses = True

    def __init__(self, root: Path, options: ReadOptions) -> None:
        super().__init__(root, options)
        self._packet_cached = lru_cache(_KEPT_PACKETS)(self._packet)

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame; absent parts are listed in its missing."""
        raise NotImplementedError

    @cached_property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording; see model.recording."""
        pose = self._first(Stream.POSE, self._pose)
        return None if pose is None else Start(pose.world_T_imu, self.level_poses)

    def trajectory(self, numbers: Sequence[int]) -> Trajectory:
        """Return the poses of these numbers; unreadable ones are left out and become losses."""
        stamps: list[int] = []
        poses: list[Transform] = []
        index = self.streams.get(Stream.POSE)
        if index is not None:
            stamp_of = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
            for number, pose in self.readable_poses(numbers, Stream.PATH):
                stamps.append(stamp_of[number])
                poses.append(pose.world_T_imu)
        return Trajectory(np.array(stamps, dtype=np.int64), poses)

    def readable_poses(
        self, numbers: Iterable[int], needed_for: Stream
    ) -> Iterator[tuple[int, Pose]]:
        """Yield the poses of these numbers; unreadable ones become losses of a stream."""
        for number in numbers:
            try:
                yield number, self._pose(number)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:
                self._lose_late(needed_for, describe_error(error))

    def trails(self, number: int) -> dict[int, Float64Array]:
        """Return the path of each of a frame's tracks up to it; see model.recording."""
        known = Stream.LABELS in self.streams and Stream.POSE in self.streams
        return self._trails.up_to(number) if known else {}

    @cached_property
    def _trails(self) -> Trails:
        frames = {}
        for number in self.streams[Stream.LABELS].numbers.tolist():
            calibration = self.calibration(number)
            try:
                frames[number] = cuboids_of(self._labels(number), calibration)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:
                self._lose_late(Stream.LABELS, describe_error(error))
            except ValueError as error:
                reason = next(iter(calibration.missing.values()), str(error))
                self._lose_late(Stream.LABELS, f'{reason}; it is needed for the 3D boxes of labels')
        return Trails(frames, self._world_t_velo)

    def _world_t_velo(self, number: int) -> Transform | None:
        """Return the scanner's pose at a frame, None without a readable pose of this number."""
        if number not in self._posed:
            return None
        try:
            pose = self._pose(number)
        except RemoteError:
            raise
        except (KittiRos2Error, OSError) as error:
            self._lose_late(Stream.LABELS, describe_error(error))
            return None
        return pose.world_T_imu @ self.calibration(number).velo_T_imu.inverse()

    @cached_property
    def _posed(self) -> frozenset[int]:
        return frozenset(self.streams[Stream.POSE].numbers.tolist())

    def _first(self, stream: Stream, read: Callable[[int], T]) -> T | None:
        """Return the first readable sample of a stream, None without one.

        The poses begin there: if it is not the first, all differ, which is reported as a loss.
        """
        index = self.streams.get(stream)
        failure = ''
        for number in () if index is None else index.numbers.tolist():
            try:
                sample = read(number)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:
                failure = failure or describe_error(error)
                continue
            if failure:
                self._lose_late(Stream.POSE, f'{failure}; map begins at frame {number} instead')
            return sample
        if failure:
            self._lose_late(Stream.POSE, failure)
        return None

    def _pose(self, number: int) -> Pose:
        return pose_from_packet(self._packet_cached(number), self._world)

    @cached_property
    def _world(self) -> MercatorWorld:
        """The fixed frame of the poses, at the first readable oxts packet."""
        packet = self._first(Stream.OXTS, self._packet_cached)
        if packet is None:
            needed_for = 'the origin of the map: not one oxts packet is readable'
            raise MissingFileError(self.root, needed_for)
        return MercatorWorld.at(packet)

    def _packet(self, number: int) -> OxtsPacket:
        raise NotImplementedError

    def _labels(self, number: int) -> FrameLabels:
        raise NotImplementedError
