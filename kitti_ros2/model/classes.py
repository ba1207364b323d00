# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's classes: names of other data sets and of Autoware, and overlaps that they need."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from .errors import not_one_of

if TYPE_CHECKING:
    from collections.abc import Mapping


# The classes of other data sets and detectors as KITTI's.
#
# Names are compared without regard to case, blanks and punctuation, and without a leading "type":
# vehicle.car, VEHICLE_CAR and vehicle car are one. The names are those of
#
# - KITTI (readme.txt of the object devkit; Person and Person (sitting) of tracking and tracklets),
# - nuScenes: categories (docs/instructions_nuscenes.md of its devkit) and detection names,
# - Argoverse 2 (av2/datasets/sensor/constants.py of av2-api, AnnotationCategories),
# - Waymo Open (label.proto, Label.Type),
# - COCO (the names of coco.names),
# - Autoware (autoware_perception_msgs/ObjectClassification).
#
# Numbers have no default: 1 is a car of Autoware, a person of COCO, and a vehicle of Waymo.

KITTI_CLASSES = (
    'Car',
    'Van',
    'Truck',
    'Pedestrian',
    'Person_sitting',
    'Cyclist',
    'Tram',
    'Misc',
    'DontCare',
)
"""The classes of label files (readme.txt of the object devkit)."""

OTHERS = 'Misc'
"""KITTI's class of all other objects, such as trailers. Buses, motorcycles, animals and barriers,
which KITTI's labels do not distinguish, have no name below: users may want to keep theirs."""

_SEPARATORS = re.compile(r'[\W_]+')

_NAMES = {
    'Car': """
        car vehicle sedan suv taxi hatchback passenger_car regular_vehicle vehicle_car
        vehicle_passenger vehicle_emergency_police police_car
        """,
    'Van': 'van minivan vehicle_van vehicle_emergency_ambulance ambulance',
    'Truck': """
        truck pickup pickup_truck lorry vehicle_truck box_truck large_vehicle truck_cab
        vehicle_fire_truck fire_truck
        """,
    'Pedestrian': """
        pedestrian person people human walker adult child man woman human_pedestrian
        walker_pedestrian human_pedestrian_adult human_pedestrian_child
        human_pedestrian_construction_worker human_pedestrian_police_officer official_signaler
        construction_worker police_officer
        """,
    'Person_sitting': 'person_sitting sitting_person pedestrian_sitting_lying_down',
    'Cyclist': """
        cyclist bicyclist bicycle bike cycle vehicle_bicycle vehicle_cycle bicycle_rider
        vehicle_cyclist
        """,
    'Tram': 'tram train streetcar railed_vehicle vehicle_train vehicle_tram',
    'Misc': 'misc unknown other others',
    'DontCare': 'dontcare dont_care ignore',
}
_CLASS_OF = {name: kind for kind, names in _NAMES.items() for name in names.split()}
_OWN = {name.replace('_', '').lower(): name for name in KITTI_CLASSES}


def plain(name: str) -> str:
    """Return a class for comparisons: vehicle.car and VEHICLE CAR are vehicle_car."""
    return _SEPARATORS.sub('_', name).strip('_').lower().removeprefix('type_')


def own_class(name: str) -> str | None:
    """Return the class of KITTI that has a name, in any case; None for another name."""
    return _OWN.get(plain(name).replace('_', ''))


def kitti_class(name: str) -> str | None:
    """Return KITTI's class of a name of another data set, None for an unknown one."""
    return own_class(name) or _CLASS_OF.get(plain(name))


# KITTI's classes as labels of Autoware, and back.
#
# The labels are those of autoware_perception_msgs/ObjectClassification. Several classes have the
# same label, so that the way back is not exact; docs/reference/topics.md has the table with
# reasons.


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
"""KITTI's classes; label files, tracking and tracklets spell a sitting person differently."""

CLASS_OF_LABEL = {
    AutowareLabel.UNKNOWN: 'Misc',
    AutowareLabel.CAR: 'Car',
    AutowareLabel.TRUCK: 'Truck',
    AutowareLabel.BICYCLE: 'Cyclist',
    AutowareLabel.PEDESTRIAN: 'Pedestrian',
}
"""Labels that are classes of KITTI; others keep their names: Bus, Trailer, Motorcycle."""


