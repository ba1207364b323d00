# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules with severity and remedy, and the findings of a validation."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from ..files.remote import as_path
from ..model.errors import BadFileError, KittiRos2Error, describe_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path


# A rule: its check, the severity of a breach, and the remedy.

S = TypeVar('S')

_LINE = re.compile(r'(?P<path>.+?)(?::(?P<line>\d+))?: (?P<text>.+)', re.DOTALL)
MOST_FINDINGS = 1000
"""Most findings of a rule in a report; others are counted only, which bounds memory."""


class RuleSeverity(str, Enum):
    """The severity of a breach."""

    ERROR = 'error'
    """Wrong or unreadable data: exit code 1."""
    WARNING = 'warning'
    """Suspicious data, or missing data that is usually there."""
    NOTE = 'note'
    """A line that costs no data."""


ERROR, WARNING, NOTE = RuleSeverity


class RuleScope(str, Enum):
    """The extent of the data that a rule checks at once."""

    FILE = 'file'
    FRAME = 'frame'
    STREAM = 'stream'
    RECORDING = 'recording'
    SET = 'set'
    BAG = 'bag'


class Breach(NamedTuple):
    """A breach of a rule, with its file and line.

    Attributes:
        text: Description, without the path.
        path: The file or folder.
        line: Line of a text file, from 1.
    """

    text: str
    path: Path
    line: int | None = None


@dataclass(frozen=True)
class Rule(Generic[S]):
    """A rule.

    Attributes:
        id: Name in the output.
        severity: Severity of a breach.
        scope: Extent of the data that it checks at once.
        checks: Condition of valid data.
        remedy: Remedy of a breach.
        find: Yields the breaches in a subject.
    """

    id: str
    severity: RuleSeverity
    scope: RuleScope
    checks: str
    remedy: str
    find: Callable[[S], Iterable[Breach]] = field(repr=False)


class RuleTable(list[Rule[S]]):
    """The rules about a kind of subject, in the order of reports.

    Args:
        scope: Extent of the data that they check at once.
    """

    def __init__(self, scope: RuleScope) -> None:
        super().__init__()
        self._scope = scope

    def add(
        self,
        rule_id: str,
        severity: RuleSeverity,
        checks: str,
        remedy: str,
        scope: RuleScope | None = None,
    ) -> Callable[[Callable[[S], Iterable[Breach]]], Callable[[S], Iterable[Breach]]]:
        """Add a rule for the decorated function, which finds its breaches; see Rule."""

        def add_rule(find: Callable[[S], Iterable[Breach]]) -> Callable[[S], Iterable[Breach]]:
            self.append(Rule(rule_id, severity, scope or self._scope, checks, remedy, find))
            return find

        return add_rule


def find_breaches(rules: Iterable[Rule[S]], subject: S) -> Iterator[tuple[str, Breach]]:
    """Yield the breaches of rules, each with the id of its rule."""
    for rule in rules:
        for breach in rule.find(subject):
            yield rule.id, breach


def breach_of(error: Exception, path: Path) -> Breach:
    """Return the breach of a reader's error.

    Args:
        error: A KittiRos2Error or OSError.
        path: The file of errors without one.
    """
    line = error.line if isinstance(error, KittiRos2Error) else None
    error_path = error.path if isinstance(error, KittiRos2Error) else None
    file = as_path(error_path) if error_path else path
    text = _without_path(describe_error(error), str(file), line)
    if isinstance(error, BadFileError):
        text = text.removesuffix(f' ({error.remedy})')  # rules have their own
    return Breach(text, file, line)


def breach_in(text: str, path: Path) -> Breach:
    """Split a reader's line into file, line number and reason.

    Args:
        text: A line, possibly with a file and the number of a line at its beginning.
        path: The folder or bag; files elsewhere are not recognized.
    """
    match = _LINE.fullmatch(text)
    if match is None or not (match['path'] == str(path) or _is_below(match['path'], path)):
        return Breach(text, path)
    return Breach(
        match['text'], as_path(match['path']), int(match['line']) if match['line'] else None
    )


def _is_below(name: str, path: Path) -> bool:
    file = as_path(name)
    return file.is_absolute() == path.is_absolute() and (
        path in file.parents or path.parent in file.parents
    )


def _without_path(text: str, path: str, line: int | None) -> str:
    for head in (f'{path}:{line}: ', f'{path}: '):
        if text.startswith(head):
            return text[len(head) :]
    return text


# The result of a validation: findings by rule, with complete counts.


