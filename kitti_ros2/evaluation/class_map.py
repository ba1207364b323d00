# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of results as KITTI's."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING

from ..model.losses import Loss
from ..model.text import some_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

CLASSES = ('Car', 'Van', 'Truck', 'Pedestrian', 'Person_sitting', 'Cyclist', 'Tram', 'Misc')
"""The classes of KITTI's labels; those of tracking have Person for Person_sitting."""

_OTHERS = '*'
_SHOWN = 5
_PUNCTUATION = re.compile(r'[\s()_-]+')


class ClassMap:
    """Maps the classes of results to KITTI's, and counts those without one.

    Args:
        given: KITTI's class of a class, by its name or numeric id; an empty one leaves its boxes
            out, and the name * stands for all other classes.
        known: Classes that stand for themselves, in any case and with any blanks or brackets.
    """

    def __init__(self, given: Mapping[str, str], known: Iterable[str] = CLASSES) -> None:
        self._known = {_word(name): name for name in known}
        self._given = {own: self._known.get(_word(name), name) for own, name in given.items()}
        self._known |= {_word(name): name for name in self._given.values() if name}
        self._unknown: Counter[str] = Counter()

    def find(self, *names: str) -> str:
        """Return KITTI's class of a box by the first of its names that has one.

        Empty for a box that is left out.
        """
        for name in names:
            if name in self._given:
                return self._given[name]
        for name in names:
            if _word(name) in self._known:
                return self._known[_word(name)]
        if _OTHERS in self._given:
            return self._given[_OTHERS]
        self._unknown[next(filter(None, names), '')] += 1
        return ''

    def losses(self, stream: str) -> tuple[Loss, ...]:
        """Return the boxes so far of classes that are unknown.

        Args:
            stream: Their topic or file.
        """
        if not self._unknown:
            return ()
        counted = [f'{name!r} ({count})' for name, count in self._unknown.most_common()]
        first = next(iter(self._unknown)) or _OTHERS
        text = (
            f"{stream}: boxes of classes that are not among KITTI's: {some_of(counted, _SHOWN)};"
            f" map them, such as --class-map '{first}=Car', or leave them out with '{first}='"
        )
        count = sum(self._unknown.values())
        return (Loss(stream, count, text.replace('{', '(').replace('}', ')')),)


def _word(name: str) -> str:
    """Return a class for comparisons: Person (sitting), as in tracklets, is person_sitting."""
    return _PUNCTUATION.sub('_', name).strip('_').lower()