def label_of(class_name: str, label_names: Mapping[str, str]) -> AutowareLabel:
    """Return the label of a class; UNKNOWN unless KITTI or Autoware has a class of this name.

    Args:
        class_name: KITTI's or any other.
        label_names: Names of labels by class, which take precedence.
    """
    if class_name in label_names:
        return AutowareLabel[label_names[class_name]]
    if class_name in LABEL_OF_CLASS:
        return LABEL_OF_CLASS[class_name]
    return AutowareLabel.__members__.get(class_name.upper(), AutowareLabel.UNKNOWN)


def class_of(label: int) -> str:
    """Return the class of a label, that of UNKNOWN for a number without a name."""
    if label not in {member.value for member in AutowareLabel}:
        return CLASS_OF_LABEL[AutowareLabel.UNKNOWN]
    autoware_label = AutowareLabel(label)
    return CLASS_OF_LABEL.get(autoware_label, autoware_label.name.capitalize())


def check_labels(label_names: Mapping[str, str]) -> None:
    """Check names of labels.

    Raises:
        UsageError: There is no such label.
    """
    labels = list(AutowareLabel.__members__)
    for class_name, name in label_names.items():
        if name not in labels:
            raise not_one_of(f'autoware_labels: {class_name}', name, labels)


# The overlap that a true positive needs, by class.

_VEHICLES = frozenset({'car', 'van', 'truck', 'tram'})
_VEHICLE_OVERLAP, _OTHER_OVERLAP = 0.7, 0.5


@dataclass(frozen=True)
class LeastOverlaps:
    """The intersection over union (IoU) above which a prediction finds a label.

    Attributes:
        by_class: Pairs of a class, in lower case, and its IoU.
        others: IoU of all other classes; None is that of KITTI's devkit.
    """

    by_class: tuple[tuple[str, float], ...] = ()
    others: float | None = None

    def of(self, class_name: str) -> float:
        """Return the IoU of a class, whose case does not matter."""
        name = class_name.lower()
        of_kitti = _VEHICLE_OVERLAP if name in _VEHICLES else _OTHER_OVERLAP
        return dict(self.by_class).get(name, of_kitti if self.others is None else self.others)


KITTI_OVERLAPS = LeastOverlaps()
"""Values of evaluate_object.cpp of the object devkit; other vehicles are as cars."""


# The labels of KITTI-360, whose boxes and pixels have other numbers.

KITTI_360_LABELS = {
    1: (7, 'road'), 2: (9, 'parking'), 3: (8, 'sidewalk'), 4: (22, 'terrain'),
    5: (21, 'vegetation'), 6: (35, 'gate'), 7: (12, 'wall'), 8: (13, 'fence'), 9: (23, 'sky'),
    10: (10, 'rail track'), 11: (11, 'building'), 12: (34, 'garage'), 13: (26, 'car'),
    14: (27, 'truck'), 15: (30, 'trailer'), 16: (29, 'caravan'), 17: (32, 'motorcycle'),
    18: (33, 'bicycle'), 19: (24, 'person'), 20: (25, 'rider'), 21: (17, 'pole'),
    22: (37, 'smallpole'), 23: (19, 'traffic light'), 24: (20, 'traffic sign'), 25: (38, 'lamp'),
    26: (39, 'trash bin'), 27: (40, 'vending machine'), 28: (41, 'box'), 29: (36, 'stop'),
    30: (14, 'guard rail'), 31: (15, 'bridge'), 32: (16, 'tunnel'), 33: (31, 'train'),
    34: (28, 'bus'), 35: (42, 'unknown construction'), 36: (43, 'unknown vehicle'),
    37: (44, 'unknown object'),
}  # fmt: skip
"""By kittiId the id, the number in images, and the label (labels.py of kitti360Scripts)."""

KITTI_360_IMAGE_LABELS = {
    0: 'unlabeled', 1: 'ego vehicle', 2: 'rectification border', 3: 'out of roi', 4: 'static',
    5: 'dynamic', 6: 'ground', 18: 'polegroup', **dict(KITTI_360_LABELS.values()),
}  # fmt: skip
"""By id the label, of all pixels of semantic images."""
