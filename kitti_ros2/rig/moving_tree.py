# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The TF tree at any stamp: static links, and moving links interpolated between their transforms.

As in tf2, each link of a chain is interpolated by itself at the requested stamp (linear, and slerp
of the rotation), then the links are composed. Unlike tf2, nothing is known in a large gap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import MissingDataError
from ..model.geometry import Transform
from ..model.stamps import NS_PER_S
from .pose_track import MAX_GAP_NS
from .tf_tree import FrameTree, plain

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy.typing as npt

    from ..model.samples import Int64Array
    from .pose_track import Track
    from .tf_tree import Link, Step


class MovingTree:
    """Frames, and the links between them over time.

    Attributes:
        links: The tree without the transforms of its moving links.
    """

    def __init__(
        self, static: Iterable[Link], moving: Mapping[tuple[str, str], Track], lost: str = ''
    ) -> None:
        """Take links in any order.

        Args:
            static: Links that do not move.
            moving: The others, by (parent, child): parent_T_child over time.
            lost: The part that may be missing, and why.
        """
        self._tracks = {
            (plain(above), plain(below)): moving[above, below] for above, below in moving
        }
        self.links = FrameTree(static, self._tracks, lost)

    def joins(self, target: str, source: str) -> bool:
        """Whether links join two frames, at some stamps at least."""
        try:
            self.links.steps(target, source)
        except MissingDataError:
            return False
        return True

    def common(self, target: str, source: str) -> str:
        """Return the nearest common ancestor of two frames.

        Raises:
            MissingDataError: Nothing joins them.
        """
        down, _ = self.links.steps(target, source)
        return down[0][0] if down else target

    def moving_between(self, target: str, source: str) -> list[tuple[str, str]]:
        """Return (parent, child) of the moving links between two frames.

        Raises:
            MissingDataError: Nothing joins them.
        """
        steps = self.links.steps(target, source)
        return [(above, below) for line in steps for above, below, fixed in line if fixed is None]

    def transforms(self, target: str, source: str, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return target_T_source at each of (M,) stamps; None where a moving link is not known.

        Raises:
            MissingDataError: Nothing joins the two frames, whatever the stamp.
        """
        up, down = self.links.steps(target, source)
        wanted = np.asarray(stamps_ns, dtype=np.int64)
        pairs = zip(self._down(up, wanted), self._down(down, wanted), strict=True)
        return [
            None if to_target is None or to_source is None else to_target.inverse() @ to_source
            for to_target, to_source in pairs
        ]

    def known(self, target: str, source: str, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether target_T_source is known at each of (M,) stamps.

        Raises:
            MissingDataError: As transforms.
        """
        found = np.ones(len(stamps_ns), dtype=np.bool_)
        for link in self.moving_between(target, source):
            found &= self._tracks[link].known(stamps_ns)
        return found

    def _down(self, line: list[Step], stamps_ns: Int64Array) -> list[Transform | None]:
        """Return top_T_bottom of a line of links at each stamp."""
        made: list[Transform | None] = [Transform.identity()] * len(stamps_ns)
        for parent, child, fixed in line:
            links = (
                [fixed] * len(made)
                if fixed is not None
                else self._tracks[parent, child].at(stamps_ns)
            )
            made = [
                None if above is None or below is None else above @ below
                for above, below in zip(made, links, strict=True)
            ]
        return made

    def reason(self, target: str, source: str, stamp_ns: int) -> str:
        """Describe the moving links between two frames that are not known at a stamp."""
        stamps = np.array([stamp_ns], dtype=np.int64)
        lost = [
            f'{parent} -> {child}'
            for parent, child in self.moving_between(target, source)
            if self._tracks[parent, child].at(stamps) == [None]
        ]
        return (
            f'no transform from {source} to {target} at its stamp: {" and ".join(lost)} has none'
            f' before and after it that are at most {MAX_GAP_NS / NS_PER_S:g} s apart'
        )

    def track(self, target: str, source: str) -> ChainTrack:
        """Return target_T_source over time.

        Raises:
            MissingDataError: Nothing joins the two frames.
        """
        return ChainTrack(self, target, source)

    def stamps_ns(self, target: str, source: str) -> Int64Array:
        """Return the stamps of the moving link nearest to source, (N,); empty without any.

        Raises:
            MissingDataError: Nothing joins the two frames.
        """
        moving = self.moving_between(target, source)
        return self._tracks[moving[-1]].stamps_ns if moving else np.zeros(0, dtype=np.int64)


class ChainTrack:
    """The poses of a frame in another that several links join.

    Attributes:
        stamps_ns: (N,) of the moving link nearest to the frame, where the others are known.
    """

    def __init__(self, tree: MovingTree, target: str, source: str) -> None:
        """Take the two frames.

        Raises:
            MissingDataError: Nothing joins them.
        """
        self._tree = tree
        self._ends = target, source
        stamps_ns = tree.stamps_ns(target, source)
        self.stamps_ns = stamps_ns[tree.known(target, source, stamps_ns)]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose at each of (M,) stamps, None where a link of the chain is not known."""
        return self._tree.transforms(*self._ends, stamps_ns)

    def known(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the pose at each of (M,) stamps is known."""
        return self._tree.known(*self._ends, stamps_ns)


class ProductTrack:
    """A track between two others, or transforms that do not move: a_T_b b_T_c c_T_d over time."""

    def __init__(self, before: Track | Transform, middle: Track, after: Track | Transform) -> None:
        self._parts = before, middle, after
        self.stamps_ns = middle.stamps_ns[self.known(middle.stamps_ns)]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the product at each of (M,) stamps, None where a part is not known."""
        parts = [
            [part] * len(stamps_ns) if isinstance(part, Transform) else part.at(stamps_ns)
            for part in self._parts
        ]
        return [
            None if first is None or second is None or third is None else first @ second @ third
            for first, second, third in zip(*parts, strict=True)
        ]

    def known(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the product at each of (M,) stamps is known."""
        found = np.ones(len(stamps_ns), dtype=np.bool_)
        for part in self._parts:
            if not isinstance(part, Transform):
                found &= part.known(stamps_ns)
        return found
