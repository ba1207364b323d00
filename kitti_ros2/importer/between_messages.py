# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The GPS/IMU unit at a moment between two of its messages.

Each returns a message like the nearer one. What one of the two does not tell is that of the nearer;
an orientation, or an altitude, that one alone has is taken from it. Places are linear in degrees:
in metres that is the straight line, to 1 mm in 200 m.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..messages.header import vector_of
from ..messages.oxts import has_fix, has_orientation
from ..model.geometry import Transform
from ..rig.pose_track import interpolate

_TURN_DEG, _HALF_TURN_DEG = 360.0, 180.0
_NOWHERE = np.zeros(3)


def imu_between(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - of the bag's types
    """Interpolate two Imu: linear, and slerp; share is 0 at the first."""
    near = _nearer(first, last, share)
    changes: dict[str, Any] = {}
    oriented = [each for each in (first, last) if has_orientation(each)]
    if len(oriented) == 1:
        names = 'orientation', 'orientation_covariance'
        changes |= {name: getattr(oriented[0], name) for name in names}
    elif oriented:
        turn = interpolate(_turn(first), _turn(last), share).quaternion()
        changes['orientation'] = replace(
            near.orientation, **dict(zip('xyzw', turn.tolist(), strict=True))
        )
    for name in ('angular_velocity', 'linear_acceleration'):
        known = {getattr(each, f'{name}_covariance')[0] for each in (first, last)}
        if len(known) == 1:
            changes[name] = _vector(getattr(first, name), getattr(last, name), share)
    return replace(near, **changes)


def velocity_between(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - of the bag's types
    """Interpolate two messages with a Twist, twist, linearly: see oxts_poses.as_velocity."""
    near = _nearer(first, last, share)
    parts = {
        name: _vector(getattr(first.twist, name), getattr(last.twist, name), share)
        for name in ('linear', 'angular')
    }
    return SimpleNamespace(header=near.header, twist=SimpleNamespace(**parts))


def fix_between(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - as above
    """Interpolate two NavSatFix linearly; one without a fix is passed over."""
    if not has_fix(last):
        return first
    if not has_fix(first):
        return last
    eastward = math.remainder(last.longitude - first.longitude, _TURN_DEG)
    longitude = first.longitude + share * eastward
    if max(abs(first.longitude), abs(last.longitude)) <= _HALF_TURN_DEG < abs(longitude):
        longitude = math.remainder(longitude, _TURN_DEG)
    return replace(
        _nearer(first, last, share),
        latitude=_number(first.latitude, last.latitude, share),
        longitude=longitude,
        altitude=_number(first.altitude, last.altitude, share),
    )


def _nearer(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - of the bag's types
    return last if share > 0.5 else first


def _number(first: float, last: float, share: float) -> float:
    """Return the number between two; one of them where the other is NaN."""
    mixed = first + share * (last - first)
    return mixed if math.isfinite(mixed) else last if math.isfinite(last) else first


def _turn(imu: Any) -> Transform:  # noqa: ANN401 - as above
    q = imu.orientation
    return Transform.from_quaternion([q.x, q.y, q.z, q.w], _NOWHERE)


def _vector(first: Any, last: Any, share: float) -> Any:  # noqa: ANN401 - as above
    near = _nearer(first, last, share)
    with np.errstate(invalid='ignore', over='ignore'):
        mixed = vector_of(first) + share * (vector_of(last) - vector_of(first))
    if not np.isfinite(mixed).all():
        return near
    return replace(near, **dict(zip('xyz', mixed.tolist(), strict=True)))
