# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The errors of KITTI's odometry benchmark, segment by segment.

Source: evaluate_odometry.cpp of the odometry devkit: trajectoryDistances,
lastFrameFromSegmentLength, rotationError, translationError, calcSequenceErrors and saveStats. What
is not obvious there, and is the same here:

- The length of a segment is measured along the ground truth, in float32, and its last frame is
  the first one *beyond* the length; errors are divided by the length itself (100 m), not by the
  distance of the frames (100.7 m).
- Every 10th frame is a start, and a start has a segment of each length that still fits. All
  segments have the same weight in the mean, so that short ones, of which there are more, count
  more.
- The rotation error is the angle of the trace in float32: angles below about 0.02 degrees are 0,
  and the next possible one is 0.028 degrees.
- Matrices are inverted as such, not transposed: a rotation of seven digits has no error against
  itself.
- The speed of a segment counts both its first and its last frame, at 10 Hz.

The devkit refuses a result that has not as many poses as the ground truth. Here a segment whose
first or last frame has no result is left out, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Int64Array

LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
STEP = 10
_PERIOD_S = 0.1


@dataclass(frozen=True, eq=False)
class SegmentErrors:
    """The errors of N segments, by first frame, and of one frame by length.

    Attributes:
        first, last: (N,) positions of its first and last frame in the ground truth.
        lengths_m: (N,) float32, of LENGTHS_M.
        translations: (N,) float32, metres per metre.
        rotations: (N,) float32, radians per metre.
        speeds_m_s: (N,) float32.
        left_out: Number of segments of the ground truth without a result.
    """

    first: Int64Array
    last: Int64Array
    lengths_m: Float32Array
    translations: Float32Array
    rotations: Float32Array
    speeds_m_s: Float32Array
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.first)

    @property
    def t_err_percent(self) -> float | None:
        """Mean translation error in percent; None without segments."""
        return _mean(self.translations, 100)

    @property
    def r_err_deg_per_m(self) -> float | None:
        """Mean rotation error in degrees per metre; None without segments."""
        return _mean(self.rotations, 180 / np.pi)

    def chosen(self, kept: npt.NDArray[np.bool_]) -> SegmentErrors:
        """Return some of the segments, (N,) bool."""
        return SegmentErrors(
            self.first[kept],
            self.last[kept],
            self.lengths_m[kept],
            self.translations[kept],
            self.rotations[kept],
            self.speeds_m_s[kept],
        )

    def of_length(self, length_m: int) -> SegmentErrors:
        """Return the segments of one of LENGTHS_M."""
        return self.chosen(self.lengths_m == length_m)


def _mean(errors: Float32Array, factor: float) -> float | None:
    """Return the mean of the devkit: a float32 sum, one after the other."""
    if not len(errors):
        return None
    total = np.cumsum(errors, dtype=np.float32)[-1]
    return float(total / np.float32(len(errors))) * factor


def path_distances(poses: Float64Array) -> Float32Array:
    """Return (N,) metres along (N, 4, 4) poses up to each."""
    steps = np.diff(poses[:, :3, 3], axis=0).astype(np.float32)
    found: Float32Array = np.cumsum(np.append(np.float32(0), _norms(steps)), dtype=np.float32)
    return found


def segment_errors(
    numbers: Int64Array,
    ground_truth: Float64Array,
    result: Float64Array,
    known: npt.NDArray[np.bool_],
) -> SegmentErrors:
    """Compute the errors of all segments.

    Args:
        numbers: (N,) frame numbers of the ground truth, ascending; with holes, every 10th is by
            number.
        ground_truth: (N, 4, 4) poses of camera 0.
        result: (N, 4, 4) poses of camera 0 at the same frames, in any fixed frame.
        known: (N,) which frames have a result.
    """
    distances = path_distances(ground_truth)
    starts = np.flatnonzero((numbers - numbers[0]) % STEP == 0)
    first = np.repeat(starts, len(LENGTHS_M))
    lengths = np.tile(np.array(LENGTHS_M, dtype=np.float32), len(starts))
    last = np.searchsorted(distances, distances[first] + lengths, side='right')
    fits = last < len(distances)
    first, last, lengths = first[fits], last[fits], lengths[fits]
    scored = known[first] & known[last]
    left_out = int(np.count_nonzero(~scored))
    first, last, lengths = first[scored], last[scored], lengths[scored]
    errors = np.linalg.inv(_between(result, first, last)) @ _between(ground_truth, first, last)
    frames = (last - first + 1).astype(np.float32)
    return SegmentErrors(
        first,
        last,
        lengths,
        _norms(errors[:, :3, 3].astype(np.float32)) / lengths,
        _angles(errors) / lengths,
        (lengths / (_PERIOD_S * frames.astype(np.float64))).astype(np.float32),
        left_out,
    )


def _between(poses: Float64Array, first: Int64Array, last: Int64Array) -> Float64Array:
    """Return (M, 4, 4) poses of the last frames in the first ones."""
    found: Float64Array = np.linalg.inv(poses[first]) @ poses[last]
    return found


def _norms(vectors: Float32Array) -> Float32Array:
    """Return (N,) lengths of (N, 3) vectors, added in the order of the devkit."""
    x, y, z = vectors.T
    found: Float32Array = np.sqrt(x * x + y * y + z * z)
    return found


def _angles(errors: Float64Array) -> Float32Array:
    """Return (N,) radians of the rotations of (N, 4, 4) transforms."""
    a, b, c = (errors[:, axis, axis].astype(np.float32) for axis in range(3))
    cosines = (0.5 * ((a + b + c).astype(np.float64) - 1.0)).astype(np.float32)
    found: Float32Array = np.arccos(np.clip(cosines, np.float32(-1), np.float32(1)))
    return found
