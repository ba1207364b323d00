# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plot of the sensors: their frames with axes, from above and from the side."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform, rotation_from_rpy
from .svg import WIDTH, circle, figure, line, number, path, scale_bar, text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from .glances import LinkGlance

MOST_FRAMES = 16
"""Maximum number of frames that can be distinguished in a drawing."""

_RIG_MARGIN = 44.0
_FOOT = 26
_AXIS = 26.0
_LEAST_RIG_M = 0.2
_APART = 15.0
_LABELLED = 84.0
_SPARSE = 9
_NAMES = ('x', 'y', 'z')


@dataclass(frozen=True, eq=False)
class Mount:
    """A frame of the rig.

    Attributes:
        name: Frame.
        parent: Its parent frame, empty for the root.
        root_T_frame: Its pose in the root.
        xyz_m: Translation in its parent, metres; empty for the root.
        rpy_deg: Rotation in its parent, roll pitch yaw in degrees; empty for the root.
    """

    name: str
    parent: str
    root_T_frame: Transform
    xyz_m: tuple[float, ...] = ()
    rpy_deg: tuple[float, ...] = ()

    @property
    def distance_m(self) -> float:
        """Distance to its parent, metres; 0 for the root."""
        return math.hypot(*self.xyz_m)


def mounts_of(links: Sequence[LinkGlance]) -> list[Mount]:
    """Return the frames of the largest tree of links, parents before children."""
    links = [link for link in links if is_finite(link)]
    children: dict[str, list[LinkGlance]] = defaultdict(list)
    for link in links:
        children[link.parent].append(link)
    placed = {link.child for link in links}
    trees = [_tree(root, children) for root in children if root not in placed]
    return max(trees, key=len, default=[])


def is_finite(link: LinkGlance) -> bool:
    """Whether the values of a link are finite; those of a zero quaternion are not."""
    return bool(np.isfinite([*link.xyz_m, *link.rpy_deg]).all())


def _tree(root: str, children: dict[str, list[LinkGlance]]) -> list[Mount]:
    found = [Mount(root, '', Transform.identity())]
    for mount in found:
        for link in children.get(mount.name, ()):
            place = Transform(
                rotation_from_rpy(*(float(np.radians(angle)) for angle in link.rpy_deg)),
                np.array(link.xyz_m),
            )
            pose = mount.root_T_frame @ place
            found.append(Mount(link.child, mount.name, pose, link.xyz_m, link.rpy_deg))
    return found


def rig_plot(key: str, mounts: Sequence[Mount], *, side: bool) -> str:
    """Draw the frames with their axes, numbered from 1, and distances on links with room.

    Args:
        key: Unique in the page.
        mounts: At most MOST_FRAMES.
        side: From the left side (x to the right, z up); else from above (x to the right, y up).
    """
    axes = (0, 2) if side else (0, 1)
    view = _RigView(mounts, axes)
    order = {mount.name: place for place, mount in enumerate(mounts)}
    spots = np.array([view.place(mount.root_T_frame.translation) for mount in mounts])
    links = [
        (spots[order[mount.parent]], spots[place], mount.distance_m)
        for place, mount in enumerate(mounts)
        if mount.parent
    ]
    drawn = [line(start[0], start[1], end[0], end[1], 'link') for start, end, _ in links]
    drawn += [
        _axes(spot, mount.root_T_frame.rotation[list(axes)])
        for spot, mount in zip(spots, mounts, strict=True)
    ]
    drawn += _lengths(links) if len(mounts) <= _SPARSE else []
    drawn += [_badge(spot, place + 1) for place, spot in enumerate(_apart(spots))]
    seen, up = ('the left side', 'z') if side else ('above', 'y')
    height = view.height + _FOOT
    drawn += [
        text(WIDTH - 8, height - 7, 'x \N{RIGHTWARDS ARROW}', 'end', 'unit'),
        text(8, 14, f'{up} \N{UPWARDS ARROW}', 'start', 'unit'),
        scale_bar(view.scale, height),
    ]
    places = '; '.join(
        f'{place + 1} {mount.name} at {_metres(mount.root_T_frame.translation)}'
        for place, mount in enumerate(mounts)
    )
    words = f'Seen from {seen}, in metres x y z of {mounts[0].name}: {places}.'
    return figure(key, f'Sensors from {seen}', words, (WIDTH, height), *drawn)


