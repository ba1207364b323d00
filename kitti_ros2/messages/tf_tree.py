# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The static part of a bag's TF tree, its transforms as links, and forward of the robot.

As in tf2, every frame has one parent, and ROS 1's leading slash is not part of a frame's name.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.errors import MissingDataError, did_you_mean
from ..model.geometry import Transform
from .camera_info import decode_static
from .cdr import stamp_ns_of
from .ros_types import TFMessage

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TypeAlias

    from ..model.geometry import Float64Array


# The static part of a bag's TF tree.
#
# As in tf2, every frame has one parent, and ROS 1's leading slash is not part of a frame's name.

Link: TypeAlias = 'tuple[str, str, Transform]'
"""Parent, child, parent_T_child."""

Step: TypeAlias = 'tuple[str, str, Transform | None]'
"""Parent, child, parent_T_child; None where the link moves."""

_MOST_CHILDREN = 8
_MOST_FRAMES = 40
_MOST_LINKS = 100  # of a chain: robots have some ten, and a search takes as many steps
_SAME_LINK = 1e-9
# tf2 accepts quaternions whose squared norm is off by 1 % at most; matrices have the same limit.
_ROTATION = 1e-2
_FARTHEST_M = 1e9  # beyond any map on earth; squares of float32 coordinates are still finite


