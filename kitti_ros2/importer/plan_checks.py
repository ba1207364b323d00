# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the values of a plan that its types do not express."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..model.class_names import KITTI_CLASSES, own_class
from ..model.errors import UsageError
from ..model.spelling import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from .plan import LabelPlan


def check_parts(made: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Check the values of scan and labels; return the labels, whose classes get KITTI's spelling.

    Raises:
        UsageError: A value is invalid; the error names the key.
    """
    scan, labels = made.get('scan'), made.get('labels')
    if scan is not None and scan.minimum_range_m < 0:
        raise UsageError(
            f'{path}: scan: minimum_range_m: {scan.minimum_range_m}; expected 0 or more'
        )
    if labels is not None and labels.occluded not in range(4):
        raise UsageError(f'{path}: labels: occluded: {labels.occluded}; expected 0 to 3')
    if labels is not None:
        return {'labels': replace(labels, classes=_classes(labels, path))}
    return {}


def _classes(labels: LabelPlan, path: Path) -> Mapping[str, str]:
    """Check the classes of a plan; returns them with KITTI's spelling."""
    where = f'{path}: labels: classes'
    if not isinstance(labels.classes, dict):
        raise UsageError(f'{where}: {labels.classes!r}; expected NAME: CLASS, ...')
    found = {}
    for name, wanted in labels.classes.items():
        if type(name) not in (str, int) or not isinstance(wanted, str):
            raise UsageError(f'{where}: {name!r}: {wanted!r}; expected two texts (quote numbers)')
        kind = own_class(wanted)
        if kind is None and not (labels.keep_classes and len(wanted.split()) == 1):
            known = ', '.join(KITTI_CLASSES)
            hint = did_you_mean(wanted, KITTI_CLASSES)
            raise UsageError(
                f'{where}: {name}: {wanted!r}; expected {known}, or any word with'
                f' keep_classes: true{hint}'
            )
        found[str(name)] = kind or wanted
    return found
