# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""velo_T_frame of the frames of clouds and boxes, also of those that the vehicle moves in.

A message in map or odom is placed by the vehicle's pose at the message's own stamp: it is turned
into what the vehicle saw at that moment. For a detection that carries the stamp of the scan that it
was made of, as detectors do, this is the scan's moment exactly. One with another stamp is assigned
to the nearest frame like any other sample, and is off by what the vehicle moved in between.

Where clouds are in such a frame themselves, each is brought to the vehicle at its stamp, which may
be in the middle of a turn. Boxes go the same way: also those in a frame of the vehicle are placed
in the frame of the clouds at their own stamp, then brought to it at the stamp of the cloud.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.header import stamp_ns_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from collections.abc import Set as AbstractSet

    from ..model.geometry import Transform
    from ..rig.moving_tree import MovingTree
    from ..rig.tf_tree import FrameTree


@dataclass(frozen=True, eq=False)
class MovingBase:
    """A frame of the vehicle, and the links that join it to frames that it moves in.

    Attributes:
        frame: The frame, fixed to the vehicle.
        velo_T_frame: Its place in KITTI's velodyne frame.
        tree: The links over time; None where no message needs them.
        middle_ns: From the moment of messages to their stamps, which may be the middle of a turn.
        world: The frame of clouds that the vehicle moves in; empty where clouds are fixed to it.
    """

    frame: str
    velo_T_frame: Transform
    tree: MovingTree | None = None
    middle_ns: int = 0
    world: str = ''


class UnknownPlaceError(ValueError):
    """The place of a frame is not known at a stamp.

    Attributes:
        stamp_ns: The stamp, which differs from the log time of the message.
    """

    def __init__(self, reason: str, stamp_ns: int) -> None:
        super().__init__(reason)
        self.stamp_ns = stamp_ns


class StaticFrames(Mapping[str, 'Transform']):
    """velo_T_frame of the frames that static transforms join, computed when one is looked up.

    Args:
        tree: The static transforms.
        base: A frame of them, or one of its own.
    """

    def __init__(self, tree: FrameTree, base: MovingBase) -> None:
        self._tree = tree
        self._base = base
        self._found: dict[str, Transform | None] = {base.frame: base.velo_T_frame}

    def _find(self, frame: object) -> Transform | None:
        if not isinstance(frame, str) or (frame not in self._found and frame not in self._frames):
            return None
        if frame not in self._found:
            base_t_frame = self._tree.find(self._base.frame, frame)
            joined = None if base_t_frame is None else self._base.velo_T_frame @ base_t_frame
            self._found[frame] = joined
        return self._found[frame]

    @property
    def _frames(self) -> AbstractSet[str]:
        return self._tree.frames

    def __contains__(self, frame: object) -> bool:
        return self._find(frame) is not None

    def __getitem__(self, frame: str) -> Transform:
        found = self._find(frame)
        if found is None:
            raise KeyError(frame)
        return found

    def __iter__(self) -> Iterator[str]:
        names = self._frames | {self._base.frame}
        return (frame for frame in names if frame in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


class FramesAt(Mapping[str, 'Transform']):
    """velo_T_frame by name at a stamp; looking one up raises UnknownPlaceError if it is not known.

    Args:
        joined: Of the frames that static transforms join.
        base: For the others.
        stamp_ns: The stamp of the message.
        cloud_ns: The stamp of the cloud that the message belongs to, None for the message's moment.
    """

    def __init__(
        self,
        joined: Mapping[str, Transform],
        base: MovingBase,
        stamp_ns: int,
        cloud_ns: int | None = None,
    ) -> None:
        self._joined = joined
        self._base = base
        self._moment_ns = stamp_ns - base.middle_ns
        self._cloud_ns = self._moment_ns if cloud_ns is None or not base.world else cloud_ns

    def __contains__(self, frame: object) -> bool:
        tree = self._base.tree
        return frame in self._joined or (
            tree is not None and isinstance(frame, str) and tree.joins(self._base.frame, frame)
        )

    def __getitem__(self, frame: str) -> Transform:
        base, moment_ns = self._base, self._moment_ns
        carried = base.tree is not None and self._cloud_ns != moment_ns
        if frame in self._joined and not carried:
            return self._joined[frame]
        if base.tree is None:
            raise KeyError(frame)
        if not carried:
            return base.velo_T_frame @ _transform(base.tree, base.frame, frame, moment_ns)
        if frame in self._joined:
            base_t_frame = base.velo_T_frame.inverse() @ self._joined[frame]
            moved = _transform(base.tree, base.world, base.frame, moment_ns) @ base_t_frame
        else:
            moved = _transform(base.tree, base.world, frame, moment_ns)
        base_t_world = _transform(base.tree, base.frame, base.world, self._cloud_ns)
        return base.velo_T_frame @ base_t_world @ moved

    def __iter__(self) -> Iterator[str]:
        return iter(self._joined)

    def __len__(self) -> int:
        return len(self._joined)


def _transform(tree: MovingTree, target: str, source: str, stamp_ns: int) -> Transform:
    """Return target_T_source at a stamp.

    Raises:
        UnknownPlaceError: It is not known then.
    """
    (found,) = tree.transforms(target, source, np.array([stamp_ns], dtype=np.int64))
    if found is None:
        raise UnknownPlaceError(tree.reason(target, source, stamp_ns), stamp_ns)
    return found


def stamp_of_boxes(message: Any, stamp_ns: int | None) -> int:  # noqa: ANN401 - of the bag's types
    """Return the stamp of a message with boxes: a MarkerArray's is that of its markers, if any.

    Args:
        message: Of the bag's own types.
        stamp_ns: The stamp by which it was assigned to a frame; None for its header's.
    """
    if stamp_ns is not None:
        return stamp_ns
    if hasattr(message, 'header'):
        return stamp_ns_of(message.header)
    stamps = (stamp_ns_of(marker.header) for marker in getattr(message, 'markers', ()))
    return next(filter(None, stamps), 0)