class FrameTree:
    """Frames and the links between them; errors are raised only for the frames they affect."""

    def __init__(
        self,
        static: Iterable[Link],
        dynamic: Iterable[tuple[str, str]] = (),
        lost: str = '',
    ) -> None:
        """Take links in any order.

        Args:
            static: Links that do not move.
            dynamic: (parent, child) of moving links.
            lost: The part that may be missing, and why.
        """
        self._parents: dict[str, dict[str, Transform | None]] = defaultdict(dict)
        self._differing: set[str] = set()
        self._faults: dict[tuple[str, str], str] = {}
        self._below: dict[str, dict[str, Transform | str]] = defaultdict(dict)
        self._lines_up: dict[str, list[str]] = {}
        self._anchors: dict[str, str] = {}
        self._lost = f'; {lost}' if lost else ''
        for parent, child, transform in static:
            above = self._parents[plain(child)]
            earlier = above.setdefault(plain(parent), transform)
            if (
                earlier is not None
                and earlier is not transform
                and differ(earlier, transform, _SAME_LINK)
            ):
                self._differing.add(plain(child))
        for parent, child in dynamic:
            self._parents[plain(child)][plain(parent)] = None
        self.frames = set(self._parents) | {
            parent for above in self._parents.values() for parent in above
        }

    def add_moving(self, parent: str, child: str) -> None:
        """Add a moving link."""
        self._parents[plain(child)][plain(parent)] = None
        self.frames |= {plain(parent), plain(child)}
        for cache in (self._faults, self._below, self._lines_up, self._anchors):
            cache.clear()
        for name in ('_children', '_description'):
            vars(self).pop(name, None)

    @cached_property
    def _children(self) -> dict[str, list[str]]:
        children: dict[str, list[str]] = defaultdict(list)
        for child, above in sorted(self._parents.items()):
            for parent, link in above.items():
                if link is not None:
                    children[parent].append(child)
        return children

    def transform(self, target: str, source: str) -> Transform:
        """Return target_T_source through static links; the identity for twice the same name.

        Raises:
            MissingDataError: A frame is unknown, the two are in different trees, a link between
                them moves, a frame between them has two parents or two poses, there is a cycle, or
                a rotation is invalid. The message shows the tree.
        """
        joined = self._join(plain(target), plain(source))
        if isinstance(joined, Transform):
            return joined
        raise MissingDataError(
            f'no static transform from {_shown(source)} to {_shown(target)}: {joined}; the bag has'
            f' {self} (add the link to the bag, name other frames in the plan, or give --calib)'
            f'{self._lost}'
        )

    def find(self, target: str, source: str) -> Transform | None:
        """Return target_T_source as transform does, None instead of an error."""
        if not self.joins(target, source):
            return None
        joined = self._join(plain(target), plain(source))
        return joined if isinstance(joined, Transform) else None

    def joins(self, target: str, source: str) -> bool:
        """Return whether transform has no error for two frames."""
        return self.anchor(target) == self.anchor(source)

    def anchor(self, frame: str) -> str:
        """Return the highest frame that static links join to a frame, which may be itself.

        Two frames have the same anchor if and only if static links join them.
        """
        name = plain(frame)
        anchor = self._anchors.get(name)
        if anchor is None:
            anchor = self._anchors[name] = self._find_anchor(name)
        return anchor

    def _find_anchor(self, frame: str) -> str:
        line = self._ancestors(frame)
        if len(line) == 1 or len(line) > _MOST_LINKS + 1 or _is_circle(line):
            return frame
        parent = line[1]
        link = self._parents[frame][parent]
        return frame if link is None or self._fault(parent, frame, link) else self.anchor(parent)

    def neighbours(self, frame: str) -> list[str]:
        """Return the parents and children of a frame, sorted."""
        name = plain(frame)
        return sorted({*self._parents.get(name, ()), *self._children.get(name, ())})

    @property
    def roots(self) -> list[str]:
        """The frames without a parent."""
        return sorted(filter(self.is_root, self.frames))

    def is_root(self, frame: str) -> bool:
        """Return whether a frame, which may be unknown, has no parent."""
        return not self._parents.get(frame)

    def root_of(self, frame: str) -> str:
        """Return the root of a frame's tree."""
        return self._ancestors(plain(frame))[-1]

    def faults(self) -> list[str]:
        """Describe the frames with several parents, and the circles."""
        descriptions = [
            f'{child} has several parents, {" and ".join(sorted(above))}'
            for child, above in sorted(self._parents.items())
            if len(above) > 1
        ]
        circles: set[frozenset[str]] = set()
        for frame in sorted(self.frames):
            line = self._ancestors(frame)
            circle = line[line.index(line[-1]) :] if _is_circle(line) else []
            if circle and frozenset(circle) not in circles:
                circles.add(frozenset(circle))
                descriptions.append(f'{" <- ".join(circle)} is a circle')
        return descriptions

    def steps(self, target: str, source: str) -> tuple[list[Step], list[Step]]:
        """Return the links from the common ancestor down to target, and down to source.

        Raises:
            MissingDataError: As transform, except that links may move.
        """
        lines = self._lines(plain(target), plain(source))
        steps: list[list[Step]] = []
        for line in lines if not isinstance(lines, str) else ():
            links = [
                (parent, child, self._parents[child][parent]) for child, parent in pairwise(line)
            ]
            fault = next(filter(None, (self._fault(*link) for link in links)), '')
            if fault:
                lines = fault
                break
            steps.append(links[::-1])
        if isinstance(lines, str):
            raise MissingDataError(
                f'no transform from {_shown(source)} to {_shown(target)}: {lines}; the bag has'
                f' {self}{self._lost}'
            )
        return steps[0], steps[1]

    def _join(self, target: str, source: str) -> Transform | str:
        """Return target_T_source, or the reason why there is none."""
        lines = self._lines(target, source)
        if isinstance(lines, str):
            return lines
        common_t = []
        for line in lines:
            common_t_frame = self._down(line)
            if isinstance(common_t_frame, str):
                return common_t_frame
            common_t.append(common_t_frame)
        return common_t[0].inverse() @ common_t[1]

    def _lines(self, target: str, source: str) -> tuple[list[str], list[str]] | str:
        """Return the frames from target, and from source, up to their common ancestor."""
        if target == source:
            return [target], [source]
        for frame in (target, source):
            if frame not in self.frames:
                return self._unknown(frame)
        lines = self._ancestors(target), self._ancestors(source)
        for line in lines:
            if _is_circle(line):
                return f'{" <- ".join(line[line.index(line[-1]) :])} is a circle'
            if len(line) > _MOST_LINKS + 1:
                return f'{line[0]} has more than {_MOST_LINKS} frames above it'
        others = set(lines[1])
        common = next((frame for frame in lines[0] if frame in others), None)
        if common is None:
            return self._apart(*lines)
        up, down = (line[: line.index(common) + 1] for line in lines)
        return up, down

    def _ancestors(self, frame: str) -> list[str]:
        """Return a frame and its ancestors up to a root, a frame with two parents, or a cycle.

        A longer line than any robot has is cut off.
        """
        ancestors = self._lines_up.get(frame)
        if ancestors is None:
            ancestors = self._lines_up[frame] = self._walk_up(frame)
        return ancestors

    def _walk_up(self, frame: str) -> list[str]:
        line, passed = [frame], {frame}
        while len(line) <= _MOST_LINKS + 1 and len(self._parents.get(line[-1], ())) == 1:
            (parent,) = self._parents[line[-1]]
            above = self._lines_up.get(parent)
            if above is not None and passed.isdisjoint(above):
                return [*line, *above][: _MOST_LINKS + 2]
            line.append(parent)
            if parent in passed:
                break
            passed.add(parent)
        return line

    def _down(self, line: list[str]) -> Transform | str:
        """Return top_T_bottom of a line of frames from bottom to top, or why there is none."""
        transforms = self._below[line[-1]]
        transforms.setdefault(line[-1], Transform.identity())
        first = next(at for at, frame in enumerate(line) if frame in transforms)
        for child, parent in reversed(list(pairwise(line[: first + 1]))):
            transforms[child] = self._one_below(transforms[parent], parent, child)
        return transforms[line[0]]

    def _one_below(self, top_t_parent: Transform | str, parent: str, child: str) -> Transform | str:
        """Return top_T_child, or why there is none: what is next to the child counts first."""
        link = self._parents[child][parent]
        if link is None:
            return f'{parent} -> {child} moves'
        fault = self._fault(parent, child, link)
        return fault or (top_t_parent if isinstance(top_t_parent, str) else top_t_parent @ link)

    def _fault(self, parent: str, child: str, link: Transform | None) -> str:
        """Return why a static link cannot be used, empty if it can."""
        fault = self._faults.get((parent, child))
        if fault is None:
            fault = self._faults[parent, child] = self._find_fault(parent, child, link)
        return fault

    def _find_fault(self, parent: str, child: str, link: Transform | None) -> str:
        if link is not None and child in self._differing:
            return f'{parent} -> {child} is given twice, and differently'
        if link is not None and not _is_rigid(link):
            return (
                f'{parent} -> {child} is no transform; its numbers must be finite and possible,'
                f' its quaternion of length 1'
            )
        return ''

    def _apart(self, first: list[str], second: list[str]) -> str:
        """Return the reason why two lines of ancestors do not meet."""
        for line in (first, second):
            parents = self._parents.get(line[-1])
            if parents:
                return f'{line[-1]} has several parents, {" and ".join(sorted(parents))}'
        return f'they are in different trees, of {second[-1]} and of {first[-1]}'

    def _unknown(self, frame: str) -> str:
        return f'there is no frame {_shown(frame)}{did_you_mean(frame, sorted(self.frames))}'

    def __str__(self) -> str:
        """Format all frames: ``base_link -> {imu_link, velo_link -> {cam}}; map -> ...``."""
        return self._description

    @cached_property
    def _description(self) -> str:
        shown: set[str] = set()
        roots = sorted(self._tops())
        texts = [self._text(root, shown) for root in roots[:_MOST_CHILDREN]]
        if len(roots) > _MOST_CHILDREN:
            texts.append(f'{len(roots) - _MOST_CHILDREN} more trees')
        moving = [
            f'{parent} -> {child} (moving)'
            for child, above in sorted(self._parents.items())
            for parent, link in sorted(above.items())
            if link is None
        ]
        texts += moving[:_MOST_CHILDREN]
        if len(moving) > _MOST_CHILDREN:
            texts.append(f'{len(moving) - _MOST_CHILDREN} more that move')
        return '; '.join(texts) or 'no transforms'

    def _text(self, frame: str, shown: set[str]) -> str:
        """Format a frame and its descendants, up to a limit, without children already shown."""
        children = () if frame in shown else self._children.get(frame, ())
        shown.add(frame)
        texts: list[str] = []
        for child in children:
            if len(texts) == _MOST_CHILDREN or len(shown) >= _MOST_FRAMES:
                texts.append(f'{len(children) - len(texts)} more')
                break
            texts.append(self._text(child, shown))
        return f'{frame} -> {{{", ".join(texts)}}}' if texts else frame

    def _tops(self) -> set[str]:
        """Return the frames that begin the texts of trees: roots, and the first of each cycle."""
        tops = set()
        seen: set[str] = set()
        for frame in self._children:
            line = [] if frame in seen else self._ancestors(frame)
            if _is_circle(line) and not seen.intersection(line):
                tops.add(min(line[line.index(line[-1]) :]))
            seen.update(line)
            if all(link is None for link in self._parents.get(frame, {}).values()):
                tops.add(frame)
        return tops


