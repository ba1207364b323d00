# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Losses: unusable data of the user, and the text form of file numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .text import format_count

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Sequence

    import numpy as np
    import numpy.typing as npt


@dataclass(frozen=True)
class Loss:
    """Unusable data of the user: stream, count and reason.

    Attributes:
        stream: Name of the stream or topic.
        count: Samples or messages.
        message: One line; {} stands for the numbers.
        numbers: File numbers, where they are known.
    """

    stream: str
    count: int
    message: str
    numbers: tuple[int, ...] = ()

    def within(self, lowest: int, highest: int) -> Loss | None:
        """Return the part between two file numbers, both included; all if none are known."""
        return self.among(range(lowest, highest + 1))

    def among(self, numbers: Container[int]) -> Loss | None:
        """Return the part that concerns some file numbers; all if none are known."""
        kept = tuple(number for number in self.numbers if number in numbers)
        if kept == self.numbers:
            return self
        return Loss(self.stream, len(kept), self.message, kept) if kept else None

    def text(self) -> str:
        """Return the message with its numbers."""
        return self.message.replace('{}', format_numbers(self.numbers))


def runs_of(numbers: Iterable[int]) -> list[list[int]]:
    """Return [first, last] of each run without a gap of ascending numbers."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return spans


def describe_frames(numbers: Sequence[int] | npt.NDArray[np.int64]) -> str:
    """Describe ascending frame numbers: how many, the first, the last, and whether some miss."""
    count, first, last = len(numbers), int(numbers[0]), int(numbers[-1])
    gaps = ' with gaps' if last - first + 1 != count else ''
    return f'{format_count(count, "frame")}, {first} to {last}{gaps}'


def format_numbers(numbers: Sequence[int], most: int = 6) -> str:
    """Format ascending numbers as ranges, such as ``3, 177-180 and 2 more``."""
    spans = runs_of(numbers)
    texts = [f'{first}' if first == last else f'{first}-{last}' for first, last in spans[:most]]
    rest = sum(last - first + 1 for first, last in spans[most:])
    return ', '.join(texts) + (f' and {rest} more' if rest else '')