def _metres(xyz: Float64Array) -> str:
    return ' '.join(f'{value + 0.0:.2f}' for value in xyz.tolist())


class _RigView:
    """The mapping from metres of two axes to the units of the plot."""

    def __init__(self, mounts: Sequence[Mount], axes: tuple[int, int]) -> None:
        self._axes = list(axes)
        places = np.array([mount.root_T_frame.translation for mount in mounts])
        flat = places[:, self._axes]
        extent = np.maximum(flat.max(axis=0) - flat.min(axis=0), _LEAST_RIG_M)
        # The same scale in both views, so that they can be compared.
        widest = float(np.ptp(places, axis=0).max())
        self.scale = (WIDTH - 2 * _RIG_MARGIN) / max(widest, _LEAST_RIG_M)
        self.height = round(float(extent[1]) * self.scale + 2 * _RIG_MARGIN)
        self._middle = (flat.max(axis=0) + flat.min(axis=0)) / 2

    def place(self, xyz: Float64Array) -> Float64Array:
        """Map (3,) metres to (2,) units."""
        shift = (xyz[self._axes] - self._middle) * [self.scale, -self.scale]
        placed: Float64Array = np.array([WIDTH / 2, self.height / 2]) + shift
        return placed


def _lengths(links: Sequence[tuple[Float64Array, Float64Array, float]]) -> list[str]:
    """Draw the lengths of links that are long enough, unless another length is close.

    Args:
        links: (2,) units of both ends, and the distance of the two frames in metres.
    """
    drawn: list[str] = []
    middles: list[Float64Array] = []
    for start, end, distance_m in links:
        middle = (start + end) / 2
        crowded = any(np.abs((middle - other) / [60, 18]).max() < 1 for other in middles)
        if np.linalg.norm(end - start) > _LABELLED and not crowded:
            middles.append(middle)
            x, y = middle.tolist()
            drawn.append(text(x, y - 5, f'{distance_m:.2f} m', 'middle', 'distance'))
    return drawn


def _axes(spot: Float64Array, directions: Float64Array) -> str:
    """Draw arrows along x, y and z, projected into the plane of the drawing.

    Args:
        spot: (2,) units.
        directions: (2, 3), columns are the axes in the plane.
    """
    x, y = spot.tolist()
    drawn = []
    for name, (dx, dy) in zip(_NAMES, directions.T.tolist(), strict=True):
        length = float(np.hypot(dx, dy))
        if length < 0.35:
            continue
        tip = f'{number(x + dx * _AXIS)} {number(y - dy * _AXIS)}'
        drawn.append(path(f'M{number(x)} {number(y)}L{tip}', f'axis-{name}'))
        drawn.append(
            text(x + dx * (_AXIS + 7), y - dy * (_AXIS + 7) + 4, name, 'middle', f'axis-{name}')
        )
    return ''.join(drawn)


def _apart(spots: Float64Array) -> Float64Array:
    """Return (N, 2) places near the spots, far enough from each other for their badges."""
    places = spots + np.linspace(0, 1e-3, len(spots))[:, None]
    for _ in range(200):
        away = places[:, None] - places[None]
        distance = np.linalg.norm(away, axis=2)
        np.fill_diagonal(distance, np.inf)
        close = distance < _APART
        if not close.any():
            break
        push = np.where(close, (_APART - distance) / 4, 0.0)
        places = places + (away / np.maximum(distance, 1e-6)[..., None] * push[..., None]).sum(1)
    spread: Float64Array = places
    return spread


def _badge(spot: Float64Array, place: int) -> str:
    x, y = spot.tolist()
    words = text(x, y + 3.8, str(place), 'middle', 'badge')
    return f'<g>{circle(x, y, 7.5, "badge")}{words}</g>'