def plain(name: str) -> str:
    """Return a frame's name without the leading slash of ROS 1."""
    return name.lstrip('/')


def _shown(name: str) -> str:
    return name or 'of an empty name'


def _is_circle(line: list[str]) -> bool:
    return len(line) > 1 and line[-1] in line[:-1]


def differ(first: Transform, second: Transform, limit: float) -> bool:
    """Return whether two transforms differ by more than a limit in any element."""
    with np.errstate(invalid='ignore'):
        return bool((np.abs(first.matrix() - second.matrix()) > limit).any())


def _is_rigid(link: Transform) -> bool:
    """Return whether a link is a valid transform; a quaternion of zeros is NaN here."""
    if not (np.abs(link.matrix()) <= _FARTHEST_M).all() or np.linalg.det(link.rotation) < 0:
        return False
    product = link.rotation @ link.rotation.T
    return bool(np.abs(product - np.eye(3)).max() < _ROTATION)


# Forward of a robot, from the names and poses of its frames.
#
# Bodies have x forward, y left, z up, and optical frames z forward, x right, y down (REP 103, REP
# 105). Lidars have any axes: x of Ouster's os_lidar looks to the cable, backward in os_sensor
# (ouster-ros, "Coordinate Frames"), and x of nuScenes' LIDAR_TOP looks right.

