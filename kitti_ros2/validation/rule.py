# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A rule and its findings: what is checked, how bad a breach is, and what to do."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from ..files.remote import as_path
from ..model.errors import BadFileError, KittiRos2Error, describe_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

S = TypeVar('S')

_PLACE = re.compile(r'(?P<path>.+?)(?::(?P<line>\d+))?: (?P<text>.+)', re.DOTALL)
MOST_KEPT = 1000
"""Findings of a rule that a report keeps; the others are counted, so that memory stays flat."""


class RuleSeverity(str, Enum):
    """How bad a breach of a rule is."""

    ERROR = 'error'
    """Wrong or unreadable data: exit code 1."""
    WARNING = 'warning'
    """Suspicious data, or missing data that is usually there."""
    NOTE = 'note'
    """A remark."""


class RuleScope(str, Enum):
    """The extent of data that a rule sees at once."""

    FILE = 'file'
    FRAME = 'frame'
    STREAM = 'stream'
    RECORDING = 'recording'
    SET = 'set'
    BAG = 'bag'


class Breach(NamedTuple):
    """A place that breaks a rule.

    Attributes:
        text: What was found there, without the path.
        path: The file or folder.
        line: Of a text file, from 1.
    """

    text: str
    path: Path
    line: int | None = None


@dataclass(frozen=True)
class Rule(Generic[S]):
    """A rule.

    Attributes:
        id: Its name in the output.
        severity: How bad a breach is.
        scope: The extent of data that it sees at once.
        checks: What holds in valid data.
        remedy: What to do about a breach.
        find: Yields the places in a subject that break the rule.
    """

    id: str
    severity: RuleSeverity
    scope: RuleScope
    checks: str
    remedy: str
    find: Callable[[S], Iterable[Breach]] = field(repr=False)


def find_breaches(rules: Iterable[Rule[S]], subject: S) -> Iterator[tuple[str, Breach]]:
    """Yield the id of each broken rule with the place."""
    for rule in rules:
        for breach in rule.find(subject):
            yield rule.id, breach


def breach_of(error: Exception, path: Path) -> Breach:
    """Return the place and the reason of an error of a reader.

    Args:
        error: A KittiRos2Error or OSError.
        path: The file, for errors without one.
    """
    line = error.line if isinstance(error, KittiRos2Error) else None
    found = error.path if isinstance(error, KittiRos2Error) else None
    place = as_path(found) if found else path
    text = _without_place(describe_error(error), str(place), line)
    if isinstance(error, BadFileError):
        text = text.removesuffix(f' ({error.remedy})')  # rules have their own
    return Breach(text, place, line)


def breach_in(text: str, path: Path) -> Breach:
    """Split a reader's line into place and reason.

    Args:
        text: A line that may begin with a file, and the number of a line in it.
        path: The folder or bag that was read; files in other places are not recognized.
    """
    match = _PLACE.fullmatch(text)
    if match is None or not (match['path'] == str(path) or _is_below(match['path'], path)):
        return Breach(text, path)
    return Breach(
        match['text'], as_path(match['path']), int(match['line']) if match['line'] else None
    )


def _is_below(name: str, path: Path) -> bool:
    place = as_path(name)
    return place.is_absolute() == path.is_absolute() and (
        path in place.parents or path.parent in place.parents
    )


def _without_place(text: str, path: str, line: int | None) -> str:
    for head in (f'{path}:{line}: ', f'{path}: '):
        if text.startswith(head):
            return text[len(head) :]
    return text
