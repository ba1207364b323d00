# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The static part of a bag's TF tree.

As in tf2, every frame has one parent, and ROS 1's leading slash is not part of a frame's name.
"""

from __future__ import annotations

from collections import defaultdict
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import MissingDataError
from ..model.geometry import Transform
from ..model.spelling import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TypeAlias

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
            known = above.setdefault(plain(parent), transform)
            if (
                known is not None
                and known is not transform
                and differ(known, transform, _SAME_LINK)
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
        for found in (self._faults, self._below, self._lines_up, self._anchors):
            found.clear()
        for name in ('_children', '_description'):
            vars(self).pop(name, None)

    @cached_property
    def _children(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = defaultdict(list)
        for child, above in sorted(self._parents.items()):
            for parent, link in above.items():
                if link is not None:
                    found[parent].append(child)
        return found

    def transform(self, target: str, source: str) -> Transform:
        """Return target_T_source through static links; the identity for twice the same name.

        Raises:
            MissingDataError: A frame is unknown, the two are in different trees, a link between
                them moves, a frame between them has two parents or two places, there is a cycle, or
                a rotation is invalid. The message shows the tree.
        """
        found = self._join(plain(target), plain(source))
        if isinstance(found, Transform):
            return found
        raise MissingDataError(
            f'no static transform from {_shown(source)} to {_shown(target)}: {found}; the bag has'
            f' {self} (add the link to the bag, name other frames in the plan, or give --calib)'
            f'{self._lost}'
        )

    def find(self, target: str, source: str) -> Transform | None:
        """Return target_T_source as transform does, None instead of an error."""
        if not self.joins(target, source):
            return None
        found = self._join(plain(target), plain(source))
        return found if isinstance(found, Transform) else None

    def joins(self, target: str, source: str) -> bool:
        """Whether transform has no error for two frames."""
        return self.anchor(target) == self.anchor(source)

    def anchor(self, frame: str) -> str:
        """Return the highest frame that static links join to a frame, which may be itself.

        Two frames have the same anchor if and only if static links join them.
        """
        name = plain(frame)
        known = self._anchors.get(name)
        if known is None:
            known = self._anchors[name] = self._find_anchor(name)
        return known

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
        """Whether a frame, which may be unknown, has no parent."""
        return not self._parents.get(frame)

    def root_of(self, frame: str) -> str:
        """Return the root of a frame's tree."""
        return self._ancestors(plain(frame))[-1]

    def faults(self) -> list[str]:
        """Describe the frames with several parents, and the circles."""
        found = [
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
                found.append(f'{" <- ".join(circle)} is a circle')
        return found

    def steps(self, target: str, source: str) -> tuple[list[Step], list[Step]]:
        """Return the links from the common ancestor down to target, and down to source.

        Raises:
            MissingDataError: As transform, except that links may move.
        """
        found = self._lines(plain(target), plain(source))
        steps: list[list[Step]] = []
        for line in found if not isinstance(found, str) else ():
            links = [
                (parent, child, self._parents[child][parent]) for child, parent in pairwise(line)
            ]
            fault = next(filter(None, (self._fault(*link) for link in links)), '')
            if fault:
                found = fault
                break
            steps.append(links[::-1])
        if isinstance(found, str):
            raise MissingDataError(
                f'no transform from {_shown(source)} to {_shown(target)}: {found}; the bag has'
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
        known = self._lines_up.get(frame)
        if known is None:
            known = self._lines_up[frame] = self._walk_up(frame)
        return known

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
        known = self._below[line[-1]]
        known.setdefault(line[-1], Transform.identity())
        first = next(at for at, frame in enumerate(line) if frame in known)
        for child, parent in reversed(list(pairwise(line[: first + 1]))):
            known[child] = self._one_below(known[parent], parent, child)
        return known[line[0]]

    def _one_below(self, top_t_parent: Transform | str, parent: str, child: str) -> Transform | str:
        """Return top_T_child, or why there is none: what is next to the child counts first."""
        link = self._parents[child][parent]
        if link is None:
            return f'{parent} -> {child} moves'
        fault = self._fault(parent, child, link)
        return fault or (top_t_parent if isinstance(top_t_parent, str) else top_t_parent @ link)

    def _fault(self, parent: str, child: str, link: Transform | None) -> str:
        """Return why a static link cannot be used, empty if it can."""
        known = self._faults.get((parent, child))
        if known is None:
            known = self._faults[parent, child] = self._find_fault(parent, child, link)
        return known

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
    """Whether two transforms differ by more than a limit in any element."""
    with np.errstate(invalid='ignore'):
        return bool((np.abs(first.matrix() - second.matrix()) > limit).any())


def _is_rigid(link: Transform) -> bool:
    """Whether a link is a valid rotation and translation; a quaternion of zeros is NaN here."""
    if not (np.abs(link.matrix()) <= _FARTHEST_M).all() or np.linalg.det(link.rotation) < 0:
        return False
    product = link.rotation @ link.rotation.T
    return bool(np.abs(product - np.eye(3)).max() < _ROTATION)
