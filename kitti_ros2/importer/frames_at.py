# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""velo_T_frame of the frames of clouds and boxes, also of those that the vehicle moves in.

Boxes in map or odom stand in the world: they are placed by the vehicle's pose at the stamp of the
scan that they are assigned to, so that a parked car lies on its points whatever the stamp of its
box. Detectors give their output the stamp of the scan that it was made of, which may be the start
of a turn while the scan is stamped in the middle; their boxes came into the world by the pose at
that stamp, and are brought back by it. Boxes in a frame that moves are placed at their own stamp.

Where clouds are in such a frame themselves, each is brought to the vehicle at its stamp, which may
be in the middle of a turn. Boxes go the same way: also those in a frame of the vehicle are placed
in the frame of the clouds at their own stamp, then brought to it at the stamp of the cloud.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..messages.header import stamp_ns_of
from .guess_names import is_fixed

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
        world: The frame of clouds that the vehicle moves in; empty where clouds are fixed to it.
    """

    frame: str
    velo_T_frame: Transform
    tree: MovingTree | None = None
    world: str = ''


class BoxTimes(NamedTuple):
    """When the boxes of a message are placed.

    Attributes:
        own_ns: The stamp of the message.
        scan_ns: That of its scan, which may be the middle of a turn; None for the message's own.
        moved_ns: The way there from the stamp of the scan's header, if the message has this stamp.
    """

    own_ns: int
    scan_ns: int | None = None
    moved_ns: int = 0


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
        times: When the message and its scan are placed.
    """

    def __init__(self, joined: Mapping[str, Transform], base: MovingBase, times: BoxTimes) -> None:
        self._joined = joined
        self._base = base
        self._own_ns = self._scan_ns = times.own_ns
        if times.scan_ns is not None:
            self._scan_ns = times.scan_ns - (0 if base.world else times.moved_ns)

    def __contains__(self, frame: object) -> bool:
        tree = self._base.tree
        return frame in self._joined or (
            tree is not None and isinstance(frame, str) and tree.joins(self._base.frame, frame)
        )

    def __getitem__(self, frame: str) -> Transform:
        base, scan_ns, own_ns = self._base, self._scan_ns, self._own_ns
        carried = base.world and base.tree is not None and scan_ns != own_ns
        if frame in self._joined and not carried:
            return self._joined[frame]
        if base.tree is None:
            raise KeyError(frame)
        if frame in self._joined:
            top = base.world
            base_t_frame = base.velo_T_frame.inverse() @ self._joined[frame]
            top_t_frame = _transform(base.tree, top, base.frame, own_ns) @ base_t_frame
        else:
            stands = is_fixed(frame)
            top = base.world if carried and not stands else base.tree.common(base.frame, frame)
            top_t_frame = _transform(base.tree, top, frame, scan_ns if stands else own_ns)
        return base.velo_T_frame @ _transform(base.tree, base.frame, top, scan_ns) @ top_t_frame

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


def stamp_of_boxes(message: Any) -> int:  # noqa: ANN401 - of the bag's types
    """Return the stamp of a message with boxes: a MarkerArray's is that of its markers, if any."""
    if hasattr(message, 'header'):
        return stamp_ns_of(message.header)
    stamps = (stamp_ns_of(marker.header) for marker in getattr(message, 'markers', ()))
    return next(filter(None, stamps), 0)
