# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of random objects, results of passable detectors, and the usual mistakes in these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from random_results import SIZES_HWL, rectangle_of

from kitti_ros2.evaluation.object_benchmark import ObjectTable

NAMES = ('car', 'pedestrian', 'cyclist')
SIZES = np.array([SIZES_HWL[name.title()] for name in NAMES])


def flatten(size, place):
    return np.array([rectangle_of(*row) for row in zip(size, place, strict=True)]).reshape(-1, 4)


def labels_of(rng, count=None, frames=20):
    """Labels of 60 to 300 objects, most of them cars along the street."""
    count = int(rng.integers(60, 301)) if count is None else count
    kind = rng.choice(3, count, p=[0.6, 0.25, 0.15])
    size = SIZES[kind] * rng.normal(1, 0.08, (count, 3))
    depth = rng.uniform(6, 50, count)
    aside = rng.uniform(-0.7, 0.7, count) * depth
    place = np.stack([aside, rng.normal(1.65, 0.1, count), depth], axis=1)
    along = rng.choice([-np.pi / 2, np.pi / 2], count) + rng.normal(0, 0.15, count)
    yaw = np.where(rng.random(count) < 0.5, along, rng.uniform(-np.pi, np.pi, count))
    return ObjectTable(
        np.sort(rng.integers(0, frames, count)),
        NAMES,
        kind,
        flatten(size, place),
        size,
        place,
        yaw,
        yaw - np.arctan2(place[:, 0], depth),
        np.zeros(count),
        np.zeros(count),
        np.ones(count),
    )


def some(table, rows):
    columns = ('frame', 'class_index', 'box_2d', 'size_hwl', 'location', 'rotation_y', 'alpha')
    columns += ('truncated', 'occluded', 'score')
    return replace(table, **{name: getattr(table, name)[rows] for name in columns})


def joined(*tables):
    columns = ('frame', 'class_index', 'box_2d', 'size_hwl', 'location', 'rotation_y', 'alpha')
    columns += ('truncated', 'occluded', 'score')
    both = {name: np.concatenate([getattr(t, name) for t in tables]) for name in columns}
    whole = replace(tables[0], **both)
    return some(whole, np.argsort(whole.frame, kind='stable'))


def detected(labels, rng, *, monocular=None):
    """Results of a passable detector: some misses, some false positives, errors, turned boxes."""
    monocular = rng.random() < 0.5 if monocular is None else monocular
    seen = some(labels, np.flatnonzero(rng.random(len(labels)) < rng.uniform(0.6, 1.0)))
    count = len(seen)
    scale = rng.normal(1, 0.06, (count, 1)) if monocular else 1.0
    place = seen.location * scale + rng.normal(0, 0.1, (count, 3))
    size = seen.size_hwl * rng.normal(1, 0.1 if monocular else 0.05, (count, 3))
    yaw = seen.rotation_y + rng.normal(0, 0.2 if monocular else 0.07, count)
    yaw = yaw + np.pi * (rng.random(count) < 0.2)
    sides = seen.box_2d[:, 2:] - seen.box_2d[:, :2]
    flat = seen.box_2d + rng.normal(0, 0.04, (count, 4)) * np.tile(sides, 2)
    yaw = (yaw + np.pi) % (2 * np.pi) - np.pi
    found = replace(seen, location=place, size_hwl=size, rotation_y=yaw, box_2d=flat)
    found = replace(found, score=rng.beta(5, 2, count))
    false = labels_of(rng, int(0.3 * count) + 1, int(labels.frame.max()) + 1)
    return joined(found, replace(false, score=rng.beta(2, 5, len(false))))


def noise(labels, rng):
    """Boxes of nothing, some at the places of labels in the image."""
    boxes = labels_of(rng, len(labels), int(labels.frame.max()) + 1)
    at = rng.integers(0, len(labels), len(labels) // 2)
    copied = replace(
        some(boxes, np.arange(len(at))), box_2d=labels.box_2d[at], frame=labels.frame[at]
    )
    size = rng.uniform(0.3, 5, (len(at), 3))
    place = rng.uniform([-30, -3, -5], [30, 3, 60], (len(at), 3))
    copied = replace(copied, size_hwl=size, location=place)
    boxes = joined(some(boxes, np.arange(len(at), len(boxes))), copied)
    return replace(boxes, score=rng.random(len(boxes)))


def _sizes(*order):
    return lambda table, _: replace(table, size_hwl=table.size_hwl[:, order])


def _yaw(change):
    return lambda table, _: replace(table, rotation_y=change(table))


def _scanner(table, _):
    x, y, z = table.location.T
    return replace(table, location=np.stack([z, -x, -y], 1))


def _centre(table, _):
    return replace(table, location=table.location - [0, 0.5, 0] * table.size_hwl[:, :1])


def _all_of_lidar(table, rng):
    """Boxes as OpenPCDet and mmdet3d have them: centre, l w h, yaw, all in the scanner's axes."""
    table = _scanner(_centre(table, rng), rng)
    yaw = -table.rotation_y - np.pi / 2
    return replace(table, size_hwl=table.size_hwl[:, [2, 1, 0]], rotation_y=yaw)


def _renamed(table, _):
    return replace(table, class_names=('vehicle', 'person', 'bike'))


def _shifted(by):
    return lambda table, _: replace(table, frame=table.frame + by)


def _other_split(table, rng):
    other = labels_of(rng, len(table), int(table.frame.max()) + 1)
    return replace(other, score=table.score)


MISTAKES = {
    'length and width exchanged': (_sizes(0, 2, 1), 'height length width;'),
    'order l w h': (_sizes(2, 1, 0), 'length width height;'),
    'order l h w': (_sizes(2, 0, 1), 'length height width;'),
    'order w l h': (_sizes(1, 2, 0), 'width length height;'),
    'centre': (_centre, 'half their height too high'),
    'scanner': (_scanner, 'the axes of the scanner'),
    'yaw of scanner': (_yaw(lambda t: -t.rotation_y - np.pi / 2), 'the yaw of the scanner'),
    'sign of yaw': (_yaw(lambda t: -t.rotation_y), 'of the other sign'),
    'quarter': (_yaw(lambda t: t.rotation_y - np.pi / 2), 'a quarter of a turn'),
    'alpha': (
        _yaw(lambda t: t.rotation_y - np.arctan2(t.location[:, 0], t.location[:, 2])),
        'as alpha',
    ),
    'degrees': (_yaw(lambda t: np.degrees(t.rotation_y)), 'an angle in degrees'),
    'scanner in degrees': (
        _yaw(lambda t: np.degrees(-t.rotation_y - np.pi / 2)),
        'the yaw of the scanner (counterclockwise from x forward: rotation_y = -yaw - pi/2) in deg',
    ),
    'boxes of lidar': (_all_of_lidar, 'the axes of the scanner'),
    'percent': (lambda t, _: replace(t, score=100 * t.score), 'percent?'),
    'equal scores': (lambda t, _: replace(t, score=np.ones(len(t))), 'scores are 1;'),
    'names': (_renamed, 'are named vehicle'),
    'one late': (_shifted(1), 'numbered one too high'),
    'one early': (_shifted(-1), 'numbered one too low'),
    'other split': (_other_split, 'another split'),
}
"""By name: what plants it, and a part of its note."""
