# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames with the most errors: their order, their reasons, their pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from prediction_set import LABELS, RESULTS, line, write_prediction_set

from kitti_ros2 import evaluation
from kitti_ros2.drawing.labelled_objects import VERDICT_COLORS
from kitti_ros2.evaluation import worst_frames
from kitti_ros2.evaluation.error_pictures import draw_worst_frames
from kitti_ros2.kitti.label_file import parse_box
from kitti_ros2.model.classes import LeastOverlaps
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.recording_frames import open_frames


def boxes(frames):
    return {number: [parse_box(line(*box)) for box in some] for number, some in frames.items()}


TRUTH, FOUND = boxes(LABELS), boxes(RESULTS)


def test_misses_and_the_scores_of_false_positives_add_up():
    """Frame 0: a miss, 0.8. 1: a miss, 0.6 (IoU 0.6). 2: 0.4. 4: two misses. 3 has no labels."""
    ranked = worst_frames(TRUTH, FOUND)
    assert [(frame.number, frame.missed, frame.false_positives) for frame in ranked] == [
        (4, 2, 0),
        (0, 1, 1),
        (1, 1, 1),
        (2, 0, 1),
    ]
    assert [frame.penalty for frame in ranked] == pytest.approx([2.0, 1.8, 1.6, 0.4])
    assert [frame.reason for frame in ranked] == [
        'missed: 1 Car, 1 Cyclist',
        'missed: 1 Car; false positive: Car 0.80',
        'missed: 1 Car; false positive: Car 0.60',
        'false positive: Pedestrian 0.40',
    ]


def test_frames_without_errors_are_left_out():
    ranked = worst_frames(TRUTH, FOUND, overlaps=LeastOverlaps((), 0.5))
    assert [frame.number for frame in ranked] == [4, 0, 2]
    assert worst_frames(TRUTH, TRUTH) == []
    assert worst_frames({}, FOUND) == []


def test_only_so_many_are_returned_and_ties_are_by_number():
    truth = boxes({number: [('Car', 0, 20)] for number in (9, 3, 7)})
    assert [frame.number for frame in worst_frames(truth, {})] == [3, 7, 9]
    assert [frame.number for frame in worst_frames(truth, {}, 2)] == [3, 7]


def test_scores_of_any_scale_are_weights_from_0_to_1():
    """-4 is the lowest score and 6 the highest: 1 is in the middle."""
    results = boxes({0: [('Car', 0, 20, -4)], 1: [('Car', 0, 20, 6), ('Car', 9, 20, 1)]})
    ranked = worst_frames({0: [], 1: []}, results)
    assert [(frame.number, frame.penalty) for frame in ranked] == [(1, 1.5), (0, 0.0)]
    assert ranked[0].reason == 'false positives: Car 6.00, Car 1.00'


@pytest.mark.parametrize('score', [None, 7])
def test_equal_scores_and_none_count_as_1(score):
    results = boxes({0: [('Car', x, 20, score) for x in (0, 5, 10, 15)]})
    [frame] = worst_frames({0: []}, results)
    assert frame.penalty == 4.0
    assert frame.reason.endswith(' and 1 more')


def test_the_names_of_the_library():
    assert {'WorstFrame', 'worst_frames'} <= set(evaluation.__all__)
    assert evaluation.worst_frames is worst_frames


@pytest.fixture
def made(recordings, tmp_path):
    return write_prediction_set(recordings[Layout.OBJECT], tmp_path)


def test_the_worst_frames_are_drawn_in_order(made, tmp_path):
    ranked = worst_frames(TRUTH, FOUND, 3)
    source = open_frames(made.root, ReadOptions())
    (tmp_path / 'out').mkdir()
    done = []
    losses = draw_worst_frames(source, ranked, FOUND, tmp_path / 'out', progress=done.append)
    assert losses == ()
    assert done == [1, 2, 3]
    names = ['01_000004.png', '02_000000.png', '03_000001.png']
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == names
    height = source.frame(4).images[2].shape[0]
    pictures = [cv2.imread(str(tmp_path / 'out' / name)) for name in names]
    assert all(picture.shape[0] > height for picture in pictures), 'the reason is above the image'
    missed, wrong = (
        [(np.abs(picture.astype(int) - rgb[::-1]) < 8).all(axis=2).any() for picture in pictures]
        for rgb in (VERDICT_COLORS['FN'], VERDICT_COLORS['FP'])
    )
    assert missed == [True, True, True]
    assert wrong == [False, True, True]


def test_missing_and_damaged_data_is_a_loss(made, tmp_path):
    """The other parts of the picture are drawn."""
    ranked = worst_frames(TRUTH, FOUND)
    (made.root / 'training/image_2/000000.png').unlink()
    (made.root / 'training/image_2/000001.png').write_bytes(b'')
    (made.root / 'training/image_2/000003.png').unlink()
    source = open_frames(made.root, ReadOptions())
    losses = draw_worst_frames(source, ranked, FOUND, tmp_path)
    assert [(loss.stream, loss.numbers) for loss in losses] == [
        ('image_2', (0,)),
        ('image_2', (1,)),
    ]
    assert len(list(tmp_path.glob('*.png'))) == len(ranked)
