# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of one frame in another over time, interpolated."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, overload

import numpy as np

from ..model.geometry import Transform
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Int64Array

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

    def known(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
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
            return [self[place] for place in range(*index.indices(len(self)))]
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
        self.stamps_ns, self._places = np.unique(stamps, return_index=True)
        self._transforms = transforms

    def __len__(self) -> int:
        return len(self._places)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """Return the pose at each of (M,) stamps; None before, after, and in too large a gap."""
        if not len(self):
            return [None] * len(stamps_ns)
        wanted = np.asarray(stamps_ns, dtype=np.int64)
        after, exact, between = self._places_of(wanted)
        before = np.maximum(after - 1, 0)
        gaps = self.stamps_ns[after] - self.stamps_ns[before]
        share = (wanted - self.stamps_ns[before]) / np.maximum(gaps, 1)
        poses: list[Transform | None] = [None] * len(wanted)
        for index in np.flatnonzero(exact).tolist():
            poses[index] = self._pose(after[index])
        for index in np.flatnonzero(between).tolist():
            pair = self._pose(before[index]), self._pose(after[index])
            poses[index] = interpolate(*pair, float(share[index]))
        return poses

    def known(self, stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
        """Return (M,) whether the pose at each of (M,) stamps is known."""
        if not len(self):
            return np.zeros(len(stamps_ns), dtype=np.bool_)
        _, exact, between = self._places_of(np.asarray(stamps_ns, dtype=np.int64))
        return exact | between

    def _places_of(
        self, wanted: Int64Array
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return the first pose not before each stamp, and whether it is at it, or beyond it.

        The last is false where the pose before is further away than MAX_GAP_NS.
        """
        after = np.searchsorted(self.stamps_ns, wanted)
        within = after < len(self)
        after[~within] = 0
        exact = within & (self.stamps_ns[after] == wanted)
        gaps = self.stamps_ns[after] - self.stamps_ns[np.maximum(after - 1, 0)]
        between = within & (after > 0) & (gaps <= MAX_GAP_NS) & ~exact
        return after, exact, between

    def _pose(self, place: np.intp) -> Transform:
        return self._transforms[int(self._places[place])]


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