@dataclass(frozen=True)
class ValidationFinding:
    """A breach of a rule, with its file and line.

    Attributes:
        rule: The id of the rule.
        severity: error, warning or note.
        path: The file or folder.
        line: Line of a text file, from 1; None without one.
        message: Description, without the path.
        remedy: Remedy.
    """

    rule: str
    severity: str
    path: Path
    line: int | None
    message: str
    remedy: str

    @property
    def place(self) -> str:
        """The path, with the line if any."""
        return f'{self.path}' if self.line is None else f'{self.path}:{self.line}'


@dataclass(frozen=True)
class RuleFindings:
    """The findings of a rule.

    Attributes:
        rule: Id of the rule.
        severity: error, warning or note.
        checks: Condition of valid data.
        remedy: Remedy of a breach.
        count: Number of findings.
        findings: The first findings, at most 1000.
    """

    rule: str
    severity: str
    checks: str
    remedy: str
    count: int
    findings: tuple[ValidationFinding, ...]


@dataclass(frozen=True)
class CheckedSource:
    """A checked recording or bag.

    Attributes:
        path: The folder, or the bag.
        kind: Layout or container.
        name: Name of the drive, split or sequence; file name of a bag.
        count: Number of frames, or of messages in a bag.
        files: Number of checked files.
        size_bytes: Their size.
        is_bag: True for a bag.
    """

    path: Path
    kind: str
    name: str
    count: int
    files: int
    size_bytes: int
    is_bag: bool = False


@dataclass(frozen=True)
class ValidationReport:
    """The result of a validation.

    Attributes:
        sources: The checked recordings and bags.
        rules: The broken rules, errors first.
        errors, warnings, notes: Number of findings of each severity.
    """

    sources: tuple[CheckedSource, ...]
    rules: tuple[RuleFindings, ...]
    errors: int
    warnings: int
    notes: int

    @property
    def ok(self) -> bool:
        """True if there are no errors."""
        return not self.errors

    @property
    def findings(self) -> tuple[ValidationFinding, ...]:
        """The findings of all rules, at most 1000 of each, errors first."""
        return tuple(finding for group in self.rules for finding in group.findings)


@dataclass
class FindingTally:
    """Collects breaches by rule.

    Attributes:
        rules: All rules by id.
    """

    rules: Mapping[str, Rule]  # type: ignore[type-arg] # of any subject
    _counts: Counter[str] = field(default_factory=Counter)
    _breaches: dict[str, dict[Breach, None]] = field(default_factory=dict)

    def add(self, breaches: Iterable[tuple[str, Breach]]) -> None:
        """Add breaches; equal ones count once."""
        for rule, breach in breaches:
            rule_breaches = self._breaches.setdefault(rule, {})
            if breach in rule_breaches:
                continue
            self._counts[rule] += 1
            if len(rule_breaches) < MOST_FINDINGS:
                rule_breaches[breach] = None

    def report(self, sources: Iterable[CheckedSource]) -> ValidationReport:
        """Return the report of all added breaches."""
        order = list(RuleSeverity)
        positions = {rule: position for position, rule in enumerate(self.rules)}
        rule_ids = sorted(
            self._breaches,
            key=lambda rule: (order.index(self.rules[rule].severity), positions[rule]),
        )
        groups = tuple(map(self._group, rule_ids))
        totals = {
            severity: sum(group.count for group in groups if group.severity == severity.value)
            for severity in order
        }
        return ValidationReport(tuple(sources), groups, *totals.values())

    def _group(self, rule_id: str) -> RuleFindings:
        rule = self.rules[rule_id]
        severity = rule.severity.value
        findings = tuple(
            ValidationFinding(rule_id, severity, breach.path, breach.line, breach.text, rule.remedy)
            for breach in self._breaches[rule_id]
        )
        count = self._counts[rule_id]
        return RuleFindings(rule_id, severity, rule.checks, rule.remedy, count, findings)


# Rules about the arguments: openable, and searched to the end.


@dataclass(frozen=True, eq=False)
class Unopened:
    """A recording, data set or bag that cannot be opened, or a folder not searched to the end.

    Attributes:
        path: The folder or bag.
        error: Error of opening; None if the search ended early.
    """

    path: Path
    error: Exception | None = None


SOURCE_RULES = RuleTable[Unopened](RuleScope.SET)


@SOURCE_RULES.add(
    'source-open',
    ERROR,
    'Recordings and bags can be opened',
    'check permissions and links, or copy it again',
)
def _find_unopened(source: Unopened) -> Iterator[Breach]:
    if source.error is not None:
        yield breach_of(source.error, source.path)


@SOURCE_RULES.add(
    'source-large',
    WARNING,
    'Folders are searched for data sets to the end',
    'give the data sets themselves',
)
def _find_unsearched(source: Unopened) -> Iterator[Breach]:
    if source.error is None:
        yield Breach('only the first 300 folders, 4 levels deep, were searched', source.path)
