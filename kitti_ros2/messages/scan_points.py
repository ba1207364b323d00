# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The points that a message of any sensor was decoded to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array


@dataclass(frozen=True, eq=False)
class ScanPoints:
    """The points of a message.

    Attributes:
        points: (N, 4) float32 x y z reflectance, metres and 0..1, in the message's frame.
        dropped: Number of values without a return, by reason.
        lost: Number of parts that could not be decoded, by reason.
        labels: (N,) uint32 as SemanticKITTI's: low 16 bits class, high 16 instance; None without.
    """

    points: Float32Array
    dropped: Mapping[str, int]
    lost: Mapping[str, int] = field(default_factory=dict)
    labels: npt.NDArray[np.uint32] | None = None


def make_points(xyz: Float64Array, reflectance: Float64Array) -> Float32Array:
    """Make (N, 4) float32 of (N, 3) and (N,); reflectance is clipped to 0..1, and 0 for NaN."""
    points = np.empty((len(xyz), 4), dtype=np.float32)
    points[:, :3] = xyz
    points[:, 3] = np.clip(np.nan_to_num(reflectance, nan=0.0), 0.0, 1.0)
    return points
