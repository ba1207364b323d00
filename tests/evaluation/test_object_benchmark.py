# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's object benchmark: equal to its rules written down again, and cases computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from devkit_rules import evaluate
from random_results import make_frames
from result_folders import dont_care, line, write_frames

from kitti_ros2.evaluation import evaluate_detection
from kitti_ros2.model.boxes import Difficulty

LEVELS = ('easy', 'moderate', 'hard')
SAMPLES = 41


@pytest.fixture
def score(tmp_path):
    """Score the texts of label files and result files by frame."""

    def run(labels, results, **options):
        folders = [
            write_frames(tmp_path / name, texts)
            for name, texts in (('label_2', labels), ('results', results))
        ]
        return evaluate_detection(*folders, **options)

    return run


@pytest.fixture
def repeated(score):
    """Score a frame that occurs 41 times, so that precision is known at each sample of recall."""

    def run(label, result, **options):
        return score([label] * SAMPLES, [result] * SAMPLES, **options)

    return run


def r40(scores, metric, level='easy', class_name='car'):
    return scores.scores[class_name][metric][Difficulty(level)].r40


def differences(scores, expected):
    """Cells that differ by more than the figures are rounded by; the devkit's are 0 for None."""
    plain = scores.percent()['detection']
    return {
        (name, metric, level): (plain[name][metric][level], figures)
        for name, metrics in expected.items()
        for metric, levels in metrics.items()
        for level, figures in levels.items()
        if any(abs((plain[name][metric][level][key] or 0) - figures[key]) > 1e-4 for key in figures)
    }


@pytest.mark.parametrize(('frames', 'seed'), [(300, 0), (120, 1), (40, 2), (5, 3), (1, 4)])
def test_random_sets_are_scored_as_by_the_rules_one_by_one(frames, seed, score):
    labels, results = make_frames(frames, seed)
    scores = score(labels, results)
    expected = evaluate(labels, results)
    assert differences(scores, expected) == {}
    if frames == 300:
        assert all(
            5 < expected[name][metric][level]['R40'] < 95
            for name in expected
            for metric in ('2d', 'bev', '3d', 'aos')
            for level in LEVELS
        )


def test_other_classes_and_limits_are_scored_by_the_same_rules(score):
    labels, results = make_frames(60, 7)
    classes = {'truck': 0.5, 'van': 0.25, 'car': 0.5}
    scores = score(labels, results, classes=classes)
    assert differences(scores, evaluate(labels, results, classes)) == {}
    assert [*scores.scores] == [*classes]


def test_the_loose_table_changes_boxes_on_the_ground_and_in_space_only(score):
    labels, results = make_frames(60, 8)
    loose = {'car': 0.5, 'pedestrian': 0.25, 'cyclist': 0.25}
    scores = score(labels, results, loose=True)
    expected = evaluate(labels, results, loose)
    plain = scores.percent()
    for name, metrics in plain['loose'].items():
        assert set(metrics) == {'bev', '3d'}
        for metric, levels in metrics.items():
            for level, figures in levels.items():
                assert figures == pytest.approx(expected[name][metric][level], abs=1e-4)
    assert (
        scores.scores['car']['bev'][Difficulty.HARD].r40
        < plain['loose']['car']['bev']['hard']['R40']
    )
    assert differences(scores, evaluate(labels, results)) == {}


