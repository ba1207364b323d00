# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Check of the classes that a plan maps."""

from __future__ import annotations

from ..model.class_names import KITTI_CLASSES, own_class
from ..model.errors import UsageError
from ..model.spelling import did_you_mean
from ..model.text import shown


def check_classes(classes: object, where: str, *, any_word: bool) -> dict[str, str]:
    """Return the classes of a plan by name or number, with KITTI's spelling.

    Args:
        classes: As it is in the file.
        where: The file and the key.
        any_word: Whether other classes than KITTI's are valid.

    Raises:
        UsageError: One is invalid; the error names the key.
    """
    if not isinstance(classes, dict):
        raise UsageError(f'{where}: {shown(classes)}; expected NAME: CLASS, ...')
    found = {}
    for name, wanted in classes.items():
        if type(name) not in (str, int) or not isinstance(wanted, str):
            raise UsageError(
                f'{where}: {shown(name)}: {shown(wanted)}; expected two texts (quote numbers)'
            )
        kind = own_class(wanted)
        is_word = wanted.isprintable() and len(wanted.split()) == 1
        if kind is None and not (any_word and is_word):
            raise UsageError(
                f'{where}: {name}: {wanted!r}; expected {", ".join(KITTI_CLASSES)}, or any word'
                f' with keep_classes: true{did_you_mean(wanted, KITTI_CLASSES)}'
            )
        found[str(name)] = kind or wanted
    return found