AXES: dict[str, Float64Array] = {
    'x': np.eye(3),
    '-x': np.diag([-1.0, -1.0, 1.0]),
    'y': np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    '-y': np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    'z': np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
}
"""By the axis that looks forward: (3, 3), columns forward, left, up in the frame. Up is z, with z
forward it is -y, as in an optical frame."""

_BODIES = (
    *('base_link', 'base_footprint', 'ego_vehicle', 'vehicle', 'base'),
    *('chassis', 'chassis_link', 'ego', 'car', 'trunk', 'body'),
)
FIXED_FRAMES = ('map', 'earth', 'world', 'odom')
"""Frames in which a robot moves (REP 105), in order of preference: poses in odom drift."""

_ROBOT_BASE = re.compile(r'_base_link$', re.IGNORECASE)
_SENSOR = re.compile(r'velo|lidar|laser|ouster|cam|imu|gps|gnss|radar|kit', re.IGNORECASE)
_OPTICAL = re.compile(r'optical(_frame|_link)?$', re.IGNORECASE)
_OUSTER = re.compile(r'^(?P<prefix>.*)os_lidar$')
_BACKWARD_DEG = 175
_STEEP_DEG = 60


@dataclass(frozen=True, eq=False)
class Heading:
    """Forward of a robot.

    Attributes:
        frame: A frame.
        rotation: (3, 3), columns forward, left, up in that frame.
        source: The reason, for notes.
        body: Whether the frame is the robot's body, with x forward.
        assumed: Whether nothing but the scanner's own x is known.
    """

    frame: str
    rotation: Float64Array
    source: str
    body: bool = False
    assumed: bool = False

    def axes_of(self, tree: FrameTree, frame: str) -> Float64Array | None:
        """Return (3, 3) the axes of a frame as columns in forward, left, up; None if not joined."""
        pose = tree.find(self.frame, frame)
        return None if pose is None else self.rotation.T @ pose.rotation


