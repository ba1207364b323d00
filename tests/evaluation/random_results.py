# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Random labels and results of a detector, with everything that the benchmark has a rule for."""

from __future__ import annotations

import numpy as np

SIZES_HWL = {
    'Car': (1.5, 1.6, 3.9),
    'Van': (2.2, 1.9, 5.0),
    'Truck': (3.2, 2.6, 10.0),
    'Pedestrian': (1.75, 0.66, 0.84),
    'Person_sitting': (1.27, 0.6, 0.8),
    'Cyclist': (1.74, 0.6, 1.76),
    'Misc': (1.9, 1.5, 3.6),
}
KINDS = (
    *['Car'] * 5,
    *['Pedestrian'] * 3,
    *['Cyclist'] * 3,
    'Van',
    'Person_sitting',
    'Truck',
    'Misc',
)
FOCAL_PX = 720.0
DONT_CARE = 'DontCare -1 -1 -10 {:.2f} {:.2f} {:.2f} {:.2f} -1 -1 -1 -1000 -1000 -1000 -10\n'


def line_of(kind, truncated, occluded, alpha, rectangle, size, place, ry, score=None):
    numbers = [*rectangle, *size, *place, ry]
    words = [
        kind,
        f'{truncated:.2f}',
        f'{occluded}',
        f'{alpha:.2f}',
        *(f'{n:.2f}' for n in numbers),
    ]
    return ' '.join(words + ([] if score is None else [f'{score:.4f}'])) + '\n'


def rectangle_of(size, place):
    """A 2D box that is as high as the camera sees it, also outside of the image."""
    u, v = 610 + FOCAL_PX * place[0] / place[2], 172 + FOCAL_PX * place[1] / place[2]
    height = FOCAL_PX * size[0] / place[2]
    width = height * max(size[2], size[1]) / size[0] * 0.8
    return np.array([u - width / 2, v - height, u + width / 2, v])


def make_frames(count, seed, objects=7):
    """The texts of label files and result files of so many frames."""
    rng = np.random.default_rng(seed)
    labels, results = [], []
    for _ in range(count):
        made, lines = [], []
        for _ in range(rng.poisson(objects) if rng.random() > 0.05 else 0):
            _add_object(made, lines, rng)
        for _ in range(rng.poisson(1.0)):
            left, top = rng.uniform(-50, 1200), rng.uniform(100, 200)
            area = np.array([left, top, left + rng.uniform(20, 200), top + rng.uniform(20, 90)])
            made.append(DONT_CARE.format(*area))
            if rng.random() < 0.6:  # within the region, or partly
                lines.append(_false_positive(rng, area + rng.normal(0, 6, 4)))
        lines += [_false_positive(rng) for _ in range(rng.poisson(1.5))]
        rng.shuffle(made)
        rng.shuffle(lines)
        labels.append(''.join(made))
        results.append(''.join(lines) if rng.random() > 0.03 else '')
    return labels, results


def _add_object(made, lines, rng):
    kind = KINDS[rng.integers(len(KINDS))]
    size = np.array(SIZES_HWL[kind]) * rng.normal(1, 0.05)
    place = np.array([rng.normal(0, 8), 1.7, rng.gamma(3, 8) + 4])
    ry = rng.uniform(-np.pi, np.pi)
    alpha = ry - np.arctan2(place[0], place[2])
    rectangle = rectangle_of(size, place)
    if rng.random() < 0.05:  # on the limits of height
        rectangle[1] = rectangle[3] - (25, 40)[rng.integers(2)]
    truncated = (0.0, 0.0, 0.0, 0.1, 0.15, 0.3, 0.31, 0.5, 0.8)[rng.integers(9)]
    made.append(
        line_of(
            kind,
            truncated,
            rng.integers(4) if rng.random() < 0.5 else 0,
            alpha,
            rectangle,
            size,
            place,
            ry,
        )
    )
    for _ in range(rng.choice([0, 1, 1, 1, 1, 1, 2, 3])):
        noise = rng.choice([0.0, 0.02, 0.06, 0.12])
        turned = ry + rng.normal(0, noise) + (np.pi if rng.random() < 0.15 else 0)
        moved = place + rng.normal(0, 3 * noise, 3) * size[[2, 0, 2]] / 3
        seen = rectangle + rng.normal(0, noise, 4) * np.tile(rectangle[2:] - rectangle[:2], 2)
        said = kind if rng.random() < 0.9 else KINDS[rng.integers(len(KINDS))]
        said = said.lower() if rng.random() < 0.1 else said
        score = round(rng.random(), 1) if rng.random() < 0.5 else rng.normal(0.6, 0.3)
        sized = size * (1 + rng.normal(0, noise, 3))
        lines.append(line_of(said, -1, -1, turned - ry + alpha, seen, sized, moved, turned, score))


def _false_positive(rng, rectangle=None):
    kind = KINDS[rng.integers(len(KINDS))]
    place = np.array([rng.normal(0, 8), 1.7, rng.gamma(3, 8) + 4])
    rectangle = rectangle_of(SIZES_HWL[kind], place) if rectangle is None else rectangle
    angle = rng.uniform(-np.pi, np.pi)
    return line_of(
        kind, -1, -1, angle, rectangle, SIZES_HWL[kind], place, angle, rng.normal(0.4, 0.3)
    )
