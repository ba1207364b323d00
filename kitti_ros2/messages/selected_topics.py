# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Topics that --topics and --exclude-topics select."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from ..model.spelling import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from ..options.selection import SelectionOptions
    from .topics import Topic


def select_topics(table: list[Topic], selection: SelectionOptions) -> list[Topic]:
    """Select the rows whose names match a pattern of topics and none of exclude_topics.

    Patterns are shell wildcards; without topics all are selected.

    Raises:
        UsageError: No row is selected.
    """
    names = set(match_names([row.topic for row in table], selection))
    return [row for row in table if row.topic in names]


def match_names(names: list[str], selection: SelectionOptions) -> list[str]:
    """Select topic names; see select_topics."""
    patterns, excluded = selection.topics, selection.exclude_topics
    selected = [name for name in names if not patterns or _matches(name, patterns)]
    if not selected and patterns:
        hints = [_close_topics(each, names) for each in patterns]
        hint = ''.join(hints) or f'; there are {", ".join(sorted(names))}'
        raise UsageError(f'no topic is called {" or ".join(patterns)}{hint}')
    kept = [name for name in selected if not _matches(name, excluded)]
    if selected and not kept:
        raise UsageError(f'no topic is left without {" and ".join(excluded)}; exclude fewer')
    return kept


def _matches(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(name, each) for each in patterns)


def unmatched(names: Collection[str], selection: SelectionOptions) -> list[str]:
    """Return a note on each pattern of topics and exclude_topics that matches no topic."""
    return [
        f'no topic is called {each}{_close_topics(each, sorted(names))}'
        for each in (*selection.topics, *selection.exclude_topics)
        if not any(fnmatchcase(name, each) for name in names)
    ]


def _close_topics(pattern: str, names: Sequence[str]) -> str:
    """Return the question for a misspelt topic, or for a misspelt pattern of several."""
    known = list(names)
    if '*' in pattern:
        words = [name.split('/') for name in names]
        known = [f'{"/".join(each[:at])}/*' for each in words for at in range(1, len(each))]
        known += [f'*/{"/".join(each[at:])}' for each in words for at in range(1, len(each))]
    return did_you_mean(pattern, known)