def is_optical(frame: str) -> bool:
    """Return whether a frame's name says that z looks forward."""
    return bool(_OPTICAL.search(frame))


def find_body(tree: FrameTree, sensors: Iterable[str]) -> Heading | None:
    """Return the heading of the robot's body, if static transforms join a sensor to it."""
    sensor_frames = [frame for frame in sensors if frame]
    frames = sorted({*tree.frames, *sensor_frames})
    named = [
        frame for name in _BODIES for frame in frames if frame.rpartition('/')[2].lower() == name
    ]
    named += [frame for frame in frames if _ROBOT_BASE.search(frame) and not _SENSOR.search(frame)]
    anchors = {tree.anchor(frame) for frame in sensor_frames}
    for frame in named:
        if tree.anchor(frame) in anchors:
            return Heading(frame, AXES['x'], f'x of {frame}', body=True)
    return None


def root_heading(tree: FrameTree, sensors: Iterable[str]) -> Heading | None:
    """Return the heading of a root above several sensors, which is no sensor: it is the robot's."""
    present = {frame for frame in sensors if frame in tree.frames}
    joined = Counter(tree.anchor(frame) for frame in present)
    for root in tree.roots:
        other = root in present or _SENSOR.search(root) or is_optical(root) or root in FIXED_FRAMES
        if not other and joined[root] > 1:
            return Heading(root, AXES['x'], f'x of {root}', body=True)
    return None


def known_heading(tree: FrameTree, frame: str) -> Heading | None:
    """Return the heading of a scanner's frame that its name implies: Ouster's, optical ones."""
    match = _OUSTER.match(frame)
    sensor = f'{match["prefix"]}os_sensor' if match else ''
    if sensor and tree.find(sensor, frame) is not None:
        return Heading(sensor, AXES['x'], f'x of {sensor}')
    if is_optical(frame):
        return Heading(frame, AXES['z'], f'z of {frame}')
    return None


def nearest_axis(rotation: Float64Array) -> str:
    """Return the key of AXES nearest to a rotation (columns forward, left, up in a frame)."""
    return max(AXES, key=lambda name: float(np.trace(AXES[name].T @ rotation)))


def describe_direction(direction: Float64Array) -> str:
    """Describe a (3,) direction, given in forward, left, up, as an angle from forward."""
    forward, left, up = direction / np.linalg.norm(direction)
    steep = np.degrees(np.arcsin(np.clip(up, -1, 1)))
    if abs(steep) > _STEEP_DEG:
        return f'{abs(steep):.0f} degrees {"up" if up > 0 else "down"}'
    degrees = float(np.degrees(np.arctan2(left, forward)))
    if abs(degrees) >= _BACKWARD_DEG:
        return 'backward'
    if round(abs(degrees)) == 0:
        return 'forward'
    return f'{abs(degrees):.0f} degrees to the {"left" if left > 0 else "right"}'


# Transforms of a bag as links: which stay as they are, and which move.

_STILL_M = 1e-6
_JITTER_M = 5e-4
"""Limit by which a rig's own transforms may differ on /tf, computed anew for each message, say from
float32; less than a calibration is known to. A robot's slow way is none."""


