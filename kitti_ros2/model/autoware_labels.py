# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's classes as labels of Autoware, and back.

The labels are those of autoware_perception_msgs/ObjectClassification. Several classes have the same
label, so that the way back is not exact; docs/reference/topics.md has the table with reasons.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

from .spelling import not_one_of

if TYPE_CHECKING:
    from collections.abc import Mapping


class AutowareLabel(IntEnum):
    """The constants of ObjectClassification."""

    UNKNOWN = 0
    CAR = 1
    TRUCK = 2
    BUS = 3
    TRAILER = 4
    MOTORCYCLE = 5
    BICYCLE = 6
    PEDESTRIAN = 7
    ANIMAL = 8
    HAZARD = 9
    OVER_DRIVABLE = 10
    UNDER_DRIVABLE = 11


LABEL_OF_CLASS = {
    'Car': AutowareLabel.CAR,
    'Van': AutowareLabel.CAR,
    'Truck': AutowareLabel.TRUCK,
    'Tram': AutowareLabel.UNKNOWN,
    'Pedestrian': AutowareLabel.PEDESTRIAN,
    'Person': AutowareLabel.PEDESTRIAN,
    'Person_sitting': AutowareLabel.PEDESTRIAN,
    'Person (sitting)': AutowareLabel.PEDESTRIAN,
    'Cyclist': AutowareLabel.BICYCLE,
    'Misc': AutowareLabel.UNKNOWN,
}
"""Of KITTI's classes; label files, tracking and tracklets spell a sitting person differently."""

CLASS_OF_LABEL = {
    AutowareLabel.UNKNOWN: 'Misc',
    AutowareLabel.CAR: 'Car',
    AutowareLabel.TRUCK: 'Truck',
    AutowareLabel.BICYCLE: 'Cyclist',
    AutowareLabel.PEDESTRIAN: 'Pedestrian',
}
"""Labels that are classes of KITTI; others keep their names: Bus, Trailer, Motorcycle."""


def label_of(class_name: str, given: Mapping[str, str]) -> AutowareLabel:
    """Return the label of a class; UNKNOWN unless KITTI or Autoware has a class of this name.

    Args:
        class_name: KITTI's or any other.
        given: Names of labels by class, which take precedence.
    """
    if class_name in given:
        return AutowareLabel[given[class_name]]
    if class_name in LABEL_OF_CLASS:
        return LABEL_OF_CLASS[class_name]
    return AutowareLabel.__members__.get(class_name.upper(), AutowareLabel.UNKNOWN)


def class_of(label: int) -> str:
    """Return the class of a label, that of UNKNOWN for a number without a name."""
    if label not in {each.value for each in AutowareLabel}:
        return CLASS_OF_LABEL[AutowareLabel.UNKNOWN]
    found = AutowareLabel(label)
    return CLASS_OF_LABEL.get(found, found.name.capitalize())


def check_labels(given: Mapping[str, str]) -> None:
    """Check names of labels.

    Raises:
        UsageError: There is no such label.
    """
    known = list(AutowareLabel.__members__)
    for class_name, name in given.items():
        if name not in known:
            raise not_one_of(f'autoware_labels: {class_name}', name, known)
