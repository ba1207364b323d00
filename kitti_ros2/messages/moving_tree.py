# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The TF tree at any stamp: static links, and moving links interpolated between their transforms.

As in tf2, each link of a chain is interpolated by itself at the requested stamp (linear, and slerp
of the rotation), then the links are composed. Unlike tf2, nothing is known in a large gap.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, overload

import numpy as np

from ..model.errors import MissingDataError
from ..model.geometry import Transform
from ..model.samples import default_tolerance_ns, nearest_stamps
from ..model.streams import NS_PER_S
from .tf_tree import FrameTree, plain

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy.typing as npt

    from ..model.samples import Int64Array
    from .tf_tree import Link, Step


# Poses of one frame in another over time, interpolated.

MAX_GAP_NS = NS_PER_S + NS_PER_S // 2
"""Poses once a second, unevenly, still make a track. Further apart they say little of what was
between: in a bend of 0.2 rad/s at 10 m/s the straight line of these 1.5 s is 0.6 m off."""


class Track(Protocol):
    """Poses of one frame in another over time.

    Attributes:
        stamps_ns: (N,) stamps of the poses that it is made of, nanoseconds, ascending.
    """

    @property
    def stamps_ns(self) -> Int64Array:
        """See the class."""

    def __len__(self) -> int: ...

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose at each of (M,) stamps, None where it is not known."""

    def covers(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the pose at each stamp is known."""


class TransformSeries(Sequence[Transform]):
    """Transforms in the order of a bag: 56 bytes each, for an hour of 1 kHz has 3.6 million."""

    def __init__(self) -> None:
        self._numbers = array('d')

    def append(self, numbers: Sequence[float]) -> None:
        """Append x y z, metres, and x y z w of a quaternion."""
        self._numbers.extend(numbers)

    def __len__(self) -> int:
        return len(self._numbers) // 7

    @overload
    def __getitem__(self, index: int) -> Transform: ...

    @overload
    def __getitem__(self, index: slice) -> list[Transform]: ...

    def __getitem__(self, index: int | slice) -> Transform | list[Transform]:
        if isinstance(index, slice):
            return [self[row] for row in range(*index.indices(len(self)))]
        numbers = self._numbers[7 * index : 7 * index + 7]
        if not numbers:
            raise IndexError(index)
        return Transform.from_quaternion(numbers[3:], numbers[:3])


