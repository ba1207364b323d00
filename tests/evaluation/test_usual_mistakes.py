# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The usual mistakes are named by a note; sound results and noise are not accused of any."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import mistaken_poses
import mistaken_results
import numpy as np
import pytest
from mistaken_poses import drive, odometry
from mistaken_results import NAMES, detected, labels_of, noise
from random_results import line_of

from kitti_ros2.evaluation.box_mistakes import (
    diagnose_detections,
    diagnose_predictions,
    diagnose_tracks,
)
from kitti_ros2.evaluation.pose_mistakes import diagnose_keyframes, diagnose_poses
from kitti_ros2.evaluation.track_metrics import TrackBox
from kitti_ros2.kitti.label_file import ResultFiles
from kitti_ros2.model.boxes import Box

_SETS, _LEAST = 20, 19
_SOUND = 40


def notes_on(labels, detections):
    """The notes; the first frame is 10, and results have that before and that after them."""
    moved = (replace(table, frame=table.frame + 1) for table in (labels, detections))
    return [*diagnose_detections('results', NAMES, *moved, range(9, 31))]


def notes_on_poses(truth, result):
    count = min(len(truth), len(result))
    numbers = np.arange(count)
    return [*diagnose_keyframes('result', truth, result)] or [
        *diagnose_poses('result', numbers, truth[:count], result[:count])
    ]


@pytest.mark.parametrize('name', mistaken_results.MISTAKES)
def test_mistake_in_boxes_is_named(name):
    plant, part = mistaken_results.MISTAKES[name]
    named = 0
    for seed in range(_SETS):
        rng = np.random.default_rng(seed)
        labels = labels_of(rng)
        named += any(part in note for note in notes_on(labels, plant(detected(labels, rng), rng)))
    assert named >= _LEAST


@pytest.mark.parametrize('make', [detected, noise])
def test_sound_detections_and_noise_have_no_note(make):
    for seed in range(_SOUND):
        rng = np.random.default_rng(1000 + seed)
        labels = labels_of(rng)
        assert notes_on(labels, make(labels, rng)) == []


def test_boxes_of_an_image_alone_have_no_note():
    rng = np.random.default_rng(0)
    labels = labels_of(rng, 200)
    boxes = detected(labels, rng)
    nothing = np.full((len(boxes), 3), -1000.0)
    yaw = np.full(len(boxes), -10.0)
    boxes = replace(boxes, location=nothing, size_hwl=nothing / 1000, rotation_y=yaw)
    assert notes_on(labels, boxes) == []


def test_few_boxes_have_no_note():
    rng = np.random.default_rng(0)
    labels = labels_of(rng, 8)
    plant, _ = mistaken_results.MISTAKES['scanner']
    assert notes_on(labels, plant(detected(labels, rng), rng)) == []


def test_labels_without_2d_boxes_are_named():
    rng = np.random.default_rng(0)
    labels = labels_of(rng, 60)
    note = notes_on(replace(labels, box_2d=0 * labels.box_2d), detected(labels, rng))[0]
    assert note.startswith('car: all ')
    assert 'labels have a 2D box lower than 25 px, or none' in note


@pytest.mark.parametrize('name', mistaken_poses.MISTAKES)
def test_mistake_in_poses_is_named(name):
    plant, part = mistaken_poses.MISTAKES[name]
    for seed in range(3):
        rng = np.random.default_rng(seed)
        truth = drive(rng)
        (note,) = notes_on_poses(truth, plant(odometry(truth, rng), rng))
        assert part in note


def test_sound_odometry_and_another_drive_have_no_note():
    for seed in range(4):
        rng = np.random.default_rng(1000 + seed)
        truth = drive(rng, 400)
        assert notes_on_poses(truth, odometry(truth, rng)) == []
        assert notes_on_poses(truth, odometry(drive(rng, 400), rng)) == []


def test_standing_still_has_no_note():
    still = np.tile(np.eye(4), (100, 1, 1))
    assert notes_on_poses(still, still) == []
    assert notes_on_poses(still[:2], still[:2]) == []
    assert notes_on_poses(still[:1], still[:1]) == []


def tracks_of(rng, frames=30, objects=8):
    """Tracks of objects that move across the image."""
    at = rng.uniform([0, 150], [1100, 170], (objects, 2))
    size = rng.uniform([50, 40], [140, 90], (objects, 2))
    speed = rng.uniform(-4, 4, objects)
    boxes = []
    for frame, track in product(range(frames), range(objects)):
        left, top = at[track] + [frame * speed[track], 0]
        flat = (left, top, left + size[track, 0], top + size[track, 1])
        box = Box('Car', 0.0, 0, 0.0, flat, (1.5, 1.6, 4.0), (1.0, 1.6, 20.0), 0.0, 0.9)
        boxes.append(TrackBox('car', frame, track, box))
    return boxes


def _numbered_in_frame(boxes, rng):
    order = {frame: rng.permutation(8).tolist() for frame in range(30)}
    return [box._replace(track_id=order[box.frame][box.track_id]) for box in boxes]


def _numbered_from_1(boxes, _):
    return [box._replace(frame=box.frame + 1) for box in boxes]


@pytest.mark.parametrize(
    ('plant', 'part'),
    [
        (_numbered_in_frame, 'have another id'),
        (lambda boxes, _: [box._replace(track_id=i) for i, box in enumerate(boxes)], 'another id'),
        (
            lambda boxes, _: [
                box._replace(box=replace(box.box, box_2d=(-1.0, -1.0, -1.0, -1.0))) for box in boxes
            ],
            'none of 240 boxes has a 2D box',
        ),
        (_numbered_from_1, 'numbered one too high'),
    ],
)
def test_mistake_in_tracks_is_named(plant, part):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        labels = tracks_of(rng)
        notes = [*diagnose_tracks('0000', labels, plant(labels, rng))]
        assert any(part in note for note in notes), notes


def test_sound_tracks_have_no_note():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        labels = tracks_of(rng)
        assert [
            *diagnose_tracks('0000', labels, [box for box in labels if rng.random() < 0.8])
        ] == []
        assert [*diagnose_tracks('0000', labels, tracks_of(rng))] == []
        assert [*diagnose_tracks('0000', labels, [])] == []


def write_files(folder, table, *, scored=False):
    folder.mkdir(parents=True)
    for frame in range(20):
        rows = np.flatnonzero(table.frame == frame)
        lines = [
            line_of(
                table.class_names[table.class_index[row]].title(),
                0,
                0,
                table.alpha[row],
                table.box_2d[row],
                table.size_hwl[row],
                table.location[row],
                table.rotation_y[row],
                table.score[row] if scored else None,
            )
            for row in rows
        ]
        (folder / f'{frame:06d}.txt').write_text(''.join(lines))


def test_mistake_in_files_of_predictions_is_named(tmp_path):
    rng = np.random.default_rng(0)
    labels = labels_of(rng, 120)
    plant, part = mistaken_results.MISTAKES['scanner']
    predictions = plant(detected(labels, rng), rng)
    write_files(tmp_path / 'object/training/label_2', labels)
    write_files(tmp_path / 'results', predictions, scored=True)
    readers = [ResultFiles(tmp_path / name).read for name in ('object/training/label_2', 'results')]
    notes = [*diagnose_predictions('results', readers, range(25))]
    assert len(notes) == 1
    assert part in notes[0]
