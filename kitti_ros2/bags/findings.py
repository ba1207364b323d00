# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes and losses found while a bag is read."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Findings:
    """Notes and losses of a bag, each listed once.

    Attributes:
        notes: Non-fatal remarks without loss, one line each.
        losses: Damaged or unreadable parts, one line each with their place (file, byte or row),
            and the number of lost messages; None if that is unknown.
    """

    notes: dict[str, None] = field(default_factory=dict)
    losses: dict[str, int | None] = field(default_factory=dict)

    def note(self, text: str) -> None:
        """Enter a remark that is not a loss."""
        self.notes[text] = None

    def lose(self, text: str, messages: int | None = None) -> None:
        """Enter a loss."""
        self.losses[text] = messages

    def lose_one(self, text: str) -> None:
        """Enter one more message that is lost for the same reason as others."""
        self.losses[text] = (self.losses.get(text) or 0) + 1

    def add(self, other: Findings) -> None:
        """Enter what others hold so far."""
        self.notes |= other.notes
        self.losses |= other.losses

    @property
    def complete(self) -> bool:
        """Whether nothing is known to be damaged."""
        return not self.losses

    @property
    def lines(self) -> tuple[str, ...]:
        """Notes and losses, one line each."""
        return (*self.notes, *self.losses)