class PoseTrack:
    """Poses of one frame in another over time, interpolated.

    Between two poses the translation is linear and the rotation is spherical linear (slerp).
    Nothing is extrapolated, and nothing is known between poses more than MAX_GAP_NS apart.

    Args:
        stamps_ns: (N,) nanoseconds, in any order; of equal ones the first is used.
        transforms: N of them.

    Raises:
        ValueError: The numbers of stamps and transforms differ.
    """

    def __init__(self, stamps_ns: npt.ArrayLike, transforms: Sequence[Transform]) -> None:
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        if stamps.shape != (len(transforms),):
            raise ValueError(f'{len(transforms)} poses with stamps of shape {stamps.shape}')
        self.stamps_ns, self._indices = np.unique(stamps, return_index=True)
        self._transforms = transforms

    def __len__(self) -> int:
        return len(self._indices)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose at each of (M,) stamps; None before, after, and in too large a gap."""
        if not len(self):
            return [None] * len(stamps_ns)
        at_ns = np.asarray(stamps_ns, dtype=np.int64)
        after, exact, between = self._find_poses(at_ns)
        before = np.maximum(after - 1, 0)
        gaps = self.stamps_ns[after] - self.stamps_ns[before]
        share = (at_ns - self.stamps_ns[before]) / np.maximum(gaps, 1)
        poses: list[Transform | None] = [None] * len(at_ns)
        for index in np.flatnonzero(exact).tolist():
            poses[index] = self._pose(after[index])
        for index in np.flatnonzero(between).tolist():
            pair = self._pose(before[index]), self._pose(after[index])
            poses[index] = interpolate(*pair, float(share[index]))
        return poses

    def covers(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the pose at each of (M,) stamps is known."""
        if not len(self):
            return np.zeros(len(stamps_ns), dtype=np.bool_)
        _, exact, between = self._find_poses(np.asarray(stamps_ns, dtype=np.int64))
        return exact | between

    def _find_poses(
        self, at_ns: Int64Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return the first pose not before each stamp, and whether it is at it, or beyond it.

        The last is false where the pose before is further away than MAX_GAP_NS.
        """
        after = np.searchsorted(self.stamps_ns, at_ns)
        within = after < len(self)
        after[~within] = 0
        exact = within & (self.stamps_ns[after] == at_ns)
        gaps = self.stamps_ns[after] - self.stamps_ns[np.maximum(after - 1, 0)]
        between = within & (after > 0) & (gaps <= MAX_GAP_NS) & ~exact
        return after, exact, between

    def _pose(self, index: np.intp) -> Transform:
        return self._transforms[int(self._indices[index])]


class NearestTrack:
    """The poses of a track at their own stamps; nothing is known between them.

    Args:
        track: The track.
        tolerance_ns: How far stamps may be from those of the poses; at most half their period.
    """

    def __init__(self, track: Track, tolerance_ns: int) -> None:
        self._track = track
        self.stamps_ns = track.stamps_ns
        self._tolerance_ns = min(tolerance_ns, default_tolerance_ns(track.stamps_ns))

    def __len__(self) -> int:
        return len(self._track)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose nearest to each of (M,) stamps, None where it is too far."""
        covered = self.covers(stamps_ns)
        if not covered.any():
            return [None] * len(stamps_ns)
        nearest, _ = nearest_stamps(self.stamps_ns, stamps_ns)
        poses = self._track.at(self.stamps_ns[nearest])
        return [pose if near else None for pose, near in zip(poses, covered.tolist(), strict=True)]

    def covers(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether a pose is near each of (M,) stamps."""
        if not len(self):
            return np.zeros(len(stamps_ns), dtype=np.bool_)
        _, later_ns = nearest_stamps(self.stamps_ns, stamps_ns)
        near: npt.NDArray[np.bool_] = np.abs(later_ns) <= self._tolerance_ns
        return near


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
        """Return whether links join two frames, at some stamps at least."""
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
        at_ns = np.asarray(stamps_ns, dtype=np.int64)
        pairs = zip(self._down(up, at_ns), self._down(down, at_ns), strict=True)
        return [
            None if to_target is None or to_source is None else to_target.inverse() @ to_source
            for to_target, to_source in pairs
        ]

    def covers(self, target: str, source: str, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether target_T_source is known at each of (M,) stamps.

        Raises:
            MissingDataError: As transforms.
        """
        mask = np.ones(len(stamps_ns), dtype=np.bool_)
        for link in self.moving_between(target, source):
            mask &= self._tracks[link].covers(stamps_ns)
        return mask

    def _down(self, line: list[Step], stamps_ns: Int64Array) -> list[Transform | None]:
        """Return top_T_bottom of a line of links at each stamp."""
        top_T_bottom: list[Transform | None] = [Transform.identity()] * len(stamps_ns)
        for parent, child, fixed in line:
            links = (
                [fixed] * len(top_T_bottom)
                if fixed is not None
                else self._tracks[parent, child].at(stamps_ns)
            )
            top_T_bottom = [
                None if above is None or below is None else above @ below
                for above, below in zip(top_T_bottom, links, strict=True)
            ]
        return top_T_bottom

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
        self.stamps_ns = stamps_ns[tree.covers(target, source, stamps_ns)]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose at each of (M,) stamps, None where a link of the chain is not known."""
        return self._tree.transforms(*self._ends, stamps_ns)

    def covers(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the pose at each of (M,) stamps is known."""
        return self._tree.covers(*self._ends, stamps_ns)


class ProductTrack:
    """A track between two others, or transforms that do not move: a_T_b b_T_c c_T_d over time."""

    def __init__(self, before: Track | Transform, middle: Track, after: Track | Transform) -> None:
        self._parts = before, middle, after
        self.stamps_ns = middle.stamps_ns[self.covers(middle.stamps_ns)]

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

    def covers(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the product at each of (M,) stamps is known."""
        mask = np.ones(len(stamps_ns), dtype=np.bool_)
        for part in self._parts:
            if not isinstance(part, Transform):
                mask &= part.covers(stamps_ns)
        return mask