class LinkTally:
    """Transforms by (parent, child): the first of each, and whether it moved."""

    def __init__(self) -> None:
        self._first: dict[tuple[str, str], Transform] = {}
        self._seen: dict[tuple[str, str], int] = defaultdict(int)
        self._moving: set[tuple[str, str]] = set()
        self._static: set[tuple[str, str]] = set()
        self._values: dict[tuple[str, str], list[tuple[int, int, Transform]]] = defaultdict(list)
        self._invalid: Counter[tuple[str, str]] = Counter()
        self._topics: dict[tuple[str, str], str] = {}
        self.clashes: dict[tuple[str, str], tuple[str, str]] = {}
        """Links that topics of two namespaces have otherwise, with these: see add."""

    def add(self, message: Any, *, still: bool, topic: str = '', log_ns: int = 0) -> None:  # noqa: ANN401
        """Add the transforms of a TFMessage of the bag's types.

        Args:
            message: The message.
            still: Whether it is of /tf_static.
            log_ns: When it was recorded, nanoseconds.
            topic: Its topic. Those of robots with the same names of frames differ by a namespace.
        """
        for stamped in message.transforms:
            key = (plain(stamped.header.frame_id), plain(stamped.child_frame_id))
            if key in self._moving and not still:
                self._check_robot(key, topic)
                continue  # known to move
            ((_, _, transform),) = decode_static(TFMessage([stamped]))
            if not still and not _is_finite(transform):
                self._invalid[key] += 1
                self._first.setdefault(key, transform)
                continue
            first = self._first.setdefault(key, transform)
            if not still and not self._seen[key]:  # those before were invalid
                self._first[key] = first = transform
            self._seen[key] += 1
            self._topics.setdefault(key, topic)
            if still:
                # The last value of a static link is valid, as for late subscribers.
                changed = first is not transform and differ(first, transform, _STILL_M)
                if changed or key not in self._values:
                    entry = stamp_ns_of(stamped.header), log_ns, transform
                    self._values[key].append(entry)
                if changed:
                    self._check_robot(key, topic)
                self._first[key] = transform
                self._static.add(key)
            elif key not in self._moving and differ(first, transform, _still(key[0])):
                self._moving.add(key)
                self._check_robot(key, topic)

    def _check_robot(self, key: tuple[str, str], topic: str) -> None:
        earlier = self._topics[key]
        if earlier != topic and earlier.rpartition('/')[0] != topic.rpartition('/')[0]:
            self.clashes.setdefault(key, (earlier, topic))

    def invalid(self) -> dict[tuple[str, str], int]:
        """Return the links on /tf without a valid transform, each with the number of the others."""
        return {key: count for key, count in sorted(self._invalid.items()) if not self._seen[key]}

    def sorted(self) -> tuple[list[Link], list[tuple[str, str]], list[tuple[str, str]]]:
        """Return static, moving and changing static links; one seen only once on /tf is moving."""
        moving = {key for key in self._moving if key not in self._static}
        moving |= {key for key, n in self._seen.items() if n == 1 and key not in self._static}
        still = [(*key, pose) for key, pose in self._first.items() if key not in moving]
        return still, sorted(moving), sorted(self.changes())

    def changes(self) -> dict[tuple[str, str], list[tuple[int, Transform]]]:
        """Return the values of static links that change, each with the stamp it is valid from.

        Log times count where the stamps do not ascend.
        """
        changes = {}
        for key, values in sorted(self._values.items()):
            if len(values) > 1:
                headers = [header_ns for header_ns, _, _ in values]
                ascend = headers[0] > 0 and all(a < b for a, b in pairwise(headers))
                changes[key] = [(own if ascend else log, pose) for own, log, pose in values]
        return changes


def _still(parent: str) -> float:
    """Return by how much the transforms of a link on /tf may differ that does not move."""
    return _STILL_M if parent.rpartition('/')[2] in FIXED_FRAMES else _JITTER_M


def _is_finite(transform: Transform) -> bool:
    """Return whether no number is NaN or infinite; a quaternion of zeros has become NaN."""
    return bool(np.isfinite(transform.matrix()).all())