def test_ground_truth_against_itself_is_100(score):
    rng = np.random.default_rng(5)
    kinds = ['Car', 'Pedestrian', 'Cyclist', 'Van', 'Person_sitting', 'Truck']
    labels = []
    for _ in range(300):
        made = [
            line(
                kinds[rng.integers(len(kinds))],
                (left, 100, left + 40, 100 + (20, 26, 41, 90)[rng.integers(4)]),
                occluded=rng.choice([0, 0, 1, 2, 3]),
                truncated=rng.choice([0, 0, 0.2, 0.4, 0.6]),
                place=(left / 10, 1.7, 20),
                alpha=round(rng.uniform(-3, 3), 2),
                ry=round(rng.uniform(-3, 3), 2),
            )
            for left in range(0, 900, 60)
        ]
        labels.append(''.join([*made, dont_care((900, 100, 1000, 160))]))
    scores = score(labels, labels)
    assert {
        (curve.r40, curve.r11)
        for metrics in scores.scores.values()
        for levels in metrics.values()
        for curve in levels.values()
    } == {(100.0, 100.0)}
    assert any('detections without a score' in note for note in scores.notes)


@pytest.mark.parametrize(
    ('turn', 'similarity'), [(0, 100), (math.pi / 3, 75), (math.pi / 2, 50), (math.pi, 0)]
)
def test_a_wrong_angle_costs_orientation_only(turn, similarity, repeated):
    scores = repeated(line(alpha=0.5), line(alpha=0.5 + turn, score=0.9))
    assert [r40(scores, metric) for metric in ('2d', 'bev', '3d', 'aos')] == pytest.approx(
        [100, 100, 100, similarity]
    )


def test_false_positives_have_similarity_0(repeated):
    wrong = line(area=(500, 100, 600, 200), place=(20, 1.7, 20), score=0.9)
    scores = repeated(line(), line(alpha=0.5 + math.pi / 3, score=0.9) + wrong)
    assert (r40(scores, '2d'), r40(scores, 'aos')) == pytest.approx((50, 37.5))


def test_a_false_positive_of_a_lower_score_costs_nothing(repeated):
    wrong = line(area=(500, 100, 600, 200), place=(20, 1.7, 20), score=0.8)
    assert r40(repeated(line(), line(score=0.9) + wrong), '3d') == 100


def test_the_curve_of_two_scores(score):
    """20 labels are found at 0.9, 21 at 0.5 together with 21 false positives: 41 / 62."""
    wrong = line(area=(500, 100, 600, 200), place=(20, 1.7, 20), score=0.5)
    results = [line(score=0.9)] * 20 + [line(score=0.5) + wrong] * 21
    curve = score([line()] * 41, results).scores['car']['2d'][Difficulty.EASY]
    assert curve.values.tolist() == pytest.approx([1.0] * 20 + [41 / 62] * 21)
    assert curve.r40 == pytest.approx(100 * (19 + 21 * 41 / 62) / 40)
    assert curve.r11 == pytest.approx(100 * (5 + 6 * 41 / 62) / 11)


@pytest.mark.parametrize(('objects', 'highest'), [(1, 0), (10, 22.5), (40, 97.5), (41, 100)])
def test_few_objects_do_not_reach_100(objects, highest, score):
    scores = score([line()] * objects, [line(score=0.9)] * objects)
    assert r40(scores, '3d') == pytest.approx(highest)
    curve = scores.scores['car']['3d'][Difficulty.EASY]
    assert curve.highest_r40 == highest
    noted = f'car easy {objects} (at most {highest:.2f})'
    assert any(noted in note for note in scores.notes) == (objects < 41)


@pytest.mark.parametrize(
    ('kind', 'by', 'precision'),
    [('Van', 'Car', 100), ('Truck', 'Car', 50), ('Person_sitting', 'Pedestrian', 100),
     ('Cyclist', 'Pedestrian', 50)],
)  # fmt: skip
def test_a_neighbour_class_is_ignored(kind, by, precision, repeated):
    other = {'area': (500, 100, 600, 200), 'place': (20, 1.7, 20)}
    labels = line(by) + line(kind, **other)
    results = line(by, score=0.9) + line(by, score=0.9, **other)
    scores = repeated(labels, results)
    for metric in ('2d', 'aos', 'bev', '3d'):
        assert r40(scores, metric, class_name=by.lower()) == pytest.approx(precision)


