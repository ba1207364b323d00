# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses of cameras whose images are not rectified: from a camera's frame to the plane before K."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

if TYPE_CHECKING:
    from .geometry import Float64Array

_MOST_STEPS = 500
_STEP = 1e-12


class Lens(Protocol):
    """A lens.

    Attributes:
        model: Name of the model, as in CameraInfo.
        is_wide: Whether it sees to the side and behind; its depths are distances.
        scale: Size of an image in its middle, relative to that of a pinhole with the same K.
    """

    @property
    def model(self) -> str: ...  # noqa: D102 - above

    @property
    def is_wide(self) -> bool: ...  # noqa: D102

    @property
    def scale(self) -> float: ...  # noqa: D102

    @property
    def numbers(self) -> Float64Array:
        """(n,) D of CameraInfo."""
        ...

    def bent(self, seen: Float64Array) -> Float64Array:
        """Return (..., 2) x and y before K of (..., 3) points, NaN for invisible ones."""
        ...

    def rays(self, bent: Float64Array) -> Float64Array:
        """Return (N, 3) rays, of depth 1, that (N, 2) x and y before K come from."""
        ...


def at_depth_1(seen: Float64Array) -> Float64Array:
    """Return (..., 2) x and y at depth 1 of (..., 3) points; NaN for those behind."""
    return np.asarray(seen[..., :2] / np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan))


@dataclass(frozen=True, eq=False)
class PlumbBob:
    """The lens of an unrectified camera, as OpenCV's calib3d defines it; see Lens.

    Attributes:
        d: (5,) k1 k2 p1 p2 k3.
    """

    d: Float64Array
    model: ClassVar[str] = 'plumb_bob'
    is_wide: ClassVar[bool] = False
    scale: ClassVar[float] = 1.0

    @property
    def numbers(self) -> Float64Array:
        """(5,) D of CameraInfo."""
        return self.d

    def bent(self, seen: Float64Array) -> Float64Array:
        """Return (..., 2) x and y before K of (..., 3) points; NaN where the model folds back."""
        return self._distorted(at_depth_1(seen))

    def rays(self, bent: Float64Array) -> Float64Array:
        """Return (N, 3) rays at depth 1, by fixed-point iteration; NaN where none is bent there."""
        flat = bent
        for _ in range(_MOST_STEPS):
            step = bent - self._distorted(flat)
            flat = flat + step
            if not (np.abs(step) > _STEP).any():
                break
        return np.column_stack([np.where(np.abs(step) <= _STEP, flat, np.nan), np.ones(len(flat))])

    def _distorted(self, flat: Float64Array) -> Float64Array:
        k1, k2, p1, p2, k3 = self.d
        x, y = flat[..., 0], flat[..., 1]
        squared = x * x + y * y
        squared = np.where(squared < self._fold_radius, squared, np.nan)
        radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x),
                y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )

    @cached_property
    def _fold_radius(self) -> float:
        """The squared radius beyond which the distortion folds points back."""
        k1, k2, _, _, k3 = self.d
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        return float(real.min()) if len(real) else np.inf


@dataclass(frozen=True, eq=False)
class MeiLens:
    """The lens of a fisheye: C. Mei and P. Rives, ICRA 2007; see Lens.

    A point goes to the unit sphere, from there to a plane as seen from xi behind its centre, and
    through a plumb bob distortion. KITTI-360's fisheyes (xi > 1) see to 99 degrees off their axis;
    beyond arccos(-1 / xi), 113 or 117 degrees, the model folds points back into the image.

    Attributes:
        xi: Of the mirror.
        d: (4,) k1 k2 p1 p2.
    """

    xi: float
    d: Float64Array
    model: ClassVar[str] = 'mei'
    is_wide: ClassVar[bool] = True

    @property
    def scale(self) -> float:
        """Size of an image in its middle, relative to that of a pinhole with the same K."""
        return 1 / (1 + self.xi)

    @property
    def numbers(self) -> Float64Array:
        """(5,) xi k1 k2 p1 p2; ROS has no name for the model."""
        return np.array([self.xi, *self.d])

    def bent(self, seen: Float64Array) -> Float64Array:
        """Return (..., 2) x and y before K of (..., 3) points; NaN beyond the model's limit."""
        unit = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
        limit = -1 / self.xi if self.xi > 1 else -self.xi
        bent = self._plane.bent(unit + np.array([0.0, 0.0, self.xi]))
        return np.where(unit[..., 2:] > limit, bent, np.nan)

    def rays(self, bent: Float64Array) -> Float64Array:
        """Return (N, 3) unit rays that are bent to (N, 2) x and y; NaN where there is none."""
        plane = self._plane.rays(bent)
        squared = (plane[:, :2] ** 2).sum(axis=1)
        with np.errstate(invalid='ignore'):
            scale = (self.xi + np.sqrt(1 + (1 - self.xi**2) * squared)) / (1 + squared)
        rays: Float64Array = plane * scale[:, None] - np.array([0.0, 0.0, self.xi])
        return rays

    @cached_property
    def _plane(self) -> PlumbBob:
        return PlumbBob(np.append(self.d, 0.0))
