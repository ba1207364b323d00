# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about what is given: it can be opened, and searched to the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@dataclass(frozen=True, eq=False)
class Unopened:
    """A recording, data set or bag that cannot be opened; or a folder not searched to the end.

    Attributes:
        path: The folder or bag.
        error: Why it cannot be opened; None if the search ended early.
    """

    path: Path
    error: Exception | None = None


def _find_unopened(source: Unopened) -> Iterator[Breach]:
    if source.error is not None:
        yield breach_of(source.error, source.path)


def _find_unsearched(source: Unopened) -> Iterator[Breach]:
    if source.error is None:
        yield Breach('only the first 300 folders, 4 levels deep, were searched', source.path)


SOURCE_RULES: tuple[Rule[Unopened], ...] = (
    Rule(
        'source-open',
        RuleSeverity.ERROR,
        RuleScope.SET,
        'Recordings and bags can be opened',
        'check permissions and links, or copy it again',
        _find_unopened,
    ),
    Rule(
        'source-large',
        RuleSeverity.WARNING,
        RuleScope.SET,
        'Folders are searched for data sets to the end',
        'give the data sets themselves',
        _find_unsearched,
    ),
)