@pytest.mark.parametrize(('covered', 'in_image'), [(100, 100), (71, 100), (70, 50), (0, 50)])
def test_a_dont_care_region_excuses_in_the_image_only(covered, in_image, repeated):
    labels = line() + dont_care((500, 100, 500 + covered, 200))
    wrong = line(area=(500, 100, 600, 200), place=(20, 1.7, 20), score=0.9)
    scores = repeated(labels, line(score=0.9) + wrong)
    assert [r40(scores, metric) for metric in ('2d', 'aos')] == pytest.approx([in_image] * 2)
    assert [r40(scores, metric) for metric in ('bev', '3d')] == pytest.approx([50, 50])


def test_a_dont_care_region_may_be_smaller_than_it_excuses(repeated):
    """The share is of the detection, not of the union."""
    labels = line() + dont_care((0, 0, 1000, 1000))
    wrong = line(area=(500, 100, 600, 200), place=(20, 1.7, 20), score=0.9)
    assert r40(repeated(labels, line(score=0.9) + wrong), '2d') == 100


@pytest.mark.parametrize(
    ('limits', 'counts'),
    [
        ({'area': (100, 100, 200, 140)}, (0, 1, 1)),  # of exactly 40 px
        ({'area': (100, 100, 200, 140.01)}, (1, 1, 1)),
        ({'area': (100, 100, 200, 125)}, (0, 0, 0)),
        ({'area': (100, 100, 200, 125.01)}, (0, 1, 1)),
        ({'truncated': 0.15}, (1, 1, 1)),
        ({'truncated': 0.16}, (0, 1, 1)),
        ({'truncated': 0.3}, (0, 1, 1)),
        ({'truncated': 0.5}, (0, 0, 1)),
        ({'truncated': 0.51}, (0, 0, 0)),
        ({'occluded': 1}, (0, 1, 1)),
        ({'occluded': 2}, (0, 0, 1)),
        ({'occluded': 3}, (0, 0, 0)),
        ({'occluded': -1, 'truncated': -1}, (1, 1, 1)),
    ],
)
def test_limits_of_the_levels(limits, counts, score):
    scores = score([line(**limits)], [line(score=0.9)])
    levels = scores.scores['car']['3d']
    assert tuple(levels[level].objects for level in Difficulty) == counts


def test_labels_that_do_not_count_excuse_their_detections(repeated):
    hidden = {'area': (500, 100, 600, 200), 'place': (20, 1.7, 20)}
    labels = line() + line(occluded=2, **hidden)
    scores = repeated(labels, line(score=0.9) + line(score=0.9, **hidden))
    assert [r40(scores, '3d', level) for level in LEVELS] == pytest.approx([100, 100, 100])
    assert [scores.scores['car']['3d'][level].objects for level in Difficulty] == [41, 41, 82]


def test_a_low_detection_takes_its_label_without_finding_it(repeated):
    """39.9 px are not enough at level easy, where the label of 41 px counts."""
    scores = repeated(line(area=(100, 100, 200, 141)), line(area=(100, 100, 200, 139.9), score=0.9))
    assert [r40(scores, '2d', level) for level in LEVELS] == pytest.approx([0, 100, 100])


def test_a_low_detection_of_any_class_takes_the_label_of_a_lower_score(repeated):
    label = line(area=(100, 100, 200, 126))
    low = line('Misc', area=(100, 100, 200, 124.9), score=0.9)
    right = line(area=(100, 100, 200, 126), score=0.8)
    assert r40(repeated(label, low + right), '2d', 'hard') == 0
    other = line('Misc', area=(100, 100, 200, 125.1), score=0.9)
    assert r40(repeated(label, other + right), '2d', 'hard') == 100


def test_a_label_is_found_once(repeated):
    twice = line(score=0.9) + line(score=0.9)
    assert r40(repeated(line(), twice), '3d') == pytest.approx(50)
    assert r40(repeated(line(), line(score=0.9) + line(score=0.8)), '3d') == 100


