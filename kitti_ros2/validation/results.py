# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The result of a validation: findings by rule, with counts that are complete."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .rule import MOST_KEPT, RuleSeverity

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from .rule import Breach, Rule


@dataclass(frozen=True)
class ValidationFinding:
    """A place that breaks a rule.

    Attributes:
        rule: The id of the rule.
        severity: error, warning or note.
        path: The file or folder.
        line: Of a text file, from 1; None where there is none.
        message: What was found there.
        remedy: What to do about it.
    """

    rule: str
    severity: str
    path: Path
    line: int | None
    message: str
    remedy: str

    @property
    def place(self) -> str:
        """The path, with the line if there is one."""
        return f'{self.path}' if self.line is None else f'{self.path}:{self.line}'


@dataclass(frozen=True)
class RuleFindings:
    """The findings of a rule.

    Attributes:
        rule: Its id.
        severity: error, warning or note.
        checks: What holds in valid data.
        remedy: What to do about a breach.
        count: Number of findings.
        findings: The first of them, at most 1000.
    """

    rule: str
    severity: str
    checks: str
    remedy: str
    count: int
    findings: tuple[ValidationFinding, ...]


@dataclass(frozen=True)
class CheckedSource:
    """A recording or bag that was checked.

    Attributes:
        path: The folder, or the bag.
        kind: Its layout or container.
        name: Of the drive, split or sequence; the file name of a bag.
        count: Number of frames, or of messages in a bag.
        files: Number of files that were checked.
        size_bytes: Their size.
        is_bag: Whether it is a bag.
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
        sources: The recordings and bags that were checked.
        rules: The rules that were broken, errors first.
        errors, warnings, notes: Number of findings of each severity.
    """

    sources: tuple[CheckedSource, ...]
    rules: tuple[RuleFindings, ...]
    errors: int
    warnings: int
    notes: int

    @property
    def ok(self) -> bool:
        """Whether there are no errors."""
        return not self.errors

    @property
    def findings(self) -> tuple[ValidationFinding, ...]:
        """The findings of all rules, at most 1000 of each, errors first."""
        return tuple(each for group in self.rules for each in group.findings)


@dataclass
class FindingTally:
    """Collects breaches by rule.

    Attributes:
        known: All rules by id.
    """

    known: Mapping[str, Rule]  # type: ignore[type-arg] # of any subject
    _counts: Counter[str] = field(default_factory=Counter)
    _kept: dict[str, dict[Breach, None]] = field(default_factory=dict)

    def add(self, found: Iterable[tuple[str, Breach]]) -> None:
        """Add breaches; one that was added before counts once."""
        for rule, breach in found:
            kept = self._kept.setdefault(rule, {})
            if breach in kept:
                continue
            self._counts[rule] += 1
            if len(kept) < MOST_KEPT:
                kept[breach] = None

    def report(self, sources: Iterable[CheckedSource]) -> ValidationReport:
        """Return the report of all that was added."""
        order = list(RuleSeverity)
        places = {rule: place for place, rule in enumerate(self.known)}
        found = sorted(
            self._kept, key=lambda each: (order.index(self.known[each].severity), places[each])
        )
        groups = tuple(map(self._group, found))
        totals = {
            severity: sum(each.count for each in groups if each.severity == severity.value)
            for severity in order
        }
        return ValidationReport(tuple(sources), groups, *totals.values())

    def _group(self, rule_id: str) -> RuleFindings:
        rule = self.known[rule_id]
        severity = rule.severity.value
        findings = tuple(
            ValidationFinding(rule_id, severity, each.path, each.line, each.text, rule.remedy)
            for each in self._kept[rule_id]
        )
        count = self._counts[rule_id]
        return RuleFindings(rule_id, severity, rule.checks, rule.remedy, count, findings)
