# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of other data sets and detectors as KITTI's.

Names are compared without regard to case, blanks and punctuation, and without a leading "type":
vehicle.car, VEHICLE_CAR and vehicle car are one. The names are those of

- KITTI (readme.txt of the object devkit; Person and Person (sitting) of tracking and tracklets),
- nuScenes: categories (docs/instructions_nuscenes.md of its devkit) and detection names,
- Argoverse 2 (av2/datasets/sensor/constants.py of av2-api, AnnotationCategories),
- Waymo Open (label.proto, Label.Type),
- COCO (the names of coco.names),
- Autoware (autoware_perception_msgs/ObjectClassification).

Numbers have no default: 1 is a car of Autoware, a person of COCO, and a vehicle of Waymo.
"""

from __future__ import annotations

import re

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
which KITTI's labels do not tell apart, have no name below: users may want to keep theirs."""

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