def test_labels_choose_in_the_order_of_the_file(repeated):
    """The first label takes the detection of the greatest overlap, and leaves the other worse off.

    A detection overlaps both labels enough; another one the first label only.
    """
    first, second = line(area=(100, 100, 200, 200)), line(area=(100, 100, 200, 180))
    results = line(area=(100, 100, 200, 195), score=0.9) + line(
        area=(100, 120, 200, 205), score=0.9
    )
    scores = repeated(first + second, results)
    curve = scores.scores['car']['2d'][Difficulty.EASY]
    assert curve.values.tolist() == pytest.approx([0.5] * 21 + [0.0] * 20)  # 41 of 82 labels
    assert r40(repeated(second + first, results), '2d') == pytest.approx(100)


def test_an_overlap_of_exactly_the_limit_is_no_match(repeated):
    label = line('Pedestrian', area=(100, 100, 200, 200))
    half = line('Pedestrian', area=(100, 100, 200, 150), score=0.9)
    more = line('Pedestrian', area=(100, 100, 200, 150.1), score=0.9)
    assert r40(repeated(label, half), '2d', class_name='pedestrian') == 0
    assert r40(repeated(label, more), '2d', class_name='pedestrian') == pytest.approx(100)


def test_an_invalid_angle_switches_orientation_off_for_all_classes(repeated):
    labels = line() + line('Cyclist', (500, 100, 600, 200))
    results = line(score=0.9) + line('Cyclist', (500, 100, 600, 200), score=0.9)
    misc = line('Misc', (800, 100, 900, 200), score=0.1, alpha=-10)
    scores = repeated(labels, results + misc)
    for name in ('car', 'cyclist'):
        assert set(scores.scores[name]['aos'].values()) == {None}
        assert r40(scores, '2d', class_name=name) == pytest.approx(100)
    assert scores.percent()['detection']['car']['aos']['easy'] == {'R40': None, 'R11': None}
    assert sum('alpha -10' in note for note in scores.notes) == 3
    with_region = repeated(labels, results + dont_care((800, 100, 900, 200)))
    assert r40(with_region, 'aos') == pytest.approx(100)


def test_a_space_without_boxes_is_not_evaluated(repeated):
    flat = {'size': (-1, -1, -1), 'place': (-1000, -1000, -1000), 'ry': -10}
    scores = repeated(line(), line(score=0.9, **flat))
    assert set(scores.scores['car']['3d'].values()) == {None}
    assert set(scores.scores['car']['bev'].values()) == {None}
    assert r40(scores, '2d') == pytest.approx(100)


def test_boxes_in_space_without_one_in_the_image_are_ignored_and_noted(repeated):
    scores = repeated(line(), line(area=(-1, -1, -1, -1), score=0.9))
    assert r40(scores, '3d') == 0
    assert any('project the 3D boxes into the image' in note for note in scores.notes)


def test_a_class_that_is_never_detected_scores_0(repeated):
    scores = repeated(line('Cyclist'), line(score=0.9))
    assert r40(scores, '3d', class_name='cyclist') == 0
    assert any('no detection of this class' in note for note in scores.notes)


def test_names_of_classes_are_compared_without_case(repeated):
    scores = repeated(line('CAR') + line('vAn', (500, 100, 600, 200)), line('cAr', score=0.9))
    assert r40(scores, '2d') == pytest.approx(100)


def test_numbers_of_any_size_are_scored(score):
    wild = line(place=(1e300, -1e300, 1e300), size=(1e-300, 1e200, 1e200), score=-1e300)
    inverted = line(area=(200, 200, 100, 100), size=(-1, -2, 3), score=1e300)
    labels = line() + line(place=(1e300, 0, 0), size=(0, 0, 0))
    scores = score([labels, ''], [wild + inverted, wild])
    assert r40(scores, '3d', 'hard') == 0
