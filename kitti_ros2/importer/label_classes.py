# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of a bag's boxes as those of KITTI's labels, by a plan."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from ..messages.source import RECORDING
from ..messages.topics import own_topics
from ..model.class_names import OTHERS, kitti_class, plain
from ..model.text import one_line, some_of
from .labels import class_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from .plan import LabelPlan
    from .survey import Survey

_SHOWN = 12


class LabelClasses:
    """Maps classes, counts those that become Misc, and finds entries of the plan without a box.

    The plan's classes come first, then the defaults (model/class_names.py). Boxes of to-bag have
    KITTI's classes already, or those of the user's own labels: they have no defaults.
    """

    def __init__(self, plan: LabelPlan, *, own: bool) -> None:
        self._topic = plan.topic
        self._given = plan.classes
        self._by_word = {plain(name): kind for name, kind in plan.classes.items()}
        self._keeps = plan.keep_classes
        self._own = own
        self._others: Counter[str] = Counter()
        self._unmatched = {
            name for name, kind in plan.classes.items() if kind != (kitti_class(name) or OTHERS)
        }

    def find(self, name: str) -> str:
        """Return the class of a label for that of a box."""
        word = plain(name)
        given = self._given.get(name) or self._by_word.get(word or name)
        if given is not None and self._unmatched:
            self._unmatched = {
                each for each in self._unmatched if each != name and plain(each) != word
            }
        if self._own and given is None:
            return class_name(name)
        known = kitti_class(name)
        found = given or known or OTHERS
        if found != OTHERS or known == OTHERS:
            return found
        if self._keeps:
            return class_name(name)
        self._others[name.strip() or 'no class'] += 1
        return found

    def notes(self) -> list[str]:
        """Return notes on the boxes so far that became Misc, and on classes without a box."""
        found = others_note(self._topic, self._others, 'were written')
        if self._unmatched:
            names = some_of([one_line(name) for name in sorted(self._unmatched)], _SHOWN)
            found.append(f'{self._topic}: no box is of these labels.classes of the plan: {names}')
        return found


def others_note(topic: str, others: Mapping[str, int], done: str) -> list[str]:
    """Return a note on boxes without a class of KITTI, none without such boxes."""
    if not others:
        return []
    ordered = sorted(others.items(), key=lambda each: (-each[1], each[0]))
    names = some_of([f'{one_line(name)} ({count})' for name, count in ordered], _SHOWN)
    note = (
        f'{topic}: {sum(others.values())} boxes {done} as {OTHERS}: {names}; labels.classes of the'
        f' plan maps them, labels.keep_classes: true keeps their names'
    )
    return [note]


def is_own(survey: Survey, topic: str) -> bool:
    """Whether a topic was written by to-bag."""
    return RECORDING in survey.topics and topic in own_topics()


def default_classes(names: Iterable[str]) -> dict[str, str]:
    """Return KITTI's class of each name that is another, Misc for unknown ones."""
    found = {name: kitti_class(name) or OTHERS for name in sorted(names) if name.strip()}
    return {name: kind for name, kind in found.items() if name != kind}


def others_of(names: Mapping[str, int]) -> dict[str, int]:
    """Return the names without a class of KITTI, with their counts."""
    return {name: count for name, count in names.items() if kitti_class(name) is None}
