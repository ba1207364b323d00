# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Non-fatal remarks on samples, collected while they are encoded."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..model.losses import format_numbers

if TYPE_CHECKING:
    from ..model.samples import Calibration


@dataclass(frozen=True)
class Remarks:
    """Remarks on the samples encoded so far.

    Attributes:
        nominal: Parts of the calibration for which a nominal value is used.
        calibration: Notes on calibration files.
        estimated: The scans that a remark is on, by its text.
    """

    nominal: set[str] = field(default_factory=set)
    calibration: set[str] = field(default_factory=set)
    estimated: dict[str, set[int]] = field(default_factory=dict)

    def add_calibration(self, calibration: Calibration) -> None:
        """Add the notes on a calibration, and its parts for which a nominal value is used."""
        self.nominal.update(calibration.nominal)
        self.calibration.update(calibration.notes)

    def add_estimated(self, text: str, number: int) -> None:
        """Add a remark on a scan."""
        self.estimated.setdefault(text, set()).add(number)

    def add(self, other: Remarks) -> None:
        """Add the remarks on other samples."""
        self.nominal.update(other.nominal)
        self.calibration.update(other.calibration)
        for text, numbers in other.estimated.items():
            self.estimated.setdefault(text, set()).update(numbers)

    def on_calibration(self) -> list[str]:
        """Return the notes on calibration files and nominal values."""
        return sorted(self.calibration) + [
            f'{part}: not in the calibration, a nominal value is used'
            for part in sorted(self.nominal)
        ]

    def on_scans(self) -> list[str]:
        """Return the notes on scans."""
        return [
            f'{text}: scans {format_numbers(sorted(numbers))}'
            for text, numbers in sorted(self.estimated.items())
        ]
