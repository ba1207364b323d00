# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lists that a user gives, with their entries looked up in the data set."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti import names
from ..kitti.image_set import parse_image_set
from ..kitti.store import STORE
from ..model.errors import MissingPathError, UsageError
from ..model.losses import Loss
from ..model.text import some_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from .units import UnitSet


def read_lists(files: Sequence[Path], found: UnitSet) -> list[GivenList]:
    """Read lists.

    Raises:
        UsageError: A file does not exist, or two have one name.
        KittiRos2Error, OSError: One cannot be read.
    """
    lists: dict[str, GivenList] = {}
    for file in files:
        given = GivenList(file, found)
        if given.name in lists:
            raise UsageError(f'{lists[given.name].path} and {file} have the same name')
        lists[given.name] = given
    return [*lists.values()]


class GivenList:
    """A list and its entries that the set has.

    Attributes:
        path: Its file.
        name: The name of the file, without suffix.
        entries: Those of the set, in the order of the file.
    """

    def __init__(self, path: Path, found: UnitSet) -> None:
        if not path.is_file():
            raise MissingPathError(path)
        self.path = path
        self.name = path.name.removesuffix(names.TXT)
        self._noun = found.noun
        testing = found.is_of_testing(self.name)
        known = found.testing_frames if testing else found.frames
        self._parsed = parse_image_set(
            STORE.read_text(path), path, frames=found.lists_frames, known=known
        )
        units = found.testing if testing else found.units
        self._unchecked = units is None
        every = self._parsed.entries
        self.entries = [*every] if units is None else [name for name in every if name in units]
        self._unknown = [name for name in every if units is not None and name not in units]

    def require_entries(self) -> None:
        """Check that it has an entry.

        Raises:
            UsageError: It has none.
        """
        if not self.entries:
            reasons = [*self._parsed.invalid, f'{self.path}: no {self._noun} of the set']
            raise UsageError(f'{reasons[0]}; the list would be empty')

    def losses(self, *, checked: bool) -> list[Loss]:
        """Return what could not be used, and what other readers may not accept if it is checked."""
        reasons = [*self._parsed.invalid, *(self._parsed.repaired if checked else ())]
        losses = [Loss(self.name, 1, reason.replace('{', '(')) for reason in reasons]
        if self._unknown:
            what = some_of(self._unknown, 5)
            text = f'{self.path}: not in the set: {what}'
            losses.append(Loss(self.name, len(self._unknown), text))
        return losses

    def notes(self, *, checked: bool) -> list[str]:
        """Return remarks."""
        notes = [] if checked else [f'{each}; corrected' for each in self._parsed.repaired]
        if self._unchecked:
            notes.append(f'{self.path}: of testing frames, which are not there to compare')
        if not self._parsed.entries and not self._parsed.invalid:
            notes.append(f'{self.path}: is empty')
        return notes
