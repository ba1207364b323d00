# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a user should know of a bag that is being read."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Findings:
    """Grows while a bag is read; what is met again is told once.

    Attributes:
        notes: What is worth a word and no loss, one line each.
        losses: What is damaged or cannot be read, one line each with its place (file, byte or row),
            and how many messages it costs; None where that cannot be told.
    """

    notes: dict[str, None] = field(default_factory=dict)
    losses: dict[str, int | None] = field(default_factory=dict)

    def note(self, text: str) -> None:
        """Enter what is no loss."""
        self.notes[text] = None

    def lose(self, text: str, messages: int | None = None) -> None:
        """Enter what is damaged."""
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
        """Whether nothing is damaged, as far as is known."""
        return not self.losses

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything, one line each."""
        return (*self.notes, *self.losses)
